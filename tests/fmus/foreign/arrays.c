/* A solver of FMI 3.0 that has all its variables as arrays, as tools do that export a vector of sensors and one of actuators.
 *
 * Two masses, each on a spring and a damper: m x'' = f - k x - c v. Inputs f[2] (N), of which the first begins with 60; outputs
 * x[2,1] (micrometres, which the FMU calls mum), v[2] (m/s). */
enum { F, X, V, COUNT };
#define WIDTH 2

typedef struct {
    double values[COUNT * WIDTH];
} Model;
#define INITIAL {{60.0}}
#include "slave.h"

static void model_start(Model *self, double time) { self->values[X * WIDTH] = 1e3; }
static double model_get(Model *self, unsigned at) { return self->values[at]; }
static void model_set(Model *self, unsigned at, double value) { self->values[at] = value; }

static int model_step(Model *self, double time, double size)
{
    for (int i = 0; i < WIDTH; i++) {
        const double *f = self->values + F * WIDTH;
        double *x = self->values + X * WIDTH, *v = self->values + V * WIDTH;
        v[i] += size * (f[i] - 4e-3 * x[i] - 20.0 * v[i]) / 10.0;
        x[i] += 1e6 * size * v[i];
    }
    return OK;
}
