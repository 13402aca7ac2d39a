/* FMI 2.0 and 3.0 around a small model, for solvers that behave as commercial exporters' do: what the file that includes this must
 * define is Model, COUNT (variables, by value reference from FIRST on, 0 unless it says otherwise), and model_start, model_get,
 * model_set and model_step. INSTANCES: so many a process may be made. INITIAL: what a new instance holds, 0 unless it is said. WIDTH: every
 * variable is an array of so many elements, in FMI 3.0; to the model they are variables in a row. */
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#ifndef FIRST
#define FIRST 0u
#endif
#ifndef INSTANCES
#define INSTANCES 1000
#endif
#ifndef WIDTH
#define WIDTH 1
#endif
#ifndef INITIAL
#define INITIAL {0}
#endif

enum { OK, WARNING, DISCARD, ERROR };

static void model_start(Model *self, double time);
static double model_get(Model *self, unsigned reference);
static void model_set(Model *self, unsigned reference, double value);
static int model_step(Model *self, double time, double size);

static int instances = 0; /* ever made: what a tool leaves behind in its process is not made good by freeing */
static const Model initial = INITIAL;

static Model *born(void)
{
    Model *self = instances++ < INSTANCES ? malloc(sizeof *self) : NULL;
    if (self)
        *self = initial;
    return self;
}

#define M Model *self
#define ACCESS                                                                                                           \
    for (size_t i = 0; i < n; i++)                                                                                       \
        if (references[i] - FIRST >= COUNT)                                                                                      \
            return ERROR;                                                                                                \
        else
#define GET ACCESS values[i] = model_get(self, references[i] - FIRST); return OK
#define SET ACCESS model_set(self, references[i] - FIRST, values[i]); return OK

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks, int visible, int logging)
{
    return born();
}
EXPORT void fmi2FreeInstance(M) { free(self); }
EXPORT int fmi2SetDebugLogging(M, int on, size_t n, const char *const categories[]) { return OK; }
EXPORT int fmi2SetupExperiment(M, int tolerance, double value, double time, int stop, double end) { return model_start(self, time), OK; }
EXPORT int fmi2EnterInitializationMode(M) { return OK; }
EXPORT int fmi2ExitInitializationMode(M) { return OK; }
EXPORT int fmi2Terminate(M) { return OK; }
EXPORT int fmi2Reset(M) { return *self = initial, OK; }
EXPORT int fmi2GetReal(M, const unsigned references[], size_t n, double values[]) { GET; }
EXPORT int fmi2SetReal(M, const unsigned references[], size_t n, const double values[]) { SET; }
EXPORT int fmi2DoStep(M, double time, double size, int no_set_state) { return model_step(self, time, size); }

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging, bool event,
                                         bool early, const unsigned required[], size_t n, void *environment, void *log, void *update)
{
    return born();
}
EXPORT void fmi3FreeInstance(M) { free(self); }
EXPORT int fmi3SetDebugLogging(M, bool on, size_t n, const char *const categories[]) { return OK; }
EXPORT int fmi3EnterInitializationMode(M, bool tolerance, double value, double time, bool stop, double end) { return model_start(self, time), OK; }
EXPORT int fmi3ExitInitializationMode(M) { return OK; }
EXPORT int fmi3Terminate(M) { return OK; }
EXPORT int fmi3Reset(M) { return *self = initial, OK; }
#define ELEMENTS                                                                                                         \
    if (count != n * WIDTH)                                                                                              \
        return ERROR;                                                                                                    \
    ACCESS for (unsigned k = 0; k < WIDTH; k++)
EXPORT int fmi3GetFloat64(M, const unsigned references[], size_t n, double values[], size_t count)
{
    ELEMENTS values[i * WIDTH + k] = model_get(self, (references[i] - FIRST) * WIDTH + k);
    return OK;
}
EXPORT int fmi3SetFloat64(M, const unsigned references[], size_t n, const double values[], size_t count)
{
    ELEMENTS model_set(self, (references[i] - FIRST) * WIDTH + k, values[i * WIDTH + k]);
    return OK;
}
EXPORT int fmi3DoStep(M, double time, double size, bool no_set_state, bool *event, bool *terminate, bool *early, double *last)
{
    *event = *terminate = *early = false;
    *last = time + size;
    return model_step(self, time, size);
}

/* What the standards have beside it, and no host of the tests calls. */
#define REFUSED(name)                                                                                                    \
    EXPORT int name(void) { return ERROR; }
REFUSED(fmi2CancelStep) REFUSED(fmi2DeSerializeFMUstate) REFUSED(fmi2FreeFMUstate) REFUSED(fmi2GetBoolean)
REFUSED(fmi2GetBooleanStatus) REFUSED(fmi2GetDirectionalDerivative) REFUSED(fmi2GetFMUstate) REFUSED(fmi2GetInteger)
REFUSED(fmi2GetIntegerStatus) REFUSED(fmi2GetRealOutputDerivatives) REFUSED(fmi2GetRealStatus) REFUSED(fmi2GetStatus)
REFUSED(fmi2GetString) REFUSED(fmi2GetStringStatus)
REFUSED(fmi2SerializeFMUstate) REFUSED(fmi2SerializedFMUstateSize) REFUSED(fmi2SetBoolean) REFUSED(fmi2SetFMUstate)
REFUSED(fmi2SetInteger) REFUSED(fmi2SetRealInputDerivatives) REFUSED(fmi2SetString)
REFUSED(fmi3ActivateModelPartition) REFUSED(fmi3CompletedIntegratorStep) REFUSED(fmi3DeserializeFMUState)
REFUSED(fmi3EnterConfigurationMode) REFUSED(fmi3EnterContinuousTimeMode) REFUSED(fmi3EnterEventMode)
REFUSED(fmi3EnterStepMode) REFUSED(fmi3EvaluateDiscreteStates) REFUSED(fmi3ExitConfigurationMode)
REFUSED(fmi3FreeFMUState) REFUSED(fmi3GetAdjointDerivative) REFUSED(fmi3GetBinary) REFUSED(fmi3GetBoolean)
REFUSED(fmi3GetClock) REFUSED(fmi3GetContinuousStateDerivatives) REFUSED(fmi3GetContinuousStates)
REFUSED(fmi3GetDirectionalDerivative) REFUSED(fmi3GetEventIndicators) REFUSED(fmi3GetFMUState) REFUSED(fmi3GetFloat32)
REFUSED(fmi3GetInt16) REFUSED(fmi3GetInt32) REFUSED(fmi3GetInt64) REFUSED(fmi3GetInt8) REFUSED(fmi3GetIntervalDecimal)
REFUSED(fmi3GetIntervalFraction) REFUSED(fmi3GetNominalsOfContinuousStates) REFUSED(fmi3GetNumberOfContinuousStates)
REFUSED(fmi3GetNumberOfEventIndicators) REFUSED(fmi3GetNumberOfVariableDependencies) REFUSED(fmi3GetOutputDerivatives)
REFUSED(fmi3GetShiftDecimal) REFUSED(fmi3GetShiftFraction) REFUSED(fmi3GetString) REFUSED(fmi3GetUInt16)
REFUSED(fmi3GetUInt32) REFUSED(fmi3GetUInt64) REFUSED(fmi3GetUInt8) REFUSED(fmi3GetVariableDependencies)
REFUSED(fmi3InstantiateModelExchange) REFUSED(fmi3InstantiateScheduledExecution)
REFUSED(fmi3SerializeFMUState) REFUSED(fmi3SerializedFMUStateSize) REFUSED(fmi3SetBinary) REFUSED(fmi3SetBoolean)
REFUSED(fmi3SetClock) REFUSED(fmi3SetContinuousStates) REFUSED(fmi3SetFMUState) REFUSED(fmi3SetFloat32)
REFUSED(fmi3SetInt16) REFUSED(fmi3SetInt32) REFUSED(fmi3SetInt64) REFUSED(fmi3SetInt8) REFUSED(fmi3SetIntervalDecimal)
REFUSED(fmi3SetIntervalFraction) REFUSED(fmi3SetShiftDecimal) REFUSED(fmi3SetShiftFraction) REFUSED(fmi3SetString)
REFUSED(fmi3SetTime) REFUSED(fmi3SetUInt16) REFUSED(fmi3SetUInt32) REFUSED(fmi3SetUInt64) REFUSED(fmi3SetUInt8)
REFUSED(fmi3UpdateDiscreteStates)
