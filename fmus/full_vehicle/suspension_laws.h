/* Laws of the nonlinear dampers, from the parameters. */
#ifndef FULL_VEHICLE_SUSPENSION_LAWS_H
#define FULL_VEHICLE_SUSPENSION_LAWS_H

#include "suspension.h"
#include "variables.h"

#define P(name) v[V_##name] /* a parameter, input, state or output */

typedef struct {
    Point vertical[2], secondary_vertical[1], lateral[2], yaw[3];
} DamperLaws;

static inline DamperLaws damper_laws(const double *v)
{
    DamperLaws laws;
    law_with_knee(laws.vertical, P(vertical_damper_c1), P(vertical_damper_knee), P(vertical_damper_c2));
    laws.secondary_vertical[0] = (Point){1.0, P(secondary_vertical_damper_c)};
    law_with_knee(laws.lateral, P(lateral_damper_c1), P(lateral_damper_knee), P(lateral_damper_c2));
    laws.yaw[0] = (Point){P(yaw_damper_v1), P(yaw_damper_F1)};
    laws.yaw[1] = (Point){P(yaw_damper_v2), P(yaw_damper_F2)};
    laws.yaw[2] = (Point){P(yaw_damper_v3), P(yaw_damper_F3)};
    return laws;
}

#endif
