/* An FMU for FMI 2.0 and 3.0 that does something terrible at one moment: the environment's HOSTILE, "DO_STEP CRASH", says both.
 * One output y (value reference 1) = time, one input u (0). */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    double u, y;
} Instance;

static volatile int never;
static char *volatile kept;

static void trouble(const char *where)
{
    const char *order = getenv("HOSTILE");
    const size_t length = strlen(where);
    if (!order || strncmp(order, where, length) || order[length] != ' ')
        return;
    const char *what = order + length + 1;
    if (!strcmp(what, "CRASH"))
        *(volatile int *)8 = 1;
    if (!strcmp(what, "ABORT"))
        abort();
    if (!strcmp(what, "EXIT"))
        exit(0);
    while (!strcmp(what, "LOOP") && !never)
        ;
    for (size_t size = 64 << 20; !strcmp(what, "ALLOCATE");)
        memset(kept = malloc(size), 1, size);
    if (!strcmp(what, "PRINT")) {
        printf("{\"answer\": null}\nhello from the solver\n");
        fflush(stdout);
        fprintf(stderr, "and a complaint\n");
    }
}

__attribute__((constructor)) static void loaded(void) { trouble("CONSTRUCTOR"); }

static void *instantiate(void)
{
    trouble("INSTANTIATE");
    return calloc(1, sizeof(Instance));
}
static int initialised(void)
{
    trouble("INITIALISE");
    return 0;
}
static int step(Instance *self, double t, double h)
{
    self->y = t + h;
    if (t + h > 0.5 - 1e-9)
        trouble("DO_STEP");
    return 0;
}
static int get(Instance *self, const unsigned reference[], size_t n, double value[])
{
    if (self->y > 0.5 - 1e-9)
        trouble("GET_REAL");
    for (size_t i = 0; i < n; i++)
        value[i] = reference[i] ? self->y : self->u;
    return 0;
}
static int set(Instance *self, const double value[])
{
    self->u = value[0];
    return 0;
}
static void release(Instance *self)
{
    trouble("FREE");
    free(self);
}

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks, int visible, int logging) { return instantiate(); }
void fmi2FreeInstance(void *self) { release(self); }
int fmi2SetupExperiment(void *self, int tolerance, double value, double start, int stop, double end) { return 0; }
int fmi2EnterInitializationMode(void *self) { return 0; }
int fmi2ExitInitializationMode(void *self) { return initialised(); }
int fmi2Terminate(void *self) { return 0; }
int fmi2DoStep(void *self, double t, double h, int no_set_state) { return step(self, t, h); }
int fmi2GetReal(void *self, const unsigned vr[], size_t n, double values[]) { return get(self, vr, n, values); }
int fmi2SetReal(void *self, const unsigned vr[], size_t n, const double values[]) { return set(self, values); }

void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging, bool event, bool early,
                                  const unsigned required[], size_t n, void *environment, void *log, void *update)
{
    return instantiate();
}
void fmi3FreeInstance(void *self) { release(self); }
int fmi3EnterInitializationMode(void *self, bool tolerance, double value, double start, bool stop, double end) { return 0; }
int fmi3ExitInitializationMode(void *self) { return initialised(); }
int fmi3Terminate(void *self) { return 0; }
int fmi3DoStep(void *self, double t, double h, bool no_set_state, bool *event, bool *terminate, bool *early, double *last)
{
    *event = *terminate = *early = false;
    *last = t + h;
    return step(self, t, h);
}
int fmi3GetFloat64(void *self, const unsigned vr[], size_t n, double values[], size_t count) { return get(self, vr, n, values); }
int fmi3SetFloat64(void *self, const unsigned vr[], size_t n, const double values[], size_t count) { return set(self, values); }
