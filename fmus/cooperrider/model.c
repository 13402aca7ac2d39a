/* Cooperrider's complex bogie: two wheelsets (lateral, yaw) and a frame (lateral, yaw, roll) under a car body that runs
 * straight. Axes and signs as in the roller rig; equations and the source of the numbers in readme.md. */
#include "variables.h"

#include "contact.h"
#include "model.h"

#include <stdio.h>

#define P(name) v[V_##name]
#define DER(name) v[DX0 + (V_##name - X0)]

void model_initialise(double *v) { (void)v; }

void model_derivatives(double *v)
{
    const Contact contact = {
        .f11 = P(f11), .f22 = P(f22), .f23 = 0.0, .conicity = P(equivalent_conicity), .radius = P(wheel_radius),
        .half_base = P(a), .limit = P(friction_limit), .lateral = 0.0, .yaw = 0.0,
        .flange_gap = P(flange_clearance), .flange = P(flange_stiffness),
    };
    const double b = P(b), d1 = P(d1), d2 = P(d2), h1 = P(h1), h2 = P(h2);
    const ContactForce front = contact_force(&contact, P(speed), P(wheelset_front_y), P(wheelset_front_v_y),
                                             P(wheelset_front_psi), P(wheelset_front_v_psi));
    const ContactForce rear = contact_force(&contact, P(speed), P(wheelset_rear_y), P(wheelset_rear_v_y),
                                            P(wheelset_rear_psi), P(wheelset_rear_v_psi));
    /* joint forces, positive opposing the displacement of the upper body relative to the lower one */
    const double y_primary = P(frame_y) - h1 * P(frame_phi);
    const double lateral_front = 2.0 * P(k1) * (y_primary + b * P(frame_psi) - P(wheelset_front_y));
    const double lateral_rear = 2.0 * P(k1) * (y_primary - b * P(frame_psi) - P(wheelset_rear_y));
    const double yaw_front = 2.0 * P(k2) * d1 * d1 * (P(frame_psi) - P(wheelset_front_psi));
    const double yaw_rear = 2.0 * P(k2) * d1 * d1 * (P(frame_psi) - P(wheelset_rear_psi));
    const double lateral = 2.0 * (P(k4) * (P(frame_y) + h2 * P(frame_phi)) + P(D2) * (P(frame_v_y) + h2 * P(frame_v_phi)));
    const double yaw = P(k6) * P(frame_psi) + P(D6) * P(frame_v_psi);
    const double roll = (2.0 * P(k5) * d2 * d2 + 4.0 * P(k3) * d1 * d1) * P(frame_phi) + 2.0 * P(D1) * d2 * d2 * P(frame_v_phi);

    DER(wheelset_front_y) = P(wheelset_front_v_y);
    DER(wheelset_front_psi) = P(wheelset_front_v_psi);
    DER(wheelset_rear_y) = P(wheelset_rear_v_y);
    DER(wheelset_rear_psi) = P(wheelset_rear_v_psi);
    DER(frame_y) = P(frame_v_y);
    DER(frame_psi) = P(frame_v_psi);
    DER(frame_phi) = P(frame_v_phi);
    DER(wheelset_front_v_y) = (lateral_front - front.lateral) / P(wheelset_mass);
    DER(wheelset_front_v_psi) = (yaw_front - front.yaw) / P(wheelset_inertia);
    DER(wheelset_rear_v_y) = (lateral_rear - rear.lateral) / P(wheelset_mass);
    DER(wheelset_rear_v_psi) = (yaw_rear - rear.yaw) / P(wheelset_inertia);
    DER(frame_v_y) = (-lateral_front - lateral_rear - lateral) / P(frame_mass);
    DER(frame_v_psi) = (-b * (lateral_front - lateral_rear) - yaw_front - yaw_rear - yaw) / P(frame_yaw_inertia);
    DER(frame_v_phi) = (h1 * (lateral_front + lateral_rear) - h2 * lateral - roll) / P(frame_roll_inertia);
}

void model_outputs(double *v)
{
    P(FW) = 1e3 * P(wheelset_front_y);
    P(FB) = 1e3 * (P(frame_y) + P(b) * P(frame_psi));
    P(RW) = 1e3 * P(wheelset_rear_y);
    P(RB) = 1e3 * (P(frame_y) - P(b) * P(frame_psi));
}

/* The creep forces make modes as fast as 2 f a^2 / (I V) and 2 f / (m V); a Runge-Kutta step is stable up to 2.78. */
const char *model_check(const double *v, char *message, size_t size)
{
    const double rate = 2.0 * fmax(P(f22) / P(wheelset_mass), P(f11) * P(a) * P(a) / P(wheelset_inertia)) / P(speed);
    if (!(rate * MODEL_INTERNAL_STEP < 2.5)) {
        snprintf(message, size, "speed: expected at least %g m/s for these creep coefficients (integration step %g s), got %g m/s",
                 rate * P(speed) * MODEL_INTERNAL_STEP / 2.5, MODEL_INTERNAL_STEP, P(speed));
        return message;
    }
    return NULL;
}
