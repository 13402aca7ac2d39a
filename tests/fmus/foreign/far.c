/* A solver as tools write it that number their variables through all of a large model, and keep what they compute in globals: value
 * references from 2^30 on, one instance in the life of a process, no state to be saved.
 *
 * A mass on a spring and a damper, m x'' = f - k (x - u) - c v. Inputs u (mm), f (N); outputs x (mm), v (m/s). */
enum { U, F, X, V, COUNT };
#define FIRST (1u << 30)
#define INSTANCES 1

typedef struct {
    int unused;
} Model;
#include "slave.h"

static double variables[COUNT];

static void model_start(Model *self, double time) { variables[X] = 1.0; }
static double model_get(Model *self, unsigned at) { return variables[at]; }
static void model_set(Model *self, unsigned at, double value) { variables[at] = value; }

static int model_step(Model *self, double time, double size)
{
    for (int i = 0; i < 10; i++) {
        variables[V] += 0.1 * size * (variables[F] - 4.0 * (variables[X] - variables[U]) - 20.0 * variables[V]) / 10.0;
        variables[X] += 0.1 * size * 1e3 * variables[V];
    }
    return OK;
}
