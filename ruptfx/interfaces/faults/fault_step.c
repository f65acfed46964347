// One explicit step of an interface, LANES points at a time: gather, point and write_back (points.c, in front of this file),
// push (what the bodies feel).

typedef REAL real;  // of velocities and forces of nodes

INLINE void gather(const long *plus, const long *minus, const double *displacement, const real *velocity,
                   struct points *points)
{
    lanes u[COMPONENTS], v[COMPONENTS];
    for (int c = 0; c < COMPONENTS; c++)
        EACH_LANE {
            u[c][l] = displacement[plus[l] + c] - (ONE_SIDED ? 0 : displacement[minus[l] + c]);
            v[c][l] = velocity[plus[l] + c] - (ONE_SIDED ? 0 : velocity[minus[l] + c]);
        }
    for (int k = 0; k < LOCAL; k++)
        EACH_LANE {
            double jump = 0, rate = 0;
            for (int c = 0; c < COMPONENTS; c++) {
                jump += FIXED(frame + k * COMPONENTS + c) * u[c][l];
                rate += FIXED(frame + k * COMPONENTS + c) * v[c][l];
            }
            points->jump[k][l] = jump;
            points->velocity[k][l] = rate;
        }
}

// Nodes are far apart in memory: processors read those of the next block while this one is computed.
INLINE void prefetch(const long *plus, const long *minus, const double *displacement, const real *velocity,
                const real *force)
{
    for (int l = 0; l < LANES; l++) {
        const void *const addresses[] = {
            displacement + plus[l], velocity + plus[l], force + plus[l],
            displacement + minus[l], velocity + minus[l], force + minus[l],
        };
        for (int i = 0; i < (ONE_SIDED ? 3 : 6); i++) __builtin_prefetch(addresses[i]);
    }
}

// Velocities change by the traction beyond the initial one, with which the bodies begin in equilibrium. Lanes compute and single
// points write, because nodes of neighbouring points are not neighbours in memory.
INLINE void push(int count, double kick, const long *plus, const long *minus, const struct points *points,
                 real *velocity, real *force)
{
    lanes pull[COMPONENTS], slower[COMPONENTS], faster[COMPONENTS];
    for (int c = 0; c < COMPONENTS; c++)
        EACH_LANE {
            double sum = 0;
            for (int k = 0; k < LOCAL; k++) sum += FIXED(frame + k * COMPONENTS + c) * points->change[k][l];
            pull[c][l] = FIXED(weight) * sum;
            slower[c][l] = kick * FIXED(mobility_plus + c) * pull[c][l];
            faster[c][l] = kick * FIXED(mobility_minus + c) * pull[c][l];
        }
    for (int l = 0; l < count; l++)
        for (int c = 0; c < COMPONENTS; c++) {
            velocity[plus[l] + c] -= slower[c][l];
            // For the reaction where an edge that meets the interface is driven.
            force[plus[l] + c] -= pull[c][l];
            if (ONE_SIDED) continue;
            velocity[minus[l] + c] += faster[c][l];
            force[minus[l] + c] += pull[c][l];
        }
}

// plus, minus: first degree of freedom of the nodes. result: as points.c says; fields and velocities are of no use when a
// point failed. result[6] is what cohesion took [J], with split nodes in shear only; [7] what contact took that opened or
// closed within the step, where slip ends with the traction.
void update(long n, const struct times *times, const long *plus, const long *minus, const double *displacement,
            real *velocity, real *force, const double *fixed, const double *number, double *const *field,
            double *result)
{
    lanes dissipated = {0};
    double fractured = 0, contact_loss = 0;
    result[1] = -1;
    for (long first = 0; first < n; first += LANES) {
        struct points points;
        const int count = n - first < LANES ? (int)(n - first) : LANES;
        points.fixed = (const lanes *)(fixed + first * FIXED_COUNT);
        if (first + LANES < n) prefetch(plus + first + LANES, minus + first + LANES, displacement, velocity, force);
        load(first, count, field, &points);
        gather(plus + first, minus + first, displacement, velocity, &points);
        point(times, number, &points);
        if (failed(first, count, &points, result)) return;
        write_back(count, times, number, &points, dissipated);
        for (int l = 0; l < LANES; l++) contact_loss += points.contact_loss[l];
#if BONDED
        for (int l = 0; l < LANES; l++) fractured += points.fractured[l];
#endif
        store(first, count, field, &points);
        push(count, times->kick, plus + first, minus + first, &points, velocity, force);
    }
    result[0] = 0;
    for (int l = 0; l < LANES; l++) result[0] += dissipated[l];
    result[6] = fractured, result[7] = contact_loss;
}
