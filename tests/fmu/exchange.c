/* FMUs of model exchange for FMI 2.0 and 3.0 in one library; the token says which model one is (exchange_fmu.py describes
 * them). The first four are the published ones of the Reference-FMUs by their equations; `mass` has inputs of all kinds, and
 * `dahlquist` makes trouble on request. Strict: what the standard does not allow in the mode it is in, it refuses.
 * Value references: 1, 2 states; 3, 4 their derivatives; 10 to 15 parameters; 20 continuous input, 21 discrete input; 30 the
 * discrete state; 31 events so far; 32 completed integrator steps. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

enum { OK, WARNING, DISCARD, ERROR };
enum { INSTANTIATED, INITIALISING, EVENT, CONTINUOUS };
enum { X = 1, V = 2, DX = 3, DV = 4, P = 10, U = 20, GEAR = 21, D = 30, EVENTS = 31, STEPS = 32, COUNT = 40 };
enum { REFUSE_LATE = 1, FAIL, NOT_A_NUMBER, END, ENDLESS_EVENT, DISCARD_LONG };

typedef struct Instance Instance;
typedef struct {
    const char *token;
    size_t states, indicators;
    const double start[COUNT]; /* by value reference */
    void (*derivatives)(Instance *);
    double (*indicator)(const Instance *);
    void (*event)(Instance *);
} Model;
struct Instance {
    const Model *model;
    int mode;
    double t, next_event, last_t, value[COUNT];
};

/* BouncingBall: h'' = g, at the ground v -> -e v, at rest below v_min. */
static void fall(Instance *s) { s->value[DX] = s->value[V], s->value[DV] = s->value[P]; }
static double height(const Instance *s) { return s->value[X] == 0 && s->value[V] == 0 ? 1 : s->value[X]; }
static void bounce(Instance *s)
{
    if (s->value[X] > 0 || s->value[P] == 0)
        return;
    s->value[X] = 0;
    s->value[V] = fabs(s->value[V] * s->value[P + 1]);
    s->value[D]++;
    if (s->value[V] < s->value[P + 2])
        s->value[V] = s->value[P] = 0;
}

/* VanDerPol: x'' = mu (1 - x^2) x' - x. */
static void pol(Instance *s)
{
    const double x = s->value[X], v = s->value[V];
    s->value[DX] = v, s->value[DV] = s->value[P] * (1 - x * x) * v - x;
}

/* Stair: a counter that goes up each second (P: interval), at P + 1 it ends. */
static void up(Instance *s)
{
    if (s->t >= s->next_event) {
        s->value[D]++;
        s->next_event = s->value[P] * s->value[D];
    }
}

/* Dahlquist: x' = -k x. From the time P + 2 on, the trouble P + 1. */
static void decay(Instance *s) { s->value[DX] = -s->value[P] * s->value[X]; }

/* A mass on spring and damper with the force u and the force that the gear gives, beside it a switch: on while u > 1. */
static void swing(Instance *s)
{
    const double *v = s->value, force = v[U] + v[D + 3];
    s->value[DX] = v[V], s->value[DV] = (force - v[P] * v[X] - v[P + 1] * v[V]) / v[P + 2];
}
static double over(const Instance *s) { return s->value[U] - 1; }
static void engage(Instance *s) { s->value[D] = s->value[U] > 1, s->value[D + 3] = 10 * s->value[GEAR]; }

static void nothing(Instance *s) {}
static const Model MODELS[] = {
    {"ball", 2, 1, {[X] = 1, [P] = -9.81, [P + 1] = 0.7, [P + 2] = 0.1}, fall, height, bounce},
    {"pol", 2, 0, {[X] = 2, [P] = 1}, pol, NULL, nothing},
    {"stair", 0, 0, {[D] = 1, [P] = 1, [P + 1] = 1e9}, nothing, NULL, up},
    {"dahlquist", 1, 0, {[X] = 1, [P] = 1, [P + 2] = 1e9}, decay, NULL, nothing},
    {"mass", 2, 1, {[P] = 1800, [P + 1] = 3, [P + 2] = 2}, swing, over, engage},
};

static bool trouble(const Instance *s, int what)
{
    return s->model->states == 1 && s->value[P + 1] == what && s->t >= s->value[P + 2];
}
static void *made(const char *token)
{
    Instance *s = calloc(1, sizeof *s);
    for (size_t i = 0; i < sizeof MODELS / sizeof *MODELS; i++)
        if (!strcmp(MODELS[i].token, token))
            s->model = &MODELS[i];
    memcpy(s->value, s->model->start, sizeof s->value);
    return s;
}
static int enter(Instance *s, int from, int to)
{
    if (s->mode != from)
        return ERROR;
    s->mode = to;
    return OK;
}
static int begin(Instance *s, double start)
{
    s->t = s->last_t = start;
    return enter(s, INSTANTIATED, INITIALISING);
}
static int initialised(Instance *s)
{
    s->next_event = s->model->event == up ? s->value[P] : INFINITY;
    return enter(s, INITIALISING, EVENT);
}
static int update(Instance *s, bool *again, bool *terminate, bool *timed, double *next)
{
    if (s->mode != EVENT)
        return ERROR;
    s->model->event(s);
    s->value[EVENTS]++;
    *again = trouble(s, ENDLESS_EVENT);
    *terminate = (s->model->event == up && s->value[D] > s->value[P + 1]) || trouble(s, END);
    *timed = isfinite(s->next_event);
    *next = s->next_event;
    return OK;
}
static int completed(Instance *s, bool *event, bool *terminate)
{
    if (s->mode != CONTINUOUS || s->t < s->last_t)
        return ERROR;
    s->last_t = s->t;
    s->value[STEPS]++;
    *event = trouble(s, ENDLESS_EVENT);
    *terminate = trouble(s, END);
    return OK;
}
static int set_time(Instance *s, double t)
{
    s->t = t;
    return s->mode >= EVENT ? OK : ERROR;
}
static int set_states(Instance *s, const double x[], size_t n)
{
    memcpy(s->value + X, x, n * sizeof *x);
    return s->mode == CONTINUOUS && n == s->model->states ? OK : ERROR;
}
static int get_states(Instance *s, double x[], size_t n)
{
    memcpy(x, s->value + X, n * sizeof *x);
    return n == s->model->states ? OK : ERROR;
}
static int get_derivatives(Instance *s, double dx[], size_t n)
{
    s->model->derivatives(s);
    memcpy(dx, s->value + DX, n * sizeof *dx);
    if (trouble(s, NOT_A_NUMBER))
        dx[0] = NAN;
    if (trouble(s, DISCARD_LONG) && s->t > s->last_t + 0.0011)
        return DISCARD;
    return trouble(s, REFUSE_LATE) ? DISCARD : trouble(s, FAIL) || n != s->model->states ? ERROR : OK;
}
static int get_indicators(Instance *s, double z[], size_t n)
{
    if (n != s->model->indicators)
        return ERROR;
    if (n)
        z[0] = s->model->indicator(s);
    return OK;
}
static int get_nominals(Instance *s, double x[], size_t n)
{
    for (size_t i = 0; i < n; i++)
        x[i] = 1;
    return OK;
}
static double get(Instance *s, unsigned reference)
{
    if (reference == DX || reference == DV)
        s->model->derivatives(s);
    return reference ? s->value[reference] : s->t;
}
static int set(Instance *s, unsigned reference, double value)
{
    if (s->mode == CONTINUOUS && reference != U)
        return ERROR; /* all else wants an event */
    s->value[reference] = value;
    return OK;
}
static int reset(Instance *s)
{
    const Model *model = s->model;
    memset(s, 0, sizeof *s);
    s->model = model;
    memcpy(s->value, model->start, sizeof s->value);
    return OK;
}
static void *copied(void **state, const Instance *s)
{
    if (!*state)
        *state = malloc(sizeof *s);
    return memcpy(*state, s, sizeof *s);
}

#define GET(type)                                                                        \
    for (size_t i = 0; i < n; i++)                                                       \
        values[i] = (type)get(s, vr[i]);                                                 \
    return OK
#define SET                                                                              \
    for (size_t i = 0; i < n; i++)                                                       \
        if (set(s, vr[i], values[i]))                                                    \
            return ERROR;                                                                \
    return OK
#define BOTH(prefix)                                                                                                       \
    void prefix##FreeInstance(Instance *s) { free(s); }                                                                    \
    int prefix##ExitInitializationMode(Instance *s) { return initialised(s); }                                             \
    int prefix##Terminate(Instance *s) { return OK; }                                                                      \
    int prefix##Reset(Instance *s) { return reset(s); }                                                                    \
    int prefix##EnterEventMode(Instance *s) { return enter(s, CONTINUOUS, EVENT); }                                        \
    int prefix##EnterContinuousTimeMode(Instance *s) { return enter(s, EVENT, CONTINUOUS); }                               \
    int prefix##SetTime(Instance *s, double t) { return set_time(s, t); }                                                  \
    int prefix##SetContinuousStates(Instance *s, const double x[], size_t n) { return set_states(s, x, n); }               \
    int prefix##GetContinuousStates(Instance *s, double x[], size_t n) { return get_states(s, x, n); }                     \
    int prefix##GetEventIndicators(Instance *s, double z[], size_t n) { return get_indicators(s, z, n); }                  \
    int prefix##GetNominalsOfContinuousStates(Instance *s, double x[], size_t n) { return get_nominals(s, x, n); }

/* FMI 2.0 */
typedef struct {
    int again, terminate, nominals, values, timed;
    double next;
} EventInfo;
BOTH(fmi2)
void *fmi2Instantiate(const char *name, int type, const char *token, const char *resources, const void *callbacks, int visible, int logging)
{
    return type == 0 ? made(token) : NULL;
}
int fmi2SetupExperiment(Instance *s, int tolerance, double value, double start, int stop, double end)
{
    s->t = start;
    return OK;
}
int fmi2EnterInitializationMode(Instance *s) { return begin(s, s->t); }
int fmi2GetDerivatives(Instance *s, double dx[], size_t n) { return get_derivatives(s, dx, n); }
int fmi2NewDiscreteStates(Instance *s, EventInfo *info)
{
    bool again, terminate, timed;
    const int status = update(s, &again, &terminate, &timed, &info->next);
    info->again = again, info->terminate = terminate, info->timed = timed, info->nominals = 0, info->values = 1;
    return status;
}
int fmi2CompletedIntegratorStep(Instance *s, int no_set_state, int *event, int *terminate)
{
    bool events, terminates;
    const int status = completed(s, &events, &terminates);
    *event = events, *terminate = terminates;
    return status;
}
int fmi2GetReal(Instance *s, const unsigned vr[], size_t n, double values[]) { GET(double); }
int fmi2SetReal(Instance *s, const unsigned vr[], size_t n, const double values[]) { SET; }
int fmi2GetInteger(Instance *s, const unsigned vr[], size_t n, int values[]) { GET(int); }
int fmi2SetInteger(Instance *s, const unsigned vr[], size_t n, const int values[]) { SET; }
int fmi2GetFMUstate(Instance *s, void **state) { return copied(state, s) ? OK : ERROR; }
int fmi2SetFMUstate(Instance *s, void *state) { return memcpy(s, state, sizeof *s) ? OK : ERROR; }
int fmi2FreeFMUstate(Instance *s, void **state) { return free(*state), *state = NULL, OK; }
int fmi2SerializedFMUstateSize(Instance *s, void *state, size_t *size) { return *size = sizeof *s, OK; }
int fmi2SerializeFMUstate(Instance *s, void *state, char bytes[], size_t size) { return memcpy(bytes, state, size) ? OK : ERROR; }
int fmi2DeSerializeFMUstate(Instance *s, const char bytes[], size_t size, void **state)
{
    Instance *copy = copied(state, (const Instance *)bytes);
    copy->model = s->model; /* the address is of another process */
    return OK;
}

/* FMI 3.0 */
BOTH(fmi3)
void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible, bool logging, void *environment, void *log)
{
    return made(token);
}
int fmi3EnterInitializationMode(Instance *s, bool tolerance, double value, double start, bool stop, double end) { return begin(s, start); }
int fmi3GetNumberOfContinuousStates(Instance *s, size_t *n) { return *n = s->model->states, OK; }
int fmi3GetNumberOfEventIndicators(Instance *s, size_t *n) { return *n = s->model->indicators, OK; }
int fmi3GetContinuousStateDerivatives(Instance *s, double dx[], size_t n) { return get_derivatives(s, dx, n); }
int fmi3UpdateDiscreteStates(Instance *s, bool *again, bool *terminate, bool *nominals, bool *values, bool *timed, double *next)
{
    *nominals = false, *values = true;
    return update(s, again, terminate, timed, next);
}
int fmi3CompletedIntegratorStep(Instance *s, bool no_set_state, bool *event, bool *terminate) { return completed(s, event, terminate); }
int fmi3GetFloat64(Instance *s, const unsigned vr[], size_t n, double values[], size_t count) { GET(double); }
int fmi3SetFloat64(Instance *s, const unsigned vr[], size_t n, const double values[], size_t count) { SET; }
int fmi3GetInt32(Instance *s, const unsigned vr[], size_t n, int values[], size_t count) { GET(int); }
int fmi3SetInt32(Instance *s, const unsigned vr[], size_t n, const int values[], size_t count) { SET; }
int fmi3GetFMUState(Instance *s, void **state) { return fmi2GetFMUstate(s, state); }
int fmi3SetFMUState(Instance *s, void *state) { return fmi2SetFMUstate(s, state); }
int fmi3FreeFMUState(Instance *s, void **state) { return fmi2FreeFMUstate(s, state); }
int fmi3SerializedFMUStateSize(Instance *s, void *state, size_t *size) { return fmi2SerializedFMUstateSize(s, state, size); }
int fmi3SerializeFMUState(Instance *s, void *state, char bytes[], size_t size) { return fmi2SerializeFMUstate(s, state, bytes, size); }
int fmi3DeserializeFMUState(Instance *s, const char bytes[], size_t size, void **state) { return fmi2DeSerializeFMUstate(s, bytes, size, state); }

/* What hosts look for that take only a whole library, fmpy among them. */
#define NOT2(name) int fmi2##name(void) { return ERROR; }
NOT2(GetBoolean) NOT2(SetBoolean) NOT2(GetString) NOT2(SetString) NOT2(GetDirectionalDerivative) NOT2(GetTypesPlatform)
NOT2(GetVersion) NOT2(SetDebugLogging)
#define NOT3(name) int fmi3##name(void) { return ERROR; }
NOT3(GetVersion) NOT3(SetDebugLogging) NOT3(EnterConfigurationMode) NOT3(ExitConfigurationMode) NOT3(EvaluateDiscreteStates)
NOT3(GetAdjointDerivative) NOT3(GetDirectionalDerivative) NOT3(GetVariableDependencies) NOT3(GetNumberOfVariableDependencies)
NOT3(GetIntervalDecimal) NOT3(GetIntervalFraction) NOT3(GetShiftDecimal) NOT3(GetShiftFraction) NOT3(SetIntervalDecimal)
NOT3(SetIntervalFraction) NOT3(SetShiftDecimal) NOT3(SetShiftFraction) NOT3(InstantiateCoSimulation)
NOT3(InstantiateScheduledExecution) NOT3(ActivateModelPartition) NOT3(DoStep) NOT3(EnterStepMode) NOT3(GetOutputDerivatives)
NOT3(GetBinary) NOT3(SetBinary) NOT3(GetBoolean) NOT3(SetBoolean) NOT3(GetClock) NOT3(SetClock) NOT3(GetFloat32) NOT3(SetFloat32)
NOT3(GetInt8) NOT3(SetInt8) NOT3(GetInt16) NOT3(SetInt16) NOT3(GetInt64) NOT3(SetInt64) NOT3(GetUInt8) NOT3(SetUInt8)
NOT3(GetUInt16) NOT3(SetUInt16) NOT3(GetUInt32) NOT3(SetUInt32) NOT3(GetUInt64) NOT3(SetUInt64) NOT3(GetString) NOT3(SetString)
