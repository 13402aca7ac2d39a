/* A solver that does what it should not. WHERE and WHAT are given to the compiler; see archives.py. FMI 2.0, one output `y`
 * (value reference 0) that is the time. */
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { CONSTRUCTOR, INSTANTIATE, INITIALISE, STEP, GET, FREE, DESTRUCTOR, NOWHERE };
enum { CRASH, LEAVE, ABORT, LOOP, MEMORY, TALK, SLEEP, FAIL, OVERFLOW };

static volatile double sink;
static void evil(int where)
{
    if (where != WHERE)
        return;
    switch (WHAT) {
    case CRASH: *(volatile int *)0 = 1; break;
    case LEAVE: exit(0);
    case ABORT: abort();
    case LOOP: for (;;) sink += 1.0;
    case MEMORY: for (;;) memset(malloc(1 << 24), 1, 1 << 24);
    case TALK: for (int i = 0; i < 20000; i++) printf("the solver says that all is well, and says it again \033[31m\n"); fflush(stdout); break;
    case SLEEP: for (;;) pause();
    case OVERFLOW: { volatile char here[1 << 16]; here[0] = (char)where; evil(where); here[1] = here[0]; } break;
    }
}
#define EVIL(where) evil(where); if (WHAT == FAIL && WHERE == (where)) return 3

__attribute__((constructor)) static void begin(void) { evil(CONSTRUCTOR); }
__attribute__((destructor)) static void end(void) { evil(DESTRUCTOR); }

static double now;
void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks, int visible, int logging)
{
    evil(INSTANTIATE);
    return WHAT == FAIL && WHERE == INSTANTIATE ? NULL : &now;
}
void fmi2FreeInstance(void *self) { evil(FREE); }
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
int fmi2SetDebugLogging(void *self, int on, size_t n, const char *const categories[]) { return 0; }
int fmi2SetupExperiment(void *self, int tolerance, double value, double start, int stop, double end) { now = start; return 0; }
int fmi2EnterInitializationMode(void *self) { EVIL(INITIALISE); return 0; }
int fmi2ExitInitializationMode(void *self) { return 0; }
int fmi2Terminate(void *self) { return 0; }
int fmi2Reset(void *self) { return 0; }
int fmi2DoStep(void *self, double t, double h, int no_set_state)
{
    if (t > 0.0095) { EVIL(STEP); }
    now = t + h;
    return 0;
}
int fmi2GetReal(void *self, const unsigned vr[], size_t n, double values[])
{
    if (now > 0.0095) { EVIL(GET); }
    for (size_t i = 0; i < n; i++)
        values[i] = now;
    return 0;
}
int fmi2SetReal(void *self, const unsigned vr[], size_t n, const double values[]) { return 0; }
int fmi2GetInteger(void *self, const unsigned vr[], size_t n, int values[]) { return 0; }
int fmi2SetInteger(void *self, const unsigned vr[], size_t n, const int values[]) { return 0; }
int fmi2GetBoolean(void *self, const unsigned vr[], size_t n, int values[]) { return 0; }
int fmi2SetBoolean(void *self, const unsigned vr[], size_t n, const int values[]) { return 0; }
