// The step of a sliding interface; behind points.c and jump.c. Rigid contact in sweeps: all points at once,
// from the velocities after the tractions of the last sweep and the fields at the beginning of the step, until
// tractions converge. The last sweep, which also writes the fields, is over all points; others are over blocks of points
// that share a paired node with one whose tractions have changed. They skip blocks that cannot close: an open point
// remains open, whatever changes, until the other side has changed its velocity by the margin of its trial stress.

// Arrays: component after component (normal and tangents, or x, y and z), points filled up to whole blocks with zeros.
struct sweeps {
    long most;              // largest number of sweeps; 0: the points are not coupled
    double tolerance;
    const double *push;     // velocity per force at the nodes of both sides [m/s/N]
    const double *initial;  // force of the bodies' own initial stress there
    const long *places;       // places of those nodes among the velocities before the step
    double *begun;          // velocities before contact there, but for what `initial` does
    const double *frame;    // of points: COMPONENTS x COMPONENTS, zero without a partner, and weights
    const double *offset;   // of the jump
    const double *load;     // shear traction of the nucleation, of every tangent
    double *jump, *before;  // of the displacement, and, where anything acts, of the velocities before the step
    double *traction;       // normal stress and shear traction
    double *rate;           // of the jump
    long parts;             // of RUN nodes of the other side
    const long *reach;      // of every block of points: of lines the range of parts paired with it, in space its first in `listed`
    unsigned char *changed; // parts where forces have changed in this sweep
    long *upto;             // how many parts before each, and in all, changed in the last one
    const long *listed;     // in space: the parts paired with every block
    const double *spread;   // largest sum of the sizes of a row of B in every block
    double *limit;          // change of velocities on the other side in this step below which every block remains open [m/s]
    unsigned char *ever;    // parts where velocities have changed since the first rates of this step were computed
    double *displaced;      // displacements of the other side
};

#define ROUNDED 1e-9  // part of a velocity that is left to rounding when blocks are skipped

enum { CHANGED = 1, UNSETTLED = 2 };  // flags of changed forces: at all, and beyond the tolerance

INLINE long filled(const struct pairing *f) { return (f->n + LANES - 1) / LANES * LANES; }

#define EACH_BLOCK \
    for (long first = 0, count = f->n < LANES ? f->n : LANES; first < f->n; \
         first += LANES, count = f->n - first < LANES ? f->n - first : LANES)

// Quantities of a block less the mean of its partners, in its frame.
INLINE void relative_motion(const struct pairing *f, const struct sweeps *s, const double *across, long first, int count,
                            const lanes *own, double *local)
{
    const long points = filled(f);
    lanes difference[COMPONENTS];
    for (int l = 0; l < LANES; l++) {
        double mean[COMPONENTS] = {0};
        if (l < count) opposite_mean(f, across, first + l, mean);
        EACH_COMPONENT difference[c][l] = own[c][l] - mean[c];
    }
    for (int k = 0; k < COMPONENTS; k++) {
        const double *frame = s->frame + k * COMPONENTS * points + first;
        EACH_LANE local[k * points + first + l] = ADD(
            frame[l] * difference[0][l], frame[points + l] * difference[1][l], frame[2 * points + l] * difference[2][l]);
    }
}

// A field at the nodes of the other side; its first component at every node is at `places`.
INLINE void gather_opposite(const struct pairing *f, const double *field, const long *places, double *across)
{
    for (long j = 0; j < f->m; j++)
        EACH_COMPONENT across[PLACE(c, j)] = field[places[f->n + j] + c];
}

// J of that field, of a block.
INLINE void jump_of(const struct pairing *f, const struct sweeps *s, const double *field, const long *places,
                    const double *across, long first, int count, double *local)
{
    lanes own[COMPONENTS] = {{0}};
    for (int l = 0; l < count; l++)
        EACH_COMPONENT own[c][l] = field[places[first + l] + c];
    relative_motion(f, s, across, first, count, own, local);
}

// Rates of the jump of a block from the velocities as they are.
INLINE void rates_of(const struct pairing *f, const struct sweeps *s, long first, int count)
{
    const long nodes = filled(f) + f->m;
    lanes own[COMPONENTS];
    EACH_COMPONENT {
        const double *begun = s->begun + c * nodes + first, *push = s->push + c * nodes + first;
        EACH_LANE own[c][l] = begun[l] - push[l] * FORCES(c, first + l);
    }
    relative_motion(f, s, f->across, first, count, own, s->rate);
}

// Forces of the tractions of a block: whether they have changed.
INLINE int update_forces(const struct pairing *f, const struct sweeps *s, long first)
{
    const long points = filled(f);
    const double *traction = s->traction + first, *load = s->load + first, *weight = s->frame + SQUARE * points + first;
    lanes local[COMPONENTS];
    double any = 0;
    EACH_LANE local[0][l] = -traction[l];
    EACH_TANGENT EACH_LANE local[1 + k][l] = traction[(1 + k) * points + l] - load[k * points + l];
    EACH_COMPONENT {
        const double *frame = s->frame + c * points + first;
        _Pragma("omp simd reduction(+:any)")
        for (int l = 0; l < LANES; l++) {
            const double force = weight[l] * ADD(
                frame[l] * local[0][l], frame[COMPONENTS * points + l] * local[1][l],
                frame[2 * COMPONENTS * points + l] * local[2][l]);
            any += fabs(FORCES(c, first + l) - force);
            FORCES(c, first + l) = force;
        }
    }
    return any != 0;
}

// When the tractions of all blocks are known: forces where they have changed on the other side, and velocities there.
// Return the largest change of a velocity.
INLINE double meet(const struct pairing *f, const struct sweeps *s)
{
    const long points = filled(f), nodes = points + f->m;
    double largest = 0;
    for (long part = 0; part < s->parts; part++) {
        if (!s->changed[part]) continue;
        s->ever[part] = 1;
        const long first = part * RUN, end = first + RUN < f->m ? first + RUN : f->m;
        for (long j = first; j < end; j++) react(f, j);
        double square[RUN] = {0};
        EACH_COMPONENT {
            const double *begun = s->begun + c * nodes + points, *push = s->push + c * nodes + points;
            for (long j = first; j < end; j++) {
                const double now = begun[j] + push[j] * BACK(c, j), change = now - ACROSS(c, j);
                square[j - first] += change * change;
                ACROSS(c, j) = now;
            }
        }
        for (int l = 0; l < RUN; l++) largest = fmax(largest, square[l]);
    }
    return sqrt(largest);
}

// Count the parts that have changed, for `reached`, and begin anew.
INLINE void turn(const struct sweeps *s, unsigned char least)
{
    for (long i = 0; i < s->parts; i++) s->upto[i + 1] = s->upto[i] + (s->changed[i] >= least);
    memset(s->changed, 0, s->parts);
}

#if COMPONENTS == 2
#define EACH_PART(first) \
    for (long at = s->reach[2 * ((first) / LANES)], part = at; at < s->reach[2 * ((first) / LANES) + 1]; part = ++at)
#else
#define EACH_PART(first) \
    for (long at = s->reach[(first) / LANES], part; at < s->reach[(first) / LANES + 1] && (part = s->listed[at], 1); at++)
#endif

// Return whether a block is paired with a part of the other side whose forces have changed.
INLINE int reached(const struct sweeps *s, long first)
{
#if COMPONENTS == 2
    const long *reach = s->reach + 2 * (first / LANES);
    return s->upto[reach[1]] > s->upto[reach[0]];
#else
    EACH_PART(first) if (s->upto[part + 1] > s->upto[part]) return 1;
    return 0;
#endif
}

INLINE void mark_changed(const struct sweeps *s, long first, unsigned char how)
{
    EACH_PART(first) s->changed[part] = how > s->changed[part] ? how : s->changed[part];
}

// Return whether tractions of a block differ from the `given` ones beyond the tolerance; scale grows to the largest traction.
INLINE int unconverged(const struct pairing *f, const struct sweeps *s, long first, const lanes *given, double *scale)
{
    double most = 0, largest = *scale;
    for (int k = 0; k < COMPONENTS; k++) {
        const double *now = s->traction + k * filled(f) + first;
        _Pragma("omp simd reduction(max:most, largest)")
        for (int l = 0; l < LANES; l++) {
            most = fmax(most, fabs(now[l] - given[k][l]));
            largest = fmax(largest, fabs(now[l]));
        }
    }
    *scale = largest;
    return most > s->tolerance * largest;
}

// Return whether the first rates of a block are those of the present velocities: it was open in all sweeps, and no part that
// it is paired with has changed.
INLINE int keeps_rates(const struct sweeps *s, long first)
{
    if (!(s->limit[first / LANES] > 0)) return 0;
    EACH_PART(first) if (s->ever[part]) return 0;
    return 1;
}

// Initial values of the step of a block; in sweeps, rates and `given` tractions of the last one.
INLINE void begin(const struct pairing *f, const struct sweeps *s, double *fixed, double *const *field, long first,
                  int count, int has_rates, struct points *points, lanes *given)
{
    const long other = filled(f);
    lanes *const own = (lanes *)(fixed + first * FIXED_COUNT);
    points->fixed = (const lanes *)own;
    load(first, count, field, points);
    if (s->most) {
        if (!has_rates) rates_of(f, s, first, count);
        for (int k = 0; k < COMPONENTS; k++) memcpy(given[k], s->traction + k * other + first, sizeof(lanes));
        memcpy(own[FIXED_normal_stress_0], given[0], sizeof(lanes));
        EACH_TANGENT memcpy(own[FIXED_shear_traction_0 + k], given[1 + k], sizeof(lanes));
    }
    for (int k = 0; k < COMPONENTS; k++) {
        memcpy(points->jump[k], s->jump + k * other + first, sizeof(lanes));
        memcpy(points->velocity[k], s->rate + k * other + first, sizeof(lanes));
    }
}

// Return whether a block has no pressure, and had none in the last sweep: it needs no friction law then.
INLINE int open(const struct times *times, const double *number, struct points *points, const lanes *given)
{
    UNPACK_TIMES
    double any = 0;
    EACH_LANE {
        points->opening[l] = points->jump[0][l] + FIXED(gap);
        TRIAL
    }
    _Pragma("omp simd reduction(+:any)")
    for (int l = 0; l < LANES; l++)
        any += !(points->trial_normal[l] < 0) + ADD(given[0][l] != 0, given[1][l] != 0, given[2][l] != 0);
#if BONDED
    EACH_LANE any += OLD(damage) < 1;
#endif
    return any == 0;
}

// Set the limit of an open block. Its rates may differ from those of the trial by what the other side has changed since
// `changed`; the trial stress falls by the impedance times the opening velocity (`ContactMethod.sweeps_to`).
INLINE void keep_open(const struct sweeps *s, const struct points *points, long first, int count, double changed, double fastest)
{
    double least = INFINITY;
    for (int l = 0; l < count; l++) least = fmin(least, -points->trial_normal[l] / FIXED(normal_impedance));
    const double spread = s->spread[first / LANES];
    s->limit[first / LANES] = changed + ((1 - ROUNDED) * least - ROUNDED * (1 + spread) * fastest) / spread;
}

// Find blocks that remain open at any velocities of a size, `fastest`, of both sides; the forces on open points are those of a
// nucleation.
INLINE void find_open(const struct pairing *f, const struct sweeps *s, const struct times *times, const double *number,
                      double *fixed, double *const *field, double fastest)
{
    const long nodes = filled(f) + f->m;
    struct points whole, *const points = &whole;
    lanes given[COMPONENTS];
    EACH_BLOCK {
        double pushed = 0;
        EACH_COMPONENT {
            const double *push = s->push + c * nodes + first;
            for (int l = 0; l < count; l++) pushed = fmax(pushed, fabs(push[l] * FORCES(c, first + l)));
        }
        const double closing = (1 + s->spread[first / LANES]) * fastest + COMPONENTS * pushed;
        begin(f, s, fixed, field, first, (int)count, 1, points, given);
        EACH_LANE points->velocity[0][l] = -closing;
        s->limit[first / LANES] = 0;
        if (open(times, number, points, given)) keep_open(s, points, first, (int)count, 0, fastest);
    }
}

// One sweep, over all blocks or those that changes have reached: how many have changed, -1 for a point that failed.
// `moved` is the sum of the largest changes of velocities on the other side. The first sweep, over all blocks, has their rates.
INLINE long sweep(const struct pairing *f, const struct sweeps *s, const struct times *times, const double *number,
                  double *fixed, double *const *field, double *result, int every, double *scale, double fastest, double *moved)
{
    struct points whole, *const points = &whole;
    lanes given[COMPONENTS];
    long many = 0;
    turn(s, UNSETTLED);
    EACH_BLOCK {
        if (*moved < s->limit[first / LANES] || (!every && !reached(s, first))) continue;
        begin(f, s, fixed, field, first, (int)count, every, points, given);
        if (open(times, number, points, given)) {
            keep_open(s, points, first, (int)count, *moved, fastest);
            continue;
        }
        s->limit[first / LANES] = 0;
        point(times, number, points);
        if (failed(first, (int)count, points, result)) return -1;
        double *normal = s->traction + first, *shear = normal + filled(f);
        EACH_LANE normal[l] = l < count ? points->sigma[l] : 0;
        EACH_TANGENT EACH_LANE shear[k * filled(f) + l] = l < count ? NEW(shear_traction + k) : 0;
        if (!update_forces(f, s, first)) continue;
        const int more = unconverged(f, s, first, given, scale);
        mark_changed(s, first, more ? UNSETTLED : CHANGED);
        many += more;
    }
    *moved += meet(f, s);
    return many;
}

// Tractions of some points from the fields.
INLINE void remember(const struct pairing *f, const struct sweeps *s, double *const *field, long first, long count)
{
    memcpy(s->traction + first, field[STATE_normal_stress] + first, count * sizeof(double));
    EACH_TANGENT
        memcpy(s->traction + (1 + k) * filled(f) + first, field[STATE_shear_traction + k] + first, count * sizeof(double));
}

// Velocities before contact at the nodes of both sides, and the tractions of the step before, from which sweeps begin.
// Return the largest traction; `fastest` is the largest velocity before contact, `moved` as in `sweep`.
INLINE double start(const struct pairing *f, const struct sweeps *s, double *const *field, const double *displacement,
                    const double *velocity, double *fastest, double *moved)
{
    const long points = filled(f), nodes = points + f->m;
    const lanes none[COMPONENTS] = {{0}};
    double scale = 0, largest = 0;
    // Nodes are far apart in memory: all are prefetched before the first is needed.
    for (long i = 0; i < f->n + f->m; i++) __builtin_prefetch(displacement + f->dofs[i]);
    for (long i = 0; i < f->n + f->m; i++) {
        const long node = i < f->n ? i : points + i - f->n;
        double square = 0;
        EACH_COMPONENT {
            const long at = c * nodes + node;
            const double begun = velocity[f->dofs[i] + c] + s->push[at] * s->initial[at];
            s->begun[at] = begun;
            square += begun * begun;
        }
        largest = square > largest ? square : largest;
    }
    *fastest = sqrt(largest), *moved = 0;
    memset(s->limit, 0, points / LANES * sizeof(double));
    gather_opposite(f, displacement, f->dofs, s->displaced);
    memset(s->changed, 0, s->parts);
    EACH_COMPONENT {
        for (long i = 0; i < points; i++) FORCES(c, i) = 0;
        for (long j = 0; j < f->m; j++) BACK(c, j) = 0, ACROSS(c, j) = s->begun[c * nodes + points + j];
    }
    if (s->most) {
        remember(f, s, field, 0, f->n);
        EACH_BLOCK {
            unconverged(f, s, first, none, &scale);
            if (update_forces(f, s, first)) mark_changed(s, first, CHANGED);
        }
        *moved = meet(f, s);
    }
    memset(s->ever, 0, s->parts);
    // One pass over the rows of B for both.
    EACH_BLOCK {
        jump_of(f, s, displacement, f->dofs, s->displaced, first, (int)count, s->jump);
        if (s->most) rates_of(f, s, first, (int)count);
    }
    for (long i = 0; i < COMPONENTS * points; i++) s->jump[i] += s->offset[i];
    return scale;
}

// Velocities and forces after contact.
INLINE void leave(const struct pairing *f, const struct sweeps *s, double *velocity, double *force)
{
    const long points = filled(f), nodes = points + f->m;
    for (long i = 0; i < f->n + f->m; i++)
        EACH_COMPONENT {
            const long j = i - f->n, at = c * nodes + (i < f->n ? i : points + j);
            const double contact = i < f->n ? -FORCES(c, i) : BACK(c, j);
            const double pull = s->initial[at] + contact;
            if (pull == 0) continue;
            velocity[f->dofs[i] + c] = s->begun[at] + s->push[at] * contact;
            force[f->dofs[i] + c] += pull;
        }
}

// Return whether tractions act between a block and its partners.
INLINE int acts(const struct pairing *f, const struct sweeps *s, long first)
{
    const long points = filled(f);
    const double *normal = s->traction + first, *shear = normal + points, *load = s->load + first;
    double any = 0;
    EACH_TANGENT
        _Pragma("omp simd reduction(+:any)")
        for (int l = 0; l < LANES; l++) any += (normal[l] != 0) + (shear[k * points + l] != 0) + (load[k * points + l] != 0);
    return any != 0;
}

// Work of the tractions on the rates of the jump, converged or not: dissipation by friction and work of impacts
// [J]; and the largest slip rate.
INLINE void work_of(const struct pairing *f, const struct sweeps *s, double kick, const double *fixed, double *result)
{
    const long points = filled(f);
    double shear = 0, normal = 0, fastest = 0;
    for (long first = 0; first < f->n; first += LANES) {
        const double *area = fixed + first * FIXED_COUNT + FIXED_owned_area * LANES, *traction = s->traction + first;
        const double *before = s->before + first, *now = s->rate + first;
        _Pragma("omp simd reduction(+:shear, normal) reduction(max:fastest)")
        for (int l = 0; l < LANES; l++) {
            normal += area[l] * traction[l] * (before[l] + now[l]);
            double power = 0, square = 0;
            EACH_TANGENT {
                const long at = (1 + k) * points + l;
                power += area[l] * traction[at] * (before[at] + now[at]);
                square += now[at] * now[at];
            }
            shear += power;
            fastest = fmax(fastest, sqrt(square));
        }
    }
    result[0] = 0.5 * kick * shear, result[6] = -0.5 * kick * normal, result[7] = fastest;
}

// Advance fields, velocities and forces; `before` holds the velocities before the step, `rate` is after sweeps that of
// the new ones. result as in points.c, [6] and [7] as in work_of; returns the sweeps until convergence, 0 without.
long slide(const struct pairing *f, const struct sweeps *s, const struct times *times, const double *number,
           double *fixed, double *const *field, const double *displacement, const double *before, double *velocity,
           double *force, double *result)
{
    struct points points;
    lanes dissipated = {0}, given[COMPONENTS] = {{0}};
    double fastest, moved, scale = start(f, s, field, displacement, velocity, &fastest, &moved);
    result[0] = 0, result[1] = -1;
    long done = 0, many = 1;
    if (s->most > 1) find_open(f, s, times, number, fixed, field, fastest);
    for (; done + 1 < s->most && many; done++) {
        many = sweep(f, s, times, number, fixed, field, result, done == 0, &scale, fastest, &moved);
        if (many < 0) return 0;
    }
    const int settled = many == 0;
    many = 0;
    turn(s, CHANGED);
    EACH_BLOCK {
        begin(f, s, fixed, field, first, (int)count, keeps_rates(s, first), &points, given);
        point(times, number, &points);
        if (failed(first, (int)count, &points, result)) return 0;
        write_back((int)count, times, number, &points, dissipated);
        store(first, (int)count, field, &points);
        remember(f, s, field, first, count);
        if (!update_forces(f, s, first)) continue;
        many += s->most && unconverged(f, s, first, given, &scale);
        mark_changed(s, first, CHANGED);
    }
    meet(f, s);
    leave(f, s, velocity, force);
    turn(s, CHANGED);
    // Blocks without a changed partner have the rates of the last sweep still.
    if (s->most) EACH_BLOCK if (!s->parts || reached(s, first)) rates_of(f, s, first, (int)count);
    gather_opposite(f, before, s->places, f->across);
    EACH_BLOCK if (!s->most || acts(f, s, first)) jump_of(f, s, before, s->places, f->across, first, (int)count, s->before);
    if (s->most) work_of(f, s, times->kick, fixed, result);
    else for (int l = 0; l < LANES; l++) result[0] += dissipated[l];
    return settled || many == 0 ? done + 1 : 0;
}
