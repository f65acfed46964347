// The nodes the bulk kernel leaves to the stepper: interfaces, boundaries, nodes shared with other ranks.  Where these are
// all there are, `dof` is null.

#define INLINE static inline __attribute__((always_inline))

INLINE void kick_each(long n, const long *dof, const double *keep, const double *push, const double *force,
                      double *restrict velocity, double *restrict velocity_old)
{
    for (long i = 0; i < n; i++) {
        const long d = dof ? dof[i] : i;
        velocity_old[i] = velocity[d];
        velocity[d] = keep[i] * velocity[d] + push[i] * force[d];
    }
}

// Velocity half a step later without contact: v = keep v + push f; the old velocity is kept for the work integrals.
void kick(long n, const long *dof, const double *keep, const double *push, const double *force, double *velocity,
          double *velocity_old)
{
    if (dof) kick_each(n, dof, keep, push, force, velocity, velocity_old);
    else kick_each(n, 0, keep, push, force, velocity, velocity_old);
}

INLINE void drift_each(long n, const long *dof, double dt, const double *velocity, double *restrict displacement,
                       double *restrict force)
{
    for (long i = 0; i < n; i++) {
        const long d = dof ? dof[i] : i;
        displacement[d] += dt * velocity[d];
        force[d] = 0;
    }
}

// work[0] += energy lost in dashpots, work[1] += work of prescribed motion; both by the mean of the velocities before and
// after forces acted for the time `kick`, at the `special` ones, where there is either.
void drift(long n, const long *dof, long specials, const long *special, double dt, double kick, const double *mass,
           const double *dashpot, const double *driven, const double *owned, const double *velocity_old,
           const double *velocity, double *displacement, double *force, double *work)
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
    if (dof) drift_each(n, dof, dt, velocity, displacement, force);
    else drift_each(n, 0, dt, velocity, displacement, force);
}
