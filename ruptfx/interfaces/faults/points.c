// What a step does at the points of an interface, LANES of them at a time: point (trial, slip rate and traction) and write_back
// (all fields). Explicit steps (fault_step.c) and implicit ones (implicit/response.c) go on from here. point_code.py writes in
// front of this file what is known at compile time: COMPONENTS, LOCAL, TANGENTS, NORMAL, ONE_SIDED, AT_END, TOLERANCE, MAX_ITERATIONS,
// BISECT_EVERY, DAMAGED, LANES, where arrays are, IS_HELD (whether slip is prescribed), BONDED and the formulas of cohesion, and
// the traced formulas of contact method, law, monitors and step (point_step.py). This file has the loops over points and iterates.
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

// kick: duration for which the traction acts [s]; since: time since the traction before; carried: weight of the mean slip rate
// of the previous step in the slip rate at the traction; extrapolation: part of a step from the middle of a step to the traction.
struct times { double dt, kick, since, extrapolation, carried, threshold, time; };

struct points {
    const lanes *fixed;                          // what does not change during a run
    lanes old[STATE_COUNT], new[STATE_COUNT];    // fields at the traction before, and now
    lanes opening, jump[LOCAL], velocity[LOCAL]; // jumps of the bodies
    lanes multiplier[1 + TANGENTS], body_stiffness, radiation, near;  // given to implicit steps
    lanes trial_normal, trial_shear[TANGENTS], compliance, z[TANGENTS];
    lanes shear[TANGENTS], size, shift[TANGENTS], shift_along, mean_impedance, free_velocity[TANGENTS], free_direction[TANGENTS], free_rate;  // `ShiftedTrial`
    lanes rate_before, speed_before, speed_then; // mean slip rate before, along and in size; slip rate at that traction
    lanes sigma, rate, low, high, direction[TANGENTS], goes_on;  // normal stress, and V as an `Iterate`
    lanes strength, slope, stress_slope, before_slope;  // at V, and its derivatives, for implicit steps
    lanes change[LOCAL];                         // traction beyond the initial one
    lanes contact_loss;                          // energy lost by contact that opens or closes within the step [J]
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
        carried = times->carried, threshold = times->threshold, time = times->time; \
    (void)dt; (void)kick; (void)since; (void)extrapolation; (void)carried; (void)threshold; (void)time;
#if BONDED
#define IS_CLOSED(normal_stress) ((normal_stress) > 0 || IS_HELD || points->tension[l] > 0 || points->bond[l] > 0)
#else
#define IS_CLOSED(normal_stress) ((normal_stress) > 0 || IS_HELD)
#endif

#if BONDED
// Cohesion at a known opening and slip, and with it the normal stress (cohesive_interface.py).
INLINE void update_cohesion(const struct times *times, const double *number, struct points *points)
{
    UNPACK_TIMES
    EACH_LANE { double damage; DAMAGE NEW(damage) = damage; }
    EACH_LANE { COHESIVE_STRENGTH }
}

// Cohesion at `points->damage`, and with it the normal stress, of which opening follows.
INLINE void apply_damage(const double *number, struct points *points)
{
    EACH_LANE { COHESIVE_STRENGTH }
    EACH_LANE { OPENED }
}

// Set the next trial damages, and return whether a point needs one. Points search one by one, because the branches of false
// position differ between them; those that have converged keep their damage.
INLINE int search_damages(const struct times *times, const double *number, struct points *points, struct damage_search *at)
{
    UNPACK_TIMES
    lanes missing;
    int any = 0;
    EACH_LANE {
        double damage;
        { DAMAGE }
        NEW(damage) = points->damage[l];
        missing[l] = damage - points->damage[l];
    }
    for (int l = 0; l < LANES; l++) {
        if (at[l].calls == 0 || at[l].open) any |= search_damage(at + l, missing[l], DAMAGED, DAMAGED, MAX_ITERATIONS);
        points->damage[l] = at[l].now;
    }
    return any;
}
#endif

// Slip rate and traction that the law admits of a trial, for a normal stress; V is not a number where there is none.
INLINE void project(const struct times *times, const double *number, struct points *points)
{
    UNPACK_TIMES
    lanes begun[BEGUN_COUNT + 1], at_rest;
    // A loop for each formula, which compilers vectorise; `points` keeps what the later ones need.
    EACH_LANE { SHIFTED_TRIAL }
    EACH_LANE { BEGIN }
    EACH_LANE { STRENGTH_AT_REST }
    EACH_LANE { FIRST_ITERATE }
    double any = 0;  // a double like the values beside it, so that its sum over lanes is a vector, too
    for (int l = 0; l < LANES; l++) any += points->goes_on[l];
    // A block iterates until its last point has converged; NEXT_ITERATE leaves the others as they are, so that the result of a
    // point does not depend on the points that share its block, and with it not on the number of ranks.
    for (int iteration = 0; any > 0 && iteration < MAX_ITERATIONS; iteration++) {
        const int bisects = iteration % BISECT_EVERY == BISECT_EVERY - 1;
        any = 0;
        _Pragma("omp simd reduction(+:any)")
        for (int l = 0; l < LANES; l++) {
            double strength, slope, spread;
            { RESISTANCE }
            NEXT_ITERATE
            any += points->goes_on[l];
        }
    }
    // Not a number in place of an error: the block is completed without branches, and `failed` looks at it once.
    EACH_LANE points->rate[l] = points->goes_on[l] != 0 ? (double)NAN : points->rate[l];
    EACH_LANE { SLIDING }
}

// The trial, and what law and cohesion admit of it.
INLINE void point(const struct times *times, const double *number, struct points *points)
{
    UNPACK_TIMES
    EACH_LANE {
        points->opening[l] = (NORMAL ? points->jump[0][l] : 0) + FIXED(gap);
        TRIAL
    }
#if BONDED && AT_END
    // Opening and slip of the step follow from its tractions, and damage from both, so that it is sought. The first trial is the
    // present damage, which is the result of most points: damage does not heal, and most do not break in a step.
    struct damage_search at[LANES];
    for (int l = 0; l < LANES; l++) at[l] = (struct damage_search){.now = points->damage[l] = OLD(damage)};
    do {
        apply_damage(number, points);
        project(times, number, points);
    } while (search_damages(times, number, points, at));
#else
#if BONDED
    update_cohesion(times, number, points);
#endif
    project(times, number, points);
#endif
}

// The fields at the traction, and what friction takes [J].
INLINE void write_back(int count, const struct times *times, const double *number, struct points *points, lanes dissipated)
{
    UNPACK_TIMES
    // Where slip ends with the traction, mean tractions work over the step; else the traction acts for the time of its kick.
    const double duration = AT_END ? since : kick;
    EACH_LANE {
        { WRITE_BACK }
        const double normal_stress = points->sigma[l], speed_then = points->speed_then[l];
        const int closed = IS_CLOSED(normal_stress), held = IS_HELD;
        double power = 0, square = 0, whole = 0;
        EACH_TANGENT {
            // Bodies start from rest, also where the interface creeps.
            const double rate_old = since > 0 ? OLD(mean_slip_rate + k) : 0, traction_old = OLD(shear_traction + k);
            const double rate = NEW(mean_slip_rate + k), traction = NEW(shear_traction + k);
            double dissipation;
            DISSIPATED
            power += dissipation;
            square += NEW(slip_rate + k) * NEW(slip_rate + k);
            whole += traction * traction;
        }
        const double speed = sqrt(square);
        const double normal_stress_then = OLD(normal_stress), has_strength = FIXED(has_strength);
        (void)whole, (void)normal_stress_then, (void)has_strength, (void)held;
#if BONDED && AT_END
        // Mean tractions work between those before and now; cohesion carries its share of both.
        double cohesion, before = 0, cohesive_power = 0;
        { COHESION_BEFORE }
        EACH_TANGENT before += OLD(shear_traction + k) * OLD(shear_traction + k);
        const double share_old = cohesive_share(cohesion, sqrt(before)), share_now = cohesive_share(points->bond[l], sqrt(whole));
        EACH_TANGENT {
            const double rate_old = since > 0 ? OLD(mean_slip_rate + k) : 0, rate = NEW(mean_slip_rate + k);
            const double traction_old = share_old * OLD(shear_traction + k);
            const double traction = share_now * NEW(shear_traction + k);
            double dissipation;
            (void)rate_old, (void)traction_old;
            DISSIPATED
            cohesive_power += dissipation;
        }
        power -= cohesive_power;
        // What is elastic, along the secant to the origin too, is stored.
        // Differences from zero, as a plain minus sign makes minus zero of no stress.
        const double pull_old = 0 - OLD(normal_stress), pull = 0 - normal_stress;
        const double opening_work = 0.5 * (pull_old + pull) * (NEW(opening) - OLD(opening));
        const double stored = 0.5 * ((pull > 0 ? pull * NEW(opening) : 0) - (pull_old > 0 ? pull_old * OLD(opening) : 0));
        const int pressed = pull_old < 0 || pull < 0;
        // Of points that this rank owns, each once: those of other ranks have no owned area, and fillers of a block do not count.
        const double area = l < count ? FIXED(owned_area) : 0;
        points->fractured[l] = area * (cohesive_power * duration + (pressed ? 0 : opening_work - stored));
        points->contact_loss[l] = area * (pressed ? opening_work - stored : 0);
#elif BONDED
        const double part = cohesive_share(points->bond[l], sqrt(whole));
        points->fractured[l] = l < count ? FIXED(owned_area) * part * power * duration : 0;
        points->contact_loss[l] = 0;
        power -= part * power;
#else
        const double mean_stress = AT_END ? 0.5 * (OLD(normal_stress) + normal_stress) : 0;
        points->contact_loss[l] = l < count ? FIXED(owned_area) * mean_stress * (OLD(opening) - NEW(opening)) : 0;
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
        const double values[] = {
            0, first + l, points->trial_normal[l], points->size[l], points->z[0][l], points->speed_then[l],
        };
        memcpy(result, values, sizeof values);
        return 1;
    }
    return 0;
}
