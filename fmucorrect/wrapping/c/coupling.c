/* Effects in the loop: forces that the model lacks, fed back into the solver's force inputs.
 *
 * A piece of a step is divided into sub-steps of at most COUPLING s. Each begins by reading the joints; a law then sees the
 * displacement that half a sub-step later will be (d + v h / 2), and its force is held in the solver over the sub-step, so that a
 * stiffness gains no negative damping from being held. The coupling is of first order in the sub-step. */
#include <math.h>

#include "wrapper.h"
#include "effects.h"

#if EFFECTS
static Status apply_forces(Wrapper *self, double time, double size)
{
    State *s = &self->state;
    double ports[EFFECTS][4] = {{0.0}}, forces[EFFECTS] = {0.0}, total[FORCES + 1] = {0.0};
    for (size_t i = 0; i < EFFECTS; i++) {
        const Place *place = &PLACES[i];
        for (size_t p = 0; p < 4; p++) {
            if (!place->ports[p].size)
                continue;
            const Status status = inner_numbers(self, &place->ports[p], 1, &ports[i][p]);
            if (status > STATUS_WARNING)
                return status;
            ports[i][p] *= place->factors[p];
        }
        if (!place->ports[1].size && s->moved && time > s->moved_at) /* no velocity: the last sub-step's mean one */
            ports[i][1] = (ports[i][0] - s->displacement[i]) / (time - s->moved_at);
        s->displacement[i] = ports[i][0];
        ports[i][0] += 0.5 * size * ports[i][1];
    }
    s->moved = true;
    s->moved_at = time;
    if (s->effects_enabled)
        effects_step(time + 0.5 * size, size, ports, s->states, forces);
    for (size_t i = 0; i < EFFECTS; i++)
        total[PLACES[i].force] += PLACES[i].factor * forces[i];
    for (size_t f = 0; f != FORCES; f++) {
        s->force[f] = total[f];
        const Value value = {NUMBER, s->host_force[f] + total[f], 0, NULL};
        const Status status = inner_set(self, &FORCE_INPUTS[f], &value);
        if (status > STATUS_WARNING)
            return status;
    }
    return STATUS_OK;
}
#endif

Status coupling_advance(Wrapper *self, double begin, double size, Outcome *outcome)
{
#if EFFECTS
    const double count = size > COUPLING ? ceil(size / COUPLING - 1e-6) : 1.0, part = size / count;
    Status worst = STATUS_OK;
    for (double i = 0.0; i < count; i++) {
        const double time = begin + i * part;
        Status status = apply_forces(self, time, part);
        if (status <= STATUS_WARNING)
            status = inner_step(self, time, part, outcome);
        if (status > worst)
            worst = status;
        if (status > STATUS_WARNING || outcome->early || outcome->terminate)
            break;
        if (outcome->event && i + 1.0 < count && (status = inner_events(self, outcome)) > STATUS_WARNING)
            return status;
        if (outcome->terminate) /* said while an event was handled */
            break;
    }
    return worst;
#else
    return inner_step(self, begin, size, outcome);
#endif
}
