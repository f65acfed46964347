// Friction with rates and states at the end of a step, for facets and collisions: what is known when the step begins, strength at a
// slip rate, the slip rate under a trial traction, state after the step. In front of it stand STATES, the numbers of the states,
// BEGUN and the traced formulas BEGIN, STRENGTH and ADVANCE. A law without rates and states (RATED is 0) needs none of it.
enum { STATES };  // STATE_theta = 0, ...
#define OLD(name) state[STATE_##name][l]

#if RATED

enum { BEGUN };  // of the law, known when the step begins

// What a law with rates takes besides the slip rate.
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

// Slip rate V at which friction and z V are what is left of a trial traction, by the steps of `next_rate`; no number where there is none. `friction` becomes its strength.
static double solve_slip_rate(const struct rated *at, const double *number, double trial, double z, double *friction)
{
    double slope, low = 0, high = trial / z, v = high;
    *friction = friction_at(at, number, 0, &slope);
    if (!(trial > *friction) || !(high > 0)) return 0;
    v = (trial - *friction) / z;
    for (int iteration = 0; iteration < 100; iteration++) {
        *friction = friction_at(at, number, v, &slope);
        const double residual = trial - z * v - *friction;
        if (fabs(residual) <= 1e-13 * trial) return v;
        if (residual > 0) low = v;
        else high = v;
        if (high - low <= 1e-15 * high) return fabs(residual) <= 1e-9 * trial ? v : NAN;
        v = next_rate(v, low, high, residual, slope + z, z, v, iteration % 8 == 7);
    }
    return NAN;
}

// What the law knows when the step begins.
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
