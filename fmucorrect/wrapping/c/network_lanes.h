/* What the generated graph leans on: a row times a matrix, and tanh, in vectors of NETWORK_LANES values. */
#ifndef NETWORK_LANES_H
#define NETWORK_LANES_H

#if defined(__clang__)
#define NETWORK_UNROLLED _Pragma("unroll")
#elif defined(__GNUC__)
#define NETWORK_UNROLLED _Pragma("GCC unroll 16")
#else
#define NETWORK_UNROLLED
#endif

#if NETWORK_VECTORS
#define NETWORK_INLINE static inline __attribute__((always_inline, unused))
typedef float network_lanes __attribute__((vector_size(4 * NETWORK_LANES)));
typedef float network_four __attribute__((vector_size(16)));
#else
#define NETWORK_INLINE static inline
typedef float network_lanes;
#endif

/* a b + c, rounded once: ONNX Runtime's kernels do so on every processor of today, and the weights cancel so strongly that
 * rounding twice ends 1.5e-5 mm away. Processors without that instruction go through double precision. */
#if NETWORK_DOUBLE
NETWORK_INLINE float network_fused(float a, float b, float c) { return (float)((double)a * b + c); }
#if NETWORK_VECTORS
typedef double network_wide __attribute__((vector_size(8 * NETWORK_LANES)));
NETWORK_INLINE network_lanes network_fused_lanes(float a, network_lanes b, network_lanes c)
{
    return __builtin_convertvector((double)a * __builtin_convertvector(b, network_wide) + __builtin_convertvector(c, network_wide),
                                   network_lanes);
}
#define network_fused_four network_fused_lanes /* NETWORK_LANES is 4 */
#endif
#else
NETWORK_INLINE float network_fused(float a, float b, float c) { return a * b + c; }
#if NETWORK_VECTORS
NETWORK_INLINE network_lanes network_fused_lanes(float a, network_lanes b, network_lanes c) { return a * b + c; }
NETWORK_INLINE network_four network_fused_four(float a, network_four b, network_four c) { return a * b + c; }
#endif
#endif

/* y[j..] for `count` vectors of `size` columns at once, as long as there are that many. The sums stay in registers.
 * They are added up in the order of the rows, as ONNX Runtime does; only those of few columns in `split` interleaved
 * parts, since an addition takes longer than the processor needs to begin the next. */
#define NETWORK_COLUMNS(vector, size, count, split, fused)                                                          \
    for (; j + count * size <= columns; j += count * size) {                                                   \
        const float *from = weights + j;                                                                       \
        vector sums[split][count], weight;                                                                     \
        int k = 0;                                                                                             \
        memset(sums, 0, sizeof sums);                                                                          \
        for (; k + split <= rows; k += split, from += split * columns) {                                       \
            NETWORK_UNROLLED for (int part = 0; part < split; part++) {                                        \
                NETWORK_UNROLLED for (int v = 0; v < count; v++) {                                             \
                    memcpy(&weight, from + part * columns + v * size, sizeof weight);                          \
                    sums[part][v] = fused(x[k + part], weight, sums[part][v]);                                 \
                }                                                                                              \
            }                                                                                                  \
        }                                                                                                      \
        for (; k < rows; k++, from += columns) {                                                               \
            NETWORK_UNROLLED for (int v = 0; v < count; v++) {                                                 \
                memcpy(&weight, from + v * size, sizeof weight);                                               \
                sums[0][v] = fused(x[k], weight, sums[0][v]);                                                  \
            }                                                                                                  \
        }                                                                                                      \
        NETWORK_UNROLLED for (int v = 0; v < count; v++) {                                                     \
            NETWORK_UNROLLED for (int part = 1; part < split; part++) sums[0][v] += sums[part][v];             \
            if (bias) {                                                                                        \
                memcpy(&weight, bias + j + v * size, sizeof weight);                                           \
                sums[0][v] += weight;                                                                          \
            }                                                                                                  \
            memcpy(y + j + v * size, &sums[0][v], sizeof weight);                                              \
        }                                                                                                      \
    }

/* y = x W + bias with W of `rows` times `columns`, row by row; bias may be NULL. rows and columns are constants where
 * this is called, so that only the loops remain that have something to do. */
NETWORK_INLINE void network_row(int rows, int columns, const float *restrict x, const float *restrict weights,
                                const float *restrict bias, float *restrict y)
{
    int j = 0;
#if NETWORK_VECTORS
    NETWORK_COLUMNS(network_lanes, NETWORK_LANES, 12, 1, network_fused_lanes)
    NETWORK_COLUMNS(network_lanes, NETWORK_LANES, 8, 1, network_fused_lanes)
    NETWORK_COLUMNS(network_lanes, NETWORK_LANES, 4, 2, network_fused_lanes)
    NETWORK_COLUMNS(network_lanes, NETWORK_LANES, 2, 4, network_fused_lanes)
    NETWORK_COLUMNS(network_lanes, NETWORK_LANES, 1, 8, network_fused_lanes)
    NETWORK_COLUMNS(network_four, 4, 2, 4, network_fused_four)
    NETWORK_COLUMNS(network_four, 4, 1, 8, network_fused_four)
#else
    NETWORK_COLUMNS(float, 1, 8, 1, network_fused)
#endif
    NETWORK_COLUMNS(float, 1, 1, 8, network_fused)
}

/* tanh as a ratio of polynomials, good to 5e-7 (Eigen's generic_fast_tanh_float and ONNX Runtime's MlasComputeTanh
 * have the same coefficients). Without branches, so that loops over it become vectors; NaN stays NaN. */
NETWORK_INLINE float network_tanh(float value)
{
    float x = value > 9.0f ? 9.0f : value;
    x = x < -9.0f ? -9.0f : x;
    const float s = x * x;
    float p = -2.76076847742355e-16f;
    p = network_fused(p, s, 2.00018790482477e-13f);
    p = network_fused(p, s, -8.60467152213735e-11f);
    p = network_fused(p, s, 5.12229709037114e-08f);
    p = network_fused(p, s, 1.48572235717979e-05f);
    p = network_fused(p, s, 6.37261928875436e-04f);
    p = network_fused(p, s, 4.89352455891786e-03f);
    float q = 1.19825839466702e-06f;
    q = network_fused(q, s, 1.18534705686654e-04f);
    q = network_fused(q, s, 2.26843463243900e-03f);
    q = network_fused(q, s, 4.89352518554385e-03f);
    return x * p / q;
}

#endif
