// The formulas of one group of facets with the same laws, for cracks.c and rigid.c. In front of every copy of this file stand
// GROUP, the number of the group, RATED and the traced formulas of cohesion and friction.
#define JOINED(name, group) name##_##group
#define EXPANDED(name, group) JOINED(name, group)
#define OF_GROUP(name) EXPANDED(name, GROUP)

static double OF_GROUP(left)(const double *number, double damage)
{
    (void)number;
    double left;
    LEFT
    return damage >= 1 ? 0 : left;  // whatever rounding leaves
}

static double OF_GROUP(damage)(const double *number, double opening, double slip)
{
    (void)number, (void)opening, (void)slip;
    double damage;
    DAMAGE
    return damage;
}

#if !RATED  // those are in rated.c
static double OF_GROUP(friction)(const double *number, double *const *state, long l, double normal_stress)
{
    (void)number, (void)state, (void)l;
    double friction;
    FRICTION
    return friction;
}

static void OF_GROUP(advance)(const double *number, double *const *state, long l, double slip_rate,
                              double normal_stress, double since)
{
    (void)number, (void)state, (void)l, (void)slip_rate, (void)normal_stress, (void)since;
    ADVANCE
}
#endif
