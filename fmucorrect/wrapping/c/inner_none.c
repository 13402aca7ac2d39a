/* No solver: the channels are inputs, and the FMU is the network alone. */
#include "wrapper.h"

void inner_close(Wrapper *self) { }

Status inner_setup(Wrapper *self, bool tolerance_defined, double tolerance, double start, bool stop_defined, double stop)
{
    return STATUS_OK;
}

Status inner_enter_initialisation(Wrapper *self) { return STATUS_OK; }
Status inner_exit_initialisation(Wrapper *self) { return STATUS_OK; }
Status inner_terminate(Wrapper *self) { return STATUS_OK; }

Status inner_reset(Wrapper *self) { return STATUS_OK; } /* the inputs lie in the wrapper's own state */

Status inner_debug_logging(Wrapper *self, bool on, size_t n, const char *const categories[])
{
    return STATUS_OK;
}

Status inner_step(Wrapper *self, double time, double size, Outcome *outcome)
{
    outcome->last = time + size;
    return STATUS_OK;
}

Status inner_events(Wrapper *self, Outcome *outcome) { return STATUS_OK; }

Status inner_get(Wrapper *self, const Wired *variable, Value *value)
{
    value->number = self->state.inputs[variable->reference];
    return STATUS_OK;
}

Status inner_set(Wrapper *self, const Wired *variable, const Value *value)
{
    self->state.inputs[variable->reference] = value->number;
    return STATUS_OK;
}

Status inner_numbers(Wrapper *self, const Wired variables[], size_t n, double values[])
{
    for (size_t i = 0; i < n; i++)
        values[i] = self->state.inputs[variables[i].reference];
    return STATUS_OK;
}

/* Nothing beside the wrapper's own state. */
Status inner_state_get(Wrapper *self, void **state) { return STATUS_OK; }
Status inner_state_set(Wrapper *self, void *state) { return STATUS_OK; }
Status inner_state_free(Wrapper *self, void **state) { return STATUS_OK; }
Status inner_state_size(Wrapper *self, void *state, size_t *size) { return *size = 0, STATUS_OK; }

Status inner_state_write(Wrapper *self, void *state, char bytes[], size_t size)
{
    return STATUS_OK;
}

Status inner_state_read(Wrapper *self, const char bytes[], size_t size, void **state)
{
    *state = NULL;
    return STATUS_OK;
}
