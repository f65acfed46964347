// The return map of contact in scalars, for the points of interfaces (points.c), facets (cracks.c, patch.c, rigid.c) and
// collisions (collide.c): shear traction, damage, and the split of the work between cohesion and friction.
#include <math.h>

#ifndef INLINE
#define INLINE static inline __attribute__((always_inline))
#endif

INLINE double admissible_shear(double trial, double strength)
{
    return fabs(trial) > strength ? copysign(strength, trial) : trial;
}

// Part of a shear traction that cohesion carries: its strength first, and friction the rest.
INLINE double cohesive_share(double strength, double traction) { return traction > strength ? strength / traction : 1; }

// Damage that agrees with the opening and slip which it leaves: false position (Illinois) between that before and 1.
struct damage_search {
    double now, low, high, below, above;  // damage to try; bracket, and what is missing at its ends
    int side, calls, open;                // last end that moved; damages tried; whether the search goes on
};

// Given what is `missing` at the present damage, choose the next one; returns whether there is one to try. The first one
// is right if no more than `least` is missing, others if it is within the tolerance.
INLINE int search_damage(struct damage_search *at, double missing, double least, double tolerance, int most)
{
    const int call = at->calls++;
    at->open = 0;
    if (call == 0) {
        at->low = at->now, at->high = 1, at->below = missing, at->side = 0;
        if (missing > least) at->now = 1, at->open = 1;
        return at->open;
    }
    if (call == 1) {
        at->above = missing;
        if (!(missing < 0)) return 0;
    } else if (fabs(missing) <= tolerance || at->high - at->low <= tolerance || missing != missing || call == most) {
        return 0;
    } else if (missing > 0) {
        at->low = at->now, at->below = missing;
        if (at->side > 0) at->above *= 0.5;
        at->side = 1;
    } else {
        at->high = at->now, at->above = missing;
        if (at->side < 0) at->below *= 0.5;
        at->side = -1;
    }
    at->now = (at->low * at->above - at->high * at->below) / (at->above - at->below);
    return at->open = 1;
}
