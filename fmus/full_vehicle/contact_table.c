/* Reading contact.csv and checking that it can be what it says. */
#include "contact_table.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "csv_columns.h"

enum { Y, RADIUS, ANGLE, LIFT, WHEEL_Y, A, B, C11, C22, C23, WIDTH };
static const char *const names[WIDTH] = {"y", "radius", "angle", "lift", "wheel_y", "a", "b", "c11", "c22", "c23"};

/* What a column may hold, SI units: wide enough for any wheel, too narrow for a file in millimetres or degrees. */
static const double lowest[WIDTH] = {-0.1, 0.1, -1.5, -0.1, -0.1, 1e-5, 1e-5, 0.1, 0.1, 1e-3};
static const double highest[WIDTH] = {0.1, 1.0, 1.5, 0.1, 0.1, 0.1, 0.1, 1e3, 1e3, 1e4};
static const double REACH = 0.015, COARSEST = 0.1e-3;

static bool check(const double *v, size_t rows, const char *path, char *message, size_t size)
{
    if (rows < 3) {
        snprintf(message, size, "%s: expected a table over -15 to 15 mm, got %u rows", path, (unsigned)rows);
        return false;
    }
    for (size_t i = 0; i < rows; i++)
        for (int k = 0; k < WIDTH; k++)
            if (!(v[i * WIDTH + k] >= lowest[k] && v[i * WIDTH + k] <= highest[k])) {
                snprintf(message, size, "%s: expected %s from %g to %g (SI units: m, rad, 1/m), got %g in row %u", path,
                         names[k], lowest[k], highest[k], v[i * WIDTH + k], (unsigned)(i + 1));
                return false;
            }
    const double first = v[Y], last = v[(rows - 1) * WIDTH + Y], step = (last - first) / (double)(rows - 1);
    if (!csv_uniform(v, rows, WIDTH, names[Y], path, message, size))
        return false;
    if (first > -REACH + 1e-9 || last < REACH - 1e-9 || step > COARSEST * 1.001) {
        snprintf(message, size,
                 "%s: expected y from -0.015 to 0.015 m in steps of at most 0.0001 m, got %g to %g m in steps of %g m",
                 path, first, last, step);
        return false;
    }
    /* a lift that does not follow the contact angle would make or lose energy, and betrays another sign or unit */
    double lift = v[LIFT], worst = 0.0;
    for (size_t i = 1; i < rows; i++) {
        lift += 0.5 * step * (tan(v[(i - 1) * WIDTH + ANGLE]) + tan(v[i * WIDTH + ANGLE]));
        worst = fmax(worst, fabs(lift - v[i * WIDTH + LIFT]));
    }
    if (worst > 0.5e-3) {
        snprintf(message, size,
                 "%s: expected a lift whose slope is the tangent of the angle, got one that is %g mm beside it", path,
                 1e3 * worst);
        return false;
    }
    return true;
}

static ContactPoint point(const double *row)
{
    const double ab = row[A] * row[B];
    return (ContactPoint){
        .lift = row[LIFT],
        .slope = tan(row[ANGLE]),
        .across = row[WHEEL_Y],
        .radius = row[RADIUS],
        .c11 = row[C11] * ab,
        .c22 = row[C22] * ab,
        .c23 = row[C23] * ab * sqrt(ab),
    };
}

bool contact_table_read(ContactTable *table, const char *path, char *message, size_t size)
{
    size_t rows;
    double *v = csv_columns(path, names, WIDTH, &rows, message, size);
    table->rows = NULL;
    if (!v)
        return false;
    if (check(v, rows, path, message, size)) {
        table->rows = malloc(rows * sizeof *table->rows);
        if (!table->rows)
            snprintf(message, size, "%s: no memory for %u rows", path, (unsigned)rows);
    }
    if (table->rows) {
        table->n = rows;
        table->first = v[Y];
        table->step = (v[(rows - 1) * WIDTH + Y] - v[Y]) / (double)(rows - 1);
        table->per_step = 1.0 / table->step;
        for (size_t i = 0; i < rows; i++)
            table->rows[i] = point(v + i * WIDTH);
        for (size_t i = 0; i < rows; i++) {
            const size_t low = i > 0 ? i - 1 : 0, high = i + 1 < rows ? i + 1 : i;
            table->rows[i].across_gain =
                (table->rows[high].across - table->rows[low].across) / ((double)(high - low) * table->step);
        }
    }
    free(v);
    return table->rows != NULL;
}
