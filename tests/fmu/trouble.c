/* An FMU that makes trouble on request, for FMI 2.0 and 3.0 in one library. conftest.py writes its model descriptions.
 * Value references: 0 mode, 1 at (s); inputs 10 real, 11 integer, 12 boolean, 13 enumeration, 14 single; the outputs 20 to
 * 24 repeat them; 30 time. Only what the tests call is here. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

enum { NOTHING, WARN, DISCARD, ERROR, FATAL, NOT_A_NUMBER, NO_INITIALISATION, NO_INSTANCE, TERMINATE, EARLY, STUCK, PENDING };
enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR, STATUS_FATAL, STATUS_PENDING };

typedef void (*Log2)(void *, const char *, int, const char *, const char *, ...);
typedef void (*Log3)(void *, int, const char *, const char *);
typedef struct {
    Log2 log;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished, *environment;
} Callbacks;

typedef struct {
    Log2 log2;
    Log3 log3;
    void (*release)(void *);
    void *environment;
    double value[32];
} Instance;

static void say(Instance *self, int status, const char *category, const char *text, double number)
{
    char message[200];
    if (self->log2)
        self->log2(self->environment, "trouble", status, category, "%s %.3g", text, number);
    if (self->log3) {
        snprintf(message, sizeof message, "%s %.3g", text, number);
        self->log3(self->environment, status, category, message);
    }
}

static bool due(const Instance *self, int mode, double t) { return self->value[0] == mode && t >= self->value[1] - 1e-9; }

static int step(Instance *self, double t, double h)
{
    if (fabs(t - self->value[30]) > 1e-9) {
        say(self, STATUS_ERROR, "time", "step does not start where the last one ended:", t);
        return STATUS_ERROR;
    }
    t += h;
    for (int mode = WARN; mode <= FATAL; mode++)
        if (due(self, mode, t)) {
            say(self, mode, "trouble", "trouble was ordered for", self->value[1]);
            if (mode > WARN)
                return mode;
        }
    self->value[30] = t;
    return due(self, PENDING, t) ? STATUS_PENDING : due(self, WARN, t) ? STATUS_WARNING : STATUS_OK;
}

static double get(const Instance *self, unsigned reference)
{
    if (reference >= 20 && reference < 25)
        return due(self, NOT_A_NUMBER, self->value[30]) ? NAN : self->value[reference - 10];
    return self->value[reference];
}

static int initialised(Instance *self)
{
    if (self->value[0] != NO_INITIALISATION)
        return STATUS_OK;
    say(self, STATUS_ERROR, "trouble", "no equilibrium found at", self->value[30]);
    return STATUS_ERROR;
}

#define GET(name, type)                                                                  \
    for (size_t i = 0; i < n; i++)                                                       \
        values[i] = (type)get(self, vr[i]);                                              \
    return STATUS_OK
#define SET(name, type)                                                                  \
    for (size_t i = 0; i < n; i++)                                                       \
        self->value[vr[i]] = (double)values[i];                                          \
    return STATUS_OK

/* FMI 2.0 */
void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const Callbacks *callbacks, int visible, int logging)
{
    Instance *self = callbacks->allocate(1, sizeof *self);
    self->log2 = callbacks->log;
    self->release = callbacks->release;
    self->environment = callbacks->environment;
    if (logging)
        say(self, STATUS_OK, "debug", resources, 0);
    return self;
}
void fmi2FreeInstance(Instance *self)
{
    say(self, STATUS_OK, "debug", "freed", 0);
    self->release(self);
}
int fmi2SetDebugLogging(Instance *self, int on, size_t n, const char *const categories[]) { return on == 1 && n == 1 ? STATUS_OK : STATUS_ERROR; }
int fmi2SetupExperiment(Instance *self, int tolerance, double value, double start, int stop, double end)
{
    self->value[30] = start;
    return STATUS_OK;
}
int fmi2EnterInitializationMode(Instance *self) { return STATUS_OK; }
int fmi2ExitInitializationMode(Instance *self) { return initialised(self); }
int fmi2Terminate(Instance *self) { return STATUS_OK; }
int fmi2Reset(Instance *self)
{
    for (int i = 0; i < 32; i++)
        self->value[i] = 0.0;
    return STATUS_OK;
}
int fmi2DoStep(Instance *self, double t, double h, int no_set_state) { return step(self, t, h); }
int fmi2GetRealStatus(Instance *self, int kind, double *value) { *value = self->value[30]; return STATUS_OK; }
int fmi2GetBooleanStatus(Instance *self, int kind, int *value) { *value = 1; return STATUS_OK; }
#define TYPE2(name, type)                                                                                                             \
    int fmi2Get##name(Instance *self, const unsigned vr[], size_t n, type values[]) { GET(name, type); }                              \
    int fmi2Set##name(Instance *self, const unsigned vr[], size_t n, const type values[]) { SET(name, type); }
TYPE2(Real, double)
TYPE2(Integer, int)
TYPE2(Boolean, int)

/* FMI 3.0 */
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging, bool event, bool early,
                                  const unsigned required[], size_t n, void *environment, Log3 log, void *update)
{
    if (event || early || update)
        return NULL;
    Instance *self = calloc(1, sizeof *self);
    self->log3 = log;
    self->release = free;
    self->environment = environment;
    if (logging)
        say(self, STATUS_OK, "debug", resources, 0);
    return self;
}
void fmi3FreeInstance(Instance *self) { fmi2FreeInstance(self); }
int fmi3SetDebugLogging(Instance *self, bool on, size_t n, const char *const categories[]) { return fmi2SetDebugLogging(self, on, n, categories); }
int fmi3EnterInitializationMode(Instance *self, bool tolerance, double value, double start, bool stop, double end)
{
    self->value[30] = start;
    return STATUS_OK;
}
int fmi3ExitInitializationMode(Instance *self) { return initialised(self); }
int fmi3Terminate(Instance *self) { return STATUS_OK; }
int fmi3Reset(Instance *self) { return fmi2Reset(self); }
int fmi3DoStep(Instance *self, double t, double h, bool no_set_state, bool *event, bool *terminate, bool *early, double *last)
{
    *event = *terminate = *early = false;
    *last = self->value[30];
    if (due(self, STUCK, t + h)) {
        *early = true;
        return STATUS_OK;
    }
    const bool half = due(self, EARLY, t + h) && h > 3e-4;
    const int status = step(self, t, half ? h / 2 : h);
    *early = half;
    *terminate = due(self, TERMINATE, t + h);
    *last = self->value[30];
    return status;
}
#define TYPE3(name, type)                                                                                                             \
    int fmi3Get##name(Instance *self, const unsigned vr[], size_t n, type values[], size_t count) { GET(name, type); }                \
    int fmi3Set##name(Instance *self, const unsigned vr[], size_t n, const type values[], size_t count) { SET(name, type); }
TYPE3(Float64, double)
TYPE3(Float32, float)
TYPE3(Int8, int8_t)
TYPE3(Int32, int32_t)
TYPE3(Int64, int64_t)
TYPE3(UInt64, uint64_t)
TYPE3(Boolean, bool)
