// Tractions of facets and the forces of their cells, LANES ends at a time (two for every facet).  _step.py writes in
// front of this file LANES, BONDED, where states are, and the traced formulas of cohesion and friction.
#include <math.h>
#include <string.h>

#define INLINE static inline __attribute__((always_inline))
#define EACH_LANE _Pragma("omp simd") for (int l = 0; l < LANES; l++)

typedef double lanes[LANES];

enum { STATES };  // STATE_normal_traction = 0, ...
enum { FACETS };  // FACET_time_of_yield = 0, ...
enum { NORMAL_X, NORMAL_Y, WEIGHT, STIFFNESS, ALONG, COLUMNS };  // along the tangent, length with the sign of its sense

// An end: jumps and stiffness now, inelastic jumps and damage before, and what friction admits.
struct end { double open, jump, stiffness, damage, inelastic, largest, slip, cohesive, friction; };

// What it carries at a given damage, and the damage which that would lead to.
struct answer { double normal, shear, inelastic, largest, slip, cohesive, strength, damage; };

INLINE double left_of(const double *number, double damage)
{
    (void)number;
    double left;
    LEFT
    return damage >= 1 ? 0 : left;  // whatever rounding leaves
}

INLINE double damage_of(const double *number, double opening, double slip)
{
    (void)number, (void)opening, (void)slip;
    double damage;
    DAMAGE
    return damage;
}

static __attribute__((noinline)) struct answer respond(const struct end *end, const double *number, double damage)
{
    struct answer at;
    const double left = left_of(number, damage), tension = TENSILE_STRENGTH * left, k = end->stiffness;
    at.inelastic = 0;
    if (end->open > 0) {
        const double loading = end->open - tension / k;
        // Back to the origin along the secant, and up again.
        const double most = k * end->largest, secant = tension > 0 ? end->open * most / (most + tension) : 0;
        at.inelastic = loading > secant ? loading : secant;
    }
    at.normal = k * (end->open - at.inelastic);
    at.largest = at.inelastic > end->largest ? at.inelastic : end->largest;
    at.strength = COHESION * left + end->friction;
    const double trial = k * (end->jump - end->slip), excess = fabs(trial) - at.strength;
    const double more = excess > 0 ? excess / k : 0;
    at.shear = excess > 0 ? copysign(at.strength, trial) : trial;
    at.slip = end->slip + copysign(more, trial);
    at.cohesive = end->cohesive + more;
    at.damage = damage_of(number, at.largest, at.cohesive);
    return at;
}

// The damage that agrees with the strength it leaves: false position between what it was and 1.
static __attribute__((noinline)) double damage_after(const struct end *end, const double *number)
{
    double low = end->damage, high = 1, now = low;
    if (low >= 1) return low;
    double below = respond(end, number, low).damage - low;
    if (below <= 0) return low;
    double above = respond(end, number, high).damage - high;
    if (above >= 0) return high;
    for (int iteration = 0, side = 0; iteration < 100; iteration++) {
        now = (low * above - high * below) / (above - below);
        const double rest = respond(end, number, now).damage - now;
        if (fabs(rest) <= 1e-15 || high - low <= 1e-15) break;
        if (rest > 0) {
            low = now, below = rest;
            if (side == 1) above *= 0.5;
            side = 1;
        } else {
            high = now, above = rest;
            if (side == -1) below *= 0.5;
            side = -1;
        }
    }
    return now;
}

// One end by the full law; what it took of the energy is added to taken: friction, fracture, contact [J/m2].
static __attribute__((noinline)) void yield_end(double since, double open, double jump, double stiffness,
                                                const double *number, double *const *state, int l, double *taken)
{
    (void)since;
#define OLD_AT(name, lane) state[STATE_##name][lane]
#define OLD(name) OLD_AT(name, l)
    struct end end = {open, jump, stiffness, OLD(damage), OLD(inelastic_opening), OLD(largest_opening), OLD(slip),
                      OLD(cohesive_slip), 0};
    const double normal_stress = open < 0 ? -stiffness * open : 0;
    if (normal_stress > 0) {
        double friction;
        FRICTION
        end.friction = friction;
    }
    const double damage = damage_after(&end, number), before = OLD(normal_traction);
    const struct answer at = respond(&end, number, damage);
    // Between two tractions their mean works; what is elastic, along the secant too, is stored.
    const double opened = 0.5 * (before + at.normal) * (at.inelastic - end.inelastic);
    const double given_back = 0.5 * (before * end.inelastic * (before > 0) - at.normal * at.inelastic * (at.normal > 0));
    const double slipped = 0.5 * (OLD(shear_traction) + at.shear) * (at.slip - end.slip);
    const double friction_work = end.friction * fabs(at.slip - end.slip);
    const double rubbed = friction_work < slipped ? friction_work : slipped;
    taken[0] += rubbed;
    taken[1] += slipped - rubbed;
    taken[before >= 0 && at.normal >= 0 ? 1 : 2] += opened + given_back;
    if (end.damage < 1) {
        OLD(largest_opening) = at.largest;
        OLD(cohesive_slip) = at.cohesive;
    }
    const double slip_rate = since > 0 ? fabs(at.slip - end.slip) / since : 0;
    (void)slip_rate, (void)normal_stress;
    ADVANCE
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

#if LARGE_ROTATIONS
// Normals of facets as they are now, the mean of both sides, and their lengths.  Ends are pairs of lanes.
INLINE void turn_frames(const int *minus, const int *plus, const double *fixed, const double *displacement, double *nx,
                        double *ny, double *along)
{
    for (int l = 0; l < LANES; l += 2) {
        double way[2];
        for (int c = 0; c < 2; c++) {
            const double first = displacement[minus[l] + c] + displacement[plus[l] + c];
            const double second = displacement[minus[l + 1] + c] + displacement[plus[l + 1] + c];
            way[c] = 0.5 * (second - first);
        }
        const double before = fixed[ALONG * LANES + l], sense = copysign(1, before);
        way[0] += before * fixed[NORMAL_Y * LANES + l];
        way[1] -= before * fixed[NORMAL_X * LANES + l];
        const double length = sqrt(way[0] * way[0] + way[1] * way[1]), scale = sense / length;
        for (int e = l; e < l + 2; e++) {
            nx[e] = -way[1] * scale;
            ny[e] = way[0] * scale;
            along[e] = sense * length;
        }
    }
}
#endif

// Tractions at the displacement, and their forces added to `force`; energies of owned facets are added to `energy`.
void update(long facets, double since, double time, const int *node, const double *fixed, const double *number,
            const double *owned, const double *displacement, const double *velocity, const double *mass, double *force,
            double *const *states, double *const *facet, double *energy)
{
    for (long first = 0; first < 2 * facets; first += LANES, node += 2 * LANES, fixed += COLUMNS * LANES) {
        const long rest = 2 * facets - first;
        const int count = rest < LANES ? (int)rest : LANES;
        // The last block has room of its own, so that all blocks take the same way.
        lanes room[STATE_COUNT];
        double *state[STATE_COUNT];
        for (int s = 0; s < STATE_COUNT; s++) {
            state[s] = states[s] + first;
            if (count == LANES) continue;
            memset(room[s], 0, sizeof room[s]);
            memcpy(room[s], state[s], (size_t)count * sizeof(double));
            state[s] = room[s];
        }
        const int *minus = node, *plus = node + LANES;
        lanes open, jump;
#if LARGE_ROTATIONS
        lanes normal_x, normal_y, along;
        turn_frames(minus, plus, fixed, displacement, normal_x, normal_y, along);
#else
        const double *const normal_x = fixed + NORMAL_X * LANES, *const normal_y = fixed + NORMAL_Y * LANES;
#endif
        int busy = 0;
        _Pragma("omp simd reduction(|:busy)")
        for (int l = 0; l < LANES; l++) {
            const double nx = normal_x[l], ny = normal_y[l];
            const double k = fixed[STIFFNESS * LANES + l];
            const double x = displacement[plus[l]] - displacement[minus[l]];
            const double y = displacement[plus[l] + 1] - displacement[minus[l] + 1];
            open[l] = x * nx + y * ny;
            jump[l] = x * ny - y * nx;
            busy |= OLD(damage) > 0 || !(k * open[l] <= TENSILE_STRENGTH) || !(k * fabs(jump[l]) <= COHESION);
        }
        if (busy) {
            for (int l = 0; l < count; l++) {
                double taken[3] = {0, 0, 0};
                yield_end(since, open[l], jump[l], fixed[STIFFNESS * LANES + l], number, state, l, taken);
                const double area = fixed[WEIGHT * LANES + l] * owned[(first + l) / 2];
                for (int e = 0; e < 3; e++) energy[e] += area * taken[e];
            }
            if (BONDED)
                for (int l = 0; l < count; l += 2)
                    listen(time, node, velocity, mass, state, facet, (first + l) / 2, l);
        } else
            EACH_LANE {
                OLD(normal_traction) = fixed[STIFFNESS * LANES + l] * open[l];
                OLD(shear_traction) = fixed[STIFFNESS * LANES + l] * jump[l];
            }
        lanes x, y;
        EACH_LANE {
            const double nx = normal_x[l], ny = normal_y[l];
            x[l] = fixed[WEIGHT * LANES + l] * (OLD(normal_traction) * nx + OLD(shear_traction) * ny);
            y[l] = fixed[WEIGHT * LANES + l] * (OLD(normal_traction) * ny - OLD(shear_traction) * nx);
        }
        for (int l = 0; l < LANES; l++) {  // one after the other: ends of a block share corners
            force[minus[l]] += x[l];
            force[minus[l] + 1] += y[l];
            force[plus[l]] -= x[l];
            force[plus[l] + 1] -= y[l];
        }
#if LARGE_ROTATIONS
        // Jumps are measured in a frame that turns with the ends of both sides, so tractions have a moment on it.
        for (int l = 0; l < LANES; l += 2) {
            double moment = 0;
            for (int e = l; e < l + 2; e++)
                moment += fixed[WEIGHT * LANES + e] * (OLD_AT(shear_traction, e) * open[e]
                                                       - OLD_AT(normal_traction, e) * jump[e]);
            const double pull = 0.5 * moment / along[l], px = pull * normal_x[l], py = pull * normal_y[l];
            for (int side = 0; side < 2; side++) {
                const int *const at = node + side * LANES + l;
                force[at[0]] += px;
                force[at[0] + 1] += py;
                force[at[1]] -= px;
                force[at[1] + 1] -= py;
            }
        }
#endif
        if (count < LANES)
            for (int s = 0; s < STATE_COUNT; s++)
                memcpy(states[s] + first, room[s], (size_t)count * sizeof(double));
    }
}
