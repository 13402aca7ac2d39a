/* Track irregularities by distance, read from irregularity.csv. */
#ifndef FULL_VEHICLE_IRREGULARITY_H
#define FULL_VEHICLE_IRREGULARITY_H

#include <stdbool.h>
#include <stddef.h>

/* Of the track at one place, m: alignment to the right, level upwards, left rail above right, gauge widening. */
typedef struct {
    double lateral, vertical, cant, gauge;
} Unevenness;

typedef struct {
    double first, step; /* m */
    size_t n;
    bool level; /* every row is zero */
    Unevenness *rows;
} Irregularity;

/* False, and one line in message, when the file is no table of irregularities over a uniform grid, in m. */
bool irregularity_read(Irregularity *table, const char *path, char *message, size_t size);

/* Value and slope (per metre of track) at a distance: cubic between the rows with the slopes of central differences,
 * held before the first row and after the last. */
void irregularity_at(const Irregularity *table, double distance, Unevenness *value, Unevenness *slope);

#endif
