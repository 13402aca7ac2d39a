/* The track's frame below every body: curve, cant, and what their motion along the track asks of the bodies.
 *
 * Curvature and cant go from the straight to the arc and back after Bloss, 3 xi^2 - 2 xi^3, so that the roll rate of
 * the track is continuous; cant turns the track about its centre line. The frame of a wheelset sits on the track's
 * centre line, that of a bogie frame or of the car body on the chord between its wheelsets or bogies: in a curve every
 * displacement from these frames stays small, and what joins two bodies sees only the difference of their headings and
 * cants. */
#ifndef FULL_VEHICLE_TRACK_H
#define FULL_VEHICLE_TRACK_H

#include <stdbool.h>

#include "irregularity.h"

enum { WHEELSETS = 4, BOGIES = 2, LEFT = 0, RIGHT = 1 };

/* A body's frame. */
typedef struct {
    double offset, slope, curvature;                    /* of its origin: m, 1, 1/m, positive to the right */
    double heading, heading_rate, heading_acceleration; /* rad, rad/s, rad/s2 */
    double cant, cant_rate, cant_acceleration;          /* roll of the frame */
    double lateral, vertical;                           /* acceleration in the frame of what falls freely, m/s2 */
} TrackFrame;

/* A rail below a wheel, m and m/s. */
typedef struct {
    double y, z, y_rate, z_rate;
} Rail;

typedef struct {
    double speed, speed_rate; /* m/s, m/s2 */
    TrackFrame car, frame[BOGIES], wheelset[WHEELSETS];
    Rail rail[WHEELSETS][2];
} Track;

/* Shortest radius, m: the small angles between car body, bogies and track stay below 0.09 rad. */
#define SHORTEST_RADIUS 100.0
#define SLOWEST 5.0
#define FASTEST 600.0

/* speed and speed_change, kept between SLOWEST and FASTEST; held says whether that was needed. */
double running_speed(const double *v, double *rate, bool *held);

/* v: the model's variables. level: straight, without irregularities, at a steady speed, wherever the vehicle is. */
void track_below(const Irregularity *irregularity, const double *v, bool level, Track *track);

#endif
