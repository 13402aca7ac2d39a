/* Takes the way that suits the processor, at the first call.
 *
 * There is none for AVX-512: reading the weights takes the time, AVX2 does that as fast, and some processors lower
 * their clock, the solver's with it, for 512-bit arithmetic. */
#include "network.h"

#include <stddef.h>

#include "network_machine.h"

network_function network_baseline, network_avx2;

#if NETWORK_X86
#include <cpuid.h>

/* FMA, AVX2, and an operating system that saves their registers (XCR0 says so). */
static int runs_avx2(void)
{
    const unsigned wanted = 1u << 12 | 1u << 27 | 1u << 28; /* FMA, OSXSAVE, AVX */
    unsigned a, b, c, d;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & wanted) != wanted)
        return 0;
    __asm__ volatile("xgetbv" : "=a"(a), "=d"(d) : "c"(0));
    return (a & 6) == 6 && __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & 1u << 5);
}

network_function *network_way(int number)
{
    return number == 0 ? network_baseline : number == 1 && runs_avx2() ? network_avx2 : NULL;
}

void network(const float window[], const float condition[], double seconds, float corrected[], float baseline[],
             float sigma[], float *in_envelope, const float state[], float next_state[])
{
    /* Threads that come first together all find the same. Asking again at each call would cost more than the network:
     * hypervisors answer cpuid themselves. */
    static network_function *fastest;
    network_function *way = __atomic_load_n(&fastest, __ATOMIC_RELAXED);
    if (!way) {
        way = runs_avx2() ? network_avx2 : network_baseline;
        __atomic_store_n(&fastest, way, __ATOMIC_RELAXED);
    }
    way(window, condition, seconds, corrected, baseline, sigma, in_envelope, state, next_state);
}
#else
network_function *network_way(int number) { return number == 0 ? network_baseline : NULL; }

void network(const float window[], const float condition[], double seconds, float corrected[], float baseline[],
             float sigma[], float *in_envelope, const float state[], float next_state[])
{
    network_baseline(window, condition, seconds, corrected, baseline, sigma, in_envelope, state, next_state);
}
#endif
