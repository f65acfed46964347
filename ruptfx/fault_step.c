// One explicit step of an interface: jumps, trial traction, projection, force. The blanks are filled in by fault_step.py
// from the traced contact method and friction law; the algorithm is that of projection.py, eight points at a time.
#include <math.h>

#define LANES 8
#define COMPONENTS $components
#define LOCAL $local
#define TANGENTS $tangents
#define NORMAL $has_normal
#define ONE_SIDED $one_sided
#define AT_END $at_end
#define EACH_LANE _Pragma("omp simd") for (int l = 0; l < LANES; l++)
// What a traced law takes, for a trial slip rate.
#define GIVEN(rate) const double slip_rate = rate, rate_before = along[l], speed_before = faster[l], \
    speed_then = was[l], normal_stress = sigma[l], radiation = 0; \
    (void)slip_rate; (void)rate_before; (void)speed_before; (void)speed_then; (void)normal_stress; (void)radiation;

static const double tolerance = $tolerance;
enum { max_iterations = $max_iterations, bisect_every = $bisect_every };

static inline double next_rate(double v, double low, double high, double residual, double slope, double z, double spread,
                               int bisect)
{
    // Newton in V where the impedance rules, in the logarithm of what the law sees where the law does; else, and now
    // and then, bisection.
    const double step = slope > 2 * z ? v + spread * expm1(residual / (slope * spread)) : v + residual / slope;
    const double floor_ = low > 1e-12 * high ? low : 1e-12 * high;
    const double middle = low > 1e-3 * high ? 0.5 * (low + high) : sqrt(floor_ * high);
    return step > low && step < high && !bisect ? step : middle;
}

// kick: how long the traction acts; since: time since the one before; carried: of the slip rate before in that now.
// result: [0] dissipated energy, [1] failing point or -1, [2..5] its trial normal stress, trial shear, Z, slip rate
void update(long n, double dt, double kick, double since, double extrapolation, double carried, double time,
            double threshold, const long *plus, const long *minus, const double *frame, const double *owned,
            const double *displacement, double *velocity, double *force, const double *inverse_mass,
            double *const *array, const double *number, double *result)
{
$unpack
    double dissipated_energy = 0;
    (void)extrapolation;
    result[1] = -1;
    for (long b = 0; b < n; b += LANES) {
        const int m = n - b < LANES ? (int)(n - b) : LANES;
        long at[LANES];
        double jump_u[LOCAL][LANES], jump_v[LOCAL][LANES];
        for (int l = 0; l < LANES; l++) {
            const long i = at[l] = b + (l < m ? l : m - 1);
            const double *r = frame + i * LOCAL * COMPONENTS;
            for (int k = 0; k < LOCAL; k++) {
                double u = 0, v = 0;
                for (int c = 0; c < COMPONENTS; c++) {
                    const long p = plus[i] * COMPONENTS + c, q = minus[i] * COMPONENTS + c;
                    u += r[k * COMPONENTS + c] * (displacement[p] - (ONE_SIDED ? 0 : displacement[q]));
                    v += r[k * COMPONENTS + c] * (velocity[p] - (ONE_SIDED ? 0 : velocity[q]));
                }
                jump_u[k][l] = u;
                jump_v[k][l] = v;
            }
        }
$load
        double trial_n[LANES], trial_s[TANGENTS][LANES], compliance[LANES], z[TANGENTS][LANES];
        double sigma[LANES], turning[TANGENTS][LANES], shifted[TANGENTS][LANES], way[TANGENTS][LANES];
        double along[LANES], taken[LANES], faster[LANES], size[LANES], mean_z[LANES], free_rate[LANES];
        double rest[LANES], v[LANES], low[LANES], high[LANES], active[LANES], now[LANES];
        EACH_LANE {
$bind_trial
$trial
            sigma[l] = trial_n[l] > 0 ? trial_n[l] : 0;
        }
        EACH_LANE {
            // What slid the other way has come to rest before it turns.
            double product = 0, square = 0, length = 0, loose = 0, trial_square = 0, shift_square = 0;
            for (int k = 0; k < TANGENTS; k++) {
                const double shift = carried * z[k][l] * old[k][l];
                product += old[k][l] * trial_s[k][l];
                square += old[k][l] * old[k][l];
                shift_square += shift * shift;
                trial_square += trial_s[k][l] * trial_s[k][l];
            }
            faster[l] = sqrt(square);
            const double turns = product > 0 && (carried > 0 || 4 * shift_square <= trial_square) ? carried : 0;
            for (int k = 0; k < TANGENTS; k++) {
                turning[k][l] = turns * old[k][l];
                shifted[k][l] = trial_s[k][l] + z[k][l] * turning[k][l];
                length += shifted[k][l] * shifted[k][l];
                const double part = z[k][l] > 0 ? shifted[k][l] / z[k][l] : 0;
                loose += TANGENTS == 1 ? fabs(part) : part * part;
            }
            size[l] = TANGENTS == 1 ? fabs(shifted[0][l]) : sqrt(length);
            along[l] = taken[l] = mean_z[l] = 0;
            for (int k = 0; k < TANGENTS; k++) {
                way[k][l] = size[l] > 0 ? shifted[k][l] / size[l] : 0;
                along[l] += product > 0 ? old[k][l] * way[k][l] : 0;
                taken[l] += turning[k][l] * way[k][l];
                mean_z[l] += way[k][l] * way[k][l] * z[k][l];
            }
            free_rate[l] = loose > 0 ? (TANGENTS == 1 ? loose : sqrt(loose)) - taken[l] : 0;
        }
$declare_start
        EACH_LANE {
            GIVEN(0)
$bind_start
$law_start
        }
        EACH_LANE {
            double strength;
            GIVEN(0)
$bind_law
$law_strength
            rest[l] = strength;
        }
        double any = 0;
        for (int l = 0; l < LANES; l++) {
            const double begin = size[l] - mean_z[l] * taken[l] - rest[l];
            double guess = 0;
            for (int k = 0; k < TANGENTS; k++) guess += old[k][l] * way[k][l];
            active[l] = sigma[l] > 0 && begin > 0 && free_rate[l] > 0;
            low[l] = 0;
            high[l] = free_rate[l];
            v[l] = sigma[l] > 0 ? 0 : free_rate[l];
            if (active[l]) v[l] = guess > 0 && guess < high[l] ? guess : fmin(begin / mean_z[l], high[l]);
            // Not a number anywhere: fails below.
            if (!isfinite(size[l] + trial_n[l] + rest[l])) v[l] = NAN, active[l] = 0;
            if (TANGENTS > 1 && sigma[l] <= 0)
                for (int k = 0; k < TANGENTS; k++)
                    way[k][l] = z[k][l] > 0 ? shifted[k][l] / z[k][l] / (free_rate[l] + taken[l]) : 0;
            any += active[l];
        }
        for (int iteration = 0; any > 0; iteration++) {
            const int bisect = iteration % bisect_every == bisect_every - 1;
            any = 0;
            _Pragma("omp simd reduction(+:any)")
            for (int l = 0; l < LANES; l++) {
                double strength, slope, rate_now, rate_slope;
                GIVEN(v[l])
$bind_law
$law_solved
                const double sliding = slip_rate + taken[l];
                double residual = size[l] - z[0][l] * sliding - strength, steep = slope + z[0][l];
                if (TANGENTS > 1) {
                    double ratio[TANGENTS], square = 0, mean = 0, sum = 0;
                    for (int k = 0; k < TANGENTS; k++) {
                        ratio[k] = shifted[k][l] / (strength + z[k][l] * sliding);
                        square += ratio[k] * ratio[k];
                    }
                    const double norm = sqrt(square);
                    for (int k = 0; k < TANGENTS; k++) {
                        const double d = ratio[k] / norm, q = strength + z[k][l] * sliding;
                        way[k][l] = active[l] != 0 ? d : way[k][l];
                        mean += d * d * q;
                        sum += d * d * (slope + z[k][l]) / q;
                    }
                    residual = mean * (norm - 1);
                    steep = mean * sum;
                }
                const double lo = residual > 0 ? slip_rate : low[l], hi = residual > 0 ? high[l] : slip_rate;
                const double done = fabs(residual) <= tolerance * size[l] || hi - lo <= 1e-15 * hi;
                const double go = active[l] != 0 && done == 0;
                const double next =
                    next_rate(slip_rate, lo, hi, residual, steep, mean_z[l], rate_now / rate_slope, bisect);
                low[l] = active[l] != 0 ? lo : low[l];
                high[l] = active[l] != 0 ? hi : high[l];
                // A strength that is not a number must not be taken for a converged one.
                const double moved = residual == residual ? next : (double)NAN;
                v[l] = go != 0 ? moved : slip_rate;
                active[l] = go != 0 && residual == residual;
                any += active[l];
            }
            if (iteration == max_iterations) {
                for (int l = 0; l < LANES; l++)
                    if (active[l]) v[l] = NAN;
                break;
            }
        }
$declare_new
        EACH_LANE {
            GIVEN(v[l])
$bind_law
$law_state
        }
        for (int l = 0; l < m; l++) {
            const long i = at[l];
            if (!isfinite(v[l])) {
                if (result[1] < 0) {
                    result[1] = i;
                    result[2] = trial_n[l], result[3] = size[l], result[4] = z[0][l], result[5] = was[l];
                }
                continue;
            }
            const int stuck = v[l] == 0 && sigma[l] > 0;
            double change[LOCAL], power = 0, square = 0;
            if (NORMAL) change[0] = -(sigma[l] - normal_stress_0[l]);
            for (int k = 0; k < TANGENTS; k++) {
                // Bodies start from rest, also where the interface creeps.
                const double rate_old = since > 0 ? old[k][l] : 0, traction_old = *tractions[k][l];
                double rate = stuck ? 0 : (v[l] + taken[l]) * way[k][l] - turning[k][l];
                const double traction = sigma[l] > 0 ? trial_s[k][l] - z[k][l] * rate : 0;
                double rate_now = stuck ? (AT_END ? 0 : 0.5 * old[k][l]) : now[l] * way[k][l];
                if (AT_END && since == 0) rate = old[k][l], rate_now = *rates[k][l];
$dissipated
                *rates[k][l] = rate_now;
                *means[k][l] = rate;
                *tractions[k][l] = traction;
                *slips[k][l] += since * (AT_END ? rate : old[k][l]);
                square += rate_now * rate_now;
                change[NORMAL + k] = traction - initial[k][l];
            }
            dissipated_energy += owned[i] * A_weight[i] * power * (AT_END ? since : kick);
            const double apart = (NORMAL ? jump_u[0][l] : 0)$gap;
            A_opening[i] = AT_END ? (sigma[l] - trial_n[l]) * compliance[l]
                                  : A_normal_stress[i] > 0 || apart < 0 ? 0 : apart;
            A_normal_stress[i] = sigma[l];
            const double speed = TANGENTS == 1 ? fabs(*rates[0][l]) : sqrt(square), speed_then = was[l];
            const double normal_stress = sigma[l], duration = AT_END ? since : kick;
            (void)speed, (void)speed_then, (void)normal_stress, (void)duration;
$bind_monitors
$monitors
$store_new
            const double *r = frame + i * LOCAL * COMPONENTS;
            for (int c = 0; c < COMPONENTS; c++) {
                double pull = 0;
                for (int k = 0; k < LOCAL; k++) pull += A_weight[i] * r[k * COMPONENTS + c] * change[k];
                const long p = plus[i] * COMPONENTS + c, q = minus[i] * COMPONENTS + c;
                velocity[p] -= kick * inverse_mass[p] * pull;
                // For the reaction where an edge that meets the interface is driven.
                force[p] -= pull;
                if (ONE_SIDED) continue;
                velocity[q] += kick * inverse_mass[q] * pull;
                force[q] += pull;
            }
        }
    }
    result[0] = dissipated_energy;
}
