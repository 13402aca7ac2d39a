/* What differs between operating systems: shared libraries, and where they lie. Paths are UTF-8. Not there in an FMU that is linked
 * into a program: that may run without files. */
#ifndef PLATFORM_H
#define PLATFORM_H

#include <stdbool.h>
#include <stddef.h>

#include "names.h"

/* Folder of binaries/ and suffix of libraries, for an FMU of FMI version 2 or 3; "" where this machine is none of them. */
const char *platform_folder(int fmi);
const char *platform_suffix(void);

/* Loads a library of its own: its symbols are seen by nobody else, and it sees its own before those of the host. NULL, and the
 * system's words in `error`, where that fails. */
void *library_open(const char *path, char *error, size_t size);
void library_close(void *library);

/* The address of a function, NULL where there is none. */
typedef void (*Function)(void);
Function library_function(void *library, const char *name);

/* Path of the resources folder next to this very library (binaries/<platform>/../../resources), to be freed; NULL on failure. */
char *own_resources(void);

bool file_exists(const char *path);

#endif
