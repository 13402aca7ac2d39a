#include "fmi2Functions.h"

#include <stdlib.h>

#include "swing.h"

#define UNUSED(x) (void)(x)

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    UNUSED(name), UNUSED(type), UNUSED(guid), UNUSED(resources), UNUSED(functions), UNUSED(visible), UNUSED(logging);
    return calloc(1, sizeof(Swing));
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance, fmi2Real start, fmi2Boolean ends, fmi2Real stop)
{
    UNUSED(defined), UNUSED(tolerance), UNUSED(ends), UNUSED(stop);
    ((Swing *)c)->time = start;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    for (size_t i = 0; i < n; i++)
        value[i] = swing_value(c, vr[i]);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean unchanged)
{
    UNUSED(unchanged);
    ((Swing *)c)->time = time + size;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    ((Swing *)c)->time = 0.0;
    return fmi2OK;
}

#define NOTHING_TO_DO(function)                                                                                          \
    fmi2Status function(fmi2Component c)                                                                                 \
    {                                                                                                                    \
        UNUSED(c);                                                                                                       \
        return fmi2OK;                                                                                                   \
    }
NOTHING_TO_DO(fmi2EnterInitializationMode)
NOTHING_TO_DO(fmi2ExitInitializationMode)
NOTHING_TO_DO(fmi2Terminate)
NOTHING_TO_DO(fmi2CancelStep)

#define NONE(function, ...)                                                                                              \
    fmi2Status function(fmi2Component c, __VA_ARGS__)                                                                    \
    {                                                                                                                    \
        UNUSED(c);                                                                                                       \
        return fmi2Error;                                                                                                \
    }
NONE(fmi2SetDebugLogging, fmi2Boolean on, size_t n, const fmi2String categories[])
NONE(fmi2GetInteger, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
NONE(fmi2GetBoolean, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
NONE(fmi2GetString, const fmi2ValueReference vr[], size_t n, fmi2String value[])
NONE(fmi2SetReal, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
NONE(fmi2SetInteger, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
NONE(fmi2SetBoolean, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
NONE(fmi2SetString, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
NONE(fmi2GetFMUstate, fmi2FMUstate *state)
NONE(fmi2SetFMUstate, fmi2FMUstate state)
NONE(fmi2FreeFMUstate, fmi2FMUstate *state)
NONE(fmi2SerializedFMUstateSize, fmi2FMUstate state, size_t *size)
NONE(fmi2SerializeFMUstate, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
NONE(fmi2DeSerializeFMUstate, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
NONE(fmi2GetStatus, const fmi2StatusKind kind, fmi2Status *value)
NONE(fmi2GetRealStatus, const fmi2StatusKind kind, fmi2Real *value)
NONE(fmi2GetIntegerStatus, const fmi2StatusKind kind, fmi2Integer *value)
NONE(fmi2GetBooleanStatus, const fmi2StatusKind kind, fmi2Boolean *value)
NONE(fmi2GetStringStatus, const fmi2StatusKind kind, fmi2String *value)
