/* Reading a CSV file of numbers by the names of its columns. */
#ifndef FULL_VEHICLE_CSV_COLUMNS_H
#define FULL_VEHICLE_CSV_COLUMNS_H

#include <stdbool.h>
#include <stddef.h>

/* The n named columns of the file, row by row (values[row * n + column]), in the order of names; free it. Lines that
 * begin with # are comments, the first other line holds the names, columns that are not asked for are left out. NULL,
 * and one line in message, when the file cannot be read, lacks a column, or holds something that is no finite number.
 * Numbers have a decimal point, whatever the locale of the host. */
double *csv_columns(const char *path, const char *const names[], size_t n, size_t *rows, char *message, size_t size);

/* Whether the first of the n columns, whose name this is, rises by the same step (to 0.1 %) from row to row; one line in
 * message where it does not. rows: at least 2. */
bool csv_uniform(const double *values, size_t rows, size_t n, const char *name, const char *path, char *message,
                 size_t size);

#endif
