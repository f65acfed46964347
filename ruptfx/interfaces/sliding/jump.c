// The jump of a sliding interface, frame (u+ - B u-), and its transpose; nodes are those of the plus side, then those of the
// minus side. Where surfaces are lines (COMPONENTS is 2), every row of B and of B' is a run of neighbouring nodes, padded with
// zeros, and vectors are stored component after component. In space rows are lists of nodes, and vectors are stored node by node.
#include <string.h>

enum { RUN = 8 };

#if COMPONENTS == 2
#define ADD(x, y, z) ((x) + (y))
#else
#define ADD(x, y, z) ((x) + (y) + (z))
#endif
#define SQUARE (COMPONENTS * COMPONENTS)
#define ACROSS(c, j) f->across[PLACE(c, j)]
#define EACH_COMPONENT for (int c = 0; c < COMPONENTS; c++)

struct pairing {
    long n, m;                // points, nodes of the other side
    long columns, width;      // of lines: lengths of the rows of B and B', multiples of RUN
    const long *dofs;         // first degree of freedom of every node
    const long *first;        // of lines: first node that every point is paired with; in space: first entry of every row of B
    const double *coupling;   // B, n rows
    const long *paired;       // of lines: first point that every node of the other side is paired with; in space: rows of B'
    const double *transposed; // B', m rows
    const double *frame;      // n times COMPONENTS x COMPONENTS, zero for points without a partner
    const double *weight;     // n
    double *across, *back;    // vectors at the nodes of the other side, and the forces on them
    double *forces;           // forces at the points
    const int *nodes, *points;   // in space: the node of every entry of B, the point of every entry of B'
};

#if COMPONENTS == 2
#define PLACE(c, j) ((c) * (f->m + f->columns) + (j))  // of a component at a node of the other side
#define BACK(c, j) f->back[(c) * (f->m + f->columns) + (j)]
#define FORCES(c, i) f->forces[(c) * (f->n + f->width) + (i)]

typedef double run __attribute__((vector_size(RUN * sizeof(double)), aligned(8), may_alias));
typedef double half __attribute__((vector_size(RUN / 2 * sizeof(double)), may_alias));
typedef union { run all; half halves[2]; double each[RUN]; } row;

static inline __attribute__((always_inline)) double total(run values)
{
    const row sum = {values};
    row part;
    part.halves[0] = sum.halves[0] + sum.halves[1];
    return (part.each[0] + part.each[2]) + (part.each[1] + part.each[3]);
}

// A row times x and y.
static inline __attribute__((always_inline)) void product(const double *each, long columns, const double *x,
                                                          const double *y, double result[2])
{
    run of_x = {0}, of_y = {0};
    for (long j = 0; j < columns; j += RUN) {
        const run values = *(const run *)(each + j);
        of_x += values * *(const run *)(x + j);
        of_y += values * *(const run *)(y + j);
    }
    result[0] = total(of_x), result[1] = total(of_y);
}

// B times vectors at the nodes of the other side, of point i.
static inline __attribute__((always_inline)) void opposite_mean(const struct pairing *f, const double *vectors, long i,
                                                                double mean[2])
{
    const double *x = vectors + f->first[i];
    product(f->coupling + i * f->columns, f->columns, x, x + f->m + f->columns, mean);
}

// back = B' times the forces of the points, of node j of the other side.
static inline __attribute__((always_inline)) void react(const struct pairing *f, long j)
{
    const double *x = f->forces + f->paired[j];
    double sum[2];
    product(f->transposed + j * f->width, f->width, x, x + f->n + f->width, sum);
    EACH_COMPONENT BACK(c, j) = sum[c];
}
#else
enum { STRIDE = 4 };  // a vector and a filler, so that processors read it at once
#define PLACE(c, j) (STRIDE * (j) + (c))
#define BACK(c, j) f->back[STRIDE * (j) + (c)]
#define FORCES(c, i) f->forces[STRIDE * (i) + (c)]

typedef double vector __attribute__((vector_size(STRIDE * sizeof(double)), aligned(8), may_alias));

// Entries `begin` to `end` of a row times the vectors at their nodes.
static inline __attribute__((always_inline)) void product(const double *values, const int *nodes, long begin, long end,
                                                          const double *vectors, double *result)
{
    vector even = {0}, odd = {0};
    long j = begin;
    for (; j + 1 < end; j += 2) {
        even += values[j] * *(const vector *)(vectors + STRIDE * nodes[j]);
        odd += values[j + 1] * *(const vector *)(vectors + STRIDE * nodes[j + 1]);
    }
    if (j < end) even += values[j] * *(const vector *)(vectors + STRIDE * nodes[j]);
    even += odd;
    EACH_COMPONENT result[c] = even[c];
}

// B times vectors at the nodes of the other side, of point i.
static inline __attribute__((always_inline)) void opposite_mean(const struct pairing *f, const double *vectors, long i,
                                                                double *mean)
{
    product(f->coupling, f->nodes, f->first[i], f->first[i + 1], vectors, mean);
}

// back = B' times the forces of the points, of node j of the other side.
static inline __attribute__((always_inline)) void react(const struct pairing *f, long j)
{
    product(f->transposed, f->points, f->paired[j], f->paired[j + 1], f->forces, &BACK(0, j));
}
#endif

// local = J field, n x COMPONENTS.
void jump(const struct pairing *f, const double *field, double *local)
{
    const long *dofs = f->dofs + f->n;
    // Nodes are far apart in memory: all are prefetched before the first is needed.
    for (long i = 0; i < f->n + f->m; i++) __builtin_prefetch(field + f->dofs[i]);
    for (long j = 0; j < f->m; j++)
        EACH_COMPONENT ACROSS(c, j) = field[dofs[j] + c];
    for (long i = 0; i < f->n; i++) {
        const double *frame = f->frame + SQUARE * i, *own = field + f->dofs[i];
        double mean[COMPONENTS];
        opposite_mean(f, f->across, i, mean);
        for (int k = 0; k < COMPONENTS; k++, frame += COMPONENTS)
            local[COMPONENTS * i + k] =
                ADD(frame[0] * (own[0] - mean[0]), frame[1] * (own[1] - mean[1]), frame[2] * (own[2] - mean[2]));
    }
}

// Largest difference of a field from `values` at the nodes of both sides, in any component.
double largest_difference(const struct pairing *f, const double *field, const double *values)
{
    double largest = 0;
    for (long i = 0; i < f->n + f->m; i++) __builtin_prefetch(field + f->dofs[i]);
    for (long i = 0; i < f->n + f->m; i++)
        EACH_COMPONENT {
            const double difference = field[f->dofs[i] + c] - values[COMPONENTS * i + c];
            const double size = difference < 0 ? -difference : difference;
            largest = size > largest ? size : largest;
        }
    return largest;
}

// field += J' W local.
void assemble(const struct pairing *f, const double *local, double *field)
{
    const long *dofs = f->dofs + f->n;
    for (long i = 0; i < f->n; i++) {
        const double *frame = f->frame + SQUARE * i, *value = local + COMPONENTS * i;
        EACH_COMPONENT {
            const double force = f->weight[i] * ADD(
                frame[c] * value[0], frame[COMPONENTS + c] * value[1], frame[2 * COMPONENTS + c] * value[2]);
            FORCES(c, i) = force;
            field[f->dofs[i] + c] += force;
        }
    }
    for (long j = 0; j < f->m; j++) {
        react(f, j);
        EACH_COMPONENT field[dofs[j] + c] -= BACK(c, j);
    }
}
