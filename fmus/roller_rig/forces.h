/* Forces of the roller rig: what a state of motion implies at every joint. Included by model.c only; see readme.md.
 * Coordinates are deviations from the loaded equilibrium, small angles. Axes: x forward, y right, z up; yaw positive
 * when the front turns right, roll when the top goes right, pitch when the nose goes up, so that a point (x, y, z) of a
 * body moves by  y + x psi + z phi  sideways and by  z + x pitch - y phi  upwards. */
#ifndef ROLLER_RIG_FORCES_H
#define ROLLER_RIG_FORCES_H

#include "contact.h"
#include "suspension.h"

static const double PI = 3.14159265358979323846;
static const double DEG = 3.14159265358979323846 / 180.0;

#define P(name) v[V_##name]                 /* a parameter, input or state */
#define DER(name) v[DX0 + (V_##name - X0)]  /* the derivative of a state */

/* d of the upper body relative to the lower one; F the model's own force, f the extra one; both oppose d. */
typedef struct {
    double d, v, F, f;
} Joint;

enum { FRONT, REAR };
enum { LEFT, RIGHT };

/* Everything that a state of motion implies, worked out once and used by derivatives and outputs. */
typedef struct {
    double theta, theta_v;                           /* platform yaw, rad and rad/s */
    Joint primary_lateral[2], primary_yaw[2];        /* front, rear */
    Joint secondary_lateral, secondary_yaw, secondary_roll;
    Joint yaw_damper[2], yaw_mount[2];               /* left, right */
    Joint lateral_damper[2], lateral_mount[2];       /* front, rear */
    Joint contact_lateral[2], contact_yaw[2];        /* front, rear */
    double yaw_piston[2], lateral_piston[2], primary_piston[2][2]; /* piston speeds, m/s */
    double primary_vertical[2][2];                   /* forces of an axlebox [front, rear][left, right], positive stretched */
    double secondary_vertical;                       /* both sides together */
} Rig;

static double total(Joint j) { return j.F + j.f; }

static double car_weight_on_bogie(const double *v)
{
    return P(car_mass) * P(gravity) * P(car_joint_to_cg) / P(car_joint_to_bogie);
}

static double wheel_load(const double *v)
{
    return (car_weight_on_bogie(v) + P(gravity) * (P(frame_mass) + 2.0 * P(wheelset_mass))) / 4.0;
}

static void yaw_law(const double *v, Point law[3])
{
    law[0] = (Point){P(yaw_damper_v1), P(yaw_damper_F1)};
    law[1] = (Point){P(yaw_damper_v2), P(yaw_damper_F2)};
    law[2] = (Point){P(yaw_damper_v3), P(yaw_damper_F3)};
}

/* 0 before, 1 after, and one half at the instant itself, so that the Runge-Kutta steps that meet there share the jump. */
static double switch_at(double t)
{
    return t > 1e-9 ? 1.0 : t < -1e-9 ? 0.0 : 0.5;
}

/* Prescribed sine between start and stop, plus the servo's two states. The phase counts from start, in double. */
static void platform(const double *v, double *theta, double *theta_v)
{
    const double t = P(time) - P(platform_start), w = 2.0 * PI * P(platform_frequency);
    *theta = P(platform_theta);
    *theta_v = P(platform_rate);
    const double on = switch_at(t) - switch_at(P(time) - P(platform_stop));
    if (on > 0.0) {
        *theta += on * P(platform_amplitude) * sin(w * t);
        *theta_v += on * P(platform_amplitude) * w * cos(w * t);
    }
    *theta *= DEG;
    *theta_v *= DEG;
}

static void contacts(const double *v, Rig *r)
{
    const double load = wheel_load(v), l0 = P(half_contact_distance), radius = P(wheel_radius);
    const Contact c = {
        .f11 = P(f11), .f22 = P(f22), .f23 = P(f23), .conicity = P(equivalent_conicity), .radius = radius, .half_base = l0,
        .limit = P(friction) * load,
        .lateral = gravitational_stiffness(load, P(equivalent_conicity), l0),
        .yaw = decrowning_stiffness(load, l0, radius, P(roller_radius)),
        .flange_gap = P(flange_clearance), .flange = P(flange_stiffness),
    };
    const double y[2] = {P(wheelset_front_y), P(wheelset_rear_y)}, v_y[2] = {P(wheelset_front_v_y), P(wheelset_rear_v_y)};
    const double psi[2] = {P(wheelset_front_psi), P(wheelset_rear_psi)};
    const double v_psi[2] = {P(wheelset_front_v_psi), P(wheelset_rear_v_psi)};
    const double f[2] = {P(contact_lateral_front_f), P(contact_lateral_rear_f)};
    const double m[2] = {P(contact_yaw_front_f), P(contact_yaw_rear_f)};
    platform(v, &r->theta, &r->theta_v);
    for (int i = 0; i < 2; i++) {
        const double arm = i == FRONT ? P(platform_arm) : -P(platform_arm);
        const double e = y[i] - arm * r->theta, e_v = v_y[i] - arm * r->theta_v;
        const double a = psi[i] - r->theta, a_v = v_psi[i] - r->theta_v;
        const ContactForce force = contact_force(&c, P(speed), e, e_v, a, a_v);
        r->contact_lateral[i] = (Joint){e, e_v, force.lateral, f[i]};
        r->contact_yaw[i] = (Joint){a, a_v, force.yaw, m[i]};
    }
}

static void primary(const double *v, Rig *r)
{
    const double x = P(wheelbase) / 2.0, h = P(wheel_radius) - P(frame_cg_height), b = P(primary_half_base);
    const double kx = P(coil_kx) + P(bush_kx), ky = P(coil_ky) + P(bush_ky);
    const double y[2] = {P(wheelset_front_y), P(wheelset_rear_y)}, v_y[2] = {P(wheelset_front_v_y), P(wheelset_rear_v_y)};
    const double psi[2] = {P(wheelset_front_psi), P(wheelset_rear_psi)};
    const double v_psi[2] = {P(wheelset_front_v_psi), P(wheelset_rear_v_psi)};
    const double f[2] = {P(primary_lateral_front_f), P(primary_lateral_rear_f)};
    const double m[2] = {P(primary_yaw_front_f), P(primary_yaw_rear_f)};
    const double piston[2][2] = {{P(primary_damper_FL_piston), P(primary_damper_FR_piston)},
                                 {P(primary_damper_RL_piston), P(primary_damper_RR_piston)}};
    Point law[2];
    law_with_knee(law, P(primary_damper_c1), P(primary_damper_knee), P(primary_damper_c2));
    for (int i = 0; i < 2; i++) {
        const double sx = i == FRONT ? x : -x;
        const double d = P(frame_y) + sx * P(frame_psi) + h * P(frame_phi) - y[i];
        const double d_v = P(frame_v_y) + sx * P(frame_v_psi) + h * P(frame_v_phi) - v_y[i];
        const double a = P(frame_psi) - psi[i], a_v = P(frame_v_psi) - v_psi[i];
        r->primary_lateral[i] = (Joint){d, d_v, 2.0 * (ky * d + P(bush_cy) * d_v), f[i]};
        r->primary_yaw[i] = (Joint){a, a_v, 2.0 * b * b * (kx * a + P(bush_cx) * a_v), m[i]};
        for (int side = 0; side < 2; side++) {
            const double sy = side == RIGHT ? b : -b;
            const double z = P(frame_z) + sx * P(frame_pitch) - sy * P(frame_phi);
            const double z_v = P(frame_v_z) + sx * P(frame_v_pitch) - sy * P(frame_v_phi);
            const Maxwell e = maxwell(law, 2, 1.0, P(primary_damper_series), z, z_v, piston[i][side], 0.0);
            r->primary_vertical[i][side] = P(coil_kz) * z + e.force;
            r->primary_piston[i][side] = e.piston_speed;
        }
    }
}

static void secondary(const double *v, Rig *r)
{
    const double b = P(air_spring_half_base), bd = P(secondary_damper_half_base), length = P(car_joint_to_bogie);
    const double hc = P(air_spring_height) - P(car_joint_height), hf = P(air_spring_height) - P(frame_cg_height);
    const double d = P(car_y) + hc * P(car_phi) - P(frame_y) - hf * P(frame_phi);
    const double d_v = P(car_v_y) + hc * P(car_v_phi) - P(frame_v_y) - hf * P(frame_v_phi);
    const double yaw = P(car_y) / length - P(frame_psi), yaw_v = P(car_v_y) / length - P(frame_v_psi);
    const double roll = P(car_phi) - P(frame_phi), roll_v = P(car_v_phi) - P(frame_v_phi);
    const double z = P(car_z) - P(frame_z), z_v = P(car_v_z) - P(frame_v_z);
    r->secondary_lateral = (Joint){d, d_v, 2.0 * P(air_spring_ky) * d + bump_stop(P(lateral_stop_gap), d), P(secondary_lateral_f)};
    r->secondary_yaw = (Joint){yaw, yaw_v, 2.0 * P(air_spring_kx) * b * b * yaw, P(secondary_yaw_f)};
    r->secondary_roll = (Joint){roll, roll_v,
        (2.0 * P(air_spring_kz) * b * b + P(anti_roll_bar)) * roll + 2.0 * P(secondary_damper_c) * bd * bd * roll_v,
        P(secondary_roll_f)};
    r->secondary_vertical = 2.0 * (P(air_spring_kz) * z + P(secondary_damper_c) * z_v);
}

static void yaw_dampers(const double *v, Rig *r)
{
    const double piston[2] = {P(yaw_damper_left_piston), P(yaw_damper_right_piston)};
    const double scale[2] = {P(yaw_damper_left_scale), P(yaw_damper_right_scale)};
    const double f[2] = {P(yaw_damper_left_f), P(yaw_damper_right_f)};
    const double mount[2] = {P(yaw_damper_left_mount_f), P(yaw_damper_right_mount_f)};
    Point law[3];
    yaw_law(v, law);
    for (int i = 0; i < 2; i++) { /* the car end moves forward of the frame end by d; a yaw moves the left side forward */
        const double b = i == LEFT ? P(yaw_damper_half_base) : -P(yaw_damper_half_base);
        const double d = b * r->secondary_yaw.d, d_v = b * r->secondary_yaw.v;
        const Maxwell e = maxwell(law, 3, scale[i], P(yaw_damper_series), d, d_v, piston[i], mount[i]);
        r->yaw_damper[i] = (Joint){d, d_v, e.force, f[i]};
        r->yaw_mount[i] = (Joint){e.mount_d, e.mount_v, e.mount_force, mount[i]};
        r->yaw_piston[i] = e.piston_speed;
    }
}

static void lateral_dampers(const double *v, Rig *r)
{
    const double hc = P(lateral_damper_height) - P(car_joint_height), hf = P(lateral_damper_height) - P(frame_cg_height);
    const double piston[2] = {P(lateral_damper_front_piston), P(lateral_damper_rear_piston)};
    const double scale[2] = {P(lateral_damper_front_scale), P(lateral_damper_rear_scale)};
    const double f[2] = {P(lateral_damper_front_f), P(lateral_damper_rear_f)};
    const double mount[2] = {P(lateral_damper_front_mount_f), P(lateral_damper_rear_mount_f)};
    const double d0 = P(car_y) + hc * P(car_phi) - P(frame_y) - hf * P(frame_phi);
    const double v0 = P(car_v_y) + hc * P(car_v_phi) - P(frame_v_y) - hf * P(frame_v_phi);
    Point law[2];
    law_with_knee(law, P(lateral_damper_c1), P(lateral_damper_knee), P(lateral_damper_c2));
    for (int i = 0; i < 2; i++) {
        const double a = i == FRONT ? P(lateral_damper_offset) : -P(lateral_damper_offset);
        const double d = d0 + a * r->secondary_yaw.d, d_v = v0 + a * r->secondary_yaw.v;
        const Maxwell e = maxwell(law, 2, scale[i], P(lateral_damper_series), d, d_v, piston[i], mount[i]);
        r->lateral_damper[i] = (Joint){d, d_v, e.force, f[i]};
        r->lateral_mount[i] = (Joint){e.mount_d, e.mount_v, e.mount_force, mount[i]};
        r->lateral_piston[i] = e.piston_speed;
    }
}

static void evaluate(const double *v, Rig *r)
{
    contacts(v, r);
    primary(v, r);
    secondary(v, r);
    yaw_dampers(v, r);
    lateral_dampers(v, r);
}

#endif
