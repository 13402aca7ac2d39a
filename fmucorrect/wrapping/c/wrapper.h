/* One instance of the wrapped FMU, independent of both FMI versions.
 *
 * outer_fmi*.c translates the host's calls, inner_fmi*.c speaks with the solver's FMU, sampling.c keeps the corrector's time grid,
 * coupling.c feeds forces back, variables.c answers for what the wrapper adds. wrapped.h and wrapped.c are generated: versions,
 * value references, units, start values. Nothing allocates or locks once the instance exists, but for copies of the state. */
#ifndef WRAPPER_H
#define WRAPPER_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "names.h"
#include "wrapped.h"

#if OUTER_FMI == 2 || INNER_FMI == 2
#include "fmi2FunctionTypes.h"
#endif
#if OUTER_FMI == 3 || INNER_FMI == 3
#include "fmi3FunctionTypes.h"
#endif

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter" /* the functions of FMI have theirs, and so have both sides of this wrapper */
#endif
#if LINKED && INNER_FMI && !defined(INNER_PREFIX)
#error "the solver's modelIdentifier is no name in C: its functions cannot be linked"
#endif

#define REMEMBERS (CORRECTOR_STATE > 0) /* the corrector hands numbers from sample to sample */
#define DIRECT (OUTER_FMI == INNER_FMI) /* the solver's value references are the host's */

/* The values of fmi2Status and fmi3Status. */
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR, STATUS_FATAL, STATUS_PENDING } Status;

/* What corrector_status says (fmucorrect.stepper.Status; a stepper raises an error where this says INVALID). */
typedef enum { CORRECTED, WARMUP, OUTSIDE, INVALID, OFF } Correction;

/* A variable of the solver: its type (a Kind of the inner FMI version), value reference, number of elements and the element. */
typedef struct {
    unsigned char kind;
    uint32_t reference, size, index;
} Wired;

/* fmucorrect/wrapping/conversion.py writes these numbers. */
enum { REAL_2, INTEGER_2, BOOLEAN_2, STRING_2 };
enum {
    FLOAT64_3, FLOAT32_3, INT8_3, UINT8_3, INT16_3, UINT16_3, INT32_3, UINT32_3, INT64_3, UINT64_3, BOOLEAN_3, STRING_3
};
enum { TIME_KIND = 255 }; /* the communication time itself */

/* A value on its way between versions. */
typedef enum { NUMBER, INTEGER, TRUTH, TEXT } Class;
typedef struct {
    Class class;
    double number;
    int64_t integer;
    const char *text;
} Value;
typedef double Value_number; /* of its members, for the macros of all types */
typedef int64_t Value_integer;
typedef const char *Value_text;

typedef struct {
    Wired variable;
    double value;
} Start;

/* A parameter of the solver as the corrector was trained with it: from low to high it counts as the same. */
typedef struct {
    Wired variable;
    double low, high;
    const char *name, *was;
} Trained;

typedef struct {
    uint32_t reference, size;
} ArraySize;

/* Where law i acts: ports displacement, velocity, acceleration, nominal force (size 0: not there) with their factors to SI, the
 * force input by its number in FORCE_INPUTS, and the factor from the law's force to it: unit and sign of the joint. */
typedef struct {
    Wired ports[4];
    double factors[4];
    unsigned force;
    double factor;
} Place;

enum { SPEED, AMPLITUDE, FREQUENCY, START, CONDITIONS };

extern const Wired SOURCES[SEEN + CONDITIONS]; /* what the corrector sees, the channels first, then conditions; size 0 where a condition is a tunable */
extern const double FACTORS[SEEN + CONDITIONS];
extern const bool HELD[SEEN + 1]; /* inputs, of which a row has what they held until its time */
extern const char *const CHANNEL_NAMES[SEEN + 1];
extern const double UNCORRECTED[CHANNELS + 1];
extern const double TUNABLES[CONDITIONS];
extern const Start START_VALUES[STARTS + 1];
extern const Trained TRAINED[TRAINED_COUNT + 1];
extern const ArraySize ARRAYS[ARRAY_COUNT + 1];
extern const Wired WIRED[WIRED_COUNT + 1]; /* by the host's value reference, where the versions differ */
extern const Wired FORCE_INPUTS[FORCES + 1];
extern const double FORCE_STARTS[FORCES + 1]; /* what the solver begins with there */
extern const Place PLACES[EFFECTS + 1];
extern const double ANSWERS[EFFECTS + 1][FORCES + 1]; /* of law i's acceleration to a force input: m/s2 a unit of the solver's */

/* Added variables, counted from ADDED_BASE. */
enum {
    CORRECTED_0, SIGMA_0 = CHANNELS, STATUS_VARIABLE = 2 * CHANNELS, ENABLED, CONDITION_0, EFFECTS_ENABLED = CONDITION_0 + CONDITIONS,
    ADDED_COUNT
};

/* All that an FMU state holds beside the solver's own. */
typedef struct {
    bool enabled, effects_enabled;
    bool started;     /* initialisation has ended: there is a first sample */
    bool on_grid;     /* the newest row of the window belongs to the time that has been reached */
    bool row_stale;   /* the solver's outputs may have changed since they were read */
    bool row_due;     /* the sample of this time is to be read (again) before the solver goes on */
    bool joints_due;  /* the joints likewise */
    bool led;         /* the host has set inputs or parameters since initialisation ended */
    bool awaited;     /* the inputs of this time, which the corrector sees, have not been set yet */
    bool inputs_known; /* inputs_before is */
    bool divided;     /* the solver has been given other steps than the host's */
    bool stale;       /* the correction does not follow yet from window and conditions */
    bool ill;         /* the last sample was not finite, and that was said */
    bool unlike;      /* the solver has started with other parameters than in training, and that was said: nothing is corrected */
    bool carried;     /* next_memory follows from the newest sample */
    int64_t now_ns;   /* time that has been reached, on the solver's clock */
    int64_t sample_ns; /* time of the newest sample */
    double piece;     /* a solver of constant step: s from sample to sample or less, 0 before the first */
    double part;      /* the same, what the solver got last, with effects less than a piece; s, 0 before the first */
    uint32_t seen, seen_before;
    int status;
    double now;  /* s, where the solver's last step ended: its begin + its size, in the solver's own arithmetic */
    double host; /* s, where the host's last step ended, on the host's clock */
    double conditions[CONDITIONS];
    double row[SEEN + 1]; /* what is seen of the solver's response now, in the corrector's units */
    double inputs_before[SEEN + 1]; /* what inputs have held since the sample before, in the corrector's units */
    double delta[CHANNELS + 1], sigma[CHANNELS + 1];
    float window[ROWS * SEEN + 1];
    float memory[CORRECTOR_STATE + 1], next_memory[CORRECTOR_STATE + 1]; /* the corrector's state, before and after the newest sample */
    double host_force[FORCES + 1], force[FORCES + 1]; /* the host's own share of the force inputs, and the laws' */
    double held[FORCES + 1];      /* what they held in the last sub-step */
    double states[EFFECT_STATES + 1];
    double joints[EFFECTS + 1][4]; /* the joints of every law as they were read last */
    double ports[EFFECTS + 1][4]; /* of every law at the time moved_at (s), see coupling.c */
    bool moved;                   /* they were read */
    double moved_at, span;        /* span: s from the reading before to moved_at, 0 without one */
    uint32_t readings;            /* since the start or the last event, at most 2 */
#if INNER_FMI == 0
    double inputs[SEEN + 1];
#endif
} State;

typedef struct {
    bool event, terminate, early;
    double last; /* s, time that was reached; on the clock of whom it is told */
} Outcome;

typedef struct Wrapper Wrapper;

typedef struct {
    void *library;
#if INNER_FMI == 2
#define INNER_FUNCTIONS(X)                                                                                               \
    X(Instantiate) X(FreeInstance) X(SetDebugLogging) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode) \
    X(Terminate) X(Reset) X(GetReal) X(GetInteger) X(GetBoolean) X(GetString) X(SetReal) X(SetInteger) X(SetBoolean)     \
    X(SetString) X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate) X(SerializedFMUstateSize) X(SerializeFMUstate)            \
    X(DeSerializeFMUstate) X(DoStep) X(GetStatus) X(GetRealStatus) X(GetIntegerStatus) X(GetBooleanStatus)              \
    X(GetStringStatus) X(CancelStep)
#define X(name) fmi2##name##TYPE *name;
    INNER_FUNCTIONS(X)
#undef X
    fmi2Component component;
    fmi2CallbackFunctions callbacks;
#elif INNER_FMI == 3
#define INNER_ACCESS_3(X) X(Float32) X(Float64) X(Int8) X(UInt8) X(Int16) X(UInt16) X(Int32) X(UInt32) X(Int64) X(UInt64) X(Boolean) X(String)
#define INNER_FUNCTIONS(X)                                                                                               \
    X(InstantiateCoSimulation) X(FreeInstance) X(SetDebugLogging) X(EnterInitializationMode) X(ExitInitializationMode)   \
    X(EnterEventMode) X(EnterStepMode) X(UpdateDiscreteStates) X(EvaluateDiscreteStates) X(EnterConfigurationMode)       \
    X(ExitConfigurationMode) X(Terminate) X(Reset) X(DoStep)                                                             \
    X(GetFloat32) X(GetFloat64) X(GetInt8) X(GetUInt8) X(GetInt16) X(GetUInt16) X(GetInt32) X(GetUInt32) X(GetInt64)     \
    X(GetUInt64) X(GetBoolean) X(GetString) X(GetBinary) X(GetClock)                                                     \
    X(SetFloat32) X(SetFloat64) X(SetInt8) X(SetUInt8) X(SetInt16) X(SetUInt16) X(SetInt32) X(SetUInt32) X(SetInt64)     \
    X(SetUInt64) X(SetBoolean) X(SetString) X(SetBinary) X(SetClock)                                                     \
    X(GetIntervalDecimal) X(GetIntervalFraction) X(GetShiftDecimal) X(GetShiftFraction)                                  \
    X(SetIntervalDecimal) X(SetIntervalFraction) X(SetShiftDecimal) X(SetShiftFraction)                                  \
    X(GetFMUState) X(SetFMUState) X(FreeFMUState) X(SerializedFMUStateSize) X(SerializeFMUState) X(DeserializeFMUState)
#define X(name) fmi3##name##TYPE *name;
    INNER_FUNCTIONS(X)
#undef X
    fmi3Instance component;
    bool tolerance_defined, stop_defined, event_mode;
    double tolerance, start, stop;
    uint64_t scratch[WIRED_LARGEST]; /* an array variable on its way to or from one element */
#endif
} Inner;

struct Wrapper {
    State state;
    Inner inner;
    char *name;
    bool no_rollback; /* what the host promises of this step: no state of before it will be set again */
#if OUTER_FMI == 2
    const fmi2CallbackFunctions *callbacks;
    double last_time;
    bool terminated;
#else
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback callback;
    bool early_return;
#endif
};

/* wrapper.c: life. NULL where the solver cannot be had, which is logged. resources: of the wrapped FMU, a path or NULL. */
Wrapper *wrapper_new(Wrapper *blank, const char *name, const char *resources, bool visible, bool logging, bool event_mode, bool early_return);
void wrapper_free(Wrapper *self);
Status wrapper_reset(Wrapper *self);
Status wrapper_started(Wrapper *self, double time);
/* Says a line to the host's logger and returns the status. */
#if defined(__GNUC__)
__attribute__((format(printf, 3, 4)))
#endif
Status wrapper_log(Wrapper *self, Status status, const char *format, ...);
/* outer_fmi*.c: how the host is spoken to. */
void host_log(Wrapper *self, Status status, const char *category, const char *message);

/* sampling.c */
Status sampling_step(Wrapper *self, double time, double size, bool may_return_early, Outcome *outcome);
/* The solver's outputs at the time that has been reached, and what the corrector says to them. */
Status sampling_row(Wrapper *self);
Status sampling_sample(Wrapper *self); /* the same, and what a corrector with a state remembers of it */
Status sampling_correction(Wrapper *self);

/* coupling.c: from `begin` to `begin + size` with the effects in the loop, never beyond a sample; or `whole`, with none. */
Status coupling_advance(Wrapper *self, double begin, double size, bool whole, Outcome *outcome);
double coupling_parts(double size); /* into how many sub-steps it divides that */

/* variables.c: what the host does not get from the solver directly. */
size_t solver_run(const uint32_t references[], size_t n); /* how many of the first ones go straight to the solver */
size_t variable_size(uint32_t reference);
/* element: of an array, row-major; 0 of any other. */
Status variable_get(Wrapper *self, uint32_t reference, size_t element, Class class, Value *value);
Status variable_set(Wrapper *self, uint32_t reference, size_t element, const Value *value);
void variables_touched(Wrapper *self); /* the host has set a variable of the solver */
void variables_jumped(Wrapper *self);  /* the solver has been in another mode */

/* inner_fmi*.c */
Status inner_open(Wrapper *self, const char *library); /* NULL where it is linked */
/* resources: the solver's own, NULL where there are none */
Status inner_instantiate(Wrapper *self, const char *resources, bool visible, bool logging, bool event_mode, bool early_return);
void inner_close(Wrapper *self);
Status inner_setup(Wrapper *self, bool tolerance_defined, double tolerance, double start, bool stop_defined, double stop);
Status inner_enter_initialisation(Wrapper *self);
Status inner_exit_initialisation(Wrapper *self);
Status inner_terminate(Wrapper *self);
Status inner_reset(Wrapper *self);
Status inner_debug_logging(Wrapper *self, bool on, size_t n, const char *const categories[]);
Status inner_step(Wrapper *self, double time, double size, Outcome *outcome);
Status inner_events(Wrapper *self, Outcome *outcome); /* handles events on its own, where the host may not */
Status inner_get(Wrapper *self, const Wired *variable, Value *value);
Status inner_set(Wrapper *self, const Wired *variable, const Value *value);
Status inner_numbers(Wrapper *self, const Wired variables[], size_t n, double values[]);
Status inner_state_get(Wrapper *self, void **state);
Status inner_state_set(Wrapper *self, void *state);
Status inner_state_free(Wrapper *self, void **state);
Status inner_state_size(Wrapper *self, void *state, size_t *size);
Status inner_state_write(Wrapper *self, void *state, char bytes[], size_t size);
Status inner_state_read(Wrapper *self, const char bytes[], size_t size, void **state);

/* state.c: the host's FMU states. */
Status state_get(Wrapper *self, void **state);
Status state_set(Wrapper *self, void *state);
Status state_free(Wrapper *self, void **state);
Status state_size(Wrapper *self, void *state, size_t *size);
Status state_write(Wrapper *self, void *state, char bytes[], size_t size);
Status state_read(Wrapper *self, const char bytes[], size_t size, void **state);

#endif
