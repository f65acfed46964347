// What an interface answers to a displacement at the end of an implicit step, LANES points at a time: traction, its exact
// tangent and all fields. points.c is in front of this file.

// Rows of an array as lanes; the last point stands in for those that are missing.
INLINE void take(long first, int count, const double *rows, int width, lanes *taken)
{
    for (int k = 0; k < width; k++)
        for (int l = 0; l < LANES; l++) taken[k][l] = rows[(first + (l < count ? l : count - 1)) * width + k];
}

// dT / d[u]. t - Z V = strength(V, sigma, b), t and b the parts of trial and V_before along the traction, is
// differentiated, and the direction d, which turns with the trial: V = (V + c) d - k V_before with c the part of
// k V_before along it. The trial has the stiffness Z / dt along the interface and 1 / compliance across.
INLINE void differentiate(const struct times *times, const struct points *points, lanes *tangent)
{
    EACH_LANE {
        const double z = points->z[0][l], stiffness = z / times->since, rate = points->rate[l];
        const int closed = points->sigma[l] > 0, together = TOGETHER(points->sigma[l]), slides = rate > 0;
        const double bend = slides ? 1 / points->size[l] : 0;
        // (Z + dstrength/dV) dV = dt - dstrength/db db - dstrength/dsigma dsigma; an open interface has no strength
        const double yields = slides ? 1 / (z + (together ? points->slope[l] : 0)) : 0, by_stress = closed ? points->stress_slope[l] : 0;
        const double by_before = together ? points->before_slope[l] : 0;
        double product = 0, before_along = 0, shift_along = 0;
        EACH_TANGENT {
            product += OLD(mean_slip_rate + k) * points->trial_shear[k][l];
            before_along += OLD(mean_slip_rate + k) * points->direction[k][l];
            shift_along += points->shift[k][l] * points->direction[k][l];
        }
        const int forward = product > 0;
        if (NORMAL) {
            const double normal = 1 / points->compliance[l];
            tangent[0][l] = closed ? normal : 0;
            for (int k = 0; k < TANGENTS; k++) {
                tangent[1 + k][l] = 0;
                // Opening lowers the trial pressure, and the slip rate grows for it.
                tangent[LOCAL * (1 + k)][l] = -z * normal * yields * by_stress * points->direction[k][l];
            }
        }
        for (int j = 0; j < TANGENTS; j++) {
            const double d = points->direction[j][l];
            // What is across the direction, over the size of the trial.
            const double before = forward ? bend * (OLD(mean_slip_rate + j) - before_along * d) : 0;
            const double shift = bend * (points->shift[j][l] - shift_along * d);
            const double by_size = yields * (d - z * shift - by_before * before);
            for (int i = 0; i < TANGENTS; i++) {
                const double across = (i == j) - points->direction[i][l] * d;
                const double slips = points->direction[i][l] * (by_size + shift) + (rate + shift_along) * bend * across;
                tangent[LOCAL * (NORMAL + i) + NORMAL + j][l] = stiffness * ((i == j) - z * slips);
            }
        }
    }
}

#if BONDED
// What the damage changes in the tangent. D = damage(w, s) is differentiated, with the opening w, which follows from the
// pull p of the trial, w = compliance (p - T), and the slip s, which follows from the slip rate.
INLINE void soften(const struct times *times, const double *number, const struct points *points, lanes *tangent)
{
    (void)number;
    const double since = times->since;
    EACH_LANE {
        const double z = points->z[0][l], stiffness = z / since, compliance = points->compliance[l];
        const double bond_damage = NEW(damage), bond_opening = NEW(largest_opening), bond_slip = NEW(damaging_slip);
        double left_slope, by_opening, by_slip;
        { LEFT_SLOPE }
        { DAMAGE_SLOPES }
        // A damage that is not smooth in pure modes makes Newton's iteration slower there, no more.
        by_opening = isfinite(by_opening) ? by_opening : 0;
        by_slip = isfinite(by_slip) ? by_slip : 0;
        const int grows = bond_damage > OLD(damage) && bond_damage < 1, opens = bond_opening > OLD(largest_opening);
        const double most = points->tension[l], pulled = -points->trial_normal[l], before = OLD(largest_opening);
        const double open_by = before / compliance;
        // T by the pull, and by the damage, with the other one as it is.
        double by_pull;
        const int presses = pulled < 0, yields_now = admissible_normal(pulled, most, open_by, &by_pull) >= most;
        const double by_strength = presses ? 0 : yields_now ? 1 : pulled * open_by / ((most + open_by) * (most + open_by));
        const double by_damage = grows ? by_strength * TENSILE_STRENGTH * left_slope : 0;
        const double yields = points->rate[l] > 0 ? 1 / (z + (TOGETHER(points->sigma[l]) ? points->slope[l] : 0)) : 0;
        const double weakens = grows ? COHESION * left_slope : 0;
        double size = 0, along = 0;
        EACH_TANGENT size += NEW(mean_slip_rate + k) * NEW(mean_slip_rate + k);
        size = sqrt(size);
        const double slips = grows && size > 0 ? by_slip * since / size : 0;
        EACH_TANGENT along += NEW(mean_slip_rate + k) * points->direction[k][l];
        const double open = grows && opens ? by_opening * compliance : 0;
        const double whole = 1 + open * by_damage + slips * yields * along * weakens;
        for (int j = 0; j < LOCAL; j++) {
            double damages = NORMAL && j == 0 ? open * (1 - by_pull) / compliance : 0;
            EACH_TANGENT {
                const double own = NORMAL + k == j ? stiffness : 0;
                damages += slips * NEW(mean_slip_rate + k) * (own - tangent[LOCAL * (NORMAL + k) + j][l]) / z;
            }
            damages = grows ? damages / whole : 0;
            if (NORMAL) tangent[j][l] = (j == 0 ? by_pull / compliance : 0) + by_damage * damages;
            EACH_TANGENT tangent[LOCAL * (NORMAL + k) + j][l] += z * yields * points->direction[k][l] * weakens * damages;
        }
    }
}
#endif

// Rows per point: jump, change and tangent of LOCAL, LOCAL and LOCAL^2 components, multiplier of normal stress and shear
// traction, near the size of a mean slip rate. result: as points.c says.
void respond(long n, const struct times *times, const double *jump, const double *multiplier,
             const double *body_stiffness, const double *radiation, const double *near, const double *fixed,
             const double *number, double *const *old, double *const *new, double *change, double *tangent,
             double *result)
{
    lanes dissipated = {0};
    result[1] = -1;
    for (long first = 0; first < n; first += LANES) {
        struct points points;
        lanes slopes[LOCAL * LOCAL];
        const int count = n - first < LANES ? (int)(n - first) : LANES;
        points.fixed = (const lanes *)(fixed + first * FIXED_COUNT);
        load(first, count, old, &points);
        take(first, count, jump, LOCAL, points.jump);
        take(first, count, multiplier, 1 + TANGENTS, points.multiplier);
        take(first, count, body_stiffness, 1, &points.body_stiffness);
        take(first, count, radiation, 1, &points.radiation);
        take(first, count, near, 1, &points.near);
        point(times, number, &points);
        if (failed(first, count, &points, result)) return;
        write_back(count, times, number, &points, dissipated);
        store(first, count, new, &points);
        differentiate(times, &points, slopes);
#if BONDED
        soften(times, number, &points, slopes);
#endif
        for (int l = 0; l < count; l++) {
            for (int k = 0; k < LOCAL; k++) change[(first + l) * LOCAL + k] = points.change[k][l];
            for (int k = 0; k < LOCAL * LOCAL; k++) tangent[(first + l) * LOCAL * LOCAL + k] = slopes[k][l];
        }
    }
    result[0] = 0;
    for (int l = 0; l < LANES; l++) result[0] += dissipated[l];
}
