// The jump of a sliding interface, frame (u+ - B u-), and its transpose. Every row of B and of B' is a run of
// neighbouring nodes, padded with zeros; nodes are those of the plus side, then those of the minus side.
#include <string.h>

enum { RUN = 8 };

struct pairing {
    long n, m;                // points, nodes of the other side
    long columns, width;      // lengths of the rows of B and B': multiples of RUN
    const long *dofs;         // first degree of freedom of every node
    const long *first;        // first node that every point is paired with
    const double *coupling;   // B, n rows
    const long *paired;       // first point that every node of the other side is paired with
    const double *transposed; // B', m rows
    const double *frame;      // n times 2 x 2, zero for points without a partner
    const double *weight;     // n
    double *across, *back;    // x, y of the other side, m + columns each, and of the forces on it
    double *forces;             // x, y of the forces at the points, n + width each
};

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

// B times x and y at the nodes of the other side, of point i.
static inline __attribute__((always_inline)) void opposite_mean(const struct pairing *f, long i, double mean[2])
{
    const double *x = f->across + f->first[i];
    product(f->coupling + i * f->columns, f->columns, x, x + f->m + f->columns, mean);
}

// back = B' times the forces of the points, of node j of the other side.
static inline __attribute__((always_inline)) void react(const struct pairing *f, long j)
{
    const double *x = f->forces + f->paired[j];
    double sum[2];
    product(f->transposed + j * f->width, f->width, x, x + f->n + f->width, sum);
    for (int c = 0; c < 2; c++) f->back[c * (f->m + f->columns) + j] = sum[c];
}

// local = J field, n x 2.
void jump(const struct pairing *f, const double *field, double *local)
{
    const long *dofs = f->dofs + f->n;
    // Nodes are far apart in memory: all are prefetched before the first is needed.
    for (long i = 0; i < f->n + f->m; i++) __builtin_prefetch(field + f->dofs[i]);
    for (long j = 0; j < f->m; j++)
        for (int c = 0; c < 2; c++) f->across[c * (f->m + f->columns) + j] = field[dofs[j] + c];
    for (long i = 0; i < f->n; i++) {
        const double *frame = f->frame + 4 * i, *own = field + f->dofs[i];
        double mean[2];
        opposite_mean(f, i, mean);
        for (int k = 0; k < 2; k++)
            local[2 * i + k] = frame[2 * k] * (own[0] - mean[0]) + frame[2 * k + 1] * (own[1] - mean[1]);
    }
}

// field += J' W local.
void assemble(const struct pairing *f, const double *local, double *field)
{
    const long *dofs = f->dofs + f->n;
    for (long i = 0; i < f->n; i++) {
        const double *frame = f->frame + 4 * i, *value = local + 2 * i;
        for (int c = 0; c < 2; c++) {
            const double force = f->weight[i] * (frame[c] * value[0] + frame[2 + c] * value[1]);
            f->forces[c * (f->n + f->width) + i] = force;
            field[f->dofs[i] + c] += force;
        }
    }
    for (long j = 0; j < f->m; j++) {
        react(f, j);
        for (int c = 0; c < 2; c++) field[dofs[j] + c] -= f->back[c * (f->m + f->columns) + j];
    }
}
