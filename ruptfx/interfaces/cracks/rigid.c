// Bodies whose facets are rigid until their strength: corners that are tied to each other, the strength of tied facets, and
// the tractions of those that have been inserted. rigid.py writes in front of this file rigid_types.c, facet_law.c once
// for every group of facets, their table LAWS, and patch.c.

#define CHUNK 64  // facets looked at together

// -- corners that move together --------------------------------------------------------------------------------------

// Give the corners of every piece what they have together, in the order of the input; of all vertices or of a list.
void total(const struct rigid *r, long count, const int *list, const double *values, double *sums)
{
    for (long i = 0; i < count; i++) {
        const long v = list ? list[i] : i;
        const int *star = r->star + r->star_start[v];
        const int corners = r->star_start[v + 1] - r->star_start[v];
        for (int first = 0; first < corners; first++) {
            if (r->leader[star[first]] != star[first]) continue;
            double x = 0, y = 0;
            for (int c = first; c < corners; c++)
                if (r->leader[star[c]] == star[first]) {
                    x += values[2 * star[c]];
                    y += values[2 * star[c] + 1];
                }
            for (int c = first; c < corners; c++)
                if (r->leader[star[c]] == star[first]) {
                    sums[2 * star[c]] = x;
                    sums[2 * star[c] + 1] = y;
                }
            if (!r->split[v]) break;
        }
    }
}

INLINE void advance_each(const int viscid, const struct rigid *r, long count, double dt, const double *keep,
                         const double *push, double *force, double *velocity, double *displacement, double *viscous,
                         double *lost)
{
    couple taken = {0};
    for (long v = 0; v < count; v++) {
        if (r->left[v]) continue;
        const int *star = r->star + r->star_start[v];
        const int corners = r->star_start[v + 1] - r->star_start[v];
        couple sum = {0}, share = {0};
        for (int c = 0; c < corners; c++) {
            couple *const at = (couple *)(force + 2L * star[c]), *const of = (couple *)(viscous + 2L * star[c]);
            sum += *at;
            if (viscid) share += *of, *of = (couple){0};
            *at = (couple){0};
        }
        const long first = 2L * star[0];
        const couple old = load_couple(velocity + first), there = load_couple(displacement + first);
        const couple k = load_couple(keep + first), added = load_couple(push + first) * sum;
        const couple now = {FUSED(k[0], old[0], added[0]), FUSED(k[1], old[1], added[1])};
        const couple moved = {FUSED(dt, now[0], there[0]), FUSED(dt, now[1], there[1])};
        for (int c = 0; c < corners; c++) {
            *(couple *)(velocity + 2L * star[c]) = now;
            *(couple *)(displacement + 2L * star[c]) = moved;
        }
        if (viscid) taken += share * (old + now);
    }
    if (viscid) *lost -= 0.5 * (taken[0] + taken[1]);
}

// Velocity and displacement of all vertices that are whole and free: v = keep v + push f, u += dt v, alike at all corners.
// Forces there become zero; viscous ones among them, where there are any, have taken `lost`.
void advance(const struct rigid *r, long count, double dt, const double *keep, const double *push, double *force,
             double *velocity, double *displacement, double *viscous, double *lost)
{
    if (viscous) advance_each(1, r, count, dt, keep, push, force, velocity, displacement, viscous, lost);
    else advance_each(0, r, count, dt, keep, push, force, velocity, displacement, 0, 0);
}

// Pieces of the stars of some vertices: corners that tied facets connect, under their first one.
void split(const struct rigid *r, long count, const int *list)
{
    for (long i = 0; i < count; i++) {
        const long v = list[i];
        const int *star = r->star + r->star_start[v];
        const int corners = r->star_start[v + 1] - r->star_start[v];
        int piece[MOST_CORNERS], changed = 1;
        for (int c = 0; c < corners; c++) piece[c] = c;
        while (changed) {
            changed = 0;
            for (int e = r->ends_start[v]; e < r->ends_start[v + 1]; e++) {
                if (r->inserted[r->ends[e] / 2]) continue;
                int *minus = piece + r->place[2 * e], *plus = piece + r->place[2 * e + 1];
                if (*minus == *plus) continue;
                *minus = *plus = *minus < *plus ? *minus : *plus;
                changed = 1;
            }
        }
        r->split[v] = 0;
        for (int c = 0; c < corners; c++) {
            r->leader[star[c]] = star[piece[c]];
            r->split[v] |= piece[c] > 0;
        }
    }
}

// Normals of facets at the displacement, across the mean of both sides. Vertices advance one after the other, so that they
// are computed before the first of them does.
void orient(const struct rigid *r, const double *displacement)
{
    for (long f = 0; f < r->facets; f++) {
        const int *at = r->corner + 4 * f;  // both ends of the minus side, then of the plus side
        const double *first = displacement + 2L * at[0], *last = displacement + 2L * at[1];
        const double *over_first = displacement + 2L * at[2], *over_last = displacement + 2L * at[3];
        const double along = r->along[f];
        const double x = along * r->normal[2 * f + 1] + 0.5 * (last[0] + over_last[0] - first[0] - over_first[0]);
        const double y = -along * r->normal[2 * f] + 0.5 * (last[1] + over_last[1] - first[1] - over_first[1]);
        const double over = copysign(1 / sqrt(x * x + y * y), along);
        r->present[2 * f] = -y * over, r->present[2 * f + 1] = x * over;
    }
}

// -- strength --------------------------------------------------------------------------------------------------------

// Mean of the stresses of both cells on every facet that does not move, its traction; returns how many tied facets it is
// too much for, and which.
long check(const struct rigid *r, const double *displacement, double *const *state, int *found)
{
    const long cells = r->cells, facets = r->facets;
    double *const stress_xx = r->stress, *const stress_yy = stress_xx + cells, *const stress_xy = stress_yy + cells;
    const double *const g = r->gradient;
#pragma omp simd
    for (long c = 0; c < cells; c++) {
        double xx = 0, yy = 0, xy = 0;
#if LARGE_ROTATIONS
        double yx = 0;
#endif
        UNROLL for (int k = 0; k < 3; k++) {
            const long at = 2L * r->dof[k * cells + c];
            const double x = displacement[at], y = displacement[at + 1];
            const double along_x = g[2 * k * cells + c], along_y = g[(2 * k + 1) * cells + c];
            xx += along_x * x;
            yy += along_y * y;
#if LARGE_ROTATIONS
            xy += along_y * x, yx += along_x * y;
#else
            xy += along_y * x + along_x * y;
#endif
        }
#if LARGE_ROTATIONS  // F = R U: the strain is U - 1, in the frame of the cell
        const double both = 1 / sqrt((2 + xx + yy) * (2 + xx + yy) + (yx - xy) * (yx - xy));
        const double cosine = (2 + xx + yy) * both, sine = (yx - xy) * both, of_y = 1 + yy;
        xx = cosine * (1 + xx) + sine * yx - 1;
        yy = cosine * of_y - sine * xy - 1;
        xy = 2 * (cosine * xy + sine * of_y);
#endif
        const double *stiffness = r->stiffness + 6 * r->body[c];
        stress_xx[c] = stiffness[0] * xx + stiffness[1] * yy + stiffness[2] * xy;
        stress_yy[c] = stiffness[1] * xx + stiffness[3] * yy + stiffness[4] * xy;
        stress_xy[c] = stiffness[2] * xx + stiffness[4] * yy + stiffness[5] * xy;
#if LARGE_ROTATIONS  // R S R'
        const double mean = 0.5 * (stress_xx[c] + stress_yy[c]), half = 0.5 * (stress_xx[c] - stress_yy[c]);
        const double cosine_2 = cosine * cosine - sine * sine, sine_2 = 2 * cosine * sine;
        const double turned = cosine_2 * half - sine_2 * stress_xy[c];
        stress_xy[c] = sine_2 * half + cosine_2 * stress_xy[c];
        stress_xx[c] = mean + turned, stress_yy[c] = mean - turned;
#endif
#if PRELOADED
        stress_xx[c] += r->initial[0], stress_yy[c] += r->initial[1], stress_xy[c] += r->initial[2];
#endif
    }
    long count = 0;
    for (long first = 0; first < facets; first += CHUNK) {
        const long end = first + CHUNK < facets ? first + CHUNK : facets;
        double normals[CHUNK], shears[CHUNK];
        long look = 0;
#pragma omp simd reduction(| : look)
        for (long f = first; f < end; f++) {
            const int a = r->cell[2 * f], b = r->cell[2 * f + 1];
            const double nx = r->present[2 * f], ny = r->present[2 * f + 1];
            const double xx = 0.5 * (stress_xx[a] + stress_xx[b]), yy = 0.5 * (stress_yy[a] + stress_yy[b]);
            const double xy = 0.5 * (stress_xy[a] + stress_xy[b]);
            const double x = xx * nx + xy * ny, y = xy * nx + yy * ny;
            const double normal = x * nx + y * ny, shear = x * ny - y * nx;
            normals[f - first] = normal, shears[f - first] = shear;
            const double *strength = r->strength + 2 * r->group[f];
            look |= (normal >= strength[0]) | (fabs(shear) >= strength[1]) | (r->inserted[f] != 0);
        }
        if (!look) {  // as almost everywhere
            double *const at_normal = state[STATE_normal_traction], *const at_shear = state[STATE_shear_traction];
            for (long f = first; f < end; f++) {
                at_normal[2 * f] = at_normal[2 * f + 1] = normals[f - first];
                at_shear[2 * f] = at_shear[2 * f + 1] = shears[f - first];
            }
            continue;
        }
        for (long f = first; f < end; f++) {
            const double normal = normals[f - first], shear = shears[f - first];
            for (int e = 0; e < 2; e++)  // an end that cannot move yet carries what the bodies give
                if (!r->inserted[f] || r->leader[r->corner[4 * f + e]] == r->leader[r->corner[4 * f + 2 + e]]) {
                    state[STATE_normal_traction][2 * f + e] = normal;
                    state[STATE_shear_traction][2 * f + e] = shear;
                }
            const double *strength = r->strength + 2 * r->group[f];
            int breaks = normal >= strength[0];
            if (!breaks && fabs(shear) >= strength[1]) {
                const double pressure = normal < 0 ? -normal : 0;
                const double friction =
                    LAWS[r->group[f]].friction(r->number + r->first_number[r->group[f]], state, 2 * f, pressure);
                breaks = fabs(shear) >= strength[1] + (pressure > 0 ? friction : 0);
            }
            if (breaks && !r->inserted[f]) found[count++] = (int)f;
        }
    }
    return count;
}

// -- inserted facets -------------------------------------------------------------------------------------------------

// Opening and slip at the displacement, damage and state, and what they leave of the strength.
static void begin(const struct rigid *r, struct end *end, double since, const double *displacement,
                  double *const *state)
{
    const long f = end->at / 2, l = end->at;
    const int minus = r->corner[4 * f + l % 2], plus = r->corner[4 * f + 2 + l % 2];
    const double x = displacement[2 * plus] - displacement[2 * minus];
    const double y = displacement[2 * plus + 1] - displacement[2 * minus + 1];
    end->nx = r->present[2 * f], end->ny = r->present[2 * f + 1], end->weight = r->weight[f];
    end->law = &LAWS[r->group[f]], end->number = r->number + r->first_number[r->group[f]];
    end->open = x * end->nx + y * end->ny;
    end->slip = x * end->ny - y * end->nx;
    end->normal = OLD(normal_traction), end->shear = OLD(shear_traction);
    const double slid = fabs(end->slip - OLD(slip));
    if (OLD(damage) < 1) {
        if (end->open > OLD(largest_opening)) OLD(largest_opening) = end->open;
        OLD(cohesive_slip) += slid;
        const double damage = end->law->damage(end->number, OLD(largest_opening), OLD(cohesive_slip));
        if (damage > OLD(damage)) OLD(damage) = damage < 1 ? damage : 1;
    }
    if (since > 0)
        end->law->advance(end->number, state, l, slid / since, end->normal < 0 ? -end->normal : 0, since);
    const double left = OLD(damage) < 1 ? end->law->left(end->number, OLD(damage)) : 0;
    end->largest = OLD(largest_opening);
    end->most = r->strength[2 * r->group[f]] * left;
    end->cohesive = r->strength[2 * r->group[f] + 1] * left;
}

// Traction per velocity of both pieces along a direction, over the time that the traction acts.
static double impedance(double weight, const double *a, const double *b, double x, double y)
{
    const double mobility = weight * (x * x * (a[0] + b[0]) + y * y * (a[1] + b[1]));
    return mobility > 0 ? 1 / mobility : 0;
}

// Tractions at the ends of one vertex, and what they do to its pieces; energies of owned facets are added to `taken`.
static void vertex(const struct rigid *r, long v, double dt, double kick, double since, const double *displacement,
                   const double *push, const double *before, double *velocity, double *force, double *const *state,
                   double *taken)
{
    const int *star = r->star + r->star_start[v];
    const int corners = r->star_start[v + 1] - r->star_start[v];
    double speed[MOST_CORNERS][2], now[MOST_CORNERS][2], mobility[MOST_CORNERS][2], sum[MOST_CORNERS][2];
    int piece[MOST_CORNERS], first[MOST_CORNERS];  // component of every corner, first corner of every component
    struct end ends[MOST_ENDS];
    struct patch patch = {0, 0, dt, 0, state, speed, mobility, now, ends};
    for (int c = 0; c < corners; c++) {
        const int leader = r->leader[star[c]];
        for (piece[c] = 0; piece[c] < patch.pieces && star[first[piece[c]]] != leader;) piece[c]++;
        if (piece[c] < patch.pieces) continue;
        first[patch.pieces++] = c;
        for (int i = 0; i < 2; i++) {
            speed[piece[c]][i] = velocity[2 * star[c] + i];
            mobility[piece[c]][i] = push[2 * star[c] + i];
            sum[piece[c]][i] = 0;
        }
    }
    for (int e = r->ends_start[v]; e < r->ends_start[v + 1]; e++) {
        const int minus = piece[r->place[2 * e]], plus = piece[r->place[2 * e + 1]];
        if (minus == plus || !(r->weight[r->ends[e] / 2] > 0)) continue;  // tied, or left to collision contact
        struct end *end = ends + patch.count++;
        end->at = r->ends[e], end->minus = minus, end->plus = plus;
        begin(r, end, since, displacement, state);
        end->z_normal = impedance(end->weight, mobility[minus], mobility[plus], end->nx, end->ny);
        end->z_shear = impedance(end->weight, mobility[minus], mobility[plus], end->ny, -end->nx);
        if (end->z_normal == 0) end->normal = 0;
        if (end->z_shear == 0) end->shear = 0;
#if PRELOADED  // the bodies are in equilibrium with the initial tractions: only what exceeds them acts on the components
        const double *initial = r->initial;
        const double fx = end->weight * (initial[0] * end->nx + initial[2] * end->ny);
        const double fy = end->weight * (initial[2] * end->nx + initial[1] * end->ny);
        sum[minus][0] -= fx, sum[minus][1] -= fy, sum[plus][0] += fx, sum[plus][1] += fy;
#endif
        const double size = fabs(end->normal) + fabs(end->shear) + r->strength[2 * r->group[end->at / 2]];
        patch.scale = fmax(patch.scale, size);
    }
#if PRELOADED
    for (int p = 0; p < patch.pieces; p++)
        for (int i = 0; i < 2; i++) speed[p][i] += mobility[p][i] * sum[p][i];
#endif
    const int count = patch.count;
    const double error = count ? solve(&patch) : 0;
    if (!(error <= taken[3])) taken[3] = error, taken[4] = v;
    for (int e = 0; e < count; e++) {
        const struct end *end = ends + e;
        const double fx = end->weight * (end->normal * end->nx + end->shear * end->ny);
        const double fy = end->weight * (end->normal * end->ny - end->shear * end->nx);
        sum[end->minus][0] += fx, sum[end->minus][1] += fy;
        sum[end->plus][0] -= fx, sum[end->plus][1] -= fy;
    }
    for (int c = 0; c < corners; c++)
        for (int i = 0; i < 2; i++) {
            velocity[2 * star[c] + i] += mobility[piece[c]][i] * sum[piece[c]][i];
            force[2 * star[c] + i] += sum[piece[c]][i];
        }
    for (int e = 0; e < count; e++) {
        const struct end *end = ends + e;
        const long l = end->at, a = 2 * star[first[end->minus]], b = 2 * star[first[end->plus]];
        const double x = 0.5 * (velocity[b] + before[b] - velocity[a] - before[a]);
        const double y = 0.5 * (velocity[b + 1] + before[b + 1] - velocity[a + 1] - before[a + 1]);
        const double opening = end->open > 0 ? end->open : 0;
        const double tension = end->normal > 0 ? end->normal : 0, former = OLD(normal_traction) > 0 ? OLD(normal_traction) : 0;
        const double pulled = end->normal * (x * end->nx + y * end->ny) * kick;
        const double rubbed = end->shear * (x * end->ny - y * end->nx) * kick;
        const double kept = 0.5 * (tension * opening - former * OLD(inelastic_opening));
        const double part = cohesive_share(end->cohesive, fabs(end->shear));
        const double area = end->weight * r->owned[l / 2];
        taken[0] += area * (1 - part) * rubbed;
        taken[1] += area * (part * rubbed + (end->normal > 0 ? pulled : 0) - kept);
        taken[2] += area * (end->normal > 0 ? 0 : pulled);
        OLD(normal_traction) = end->normal;
        OLD(shear_traction) = end->shear;
        OLD(inelastic_opening) = opening;
        OLD(slip) = end->slip;
    }
}

// Kinetic energy of the corners of a facet [J].
static double kinetic(const struct rigid *r, long f, const double *velocity)
{
    double energy = 0;
    for (int i = 0; i < 4; i++)
        for (int c = 0; c < 2; c++) {
            const int d = 2 * r->corner[4 * f + i] + c;
            energy += 0.5 * r->mass[d] * velocity[d] * velocity[d];
        }
    return energy;
}

// The facets that are inserted now.
void insert(const struct rigid *r, long count, const int *list, double time, const double *velocity,
            double *const *facet)
{
    for (long i = 0; i < count; i++) {
        facet[FACET_time_of_yield][list[i]] = time;
        facet[FACET_energy_at_yield][list[i]] = kinetic(r, list[i], velocity);
    }
}

// Tractions of inserted facets at the displacement, and the velocity after them, at vertices whose star is in components.
void hold(const struct rigid *r, long count, const int *vertices, double dt, double kick, double since,
          const double *displacement, const double *push, const double *before, double *velocity, double *force,
          double *const *state, double *taken)
{
    for (long i = 0; i < count; i++)
        vertex(r, vertices[i], dt, kick, since, displacement, push, before, velocity, force, state, taken);
}

// Record the largest gain of kinetic energy beside inserted facets until they fail, and when and with which slip they fail.
void listen(const struct rigid *r, long facets, const int *waiting, double time, const double *velocity,
            double *const *state, double *const *facet)
{
    for (long i = 0; i < facets; i++) {
        const long f = waiting[i];
        const double energy = kinetic(r, f, velocity) - facet[FACET_energy_at_yield][f];
        if (energy > facet[FACET_energy_gain][f]) {
            facet[FACET_energy_gain][f] = energy;
            facet[FACET_time_of_gain][f] = time;
        }
        if (state[STATE_damage][2 * f] >= 1 && state[STATE_damage][2 * f + 1] >= 1) {
            facet[FACET_time_of_failure][f] = time;
            facet[FACET_slip_at_failure][f] = 0.5 * (state[STATE_slip][2 * f] + state[STATE_slip][2 * f + 1]);
        }
    }
}
