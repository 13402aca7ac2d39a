/* The network for any processor: with vectors of 4 values, or without. */
#define NETWORK_WAY network_baseline
#include "network_machine.h"
#if NETWORK_VECTORS
#define NETWORK_LANES 4
#else
#define NETWORK_LANES 1
#endif
#define NETWORK_DOUBLE NETWORK_X86 /* no fused multiply-add */
#include "network_way.h"
