/* The network for x86-64 processors with AVX2 and FMA. */
#include "network_machine.h"
#if NETWORK_X86
#define NETWORK_WAY network_avx2
#define NETWORK_LANES 8
#define NETWORK_DOUBLE 0
#define NETWORK_TARGET "avx2,fma"
#include "network_way.h"
#else
typedef int network_no_avx2;
#endif
