/* Reading irregularity.csv, and looking it up. */
#include "irregularity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "csv_columns.h"

enum { DISTANCE, LATERAL, VERTICAL, CANT, GAUGE, WIDTH };
static const char *const names[WIDTH] = {"distance", "lateral", "vertical", "cant", "gauge"};
static const double LARGEST = 0.2; /* m */

static bool check(const double *v, size_t rows, const char *path, char *message, size_t size)
{
    if (rows < 2) {
        snprintf(message, size, "%s: expected at least two rows, got %u", path, (unsigned)rows);
        return false;
    }
    if (!csv_uniform(v, rows, WIDTH, names[DISTANCE], path, message, size))
        return false;
    for (size_t i = 0; i < rows; i++)
        for (int k = LATERAL; k < WIDTH; k++)
            if (fabs(v[i * WIDTH + k]) > LARGEST) {
                snprintf(message, size, "%s: expected %s of at most %g m, got %g in row %u", path, names[k], LARGEST,
                         v[i * WIDTH + k], (unsigned)(i + 1));
                return false;
            }
    return true;
}

bool irregularity_read(Irregularity *table, const char *path, char *message, size_t size)
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
        table->first = v[0];
        table->step = (v[(rows - 1) * WIDTH] - v[0]) / (double)(rows - 1);
        table->level = true;
        for (size_t i = 0; i < rows; i++) {
            const double *row = v + i * WIDTH;
            table->rows[i] = (Unevenness){row[LATERAL], row[VERTICAL], row[CANT], row[GAUGE]};
            table->level =
                table->level && row[LATERAL] == 0.0 && row[VERTICAL] == 0.0 && row[CANT] == 0.0 && row[GAUGE] == 0.0;
        }
    }
    free(v);
    return table->rows != NULL;
}

void irregularity_at(const Irregularity *table, double distance, Unevenness *value, Unevenness *slope)
{
    const double last = (double)(table->n - 1), at = (distance - table->first) / table->step;
    if (!(at >= 0.0 && at < last)) {
        *value = table->rows[at < 0.0 ? 0 : table->n - 1];
        *slope = (Unevenness){0};
        return;
    }
    const size_t i = (size_t)at;
    const double s = at - (double)i, h = table->step;
    const Unevenness *p = table->rows + i, *q = p + 1;
    const Unevenness *before = i > 0 ? p - 1 : p, *after = i + 2 < table->n ? q + 1 : q;
    /* cubic Hermite polynomials and their derivatives by s; the slopes at the ends in units of the step */
    const double h1 = s * s * (3.0 - 2.0 * s), h2 = s * (1.0 - s) * (1.0 - s), h3 = -s * s * (1.0 - s);
    const double d1 = 6.0 * s * (1.0 - s), d2 = (1.0 - s) * (1.0 - 3.0 * s), d3 = s * (3.0 * s - 2.0);
#define CUBIC(field)                                                                                                   \
    do {                                                                                                               \
        const double start = i > 0 ? 0.5 * (q->field - before->field) : 0.0;                                           \
        const double end = i + 2 < table->n ? 0.5 * (after->field - p->field) : 0.0;                                   \
        value->field = p->field + h1 * (q->field - p->field) + h2 * start + h3 * end;                                  \
        slope->field = (d1 * (q->field - p->field) + d2 * start + d3 * end) / h;                                       \
    } while (0)
    CUBIC(lateral);
    CUBIC(vertical);
    CUBIC(cant);
    CUBIC(gauge);
#undef CUBIC
}
