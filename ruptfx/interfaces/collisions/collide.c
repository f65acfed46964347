// Forces between triangles that overlap, from the potential phi = 3 min(l_1, l_2, l_3) of either, and friction.  Corners
// are x, y of three nodes; a pair is computed in the order of its cells, so that any rank finds the same bits.  step.py
// writes in front of this file return_map.c and, for a law with rates or states (RATED), rated.c with its traced formulas.
#include <string.h>

#if RATED
#define GIVE_LAW , &law, number
#define LAW , struct rated *law, const double *number
#else
#define GIVE_LAW
#define LAW
#endif

struct triangle { const double *x; double inverse, sense; };  // 1 / twice the area, of the sign of its sense

static struct triangle triangle_of(const double *x)
{
    const double twice = (x[2] - x[0]) * (x[5] - x[1]) - (x[4] - x[0]) * (x[3] - x[1]);
    return (struct triangle){x, 1 / twice, twice < 0 ? -1 : 1};
}

static void barycentric(const struct triangle *t, const double *p, double *l)
{
    const double *x = t->x;
    l[0] = ((x[2] - p[0]) * (x[5] - p[1]) - (x[4] - p[0]) * (x[3] - p[1])) * t->inverse;
    l[1] = ((x[4] - p[0]) * (x[1] - p[1]) - (x[0] - p[0]) * (x[5] - p[1])) * t->inverse;
    l[2] = 1 - l[0] - l[1];
}

static double smallest(const double *l)
{
    const double two = l[0] < l[1] ? l[0] : l[1];
    return two < l[2] ? two : l[2];
}

// Part of a side, from l[0] to l[1] in barycentric coordinates, inside of the triangle: integrals of phi and phi t.
static int side_moments(const double l[2][3], double *moment)
{
    double begin = 0, end = 1, at[5];
    for (int k = 0; k < 3; k++) {
        const double first = l[0][k], last = l[1][k];
        if (first < 0 && last < 0) return 0;
        if (first < 0) begin = fmax(begin, first / (first - last));
        if (last < 0) end = fmin(end, first / (first - last));
    }
    if (begin >= end) return 0;
    int count = 0;
    at[count++] = begin;
    for (int k = 0; k < 3; k++) {  // where another coordinate becomes the smallest
        const int m = (k + 1) % 3;
        const double first = l[0][k] - l[0][m], last = l[1][k] - l[1][m], t = first / (first - last);
        if (t > begin && t < end) {
            int place = count++;
            while (at[place - 1] > t) at[place] = at[place - 1], place--;
            at[place] = t;
        }
    }
    at[count] = end;
    moment[0] = moment[1] = 0;
    for (int piece = 0; piece < count; piece++) {  // linear in each piece: Simpson's rule is exact
        const double a = at[piece], b = at[piece + 1], t[3] = {a, 0.5 * (a + b), b}, weight[3] = {1, 4, 1};
        for (int q = 0; q < 3; q++) {
            double here[3];
            for (int k = 0; k < 3; k++) here[k] = l[0][k] + t[q] * (l[1][k] - l[0][k]);
            const double phi = 3 * smallest(here) * weight[q] * (b - a) / 6;
            moment[0] += phi;
            moment[1] += phi * t[q];
        }
    }
    return 1;
}

// Forces of the sides of a in the potential of b; their weighted middle is added to centre (x, y, weight).
static void push(const struct triangle *a, const struct triangle *b, double modulus, double *force_a, double *force_b,
                 double *centre)
{
    double l[3][3];
    for (int i = 0; i < 3; i++) barycentric(b, a->x + 2 * i, l[i]);
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3;
        double both[2][3], moment[2];
        memcpy(both[0], l[i], sizeof l[i]);
        memcpy(both[1], l[j], sizeof l[j]);
        if (!side_moments(both, moment)) continue;
        const double *p = a->x + 2 * i, *q = a->x + 2 * j, dx = q[0] - p[0], dy = q[1] - p[1];
        const double out[2] = {modulus * a->sense * dy, -modulus * a->sense * dx};  // normal times length
        for (int c = 0; c < 2; c++) {
            force_a[2 * i + c] -= out[c] * (moment[0] - moment[1]);
            force_a[2 * j + c] -= out[c] * moment[1];
            for (int k = 0; k < 3; k++)
                force_b[2 * k + c] += out[c] * (l[i][k] * moment[0] + (l[j][k] - l[i][k]) * moment[1]);
        }
        const double weight = modulus * sqrt(dx * dx + dy * dy);
        centre[0] += weight * (p[0] * moment[0] + dx * moment[1]);
        centre[1] += weight * (p[1] * moment[0] + dy * moment[1]);
        centre[2] += weight * moment[0];
    }
}

// Friction across the force on a; `moved` are displacements since the last time.  Returns the dissipation.  A law with rates or
// states has the force per thickness between two cells as its normal stress.
static double rub(const struct triangle *a, const struct triangle *b, const double *moved_a, const double *moved_b,
                  double stiffness, double friction, const double *centre, double *traction, double *force_a,
                  double *force_b LAW)
{
    const double before = *traction;
    const double fx = force_a[0] + force_a[2] + force_a[4], fy = force_a[1] + force_a[3] + force_a[5];
    const double normal = sqrt(fx * fx + fy * fy);
    if (!(normal > 0) || !(centre[2] > 0)) {
        *traction = 0;
        return 0.5 * before * before / stiffness;
    }
    const double along[2] = {-fy / normal, fx / normal}, at[2] = {centre[0] / centre[2], centre[1] / centre[2]};
    double la[3], lb[3], slid = 0;
    barycentric(a, at, la);
    barycentric(b, at, lb);
    for (int k = 0; k < 3; k++)
        for (int c = 0; c < 2; c++)
            slid += along[c] * (la[k] * moved_a[2 * k + c] - lb[k] * moved_b[2 * k + c]);
    const double trial = before + stiffness * slid;
#if RATED
    (void)friction;
    law->normal_stress = normal;
    begin_friction(law, number);
    // Springs let the slip rate differ from that of the cells. Where strength falls with it by more than half of z this difference
    // grows from step to step by -slope / (z + slope) > 1: the strength is then that at the rate of the cells.
    const double z = stiffness * law->since;
    double strength, slope, rate = 0;
    if (law->since > 0) {
        strength = friction_at(law, number, fabs(slid) / law->since, &slope);
        if (2 * slope + z < 0) rate = fmax(fabs(trial) - strength, 0) / z;
        else if (fabs(trial) > friction_at(law, number, 0, &slope))
            rate = solve_slip_rate(law, number, fabs(trial), z, &strength);
    }
    const double now = rate == 0 ? trial : copysign(fabs(trial) - z * rate, trial);
    advance_friction(law, number, rate);
#else
    const double now = admissible_shear(trial, friction * normal);
#endif
    *traction = now;
    for (int k = 0; k < 3; k++)
        for (int c = 0; c < 2; c++) {
            force_a[2 * k + c] -= now * along[c] * la[k];
            force_b[2 * k + c] += now * along[c] * lb[k];
        }
    return 0.5 * (before + now) * (slid - (now - before) / stiffness);
}

// -- energy ---------------------------------------------------------------------------------------------------------

struct polygon { int count; double x[16][2]; };

// The part of a polygon where the linear function value[0] l_0 + value[1] l_1 + value[2] l_2 is not negative.
static void cut(struct polygon *p, const struct triangle *t, const double *value)
{
    struct polygon old = *p;
    double f[16];
    for (int i = 0; i < old.count; i++) {
        double l[3];
        barycentric(t, old.x[i], l);
        f[i] = value[0] * l[0] + value[1] * l[1] + value[2] * l[2];
    }
    p->count = 0;
    for (int i = 0; i < old.count; i++) {
        const int j = (i + 1) % old.count;
        if (f[i] >= 0) memcpy(p->x[p->count++], old.x[i], sizeof old.x[i]);
        if ((f[i] < 0) != (f[j] < 0))
            for (int c = 0; c < 2; c++) {
                p->x[p->count][c] = old.x[i][c] + (old.x[j][c] - old.x[i][c]) * f[i] / (f[i] - f[j]);
                if (c == 1) p->count++;
            }
    }
}

// Integral of the potential of b over its overlap with a.
static double shared(const struct triangle *a, const struct triangle *b)
{
    static const double inside[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    struct polygon whole = {.count = 3};
    memcpy(whole.x, a->x, 6 * sizeof(double));
    for (int k = 0; k < 3; k++) cut(&whole, b, inside[k]);
    double sum = 0;
    for (int k = 0; k < 3; k++) {  // where l_k is the smallest, phi = 3 l_k is linear
        struct polygon part = whole;
        for (int m = 0; m < 3; m++) {
            double value[3] = {0};
            value[m] += 1;
            value[k] -= 1;
            if (m != k) cut(&part, b, value);
        }
        for (int i = 1; i + 1 < part.count; i++) {
            const double *p = part.x[0], *q = part.x[i], *r = part.x[i + 1];
            const double twice = (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1]);
            const double middle[2] = {(p[0] + q[0] + r[0]) / 3, (p[1] + q[1] + r[1]) / 3};
            double l[3];
            barycentric(b, middle, l);
            sum += 0.5 * fabs(twice) * 3 * l[k];
        }
    }
    return sum;
}

static double overlap(const struct triangle *a, const struct triangle *b, double modulus, double rest_a, double rest_b)
{
    const double found = rest_b * fabs(b->inverse) * shared(a, b) + rest_a * fabs(a->inverse) * shared(b, a);
    return modulus * fmax(found, 0);  // rounding may take it below
}

// -- what Python calls ----------------------------------------------------------------------------------------------

// Factor of the force of a pair.  It is 1 unless contact begins or ends between two steps: a force that is linear
// in the depth d does the work of the energy, over steps of length |done| / force, if its factor is a half at d = 0.
static double share(double energy, double done)
{
    const double depth = 2 * energy / fabs(done);  // over the way of a step
    return depth < 1 ? 0.5 * (1 + depth) : 1;
}

// Forces of all pairs [pair][2], cells [cell][6]; `modulus` of pairs, `rest` twice the initial areas.  `at_rest` is the
// energy E_0 of an initial overlap without forces: such a pair has the energy (sqrt(E) - sqrt(E_0))^2, and E_0 decreases with
// E.  Counted pairs add frictional dissipation to taken, and their energy to stored.  A law with rates or states keeps the normal
// force in `pressure`, and its states.
void collide(long pairs, const int *pair, const double *x, const double *moved, const double *rest,
             const double *modulus, const double *friction, const double *counted, double *at_rest, double *traction,
             double *force, double *taken, double *stored
#if RATED
             , double since, const double *number, double *pressure, double *const *state
#endif
)
{
    for (long n = 0; n < pairs; n++) {
        const int first = pair[2 * n], second = pair[2 * n + 1];
        const double *const moved_a = moved + 6 * first, *const moved_b = moved + 6 * second;
        const struct triangle a = triangle_of(x + 6 * first), b = triangle_of(x + 6 * second);
        double force_a[6] = {0}, force_b[6] = {0}, centre[3] = {0};
        push(&a, &b, modulus[n] * rest[second] * fabs(b.inverse), force_a, force_b, centre);
        push(&b, &a, modulus[n] * rest[first] * fabs(a.inverse), force_b, force_a, centre);
        if (centre[2] > 0) {
            const double now = overlap(&a, &b, modulus[n], rest[first], rest[second]);
            if (now < at_rest[n]) at_rest[n] = now;
            const double beyond = sqrt(now) - sqrt(at_rest[n]), energy = beyond * beyond;
            double part = now > 0 ? beyond / sqrt(now) : 0, done = 0;
            for (int k = 0; k < 6; k++) done += force_a[k] * moved_a[k] + force_b[k] * moved_b[k];
            if (part * done != 0) part *= share(energy, part * done);
            for (int k = 0; k < 6; k++) force_a[k] *= part, force_b[k] *= part;
            *stored += counted[n] * energy;
        } else {
            at_rest[n] = 0;
        }
#if RATED
        struct rated law = {.state = state, .l = (int)n, .since = since, .normal_stress_before = pressure[n]};
#endif
        if (friction[n] > 0 && (centre[2] > 0 || traction[n] != 0))
            *taken += counted[n] * rub(&a, &b, moved_a, moved_b, modulus[n], friction[n], centre, traction + n, force_a,
                                       force_b GIVE_LAW);
#if RATED
        pressure[n] = law.normal_stress;
#endif
        *stored += counted[n] * 0.5 * traction[n] * traction[n] / modulus[n];
        for (int k = 0; k < 6; k++) {
            force[6 * first + k] += force_a[k];
            force[6 * second + k] += force_b[k];
        }
    }
}

// Energies of the overlaps of pairs, initial overlaps included.
void overlaps(long pairs, const int *pair, const double *x, const double *rest, const double *modulus, double *energy)
{
    for (long n = 0; n < pairs; n++) {
        const struct triangle a = triangle_of(x + 6 * pair[2 * n]), b = triangle_of(x + 6 * pair[2 * n + 1]);
        energy[n] = overlap(&a, &b, modulus[n], rest[pair[2 * n]], rest[pair[2 * n + 1]]);
    }
}
