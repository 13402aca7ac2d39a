/* One wheelset on a track, sprung to ground laterally and in yaw: the classical stability problem. See readme.md. */
#include "variables.h"

#include "contact.h"
#include "model.h"

#include <stdio.h>

#define P(name) v[V_##name]
#define DER(name) v[DX0 + (V_##name - X0)]

static ContactForce contact(const double *v)
{
    const Contact c = {
        .f11 = P(f11), .f22 = P(f22), .f23 = P(f23), .conicity = P(equivalent_conicity), .radius = P(wheel_radius),
        .half_base = P(half_contact_distance), .limit = P(friction) * P(wheel_load), .lateral = P(gravitational_stiffness),
        .yaw = 0.0, .flange_gap = P(flange_clearance), .flange = P(flange_stiffness),
    };
    return contact_force(&c, P(speed), P(y), P(v_y), P(psi), P(v_psi));
}

void model_initialise(double *v) { (void)v; }

void model_derivatives(double *v)
{
    const ContactForce c = contact(v);
    DER(y) = P(v_y);
    DER(psi) = P(v_psi);
    DER(v_y) = -(c.lateral + P(contact_lateral_f) + P(ky) * P(y)) / P(mass);
    DER(v_psi) = -(c.yaw + P(contact_yaw_f) + P(kpsi) * P(psi)) / P(inertia);
}

void model_outputs(double *v)
{
    const ContactForce c = contact(v);
    P(contact_lateral_F) = c.lateral;
    P(contact_yaw_F) = c.yaw;
    P(lateral_displacement) = 1e3 * P(y);
}

/* The creep forces make modes as fast as 2 f l0^2 / (I V) and 2 f / (m V); a Runge-Kutta step is stable up to 2.78. */
const char *model_check(const double *v, char *message, size_t size)
{
    const double l0 = P(half_contact_distance);
    const double rate = 2.0 * fmax(P(f22) / P(mass), P(f11) * l0 * l0 / P(inertia)) / P(speed);
    if (!(rate * MODEL_INTERNAL_STEP < 2.5)) {
        snprintf(message, size, "speed: expected at least %g m/s for these creep coefficients (integration step %g s), got %g m/s",
                 rate * P(speed) * MODEL_INTERNAL_STEP / 2.5, MODEL_INTERNAL_STEP, P(speed));
        return message;
    }
    return NULL;
}
