/* What a library for Windows takes from no other: its beginning, and the words of <stdio.h> that are no functions of the
 * Universal C Runtime. With it a library is linked to that runtime alone; compiler.py says why. */
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <windows.h>

BOOL WINAPI _DllMainCRTStartup(HINSTANCE library, DWORD reason, LPVOID reserved);
BOOL WINAPI _DllMainCRTStartup(HINSTANCE library, DWORD reason, LPVOID reserved)
{
    (void)library, (void)reason, (void)reserved; /* no constructors, and the runtime begins itself */
    return TRUE;
}

int vsnprintf(char *text, size_t size, const char *format, va_list arguments)
{
    return __stdio_common_vsprintf(_CRT_INTERNAL_PRINTF_STANDARD_SNPRINTF_BEHAVIOR, text, size, format, NULL, arguments);
}

int snprintf(char *text, size_t size, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    int count = vsnprintf(text, size, format, arguments);
    va_end(arguments);
    return count;
}

int sprintf(char *text, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    int count = vsnprintf(text, (size_t)-1, format, arguments);
    va_end(arguments);
    return count;
}
