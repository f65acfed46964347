// What a step does at the points of an interface, LANES of them at a time: point (trial and projection) and write_back (what
// is written back). Explicit steps (fault_step.c) and implicit ones (implicit/response.c) go on from here. point_code.py
// writes in front of this file what is known at compile time: COMPONENTS, LOCAL, TANGENTS, NORMAL, ONE_SIDED, AT_END,
// TOLERANCE, BALANCED, AT_REST, MAX_ITERATIONS, BISECT_EVERY, DAMAGED, LANES, where arrays are, the traced formulas of contact method, law and
// monitors, BONDED and the formulas of cohesion, and how a step begins: RADIATION, the traction per slip rate on top of the strength, and GUESS, what makes
// `guess` a slip rate to begin with.
#include <string.h>

// The C library has these for vectors, too, but its headers say so only where NaN may be ignored.
#if defined __x86_64__ && defined __GLIBC__ && !defined __clang__
#define VECTOR __attribute__((simd("notinbranch")))
#if __GLIBC_PREREQ(2, 22)
VECTOR double exp(double), log(double), sin(double), cos(double), pow(double, double);
#endif
#if __GLIBC_PREREQ(2, 35)
VECTOR double expm1(double), log1p(double), exp2(double), log2(double), log10(double), cbrt(double), tan(double);
VECTOR double sinh(double), cosh(double), tanh(double), asin(double), acos(double), atan(double), asinh(double);
VECTOR double acosh(double), atanh(double), hypot(double, double), atan2(double, double);
#endif
#endif

#define EACH_LANE _Pragma("omp simd") for (int l = 0; l < LANES; l++)
#define EACH_TANGENT for (int k = 0; k < TANGENTS; k++)

enum { FIXED_PLACES };  // FIXED_weight = 0, ...
enum { STATE_PLACES };  // STATE_normal_stress = 0, ...
enum { BEGUN_PLACES };  // of the state of the law, known when the step begins

typedef double lanes[LANES];

// kick: how long the traction acts; since: time since the one before; carried: of the slip rate before in that now.
struct times { double dt, kick, since, extrapolation, carried, threshold, time; };

struct points {
    const lanes *fixed;                          // what does not change during a run
    lanes old[STATE_COUNT], new[STATE_COUNT];    // fields at the traction before, and now
    lanes opening, jump[LOCAL], velocity[LOCAL]; // jumps of the bodies
    lanes multiplier[1 + TANGENTS], body_stiffness, radiation, near;  // given to implicit steps
    lanes trial_normal, trial_shear[TANGENTS], compliance, z[TANGENTS], size;
    lanes sigma, rate, taken, way[TANGENTS], turning[TANGENTS];  // V, what of k V_before is along the traction
    lanes rate_now, speed_then;                  // slip rate at the traction, and at the one before
    lanes slope, stress_slope, before_slope;     // of the strength, for implicit steps
    lanes change[LOCAL];                         // traction beyond the initial one
    lanes met;                                   // energy lost by contact that opens or closes within the step [J]
#if BONDED
    lanes tension, bond;                         // strengths that cohesion has left, in tension and shear beyond friction
    lanes fractured;                             // energy it took [J]
    lanes damage;                                // at which they are
#endif
};

// Names in the formulas.
#define FIXED(name) points->fixed[FIXED_##name][l]
#define OLD(name) points->old[STATE_##name][l]
#define NEW(name) points->new[STATE_##name][l]
#define BEGUN(name) begun[BEGUN_##name][l]
#define UNPACK_TIMES \
    const double dt = times->dt, kick = times->kick, since = times->since, extrapolation = times->extrapolation, \
        threshold = times->threshold, time = times->time; \
    (void)dt; (void)kick; (void)since; (void)extrapolation; (void)threshold; (void)time;
#if BONDED
#define TOGETHER(normal_stress) ((normal_stress) > 0 || points->tension[l] > 0 || points->bond[l] > 0)
#define PRESSURE(normal_stress) ((normal_stress) > 0 ? (normal_stress) : 0)
#define GIVEN_BOND const double bond = points->bond[l]; (void)bond;
#else
#define TOGETHER(normal_stress) ((normal_stress) > 0)
#define PRESSURE(normal_stress) (normal_stress)
#define GIVEN_BOND
#endif
#define GIVEN(v) \
    const double slip_rate = v, rate_before = along[l], speed_before = faster[l], \
        normal_stress = PRESSURE(points->sigma[l]), normal_stress_before = PRESSURE(OLD(normal_stress)), \
        radiation = RADIATION; \
    GIVEN_BOND \
    (void)slip_rate; (void)rate_before; (void)speed_before; (void)normal_stress; \
    (void)normal_stress_before; (void)radiation;

// Slip rate of a point that slides, along a tangent.
INLINE double slip_rate_of(const struct points *points, int k, int l)
{
    return (points->rate[l] + points->taken[l]) * points->way[k][l] - points->turning[k][l];
}

#if BONDED
// Strength that a damage leaves, and the normal stress on the secant of the largest opening.
INLINE void hold_at(const double *number, struct points *points, int l, double bond_damage, double largest)
{
    (void)number;
    double left, slope;
    { LEFT }
    left = bond_damage < 1 ? left : 0;
    const double most = TENSILE_STRENGTH * left, softness = largest / points->compliance[l];
    points->tension[l] = most;
    points->bond[l] = COHESION * left;
    points->sigma[l] = 0 - admissible_normal(-points->trial_normal[l], most, softness, &slope);
}

// Cohesion at a known opening and slip, and with it the normal stress (cohesive_interface.py).
INLINE void hold(const struct times *times, const double *number, struct points *points)
{
    UNPACK_TIMES
    EACH_LANE {
        double slid = 0;
        EACH_TANGENT slid += OLD(mean_slip_rate + k) * OLD(mean_slip_rate + k);
        const double before = OLD(largest_opening);
        const double bond_opening = points->opening[l] > before ? points->opening[l] : before;
        const double bond_slip = OLD(damaging_slip) + since * sqrt(slid);
        double damage;
        { DAMAGE }
        NEW(largest_opening) = bond_opening;
        NEW(damaging_slip) = bond_slip;
        NEW(damage) = damage > OLD(damage) ? damage : OLD(damage);
        hold_at(number, points, l, NEW(damage), bond_opening);
    }
}

// Cohesion at `points->damage`, and with it the normal stress, of which opening follows.
INLINE void hold_damaged(const double *number, struct points *points)
{
    EACH_LANE {
        const double before = OLD(largest_opening);
        hold_at(number, points, l, points->damage[l], before);
        const double opened = (points->sigma[l] - points->trial_normal[l]) * points->compliance[l];
        NEW(largest_opening) = opened > before ? opened : before;
    }
}

// The next damages to try; whether there is a point that has to.
INLINE int search_damages(const struct times *times, const double *number, struct points *points, struct damage_search *at)
{
    UNPACK_TIMES
    lanes missing;
    int any = 0;
    EACH_LANE {
        const int stuck = (points->rate[l] == 0) & TOGETHER(points->sigma[l]);
        double square = 0, damage;
        EACH_TANGENT {
            const double v = slip_rate_of(points, k, l);
            square += stuck ? 0 : v * v;
        }
        const double bond_opening = NEW(largest_opening), bond_slip = OLD(damaging_slip) + since * sqrt(square);
        { DAMAGE }
        NEW(damaging_slip) = bond_slip;
        NEW(damage) = points->damage[l];
        missing[l] = (damage > OLD(damage) ? damage : OLD(damage)) - points->damage[l];
    }
    for (int l = 0; l < LANES; l++) {
        if (at[l].calls == 0 || at[l].open) any |= search_damage(at + l, missing[l], DAMAGED, DAMAGED, MAX_ITERATIONS);
        points->damage[l] = at[l].now;
    }
    return any;
}
#endif

// Strengths below this are negative beyond rounding.
#define LEAST_STRENGTH(traction) (-TOLERANCE * (traction))

// The traction that the law admits of a trial, for a normal stress; V is not a number where there is none.
INLINE void project(const struct times *times, const double *number, struct points *points)
{
    UNPACK_TIMES
    const double carried = times->carried;
    lanes shifted[TANGENTS], mean_z, along, faster, rest, low, high, active, begun[BEGUN_COUNT + 1];
    EACH_LANE {
        // What slid the other way has come to rest before it turns.
        double product = 0, square = 0, length = 0, loose = 0, trial_square = 0, shift_square = 0, square_then = 0;
        EACH_TANGENT {
            const double before = OLD(mean_slip_rate + k), shift = carried * points->z[k][l] * before;
            product += before * points->trial_shear[k][l];
            square += before * before;
            shift_square += shift * shift;
            trial_square += points->trial_shear[k][l] * points->trial_shear[k][l];
            square_then += OLD(slip_rate + k) * OLD(slip_rate + k);
        }
        faster[l] = sqrt(square);
        points->speed_then[l] = sqrt(square_then);
        const double turns = product > 0 && (carried > 0 || 4 * shift_square <= trial_square) ? carried : 0;
        EACH_TANGENT {
            points->turning[k][l] = turns * OLD(mean_slip_rate + k);
            shifted[k][l] = points->trial_shear[k][l] + points->z[k][l] * points->turning[k][l];
            length += shifted[k][l] * shifted[k][l];
            const double part = points->z[k][l] > 0 ? shifted[k][l] / points->z[k][l] : 0;
            loose += TANGENTS == 1 ? fabs(part) : part * part;
        }
        const double size = TANGENTS == 1 ? fabs(shifted[0][l]) : sqrt(length);
        double taken = 0;
        along[l] = mean_z[l] = 0;
        EACH_TANGENT {
            const double way = size > 0 ? shifted[k][l] / size : 0;
            along[l] += product > 0 ? OLD(mean_slip_rate + k) * way : 0;
            taken += points->turning[k][l] * way;
            mean_z[l] += way * way * points->z[k][l];
            points->way[k][l] = way;
        }
        points->size[l] = size;
        points->taken[l] = taken;
        high[l] = loose > 0 ? (TANGENTS == 1 ? loose : sqrt(loose)) - taken : 0;  // leaves no traction
    }
    EACH_LANE {
        GIVEN(0)
        BEGIN
    }
    EACH_LANE {
        double strength;
        GIVEN(0)
        STRENGTH
        rest[l] = strength;
    }
    double any = 0;
    _Pragma("omp simd reduction(+:any)")
    for (int l = 0; l < LANES; l++) {
        const double begin = points->size[l] - mean_z[l] * points->taken[l] - rest[l], free_rate = high[l];
        const int closed = TOGETHER(points->sigma[l]), yields = closed && begin > 0 && free_rate > 0;
        double guess = 0;
        GUESS
        const double linear = begin / mean_z[l] < free_rate ? begin / mean_z[l] : free_rate;
        const double first = guess > 0 && guess < free_rate ? guess : linear;
        // Not a number anywhere, or a strength that drives slip: fails.
        const int finite = isfinite(points->size[l] + points->trial_normal[l] + rest[l]);
        const int sound = finite && (!closed || rest[l] >= LEAST_STRENGTH(points->size[l] + points->sigma[l]));
        points->rate[l] = !sound ? (double)NAN : yields ? first : closed ? 0 : free_rate;
        active[l] = sound && yields;
        low[l] = 0;
        if (TANGENTS > 1)
            EACH_TANGENT {
                const double loose = points->z[k][l] > 0 ? shifted[k][l] / points->z[k][l] : 0;
                const double speed = free_rate + points->taken[l];
                points->way[k][l] = closed ? points->way[k][l] : speed > 0 ? loose / speed : 0;
            }
        any += active[l];
    }
    for (int iteration = 0; any > 0; iteration++) {
        const int bisect = iteration % BISECT_EVERY == BISECT_EVERY - 1;
        any = 0;
        _Pragma("omp simd reduction(+:any)")
        for (int l = 0; l < LANES; l++) {
            double strength, slope, rate_now, rate_slope;
            GIVEN(points->rate[l])
            SOLVED
            const double sliding = slip_rate + points->taken[l];
            double residual = points->size[l] - points->z[0][l] * sliding - strength, steep = slope + points->z[0][l];
            if (TANGENTS > 1) {
                double ratio[TANGENTS], square = 0, mean = 0, sum = 0;
                EACH_TANGENT {
                    ratio[k] = shifted[k][l] / (strength + points->z[k][l] * sliding);
                    square += ratio[k] * ratio[k];
                }
                const double norm = sqrt(square);
                EACH_TANGENT {
                    const double d = ratio[k] / norm, q = strength + points->z[k][l] * sliding;
                    points->way[k][l] = active[l] != 0 ? d : points->way[k][l];
                    mean += d * d * q;
                    sum += d * d * (slope + points->z[k][l]) / q;
                }
                residual = mean * (norm - 1);
                steep = mean * sum;
            }
            const double lo = residual > 0 ? slip_rate : low[l], hi = residual > 0 ? high[l] : slip_rate;
            const int rests = hi <= AT_REST && residual == residual;  // its traction is the trial one
            // A law that jumps, or that pulls, has no root where the bracket ends.
            const int ends = hi - lo <= 1e-15 * hi && fabs(residual) <= BALANCED * points->size[l];
            const double done = fabs(residual) <= TOLERANCE * points->size[l] || ends || rests;
            const double go = active[l] != 0 && done == 0;
            const double next = next_rate(slip_rate, lo, hi, residual, steep, mean_z[l], rate_now / rate_slope, bisect);
            low[l] = active[l] != 0 ? lo : low[l];
            high[l] = active[l] != 0 ? hi : high[l];
            // A strength that is not a number must not be taken for a converged one.
            const double moved = residual == residual ? next : (double)NAN;
            const int drives = active[l] != 0 && strength < LEAST_STRENGTH(points->size[l] + points->sigma[l]);
            const double found = drives ? (double)NAN : slip_rate;
            points->rate[l] = go != 0 ? moved : rests && active[l] != 0 ? 0 : found;
            active[l] = go != 0 && residual == residual;
            any += active[l];
        }
        if (iteration < MAX_ITERATIONS) continue;
        EACH_LANE points->rate[l] = active[l] != 0 ? (double)NAN : points->rate[l];
        break;
    }
    EACH_LANE {
        GIVEN(points->rate[l])
        ADVANCED
    }
}

// The trial, and what law and cohesion admit of it.
INLINE void point(const struct times *times, const double *number, struct points *points)
{
    UNPACK_TIMES
    EACH_LANE {
        points->opening[l] = (NORMAL ? points->jump[0][l] : 0) + FIXED(gap);
        TRIAL
        points->sigma[l] = points->trial_normal[l] > 0 ? points->trial_normal[l] : 0;
    }
#if BONDED && AT_END
    // Opening and slip of the step follow from its tractions, and so does the damage.
    struct damage_search at[LANES];
    for (int l = 0; l < LANES; l++) at[l] = (struct damage_search){.now = points->damage[l] = OLD(damage)};
    do {
        hold_damaged(number, points);
        project(times, number, points);
    } while (search_damages(times, number, points, at));
#else
#if BONDED
    hold(times, number, points);
#endif
    project(times, number, points);
#endif
}

// The fields at the traction, and what friction takes [J].
INLINE void write_back(int count, const struct times *times, const double *number, struct points *points, lanes dissipated)
{
    UNPACK_TIMES
    const double duration = AT_END ? since : kick;
    EACH_LANE {
        const double normal_stress = points->sigma[l], speed_then = points->speed_then[l], v = points->rate[l];
        const int closed = TOGETHER(normal_stress), stuck = (v == 0) & closed;
        double power = 0, square = 0, whole = 0;
        if (NORMAL) points->change[0][l] = FIXED(normal_stress_0) - normal_stress;
        EACH_TANGENT {
            const double before = OLD(mean_slip_rate + k), way = points->way[k][l];
            // Bodies start from rest, also where the interface creeps.
            const double rate_old = since > 0 ? before : 0, traction_old = OLD(shear_traction + k);
            double rate = stuck ? 0 : slip_rate_of(points, k, l), taken;
            const double traction = closed ? points->trial_shear[k][l] - points->z[k][l] * rate : 0;
            double rate_now = stuck ? (AT_END ? 0 : 0.5 * before) : points->rate_now[l] * way;
            if (AT_END && since == 0) rate = before, rate_now = OLD(slip_rate + k);
            DISSIPATED
            power += taken;
            square += rate_now * rate_now;
            whole += traction * traction;
            NEW(slip_rate + k) = rate_now;
            NEW(mean_slip_rate + k) = rate;
            NEW(shear_traction + k) = traction;
            NEW(slip + k) = OLD(slip + k) + since * (AT_END ? rate : before);
            points->change[NORMAL + k][l] = traction - FIXED(shear_traction_0 + k);
        }
        const double apart = points->opening[l], speed = sqrt(square);
        NEW(opening) = AT_END ? (normal_stress - points->trial_normal[l]) * points->compliance[l]
                              : OLD(normal_stress) > 0 || apart < 0 ? 0 : apart;
        NEW(normal_stress) = normal_stress;
        const double normal_stress_then = OLD(normal_stress), has_strength = FIXED(has_strength);
        (void)whole, (void)normal_stress_then, (void)has_strength;
#if BONDED && AT_END
        // Mean tractions work between those before and now; cohesion carries its share of both.
        double left, before = 0, broken = 0;
        {
            const double bond_damage = OLD(damage);
            { LEFT }
            left = bond_damage < 1 ? left : 0;
        }
        EACH_TANGENT before += OLD(shear_traction + k) * OLD(shear_traction + k);
        const double share_old = cohesive_share(COHESION * left, sqrt(before)), share_now = cohesive_share(points->bond[l], sqrt(whole));
        EACH_TANGENT {
            const double rate_old = since > 0 ? OLD(mean_slip_rate + k) : 0, rate = NEW(mean_slip_rate + k);
            const double traction_old = share_old * OLD(shear_traction + k);
            const double traction = share_now * NEW(shear_traction + k);
            double taken;
            (void)rate_old, (void)traction_old;
            DISSIPATED
            broken += taken;
        }
        power -= broken;
        // What is elastic, along the secant to the origin too, is stored.
        const double pull_old = 0 - OLD(normal_stress), pull = 0 - normal_stress;
        const double opened = 0.5 * (pull_old + pull) * (NEW(opening) - OLD(opening));
        const double kept = 0.5 * ((pull > 0 ? pull * NEW(opening) : 0) - (pull_old > 0 ? pull_old * OLD(opening) : 0));
        const int pressed = pull_old < 0 || pull < 0;
        const double area = l < count ? FIXED(owned_area) : 0;
        points->fractured[l] = area * (broken * duration + (pressed ? 0 : opened - kept));
        points->met[l] = area * (pressed ? opened - kept : 0);
#elif BONDED
        const double part = cohesive_share(points->bond[l], sqrt(whole));
        points->fractured[l] = l < count ? FIXED(owned_area) * part * power * duration : 0;
        points->met[l] = 0;
        power -= part * power;
#else
        const double mean_stress = AT_END ? 0.5 * (OLD(normal_stress) + normal_stress) : 0;
        points->met[l] = l < count ? FIXED(owned_area) * mean_stress * (OLD(opening) - NEW(opening)) : 0;
#endif
        dissipated[l] += l < count ? FIXED(owned_area) * power * duration : 0;
        (void)speed, (void)speed_then;
        MONITORS
    }
}

// Fixed arrays and nodes fill whole blocks, fields do not: the last point stands in for those that are missing.
INLINE void load(long first, int count, double *const *field, struct points *points)
{
    for (int i = 0; i < STATE_COUNT; i++)
        if (count == LANES) memcpy(points->old[i], field[i] + first, sizeof(lanes));
        else for (int l = 0; l < LANES; l++) points->old[i][l] = field[i][first + (l < count ? l : count - 1)];
}

INLINE void store(long first, int count, double *const *field, const struct points *points)
{
    for (int i = 0; i < STATE_COUNT; i++)
        if (count == LANES) memcpy(field[i] + first, points->new[i], sizeof(lanes));
        else for (int l = 0; l < count; l++) field[i][first + l] = points->new[i][l];
}

// Whether a point has no admissible traction. result: [0] dissipated energy, [1] that point or -1, [2..5] its trial
// normal stress, trial shear, Z, slip rate.
INLINE int failed(long first, int count, const struct points *points, double *result)
{
    for (int l = 0; l < count; l++) {
        if (isfinite(points->rate[l])) continue;
        const double found[] = {
            0, first + l, points->trial_normal[l], points->size[l], points->z[0][l], points->speed_then[l],
        };
        memcpy(result, found, sizeof found);
        return 1;
    }
    return 0;
}
