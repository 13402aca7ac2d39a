/* Reading a CSV file of numbers by the names of its columns. */
#include "csv_columns.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
static FILE *open_file(const char *path) /* UTF-8 */
{
    wchar_t name[1024];
    return MultiByteToWideChar(CP_UTF8, 0, path, -1, name, 1024) ? _wfopen(name, L"rb") : NULL;
}
#else
static FILE *open_file(const char *path) { return fopen(path, "rb"); }
#endif

enum { COLUMNS = 64, LARGEST = 256 << 20 /* bytes */ };

/* The whole file, ended by a zero; free it. */
static char *read_text(const char *path)
{
    FILE *file = open_file(path);
    char *text = NULL;
    if (!file)
        return NULL;
    if (!fseek(file, 0, SEEK_END)) {
        const long length = ftell(file);
        rewind(file);
        text = length >= 0 && length <= LARGEST ? malloc((size_t)length + 1) : NULL;
        if (text)
            text[fread(text, 1, (size_t)length, file)] = '\0';
    }
    fclose(file);
    return text;
}

static double power_of_ten(int exponent)
{
    double power = 1.0;
    for (int i = abs(exponent); i > 0; i--)
        power *= 10.0;
    return power;
}

/* A decimal number at *at, which is left behind it; NAN when there is none. Exact up to 15 digits and powers to 22. */
static double read_number(const char **at)
{
    const char *c = *at;
    const double sign = *c == '-' ? -1.0 : 1.0;
    uint64_t digits = 0;
    int exponent = 0, n = 0;
    bool point = false;
    c += *c == '-' || *c == '+';
    for (; (*c >= '0' && *c <= '9') || (*c == '.' && !point); c++) {
        if (*c == '.') {
            point = true;
        } else {
            const bool room = digits < 100000000000000000u;
            digits = room ? 10 * digits + (uint64_t)(*c - '0') : digits;
            exponent += (room ? 0 : 1) - (point ? 1 : 0);
            n++;
        }
    }
    if (n && (*c | 32) == 'e') {
        char *end;
        const long power = strtol(c + 1, &end, 10);
        if (end == c + 1 || labs(power) > 300)
            return NAN;
        exponent += (int)power;
        c = end;
    }
    *at = c;
    if (!n || abs(exponent) > 320)
        return NAN;
    return sign * (exponent < 0 ? (double)digits / power_of_ten(exponent) : (double)digits * power_of_ten(exponent));
}

static const char *skip_blanks(const char *c)
{
    while (*c == ' ' || *c == '\t' || *c == '\r')
        c++;
    return c;
}

/* Where in the header line every name stands: place[k] = its column. The name that is missing, or NULL. */
static const char *find_columns(const char *line, const char *const names[], size_t n, int place[])
{
    for (size_t i = 0; i < n; i++) {
        const char *c = line;
        place[i] = -1;
        for (int column = 0; column < COLUMNS; column++) {
            c = skip_blanks(c);
            const size_t length = strcspn(c, ", \t\r\n");
            if (length == strlen(names[i]) && !strncmp(c, names[i], length))
                place[i] = column;
            c += strcspn(c, ",\n");
            if (*c != ',')
                break;
            c++;
        }
        if (place[i] < 0)
            return names[i];
    }
    return NULL;
}

static const char *next_line(const char *c)
{
    c += strcspn(c, "\n");
    return *c ? c + 1 : c;
}

/* One row into values; the number of its columns, or minus the number of the first that holds no number. */
static int read_row(const char *c, const int place[], size_t n, double values[])
{
    for (int column = 0;; column++) {
        c = skip_blanks(c);
        const double value = read_number(&c);
        c = skip_blanks(c);
        if (!isfinite(value) || (*c && *c != ',' && *c != '\n'))
            return -(column + 1);
        for (size_t i = 0; i < n; i++)
            if (place[i] == column)
                values[i] = value;
        if (*c != ',')
            return column + 1;
        c++;
    }
}

static double *parse(const char *text, const char *path, const char *const names[], size_t n, size_t *rows,
                     char *message, size_t size)
{
    int place[COLUMNS], most = 0;
    size_t line = 1, lines = 0;
    text += strncmp(text, "\xef\xbb\xbf", 3) ? 0 : 3; /* what some programs put before UTF-8 */
    for (const char *c = text; *c; c = next_line(c))
        lines++;
    while (*text == '#')
        text = next_line(text), line++;
    const char *missing = find_columns(text, names, n, place);
    if (missing) {
        snprintf(message, size, "%s: expected a column named %s in line %u, the first that is no comment", path,
                 missing, (unsigned)line);
        return NULL;
    }
    for (size_t i = 0; i < n; i++)
        most = place[i] > most ? place[i] : most;
    double *values = malloc((lines + 1) * n * sizeof *values);
    if (!values) {
        snprintf(message, size, "%s: no memory for %u rows", path, (unsigned)lines);
        return NULL;
    }
    *rows = 0;
    for (text = next_line(text), line++; *text; text = next_line(text), line++) {
        const char *c = skip_blanks(text);
        if (*c == '#' || *c == '\n' || !*c)
            continue;
        const int columns = read_row(c, place, n, values + *rows * n);
        if (columns <= most) {
            snprintf(message, size, "%s: expected a finite number in line %u, column %d", path, (unsigned)line,
                     columns < 0 ? -columns : columns + 1);
            free(values);
            return NULL;
        }
        ++*rows;
    }
    return values;
}

double *csv_columns(const char *path, const char *const names[], size_t n, size_t *rows, char *message, size_t size)
{
    char *text = read_text(path);
    if (!text) {
        snprintf(message, size, "%s: cannot be read; the model needs it in the FMU's resources", path);
        return NULL;
    }
    double *values = parse(text, path, names, n, rows, message, size);
    free(text);
    return values;
}

bool csv_uniform(const double *values, size_t rows, size_t n, const char *name, const char *path, char *message,
                 size_t size)
{
    const double step = (values[(rows - 1) * n] - values[0]) / (double)(rows - 1);
    for (size_t i = 0; i < rows; i++)
        if (!(step > 0.0) || fabs(values[i * n] - (values[0] + step * (double)i)) > 1e-3 * step) {
            snprintf(message, size, "%s: expected %s to rise by the same step from row to row, got %g m in row %u", path,
                     name, values[i * n], (unsigned)(i + 1));
            return false;
        }
    return true;
}
