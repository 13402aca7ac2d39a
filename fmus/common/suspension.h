/* Suspension elements shared by the rail models. SI units. Sign rule everywhere: a force is positive when it OPPOSES a
 * positive displacement, as a spring's does. Numbers come from the models' parameters; sources in their readmes. */
#ifndef FMUCORRECT_SUSPENSION_H
#define FMUCORRECT_SUSPENSION_H

#include <math.h>

/* A point of a damper's force-velocity law (m/s, N), or of a stop's force-travel table (m, N). */
typedef struct {
    double x, force;
} Point;

/* Odd piecewise-linear law through the origin and n points, x and force both strictly increasing; beyond the last point
 * its slope goes on (a damper that has blown off). Force at x. */
static inline double law_force(const Point *p, int n, double x)
{
    const double s = fabs(x);
    Point a = {0.0, 0.0}, b = p[0];
    for (int i = 1; i < n && s > b.x; i++) {
        a = b;
        b = p[i];
    }
    return copysign(a.force + (s - a.x) * (b.force - a.force) / (b.x - a.x), x);
}

/* The exact inverse of law_force: the x at which the law gives this force. */
static inline double law_inverse(const Point *p, int n, double force)
{
    const double s = fabs(force);
    Point a = {0.0, 0.0}, b = p[0];
    for (int i = 1; i < n && s > b.force; i++) {
        a = b;
        b = p[i];
    }
    return copysign(a.x + (s - a.force) * (b.x - a.x) / (b.force - a.force), force);
}

/* True when law_inverse can be used: both coordinates strictly increasing from the origin. */
static inline int law_valid(const Point *p, int n)
{
    double x = 0.0, force = 0.0;
    for (int i = 0; i < n; i++) {
        if (!(p[i].x > x && p[i].force > force))
            return 0;
        x = p[i].x;
        force = p[i].force;
    }
    return 1;
}

/* A damper law that changes slope once: c1 up to the knee (m/s), c2 above (N s/m). */
static inline void law_with_knee(Point p[2], double c1, double knee, double c2)
{
    p[0] = (Point){knee, c1 * knee};
    p[1] = (Point){2.0 * knee, (c1 + c2) * knee};
}

/* A series spring and a nonlinear damper. The state is the piston's displacement; the spring (the mount) deflects by
 * stroke - piston. An extra force at the mount acts in parallel to the spring, so that any mount law can be made of it. */
typedef struct {
    double mount_d;      /* deflection of the series spring, m */
    double mount_v;      /* its rate, m/s */
    double mount_force;  /* the series spring's own force, N */
    double force;        /* what the element transmits from end to end: spring + extra force at the mount, N */
    double piston_speed; /* derivative of the state, m/s */
} Maxwell;

/* scale multiplies the damper's law (1 = as given); stroke m, stroke_speed m/s, series N/m, mount_extra N. */
static inline Maxwell maxwell(const Point *law, int n, double scale, double series, double stroke, double stroke_speed,
                              double piston, double mount_extra)
{
    Maxwell m;
    m.mount_d = stroke - piston;
    m.mount_force = series * m.mount_d;
    m.force = m.mount_force + mount_extra;
    m.piston_speed = law_inverse(law, n, m.force / scale);
    m.mount_v = stroke_speed - m.piston_speed;
    return m;
}

/* Lateral stop of the secondary suspension: free up to gap, then a stiffening rubber (public CRH380A parameter file:
 * 20 mm free, then 26:2, 32:5, 38:11, 44:25.5, 48:49 mm:kN). The table counts from the contact. */
static inline double bump_stop(double gap, double d)
{
    static const Point table[5] = {{0.006, 2e3}, {0.012, 5e3}, {0.018, 11e3}, {0.024, 25.5e3}, {0.028, 49e3}};
    const double beyond = fabs(d) - gap;
    return beyond > 0.0 ? copysign(law_force(table, 5, beyond), d) : 0.0;
}

#endif
