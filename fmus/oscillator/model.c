/* A chain of one to four masses between a moving base and a free end; readme.md has the equations. */
#include <math.h>
#include <stdio.h>

#include "variables.h"

/* What belongs to mass and joint i = 0..3 lies a fixed stride apart in v. */
enum {
    PARAMETERS = V_m2 - V_m1,    /* m, k, c */
    MOTIONS = V_mass2_x - V_mass1_x, /* x, v, a */
    JOINTS = V_joint2_d - V_joint1_d /* d, v, F */
};

const char *model_check(const double *v, char *message, size_t size)
{
    if (v[V_masses] == floor(v[V_masses]))
        return NULL;
    snprintf(message, size, "masses: expected a whole number from 1 to 4, got %.9g", v[V_masses]);
    return message;
}

void model_initialise(double *v) { (void)v; }

static double joint_displacement(const double *v, int i) { return v[V_x1 + i] - (i ? v[V_x1 + i - 1] : v[V_base_d]); }

static double joint_velocity(const double *v, int i) { return v[V_v1 + i] - (i ? v[V_v1 + i - 1] : v[V_base_v]); }

static double joint_force(const double *v, int i)
{
    const double *p = v + i * PARAMETERS;
    return p[V_k1] * joint_displacement(v, i) + p[V_c1] * joint_velocity(v, i);
}

void model_derivatives(double *v)
{
    const int n = (int)v[V_masses];
    double *dx = v + DX0;
    double right = v[V_k_end] * v[V_x1 + n - 1] + v[V_c_end] * v[V_v1 + n - 1]; /* what pulls mass i back from its right, N */
    for (int i = 3; i >= 0; i--) {
        if (i >= n) {
            dx[i] = dx[4 + i] = 0.0;
            continue;
        }
        const double left = joint_force(v, i) + v[V_joint1_f + i];
        dx[i] = v[V_v1 + i];
        dx[4 + i] = (v[V_mass1_f + i] - left - right) / v[V_m1 + i * PARAMETERS];
        right = -left;
    }
}

void model_outputs(double *v)
{
    const int n = (int)v[V_masses];
    for (int i = 0; i < 4; i++) {
        double *mass = v + i * MOTIONS, *joint = v + i * JOINTS;
        const double in_chain = i < n ? 1.0 : 0.0;
        mass[V_mass1_x] = in_chain * v[V_x1 + i];
        mass[V_mass1_v] = in_chain * v[V_v1 + i];
        mass[V_mass1_a] = in_chain * v[DX0 + 4 + i];
        joint[V_joint1_d] = in_chain * joint_displacement(v, i);
        joint[V_joint1_v] = in_chain * joint_velocity(v, i);
        joint[V_joint1_F] = in_chain * joint_force(v, i);
    }
    v[V_base_F] = joint_force(v, 0) + v[V_joint1_f];
}
