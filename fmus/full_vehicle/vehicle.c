/* Forces between the bodies and their equations of motion: readme.md writes them out. */
#include "vehicle.h"

_Static_assert(V_wheelset_4_yaw - V_car_body_x + 1 == MOTIONS, "displacements lie side by side");
_Static_assert(V_wheelset_4_yaw_rate - V_car_body_vx + 1 == MOTIONS, "their rates, in the same order");
_Static_assert(V_car_body_yaw == V_car_body_x + 5 && V_frame_1_x == V_car_body_x + 6 &&
                   V_wheelset_1_y == V_frame_1_x + 12,
               "bodies");
_Static_assert(V_vertical_damper_4r_piston == V_vertical_damper_1l_piston + 7 &&
                   V_rod_bush_4r_node_x == V_rod_bush_1l_node_x + 7,
               "axleboxes");
_Static_assert(V_rod_bush_4r_node_z == V_rod_bush_1l_node_z + 7 && V_yaw_damper_2r_piston == V_yaw_damper_1l_piston + 3,
               "axleboxes and sides");

Six six_of_body(const double *s) { return (Six){s[0], s[1], s[2], s[3], s[4], s[5]}; }

Six six_of_wheelset(const double *s) { return (Six){0.0, s[0], s[1], s[2], s[3], s[4]}; }

typedef struct {
    Six place, rate; /* of a body's centre of mass */
} Motion;

static Motion body_motion(const double *v, int offset)
{
    return (Motion){six_of_body(v + V_car_body_x + offset), six_of_body(v + V_car_body_vx + offset)};
}

static Motion wheelset_motion(const double *v, int i)
{
    return (Motion){six_of_wheelset(v + V_wheelset_1_y + 5 * i), six_of_wheelset(v + V_wheelset_1_vy + 5 * i)};
}

/* Where the centre of mass is, from the origin of the body's track frame; centre: in the design position. */
static Vector displaced(Vector centre, Six place)
{
    return (Vector){centre.x + place.x, centre.y + place.y, centre.z + place.z};
}

/* Displacement and rate of a body, said of the origin of its track frame; centre: where its centre of mass is. */
static Motion on_rail_plane(Motion m, Vector centre)
{
    const Vector origin = {-centre.x, -centre.y, -centre.z};
    return (Motion){displacement_at(m.place, origin), displacement_at(m.rate, origin)};
}

/* Acceleration of a body from the wrench about its frame's origin; centre: of mass in the design position. */
static Six body_acceleration(Six wrench, Six place, Vector centre, double mass, Vector inertia, const TrackFrame *f)
{
    const Six w = wrench_at(wrench, displaced(centre, place));
    return (Six){
        w.x / mass,
        w.y / mass + f->lateral - centre.z * f->cant_acceleration - centre.x * f->heading_acceleration,
        w.z / mass + f->vertical + centre.y * f->cant_acceleration,
        w.roll / inertia.x - f->cant_acceleration,
        w.pitch / inertia.y,
        w.yaw / inertia.z - f->heading_acceleration,
    };
}

/* Bogie b and the car body, in the bogie's frame about its reference; gives the wrench on the car body in its own. */
static Six evaluate_secondary(const double *v, const DamperLaws *laws, Six car, Six frame, int b, Vehicle *vehicle)
{
    const TrackFrame *c = &vehicle->track.car, *f = &vehicle->track.frame[b];
    const double ahead = (b == 0 ? 0.5 : -0.5) * P(bogie_distance), roll = c->cant - f->cant,
                 yaw = c->heading - f->heading;
    const Pistons pistons = {&P(secondary_vertical_damper_1l_piston) + 2 * b, &P(lateral_damper_1l_piston) + 2 * b,
                             &P(yaw_damper_1l_piston) + 2 * b};
    Joint *joint = &vehicle->secondary_joint[b];
    Six upper = displacement_at(car, (Vector){ahead, 0.0, 0.0});
    upper.roll += roll, upper.yaw += yaw;
    *joint = joint_between(upper, frame);
    vehicle->secondary[b] = secondary_forces(v, laws, joint, pistons);
    return wrench_at(wrench_seen_from(joint->wrench, roll, yaw), (Vector){-ahead, 0.0, 0.0});
}

/* Wheelset i and bogie frame, in the frame's track frame; gives the wrench on the wheelset, about its track point. */
static Six evaluate_primary(const double *v, const DamperLaws *laws, Motion frame, Motion wheelset, int i,
                            Vehicle *vehicle)
{
    const TrackFrame *f = &vehicle->track.frame[i / 2], *w = &vehicle->track.wheelset[i];
    const double front = i % 2 ? -1.0 : 1.0, ahead = front * 0.5 * P(wheelbase), roll = w->cant - f->cant,
                 yaw = w->heading - f->heading;
    const Vector bogie = {-ahead, 0.0, 0.0};
    Joint *joint = &vehicle->primary_joint[i];
    Six lower = wheelset.place, lower_rate = wheelset.rate;
    lower.roll += roll, lower.yaw += yaw;
    lower_rate.roll += w->cant_rate - f->cant_rate, lower_rate.yaw += w->heading_rate - f->heading_rate;
    *joint = joint_between(frame.place, displacement_at(lower, bogie));
    const Six rate = six_subtract(frame.rate, displacement_at(lower_rate, bogie));
    for (int side = 0; side < 2; side++) {
        const int k = 2 * i + side;
        const Vector point = {ahead, side ? P(primary_half_base) : -P(primary_half_base), P(wheel_radius)};
        const AxleboxStates states = {(&P(rod_bush_1l_node_x))[k], (&P(rod_bush_1l_node_z))[k],
                                      (&P(vertical_damper_1l_piston))[k]};
        vehicle->axlebox[k] = axlebox_forces(v, laws, joint, rate, point, front, states);
    }
    return wrench_seen_from(wrench_at(six_scale(joint->wrench, -1.0), (Vector){ahead, 0.0, 0.0}), roll, yaw);
}

/* Both wheels on their rails; gives the wrench on the wheelset about its centre of mass. */
static Six evaluate_wheels(const ContactTable *table, const WheelRail *contact, Motion m, int i, Vehicle *vehicle)
{
    Six both[2];
    for (int side = 0; side < 2; side++) {
        const double out = side ? 1.0 : -1.0;
        const Rail *rail = &vehicle->track.rail[i][side];
        const WheelMotion motion = {
            .y = out * (m.place.y - rail->y),
            .z = m.place.z - rail->z,
            .roll = out * m.place.roll,
            .yaw = out * m.place.yaw,
            .y_rate = out * m.rate.y,
            .z_rate = m.rate.z,
            .roll_rate = out * m.rate.roll,
            .rail_y_rate = out * rail->y_rate,
            .rail_z_rate = rail->z_rate,
            .turning = out * (m.rate.yaw + vehicle->track.wheelset[i].heading_rate),
            .spin = -m.rate.pitch,
        };
        const WheelForce f = wheel_force(table, contact, &motion);
        vehicle->wheel[2 * i + side] = f;
        vehicle->wheel_y[2 * i + side] = motion.y - contact->radius * motion.roll;
        both[side] = (Six){f.x, out * f.y, f.z, out * f.roll, f.pitch, out * f.yaw};
    }
    return six_add(both[RIGHT], both[LEFT]);
}

static Six wheelset_acceleration(const double *v, Six primary, Six wheels, Motion m, double rolling,
                                 const TrackFrame *f)
{
    const Vector centre = {0.0, 0.0, P(wheel_radius)}, inertia = {P(wheelset_Ixx), P(wheelset_Iyy), P(wheelset_Izz)};
    Six a = body_acceleration(primary, m.place, centre, P(wheelset_mass), inertia, f);
    const double spin = inertia.y * (rolling - m.rate.pitch); /* angular momentum of the rolling wheelset */
    a.x = 0.0;
    a.y += wheels.y / P(wheelset_mass);
    a.z += wheels.z / P(wheelset_mass);
    a.roll += (wheels.roll - spin * (m.rate.yaw + f->heading_rate)) / inertia.x;
    a.pitch = wheels.pitch / inertia.y;
    a.yaw += (wheels.yaw + spin * (m.rate.roll + f->cant_rate)) / inertia.z;
    return a;
}

static WheelRail wheel_rail(const double *v, double speed)
{
    return (WheelRail){
        .speed = speed,
        .rolling = speed / P(wheel_radius),
        .half_base = P(half_contact_distance),
        .radius = P(wheel_radius),
        .friction = P(mu),
        .shear_modulus = P(shear_modulus),
        .approach = P(contact_approach),
        .damping = P(contact_damping),
    };
}

void vehicle_evaluate(const struct Resources *resources, const double *v, bool level, Vehicle *vehicle)
{
    const Vector car_centre = {P(car_cg_x), P(car_cg_y), P(car_cg_height)},
                 frame_centre = {P(frame_cg_x), 0.0, P(frame_cg_height)};
    const Vector car_inertia = {P(car_Ixx), P(car_Iyy), P(car_Izz)},
                 frame_inertia = {P(frame_Ixx), P(frame_Iyy), P(frame_Izz)};
    const Vector axle = {0.0, 0.0, P(wheel_radius)};
    const DamperLaws laws = damper_laws(v);
    const Motion car = body_motion(v, 0);
    const Motion car_at = on_rail_plane(car, displaced(car_centre, car.place));
    const Track *t = &vehicle->track;
    Six on_car = {0};
    track_below(&resources->irregularity, v, level, &vehicle->track);
    const WheelRail contact = wheel_rail(v, t->speed);
    for (int b = 0; b < BOGIES; b++) {
        const Motion frame = body_motion(v, 6 * (b + 1));
        const Motion at = on_rail_plane(frame, displaced(frame_centre, frame.place));
        const Six from_frame = evaluate_secondary(v, &laws, car_at.place, at.place, b, vehicle);
        Six on_frame = six_scale(vehicle->secondary_joint[b].wrench, -1.0);
        on_car = six_add(on_car, from_frame);
        for (int i = 2 * b; i < 2 * b + 2; i++) {
            const Motion m = wheelset_motion(v, i);
            Motion low = m;
            low.place.pitch = low.rate.pitch = 0.0; /* the axleboxes do not turn with the wheelset */
            low = on_rail_plane(low, displaced(axle, m.place));
            const Six primary = evaluate_primary(v, &laws, at, low, i, vehicle);
            const Six wheels = evaluate_wheels(&resources->contact, &contact, m, i, vehicle);
            on_frame = six_add(on_frame, vehicle->primary_joint[i].wrench);
            vehicle->wheelset[i] = wheelset_acceleration(v, primary, wheels, m, contact.rolling, &t->wheelset[i]);
        }
        vehicle->frame[b] =
            body_acceleration(on_frame, frame.place, frame_centre, P(frame_mass), frame_inertia, &t->frame[b]);
    }
    vehicle->car = body_acceleration(on_car, car.place, car_centre, P(car_mass), car_inertia, &t->car);
}
