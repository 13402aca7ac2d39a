/* Secondary suspension of one bogie. */
#include "secondary.h"

static void air_springs(const double *v, Joint *joint, Secondary *s)
{
    for (int side = 0; side < 2; side++) {
        const double y = side ? P(air_spring_half_base) : -P(air_spring_half_base);
        const Vector p = joint_point(joint, (Vector){0.0, y, P(air_spring_height)}), d = joint_deflection(joint, p, y);
        s->air_spring[side] = P(air_spring_preload) - P(air_spring_kz) * d.z;
        joint_push_turning(joint, (Vector){-P(air_spring_kx) * d.x, -P(air_spring_ky) * d.y, s->air_spring[side]}, p);
    }
}

static void dampers(const double *v, const DamperLaws *laws, Joint *joint, Pistons pistons, Secondary *s)
{
    for (int side = 0; side < 2; side++) {
        const double out = side ? 1.0 : -1.0;
        const double vertical_y = out * P(secondary_vertical_damper_half_base), yaw_y = out * P(yaw_damper_half_base);
        const double ahead = -out * P(lateral_damper_offset); /* the left one is ahead */
        const Vector vertical = joint_point(joint, (Vector){0.0, vertical_y, P(air_spring_height)});
        const Vector lateral = joint_point(joint, (Vector){ahead, 0.0, P(lateral_damper_height)});
        const Vector yaw = joint_point(joint, (Vector){0.0, yaw_y, P(yaw_damper_height)});
        const double up = s->vertical_stroke[side] = joint_deflection(joint, vertical, vertical_y).z;
        const double right = s->lateral_stroke[side] = joint_deflection(joint, lateral, 0.0).y;
        const double forward = s->yaw_stroke[side] = joint_deflection(joint, yaw, yaw_y).x;
        s->vertical[side] = maxwell(laws->secondary_vertical, 1, 1.0, P(secondary_vertical_damper_series), up, 0.0,
                                    pistons.vertical[side], 0.0);
        s->lateral[side] =
            maxwell(laws->lateral, 2, 1.0, P(lateral_damper_series), right, 0.0, pistons.lateral[side], 0.0);
        s->yaw[side] = maxwell(laws->yaw, 3, 1.0, P(yaw_damper_series), forward, 0.0, pistons.yaw[side], 0.0);
        joint_push_z(joint, -s->vertical[side].force, vertical);
        joint_push_y(joint, -s->lateral[side].force, lateral);
        joint_push_x(joint, -s->yaw[side].force, yaw);
    }
}

Secondary secondary_forces(const double *v, const DamperLaws *laws, Joint *joint, Pistons pistons)
{
    Secondary s;
    air_springs(v, joint, &s);
    dampers(v, laws, joint, pistons, &s);
    const Vector pivot = joint_point(joint, (Vector){0.0, 0.0, P(centre_pivot_height)});
    const Vector stop = joint_point(joint, (Vector){0.0, 0.0, P(lateral_stop_height)});
    s.anti_roll_bar = P(anti_roll_bar_k) * joint->relative.roll;
    joint->wrench.roll -= s.anti_roll_bar;
    /* the dummy bolster is fixed to the car body: its end of the pivot moves with the car body and loads it there */
    s.centre_pivot = P(centre_pivot_k) * joint_deflection(joint, pivot, 0.0).x;
    joint_push_x(joint, -s.centre_pivot, pivot);
    s.lateral_stop = bump_stop(P(lateral_stop_gap), joint_deflection(joint, stop, 0.0).y);
    joint_push_y(joint, -s.lateral_stop, stop);
    return s;
}
