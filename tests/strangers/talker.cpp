// A solver in C++ as many exporters' are: streams, strings, exceptions, and a call of its own exported functions. FMI 2.
#include <cmath>
#include <iostream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>

#include "fmi2Functions.h"

namespace {

struct Talker {
    std::map<fmi2ValueReference, double> values{{1, 0.0}, {2, 2.0}, {3, 1.0}};
    std::ostringstream said;
    double time = 0.0;
};

Talker &of(fmi2Component c) { return *static_cast<Talker *>(c); }

template <typename Do>
fmi2Status tried(Do what) {
    try {
        what();
        return fmi2OK;
    } catch (const std::exception &error) {
        std::cerr << "talker: " << error.what() << std::endl;
        return fmi2Error;
    }
}

}  // namespace

extern "C" {

const char *fmi2GetTypesPlatform() { return "default"; }
const char *fmi2GetVersion() { return "2.0"; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type, fmi2String, fmi2String, const fmi2CallbackFunctions *, fmi2Boolean,
                              fmi2Boolean) {
    auto *talker = new Talker;
    talker->said << "talker " << std::string(name) << " is there, " << 0.5;
    std::cout << talker->said.str() << std::endl;
    return talker;
}
void fmi2FreeInstance(fmi2Component c) { delete static_cast<Talker *>(c); }
fmi2Status fmi2SetDebugLogging(fmi2Component, fmi2Boolean, size_t, const fmi2String[]) { return fmi2OK; }
fmi2Status fmi2SetupExperiment(fmi2Component, fmi2Boolean, fmi2Real, fmi2Real, fmi2Boolean, fmi2Real) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) {
    return tried([&] { of(c).values = Talker{}.values, of(c).time = 0.0; });
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference names[], size_t n, fmi2Real values[]) {
    return tried([&] {
        for (size_t i = 0; i < n; i++) values[i] = of(c).values.at(names[i]);
    });
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference names[], size_t n, const fmi2Real values[]) {
    return tried([&] {
        for (size_t i = 0; i < n; i++) of(c).values.at(names[i]) = values[i];
    });
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean) {
    return tried([&] {
        Talker &talker = of(c);
        if (step <= 0.0) throw std::invalid_argument("a step goes forward");
        talker.time = time + step;
        const fmi2ValueReference gain = 3;
        double factor = 0.0;
        if (fmi2GetReal(c, &gain, 1, &factor) != fmi2OK) throw std::runtime_error("its own gain is gone");
        talker.values[1] = 2.0 * factor * std::sin(9.0 * talker.time);
        talker.values[2] = 2.0 * std::cos(9.0 * talker.time);
        talker.said.str("");
        talker.said << talker.time << ' ' << talker.values[1];
    });
}
fmi2Status fmi2GetStatus(fmi2Component, const fmi2StatusKind, fmi2Status *) { return fmi2Discard; }
fmi2Status fmi2GetRealStatus(fmi2Component, const fmi2StatusKind, fmi2Real *) { return fmi2Discard; }
fmi2Status fmi2GetIntegerStatus(fmi2Component, const fmi2StatusKind, fmi2Integer *) { return fmi2Discard; }
fmi2Status fmi2GetBooleanStatus(fmi2Component, const fmi2StatusKind, fmi2Boolean *) { return fmi2Discard; }
fmi2Status fmi2GetStringStatus(fmi2Component, const fmi2StatusKind, fmi2String *) { return fmi2Discard; }
fmi2Status fmi2CancelStep(fmi2Component) { return fmi2Error; }
#define REFUSED(name, ...) \
    fmi2Status name(fmi2Component, __VA_ARGS__) { return fmi2Error; }
REFUSED(fmi2GetInteger, const fmi2ValueReference[], size_t, fmi2Integer[])
REFUSED(fmi2GetBoolean, const fmi2ValueReference[], size_t, fmi2Boolean[])
REFUSED(fmi2GetString, const fmi2ValueReference[], size_t, fmi2String[])
REFUSED(fmi2SetInteger, const fmi2ValueReference[], size_t, const fmi2Integer[])
REFUSED(fmi2SetBoolean, const fmi2ValueReference[], size_t, const fmi2Boolean[])
REFUSED(fmi2SetString, const fmi2ValueReference[], size_t, const fmi2String[])
REFUSED(fmi2GetFMUstate, fmi2FMUstate *)
REFUSED(fmi2SetFMUstate, fmi2FMUstate)
REFUSED(fmi2FreeFMUstate, fmi2FMUstate *)
REFUSED(fmi2SerializedFMUstateSize, fmi2FMUstate, size_t *)
REFUSED(fmi2SerializeFMUstate, fmi2FMUstate, fmi2Byte[], size_t)
REFUSED(fmi2DeSerializeFMUstate, const fmi2Byte[], size_t, fmi2FMUstate *)
REFUSED(fmi2GetDirectionalDerivative, const fmi2ValueReference[], size_t, const fmi2ValueReference[], size_t, const fmi2Real[],
        fmi2Real[])
REFUSED(fmi2SetRealInputDerivatives, const fmi2ValueReference[], size_t, const fmi2Integer[], const fmi2Real[])
REFUSED(fmi2GetRealOutputDerivatives, const fmi2ValueReference[], size_t, const fmi2Integer[], fmi2Real[])
}
