/* Getting, setting and serialising the FMU state. */
#include <stdlib.h>
#include <string.h>

#include "instance.h"

_Static_assert(sizeof(MODEL_TOKEN) <= 40, "the token fits the serialised state");

Status instance_get_state(Instance *self, State **state)
{
    State *copy = *state ? *state : malloc(sizeof *copy);
    if (!copy)
        return instance_log(self, STATUS_ERROR, "get FMU state: no memory for %u bytes", (unsigned)sizeof *copy);
    instance_values(self); /* so that equal states have equal bytes */
    *copy = self->state;
    *state = copy;
    return STATUS_OK;
}

Status instance_set_state(Instance *self, const State *state)
{
    if (!state)
        return instance_log(self, STATUS_ERROR, "set FMU state: expected a state, got none");
    self->state = *state;
    self->stale = true;
    return instance_log(self, STATUS_OK, "FMU state of t = %.9g s restored", self->state.v[V_time]);
}

void instance_free_state(State **state)
{
    if (state) {
        free(*state);
        *state = NULL;
    }
}

Status instance_serialise(Instance *self, const State *state, unsigned char bytes[], size_t size)
{
    if (!state || size < SERIALISED_SIZE)
        return instance_log(self, STATUS_ERROR, "serialise FMU state: expected a state and %d bytes, got %s and %u", SERIALISED_SIZE,
                            state ? "one" : "none", (unsigned)size);
    const double head[2] = {(double)state->phase, state->stop_time};
    memset(bytes, 0, size);
    memcpy(bytes, MODEL_TOKEN, sizeof MODEL_TOKEN);
    memcpy(bytes + 40, head, sizeof head);
    memcpy(bytes + 40 + sizeof head, state->v, sizeof state->v);
    return STATUS_OK;
}

Status instance_deserialise(Instance *self, const unsigned char bytes[], size_t size, State **state)
{
    double head[2];
    if (size < SERIALISED_SIZE || memcmp(bytes, MODEL_TOKEN, sizeof MODEL_TOKEN))
        return instance_log(self, STATUS_ERROR, "deserialise FMU state: expected %d bytes that begin with %s, got %u: a state of another model or build",
                            SERIALISED_SIZE, MODEL_TOKEN, (unsigned)size);
    memcpy(head, bytes + 40, sizeof head);
    if (!(head[0] >= INSTANTIATED && head[0] <= TERMINATED))
        return instance_log(self, STATUS_ERROR, "deserialise FMU state: expected a phase from 0 to 3, got %g", head[0]);
    State *copy = *state ? *state : malloc(sizeof *copy);
    if (!copy)
        return instance_log(self, STATUS_ERROR, "deserialise FMU state: no memory for %u bytes", (unsigned)sizeof *copy);
    copy->phase = (Phase)head[0];
    copy->stop_time = head[1];
    memcpy(copy->v, bytes + 40 + sizeof head, sizeof copy->v);
    *state = copy;
    return STATUS_OK;
}
