/* The whole vehicle at one moment: where every body is, what acts on it, how it accelerates. */
#ifndef FULL_VEHICLE_VEHICLE_H
#define FULL_VEHICLE_VEHICLE_H

#include <stdbool.h>

#include "primary.h"
#include "secondary.h"
#include "track.h"
#include "wheel_rail.h"

struct Resources {
    ContactTable contact;
    Irregularity irregularity;
};

/* The states of one kind lie side by side in v, in the order of the structures here (vehicle.c asserts it). */
enum { BODIES = 3 + WHEELSETS, AXLEBOXES = 2 * WHEELSETS, MOTIONS = 6 * 3 + 5 * WHEELSETS };

typedef struct {
    Track track;
    Joint secondary_joint[BOGIES], primary_joint[WHEELSETS];
    Axlebox axlebox[AXLEBOXES]; /* 1l, 1r, 2l, ... */
    Secondary secondary[BOGIES];
    WheelForce wheel[AXLEBOXES];                 /* mirrored, as wheel_rail.h says */
    double wheel_y[AXLEBOXES];                   /* displacement at which the contact table was read, m */
    Six car, frame[BOGIES], wheelset[WHEELSETS]; /* accelerations in the track's frame */
} Vehicle;

/* level: on a straight track without irregularities, at a steady speed. */
void vehicle_evaluate(const struct Resources *resources, const double *v, bool level, Vehicle *vehicle);

/* Displacements of wheelsets have no x: their motion along the track is the speed's. */
Six six_of_body(const double *states);
Six six_of_wheelset(const double *states);

#endif
