/* What the compiler can do. AVX2 needs vector types, target attributes and <cpuid.h>: gcc and clang on x86-64. */
#ifndef NETWORK_MACHINE_H
#define NETWORK_MACHINE_H

#if defined(__GNUC__)
#define NETWORK_VECTORS 1
#define NETWORK_ALIGNED __attribute__((aligned(64)))
#else
#define NETWORK_VECTORS 0
#define NETWORK_ALIGNED
#endif

#if NETWORK_VECTORS && defined(__x86_64__)
#define NETWORK_X86 1
#else
#define NETWORK_X86 0
#endif

#endif
