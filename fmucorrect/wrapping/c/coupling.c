/* Effects in the loop: forces that the model lacks, fed back into the solver's force inputs.
 *
 * A piece of a step is divided into sub-steps of at most COUPLING s. The joints are read where a sub-step ends, or, where
 * they may depend at once on an input that is no force of a law (JOINTS_FED), where the next one begins; a law then sees
 * what they will show in the middle of the sub-step (joint.h), and its force is held in the solver over it. Second order in
 * the sub-step. An acceleration answers to forces at once: what the forces that were held have to do with it is taken out
 * of what is read, and the new forces are solved together with it (together.h). discovery/c/march.c does the same.
 *
 * Switched off, nothing is read, set or divided; switched on again, it begins as at the start. */
#include <math.h>
#include <string.h>

#include "wrapper.h"
#include "effects.h"
#if EFFECTS
#include "joint.h"
#endif
#if ANSWERED
#include "together.h"
#endif

#if EFFECTS
/* What the acceleration that law i sees has of these forces. */
static double answered(size_t i, const double forces[])
{
    double sum = 0.0;
    for (size_t f = 0; f != FORCES; f++)
        sum += ANSWERS[i][f] * forces[f];
    return sum;
}

static Status read_joints(Wrapper *self)
{
    State *s = &self->state;
    Status worst = STATUS_OK;
    for (size_t i = 0; i < EFFECTS; i++)
        for (size_t p = 0; p < 4; p++) {
            if (!PLACES[i].ports[p].size)
                continue;
            const Status status = inner_numbers(self, &PLACES[i].ports[p], 1, &s->joints[i][p]);
            worst = status > worst ? status : worst;
            if (status > STATUS_WARNING)
                return status;
            s->joints[i][p] *= PLACES[i].factors[p];
        }
    s->joints_due = false;
    return worst;
}

/* What law i sees, the acceleration as without all forces. gap: s since the last reading, 0 where there is none before. */
static void look(State *s, size_t i, double gap, double size, double port[4])
{
    double now[4];
    memcpy(now, s->joints[i], sizeof now);
    now[2] -= answered(i, s->held);
    predict(now, s->ports[i], PLACES[i].ports[1].size != 0, s->readings, gap, s->span, size, port);
}

/* The forces of all laws at a time, the middle of a sub-step of that size. */
static void solve(State *s, double time, double size, double ports[EFFECTS][4], double forces[EFFECTS])
{
    const double(*const seen)[4] = (const double(*)[4])ports; /* which C11 does not see by itself */
#if ANSWERED
    double states[EFFECT_STATES + 1], slope[EFFECTS], answers[EFFECTS * EFFECTS];
    memcpy(states, s->states, sizeof states);
    for (size_t i = 0; i < EFFECTS; i++)
        ports[i][2] += answered(i, s->host_force);
    effects_step(time, size, seen, s->states, forces);
    for (size_t i = 0; i < EFFECTS; i++)
        ports[i][2] += 1.0;
    effects_step(time, size, seen, states, slope);
    for (size_t i = 0; i < EFFECTS; i++) {
        slope[i] -= forces[i];
        for (size_t j = 0; j < EFFECTS; j++)
            answers[i * EFFECTS + j] = ANSWERS[i][PLACES[j].force] * PLACES[j].factor;
    }
    together(EFFECTS, slope, answers, forces);
#else
    effects_step(time, size, seen, s->states, forces);
#endif
}

static Status apply_forces(Wrapper *self, double time, double size)
{
    State *s = &self->state;
    double ports[EFFECTS][4] = {{0.0}}, forces[EFFECTS] = {0.0}, total[FORCES + 1] = {0.0};
    const double gap = s->moved && time > s->moved_at ? time - s->moved_at : 0.0;
    const Status read = s->joints_due ? read_joints(self) : STATUS_OK;
    if (read > STATUS_WARNING)
        return read;
    for (size_t f = 0; f != FORCES && !s->moved; f++)
        s->held[f] = s->host_force[f]; /* since initialisation */
    for (size_t i = 0; i < EFFECTS; i++)
        look(s, i, gap, size, ports[i]);
    if (!s->moved || gap > 0.0) { /* not a step that is tried again */
        s->readings += s->readings < 2;
        s->span = gap;
    }
    s->moved = true;
    s->moved_at = time;
    solve(s, time + 0.5 * size, size, ports, forces);
    for (size_t i = 0; i < EFFECTS; i++)
        total[PLACES[i].force] += PLACES[i].factor * forces[i];
    for (size_t f = 0; f != FORCES; f++) {
        s->force[f] = total[f];
        s->held[f] = s->host_force[f] + total[f];
        const Value value = {NUMBER, s->held[f], 0, NULL};
        const Status status = inner_set(self, &FORCE_INPUTS[f], &value);
        if (status > STATUS_WARNING)
            return status;
    }
    return STATUS_OK;
}

/* The solver gets back what the host has given it. */
static Status let_go(Wrapper *self)
{
    State *s = &self->state;
    s->moved = false;
    s->readings = 0;
    s->joints_due = true;
    for (size_t f = 0; f != FORCES; f++) {
        if (s->force[f] == 0.0)
            continue;
        s->force[f] = 0.0;
        const Value value = {NUMBER, s->host_force[f], 0, NULL};
        const Status status = inner_set(self, &FORCE_INPUTS[f], &value);
        if (status > STATUS_WARNING)
            return status;
    }
    return STATUS_OK;
}
#endif

double coupling_parts(double size) { return !EFFECTS || size <= COUPLING ? 1.0 : ceil(size / COUPLING - 1e-6); }

Status coupling_advance(Wrapper *self, double begin, double size, bool whole, Outcome *outcome)
{
#if EFFECTS
    State *s = &self->state;
    const double count = whole || (INNER_VARIABLE_STEP && !s->effects_enabled) ? 1.0 : coupling_parts(size), end = begin + size;
    double time = begin;
    Status worst = STATUS_OK;
    s->divided = s->divided || count > 1.0;
    for (double i = 0.0; i < count; i++, time = outcome->last) {
        const bool rest = INNER_VARIABLE_STEP && i > 0.0 && i + 1.0 == count; /* ends where the whole does */
        const double part = rest ? end - time : size / count;
        Status status = s->effects_enabled ? apply_forces(self, time, part) : let_go(self);
        s->joints_due = true;
        if (status <= STATUS_WARNING)
            status = inner_step(self, time, part, outcome);
        if (status <= STATUS_WARNING && s->effects_enabled && !JOINTS_FED && !outcome->event) {
            const Status read = read_joints(self);
            status = read > status ? read : status;
        }
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
