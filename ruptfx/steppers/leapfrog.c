// The nodes the bulk kernel leaves to the stepper: interfaces, boundaries, nodes shared with other ranks.

// Velocity half a step later without contact: v = keep v + push f; the old velocity is kept for the work integrals.
void kick(long n, const long *dof, const double *keep, const double *push, const double *force, double *velocity,
          double *velocity_old)
{
    for (long i = 0; i < n; i++) {
        const long d = dof[i];
        velocity_old[i] = velocity[d];
        velocity[d] = keep[i] * velocity[d] + push[i] * force[d];
    }
}

// work[0] += energy lost in dashpots, work[1] += work of prescribed motion; both by the mean of the velocities before and
// after forces acted for the time `kick`.
void drift(long n, const long *dof, double dt, double kick, const double *mass, const double *dashpot,
           const double *driven, const double *owned, const double *velocity_old, const double *velocity,
           double *displacement, double *force, double *work)
{
    double lost = 0, driving = 0;
    for (long i = 0; i < n; i++) {
        const long d = dof[i];
        const double mean = 0.5 * (velocity_old[i] + velocity[d]);
        const double damping = dashpot[i] * mean;
        const double reaction = mass[i] * (velocity[d] - velocity_old[i]) / kick + damping - force[d];
        lost += owned[i] * damping * mean * kick;
        driving += owned[i] * driven[i] * reaction * mean * kick;
        displacement[d] += dt * velocity[d];
        force[d] = 0;
    }
    work[0] += lost;
    work[1] += driving;
}
