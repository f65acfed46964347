// One explicit step of an interface: jumps, trial traction, projection, force.  The blanks are filled in by fault.py from
// the traced contact method and friction law; the algorithm is that of projection.py, eight points at a time.
#include <math.h>

#define LANES 8
#define COMPONENTS $components
#define LOCAL $local
#define TANGENTS $tangents
#define NORMAL $has_normal
#define ONE_SIDED $one_sided
#define EACH_LANE _Pragma("omp simd") for (int l = 0; l < LANES; l++)

static const double tolerance = $tolerance;
enum { max_iterations = $max_iterations, bisect_every = $bisect_every };

static inline double next_rate(double v, double low, double high, double residual, double slope, double z, int bisect)
{
    // Newton in V where the impedance rules, in log V where the law does; else, and now and then, bisection.
    const double step = slope > 2 * z ? v * exp(residual / (slope * v)) : v + residual / slope;
    const double floor_ = low > 1e-12 * high ? low : 1e-12 * high;
    const double middle = low > 1e-3 * high ? 0.5 * (low + high) : sqrt(floor_ * high);
    return step > low && step < high && !bisect ? step : middle;
}

// result: [0] dissipated energy, [1] failing point or -1, [2..5] its trial normal stress, trial shear, Z, slip rate
void update(long n, double dt, double time, double threshold, const long *plus, const long *minus,
            const double *frame, const double *owned, const double *displacement, double *velocity, double *force,
            const double *inverse_mass, double *const *array, const double *number, double *result)
{
$unpack
    double dissipated_energy = 0;
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
        double trial_n[LANES], trial_s[TANGENTS][LANES], compliance[LANES], z[LANES];
        double sigma[LANES], trial[LANES], rest[LANES], v[LANES], low[LANES], high[LANES], active[LANES];
        EACH_LANE {
$bind_trial
$trial
            sigma[l] = trial_n[l] > 0 ? trial_n[l] : 0;
            double square = 0;
            for (int k = 0; k < TANGENTS; k++) square += trial_s[k][l] * trial_s[k][l];
            trial[l] = TANGENTS == 1 ? fabs(trial_s[0][l]) : sqrt(square);
        }
        EACH_LANE {
            double strength, slope;
            const double slip_rate = 0, normal_stress = sigma[l];
$bind_law
$law_strength
            rest[l] = strength;
        }
        double any = 0;
        for (int l = 0; l < LANES; l++) {
            const double free_rate = trial[l] / z[l];
            const double guess = guess_rate[l];
            active[l] = sigma[l] > 0 && trial[l] > rest[l];
            low[l] = 0;
            high[l] = free_rate;
            v[l] = sigma[l] > 0 ? 0 : free_rate;
            if (active[l]) v[l] = guess > 0 && guess < free_rate ? guess : (trial[l] - rest[l]) / z[l];
            // Not a number anywhere: fails below.
            if (!isfinite(trial[l] + trial_n[l] + rest[l])) v[l] = NAN, active[l] = 0;
            any += active[l];
        }
        for (int iteration = 0; any > 0; iteration++) {
            const int bisect = iteration % bisect_every == bisect_every - 1;
            any = 0;
            _Pragma("omp simd reduction(+:any)")
            for (int l = 0; l < LANES; l++) {
                double strength, slope;
                const double slip_rate = v[l], normal_stress = sigma[l];
$bind_law
$law_slope
                const double residual = trial[l] - z[l] * slip_rate - strength;
                const double lo = residual > 0 ? slip_rate : low[l], hi = residual > 0 ? high[l] : slip_rate;
                const double done = fabs(residual) <= tolerance * trial[l] || hi - lo <= 1e-15 * hi;
                const double go = active[l] != 0 && done == 0;
                const double next = next_rate(slip_rate, lo, hi, residual, z[l] + slope, z[l], bisect);
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
            const double slip_rate = v[l], normal_stress = sigma[l];
$bind_law
$law_state
        }
        for (int l = 0; l < m; l++) {
            const long i = at[l];
            if (!isfinite(v[l])) {
                if (result[1] < 0) {
                    result[1] = i;
                    result[2] = trial_n[l], result[3] = trial[l], result[4] = z[l], result[5] = guess_rate[l];
                }
                continue;
            }
            const double relief = trial[l] > 0 ? v[l] / trial[l] : 0;
            double change[LOCAL], power = 0;
            if (NORMAL) change[0] = -(sigma[l] - normal_stress_0[l]);
            for (int k = 0; k < TANGENTS; k++) {
                const double rate_old = *rates[k][l], traction_old = *tractions[k][l];
                const double rate = relief * trial_s[k][l], traction = trial_s[k][l] - z[l] * rate;
$dissipated
                *rates[k][l] = rate;
                *tractions[k][l] = traction;
                *slips[k][l] += dt * rate;
                change[NORMAL + k] = traction - initial[k][l];
            }
            dissipated_energy += owned[i] * A_weight[i] * power * dt;
            A_normal_stress[i] = sigma[l];
            A_opening[i] = (sigma[l] - trial_n[l]) * compliance[l];
            // Where it opens a compliant interface lets its traction go within one step: not a rate of sliding.
            if (sigma[l] > 0 && v[l] > A_peak_slip_rate[i]) A_peak_slip_rate[i] = v[l];
            if (v[l] > threshold && isnan(A_rupture_time[i])) A_rupture_time[i] = time;
$store_new
            const double *r = frame + i * LOCAL * COMPONENTS;
            for (int c = 0; c < COMPONENTS; c++) {
                double pull = 0;
                for (int k = 0; k < LOCAL; k++) pull += A_weight[i] * r[k * COMPONENTS + c] * change[k];
                const long p = plus[i] * COMPONENTS + c, q = minus[i] * COMPONENTS + c;
                velocity[p] -= dt * inverse_mass[p] * pull;
                // For the reaction where an edge that meets the interface is driven.
                force[p] -= pull;
                if (ONE_SIDED) continue;
                velocity[q] += dt * inverse_mass[q] * pull;
                force[q] += pull;
            }
        }
    }
    result[0] = dissipated_energy;
}
