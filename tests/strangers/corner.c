/* A quarter car as somebody else would write it: kN, t and mm, one array behind value references from 1000 on, compression of the
   strut positive, no state that could be saved, no fixed step of its own. A solver of FMI 2 for tests; units in corner.xml. */
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

enum { ROAD = 1000, FORCE, COMPRESSION, RATE, BODY_A, TYRE_F, BODY_M, AXLE_M, STRUT_K, STRUT_D, TYRE_K, END };

typedef struct {
    double values[END - ROAD];
    double body_z, body_v, axle_z, axle_v; /* mm, mm/s */
} Corner;

#define AT(name) (corner->values[(name) - ROAD])

static double strut(const Corner *corner) {
    return AT(STRUT_K) * (corner->axle_z - corner->body_z) + AT(STRUT_D) * (corner->axle_v - corner->body_v) - AT(FORCE);
}

static double tyre(const Corner *corner) { return AT(TYRE_K) * (AT(ROAD) - corner->axle_z); }

static void show(Corner *corner) {
    AT(COMPRESSION) = corner->axle_z - corner->body_z;
    AT(RATE) = corner->axle_v - corner->body_v;
    AT(BODY_A) = strut(corner) / AT(BODY_M); /* kN / t = m/s2 */
    AT(TYRE_F) = tyre(corner);
}

static void begin(Corner *corner) {
    memset(corner, 0, sizeof *corner);
    AT(BODY_M) = 0.35, AT(AXLE_M) = 0.045, AT(STRUT_K) = 0.022, AT(STRUT_D) = 0.0014, AT(TYRE_K) = 0.19;
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    Corner *corner = malloc(sizeof *corner);
    if (corner) begin(corner);
    return corner;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) { return fmi2OK; }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean told, fmi2Real tolerance, fmi2Real start, fmi2Boolean ends,
                               fmi2Real stop) {
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    show(c);
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) {
    begin(c);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference names[], size_t n, fmi2Real values[]) {
    Corner *corner = c;
    for (size_t i = 0; i < n; i++) {
        if (names[i] < ROAD || names[i] >= END) return fmi2Error;
        values[i] = AT(names[i]);
    }
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference names[], size_t n, const fmi2Real values[]) {
    Corner *corner = c;
    for (size_t i = 0; i < n; i++) {
        if (names[i] < ROAD || names[i] >= END) return fmi2Error;
        AT(names[i]) = values[i];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean kept) {
    Corner *corner = c;
    const int pieces = 20;
    const double h = step / pieces;
    for (int i = 0; i < pieces; i++) {
        const double force = strut(corner), road = tyre(corner);
        corner->body_v += h * 1e3 * force / AT(BODY_M);
        corner->axle_v += h * 1e3 * (road - force) / AT(AXLE_M);
        corner->body_z += h * corner->body_v;
        corner->axle_z += h * corner->axle_v;
    }
    show(corner);
    return fmi2OK;
}

/* What it has not. */
#define REFUSED(name, ...) \
    fmi2Status name(fmi2Component c, __VA_ARGS__) { return fmi2Error; }
REFUSED(fmi2GetInteger, const fmi2ValueReference v[], size_t n, fmi2Integer x[])
REFUSED(fmi2GetBoolean, const fmi2ValueReference v[], size_t n, fmi2Boolean x[])
REFUSED(fmi2GetString, const fmi2ValueReference v[], size_t n, fmi2String x[])
REFUSED(fmi2SetInteger, const fmi2ValueReference v[], size_t n, const fmi2Integer x[])
REFUSED(fmi2SetBoolean, const fmi2ValueReference v[], size_t n, const fmi2Boolean x[])
REFUSED(fmi2SetString, const fmi2ValueReference v[], size_t n, const fmi2String x[])
REFUSED(fmi2GetFMUstate, fmi2FMUstate *s)
REFUSED(fmi2SetFMUstate, fmi2FMUstate s)
REFUSED(fmi2FreeFMUstate, fmi2FMUstate *s)
REFUSED(fmi2SerializedFMUstateSize, fmi2FMUstate s, size_t *n)
REFUSED(fmi2SerializeFMUstate, fmi2FMUstate s, fmi2Byte b[], size_t n)
REFUSED(fmi2DeSerializeFMUstate, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
REFUSED(fmi2GetDirectionalDerivative, const fmi2ValueReference u[], size_t nu, const fmi2ValueReference k[], size_t nk,
        const fmi2Real d[], fmi2Real x[])
REFUSED(fmi2SetRealInputDerivatives, const fmi2ValueReference v[], size_t n, const fmi2Integer o[], const fmi2Real x[])
REFUSED(fmi2GetRealOutputDerivatives, const fmi2ValueReference v[], size_t n, const fmi2Integer o[], fmi2Real x[])
REFUSED(fmi2GetStatus, const fmi2StatusKind k, fmi2Status *x)
REFUSED(fmi2GetRealStatus, const fmi2StatusKind k, fmi2Real *x)
REFUSED(fmi2GetIntegerStatus, const fmi2StatusKind k, fmi2Integer *x)
REFUSED(fmi2GetBooleanStatus, const fmi2StatusKind k, fmi2Boolean *x)
REFUSED(fmi2GetStringStatus, const fmi2StatusKind k, fmi2String *x)
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }
