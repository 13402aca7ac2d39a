/* Steps an FMU along a condition with laws at its joints, as the wrapped FMU would do it, at the speed of C.
 *
 * The instance belongs to the caller, who has opened and initialised it; its functions come as pointers. Laws see what
 * a joint will show in the middle of a sub-step, and their force is held over it (see coupling.c in wrapping). */
#include "march.h"
#include "joint.h"
#include "together.h"

#include <stdbool.h>
#include <stddef.h>
#include <string.h>

/* Of FMI's statuses the worst with which a solver goes on. */
enum { WARNING = 1 };

typedef int Step2(void *, double, double, int);
typedef int Access2(void *, const unsigned[], size_t, double[]);
typedef int Step3(void *, double, double, bool, bool *, bool *, bool *, double *);
typedef int Access3(void *, const unsigned[], size_t, double[], size_t);

/* An opened instance. fmi: 2 or 3. */
typedef struct {
    void *component, *step, *get, *set;
    int fmi;
} Solver;

/* One law at one joint. port: places among the values that are read, -1 where the joint has none; factor: to SI. force:
 * place among the force inputs; force_factor: from the law's force to the input. seen: readings so far, at most 2.
 * last: the newest one, with the mean velocity of the sub-step before it where the displacement is differentiated, and the
 * acceleration without what the forces had to do with it. answer: how the acceleration answers to each of the force inputs
 * at once, in m/s2 a unit; NULL for a law that does not see it. */
typedef struct {
    int law, port[4], force, seen;
    double factor[4], force_factor, last[4];
    const double *p, *answer;
    double *z;
} Placed;

/* Where and what is stepped: `steps` steps of `size` s from `start`, each in `parts` sub-steps. inputs: (steps + 1,
 * n_inputs) rows. reads: references of what is read after every sub-step, responses first; out: (steps + 1,
 * n_responses). forces: references of the force inputs, and where the same input is among those of the row: laws push
 * on top of what is given there; -1 where it is not, and then of force_starts. force_values: what they hold. */
typedef struct {
    double start, size;
    long steps, parts;
    const unsigned *input_references;
    long n_inputs;
    const double *inputs;
    const unsigned *read_references;
    long n_reads, n_responses;
    double *reads, *out;
    const unsigned *force_references;
    const long *force_columns;
    const double *force_starts;
    long n_forces;
    double *force_values;
} Road;

static int get(const Solver *s, const unsigned r[], size_t n, double v[])
{
    return s->fmi == 2 ? ((Access2 *)s->get)(s->component, r, n, v) : ((Access3 *)s->get)(s->component, r, n, v, n);
}

static int set(const Solver *s, const unsigned r[], size_t n, double v[])
{
    return s->fmi == 2 ? ((Access2 *)s->set)(s->component, r, n, v) : ((Access3 *)s->set)(s->component, r, n, v, n);
}

static int step(const Solver *s, double t, double h)
{
    if (s->fmi == 2)
        return ((Step2 *)s->step)(s->component, t, h, 1);
    bool event, terminate, early;
    double last;
    const int status = ((Step3 *)s->step)(s->component, t, h, true, &event, &terminate, &early, &last);
    return terminate || early ? 3 : status;
}

/* What the acceleration that a law sees has of these forces. */
static double answered(const Placed *law, const double forces[], long n_forces)
{
    double sum = 0.0;
    for (long f = 0; f < n_forces; f++)
        sum += law->answer[f] * forces[f];
    return sum;
}

/* What the law sees in the middle of a sub-step of h s, the acceleration as without all forces. */
static void look(Placed *law, const Road *road, double h, double port[4])
{
    double now[4];
    for (int p = 0; p < 4; p++)
        now[p] = law->port[p] < 0 ? 0.0 : law->factor[p] * road->reads[law->port[p]];
    if (law->answer)
        now[2] -= answered(law, road->force_values, road->n_forces);
    predict(now, law->last, law->port[1] >= 0, (unsigned)law->seen, law->seen ? h : 0.0, h, h, port);
    law->seen += law->seen < 2;
}

/* The force inputs with what `row` gives them, before any law. */
static void given(const Road *road, const double row[])
{
    for (long f = 0; f < road->n_forces; f++)
        road->force_values[f] = road->force_columns[f] < 0 ? road->force_starts[f] : row[road->force_columns[f]];
}

/* The inputs of `row` are set, and forces of laws stay on top of them: what a force input passes on at once shows both.
 * The solver's status. */
static int enter(const Solver *s, const Road *road, const double row[], const double pushed[])
{
    double values[road->n_inputs + 1];
    memcpy(values, row, (size_t)road->n_inputs * sizeof *row);
    given(road, row);
    for (long f = 0; f < road->n_forces; f++) {
        road->force_values[f] += pushed[f];
        if (road->force_columns[f] >= 0)
            values[road->force_columns[f]] = road->force_values[f];
    }
    return road->n_inputs ? set(s, road->input_references, (size_t)road->n_inputs, values) : 0;
}

/* One sub-step of h s from t, with the inputs of `row`; the joints have been read. pushed: gets the laws' part of the force
 * inputs. The solver's status. */
static int advance(const Solver *s, const Road *road, const double row[], double pushed[], Placed laws[], long n_laws,
                   double t, double h)
{
    double ports[n_laws + 1][4], force[n_laws + 1], slope[n_laws + 1], answers[n_laws * n_laws + 1];
    for (long i = 0; i < n_laws; i++)
        look(&laws[i], road, h, ports[i]);
    given(road, row);
    memset(pushed, 0, (size_t)road->n_forces * sizeof *pushed);
    for (long i = 0; i < n_laws; i++) {
        Placed *law = &laws[i];
        if (law->answer)
            ports[i][2] += answered(law, road->force_values, road->n_forces);
        force[i] = LAWS[law->law](law->p, ports[i], t + 0.5 * h, h, law->z);
        slope[i] = 0.0;
        if (law->answer) {
            ports[i][2] += 1.0;
            slope[i] = LAWS[law->law](law->p, ports[i], t + 0.5 * h, h, law->z) - force[i];
        }
        for (long j = 0; j < n_laws; j++)
            answers[i * n_laws + j] = law->answer ? law->answer[laws[j].force] * laws[j].force_factor : 0.0;
    }
    together((size_t)n_laws, slope, answers, force);
    for (long i = 0; i < n_laws; i++)
        pushed[laws[i].force] += laws[i].force_factor * force[i];
    for (long f = 0; f < road->n_forces; f++)
        road->force_values[f] += pushed[f];
    const int status = road->n_forces ? set(s, road->force_references, (size_t)road->n_forces, road->force_values) : 0;
    return status > WARNING ? status : step(s, t, h);
}

/* Number of the first step that failed, or `steps` when all went well; rows up to it are filled. status: of the last call. */
__attribute__((visibility("default"))) long march(const Solver *s, const Road *road, Placed laws[], long n_laws, int *status)
{
    const double h = road->size / (double)road->parts;
    double pushed[road->n_forces + 1];
    memset(pushed, 0, sizeof pushed);
    for (long k = 0; k <= road->steps; k++) {
        const double *row = road->inputs + k * road->n_inputs;
        if ((*status = enter(s, road, row, pushed)) > WARNING)
            return k;
        if ((*status = get(s, road->read_references, (size_t)road->n_reads, road->reads)) > WARNING)
            return k;
        for (long j = 0; j < road->n_responses; j++)
            road->out[k * road->n_responses + j] = road->reads[j];
        if (k == road->steps)
            break;
        const double t = road->start + (double)k * road->size;
        for (long part = 0; part < road->parts; part++) {
            if (part && (*status = get(s, road->read_references, (size_t)road->n_reads, road->reads)) > WARNING)
                return k;
            if ((*status = advance(s, road, row, pushed, laws, n_laws, t + (double)part * h, h)) > WARNING)
                return k;
        }
    }
    return road->steps;
}
