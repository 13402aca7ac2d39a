/* An instance's life, checks, values and integration. */
#include "instance.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const phases[] = {"before initialisation", "during initialisation", "after initialisation", "after termination"};

Status instance_log(Instance *self, Status status, const char *format, ...)
{
    if (self->logger && (status != STATUS_OK || self->verbose)) {
        char message[512];
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(message, sizeof message, format, arguments);
        va_end(arguments);
        self->logger(self, status, status == STATUS_OK ? "logAll" : "logStatusError", message);
    }
    return status;
}

static void set_start_values(Instance *self)
{
    for (size_t i = 0; i < NV; i++)
        self->state.v[i] = variables[i].start;
    self->state.phase = INSTANTIATED;
    self->state.stop_time = INFINITY;
    self->stale = true;
}

Instance *instance_new(const char *name, const char *token, const char *folder, bool verbose, Logger *logger, void (*callback)(void),
                       void *environment)
{
    Instance *self = calloc(1, sizeof *self);
    if (!self)
        return NULL;
    self->logger = logger;
    self->callback = callback;
    self->environment = environment;
    self->verbose = verbose;
    if (!name)
        name = MODEL_NAME;
    self->name = malloc(strlen(name) + 1);
    if (!self->name) {
        instance_free(self);
        return NULL;
    }
    strcpy(self->name, name);
    if (!token || strcmp(token, MODEL_TOKEN)) {
        instance_log(self, STATUS_ERROR, "instantiate: expected the token %s of this " MODEL_NAME ", got %s: the model description is of another build",
                     MODEL_TOKEN, token ? token : "none");
        instance_free(self);
        return NULL;
    }
#ifdef MODEL_RESOURCES
    if (instance_load(self, folder)) {
        instance_free(self);
        return NULL;
    }
#endif
    set_start_values(self);
    return self;
}

void instance_free(Instance *self)
{
    if (self) {
#ifdef MODEL_RESOURCES
        model_unload(self->resources);
#endif
        free(self->name);
    }
    free(self);
}

Status instance_debug_logging(Instance *self, bool on, size_t n, const char *const categories[])
{
    bool all = n == 0;
    for (size_t i = 0; i < n; i++) {
        if (!strcmp(categories[i], "logAll"))
            all = true;
        else if (strcmp(categories[i], "logStatusError"))
            return instance_log(self, STATUS_ERROR, "debug logging: expected the category logAll or logStatusError, got %s", categories[i]);
    }
    if (all)
        self->verbose = on;
    return STATUS_OK;
}

/* STATUS_OK in the phase that the call belongs to. */
static Status require(Instance *self, const char *call, Phase phase)
{
    if (self->state.phase == phase)
        return STATUS_OK;
    return instance_log(self, STATUS_ERROR, "%s: allowed only %s, called %s", call, phases[phase], phases[self->state.phase]);
}

Status instance_setup(Instance *self, double start_time, bool stop_defined, double stop_time)
{
    if (require(self, "setup of the experiment", INSTANTIATED))
        return STATUS_ERROR;
    if (!isfinite(start_time) || (stop_defined && !(stop_time >= start_time)))
        return instance_log(self, STATUS_ERROR, "setup of the experiment: expected a finite start time and a stop time not before it, got %g s and %g s",
                            start_time, stop_defined ? stop_time : INFINITY);
    self->state.v[V_time] = start_time;
    self->state.stop_time = stop_defined ? stop_time : INFINITY;
    return STATUS_OK;
}

Status instance_enter_initialisation(Instance *self)
{
    if (require(self, "entering initialisation", INSTANTIATED))
        return STATUS_ERROR;
    self->state.phase = INITIALISING;
    return STATUS_OK;
}

/* Logs the first state that is not a finite number, and what that means. */
static Status require_finite_states(Instance *self, const double *v, const char *call, const char *meaning)
{
    for (size_t i = X0; i < (size_t)X0 + NX; i++)
        if (!isfinite(v[i]))
            return instance_log(self, STATUS_ERROR, "%s: state %s became %g at t = %.9g s: %s", call, variables[i].name, v[i], v[V_time], meaning);
    return STATUS_OK;
}

static Status require_sense(Instance *self, const double *v, const char *call)
{
    char message[256];
    const char *problem = model_check(OF(self) v, message, sizeof message);
    return problem ? instance_log(self, STATUS_ERROR, "%s refused: %s", call, problem) : STATUS_OK;
}

Status instance_exit_initialisation(Instance *self)
{
    if (require(self, "exit of initialisation", INITIALISING) || require_sense(self, self->state.v, "initialisation"))
        return STATUS_ERROR;
    memcpy(self->scratch, self->state.v, sizeof self->scratch);
    model_initialise(OF(self) self->scratch);
    if (require_finite_states(self, self->scratch, "initialisation", "with these parameters there is nothing to start from"))
        return STATUS_ERROR;
    memcpy(self->state.v, self->scratch, sizeof self->scratch);
    self->state.phase = STEPPING;
    self->stale = true;
    return instance_log(self, STATUS_OK, "initialised at t = %.9g s: %d states, sub-steps of at most %g s", self->state.v[V_time], (int)NX, MODEL_INTERNAL_STEP);
}

Status instance_terminate(Instance *self)
{
    if (require(self, "termination", STEPPING))
        return STATUS_ERROR;
    self->state.phase = TERMINATED;
    return STATUS_OK;
}

Status instance_reset(Instance *self)
{
    set_start_values(self);
    return instance_log(self, STATUS_OK, "reset to the start values");
}

/* What forbids setting the variable in the present phase, or NULL. */
static const char *why_fixed(Causality causality, Phase phase)
{
    switch (causality) {
    case PARAMETER: return phase < STEPPING ? NULL : "a fixed parameter can be set only until initialisation ends";
    case STATE: return phase < STEPPING ? NULL : "a state can be set only until initialisation ends (later through the FMU state)";
    case TUNABLE:
    case INPUT: return phase < TERMINATED ? NULL : "nothing can be set after termination";
    case INDEPENDENT: return "time is set by the experiment and the steps";
    default: return "the model computes it";
    }
}

static Status check_value(Instance *self, unsigned reference, double value)
{
    if (reference >= NV)
        return instance_log(self, STATUS_ERROR, "set: expected a value reference from 0 to %d, got %u", NV - 1, reference);
    const Variable *variable = &variables[reference];
    const char *fixed = why_fixed(variable->causality, self->state.phase);
    if (fixed)
        return instance_log(self, STATUS_ERROR, "set %s = %.9g refused: %s", variable->name, value, fixed);
    if (!isfinite(value))
        return instance_log(self, STATUS_ERROR, "set %s refused: expected a finite number, got %g", variable->name, value);
    if (value < variable->min)
        return instance_log(self, STATUS_ERROR, "set %s refused: expected at least %.9g, got %.9g", variable->name, variable->min, value);
    if (value > variable->max)
        return instance_log(self, STATUS_ERROR, "set %s refused: expected at most %.9g, got %.9g", variable->name, variable->max, value);
    return STATUS_OK;
}

Status instance_set(Instance *self, const unsigned references[], size_t n, const double values[])
{
    bool tuned = false;
    for (size_t i = 0; i < n; i++) {
        if (check_value(self, references[i], values[i]))
            return STATUS_ERROR;
        tuned = tuned || variables[references[i]].causality == TUNABLE;
    }
    tuned = tuned && self->state.phase == STEPPING;
    if (tuned)
        memcpy(self->scratch, self->state.v, sizeof self->scratch);
    for (size_t i = 0; i < n; i++)
        self->state.v[references[i]] = values[i];
    if (tuned && require_sense(self, self->state.v, "change of a tunable parameter")) {
        memcpy(self->state.v, self->scratch, sizeof self->scratch);
        return STATUS_ERROR;
    }
    self->stale = self->stale || n > 0;
    return STATUS_OK;
}

void instance_evaluate(const Instance *self, double *v)
{
    if (self->state.phase < STEPPING)
        model_initialise(OF(self) v);
    model_derivatives(OF(self) v);
    model_outputs(OF(self) v);
}

const double *instance_values(Instance *self)
{
    double *v = self->state.v;
    if (self->state.phase < STEPPING) {
        memcpy(self->scratch, v, sizeof self->scratch);
        v = self->scratch;
    }
    if (self->stale || v == self->scratch)
        instance_evaluate(self, v);
    self->stale = false;
    return v;
}

Status instance_get(Instance *self, const unsigned references[], size_t n, double values[])
{
    const double *v = instance_values(self);
    for (size_t i = 0; i < n; i++) {
        if (references[i] >= NV)
            return instance_log(self, STATUS_ERROR, "get: expected a value reference from 0 to %d, got %u", NV - 1, references[i]);
        values[i] = v[references[i]];
        if (!isfinite(values[i]))
            return instance_log(self, STATUS_ERROR, "get: %s is %g at t = %.9g s, which the model does not describe",
                                variables[references[i]].name, values[i], v[V_time]);
    }
    return STATUS_OK;
}

/* One Runge-Kutta step of order 4 (Kutta 1901) from t to t + h. */
static void sub_step(Instance *self, double t, double h)
{
    static const double reach[4] = {0.5, 0.5, 1.0, 0.0}, weight[4] = {1.0, 2.0, 2.0, 1.0}, at[4] = {0.0, 0.5, 0.5, 1.0};
    double *v = self->state.v, *x = v + X0, *dx = v + DX0;
    memcpy(self->x, x, sizeof self->x);
    memset(self->dx, 0, sizeof self->dx);
    for (int stage = 0; stage < 4; stage++) {
        v[V_time] = t + at[stage] * h;
        model_derivatives(OF(self) v);
        for (size_t i = 0; i < NX; i++) {
            self->dx[i] += weight[stage] * dx[i];
            x[i] = self->x[i] + reach[stage] * h * dx[i];
        }
    }
    for (size_t i = 0; i < NX; i++)
        x[i] = self->x[i] + h / 6.0 * self->dx[i];
}

Status instance_step(Instance *self, double t, double h)
{
    double *v = self->state.v;
    if (require(self, "step", STEPPING))
        return STATUS_ERROR;
    if (!(h > 0.0) || !(h <= DBL_MAX))
        return instance_log(self, STATUS_ERROR, "step: expected a finite step size above 0 s, got %g s", h);
    const double tolerance = 1e-3 * h + 8.0 * DBL_EPSILON * fabs(v[V_time]); /* hosts sum or multiply their time */
    if (!(fabs(t - v[V_time]) <= tolerance))
        return instance_log(self, STATUS_ERROR, "step: expected to start at t = %.12g s, where the last one ended, got %.12g s", v[V_time], t);
    if (t + h > self->state.stop_time + tolerance)
        return instance_log(self, STATUS_ERROR, "step: expected to end by the stop time %.12g s, got %.12g s", self->state.stop_time, t + h);
    const double n = fmax(1.0, ceil(h / MODEL_INTERNAL_STEP - 1e-9));
    if (n > 1e9)
        return instance_log(self, STATUS_ERROR, "step: expected at most 1e9 sub-steps of %g s, got a step of %g s", MODEL_INTERNAL_STEP, h);

    memcpy(self->scratch, v, sizeof self->scratch);
    for (long i = 0; i < (long)n; i++)
        sub_step(self, t + (double)i * (h / n), h / n);
    v[V_time] = t + h;
    if (require_finite_states(self, v, "step", "the motion has left what the model describes")) {
        memcpy(v, self->scratch, sizeof self->scratch);
        return STATUS_ERROR;
    }
    self->stale = true;
    return STATUS_OK;
}
