/* A plant as a co-simulation slave of FMI 2.0: classical Runge-Kutta, four steps to a millisecond, inputs held over a step.
 * Value references: parameters from 0, inputs from 100, missing forces of the joints from 200, and outputs from 300 (sensors),
 * 400 (displacement), 500 (velocity), 600 (own force) and 700 (acceleration of the body, along the joint). */
#include "fmi2Functions.h"

#include <stdlib.h>

#include "plants.h"

typedef struct {
    Plant plant;
    double p[PARAMETERS], u[INPUTS], f[JOINTS], q[N], v[N], time;
    fmi2Boolean stale;
} Slave;

static const double START[PARAMETERS] = {START_VALUES};

static void fresh(Slave *s)
{
    memset(s, 0, sizeof *s);
    memcpy(s->p, START, sizeof s->p);
    s->stale = fmi2True;
}

static const Plant *plant(Slave *s)
{
    if (s->stale)
        plant_set(WHICH, s->p, &s->plant);
    s->stale = fmi2False;
    return &s->plant;
}

static void acceleration(const Slave *s, const double *q, const double *v, double *a)
{
    double M[N][N], Q[N];
    plant_forces(&s->plant, q, v, s->u, s->f, M, Q);
    solved(s->plant.n, M, Q, a);
}

static void step(Slave *s, double h)
{
    static const double at[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    const int n = s->plant.n;
    double q[N], v[N], dq[N] = {0}, dv[N] = {0}, nq[N], nv[N];
    memcpy(nq, s->q, sizeof nq), memcpy(nv, s->v, sizeof nv);
    for (int k = 0; k < 4; k++) {
        for (int i = 0; i < n; i++)
            q[i] = s->q[i] + h * at[k] * dq[i], v[i] = s->v[i] + h * at[k] * dv[i];
        acceleration(s, q, v, dv);
        memcpy(dq, v, sizeof dq);
        for (int i = 0; i < n; i++)
            nq[i] += h * weight[k] * dq[i], nv[i] += h * weight[k] * dv[i];
    }
    memcpy(s->q, nq, sizeof nq), memcpy(s->v, nv, sizeof nv);
}

static double *place(Slave *s, fmi2ValueReference vr)
{
    const unsigned i = vr % 100;
    if (vr < 100)
        return i < PARAMETERS ? s->p + i : NULL;
    if (vr < 200)
        return i < INPUTS ? s->u + i : NULL;
    return vr < 300 && i < JOINTS ? s->f + i : NULL;
}

static double output(Slave *s, fmi2ValueReference vr)
{
    const Plant *P = plant(s);
    const int j = (int)(vr % 100);
    double value = 0.0, d, rate, a[N] = {0};
    if (vr < 400) {
        for (int i = 0; i < P->n; i++)
            value += P->Y[j][i] * s->q[i];
        return value;
    }
    joint_motion(P, j, s->q, s->v, s->u, &d, &rate);
    if (vr < 600)
        return vr < 500 ? d : rate;
    if (vr < 700)
        return P->k[j] * d + P->c[j] * rate;
    acceleration(s, s->q, s->v, a);
    for (int i = 0; i < P->n; i++)
        value += P->B[j][i] * a[i];
    return value;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)type, (void)guid, (void)resources, (void)functions, (void)visible, (void)logging;
    Slave *s = malloc(sizeof *s);
    if (s != NULL)
        fresh(s);
    return s;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance, fmi2Real start, fmi2Boolean ends, fmi2Real stop)
{
    (void)defined, (void)tolerance, (void)ends, (void)stop;
    ((Slave *)c)->time = start;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    fresh(c);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    for (size_t i = 0; i < n; i++) {
        const double *at = place(c, vr[i]);
        value[i] = at != NULL ? *at : output(c, vr[i]);
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    for (size_t i = 0; i < n; i++) {
        double *at = place(c, vr[i]);
        if (at == NULL)
            return fmi2Error;
        *at = value[i];
        if (vr[i] < 100)
            ((Slave *)c)->stale = fmi2True;
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean unchanged)
{
    (void)unchanged;
    Slave *s = c;
    plant(s);
    const int parts = (int)ceil(size / 2.5e-4 - 1e-9);
    for (int i = 0; i < parts; i++)
        step(s, size / parts);
    s->time = time + size;
    return fmi2OK;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

#define NOTHING_TO_DO(function)                                                                                                          \
    fmi2Status function(fmi2Component c)                                                                                                 \
    {                                                                                                                                    \
        (void)c;                                                                                                                         \
        return fmi2OK;                                                                                                                   \
    }
NOTHING_TO_DO(fmi2EnterInitializationMode)
NOTHING_TO_DO(fmi2ExitInitializationMode)
NOTHING_TO_DO(fmi2Terminate)
NOTHING_TO_DO(fmi2CancelStep)

#define NONE(function, ...)                                                                                                              \
    fmi2Status function(fmi2Component c, __VA_ARGS__)                                                                                    \
    {                                                                                                                                    \
        (void)c;                                                                                                                         \
        return fmi2Error;                                                                                                                \
    }
NONE(fmi2SetDebugLogging, fmi2Boolean on, size_t n, const fmi2String categories[])
NONE(fmi2GetInteger, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
NONE(fmi2GetBoolean, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
NONE(fmi2GetString, const fmi2ValueReference vr[], size_t n, fmi2String value[])
NONE(fmi2SetInteger, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
NONE(fmi2SetBoolean, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
NONE(fmi2SetString, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
NONE(fmi2GetFMUstate, fmi2FMUstate *state)
NONE(fmi2SetFMUstate, fmi2FMUstate state)
NONE(fmi2FreeFMUstate, fmi2FMUstate *state)
NONE(fmi2SerializedFMUstateSize, fmi2FMUstate state, size_t *size)
NONE(fmi2SerializeFMUstate, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
NONE(fmi2DeSerializeFMUstate, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
NONE(fmi2SetRealInputDerivatives, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], const fmi2Real value[])
NONE(fmi2GetRealOutputDerivatives, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], fmi2Real value[])
NONE(fmi2GetDirectionalDerivative, const fmi2ValueReference x[], size_t n, const fmi2ValueReference z[], size_t m, const fmi2Real d[],
     fmi2Real value[])
NONE(fmi2GetStatus, const fmi2StatusKind kind, fmi2Status *value)
NONE(fmi2GetRealStatus, const fmi2StatusKind kind, fmi2Real *value)
NONE(fmi2GetIntegerStatus, const fmi2StatusKind kind, fmi2Integer *value)
NONE(fmi2GetBooleanStatus, const fmi2StatusKind kind, fmi2Boolean *value)
NONE(fmi2GetStringStatus, const fmi2StatusKind kind, fmi2String *value)
