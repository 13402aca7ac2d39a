/* See paths.h. */
#include "paths.h"

#include <ctype.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static char *copy_of(const char *text)
{
    char *copy = malloc(strlen(text) + 1);
    return copy ? strcpy(copy, text) : NULL;
}

static int hex(char c) { return isdigit((unsigned char)c) ? c - '0' : isxdigit((unsigned char)c) ? tolower((unsigned char)c) - 'a' + 10 : -1; }

char *path_of_uri(const char *uri)
{
    if (strncmp(uri, "file:", 5) != 0)
        return copy_of(uri);
    const char *from = uri + 5;
    if (from[0] == '/' && from[1] == '/') { /* an authority: empty or localhost */
        from += 2;
        if (strncmp(from, "localhost/", 10) == 0)
            from += 9;
    }
    if (from[0] == '/' && isalpha((unsigned char)from[1]) && (from[2] == ':' || from[2] == '|'))
        from++; /* /C:/ of Windows */
    char *path = malloc(strlen(from) + 1), *to = path;
    while (path && *from && *from != '?' && *from != '#') {
        if (*from == '%' && hex(from[1]) >= 0 && hex(from[2]) >= 0) {
            *to++ = (char)(hex(from[1]) * 16 + hex(from[2]));
            from += 3;
        } else {
            *to++ = *from++;
        }
    }
    if (path) {
        while (to > path + 1 && to[-1] == '/')
            to--;
        *to = 0;
    }
    return path;
}

char *uri_of_path(const char *path)
{
    static const char digits[] = "0123456789ABCDEF";
    char *uri = malloc(3 * strlen(path) + 9), *to = uri;
    if (!uri)
        return NULL;
    to += sprintf(to, "file://%s", path[0] == '/' ? "" : "/");
    for (const unsigned char *c = (const unsigned char *)path; *c; c++) {
        if ((*c < 128 && isalnum(*c)) || strchr("/-_.~:", *c)) {
            *to++ = (char)*c;
        } else if (*c == '\\') {
            *to++ = '/';
        } else {
            *to++ = '%';
            *to++ = digits[*c >> 4];
            *to++ = digits[*c & 15];
        }
    }
    *to = 0;
    return uri;
}

char *path_join(const char *first, ...)
{
    va_list parts;
    size_t size = strlen(first) + 1;
    va_start(parts, first);
    for (const char *part; (part = va_arg(parts, const char *));)
        size += strlen(part) + 1;
    va_end(parts);
    char *path = malloc(size);
    if (!path)
        return NULL;
    strcpy(path, first);
    va_start(parts, first);
    for (const char *part; (part = va_arg(parts, const char *));) {
        strcat(path, "/");
        strcat(path, part);
    }
    va_end(parts);
    return path;
}
