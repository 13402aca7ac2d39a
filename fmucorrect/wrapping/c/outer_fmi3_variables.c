/* The wrapped FMU's functions of FMI 3.0: reading and writing variables, and what it does not have. */
#include "fmi3Functions.h"
#include "wrapper.h"

#define REFUSE_WITHOUT_INSTANCE                                                                                          \
    if (!instance)                                                                                                       \
        return fmi3Error;                                                                                                \
    Wrapper *const self = instance

#if DIRECT
/* A run of the solver's own variables; where the wrapper's are asked for in the same call, arrays count with their declared size. */
#define RUN(function, touched)                                                                                           \
    const size_t run = solver_run(vr + i, n - i);                                                                        \
    if (run) {                                                                                                           \
        size_t count = run == n ? n_values : 0;                                                                          \
        for (size_t k = 0; k < run && run < n; k++)                                                                      \
            count += variable_size(vr[i + k]);                                                                           \
        if (at + count > n_values)                                                                                       \
            return (fmi3Status)wrapper_log(self, STATUS_ERROR, "fmi3" #function ": room for %zu values was given, %zu are needed", \
                                           n_values, at + count);                                                        \
        touched;                                                                                                         \
        const Status status =                                                                                            \
            self->inner.function ? (Status)self->inner.function(self->inner.component, vr + i, run, values + at, count)  \
                                 : STATUS_ERROR;                                                                         \
        worst = status > worst ? status : worst;                                                                         \
        i += run;                                                                                                        \
        at += count;                                                                                                     \
        continue;                                                                                                        \
    }
#else
#define RUN(function, touched)
#endif
#define ROOM(function)                                                                                                   \
    if (at >= n_values)                                                                                                  \
    return (fmi3Status)wrapper_log(self, STATUS_ERROR, "fmi3" #function ": %zu values for %zu variables", n_values, n)

#define ACCESS(Name, CLASS, member)                                                                                      \
    fmi3Status fmi3Get##Name(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3##Name values[], size_t n_values) \
    {                                                                                                                    \
        REFUSE_WITHOUT_INSTANCE;                                                                                         \
        Status worst = STATUS_OK;                                                                                        \
        for (size_t i = 0, at = 0; i < n && worst <= STATUS_WARNING;) {                                                  \
            RUN(Get##Name, (void)0)                                                                                      \
            const size_t size = variable_size(vr[i]);                                                                    \
            for (size_t element = 0; element < size; element++) {                                                        \
                ROOM(Get##Name);                                                                                         \
                Value got = {CLASS, 0.0, 0, NULL};                                                                       \
                const Status one = variable_get(self, vr[i], element, CLASS, &got);                                      \
                worst = one > worst ? one : worst;                                                                       \
                values[at++] = (fmi3##Name)got.member;                                                                   \
            }                                                                                                            \
            i++;                                                                                                         \
        }                                                                                                                \
        return (fmi3Status)worst;                                                                                        \
    }                                                                                                                    \
    fmi3Status fmi3Set##Name(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3##Name values[],  \
                             size_t n_values)                                                                            \
    {                                                                                                                    \
        REFUSE_WITHOUT_INSTANCE;                                                                                         \
        Status worst = STATUS_OK;                                                                                        \
        for (size_t i = 0, at = 0; i < n && worst <= STATUS_WARNING;) {                                                  \
            RUN(Set##Name, variables_touched(self))                                                                      \
            const size_t size = variable_size(vr[i]);                                                                    \
            for (size_t element = 0; element < size; element++) {                                                        \
                ROOM(Set##Name);                                                                                         \
                Value given = {CLASS, 0.0, 0, NULL};                                                                     \
                given.member = (Value_##member)values[at++];                                                             \
                const Status one = variable_set(self, vr[i], element, &given);                                           \
                worst = one > worst ? one : worst;                                                                       \
            }                                                                                                            \
            i++;                                                                                                         \
        }                                                                                                                \
        return (fmi3Status)worst;                                                                                        \
    }

ACCESS(Float32, NUMBER, number)
ACCESS(Float64, NUMBER, number)
ACCESS(Int8, INTEGER, integer)
ACCESS(UInt8, INTEGER, integer)
ACCESS(Int16, INTEGER, integer)
ACCESS(UInt16, INTEGER, integer)
ACCESS(Int32, INTEGER, integer)
ACCESS(UInt32, INTEGER, integer)
ACCESS(Int64, INTEGER, integer)
ACCESS(UInt64, INTEGER, integer)
ACCESS(Boolean, TRUTH, integer)
ACCESS(String, TEXT, text)

/* What goes straight to a solver of FMI 3.0, and exists nowhere else. */
#if INNER_FMI == 3
#define PASS(function, ...)                                                                                              \
    REFUSE_WITHOUT_INSTANCE;                                                                                             \
    return self->inner.function ? self->inner.function(self->inner.component, __VA_ARGS__)                               \
                                : (fmi3Status)wrapper_log(self, STATUS_ERROR, "the solver's FMU has no fmi3" #function)
#define PASS_SET(function, ...)                                                                                          \
    if (instance)                                                                                                        \
        variables_touched(instance);                                                                                     \
    PASS(function, __VA_ARGS__)
#else
static fmi3Status nothing(Wrapper *self, const char *function, size_t n)
{
    return n ? (fmi3Status)wrapper_log(self, STATUS_ERROR, "%s: there is no variable of this type", function) : fmi3OK;
}
#define PASS(function, vr, n, ...)                                                                                       \
    REFUSE_WITHOUT_INSTANCE;                                                                                             \
    return nothing(self, "fmi3" #function, n)
#define PASS_SET PASS
#endif
#define REFERENCES fmi3Instance instance, const fmi3ValueReference vr[], size_t n

fmi3Status fmi3GetBinary(REFERENCES, size_t sizes[], fmi3Binary values[], size_t n_values) { PASS(GetBinary, vr, n, sizes, values, n_values); }

fmi3Status fmi3SetBinary(REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t n_values)
{
    PASS_SET(SetBinary, vr, n, sizes, values, n_values);
}

fmi3Status fmi3GetClock(REFERENCES, fmi3Clock values[]) { PASS(GetClock, vr, n, values); }
fmi3Status fmi3SetClock(REFERENCES, const fmi3Clock values[]) { PASS_SET(SetClock, vr, n, values); }

fmi3Status fmi3GetIntervalDecimal(REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
{
    PASS(GetIntervalDecimal, vr, n, intervals, qualifiers);
}

fmi3Status fmi3GetIntervalFraction(REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
    PASS(GetIntervalFraction, vr, n, counters, resolutions, qualifiers);
}

fmi3Status fmi3GetShiftDecimal(REFERENCES, fmi3Float64 shifts[]) { PASS(GetShiftDecimal, vr, n, shifts); }

fmi3Status fmi3GetShiftFraction(REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
{
    PASS(GetShiftFraction, vr, n, counters, resolutions);
}

fmi3Status fmi3SetIntervalDecimal(REFERENCES, const fmi3Float64 intervals[]) { PASS(SetIntervalDecimal, vr, n, intervals); }

fmi3Status fmi3SetIntervalFraction(REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    PASS(SetIntervalFraction, vr, n, counters, resolutions);
}

fmi3Status fmi3SetShiftDecimal(REFERENCES, const fmi3Float64 shifts[]) { PASS(SetShiftDecimal, vr, n, shifts); }

fmi3Status fmi3SetShiftFraction(REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    PASS(SetShiftFraction, vr, n, counters, resolutions);
}

/* What the wrapper does not offer; its model description says so. */
#define REFUSE(what)                                                                                                     \
    REFUSE_WITHOUT_INSTANCE;                                                                                             \
    return (fmi3Status)wrapper_log(self, STATUS_ERROR, "%s: not provided", what)

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference vr, size_t *count)
{
    REFUSE("dependencies of array elements");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent, size_t elements[], fmi3ValueReference knowns[],
                                       size_t known_elements[], fmi3DependencyKind kinds[], size_t n)
{
    REFUSE("dependencies of array elements");
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
                                        fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    REFUSE("directional derivatives");
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
                                    fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    REFUSE("adjoint derivatives");
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t n_values)
{
    REFUSE("derivatives of outputs");
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) { REFUSE("model exchange"); }

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_rollback, fmi3Boolean *event, fmi3Boolean *terminate)
{
    REFUSE("model exchange");
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    REFUSE("model exchange");
}

#define NO_NUMBERS(function, constness)                                                                                  \
    fmi3Status function(fmi3Instance instance, constness fmi3Float64 values[], size_t n)                                 \
    {                                                                                                                    \
        REFUSE("model exchange");                                                                                        \
    }
NO_NUMBERS(fmi3SetContinuousStates, const)
NO_NUMBERS(fmi3GetContinuousStateDerivatives, )
NO_NUMBERS(fmi3GetEventIndicators, )
NO_NUMBERS(fmi3GetContinuousStates, )
NO_NUMBERS(fmi3GetNominalsOfContinuousStates, )

#define NO_COUNT(function)                                                                                               \
    fmi3Status function(fmi3Instance instance, size_t *n)                                                                \
    {                                                                                                                    \
        REFUSE("model exchange");                                                                                        \
    }
NO_COUNT(fmi3GetNumberOfEventIndicators)
NO_COUNT(fmi3GetNumberOfContinuousStates)

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time)
{
    REFUSE("scheduled execution");
}
