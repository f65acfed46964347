// Products with the matrix B of a pairing, n rows of `width` values at listed nodes; values of zero do not count.

// result = B nodal, of `components` values at every node.
void multiply(long n, long width, const double *values, const long *nodes, long components, const double *nodal, double *result)
{
    for (long i = 0; i < n; i++, values += width, nodes += width, result += components) {
        for (long c = 0; c < components; c++) result[c] = 0;
        for (long j = 0; j < width; j++) {
            if (values[j] == 0) continue;
            const double *at = nodal + components * nodes[j];
            for (long c = 0; c < components; c++) result[c] += values[j] * at[c];
        }
    }
}

// Count the values of every node in `counts`, zeros before; return the largest count.
long longest_column(long n, long width, const double *values, const long *nodes, long *counts)
{
    long most = 0;
    for (long at = 0; at < n * width; at++) {
        if (values[at] == 0) continue;
        const long count = ++counts[nodes[at]];
        most = count > most ? count : most;
    }
    return most;
}

// B', rows of `length` values and points; `counts` are zeros before, `transposed`, too. A row is filled by its first point.
void transpose(long n, long width, const double *values, const long *nodes, long m, long length, long *counts, long *first,
               double *transposed, long *points)
{
    for (long i = 0; i < n; i++)
        for (long j = i * width; j < (i + 1) * width; j++) {
            if (values[j] == 0) continue;
            const long node = nodes[j], at = node * length + counts[node]++;
            transposed[at] = values[j], points[at] = i;
        }
    for (long node = 0; node < m; node++) {
        first[node] = counts[node] ? points[node * length] : 0;
        for (long k = counts[node]; k < length; k++) points[node * length + k] = first[node];
    }
}
