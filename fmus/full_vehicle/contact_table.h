/* Contact of one wheel on one rail by lateral displacement, read from contact.csv (fmucorrect/railway/contact_table.py
 * makes one from two profiles). */
#ifndef FULL_VEHICLE_CONTACT_TABLE_H
#define FULL_VEHICLE_CONTACT_TABLE_H

#include <stdbool.h>
#include <stddef.h>

#define TABLE_LOAD 60e3 /* N, the normal force that the table's ellipse belongs to */

/* Of a wheel on its rail; outward, towards the rail's field side, brings the flange to the rail. */
typedef struct {
    double lift;        /* of the wheel's centre by which contact is kept, m */
    double slope;       /* its derivative: tan of the contact angle */
    double across;      /* contact point on the wheel, outward from the running circle, m */
    double across_gain; /* derivative of across with respect to the displacement */
    double radius;      /* rolling radius, m */
    double c11, c22;    /* Kalker's C11 a b, C22 a b at TABLE_LOAD, m2 */
    double c23;         /* C23 (a b)^(3/2) at TABLE_LOAD, m3 */
} ContactPoint;

typedef struct {
    double first, step, per_step; /* m, m, 1/m */
    size_t n;
    ContactPoint *rows;
} ContactTable;

/* False, and one line in message, when the file is no contact table in SI units that covers at least +-15 mm. */
bool contact_table_read(ContactTable *table, const char *path, char *message, size_t size);

static inline bool contact_table_covers(const ContactTable *table, double y)
{
    return y >= table->first && y <= table->first + table->step * (double)(table->n - 1);
}

/* Linear between the rows, lift quadratic, so that its slope is the slope; beyond the ends everything but the lift is
 * held, and the lift goes on with the last slope. Defined for every finite y. */
static inline ContactPoint contact_table_at(const ContactTable *table, double y)
{
    const double last = (double)(table->n - 1), at = (y - table->first) * table->per_step;
    const double held = at < 0.0 ? 0.0 : at > last ? last : at;
    const size_t i = held < last ? (size_t)held : table->n - 2;
    const ContactPoint *p = table->rows + i, *q = p + 1;
    const double s = held - (double)i, r = 1.0 - s;
    ContactPoint c = {
        .slope = r * p->slope + s * q->slope,
        .across = r * p->across + s * q->across,
        .across_gain = r * p->across_gain + s * q->across_gain,
        .radius = r * p->radius + s * q->radius,
        .c11 = r * p->c11 + s * q->c11,
        .c22 = r * p->c22 + s * q->c22,
        .c23 = r * p->c23 + s * q->c23,
    };
    c.lift = r * p->lift + s * q->lift - 0.5 * table->step * r * s * (q->slope - p->slope) +
             (at - held) * table->step * c.slope;
    return c;
}

#endif
