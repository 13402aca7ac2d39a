/* Only for the proof: many windows through one way of computing the network. */
#include "network.h"

#include <stddef.h>

#if defined(_WIN32)
__declspec(dllexport)
#elif defined(__GNUC__)
__attribute__((visibility("default")))
#endif
int probe(int way, int count, const float windows[], const float conditions[], const double seconds[],
          float corrected[], float baseline[], float sigma[], float in_envelope[], const float states[], float next_states[]);

/* way -1: as network() chooses. Returns 0 where this processor lacks what the way needs. */
int probe(int way, int count, const float windows[], const float conditions[], const double seconds[],
          float corrected[], float baseline[], float sigma[], float in_envelope[], const float states[], float next_states[])
{
    network_function *compute = way < 0 ? network : network_way(way);
    if (!compute)
        return 0;
    for (size_t i = 0; i < (size_t)count; i++)
        compute(windows + i * NETWORK_ROWS * NETWORK_SEEN, conditions + i * 3, seconds[i],
                corrected + i * NETWORK_CHANNELS, baseline + i * NETWORK_CHANNELS, sigma + i * NETWORK_CHANNELS,
                in_envelope + i, states + i * NETWORK_STATE, next_states + i * NETWORK_STATE);
    return 1;
}
