/* The physical side: a plant with laws at its joints, by the pair of Dormand and Prince (1980) with a step that its error chooses, and
 * events located where a law changes its branch: a joint that comes to rest, breaks away or turns, a stop or a play that is reached.
 * Sources of the laws stand beside each. A force opposes a positive displacement, as a spring does. SI. */
#include <stdlib.h>

#include "plants.h"

enum { MOST = 6, SLIDERS = 12, NUMBERS = 8, STATES = 2 * N + MOST };
enum { FRICTION, LUGRE, STOP, PLAY, IWAN, MAXWELL, CUBIC, ORIFICE };
enum { FINE = 4 };                    /* rows a step of the inputs */
static const double RELATIVE = 1e-9, ABSOLUTE[3] = {1e-11, 1e-9, 1e-7}; /* of displacements, velocities, states of laws */

typedef struct {
    int type, joint, mode;       /* FRICTION: -1, 0 (sticks), 1. STOP, PLAY: 1 beyond the gap. */
    double p[NUMBERS];
    double z[SLIDERS], from;     /* IWAN: stretch of each spring when the joint was at `from` */
} Law;

typedef struct {
    Plant plant;
    const double *u;
    Law law[MOST];
    int laws;
} System;

static double sign(double x) { return (x > 0.0) - (x < 0.0); }

/* Sliding force: Coulomb's, and above it what breaks away, as Stribeck's curve has it (Armstrong-Helouvry, Dupont and Canudas de Wit,
 * Automatica 30 (1994), eq. 5, exponent 2). p: sliding, breakaway, Stribeck velocity. */
static double sliding(const double *p, double v)
{
    return p[1] > p[0] ? p[0] + (p[1] - p[0]) * exp(-(v / p[2]) * (v / p[2])) : p[0];
}

/* Force of a law, and the rate of its state z; nothing of a joint that sticks. */
static double force(const Law *l, double d, double v, double z, double *dz)
{
    const double *p = l->p;
    *dz = 0.0;
    switch (l->type) {
    case FRICTION:
        return l->mode * sliding(p, v);
    case LUGRE: /* Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE TAC 40 (1995), eqs. 1 to 4. p: as above, then bristles' stiffness, damping */
        *dz = v - p[3] * fabs(v) * z / sliding(p, v);
        return p[3] * z + p[4] * *dz;
    case STOP: { /* Hunt and Crossley, J. Appl. Mech. 42 (1975): what a stop takes grows with how deep and how fast; linear spring. p: gap, stiffness, s/m */
        const double deep = fabs(d) - p[0], hard = 1.0 + p[2] * v * sign(d);
        return l->mode ? sign(d) * p[1] * deep * (hard > 0.0 ? hard : 0.0) : 0.0;
    }
    case PLAY: /* no spring within the gap: takes the joint's own away (Nordin and Gutman, Automatica 38 (2002)). p: gap, its stiffness */
        return l->mode ? -p[1] * sign(d) * p[0] : -p[1] * d;
    case IWAN: { /* Iwan, J. Appl. Mech. 33 (1966): springs in series with sliders, side by side, that slip at evenly spread stretches. p: stiffness, mean stretch, number */
        double F = 0.0;
        const int n = (int)p[2];
        for (int i = 0; i < n; i++) {
            const double most = p[1] * (2.0 * i + 1.0) / n, now = l->z[i] + d - l->from;
            F += p[0] / n * (now > most ? most : now < -most ? -most : now);
        }
        return F;
    }
    case MAXWELL: /* a spring and a damper in a row (Findley, Lai and Onaran, Creep and Relaxation, 1976, sec. 5.2). p: stiffness, damping */
        *dz = p[0] * v - p[0] / p[1] * z;
        return z;
    case CUBIC: /* Duffing. p: N/m3 */
        return p[0] * d * d * d;
    default: { /* turbulent flow through an orifice, pressure as its square (Merritt, Hydraulic Control Systems, 1967, sec. 3.3); in rebound
                * the chamber behind cannot fall below vapour pressure (Dixon, The Shock Absorber Handbook, 2007). p: N s2/m2, most in rebound or 0 */
        const double F = p[0] * v * fabs(v);
        return p[1] > 0.0 && F < -p[1] ? -p[1] : F;
    }
    }
}

/* y' of y = (q, v, z). held: forces of the laws that stick, from that their joints' velocities do not change. */
static void rates(const System *s, const double *y, double *dy, double *held)
{
    const Plant *P = &s->plant;
    const double *q = y, *v = y + N, *z = y + 2 * N;
    double missing[JOINTS] = {0}, M[N][N], Q[N], way[MOST][N];
    int stuck[MOST], count = 0;
    memset(dy, 0, STATES * sizeof *dy);
    for (int i = 0; i < s->laws; i++) {
        const Law *l = s->law + i;
        double d, rate;
        joint_motion(P, l->joint, q, v, s->u, &d, &rate);
        missing[l->joint] += force(l, d, rate, z[i], dy + 2 * N + i);
        held[i] = 0.0;
        if (l->type == FRICTION && l->mode == 0)
            stuck[count++] = i;
    }
    plant_forces(P, q, v, s->u, missing, M, Q);
    solved(P->n, M, Q, dy + N);
    if (count > 0) { /* b a = 0 for each: (B M^-1 B') held = B a */
        double A[N][N] = {{0}}, r[N], x[N];
        for (int i = 0; i < count; i++)
            solved(P->n, M, P->B[s->law[stuck[i]].joint], way[i]);
        for (int i = 0; i < count; i++) {
            const double *b = P->B[s->law[stuck[i]].joint];
            r[i] = 0.0;
            for (int l = 0; l < P->n; l++)
                r[i] += b[l] * dy[N + l];
            for (int j = 0; j < count; j++)
                for (int l = 0; l < P->n; l++)
                    A[i][j] += b[l] * way[j][l];
        }
        solved(count, A, r, x);
        for (int i = 0; i < count; i++) {
            held[stuck[i]] = x[i];
            for (int l = 0; l < P->n; l++)
                dy[N + l] -= way[i][l] * x[i];
        }
    }
    memcpy(dy, v, (size_t)P->n * sizeof *dy);
}

static const double A[7][6] = {{0},
                               {1.0 / 5},
                               {3.0 / 40, 9.0 / 40},
                               {44.0 / 45, -56.0 / 15, 32.0 / 9},
                               {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
                               {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
                               {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
static const double LESS[7] = {71.0 / 57600, 0, -71.0 / 16695, 71.0 / 1920, -17253.0 / 339200, 22.0 / 525, -1.0 / 40};

/* One step; the error over what is allowed. */
static double step(const System *s, const double *y, double h, double *after)
{
    double k[7][STATES], held[MOST], worst = 0.0;
    for (int i = 0; i < 7; i++) {
        memcpy(after, y, STATES * sizeof *y);
        for (int j = 0; j < i; j++)
            for (int l = 0; l < STATES; l++)
                after[l] += h * A[i][j] * k[j][l];
        rates(s, after, k[i], held);
    }
    for (int l = 0; l < STATES; l++) {
        double e = 0.0;
        for (int i = 0; i < 7; i++)
            e += h * LESS[i] * k[i][l];
        e = fabs(e) / (ABSOLUTE[l / N > 2 ? 2 : l / N] + RELATIVE * fabs(y[l]));
        worst = e > worst || e != e ? e : worst;
    }
    return worst;
}

/* What changes its sign, from not negative to negative, where a law leaves its branch. */
static double margin(const System *s, int i, const double *y)
{
    const Law *l = s->law + i;
    double d, v, dy[STATES], held[MOST];
    joint_motion(&s->plant, l->joint, y, y + N, s->u, &d, &v);
    switch (l->type) {
    case FRICTION:
        if (l->mode != 0)
            return l->mode * v;
        rates(s, y, dy, held);
        return sliding(l->p, 0.0) - fabs(held[i]);
    case STOP:
    case PLAY:
        return l->mode ? fabs(d) - l->p[0] : l->p[0] - fabs(d);
    default:
        return 1.0;
    }
}

/* How fast a joint moves, so that memory's branches end where it turns. */
static double turning(const System *s, int i, const double *y)
{
    double d, v;
    joint_motion(&s->plant, s->law[i].joint, y, y + N, s->u, &d, &v);
    return s->law[i].type == IWAN || s->law[i].type == LUGRE ? v : 0.0;
}

/* Whether a step from y to after crosses an event. */
static int crossed(const System *s, const double *y, const double *after)
{
    for (int i = 0; i < s->laws; i++) {
        if (margin(s, i, after) < -1e-13 && margin(s, i, y) >= -1e-13)
            return 1;
        if (turning(s, i, y) * turning(s, i, after) < 0.0 && fabs(turning(s, i, y)) > 1e-12)
            return 1;
    }
    return 0;
}

/* Behind a step: the sliders of each Iwan law as they have slipped, and the branch that each law goes on in. */
static void settle(System *s, double *y)
{
    double dy[STATES], held[MOST];
    for (int i = 0; i < s->laws; i++) {
        Law *l = s->law + i;
        double d, v;
        joint_motion(&s->plant, l->joint, y, y + N, s->u, &d, &v);
        if (l->type == IWAN) {
            for (int j = 0; j < (int)l->p[2]; j++) {
                const double most = l->p[1] * (2.0 * j + 1.0) / (int)l->p[2], now = l->z[j] + d - l->from;
                l->z[j] = now > most ? most : now < -most ? -most : now;
            }
            l->from = d;
        } else if ((l->type == STOP || l->type == PLAY) && margin(s, i, y) < 0.0)
            l->mode = !l->mode;
        else if (l->type == FRICTION && l->mode != 0 && l->mode * v < 0.0) { /* at rest: the velocity that is left is of rounding */
            double M[N][N], Q[N], way[N], missing[JOINTS] = {0}, across = 0.0;
            plant_forces(&s->plant, y, y + N, s->u, missing, M, Q);
            solved(s->plant.n, M, s->plant.B[l->joint], way);
            for (int j = 0; j < s->plant.n; j++)
                across += s->plant.B[l->joint][j] * way[j];
            for (int j = 0; j < s->plant.n; j++)
                y[N + j] -= way[j] * v / across;
            l->mode = 0;
        }
    }
    rates(s, y, dy, held);
    for (int i = 0; i < s->laws; i++)
        if (s->law[i].type == FRICTION && s->law[i].mode == 0 && fabs(held[i]) > sliding(s->law[i].p, 0.0))
            s->law[i].mode = (int)sign(held[i]);
}

/* From rest, inputs u (rows, inputs) held over `size` s each. out (rows * FINE + 1, sensors + 2 joints): before and after each quarter of
 * a step, the sensors, then displacement and velocity of each joint. laws: type and joint of each in `what`, NUMBERS numbers in p. added:
 * kg at each joint. 0, or 1 where the step became too small or the motion unbounded. */
int truth(int which, const double *parameters, int laws, const int *what, const double *p, const double *added, const double *u, int rows,
          double size, const double *start, double *out)
{
    System s = {.laws = laws};
    double y[STATES] = {0}, after[STATES], h = size / FINE;
    plant_set(which, parameters, &s.plant);
    const Plant *P = &s.plant;
    const int wide = P->sensors + 2 * P->joints;
    for (int j = 0; j < P->joints; j++)
        for (int i = 0; i < N; i++)
            for (int l = 0; l < N; l++)
                s.plant.M[i][l] += added[j] * P->B[j][i] * P->B[j][l];
    for (int i = 0; i < laws; i++) {
        s.law[i].type = what[2 * i], s.law[i].joint = what[2 * i + 1];
        memcpy(s.law[i].p, p + NUMBERS * i, sizeof s.law[i].p);
    }
    for (int i = 0; i < 2 * P->n; i++)
        y[i / P->n * N + i % P->n] = start[i];
    for (int part = 0; part <= rows * FINE; part++) {
        double *row = out + (size_t)part * (size_t)wide, done = 0.0;
        s.u = u + (part < rows * FINE ? part / FINE : rows - 1) * P->inputs;
        if (part == 0)
            for (int i = 0; i < laws; i++) { /* the branches that the start is in; who moves, slides */
                double d, v;
                joint_motion(P, s.law[i].joint, y, y + N, s.u, &d, &v);
                s.law[i].from = d;
                s.law[i].mode = s.law[i].type == FRICTION ? (int)sign(v) : fabs(d) > s.law[i].p[0];
            }
        for (int i = 0; i < P->sensors; i++) {
            row[i] = 0.0;
            for (int j = 0; j < P->n; j++)
                row[i] += P->Y[i][j] * y[j];
        }
        for (int j = 0; j < P->joints; j++)
            joint_motion(P, j, y, y + N, s.u, row + P->sensors + 2 * j, row + P->sensors + 2 * j + 1);
        settle(&s, y);
        for (int tries = 0; part < rows * FINE && done < size / FINE * (1.0 - 1e-12); tries++) {
            const double left = size / FINE - done;
            double now = h < left ? h : left;
            const double error = step(&s, y, now, after);
            if (tries > 100000 || error != error || fabs(after[0]) > 1e6)
                return 1;
            const double factor = 0.9 * pow(error > 1e-10 ? error : 1e-10, -0.2);
            if (error > 1.0 && now > 1e-9) {
                h = now * (factor > 0.2 ? factor : 0.2);
                continue;
            }
            if (crossed(&s, y, after)) { /* the smallest step that crosses, by halves */
                double below = 0.0, above = now;
                while (above - below > 1e-12) {
                    const double middle = 0.5 * (below + above);
                    step(&s, y, middle, after);
                    if (crossed(&s, y, after))
                        above = middle;
                    else
                        below = middle;
                }
                now = above;
                step(&s, y, now, after);
            } else
                h = now * (factor < 4.0 ? factor : 4.0), h = h > size / FINE ? size / FINE : h;
            memcpy(y, after, sizeof y);
            done += now;
            settle(&s, y);
        }
    }
    return 0;
}
