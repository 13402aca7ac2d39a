// A host in C++: loads FMUs of FMI 2, each as host LIBRARY GUID RESOURCES local|global names it, steps them and prints
// two outputs through streams.
#include <dlfcn.h>

#include <cstdarg>
#include <cstdlib>
#include <iomanip>
#include <iostream>
#include <string>
#include <vector>

#include "fmi2FunctionTypes.h"

namespace {

void logged(fmi2ComponentEnvironment, fmi2String name, fmi2Status status, fmi2String, fmi2String message, ...) {
    std::cerr << name << ' ' << status << ' ' << message << std::endl;
}

template <typename Function>
Function *found(void *library, const char *name) {
    void *address = dlsym(library, name);
    if (!address) {
        std::cerr << "no " << name << std::endl;
        std::exit(2);
    }
    return reinterpret_cast<Function *>(address);
}

void sure(fmi2Status status, const std::string &what) {
    if (status > fmi2Warning) {
        std::cerr << what << " failed" << std::endl;
        std::exit(3);
    }
}

}  // namespace

int main(int count, char **given) {
    const std::vector<std::string> arguments(given + 1, given + count);
    const fmi2CallbackFunctions callbacks{logged, std::calloc, std::free, nullptr, nullptr};
    for (size_t at = 0; at + 4 <= arguments.size(); at += 4) {
        const int way = arguments[at + 3] == "global" ? RTLD_GLOBAL : RTLD_LOCAL;
        void *library = dlopen(arguments[at].c_str(), RTLD_NOW | way);
        if (!library) {
            std::cerr << dlerror() << std::endl;
            return 1;
        }
        auto *instance = found<fmi2InstantiateTYPE>(library, "fmi2Instantiate")(
            "one", fmi2CoSimulation, arguments[at + 1].c_str(), arguments[at + 2].c_str(), &callbacks, fmi2False, fmi2False);
        if (!instance) return 4;
        sure(found<fmi2SetupExperimentTYPE>(library, "fmi2SetupExperiment")(instance, fmi2False, 0.0, 0.0, fmi2False, 0.0), "setup");
        sure(found<fmi2EnterInitializationModeTYPE>(library, "fmi2EnterInitializationMode")(instance), "enter");
        sure(found<fmi2ExitInitializationModeTYPE>(library, "fmi2ExitInitializationMode")(instance), "exit");
        const fmi2ValueReference names[2] = {1, 2};
        double values[2] = {0.0, 0.0};
        for (int i = 0; i < 50; i++)
            sure(found<fmi2DoStepTYPE>(library, "fmi2DoStep")(instance, i * 1e-3, 1e-3, fmi2True), "step");
        sure(found<fmi2GetRealTYPE>(library, "fmi2GetReal")(instance, names, 2, values), "get");
        std::cout << "values " << std::setprecision(17) << values[0] << ' ' << values[1] << std::endl;
        found<fmi2FreeInstanceTYPE>(library, "fmi2FreeInstance")(instance);
    }
    std::cout << "done" << std::endl;
}
