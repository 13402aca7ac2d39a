/* What FMI 3.0 asks every library to export and these FMUs do not have: other interfaces, other types, clocks, events. */
#include "fmi3Functions.h"
#include "instance.h"

#define REFUSE(...) return instance ? (fmi3Status)instance_log(instance, STATUS_ERROR, __VA_ARGS__) : fmi3Error

#define REFERENCES const fmi3ValueReference vr[], size_t n

/* Asking for no variables of a type is fine. */
#define NO_VARIABLES(function)                                                                                          \
    if (instance && n == 0)                                                                                             \
        return fmi3OK;                                                                                                  \
    REFUSE(#function ": all variables are Float64, got value reference %u", vr[0])

#define NO_TYPE(type)                                                                                                    \
    fmi3Status fmi3Get##type(fmi3Instance instance, REFERENCES, fmi3##type values[], size_t n_values) { NO_VARIABLES(fmi3Get##type); } \
    fmi3Status fmi3Set##type(fmi3Instance instance, REFERENCES, const fmi3##type values[], size_t n_values) { NO_VARIABLES(fmi3Set##type); }

NO_TYPE(Float32)
NO_TYPE(Int8)
NO_TYPE(UInt8)
NO_TYPE(Int16)
NO_TYPE(UInt16)
NO_TYPE(Int32)
NO_TYPE(UInt32)
NO_TYPE(Int64)
NO_TYPE(UInt64)
NO_TYPE(Boolean)
NO_TYPE(String)

fmi3Status fmi3GetBinary(fmi3Instance instance, REFERENCES, size_t sizes[], fmi3Binary values[], size_t n_values) { NO_VARIABLES(fmi3GetBinary); }

fmi3Status fmi3SetBinary(fmi3Instance instance, REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t n_values)
{
    NO_VARIABLES(fmi3SetBinary);
}

fmi3Status fmi3GetClock(fmi3Instance instance, REFERENCES, fmi3Clock values[]) { NO_VARIABLES(fmi3GetClock); }

fmi3Status fmi3SetClock(fmi3Instance instance, REFERENCES, const fmi3Clock values[]) { NO_VARIABLES(fmi3SetClock); }

/* The first parameter is always instance. */
#define UNSUPPORTED(function, reason, ...) \
    fmi3Status function(__VA_ARGS__) { REFUSE(#function " is not supported: " reason); }

#define NO_EVENTS "the FMU has no event mode"
#define NO_CLOCKS "the FMU has no clocks"
#define NO_STRUCTURE "the FMU has no structural parameters"
#define NO_DEPENDENCIES "providesPerElementDependencies is false"
#define NO_MODEL_EXCHANGE "this is co-simulation"

UNSUPPORTED(fmi3EnterEventMode, NO_EVENTS, fmi3Instance instance)
UNSUPPORTED(fmi3EnterStepMode, NO_EVENTS, fmi3Instance instance)
UNSUPPORTED(fmi3EvaluateDiscreteStates, NO_EVENTS, fmi3Instance instance)
UNSUPPORTED(fmi3UpdateDiscreteStates, NO_EVENTS, fmi3Instance instance, fmi3Boolean *update, fmi3Boolean *terminate, fmi3Boolean *nominals,
            fmi3Boolean *values, fmi3Boolean *defined, fmi3Float64 *time)
UNSUPPORTED(fmi3EnterConfigurationMode, NO_STRUCTURE, fmi3Instance instance)
UNSUPPORTED(fmi3ExitConfigurationMode, NO_STRUCTURE, fmi3Instance instance)
UNSUPPORTED(fmi3GetNumberOfVariableDependencies, NO_DEPENDENCIES, fmi3Instance instance, fmi3ValueReference vr, size_t *n)
UNSUPPORTED(fmi3GetVariableDependencies, NO_DEPENDENCIES, fmi3Instance instance, fmi3ValueReference dependent, size_t elements[],
            fmi3ValueReference independents[], size_t independent_elements[], fmi3DependencyKind kinds[], size_t n)
UNSUPPORTED(fmi3GetOutputDerivatives, "maxOutputDerivativeOrder is 0", fmi3Instance instance, REFERENCES, const fmi3Int32 orders[],
            fmi3Float64 values[], size_t n_values)

UNSUPPORTED(fmi3GetIntervalDecimal, NO_CLOCKS, fmi3Instance instance, REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
UNSUPPORTED(fmi3GetIntervalFraction, NO_CLOCKS, fmi3Instance instance, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
            fmi3IntervalQualifier qualifiers[])
UNSUPPORTED(fmi3GetShiftDecimal, NO_CLOCKS, fmi3Instance instance, REFERENCES, fmi3Float64 shifts[])
UNSUPPORTED(fmi3GetShiftFraction, NO_CLOCKS, fmi3Instance instance, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
UNSUPPORTED(fmi3SetIntervalDecimal, NO_CLOCKS, fmi3Instance instance, REFERENCES, const fmi3Float64 intervals[])
UNSUPPORTED(fmi3SetIntervalFraction, NO_CLOCKS, fmi3Instance instance, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
UNSUPPORTED(fmi3SetShiftDecimal, NO_CLOCKS, fmi3Instance instance, REFERENCES, const fmi3Float64 shifts[])
UNSUPPORTED(fmi3SetShiftFraction, NO_CLOCKS, fmi3Instance instance, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
UNSUPPORTED(fmi3ActivateModelPartition, NO_CLOCKS, fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time)

UNSUPPORTED(fmi3EnterContinuousTimeMode, NO_MODEL_EXCHANGE, fmi3Instance instance)
UNSUPPORTED(fmi3CompletedIntegratorStep, NO_MODEL_EXCHANGE, fmi3Instance instance, fmi3Boolean no_set_state_prior, fmi3Boolean *event, fmi3Boolean *terminate)
UNSUPPORTED(fmi3SetTime, NO_MODEL_EXCHANGE, fmi3Instance instance, fmi3Float64 time)
UNSUPPORTED(fmi3SetContinuousStates, NO_MODEL_EXCHANGE, fmi3Instance instance, const fmi3Float64 states[], size_t n)
UNSUPPORTED(fmi3GetContinuousStates, NO_MODEL_EXCHANGE, fmi3Instance instance, fmi3Float64 states[], size_t n)
UNSUPPORTED(fmi3GetContinuousStateDerivatives, NO_MODEL_EXCHANGE, fmi3Instance instance, fmi3Float64 derivatives[], size_t n)
UNSUPPORTED(fmi3GetNominalsOfContinuousStates, NO_MODEL_EXCHANGE, fmi3Instance instance, fmi3Float64 nominals[], size_t n)
UNSUPPORTED(fmi3GetNumberOfContinuousStates, NO_MODEL_EXCHANGE, fmi3Instance instance, size_t *n)
UNSUPPORTED(fmi3GetEventIndicators, NO_MODEL_EXCHANGE, fmi3Instance instance, fmi3Float64 indicators[], size_t n)
UNSUPPORTED(fmi3GetNumberOfEventIndicators, NO_MODEL_EXCHANGE, fmi3Instance instance, size_t *n)

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    if (log)
        log(environment, fmi3Error, "logStatusError", "instantiate: expected co-simulation, got model exchange, which this FMU has not");
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
                                               fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    if (log)
        log(environment, fmi3Error, "logStatusError", "instantiate: expected co-simulation, got scheduled execution, which this FMU has not");
    return NULL;
}
