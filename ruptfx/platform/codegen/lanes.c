// LANES numbers at a time: vectors as wide as the processor has them, and couples of neighbouring numbers, the components
// of a node in the plane, gathered into them and scattered from them.
#ifdef __AVX512F__
#define VECTOR 64
#else
#define VECTOR 32
#endif
#ifndef LANE
#define LANE 8  // bytes of a number in `lanes`
#endif
#ifndef REAL
#define REAL double  // type of velocities and forces of nodes
#endif
#define LANES (VECTOR / LANE)
#define WIDE (VECTOR / 8)
#define HALVES (LANES / WIDE)
#define INLINE static inline __attribute__((always_inline))
#define UNROLL _Pragma("GCC unroll 16")
#define KEEP _Pragma("GCC unroll 1")

#if LANE == 4
typedef float lane;
typedef int whole;
#define FUSED_ONCE __builtin_fmaf
#else
typedef double lane;
typedef long whole;
#define FUSED_ONCE __builtin_fma
#endif

// a b + c, rounded as these loops are by vectors of any width: once where the processor can do that.
#if defined __FMA__ || defined __ARM_FEATURE_FMA
#define FUSED(a, b, c) FUSED_ONCE(a, b, c)
#else
#define FUSED(a, b, c) ((a) * (b) + (c))
#endif

typedef REAL real;
typedef lane lanes __attribute__((vector_size(VECTOR)));
typedef whole whole_lanes __attribute__((vector_size(VECTOR)));
typedef lane loose __attribute__((vector_size(VECTOR), aligned(LANE)));
// As many numbers of the type of `lanes` as there are doubles in a vector.
typedef lane few __attribute__((vector_size(LANE * WIDE)));
typedef lane loose_few __attribute__((vector_size(LANE * WIDE), aligned(LANE)));
typedef whole whole_few __attribute__((vector_size(LANE * WIDE)));
typedef double wide __attribute__((vector_size(VECTOR)));
typedef double loose_wide __attribute__((vector_size(VECTOR), aligned(8)));
typedef double wide_couple __attribute__((vector_size(16), aligned(8)));

int lanes_per_batch(void) { return LANES; }

INLINE wide_couple load_couple(const double *x) { return *(const wide_couple *)x; }

// Two neighbouring numbers at WIDE places: x[0][lane], x[1][lane].
INLINE void gather_wide_couples(const double *field, const int *dof, wide x[2])
{
#if WIDE == 8
    typedef double four __attribute__((vector_size(32)));
#define PAIR(a, b) __builtin_shufflevector(load_couple(field + dof[a]), load_couple(field + dof[b]), 0, 1, 2, 3)
    const four a = PAIR(0, 2), b = PAIR(4, 6), c = PAIR(1, 3), d = PAIR(5, 7);
    const wide even = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
    const wide odd = __builtin_shufflevector(c, d, 0, 1, 2, 3, 4, 5, 6, 7);
    x[0] = __builtin_shufflevector(even, odd, 0, 8, 2, 10, 4, 12, 6, 14);
    x[1] = __builtin_shufflevector(even, odd, 1, 9, 3, 11, 5, 13, 7, 15);
#else
    const wide_couple a = load_couple(field + dof[0]), b = load_couple(field + dof[1]);
    const wide_couple c = load_couple(field + dof[2]), d = load_couple(field + dof[3]);
    x[0] = (wide){a[0], b[0], c[0], d[0]};
    x[1] = (wide){a[1], b[1], c[1], d[1]};
#endif
}

#if LANE == 4
typedef float couple __attribute__((vector_size(8), aligned(4)));
typedef double two_floats __attribute__((aligned(4), may_alias));  // as one number, which is faster to load
#if WIDE == 8
#define LOWER 0, 1, 2, 3, 4, 5, 6, 7
#define UPPER 8, 9, 10, 11, 12, 13, 14, 15
#define EVEN 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30
#define ODD 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31
#define MIXED(n) n, 16 + n, n + 1, 17 + n, n + 2, 18 + n, n + 3, 19 + n, n + 4, 20 + n, n + 5, 21 + n, n + 6, 22 + n, \
    n + 7, 23 + n
#else
#define LOWER 0, 1, 2, 3
#define UPPER 4, 5, 6, 7
#define EVEN 0, 2, 4, 6, 8, 10, 12, 14
#define ODD 1, 3, 5, 7, 9, 11, 13, 15
#define MIXED(n) n, 8 + n, n + 1, 9 + n, n + 2, 10 + n, n + 3, 11 + n
#endif

INLINE wide widen(const few x) { return __builtin_convertvector(x, wide); }
INLINE few narrow(const wide x) { return __builtin_convertvector(x, few); }
INLINE lanes narrowed(const wide x[HALVES]) { return __builtin_shufflevector(narrow(x[0]), narrow(x[1]), LOWER, UPPER); }

INLINE void gather_couples(const float *field, const int *dof, lanes x[2])
{
    wide part[2];
    UNROLL for (int l = 0; l < LANES; l++) part[l / WIDE][l % WIDE] = *(const two_floats *)(field + dof[l]);
    x[0] = __builtin_shufflevector((lanes)part[0], (lanes)part[1], EVEN);
    x[1] = __builtin_shufflevector((lanes)part[0], (lanes)part[1], ODD);
}

// Do something with every couple (place in the vectors, its two numbers), lane after lane: those of
// one vector may be the same.
#define EACH_COUPLE(dof, x, DO) { \
        const lanes mixed[2] = {__builtin_shufflevector(x[0], x[1], MIXED(0)), \
                                __builtin_shufflevector(x[0], x[1], MIXED(WIDE))}; \
        UNROLL for (int l = 0; l < LANES; l++) DO(couple, dof[l], ((const couple *)mixed)[l]) \
    }
#else
typedef wide_couple couple;

INLINE wide widen(const few x) { return x; }
INLINE few narrow(const wide x) { return x; }

#define gather_couples gather_wide_couples

#if WIDE == 8
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
#endif
