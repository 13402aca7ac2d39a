/* Static equilibrium of the vehicle running straight. */
#ifndef FULL_VEHICLE_EQUILIBRIUM_H
#define FULL_VEHICLE_EQUILIBRIUM_H

#include "vehicle.h"

/* Adds to the states in v those of the steady motion on straight, level track at the speed in v, found by Newton's
 * method on the model's own equations. Where there is none the states become NAN. */
void equilibrium_add(const struct Resources *resources, double *v);

#endif
