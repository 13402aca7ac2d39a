/* The wrapped FMU's functions of FMI 3.0 co-simulation: life, modes, steps and states. outer_fmi3_variables.c has the variables. */
#include "fmi3Functions.h"
#include "wrapper.h"

#include <string.h>

#define REFUSE_WITHOUT_INSTANCE                                                                                          \
    if (!instance)                                                                                                       \
        return fmi3Error;                                                                                                \
    Wrapper *const self = instance

void host_log(Wrapper *self, Status status, const char *category, const char *message)
{
    if (self->callback)
        self->callback(self->environment, (fmi3Status)(status == STATUS_PENDING ? STATUS_ERROR : status), category, message);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback callback,
                                         fmi3IntermediateUpdateCallback update)
{
    Wrapper blank = {.environment = environment, .callback = callback, .early_return = early_return};
    if (!token || strcmp(token, OUTER_TOKEN) != 0) {
        wrapper_log(&blank, STATUS_ERROR, "the instantiation token does not fit: expected %s, got %s", OUTER_TOKEN, token ? token : "nothing");
        return NULL;
    }
    return wrapper_new(&blank, name, resources, visible, logging, event_mode, early_return);
}

static fmi3Instance only_co_simulation(fmi3InstanceEnvironment environment, fmi3LogMessageCallback callback)
{
    Wrapper blank = {.environment = environment, .callback = callback};
    wrapper_log(&blank, STATUS_ERROR, "this FMU is for co-simulation only");
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback callback)
{
    return only_co_simulation(environment, callback);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                               fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                               fmi3LogMessageCallback callback, fmi3ClockUpdateCallback update,
                                               fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    return only_co_simulation(environment, callback);
}

void fmi3FreeInstance(fmi3Instance instance) { wrapper_free(instance); }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    REFUSE_WITHOUT_INSTANCE;
    const char *own[32];
    size_t count = 0;
    for (size_t i = 0; i < n; i++)
        if (count < 32 && categories[i] && strcmp(categories[i], "fmucorrect") != 0)
            own[count++] = categories[i]; /* the solver does not know of the wrapper's category */
    return n && !count ? fmi3OK : (fmi3Status)inner_debug_logging(self, on, count, own);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stop_defined, fmi3Float64 stop)
{
    REFUSE_WITHOUT_INSTANCE;
    self->state.host = start;
    const Status status = inner_setup(self, tolerance_defined, tolerance, start, stop_defined, stop);
    return (fmi3Status)(status > STATUS_WARNING ? status : inner_enter_initialisation(self));
}

/* With event mode the FMU is in it now; the first sample is read when it is asked for, or at the first step. */
fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    REFUSE_WITHOUT_INSTANCE;
    const Status status = inner_exit_initialisation(self);
    return (fmi3Status)(status > STATUS_WARNING ? status : wrapper_started(self, self->state.host));
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi3Status)inner_terminate(self);
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi3Status)wrapper_reset(self);
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 size, fmi3Boolean no_rollback, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    REFUSE_WITHOUT_INSTANCE;
    Outcome outcome;
    self->no_rollback = no_rollback;
    Status status = sampling_step(self, time, size, self->early_return, &outcome);
    /* After fmi3Discard the FMU is where it was before (FMI 3.0.2, 2.2.3): if it has moved, the step has ended early. */
    if (status == STATUS_DISCARD && (outcome.terminate || (outcome.last > time && self->early_return))) {
        status = STATUS_OK;
        outcome.early = outcome.last < time + size;
    }
    *event = outcome.event;
    *terminate = outcome.terminate;
    *early = outcome.early;
    *last = outcome.last;
    return (fmi3Status)(status == STATUS_PENDING ? STATUS_ERROR : status);
}

/* Modes that only a solver of FMI 3.0 has. */
#if INNER_FMI == 3
#define MODE(function)                                                                                                   \
    fmi3Status fmi3##function(fmi3Instance instance)                                                                     \
    {                                                                                                                    \
        REFUSE_WITHOUT_INSTANCE;                                                                                         \
        variables_jumped(self);                                                                                          \
        return self->inner.function                                                                                      \
                   ? self->inner.function(self->inner.component)                                                         \
                   : (fmi3Status)wrapper_log(self, STATUS_ERROR, "the solver's FMU has no fmi3" #function);              \
    }
#else
#define MODE(function)                                                                                                   \
    fmi3Status fmi3##function(fmi3Instance instance)                                                                     \
    {                                                                                                                    \
        REFUSE_WITHOUT_INSTANCE;                                                                                         \
        return (fmi3Status)wrapper_log(self, STATUS_ERROR, "fmi3" #function ": there is no such mode");                  \
    }
#endif
MODE(EnterEventMode)
MODE(EnterStepMode)
MODE(EvaluateDiscreteStates)
MODE(EnterConfigurationMode)
MODE(ExitConfigurationMode)

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals,
                                    fmi3Boolean *values, fmi3Boolean *defined, fmi3Float64 *next)
{
    REFUSE_WITHOUT_INSTANCE;
#if INNER_FMI == 3
    variables_touched(self);
    if (self->inner.UpdateDiscreteStates)
        return self->inner.UpdateDiscreteStates(self->inner.component, again, terminate, nominals, values, defined, next);
#endif
    return (fmi3Status)wrapper_log(self, STATUS_ERROR, "fmi3UpdateDiscreteStates: there are no events");
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi3Status)state_get(self, state);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi3Status)state_set(self, state);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    REFUSE_WITHOUT_INSTANCE;
    return state ? (fmi3Status)state_free(self, state) : fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi3Status)state_size(self, state, size);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi3Status)state_write(self, state, (char *)bytes, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi3Status)state_read(self, (const char *)bytes, size, state);
}
