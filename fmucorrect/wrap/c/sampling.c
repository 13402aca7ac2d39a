/* The corrector's time grid under whatever steps the host takes.
 *
 * Samples lie at first + k * STEP_NS, where first is the time at which initialisation ended. A host's step that passes samples is
 * taken in pieces that end on them, so that the window always holds the solver's outputs at the corrector's sample time. Between
 * samples the correction of the last one is held: corrected = solver's output now + correction of the last sample. A solver that
 * needs a constant step gets one: the sample time if the host's step is a multiple of it, the host's step if that is a fraction of
 * it; any other step is refused. A sample is what the solver's outputs are when the next step begins, with the inputs of its time. */
#include <math.h>
#include <string.h>

#include "wrapper.h"
#if CHANNELS
#include "network.h"
#endif

#define SECOND 1e9
#define SNAP (STEP_NS / 1000 + 1) /* hosts that add up floating-point steps miss a sample by no more than this, ns */

#if CHANNELS
/* A new sample is due at the time that has been reached: one row up. */
static void open_row(State *s)
{
    memmove(s->window, s->window + CHANNELS, (ROWS - 1) * CHANNELS * sizeof *s->window);
    s->seen_before = s->seen;
    s->on_grid = s->row_stale = s->stale = true;
}
#endif

Status sampling_row(Wrapper *self)
{
    State *s = &self->state;
    if (!s->row_stale)
        return s->ill ? STATUS_WARNING : STATUS_OK;
#if CHANNELS
    double row[CHANNELS];
    const Status status = inner_numbers(self, SOURCES, CHANNELS, row);
    if (status > STATUS_WARNING)
        return status;
    size_t bad = CHANNELS;
    for (size_t j = 0; j < CHANNELS; j++) {
        row[j] *= FACTORS[j];
        if (!isfinite(row[j]) && bad == CHANNELS)
            bad = j;
    }
    s->row_stale = false;
    if (memcmp(row, s->row, sizeof row) != 0)
        s->stale = true;
    memcpy(s->row, row, sizeof row);
    if (s->started && s->on_grid) {
        float *newest = s->window + (ROWS - 1) * CHANNELS;
        for (size_t j = 0; j < CHANNELS; j++)
            newest[j] = bad == CHANNELS ? (float)row[j] : 0.0f;
        s->seen = bad < CHANNELS ? 0 : s->seen_before < ROWS ? s->seen_before + 1 : ROWS;
    }
    if (bad < CHANNELS && !s->ill)
        wrapper_log(self, STATUS_WARNING,
                    "channel %s is %g at t = %.9g s: it is passed on as it is, and the correction pauses until %d finite samples were seen",
                    CHANNEL_NAMES[bad], row[bad], s->now, ROWS);
    s->ill = bad < CHANNELS;
#else
    s->row_stale = false;
#endif
    return s->ill ? STATUS_WARNING : STATUS_OK;
}

Status sampling_correction(Wrapper *self)
{
    State *s = &self->state;
    const Status status = sampling_row(self);
    if (status > STATUS_WARNING || !s->stale)
        return status;
#if CHANNELS
    if (s->ill || !s->enabled || s->seen < ROWS) {
        s->status = s->ill ? INVALID : !s->enabled ? OFF : WARMUP;
        memset(s->delta, 0, sizeof s->delta);
        memcpy(s->sigma, UNCORRECTED, sizeof s->sigma);
    } else if (s->started) {
        double conditions[CONDITIONS];
        for (size_t i = 0; i < CONDITIONS; i++) {
            conditions[i] = s->conditions[i];
            if (SOURCES[CHANNELS + i].size) {
                const Status read = inner_numbers(self, &SOURCES[CHANNELS + i], 1, &conditions[i]);
                if (read > STATUS_WARNING)
                    return read;
                conditions[i] *= FACTORS[CHANNELS + i];
            }
        }
        const float condition[3] = {(float)conditions[SPEED], (float)conditions[AMPLITUDE], (float)conditions[FREQUENCY]};
        const int64_t at = s->first_ns + s->sample * STEP_NS;
        float corrected[CHANNELS], baseline[CHANNELS], sigma[CHANNELS], inside;
        network(s->window, condition, (double)(at - llround(conditions[START] * SECOND)) / SECOND, corrected, baseline, sigma, &inside);
        const float *newest = s->window + (ROWS - 1) * CHANNELS;
        for (size_t j = 0; j < CHANNELS; j++) {
            const float delta = corrected[j] - newest[j];
            s->delta[j] = delta;
            s->sigma[j] = sigma[j];
        }
        s->status = inside >= 1.0f ? CORRECTED : OUTSIDE;
    }
#endif
    s->stale = false;
    return status;
}

/* Whether a solver of constant step can be led from sample to sample by steps of `size` s. */
static Status check_constant_step(Wrapper *self, double size)
{
    const int64_t step = llround(size * SECOND);
    if (step > 0 && (step % STEP_NS == 0 || STEP_NS % step == 0) && (INNER_FMI || step <= STEP_NS))
        return STATUS_OK;
    return wrapper_log(self, STATUS_ERROR,
                       "a communication step of %.9g s was asked for, expected %s of the corrector's sample time %.9g s: %s", size,
                       INNER_FMI ? "a multiple or a whole fraction" : "a whole fraction", STEP_NS / SECOND,
                       INNER_FMI ? "the solver cannot vary its step" : "the inputs are not known in between");
}

Status sampling_step(Wrapper *self, double time, double size, bool may_return_early, Outcome *outcome)
{
    State *s = &self->state;
    *outcome = (Outcome){.last = time};
    Status worst = sampling_row(self); /* the row of this time, with the inputs that the host has set by now */
    if (worst > STATUS_WARNING)
        return worst;
    const int64_t begin_ns = llround(time * SECOND), target_ns = llround((time + size) * SECOND);
    if (begin_ns - s->now_ns > SNAP || s->now_ns - begin_ns > SNAP)
        return wrapper_log(self, STATUS_ERROR, "a step from t = %.9g s was asked for, expected from %.9g s, where the last one ended", time,
                           s->now);
    if (!INNER_VARIABLE_STEP && (worst = check_constant_step(self, size)) > STATUS_WARNING)
        return worst;
    worst = STATUS_OK;
    double begin = time;
    for (bool last = false; !last;) {
        const int64_t next_ns = s->first_ns + (s->sample + 1) * STEP_NS;
        const bool sample = target_ns >= next_ns - SNAP;
        last = target_ns <= next_ns + SNAP;
        const double end = last ? time + size : (double)next_ns / SECOND;
        /* undivided, the solver gets the host's own numbers; divided, those of FmuStepper */
        const double piece = last && begin == time ? size : (double)((last ? target_ns : next_ns) - llround(begin * SECOND)) / SECOND;
        const Status status = coupling_advance(self, begin, piece, outcome);
        if (status > worst)
            worst = status;
        s->on_grid = false;
        s->row_stale = true;
        if (status == STATUS_DISCARD || outcome->early) {
            s->now = outcome->last;
            s->now_ns = llround(s->now * SECOND);
            last = true;
        } else if (status > STATUS_WARNING) {
            return status;
        } else {
            s->now = end;
            s->now_ns = last ? target_ns : next_ns;
        }
#if CHANNELS
        if (sample && s->now_ns >= next_ns - SNAP) {
            s->sample++;
            open_row(s);
        }
#else
        if (sample)
            s->sample++;
#endif
        const Status read = sampling_row(self);
        if (read > worst)
            worst = read;
        if (read > STATUS_WARNING)
            return read;
        begin = end;
        if (outcome->terminate)
            break;
        if (outcome->event && !last) {
            if (may_return_early) {
                outcome->early = true;
                break;
            }
            const Status handled = inner_events(self, outcome);
            if (handled > STATUS_WARNING)
                return handled;
        }
    }
    outcome->last = s->now;
    return worst;
}
