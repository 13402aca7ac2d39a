/* See platform.h. */
#if defined(__linux__) && !defined(_GNU_SOURCE)
#define _GNU_SOURCE /* dladdr, RTLD_DEEPBIND */
#endif
#include "platform.h"

#if !LINKED
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "paths.h"

#if defined(_WIN32)
#include <windows.h>
#else
#include <dlfcn.h>
#include <unistd.h>
#endif

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define SANITIZED
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED
#endif

#if defined(_WIN32)
#define PLATFORM_2 "win64"
#define PLATFORM_3 "x86_64-windows"
#define SUFFIX ".dll"
#elif defined(__APPLE__)
#define PLATFORM_2 "darwin64"
#if defined(__aarch64__)
#define PLATFORM_3 "aarch64-darwin"
#else
#define PLATFORM_3 "x86_64-darwin"
#endif
#define SUFFIX ".dylib"
#else
#if defined(__aarch64__)
#define PLATFORM_2 "aarch64-linux"
#define PLATFORM_3 "aarch64-linux"
#elif defined(__x86_64__)
#define PLATFORM_2 "linux64"
#define PLATFORM_3 "x86_64-linux"
#else
#define PLATFORM_2 ""
#define PLATFORM_3 ""
#endif
#define SUFFIX ".so"
#endif

const char *platform_folder(int fmi) { return fmi == 2 ? PLATFORM_2 : PLATFORM_3; }

const char *platform_suffix(void) { return SUFFIX; }

#if defined(_WIN32)

static wchar_t *wide(const char *text)
{
    const int size = MultiByteToWideChar(CP_UTF8, 0, text, -1, NULL, 0);
    wchar_t *result = size > 0 ? malloc((size_t)size * sizeof *result) : NULL;
    if (result)
        MultiByteToWideChar(CP_UTF8, 0, text, -1, result, size);
    return result;
}

static char *narrow(const wchar_t *text)
{
    const int size = WideCharToMultiByte(CP_UTF8, 0, text, -1, NULL, 0, NULL, NULL);
    char *result = size > 0 ? malloc((size_t)size) : NULL;
    if (result)
        WideCharToMultiByte(CP_UTF8, 0, text, -1, result, size, NULL, NULL);
    return result;
}

void *library_open(const char *path, char *error, size_t size)
{
    wchar_t *name = wide(path);
    for (wchar_t *c = name; c && *c; c++)
        if (*c == L'/')
            *c = L'\\'; /* an altered search path wants backslashes */
    HMODULE library = name ? LoadLibraryExW(name, NULL, LOAD_WITH_ALTERED_SEARCH_PATH) : NULL;
    if (!library)
        snprintf(error, size, "Windows error %lu", (unsigned long)GetLastError());
    free(name);
    return (void *)library;
}

void library_close(void *library) { FreeLibrary((HMODULE)library); }

Function library_function(void *library, const char *name) { return (Function)GetProcAddress((HMODULE)library, name); }

static char *own_path(void)
{
    HMODULE self = NULL;
    wchar_t name[32768];
    const DWORD flags = GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT;
    if (!GetModuleHandleExW(flags, (LPCWSTR)(void *)&own_path, &self))
        return NULL;
    const DWORD length = GetModuleFileNameW(self, name, 32768);
    char *path = length && length < 32768 ? narrow(name) : NULL;
    for (char *c = path; c && *c; c++)
        if (*c == '\\')
            *c = '/';
    return path;
}

bool file_exists(const char *path)
{
    wchar_t *name = wide(path);
    const bool there = name && GetFileAttributesW(name) != INVALID_FILE_ATTRIBUTES;
    free(name);
    return there;
}

#else

/* Deep binding keeps a solver that calls its own functions by their names from those of another FMU that the host shows to
   all. Without need it does harm: a solver and a host that share a C++ library would have each a half of its streams, and the
   sanitizers refuse it. */
#if defined(RTLD_DEEPBIND) && !defined(SANITIZED)
static int binding(void)
{
    void *shown = dlopen(NULL, RTLD_LAZY); /* RTLD_DEFAULT would find this library's own, shown or not */
    const bool crowded = shown && (dlsym(shown, "fmi2DoStep") || dlsym(shown, "fmi3DoStep"));
    if (shown)
        dlclose(shown);
    return crowded ? RTLD_DEEPBIND : 0;
}
#else
static int binding(void) { return 0; }
#endif

void *library_open(const char *path, char *error, size_t size)
{
    int flags = RTLD_NOW | RTLD_LOCAL | binding();
#if defined(__APPLE__)
    flags |= RTLD_FIRST;
#endif
    void *library = dlopen(path, flags);
    if (!library) {
        const char *words = dlerror();
        snprintf(error, size, "%s", words ? words : "unknown error");
    }
    return library;
}

void library_close(void *library) { dlclose(library); }

Function library_function(void *library, const char *name)
{
    void *address = dlsym(library, name);
    Function function;
    memcpy(&function, &address, sizeof function); /* POSIX promises that these are the same */
    return function;
}

static char *own_path(void)
{
    Dl_info info;
    static const char inside = 0;
    return dladdr((const void *)&inside, &info) && info.dli_fname ? path_join(info.dli_fname, NULL) : NULL;
}

bool file_exists(const char *path) { return access(path, R_OK) == 0; }

#endif

char *own_resources(void)
{
    char *path = own_path(), *result = NULL;
    for (int level = 0; path && level < 3; level++) { /* the file, its platform, binaries */
        char *slash = strrchr(path, '/');
        if (!slash) {
            free(path);
            return NULL;
        }
        *slash = 0;
    }
    if (path)
        result = path_join(path, "resources", NULL);
    free(path);
    return result;
}
#else
typedef int platform_not_needed; /* nothing is loaded */
#endif
