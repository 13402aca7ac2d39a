/* One instance of a model, independent of the FMI version: its memory, phases, checks and integration.
 *
 * Every function that can refuse logs one line (what, expected, got) and returns STATUS_ERROR; a refused call changes
 * nothing, so that the instance can be used on. fmi2.c and fmi3.c translate the standard's calls to these. */
#ifndef FMUCORRECT_INSTANCE_H
#define FMUCORRECT_INSTANCE_H

#include <stdbool.h>
#include <stddef.h>

#include "variables.h"

/* The values of fmi2Status and fmi3Status. */
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR } Status;

/* Instantiated -> initialising -> stepping -> terminated; reset leads back to the first. */
typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } Phase;

/* All that an FMU state holds. */
typedef struct {
    Phase phase;
    double stop_time; /* s, INFINITY where the host set none */
    double v[NV];
} State;

typedef struct Instance Instance;
typedef void Logger(Instance *self, Status status, const char *category, const char *message);

struct Instance {
    State state;
    bool stale;           /* derivatives and outputs in v do not follow yet from time, states, inputs and parameters */
    bool verbose;         /* log what happens (logAll), not only refusals */
    double scratch[NV];   /* v as it was before a call that may be refused, or as it would be if initialisation ended now */
    double x[NX], dx[NX]; /* Runge-Kutta: states at the start of the sub-step, weighted sum of the slopes */
#ifdef MODEL_RESOURCES
    Resources *resources;
#endif
    char *name;
    Logger *logger;
    void (*callback)(void); /* the host's log function and its context, as logger knows them */
    void *environment;
};

#ifdef MODEL_RESOURCES
#define OF(instance) (instance)->resources, /* the first argument of the model's functions */

/* Reads the model's files; folder as in instance_new. */
Status instance_load(Instance *self, const char *folder);
#else
#define OF(instance)
#endif

/* folder: of the FMU's resources, as the host gives it: a path, or a file URI. NULL without memory, when the token is not
 * the model's own, or when the model cannot read its files (which is logged). */
Instance *instance_new(const char *name, const char *token, const char *folder, bool verbose, Logger *logger, void (*callback)(void),
                       void *environment);
void instance_free(Instance *self);

/* Logs a formatted line and returns the status. STATUS_OK is logged only when verbose. */
#if defined(__GNUC__)
__attribute__((format(printf, 3, 4)))
#endif
Status instance_log(Instance *self, Status status, const char *format, ...);

/* categories: the names that the model description declares; none means all. */
Status instance_debug_logging(Instance *self, bool on, size_t n, const char *const categories[]);

Status instance_setup(Instance *self, double start_time, bool stop_defined, double stop_time);
Status instance_enter_initialisation(Instance *self);
Status instance_exit_initialisation(Instance *self);
Status instance_terminate(Instance *self);
Status instance_reset(Instance *self);

/* Computes derivatives and outputs in v, as if initialisation ended now where it has not. */
void instance_evaluate(const Instance *self, double *v);

/* v with derivatives and outputs that follow from the rest; valid until the next call. */
const double *instance_values(Instance *self);

/* All n values are set, or none. Fixed parameters and states until initialisation ends, tunable parameters and inputs always. */
Status instance_set(Instance *self, const unsigned references[], size_t n, const double values[]);

/* Any variable in any phase; before initialisation ends, what it would be if initialisation ended now. */
Status instance_get(Instance *self, const unsigned references[], size_t n, double values[]);

/* Integrates from t to t + h, in s; t is where the last step ended. */
Status instance_step(Instance *self, double t, double h);

/* Derivative of an output, local or state derivative (unknown) with respect to an input, state or parameter (known), by
 * central differences of relative step cbrt(DBL_EPSILON): the sum over the knowns of d unknown / d known * seed, for
 * every unknown; or, adjoint, the sum over the unknowns of seed * d unknown / d known, for every known. */
Status instance_directional(Instance *self, const unsigned unknowns[], size_t n_unknowns, const unsigned knowns[], size_t n_knowns,
                            const double seed[], double sensitivity[]);
Status instance_adjoint(Instance *self, const unsigned unknowns[], size_t n_unknowns, const unsigned knowns[], size_t n_knowns,
                        const double seed[], double sensitivity[]);

/* The state: *state is allocated when NULL and freed (and set to NULL) by instance_free_state. */
Status instance_get_state(Instance *self, State **state);
Status instance_set_state(Instance *self, const State *state);
void instance_free_state(State **state);

/* A state as bytes: the model's token, phase, stop time and v, exact to the bit on machines of the same byte order. */
enum { SERIALISED_SIZE = 40 + 8 * (2 + NV) };
Status instance_serialise(Instance *self, const State *state, unsigned char bytes[], size_t size);
Status instance_deserialise(Instance *self, const unsigned char bytes[], size_t size, State **state);

#endif
