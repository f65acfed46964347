// LANES numbers at a time: vectors as wide as the processor has them, and couples of neighbouring numbers, the components
// of a node in the plane, gathered into them and scattered from them.
#ifdef __AVX512F__
#define LANES 8
#else
#define LANES 4
#endif
#define INLINE static inline __attribute__((always_inline))
#define UNROLL _Pragma("GCC unroll 16")
#define KEEP _Pragma("GCC unroll 1")

// a b + c, rounded as these loops are by vectors of any width: once where the processor can do that.
#if defined __FMA__ || defined __ARM_FEATURE_FMA
#define FUSED(a, b, c) __builtin_fma(a, b, c)
#else
#define FUSED(a, b, c) ((a) * (b) + (c))
#endif

typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef long long_lanes __attribute__((vector_size(8 * LANES)));
typedef double loose __attribute__((vector_size(8 * LANES), aligned(8)));
typedef double couple __attribute__((vector_size(16), aligned(8)));

int lanes_per_batch(void) { return LANES; }

INLINE couple load_couple(const double *x) { return *(const couple *)x; }

// Two neighbouring numbers at LANES places: x[0][lane], x[1][lane].
INLINE void gather_couples(const double *field, const int *dof, lanes x[2])
{
#if LANES == 8
    typedef double four __attribute__((vector_size(32)));
#define PAIR(a, b) __builtin_shufflevector(load_couple(field + dof[a]), load_couple(field + dof[b]), 0, 1, 2, 3)
    const four a = PAIR(0, 2), b = PAIR(4, 6), c = PAIR(1, 3), d = PAIR(5, 7);
    const lanes even = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
    const lanes odd = __builtin_shufflevector(c, d, 0, 1, 2, 3, 4, 5, 6, 7);
    x[0] = __builtin_shufflevector(even, odd, 0, 8, 2, 10, 4, 12, 6, 14);
    x[1] = __builtin_shufflevector(even, odd, 1, 9, 3, 11, 5, 13, 7, 15);
#else
    const couple a = load_couple(field + dof[0]), b = load_couple(field + dof[1]);
    const couple c = load_couple(field + dof[2]), d = load_couple(field + dof[3]);
    x[0] = (lanes){a[0], b[0], c[0], d[0]};
    x[1] = (lanes){a[1], b[1], c[1], d[1]};
#endif
}

// Do something with every couple (place in the vectors, its two numbers), lane after lane: those of
// one vector may be the same.
#if LANES == 8
#define EACH_COUPLE(dof, x, DO) { \
        const lanes even = __builtin_shufflevector(x[0], x[1], 0, 8, 2, 10, 4, 12, 6, 14); \
        const lanes odd = __builtin_shufflevector(x[0], x[1], 1, 9, 3, 11, 5, 13, 7, 15); \
        DO(couple, dof[0], __builtin_shufflevector(even, even, 0, 1)) \
        DO(couple, dof[1], __builtin_shufflevector(odd, odd, 0, 1)) \
        DO(couple, dof[2], __builtin_shufflevector(even, even, 2, 3)) \
        DO(couple, dof[3], __builtin_shufflevector(odd, odd, 2, 3)) \
        DO(couple, dof[4], __builtin_shufflevector(even, even, 4, 5)) \
        DO(couple, dof[5], __builtin_shufflevector(odd, odd, 4, 5)) \
        DO(couple, dof[6], __builtin_shufflevector(even, even, 6, 7)) \
        DO(couple, dof[7], __builtin_shufflevector(odd, odd, 6, 7)) \
    }
#else
#define EACH_COUPLE(dof, x, DO) UNROLL for (int l = 0; l < LANES; l++) DO(couple, dof[l], ((couple){x[0][l], x[1][l]}))
#endif
