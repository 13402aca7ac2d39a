/* The corrector's time grid under whatever steps the host takes.
 *
 * The first sample lies at the time at which initialisation ended, each other one STEP_NS after the one before. A host's step that
 * passes samples is taken in pieces that end on them, so that the window always holds the solver's outputs at the corrector's sample
 * time. A host that meets a sample within a ten-thousandth of the sample time has met it, and the grid goes on from there: times
 * that are added up in floating point do not drift away from it. Between samples the correction of the last one is held: corrected =
 * solver's output now + correction of the last sample. A solver that needs a constant step gets one, the same number each time: the
 * sample time if the host's step is a multiple of it, the host's step if that is a fraction of it; any other step, and any change
 * from one to another, is refused.
 *
 * With the correction and all effects switched off the host's steps reach the solver whole, as if it were alone. Samples that such
 * a step passes are not known: the window fills anew, on the same grid.
 *
 * A sample is what the solver's outputs are with the inputs of its time: read when the step that leads to it has ended, and again
 * when the next one begins where an output may depend on an input at once (CHANNELS_FED) and inputs have been set in between.
 * Of inputs that a corrector sees it has what they held while the solver came to the sample (HELD), so that it waits for nothing.
 * One that was trained with the inputs of a sample's own time (INPUTS_SEEN) has none until the host has set them. A host that reads
 * its outputs before gets the correction of the sample before, as between samples: the old inputs beside the new outputs would be a
 * window that nothing was trained on. One that has not set any since the start has inputs that do not change.
 *
 * Two clocks: `host` is the host's, which may be coarse; `now` the solver's, to which each step begins where the last one ended.
 * They are one as long as the host's numbers follow each other but for the rounding of double precision. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "wrapper.h"
#if CHANNELS
#include "network.h"
#endif

#define SECOND 1e9
#define SNAP (STEP_NS / 10000 + 1) /* ns; a sample missed by less is met */
#define ROUNDING (4.0 * DBL_EPSILON) /* of a host that adds its steps up, or counts them and multiplies */
#define COARSE (4.0 * FLT_EPSILON) /* the same in single precision, 4 to 8 units in the last place */
#define LONGEST 4e9 /* s; differences of such times still fit into nanoseconds of 64 bits */

#if CHANNELS
/* A new sample is due at the time that has been reached: one row up. */
static void open_row(State *s)
{
#if REMEMBERS
    if (s->carried)
        memcpy(s->memory, s->next_memory, sizeof s->memory);
    else { /* the window is not full, or nothing finite came of it: both begin anew */
        memset(s->memory, 0, sizeof s->memory);
        s->seen = s->seen < ROWS ? s->seen : 0;
    }
    s->carried = false;
#endif
    memmove(s->window, s->window + SEEN, (ROWS - 1) * SEEN * sizeof *s->window);
    s->seen_before = s->seen;
    s->on_grid = s->row_stale = s->stale = true;
    s->awaited = INPUTS_SEEN && s->led;
}
#endif

/* Nothing of the wrapper acts. A solver of constant step that was led from sample to sample goes on so. */
static bool idle(const State *s)
{
    return !(CHANNELS && s->enabled) && !(EFFECTS && s->effects_enabled) && (INNER_VARIABLE_STEP || !s->divided);
}

/* The grid at the time that has been reached: at the next sample, before it, or, after a step that was not divided, anywhere. */
static void follow_grid(State *s)
{
    const int64_t passed = (s->now_ns + SNAP - s->sample_ns) / STEP_NS, newest_ns = s->sample_ns + passed * STEP_NS;
    if (passed == 0)
        return;
    const bool met = s->now_ns <= newest_ns + SNAP;
    s->sample_ns = met ? s->now_ns : newest_ns;
#if CHANNELS
    if (passed > 1 || !met) { /* a state that missed a sample is worth nothing either */
        s->seen = 0;
        s->carried = false;
    }
    if (met)
        open_row(s);
#endif
}

Status sampling_row(Wrapper *self)
{
    State *s = &self->state;
    if (!s->row_stale)
        return s->ill ? STATUS_WARNING : STATUS_OK;
#if CHANNELS
    double row[SEEN];
    const Status status = inner_numbers(self, SOURCES, SEEN, row);
    if (status > STATUS_WARNING)
        return status;
    size_t bad = SEEN;
    for (size_t j = 0; j < SEEN; j++) {
        row[j] = HELD[j] && s->inputs_known ? s->inputs_before[j] : row[j] * FACTORS[j];
        if (!(fabs(row[j]) <= FLT_MAX) && bad == SEEN) /* a window is of single precision */
            bad = j;
    }
    s->row_stale = s->row_due = false;
    if (s->ill != (bad < SEEN) || (s->on_grid && memcmp(row, s->row, sizeof row) != 0)) {
        s->stale = true;
        s->carried = s->carried && !s->on_grid;
    }
    memcpy(s->row, row, sizeof row);
    if (s->started && s->on_grid) {
        float *newest = s->window + (ROWS - 1) * SEEN;
        for (size_t j = 0; j < SEEN; j++)
            newest[j] = bad == SEEN ? (float)row[j] : 0.0f;
        s->seen = bad < SEEN ? 0 : s->seen_before < ROWS ? s->seen_before + 1 : ROWS;
    }
    if (bad < SEEN && !s->ill)
        wrapper_log(self, STATUS_WARNING,
                    "channel %s is %g at t = %.9g s: it is passed on as it is, and the correction pauses until %d finite samples were seen",
                    CHANNEL_NAMES[bad], row[bad], s->now, ROWS);
    s->ill = bad < SEEN;
#else
    s->row_stale = s->row_due = false;
#endif
    return s->ill ? STATUS_WARNING : STATUS_OK;
}

Status sampling_correction(Wrapper *self)
{
    State *s = &self->state;
    const Status status = sampling_row(self);
    if (status > STATUS_WARNING || !s->stale || (s->awaited && !s->ill))
        return status;
#if CHANNELS
    s->status = s->ill ? INVALID : !s->enabled ? OFF : WARMUP;
    memset(s->delta, 0, sizeof s->delta);
    memcpy(s->sigma, UNCORRECTED, sizeof s->sigma);
    if (!s->ill && (s->enabled || (REMEMBERS && !s->carried)) && s->seen >= ROWS) { /* the state goes on when switched off */
        double conditions[CONDITIONS];
        bool sound = true;
        for (size_t i = 0; i < CONDITIONS; i++) {
            conditions[i] = s->conditions[i];
            if (SOURCES[SEEN + i].size) {
                const Status read = inner_numbers(self, &SOURCES[SEEN + i], 1, &conditions[i]);
                if (read > STATUS_WARNING)
                    return read;
                conditions[i] *= FACTORS[SEEN + i];
            }
            sound = sound && fabs(conditions[i]) <= (i == START ? LONGEST : FLT_MAX);
        }
        if (!sound) {
            s->status = s->enabled ? INVALID : OFF;
            s->stale = false;
            return status;
        }
        const float condition[3] = {(float)conditions[SPEED], (float)conditions[AMPLITUDE], (float)conditions[FREQUENCY]};
        float corrected[CHANNELS], baseline[CHANNELS], sigma[CHANNELS], inside, next[CORRECTOR_STATE + 1] = {0.0f};
        network(s->window, condition, (double)(s->sample_ns - llround(conditions[START] * SECOND)) / SECOND, corrected, baseline, sigma, &inside, s->memory, next);
        const float *newest = s->window + (ROWS - 1) * SEEN;
        for (size_t j = 0; j < CHANNELS; j++) {
            const float delta = corrected[j] - newest[j];
            sound = sound && isfinite(delta) && isfinite(sigma[j]);
            s->delta[j] = delta;
            s->sigma[j] = sigma[j];
        }
        sound = sound && isfinite(inside);
        for (size_t i = 0; i < CORRECTOR_STATE + 1; i++)
            sound = sound && isfinite(next[i]);
        if (sound && !s->carried) {
            memcpy(s->next_memory, next, sizeof next);
            s->carried = true;
        }
        s->status = !s->enabled ? OFF : !sound ? INVALID : inside >= 1.0f && !s->unlike ? CORRECTED : OUTSIDE;
        if (!sound || !s->enabled || s->unlike) { /* not sound: finite, but too large for the network's arithmetic */
            memset(s->delta, 0, sizeof s->delta);
            memcpy(s->sigma, UNCORRECTED, sizeof s->sigma);
        }
    }
#endif
    s->stale = false;
    return status;
}

Status sampling_sample(Wrapper *self)
{
    const State *s = &self->state;
    const Status status = sampling_row(self);
    return status <= STATUS_WARNING && REMEMBERS && s->on_grid && !s->carried ? sampling_correction(self) : status;
}

/* Whether a solver of constant step can be led from sample to sample by host's steps of `size` s; it then takes steps of s->piece. */
static Status check_constant_step(Wrapper *self, double size)
{
    State *s = &self->state;
    const double sample = STEP_NS / SECOND, room = SNAP / SECOND, many = round(size / sample), parts = round(sample / size);
    const bool multiple = many >= 1.0 && fabs(size - many * sample) <= room;
    const bool fits = multiple ? INNER_FMI || many == 1.0 : parts >= 1.0 && fabs(size * parts - sample) <= room;
    if (!fits)
        return wrapper_log(self, STATUS_ERROR,
                           "a communication step of %.9g s was asked for, expected %s of the corrector's sample time %.9g s: %s", size,
                           INNER_FMI ? "a multiple or a whole fraction" : "a whole fraction", sample,
                           INNER_FMI ? "the solver cannot vary its step" : "the inputs are not known in between");
    const double piece = multiple ? sample : size, part = piece / coupling_parts(piece);
    if (s->part == 0.0)
        s->part = part;
    if (INNER_FMI && fabs(part - s->part) > 1e-3 * s->part)
        return wrapper_log(self, STATUS_ERROR,
                           "a communication step of %.9g s was asked for, with which the solver would take steps of %.9g s after steps of "
                           "%.9g s: it cannot vary its step%s",
                           size, part, s->part,
                           s->piece == 0.0 ? "; what is switched on later has to be on from the first step" : "");
    if (s->piece == 0.0)
        s->piece = piece;
    return STATUS_OK;
}

/* Whether a step may begin at `time` at all. */
static Status check_step(Wrapper *self, double time, double size)
{
    const State *s = &self->state;
    if (!s->started)
        return wrapper_log(self, STATUS_ERROR, "a step was asked for before initialisation has ended");
    if (!(size > 0.0 && time + size < LONGEST && time > -LONGEST))
        return wrapper_log(self, STATUS_ERROR, "a step from t = %.9g s of %.9g s was asked for, expected one of more than 0 s", time, size);
    if (fabs(time - s->host) > fmin(0.5 * size, fmax(SNAP / SECOND, COARSE * fabs(time))))
        return wrapper_log(self, STATUS_ERROR, "a step from t = %.9g s was asked for, expected from %.9g s, where the last one ended", time,
                           s->host);
    return INNER_VARIABLE_STEP || idle(s) ? STATUS_OK : check_constant_step(self, size);
}

/* One piece of a step, which ends at the next sample or before it. `last`: the step ends with it. */
static Status step_piece(Wrapper *self, double begin, double piece, bool last, Outcome *outcome)
{
    State *s = &self->state;
    const int64_t before_ns = s->now_ns, next_ns = s->sample_ns + STEP_NS;
    const bool alone = idle(s);
#if INNER_FMI && !INNER_VARIABLE_STEP
    if (alone)
        s->part = piece;
    else if (fabs(piece - s->piece) * SECOND > SNAP)
        return wrapper_log(self, STATUS_ERROR,
                           "the solver would have to take a step of %.9g s to the corrector's next sample after steps of %.9g s: it "
                           "cannot vary its step",
                           piece, s->piece);
    else
        piece = s->piece;
#endif
    const Status status = coupling_advance(self, begin, piece, alone, outcome);
    const bool part = status == STATUS_DISCARD || outcome->early;
    if (status > STATUS_WARNING && !part)
        return status;
    s->now = outcome->last;
    s->now_ns = part || last ? llround(s->now * SECOND) : next_ns;
    s->on_grid = s->on_grid && s->now_ns == before_ns;
    s->row_stale = true;
    follow_grid(s);
    return status;
}

#if INPUTS_HELD
/* A step begins: what the inputs hold now they hold until the next sample. */
static Status keep_inputs(Wrapper *self)
{
    State *s = &self->state;
    for (size_t j = 0; j < SEEN; j++) {
        if (!HELD[j])
            continue;
        const Status status = inner_numbers(self, &SOURCES[j], 1, &s->inputs_before[j]);
        if (status > STATUS_WARNING)
            return status;
        s->inputs_before[j] *= FACTORS[j];
    }
    s->inputs_known = true;
    return STATUS_OK;
}
#endif

/* From `start` by `size` s, on the solver's clock. */
static Status step_by_pieces(Wrapper *self, double start, double size, bool may_return_early, Outcome *outcome)
{
    State *s = &self->state;
    const double end = start + size;
    const int64_t end_ns = llround(end * SECOND);
    Status worst = STATUS_OK;
    double begin = start;
    for (bool whole = true, last = false; !last; whole = false, begin = s->now) {
#if INPUTS_SEEN
        s->awaited = false; /* the inputs of a step's begin are those that are set by then */
        const Status known = s->enabled ? sampling_correction(self) : STATUS_OK; /* what its end may have to go on with */
        if (known > STATUS_WARNING)
            return known;
#endif
#if INPUTS_HELD
        const Status kept = s->on_grid || idle(s) ? keep_inputs(self) : STATUS_OK;
        if (kept > STATUS_WARNING)
            return kept;
#endif
        const int64_t next_ns = s->sample_ns + STEP_NS;
        last = idle(s) || end_ns <= next_ns + SNAP;
        s->divided = s->divided || !last;
        const double piece = !last ? (double)(next_ns - s->now_ns) / SECOND : whole ? size : end - begin;
        const Status status = step_piece(self, begin, piece, last, outcome);
        if (status > worst)
            worst = status;
        if (status > STATUS_WARNING)
            return status;
        const Status read = sampling_sample(self);
        if (read > worst)
            worst = read;
        if (read > STATUS_WARNING || outcome->early)
            return worst;
        if (outcome->event && !last && !outcome->terminate) {
            if (may_return_early) {
                outcome->early = true;
                return worst;
            }
            const Status handled = inner_events(self, outcome);
            const Status after = handled > STATUS_WARNING ? handled : sampling_sample(self);
            if (after > STATUS_WARNING)
                return after;
        }
        if (outcome->terminate) {
            outcome->early = !last;
            return worst;
        }
    }
    return worst;
}

/* The sample of the time at which a step begins, with the inputs that the host has set by now. Switched off, nothing is read here,
 * and a window that misses a sample fills anew. */
static Status complete_sample(Wrapper *self)
{
    State *s = &self->state;
#if REMEMBERS
    const bool behind = !s->carried && s->seen >= ROWS; /* the corrector's state has not taken this sample yet */
#else
    const bool behind = false;
#endif
    if (!s->on_grid || (!s->row_due && !behind))
        return STATUS_OK;
    if (s->enabled)
        return sampling_sample(self);
    s->row_due = false;
    s->seen = 0;
    return STATUS_OK;
}

Status sampling_step(Wrapper *self, double time, double size, bool may_return_early, Outcome *outcome)
{
    State *s = &self->state;
    *outcome = (Outcome){.last = s->host};
    Status status = check_step(self, time, size);
    if (status <= STATUS_WARNING)
        status = complete_sample(self);
    if (status > STATUS_WARNING)
        return status;
    const bool same = !s->divided && fabs(time - s->now) <= ROUNDING * (1.0 + fabs(time));
    const double begin = same ? time : s->now;
    status = step_by_pieces(self, begin, size, may_return_early, outcome);
    s->host = status <= STATUS_WARNING && !outcome->early ? time + size : s->now + (time - begin);
    outcome->last = s->host;
    return status;
}
