// Tractions of facets and the forces of their cells, LANES ends at a time (two for every facet).  step.py writes in
// front of this file lanes.c, BONDED, RATED (friction knows rates), where states are, which parameters vary from end to
// end, and the traced formulas of cohesion and friction.
#include <string.h>

enum { FACETS };  // FACET_time_of_yield = 0, ...
enum {
    NORMAL_X, NORMAL_Y, WEIGHT, STIFFNESS,
#if LARGE_ROTATIONS
    ALONG,  // the tangent: length with the sign of its sense
#endif
#if PRELOADED
    INITIAL_NORMAL, INITIAL_SHEAR,  // tractions before anything moves
#endif
    COLUMNS
};

// An end: jumps and stiffness now, inelastic jumps and damage before, and what friction admits (at rest, of a law with
// rates).
struct end {
    double open, jump, stiffness, damage, inelastic, largest, slip, cohesive, friction;
#if RATED
    const struct rated *rated;
#endif
};

// Tractions of an end at a trial damage, and the damage that follows from its opening and slip under them.
struct answer { double normal, shear, inelastic, largest, slip, cohesive, strength, damage, friction, left; };

static __attribute__((noinline)) struct answer respond(const struct end *end, const double *number, double damage)
{
    struct answer at;
    const double left = OF_GROUP(left)(number, damage), tension = TENSILE_STRENGTH * left, k = end->stiffness;
    at.left = left;
    at.inelastic = 0;
    if (end->open > 0) {
        const double loading = end->open - tension / k;
        // Back to the origin along the secant, and up again.
        const double most = k * end->largest, secant = tension > 0 ? end->open * most / (most + tension) : 0;
        at.inelastic = loading > secant ? loading : secant;
    }
    at.normal = k * (end->open - at.inelastic);
    at.largest = at.inelastic > end->largest ? at.inelastic : end->largest;
    at.friction = end->friction;
    at.strength = COHESION * left + end->friction;
    const double trial = k * (end->jump - end->slip), excess = fabs(trial) - at.strength;
#if RATED
    const struct rated *const law = end->rated;
    double more = law->normal_stress > 0 || !(excess > 0) ? 0 : excess / k;
    if (law->normal_stress > 0 && law->since > 0 && excess > 0) {
        const double since = law->since;
        more = since * solve_slip_rate(law, number, fabs(trial) - COHESION * left, k * since, &at.friction);
        at.strength = COHESION * left + at.friction;
    }
    at.shear = more > 0 ? copysign(fabs(trial) - k * more, trial) : more == 0 ? trial : more;
#else
    const double more = excess > 0 ? excess / k : 0;
    at.shear = admissible_shear(trial, at.strength);
#endif
    at.slip = end->slip + copysign(more, trial);
    at.cohesive = end->cohesive + more;
    at.damage = OF_GROUP(damage)(number, at.largest, at.cohesive);
    return at;
}

// Tractions of an end at the damage that agrees with the one following from them; `worst` becomes the largest difference that
// the search accepts. left_before: remaining strength at the damage before.
static __attribute__((noinline)) struct answer solve_damage(const struct end *end, const double *number, double *damage,
                                                      double *left_before, double *worst)
{
    struct damage_search search = {.now = end->damage};
    struct answer found;
    double missing;
    do {
        found = respond(end, number, search.now);
        if (search.calls == 0) *left_before = found.left;
        missing = found.damage - search.now;
    } while (search_damage(&search, missing, 0, 1e-15, 101));
    *damage = search.now;
    const double left = search.calls > 1 && !(search.now >= 1 && missing >= 0) ? fabs(missing) : 0 * missing;
    *worst = left <= *worst ? *worst : left;  // also where it is not a number
    return found;
}

// One end by the full law; what it took of the energy is added to taken: friction, fracture, contact [J/m2].
static __attribute__((noinline)) void yield_end(double since, double open, double jump, double stiffness,
                                                const double *number, const double *varied, double *const *state,
                                                int l, double *taken)
{
    (void)varied;
#if VARIED
    static const int places[] = {VARIED_NUMBERS};
    double here[NUMBERS];
    memcpy(here, number, sizeof here);
    for (int i = 0; i < VARIED; i++) here[places[i]] = varied[i * LANES + l];
    number = here;
#endif
    (void)since;
    struct end end = {
        .open = open, .jump = jump, .stiffness = stiffness, .damage = OLD(damage), .inelastic = OLD(inelastic_opening),
        .largest = OLD(largest_opening), .slip = OLD(slip), .cohesive = OLD(cohesive_slip),
    };
    const double normal_stress = open < 0 ? -stiffness * open : 0;
#if RATED
    struct rated rated = {
        .state = state, .l = l, .since = since, .normal_stress = normal_stress,
        .normal_stress_before = OLD(normal_traction) < 0 ? -OLD(normal_traction) : 0,
    };
    begin_friction(&rated, number);
    double slope;
    end.rated = &rated;
    end.friction = normal_stress > 0 ? friction_at(&rated, number, 0, &slope) : 0;
#else
    if (normal_stress > 0) end.friction = OF_GROUP(friction)(number, state, l, normal_stress);
#endif
    double damage, left_before;
    const struct answer at = solve_damage(&end, number, &damage, &left_before, taken + 3);
    const double before = OLD(normal_traction);
    // Between two tractions their mean works; what is elastic, along the secant too, is stored.
    const double opened = 0.5 * (before + at.normal) * (at.inelastic - end.inelastic);
    const double given_back = 0.5 * (before * end.inelastic * (before > 0) - at.normal * at.inelastic * (at.normal > 0));
    const double slipped = 0.5 * (OLD(shear_traction) + at.shear) * (at.slip - end.slip);
    const double bond_before = COHESION * left_before, bond = COHESION * at.left;
    const double broken = 0.5 * (cohesive_share(bond_before, fabs(OLD(shear_traction))) * OLD(shear_traction)
                                 + cohesive_share(bond, fabs(at.shear)) * at.shear) * (at.slip - end.slip);
    taken[0] += slipped - broken;
    taken[1] += broken;
    taken[before >= 0 && at.normal >= 0 ? 1 : 2] += opened + given_back;
    if (end.damage < 1) {
        OLD(largest_opening) = at.largest;
        OLD(cohesive_slip) = at.cohesive;
    }
    const double slip_rate = since > 0 ? fabs(at.slip - end.slip) / since : 0;
#if RATED
    advance_friction(&rated, number, slip_rate);
#else
    OF_GROUP(advance)(number, state, l, slip_rate, normal_stress, since);
#endif
    OLD(normal_traction) = at.normal;
    OLD(shear_traction) = at.shear;
    OLD(inelastic_opening) = at.inelastic;
    OLD(slip) = at.slip;
    OLD(damage) = damage;
}

// Kinetic energy of the corners of a facet from its yield to its failure: what it emits.
INLINE void listen(double time, const int *node, const double *velocity, const double *mass, double *const *state,
                   double *const *facet, long f, int l)
{
    const double first = OLD(damage), second = state[STATE_damage][l + 1];
    if (!(first > 0 || second > 0) || !isnan(facet[FACET_time_of_failure][f])) return;
    double energy = 0;
    for (int side = 0; side < 2; side++)
        for (int end = l; end < l + 2; end++)
            for (int c = 0; c < 2; c++) {
                const int d = node[side * LANES + end] + c;
                energy += 0.5 * mass[d] * velocity[d] * velocity[d];
            }
    if (isnan(facet[FACET_time_of_yield][f])) {
        facet[FACET_time_of_yield][f] = time;
        facet[FACET_energy_at_yield][f] = energy;
    } else if (energy - facet[FACET_energy_at_yield][f] > facet[FACET_energy_gain][f]) {
        facet[FACET_energy_gain][f] = energy - facet[FACET_energy_at_yield][f];
        facet[FACET_time_of_gain][f] = time;
    }
    if (first >= 1 && second >= 1) {
        facet[FACET_time_of_failure][f] = time;
        facet[FACET_slip_at_failure][f] = 0.5 * (OLD(slip) + state[STATE_slip][l + 1]);
    }
}

// Ends are pairs of lanes: what both have of a vector of LANES / 2 numbers of facets, of the first ends, of the second.
#if LANES == 8
#define PAIRS(x, a, b, c, d) __builtin_shufflevector(x, x, a, a, b, b, c, c, d, d)
typedef double half __attribute__((vector_size(32), aligned(8)));
INLINE lanes at_ends(const double *fixed) { return PAIRS(*(const half *)fixed, 0, 1, 2, 3); }
INLINE lanes first_of(lanes x) { return PAIRS(x, 0, 2, 4, 6); }
INLINE lanes second_of(lanes x) { return PAIRS(x, 1, 3, 5, 7); }
#else
INLINE lanes at_ends(const double *fixed) { return (lanes){fixed[0], fixed[0], fixed[1], fixed[1]}; }
INLINE lanes first_of(lanes x) { return (lanes){x[0], x[0], x[2], x[2]}; }
INLINE lanes second_of(lanes x) { return (lanes){x[1], x[1], x[3], x[3]}; }
#endif

#if LARGE_ROTATIONS
// Normals of facets as they are now, the mean of both sides, and their lengths `along` the tangent.
INLINE void turn_frames(const lanes minus[2], const lanes plus[2], lanes *nx, lanes *ny, lanes *along)
{
    const lanes x = minus[0] + plus[0], y = minus[1] + plus[1];
    const lanes way_x = 0.5 * (second_of(x) - first_of(x)) + *along * *ny;
    const lanes way_y = 0.5 * (second_of(y) - first_of(y)) - *along * *nx;
    const lanes square = way_x * way_x + way_y * way_y;
    UNROLL for (int l = 0; l < LANES; l++) (*along)[l] = copysign(sqrt(square[l]), (*along)[l]);
    *nx = -way_y / *along;
    *ny = way_x / *along;
}
#endif

// All bits of the ends that are whole and carry no more than their springs alone may, as almost all do.
INLINE whole_lanes elastic(lanes damage, lanes normal, lanes shear, const double *number, const double *varied)
{
    (void)number, (void)varied;
    const lanes none = {0}, tension = TENSION_AT_ENDS, cohesion = BOND_AT_ENDS;
    return (damage <= none) & (normal <= tension) & (shear <= cohesion) & (-shear <= cohesion);
}

// Tractions at the displacement, and their forces added to `force`; energies of owned facets are added to `energy`, then
// the largest residual of a damage, and the facet that has it.
void update(long facets, double since, double time, const int *node, const double *fixed, const double *number,
            const double *varied, const double *owned, const double *displacement, const double *velocity, const double *mass, double *force,
            double *const *states, double *const *facet, double *energy)
{
    for (long first = 0; first < 2 * facets; first += LANES, node += 2 * LANES, fixed += COLUMNS * LANES / 2,
              varied += VARIED * LANES) {
        const long rest = 2 * facets - first;
        const int count = rest < LANES ? (int)rest : LANES;
        // The last block has room of its own, so that all blocks take the same way.
        double room[STATE_COUNT][LANES], *state[STATE_COUNT];
        for (int s = 0; s < STATE_COUNT; s++) {
            state[s] = states[s] + first;
            if (count == LANES) continue;
            memset(room[s], 0, sizeof room[s]);
            memcpy(room[s], state[s], (size_t)count * sizeof(double));
            state[s] = room[s];
        }
        lanes nx = at_ends(fixed + NORMAL_X * LANES / 2), ny = at_ends(fixed + NORMAL_Y * LANES / 2);
        const lanes weight = at_ends(fixed + WEIGHT * LANES / 2), k = at_ends(fixed + STIFFNESS * LANES / 2);
        lanes minus[2], plus[2];
        gather_couples(displacement, node, minus);
        gather_couples(displacement, node + LANES, plus);
#if LARGE_ROTATIONS
        lanes along = at_ends(fixed + ALONG * LANES / 2);
        turn_frames(minus, plus, &nx, &ny, &along);
#endif
        const lanes x = plus[0] - minus[0], y = plus[1] - minus[1];
#if PRELOADED
        // The springs carry the initial tractions at the jump that belongs to these; the bodies feel what is beyond.
        const lanes initial_normal = at_ends(fixed + INITIAL_NORMAL * LANES / 2);
        const lanes initial_shear = at_ends(fixed + INITIAL_SHEAR * LANES / 2);
        const lanes open = x * nx + y * ny + initial_normal / k, jump = x * ny - y * nx + initial_shear / k;
#else
        const lanes open = x * nx + y * ny, jump = x * ny - y * nx;
#endif
#define AT_ENDS(name) (*(loose *)state[STATE_##name])
        lanes normal = k * open, shear = k * jump;
        const whole_lanes fine = elastic(AT_ENDS(damage), normal, shear, number, varied);
        long all = -1;
        UNROLL for (int l = 0; l < LANES; l++) all &= fine[l];
        if (all) {
            AT_ENDS(normal_traction) = normal;
            AT_ENDS(shear_traction) = shear;
        } else {
            for (int l = 0; l < count; l++) {
                if (weight[l] == 0) {  // somebody else cares for it
                    OLD(normal_traction) = OLD(shear_traction) = 0;
                    continue;
                }
                if (fine[l]) {
                    OLD(normal_traction) = normal[l], OLD(shear_traction) = shear[l];
                    continue;
                }
                double taken[4] = {0, 0, 0, energy[3]};
                yield_end(since, open[l], jump[l], k[l], number, varied, state, l, taken);
                const double area = weight[l] * owned[(first + l) / 2];
                for (int e = 0; e < 3; e++) energy[e] += area * taken[e];
                if (!(taken[3] <= energy[3])) energy[3] = taken[3], energy[4] = (first + l) / 2;
            }
            if (BONDED)
                for (int l = 0; l < count; l += 2)
                    listen(time, node, velocity, mass, state, facet, (first + l) / 2, l);
            normal = AT_ENDS(normal_traction), shear = AT_ENDS(shear_traction);
        }
#if PRELOADED
        normal -= initial_normal, shear -= initial_shear;
#endif
        lanes at_minus[2] = {weight * (normal * nx + shear * ny), weight * (normal * ny - shear * nx)};
        lanes at_plus[2] = {-at_minus[0], -at_minus[1]};
#if LARGE_ROTATIONS
        // Jumps are measured in a frame that turns with the ends of both sides, so tractions have a moment on it.
        const lanes each = weight * (shear * open - normal * jump), moment = first_of(each) + second_of(each);
        lanes pull = 0.5 * moment / along;
        for (int l = 1; l < LANES; l += 2) pull[l] = -pull[l];
        at_minus[0] += pull * nx, at_minus[1] += pull * ny;
        at_plus[0] += pull * nx, at_plus[1] += pull * ny;
#endif
        // Once to every corner, which has two facets at most: their order then changes no bit of the sum.
#define ADD(type, place, y) *(type *)(force + place) += (type)y;
        EACH_COUPLE(node, at_minus, ADD)
        EACH_COUPLE((node + LANES), at_plus, ADD)
        if (count < LANES)
            for (int s = 0; s < STATE_COUNT; s++)
                memcpy(states[s] + first, room[s], (size_t)count * sizeof(double));
    }
}
