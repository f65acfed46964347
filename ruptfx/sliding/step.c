// The step of an interface that slides; behind points.c and jump.c. Rigid contact in sweeps: all points at once,
// from the velocities that the tractions of the last sweep leave and the fields at the beginning of the step, until
// tractions settle. Sweeps but the last one pass over blocks of points that carry nothing.

// Arrays: component after component (normal and tangential, or x and y), points filled up to whole blocks with zeros.
struct sweeps {
    long most;              // 0: the points do not depend on each other, and start from `given`
    double tolerance;
    const double *push;     // velocity per force at the nodes of both sides [m/s/N]
    const double *initial;  // force of the bodies' own initial stress there
    double *begun, *pull;   // velocities before contact there, and its forces
    const double *frame;    // of points: 2 x 2, zero where nothing is faced, and weights
    const double *jump;     // of the displacement
    const double *load;     // shear traction of the nucleation
    double *traction;       // normal stress and shear traction
    double *given, *rate;   // stresses, and rates of the jump, that a trial begins from
    unsigned char *idle;    // blocks of points that carry nothing
};

INLINE long filled(const struct facing *f) { return (f->n + LANES - 1) / LANES * LANES; }

// Trial and projection of the points of a block: whether all of them have an admissible traction.
INLINE int trial_of(const struct facing *f, const struct sweeps *s, const struct times *times, const double *number,
                    double *fixed, double *const *field, long first, int count, struct points *points,
                    double *result)
{
    const long other = filled(f);
    lanes *const own = (lanes *)(fixed + first * FIXED_COUNT);
    points->fixed = (const lanes *)own;
    load(first, count, field, points);
    memcpy(own[FIXED_normal_stress_0], s->given + first, sizeof(lanes));
    memcpy(own[FIXED_shear_traction_0], s->given + other + first, sizeof(lanes));
    for (int k = 0; k < 2; k++) {
        memcpy(points->jump[k], s->jump + k * other + first, sizeof(lanes));
        memcpy(points->velocity[k], s->rate + k * other + first, sizeof(lanes));
    }
    point(times, number, points);
    return !failed(first, count, points, result);
}

// Rates of the jump of a block from the velocities as they are.
INLINE void rates_of(const struct facing *f, const struct sweeps *s, long first, int count)
{
    const long points = filled(f), nodes = points + f->m;
    const double *begun = s->begun + first, *push = s->push + first, *pull = s->pull + first, *frame = s->frame + first;
    double *normal = s->rate + first, *shear = s->rate + points + first;
    lanes mean[2] = {{0}};
    for (int l = 0; l < count; l++) {
        double of_point[2];
        faced(f, first + l, of_point);
        mean[0][l] = of_point[0], mean[1][l] = of_point[1];
    }
    EACH_LANE {
        const double x = begun[l] + push[l] * pull[l] - mean[0][l];
        const double y = begun[nodes + l] + push[nodes + l] * pull[nodes + l] - mean[1][l];
        normal[l] = frame[l] * x + frame[points + l] * y;
        shear[l] = frame[2 * points + l] * x + frame[3 * points + l] * y;
    }
}

// Forces of the tractions of a block, on its own nodes and on those it faces.
INLINE void pull_of(const struct facing *f, const struct sweeps *s, long first, int count)
{
    const long points = filled(f), nodes = points + f->m;
    const double *traction = s->traction + first, *load = s->load + first, *initial = s->initial + first;
    const double *frame = s->frame + first;
    double *pull = s->pull + first, any = 0;
    lanes force[2];
    _Pragma("omp simd reduction(+:any)")
    for (int l = 0; l < LANES; l++) {
        const double normal = -traction[l], shear = traction[points + l] - load[l];
        const double x = frame[4 * points + l] * (frame[l] * normal + frame[2 * points + l] * shear);
        const double y = frame[4 * points + l] * (frame[points + l] * normal + frame[3 * points + l] * shear);
        pull[l] = initial[l] - x;
        pull[nodes + l] = initial[nodes + l] - y;
        force[0][l] = x, force[1][l] = y;
        any += fabs(x) + fabs(y);
    }
    s->idle[first / LANES] = any == 0;
    if (any != 0)
        for (int l = 0; l < count; l++) react(f, first + l, force[0][l], force[1][l]);
}

// When the tractions of all blocks are known: forces on the nodes they face, and the velocities of these.
INLINE void meet(const struct facing *f, const struct sweeps *s)
{
    const long points = filled(f), nodes = points + f->m;
    for (int c = 0; c < 2; c++) {
        const long of_x = c * (f->m + f->columns), of = c * nodes + points;
        const double *back = f->back + of_x, *initial = s->initial + of, *begun = s->begun + of, *push = s->push + of;
        double *across = f->across + of_x, *pull = s->pull + of;
        _Pragma("omp simd") for (long j = 0; j < f->m; j++) {
            pull[j] = initial[j] + back[j];
            across[j] = begun[j] + push[j] * pull[j];
        }
    }
    clear(f);
}

#define EACH_BLOCK \
    for (long first = 0, count = f->n < LANES ? f->n : LANES; first < f->n; \
         first += LANES, count = f->n - first < LANES ? f->n - first : LANES)

// One sweep, over all blocks or those that carry something: whether the tractions have settled; -1 where that is not
// known of blocks passed over, -2 for a point that failed.
INLINE int sweep(const struct facing *f, const struct sweeps *s, const struct times *times, const double *number,
                 double *fixed, double *const *field, double *result, int every)
{
    const long points_of = filled(f);
    lanes change = {0}, largest = {0};
    struct points points;
    int skipped = 0;
    EACH_BLOCK {
        if (s->idle[first / LANES] && !every) {
            skipped = 1;
            continue;
        }
        double *normal = s->traction + first, *shear = s->traction + points_of + first;
        rates_of(f, s, first, (int)count);
        memcpy(s->given + first, normal, sizeof(lanes));
        memcpy(s->given + points_of + first, shear, sizeof(lanes));
        if (!trial_of(f, s, times, number, fixed, field, first, (int)count, &points, result)) return -2;
        EACH_LANE {
            const int closed = points.sigma[l] > 0, stuck = (points.rate[l] == 0) & closed, there = l < count;
            const double v = (points.rate[l] + points.taken[l]) * points.way[0][l] - points.turning[0][l];
            const double held = points.trial_shear[0][l] - points.z[0][l] * (stuck ? 0 : v);
            const double sigma = there ? points.sigma[l] : 0, tau = there & closed ? held : 0;
            const double more = fabs(sigma - normal[l]), moved = fabs(tau - shear[l]);
            change[l] = more > change[l] ? more : change[l];
            change[l] = moved > change[l] ? moved : change[l];
            largest[l] = sigma > largest[l] ? sigma : largest[l];
            largest[l] = fabs(tau) > largest[l] ? fabs(tau) : largest[l];
            normal[l] = sigma, shear[l] = tau;
        }
        pull_of(f, s, first, (int)count);
    }
    meet(f, s);
    double most = 0, scale = 0;
    for (int l = 0; l < LANES; l++) {
        most = change[l] > most ? change[l] : most;
        scale = largest[l] > scale ? largest[l] : scale;
    }
    return most > s->tolerance * scale ? 0 : skipped ? -1 : 1;
}

// Advance fields, velocities and forces; after sweeps `rate` is that of the new velocities. result as in points.c; the
// number of sweeps that settled, 0 if they did not.
long slide(const struct facing *f, const struct sweeps *s, const struct times *times, const double *number,
           double *fixed, double *const *field, double *velocity, double *force, double *result)
{
    const long points_of = filled(f), nodes = points_of + f->m;
    struct points points;
    lanes dissipated = {0};
    long settled = 0;
    result[1] = -1;
    for (long i = 0; i < f->n + f->m; i++) {
        const long node = i < f->n ? i : points_of + i - f->n;
        for (int c = 0; c < 2; c++) s->begun[c * nodes + node] = velocity[f->dofs[i] + c];
    }
    clear(f);
    if (s->most) {
        memcpy(s->traction, field[STATE_normal_stress], f->n * sizeof(double));
        memcpy(s->traction + points_of, field[STATE_shear_traction], f->n * sizeof(double));
        EACH_BLOCK pull_of(f, s, first, (int)count);
        meet(f, s);
    }
    int done = 0;
    for (long at = 0; at < s->most && !settled; at++) {
        done = sweep(f, s, times, number, fixed, field, result, done == -1 || at + 1 == s->most);
        if (done == -2) return 0;
        settled = done == 1 ? at + 1 : 0;
    }
    EACH_BLOCK {
        if (!trial_of(f, s, times, number, fixed, field, first, (int)count, &points, result)) return 0;
        settle((int)count, times, number, &points, dissipated);
        store(first, (int)count, field, &points);
        if (s->most) continue;
        memcpy(s->traction + first, field[STATE_normal_stress] + first, count * sizeof(double));
        memcpy(s->traction + points_of + first, field[STATE_shear_traction] + first, count * sizeof(double));
        pull_of(f, s, first, (int)count);
    }
    if (s->most) EACH_BLOCK rates_of(f, s, first, (int)count);
    else meet(f, s);
    for (long i = 0; i < f->n + f->m; i++) {
        const long node = i < f->n ? i : points_of + i - f->n;
        for (int c = 0; c < 2; c++) {
            const double pull = s->pull[c * nodes + node];
            velocity[f->dofs[i] + c] += s->push[c * nodes + node] * pull;
            force[f->dofs[i] + c] += pull;
        }
    }
    result[0] = 0;
    for (int l = 0; l < LANES; l++) result[0] += dissipated[l];
    return settled;
}
