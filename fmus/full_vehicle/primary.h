/* Primary suspension of one axlebox: coil-spring pair, rod bush, vertical damper in series with its attachment. */
#ifndef FULL_VEHICLE_PRIMARY_H
#define FULL_VEHICLE_PRIMARY_H

#include "joint.h"
#include "suspension_laws.h"

typedef struct {
    double coil;                                   /* N, positive compressed */
    double bush_x, bush_y, bush_z;                 /* N: what the rod bush transmits; x and z positive compressed */
    double bush_deformation_x, bush_deformation_z; /* m, positive compressed */
    double node_x_rate, node_z_rate;               /* of the rod bush's internal nodes, m/s */
    double damper, stroke, piston_rate;            /* N, m, m/s */
} Axlebox;

/* The internal nodes of the rod bush at rest, m: k_ser (d - n) = k_par n + F0. */
static inline double resting_node(double series, double parallel, double preload, double deformation)
{
    return (series * deformation - preload) / (series + parallel);
}

/* Internal states, m. */
typedef struct {
    double node_x, node_z, piston;
} AxleboxStates;

/* Adds the forces of an axlebox to the joint of frame (upper) and wheelset. rate: of their relative displacement;
 * front: 1 for the leading wheelset, else -1. */
Axlebox axlebox_forces(const double *v, const DamperLaws *laws, Joint *joint, Six rate, Vector point, double front,
                       AxleboxStates states);

#endif
