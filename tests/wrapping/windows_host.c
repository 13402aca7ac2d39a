/* What host.c takes from the C library where it is compiled for Windows, beside windows.c (compiler.py says why). */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv);
void __main(void);
void __main(void) {} /* constructors: there are none */
void mainCRTStartup(void);
void mainCRTStartup(void) { exit(main(0, NULL)); } /* it reads its own command line */

int fprintf(FILE *file, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    int count = __stdio_common_vfprintf(_CRT_INTERNAL_PRINTF_STANDARD_SNPRINTF_BEHAVIOR, file, format, NULL, arguments);
    va_end(arguments);
    return count;
}

int printf(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    int count = __stdio_common_vfprintf(_CRT_INTERNAL_PRINTF_STANDARD_SNPRINTF_BEHAVIOR, stdout, format, NULL, arguments);
    va_end(arguments);
    return count;
}
