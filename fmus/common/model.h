/* What a model gives to the generic FMI layer. A model is three functions over one flat array of doubles.
 *
 * tools/build_fmus.py reads <model>/variables.toml and generates variables.h, which defines
 *   enum { V_time = 0, V_<name>, ... NV };   one index a variable, equal to its FMI value reference
 *                                            (dots and brackets in a name become underscores)
 *   enum { NX, X0, DX0 };                    the NX states lie at v[X0 .. X0+NX), their derivatives at v[DX0 .. DX0+NX)
 *   static const Variable variables[NV];     name, causality, start, min, max, nominal (as the model description says)
 *   MODEL_NAME, MODEL_TOKEN, MODEL_INTERNAL_STEP
 *   MODEL_RESOURCES                          only for a model that reads files: variables.toml names them as resources
 * v holds time, parameters, inputs, states, derivatives and outputs, all in the unit of variables.toml: it is the
 * whole of an instance's memory, so that copying it is getting and setting the FMU state, exact to the bit.
 *
 * The layer integrates with the classical Runge-Kutta method (order 4), each communication step cut into equal
 * sub-steps no longer than MODEL_INTERNAL_STEP; inputs are held over a communication step. There is no other memory, but for
 * the resources of a model that reads files: read once at instantiation and constant from then on. They are the first
 * argument of every function below, and of no function of a model that reads none. */
#ifndef FMUCORRECT_MODEL_H
#define FMUCORRECT_MODEL_H

#include <stddef.h>

typedef enum { PARAMETER, TUNABLE, INPUT, OUTPUT, LOCAL, STATE, DERIVATIVE, INDEPENDENT } Causality;

typedef struct {
    const char *name;
    Causality causality;
    double start, min, max; /* min = -INFINITY, max = INFINITY where the description sets none */
    double nominal;         /* 1 where the description sets none: the scale of the variable, for numerical derivatives */
} Variable;

#ifdef MODEL_RESOURCES
typedef struct Resources Resources; /* the model's own */

/* Reads the files in the folder, a path that ends in a separator. NULL, and one line in message (which file, where, what
 * was expected, what was found), when that cannot be done. */
Resources *model_load(const char *folder, char *message, size_t size);
void model_unload(Resources *resources);

#define RESOURCES const Resources *resources,
#else
#define RESOURCES
#endif

/* NULL when the parameters (and inputs) in v make sense, else one line: what, where, expected, got. Called at the end of
 * initialisation and after a tunable parameter has changed. */
const char *model_check(RESOURCES const double *v, char *message, size_t size);

/* Called once when initialisation ends: sets states that follow from parameters (a static equilibrium, say). States whose
 * start the user gave are already in v. May do nothing. */
void model_initialise(RESOURCES double *v);

/* v[time], states, inputs, parameters -> v[DX0 ..]. Must not read derivatives or outputs of an earlier call. */
void model_derivatives(RESOURCES double *v);

/* v[time], states, inputs, parameters, and the derivatives just computed -> every output and local in v. */
void model_outputs(RESOURCES double *v);

#endif
