/* Life of an instance: the solver's FMU is found, opened and started; see wrapper.h. */
#include "wrapper.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "effects.h"
#include "paths.h"
#include "platform.h"

Status wrapper_log(Wrapper *self, Status status, const char *format, ...)
{
    char message[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    host_log(self, status, "fmucorrect", message);
    return status;
}

/* Everything that the wrapper keeps, as before initialisation; the solver gets the start values that the wrapper knows better. */
static Status start_over(Wrapper *self)
{
    State *s = &self->state;
    memset(s, 0, sizeof *s);
    s->enabled = s->effects_enabled = s->row_stale = s->row_due = s->joints_due = s->stale = true;
    s->status = WARMUP;
    memcpy(s->conditions, TUNABLES, sizeof s->conditions);
    memcpy(s->host_force, FORCE_STARTS, sizeof s->host_force);
    effects_start(s->states);
    for (size_t i = 0; i != STARTS; i++) {
        const Start *start = &START_VALUES[i];
        const Value value = {NUMBER, start->value, fabs(start->value) < 9e18 ? (int64_t)start->value : 0, NULL};
        const Status status = inner_set(self, &start->variable, &value);
        if (status > STATUS_WARNING)
            return wrapper_log(self, status, "the solver's FMU refuses the start value %g of its variable %u", start->value,
                               (unsigned)start->variable.reference);
    }
    return STATUS_OK;
}

#if INNER_FMI && LINKED
/* The solver is in this program, its resources are where the host says, if they are anywhere. */
static Status open_solver(Wrapper *self, const char *resources, bool visible, bool logging, bool event_mode, bool early_return)
{
    char *folder = resources ? path_of_uri(resources) : NULL;
    char *inner_resources = folder ? path_join(folder, "solver", "resources", NULL) : NULL;
    Status status = resources && !inner_resources ? STATUS_ERROR : inner_open(self, NULL);
    if (status == STATUS_OK)
        status = inner_instantiate(self, inner_resources, visible, logging, event_mode, early_return);
    free(folder);
    free(inner_resources);
    return status;
}
#elif INNER_FMI
/* resources/solver holds the solver's FMU, unpacked. */
static Status open_solver(Wrapper *self, const char *resources, bool visible, bool logging, bool event_mode, bool early_return)
{
    Status status = STATUS_ERROR;
    char *name = malloc(strlen(INNER_LIBRARY) + strlen(platform_suffix()) + 1);
    char *folder = NULL, *library = NULL, *inner_resources = NULL;
    if (name) {
        strcat(strcpy(name, INNER_LIBRARY), platform_suffix());
        char *places[] = {resources ? path_of_uri(resources) : NULL, own_resources()};
        for (size_t i = 0; i < 2 && !library; i++) { /* where the host says, or else beside this library */
            if (!places[i])
                continue;
            folder = path_join(places[i], "solver", NULL);
            library = folder ? path_join(folder, "binaries", platform_folder(INNER_FMI), name, NULL) : NULL;
            if (library && !file_exists(library) && i == 0) {
                free(folder);
                free(library);
                folder = library = NULL;
            }
        }
        free(places[0]);
        free(places[1]);
    }
    if (!library)
        wrapper_log(self, STATUS_ERROR, "the folder resources/solver was not found; the host says resources are in %s",
                    resources ? resources : "(nothing)");
    else if (!file_exists(library))
        wrapper_log(self, STATUS_ERROR, "the solver's library is missing: expected %s. Wrap the solver again for this platform.", library);
    else if ((status = inner_open(self, library)) == STATUS_OK) {
        inner_resources = path_join(folder, "resources", NULL);
        status = inner_resources ? inner_instantiate(self, inner_resources, visible, logging, event_mode, early_return) : STATUS_ERROR;
    }
    free(name);
    free(folder);
    free(library);
    free(inner_resources);
    return status;
}
#endif

Wrapper *wrapper_new(Wrapper *blank, const char *name, const char *resources, bool visible, bool logging, bool event_mode, bool early_return)
{
    Wrapper *self = malloc(sizeof *self);
    if (!self) {
        wrapper_log(blank, STATUS_ERROR, "there is no memory for an instance");
        return NULL;
    }
    *self = *blank;
    self->name = malloc(strlen(name ? name : "") + 1);
    if (self->name)
        strcpy(self->name, name ? name : "");
#if INNER_FMI
    Status status = open_solver(self, resources, visible, logging, event_mode, early_return);
#else
    Status status = STATUS_OK;
#endif
    if (status <= STATUS_WARNING)
        status = start_over(self);
    if (status > STATUS_WARNING || !self->name) {
        wrapper_free(self);
        return NULL;
    }
    return self;
}

void wrapper_free(Wrapper *self)
{
    if (!self)
        return;
    inner_close(self);
    free(self->name);
    free(self);
}

Status wrapper_reset(Wrapper *self)
{
    const Status status = inner_reset(self);
    if (status > STATUS_WARNING)
        return status;
    const Status again = start_over(self);
    return again > status ? again : status;
}

#if TRAINED_COUNT
/* Whether the solver's parameters are those of training, each one that is not by name. What it does not let be read is not known. */
static void compare_with_training(Wrapper *self)
{
    self->state.unlike = false;
    for (size_t i = 0; i != TRAINED_COUNT; i++) {
        const Trained *trained = &TRAINED[i];
        double value;
        if (inner_numbers(self, &trained->variable, 1, &value) > STATUS_WARNING || (trained->low <= value && value <= trained->high))
            continue;
        self->state.unlike = true;
        wrapper_log(self, STATUS_WARNING, "nothing is corrected, and the status is outside: %s is %g, the corrector was trained with %s",
                    trained->name, value, trained->was);
    }
}
#endif

/* Initialisation has ended at `time`: here is the first sample, which is read before inputs are set for the first step. */
Status wrapper_started(Wrapper *self, double time)
{
    State *s = &self->state;
    if (!(fabs(time) < 4e9)) /* LONGEST of sampling.c */
        return wrapper_log(self, STATUS_ERROR, "the start time %g s is too far from 0", time);
    s->started = s->on_grid = s->row_stale = s->row_due = s->stale = true;
    s->now = s->host = time;
    s->now_ns = s->sample_ns = llround(time * 1e9);
#if TRAINED_COUNT
    compare_with_training(self);
#endif
    return s->enabled && !CHANNELS_FED ? sampling_sample(self) : STATUS_OK;
}
