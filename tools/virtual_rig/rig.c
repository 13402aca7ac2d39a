/* The physical side of a virtual rig: a rail model with hidden effects at its joints, integrated with a finer step.
 *
 * The model's own equations (fmus/<model>/model.c) are driven through the same joints that users see, but the hidden
 * forces are evaluated inside every stage of the integrator, with internal states where an effect has them. */
#include "variables.h"

#include <string.h>

typedef enum { SPRING, DAMPER, MASS, CUBIC, QUADRATIC, FRICTION, DEADBAND, STOP, ASYMMETRY, PRELOAD, PERIODIC, BOUC_WEN } Law;

/* One hidden effect. d, v, f: indices of the joint's displacement, velocity and force input in v[].
 * a, b, c: see force(). The force opposes a positive displacement, as a spring's does. */
typedef struct {
    int law, d, v, f;
    double a, b, c;
} Effect;

static double dead(double x, double half) { return x > half ? x - half : x < -half ? x + half : 0.0; }

/* Force of one effect, and the derivative of its hidden state (displacement-like, m). */
static double force(const Effect *e, const double *v, double time, double state, double *rate)
{
    const double d = v[e->d], s = v[e->v];
    *rate = 0.0;
    switch (e->law) {
    case SPRING: return e->a * d;
    case DAMPER: return e->a * s;
    case CUBIC: return e->a * d * d * d;
    case QUADRATIC: return e->a * s * fabs(s);
    case FRICTION: { /* Dahl bristle with presliding stiffness b = F / 20 um unless given: sharper than any tanh */
        const double k = e->b, g = k * state / e->a;
        *rate = s * (1.0 - copysign(1.0, s) * g);
        return k * state + e->c * s;
    }
    case DEADBAND: return e->a * (dead(d, e->b) - d); /* play of half-width b m in a spring of stiffness a N/m */
    case STOP: return e->a * dead(d, e->b);
    case ASYMMETRY: return s > 0.0 ? e->a * s : -e->a * s;
    case PRELOAD: return e->a;
    case PERIODIC: return e->a * sin(2.0 * 3.14159265358979323846 * e->b * time + e->c);
    case BOUC_WEN: *rate = s * (1.0 - pow(fabs(state) / e->b, 1.5) * (0.7 * copysign(1.0, s * state) + 0.3)); return e->a * state;
    default: return 0.0;
    }
}

enum { MAX_EFFECTS = 16 };

/* Inputs and derivatives at one stage: v holds the states; hidden the effects' own. */
static void stage(double *v, const Effect *e, int n, const double *hidden, double *rates)
{
    for (int i = 0; i < n; i++)
        v[e[i].f] = 0.0;
    model_outputs(v); /* displacements and velocities of the joints do not depend on the forces */
    double f[MAX_EFFECTS];
    for (int i = 0; i < n; i++)
        f[i] = force(&e[i], v, v[V_time], hidden[i], &rates[i]);
    for (int i = 0; i < n; i++)
        v[e[i].f] += f[i];
    model_derivatives(v);
}

#define EXPORT __attribute__((visibility("default")))

EXPORT int variable_count(void) { return NV; }
EXPORT const char *variable_name(int i) { return variables[i].name; }
EXPORT double variable_start(int i) { return variables[i].start; }

/* Runs `rows` samples of `step` s, each cut into `substeps` Runge-Kutta steps. command: the platform's command in deg at
 * each sample, linear between; input: index of the model's platform input. out: rows x columns. 0, or the row of a NaN. */
EXPORT int run_rig(double *v, const Effect *e, int n, const double *command, int input, int rows, double step, int substeps,
                   const int *columns, int n_columns, double *out)
{
    const double h = step / substeps;
    double x0[NX], k[4][NX], hidden[MAX_EFFECTS] = {0}, hidden0[MAX_EFFECTS], rates[4][MAX_EFFECTS] = {{0}};
    static const double at[4] = {0.0, 0.5, 0.5, 1.0};
    for (int row = 0; row < rows; row++) {
        const double t0 = row * step;
        const double c0 = command[row], c1 = row + 1 < rows ? command[row + 1] : c0;
        v[V_time] = t0;
        v[input] = c0;
        stage(v, e, n, hidden, rates[0]);
        model_outputs(v);
        for (int c = 0; c < n_columns; c++) {
            const double y = v[columns[c]];
            if (!isfinite(y))
                return row + 1;
            out[(size_t)row * n_columns + c] = y;
        }
        for (int s = 0; s < substeps; s++) {
            memcpy(x0, v + X0, sizeof x0);
            memcpy(hidden0, hidden, sizeof hidden);
            for (int q = 0; q < 4; q++) {
                const double part = at[q] * h;
                for (int i = 0; i < NX; i++)
                    v[X0 + i] = x0[i] + (q ? part * k[q - 1][i] : 0.0);
                for (int i = 0; i < n; i++)
                    hidden[i] = hidden0[i] + (q ? part * rates[q - 1][i] : 0.0);
                v[V_time] = t0 + s * h + part;
                v[input] = c0 + (c1 - c0) * (s * h + part) / step;
                stage(v, e, n, hidden, rates[q]);
                memcpy(k[q], v + DX0, sizeof k[q]);
            }
            for (int i = 0; i < NX; i++)
                v[X0 + i] = x0[i] + h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
            for (int i = 0; i < n; i++)
                hidden[i] = hidden0[i] + h / 6.0 * (rates[0][i] + 2.0 * rates[1][i] + 2.0 * rates[2][i] + rates[3][i]);
        }
    }
    return 0;
}
