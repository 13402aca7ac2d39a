/* Railway vehicle on track: what the generic FMI layer asks of a model. Equations and sources: readme.md. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "equilibrium.h"
#include "vehicle.h"

Resources *model_load(const char *folder, char *message, size_t size)
{
    char path[1024];
    Resources *resources = calloc(1, sizeof *resources);
    if (!resources) {
        snprintf(message, size, "no memory for the contact table");
        return NULL;
    }
    if (strlen(folder) + 20 > sizeof path) {
        snprintf(message, size, "%.100s...: expected a path of less than %u characters", folder,
                 (unsigned)sizeof path - 20);
        free(resources);
        return NULL;
    }
    snprintf(path, sizeof path, "%scontact.csv", folder);
    bool read = contact_table_read(&resources->contact, path, message, size);
    snprintf(path, sizeof path, "%sirregularity.csv", folder);
    read = read && irregularity_read(&resources->irregularity, path, message, size);
    if (read)
        return resources;
    model_unload(resources);
    return NULL;
}

void model_unload(Resources *resources)
{
    if (resources) {
        free(resources->contact.rows);
        free(resources->irregularity.rows);
    }
    free(resources);
}

const char *model_check(const Resources *resources, const double *v, char *message, size_t size)
{
    return check_parameters(v, message, size);
}

void model_initialise(const Resources *resources, double *v) { equilibrium_add(resources, v); }

static void put_wheelset(double *v, int i, Six a)
{
    memcpy(&v[DX0 + V_wheelset_1_vy - X0 + 5 * i], &a.y, 5 * sizeof *v);
}

void model_derivatives(const Resources *resources, double *v)
{
    Vehicle vehicle;
    double *d = v + DX0 - X0; /* d[V_<state>] is the state's derivative */
    bool held;
    vehicle_evaluate(resources, v, false, &vehicle);
    memcpy(&d[V_car_body_x], &v[V_car_body_vx], MOTIONS * sizeof *v);
    memcpy(&d[V_car_body_vx], &vehicle.car, sizeof vehicle.car);
    memcpy(&d[V_frame_1_vx], &vehicle.frame[0], sizeof vehicle.frame[0]);
    memcpy(&d[V_frame_2_vx], &vehicle.frame[1], sizeof vehicle.frame[1]);
    for (int i = 0; i < WHEELSETS; i++)
        put_wheelset(v, i, vehicle.wheelset[i]);
    for (int k = 0; k < AXLEBOXES; k++) {
        d[V_vertical_damper_1l_piston + k] = vehicle.axlebox[k].piston_rate;
        d[V_rod_bush_1l_node_x + k] = vehicle.axlebox[k].node_x_rate;
        d[V_rod_bush_1l_node_z + k] = vehicle.axlebox[k].node_z_rate;
    }
    for (int k = 0; k < 2 * BOGIES; k++) {
        const Secondary *s = &vehicle.secondary[k / 2];
        d[V_secondary_vertical_damper_1l_piston + k] = s->vertical[k % 2].piston_speed;
        d[V_lateral_damper_1l_piston + k] = s->lateral[k % 2].piston_speed;
        d[V_yaw_damper_1l_piston + k] = s->yaw[k % 2].piston_speed;
    }
    d[V_distance] = running_speed(v, &d[V_speed_change], &held);
}

static void put_bodies(double *v, const Vehicle *vehicle)
{
    const Six *body[BODIES] = {&vehicle->car,         &vehicle->frame[0],    &vehicle->frame[1],
                               &vehicle->wheelset[0], &vehicle->wheelset[1], &vehicle->wheelset[2],
                               &vehicle->wheelset[3]};
    P(residual_acceleration) = 0.0;
    for (int b = 0; b < BODIES; b++) {
        memcpy(&P(car_body_ay) + 5 * b, &body[b]->y, 5 * sizeof *v);
        P(residual_acceleration) = fmax(P(residual_acceleration), fmax(fabs(body[b]->y), fabs(body[b]->z)));
    }
}

static void put_wheels(const Resources *resources, double *v, const Vehicle *vehicle)
{
    P(wheel_lift) = P(outside_table) = P(constraint_acceleration) = 0.0;
    for (int k = 0; k < AXLEBOXES; k++) {
        const WheelForce *f = &vehicle->wheel[k];
        const Six *a = &vehicle->wheelset[k / 2];
        const double out = k % 2 ? 1.0 : -1.0;
        double *to = &P(wheel_1l_Y) + 4 * k;
        to[0] = -f->y;
        to[1] = f->z;
        to[2] = f->x;
        to[3] = atan(f->slope);
        const double normal = (f->slope * out * (a->y - P(wheel_radius) * a->roll) - a->z + out * f->arm * a->roll) /
                              sqrt(1.0 + f->slope * f->slope);
        P(constraint_acceleration) = fmax(P(constraint_acceleration), fabs(normal));
        if (!(f->normal > 0.0))
            P(wheel_lift) = 1.0;
        if (!contact_table_covers(&resources->contact, vehicle->wheel_y[k]))
            P(outside_table) = 1.0;
    }
}

static void put_elements(double *v, const Vehicle *vehicle)
{
    for (int k = 0; k < AXLEBOXES; k++) {
        const Axlebox *a = &vehicle->axlebox[k];
        const double bush[6] = {a->bush_z, a->bush_z, P(rod_bush_z_preload), a->bush_deformation_z,
                                a->bush_x, a->bush_y};
        (&P(coil_1l_F))[k] = a->coil;
        memcpy(&P(rod_bush_1l_F) + 6 * k, bush, sizeof bush);
        (&P(vertical_damper_1l_F))[k] = a->damper;
    }
    for (int k = 0; k < 2 * BOGIES; k++) {
        const Secondary *s = &vehicle->secondary[k / 2];
        (&P(air_spring_1l_F))[k] = s->air_spring[k % 2];
        (&P(secondary_vertical_damper_1l_F))[k] = s->vertical[k % 2].force;
        (&P(lateral_damper_1l_F))[k] = s->lateral[k % 2].force;
        (&P(yaw_damper_1l_F))[k] = s->yaw[k % 2].force;
    }
    for (int b = 0; b < BOGIES; b++) {
        (&P(anti_roll_bar_1_F))[b] = vehicle->secondary[b].anti_roll_bar;
        (&P(centre_pivot_1_F))[b] = vehicle->secondary[b].centre_pivot;
        (&P(lateral_stop_1_F))[b] = vehicle->secondary[b].lateral_stop;
    }
}

void model_outputs(const Resources *resources, double *v)
{
    Vehicle vehicle;
    bool held;
    double rate;
    vehicle_evaluate(resources, v, false, &vehicle);
    put_bodies(v, &vehicle);
    put_wheels(resources, v, &vehicle);
    put_elements(v, &vehicle);
    P(running_speed) = running_speed(v, &rate, &held);
    P(speed_held) = held ? 1.0 : 0.0;
    P(curvature) = vehicle.track.car.curvature;
    P(cant_angle) = vehicle.track.car.cant;
}
