/* One way of computing the network: NETWORK_WAY is the function's name, NETWORK_LANES the values in a vector,
 * NETWORK_TARGET the instruction sets, so that no compiler flags are needed, NETWORK_DOUBLE whether they lack a multiplication
 * and addition that is rounded once. */
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "network.h"

#ifdef NETWORK_TARGET
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target(NETWORK_TARGET))), apply_to = function)
#else
#define NETWORK_PRAGMA(text) _Pragma(#text)
#define NETWORK_GCC_TARGET(text) NETWORK_PRAGMA(GCC target(text))
#pragma GCC push_options
#pragma GCC optimize("fp-contract=fast") /* gcc does not know the standard's FP_CONTRACT */
NETWORK_GCC_TARGET(NETWORK_TARGET)
#endif
#endif

#if defined(__clang__)
#pragma STDC FP_CONTRACT ON /* a b + c may be rounded once, within one expression */
#endif

#include "network_lanes.h"

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion" /* sizes and indices of the generated graph; all of them are small */
#pragma GCC diagnostic ignored "-Wsign-conversion"
#pragma GCC diagnostic ignored "-Wpedantic" /* arrays of several dimensions become const on their way to a node */
#pragma GCC diagnostic ignored "-Wunused-parameter" /* time, where the network has no phase */
#endif
#define tanhf network_tanh
#include "network_graph.h"
#undef tanhf
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

network_function NETWORK_WAY;

void NETWORK_WAY(const float window[], const float condition[], double seconds, float corrected[], float baseline[],
                 float sigma[], float *in_envelope, const float state[], float next_state[])
{
    const double time[1][1] = {{seconds}};
#if NETWORK_STATE
#define NETWORK_STATE_IN , (const float(*)[NETWORK_STATE])state
#define NETWORK_STATE_OUT , (float(*)[NETWORK_STATE])next_state
#else
#define NETWORK_STATE_IN
#define NETWORK_STATE_OUT
    (void)state, (void)next_state;
#endif
    network_graph((const float(*)[NETWORK_ROWS][NETWORK_SEEN])window, (const float(*)[3])condition, time NETWORK_STATE_IN,
                  (float(*)[NETWORK_CHANNELS])corrected, (float(*)[NETWORK_CHANNELS])baseline,
                  (float(*)[NETWORK_CHANNELS])sigma, (float(*)[1])in_envelope NETWORK_STATE_OUT);
}

#ifdef NETWORK_TARGET
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif
#endif
