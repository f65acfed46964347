// Mortar pairing of surfaces: overlaps of facets, the dual mortar on them, rows of B. mortar_surfaces.py defines them;
// the tests have a NumPy version (tests/helpers/reference_mortar_surfaces.py). It writes in front of this file PLUS and
// MINUS, the orders of both sides, LINE, the points of quadrature along a direction, LEAF, OVERHANG and SLIVER.
#include <math.h>
#include <string.h>

#define INLINE static inline __attribute__((always_inline))
enum {
    OWN = (PLUS + 1) * (PLUS + 1), OTHER = (MINUS + 1) * (MINUS + 1), CELLS = PLUS * PLUS, PIECES = MINUS * MINUS,
    HIGHEST = PLUS > MINUS ? PLUS : MINUS, POINTS = LINE * LINE,
    SUMS = (OTHER + OWN + 3 + 7) / 8 * 8,  // columns of a quadrature: N, l, normal
    CORNERS = 12,                          // of a quadrilateral cut by another one, which need not be convex
};
#define WHOLE 1e-6  // part of a cell by which its covered area may differ from all of it
#define SETTLED 1e-8  // last step of Newton's method, in reference coordinates: the error is its square
#define NOISE 1e-14  // entry of B that is zero but for round-off: rows are short where lines of both meshes coincide
#define FLAT 1e-12  // part of an area: smaller corners are removed from polygons
enum { COVERED_TWICE = -1, FOLDED = -2 };

// A side of the interface: coordinates, nodes of facets, and coefficients of Legendre polynomials from nodal values.
struct side {
    const double *x;
    const long *numbers;
    const double *inverse, *nodes;
};
// Bilinear cell between neighbouring nodes of a facet: corners in turn, middle and radius.
struct cell { double corner[4][3], middle[3], radius; };
// Pair of a cell of the plus side and one of the minus side, with their overlap in the mean plane of the first.
struct pair {
    long cell, facet, piece;
    int corners;
    double polygon[CORNERS][2], map[4][2];
};
// A cell of the plus side in the mean plane of its facet: origin and axes of the plane, nodes of the facet along the
// axes, middle of the cell, its bilinear map and its area.
struct plane { double origin[3], axis[3][3], nodes[OWN][2], middle[3], map[4][2], area; };
// Coupling of a facet with one of the other side.
struct block { double values[OWN][OTHER]; };

INLINE double dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

INLINE void cross3(const double *a, const double *b, double *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1], c[1] = a[2] * b[0] - a[0] * b[2], c[2] = a[0] * b[1] - a[1] * b[0];
}

// Reference coordinates of corner k of a cell, in turn.
INLINE double corner_s(int k) { return k == 1 || k == 2 ? 1 : -1; }
INLINE double corner_t(int k) { return k > 1 ? 1 : -1; }

// Places among the nodes of a facet of the corners of one of its cells, in turn.
INLINE void corners_of(int order, long number, long corner[4])
{
    corner[0] = number / order * (order + 1) + number % order;
    corner[1] = corner[0] + order + 1, corner[2] = corner[0] + order + 2, corner[3] = corner[0] + 1;
}

// Quadrilateral of four nodes of a facet.
INLINE void quadrilateral(const struct side *side, const long *nodes, const long corner[4], struct cell *cell)
{
    for (int c = 0; c < 3; c++) {
        for (int i = 0; i < 4; i++) cell->corner[i][c] = side->x[3 * nodes[corner[i]] + c];
        cell->middle[c] = 0.25 * (cell->corner[0][c] + cell->corner[1][c] + cell->corner[2][c] + cell->corner[3][c]);
    }
    cell->radius = 0;
    for (int i = 0; i < 4; i++) {
        double arm[3];
        for (int c = 0; c < 3; c++) arm[c] = cell->corner[i][c] - cell->middle[c];
        cell->radius = fmax(cell->radius, sqrt(dot3(arm, arm)));
    }
}

INLINE void cell_of(const struct side *side, int order, long facet, long number, struct cell *cell)
{
    long corner[4];
    corners_of(order, number, corner);
    quadrilateral(side, side->numbers + facet * (order + 1) * (order + 1), corner, cell);
}

// Coefficients of 1, s, t and s t of the bilinear map of [-1, 1]^2 to corners.
INLINE void bilinear(double corner[4][2], double map[4][2])
{
    for (int c = 0; c < 2; c++) {
        const double a = corner[0][c], b = corner[1][c], d = corner[2][c], e = corner[3][c];
        map[0][c] = 0.25 * (a + b + d + e), map[1][c] = 0.25 * (b + d - a - e);
        map[2][c] = 0.25 * (d + e - a - b), map[3][c] = 0.25 * (a + d - b - e);
    }
}

INLINE void position(double map[4][2], double s, double t, double x[2])
{
    for (int c = 0; c < 2; c++) x[c] = map[0][c] + s * map[1][c] + t * map[2][c] + s * t * map[3][c];
}

INLINE double jacobian(double map[4][2], double s, double t)
{
    const double a = map[1][0] + t * map[3][0], b = map[1][1] + t * map[3][1];
    const double d = map[2][0] + s * map[3][0], e = map[2][1] + s * map[3][1];
    return a * e - b * d;
}

// Reference coordinates s, t of points x, y of a cell, by Newton's method for all together; whether it converges.
INLINE int inverse_of(double map[4][2], int count, const double *x, const double *y, double *s, double *t)
{
    for (int g = 0; g < count; g++) s[g] = t[g] = 0;
    double largest = 1;
    for (int i = 0; i < 30 && largest > SETTLED && largest < 1e3; i++) {
        largest = 0;
        _Pragma("omp simd reduction(max:largest)")
        for (int g = 0; g < count; g++) {
            const double a = map[1][0] + t[g] * map[3][0], b = map[1][1] + t[g] * map[3][1];
            const double d = map[2][0] + s[g] * map[3][0], e = map[2][1] + s[g] * map[3][1];
            const double u = x[g] - map[0][0] - s[g] * a - t[g] * map[2][0];
            const double v = y[g] - map[0][1] - s[g] * b - t[g] * map[2][1];
            const double one = 1 / (a * e - b * d), ds = (u * e - v * d) * one, dt = (v * a - u * b) * one;
            s[g] += ds, t[g] += dt;
            const double step = fabs(ds) + fabs(dt);
            largest = step > largest ? step : largest;
        }
    }
    return largest <= SETTLED;
}

// Diagonals of a cell and their cross product, twice its area times its normal.
INLINE void diagonals(const struct cell *cell, double first[3], double second[3], double normal[3])
{
    for (int c = 0; c < 3; c++)
        first[c] = cell->corner[2][c] - cell->corner[0][c], second[c] = cell->corner[3][c] - cell->corner[1][c];
    cross3(first, second, normal);
}

// A place along the axes of a plane.
INLINE void project(const struct plane *plane, const double *x, double flat[2])
{
    double arm[3];
    for (int c = 0; c < 3; c++) arm[c] = x[c] - plane->origin[c];
    for (int k = 0; k < 2; k++) flat[k] = dot3(arm, plane->axis[k]);
}

INLINE void project_cell(const struct plane *plane, const struct cell *cell, double flat[4][2])
{
    for (int i = 0; i < 4; i++) project(plane, cell->corner[i], flat[i]);
}

// Sets origin, axes and nodes in the mean plane of a facet of the plus side, that of its four corners: as on chains the
// direction of projection is one for a whole facet.
INLINE void plane_of_facet(const struct side *plus, long facet, struct plane *plane)
{
    const long *nodes = plus->numbers + facet * OWN, corner[4] = {0, PLUS * (PLUS + 1), OWN - 1, PLUS};
    struct cell outline;
    double first[3], second[3];
    quadrilateral(plus, nodes, corner, &outline);
    diagonals(&outline, first, second, plane->axis[2]);
    for (int c = 0; c < 3; c++) plane->origin[c] = outline.middle[c], plane->axis[0][c] = first[c] - second[c];
    const double size = sqrt(dot3(plane->axis[2], plane->axis[2])), along = sqrt(dot3(plane->axis[0], plane->axis[0]));
    for (int c = 0; c < 3; c++) plane->axis[2][c] /= size, plane->axis[0][c] /= along;
    cross3(plane->axis[2], plane->axis[0], plane->axis[1]);
    for (int a = 0; a < OWN; a++) project(plane, plus->x + 3 * nodes[a], plane->nodes[a]);
}

// Sets a cell in the plane of its facet: whether it is convex there and faces the same way as the facet.
INLINE int set_cell(const struct cell *cell, struct plane *plane)
{
    double flat[4][2];
    memcpy(plane->middle, cell->middle, sizeof(plane->middle));
    project_cell(plane, cell, flat);
    bilinear(flat, plane->map);
    plane->area = 4 * jacobian(plane->map, 0, 0);
    int convex = plane->area > 0;
    for (int i = 0; i < 4; i++)
        convex = convex && jacobian(plane->map, corner_s(i), corner_t(i)) > SLIVER * plane->area;
    return convex;
}

// Twice the area of a triangle, positive if it turns to the left.
INLINE double turn(const double *a, const double *b, const double *c)
{
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

// Part of a polygon on the left of the line from a to b.
INLINE int cut(double polygon[CORNERS][2], int corners, const double *a, const double *b)
{
    double kept[CORNERS][2];
    int count = 0;
    for (int i = 0; i < corners; i++) {
        const double *now = polygon[i], *next = polygon[(i + 1) % corners];
        const double of_now = turn(a, b, now), of_next = turn(a, b, next);
        if (of_now >= 0 && count < CORNERS) memcpy(kept[count++], now, 2 * sizeof(double));
        if (((of_now > 0 && of_next < 0) || (of_now < 0 && of_next > 0)) && count < CORNERS) {
            const double part = of_now / (of_now - of_next);
            for (int c = 0; c < 2; c++) kept[count][c] = now[c] + part * (next[c] - now[c]);
            count++;
        }
    }
    memcpy(polygon, kept, sizeof(kept));
    return count;
}

INLINE double area_of(double polygon[CORNERS][2], int corners)
{
    double area = 0;
    for (int i = 1; i + 1 < corners; i++) area += 0.5 * turn(polygon[0], polygon[i], polygon[i + 1]);
    return area;
}

// Remove corners that lie on the line between their neighbours: rectangles remain rectangles.
INLINE int without_flat_corners(double polygon[CORNERS][2], int corners, double area)
{
    for (int i = 0; corners > 2 && i < corners;) {
        const double *before = polygon[(i + corners - 1) % corners], *after = polygon[(i + 1) % corners];
        if (fabs(turn(before, polygon[i], after)) > FLAT * area) {
            i++;
            continue;
        }
        memmove(polygon[i], polygon[i + 1], (corners - i - 1) * sizeof(polygon[0]));
        corners--, i = i > 0 ? i - 1 : 0;
    }
    return corners;
}

// Range of the reference coordinates of a cell of the minus side. A side of the surface without neighbour is moved
// outwards by OVERHANG of its facet.
INLINE void limits_of(const struct pair *pair, const unsigned char *open, const double *nodes, double low[2],
                      double high[2])
{
    const long cell[2] = {pair->piece / MINUS, pair->piece % MINUS};
    const int before[2] = {open[3], open[0]}, after[2] = {open[1], open[2]};
    for (int c = 0; c < 2; c++) {
        const double more = 4 * OVERHANG / (nodes[cell[c] + 1] - nodes[cell[c]]);
        low[c] = cell[c] == 0 && before[c] ? -1 - more : -1;
        high[c] = cell[c] == MINUS - 1 && after[c] ? 1 + more : 1;
    }
}

// Sets overlap and map of a pair. Returns the area of the overlap, zero if the cell faces the other way.
INLINE double overlap(struct plane *plane, const struct cell *other, const unsigned char *open,
                      const double *nodes, struct pair *pair)
{
    double flat[4][2];
    project_cell(plane, other, flat);
    bilinear(flat, pair->map);
    pair->corners = 0;
    if (2 * (turn(flat[0], flat[1], flat[2]) + turn(flat[0], flat[2], flat[3])) <= SLIVER * plane->area) return 0;
    double low[2], high[2];
    limits_of(pair, open, nodes, low, high);
    const double ends[4][2] = {{low[0], low[1]}, {high[0], low[1]}, {high[0], high[1]}, {low[0], high[1]}};
    for (int k = 0; k < 4; k++) position(pair->map, ends[k][0], ends[k][1], pair->polygon[k]);
    double own[4][2];
    for (int k = 0; k < 4; k++) position(plane->map, corner_s(k), corner_t(k), own[k]);
    int corners = 4;
    for (int k = 0; k < 4 && corners > 2; k++) corners = cut(pair->polygon, corners, own[k], own[(k + 1) % 4]);
    if (corners < 3) return 0;
    const double area = area_of(pair->polygon, corners);
    if (area <= SLIVER * plane->area) return 0;
    corners = without_flat_corners(pair->polygon, corners, plane->area);
    pair->corners = corners > 2 ? corners : 0;
    return area;
}

// Lagrange polynomials on the nodes of a facet and their slopes, of every node at all points in turn; the points are in
// one of the cells between the nodes, with reference coordinates of that cell.
INLINE void lagrange(const struct side *side, int order, long cell, int count, const double *at, double *value,
                     double *slope)
{
    const double *nodes = side->nodes, middle = 0.5 * (nodes[cell] + nodes[cell + 1]), half = nodes[cell + 1] - middle;
    _Pragma("omp simd")
    for (int g = 0; g < count; g++) {
        const double x = middle + half * at[g];
        double p[HIGHEST + 1], d[HIGHEST + 1];
        p[0] = 1, p[1] = x, d[0] = 0, d[1] = 1;
        for (int k = 1; k < order; k++) {
            p[k + 1] = (2 * k + 1.0) / (k + 1) * x * p[k] - k / (k + 1.0) * p[k - 1];
            d[k + 1] = d[k - 1] + (2 * k + 1) * p[k];
        }
        for (int a = 0; a <= order; a++) {
            double sum = 0, by_x = 0;
            for (int k = 0; k <= order; k++) {
                sum += p[k] * side->inverse[k * (order + 1) + a];
                by_x += d[k] * side->inverse[k * (order + 1) + a];
            }
            value[a * count + g] = sum, slope[a * count + g] = by_x;
        }
    }
}

// Map of order p of a cell between the nodes of a facet, along the axes of a plane: places of points, and derivatives by
// the reference coordinates of the cell, which `slope` has by those of the facet.
INLINE void places_of(const struct side *side, int order, const long cell[2], int count, double (*flat)[2],
                      const double *s, const double *t, double *x, double *derivative)
{
    const int line = order + 1;
    double value[2][line * count], slope[2][line * count];
    lagrange(side, order, cell[0], count, s, value[0], slope[0]);
    lagrange(side, order, cell[1], count, t, value[1], slope[1]);
    const double half[2] = {0.5 * (side->nodes[cell[0] + 1] - side->nodes[cell[0]]),
                            0.5 * (side->nodes[cell[1] + 1] - side->nodes[cell[1]])};
    memset(x, 0, 2 * count * sizeof(*x));
    memset(derivative, 0, 4 * count * sizeof(*x));
    for (int i = 0; i < line; i++)
        for (int j = 0; j < line; j++)
            for (int c = 0; c < 2; c++) {
                const double at = flat[i * line + j][c];
                for (int g = 0; g < count; g++) {
                    const double of_i = value[0][i * count + g], of_j = value[1][j * count + g];
                    x[c * count + g] += of_i * of_j * at;
                    derivative[c * count + g] += half[0] * slope[0][i * count + g] * of_j * at;
                    derivative[(2 + c) * count + g] += half[1] * of_i * slope[1][j * count + g] * at;
                }
            }
}

// Reference coordinates of points x, y of a cell on the facet of order p, by Newton's method from those of the bilinear
// map, which is the facet itself for order 1; whether it converges where the facet is not folded.
INLINE int refine(const struct side *side, int order, const long cell[2], int count, double (*flat)[2],
                  const double *x, const double *y, double *s, double *t)
{
    if (order == 1) return 1;
    double largest = 1, smallest = 1;
    for (int i = 0; i < 30 && largest > SETTLED && largest < 1e3; i++) {
        double at[2 * count], derivative[4 * count];
        places_of(side, order, cell, count, flat, s, t, at, derivative);
        largest = 0, smallest = INFINITY;
        for (int g = 0; g < count; g++) {
            const double a = derivative[g], d = derivative[count + g], b = derivative[2 * count + g];
            const double e = derivative[3 * count + g], u = x[g] - at[g], v = y[g] - at[count + g], det = a * e - b * d;
            const double ds = (u * e - v * b) / det, dt = (v * a - u * d) / det, step = fabs(ds) + fabs(dt);
            s[g] += ds, t[g] += dt;
            largest = step > largest ? step : largest, smallest = det < smallest ? det : smallest;
        }
    }
    return largest <= SETTLED && smallest > 0;
}

// Basis of a facet of the minus side and its unit normal, all points in turn, at points s, t of one of its cells.
INLINE void opposite_at(const struct side *minus, long facet, long piece, int count, const double *s, const double *t,
                        double *basis, double *normal)
{
    double value[2][(MINUS + 1) * count], slope[2][(MINUS + 1) * count], along[2][3][count];
    lagrange(minus, MINUS, piece / MINUS, count, s, value[0], slope[0]);
    lagrange(minus, MINUS, piece % MINUS, count, t, value[1], slope[1]);
    memset(along, 0, sizeof(along));
    const long *nodes = minus->numbers + facet * OTHER;
    for (int i = 0; i <= MINUS; i++)
        for (int j = 0; j <= MINUS; j++) {
            const double *x = minus->x + 3 * nodes[i * (MINUS + 1) + j];
            for (int g = 0; g < count; g++) {
                const double of_i = value[0][i * count + g], of_j = value[1][j * count + g];
                const double by_s = slope[0][i * count + g] * of_j, by_t = of_i * slope[1][j * count + g];
                basis[(i * (MINUS + 1) + j) * count + g] = of_i * of_j;
                for (int c = 0; c < 3; c++) along[0][c][g] += by_s * x[c], along[1][c][g] += by_t * x[c];
            }
        }
    for (int g = 0; g < count; g++) {
        double size = 0;
        for (int c = 0; c < 3; c++) {
            const int d = (c + 1) % 3, e = (c + 2) % 3;
            normal[c * count + g] = along[0][d][g] * along[1][e][g] - along[0][e][g] * along[1][d][g];
            size += normal[c * count + g] * normal[c * count + g];
        }
        size = sqrt(size);
        for (int c = 0; c < 3; c++) normal[c * count + g] /= size;
    }
}

// Points and weights of a polygon: a product rule on quadrilaterals, else one on every triangle of a fan. Returns
// whether this is the last part.
INLINE int quadrature(double polygon[CORNERS][2], int corners, int part, const double *gauss, const double *weight, double x[2][POINTS],
                      double *w)
{
    double corner[4][2], map[4][2];
    for (int k = 0; k < 4; k++) {
        const int i = corners == 4 ? k : k < 2 ? 0 : part + k - 1;
        memcpy(corner[k], polygon[i], sizeof(corner[k]));
    }
    bilinear(corner, map);  // of a triangle: two corners coincide, and the Jacobian vanishes there
    for (int i = 0; i < LINE; i++)
        for (int j = 0; j < LINE; j++) {
            double at[2];
            position(map, gauss[i], gauss[j], at);
            for (int c = 0; c < 2; c++) x[c][i * LINE + j] = at[c];
            w[i * LINE + j] = weight[i] * weight[j] * jacobian(map, gauss[i], gauss[j]);
        }
    return corners == 4 || part + 1 == corners - 2;
}

// Corners of the overlap of a pair in reference coordinates of its cell of the plus side. Returns whether they exist.
INLINE int reference_polygon(const struct pair *pair, struct plane *plane, const struct side *plus, const long cell[2],
                             double polygon[CORNERS][2])
{
    double x[CORNERS], y[CORNERS], s[CORNERS], t[CORNERS];
    for (int k = 0; k < CORNERS; k++) {  // the last one fills up
        const int i = k < pair->corners ? k : pair->corners - 1;
        x[k] = pair->polygon[i][0], y[k] = pair->polygon[i][1];
    }
    if (!inverse_of(plane->map, CORNERS, x, y, s, t)) return 0;
    if (!refine(plus, PLUS, cell, CORNERS, plane->nodes, x, y, s, t)) return 0;
    for (int k = 0; k < CORNERS; k++) polygon[k][0] = s[k], polygon[k][1] = t[k];
    return 1;
}

// Reference coordinates of points x, y in the plane on a cell of the minus side. Returns whether they exist.
INLINE int on_minus(struct pair *pair, const struct plane *plane, const struct side *minus, int count, const double *x,
                    const double *y, double *s, double *t)
{
    if (!inverse_of(pair->map, count, x, y, s, t)) return 0;
    for (int g = 0; g < count; g++)
        if (!(jacobian(pair->map, s[g], t[g]) > SLIVER * plane->area)) return 0;
    const long cell[2] = {pair->piece / MINUS, pair->piece % MINUS}, *nodes = minus->numbers + pair->facet * OTHER;
    double flat[OTHER][2];
    for (int b = 0; MINUS > 1 && b < OTHER; b++) project(plane, minus->x + 3 * nodes[b], flat[b]);
    return refine(minus, MINUS, cell, count, flat, x, y, s, t);
}

// Add the integrals over the overlap of a pair: of l N to `block`, of l l and l n to `sums`. Polygons have straight sides
// in the reference coordinates of the plus side, where l l is a polynomial: only the place of the cut depends on that.
// Returns whether all points have reference coordinates.
INLINE int integrate(struct pair *pair, struct plane *plane, const struct side *plus, const struct side *minus,
                     const double *metric, const double *gauss, const double *weight, struct block *block,
                     double sums[OWN][OWN + 3])
{
    const long cell[2] = {pair->cell / PLUS, pair->cell % PLUS};
    const double *nodes = plus->nodes;
    const double scale = 0.25 * (nodes[cell[0] + 1] - nodes[cell[0]]) * (nodes[cell[1] + 1] - nodes[cell[1]]);
    double polygon[CORNERS][2];
    if (!reference_polygon(pair, plane, plus, cell, polygon)) return 0;
    for (int part = 0, last = 0; !last; part++) {
        double at[2][POINTS], x[2][POINTS], w[POINTS], s[POINTS], t[POINTS], all[SUMS][POINTS], local[POINTS] = {0};
        double value[2][(PLUS + 1) * POINTS], slope[(PLUS + 1) * POINTS], own[OWN][POINTS], both[POINTS][SUMS];
        double(*const l)[POINTS] = all + OTHER;
        last = quadrature(polygon, pair->corners, part, gauss, weight, at, w);
        lagrange(plus, PLUS, cell[0], POINTS, at[0], value[0], slope);
        lagrange(plus, PLUS, cell[1], POINTS, at[1], value[1], slope);
        memset(x, 0, sizeof(x));
        for (int a = 0; a < OWN; a++)
            for (int g = 0; g < POINTS; g++) {
                l[a][g] = value[0][a / (PLUS + 1) * POINTS + g] * value[1][a % (PLUS + 1) * POINTS + g];
                local[g] += l[a][g] * metric[a];
                x[0][g] += l[a][g] * plane->nodes[a][0], x[1][g] += l[a][g] * plane->nodes[a][1];
            }
        for (int g = 0; g < POINTS; g++) w[g] *= scale * local[g];
        for (int a = 0; a < OWN; a++)
            for (int g = 0; g < POINTS; g++) own[a][g] = w[g] * l[a][g];
        if (!on_minus(pair, plane, minus, POINTS, x[0], x[1], s, t)) return 0;
        opposite_at(minus, pair->facet, pair->piece, POINTS, s, t, all[0], l[OWN]);
        for (int k = 0; k < SUMS; k++)
            for (int g = 0; g < POINTS; g++) both[g][k] = k < OTHER + OWN + 3 ? all[k][g] : 0;
        for (int a = 0; a < OWN; a++) {
            double sum[SUMS] = {0};
            for (int g = 0; g < POINTS; g++)
                for (int k = 0; k < SUMS; k++) sum[k] += own[a][g] * both[g][k];
            for (int j = 0; j < OTHER; j++) block->values[a][j] += sum[j];
            for (int b = 0; b < OWN + 3; b++) sums[a][b] += sum[OTHER + b];
        }
    }
    return 1;
}

// Cholesky factor of the mass matrix, in place: whether it is positive definite.
INLINE int factorise(double mass[OWN][OWN + 3])
{
    for (int a = 0; a < OWN; a++)
        for (int b = 0; b <= a; b++) {
            double sum = mass[a][b];
            for (int k = 0; k < b; k++) sum -= mass[a][k] * mass[b][k];
            if (a == b && !(sum > 0)) return 0;
            mass[a][b] = a == b ? sqrt(sum) : sum / mass[b][b];
        }
    return 1;
}

// values = D M^-1 values, of `count` columns; their distance in memory is 1, that of rows `stride`.
INLINE void to_dual(double mass[OWN][OWN + 3], const double *integral, double *values, int count, int stride)
{
    for (int a = 0; a < OWN; a++) {
        for (int k = 0; k < a; k++)
            for (int j = 0; j < count; j++) values[a * stride + j] -= mass[a][k] * values[k * stride + j];
        for (int j = 0; j < count; j++) values[a * stride + j] /= mass[a][a];
    }
    for (int a = OWN - 1; a >= 0; a--) {
        for (int k = a + 1; k < OWN; k++)
            for (int j = 0; j < count; j++) values[a * stride + j] -= mass[k][a] * values[k * stride + j];
        for (int j = 0; j < count; j++) values[a * stride + j] /= mass[a][a];
    }
    for (int a = 0; a < OWN; a++)
        for (int j = 0; j < count; j++) values[a * stride + j] *= integral[a];
}

// Pair the nodes of a facet that is covered in part with what lies above or below them; `times` counts the cells.
INLINE void collocate(struct pair *pair, struct plane *plane, const struct side *minus, const unsigned char *open,
                      struct block *block, double normal[OWN][3], int *times)
{
    long corner[4];
    double low[2], high[2];
    corners_of(PLUS, pair->cell, corner);
    limits_of(pair, open, minus->nodes, low, high);
    for (int k = 0; k < 4; k++) {
        double x[2], at[2], basis[OTHER], n[3];
        position(plane->map, corner_s(k), corner_t(k), x);
        if (!inverse_of(pair->map, 1, x, x + 1, at, at + 1)) continue;
        int inside = jacobian(pair->map, at[0], at[1]) > SLIVER * plane->area;
        for (int c = 0; c < 2; c++) inside = inside && at[c] > low[c] - SLIVER && at[c] < high[c] + SLIVER;
        if (!inside || !on_minus(pair, plane, minus, 1, x, x + 1, at, at + 1)) continue;
        opposite_at(minus, pair->facet, pair->piece, 1, at, at + 1, basis, n);
        for (int b = 0; b < OTHER; b++) block->values[corner[k]][b] += basis[b];
        for (int c = 0; c < 3; c++) normal[corner[k]][c] += n[c];
        times[corner[k]]++;
    }
}

// Facets of the minus side in a tree: every range of `sorted` is halved down to LEAF facets; `ball` has the middle and
// the radius of every range.
struct tree { const long *sorted; double *ball; const struct cell *cells; };

static void bound(const struct tree *tree, long node, long low, long high, double box[6])
{
    for (int c = 0; c < 3; c++) box[c] = INFINITY, box[3 + c] = -INFINITY;
    if (high - low > LEAF) {
        double part[6];
        const long middle = low + (high - low) / 2;
        for (int k = 0; k < 2; k++) {
            bound(tree, 2 * node + 1 + k, k ? middle : low, k ? high : middle, part);
            for (int c = 0; c < 3; c++) box[c] = fmin(box[c], part[c]), box[3 + c] = fmax(box[3 + c], part[3 + c]);
        }
    } else
        for (long f = low; f < high; f++)
            for (int piece = 0; piece < PIECES; piece++) {
                const struct cell *cell = tree->cells + tree->sorted[f] * PIECES + piece;
                for (int c = 0; c < 3; c++) {
                    box[c] = fmin(box[c], cell->middle[c] - cell->radius);
                    box[3 + c] = fmax(box[3 + c], cell->middle[c] + cell->radius);
                }
            }
    double *ball = tree->ball + 4 * node, half[3];
    for (int c = 0; c < 3; c++) ball[c] = 0.5 * (box[c] + box[3 + c]), half[c] = 0.5 * (box[3 + c] - box[c]);
    ball[3] = sqrt(dot3(half, half));
}

// Whether a ball comes within `radius` of the normal of a cell, not farther than `reach` from its middle.
INLINE int near(const struct plane *plane, double radius, double reach, const double *middle, double other)
{
    double arm[3];
    for (int c = 0; c < 3; c++) arm[c] = middle[c] - plane->middle[c];
    const double along = dot3(arm, plane->axis[2]), beyond = fmax(fabs(along) - reach, 0), all = radius + other;
    return dot3(arm, arm) - along * along + beyond * beyond <= all * all * (1 + 1e-12);
}

// Append the cells of the minus side that may overlap a cell of the plus side; returns the number of pairs.
static long search(const struct tree *tree, long node, long low, long high, const struct plane *plane, double radius,
                   double reach, long cell, struct pair *pairs, long count, long capacity)
{
    if (!near(plane, radius, reach, tree->ball + 4 * node, tree->ball[4 * node + 3])) return count;
    if (high - low > LEAF) {
        const long middle = low + (high - low) / 2;
        count = search(tree, 2 * node + 1, low, middle, plane, radius, reach, cell, pairs, count, capacity);
        return search(tree, 2 * node + 2, middle, high, plane, radius, reach, cell, pairs, count, capacity);
    }
    for (long f = low; f < high; f++)
        for (int piece = 0; piece < PIECES; piece++) {
            const struct cell *other = tree->cells + tree->sorted[f] * PIECES + piece;
            if (!near(plane, radius, reach, other->middle, other->radius)) continue;
            if (count < capacity) {
                pairs[count].cell = cell, pairs[count].facet = tree->sorted[f], pairs[count].piece = piece;
            }
            count++;
        }
    return count;
}

// Arguments of `couple`. Results: of every facet the number of its blocks up to it (`upto`, facets + 1), of every block
// the facet of the minus side (`opposite`) and its values; `weight` and `normal`, sums at the nodes of the facets.
// Room: pairs of one facet, blocks of all; both are counted in `needed`, with the facet of a failure.
struct work {
    struct side plus, minus;
    long facets, others;
    const long *sorted;
    const unsigned char *open;                 // sides of facets of the minus side without a neighbour, others x 4
    const double *metric, *integral, *lumped;  // at the nodes of undeformed facets: metric, int l, Lobatto weights
    const double *gauss, *gauss_weight;
    double reach;                              // [m]
    struct cell *cells;
    double *ball;
    struct pair *pairs;
    long pair_capacity;
    struct block *blocks;
    long block_capacity;
    long *opposite, *upto;
    double *weight, *normal;
    long needed[3];
};

long size_of_pair(void) { return sizeof(struct pair); }
long size_of_cell(void) { return sizeof(struct cell); }

// Set planes, pairs and their overlaps of a facet: the number of pairs, COVERED_TWICE or FOLDED. *whole: covered.
static long pairs_of(struct work *work, const struct tree *tree, long e, struct plane planes[CELLS], int *whole)
{
    long count = 0;
    *whole = 1;
    plane_of_facet(&work->plus, e, planes);
    for (int s = 0; s < CELLS; s++) {
        struct cell cell;
        if (s > 0) planes[s] = planes[0];
        cell_of(&work->plus, PLUS, e, s, &cell);
        if (!set_cell(&cell, planes + s)) return FOLDED;
        const long begin = count;
        count = search(tree, 0, 0, work->others, planes + s, cell.radius, work->reach, s, work->pairs, count,
                       work->pair_capacity);
        if (count > work->pair_capacity) continue;
        double area = 0;
        for (long k = begin; k < count; k++) {
            struct pair *pair = work->pairs + k;
            area += overlap(planes + s, tree->cells + pair->facet * PIECES + pair->piece, work->open + 4 * pair->facet,
                            work->minus.nodes, pair);
        }
        if (area > (1 + WHOLE) * planes[s].area) return COVERED_TWICE;
        *whole = *whole && area > (1 - WHOLE) * planes[s].area;
    }
    return count;
}

// Block of a facet and one of the other side, set to zero at first; NULL without room for it.
INLINE struct block *block_of(struct work *work, long begin, long *blocks, long facet)
{
    long k = begin;
    while (k < *blocks && k < work->block_capacity && work->opposite[k] != facet) k++;
    if (k < *blocks && k < work->block_capacity) return work->blocks + k;
    *blocks += 1;
    if (k >= work->block_capacity) return NULL;
    work->opposite[k] = facet;
    return memset(work->blocks + k, 0, sizeof(struct block));
}

// Weights, normals and blocks of a facet from its pairs; whether all points have been paired.
static int couple_facet(struct work *work, long e, long count, struct plane planes[CELLS], int whole, long *blocks)
{
    const long begin = *blocks;
    const double *integral = work->integral + e * OWN, *lumped = work->lumped + e * OWN;
    double sums[OWN][OWN + 3] = {{0}}, normal[OWN][3] = {{0}};
    int times[OWN] = {0};
    for (long k = 0; k < count; k++) {
        struct pair *pair = work->pairs + k;
        if (whole && !pair->corners) continue;
        struct block *block = block_of(work, begin, blocks, pair->facet);
        if (!block) continue;
        if (!whole)
            collocate(pair, planes + pair->cell, &work->minus, work->open + 4 * pair->facet, block, normal, times);
        else if (!integrate(pair, planes + pair->cell, &work->plus, &work->minus, work->metric + e * OWN, work->gauss,
                            work->gauss_weight, block, sums))
            return 0;
    }
    if (*blocks > work->block_capacity) return 1;
    if (whole) {
        for (int a = 0; a < OWN; a++)
            for (int c = 0; c < 3; c++) normal[a][c] = sums[a][OWN + c];
        if (!factorise(sums)) return 0;
        to_dual(sums, integral, normal[0], 3, 3);
        for (long k = begin; k < *blocks; k++) to_dual(sums, integral, work->blocks[k].values[0], OTHER, OTHER);
    } else
        for (int a = 0; a < OWN; a++) {
            const double share = times[a] ? lumped[a] / times[a] : 0;
            for (int c = 0; c < 3; c++) normal[a][c] *= share;
            for (long k = begin; k < *blocks; k++)
                for (int j = 0; j < OTHER; j++) work->blocks[k].values[a][j] *= share;
        }
    for (int a = 0; a < OWN; a++) {
        const long i = work->plus.numbers[e * OWN + a];
        work->weight[i] += whole ? integral[a] : times[a] ? lumped[a] : 0;
        for (int c = 0; c < 3; c++) work->normal[3 * i + c] += normal[a][c];
    }
    return 1;
}

// Couple both sides: 0, or COVERED_TWICE or FOLDED at facet needed[2]. Larger needs than room: nothing is complete.
long couple(struct work *work)
{
    struct tree tree = {work->sorted, work->ball, work->cells};
    double box[6];
    for (long f = 0; f < work->others; f++)
        for (int piece = 0; piece < PIECES; piece++) {
            struct cell *cell = work->cells + f * PIECES + piece;
            cell_of(&work->minus, MINUS, f, piece, cell);
            cell->radius *= 1 + OVERHANG * (MINUS * (MINUS + 1) + 2);  // the first cell of a facet is the shortest one
        }
    bound(&tree, 0, 0, work->others, box);
    long blocks = 0;
    work->needed[0] = 0;
    for (long e = 0; e < work->facets; e++) {
        struct plane planes[CELLS];
        int whole;
        work->upto[e] = blocks, work->needed[2] = e;
        const long count = pairs_of(work, &tree, e, planes, &whole);
        if (count < 0) return count;
        work->needed[0] = count > work->needed[0] ? count : work->needed[0];
        if (count <= work->pair_capacity && !couple_facet(work, e, count, planes, whole, &blocks)) return FOLDED;
    }
    work->upto[work->facets] = work->needed[1] = blocks;
    return 0;
}

// Rows of w B: number of columns of the longest; with `width` fill in nodes and values. The facets of node i, times OWN
// plus the place in the facet, are `around` from begin[i] to begin[i + 1]; mark and place: room for `m` nodes.
long rows(const struct work *work, long n, const long *begin, const long *around, long *mark, long *place, long m,
          long width, long *columns, double *values)
{
    long longest = 0;
    for (long j = 0; j < m; j++) mark[j] = -1;
    for (long i = 0; i < n; i++) {
        long count = 0;
        for (long k = begin[i]; k < begin[i + 1]; k++) {
            const long e = around[k] / OWN, a = around[k] % OWN;
            for (long block = work->upto[e]; block < work->upto[e + 1]; block++) {
                const long *nodes = work->minus.numbers + work->opposite[block] * OTHER;
                for (int b = 0; b < OTHER; b++) {
                    const double value = work->blocks[block].values[a][b];
                    const long j = nodes[b];
                    if (fabs(value) <= NOISE * work->weight[i]) continue;
                    if (mark[j] != i) mark[j] = i, place[j] = count++;
                    if (width) columns[i * width + place[j]] = j, values[i * width + place[j]] += value;
                }
            }
        }
        longest = count > longest ? count : longest;
        if (width)
            for (long k = count; k < width; k++) columns[i * width + k] = count ? columns[i * width] : 0;
    }
    return longest;
}
