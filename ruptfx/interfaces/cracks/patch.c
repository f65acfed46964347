// Tractions at the inserted ends of one vertex patch, together with the velocities of its components after the step.
//
// The unknowns are the velocity v of every component and the tractions T (normal, shear) of every end, with
//     v = v_free + M sum(+-weight T),    T = P(T + z rate(v)),
// where M is velocity per force, `rate` the jump of v (plus opening / dt in the normal direction: the opening at the end of
// the step over dt), z > 0 any impedance, and P the projection on the tractions that cohesion, contact and friction
// admit. Damage is that of the beginning of the step. The normal law is then a maximal monotone graph, and shear follows
// Coulomb's law at the normal traction that is found with it.
//
// A patch has often more ends than relative motions of components. Their tractions are then not unique, and the matrix
// between them is singular or nearly so, as two facets of one crack have nearly the same normal: Gauss-Seidel sweeps need
// thousands of turns. So a few sweeps serve one or two ends, and the proximal method of multipliers the others (Rockafellar
// 1976): each iteration T' = P(T + rho z rate(v')), where v' are the velocities under T', found by Newton's method on
// piecewise smooth equations in v' with a line search on their energy. The matrix of these is regular for all T, and the
// iterations converge for any rho where the strength in shear does not depend on v'.

#define TOLERANCE 1e-8  // error of the tractions over the tractions and the tensile strength in the patch
#define CLOSED 1e-7     // the same for contact: smaller openings count as closed, so that rounding makes no contradictions
#define SWEEPS 6        // Gauss-Seidel sweeps before Newton's method
#define OUTER 24        // proximal iterations
#define INNER 30        // Newton iterations in each of them
#define LINE 60         // evaluations in a line search
#define SOFTEST 1.0     // bounds of rho, and its value in the first iteration
#define STIFFEST 1e6
#define FIRST 1e3
#define UNKNOWNS (2 * MOST_CORNERS)

// An inserted end between two components of a patch, at the time of the traction.
struct end {
    long at;             // its place in the fields of ends: 2 facet + end
    int minus, plus;     // components
    const struct law *law;
    const double *number;
    double nx, ny, weight, z_normal, z_shear, open, slip, largest, most, cohesive, normal, shear;
};

struct patch {
    int pieces, count;  // components, ends
    double dt, scale;   // the step; traction that tolerances refer to
    double *const *state;
    double (*free)[2], (*push)[2], (*velocity)[2];  // of components: without tractions, velocity per force, present one
    struct end *ends;
};

// Admissible normal traction for a trial one, found with impedance z, on the secant at the end of the step; its derivative.
INLINE double normal_at(const struct end *end, double dt, double z, double trial, double *derivative)
{
    const double tension = end->most, softness = end->largest * z / dt;
    double traction, slope;
    NORMAL_TRACTION
    *derivative = slope;
    return traction;
}

INLINE double shear_strength(const struct end *end, double *const *state, double normal)
{
    return end->cohesive + (normal < 0 ? end->law->friction(end->number, state, end->at, -normal) : 0);
}

// Jump of the velocity at an end along its normal, with opening / dt beyond CLOSED, and along its tangent.
INLINE void rates(const struct patch *p, const struct end *end, const double (*velocity)[2], double rate[2])
{
    const double x = velocity[end->plus][0] - velocity[end->minus][0];
    const double y = velocity[end->plus][1] - velocity[end->minus][1];
    const double slack = CLOSED * p->scale / end->z_normal, closing = end->open / p->dt;
    rate[0] = x * end->nx + y * end->ny + (fabs(closing) > slack ? closing - copysign(slack, closing) : 0);
    rate[1] = x * end->ny - y * end->nx;
}

// Add to velocities what tractions at an end do.
INLINE void exert(const struct patch *p, const struct end *end, double normal, double shear, double (*velocity)[2])
{
    const double fx = end->weight * (normal * end->nx + shear * end->ny);
    const double fy = end->weight * (normal * end->ny - shear * end->nx);
    velocity[end->minus][0] += p->push[end->minus][0] * fx, velocity[end->minus][1] += p->push[end->minus][1] * fy;
    velocity[end->plus][0] -= p->push[end->plus][0] * fx, velocity[end->plus][1] -= p->push[end->plus][1] * fy;
}

// Velocities under the present tractions.
static void respond(struct patch *p)
{
    memcpy(p->velocity, p->free, p->pieces * sizeof *p->free);
    for (int e = 0; e < p->count; e++) exert(p, p->ends + e, p->ends[e].normal, p->ends[e].shear, p->velocity);
}

// P(T + z rate) of an end at the present velocities.
INLINE void project(const struct patch *p, const struct end *end, double found[2])
{
    double rate[2], slope;
    rates(p, end, (const double(*)[2])p->velocity, rate);
    found[0] = end->z_normal > 0
        ? normal_at(end, p->dt, end->z_normal, end->normal + end->z_normal * rate[0], &slope) : 0;
    if (end->z_shear > 0) {
        const double trial = end->shear + end->z_shear * rate[1];
        const double strength = shear_strength(end, p->state, found[0]);
        found[1] = admissible_shear(trial, strength);
    } else found[1] = 0;  // both sides are driven
}

// Largest |T - P(T + z rate)| of all ends; updates the velocities.
static double residual(struct patch *p)
{
    double most = 0;
    respond(p);
    for (int e = 0; e < p->count; e++) {
        const struct end *end = p->ends + e;
        double found[2];
        project(p, end, found);
        most = fmax(most, fabs(found[0] - end->normal) + fabs(found[1] - end->shear));
    }
    return most;
}

// One Gauss-Seidel sweep: normal, then shear traction of one end after the other. Returns the largest change.
static double sweep(struct patch *p)
{
    double most = 0;
    for (int e = 0; e < p->count; e++) {
        struct end *end = p->ends + e;
        double rate[2], slope, normal = 0, shear = 0;
        if (end->z_normal > 0) {
            rates(p, end, (const double(*)[2])p->velocity, rate);
            normal = normal_at(end, p->dt, end->z_normal, end->normal + end->z_normal * rate[0], &slope);
            normal -= end->normal;
            end->normal += normal;
            exert(p, end, normal, 0, p->velocity);
        }
        if (end->z_shear > 0) {
            rates(p, end, (const double(*)[2])p->velocity, rate);
            const double trial = end->shear + end->z_shear * rate[1];
            const double strength = shear_strength(end, p->state, end->normal);
            shear = admissible_shear(trial, strength) - end->shear;
            end->shear += shear;
            exert(p, end, 0, shear, p->velocity);
        }
        most = fmax(most, fabs(normal) + fabs(shear));
    }
    return most;
}

// Solve A x = b in place by elimination with row pivoting; returns 0 for a singular matrix.
static int eliminate(int n, double (*a)[UNKNOWNS], double *b)
{
    for (int k = 0; k < n; k++) {
        int pivot = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(a[i][k]) > fabs(a[pivot][k])) pivot = i;
        if (!(fabs(a[pivot][k]) > 1e-300)) return 0;
        if (pivot != k) {
            for (int j = k; j < n; j++) {
                const double swapped = a[k][j];
                a[k][j] = a[pivot][j], a[pivot][j] = swapped;
            }
            const double swapped = b[k];
            b[k] = b[pivot], b[pivot] = swapped;
        }
        for (int i = k + 1; i < n; i++) {
            const double part = a[i][k] / a[k][k];
            if (part == 0) continue;
            for (int j = k; j < n; j++) a[i][j] -= part * a[k][j];
            b[i] -= part * b[k];
        }
    }
    for (int k = n - 1; k >= 0; k--) {
        for (int j = k + 1; j < n; j++) b[k] -= a[k][j] * b[j];
        b[k] /= a[k][k];
    }
    return 1;
}

// Tractions P(T + rho z rate(v)) of all ends at velocities v, the residual v - v(tractions) of the momentum balance, and its
// derivative unless `matrix` is null. Returns the largest entry of the residual.
static double balance(const struct patch *p, double rho, const double (*v)[2], double (*tractions)[2],
                      double (*missing)[2], double (*matrix)[UNKNOWNS])
{
    double unloaded[MOST_CORNERS][2], most = 0;
    memcpy(unloaded, p->free, p->pieces * sizeof *unloaded);
    if (matrix)
        for (int i = 0; i < 2 * p->pieces; i++)
            for (int j = 0; j < 2 * p->pieces; j++) matrix[i][j] = i == j;
    for (int e = 0; e < p->count; e++) {
        const struct end *end = p->ends + e;
        const double z_normal = rho * end->z_normal, z_shear = rho * end->z_shear;
        double rate[2], slope = 0, normal = 0, shear = 0, across = 0, along = 0, coupling = 0;
        rates(p, end, v, rate);
        if (z_normal > 0) {
            normal = normal_at(end, p->dt, z_normal, end->normal + z_normal * rate[0], &slope);
            across = slope * z_normal;
        }
        if (z_shear > 0) {
            const double trial = end->shear + z_shear * rate[1], strength = shear_strength(end, p->state, normal);
            if (fabs(trial) > strength) {
                shear = copysign(strength, trial);
                if (matrix && normal < 0 && across > 0) {
                    const double step = 1e-6 * (p->scale - normal);
                    const double grown = shear_strength(end, p->state, normal - step);
                    coupling = -copysign((grown - strength) / step, trial) * across;
                }
            } else shear = trial, along = z_shear;
        }
        tractions[e][0] = normal, tractions[e][1] = shear;
        exert(p, end, normal, shear, unloaded);
        if (!matrix) continue;
        const double n[2] = {end->nx, end->ny}, t[2] = {end->ny, -end->nx};
        for (int i = 0; i < 2; i++)
            for (int j = 0; j < 2; j++) {
                const double stiff =
                    end->weight * (n[i] * across * n[j] + t[i] * (along * t[j] + coupling * n[j]));
                const double of_minus = p->push[end->minus][i] * stiff, of_plus = p->push[end->plus][i] * stiff;
                matrix[2 * end->minus + i][2 * end->minus + j] += of_minus;
                matrix[2 * end->minus + i][2 * end->plus + j] -= of_minus;
                matrix[2 * end->plus + i][2 * end->plus + j] += of_plus;
                matrix[2 * end->plus + i][2 * end->minus + j] -= of_plus;
            }
    }
    for (int i = 0; i < p->pieces; i++)
        for (int c = 0; c < 2; c++) {
            missing[i][c] = v[i][c] - unloaded[i][c];
            most = fmax(most, fabs(missing[i][c]));
        }
    return most;
}

// Derivative along -step of the energy whose gradient is the residual over M, where friction does not depend on v.
static double power(const struct patch *p, const double (*missing)[2], const double (*step)[2])
{
    double sum = 0;
    for (int i = 0; i < p->pieces; i++)
        for (int c = 0; c < 2; c++)
            if (p->push[i][c] > 0) sum -= missing[i][c] * step[i][c] / p->push[i][c];
    return sum;
}

// One proximal iteration, from the present tractions and velocities; returns whether Newton's method has converged.
// exact: allowed residual of the momentum balance [m/s].
static int proximal(struct patch *p, double rho, double exact)
{
    double matrix[UNKNOWNS][UNKNOWNS], step[MOST_CORNERS][2], tried[MOST_CORNERS][2], tractions[MOST_ENDS][2];
    double missing[MOST_CORNERS][2];
    int found = 0;
    for (int inner = 0; inner < INNER; inner++) {
        found = balance(p, rho, (const double(*)[2])p->velocity, tractions, missing, matrix) <= exact;
        if (found) break;
        memcpy(step, missing, p->pieces * sizeof *step);
        if (!eliminate(2 * p->pieces, matrix, &step[0][0])) break;
        // To the minimum along the step: bisection in turns with false position.
        const double begun = power(p, (const double(*)[2])missing, (const double(*)[2])step);
        double low = 0, high = 1, at_low = begun, at_high = 0, length = 1;
        for (int tries = 0; tries < LINE; tries++) {
            for (int i = 0; i < p->pieces; i++)
                for (int c = 0; c < 2; c++) tried[i][c] = p->velocity[i][c] - length * step[i][c];
            found = balance(p, rho, (const double(*)[2])tried, tractions, missing, 0) <= exact;
            if (found) break;
            const double slope = power(p, (const double(*)[2])missing, (const double(*)[2])step);
            if (!(begun < 0) || (length == 1 && slope <= 0) || fabs(slope) <= -0.1 * begun) break;
            if (slope > 0) high = length, at_high = slope;
            else low = length, at_low = slope;
            length = tries % 2 ? 0.5 * (low + high) : low + (high - low) * at_low / (at_low - at_high);
        }
        memcpy(p->velocity, tried, p->pieces * sizeof *tried);
        if (found) break;
    }
    for (int e = 0; e < p->count; e++) p->ends[e].normal = tractions[e][0], p->ends[e].shear = tractions[e][1];
    return found;
}

// Keep the tractions with the smallest residual so far, and return that residual.
static double keep_best(const struct patch *p, double found, double best, double (*kept)[2])
{
    if (!(found < best)) return best;
    for (int e = 0; e < p->count; e++) kept[e][0] = p->ends[e].normal, kept[e][1] = p->ends[e].shear;
    return found;
}

// Find the tractions; returns their largest error over `scale`, which grows to the tractions found.
static double solve(struct patch *p)
{
    double found = INFINITY, kept[MOST_ENDS][2], pushed = 0, rho = FIRST;
    respond(p);
    for (int s = 0; s < SWEEPS && !(found <= TOLERANCE * p->scale); s++) found = sweep(p);
    for (int e = 0; e < p->count; e++) {
        const struct end *end = p->ends + e;
        p->scale = fmax(p->scale, fabs(end->normal) + fabs(end->shear));  // of open ends without cohesion, too
        kept[e][0] = end->normal, kept[e][1] = end->shear;
        for (int c = 0; c < 2; c++)
            pushed = fmax(pushed, end->weight * fmax(p->push[end->minus][c], p->push[end->plus][c]));
    }
    const double wanted = TOLERANCE * p->scale;
    if (found <= wanted) return found > 0 ? found / p->scale : 0;
    double best = residual(p);
    for (int outer = 0; outer < OUTER && best > wanted; outer++) {
        rho = proximal(p, rho, 1e-3 * wanted * pushed) ? fmin(10 * rho, STIFFEST) : fmax(0.1 * rho, SOFTEST);
        best = keep_best(p, residual(p), best, kept);
    }
    for (int e = 0; e < p->count; e++) p->ends[e].normal = kept[e][0], p->ends[e].shear = kept[e][1];
    return best / p->scale;
}
