/* The variables that the wrapper adds, the force inputs that it shares with the host, and, where the host speaks another FMI
 * version than the solver, every other variable by table. */
#include <math.h>

#include "wrapper.h"

static bool added(uint32_t reference) { return reference - ADDED_BASE < ADDED_COUNT && reference >= ADDED_BASE; }

#if DIRECT && FORCES
/* A force input that this variable is or has as an element, FORCES if there is none. */
static size_t force_input(uint32_t reference)
{
    for (size_t f = 0; f != FORCES; f++)
        if (FORCE_INPUTS[f].reference == reference)
            return f;
    return FORCES;
}
#endif

size_t solver_run(const uint32_t references[], size_t n)
{
#if DIRECT
    size_t run = 0;
#if FORCES
    while (run < n && !added(references[run]) && force_input(references[run]) == FORCES)
#else
    while (run < n && !added(references[run]))
#endif
        run++;
    return run;
#else
    return 0;
#endif
}

size_t variable_size(uint32_t reference)
{
    for (size_t i = 0; i != ARRAY_COUNT; i++)
        if (ARRAYS[i].reference == reference)
            return ARRAYS[i].size;
    return 1;
}

/* Outputs that no input reaches at once are still those that were read when the last step had ended. */
void variables_touched(Wrapper *self)
{
    State *s = &self->state;
    s->row_stale = s->stale = true;
    s->led = s->started;
    s->awaited = false;
    s->row_due = s->row_due || CHANNELS_FED || (INPUTS_HELD && !s->inputs_known);
    s->joints_due = s->joints_due || JOINTS_FED;
}

void variables_jumped(Wrapper *self)
{
    State *s = &self->state;
    s->row_stale = s->stale = s->row_due = s->joints_due = true;
    s->awaited = false;
    s->readings = 0;
}

static Status unknown(Wrapper *self, uint32_t reference, const char *what)
{
    return wrapper_log(self, STATUS_ERROR, "value reference %u: %s", (unsigned)reference, what);
}

static Status get_added(Wrapper *self, uint32_t variable, Class class, Value *value)
{
    State *s = &self->state;
    const bool output = variable < ENABLED;
    Status status = STATUS_OK;
    if (output && (status = sampling_correction(self)) > STATUS_WARNING)
        return status;
    value->class = variable == STATUS_VARIABLE ? INTEGER : variable == ENABLED || variable == EFFECTS_ENABLED ? TRUTH : NUMBER;
    if (variable == STATUS_VARIABLE && class == NUMBER) { /* some hosts read all outputs as numbers */
        value->class = NUMBER;
        value->number = s->status;
        return status;
    }
    if (value->class != class)
        return unknown(self, ADDED_BASE + variable, "asked for by a function of another type");
#if CHANNELS
    if (variable < SIGMA_0)
        value->number = s->delta[variable - CORRECTED_0] != 0.0 ? s->row[variable - CORRECTED_0] + s->delta[variable - CORRECTED_0]
                                                                : s->row[variable - CORRECTED_0]; /* to the bit: -0 + 0 is +0 */
    else if (variable < STATUS_VARIABLE)
        value->number = s->sigma[variable - SIGMA_0];
    else
#endif
    if (variable == STATUS_VARIABLE)
        value->integer = s->status;
    else if (variable == ENABLED || variable == EFFECTS_ENABLED)
        value->integer = variable == ENABLED ? s->enabled : s->effects_enabled;
    else
        value->number = s->conditions[variable - CONDITION_0];
    return status;
}

static Status set_added(Wrapper *self, uint32_t variable, const Value *value)
{
    State *s = &self->state;
    if (variable < ENABLED)
        return unknown(self, ADDED_BASE + variable, "an output cannot be set");
    const bool flag = variable == ENABLED || variable == EFFECTS_ENABLED;
    if (value->class != (flag ? TRUTH : NUMBER))
        return unknown(self, ADDED_BASE + variable, "set by a function of another type");
    if (!flag && !isfinite(value->number))
        return unknown(self, ADDED_BASE + variable, "expected a finite number");
    if (variable == ENABLED)
        s->enabled = value->integer != 0;
    else if (flag)
        s->effects_enabled = value->integer != 0;
    else {
        s->conditions[variable - CONDITION_0] = value->number;
        s->carried = s->carried && !s->on_grid;
    }
    s->stale = true;
    return STATUS_OK;
}

/* How the solver knows the variable, an array by its element; of size 0 where it does not. */
static Wired wired(uint32_t reference, size_t element)
{
    Wired found = {0};
#if DIRECT
#if FORCES
    const size_t f = force_input(reference);
    if (f < FORCES) {
        found = FORCE_INPUTS[f];
        found.index = (uint32_t)element;
    }
#endif
#else
    if (reference < WIRED_COUNT)
        found = WIRED[reference];
#endif
    return found;
}

/* As what the variable travels between versions. */
static Class class_of(const Wired *variable)
{
#if INNER_FMI == 2
    static const Class classes[] = {NUMBER, INTEGER, TRUTH, TEXT};
    return classes[variable->kind & 3];
#else
    switch (variable->kind) {
    case FLOAT64_3:
    case FLOAT32_3: return NUMBER;
    case BOOLEAN_3: return TRUTH;
    case STRING_3: return TEXT;
    default: return INTEGER;
    }
#endif
}

/* The number of the force input that this variable is, FORCES if it is none. */
static size_t shared_force(const Wired *variable)
{
    for (size_t f = 0; f != FORCES; f++)
        if (FORCE_INPUTS[f].reference == variable->reference && FORCE_INPUTS[f].kind == variable->kind &&
            FORCE_INPUTS[f].index == variable->index)
            return f;
    return FORCES;
}

Status variable_get(Wrapper *self, uint32_t reference, size_t element, Class class, Value *value)
{
    if (added(reference))
        return get_added(self, reference - ADDED_BASE, class, value);
    const Wired variable = wired(reference, element);
    if (!variable.size)
        return unknown(self, reference, "there is no such variable");
    *value = (Value){.class = class};
    if (variable.kind == TIME_KIND) {
        value->number = self->state.host;
        return STATUS_OK;
    }
    if (class_of(&variable) != class)
        return unknown(self, reference, "asked for by a function of another type");
    const size_t f = shared_force(&variable);
    if (f != FORCES) {
        value->number = self->state.host_force[f];
        return STATUS_OK;
    }
    return inner_get(self, &variable, value);
}

Status variable_set(Wrapper *self, uint32_t reference, size_t element, const Value *value)
{
    if (added(reference))
        return set_added(self, reference - ADDED_BASE, value);
    const Wired variable = wired(reference, element);
    if (!variable.size || variable.kind == TIME_KIND)
        return unknown(self, reference, variable.size ? "time cannot be set" : "there is no such variable");
    if (class_of(&variable) != value->class)
        return unknown(self, reference, "set by a function of another type");
    variables_touched(self);
    const size_t f = shared_force(&variable);
    if (f == FORCES)
        return inner_set(self, &variable, value);
    Value sum = *value;
    self->state.host_force[f] = value->number;
    sum.number += self->state.force[f];
    return inner_set(self, &variable, &sum);
}
