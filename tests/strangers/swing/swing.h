/* A pendulum in closed form, in the style of an exporter that ships its sources: several files, and names of its own. */
#ifndef SWING_H
#define SWING_H

typedef struct {
    double time;
} Swing;

double swing_value(const Swing *swing, unsigned reference);

#endif
