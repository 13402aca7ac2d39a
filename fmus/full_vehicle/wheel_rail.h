/* Contact of one wheel with its rail: Hertz spring along the normal, Kalker's linear creep forces for the ellipse,
 * whose semi-axes grow with the root of the approach (with the cube root of the elastic normal force, that is),
 * saturation after Shen, Hedrick and Elkins. Both wheels are written in mirrored coordinates, y outward to the rail's
 * field side, so that left and right give the same numbers to the bit. */
#ifndef FULL_VEHICLE_WHEEL_RAIL_H
#define FULL_VEHICLE_WHEEL_RAIL_H

#include <math.h>

#include "contact.h"
#include "contact_table.h"

/* Parameters of every contact. */
typedef struct {
    double speed;             /* m/s */
    double rolling;           /* nominal rotation speed / r0, rad/s */
    double half_base, radius; /* running circles, m; r0 */
    double friction, shear_modulus;
    double approach; /* of wheel and rail at TABLE_LOAD, m */
    double damping;  /* of the normal motion at TABLE_LOAD, N s/m */
} WheelRail;

/* The wheelset's centre, mirrored: y outward, roll with this side down, yaw with the front outward; m, rad. */
typedef struct {
    double y, z; /* against the rail */
    double roll, yaw;
    double y_rate, z_rate, roll_rate; /* in the track's frame */
    double rail_y_rate, rail_z_rate;  /* of the rail below the wheel, because the wheel moves on */
    double turning;                   /* yaw rate, with that of the track's heading, rad/s */
    double spin;                      /* rotation beyond nominal rolling, rad/s */
} WheelMotion;

typedef struct {
    double x, y, z;          /* force of the rail on the wheel, y outward, N */
    double roll, pitch, yaw; /* its moment about the wheelset's centre, mirrored, N m */
    double normal, slope;    /* N; tan of the contact angle in the track plane */
    double arm;              /* of the contact point from the middle of the axle, m */
} WheelForce;

static inline WheelForce wheel_force(const ContactTable *table, const WheelRail *w, const WheelMotion *m)
{
    const double e_rate = m->y_rate - w->radius * m->roll_rate;
    const ContactPoint c = contact_table_at(table, m->y - w->radius * m->roll);
    const double arm = w->half_base + c.across;
    /* the wheel rolls about its running circle: the contact point, c.across away, sinks, and its slope turns with it */
    const double slope = c.slope + m->roll * c.across_gain;
    const double overlap = c.lift - m->z + arm * m->roll;
    WheelForce f = {.slope = slope, .arm = arm};
    if (!(overlap > 0.0))
        return f;
    const double secant = sqrt(1.0 + slope * slope), cosine = 1.0 / secant, sine = slope * cosine;
    const double approach = overlap * cosine / w->approach,
                 size = sqrt(approach); /* of the ellipse, against TABLE_LOAD */
    const double approach_rate =
        (slope * (e_rate - m->rail_y_rate) - m->z_rate + m->rail_z_rate + arm * m->roll_rate) * cosine;
    const double normal = approach * size * (TABLE_LOAD + w->damping * approach_rate);
    if (!(normal > 0.0))
        return f;

    const double omega = w->rolling + m->spin, per_speed = 1.0 / w->speed;
    const double longitudinal = (w->speed - arm * m->turning - omega * c.radius) * per_speed;
    const double lateral = (e_rate * cosine + (m->z_rate - arm * m->roll_rate) * sine) * per_speed - m->yaw * secant;
    const double spin = (m->turning * cosine - omega * sine) * per_speed;
    const double g = w->shear_modulus * approach, f23 = g * size * c.c23;
    const double tx = -g * c.c11 * longitudinal, ty = -g * c.c22 * lateral - f23 * spin;
    const double factor = creep_saturation(sqrt(tx * tx + ty * ty) / (w->friction * normal));

    const double ahead = (w->radius * slope - arm) * m->yaw; /* of the contact point, for the yawed wheel */
    f.normal = normal;
    f.x = factor * tx;
    f.y = factor * ty * cosine - normal * sine;
    f.z = factor * ty * sine + normal * cosine;
    f.roll = -w->radius * f.y - arm * f.z;
    f.pitch = c.radius * f.x;
    f.yaw = ahead * f.y - arm * f.x + factor * f23 * lateral * cosine;
    return f;
}

#endif
