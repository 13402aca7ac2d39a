/* The solver's FMU of FMI 2.0. */
#include "wrapper.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "paths.h"
#include "platform.h"

#define NEEDED "Instantiate FreeInstance SetupExperiment EnterInitializationMode ExitInitializationMode Terminate Reset GetReal SetReal DoStep "
#define I (self->inner)
#define OPTIONAL(function)                                                                                               \
    if (!I.function)                                                                                                     \
    return wrapper_log(self, STATUS_ERROR, "the solver's FMU has no fmi2" #function)

#if LINKED
#define SOLVER(name) LINKAGE_NAME(INNER_PREFIX, name)
#define X(name) fmi2##name##TYPE SOLVER(fmi2##name);
INNER_FUNCTIONS(X)
#undef X

Status inner_open(Wrapper *self, const char *path)
{
#define X(name) I.name = SOLVER(fmi2##name);
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
        const Function function = library_function(I.library, "fmi2" #name);                                             \
        I.name = (fmi2##name##TYPE *)function;                                                                           \
        if (!function && strstr(NEEDED, #name " "))                                                                      \
            missing = "fmi2" #name;                                                                                      \
    }
    INNER_FUNCTIONS(X)
#undef X
    return missing ? wrapper_log(self, STATUS_ERROR, "the solver's library %s lacks the function %s", path, missing) : STATUS_OK;
}
#endif

#if OUTER_FMI != 2
/* The solver's printf-like words, for a host that wants them formatted. */
static void log_2(void *environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String format, ...)
{
    char message[2048];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format ? format : "", arguments);
    va_end(arguments);
    host_log(environment, (Status)status, category, message);
}
#endif

Status inner_instantiate(Wrapper *self, const char *resources, bool visible, bool logging, bool event_mode, bool early_return)
{
#if OUTER_FMI == 2
    const fmi2CallbackFunctions *callbacks = self->callbacks; /* the host's own: its logger formats and filters */
#else
    const fmi2CallbackFunctions own = {log_2, calloc, free, NULL, self};
    memcpy(&I.callbacks, &own, sizeof own);
    const fmi2CallbackFunctions *callbacks = &I.callbacks;
#endif
    char *uri = resources ? uri_of_path(resources) : NULL;
    I.component = uri || !resources ? I.Instantiate(self->name, fmi2CoSimulation, INNER_TOKEN, uri, callbacks, visible, logging) : NULL;
    if (!I.component)
        wrapper_log(self, STATUS_ERROR, "the solver's FMU %s refused to be instantiated; its own messages, if any, stand above (resources: %s)",
                    INNER_LIBRARY, uri ? uri : resources ? "no memory" : "none");
    free(uri);
    return I.component ? STATUS_OK : STATUS_ERROR;
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
    return (Status)I.SetupExperiment(I.component, tolerance_defined, tolerance, start, stop_defined, stop);
}

Status inner_enter_initialisation(Wrapper *self) { return (Status)I.EnterInitializationMode(I.component); }
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
    const Status status = (Status)I.DoStep(I.component, time, size, self->no_rollback ? fmi2True : fmi2False);
    outcome->last = time + size;
    if (status == STATUS_DISCARD) { /* a part of the step was done */
        fmi2Real last = time;
        fmi2Boolean terminated = fmi2False;
        if (!I.GetRealStatus || I.GetRealStatus(I.component, fmi2LastSuccessfulTime, &last) != fmi2OK || !(last > time))
            last = time; /* it does not know, or has not moved */
        if (!I.GetBooleanStatus || I.GetBooleanStatus(I.component, fmi2Terminated, &terminated) != fmi2OK)
            terminated = fmi2False;
        outcome->last = last < time + size ? last : time + size;
        outcome->terminate = terminated != fmi2False;
    } else if (status == STATUS_PENDING) {
        return wrapper_log(self, STATUS_ERROR, "the solver's FMU computes its step asynchronously, which is not supported");
    }
    return status;
}

Status inner_events(Wrapper *self, Outcome *outcome)
{
    return STATUS_OK;
}

Status inner_get(Wrapper *self, const Wired *variable, Value *value)
{
    const fmi2ValueReference reference = variable->reference;
    fmi2Integer number = 0;
    Status status = STATUS_ERROR;
    switch (variable->kind) {
    case REAL_2: return (Status)I.GetReal(I.component, &reference, 1, &value->number);
    case STRING_2: return I.GetString ? (Status)I.GetString(I.component, &reference, 1, &value->text) : STATUS_ERROR;
    case INTEGER_2: status = I.GetInteger ? (Status)I.GetInteger(I.component, &reference, 1, &number) : STATUS_ERROR; break;
    case BOOLEAN_2: status = I.GetBoolean ? (Status)I.GetBoolean(I.component, &reference, 1, &number) : STATUS_ERROR; break;
    }
    value->integer = number;
    return status;
}

Status inner_set(Wrapper *self, const Wired *variable, const Value *value)
{
    const fmi2ValueReference reference = variable->reference;
    const fmi2Integer number = (fmi2Integer)value->integer;
    if (value->class == INTEGER && number != value->integer)
        return wrapper_log(self, STATUS_ERROR, "the value %lld does not fit into an Integer of the solver", (long long)value->integer);
    switch (variable->kind) {
    case REAL_2: return (Status)I.SetReal(I.component, &reference, 1, &value->number);
    case STRING_2: return I.SetString ? (Status)I.SetString(I.component, &reference, 1, &value->text) : STATUS_ERROR;
    case INTEGER_2: return I.SetInteger ? (Status)I.SetInteger(I.component, &reference, 1, &number) : STATUS_ERROR;
    case BOOLEAN_2: return I.SetBoolean ? (Status)I.SetBoolean(I.component, &reference, 1, &number) : STATUS_ERROR;
    }
    return STATUS_ERROR;
}

Status inner_numbers(Wrapper *self, const Wired variables[], size_t n, double values[])
{
    fmi2ValueReference references[SEEN + CONDITIONS];
    bool reals = n <= SEEN + CONDITIONS;
    for (size_t i = 0; i < n && reals; i++) {
        references[i] = variables[i].reference;
        reals = variables[i].kind == REAL_2;
    }
    if (reals)
        return (Status)I.GetReal(I.component, references, n, values);
    Status worst = STATUS_OK;
    for (size_t i = 0; i < n; i++) {
        Value value = {0};
        const Status status = inner_get(self, &variables[i], &value);
        if (status > worst)
            worst = status;
        values[i] = variables[i].kind == REAL_2 ? value.number : (double)value.integer;
    }
    return worst;
}

Status inner_state_get(Wrapper *self, void **state)
{
    OPTIONAL(GetFMUstate);
    return (Status)I.GetFMUstate(I.component, state);
}

Status inner_state_set(Wrapper *self, void *state)
{
    OPTIONAL(SetFMUstate);
    return (Status)I.SetFMUstate(I.component, state);
}

Status inner_state_free(Wrapper *self, void **state)
{
    OPTIONAL(FreeFMUstate);
    return (Status)I.FreeFMUstate(I.component, state);
}

Status inner_state_size(Wrapper *self, void *state, size_t *size)
{
    OPTIONAL(SerializedFMUstateSize);
    return (Status)I.SerializedFMUstateSize(I.component, state, size);
}

Status inner_state_write(Wrapper *self, void *state, char bytes[], size_t size)
{
    OPTIONAL(SerializeFMUstate);
    return (Status)I.SerializeFMUstate(I.component, state, bytes, size);
}

Status inner_state_read(Wrapper *self, const char bytes[], size_t size, void **state)
{
    OPTIONAL(DeSerializeFMUstate);
    return (Status)I.DeSerializeFMUstate(I.component, bytes, size, state);
}
