/* A solver that holds the time that it is given against its own: each step is to begin where the last one ended, in double
 * precision. Some exporters' FMUs answer with a warning where it does not, and refuse what is further off.
 *
 * x = sin(2 pi t) (mm) at the time that it was given. misses: steps that did not begin to the bit where the last one ended. apart:
 * by how much at most (s). steps: how many. end: where the last one ended (s). shortest, longest (s). */
#include <math.h>
#include <stdbool.h>

enum { U, F, X, MISSES, APART, STEPS, END, SHORTEST, LONGEST, COUNT };

typedef struct {
    double values[16];
} Model;
#include "slave.h"

static void model_start(Model *self, double time)
{
    self->values[END] = time;
    self->values[SHORTEST] = 1e9;
}

static double model_get(Model *self, unsigned reference)
{
    return reference == X ? sin(6.283185307179586 * self->values[END]) : self->values[reference];
}

static void model_set(Model *self, unsigned reference, double value) { self->values[reference] = value; }

static int model_step(Model *self, double time, double size)
{
    double *v = self->values;
    const double apart = fabs(time - v[END]);
    v[MISSES] += apart != 0.0;
    v[APART] = fmax(v[APART], apart);
    v[STEPS] += 1.0;
    v[SHORTEST] = fmin(v[SHORTEST], size);
    v[LONGEST] = fmax(v[LONGEST], size);
    if (apart > 1e-9)
        return ERROR;
    v[END] = time + size;
    return apart > 1e-12 ? WARNING : OK;
}
