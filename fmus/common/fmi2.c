/* FMI 2.0 co-simulation: the standard's calls, translated to instance.h. */
#include <string.h>

#include "fmi2Functions.h"
#include "instance.h"

/* FMI 2.0 log functions take a printf format, so a percent sign in the text is doubled. */
static void log_fmi2(Instance *self, Status status, const char *category, const char *message)
{
    fmi2CallbackLogger logger = (fmi2CallbackLogger)self->callback;
    char format[1024];
    size_t n = 0;
    for (; *message && n < sizeof format - 2; message++) {
        if (*message == '%')
            format[n++] = '%';
        format[n++] = *message;
    }
    format[n] = '\0';
    logger(self->environment, self->name, (fmi2Status)status, category, format);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean logging)
{
    const bool can_log = functions && functions->logger;
    Instance *self = instance_new(name, guid, resources, logging != 0, can_log ? log_fmi2 : NULL, can_log ? (void (*)(void))functions->logger : NULL,
                                  functions ? functions->componentEnvironment : NULL);
    if (self && type != fmi2CoSimulation) {
        instance_log(self, STATUS_ERROR, "instantiate: expected co-simulation, got model exchange, which this FMU has not");
        instance_free(self);
        return NULL;
    }
    return self;
}

void fmi2FreeInstance(fmi2Component c) { instance_free(c); }

#define CALL(expression) return c ? (fmi2Status)(expression) : fmi2Error

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    CALL(instance_debug_logging(c, on != 0, n, categories));
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop)
{
    CALL(instance_setup(c, start, stop_defined != 0, stop));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { CALL(instance_enter_initialisation(c)); }

fmi2Status fmi2ExitInitializationMode(fmi2Component c) { CALL(instance_exit_initialisation(c)); }

fmi2Status fmi2Terminate(fmi2Component c) { CALL(instance_terminate(c)); }

fmi2Status fmi2Reset(fmi2Component c) { CALL(instance_reset(c)); }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) { CALL(instance_get(c, vr, n, value)); }

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) { CALL(instance_set(c, vr, n, value)); }

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_set_state_prior) { CALL(instance_step(c, t, h)); }

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) { CALL(instance_get_state(c, (State **)state)); }

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) { CALL(instance_set_state(c, state)); }

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    instance_free_state((State **)state);
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    *size = SERIALISED_SIZE;
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    CALL(instance_serialise(c, state, (unsigned char *)bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    CALL(instance_deserialise(c, (const unsigned char *)bytes, size, (State **)state));
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown, const fmi2ValueReference known[],
                                        size_t n_known, const fmi2Real seed[], fmi2Real sensitivity[])
{
    CALL(instance_directional(c, unknown, n_unknown, known, n_known, seed, sensitivity));
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (c && kind == fmi2LastSuccessfulTime) {
        *value = ((Instance *)c)->state.v[V_time];
        return fmi2OK;
    }
    CALL(instance_log(c, STATUS_ERROR, "status: only the last successful time is a number, got kind %d", (int)kind));
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (c && kind == fmi2Terminated) {
        *value = fmi2False;
        return fmi2OK;
    }
    CALL(instance_log(c, STATUS_ERROR, "status: only fmi2Terminated is a boolean, got kind %d", (int)kind));
}

/* What the model description says that this FMU has not. */
#define NO_VARIABLES(type)                                                                                                               \
    fmi2Status fmi2Get##type(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##type value[])                                \
    {                                                                                                                                    \
        CALL(n == 0 ? STATUS_OK : instance_log(c, STATUS_ERROR, "fmi2Get" #type ": all variables are Real, got value reference %u", vr[0]));  \
    }                                                                                                                                    \
    fmi2Status fmi2Set##type(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##type value[])                          \
    {                                                                                                                                    \
        CALL(n == 0 ? STATUS_OK : instance_log(c, STATUS_ERROR, "fmi2Set" #type ": all variables are Real, got value reference %u", vr[0]));  \
    }

NO_VARIABLES(Integer)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

#define UNSUPPORTED(function, reason, ...) \
    fmi2Status function(fmi2Component c, __VA_ARGS__) { CALL(instance_log(c, STATUS_ERROR, #function " is not supported: " reason)); }

#define INPUTS_HELD "inputs are held over a step"
#define SYNCHRONOUS "steps are synchronous"

UNSUPPORTED(fmi2SetRealInputDerivatives, INPUTS_HELD, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], const fmi2Real value[])
UNSUPPORTED(fmi2GetRealOutputDerivatives, "maxOutputDerivativeOrder is 0", const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], fmi2Real value[])
UNSUPPORTED(fmi2GetStatus, SYNCHRONOUS, const fmi2StatusKind kind, fmi2Status *value)
UNSUPPORTED(fmi2GetIntegerStatus, SYNCHRONOUS, const fmi2StatusKind kind, fmi2Integer *value)
UNSUPPORTED(fmi2GetStringStatus, SYNCHRONOUS, const fmi2StatusKind kind, fmi2String *value)

fmi2Status fmi2CancelStep(fmi2Component c) { CALL(instance_log(c, STATUS_ERROR, "fmi2CancelStep is not supported: " SYNCHRONOUS)); }

/* Model exchange. */
#define NO_MODEL_EXCHANGE "this is co-simulation"

UNSUPPORTED(fmi2SetTime, NO_MODEL_EXCHANGE, fmi2Real time)
UNSUPPORTED(fmi2NewDiscreteStates, NO_MODEL_EXCHANGE, fmi2EventInfo *info)
UNSUPPORTED(fmi2CompletedIntegratorStep, NO_MODEL_EXCHANGE, fmi2Boolean no_set_state_prior, fmi2Boolean *event, fmi2Boolean *terminate)
UNSUPPORTED(fmi2SetContinuousStates, NO_MODEL_EXCHANGE, const fmi2Real x[], size_t n)
UNSUPPORTED(fmi2GetContinuousStates, NO_MODEL_EXCHANGE, fmi2Real x[], size_t n)
UNSUPPORTED(fmi2GetDerivatives, NO_MODEL_EXCHANGE, fmi2Real derivatives[], size_t n)
UNSUPPORTED(fmi2GetEventIndicators, NO_MODEL_EXCHANGE, fmi2Real indicators[], size_t n)
UNSUPPORTED(fmi2GetNominalsOfContinuousStates, NO_MODEL_EXCHANGE, fmi2Real nominals[], size_t n)

fmi2Status fmi2EnterEventMode(fmi2Component c) { CALL(instance_log(c, STATUS_ERROR, "fmi2EnterEventMode is not supported: " NO_MODEL_EXCHANGE)); }

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    CALL(instance_log(c, STATUS_ERROR, "fmi2EnterContinuousTimeMode is not supported: " NO_MODEL_EXCHANGE));
}
