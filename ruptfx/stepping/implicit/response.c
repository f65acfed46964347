// What an interface answers to a displacement at the end of an implicit step, LANES points at a time: traction, its exact
// tangent and all fields. points.c is in front of this file.

// Rows of an array as lanes; the last point stands in for those that are missing.
INLINE void load_rows(long first, int count, const double *rows, int width, lanes *lanes_of_rows)
{
    for (int k = 0; k < width; k++)
        for (int l = 0; l < LANES; l++) lanes_of_rows[k][l] = rows[(first + (l < count ? l : count - 1)) * width + k];
}

// dT / d[u] of the step that `point` has made; every row of `tangent` is a component of T and of [u] (point_code.py).
INLINE void differentiate(const struct times *times, const double *number, const struct points *points, lanes *tangent)
{
    UNPACK_TIMES
    (void)number;
    EACH_LANE { TANGENT }
}

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
        load_rows(first, count, jump, LOCAL, points.jump);
        load_rows(first, count, multiplier, 1 + TANGENTS, points.multiplier);
        load_rows(first, count, body_stiffness, 1, &points.body_stiffness);
        load_rows(first, count, radiation, 1, &points.radiation);
        load_rows(first, count, near, 1, &points.near);
        point(times, number, &points);
        if (failed(first, count, &points, result)) return;
        write_back(count, times, number, &points, dissipated);
        store(first, count, new, &points);
        differentiate(times, number, &points, slopes);
        for (int l = 0; l < count; l++) {
            for (int k = 0; k < LOCAL; k++) change[(first + l) * LOCAL + k] = points.change[k][l];
            for (int k = 0; k < LOCAL * LOCAL; k++) tangent[(first + l) * LOCAL * LOCAL + k] = slopes[k][l];
        }
    }
    result[0] = 0;
    for (int l = 0; l < LANES; l++) result[0] += dissipated[l];
}
