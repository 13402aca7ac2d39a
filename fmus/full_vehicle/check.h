/* Whether the parameters make sense together. */
#ifndef FULL_VEHICLE_CHECK_H
#define FULL_VEHICLE_CHECK_H

#include <stddef.h>

/* NULL, or one line in message: what, expected, got. */
const char *check_parameters(const double *v, char *message, size_t size);

#endif
