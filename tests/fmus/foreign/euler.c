/* A solver of fixed step that takes one step a communication step, by forward Euler: what comes out depends on how the host divides
 * time, and on nothing else. Exports of controllers and of real-time models do so.
 *
 * A mass on a spring and a damper, m x'' = f - k (x - u) - c v. Inputs u (mm), f (N), which starts with 60 N, as a weight that was
 * given to the input itself; outputs x (mm), v (m/s), how many steps were taken. */
enum { U, F, X, V, STEPS, COUNT };

typedef struct {
    double values[COUNT];
} Model;
#define INITIAL {{[F] = 60.0}}
#include "slave.h"

static void model_start(Model *self, double time) { self->values[X] = 1.0; }
static double model_get(Model *self, unsigned at) { return self->values[at]; }
static void model_set(Model *self, unsigned at, double value) { self->values[at] = value; }

static int model_step(Model *self, double time, double size)
{
    double *v = self->values;
    const double acceleration = (v[F] - 4.0 * (v[X] - v[U]) - 20.0 * v[V]) / 10.0;
    v[X] += 1e3 * size * v[V];
    v[V] += size * acceleration;
    v[STEPS] += 1.0;
    return OK;
}
