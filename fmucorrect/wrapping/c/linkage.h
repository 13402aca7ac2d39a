/* How this FMU is linked.
 *
 * As a library of its own the functions of FMI have their plain names, and the solver's library is loaded from resources/solver.
 * Where FMI2_FUNCTION_PREFIX or FMI3_FUNCTION_PREFIX is defined, as the standards say for FMUs that are linked into one program,
 * every name that the linker sees begins with it, and the solver is linked too: its functions have the prefix that the standards
 * give it, its modelIdentifier and `_`. The prefix must be the same in all files: define it for the compiler (-D). */
#ifndef LINKAGE_H
#define LINKAGE_H

#if defined(FMI2_FUNCTION_PREFIX)
#define OWN_PREFIX FMI2_FUNCTION_PREFIX
#elif defined(FMI3_OVERRIDE_FUNCTION_PREFIX)
#if defined(FMI3_ACTUAL_FUNCTION_PREFIX)
#define OWN_PREFIX FMI3_ACTUAL_FUNCTION_PREFIX
#endif
#elif defined(FMI3_FUNCTION_PREFIX)
#define OWN_PREFIX FMI3_FUNCTION_PREFIX
#endif

#define LINKAGE_PASTE(prefix, name) prefix##name
#define LINKAGE_NAME(prefix, name) LINKAGE_PASTE(prefix, name)
#if defined(OWN_PREFIX)
#define LINKED 1
#define OWN(name) LINKAGE_NAME(OWN_PREFIX, name)
#else
#define LINKED 0
#define OWN(name) name
#endif

#endif
