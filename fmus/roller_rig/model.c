/* Bogie on a roller rig under a dummy car body: see readme.md for the equations and the sources of the numbers.
 * Coordinates are deviations from the loaded equilibrium, small angles. Axes: x forward, y right, z up; yaw positive
 * when the front turns right, roll when the top goes right, pitch when the nose goes up, so that a point (x, y, z) of a
 * body moves by  y + x psi + z phi  sideways and by  z + x pitch - y phi  upwards. */
#include "variables.h"

#include "../common/contact.h"
#include "../common/model.h"
#include "../common/suspension.h"

#include <stdio.h>

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

/* Prescribed sine between start and stop, plus the servo's two states. The phase counts from start, in double. */
static void platform(const double *v, double *theta, double *theta_v)
{
    const double t = P(time) - P(platform_start), w = 2.0 * PI * P(platform_frequency);
    *theta = P(platform_theta);
    *theta_v = P(platform_rate);
    if (t >= 0.0 && P(time) < P(platform_stop)) {
        *theta += P(platform_amplitude) * sin(w * t);
        *theta_v += P(platform_amplitude) * w * cos(w * t);
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
