/* Secondary suspension of one bogie: air springs, dampers, anti-roll bar, centre pivot, lateral stop. */
#ifndef FULL_VEHICLE_SECONDARY_H
#define FULL_VEHICLE_SECONDARY_H

#include "joint.h"
#include "suspension_laws.h"

/* Pistons of the dampers [left, right], in m. */
typedef struct {
    const double *vertical, *lateral, *yaw;
} Pistons;

/* Forces in N, strokes in m, piston rates in m/s; [left, right]. */
typedef struct {
    double air_spring[2]; /* positive compressed */
    Maxwell vertical[2], lateral[2], yaw[2];
    double vertical_stroke[2], lateral_stroke[2], yaw_stroke[2];
    double anti_roll_bar; /* N m */
    double centre_pivot, lateral_stop;
} Secondary;

/* Adds the forces to the joint of car body (upper) and bogie frame, said of the bogie's reference on the rail plane. */
Secondary secondary_forces(const double *v, const DamperLaws *laws, Joint *joint, Pistons pistons);

#endif
