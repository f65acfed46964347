// Friction with rates and states at the end of a step, for facets and collisions: what is known when the step begins, strength at a
// slip rate, the slip rate under a trial traction, state after the step. In front of it stand STATES, the numbers of the states,
// BEGUN, the traced formulas BEGIN, STRENGTH and ADVANCE of the law, and those of the step of a contact point (point_step.py)
// FIRST_ITERATE and NEXT_ITERATE, with MAX_ITERATIONS and BISECT_EVERY. A law without rates and states (RATED is 0) needs none of it.
enum { STATES };  // STATE_theta = 0, ...
#define OLD(name) state[STATE_##name][l]

#if RATED

enum { BEGUN };  // of the law, known when the step begins

// Arguments of a law with rates besides the slip rate.
struct rated {
    double *const *state;
    int l;
    double since, normal_stress, normal_stress_before, begun[BEGUN_COUNT + 1];
};

#define GIVEN(at) \
    double *const *const state = (at)->state; \
    const int l = (at)->l; \
    const double since = (at)->since, normal_stress = (at)->normal_stress, \
        normal_stress_before = (at)->normal_stress_before, rate_before = 0, speed_before = 0, extrapolation = 0, \
        radiation = 0; \
    (void)state, (void)l, (void)since, (void)normal_stress, (void)normal_stress_before, (void)rate_before, \
        (void)speed_before, (void)extrapolation, (void)radiation;

// Strength of friction at a slip rate, with the state advanced to it, and its derivative.
static double friction_at(const struct rated *at, const double *number, double slip_rate, double *derivative)
{
    GIVEN(at)
    const double *const begun = at->begun;
    (void)number, (void)begun;
    double strength, slope;
    STRENGTH
    *derivative = slope;
    return strength;
}

// Slip rate V at which friction and z V balance a trial traction; not a number where there is none. `friction` becomes the
// strength at V.
static double solve_slip_rate(const struct rated *at, const double *number, double trial, double z, double *friction)
{
    double slope, rate, low, high, goes_on, strength = friction_at(at, number, 0, &slope);
    { FIRST_ITERATE }
    for (int iteration = 0; goes_on != 0 && iteration < MAX_ITERATIONS; iteration++) {
        const int bisects = iteration % BISECT_EVERY == BISECT_EVERY - 1;
        strength = friction_at(at, number, rate, &slope);
        NEXT_ITERATE
    }
    *friction = strength;
    return goes_on != 0 ? NAN : rate;
}

// Quantities of the law that do not depend on the slip rate of the step, computed before its iteration.
static void begin_friction(struct rated *at, const double *number)
{
    GIVEN(at)
    const double slip_rate = 0;
    double *const begun = at->begun;
    (void)number, (void)slip_rate, (void)begun;
    BEGIN
}

// State after a step with a mean slip rate.
static void advance_friction(const struct rated *at, const double *number, double slip_rate)
{
    GIVEN(at)
    const double *const begun = at->begun;
    (void)number, (void)slip_rate, (void)begun;
    ADVANCE
}
#endif
