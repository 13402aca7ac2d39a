/* Bogie on a roller rig under a dummy car body: equations of motion, outputs and checks. Equations and sources: readme.md. */
#include "variables.h"

#include "model.h"
#include "forces.h"

#include <stdio.h>

static void wheelset_derivatives(double *v, const Rig *r)
{
    DER(wheelset_front_y) = P(wheelset_front_v_y);
    DER(wheelset_front_psi) = P(wheelset_front_v_psi);
    DER(wheelset_rear_y) = P(wheelset_rear_v_y);
    DER(wheelset_rear_psi) = P(wheelset_rear_v_psi);
    DER(wheelset_front_v_y) = (total(r->primary_lateral[FRONT]) - total(r->contact_lateral[FRONT])) / P(wheelset_mass);
    DER(wheelset_rear_v_y) = (total(r->primary_lateral[REAR]) - total(r->contact_lateral[REAR])) / P(wheelset_mass);
    DER(wheelset_front_v_psi) = (total(r->primary_yaw[FRONT]) - total(r->contact_yaw[FRONT])) / P(wheelset_Izz);
    DER(wheelset_rear_v_psi) = (total(r->primary_yaw[REAR]) - total(r->contact_yaw[REAR])) / P(wheelset_Izz);
}

static void frame_and_car_derivatives(double *v, const Rig *r)
{
    const double x = P(wheelbase) / 2.0, b = P(primary_half_base), by = P(yaw_damper_half_base), a = P(lateral_damper_offset);
    const double zf = P(frame_cg_height), zc = P(car_joint_height), length = P(car_joint_to_bogie), arm = P(car_joint_to_cg);
    const double hp = P(wheel_radius) - zf, hs = P(air_spring_height) - zf, hd = P(lateral_damper_height) - zf;
    const double front = total(r->primary_lateral[FRONT]), rear = total(r->primary_lateral[REAR]);
    const double dampers = total(r->lateral_damper[FRONT]) + total(r->lateral_damper[REAR]);
    const double spring = total(r->secondary_lateral), roll = total(r->secondary_roll);
    const double yaw = total(r->secondary_yaw) + by * (total(r->yaw_damper[LEFT]) - total(r->yaw_damper[RIGHT]))
                     + a * (total(r->lateral_damper[FRONT]) - total(r->lateral_damper[REAR]));
    const double fl = r->primary_vertical[FRONT][LEFT], fr = r->primary_vertical[FRONT][RIGHT];
    const double rl = r->primary_vertical[REAR][LEFT], rr = r->primary_vertical[REAR][RIGHT];
    const double ht = P(traction_rod_height) - zf; /* longitudinal springs hold the pitch of the frame */
    const double k_pitch = 4.0 * (P(coil_kx) + P(bush_kx)) * hp * hp + 2.0 * P(air_spring_kx) * hs * hs + P(traction_rod) * ht * ht;
    const double c_pitch = 4.0 * P(bush_cx) * hp * hp;

    DER(frame_y) = P(frame_v_y);
    DER(frame_psi) = P(frame_v_psi);
    DER(frame_phi) = P(frame_v_phi);
    DER(frame_z) = P(frame_v_z);
    DER(frame_pitch) = P(frame_v_pitch);
    DER(frame_v_y) = (spring + dampers - front - rear) / P(frame_mass);
    DER(frame_v_psi) = (yaw - x * (front - rear) - total(r->primary_yaw[FRONT]) - total(r->primary_yaw[REAR])) / P(frame_Izz);
    DER(frame_v_phi) = (hs * spring + hd * dampers + roll - hp * (front + rear) + b * (fr + rr - fl - rl)) / P(frame_Ixx);
    DER(frame_v_z) = (r->secondary_vertical - fl - fr - rl - rr) / P(frame_mass);
    DER(frame_v_pitch) = (-x * (fl + fr - rl - rr) - k_pitch * P(frame_pitch) - c_pitch * P(frame_v_pitch)) / P(frame_Iyy);

    /* The car body turns about the ball joint: kinetic energy with yaw y/length and roll phi, centre of mass at (arm, h). */
    const double h = P(car_cg_height) - zc, m = P(car_mass);
    const double m_yy = (P(car_Izz) + m * arm * arm) / (length * length), m_yp = m * arm * h / length;
    const double m_pp = P(car_Ixx) + m * h * h, m_zz = (P(car_Iyy) + m * arm * arm) / (length * length);
    const double q_y = -spring - dampers - yaw / length;
    const double q_p = -(P(air_spring_height) - zc) * spring - (P(lateral_damper_height) - zc) * dampers - roll
                     + m * P(gravity) * h * P(car_phi) - P(external_anti_roll_damper) * P(car_v_phi);
    const double det = m_yy * m_pp - m_yp * m_yp;
    DER(car_y) = P(car_v_y);
    DER(car_phi) = P(car_v_phi);
    DER(car_z) = P(car_v_z);
    DER(car_v_y) = (m_pp * q_y - m_yp * q_p) / det;
    DER(car_v_phi) = (m_yy * q_p - m_yp * q_y) / det;
    DER(car_v_z) = -r->secondary_vertical / m_zz;
}

void model_initialise(double *v) { (void)v; } /* the loaded equilibrium is zero */

void model_derivatives(double *v)
{
    Rig r;
    evaluate(v, &r);
    wheelset_derivatives(v, &r);
    frame_and_car_derivatives(v, &r);
    DER(yaw_damper_left_piston) = r.yaw_piston[LEFT];
    DER(yaw_damper_right_piston) = r.yaw_piston[RIGHT];
    DER(lateral_damper_front_piston) = r.lateral_piston[FRONT];
    DER(lateral_damper_rear_piston) = r.lateral_piston[REAR];
    DER(primary_damper_FL_piston) = r.primary_piston[FRONT][LEFT];
    DER(primary_damper_FR_piston) = r.primary_piston[FRONT][RIGHT];
    DER(primary_damper_RL_piston) = r.primary_piston[REAR][LEFT];
    DER(primary_damper_RR_piston) = r.primary_piston[REAR][RIGHT];
    const double w = 2.0 * PI * P(platform_bandwidth);
    DER(platform_theta) = P(platform_rate);
    DER(platform_rate) = w * w * (P(platform_yaw_input) - P(platform_theta)) - 2.0 * w * P(platform_rate);
}

#define PUT_JOINT(name, j) (P(name##_d) = (j).d, P(name##_v) = (j).v, P(name##_F) = (j).F)

static void joint_outputs(double *v, const Rig *r)
{
    PUT_JOINT(primary_lateral_front, r->primary_lateral[FRONT]);
    PUT_JOINT(primary_lateral_rear, r->primary_lateral[REAR]);
    PUT_JOINT(primary_yaw_front, r->primary_yaw[FRONT]);
    PUT_JOINT(primary_yaw_rear, r->primary_yaw[REAR]);
    PUT_JOINT(secondary_lateral, r->secondary_lateral);
    PUT_JOINT(secondary_yaw, r->secondary_yaw);
    PUT_JOINT(secondary_roll, r->secondary_roll);
    PUT_JOINT(yaw_damper_left, r->yaw_damper[LEFT]);
    PUT_JOINT(yaw_damper_right, r->yaw_damper[RIGHT]);
    PUT_JOINT(yaw_damper_left_mount, r->yaw_mount[LEFT]);
    PUT_JOINT(yaw_damper_right_mount, r->yaw_mount[RIGHT]);
    PUT_JOINT(lateral_damper_front, r->lateral_damper[FRONT]);
    PUT_JOINT(lateral_damper_rear, r->lateral_damper[REAR]);
    PUT_JOINT(lateral_damper_front_mount, r->lateral_mount[FRONT]);
    PUT_JOINT(lateral_damper_rear_mount, r->lateral_mount[REAR]);
    PUT_JOINT(contact_lateral_front, r->contact_lateral[FRONT]);
    PUT_JOINT(contact_lateral_rear, r->contact_lateral[REAR]);
    PUT_JOINT(contact_yaw_front, r->contact_yaw[FRONT]);
    PUT_JOINT(contact_yaw_rear, r->contact_yaw[REAR]);
}

/* Loads of an axle's wheels. The springs at the axleboxes and the lateral force at axle height share the roll moment. */
static void axle_loads(const double *v, const Rig *r, int axle, double acceleration, double *left, double *right)
{
    const double *f = r->primary_vertical[axle];
    const double side = total(r->primary_lateral[axle]) - P(wheelset_mass) * acceleration;
    const double moment = P(primary_half_base) * (f[LEFT] - f[RIGHT]) + P(wheel_radius) * side;
    const double mean = wheel_load(v) - (f[LEFT] + f[RIGHT]) / 2.0, shift = moment / (2.0 * P(half_contact_distance));
    *left = mean - shift;
    *right = mean + shift;
}

static void load_outputs(double *v, const Rig *r)
{
    const double car = car_weight_on_bogie(v);
    P(static_wheel_load) = wheel_load(v);
    P(static_primary_load) = (car + P(frame_mass) * P(gravity)) / 4.0;
    P(static_air_spring_load) = car / 2.0;
    P(static_ball_joint_load) = P(car_mass) * P(gravity) - car;
    axle_loads(v, r, FRONT, P(wheelset_front_a_y), &P(wheel_load_FL), &P(wheel_load_FR));
    axle_loads(v, r, REAR, P(wheelset_rear_a_y), &P(wheel_load_RL), &P(wheel_load_RR));
}

void model_outputs(double *v)
{
    const double x = P(wheelbase) / 2.0, b = P(primary_half_base);
    Rig r;
    evaluate(v, &r);
    P(FW) = 1e3 * P(wheelset_front_y);
    P(FB) = 1e3 * (P(frame_y) + x * P(frame_psi));
    P(RW) = 1e3 * P(wheelset_rear_y);
    P(RB) = 1e3 * (P(frame_y) - x * P(frame_psi));
    P(wheelset_front_a_y) = P(acc_FW) = DER(wheelset_front_v_y);
    P(wheelset_rear_a_y) = P(acc_RW) = DER(wheelset_rear_v_y);
    P(wheelset_front_a_psi) = DER(wheelset_front_v_psi);
    P(wheelset_rear_a_psi) = DER(wheelset_rear_v_psi);
    P(frame_a_y) = DER(frame_v_y);
    P(frame_a_psi) = DER(frame_v_psi);
    P(frame_a_phi) = DER(frame_v_phi);
    P(frame_a_z) = DER(frame_v_z);
    P(frame_a_pitch) = DER(frame_v_pitch);
    P(car_a_y) = DER(car_v_y);
    P(car_a_psi) = DER(car_v_y) / P(car_joint_to_bogie);
    P(car_a_phi) = DER(car_v_phi);
    P(car_a_z) = DER(car_v_z);
    P(acc_FB) = P(frame_a_y) + x * P(frame_a_psi);
    P(acc_RB) = P(frame_a_y) - x * P(frame_a_psi);
    P(acc_z_FL) = P(frame_a_z) + x * P(frame_a_pitch) + b * P(frame_a_phi);
    P(acc_z_FR) = P(frame_a_z) + x * P(frame_a_pitch) - b * P(frame_a_phi);
    P(acc_z_RL) = P(frame_a_z) - x * P(frame_a_pitch) + b * P(frame_a_phi);
    P(acc_z_RR) = P(frame_a_z) - x * P(frame_a_pitch) - b * P(frame_a_phi);
    P(platform_yaw) = r.theta / DEG;
    joint_outputs(v, &r);
    load_outputs(v, &r);
}

/* A series spring against a weak damper makes a fast mode; the Runge-Kutta step is stable up to 2.78. */
static const char *check_damper(const char *name, const Point *law, int n, double scale, double series, char *message, size_t size)
{
    if (!law_valid(law, n)) {
        snprintf(message, size, "%s: expected speeds and forces that increase from point to point", name);
        return message;
    }
    Point a = {0.0, 0.0};
    for (int i = 0; i < n; i++) {
        const double rate = series * (law[i].x - a.x) / (scale * (law[i].force - a.force));
        if (rate * MODEL_INTERNAL_STEP > 2.5) {
            snprintf(message, size, "%s: series stiffness / damping expected at most %g 1/s (integration step %g s), got %g in segment %d",
                     name, 2.5 / MODEL_INTERNAL_STEP, MODEL_INTERNAL_STEP, rate, i + 1);
            return message;
        }
        a = law[i];
    }
    return NULL;
}

const char *model_check(const double *v, char *message, size_t size)
{
    Point yaw[3], lateral[2], vertical[2];
    yaw_law(v, yaw);
    law_with_knee(lateral, P(lateral_damper_c1), P(lateral_damper_knee), P(lateral_damper_c2));
    law_with_knee(vertical, P(primary_damper_c1), P(primary_damper_knee), P(primary_damper_c2));
    const double yaw_scale = fmin(P(yaw_damper_left_scale), P(yaw_damper_right_scale));
    const double lateral_scale = fmin(P(lateral_damper_front_scale), P(lateral_damper_rear_scale));
    const char *error = check_damper("yaw_damper", yaw, 3, yaw_scale, P(yaw_damper_series), message, size);
    if (!error)
        error = check_damper("lateral_damper", lateral, 2, lateral_scale, P(lateral_damper_series), message, size);
    if (!error)
        error = check_damper("primary_damper", vertical, 2, 1.0, P(primary_damper_series), message, size);
    if (!error && !(P(speed) >= 5.0)) {
        snprintf(message, size, "speed: expected at least 5 m/s (creepage is relative to it), got %g m/s", P(speed));
        error = message;
    }
    if (!error && !(P(platform_stop) >= P(platform_start))) {
        snprintf(message, size, "platform_stop: expected at least platform_start = %g s, got %g s", P(platform_start), P(platform_stop));
        error = message;
    }
    return error;
}
