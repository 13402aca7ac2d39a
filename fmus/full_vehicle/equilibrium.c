/* Static equilibrium by Newton's method: displacements and rotation speeds of the wheelsets so that nothing
 * accelerates. */
#include "equilibrium.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { UNKNOWNS = MOTIONS, ITERATIONS = 40 };
static const double SMALL = 1e-9, TOLERATED = 1e-4; /* m/s2 and rad/s2: aimed at, and what still is an equilibrium */

/* Where unknown k lies in v: every displacement, but for a wheelset its rotation speed instead of its rotation. */
static int place_of(int k)
{
    const int wheelset = k - 18;
    const bool rotation = wheelset >= 0 && wheelset % 5 == 3; /* y, z, roll, pitch, yaw */
    return rotation ? V_car_body_vx + k : V_car_body_x + k;
}

/* Dampers without force, internal nodes of the rod bushes at rest: closed forms of the displacements. */
static void settle(double *v, const Vehicle *vehicle)
{
    for (int k = 0; k < AXLEBOXES; k++) {
        const Axlebox *a = &vehicle->axlebox[k];
        (&P(vertical_damper_1l_piston))[k] = a->stroke;
        (&P(rod_bush_1l_node_x))[k] =
            resting_node(P(rod_bush_x_series), P(rod_bush_x_parallel), P(rod_bush_x_preload), a->bush_deformation_x);
        (&P(rod_bush_1l_node_z))[k] =
            resting_node(P(rod_bush_z_series), P(rod_bush_z_parallel), P(rod_bush_z_preload), a->bush_deformation_z);
    }
    for (int b = 0; b < BOGIES; b++)
        for (int side = 0; side < 2; side++) {
            const Secondary *s = &vehicle->secondary[b];
            (&P(secondary_vertical_damper_1l_piston))[2 * b + side] = s->vertical_stroke[side];
            (&P(lateral_damper_1l_piston))[2 * b + side] = s->lateral_stroke[side];
            (&P(yaw_damper_1l_piston))[2 * b + side] = s->yaw_stroke[side];
        }
}

/* Accelerations at the unknowns in v; returns the largest. */
static double residual(const struct Resources *resources, double *v, double r[UNKNOWNS])
{
    Vehicle vehicle;
    vehicle_evaluate(resources, v, true, &vehicle);
    settle(v, &vehicle);
    vehicle_evaluate(resources, v, true, &vehicle);
    const Six *body[3] = {&vehicle.car, &vehicle.frame[0], &vehicle.frame[1]};
    double largest = 0.0;
    for (int b = 0; b < 3; b++)
        memcpy(r + 6 * b, body[b], sizeof *body[b]);
    for (int i = 0; i < WHEELSETS; i++)
        memcpy(r + 18 + 5 * i, &vehicle.wheelset[i].y, 5 * sizeof(double));
    for (int k = 0; k < UNKNOWNS; k++)
        largest = fmax(largest, fabs(r[k]));
    return largest;
}

/* Solves a x = b in place by elimination with row pivots; false where a is singular. */
static bool solve(double a[UNKNOWNS][UNKNOWNS], double b[UNKNOWNS])
{
    for (int k = 0; k < UNKNOWNS; k++) {
        int pivot = k;
        for (int i = k + 1; i < UNKNOWNS; i++)
            if (fabs(a[i][k]) > fabs(a[pivot][k]))
                pivot = i;
        if (!(fabs(a[pivot][k]) > DBL_MIN))
            return false;
        for (int j = k; j < UNKNOWNS; j++) {
            const double swapped = a[k][j];
            a[k][j] = a[pivot][j], a[pivot][j] = swapped;
        }
        const double swapped = b[k];
        b[k] = b[pivot], b[pivot] = swapped;
        for (int i = k + 1; i < UNKNOWNS; i++) {
            const double factor = a[i][k] / a[k][k];
            for (int j = k + 1; j < UNKNOWNS; j++)
                a[i][j] -= factor * a[k][j];
            b[i] -= factor * b[k];
        }
    }
    for (int k = UNKNOWNS - 1; k >= 0; k--) {
        for (int j = k + 1; j < UNKNOWNS; j++)
            b[k] -= a[k][j] * b[j];
        b[k] /= a[k][k];
    }
    return true;
}

/* One Newton step, halved until the largest acceleration falls. Returns that, or INFINITY where no step helps. */
static double improve(const struct Resources *resources, double *v, double r[UNKNOWNS], double largest)
{
    double jacobian[UNKNOWNS][UNKNOWNS], trial[NV], moved[UNKNOWNS], before[UNKNOWNS];
    for (int k = 0; k < UNKNOWNS; k++) {
        const double step = place_of(k) >= V_car_body_vx ? 1e-6 : 1e-8; /* rad/s; m and rad */
        memcpy(trial, v, sizeof trial);
        trial[place_of(k)] = v[place_of(k)] - step;
        residual(resources, trial, before);
        trial[place_of(k)] = v[place_of(k)] + step;
        residual(resources, trial, moved);
        for (int i = 0; i < UNKNOWNS; i++)
            jacobian[i][k] = (moved[i] - before[i]) / (2.0 * step);
    }
    if (!solve(jacobian, r))
        return INFINITY;
    for (double part = 1.0; part > 1e-3; part *= 0.5) {
        memcpy(trial, v, sizeof trial);
        for (int k = 0; k < UNKNOWNS; k++)
            trial[place_of(k)] -= part * r[k];
        const double now = residual(resources, trial, moved);
        if (now < largest) {
            memcpy(v, trial, sizeof trial);
            memcpy(r, moved, sizeof moved);
            return now;
        }
    }
    return INFINITY;
}

/* Wheels on the rails, everything else in the design position. */
static void first_guess(double *v)
{
    const double weight = P(gravity) * (P(car_mass) + 2.0 * P(frame_mass) + 4.0 * P(wheelset_mass)) / 8.0;
    const double share = cbrt(weight / TABLE_LOAD), approach = P(contact_approach) * share * share;
    memset(v + X0, 0, NX * sizeof *v);
    for (int i = 0; i < WHEELSETS; i++)
        (&P(wheelset_1_z))[5 * i] = -approach;
}

void equilibrium_add(const struct Resources *resources, double *v)
{
    double at[NV], r[UNKNOWNS];
    memcpy(at, v, sizeof at);
    first_guess(at);
    at[V_speed_change] = v[V_speed_change];
    double largest = residual(resources, at, r);
    for (int i = 0; i < ITERATIONS && largest > SMALL; i++) {
        const double now = improve(resources, at, r, largest);
        if (!(now < largest))
            break; /* rounding, or no equilibrium */
        largest = now;
    }
    at[V_speed_change] = 0.0;
    for (int i = X0; i < X0 + NX; i++)
        v[i] += largest < TOLERATED ? at[i] : NAN;
}
