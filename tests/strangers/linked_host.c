/* A program that two FMUs are linked into, as on a real-time target: it loads nothing. Compiled with -DFMI=2 or 3, -DFIRST and
 * -DSECOND, the prefixes of their functions.
 *
 *   linked_host COUNT TOKEN REFERENCE TOKEN REFERENCE   prints the values of both after every step of 1 ms, as %a */
#include <stdio.h>
#include <stdlib.h>

#if FMI == 2
#include "fmi2FunctionTypes.h"
#else
#include "fmi3FunctionTypes.h"
#endif

#define PASTE(a, b) a##b
#define NAME(prefix, name) PASTE(prefix, name)
#define SIZE 1e-3

static void check(int status, const char *what)
{
    if (status > 1) {
        fprintf(stderr, "linked_host: %s: %d\n", what, status);
        exit(1);
    }
}

typedef struct {
    void *instance;
    unsigned reference;
} Part;

#if FMI == 2
static void say(void *environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...)
{
    (void)environment;
    fprintf(stderr, "%s: status %d, %s: %s\n", name, (int)status, category, message);
}
static const fmi2CallbackFunctions callbacks = {say, calloc, free, NULL, NULL};

#define PART(which, prefix)                                                                                              \
    fmi2InstantiateTYPE NAME(prefix, fmi2Instantiate);                                                                   \
    fmi2SetupExperimentTYPE NAME(prefix, fmi2SetupExperiment);                                                           \
    fmi2EnterInitializationModeTYPE NAME(prefix, fmi2EnterInitializationMode);                                           \
    fmi2ExitInitializationModeTYPE NAME(prefix, fmi2ExitInitializationMode);                                             \
    fmi2DoStepTYPE NAME(prefix, fmi2DoStep);                                                                             \
    fmi2GetRealTYPE NAME(prefix, fmi2GetReal);                                                                           \
    fmi2FreeInstanceTYPE NAME(prefix, fmi2FreeInstance);                                                                 \
    static void which##_begin(Part *part, const char *token, const char *reference)                                      \
    {                                                                                                                    \
        part->instance = NAME(prefix, fmi2Instantiate)(#which, fmi2CoSimulation, token, NULL, &callbacks, 0, 0);         \
        part->reference = (unsigned)strtoul(reference, NULL, 10);                                                        \
        check(part->instance ? 0 : 3, #which);                                                                           \
        check(NAME(prefix, fmi2SetupExperiment)(part->instance, 0, 0.0, 0.0, 0, 0.0), #which);                           \
        check(NAME(prefix, fmi2EnterInitializationMode)(part->instance), #which);                                        \
        check(NAME(prefix, fmi2ExitInitializationMode)(part->instance), #which);                                         \
    }                                                                                                                    \
    static double which##_step(Part *part, long k)                                                                       \
    {                                                                                                                    \
        double value = 0.0;                                                                                              \
        check(NAME(prefix, fmi2DoStep)(part->instance, (double)k * SIZE, SIZE, 1), #which);                              \
        check(NAME(prefix, fmi2GetReal)(part->instance, &part->reference, 1, &value), #which);                           \
        return value;                                                                                                    \
    }                                                                                                                    \
    static void which##_end(Part *part) { NAME(prefix, fmi2FreeInstance)(part->instance); }
#else
static void say(void *environment, fmi3Status status, fmi3String category, fmi3String message)
{
    (void)environment;
    fprintf(stderr, "status %d, %s: %s\n", (int)status, category, message);
}

#define PART(which, prefix)                                                                                              \
    fmi3InstantiateCoSimulationTYPE NAME(prefix, fmi3InstantiateCoSimulation);                                           \
    fmi3EnterInitializationModeTYPE NAME(prefix, fmi3EnterInitializationMode);                                           \
    fmi3ExitInitializationModeTYPE NAME(prefix, fmi3ExitInitializationMode);                                             \
    fmi3DoStepTYPE NAME(prefix, fmi3DoStep);                                                                             \
    fmi3GetFloat64TYPE NAME(prefix, fmi3GetFloat64);                                                                     \
    fmi3FreeInstanceTYPE NAME(prefix, fmi3FreeInstance);                                                                 \
    static void which##_begin(Part *part, const char *token, const char *reference)                                      \
    {                                                                                                                    \
        part->instance = NAME(prefix, fmi3InstantiateCoSimulation)(#which, token, NULL, 0, 0, 0, 0, NULL, 0, NULL, say,  \
                                                                   NULL);                                                \
        part->reference = (unsigned)strtoul(reference, NULL, 10);                                                        \
        check(part->instance ? 0 : 3, #which);                                                                           \
        check(NAME(prefix, fmi3EnterInitializationMode)(part->instance, 0, 0.0, 0.0, 0, 0.0), #which);                   \
        check(NAME(prefix, fmi3ExitInitializationMode)(part->instance), #which);                                         \
    }                                                                                                                    \
    static double which##_step(Part *part, long k)                                                                       \
    {                                                                                                                    \
        fmi3Boolean event, terminate, early;                                                                             \
        double last, value = 0.0;                                                                                        \
        check(NAME(prefix, fmi3DoStep)(part->instance, (double)k * SIZE, SIZE, 1, &event, &terminate, &early, &last), #which); \
        check(NAME(prefix, fmi3GetFloat64)(part->instance, &part->reference, 1, &value, 1), #which);                     \
        return value;                                                                                                    \
    }                                                                                                                    \
    static void which##_end(Part *part) { NAME(prefix, fmi3FreeInstance)(part->instance); }
#endif
PART(first, FIRST)
PART(second, SECOND)

int main(int argc, char **argv)
{
    Part one, two;
    if (argc != 6)
        return 2;
    first_begin(&one, argv[2], argv[3]);
    second_begin(&two, argv[4], argv[5]);
    for (long k = 0; k < atol(argv[1]); k++) {
        const double value = first_step(&one, k);
        printf("%a %a\n", value, second_step(&two, k));
    }
    first_end(&one);
    second_end(&two);
    return 0;
}
