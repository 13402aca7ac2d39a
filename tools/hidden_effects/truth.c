/* The physical side of a hidden-effect case: an FMU stepped finely, with effects at its joints that are sharper than
 * anything that a fit uses. It shares nothing with the catalogue of effects or the simulator of fmucorrect.
 *
 * Every fine step of h s: the ports are read, each effect's force in the middle of the step is worked out (the ports
 * carried half a step ahead), and held over the step. Dry friction is exact: what would bring the joint to rest, as far
 * as it reaches (Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988). */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))

typedef int Step2(void *, double, double, int);
typedef int Access2(void *, const unsigned[], size_t, double[]);
typedef int Step3(void *, double, double, bool, bool *, bool *, bool *, double *);
typedef int Access3(void *, const unsigned[], size_t, double[], size_t);

/* An instance that its owner has initialised. fmi: 2 or 3. */
typedef struct {
    void *component, *step, *get, *set;
    int fmi;
} Fmu;

enum { D, V, A, F0, OTHER, PORTS };
enum { NUMBERS = 8, SPRINGS = 46, MEMORY = SPRINGS + 1 };

typedef enum {
    LINEAR_STIFFNESS, VISCOUS_DAMPING, ADDED_MASS, CUBIC_STIFFNESS, QUADRATIC_DAMPING, COULOMB_FRICTION,
    STRIBECK_FRICTION, BACKLASH, BUMP_STOP, BILINEAR_STIFFNESS, ASYMMETRY_BY_DIFFERENCE, ASYMMETRY_BY_RATIO,
    DAMPER_SATURATION, SERIES_STIFFNESS, BOUC_WEN, PRELOAD, PERIODIC_FORCE,
    DELAYED_SPRING, FRACTIONAL_DAMPING, SAWTOOTH_STIFFNESS, POSITION_FRICTION, PARAMETRIC_STIFFNESS, DELAYED_RELAY,
    CROSS_COUPLING, MAGNET, PULSES, SELF_EXCITATION, FADING_DAMPING
} Law;

/* One effect. port: places of d, v, a, F0 and another joint's d among the values read, -1 where there is none.
 * force: place among the force inputs. p: numbers, see force_of(). g_v: by how much a held force of 1 N lowers the
 * joint's rate over one fine step, g_a: its acceleration at once. history: ring of `length` displacements, one a
 * fine step. x: ports at the beginning of this step, gain: what the last one added to them. f: the force of the last
 * step. */
typedef struct {
    int law, port[PORTS], force;
    double p[NUMBERS], g_v, g_a;
    double *history;
    long length, at;
    double z[MEMORY], x[PORTS], gain[PORTS], f;
} Effect;

static double clip(double x, double limit) { return x > limit ? limit : x < -limit ? -limit : x; }
static double sign(double x) { return (x > 0.0) - (x < 0.0); }

/* The force that brings the joint to rest by the end of the step, up to `limit`. */
static double stick(const Effect *e, double limit)
{
    const double free_rate = e->x[V] + e->gain[V] + e->g_v * e->f; /* at the end of the step without this force */
    return clip(free_rate / e->g_v, limit);
}

/* What was d, `delay` s ago. */
static double delayed(Effect *e, double d, double delay, double h)
{
    const long steps = (long)(delay / h + 0.5);
    e->history[e->at % e->length] = d;
    const double past = e->at >= steps ? e->history[(e->at - steps) % e->length] : 0.0;
    e->at++;
    return past;
}

/* The force in the middle of a step. m: the ports there; t: s, there. */
static double force_of(Effect *e, const double m[], double t, double h)
{
    const double *p = e->p, two_pi = 6.283185307179586;
    const double d = m[D], v = m[V];
    switch (e->law) {
    case LINEAR_STIFFNESS: return p[0] * d;
    case VISCOUS_DAMPING: return p[0] * v;
    case ADDED_MASS: return p[0] * m[A] / (1.0 + p[0] * e->g_a); /* m[A]: without this force */
    case CUBIC_STIFFNESS: return p[0] * d * d * d;
    case QUADRATIC_DAMPING: return p[0] * v * fabs(v);
    case COULOMB_FRICTION: return stick(e, p[0]);
    case STRIBECK_FRICTION: { /* p: friction, breakaway, rate */
        const double r = v / p[2];
        return stick(e, p[0] + (p[1] - p[0]) * exp(-r * r));
    }
    case BACKLASH: return -p[1] * clip(d, p[0]);
    case BUMP_STOP: return p[1] * (d - clip(d, p[0]));
    case BILINEAR_STIFFNESS: return 0.5 * p[0] * fabs(d);
    case ASYMMETRY_BY_DIFFERENCE: return 0.5 * p[0] * fabs(v);
    case ASYMMETRY_BY_RATIO: return (p[0] - 1.0) / (p[0] + 1.0) * fabs(m[F0]);
    case DAMPER_SATURATION: return clip(m[F0], p[0]) - m[F0];
    case SERIES_STIFFNESS: { /* p: stiffness, damping */
        const double rest = p[1] * v, half = exp(-0.5 * p[0] * h / p[1]);
        const double middle = rest + (e->z[0] - rest) * half;
        e->z[0] = rest + (middle - rest) * half;
        return middle - m[F0];
    }
    case BOUC_WEN: { /* p: stiffness, alpha, beta, gamma, exponent */
        double middle = e->z[0];
        for (int i = 0; i < 8; i++) {
            const double size = pow(fabs(e->z[0]), p[4]);
            e->z[0] += h / 8.0 * (v - size * (p[2] * fabs(v) * sign(e->z[0]) + p[3] * v));
            middle = i == 3 ? e->z[0] : middle;
        }
        return p[0] * (p[1] * d + (1.0 - p[1]) * middle);
    }
    case PRELOAD: return p[0];
    case PERIODIC_FORCE: return p[0] * sin(two_pi * p[1] * t + p[2]);
    case DELAYED_SPRING: return p[0] * delayed(e, d, p[1], h);
    case FRACTIONAL_DAMPING: { /* p: N/m at 1 rad/s, order; relaxing springs, five a decade, and what lies beyond them */
        const double spacing = 0.2 * log(10.0), slow = 1e-4, fast = slow * exp(spacing * (SPRINGS - 1));
        double sum = pow(slow * exp(-0.5 * spacing), p[1]) / p[1] * (e->z[SPRINGS] + 0.5 * h * v)
                     + pow(fast * exp(0.5 * spacing), p[1] - 1.0) / (1.0 - p[1]) * v;
        e->z[SPRINGS] += h * v;
        for (int i = 0; i < SPRINGS; i++) {
            const double rate = slow * exp(spacing * i), half = exp(-0.5 * rate * h), driven = v * (1.0 - half) / rate;
            const double middle = e->z[i] * half + driven;
            e->z[i] = middle * half + driven;
            sum += spacing * pow(rate, p[1]) * middle;
        }
        return p[0] * sin(0.5 * two_pi * p[1]) / (0.5 * two_pi) * sum;
    }
    case SAWTOOTH_STIFFNESS: { /* p: amplitude, pitch */
        const double turn = d / p[1];
        return p[0] * 2.0 * (turn - floor(turn + 0.5));
    }
    case POSITION_FRICTION: /* p: friction, pitch; it comes and goes along the way */
        return stick(e, p[0] * 0.5 * (1.0 + cos(two_pi * d / p[1])));
    case PARAMETRIC_STIFFNESS: return p[0] * sin(two_pi * p[1] * t + p[2]) * d;
    case DELAYED_RELAY: { /* p: force, delay, threshold */
        const double past = delayed(e, d, p[1], h);
        return fabs(past) > p[2] ? p[0] * sign(past) : 0.0;
    }
    case CROSS_COUPLING: return p[0] * m[OTHER] * fabs(m[OTHER]);
    case MAGNET: { /* p: force, width: pulls towards a place off the middle */
        const double r = (d - p[2]) / p[1];
        return p[0] * r * exp(0.5 - 0.5 * r * r);
    }
    case PULSES: { /* p: force, period, length: kicks of either direction at uneven times */
        const double k = floor(t / p[1]), shift = sin(12.9898 * k + p[3]) * 43758.5453, part = shift - floor(shift);
        const double since = t - (k + 0.8 * part) * p[1];
        return since >= 0.0 && since < p[2] ? (part > 0.5 ? p[0] : -p[0]) * sin(0.5 * two_pi * since / p[2]) : 0.0;
    }
    case SELF_EXCITATION: { /* p: damping, displacement at which it turns over */
        const double r = d / p[1];
        return p[0] * (r * r - 1.0) * v;
    }
    case FADING_DAMPING: { /* p: damping, energy that halves it: it has taken up z */
        const double force = p[0] * v / (1.0 + e->z[0] / p[1]);
        e->z[0] += force * v * h;
        return force;
    }
    default: return 0.0;
    }
}

static int get(const Fmu *s, const unsigned r[], long n, double v[])
{
    return s->fmi == 2 ? ((Access2 *)s->get)(s->component, r, (size_t)n, v)
                       : ((Access3 *)s->get)(s->component, r, (size_t)n, v, (size_t)n);
}

static int set(const Fmu *s, const unsigned r[], long n, double v[])
{
    return s->fmi == 2 ? ((Access2 *)s->set)(s->component, r, (size_t)n, v)
                       : ((Access3 *)s->set)(s->component, r, (size_t)n, v, (size_t)n);
}

static int step(const Fmu *s, double t, double h)
{
    if (s->fmi == 2)
        return ((Step2 *)s->step)(s->component, t, h, 1);
    bool event, terminate, early;
    double last;
    const int status = ((Step3 *)s->step)(s->component, t, h, true, &event, &terminate, &early, &last);
    return terminate || early ? 3 : status;
}

/* The ports now, the acceleration as it would be without this effect's force. */
static void look(Effect *e, const double reads[], double to[])
{
    for (int p = 0; p < PORTS; p++)
        to[p] = e->port[p] < 0 ? 0.0 : reads[e->port[p]];
    to[A] += e->g_a * e->f;
}

static double effect_force(Effect *e, const double reads[], double t, double h)
{
    double m[PORTS];
    look(e, reads, e->x);
    for (int p = 0; p < PORTS; p++)
        m[p] = e->x[p] + 0.5 * e->gain[p];
    e->f = force_of(e, m, t + 0.5 * h, h);
    return e->f;
}

/* After a step, before the inputs change. */
static void gained(Effect *e, const double reads[])
{
    double now[PORTS];
    look(e, reads, now);
    for (int p = 0; p < PORTS; p++)
        e->gain[p] = now[p] - e->x[p];
}

/* Runs `rows` samples of `size` s, each of `fine` steps, from time `start` of the FMU. inputs: (rows, n_inputs),
 * held over a sample. reads: references of what is read, the first n_out go to out (rows, n_out). zero: the FMU's
 * time at which the effects' t is 0. Returns rows, or the first row that failed or is not finite. */
EXPORT long truth(const Fmu *s, double start, double size, long rows, int fine, double zero,
                  const unsigned *input_references, long n_inputs, const double *inputs,
                  const unsigned *read_references, long n_reads, long n_out, double *reads, double *out,
                  const unsigned *force_references, long n_forces, double *forces, Effect *effects, long n_effects)
{
    const double h = size / fine;
    for (long k = 0; k < rows; k++) {
        if (n_inputs && set(s, input_references, n_inputs, (double *)inputs + k * n_inputs) > 1)
            return k;
        if (get(s, read_references, n_reads, reads) > 1)
            return k;
        for (long j = 0; j < n_out; j++) {
            if (!isfinite(reads[j]))
                return k;
            out[k * n_out + j] = reads[j];
        }
        for (int q = 0; q < fine && k < rows - 1; q++) {
            const double t = start + (double)k * size + q * h;
            for (long f = 0; f < n_forces; f++)
                forces[f] = 0.0;
            for (long i = 0; i < n_effects; i++)
                forces[effects[i].force] += effect_force(&effects[i], reads, t - zero, h);
            if (n_forces && set(s, force_references, n_forces, forces) > 1)
                return k;
            if (step(s, t, h) > 1 || get(s, read_references, n_reads, reads) > 1)
                return k;
            for (long i = 0; i < n_effects; i++)
                gained(&effects[i], reads);
        }
    }
    return rows;
}

/* From a fresh instance, what is read under a held force: at once (n_reads) and after one step of h s (n_reads). */
EXPORT int probe(const Fmu *s, double start, double h, unsigned force, double size, const unsigned *read_references,
                 long n_reads, double *at_once, double *after)
{
    if (set(s, &force, 1, &size) > 1 || get(s, read_references, n_reads, at_once) > 1 || step(s, start, h) > 1)
        return 3;
    return get(s, read_references, n_reads, after);
}

EXPORT long effect_size(void) { return (long)sizeof(Effect); }
