/* Curve, cant and irregularity below the vehicle. */
#include "track.h"

#include <math.h>

#include "variables.h"

#define P(name) v[V_##name]

/* The centre line at one place. heading and offset are the first and second integral of the curvature. */
typedef struct {
    double curvature, curvature_slope, heading, offset; /* 1/m, 1/m2, rad, m */
    double cant, cant_slope, cant_bend;                 /* rad, 1/m, 1/m2 */
} Line;

typedef struct {
    double value, slope, bend, integral, twice; /* of the shape by xi: itself, two derivatives, two integrals */
} Shape;

static Shape bloss(double xi)
{
    return (Shape){
        .value = xi * xi * (3.0 - 2.0 * xi),
        .slope = 6.0 * xi * (1.0 - xi),
        .bend = 6.0 - 12.0 * xi,
        .integral = xi * xi * xi * (1.0 - 0.5 * xi),
        .twice = xi * xi * xi * xi * (0.25 - 0.1 * xi),
    };
}

/* k, cant: of the arc. */
static Line line_at(const double *v, double k, double cant, double distance)
{
    const double length = P(transition_length), arc = P(curve_length);
    const double s = distance - P(curve_start);
    Line line = {0};
    if (s <= 0.0)
        return line;
    double shape = 1.0, slope = 0.0, bend = 0.0;
    if (s < length) {
        const Shape b = bloss(s / length);
        shape = b.value, slope = b.slope / length, bend = b.bend / (length * length);
        line.heading = k * length * b.integral;
        line.offset = k * length * length * b.twice;
    } else {
        const double on_arc = fmin(s - length, arc), after = s - length - arc;
        line.heading = k * (0.5 * length + on_arc);
        line.offset = k * (0.15 * length * length + on_arc * (0.5 * length + 0.5 * on_arc));
        if (after > 0.0) {
            const double t = fmin(after, length), heading = line.heading;
            const Shape b = bloss(t / length);
            shape = 1.0 - b.value, slope = -b.slope / length, bend = -b.bend / (length * length);
            line.heading += k * (t - length * b.integral);
            line.offset += heading * t + k * (0.5 * t * t - length * length * b.twice) + line.heading * (after - t);
            if (after > length)
                shape = slope = bend = 0.0;
        }
    }
    line.curvature = k * shape;
    line.curvature_slope = k * slope;
    line.cant = cant * shape;
    line.cant_slope = cant * slope;
    line.cant_bend = cant * bend;
    return line;
}

static TrackFrame below_wheelset(Line line, Line rear, double ahead, double speed, double speed_rate)
{
    return (TrackFrame){
        .offset = line.offset - rear.offset - ahead * rear.heading, /* from the tangent at the rear wheelset: small */
        .slope = line.heading - rear.heading,
        .curvature = line.curvature,
        .heading = line.heading - rear.heading,
        .heading_rate = speed * line.curvature,
        .heading_acceleration = speed * speed * line.curvature_slope + speed_rate * line.curvature,
        .cant = line.cant,
        .cant_rate = speed * line.cant_slope,
        .cant_acceleration = speed * speed * line.cant_bend + speed_rate * line.cant_slope,
    };
}

static TrackFrame chord(const TrackFrame *front, const TrackFrame *rear, double length, double speed, double speed_rate)
{
    const double slope = front->slope - rear->slope;
    return (TrackFrame){
        .offset = 0.5 * (front->offset + rear->offset),
        .slope = 0.5 * (front->slope + rear->slope),
        .curvature = 0.5 * (front->curvature + rear->curvature),
        .heading = (front->offset - rear->offset) / length,
        .heading_rate = speed * slope / length,
        .heading_acceleration = (speed * speed * (front->curvature - rear->curvature) + speed_rate * slope) / length,
        .cant = 0.5 * (front->cant + rear->cant),
        .cant_rate = 0.5 * (front->cant_rate + rear->cant_rate),
        .cant_acceleration = 0.5 * (front->cant_acceleration + rear->cant_acceleration),
    };
}

static void put_free_fall(TrackFrame *f, double gravity, double speed)
{
    const double centripetal = speed * speed * f->curvature, s = f->cant != 0.0 ? sin(f->cant) : 0.0,
                 c = sqrt(1.0 - s * s);
    f->lateral = gravity * s - centripetal * c;
    f->vertical = -gravity * c - centripetal * s;
}

static void put_rails(const Irregularity *irregularity, const double *v, double distance, double speed, Rail rail[2])
{
    Unevenness u, du;
    irregularity_at(irregularity, distance, &u, &du);
    const double scale = P(irregularity_scale), rate = scale * speed;
    for (int side = 0; side < 2; side++) {
        const double out = side == RIGHT ? 0.5 : -0.5;
        rail[side] = (Rail){
            scale * (u.lateral + out * u.gauge),
            scale * (u.vertical - out * u.cant),
            rate * (du.lateral + out * du.gauge),
            rate * (du.vertical - out * du.cant),
        };
    }
}

double running_speed(const double *v, double *rate, bool *held)
{
    const double speed = P(speed) + P(speed_change);
    const bool low = speed < SLOWEST || (speed == SLOWEST && P(speed_rate) < 0.0);
    const bool high = speed > FASTEST || (speed == FASTEST && P(speed_rate) > 0.0);
    *held = low || high;
    *rate = (low && P(speed_rate) < 0.0) || (high && P(speed_rate) > 0.0) ? 0.0 : P(speed_rate);
    return low ? SLOWEST : high ? FASTEST : speed;
}

void track_below(const Irregularity *irregularity, const double *v, bool level, Track *t)
{
    const double bogie = 0.5 * P(bogie_distance), axle = 0.5 * P(wheelbase);
    const double ahead[WHEELSETS] = {bogie + axle, bogie - axle, -bogie + axle, -bogie - axle};
    bool held;
    *t = (Track){0};
    t->speed = running_speed(v, &t->speed_rate, &held);
    if (level)
        t->speed_rate = 0.0;
    if (!level && (P(curve_radius) != 0.0 || P(cant) != 0.0)) {
        const double k = P(curve_radius) != 0.0 ? 1.0 / P(curve_radius) : 0.0;
        const double cant = asin(P(cant) / P(contact_base)) * (k < 0.0 ? -1.0 : 1.0);
        Line line[WHEELSETS];
        for (int i = 0; i < WHEELSETS; i++)
            line[i] = line_at(v, k, cant, P(distance) + ahead[i]);
        for (int i = 0; i < WHEELSETS; i++)
            t->wheelset[i] =
                below_wheelset(line[i], line[WHEELSETS - 1], ahead[i] - ahead[WHEELSETS - 1], t->speed, t->speed_rate);
        for (int i = 0; i < BOGIES; i++)
            t->frame[i] = chord(&t->wheelset[2 * i], &t->wheelset[2 * i + 1], P(wheelbase), t->speed, t->speed_rate);
        t->car = chord(&t->frame[0], &t->frame[1], P(bogie_distance), t->speed, t->speed_rate);
    }
    for (int i = 0; i < WHEELSETS; i++) {
        put_free_fall(&t->wheelset[i], P(gravity), t->speed);
        if (!level && !irregularity->level)
            put_rails(irregularity, v, P(distance) + ahead[i], t->speed, t->rail[i]);
    }
    put_free_fall(&t->frame[0], P(gravity), t->speed);
    put_free_fall(&t->frame[1], P(gravity), t->speed);
    put_free_fall(&t->car, P(gravity), t->speed);
}
