/* Waves: the light of a wavefront on an even grid of direction cosines, as complex numbers whose sum is a PSF.

   Path, density and limits of apertures are Chebyshev polynomials over the cosines, often even in the cosine along a
   row. Each row has its polynomials over the latter. Every variant processes eight columns at once. Cells at the
   edge of an aperture transmit a share of the light, which depends on the change of the tightest limit across them.
   Three rows of that limit are therefore stored. */
#include "elementary.h"

#define WHOLE 6755399441055744.0 /* adding and subtracting it rounds a double to an integer */
#define LOG2_E 1.44269504f
#define LEAST_POWER -80 /* of e: near the smallest number of single precision */

/* The sum of a row's polynomials at eight columns. */
INLINE eight_doubles series(const double *terms, int64_t count, const double *across, int64_t columns)
{
    eight_doubles even = terms[0] * *(const eight_doubles *)across, odd = even - even;
    for (int64_t n = 1; n < count; n += 2) {
        odd += terms[n] * *(const eight_doubles *)(across + n * columns);
        if (n + 1 < count) even += terms[n + 1] * *(const eight_doubles *)(across + (n + 1) * columns);
    }
    return even + odd;
}

INLINE eight_floats series_single(const float *terms, int64_t count, const float *across, int64_t columns)
{
    eight_floats even = terms[0] * *(const eight_floats *)across, odd = even - even;
    for (int64_t n = 1; n < count; n += 2) {
        odd += terms[n] * *(const eight_floats *)(across + n * columns);
        if (n + 1 < count) even += terms[n + 1] * *(const eight_floats *)(across + (n + 1) * columns);
    }
    return even + odd;
}

/* e to a power from LEAST_POWER to 80, by a Taylor series to 2e-7. */
INLINE eight_floats exponential(eight_floats power)
{
    const eight_floats twos = power * LOG2_E, whole = rounded(twos);
    const eight_floats x = (twos - whole) * 0.693147181f;
    const eight_floats part = 1 + x * (1 + x * (0.5f + x * (1.66666667e-1f + x * (4.16666667e-2f + x * (
                              8.33333333e-3f + x * 1.38888889e-3f)))));
    return part * (eight_floats)((__builtin_convertvector(whole, eight_ints) + 127) << 23);
}

/* Writes the tightest of a row's limits to `tightest`, which has room for a value before and one after it. */
INLINE void tightest_limits(const lf_wavefront *w, int64_t row, float *tightest)
{
    const float *terms = w->edges + (row * (1 + w->limits) + 1) * w->edge_terms;
    for (int64_t c = 0; c < w->columns; c += 8) {
        const float *at = w->across_edges + c;
        eight_floats most = series_single(terms, w->edge_terms, at, w->columns);
        for (int64_t n = 1; n < w->limits; n++)
            most = larger(series_single(terms + n * w->edge_terms, w->edge_terms, at, w->columns), most);
        *(eight_floats *)(tightest + c) = most;
    }
    tightest[-1] = tightest[1]; /* no change across either end */
    tightest[w->columns] = tightest[w->columns - 2];
}

/* Whether any of eight columns is within the rim. */
INLINE int touched(const double *across, double rim)
{
    int within = 0;
    for (int k = 0; k < 8; k++) within |= across[k] <= rim;
    return within;
}

lf_waves_loop OF_VARIANT(lf_waves);
/* Writes the real and imaginary parts to the two planes of `out`, and to `light` the sums of density * share and of
   density * share * share. */
int OF_VARIANT(lf_waves)(const lf_wavefront *w, const lf_picture *out, double *light, float *work)
{
    const int64_t step = w->columns + 16;
    float *limits[3] = {work + 8, work + 8 + step, work + 8 + 2 * step}; /* of row n: in limits[n % 3] */
    eight_doubles hard = {0}, soft = {0};
    for (int64_t row = 0; row < 3; row++) tightest_limits(w, row, limits[row]);
    for (int64_t row = 0; row < w->rows; row++) {
        const int64_t middle = row < 1 ? 1 : row > w->rows - 2 ? w->rows - 2 : row;
        if (middle == row && row > 1) tightest_limits(w, row + 1, limits[(row + 1) % 3]);
        const float *here = limits[row % 3], *above = limits[(middle + 1) % 3], *below = limits[(middle + 2) % 3];
        const double *path = w->path + row * w->path_terms;
        const float *density = w->edges + row * (1 + w->limits) * w->edge_terms;
        const double rim = 1 - 2 * w->up[row] * w->up[row]; /* largest `across` within the circle of radius 1 */
        const double *across = w->across + w->square * w->columns;
        float *real = out->values + row * out->row_step, *imaginary = real + out->plane_step;
        for (int64_t c = 0; c < w->columns; c += 8) {
            if (!touched(across + c, rim)) {
                *(eight_floats *)(real + c) = *(eight_floats *)(imaginary + c) = (eight_floats){0};
                continue;
            }
            const eight_doubles at = *(const eight_doubles *)(across + c);
            const eight_longs inside = at <= rim;
            const eight_ints lit = __builtin_convertvector(inside, eight_ints);
            eight_doubles phase = series(path, w->path_terms, w->across + c, w->columns);
            phase = (eight_doubles)((eight_longs)(phase - ((phase + WHOLE) - WHOLE)) & inside);
            const eight_floats zero = {0}, one = zero + 1;
            const eight_floats tight = *(const eight_floats *)(here + c);
            const eight_floats down = *(const eight_floats *)(above + c) - *(const eight_floats *)(below + c);
            const eight_floats right = *(const eight_floats *)(here + c + 1) - *(const eight_floats *)(here + c - 1);
            const eight_floats change = larger(larger(down, -down) + larger(right, -right), zero + 1e-12f);
            eight_floats share = smaller(larger(0.5f + 2 * (1 - tight) / change, zero), one);
            share = chosen(lit, share, zero);
            eight_floats power = series_single(density, w->edge_terms, w->across_edges + c, w->columns);
            power = smaller(larger(power, zero + w->least), zero + w->most) - w->most;
            const eight_floats whole = exponential(larger(power / 2, zero + LEAST_POWER)), part = whole * share;
            eight_floats cosine, sine;
            turned(__builtin_convertvector(phase, eight_floats), &cosine, &sine);
            *(eight_floats *)(real + c) = part * cosine;
            *(eight_floats *)(imaginary + c) = part * sine;
            hard += __builtin_convertvector(whole * part, eight_doubles);
            soft += __builtin_convertvector(part * part, eight_doubles);
        }
    }
    light[0] = light[1] = 0;
    for (int k = 0; k < 8; k++) light[0] += hard[k], light[1] += soft[k];
    return 0;
}
