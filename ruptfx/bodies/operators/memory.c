// Inelastic stress of a material with memory: the sweep over its elements.  _memory.py writes this file after matrix_free.c,
// whose geometry and gradients it uses, and in front of both the macros of a traced material:
// FIELDS, numbers of state at a point; PARAMETERS, numbers of a law that vary in the bodies; PARTS, components of strain; LAW_READ,
// declarations of state, strain and parameters; LAW_STEP, LAW_PRESENT, LAW_STORED and LAW_RECORDED, the formulas; RECORDED, numbers
// that snapshots contain of the state of a point; LAW_ONCE, ONCE parts of the formulas that are the same at all points of a step.

#include <math.h>

#define POINTS (SIMPLEX ? 1 : NODES)
#define AHEAD 12  // points whose state is prefetched; measured: 4 and 25 are slower

struct memory {
    const lanes *size;     // [batch]: sqrt|det J|, or the sign of det J where it varies in the cell; 0 for padding cells
    const lanes *inverse;  // [batch]: 1 / sqrt|det J|, or 1
    lanes *state;          // [batch][POINTS][FIELDS]
    const lanes *parameter;  // [batch][POINTS][PARAMETERS]
};

// What a sweep computes: forces after a step, present stresses, stored energy, recorded states.
enum { ADVANCED, PRESENT, ENERGY, STATES };
#define MOST(a, b) ((a) > (b) ? (a) : (b))

#define STATE(k) state[(k) * LANES + l]
#define STRAIN(k) strain[(k) * LANES + l]
#define STRESS(k) stress[(k) * LANES + l]
#define PARAMETER(k) parameter[(k) * LANES + l]

// The formulas of one point, in every lane.
static inline __attribute__((always_inline)) void at_point(const int what, double dt, const double *restrict strain,
                                                           double *restrict state, const double *restrict parameter,
                                                           const double *restrict once, double *restrict stress)
{
    (void)dt, (void)parameter, (void)once;
    if (what == ADVANCED)
#pragma omp simd
        for (int l = 0; l < LANES; l++) {
            LAW_READ
            LAW_STEP
        }
    if (what == PRESENT)
#pragma omp simd
        for (int l = 0; l < LANES; l++) {
            LAW_READ
            LAW_PRESENT
        }
    if (what == ENERGY)
#pragma omp simd
        for (int l = 0; l < LANES; l++) {
            double stored;
            LAW_READ
            LAW_STORED
            STRESS(0) = stored;
        }
#if RECORDED
    if (what == STATES)
#pragma omp simd
        for (int l = 0; l < LANES; l++) {
            LAW_READ
            LAW_RECORDED
        }
#endif
}

INLINE lanes memory_batch(const int geometry, const int what, const struct plan *plan, const struct memory *memory, long b,
                          double dt, const double *once, const double *displacement, double *sums)
{
    const int *dof = plan->dof + b * NODES * LANES;
    struct cell cell = open_cell(geometry, plan->number + plan->start[b] + (plan->kind[b] >= VARYING ? MODULI * NODES : 0));
    const int *const line = plan->line + (b + 1) * NODES * FETCH;
    lanes u[COMPONENTS][NODES], p[DIM][COMPONENTS][NODES], total = {0};
    KEEP for (int node = 0; node < NODES; node++) {
        UNROLL for (int k = 0; k < FETCH; k++) __builtin_prefetch(displacement + 8L * line[node * FETCH + k], 0);
        lanes x[COMPONENTS];
        gather(displacement, dof + node * LANES, x);
        UNROLL for (int c = 0; c < COMPONENTS; c++) u[c][node] = x[c];
    }
#if SIMPLEX
    UNROLL for (int d = 0; d < DIM; d++)
        UNROLL for (int c = 0; c < COMPONENTS; c++) p[d][c][0] = u[c][d + 1] - u[c][0];
#else
    UNROLL for (int d = 0; d < DIM; d++)
        UNROLL for (int c = 0; c < COMPONENTS; c++)
            along_all(0, &DERIVATIVE, u[c], p[d][c], d == DIM - 1 ? 1 : d == DIM - 2 ? N : N * N);
#endif
    KEEP for (int q = 0; q < POINTS; q++) {
        lanes size = memory->size[b], inverse = memory->inverse[b], h[COMPONENTS][DIM], e[PARTS];
        lanes s[MOST(PARTS, RECORDED + 1)];
        lanes *const state = memory->state + (b * POINTS + q) * FIELDS;
#if !SIMPLEX
        if (geometry == MULTILINEAR) {
#if DIM == 2
            const double xi[2] = {POINT[q / N], POINT[q % N]};
#else
            const double xi[3] = {POINT[q / (N * N)], POINT[q / N % N], POINT[q % N]};
#endif
            lanes j[DIM][DIM];
            tangents(cell.geometry, xi, j);
            inverse = adjugate(j, cell.g);
        }
#endif
        UNROLL for (int c = 0; c < COMPONENTS; c++)
            UNROLL for (int a = 0; a < DIM; a++) {
                if (geometry == BOX)
                    h[c][a] = cell.geometry[a] * p[a][c][q];
                else {
                    h[c][a] = cell.g[0][a] * p[0][c][q];
                    UNROLL for (int d = 1; d < DIM; d++) h[c][a] += cell.g[d][a] * p[d][c][q];
                }
                h[c][a] *= inverse;
            }
#if COMPONENTS == 1
        UNROLL for (int a = 0; a < DIM; a++) e[a] = 0.5 * h[0][a];
#else
        UNROLL for (int c = 0; c < DIM; c++)
            UNROLL for (int a = c; a < DIM; a++) e[PLACE(c, a)] = 0.5 * (h[c][a] + h[a][c]);
#endif
        const lanes *const parameter = memory->parameter + (b * POINTS + q) * PARAMETERS;
        if (what == ADVANCED)
            UNROLL for (int k = 0; k < FIELDS; k++) __builtin_prefetch(state + AHEAD * FIELDS + k, 1);
        at_point(what, dt, (const double *)e, (double *)state, (const double *)parameter, once, (double *)s);
        const lanes volume = geometry == MULTILINEAR ? size / inverse : size * size;
        if (what == ENERGY) {
            total += -MINUS_WEIGHT[q] * volume * s[0];
            continue;
        }
        const int parts = what == STATES ? RECORDED + 1 : PARTS;
        if (what == STATES) s[RECORDED] = (lanes){0} + 1;  // its sum is the volume of a node
        if (what == PRESENT || what == STATES) {
            UNROLL for (int n = 0; n < (SIMPLEX ? NODES : 1); n++) {
                const int node = SIMPLEX ? n : q;
                const double weight = -MINUS_WEIGHT[node] * (SIMPLEX ? 1.0 / NODES : 1.0);
                UNROLL for (int l = 0; l < LANES; l++) {
                    double *const here = sums + (long)(dof[node * LANES + l] / COMPONENTS) * parts;
                    UNROLL for (int k = 0; k < parts; k++) here[k] += weight * volume[l] * s[k][l];
                }
            }
            continue;
        }
        UNROLL for (int c = 0; c < COMPONENTS; c++)
            UNROLL for (int d = 0; d < DIM; d++) {
                if (geometry == BOX)
                    p[d][c][q] = size * cell.geometry[d] * s[PLACE(c, d)];
                else {
                    lanes sum = cell.g[d][0] * s[PLACE(c, 0)];
                    UNROLL for (int a = 1; a < DIM; a++) sum += cell.g[d][a] * s[PLACE(c, a)];
                    p[d][c][q] = size * sum;
                }
            }
    }
    if (what != ADVANCED) return total;
#if SIMPLEX
    UNROLL for (int c = 0; c < COMPONENTS; c++) {
        u[c][0] = -p[0][c][0];
        UNROLL for (int d = 1; d < DIM; d++) u[c][0] -= p[d][c][0];
        UNROLL for (int d = 0; d < DIM; d++) u[c][d + 1] = p[d][c][0];
    }
#else
    UNROLL for (int d = 0; d < DIM; d++)
        UNROLL for (int c = 0; c < COMPONENTS; c++)
            along_all(d > 0, &TRANSPOSED, p[d][c], u[c], d == DIM - 1 ? 1 : d == DIM - 2 ? N : N * N);
#endif
    KEEP for (int node = 0; node < NODES; node++) {
        UNROLL for (int k = 0; k < FETCH; k++) __builtin_prefetch(sums + 8L * line[node * FETCH + k], 1);
        lanes x[COMPONENTS];
        UNROLL for (int c = 0; c < COMPONENTS; c++) x[c] = MINUS_WEIGHT[node] * u[c][node];
        scatter_add(sums, dof + node * LANES, x);
    }
    return total;
}

static inline double memory_sweep(const int what, const struct plan *plan, const struct memory *memory, long first, long last,
                                  double dt, const double *displacement, double *sums)
{
    lanes total = {0};
    double once[ONCE + 1];
    {
        LAW_ONCE
    }
    for (long b = first; b < last; b++)
        switch (GEOMETRY(plan->kind[b])) {
#define MEMORY_CASE(geometry) \
    case geometry: total += memory_batch(geometry, what, plan, memory, b, dt, once, displacement, sums); break;
            MEMORY_CASE(AFFINE)
#if !SIMPLEX
            MEMORY_CASE(BOX)
            MEMORY_CASE(MULTILINEAR)
#endif
        }
    double sum = 0;
    UNROLL for (int l = 0; l < LANES; l++) sum += total[l];
    return sum;
}

void memory_force(const struct plan *plan, const struct memory *memory, long first, long last, double dt, const double *u,
                  double *force)
{
    memory_sweep(ADVANCED, plan, memory, first, last, dt, u, force);
}

void memory_stress(const struct plan *plan, const struct memory *memory, long batches, const double *u, double *stress)
{
    memory_sweep(PRESENT, plan, memory, 0, batches, 0.0, u, stress);
}

#if RECORDED
void memory_states(const struct plan *plan, const struct memory *memory, long batches, const double *u, double *states)
{
    memory_sweep(STATES, plan, memory, 0, batches, 0.0, u, states);
}
#endif

double memory_energy(const struct plan *plan, const struct memory *memory, long batches, const double *u)
{
    return memory_sweep(ENERGY, plan, memory, 0, batches, 0.0, u, 0);
}
