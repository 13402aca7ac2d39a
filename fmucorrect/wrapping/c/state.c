/* FMU states: the solver's own, and the wrapper's, which is plain memory. */
#include <stdlib.h>
#include <string.h>

#include "wrapper.h"

typedef struct {
    void *inner;
    State state;
} Snapshot;

/* What serialised bytes begin with. */
typedef struct {
    char token[sizeof OUTER_TOKEN];
    uint64_t size, inner_size;
} Header;

Status state_get(Wrapper *self, void **state)
{
    Snapshot *snapshot = *state;
    if (!snapshot && !(snapshot = calloc(1, sizeof *snapshot)))
        return wrapper_log(self, STATUS_ERROR, "there is no memory for a state");
    const Status status = inner_state_get(self, &snapshot->inner);
    if (status > STATUS_WARNING) {
        if (!*state)
            free(snapshot);
        return status;
    }
    memcpy(&snapshot->state, &self->state, sizeof snapshot->state);
    *state = snapshot;
    return status;
}

Status state_set(Wrapper *self, void *state)
{
    const Snapshot *snapshot = state;
    if (!snapshot)
        return wrapper_log(self, STATUS_ERROR, "no state was given to be set");
    const Status status = inner_state_set(self, snapshot->inner);
    if (status <= STATUS_WARNING)
        memcpy(&self->state, &snapshot->state, sizeof self->state);
    return status;
}

Status state_free(Wrapper *self, void **state)
{
    Snapshot *snapshot = *state;
    if (!snapshot)
        return STATUS_OK;
    const Status status = inner_state_free(self, &snapshot->inner);
    free(snapshot);
    *state = NULL;
    return status;
}

Status state_size(Wrapper *self, void *state, size_t *size)
{
    const Snapshot *snapshot = state;
    size_t inner = 0;
    const Status status = snapshot ? inner_state_size(self, snapshot->inner, &inner) : STATUS_ERROR;
    *size = sizeof(Header) + sizeof(State) + inner;
    return status;
}

Status state_write(Wrapper *self, void *state, char bytes[], size_t size)
{
    const Snapshot *snapshot = state;
    size_t needed = 0;
    const Status status = state_size(self, state, &needed);
    if (status > STATUS_WARNING)
        return status;
    if (size < needed)
        return wrapper_log(self, STATUS_ERROR, "the state takes %zu bytes, got room for %zu", needed, size);
    Header header;
    memset(&header, 0, sizeof header);
    memcpy(header.token, OUTER_TOKEN, sizeof header.token);
    header.size = sizeof(State);
    header.inner_size = needed - sizeof header - sizeof(State);
    memcpy(bytes, &header, sizeof header);
    memcpy(bytes + sizeof header, &snapshot->state, sizeof(State));
    return inner_state_write(self, snapshot->inner, bytes + sizeof header + sizeof(State), (size_t)header.inner_size);
}

Status state_read(Wrapper *self, const char bytes[], size_t size, void **state)
{
    Header header = {0};
    if (size >= sizeof header)
        memcpy(&header, bytes, sizeof header);
    if (size < sizeof header + sizeof(State) || memcmp(header.token, OUTER_TOKEN, sizeof header.token) != 0 ||
        header.size != sizeof(State) || header.inner_size > size - sizeof header - sizeof(State))
        return wrapper_log(self, STATUS_ERROR, "these %zu bytes are no state of this FMU", size);
    Snapshot *snapshot = calloc(1, sizeof *snapshot);
    if (!snapshot)
        return wrapper_log(self, STATUS_ERROR, "there is no memory for a state");
    const Status status =
        inner_state_read(self, bytes + sizeof header + sizeof(State), (size_t)header.inner_size, &snapshot->inner);
    if (status > STATUS_WARNING) {
        free(snapshot);
        return status;
    }
    memcpy(&snapshot->state, bytes + sizeof header, sizeof(State));
    *state = snapshot;
    return status;
}
