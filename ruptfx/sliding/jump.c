// The jump of an interface that slides, frame (u+ - B u-), and its transpose. Neighbours face neighbours: rows of B, and of
// B', are taken in blocks, with what each node that a block faces gives to all of its rows. Nodes are those of the plus
// side, then those of the other one; arrays of either side are filled up to whole blocks.
enum { BLOCK = 8 };
enum { FROM, TO, ROWS, SPAN };  // of a block: from the first node it faces to before the last one, where rows begin

struct facing {
    long n, m;                // points, nodes of the other side
    const long *dofs;         // first degree of freedom of every node
    const long *faced;        // spans of the blocks of points
    const double *coupling;   // B
    const long *facing;       // spans of the blocks of nodes of the other side: points that face them
    const double *transposed; // B'
    const double *frame;      // n times 2 x 2, zero where nothing is faced
    const double *weight;     // n
    double *across, *back;    // x, y of what is faced, and of the forces on it
    double *held;             // x, y of the forces at the points that these come from
};

typedef double block __attribute__((vector_size(BLOCK * sizeof(double)), aligned(8), may_alias));

static inline __attribute__((always_inline)) long whole(long rows) { return (rows + BLOCK - 1) / BLOCK * BLOCK; }

// A block of rows times x and y.
static inline __attribute__((always_inline)) void product(const long *span, const double *rows, const double *x,
                                                          const double *y, block result[2])
{
    block of_x = {0}, of_y = {0};
    const double *row = rows + span[ROWS] * BLOCK;
    for (long j = span[FROM]; j < span[TO]; j++, row += BLOCK) {
        const block values = *(const block *)row;
        of_x += values * x[j];
        of_y += values * y[j];
    }
    result[0] = of_x, result[1] = of_y;
}

// B times x and y at the nodes of the other side, of the block of points that begins at `first`.
static inline __attribute__((always_inline)) void faced(const struct facing *f, long first, block mean[2])
{
    product(f->faced + first / BLOCK * SPAN, f->coupling, f->across, f->across + whole(f->m), mean);
}

// back = B' times the forces of the points, of the block of nodes of the other side that begins at `first`.
static inline __attribute__((always_inline)) void react(const struct facing *f, long first)
{
    block sum[2];
    product(f->facing + first / BLOCK * SPAN, f->transposed, f->held, f->held + whole(f->n), sum);
    for (int c = 0; c < 2; c++) *(block *)(f->back + c * whole(f->m) + first) = sum[c];
}

// local = J field, n x 2.
void jump(const struct facing *f, const double *field, double *local)
{
    const long *dofs = f->dofs + f->n;
    // Nodes are far apart in memory: all are asked for before the first is needed.
    for (long i = 0; i < f->n + f->m; i++) __builtin_prefetch(field + f->dofs[i]);
    for (long j = 0; j < f->m; j++)
        for (int c = 0; c < 2; c++) f->across[c * whole(f->m) + j] = field[dofs[j] + c];
    for (long first = 0; first < f->n; first += BLOCK) {
        block mean[2];
        faced(f, first, mean);
        for (long i = first; i < first + BLOCK && i < f->n; i++) {
            const double *frame = f->frame + 4 * i, *own = field + f->dofs[i];
            for (int k = 0; k < 2; k++)
                local[2 * i + k] =
                    frame[2 * k] * (own[0] - mean[0][i - first]) + frame[2 * k + 1] * (own[1] - mean[1][i - first]);
        }
    }
}

// field += J' W local.
void assemble(const struct facing *f, const double *local, double *field)
{
    const long *dofs = f->dofs + f->n;
    for (long i = 0; i < f->n; i++) {
        const double *frame = f->frame + 4 * i, *value = local + 2 * i;
        for (int c = 0; c < 2; c++) {
            const double force = f->weight[i] * (frame[c] * value[0] + frame[2 + c] * value[1]);
            f->held[c * whole(f->n) + i] = force;
            field[f->dofs[i] + c] += force;
        }
    }
    for (long first = 0; first < f->m; first += BLOCK) react(f, first);
    for (long j = 0; j < f->m; j++)
        for (int c = 0; c < 2; c++) field[dofs[j] + c] -= f->back[c * whole(f->m) + j];
}
