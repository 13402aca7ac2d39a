/* Laws in the loop with an FMU: what both march.c and the generated laws know. */
#ifndef MARCH_H
#define MARCH_H

/* The force of a law in the middle of a step of h s that begins with the states z, which advance to its end. p: the law's numbers.
 * port: displacement, velocity, acceleration, nominal force, SI. t: s, the middle of the step. */
typedef double LawFunction(const double p[], const double port[4], double t, double h, double z[]);

extern LawFunction *const LAWS[];

#endif
