/* FMI 3.0 co-simulation: the standard's calls, translated to instance.h. What this FMU has not is in fmi3_unsupported.c. */
#include "fmi3Functions.h"
#include "instance.h"

static void log_fmi3(Instance *self, Status status, const char *category, const char *message)
{
    ((fmi3LogMessageCallback)self->callback)(self->environment, (fmi3Status)status, category, message);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean event_mode, fmi3Boolean early_return, const fmi3ValueReference intermediate[],
                                         size_t n_intermediate, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    Instance *self = instance_new(name, token, resources, logging, log ? log_fmi3 : NULL, (void (*)(void))log, environment);
    if (self && (event_mode || n_intermediate)) {
        instance_log(self, STATUS_ERROR, "instantiate: expected no event mode and no intermediate variables, which this FMU has not, got %s",
                     event_mode ? "event mode" : "intermediate variables");
        instance_free(self);
        return NULL;
    }
    return self;
}

void fmi3FreeInstance(fmi3Instance instance) { instance_free(instance); }

#define CALL(expression) return instance ? (fmi3Status)(expression) : fmi3Error

/* A call with values: every variable is one number, so that there are as many values as references. */
#define SAME_NUMBER(call)                                                                                                  \
    if (instance && n != n_values)                                                                                         \
        return (fmi3Status)instance_log(instance, STATUS_ERROR, call ": expected as many values as references, %u, got %u", \
                                        (unsigned)n, (unsigned)n_values)

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    CALL(instance_debug_logging(instance, on, n, categories));
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stop_defined, fmi3Float64 stop)
{
    if (instance && instance_setup(instance, start, stop_defined, stop))
        return fmi3Error;
    CALL(instance_enter_initialisation(instance));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) { CALL(instance_exit_initialisation(instance)); }

fmi3Status fmi3Terminate(fmi3Instance instance) { CALL(instance_terminate(instance)); }

fmi3Status fmi3Reset(fmi3Instance instance) { CALL(instance_reset(instance)); }

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[], size_t n_values)
{
    SAME_NUMBER("fmi3GetFloat64");
    CALL(instance_get(instance, vr, n, values));
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[], size_t n_values)
{
    SAME_NUMBER("fmi3SetFloat64");
    CALL(instance_set(instance, vr, n, values));
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_set_state_prior, fmi3Boolean *event, fmi3Boolean *terminate,
                      fmi3Boolean *early_return, fmi3Float64 *last_time)
{
    if (!instance)
        return fmi3Error;
    const Status status = instance_step(instance, t, h);
    *event = *terminate = *early_return = fmi3False;
    *last_time = ((Instance *)instance)->state.v[V_time];
    return (fmi3Status)status;
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) { CALL(instance_get_state(instance, (State **)state)); }

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) { CALL(instance_set_state(instance, state)); }

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    instance_free_state((State **)state);
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    *size = SERIALISED_SIZE;
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    CALL(instance_serialise(instance, state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    CALL(instance_deserialise(instance, bytes, size, (State **)state));
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns, const fmi3ValueReference knowns[],
                                        size_t n_knowns, const fmi3Float64 seed[], size_t n_seed, fmi3Float64 sensitivity[], size_t n_values)
{
    const size_t n = n_unknowns;
    SAME_NUMBER("fmi3GetDirectionalDerivative");
    CALL(n_seed != n_knowns ? instance_log(instance, STATUS_ERROR, "fmi3GetDirectionalDerivative: expected a seed for each known, %u, got %u",
                                           (unsigned)n_knowns, (unsigned)n_seed)
                            : instance_directional(instance, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity));
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns, const fmi3ValueReference knowns[],
                                    size_t n_knowns, const fmi3Float64 seed[], size_t n_seed, fmi3Float64 sensitivity[], size_t n_values)
{
    const size_t n = n_knowns;
    SAME_NUMBER("fmi3GetAdjointDerivative");
    CALL(n_seed != n_unknowns ? instance_log(instance, STATUS_ERROR, "fmi3GetAdjointDerivative: expected a seed for each unknown, %u, got %u",
                                             (unsigned)n_unknowns, (unsigned)n_seed)
                              : instance_adjoint(instance, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity));
}
