/* A co-simulation host of one FMU, with nothing but the standard's headers: compiled with -DFMI=2 or -DFMI=3.
 *
 *   host LIBRARY RESOURCES TOKEN run      STEP COUNT REFERENCE...   prints a line of values after every step, as %a
 *   host LIBRARY RESOURCES TOKEN rollback STEP COUNT REFERENCE...   two instances; state, serialised state, reset: all to the bit
 *   host LIBRARY RESOURCES TOKEN driven   STEP COUNT INPUT SWITCH REFERENCE...   the same as run, with INPUT set and read nowhere,
 *       SWITCH (or "-") false from the start, the flag of no state to come back to in turn; `coarse`: on a clock of single precision
 *   host LIBRARY RESOURCES TOKEN early    STEP COUNT INPUT SWITCH REFERENCE...   INPUT is a time at which the FMU stops or ends, set into
 *       every third step; the host goes on from where it was told to be. A line after every doStep: 1 if it fell short, 1 if the FMU
 *       wants to end, the time reached, values
 *   host LIBRARY RESOURCES TOKEN time     STEP COUNT REFERENCE...   prints microseconds a step (doStep and reading), best of five */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#if FMI == 2
#include "fmi2FunctionTypes.h"
#define F(name) fmi2##name##TYPE *name
#define NAME(name) "fmi2" #name
typedef fmi2Component Component;
typedef fmi2ValueReference Reference;
typedef fmi2FMUstate StateHandle;
#else
#include "fmi3FunctionTypes.h"
#define F(name) fmi3##name##TYPE *name
#define NAME(name) "fmi3" #name
typedef fmi3Instance Component;
typedef fmi3ValueReference Reference;
typedef fmi3FMUState StateHandle;
#endif

#ifdef _WIN32
#include <windows.h>

#include <shellapi.h>
#define SYMBOL(library, name) (void *)GetProcAddress((HMODULE)(library), name)
#else
#include <dlfcn.h>
#define SYMBOL(library, name) dlsym(library, name)
#endif

#define LARGEST 64
static struct {
#if FMI == 2
    F(Instantiate);
    F(SetupExperiment);
    F(GetReal);
    F(SetReal);
    F(SetBoolean);
    F(GetFMUstate);
    F(SetFMUstate);
    F(FreeFMUstate);
    F(SerializedFMUstateSize);
    F(SerializeFMUstate);
    F(DeSerializeFMUstate);
    F(GetRealStatus);
    F(GetBooleanStatus);
#else
    F(InstantiateCoSimulation);
    F(GetFloat64);
    F(SetFloat64);
    F(SetBoolean);
    F(GetFMUState);
    F(SetFMUState);
    F(FreeFMUState);
    F(SerializedFMUStateSize);
    F(SerializeFMUState);
    F(DeserializeFMUState);
#endif
    F(EnterInitializationMode);
    F(ExitInitializationMode);
    F(DoStep);
    F(Reset);
    F(Terminate);
    F(FreeInstance);
} fmu;

static Reference references[LARGEST];
static size_t count;
static const char *token, *resources;

static void die(const char *what)
{
    fprintf(stderr, "host: %s\n", what);
    exit(1);
}

static void check(int status, const char *what)
{
    if (status > 1)
        die(what);
}

static void find(void *library)
{
#define GET(name)                                                                                                        \
    {                                                                                                                    \
        void *address = SYMBOL(library, NAME(name));                                                                     \
        if (!address)                                                                                                    \
            die("no function " NAME(name));                                                                              \
        memcpy(&fmu.name, &address, sizeof address);                                                                     \
    }
#if FMI == 2
    GET(Instantiate) GET(SetupExperiment) GET(GetReal) GET(SetReal) GET(SetBoolean) GET(GetFMUstate) GET(SetFMUstate) GET(FreeFMUstate)
    GET(SerializedFMUstateSize) GET(SerializeFMUstate) GET(DeSerializeFMUstate)
    GET(GetRealStatus) GET(GetBooleanStatus)
#else
    GET(InstantiateCoSimulation) GET(GetFloat64) GET(SetFloat64) GET(SetBoolean) GET(GetFMUState) GET(SetFMUState) GET(FreeFMUState)
    GET(SerializedFMUStateSize) GET(SerializeFMUState) GET(DeserializeFMUState)
#endif
    GET(EnterInitializationMode) GET(ExitInitializationMode) GET(DoStep) GET(Reset) GET(Terminate) GET(FreeInstance)
}

#if FMI == 2
static void logger(void *environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...)
{
    fprintf(stderr, "%s: status %d, %s: %s\n", name, (int)status, category, message);
}
static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
#else
static void logger(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message)
{
    fprintf(stderr, "status %d, %s: %s\n", (int)status, category, message);
}
#endif

static void start(Component c)
{
#if FMI == 2
    check(fmu.SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0), "SetupExperiment");
    check(fmu.EnterInitializationMode(c), "EnterInitializationMode");
#else
    check(fmu.EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0), "EnterInitializationMode");
#endif
    check(fmu.ExitInitializationMode(c), "ExitInitializationMode");
}

static Component begin(bool early)
{
#if FMI == 2
    (void)early;
    Component c = fmu.Instantiate("host", fmi2CoSimulation, token, resources, &callbacks, 0, 0);
#else
    Component c = fmu.InstantiateCoSimulation("host", token, resources, 0, 0, 0, early, NULL, 0, NULL, logger, NULL);
#endif
    if (!c)
        die("the FMU refused to be instantiated");
    start(c);
    return c;
}

static void switch_off(Component c, Reference reference)
{
#if FMI == 2
    const fmi2Boolean off = fmi2False;
    check(fmu.SetBoolean(c, &reference, 1, &off), "SetBoolean");
#else
    const fmi3Boolean off = false;
    check(fmu.SetBoolean(c, &reference, 1, &off, 1), "SetBoolean");
#endif
}

static void set(Component c, Reference reference, double value)
{
#if FMI == 2
    check(fmu.SetReal(c, &reference, 1, &value), "SetReal");
#else
    check(fmu.SetFloat64(c, &reference, 1, &value, 1), "SetFloat64");
#endif
}

static void step_at(Component c, double time, double size, int no_set_state, double values[])
{
#if FMI == 2
    check(fmu.DoStep(c, time, size, no_set_state), "DoStep");
    check(fmu.GetReal(c, references, count, values), "GetReal");
#else
    fmi3Boolean event, terminate, early;
    fmi3Float64 last;
    check(fmu.DoStep(c, time, size, no_set_state, &event, &terminate, &early, &last), "DoStep");
    check(fmu.GetFloat64(c, references, count, values, count), "GetFloat64");
#endif
}

typedef struct {
    bool short_of_it, ends;
    double reached;
} Answer;

static Answer try_step(Component c, double time, double size)
{
    Answer answer = {false, false, time + size};
#if FMI == 2
    const int status = fmu.DoStep(c, time, size, 1);
    answer.short_of_it = status == fmi2Discard;
    if (answer.short_of_it) {
        fmi2Boolean ends;
        check(fmu.GetRealStatus(c, fmi2LastSuccessfulTime, &answer.reached), "GetRealStatus");
        check(fmu.GetBooleanStatus(c, fmi2Terminated, &ends), "GetBooleanStatus");
        answer.ends = ends;
    } else
        check(status, "DoStep");
#else
    fmi3Boolean event;
    check(fmu.DoStep(c, time, size, 1, &event, &answer.ends, &answer.short_of_it, &answer.reached), "DoStep");
#endif
    return answer;
}

static void early(Component c, Reference stop, double size, long steps)
{
    double time = 0.0, values[LARGEST];
    for (long k = 0; k < steps; k++) {
        if (k % 3 == 1)
            set(c, stop, ((double)k + 0.4) * size);
        for (const double end = (double)(k + 1) * size; time < end - 1e-9;) {
            const Answer answer = try_step(c, time, end - time);
#if FMI == 2
            check(fmu.GetReal(c, references, count, values), "GetReal");
#else
            check(fmu.GetFloat64(c, references, count, values, count), "GetFloat64");
#endif
            printf("%d %d %a", answer.short_of_it, answer.ends, answer.reached);
            for (size_t i = 0; i < count; i++)
                printf(" %a", values[i]);
            puts("");
            if (answer.ends)
                return;
            time = answer.reached;
        }
    }
}

static void step(Component c, long k, double size, double values[]) { step_at(c, (double)k * size, size, 1, values); }

/* Steps `from` to `to`, all values one after another. */
static double *walk(Component c, long from, long to, double size)
{
    double *values = malloc(((size_t)(to - from) * count + 1) * sizeof *values);
    for (long k = from; k < to; k++)
        step(c, k, size, values + (size_t)(k - from) * count);
    return values;
}

static void same(double *a, double *b, long rows, const char *what)
{
    if (memcmp(a, b, (size_t)rows * count * sizeof *a) != 0)
        die(what);
    free(b);
}

#if FMI == 2
#define GET_STATE fmu.GetFMUstate
#define SET_STATE fmu.SetFMUstate
#define FREE_STATE fmu.FreeFMUstate
#define SIZE fmu.SerializedFMUstateSize
#define WRITE fmu.SerializeFMUstate
#define READ fmu.DeSerializeFMUstate
#else
#define GET_STATE fmu.GetFMUState
#define SET_STATE fmu.SetFMUState
#define FREE_STATE fmu.FreeFMUState
#define SIZE fmu.SerializedFMUStateSize
#define WRITE fmu.SerializeFMUState
#define READ fmu.DeserializeFMUState
#endif

static void rollback(double size, long steps)
{
    const long half = steps / 2;
    Component c = begin(false), other = begin(false);
    StateHandle state = NULL, read = NULL;
    size_t bytes = 0;
    double *whole = walk(c, 0, half, size);
    check(GET_STATE(c, &state), "get state");
    double *rest = walk(c, half, steps, size);
    check(SET_STATE(c, state), "set state");
    same(rest, walk(c, half, steps, size), steps - half, "rolled back, it went another way");
    check(SIZE(c, state, &bytes), "size of the state");
    void *content = malloc(bytes);
    check(WRITE(c, state, content, bytes), "serialise");
    same(whole, walk(other, 0, half, size), half, "a second instance went another way");
    check(READ(other, content, bytes, &read), "deserialise");
    check(SET_STATE(other, read), "set the deserialised state");
    same(rest, walk(other, half, steps, size), steps - half, "from the serialised state it went another way");
    check(GET_STATE(c, &state), "get state into an old one");
    check(FREE_STATE(c, &state), "free state");
    check(FREE_STATE(other, &read), "free the deserialised state");
    check(fmu.Terminate(c), "terminate");
    check(fmu.Reset(c), "reset");
    start(c);
    same(whole, walk(c, 0, half, size), half, "after reset it went another way");
    free(content);
    free(whole);
    free(rest);
    fmu.FreeInstance(c);
    fmu.FreeInstance(other);
    puts("same");
}

#ifdef _WIN32
/* Arguments in UTF-8, whatever the code page. */
static char **utf8(int *argc)
{
    wchar_t **wide = CommandLineToArgvW(GetCommandLineW(), argc);
    char **narrow = calloc((size_t)*argc + 1, sizeof *narrow);
    for (int i = 0; i < *argc; i++) {
        const int size = WideCharToMultiByte(CP_UTF8, 0, wide[i], -1, NULL, 0, NULL, NULL);
        narrow[i] = malloc((size_t)size);
        WideCharToMultiByte(CP_UTF8, 0, wide[i], -1, narrow[i], size, NULL, NULL);
    }
    return narrow;
}

static void *load(const char *path)
{
    wchar_t wide[4096];
    return MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, 4096) ? (void *)LoadLibraryW(wide) : NULL;
}
#else
static void *load(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
#endif

static double seconds(void)
{
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

int main(int argc, char **argv)
{
#ifdef _WIN32
    argv = utf8(&argc);
#endif
    if (argc < 7)
        die("too few arguments");
    void *library = load(argv[1]);
    if (!library)
        die("the library cannot be loaded");
    find(library);
    resources = argv[2];
    token = argv[3];
    const double size = atof(argv[5]);
    const long steps = atol(argv[6]);
    const bool coarse = strcmp(argv[4], "coarse") == 0, stopped = strcmp(argv[4], "early") == 0;
    const bool driven = coarse || stopped || strcmp(argv[4], "driven") == 0;
    for (int i = driven ? 9 : 7; i < argc && count < LARGEST; i++)
        references[count++] = (Reference)strtoul(argv[i], NULL, 10);
    if (strcmp(argv[4], "rollback") == 0) {
        rollback(size, steps);
    } else if (strcmp(argv[4], "time") == 0) {
        double best = 1e9, values[LARGEST];
        for (int round = 0; round < 5; round++) {
            Component c = begin(false);
            const double before = seconds();
            for (long k = 0; k < steps; k++)
                step(c, k, size, values);
            const double took = (seconds() - before) / (double)steps;
            best = took < best ? took : best;
            fmu.FreeInstance(c);
        }
        printf("%.6f\n", 1e6 * best);
    } else {
        Component c = begin(stopped);
        double values[LARGEST];
        float time = 0.0f;
        if (driven && strcmp(argv[8], "-") != 0)
            switch_off(c, (Reference)strtoul(argv[8], NULL, 10));
        if (stopped)
            early(c, (Reference)strtoul(argv[7], NULL, 10), size, steps);
        for (long k = 0; k < steps && !stopped; k++, time += (float)size) {
            if (driven)
                set(c, (Reference)strtoul(argv[7], NULL, 10), (double)(k * 7919 % 13) - 6.0);
            step_at(c, coarse ? time : (double)k * size, coarse ? (float)size : size, driven ? (int)(k % 2) : 1, values);
            for (size_t i = 0; i < count; i++)
                printf(i + 1 < count ? "%a " : "%a\n", values[i]);
        }
        check(fmu.Terminate(c), "terminate");
        fmu.FreeInstance(c);
    }
    return 0;
}
