/* Five small plants as M(q) q" + K q + C q' + sum over joints b (k d + c d' + missing force) = G u. SI.
 *
 * Sources: quarter car (Gillespie, Fundamentals of Vehicle Dynamics, 1992, ch. 5); geared drive, referred to neither side (Dresig and
 * Holzweissig, Dynamics of Machinery, 2010, ch. 4); cantilever by its first three modes (Blevins, Formulas for Natural Frequency and
 * Mode Shape, 1979, table 8-1); rigid body on two springs (Wickens, Fundamentals of Rail Vehicle Dynamics, 2003); crane, a pendulum
 * under a trolley (Fantoni and Lozano, Non-linear Control for Underactuated Mechanical Systems, 2002). */
#include <math.h>
#include <string.h>

enum { N = 3, JOINTS = 3, INPUTS = 2, SENSORS = 3, PARAMETERS = 12 };

typedef struct {
    int n, joints, inputs, sensors;
    double M[N][N], K[N][N], C[N][N]; /* K and C: of what is no joint */
    double B[JOINTS][N], E[JOINTS];   /* displacement of a joint: B q + E u[0], velocity B q' + E u[1] */
    double k[JOINTS], c[JOINTS];      /* the joint's own spring and damper */
    double G[N][INPUTS];              /* inputs that are forces */
    double Y[SENSORS][N];
    double hang, weight;              /* crane: m l and m g l */
} Plant;

/* Mode shape of a cantilever of length 1, tip displacement 2; the mass of the mode is the mass of the beam. */
static double mode(int i, double x)
{
    static const double root[N] = {1.87510406871196, 4.69409113297417, 7.85475743823761};
    const double b = root[i], s = (sinh(b) - sin(b)) / (cosh(b) + cos(b));
    return cosh(b * x) - cos(b * x) - s * (sinh(b * x) - sin(b * x));
}

static void plant_set(int which, const double *p, Plant *P)
{
    memset(P, 0, sizeof *P);
    P->n = P->joints = P->sensors = 2, P->inputs = 1;
    switch (which) {
    case 0: /* corner: body and wheel over a platform. body, wheel, spring, damper, tyre, tyre damper */
        P->inputs = 2;
        P->M[0][0] = p[0], P->M[1][1] = p[1];
        P->B[0][0] = 1.0, P->B[0][1] = -1.0, P->k[0] = p[2], P->c[0] = p[3];
        P->B[1][1] = 1.0, P->E[1] = -1.0, P->k[1] = p[4], P->c[1] = p[5];
        P->Y[0][0] = 1.0, P->Y[1][0] = 1.0, P->Y[1][1] = -1.0;
        break;
    case 1: /* drive: motor and load. motor, load, shaft, shaft damper, return spring, load damper, motor bearing, ratio */
        P->joints = 3;
        P->M[0][0] = p[0], P->M[1][1] = p[1];
        P->B[0][0] = 1.0 / p[7], P->B[0][1] = -1.0, P->k[0] = p[2], P->c[0] = p[3];
        P->B[1][1] = 1.0, P->k[1] = p[4], P->c[1] = p[5];
        P->B[2][0] = 1.0, P->c[2] = p[6];
        P->G[0][0] = 1.0, P->Y[0][0] = 1.0, P->Y[1][1] = 1.0;
        break;
    case 2: /* beam: mass, bending stiffness EI / L^3, damping ratio, tip spring, tip damper, damper in the middle */
        P->n = 3;
        for (int i = 0; i < N; i++) {
            static const double root[N] = {1.87510406871196, 4.69409113297417, 7.85475743823761};
            P->M[i][i] = p[0], P->K[i][i] = p[1] * root[i] * root[i] * root[i] * root[i];
            P->C[i][i] = 2.0 * p[2] * sqrt(P->K[i][i] * p[0]);
            P->B[0][i] = mode(i, 1.0), P->B[1][i] = mode(i, 0.55);
            P->G[i][0] = mode(i, 0.4);
            P->Y[0][i] = mode(i, 0.97), P->Y[1][i] = mode(i, 0.6);
        }
        P->k[0] = p[3], P->c[0] = p[4], P->c[1] = p[5];
        break;
    case 3: /* bogie: lateral and yaw. mass, inertia, front spring, front damper, rear spring, rear damper; pushed 0.7 m before the middle */
        P->M[0][0] = p[0], P->M[1][1] = p[1];
        P->B[0][0] = P->B[1][0] = 1.0, P->B[0][1] = 1.2, P->B[1][1] = -1.3;
        P->k[0] = p[2], P->c[0] = p[3], P->k[1] = p[4], P->c[1] = p[5];
        P->G[0][0] = 1.0, P->G[1][0] = 0.7;
        P->Y[0][0] = P->Y[1][0] = 1.0, P->Y[0][1] = 1.6, P->Y[1][1] = -0.9;
        break;
    default: /* crane: trolley, load, rope, rail spring, rail damper, pivot damper */
        P->M[0][0] = p[0] + p[1], P->M[1][1] = p[1] * p[2] * p[2];
        P->hang = p[1] * p[2], P->weight = p[1] * p[2] * 9.81;
        P->B[0][0] = 1.0, P->k[0] = p[3], P->c[0] = p[4];
        P->B[1][1] = 1.0, P->c[1] = p[5];
        P->G[0][0] = 1.0, P->Y[0][0] = 1.0, P->Y[1][1] = 1.0;
    }
}

static void joint_motion(const Plant *P, int j, const double *q, const double *v, const double *u, double *d, double *rate)
{
    *d = P->E[j] * u[0], *rate = P->E[j] * (P->inputs > 1 ? u[1] : 0.0);
    for (int i = 0; i < P->n; i++)
        *d += P->B[j][i] * q[i], *rate += P->B[j][i] * v[i];
}

/* Mass matrix and generalised forces; missing: of each joint, opposing. */
static void plant_forces(const Plant *P, const double *q, const double *v, const double *u, const double *missing, double M[N][N], double *Q)
{
    for (int i = 0; i < P->n; i++) {
        Q[i] = 0.0;
        for (int j = 0; j < P->n; j++)
            M[i][j] = P->M[i][j], Q[i] -= P->K[i][j] * q[j] + P->C[i][j] * v[j];
        for (int j = 0; j < P->inputs; j++)
            Q[i] += P->G[i][j] * u[j];
    }
    if (P->hang != 0.0) {
        M[0][1] += P->hang * cos(q[1]), M[1][0] += P->hang * cos(q[1]);
        Q[0] += P->hang * sin(q[1]) * v[1] * v[1], Q[1] -= P->weight * sin(q[1]);
    }
    for (int j = 0; j < P->joints; j++) {
        double d, rate;
        joint_motion(P, j, q, v, u, &d, &rate);
        const double F = P->k[j] * d + P->c[j] * rate + missing[j];
        for (int i = 0; i < P->n; i++)
            Q[i] -= P->B[j][i] * F;
    }
}

/* x of M x = r, M symmetric and positive definite: elimination without pivots. */
static void solved(int n, double M[N][N], const double *r, double *x)
{
    double A[N][N];
    memcpy(A, M, sizeof A);
    memcpy(x, r, (size_t)n * sizeof *x);
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) {
            const double w = A[j][i] / A[i][i];
            for (int l = i; l < n; l++)
                A[j][l] -= w * A[i][l];
            x[j] -= w * x[i];
        }
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++)
            x[i] -= A[i][j] * x[j];
        x[i] /= A[i][i];
    }
}
