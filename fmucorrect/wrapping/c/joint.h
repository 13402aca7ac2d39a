/* What a joint will show in the middle of a sub-step, from what it shows where the sub-step begins: for coupling.c, and for
 * discovery/c/march.c, which must do the same.
 *
 * The displacement is moved on with the velocity (d + v h / 2), the other ports with their change since the last reading,
 * which lies where the sub-step before began (v + (v - v_last) h / (2 h_last)); without one, at the start and after an
 * event, they stay as read. Without a velocity the displacement is differentiated: (d - d_last) / h_last belongs to the
 * middle of the last sub-step, and two such differences lead to the beginning and to the middle of this one. */
#ifndef JOINT_H
#define JOINT_H

#include <stdbool.h>
#include <string.h>

/* now: displacement, velocity, acceleration, nominal force; of the velocity what is read where it is shown. last: the same at
 * the reading `gap` s ago, which becomes `now`; gap is 0 where there is none. span: s from the reading before to that one;
 * readings: how many there were, at most 2. size: s of the sub-step. */
static void predict(double now[4], double last[4], bool shown, unsigned readings, double gap, double span, double size,
                    double port[4])
{
    if (!shown)
        now[1] = gap > 0.0 ? (now[0] - last[0]) / gap : last[1];
    for (size_t p = 1; p < 4; p++) {
        const bool mean = p == 1 && !shown;
        const double apart = mean ? 0.5 * (gap + span) : gap;
        const double change = gap > 0.0 && readings > (mean ? 1u : 0u) ? (now[p] - last[p]) / apart : 0.0;
        const double begin = mean ? now[p] + 0.5 * gap * change : now[p];
        if (p == 1)
            port[0] = now[0] + 0.5 * size * begin;
        port[p] = begin + 0.5 * size * change;
    }
    memcpy(last, now, 4 * sizeof *now);
}

#endif
