/* A linear response in the place of an FMU, for march.c: what the joints showed in a run that is known, and beside it what the
 * forces change that are not those of that run. Direct convolution: the force of a step hangs on the response to all before. */
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

enum {
    NEAR = 128, /* rows after which a response is taken in groups of TOGETHER: what it has of fast motion has died away */
    TOGETHER = 4,
    ROWS = NEAR + TOGETHER - 1,
    LANES = 16
};

/* shown: (rows, n_ports) of the known run. felt: whether what acts at a port hangs on what it shows. near: (n_ports, n_forces,
 * ROWS), what a unit of a force held for one step changes so many rows later, the last of them first. far: (n_ports, n_forces,
 * TOGETHER, reach), the means of each TOGETHER rows that follow NEAR, NEAR + 1 and so on, the last first. acted: (rows,
 * n_forces) forces of the known run. change: (n_forces, rows) forces beyond these; NULL to have `acted` filled in,
 * beside joints that move as they did. groups: (n_forces, rows / TOGETHER + 1) their sums. now: the row. first: that of the first
 * change. */
typedef struct {
    long rows, n_ports, n_forces, reach;
    const double *shown;
    const int *felt;
    double *acted;
    const float *near, *far;
    float *change, *groups;
    long now, first;
} Response;

/* Single precision, as its error is one of model, not of rounding; sums in lanes, which a compiler makes vectors of. */
static double product(const float *a, const float *b, long n)
{
    float sums[LANES] = {0.0f};
    double sum = 0.0;
    long i = 0;
    for (; i + LANES <= n; i += LANES)
        for (int k = 0; k < LANES; k++)
            sums[k] += a[i + k] * b[i + k];
    for (; i < n; i++)
        sum += (double)a[i] * (double)b[i];
    for (int k = 0; k < LANES; k++)
        sum += (double)sums[k];
    return sum;
}

static int get(void *component, const unsigned references[], size_t n, double values[])
{
    const Response *r = component;
    (void)references; /* march asks for the ports in their order */
    memcpy(values, r->shown + r->now * r->n_ports, n * sizeof *values);
    if (!r->change)
        return 0;
    const long left = r->now < NEAR ? 0 : (r->now - NEAR) / TOGETHER; /* groups that are far enough behind */
    const long phase = (r->now - left * TOGETHER - NEAR) % TOGETHER, begun = r->first / TOGETHER;
    const long begin = left * TOGETHER > r->first ? left * TOGETHER : r->first, back = r->now - begin;
    const long count = left - begun < r->reach ? left - begun : r->reach;
    for (long p = 0; p < r->n_ports; p++)
        for (long f = 0; r->felt[p] && f < r->n_forces; f++) {
            const long at = p * r->n_forces + f;
            const float *near = r->near + at * ROWS, *far = r->far + (at * TOGETHER + phase) * r->reach;
            values[p] += product(near + ROWS - back, r->change + f * r->rows + begin, back);
            if (count > 0)
                values[p] += product(far + r->reach - count, r->groups + f * (r->rows / TOGETHER + 1) + left - count, count);
        }
    return 0;
}

static int set(void *component, const unsigned references[], size_t n, double values[])
{
    Response *r = component;
    (void)references; /* of the forces alone: it has no other inputs */
    double *acted = r->acted + r->now * r->n_forces;
    bool none = r->first == r->now;
    for (long f = 0; f < (long)n; f++) {
        if (r->change) {
            const float change = (float)(values[f] - acted[f]);
            r->change[f * r->rows + r->now] = change;
            r->groups[f * (r->rows / TOGETHER + 1) + r->now / TOGETHER] += change;
            none = none && values[f] == acted[f];
        } else
            acted[f] = values[f];
    }
    r->first += none;
    return 0;
}

static int step(void *component, double t, double h, int keep)
{
    (void)t, (void)h, (void)keep;
    ((Response *)component)->now++;
    return 0;
}

/* Its functions, as march.c asks an FMI 2.0 FMU for them: step, get, set. */
__attribute__((visibility("default"))) void *const RESPONSE[] = {(void *)step, (void *)get, (void *)set};
