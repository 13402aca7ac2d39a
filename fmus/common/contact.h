/* Wheel-rail and wheel-roller contact of one wheelset: linear Kalker forces, Shen-Hedrick-Elkins saturation, conicity,
 * gravitational stiffness, flange. SI units. Axes: x forward, y to the right, yaw positive when the front turns right;
 * with them a wheelset at e > 0 has its larger rolling radius on the right wheel and is steered to the left. */
#ifndef FMUCORRECT_CONTACT_H
#define FMUCORRECT_CONTACT_H

#include <math.h>

typedef struct {
    double f11, f22, f23;   /* Kalker coefficients of one wheel: N, N, N m */
    double conicity;        /* equivalent conicity lambda */
    double radius;          /* rolling radius r0, m */
    double half_base;       /* half distance l0 of the contact points, m */
    double limit;           /* friction coefficient times wheel load mu N, N */
    double lateral;         /* gravitational stiffness of the wheelset, N/m */
    double yaw;             /* yaw stiffness of the wheelset from the normal forces, N m/rad (negative on rollers) */
    double flange_gap;      /* m */
    double flange;          /* flange stiffness, N/m */
} Contact;

/* What the contact of a whole wheelset gives; force and moment OPPOSE positive e and psi, as a spring's do. */
typedef struct {
    double lateral; /* N */
    double yaw;     /* N m */
} ContactForce;

/* Shen-Hedrick-Elkins: F/(mu N) = u - u^2/3 + u^3/27 for u < 3, else 1, with u = |F_linear|/(mu N).
 * Gives F/F_linear, the factor on every component of the linear force. */
static inline double creep_saturation(double u)
{
    return u < 3.0 ? 1.0 - u / 3.0 + u * u / 27.0 : 1.0 / u;
}

/* Flange spring beyond the gap. The corner is rounded by a parabola over +- 0.25 mm so that a Runge-Kutta step meets a
 * continuous stiffness; exactly zero below gap - 0.25 mm, exactly linear above gap + 0.25 mm. */
static inline double flange_force(double stiffness, double gap, double e)
{
    const double width = 0.25e-3, beyond = fabs(e) - gap;
    if (beyond <= -width)
        return 0.0;
    const double depth = beyond < width ? (beyond + width) * (beyond + width) / (4.0 * width) : beyond;
    return copysign(stiffness * depth, e);
}

/* Gravitational stiffness of a wheelset with wheel load N (one wheel): 2 N lambda / l0, N/m. */
static inline double gravitational_stiffness(double wheel_load, double conicity, double half_base)
{
    return 2.0 * wheel_load * conicity / half_base;
}

/* Decrowning on rollers: a yawed wheel slides down the roller's crown; -2 N l0^2 / (R + r0), N m/rad. */
static inline double decrowning_stiffness(double wheel_load, double half_base, double radius, double roller_radius)
{
    return -2.0 * wheel_load * half_base * half_base / (roller_radius + radius);
}

/* Wheelset at lateral position e and yaw psi relative to the rail or to its rollers, both rates, at the speed (m/s).
 * Creepages: longitudinal -+[lambda e / r0 + l0 psi'/V] (right, left), lateral e'/V - psi, spin psi'/V.
 * Both wheels carry the same load and opposite longitudinal creepages, so that they saturate alike and one evaluation
 * does for both. */
static inline ContactForce contact_force(const Contact *c, double speed, double e, double e_v, double psi, double psi_v)
{
    const double longitudinal = c->conicity * e / c->radius + c->half_base * psi_v / speed;
    const double lateral = e_v / speed - psi;
    const double spin = psi_v / speed;
    const double fx = c->f11 * longitudinal;
    const double fy = c->f22 * lateral + c->f23 * spin;
    const double factor = 2.0 * creep_saturation(sqrt(fx * fx + fy * fy) / c->limit);
    return (ContactForce){
        .lateral = factor * fy + c->lateral * e + flange_force(c->flange, c->flange_gap, e),
        .yaw = factor * (c->half_base * fx - c->f23 * lateral) + c->yaw * psi,
    };
}

#endif
