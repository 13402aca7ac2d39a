/* A solver in closed form, x(t) = A sin(2 pi f t), for FMI 2.0 and 3.0 in one library, with oddities on request: odd_solver.py
 * writes its model descriptions. Words in its GUID choose what an FMU is, parameters what happens in a run. Only what the wrapper
 * calls is here. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { OK, WARNING, DISCARD, ERROR };
/* Value references; parameters first. Times at which something happens are off while negative. */
enum {
    F, A, NAN_FROM, NAN_TO, STOP_AT, END_AT, V, TALK, GRID, HUGE_AT,
    U = 10, FLAG_IN, GEAR_IN, SMALL_IN, TABLE_IN,
    X = 20, Y, Z, STEPS, SHORTEST, LONGEST, CROSSED, FLAG, GEAR, SMALL, TABLE, PROMISED, TIME,
    COUNT
};

typedef void (*Log2)(void *, const char *, int, const char *, const char *, ...);
typedef void (*Log3)(void *, int, const char *, const char *);
typedef struct {
    Log2 log;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished, *environment;
} Callbacks;

typedef struct {
    double value[COUNT], table[3], first, stopped;
} State;

typedef struct {
    State state;
    double hidden; /* what a liar forgets */
    Log2 log2;
    Log3 log3;
    void *environment;
    bool constant, lies, forgets, crashes, early;
    double last;
    int terminated;
} Instance;

static int instances = 0;

static int say(Instance *self, int status, const char *text, int number, double size)
{
    char message[200];
    if (self->log2)
        self->log2(self->environment, "odd", status, "odd", "%s: %d of %g s", text, number, size);
    if (self->log3) {
        snprintf(message, sizeof message, "%s: %d of %g s", text, number, size);
        self->log3(self->environment, status, "odd", message);
    }
    return status;
}

static void *begin(const char *token, Log2 log2, Log3 log3, void *environment, bool early)
{
    Instance *self = calloc(1, sizeof *self);
    self->log2 = log2;
    self->log3 = log3;
    self->environment = environment;
    self->early = early;
    self->constant = strstr(token, "constant") != NULL;
    self->lies = strstr(token, "lies") != NULL;
    self->forgets = strstr(token, "forgets") != NULL;
    self->crashes = strstr(token, "crashes") != NULL;
    if (strstr(token, "refuses") || (strstr(token, "once") && instances)) {
        say(self, ERROR, "no licence for instance", instances, 0.25);
        free(self);
        return NULL;
    }
    instances++;
    return self;
}

static int reset(Instance *self)
{
    static const double starts[] = {2.0, 3.0, -1.0, -1.0, -1.0, -1.0, 80.0, 0.0, 0.0, -1.0};
    memset(&self->state, 0, sizeof self->state);
    memcpy(self->state.value, starts, sizeof starts);
    self->state.value[GEAR_IN] = 1.0;
    self->state.value[SHORTEST] = 1e9;
    self->hidden = 0.0;
    return OK;
}

static int start(Instance *self, double time)
{
    self->state.value[TIME] = time;
    return OK;
}

static double get(const Instance *self, unsigned reference)
{
    const double *v = self->state.value, t = v[TIME];
    const double x = v[A] * sin(6.283185307179586 * v[F] * t) + (self->hidden != 0.0 ? 1e-6 * self->hidden : -0.0);
    switch (reference) {
    case X: return v[HUGE_AT] >= 0.0 && fabs(t - v[HUGE_AT]) < 1e-7 ? 1e300 : x;
    case Y: return v[NAN_FROM] >= 0.0 && t >= v[NAN_FROM] - 1e-9 && t <= v[NAN_TO] + 1e-9 ? NAN : x + v[U];
    case Z: return 1e-3 * x;
    case FLAG: return v[FLAG_IN];
    case GEAR: return v[GEAR_IN];
    case SMALL: return v[SMALL_IN];
    default: return v[reference];
    }
}

/* From t by h; what happens at a time in between stops it there. */
static int step(Instance *self, double t, double h, int *terminated)
{
    double *v = self->state.value;
    *terminated = 0;
    self->last = t;
    if (fabs(t - v[TIME]) > 1e-7)
        return say(self, ERROR, "a step that does not begin where the last one ended", (int)v[STEPS], t);
    if (self->constant && self->state.first != 0.0 && h != self->state.first)
        return say(self, ERROR, "a step of another size", (int)v[STEPS], h);
    self->state.first = h;
    double end = t + h;
    for (int event = STOP_AT; event <= END_AT; event++)
        if (v[event] >= 0.0 && v[event] < end && v[event] > self->state.stopped - (event == END_AT)) {
            end = v[event];
            self->state.stopped = end;
            *terminated = event == END_AT;
        }
    v[STEPS] += 1.0;
    const double size = end == t + h ? h : end - t;
    v[SHORTEST] = fmin(v[SHORTEST], size);
    v[LONGEST] = fmax(v[LONGEST], size);
    if (v[GRID] > 0.0 && floor(end / v[GRID] - 1e-3) > floor(t / v[GRID] + 1e-3))
        v[CROSSED] += 1.0;
    self->hidden += self->lies || self->forgets;
    if (v[TALK] > 0.0)
        say(self, OK, "step", (int)v[STEPS], h);
    self->last = v[TIME] = end;
    return self->last < t + h ? say(self, DISCARD, "stopped", (int)v[STEPS], end) : OK;
}

#define GET(type)                                                                                                        \
    for (size_t i = 0; i < n; i++)                                                                                       \
        *values++ = (type)get(self, vr[i]);                                                                              \
    return OK
#define SET(type)                                                                                                        \
    for (size_t i = 0; i < n; i++)                                                                                       \
        self->state.value[vr[i]] = (double)*values++;                                                                    \
    return OK
#define INSTANCE Instance *self

/* FMI 2.0 */
EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const Callbacks *callbacks, int visible, int logging)
{
    Instance *self = begin(guid, callbacks->log, NULL, callbacks->environment, false);
    return self ? reset(self), self : NULL;
}
EXPORT void fmi2FreeInstance(INSTANCE)
{
    instances--;
    free(self);
}
EXPORT int fmi2SetDebugLogging(INSTANCE, int on, size_t n, const char *const categories[]) { return OK; }
EXPORT int fmi2SetupExperiment(INSTANCE, int tolerance, double value, double time, int stop, double end) { return start(self, time); }
EXPORT int fmi2EnterInitializationMode(INSTANCE) { return OK; }
EXPORT int fmi2ExitInitializationMode(INSTANCE) { return OK; }
EXPORT int fmi2Terminate(INSTANCE) { return OK; }
EXPORT int fmi2Reset(INSTANCE) { return reset(self); }
EXPORT int fmi2DoStep(INSTANCE, double t, double h, int no_set_state)
{
    self->state.value[PROMISED] = no_set_state;
    return step(self, t, h, &self->terminated);
}
EXPORT int fmi2GetRealStatus(INSTANCE, int kind, double *value) { return *value = self->last, OK; }
EXPORT int fmi2GetBooleanStatus(INSTANCE, int kind, int *value) { return *value = self->terminated, OK; }
#define TYPE2(name, type)                                                                                                \
    EXPORT int fmi2Get##name(INSTANCE, const unsigned vr[], size_t n, type values[]) { GET(type); }                      \
    EXPORT int fmi2Set##name(INSTANCE, const unsigned vr[], size_t n, const type values[]) { SET(type); }
TYPE2(Real, double)
TYPE2(Integer, int)
TYPE2(Boolean, int)

EXPORT int fmi2GetFMUstate(INSTANCE, void **state)
{
    if (self->crashes)
        abort();
    if (!*state)
        *state = malloc(sizeof(Instance));
    return memcpy(*state, self, sizeof *self), OK;
}
EXPORT int fmi2SetFMUstate(INSTANCE, void *state)
{
    const Instance *saved = state;
    self->state = saved->state;
    if (!self->lies)
        self->hidden = saved->hidden;
    return OK;
}
EXPORT int fmi2FreeFMUstate(INSTANCE, void **state) { return free(*state), *state = NULL, OK; }
EXPORT int fmi2SerializedFMUstateSize(INSTANCE, void *state, size_t *size) { return *size = sizeof(State), OK; }
EXPORT int fmi2SerializeFMUstate(INSTANCE, void *state, char bytes[], size_t size)
{
    return size == sizeof(State) ? memcpy(bytes, state, size), OK : ERROR;
}
EXPORT int fmi2DeSerializeFMUstate(INSTANCE, const char bytes[], size_t size, void **state)
{
    Instance *read = calloc(1, sizeof *read);
    memcpy(&read->state, bytes, sizeof(State));
    *state = read;
    return size == sizeof(State) ? OK : ERROR;
}

/* FMI 3.0 */
EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging, bool event,
                                         bool early, const unsigned required[], size_t n, void *environment, Log3 log, void *update)
{
    Instance *self = update || n ? NULL : begin(token, NULL, log, environment, early);
    return self ? reset(self), self : NULL;
}
EXPORT void fmi3FreeInstance(INSTANCE) { fmi2FreeInstance(self); }
EXPORT int fmi3SetDebugLogging(INSTANCE, bool on, size_t n, const char *const categories[]) { return OK; }
EXPORT int fmi3EnterInitializationMode(INSTANCE, bool tolerance, double value, double time, bool stop, double end) { return start(self, time); }
EXPORT int fmi3ExitInitializationMode(INSTANCE) { return OK; }
EXPORT int fmi3Terminate(INSTANCE) { return OK; }
EXPORT int fmi3Reset(INSTANCE) { return reset(self); }
EXPORT int fmi3DoStep(INSTANCE, double t, double h, bool no_set_state, bool *event, bool *terminate, bool *early, double *last)
{
    const double stop = self->state.value[STOP_AT];
    self->state.value[PROMISED] = no_set_state;
    *event = *terminate = *early = false;
    if (!self->early && stop >= 0.0 && stop < t + h && stop > self->state.stopped) { /* not allowed to return: it refuses, where it is */
        self->state.stopped = stop;
        return say(self, DISCARD, "stopped", (int)self->state.value[STEPS], t);
    }
    const int status = step(self, t, h, &self->terminated);
    *early = status == DISCARD;
    *terminate = self->terminated;
    *last = self->last;
    return *early ? OK : status;
}
#define TYPE3(name, type)                                                                                                \
    EXPORT int fmi3Get##name(INSTANCE, const unsigned vr[], size_t n, type values[], size_t count) { GET(type); }        \
    EXPORT int fmi3Set##name(INSTANCE, const unsigned vr[], size_t n, const type values[], size_t count) { SET(type); }
TYPE3(Int8, int8_t)
TYPE3(Int32, int32_t)
TYPE3(Int64, int64_t)
TYPE3(Boolean, bool)
/* Alone in having an array: `table` of three repeats `table_in`. */
EXPORT int fmi3GetFloat64(INSTANCE, const unsigned vr[], size_t n, double values[], size_t count)
{
    for (size_t i = 0, at = 0; i < n; i++) {
        const size_t size = vr[i] == TABLE || vr[i] == TABLE_IN ? 3 : 1;
        if (at + size > count)
            return say(self, ERROR, "no room for value", (int)at, 0.0);
        for (size_t k = 0; k < size; k++)
            values[at++] = size == 3 ? self->state.table[k] : get(self, vr[i]);
    }
    return OK;
}
EXPORT int fmi3SetFloat64(INSTANCE, const unsigned vr[], size_t n, const double values[], size_t count)
{
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0, size = vr[i] == TABLE_IN ? 3 : 1; k < size; k++)
            *(size == 3 ? &self->state.table[k] : &self->state.value[vr[i]]) = *values++;
    return OK;
}
EXPORT int fmi3GetFMUState(INSTANCE, void **state) { return fmi2GetFMUstate(self, state); }
EXPORT int fmi3SetFMUState(INSTANCE, void *state) { return fmi2SetFMUstate(self, state); }
EXPORT int fmi3FreeFMUState(INSTANCE, void **state) { return fmi2FreeFMUstate(self, state); }
EXPORT int fmi3SerializedFMUStateSize(INSTANCE, void *state, size_t *size) { return fmi2SerializedFMUstateSize(self, state, size); }
EXPORT int fmi3SerializeFMUState(INSTANCE, void *state, uint8_t bytes[], size_t size) { return fmi2SerializeFMUstate(self, state, (char *)bytes, size); }
EXPORT int fmi3DeserializeFMUState(INSTANCE, const uint8_t bytes[], size_t size, void **state)
{
    return fmi2DeSerializeFMUstate(self, (const char *)bytes, size, state);
}
