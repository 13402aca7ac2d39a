/* Partial derivatives by central differences. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "instance.h"

static Status check_derivative(Instance *self, const unsigned unknowns[], size_t n_unknowns, const unsigned knowns[], size_t n_knowns)
{
    for (size_t i = 0; i < n_unknowns + n_knowns; i++) {
        const bool known = i >= n_unknowns;
        const unsigned reference = known ? knowns[i - n_unknowns] : unknowns[i];
        if (reference >= NV)
            return instance_log(self, STATUS_ERROR, "derivative: expected a value reference from 0 to %d, got %u", NV - 1, reference);
        const Causality c = variables[reference].causality;
        if (known ? c != INPUT && c != STATE && c != PARAMETER && c != TUNABLE : c != OUTPUT && c != LOCAL && c != DERIVATIVE)
            return instance_log(self, STATUS_ERROR, "derivative: expected %s, got %s",
                                known ? "an input, state or parameter as known" : "an output, local or state derivative as unknown", variables[reference].name);
    }
    return STATUS_OK;
}

/* d v / d known around the present v: (plus - minus) / *width. */
static void differences(const Instance *self, unsigned known, double plus[NV], double minus[NV], double *width)
{
    const double step = cbrt(DBL_EPSILON) * fmax(fabs(self->state.v[known]), variables[known].nominal);
    memcpy(plus, self->state.v, sizeof self->state.v);
    memcpy(minus, self->state.v, sizeof self->state.v);
    plus[known] += step;
    minus[known] -= step;
    *width = plus[known] - minus[known];
    instance_evaluate(self, plus);
    instance_evaluate(self, minus);
}

Status instance_directional(Instance *self, const unsigned unknowns[], size_t n_unknowns, const unsigned knowns[], size_t n_knowns,
                            const double seed[], double sensitivity[])
{
    double plus[NV], minus[NV], width;
    if (check_derivative(self, unknowns, n_unknowns, knowns, n_knowns))
        return STATUS_ERROR;
    for (size_t j = 0; j < n_unknowns; j++)
        sensitivity[j] = 0.0;
    for (size_t i = 0; i < n_knowns; i++) {
        differences(self, knowns[i], plus, minus, &width);
        for (size_t j = 0; j < n_unknowns; j++)
            sensitivity[j] += seed[i] * (plus[unknowns[j]] - minus[unknowns[j]]) / width;
    }
    return STATUS_OK;
}

Status instance_adjoint(Instance *self, const unsigned unknowns[], size_t n_unknowns, const unsigned knowns[], size_t n_knowns,
                        const double seed[], double sensitivity[])
{
    double plus[NV], minus[NV], width;
    if (check_derivative(self, unknowns, n_unknowns, knowns, n_knowns))
        return STATUS_ERROR;
    for (size_t i = 0; i < n_knowns; i++) {
        differences(self, knowns[i], plus, minus, &width);
        sensitivity[i] = 0.0;
        for (size_t j = 0; j < n_unknowns; j++)
            sensitivity[i] += seed[j] * (plus[unknowns[j]] - minus[unknowns[j]]) / width;
    }
    return STATUS_OK;
}
