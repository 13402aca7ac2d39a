/* What joins two bodies: how the upper one stands and moves against the lower one, and what the elements between them
 * give.
 *
 * Both bodies' displacements are said of one origin in one frame, so that a force at a point loads both with equal and
 * opposite wrenches about that origin: linear and angular momentum are kept, exactly. An element acts in the middle
 * between the two bodies' displaced points, and its static force turns with the mean of their rolls and pitches. */
#ifndef FULL_VEHICLE_JOINT_H
#define FULL_VEHICLE_JOINT_H

#include "pose.h"

typedef struct {
    Six relative, middle; /* displacement of the upper body against the lower one; mean of both */
    Six wrench;           /* on the upper body, about the origin; the lower one gets its opposite */
} Joint;

static inline Joint joint_between(Six upper, Six lower)
{
    return (Joint){six_subtract(upper, lower), six_scale(six_add(upper, lower), 0.5), {0}};
}

/* Where an element acts whose place is `point` in the design position. */
static inline Vector joint_point(const Joint *j, Vector point)
{
    const Vector d = point_displacement(j->middle, point);
    return (Vector){point.x + d.x, point.y + d.y, point.z + d.z};
}

/* How far the upper body's end of an element at this place has moved against the lower one's. The place counts with its
 * nominal y: that a body which stands beside its chord comes nearer to or farther from the other one as they turn would
 * stretch the vehicle, whose wheelsets are held at given distances along the track and in truth roll to where they
 * want. */
static inline Vector joint_deflection(const Joint *j, Vector place, double nominal_y)
{
    return point_displacement(j->relative, (Vector){place.x, nominal_y, place.z});
}

/* A force along one axis on the upper body, at a place that joint_point gave. */
static inline void joint_push_x(Joint *j, double force, Vector place)
{
    j->wrench.x += force;
    j->wrench.pitch -= place.z * force;
    j->wrench.yaw -= place.y * force;
}

static inline void joint_push_y(Joint *j, double force, Vector place)
{
    j->wrench.y += force;
    j->wrench.roll += place.z * force;
    j->wrench.yaw += place.x * force;
}

static inline void joint_push_z(Joint *j, double force, Vector place)
{
    j->wrench.z += force;
    j->wrench.roll -= place.y * force;
    j->wrench.pitch += place.x * force;
}

/* A force whose vertical component, a static load, turns with the bodies. */
static inline void joint_push_turning(Joint *j, Vector force, Vector place)
{
    const Vector turned = {force.x - j->middle.pitch * force.z, force.y + j->middle.roll * force.z, force.z};
    j->wrench = six_add(j->wrench, wrench_of(turned, place));
}

#endif
