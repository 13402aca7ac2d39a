/* A solver with a variable step that grows while nothing happens, as the multistep integrators of large tools do: an input that is
 * set is noticed when the next value is asked for, and the integrator begins again with its smallest step. An input that is set
 * and not followed by a reading goes into the step as it is. Both are right, to its accuracy, and to the bit they are not the same.
 *
 * A mass on a spring whose base is moved: m x'' = f + k (u - x) - c x'. Inputs u (mm), f (N); outputs x (mm), y = x - u (mm), which
 * an input reaches at once, a (m/s2) likewise, v (m/s), and how often it began again. */
#include <stdbool.h>

enum { U, F, X, Y, V, A, RESTARTS, COUNT };

typedef struct {
    double u, f, x, v, step; /* SI, but u in mm */
    int restarts;
    bool changed;
} Model;
#include "slave.h"

static const double MASS = 10.0, STIFFNESS = 4000.0, DAMPING = 20.0, SMALLEST = 1e-5;

static void model_start(Model *self, double time)
{
    self->step = SMALLEST;
    self->x = 1e-3;
}

static double acceleration(const Model *self)
{
    return (self->f + STIFFNESS * (1e-3 * self->u - self->x) - DAMPING * self->v) / MASS;
}

static double model_get(Model *self, unsigned reference)
{
    if (reference == RESTARTS)
        return self->restarts;
    if (self->changed && reference >= X) {
        self->changed = false;
        self->step = SMALLEST;
        self->restarts++;
    }
    const double values[] = {self->u, self->f, 1e3 * self->x, 1e3 * self->x - self->u, self->v, acceleration(self)};
    return values[reference];
}

static void model_set(Model *self, unsigned reference, double value)
{
    if (reference <= F) {
        *(reference == U ? &self->u : &self->f) = value;
        self->changed = true;
    }
}

static int model_step(Model *self, double time, double size)
{
    self->changed = false;
    for (double done = 0.0; done < size;) {
        const double h = self->step < size - done ? self->step : size - done;
        self->v += h * acceleration(self); /* semi-implicit Euler: its error shows the step */
        self->x += h * self->v;
        done = h < self->step ? size : done + h;
        self->step *= 1.5;
    }
    return OK;
}
