// Mortar pairing: overlaps of facets, and the dual mortar on them. mortar.py defines them; the tests have a NumPy
// version (tests/helpers/reference_mortar.py). It writes in front of this file PLUS and MINUS, the orders of both
// sides, GAUSS, the points of quadrature on an overlap, REACH, OVERHANG and SLIVER.
#include <math.h>
#include <string.h>

#define INLINE static inline __attribute__((always_inline))
enum { GROUP = 16 };  // facets that are skipped together if they are too far away
enum { HIGHEST = PLUS > MINUS ? PLUS : MINUS, SAMPLES = GAUSS > PLUS + 1 ? GAUSS : PLUS + 1 };

INLINE const double *begin_of(const double *x, int order, long facet) { return x + 2 * order * facet; }
INLINE const double *end_of(const double *x, int order, long facet) { return x + 2 * order * (facet + 1); }

INLINE void middle_of(const double *x, int order, long facet, double middle[2])
{
    const double *a = begin_of(x, order, facet), *b = end_of(x, order, facet);
    for (int c = 0; c < 2; c++) middle[c] = 0.5 * (a[c] + b[c]);
}

// Sets the unit vector of a chord and returns its length.
INLINE double chord(const double *x, int order, long facet, double along[2])
{
    const double *a = begin_of(x, order, facet), *b = end_of(x, order, facet);
    const double length = hypot(b[0] - a[0], b[1] - a[1]);
    for (int c = 0; c < 2; c++) along[c] = (b[c] - a[c]) / length;
    return length;
}

// Overlaps: pairs of facets, with start and end along the chord of the first one. share: covered
// part of every facet; group: 3 numbers for every GROUP facets of the minus side. Returns their number; those beyond
// capacity are only counted.
long overlaps(long facets, long others, const double *plus, const double *minus, double *group, long capacity,
              long *own, long *opposite, double *low, double *high, double *share)
{
    double longest = 0, along[2], middle[2];
    for (long f = 0; f < facets; f++) longest = fmax(longest, chord(plus, PLUS, f, along));
    for (long f = 0; f < others; f++) longest = fmax(longest, chord(minus, MINUS, f, along));
    const double reach = REACH * longest;
    for (long f = 0; f < others; f += GROUP) {  // around the middle of the first one
        double *of = group + f / GROUP * 3;
        middle_of(minus, MINUS, f, of);
        of[2] = 0;
        for (long g = f; g < others && g < f + GROUP; g++) {
            middle_of(minus, MINUS, g, middle);
            of[2] = fmax(of[2], hypot(middle[0] - of[0], middle[1] - of[1]));
        }
    }
    long count = 0;
    for (long e = 0; e < facets; e++) {
        const double *origin = begin_of(plus, PLUS, e), length = chord(plus, PLUS, e, along);
        double here[2];
        middle_of(plus, PLUS, e, here);
        share[e] = 0;
        for (long f = 0; f < others; f++) {
            if (f % GROUP == 0) {
                const double *of = group + f / GROUP * 3;
                if (hypot(of[0] - here[0], of[1] - here[1]) > (1 + 1e-12) * (reach + of[2])) {
                    f += GROUP - 1;
                    continue;
                }
            }
            middle_of(minus, MINUS, f, middle);
            const double dx = middle[0] - here[0], dy = middle[1] - here[1];
            if (dx * dx + dy * dy > reach * reach) continue;
            const double *a = begin_of(minus, MINUS, f), *b = end_of(minus, MINUS, f);
            double begin = (a[0] - origin[0]) * along[0] + (a[1] - origin[1]) * along[1];
            double end = (b[0] - origin[0]) * along[0] + (b[1] - origin[1]) * along[1];
            const double size = hypot(b[0] - a[0], b[1] - a[1]);
            if (f == 0) begin -= OVERHANG * size;
            if (f == others - 1) end += OVERHANG * size;
            begin = fmax(begin, 0), end = fmin(end, length);
            if (end - begin <= SLIVER * length) continue;
            if (count < capacity) own[count] = e, opposite[count] = f, low[count] = begin, high[count] = end;
            share[e] += (end - begin) / length;
            count++;
        }
    }
    return count;
}

// Legendre polynomials and their slopes.
INLINE void legendre(int order, double x, double *value, double *slope)
{
    value[0] = 1, value[1] = x, slope[0] = 0, slope[1] = 1;
    for (int k = 1; k < order; k++) {
        value[k + 1] = (2 * k + 1.0) / (k + 1) * x * value[k] - k / (k + 1.0) * value[k - 1];
        slope[k + 1] = slope[k - 1] + (2 * k + 1) * value[k];
    }
}

INLINE double dot(int order, const double *a, const double *b)
{
    double sum = 0;
    for (int k = 0; k <= order; k++) sum += a[k] * b[k];
    return sum;
}

// Coefficients of Legendre polynomials from values at the nodes.
INLINE void expand(int order, const double *inverse, const double *values, double *series)
{
    for (int k = 0; k <= order; k++) series[k] = dot(order, inverse + k * (order + 1), values);
}

#define SETTLED 1e-9  // last step of Newton's method, in reference coordinates

// Point where a polynomial that grows along [-1, 1] has a given value, by Newton's method. *found: whether one exists.
INLINE double between(int order, double at, double wanted, const double *series, int *found)
{
    *found = 1;
    if (order == 1) return (wanted - series[0]) / series[1];
    double step = 0;
    for (int i = 0; i < 30; i++) {
        double value[HIGHEST + 1], slope[HIGHEST + 1];
        legendre(order, at, value, slope);
        step = (wanted - dot(order, value, series)) / dot(order, slope, series);
        at = fmin(fmax(at + step, -1.2), 1.2);
        if (fabs(step) < 1e-14) break;
    }
    *found = fabs(step) < SETTLED;
    return at;
}

// Sums over overlaps, ordered by facet: rows of w B from column `first` on, w, w times the tangent of the minus side.
// inverse: values at the nodes to coefficients, of both sides; dual: of psi, in Legendre polynomials; metric: of the
// undeformed facet; nodal: weights of its nodes.
// Returns the first facet on which a point was not found, or -1.
long couple(long pieces, const double *plus, const double *minus, const long *own, const long *opposite, const double *low,
            const double *high, const double *share, const double *plus_inverse, const double *minus_inverse,
            const double *gauss, const double *gauss_weight, const double *nodes, const double *dual,
            const double *metric, const double *nodal, const long *first, long band, double *coupling, double *weight,
            double *tangent)
{
    long lost = -1;
    for (long last, k = 0; k < pieces; k = last) {
        const long e = own[k];
        const double *corners = begin_of(plus, PLUS, e), *psi = dual + e * (PLUS + 1) * (PLUS + 1);
        const double *shape = metric + e * 2 * (PLUS + 1), *lumped = nodal + e * (PLUS + 1);
        double along[2], here[PLUS + 1], series[PLUS + 1];
        chord(plus, PLUS, e, along);
        for (int a = 0; a <= PLUS; a++)
            here[a] = (corners[2 * a] - corners[0]) * along[0] + (corners[2 * a + 1] - corners[1]) * along[1];
        expand(PLUS, plus_inverse, here, series);
        const int whole = share[e] > 1 - 1e-6;
        const double length = here[PLUS], slack = SLIVER * length;
        int times[PLUS + 1] = {0};  // a node above a vertex of the minus side belongs to two overlaps
        for (last = k; last < pieces && own[last] == e; last++)
            for (int a = 0; a <= PLUS; a++) times[a] += here[a] > low[last] - slack && here[a] < high[last] + slack;
        for (long piece = k; piece < last; piece++) {
            const long f = opposite[piece];
            const double *other = begin_of(minus, MINUS, f);
            double there[MINUS + 1], series_there[MINUS + 1], x[2][MINUS + 1], series_x[2][MINUS + 1];
            for (int j = 0; j <= MINUS; j++) {
                for (int c = 0; c < 2; c++) x[c][j] = other[2 * j + c] - corners[c];
                there[j] = x[0][j] * along[0] + x[1][j] * along[1];
            }
            expand(MINUS, minus_inverse, there, series_there);
            for (int c = 0; c < 2; c++) expand(MINUS, minus_inverse, x[c], series_x[c]);
            double at[SAMPLES], given[SAMPLES][PLUS + 1] = {{0}}, value[HIGHEST + 1], slope[HIGHEST + 1];
            int found, counts = 1;
            if (whole) {
                const double begin = between(PLUS, 2 * low[piece] / length - 1, low[piece], series, &found);
                counts = found;
                const double end = between(PLUS, 2 * high[piece] / length - 1, high[piece], series, &found);
                if (!(found && counts) && lost < 0) lost = e;
                for (int g = 0; g < GAUSS; g++) {
                    at[g] = 0.5 * ((begin + end) + (end - begin) * gauss[g]);
                    legendre(PLUS, at[g], value, slope);
                    const double ds = hypot(dot(PLUS, slope, shape), dot(PLUS, slope, shape + PLUS + 1));
                    const double measure = 0.5 * (end - begin) * gauss_weight[g] * ds;
                    for (int a = 0; a <= PLUS; a++) given[g][a] = measure * dot(PLUS, psi + a * (PLUS + 1), value);
                }
            } else
                for (int a = 0; a <= PLUS; a++) {
                    const int inside = here[a] > low[piece] - slack && here[a] < high[piece] + slack;
                    at[a] = nodes[a];
                    given[a][a] = inside ? lumped[a] / times[a] : 0;
                }
            double block[PLUS + 1][MINUS + 1] = {{0}}, turned[PLUS + 1][2] = {{0}};
            for (int s = 0; s < (whole ? GAUSS : PLUS + 1); s++) {
                legendre(PLUS, at[s], value, slope);
                const double wanted = dot(PLUS, value, series);
                const double guess = 2 * (wanted - there[0]) / (there[MINUS] - there[0]) - 1;
                const double eta = between(MINUS, fmin(fmax(guess, -1), 1), wanted, series_there, &found);
                // Nodes that are not above this overlap contribute nothing, and need no point on it.
                if (!found && lost < 0 && (whole || given[s][s] != 0)) lost = e;
                legendre(MINUS, eta, value, slope);
                const double dx = dot(MINUS, slope, series_x[0]), dy = dot(MINUS, slope, series_x[1]);
                const double size = hypot(dx, dy);
                double shares[MINUS + 1] = {0};
                for (int i = 0; i <= MINUS; i++)
                    for (int j = 0; j <= MINUS; j++) shares[j] += value[i] * minus_inverse[i * (MINUS + 1) + j];
                for (int a = 0; a <= PLUS; a++) {
                    for (int j = 0; j <= MINUS; j++) block[a][j] += given[s][a] * shares[j];
                    turned[a][0] += given[s][a] * (dx / size);
                    turned[a][1] += given[s][a] * (dy / size);
                }
            }
            for (int a = 0; a <= PLUS; a++) {
                const long i = e * PLUS + a;
                double *row = coupling + i * band + f * MINUS - first[i], sum = 0;
                for (int j = 0; j <= MINUS; j++) row[j] += block[a][j], sum += block[a][j];
                weight[i] += sum;
                for (int c = 0; c < 2; c++) tangent[2 * i + c] += turned[a][c];
            }
        }
    }
    return lost;
}
