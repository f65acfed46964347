// Internal force of linear elasticity without a matrix, LANES elements at a time, and the leapfrog update of
// the nodes that need nothing else.  matrix_free.py writes in front of this file lanes.c and what is known at compile time:
// DIM, COMPONENTS, ORDER, SIMPLEX, and as TABLES those of the Gauss-Lobatto-Legendre points on [0, 1].
//
// LARGE_ROTATIONS: strains U - 1 of 1 + grad u = R U, in triangles; another number, 1 / sqrt(det J), follows the geometry.
// AXISYMMETRIC: around the first axis, the second component and coordinate being the radius.
// VARIES: there are elements in which moduli vary; the kind of their batches is that of the geometry plus VARYING.
// ANISOTROPIC: the moduli of an element are the rows of its stiffness up to the diagonal; else lambda and the shear modulus.
//
// LANE and REAL, of lanes.c: displacements and shares of the force that are not elastic are doubles, all else may be floats.
//
// Every lane of a vector is another element.  Per element: gather, reference gradient along one direction after the
// other (sum factorisation), stress, transposed gradient, scatter.

#define N (ORDER + 1)
#define H (N / 2)
#if SIMPLEX
#define NODES (DIM + 1)
#elif DIM == 2
#define NODES (N * N)
#else
#define NODES (N * N * N)
#endif

// Components of strain and stress: antiplane xz, yz; xx, yy, xy, and around the axis; xx, yy, zz, xy, yz, xz.
#define STRAINS (COMPONENTS == 1 ? DIM : DIM * (DIM + 1) / 2 + AXISYMMETRIC)
#if COMPONENTS == 1
#define PLACE(c, a) (a)
#else
#define PLACE(c, a) ((c) == (a) ? (c) : DIM == 2 ? 2 : (c) + (a) == 1 ? 3 : (c) + (a) == 3 ? 4 : 5)
#endif
#if ANISOTROPIC
#define MODULI (STRAINS * (STRAINS + 1) / 2)
#else
#define MODULI 2
#endif

#define FLUSH_TO_ZERO 0x8040u  // of the register MXCSR: subnormal operands and results are zero
enum { BOX, AFFINE, MULTILINEAR, POINTWISE, VARYING };  // kind of a batch: geometry, and VARYING is added
#define GEOMETRY(kind) ((kind) & (VARYING - 1))

struct plan {
    const int *dof;                // [batch][node of the element][lane]: first degree of freedom of the node
    const unsigned char *kind;     // [batch]
    const long *start;             // [batch]: where its numbers begin, in vectors
    const lanes *number;           // moduli, those of the nodes where they vary, geometry; axisymmetric: 2 pi r and 1 / r of the nodes, sizes
    const int *line;               // [batches + 1][NODES * FETCH]: cache lines to ask for in advance
    const int *block;              // [blocks + 1]: first batch of every block
    // Nodes no later element touches: first of WIDE in a row, [blocks + 1], and [blocks] how far those with a force of `inelastic` go.
    const int *row, *row_start, *row_split;
    const int *single, *single_start, *single_split;  // the others of these nodes
    const int *move, *move_start;  // ranges of their degrees of freedom, and [blocks + 1] those that a block is the first to touch
};

// Elements with a stress that is not elastic, whose batches are computed before the elements of the block that touch the same nodes.
struct memory;
struct sweep {
    void (*add_force)(const struct plan *, const struct memory *, long, long, double, const double *, double *);
    const struct plan *plan;
    const struct memory *memory;
    const int *end;  // [blocks]: number of batches that are complete before a block
};
struct inelastic {
    const struct sweep *sweep;
    long sweeps;
    double dt, *force, *power;
};

struct matrix { lane even[H + 1][H + 1], odd[H + 1][H + 1]; };
TABLES

// -- geometry and material ------------------------------------------------------------------------------------------

// Scaled inverse Jacobian g[d][a] = d xi_d / d x_a sqrt(det J) from J, but for a factor given back: 1 / det J.
INLINE lanes adjugate(lanes j[DIM][DIM], lanes g[DIM][DIM])
{
#if DIM == 2
    g[0][0] = j[1][1], g[0][1] = -j[1][0];
    g[1][0] = -j[0][1], g[1][1] = j[0][0];
    const lanes det = j[0][0] * j[1][1] - j[0][1] * j[1][0];
#else
    UNROLL for (int d = 0; d < 3; d++) {
        const int e = (d + 1) % 3, f = (d + 2) % 3;
        UNROLL for (int a = 0; a < 3; a++) {
            const int b = (a + 1) % 3, c = (a + 2) % 3;
            g[d][a] = j[e][b] * j[f][c] - j[e][c] * j[f][b];
        }
    }
    const lanes det = j[0][0] * g[0][0] + j[0][1] * g[0][1] + j[0][2] * g[0][2];
#endif
    return 1.0 / det;
}

// Tangent vectors j[d] = dx / d xi_d of a cell with straight edges; geometry holds the coefficients of its corners' map.
INLINE void tangents(const lanes *geometry, const lane xi[DIM], lanes j[DIM][DIM])
{
    UNROLL for (int a = 0; a < DIM; a++) {
#if DIM == 2
        j[0][a] = geometry[a] + xi[1] * geometry[4 + a];
        j[1][a] = geometry[2 + a] + xi[0] * geometry[4 + a];
#else
        const lanes xy = geometry[9 + a], xz = geometry[12 + a], yz = geometry[15 + a], xyz = geometry[18 + a];
        j[0][a] = geometry[a] + xi[1] * xy + xi[2] * xz + (xi[1] * xi[2]) * xyz;
        j[1][a] = geometry[3 + a] + xi[0] * xy + xi[2] * yz + (xi[0] * xi[2]) * xyz;
        j[2][a] = geometry[6 + a] + xi[0] * xz + xi[1] * yz + (xi[0] * xi[1]) * xyz;
#endif
    }
}

struct cell {
    lanes moduli[MODULI];
    lanes g[DIM][DIM];                             // scaled inverse Jacobian, where it is the same at all points
    lanes normal[DIM][DIM], tangential[DIM][DIM];  // of an isotropic box: Hooke's law between reference gradient and flux
    const lanes *geometry;
    const lanes *of_nodes;  // moduli of the nodes, where they vary
};

INLINE struct cell open_cell(const int kind, const lanes *number)
{
    const int geometry = GEOMETRY(kind), varying = kind >= VARYING;
    struct cell cell = {.of_nodes = number + MODULI, .geometry = number + MODULI + (varying ? MODULI * NODES : 0)};
    UNROLL for (int k = 0; k < MODULI; k++) cell.moduli[k] = number[k];
#if !ANISOTROPIC
    const lanes lambda = number[0], shear = number[1];
    if (geometry == BOX && !varying)
        UNROLL for (int d = 0; d < DIM; d++)
            UNROLL for (int e = 0; e < DIM; e++) {
                const lanes both = cell.geometry[d] * cell.geometry[e];
                cell.tangential[d][e] = shear * both;
                cell.normal[d][e] = (d == e ? lambda + shear + shear : lambda) * both;
            }
#endif
    if (geometry == BOX)
        UNROLL for (int d = 0; d < DIM; d++) cell.g[d][d] = cell.geometry[d];
    if (geometry == AFFINE)
        UNROLL for (int d = 0; d < DIM; d++)
            UNROLL for (int a = 0; a < DIM; a++) cell.g[d][a] = cell.geometry[d * DIM + a];
    return cell;
}

#if !ANISOTROPIC
// Reference gradient p[d][c] to reference flux, in place, in a uniform cell whose edges follow the axes.
INLINE void box_flux(const struct cell *cell, lanes p[DIM][COMPONENTS])
{
#if COMPONENTS == 1
    UNROLL for (int d = 0; d < DIM; d++) p[d][0] *= cell->tangential[d][d];
#else
    lanes q[DIM][COMPONENTS];
    UNROLL for (int d = 0; d < DIM; d++)
        UNROLL for (int c = 0; c < DIM; c++) {
            if (d != c) q[d][c] = cell->tangential[d][d] * p[d][c] + cell->tangential[d][c] * p[c][d];
            if (d == c) {
                q[d][d] = cell->normal[d][0] * p[0][0];
                UNROLL for (int e = 1; e < DIM; e++) q[d][d] += cell->normal[d][e] * p[e][e];
            }
        }
    UNROLL for (int d = 0; d < DIM; d++)
        UNROLL for (int c = 0; c < DIM; c++) p[d][c] = q[d][c];
#endif
}
#endif

// Hooke's law from gradient h to stress s. Axisymmetric, `hoop` is the strain around the axis and becomes the stress around it.
INLINE void hooke(const lanes *moduli, lanes h[COMPONENTS][DIM], lanes *hoop, lanes s[COMPONENTS][DIM])
{
#if ANISOTROPIC
    lanes e[STRAINS], t[STRAINS];
    UNROLL for (int c = 0; c < COMPONENTS; c++)
        UNROLL for (int a = 0; a < DIM; a++)
            e[PLACE(c, a)] = COMPONENTS > 1 && a < c ? e[PLACE(c, a)] + h[c][a] : h[c][a];
    if (AXISYMMETRIC) e[STRAINS - 1] = *hoop;
    UNROLL for (int i = 0; i < STRAINS; i++)
        UNROLL for (int j = 0; j < STRAINS; j++) {
            const lanes part = moduli[i < j ? j * (j + 1) / 2 + i : i * (i + 1) / 2 + j] * e[j];
            t[i] = j ? t[i] + part : part;
        }
    if (AXISYMMETRIC) *hoop = t[STRAINS - 1];
    UNROLL for (int c = 0; c < COMPONENTS; c++)
        UNROLL for (int a = 0; a < DIM; a++) s[c][a] = t[PLACE(c, a)];
#elif COMPONENTS == 1
    UNROLL for (int a = 0; a < DIM; a++) s[0][a] = moduli[1] * h[0][a];
#else
    const lanes shear = moduli[1];
    lanes pressure = h[0][0];
    UNROLL for (int a = 1; a < DIM; a++) pressure += h[a][a];
    if (AXISYMMETRIC) pressure += *hoop;
    pressure *= moduli[0];
    if (AXISYMMETRIC) *hoop = pressure + (shear + shear) * *hoop;
    UNROLL for (int c = 0; c < DIM; c++) {
        s[c][c] = pressure + (shear + shear) * h[c][c];
        UNROLL for (int a = 0; a < c; a++) s[c][a] = s[a][c] = shear * (h[c][a] + h[a][c]);
    }
#endif
}

// Reference gradient to reference flux in any cell: G C G' with the stiffness C; in a box G is diagonal.
INLINE void flux(const int box, lanes g[DIM][DIM], const lanes *moduli, lanes *hoop, lanes p[DIM][COMPONENTS])
{
    lanes h[COMPONENTS][DIM], s[COMPONENTS][DIM];
    UNROLL for (int c = 0; c < COMPONENTS; c++)
        UNROLL for (int a = 0; a < DIM; a++) {
            h[c][a] = box ? g[a][a] * p[a][c] : g[0][a] * p[0][c];
            if (!box)
                UNROLL for (int d = 1; d < DIM; d++) h[c][a] += g[d][a] * p[d][c];
        }
    hooke(moduli, h, hoop, s);
    UNROLL for (int c = 0; c < COMPONENTS; c++)
        UNROLL for (int d = 0; d < DIM; d++) {
            p[d][c] = box ? g[d][d] * s[c][d] : g[d][0] * s[c][0];
            if (!box)
                UNROLL for (int a = 1; a < DIM; a++) p[d][c] += g[d][a] * s[c][a];
        }
}

#if LARGE_ROTATIONS
// What a cell feels of its gradient F = 1 + h = R U: R = [turn[0], turn[1]; -turn[1], turn[0]], tr U - 2 and F - R = R (U - 1).
struct strained { lanes turn[2], trace, rest[2][2]; };

INLINE struct strained strain_of(lanes g[DIM][DIM], lanes inverse_root, lanes p[DIM][COMPONENTS])
{
    struct strained found;
    lanes h[2][2], s, turned;
    UNROLL for (int c = 0; c < 2; c++)
        UNROLL for (int a = 0; a < 2; a++) h[c][a] = (g[0][a] * p[0][c] + g[1][a] * p[1][c]) * inverse_root;
    const lanes sum = h[0][0] + h[1][1], along = 2 + sum, across = h[0][1] - h[1][0], square = across * across;
    const lanes length = along * along + square;
    UNROLL for (int l = 0; l < LANES; l++) s[l] = __builtin_sqrt(length[l]);
    // cos - 1 without a difference of numbers that are nearly the same, unless it has turned by more than a right angle.
    const lanes near = -square / (along + s), far = along - s;
    UNROLL for (int l = 0; l < LANES; l++) turned[l] = along[l] > 0 ? near[l] : far[l];
    const lanes inverse = 1.0 / s, less = turned * inverse;
    found.turn[0] = along * inverse;
    found.turn[1] = across * inverse;
    found.trace = (sum * (along + 2) + square) / (s + 2);
    found.rest[0][0] = h[0][0] - less, found.rest[0][1] = h[0][1] - found.turn[1];
    found.rest[1][0] = h[1][0] + found.turn[1], found.rest[1][1] = h[1][1] - less;
    return found;
}

// The first Piola-Kirchhoff stress R (lambda tr(U - 1) + 2 G (U - 1)).
INLINE void turned_flux(lanes g[DIM][DIM], lanes lambda, lanes shear, lanes inverse_root, lanes p[DIM][COMPONENTS])
{
    const struct strained at = strain_of(g, inverse_root, p);
    const lanes root = 1.0 / inverse_root, pressure = root * lambda * at.trace, twice = root * (shear + shear);
    lanes s[2][2];
    s[0][0] = pressure * at.turn[0] + twice * at.rest[0][0], s[0][1] = pressure * at.turn[1] + twice * at.rest[0][1];
    s[1][0] = twice * at.rest[1][0] - pressure * at.turn[1], s[1][1] = pressure * at.turn[0] + twice * at.rest[1][1];
    UNROLL for (int c = 0; c < 2; c++)
        UNROLL for (int d = 0; d < 2; d++) p[d][c] = g[d][0] * s[c][0] + g[d][1] * s[c][1];
}
#endif

// Axisymmetric, `hoop` is the radial displacement and becomes the force that the stress around the axis gives it.
INLINE void flux_at(const int kind, struct cell *cell, int node, const lane xi[DIM], lanes *hoop,
                    lanes p[DIM][COMPONENTS])
{
    const int geometry = GEOMETRY(kind);
#if !ANISOTROPIC
    if (kind == BOX) {
        box_flux(cell, p);
        return;
    }
#endif
    lanes moduli[MODULI];
    UNROLL for (int k = 0; k < MODULI; k++) moduli[k] = cell->moduli[k];
#if VARIES && !SIMPLEX
    if (kind >= VARYING)
        UNROLL for (int k = 0; k < MODULI; k++) {
            moduli[k] = cell->of_nodes[MODULI * node + k];
            __builtin_prefetch(cell->of_nodes + MODULI * (node + NODES + 1) + DIM + k, 0);
        }
#endif
#if AXISYMMETRIC
    const lanes *const ring = cell->geometry + (geometry == AFFINE ? 4 : geometry == MULTILINEAR ? 6 : 4 * NODES);
    lanes size = {0};
    if (geometry != MULTILINEAR) size = ring[2 * NODES + (geometry == POINTWISE ? node : 0)];
#endif
    if (geometry == MULTILINEAR) {
        lanes j[DIM][DIM];
        tangents(cell->geometry, xi, j);
        const lanes inverse = adjugate(j, cell->g);
        UNROLL for (int k = 0; k < MODULI; k++) moduli[k] *= inverse;
#if AXISYMMETRIC
        size = 1.0 / inverse;
#endif
    }
    if (geometry == POINTWISE)
        UNROLL for (int d = 0; d < DIM; d++)
            UNROLL for (int a = 0; a < DIM; a++) cell->g[d][a] = cell->geometry[(node * DIM + d) * DIM + a];
#if AXISYMMETRIC
    *hoop *= size * ring[NODES + node];
    flux(0, cell->g, moduli, hoop, p);
    *hoop *= size * ring[NODES + node] * ring[node];
    UNROLL for (int d = 0; d < DIM; d++)
        UNROLL for (int c = 0; c < COMPONENTS; c++) p[d][c] *= ring[node];
#elif LARGE_ROTATIONS
    turned_flux(cell->g, moduli[0], moduli[1], cell->geometry[4], p);
#else
    flux(geometry == BOX, cell->g, moduli, hoop, p);
#endif
}

// -- gather and scatter ---------------------------------------------------------------------------------------------

// The field at nodes, `LANES` numbers of each component, or WIDE of them.
INLINE void gather(const real *field, const int *dof, lanes x[COMPONENTS])
{
#if COMPONENTS > 1
    gather_couples(field, dof, x);
#endif
    if (COMPONENTS != 2)
        UNROLL for (int l = 0; l < LANES; l++) x[COMPONENTS - 1][l] = field[dof[l] + COMPONENTS - 1];
}

INLINE void gather_wide(const double *field, const int *dof, wide x[COMPONENTS])
{
#if COMPONENTS > 1
    gather_wide_couples(field, dof, x);
#endif
    if (COMPONENTS != 2)
        UNROLL for (int l = 0; l < WIDE; l++) x[COMPONENTS - 1][l] = field[dof[l] + COMPONENTS - 1];
}

// The displacement of a node; as floats without that of the first node of the element, which strains nothing: digits are
// lost of the strain then, and none in a translation. The stress around an axis needs the whole radial displacement.
#if LANE == 4 && COMPONENTS == 3 && defined __AVX512VL__
#include <immintrin.h>
typedef double four __attribute__((vector_size(32)));
#define TRANSLATION wide translation[LANES / 2]

INLINE void gather_displacement(const double *field, const int *dof, wide *translation, const int is_first,
                                lanes x[COMPONENTS])
{
    lanes row[4];  // row[i]: the components at the lanes i, i + 4, i + 8 and i + 12
    UNROLL for (int i = 0; i < 4; i++) {
        few half[2];
        UNROLL for (int k = 0; k < 2; k++) {
            const four a = (four)_mm256_maskz_loadu_pd(7, field + dof[i + 8 * k]);
            const four b = (four)_mm256_maskz_loadu_pd(7, field + dof[i + 8 * k + 4]);
            const wide y = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
            if (is_first) translation[2 * i + k] = y;
            half[k] = narrow(y - translation[2 * i + k]);
        }
        row[i] = __builtin_shufflevector(half[0], half[1], LOWER, UPPER);
    }
#define IN_FOURS(a, b, i, j, k, l) \
    __builtin_shufflevector(a, b, i, j, k, l, i + 4, j + 4, k + 4, l + 4, i + 8, j + 8, k + 8, l + 8, i + 12, j + 12, k + 12, l + 12)
    const lanes near = IN_FOURS(row[0], row[1], 0, 16, 1, 17), far = IN_FOURS(row[2], row[3], 0, 16, 1, 17);
    x[0] = IN_FOURS(near, far, 0, 1, 16, 17);
    x[1] = IN_FOURS(near, far, 2, 3, 18, 19);
    x[2] = IN_FOURS(IN_FOURS(row[0], row[1], 2, 18, 3, 19), IN_FOURS(row[2], row[3], 2, 18, 3, 19), 0, 1, 16, 17);
}
#else
#define TRANSLATION wide translation[COMPONENTS * HALVES]

INLINE void gather_displacement(const double *field, const int *dof, wide *translation, const int is_first,
                                lanes x[COMPONENTS])
{
#if LANE == 8
    (void)translation, (void)is_first;
    gather_wide(field, dof, x);
#else
    wide of_parts[HALVES][COMPONENTS];
    UNROLL for (int p = 0; p < HALVES; p++) gather_wide(field, dof + p * WIDE, of_parts[p]);
    UNROLL for (int c = 0; c < COMPONENTS; c++) {
        wide y[HALVES];
        UNROLL for (int p = 0; p < HALVES; p++) {
            wide *const without = translation + c * HALVES + p;
            if (is_first) *without = AXISYMMETRIC && c == 1 ? (wide){0} : of_parts[p][c];
            y[p] = of_parts[p][c] - *without;
        }
        x[c] = narrowed(y);
    }
#endif
}
#endif

// Of floats from memory: of a vector of 16 the processor extracts few numbers with one instruction.
#define EACH_SINGLE(dof, x, DO) { \
        const lanes last = x[COMPONENTS - 1]; \
        UNROLL for (int l = 0; l < LANES; l++) \
            DO(single, dof[l] + COMPONENTS - 1, (LANE == 4 ? ((const volatile lane *)&last)[l] : last[l])) \
    }
#if COMPONENTS == 1
#define EACH EACH_SINGLE
#elif COMPONENTS == 2
#define EACH EACH_COUPLE
#else
#define EACH(dof, x, DO) EACH_COUPLE(dof, x, DO) EACH_SINGLE(dof, x, DO)
#endif
typedef lane single;

INLINE void scatter_add(real *field, const int *dof, const lanes x[COMPONENTS])
{
#define ADD(type, place, y) *(type *)(field + place) += (type)y;
    EACH(dof, x, ADD)
}

// The same for a share of the force.
INLINE void scatter_share(double *field, const int *dof, const lanes x[COMPONENTS])
{
#if LANE == 8
    scatter_add(field, dof, x);
#else
    UNROLL for (int l = 0; l < LANES; l++)
        UNROLL for (int c = 0; c < COMPONENTS; c++) field[dof[l] + c] += x[c][l];
#endif
}

// Cache lines that the next batch is the first to touch: nothing else would ask for them, as the nodes of elements follow no
// pattern that a machine sees.  They are asked for a few at a time while this batch computes: a core can wait for few at once.
struct ahead { const double *displacement; const real *force; const int *line; };
#define LINE (64L / (long)sizeof(real))  // numbers of a line of forces

INLINE void ask(const struct ahead *ahead, const int node, const int count)
{
    UNROLL for (int k = node * FETCH; k < (node + count) * FETCH; k++) {
        UNROLL for (int p = 0; p < LINE / 8; p++)
            __builtin_prefetch(ahead->displacement + LINE * ahead->line[k] + 8 * p, 0);
        __builtin_prefetch(ahead->force + LINE * ahead->line[k], 1);
    }
}

// Those of all nodes of an element.
INLINE void gather_displacements(const double *field, const int *dof, const struct ahead *ahead, lanes u[COMPONENTS][NODES])
{
    TRANSLATION;
    lanes x[COMPONENTS];
    if (ORDER == 1 && ahead) ask(ahead, 0, 1);
    gather_displacement(field, dof, translation, 1, x);
    UNROLL for (int c = 0; c < COMPONENTS; c++) u[c][0] = x[c];
    KEEP for (int node = 1; node < NODES; node++) {
        if (ORDER == 1 && ahead) ask(ahead, node, 1);
        gather_displacement(field, dof + node * LANES, translation, 0, x);
        UNROLL for (int c = 0; c < COMPONENTS; c++) u[c][node] = x[c];
    }
}

// -- gradient and its transpose -------------------------------------------------------------------------------------

#if SIMPLEX
INLINE void apply(const int geometry, const lanes *number, const struct ahead *ahead, lanes u[COMPONENTS][NODES])
{
    (void)ahead;
    struct cell cell = open_cell(geometry, number);
    lanes p[DIM][COMPONENTS];
    UNROLL for (int d = 0; d < DIM; d++)
        UNROLL for (int c = 0; c < COMPONENTS; c++) p[d][c] = u[c][d + 1] - u[c][0];
    flux_at(geometry, &cell, 0, 0, 0, p);
    UNROLL for (int c = 0; c < COMPONENTS; c++) {
        u[c][0] = p[0][c];
        UNROLL for (int d = 1; d < DIM; d++) u[c][0] += p[d][c];
        u[c][0] = -u[c][0];
        UNROLL for (int d = 0; d < DIM; d++) u[c][d + 1] = p[d][c];
    }
}
#else
// out[i] (+)= sum_j M[i][j] in[j] along a line of nodes `stride` apart.  Turning the line round changes the sign of M, so
// sums and differences of opposite nodes need half of the products; even and odd hold (M[i][j] +- M[i][N-1-j]) / 2.
INLINE void along(const int add, const struct matrix *m, const lanes *in, lanes *out, const int stride)
{
    lanes sum[H + 1], difference[H + 1];
    UNROLL for (int j = 0; j < H; j++) {
        sum[j] = in[j * stride] + in[(N - 1 - j) * stride];
        difference[j] = in[j * stride] - in[(N - 1 - j) * stride];
    }
    if (N % 2) sum[H] = in[H * stride];
    UNROLL for (int i = 0; i < H; i++) {
        lanes even = {0}, odd = {0};
        UNROLL for (int j = 0; j < H + N % 2; j++)
            if (m->even[i][j] != 0) even = j ? even + m->even[i][j] * sum[j] : m->even[i][j] * sum[j];
        UNROLL for (int j = 0; j < H; j++)
            if (m->odd[i][j] != 0) odd = j ? odd + m->odd[i][j] * difference[j] : m->odd[i][j] * difference[j];
        lanes *const near = out + i * stride, *const far = out + (N - 1 - i) * stride;
        *near = (add ? *near + odd : odd) + even;
        *far = (add ? *far + odd : odd) - even;
    }
    if (N % 2) {
        lanes middle = m->odd[H][0] * difference[0];
        UNROLL for (int j = 1; j < H; j++) middle += m->odd[H][j] * difference[j];
        out[H * stride] = add ? out[H * stride] + middle : middle;
    }
}

// The same for `stride` lines that begin at neighbouring nodes: with N those of a plane.
INLINE void along_lines(const int add, const struct matrix *m, const lanes *in, lanes *out, const int stride)
{
    KEEP for (int b = 0; b < stride; b++) along(add, m, in + b, out + b, stride);
}

// The same for all lines of one direction.
INLINE void along_all(const int add, const struct matrix *m, const lanes *in, lanes *out, const int stride)
{
    KEEP for (int a = 0; a < NODES; a += N * stride) along_lines(add, m, in + a, out + a, stride);
}

// From displacements to internal force over the weights of the nodes, in place.  In 3D plane after plane, and in a plane line after
// line of nodes that are neighbours, together with the stress.
INLINE void apply_plane(const int geometry, struct cell *cell, const struct ahead *ahead, const int plane,
                        lanes u[COMPONENTS][NODES], lanes across[COMPONENTS][NODES])
{
    lanes g[COMPONENTS][N * N];
    UNROLL for (int c = 0; c < COMPONENTS; c++) along_lines(0, &DERIVATIVE, u[c] + plane, g[c], N);
    KEEP for (int line = 0; line < N * N; line += N) {
        if (ORDER > 1 && ahead) ask(ahead, plane + line, N);
        lanes last[COMPONENTS][N];
        UNROLL for (int c = 0; c < COMPONENTS; c++) along(0, &DERIVATIVE, u[c] + plane + line, last[c], 1);
        lanes hoop[N];
#if AXISYMMETRIC
        UNROLL for (int q = 0; q < N; q++) hoop[q] = u[1][line + q];
#endif
        UNROLL for (int q = 0; q < N; q++) {
            const int node = plane + line + q;
            lanes p[DIM][COMPONENTS];
            UNROLL for (int c = 0; c < COMPONENTS; c++) {
#if DIM == 3
                p[0][c] = across[c][node];
#endif
                p[DIM - 2][c] = g[c][line + q];
                p[DIM - 1][c] = last[c][q];
            }
#if DIM == 2
            const lane xi[2] = {POINT[line / N], POINT[q]};
#else
            const lane xi[3] = {POINT[plane / (N * N)], POINT[line / N], POINT[q]};
#endif
            flux_at(geometry, cell, node, xi, hoop + q, p);
            UNROLL for (int c = 0; c < COMPONENTS; c++) {
#if DIM == 3
                across[c][node] = p[0][c];
#endif
                g[c][line + q] = p[DIM - 2][c];
                last[c][q] = p[DIM - 1][c];
            }
        }
        UNROLL for (int c = 0; c < COMPONENTS; c++) along(0, &TRANSPOSED, last[c], u[c] + plane + line, 1);
#if AXISYMMETRIC
        UNROLL for (int q = 0; q < N; q++) u[1][line + q] += hoop[q];
#endif
    }
    UNROLL for (int c = 0; c < COMPONENTS; c++) along_lines(1, &TRANSPOSED, g[c], u[c] + plane, N);
}

INLINE void apply(const int geometry, const lanes *number, const struct ahead *ahead, lanes u[COMPONENTS][NODES])
{
    struct cell cell = open_cell(geometry, number);
    lanes across[COMPONENTS][NODES];
#if DIM == 3
    UNROLL for (int c = 0; c < COMPONENTS; c++) along_lines(0, &DERIVATIVE, u[c], across[c], N * N);
#endif
    KEEP for (int plane = 0; plane < NODES; plane += N * N) apply_plane(geometry, &cell, ahead, plane, u, across);
#if DIM == 3
    UNROLL for (int c = 0; c < COMPONENTS; c++) along_lines(1, &TRANSPOSED, across[c], u[c], N * N);
#endif
}
#endif

// Forces of one batch: of the displacement, or, as a share, of the velocity.
INLINE void batch_force(const int geometry, const int is_share, const struct plan *plan, long b, const void *field, void *force)
{
    const int *dof = plan->dof + b * NODES * LANES;
    const struct ahead ahead = {field, force, plan->line + (b + 1) * NODES * FETCH};
    const struct ahead *const next = is_share ? 0 : &ahead;
    lanes u[COMPONENTS][NODES];
    if (!is_share) gather_displacements(field, dof, next, u);
    KEEP for (int node = 0; is_share && node < NODES; node++) {
        lanes x[COMPONENTS];
        gather(field, dof + node * LANES, x);
        UNROLL for (int c = 0; c < COMPONENTS; c++) u[c][node] = x[c];
    }
    apply(geometry, plan->number + plan->start[b], next, u);
    KEEP for (int node = 0; node < NODES; node++) {
        lanes x[COMPONENTS];
        UNROLL for (int c = 0; c < COMPONENTS; c++) x[c] = MINUS_WEIGHT[node] * u[c][node];
        if (is_share)
            scatter_share(force, dof + node * LANES, x);
        else
            scatter_add(force, dof + node * LANES, x);
    }
}

// Where all elements have the Kelvin-Voigt damping eta: force -= K (u + eta v) and viscous -= eta K v, in one sweep.
#define VISCID (SIMPLEX && COMPONENTS == DIM && !LARGE_ROTATIONS)
#if VISCID
static void add_damped_force(const struct plan *plan, long first, long last, double eta, const double *displacement,
                             const real *velocity, real *force, double *viscous)
{
    for (long b = first; b < last; b++) {
        const int *dof = plan->dof + b * NODES * LANES;
        const lanes *number = plan->number + plan->start[b];
        lanes u[COMPONENTS][NODES], v[COMPONENTS][NODES];
        gather_displacements(displacement, dof, 0, u);
        UNROLL for (int node = 0; node < NODES; node++) {
            lanes y[COMPONENTS];
            gather(velocity, dof + node * LANES, y);
            UNROLL for (int c = 0; c < COMPONENTS; c++) v[c][node] = y[c];
        }
        apply(AFFINE, number, 0, u);
        apply(AFFINE, number, 0, v);
        UNROLL for (int node = 0; node < NODES; node++) {
            lanes both[COMPONENTS], lost[COMPONENTS];
            UNROLL for (int c = 0; c < COMPONENTS; c++) {
                lost[c] = (lane)eta * MINUS_WEIGHT[node] * v[c][node];
                both[c] = MINUS_WEIGHT[node] * u[c][node] + lost[c];
            }
            scatter_add(force, dof + node * LANES, both);
            scatter_share(viscous, dof + node * LANES, lost);
        }
    }
}
#endif

// -- what Python calls ----------------------------------------------------------------------------------------------

int nodes_per_row(void) { return WIDE; }

INLINE void add_forces(const int is_share, const struct plan *plan, long first, long last, const void *field, void *force)
{
    for (long b = first; b < last; b++)
        switch (plan->kind[b]) {
#define CASE(geometry) \
    case geometry: batch_force(geometry, is_share, plan, b, field, force); break;
            CASE(AFFINE)
#if !SIMPLEX
            CASE(BOX)
            CASE(MULTILINEAR)
            CASE(POINTWISE)
#if VARIES
            CASE(BOX + VARYING)
            CASE(AFFINE + VARYING)
            CASE(MULTILINEAR + VARYING)
            CASE(POINTWISE + VARYING)
#endif
#endif
        }
}

void add_internal_force(const struct plan *plan, long first, long last, const double *u, real *force)
{
    add_forces(0, plan, first, last, u, force);
}

// The force -eta K v as a sweep of `inelastic`: the moduli of the plan are multiplied by eta, and in place of memory there is v.
void add_viscous_sweep(const struct plan *plan, const struct memory *velocity, long first, long last, double dt,
                       const double *u, double *force)
{
    (void)dt, (void)u;
#if LANE == 8
    add_internal_force(plan, first, last, (const double *)velocity, force);
#else
    add_forces(1, plan, first, last, velocity, force);
#endif
}

#if LARGE_ROTATIONS
// Subtract the forces of the viscous stress C : dE/dt of Green's strain E, which no rotation changes: with F = 1 + grad u, stress
// F (lambda tr(E') + 2 G E') and E' = sym(F^T grad v).
void add_viscous_force(const struct plan *plan, long batches, const double *displacement, const double *velocity,
                       double *force)
{
    for (long b = 0; b < batches; b++) {
        const int *dof = plan->dof + b * NODES * LANES;
        struct cell cell = open_cell(AFFINE, plan->number + plan->start[b]);
        const lanes inverse_root = cell.geometry[4], root = 1.0 / inverse_root;
        lanes u[NODES][2], v[NODES][2], f[2][2], w[2][2], e[2][2], stress[2][2], first[2] = {{0}};
        UNROLL for (int node = 0; node < NODES; node++) {
            gather(displacement, dof + node * LANES, u[node]);
            gather(velocity, dof + node * LANES, v[node]);
        }
        UNROLL for (int c = 0; c < 2; c++)
            UNROLL for (int a = 0; a < 2; a++) {
                f[c][a] = (cell.g[0][a] * (u[1][c] - u[0][c]) + cell.g[1][a] * (u[2][c] - u[0][c])) * inverse_root + (c == a);
                w[c][a] = (cell.g[0][a] * (v[1][c] - v[0][c]) + cell.g[1][a] * (v[2][c] - v[0][c])) * inverse_root;
            }
        UNROLL for (int c = 0; c < 2; c++)
            UNROLL for (int a = 0; a < 2; a++)
                e[c][a] = 0.5 * (f[0][c] * w[0][a] + f[1][c] * w[1][a] + f[0][a] * w[0][c] + f[1][a] * w[1][c]);
        const lanes pressure = root * cell.moduli[0] * (e[0][0] + e[1][1]), twice = root * (cell.moduli[1] + cell.moduli[1]);
        UNROLL for (int c = 0; c < 2; c++)
            UNROLL for (int a = 0; a < 2; a++)
                stress[c][a] = pressure * f[c][a] + twice * (f[c][0] * e[0][a] + f[c][1] * e[1][a]);
        UNROLL for (int d = 0; d < 2; d++) {
            lanes x[2];
            UNROLL for (int c = 0; c < 2; c++) {
                x[c] = MINUS_WEIGHT[0] * (cell.g[d][0] * stress[c][0] + cell.g[d][1] * stress[c][1]);
                first[c] -= x[c];
            }
            scatter_add(force, dof + (d + 1) * LANES, x);
        }
        scatter_add(force, dof, first);
    }
}
#endif

double strain_energy(const struct plan *plan, long batches, const double *displacement)
{
    lanes sum = {0};
#if LARGE_ROTATIONS
    for (long b = 0; b < batches; b++) {
        const int *dof = plan->dof + b * NODES * LANES;
        struct cell cell = open_cell(AFFINE, plan->number + plan->start[b]);
        lanes u[NODES][2], p[2][2];
        UNROLL for (int node = 0; node < NODES; node++) gather(displacement, dof + node * LANES, u[node]);
        UNROLL for (int d = 0; d < 2; d++)
            UNROLL for (int c = 0; c < 2; c++) p[d][c] = u[d + 1][c] - u[0][c];
        const struct strained at = strain_of(cell.g, cell.geometry[4], p);
        lanes square = at.rest[0][0] * at.rest[0][0] + at.rest[0][1] * at.rest[0][1];
        square += at.rest[1][0] * at.rest[1][0] + at.rest[1][1] * at.rest[1][1];
        const lanes area = -MINUS_WEIGHT[0] / (cell.geometry[4] * cell.geometry[4]);
        sum += area * (0.5 * cell.moduli[0] * at.trace * at.trace + cell.moduli[1] * square);
    }
#else
    (void)plan, (void)batches, (void)displacement;
#endif
    double total = 0;
    UNROLL for (int l = 0; l < LANES; l++) total += sum[l];
    return total;
}

// v = decay v + dt f / m, u += dt v, f = 0; with damping of the mass also the sum of m |mean v|^2, which says what was lost;
// and when measured energy[0] += m v^2 and energy[1] += u f of the elastic f, with the new u and v.  The share of the force that is
// not elastic becomes 0.  That of viscid elements is in f already and works on the mean v, lost -= f v; that of materials with memory
// is added here, and its power is summed for the old v and for the new one.
enum { ELASTIC, VISCOUS, INELASTIC };
struct motion {
    double *displacement;
    real *velocity, *force;
    const real *inverse_mass;
    double dt, decay, *share, *lost, *power;
};

INLINE double advance_node(const int damped, const int kind, const int measured, const struct motion *motion, long node,
                           double *energy)
{
    const lane inverse_mass = motion->inverse_mass[node], push = (lane)motion->dt * inverse_mass, decay = motion->decay;
    double square = 0;
    UNROLL for (long i = node * COMPONENTS; i < (node + 1) * COMPONENTS; i++) {
        const double share = kind ? motion->share[i] : 0;
        const lane old = motion->velocity[i];
        const lane force = kind == INELASTIC ? motion->force[i] + (lane)share : motion->force[i];
        const lane v = damped ? FUSED(decay, old, push * force) : FUSED(push, force, old);
        if (damped) square += (old + v) * (old + v);
        motion->velocity[i] = v;
        motion->displacement[i] += motion->dt * v;
        if (kind == VISCOUS) *motion->lost -= 0.5 * share * (old + v);
        if (kind == INELASTIC) motion->power[0] += share * old, motion->power[1] += share * v;
        if (kind) motion->share[i] = 0;
        if (measured) energy[0] += v * v / inverse_mass, energy[1] += motion->displacement[i] * (force - share);
        motion->force[i] = 0;
    }
    return damped ? 0.25 * square / inverse_mass : 0;
}

// The same for WIDE nodes in a row; adds to the sums, doubles, lane by lane.
INLINE void advance_row(const int damped, const int kind, const int measured, const struct motion *motion, long node,
                        wide *sum, wide *lost, wide *power, wide *energy)
{
    const few inverse_mass = *(const loose_few *)(motion->inverse_mass + node), push = (lane)motion->dt * inverse_mass;
    const few quarter_mass = damped ? (lane)0.25 / inverse_mass : push;
    const lane decay = motion->decay;
    UNROLL for (int k = 0; k < COMPONENTS; k++) {
        whole_few pick;
        UNROLL for (int l = 0; l < WIDE; l++) pick[l] = (k * WIDE + l) / COMPONENTS;
        const long i = node * COMPONENTS + k * WIDE;
        loose_few *const velocity = (loose_few *)(motion->velocity + i), *const at = (loose_few *)(motion->force + i);
        const few old = *velocity, pushed = __builtin_shuffle(push, pick);
        few force = *at;
        wide share = {0};
        if (kind) {
            loose_wide *const given = (loose_wide *)(motion->share + i);
            share = *given;
            *given = (wide){0};
        }
        if (kind == INELASTIC) force += narrow(share);
        few v;
        if (damped) {
            const few added = pushed * force;
            UNROLL for (int l = 0; l < WIDE; l++) v[l] = FUSED(decay, old[l], added[l]);
        } else
            UNROLL for (int l = 0; l < WIDE; l++) v[l] = FUSED(pushed[l], force[l], old[l]);
        if (damped) *sum += widen(__builtin_shuffle(quarter_mass, pick) * (old + v) * (old + v));
        *velocity = v;
        loose_wide *const displacement = (loose_wide *)(motion->displacement + i);
        *displacement += motion->dt * widen(v);
        if (kind == VISCOUS) *lost -= 0.5 * share * widen(old + v);
        if (kind == INELASTIC) power[0] += share * widen(old), power[1] += share * widen(v);
        if (measured) {
            energy[0] += widen(v * v / __builtin_shuffle(inverse_mass, pick));
            energy[1] += *displacement * (widen(force) - share);
        }
        *at = (few){0};
    }
}

#define ROWS_AHEAD 6
#define NODES_AHEAD 8

// Nodes of a block: all, those with a force of `inelastic`, or those without.
enum { ALL, WITH, WITHOUT };

INLINE double advance_block(const int damped, const int kind, const int measured, const int part, const struct motion *motion,
                            const struct plan *plan, long block, double *energy)
{
    wide row_sum = {0}, row_lost = {0}, row_power[2] = {{0}}, row_energy[2] = {{0}};
    double sum = 0;
#define FIRST(what) (part == WITHOUT ? plan->what##_split[block] : plan->what##_start[block])
#define END(what) (part == WITH ? plan->what##_split[block] : plan->what##_start[block + 1])
    const long end = END(row);
    for (long r = FIRST(row); r < end; r++) {
        // Rows are too short for the processor to prefetch by itself what the elements have not touched.
        const long ahead = plan->row[r + ROWS_AHEAD < end ? r + ROWS_AHEAD : end - 1];
        UNROLL for (int k = 0; k < COMPONENTS; k++) __builtin_prefetch(motion->velocity + ahead * COMPONENTS + 8 * k, 1);
        __builtin_prefetch(motion->inverse_mass + ahead, 0);
        advance_row(damped, kind, measured, motion, plan->row[r], &row_sum, &row_lost, row_power, row_energy);
    }
    for (long n = FIRST(single); n < END(single); n++) {
        const long ahead = plan->single[n + NODES_AHEAD < END(single) ? n + NODES_AHEAD : n];
        __builtin_prefetch(motion->velocity + ahead * COMPONENTS, 1);
        __builtin_prefetch(motion->inverse_mass + ahead, 0);
        sum += advance_node(damped, kind, measured, motion, plan->single[n], energy);
    }
    if (damped)
        UNROLL for (int l = 0; l < WIDE; l++) sum += row_sum[l];
    if (kind == VISCOUS)
        UNROLL for (int l = 0; l < WIDE; l++) *motion->lost += row_lost[l];
    if (kind == INELASTIC)
        UNROLL for (int l = 0; l < WIDE; l++) motion->power[0] += row_power[0][l], motion->power[1] += row_power[1][l];
    if (measured)
        UNROLL for (int l = 0; l < WIDE; l++) energy[0] += row_energy[0][l], energy[1] += row_energy[1][l];
    return sum;
}

// Displacements of the nodes that a block is the first to touch and that steps advance, with the old velocity.
static void move_first(const struct plan *plan, long block, double dt, const real *velocity, double *restrict displacement)
{
    for (long r = plan->move_start[block]; r < plan->move_start[block + 1]; r++)
        for (long i = plan->move[2 * r]; i < plan->move[2 * r + 1]; i++) displacement[i] += dt * velocity[i];
}

// Elements of some blocks; after each block the nodes that no later element touches move on, and before it, by the time `move`, those
// that no earlier one has touched.  Null may be `energy`, `viscous`, the
// force of Kelvin-Voigt damping of all elements, and `inelastic`; not both of the latter are given.
double step(const struct plan *plan, long first, long last, double *u, real *v, real *force,
            const real *inverse_mass, double dt, double decay, double *energy, double eta, double *viscous, double *lost,
            const struct inelastic *inelastic, double move)
{
#define ADVANCED(damped, kind, part) \
    (energy ? advance_block(damped, kind, 1, part, &motion, plan, block, energy) \
            : advance_block(damped, kind, 0, part, &motion, plan, block, energy))
#define ADVANCE(kind, part) (decay == 1 ? ADVANCED(0, kind, part) : ADVANCED(1, kind, part))
    const struct motion motion = {
        u, v, force, inverse_mass, dt, decay, inelastic ? inelastic->force : viscous, lost, inelastic ? inelastic->power : 0,
    };
    double sum = 0;
    // Ahead of every wave a step leaves numbers too small to be normalised, with which a processor computes many times more
    // slowly: here they count as zero.
    const unsigned rounding = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(rounding | FLUSH_TO_ZERO);
    for (long block = first; block < last; block++) {
        if (move) move_first(plan, block, move, v, u);
#if VISCID
        if (viscous) {
            add_damped_force(plan, plan->block[block], plan->block[block + 1], eta, u, v, force, viscous);
            sum += ADVANCE(VISCOUS, ALL);
            continue;
        }
#else
        (void)eta;
#endif
        for (long k = 0; inelastic && k < inelastic->sweeps; k++) {
            const struct sweep *const sweep = inelastic->sweep + k;
            const long begun = block ? sweep->end[block - 1] : 0;
            sweep->add_force(sweep->plan, sweep->memory, begun, sweep->end[block], inelastic->dt, u, inelastic->force);
        }
        add_internal_force(plan, plan->block[block], plan->block[block + 1], u, force);
        if (inelastic) sum += ADVANCE(INELASTIC, WITH);
        sum += ADVANCE(ELASTIC, WITHOUT);
    }
    __builtin_ia32_ldmxcsr(rounding);
    return sum;
}

#if !SIMPLEX && !AXISYMMETRIC
// Stresses times the weights and sizes of elements, summed at their nodes, of one batch whose geometry is the same at all
// points; `root` is that of the determinant of its Jacobian.
INLINE void batch_stress(const int kind, const struct plan *plan, long b, lanes root, const double *displacement,
                         double *stress)
{
    const int *dof = plan->dof + b * NODES * LANES, geometry = GEOMETRY(kind);
    struct cell cell = open_cell(kind, plan->number + plan->start[b]);
    lanes u[COMPONENTS][NODES], p[DIM][COMPONENTS][NODES];
    gather_displacements(displacement, dof, 0, u);
    UNROLL for (int d = 0; d < DIM; d++)
        UNROLL for (int c = 0; c < COMPONENTS; c++)
            along_all(0, &DERIVATIVE, u[c], p[d][c], d == DIM - 1 ? 1 : d == DIM - 2 ? N : N * N);
    KEEP for (int node = 0; node < NODES; node++) {
        lanes h[COMPONENTS][DIM], s[COMPONENTS][DIM];
        const lanes *const moduli = kind >= VARYING ? cell.of_nodes + MODULI * node : cell.moduli;
        UNROLL for (int c = 0; c < COMPONENTS; c++)
            UNROLL for (int a = 0; a < DIM; a++) {
                h[c][a] = (lanes){0};
                UNROLL for (int d = 0; d < DIM; d++)
                    if (geometry != BOX || d == a) h[c][a] += cell.g[d][a] * p[d][c][node];
            }
        hooke(moduli, h, 0, s);
        UNROLL for (int l = 0; l < LANES; l++) {
            double *const here = stress + (long)(dof[node * LANES + l] / COMPONENTS) * STRAINS;
            UNROLL for (int c = 0; c < COMPONENTS; c++)
                UNROLL for (int a = c * (COMPONENTS > 1); a < DIM; a++)
                    here[PLACE(c, a)] += -MINUS_WEIGHT[node] * root[l] * s[c][a][l];
        }
    }
}

void add_stress(const struct plan *plan, long batches, const lanes *root, const double *displacement, double *stress)
{
    for (long b = 0; b < batches; b++)
        switch (plan->kind[b]) {
#define STRESS_CASE(kind) \
    case kind: batch_stress(kind, plan, b, root[b], displacement, stress); break;
            STRESS_CASE(BOX)
            STRESS_CASE(AFFINE)
#if VARIES
            STRESS_CASE(BOX + VARYING)
            STRESS_CASE(AFFINE + VARYING)
#endif
        }
}
#endif
