/* The solver's FMU of FMI 3.0. */
#include "wrapper.h"

#include <stdio.h>
#include <string.h>

#include "platform.h"

#define NEEDED                                                                                                           \
    "InstantiateCoSimulation FreeInstance EnterInitializationMode ExitInitializationMode Terminate Reset GetFloat64 SetFloat64 DoStep "
#define I (self->inner)
#define OPTIONAL(function)                                                                                               \
    if (!I.function)                                                                                                     \
    return wrapper_log(self, STATUS_ERROR, "the solver's FMU has no fmi3" #function)

#if LINKED
#define SOLVER(name) LINKAGE_NAME(INNER_PREFIX, name)
#define X(name) fmi3##name##TYPE SOLVER(fmi3##name);
INNER_FUNCTIONS(X)
#undef X

Status inner_open(Wrapper *self, const char *path)
{
#define X(name) I.name = SOLVER(fmi3##name);
    INNER_FUNCTIONS(X)
#undef X
    return STATUS_OK;
}
#else
Status inner_open(Wrapper *self, const char *path)
{
    char error[512] = "";
    I.library = library_open(path, error, sizeof error);
    if (!I.library)
        return wrapper_log(self, STATUS_ERROR, "the solver's library %s cannot be loaded: %s", path, error);
    const char *missing = NULL;
#define X(name)                                                                                                          \
    {                                                                                                                    \
        const Function function = library_function(I.library, "fmi3" #name);                                             \
        I.name = (fmi3##name##TYPE *)function;                                                                           \
        if (!function && strstr(NEEDED, #name " "))                                                                      \
            missing = "fmi3" #name;                                                                                      \
    }
    INNER_FUNCTIONS(X)
#undef X
    return missing ? wrapper_log(self, STATUS_ERROR, "the solver's library %s lacks the function %s", path, missing) : STATUS_OK;
}
#endif

#if OUTER_FMI != 3
static void log_3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message)
{
    host_log(environment, (Status)status, category, message);
}
#endif

Status inner_instantiate(Wrapper *self, const char *resources, bool visible, bool logging, bool event_mode, bool early_return)
{
#if OUTER_FMI == 3
    const fmi3LogMessageCallback callback = self->callback; /* the host's own */
    const fmi3InstanceEnvironment environment = self->environment;
#else
    const fmi3LogMessageCallback callback = log_3;
    const fmi3InstanceEnvironment environment = self;
#endif
    char folder[4096]; /* FMI 3.0.2, 2.1.1: with a separator at its end */
    snprintf(folder, sizeof folder, "%s/", resources ? resources : "");
    I.event_mode = event_mode;
    I.component = I.InstantiateCoSimulation(self->name, INNER_TOKEN, resources ? folder : NULL, visible, logging, event_mode, early_return, NULL, 0,
                                            environment, callback, NULL);
    return I.component ? STATUS_OK
                       : wrapper_log(self, STATUS_ERROR,
                                     "the solver's FMU %s refused to be instantiated; its own messages, if any, stand above (resources: %s)",
                                     INNER_LIBRARY, resources ? folder : "none");
}

void inner_close(Wrapper *self)
{
    if (I.component)
        I.FreeInstance(I.component);
#if !LINKED
    if (I.library)
        library_close(I.library);
#endif
}

Status inner_setup(Wrapper *self, bool tolerance_defined, double tolerance, double start, bool stop_defined, double stop)
{
    I.tolerance_defined = tolerance_defined;
    I.tolerance = tolerance;
    I.start = start;
    I.stop_defined = stop_defined;
    I.stop = stop;
    return STATUS_OK;
}

Status inner_enter_initialisation(Wrapper *self)
{
    return (Status)I.EnterInitializationMode(I.component, I.tolerance_defined, I.tolerance, I.start, I.stop_defined, I.stop);
}

Status inner_exit_initialisation(Wrapper *self) { return (Status)I.ExitInitializationMode(I.component); }
Status inner_terminate(Wrapper *self) { return (Status)I.Terminate(I.component); }
Status inner_reset(Wrapper *self) { return (Status)I.Reset(I.component); }

Status inner_debug_logging(Wrapper *self, bool on, size_t n, const char *const categories[])
{
    OPTIONAL(SetDebugLogging);
    return (Status)I.SetDebugLogging(I.component, on, n, categories);
}

Status inner_step(Wrapper *self, double time, double size, Outcome *outcome)
{
    fmi3Boolean event = false, terminate = false, early = false;
    fmi3Float64 last = time;
    const Status status = (Status)I.DoStep(I.component, time, size, self->no_rollback, &event, &terminate, &early, &last);
    if (status > STATUS_WARNING) /* what was answered is undefined then (FMI 3.0.2, 2.2.3) */
        event = terminate = early = false;
    outcome->event = event;
    outcome->terminate = terminate;
    outcome->early = early;
    if (!early && status != STATUS_DISCARD)
        outcome->last = time + size;
    else
        outcome->last = !(last > time) ? time : last < time + size ? last : time + size;
    return status;
}

/* Event mode in the middle of a host's step that may not end early (FMI 3.0.2, 4.2.1). */
Status inner_events(Wrapper *self, Outcome *outcome)
{
    variables_jumped(self);
    if (!I.event_mode || !I.EnterEventMode || !I.UpdateDiscreteStates || !I.EnterStepMode)
        return STATUS_OK;
    Status status = (Status)I.EnterEventMode(I.component);
    fmi3Boolean again = true;
    for (int round = 0; again && status <= STATUS_WARNING; round++) {
        if (round == 1000)
            return wrapper_log(self, STATUS_ERROR, "the solver's FMU still asks for event iteration after %d rounds", round);
        fmi3Boolean terminate = false, nominals = false, values = false, defined = false;
        fmi3Float64 next = 0.0;
        status = (Status)I.UpdateDiscreteStates(I.component, &again, &terminate, &nominals, &values, &defined, &next);
        outcome->terminate = outcome->terminate || terminate;
    }
    outcome->event = false;
    return status <= STATUS_WARNING ? (Status)I.EnterStepMode(I.component) : status;
}

/* The types whose values are numbers, as KIND, FMI name, member of Value. */
#define NUMBERS(X)                                                                                                       \
    X(FLOAT64_3, Float64, number) X(FLOAT32_3, Float32, number) X(INT8_3, Int8, integer) X(UINT8_3, UInt8, integer)      \
    X(INT16_3, Int16, integer) X(UINT16_3, UInt16, integer) X(INT32_3, Int32, integer) X(UINT32_3, UInt32, integer)      \
    X(INT64_3, Int64, integer) X(UINT64_3, UInt64, integer) X(BOOLEAN_3, Boolean, integer)

Status inner_get(Wrapper *self, const Wired *variable, Value *value)
{
    const fmi3ValueReference reference = variable->reference;
    Status status = STATUS_ERROR;
    switch (variable->kind) {
#define X(KIND, Name, member)                                                                                            \
    case KIND: {                                                                                                         \
        fmi3##Name *values = (fmi3##Name *)(void *)I.scratch;                                                            \
        OPTIONAL(Get##Name);                                                                                             \
        status = (Status)I.Get##Name(I.component, &reference, 1, values, variable->size);                                \
        value->member = (Value_##member)values[variable->index];                                                         \
        return status;                                                                                                   \
    }
        NUMBERS(X)
#undef X
    case STRING_3: {
        fmi3String *values = (fmi3String *)(void *)I.scratch;
        OPTIONAL(GetString);
        status = (Status)I.GetString(I.component, &reference, 1, values, variable->size);
        value->text = values[variable->index];
        return status;
    }
    }
    return status;
}

Status inner_set(Wrapper *self, const Wired *variable, const Value *value)
{
    const fmi3ValueReference reference = variable->reference;
    Status status = STATUS_OK;
    switch (variable->kind) {
#define X(KIND, Name, member)                                                                                            \
    case KIND: {                                                                                                         \
        fmi3##Name *values = (fmi3##Name *)(void *)I.scratch;                                                            \
        OPTIONAL(Set##Name);                                                                                             \
        if (value->class == INTEGER && (int64_t)(fmi3##Name)value->integer != value->integer)                            \
            return wrapper_log(self, STATUS_ERROR, "the value %lld does not fit into an " #Name " of the solver",        \
                               (long long)value->integer);                                                               \
        if (variable->size > 1 && I.Get##Name) /* the other elements stay what they are */                               \
            status = (Status)I.Get##Name(I.component, &reference, 1, values, variable->size);                            \
        values[variable->index] = (fmi3##Name)value->member;                                                             \
        return status > STATUS_WARNING ? status : (Status)I.Set##Name(I.component, &reference, 1, values, variable->size); \
    }
        NUMBERS(X)
#undef X
    case STRING_3: {
        fmi3String *values = (fmi3String *)(void *)I.scratch;
        OPTIONAL(SetString);
        if (variable->size > 1 && I.GetString)
            status = (Status)I.GetString(I.component, &reference, 1, values, variable->size);
        values[variable->index] = value->text;
        return status > STATUS_WARNING ? status : (Status)I.SetString(I.component, &reference, 1, values, variable->size);
    }
    }
    return STATUS_ERROR;
}

Status inner_numbers(Wrapper *self, const Wired variables[], size_t n, double values[])
{
    fmi3ValueReference references[SEEN + CONDITIONS];
    bool plain = n <= SEEN + CONDITIONS;
    for (size_t i = 0; i < n && plain; i++) {
        references[i] = variables[i].reference;
        plain = variables[i].kind == FLOAT64_3 && variables[i].size == 1;
    }
    if (plain)
        return (Status)I.GetFloat64(I.component, references, n, values, n);
    Status worst = STATUS_OK;
    for (size_t i = 0; i < n; i++) {
        Value value = {0};
        const Status status = inner_get(self, &variables[i], &value);
        if (status > worst)
            worst = status;
        values[i] = variables[i].kind == FLOAT64_3 || variables[i].kind == FLOAT32_3 ? value.number : (double)value.integer;
    }
    return worst;
}

Status inner_state_get(Wrapper *self, void **state)
{
    OPTIONAL(GetFMUState);
    return (Status)I.GetFMUState(I.component, state);
}

Status inner_state_set(Wrapper *self, void *state)
{
    OPTIONAL(SetFMUState);
    return (Status)I.SetFMUState(I.component, state);
}

Status inner_state_free(Wrapper *self, void **state)
{
    OPTIONAL(FreeFMUState);
    return (Status)I.FreeFMUState(I.component, state);
}

Status inner_state_size(Wrapper *self, void *state, size_t *size)
{
    OPTIONAL(SerializedFMUStateSize);
    return (Status)I.SerializedFMUStateSize(I.component, state, size);
}

Status inner_state_write(Wrapper *self, void *state, char bytes[], size_t size)
{
    OPTIONAL(SerializeFMUState);
    return (Status)I.SerializeFMUState(I.component, state, (fmi3Byte *)bytes, size);
}

Status inner_state_read(Wrapper *self, const char bytes[], size_t size, void **state)
{
    OPTIONAL(DeserializeFMUState);
    return (Status)I.DeserializeFMUState(I.component, (const fmi3Byte *)bytes, size, state);
}
