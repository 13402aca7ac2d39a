/* Forces of laws that see an acceleration which answers to these forces at once. */
#ifndef TOGETHER_H
#define TOGETHER_H

#include <stddef.h>

/* The forces of n laws, in place. force: of each law at the acceleration that it sees without any of them; slope: its
 * change per m/s2; answer: n rows, how the acceleration that law i sees answers to the force of law j. Each force is
 * force + slope (answer force): n linear equations, which elimination solves; the laws are linear in the acceleration. */
static void together(size_t n, const double slope[], double answer[], double force[])
{
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            answer[i * n + j] = (i == j) - slope[i] * answer[i * n + j];
    for (size_t k = 0; k < n; k++)
        for (size_t i = k + 1; i < n; i++) {
            const double part = answer[i * n + k] / answer[k * n + k];
            for (size_t j = k + 1; j < n; j++)
                answer[i * n + j] -= part * answer[k * n + j];
            force[i] -= part * force[k];
        }
    for (size_t i = n; i-- > 0;) {
        for (size_t j = i + 1; j < n; j++)
            force[i] -= answer[i * n + j] * force[j];
        force[i] /= answer[i * n + i];
    }
}

#endif
