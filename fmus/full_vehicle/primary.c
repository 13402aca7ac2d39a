/* Primary suspension of one axlebox. */
#include "primary.h"

Axlebox axlebox_forces(const double *v, const DamperLaws *laws, Joint *joint, Six rate, Vector point, double front,
                       AxleboxStates states)
{
    const Vector place = joint_point(joint, point), d = joint_deflection(joint, place, point.y);
    const Maxwell damper = maxwell(laws->vertical, 2, 1.0, P(vertical_damper_series), d.z, 0.0, states.piston, 0.0);
    Axlebox a = {.bush_deformation_x = front * d.x,
                 .bush_deformation_z = -d.z,
                 .damper = damper.force,
                 .stroke = d.z,
                 .piston_rate = damper.piston_speed};

    /* series branch k_ser (d_b - n); parallel branch k_par n + c n' + F0: both transmit the same force */
    a.bush_x = P(rod_bush_x_series) * (a.bush_deformation_x - states.node_x);
    a.bush_z = P(rod_bush_z_series) * (a.bush_deformation_z - states.node_z);
    a.node_x_rate = (a.bush_x - P(rod_bush_x_parallel) * states.node_x - P(rod_bush_x_preload)) / P(rod_bush_x_damping);
    a.node_z_rate = (a.bush_z - P(rod_bush_z_parallel) * states.node_z - P(rod_bush_z_preload)) / P(rod_bush_z_damping);
    a.bush_y = P(rod_bush_ky) * d.y + P(rod_bush_cy) * point_displacement(rate, place).y;
    a.coil = P(coil_preload) - P(coil_kz) * d.z;

    joint_push_turning(
        joint,
        (Vector){-P(coil_kx) * d.x - front * a.bush_x, -P(coil_ky) * d.y - a.bush_y, a.coil + a.bush_z - a.damper},
        place);
    return a;
}
