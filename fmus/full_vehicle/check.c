/* Whether the parameters make sense together, and whether the integration step can follow them. */
#include "check.h"

#include <math.h>
#include <stdio.h>

#include "suspension_laws.h"
#include "track.h"

/* The Runge-Kutta step is stable up to 2.78 for what decays; 2.5 leaves room for what it is joined to. */
static const double STABLE = 2.5;

static const char *too_fast(const char *name, double rate, char *message, size_t size)
{
    if (rate * MODEL_INTERNAL_STEP <= STABLE)
        return NULL;
    snprintf(message, size, "%s: expected a rate of at most %g 1/s (integration step %g s), got %g 1/s", name,
             STABLE / MODEL_INTERNAL_STEP, MODEL_INTERNAL_STEP, rate);
    return message;
}

static const char *check_damper(const char *name, const Point *law, int n, double series, char *message, size_t size)
{
    if (!law_valid(law, n)) {
        snprintf(message, size, "%s: expected speeds and forces that increase from point to point", name);
        return message;
    }
    Point a = {0.0, 0.0};
    const char *problem = NULL;
    for (int i = 0; i < n && !problem; a = law[i++])
        problem = too_fast(name, series * (law[i].x - a.x) / (law[i].force - a.force), message, size);
    return problem;
}

static const char *check_places(const double *v, char *message, size_t size)
{
    if (P(wheelbase) < P(bogie_distance))
        return NULL;
    snprintf(message, size, "wheelbase: expected less than bogie_distance, %g m, got %g m", P(bogie_distance),
             P(wheelbase));
    return message;
}

static const char *check_curve(const double *v, char *message, size_t size)
{
    if (P(curve_radius) != 0.0 && fabs(P(curve_radius)) < SHORTEST_RADIUS) {
        snprintf(message, size, "curve_radius: expected 0 (straight) or at least %g m either way, got %g m",
                 SHORTEST_RADIUS, P(curve_radius));
        return message;
    }
    if (P(curve_radius) != 0.0 && 0.5 * P(bogie_distance) / fabs(P(curve_radius)) > 0.09) {
        snprintf(message, size,
                 "curve_radius: expected bogies that turn by at most 0.09 rad under the car body, got %g m between "
                 "them in a curve of %g m",
                 P(bogie_distance), P(curve_radius));
        return message;
    }
    return NULL;
}

/* The rotation of a wheelset settles with 2 f11 r0^2 / (Iyy V); f11 = C11 G a b with C11 a b of 1.8e-4 m2 at half as
 * much load again. */
static const char *check_spin(const double *v, char *message, size_t size)
{
    const double f11 = P(shear_modulus) * 1.8e-4, radius = P(wheel_radius);
    const double slowest = P(speed_rate) < 0.0 ? SLOWEST : P(speed);
    return too_fast("speed: rotation of the wheelsets", 2.0 * f11 * radius * radius / (P(wheelset_Iyy) * slowest),
                    message, size);
}

const char *check_parameters(const double *v, char *message, size_t size)
{
    const DamperLaws laws = damper_laws(v);
    const char *problem = check_damper("vertical_damper", laws.vertical, 2, P(vertical_damper_series), message, size);
    if (!problem)
        problem = check_damper("secondary_vertical_damper", laws.secondary_vertical, 1,
                               P(secondary_vertical_damper_series), message, size);
    if (!problem)
        problem = check_damper("lateral_damper", laws.lateral, 2, P(lateral_damper_series), message, size);
    if (!problem)
        problem = check_damper("yaw_damper", laws.yaw, 3, P(yaw_damper_series), message, size);
    if (!problem)
        problem = too_fast("rod_bush_x", (P(rod_bush_x_series) + P(rod_bush_x_parallel)) / P(rod_bush_x_damping),
                           message, size);
    if (!problem)
        problem = too_fast("rod_bush_z", (P(rod_bush_z_series) + P(rod_bush_z_parallel)) / P(rod_bush_z_damping),
                           message, size);
    if (!problem)
        problem = check_spin(v, message, size);
    if (!problem)
        problem = check_places(v, message, size);
    if (!problem)
        problem = check_curve(v, message, size);
    return problem;
}
