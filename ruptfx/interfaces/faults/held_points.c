// The step at points whose normal and tangential motion is coupled by the mass (held_points.py), after fault_step.c: the
// same trial, projection and write-back, repeated with what the other components of the traction do to each velocity.

// Largest number of projections of a point, and those after a residual that grew.
enum { MOST_PASSES = 60, PLAIN_PASSES = 3 };
// Size of the tractions over that in the first projection, from which on they grow without bound: the point is jammed.
#define DIVERGED 1e3

#define MOBILITY(i, j) FIXED(mobility_block + (i) * LOCAL + (j))

// Change of the traction that stops the jump and closes the point, for the velocity without contact.
INLINE double sticking(const struct points *points, const lanes *rate, double dt, int k, int l)
{
    double sum = 0;
    for (int j = 0; j < LOCAL; j++) {
        const double speed = rate[j][l] + (NORMAL && j == 0 ? points->opening[l] / dt : 0);
        sum += FIXED(sticking_block + k * LOCAL + j) * speed;
    }
    return sum;
}

INLINE void coupled_point(const struct times *times, const double *number, struct points *points)
{
    UNPACK_TIMES
    lanes rate[LOCAL], shear[TANGENTS], moved[TANGENTS], missing[TANGENTS], inverse[TANGENTS][TANGENTS];
    lanes normal, active, best, first;
    int plain[LANES];
    EACH_LANE {
        points->opening[l] = (NORMAL ? points->jump[0][l] : 0) + FIXED(gap);
        for (int k = 0; k < LOCAL; k++) rate[k][l] = points->velocity[k][l];
        EACH_TANGENT shear[k][l] = sticking(points, rate, dt, NORMAL + k, l);
        for (int i = 0; i < TANGENTS; i++) EACH_TANGENT inverse[i][k][l] = i == k ? -1 : 0;
        normal[l] = 0, active[l] = 1, best[l] = 0, plain[l] = 0;
    }
    for (int pass = 0;; pass++) {
        // The normal stress under the shear traction, then the shear trial under both.
        EACH_LANE {
            const double push = kick * FIXED(weight);
            if (NORMAL) {
                double sum = 0;
                EACH_TANGENT sum += MOBILITY(0, NORMAL + k) * shear[k][l];
                points->velocity[0][l] = rate[0][l] - push * sum;
            }
            TRIAL
            const double bonded = BONDED && pass > 0 ? points->sigma[l] : 0;
            normal[l] = active[l] == 0 ? normal[l] : points->trial_normal[l] > 0 || IS_HELD ? points->trial_normal[l] : bonded;
            for (int i = 0; i < TANGENTS; i++) {
                double sum = NORMAL ? MOBILITY(NORMAL + i, 0) * (FIXED(normal_stress_0) - normal[l]) : 0;
                EACH_TANGENT sum += MOBILITY(NORMAL + i, NORMAL + k) * shear[k][l];
                points->velocity[NORMAL + i][l] = rate[NORMAL + i][l] - push * sum + shear[i][l] / FIXED(shear_impedance + i);
            }
        }
        point(times, number, points);
        double any = 0;
        for (int l = 0; l < LANES; l++) {
            if (active[l] == 0) continue;
            double size = fabs(FIXED(normal_stress_0)) + fabs(points->sigma[l]), error = 0, square = 0;
            double change[TANGENTS], added[TANGENTS];
            if (NORMAL) error = fabs(points->sigma[l] - normal[l]);
            EACH_TANGENT {
                const double traction = NEW(shear_traction + k);
                change[k] = traction - FIXED(shear_traction_0 + k);
                added[k] = change[k] - shear[k][l];
                error = fmax(error, fabs(added[k]));
                size += fabs(traction) + fabs(shear[k][l]) + FIXED(shear_impedance + k) * fabs(rate[NORMAL + k][l]);
                square += added[k] * added[k];
            }
            if (NORMAL) size += FIXED(normal_impedance) * fabs(rate[0][l]);
            if (pass == 0) first[l] = size;
            const int converged = error <= TOLERANCE * size, ends = pass == MOST_PASSES;
            if (ends && !(size <= DIVERGED * first[l])) points->rate[l] = (double)NAN;
            active[l] = !(converged || ends || !isfinite(points->rate[l]));
            any += active[l];
            if (active[l] == 0) continue;
            // Broyden's method for change - shear = 0, in the plane the secant method. Where the residual grows, as at the
            // onset of sliding, it begins again after projections without it.
            double way[TANGENTS];
            if (pass > 0) {
                double bent[TANGENTS], row[TANGENTS], scale = 0;
                EACH_TANGENT bent[k] = row[k] = 0;
                for (int i = 0; i < TANGENTS; i++)
                    EACH_TANGENT {
                        bent[i] += inverse[i][k][l] * (added[k] - missing[k][l]);
                        row[k] += moved[i][l] * inverse[i][k][l];
                    }
                EACH_TANGENT scale += moved[k][l] * bent[k];
                if (scale != 0)
                    for (int i = 0; i < TANGENTS; i++)
                        EACH_TANGENT inverse[i][k][l] += (moved[i][l] - bent[i]) * row[k] / scale;
            }
            if (pass > 0 && !(square < best[l])) {
                plain[l] = PLAIN_PASSES;
                for (int i = 0; i < TANGENTS; i++) EACH_TANGENT inverse[i][k][l] = i == k ? -1 : 0;
            }
            best[l] = square;
            for (int i = 0; i < TANGENTS; i++) {
                way[i] = 0;
                EACH_TANGENT way[i] -= inverse[i][k][l] * added[k];
                if (plain[l] > 0) way[i] = added[i];
            }
            plain[l] -= plain[l] > 0;
            EACH_TANGENT {
                moved[k][l] = way[k], missing[k][l] = added[k];
                shear[k][l] += way[k];
            }
        }
        if (any == 0) return;
    }
}

// Keep the fields of some points before the step of all.
void keep(long n, const long *index, double *const *field, double *kept)
{
    for (int i = 0; i < STATE_COUNT; i++)
        for (long p = 0; p < n; p++) kept[i * n + p] = field[i][index[p]];
}

// Repeat `update` for the points with these indices, from the copies of their fields: `update` has overwritten these.
void update_held(long n, const long *index, const double *kept, const struct times *times, const long *plus,
                 const long *minus, const double *displacement, real *velocity, real *force, const double *fixed,
                 const double *number, double *const *field, double *result)
{
    lanes dissipated = {0};
    memset(result, 0, 8 * sizeof *result);
    result[1] = -1;
    for (long first = 0; first < n; first += LANES) {
        struct points points;
        const int count = n - first < LANES ? (int)(n - first) : LANES;
        points.fixed = (const lanes *)(fixed + first * FIXED_COUNT);
        for (int i = 0; i < STATE_COUNT; i++)
            for (int l = 0; l < LANES; l++) points.old[i][l] = kept[i * n + first + (l < count ? l : count - 1)];
        gather(plus + first, minus + first, displacement, velocity, &points);
        coupled_point(times, number, &points);
        if (failed(first, count, &points, result)) return;
        write_back(count, times, number, &points, dissipated);
        for (int l = 0; l < count; l++) result[7] += points.contact_loss[l];
#if BONDED
        for (int l = 0; l < count; l++) result[6] += points.fractured[l];
#endif
        for (int i = 0; i < STATE_COUNT; i++)
            for (int l = 0; l < count; l++) field[i][index[first + l]] = points.new[i][l];
        push(count, times->kick, plus + first, minus + first, &points, velocity, force);
    }
    for (int l = 0; l < LANES; l++) result[0] += dissipated[l];
}
