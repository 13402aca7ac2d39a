/* The wrapped FMU's functions of FMI 2.0 co-simulation. */
#include "fmi2Functions.h"
#include "wrapper.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define W Wrapper *const self = c
#define REFUSE_WITHOUT_INSTANCE                                                                                          \
    if (!c)                                                                                                              \
    return fmi2Error

void host_log(Wrapper *self, Status status, const char *category, const char *message)
{
    const fmi2CallbackFunctions *callbacks = self->callbacks;
    if (callbacks && callbacks->logger)
        callbacks->logger(callbacks->componentEnvironment, self->name ? self->name : "", (fmi2Status)status, category, "%s", message);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    Wrapper blank = {.callbacks = callbacks};
    blank.name = (char *)name;
    if (type != fmi2CoSimulation) {
        wrapper_log(&blank, STATUS_ERROR, "this FMU is for co-simulation only");
        return NULL;
    }
    if (!token || strcmp(token, OUTER_TOKEN) != 0) {
        wrapper_log(&blank, STATUS_ERROR, "the GUID does not fit: expected %s, got %s", OUTER_TOKEN, token ? token : "nothing");
        return NULL;
    }
    return wrapper_new(&blank, name, resources, visible != fmi2False, logging != fmi2False, false, false);
}

void fmi2FreeInstance(fmi2Component c) { wrapper_free(c); }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    REFUSE_WITHOUT_INSTANCE;
    W;
    const char *own[32];
    size_t count = 0;
    for (size_t i = 0; i < n; i++)
        if (count < 32 && categories[i] && strcmp(categories[i], "fmucorrect") != 0)
            own[count++] = categories[i]; /* the solver does not know of the wrapper's category */
    return n && !count ? fmi2OK : (fmi2Status)inner_debug_logging(self, on != fmi2False, count, own);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    REFUSE_WITHOUT_INSTANCE;
    W;
    self->state.host = start;
    return (fmi2Status)inner_setup(self, tolerance_defined != fmi2False, tolerance, start, stop_defined != fmi2False, stop);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    REFUSE_WITHOUT_INSTANCE;
    W;
    return (fmi2Status)inner_enter_initialisation(self);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    REFUSE_WITHOUT_INSTANCE;
    W;
    const Status status = inner_exit_initialisation(self);
    return (fmi2Status)(status > STATUS_WARNING ? status : wrapper_started(self, self->state.host));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    REFUSE_WITHOUT_INSTANCE;
    W;
    return (fmi2Status)inner_terminate(self);
}

fmi2Status fmi2Reset(fmi2Component c)
{
    REFUSE_WITHOUT_INSTANCE;
    W;
    return (fmi2Status)wrapper_reset(self);
}

#if DIRECT
#define RUN(function, touched)                                                                                           \
    const size_t run = solver_run(vr + i, n - i);                                                                        \
    if (run) {                                                                                                           \
        touched;                                                                                                         \
        const Status status = self->inner.function ? (Status)self->inner.function(self->inner.component, vr + i, run, value + i) \
                                                   : STATUS_ERROR;                                                       \
        worst = status > worst ? status : worst;                                                                         \
        i += run;                                                                                                        \
        continue;                                                                                                        \
    }
#else
#define RUN(function, touched)
#endif

#define ACCESS(Name, CLASS, member)                                                                                      \
    fmi2Status fmi2Get##Name(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Name value[])               \
    {                                                                                                                    \
        REFUSE_WITHOUT_INSTANCE;                                                                                         \
        W;                                                                                                               \
        Status worst = STATUS_OK;                                                                                        \
        for (size_t i = 0; i < n && worst <= STATUS_WARNING;) {                                                          \
            RUN(Get##Name, (void)0)                                                                                      \
            Value got = {CLASS, 0.0, 0, NULL};                                                                           \
            const Status one = variable_get(self, vr[i], 0, CLASS, &got);                                                   \
            worst = one > worst ? one : worst;                                                                           \
            value[i++] = (fmi2##Name)got.member;                                                                         \
        }                                                                                                                \
        return (fmi2Status)worst;                                                                                        \
    }                                                                                                                    \
    fmi2Status fmi2Set##Name(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Name value[])         \
    {                                                                                                                    \
        REFUSE_WITHOUT_INSTANCE;                                                                                         \
        W;                                                                                                               \
        Status worst = STATUS_OK;                                                                                        \
        for (size_t i = 0; i < n && worst <= STATUS_WARNING;) {                                                          \
            RUN(Set##Name, variables_touched(self))                                                                      \
            Value given = {CLASS, 0.0, 0, NULL};                                                                         \
            given.member = value[i];                                                                                     \
            const Status one = variable_set(self, vr[i++], 0, &given);                                                      \
            worst = one > worst ? one : worst;                                                                           \
        }                                                                                                                \
        return (fmi2Status)worst;                                                                                        \
    }

ACCESS(Real, NUMBER, number)
ACCESS(Integer, INTEGER, integer)
ACCESS(Boolean, TRUTH, integer)
ACCESS(String, TEXT, text)

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_rollback)
{
    REFUSE_WITHOUT_INSTANCE;
    W;
    Outcome outcome;
    self->no_rollback = no_rollback != fmi2False;
    Status status = sampling_step(self, time, size, false, &outcome);
    self->last_time = outcome.last;
    self->terminated = outcome.terminate;
    if ((outcome.early || outcome.terminate) && status <= STATUS_WARNING)
        status = STATUS_DISCARD; /* what FMI 2.0 says for a step that ended early */
    return (fmi2Status)status;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi2Status)wrapper_log(c, STATUS_ERROR, "no step runs asynchronously");
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    REFUSE_WITHOUT_INSTANCE;
    W;
    if (kind != fmi2LastSuccessfulTime)
        return (fmi2Status)wrapper_log(self, STATUS_DISCARD, "there is no real status %d", (int)kind);
    *value = self->last_time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    REFUSE_WITHOUT_INSTANCE;
    W;
    if (kind != fmi2Terminated)
        return (fmi2Status)wrapper_log(self, STATUS_DISCARD, "there is no boolean status %d", (int)kind);
    *value = self->terminated;
    return fmi2OK;
}

#define NO_STATUS(function, type)                                                                                        \
    fmi2Status function(fmi2Component c, const fmi2StatusKind kind, type *value)                                         \
    {                                                                                                                    \
        REFUSE_WITHOUT_INSTANCE;                                                                                         \
        return (fmi2Status)wrapper_log(c, STATUS_DISCARD, #function ": there is no status %d", (int)kind);               \
    }
NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetStringStatus, fmi2String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi2Status)state_get(c, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi2Status)state_set(c, state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    REFUSE_WITHOUT_INSTANCE;
    return state ? (fmi2Status)state_free(c, state) : fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi2Status)state_size(c, state, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi2Status)state_write(c, state, bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi2Status)state_read(c, bytes, size, state);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[])
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi2Status)wrapper_log(c, STATUS_ERROR, "directional derivatives are not provided");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                       const fmi2Real value[])
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi2Status)wrapper_log(c, STATUS_ERROR, "inputs are not interpolated");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                        fmi2Real value[])
{
    REFUSE_WITHOUT_INSTANCE;
    return (fmi2Status)wrapper_log(c, STATUS_ERROR, "derivatives of outputs are not provided");
}

/* Of model exchange, which is not offered: some hosts look for all functions of the standard before they call one. */
#define NOT_OFFERED(name, parameters)                                                                                    \
    fmi2Status name parameters                                                                                           \
    {                                                                                                                    \
        REFUSE_WITHOUT_INSTANCE;                                                                                         \
        return (fmi2Status)wrapper_log(c, STATUS_ERROR, "this FMU is for co-simulation only");                           \
    }

NOT_OFFERED(fmi2EnterEventMode, (fmi2Component c))
NOT_OFFERED(fmi2NewDiscreteStates, (fmi2Component c, fmi2EventInfo *info))
NOT_OFFERED(fmi2EnterContinuousTimeMode, (fmi2Component c))
NOT_OFFERED(fmi2CompletedIntegratorStep, (fmi2Component c, fmi2Boolean no_set_state, fmi2Boolean *event, fmi2Boolean *terminate))
NOT_OFFERED(fmi2SetTime, (fmi2Component c, fmi2Real time))
NOT_OFFERED(fmi2SetContinuousStates, (fmi2Component c, const fmi2Real states[], size_t n))
NOT_OFFERED(fmi2GetDerivatives, (fmi2Component c, fmi2Real derivatives[], size_t n))
NOT_OFFERED(fmi2GetEventIndicators, (fmi2Component c, fmi2Real indicators[], size_t n))
NOT_OFFERED(fmi2GetContinuousStates, (fmi2Component c, fmi2Real states[], size_t n))
NOT_OFFERED(fmi2GetNominalsOfContinuousStates, (fmi2Component c, fmi2Real nominals[], size_t n))
