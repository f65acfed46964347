// The step of an interface that slides; behind points.c and jump.c. Rigid contact in sweeps: all points at once,
// from the velocities that the tractions of the last sweep leave and the fields at the beginning of the step, until
// tractions settle. The first sweep and the last one, which also writes the fields, are over all points; those between
// are over blocks of points that share a faced node with one whose tractions have changed.

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
    long parts;             // of RUN nodes of the other side
    const long *reach;      // of every block of points: the parts it faces, from the first one to before the last one
    unsigned char *stirred; // parts where forces have changed in the last sweep, and in this one
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
    lanes more[2];  // than before
    _Pragma("omp simd reduction(+:any)")
    for (int l = 0; l < LANES; l++) {
        const double normal = -traction[l], shear = traction[points + l] - load[l];
        const double x = initial[l] - frame[4 * points + l] * (frame[l] * normal + frame[2 * points + l] * shear);
        const double y =
            initial[nodes + l] - frame[4 * points + l] * (frame[points + l] * normal + frame[3 * points + l] * shear);
        more[0][l] = pull[l] - x, more[1][l] = pull[nodes + l] - y;
        pull[l] = x, pull[nodes + l] = y;
        any += fabs(more[0][l]) + fabs(more[1][l]);
    }
    if (any != 0)
        for (int l = 0; l < count; l++) react(f, first + l, more[0][l], more[1][l]);
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
}

// Whether the tractions of a block are others than those that its trial began from; scale: the largest one so far.
INLINE int changed(const struct facing *f, const struct sweeps *s, long first, double *scale)
{
    double most = 0, largest = *scale;
    for (int k = 0; k < 2; k++) {
        const double *now = s->traction + k * filled(f) + first, *then = s->given + k * filled(f) + first;
        _Pragma("omp simd reduction(max:most, largest)")
        for (int l = 0; l < LANES; l++) {
            most = fmax(most, fabs(now[l] - then[l]));
            largest = fmax(largest, fabs(now[l]));
        }
    }
    *scale = largest;
    return most > s->tolerance * largest;
}

#define EACH_BLOCK \
    for (long first = 0, count = f->n < LANES ? f->n : LANES; first < f->n; \
         first += LANES, count = f->n - first < LANES ? f->n - first : LANES)

// Rates of a block, and its trial from them and its tractions.
INLINE int attempt(const struct facing *f, const struct sweeps *s, const struct times *times, const double *number,
               double *fixed, double *const *field, long first, int count, struct points *points, double *result)
{
    rates_of(f, s, first, count);
    for (int k = 0; k < 2; k++)
        memcpy(s->given + k * filled(f) + first, s->traction + k * filled(f) + first, sizeof(lanes));
    return trial_of(f, s, times, number, fixed, field, first, count, points, result);
}

// One sweep, over all blocks or those that changes have reached: how many have changed, -1 for a point that failed.
INLINE long sweep(const struct facing *f, const struct sweeps *s, const struct times *times, const double *number,
                  double *fixed, double *const *field, double *result, int every, double *scale)
{
    unsigned char *before = s->stirred, *now = before + s->parts;
    struct points points;
    long many = 0;
    memcpy(before, now, s->parts);
    memset(now, 0, s->parts);
    EACH_BLOCK {
        const long *reach = s->reach + 2 * (first / LANES);
        if (!every && !memchr(before + reach[0], 1, reach[1] - reach[0])) continue;
        if (!attempt(f, s, times, number, fixed, field, first, (int)count, &points, result)) return -1;
        double *normal = s->traction + first, *shear = s->traction + filled(f) + first;
        EACH_LANE {
            const int closed = points.sigma[l] > 0, stuck = (points.rate[l] == 0) & closed, there = l < count;
            const double v = (points.rate[l] + points.taken[l]) * points.way[0][l] - points.turning[0][l];
            const double held = points.trial_shear[0][l] - points.z[0][l] * (stuck ? 0 : v);
            normal[l] = there ? points.sigma[l] : 0, shear[l] = there & closed ? held : 0;
        }
        pull_of(f, s, first, (int)count);
        if (!changed(f, s, first, scale)) continue;
        memset(now + reach[0], 1, reach[1] - reach[0]);
        many++;
    }
    meet(f, s);
    return many;
}

// Advance fields, velocities and forces; after sweeps `rate` is that of the new velocities. result as in points.c; the
// number of sweeps that settled, 0 if they did not.
long slide(const struct facing *f, const struct sweeps *s, const struct times *times, const double *number,
           double *fixed, double *const *field, double *velocity, double *force, double *result)
{
    const long points_of = filled(f), nodes = points_of + f->m;
    struct points points;
    lanes dissipated = {0};
    double scale = 0;
    result[1] = -1;
    for (long i = 0; i < f->n + f->m; i++) {
        const long node = i < f->n ? i : points_of + i - f->n;
        for (int c = 0; c < 2; c++) s->begun[c * nodes + node] = velocity[f->dofs[i] + c];
    }
    memcpy(s->pull, s->initial, 2 * nodes * sizeof(double));
    clear(f);
    if (s->most) {
        memcpy(s->traction, field[STATE_normal_stress], f->n * sizeof(double));
        memcpy(s->traction + points_of, field[STATE_shear_traction], f->n * sizeof(double));
        EACH_BLOCK {
            pull_of(f, s, first, (int)count);
            changed(f, s, first, &scale);
        }
        meet(f, s);
    }
    long done = 0, many = 1;
    for (; done + 1 < s->most && many; done++) {
        many = sweep(f, s, times, number, fixed, field, result, done == 0, &scale);
        if (many < 0) return 0;
    }
    const int settled = many == 0;
    many = 0;
    EACH_BLOCK {
        const int possible = s->most ? attempt(f, s, times, number, fixed, field, first, (int)count, &points, result)
                                     : trial_of(f, s, times, number, fixed, field, first, (int)count, &points, result);
        if (!possible) return 0;
        settle((int)count, times, number, &points, dissipated);
        store(first, (int)count, field, &points);
        memcpy(s->traction + first, field[STATE_normal_stress] + first, count * sizeof(double));
        memcpy(s->traction + points_of + first, field[STATE_shear_traction] + first, count * sizeof(double));
        pull_of(f, s, first, (int)count);
        many += s->most && changed(f, s, first, &scale);
    }
    meet(f, s);
    if (s->most) EACH_BLOCK rates_of(f, s, first, (int)count);
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
    return settled || many == 0 ? done + 1 : 0;
}
