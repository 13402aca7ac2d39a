/* The corrector's network: one window in, one correction out. No memory is allocated, nothing is locked, the weights
 * are constant: any number of threads may call it at once. */
#ifndef NETWORK_H
#define NETWORK_H

#include "names.h"
#include "network_size.h"

/* window: NETWORK_ROWS rows of NETWORK_SEEN values, oldest first: the channels in their units, then what else it sees. condition: speed in
 * km/h, amplitude in deg, frequency in Hz. seconds: since the excitation began. corrected, baseline, sigma: the
 * channels' units, NETWORK_CHANNELS each. in_envelope: one value from 0 to 1. state, next_state: NETWORK_STATE values each,
 * not in the same place; zeros for the first full window, then what the sample before said; not used where there are none.
 * All inputs must be finite. */
typedef void network_function(const float window[], const float condition[], double seconds, float corrected[],
                              float baseline[], float sigma[], float *in_envelope, const float state[], float next_state[]);

network_function network;

/* One and the same function for several instruction sets: way 0 runs everywhere, the later one is faster. NULL beyond
 * the last, and where this processor lacks what a way needs. network() takes the last that is not NULL. */
network_function *network_way(int number);
#define NETWORK_WAYS 2

#endif
