// The nodes the bulk kernel leaves to the stepper: interfaces, boundaries, nodes shared with other ranks.  Arrays are over
// those it may leave, numbered by `dof`, or by themselves where these are all there are and `dof` is null; `which` are those
// it does leave now, all where it is null.  stepped_nodes.py puts lanes.c in front, with the type `real` of velocity and force.

// v = keep v + push f. As the kernel rounds it where masses are not damped (alike), or as it always was.
INLINE void kick_each(long n, const long *which, const long *dof, const int alike, const double *keep, const double *push,
                      const real *force, real *restrict velocity, double *restrict velocity_old)
{
    for (long k = 0; k < n; k++) {
        const long i = which ? which[k] : k, d = dof ? dof[i] : i;
        const double old = velocity[d], acting = force[d];
        velocity_old[i] = old;
        velocity[d] = alike ? FUSED(push[i], acting, keep[i] * old) : FUSED(keep[i], old, push[i] * acting);
    }
}

// Velocity half a step later without contact: v = keep v + push f; the old velocity is kept for the work integrals.
void kick(long n, const long *which, const long *dof, long alike, const double *keep, const double *push,
          const real *force, real *velocity, double *velocity_old)
{
#define KICK(which, dof, alike) kick_each(n, which, dof, alike, keep, push, force, velocity, velocity_old)
    if (which) alike ? KICK(which, dof, 1) : KICK(which, dof, 0);
    else if (dof) alike ? KICK(0, dof, 1) : KICK(0, dof, 0);
    else alike ? KICK(0, 0, 1) : KICK(0, 0, 0);
}

INLINE void drift_each(long n, const long *which, const long *dof, double dt, const real *velocity,
                       double *restrict displacement, real *restrict force)
{
    for (long k = 0; k < n; k++) {
        const long i = which ? which[k] : k, d = dof ? dof[i] : i;
        displacement[d] += dt * velocity[d];
        force[d] = 0;
    }
}

// work[0] += energy lost in dashpots, work[1] += work of prescribed motion; both by the mean of the velocities before and
// after forces acted for the time `kick`, at the `special` ones, where there is either.
void drift(long n, const long *which, const long *dof, long specials, const long *special, double dt, double kick,
           const double *mass, const double *dashpot, const double *driven, const double *owned,
           const double *velocity_old, const real *velocity, double *displacement, real *force, double *work)
{
    double lost = 0, driving = 0;
    for (long k = 0; k < specials; k++) {
        const long i = special[k], d = dof ? dof[i] : i;
        const double mean = 0.5 * (velocity_old[i] + velocity[d]);
        const double damping = dashpot[i] * mean;
        const double reaction = mass[i] * (velocity[d] - velocity_old[i]) / kick + damping - force[d];
        lost += owned[i] * damping * mean * kick;
        driving += owned[i] * driven[i] * reaction * mean * kick;
    }
    work[0] += lost;
    work[1] += driving;
    if (which) drift_each(n, which, dof, dt, velocity, displacement, force);
    else if (dof) drift_each(n, 0, dof, dt, velocity, displacement, force);
    else drift_each(n, 0, 0, dt, velocity, displacement, force);
}

// Damping forces of elements at the degrees of freedom `dof`.
void clear(long n, const long *dof, double *damping)
{
    for (long k = 0; k < n; k++)
        damping[dof[k]] = 0;
}

// damping = eta damping, and force += damping.
void add_damping(long n, const long *dof, double eta, double *damping, real *force)
{
    for (long k = 0; k < n; k++) {
        const double acting = eta * damping[dof[k]];
        damping[dof[k]] = acting;
        force[dof[k]] += acting;
    }
}

// Power of the damping force at the mean of the velocities before and after forces acted, those before at the indices
// `among`. Summed in blocks, for small rounding errors.
double damping_power(long n, const long *dof, const long *among, const double *damping, const double *velocity_old,
                     const real *velocity)
{
    double power = 0;
    for (long first = 0; first < n; first += 256) {
        const long end = first + 256 < n ? first + 256 : n;
        double block = 0;
        for (long k = first; k < end; k++)
            block += damping[dof[k]] * (0.5 * (velocity_old[among[k]] + velocity[dof[k]]));
        power += block;
    }
    return power;
}
