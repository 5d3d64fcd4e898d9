/* Control: light from few samples, corrected by a picture of many that shares their noise.

   Gains are a regression in a square window around each pixel, without the pixel. Sums over the window's rows run from
   row to row; those over its columns are added in pairs, pairs of pairs, and so on. */
#include "variant.h"

#define N LF_CHANNELS
#define HALF (LF_WINDOW_PX / 2)
#define MARGIN 8 /* of a row of sums: zeros on its left, and at least as many on its right */
#define PRODUCTS 15 /* of the control's channels in pairs, then of each with each of the picture's */
#define SHARE (1.0 / (LF_WINDOW_PX * LF_WINDOW_PX))

_Static_assert(N == 3 && LF_WINDOW_PX == 11, "the sums and the solution are written out for these");

/* The factors of a product: 0 to N - 1 for the control's channels, and then the picture's. */
INLINE int left(int product) { return product < 3 ? 0 : product < 5 ? 1 : product < 6 ? 2 : (product - 6) / N; }
INLINE int right(int product) { return product < 3 ? product : product < 6 ? product / 2 : N + (product - 6) % N; }

/* A row of the scaled control and of the scaled picture, (2 N, stride), 0 where it is not finite. */
static void scaled_row(const lf_controlled *c, int64_t row, int64_t stride, double *out)
{
    const int64_t columns = c->columns, plane = c->rows * columns, first = row * columns;
    for (int k = 0; k < 2 * N; k++) {
        const int64_t at = k % N * plane + first;
        const float *one = (k < N ? c->control_one : c->one) + at, *other = (k < N ? c->control_other : c->other) + at;
        for (int64_t x = 0; x < columns; x++) {
            const double value = 0.5 * ((double)one[x] + other[x]) * c->scale[first + x];
            out[k * stride + x] = value - value == 0 ? value : 0;
        }
    }
}

/* Adds the products of a row, times 1 or -1, to the sums, (product, stride), which begin after a margin. */
static void add_row(const lf_controlled *c, int64_t row, double sign, int64_t stride, double *values, double *sums)
{
    const int64_t columns = c->columns;
    if (row < 0 || row >= c->rows) return;
    scaled_row(c, row, stride, values);
    for (int p = 0; p < PRODUCTS; p++) {
        const double *a = values + left(p) * stride, *b = values + right(p) * stride;
        double *to = sums + p * stride + MARGIN;
        for (int64_t x = 0; x < columns; x++) to[x] += sign * (a[x] * b[x]);
    }
}

/* Sums over the window's columns; `twos` has room for a row. */
static void sum_columns(const double *sums, int64_t columns, double *twos, double *out)
{
    const double *first = sums + MARGIN - HALF;
    for (int64_t x = 0; x < columns + 8; x++) twos[x] = first[x] + first[x + 1];
    for (int64_t x = 0; x < columns; x++)
        out[x] = ((twos[x] + twos[x + 2]) + (twos[x + 4] + twos[x + 6])) + (twos[x + 8] + first[x + 10]);
}

/* Replaces the means of products by the gains, (control channel, picture channel, column), from the seventh on. */
static void solve(const lf_controlled *c, const double *values, int64_t stride, double *means)
{
    const double r0 = c->ratios[0], r1 = c->ratios[1], r2 = c->ratios[2];
    for (int64_t x = 0; x < c->columns; x += 8) {
        eight_doubles a[PRODUCTS];
        for (int p = 0; p < PRODUCTS; p++)
            a[p] = (*(eight_doubles *)(means + p * stride + x) - *(const eight_doubles *)(values + left(p) * stride + x)
                    * *(const eight_doubles *)(values + right(p) * stride + x)) * SHARE;
        const eight_doubles ridge = c->ridge * (a[0] + a[3] + a[5]) / N + c->least_ridge;
        const eight_doubles a00 = a[0] + ridge, a01 = a[1], a02 = a[2], f1 = a01 / a00, f2 = a02 / a00;
        const eight_doubles a11 = a[3] + ridge - f1 * a01, a12 = a[4] - f1 * a02, f3 = a12 / a11;
        const eight_doubles a22 = a[5] + ridge - f2 * a02 - f3 * a12;
        a[6] += ridge * r0, a[6 + N + 1] += ridge * r1, a[6 + 2 * N + 2] += ridge * r2;
        for (int k = 0; k < N; k++) {
            const eight_doubles b0 = a[6 + k], b1 = a[6 + N + k] - f1 * b0, b2 = a[6 + 2 * N + k] - f2 * b0 - f3 * b1;
            const eight_doubles g2 = b2 / a22, g1 = (b1 - a12 * g2) / a11, g0 = (b0 - a01 * g1 - a02 * g2) / a00;
            *(eight_doubles *)(means + (6 + k) * stride + x) = g0;
            *(eight_doubles *)(means + (6 + N + k) * stride + x) = g1;
            *(eight_doubles *)(means + (6 + 2 * N + k) * stride + x) = g2;
        }
    }
}

/* Writes a row of the estimate and of the difference. */
static void correct_row(const lf_controlled *c, int64_t row, const double *gains, int64_t stride, float *estimate,
                        float *difference)
{
    const int64_t columns = c->columns, plane = c->rows * columns, first = row * columns;
    for (int k = 0; k < N; k++) {
        const float *one = c->one + k * plane + first, *other = c->other + k * plane + first;
        float *to = estimate + k * plane + first, *between = difference + k * plane + first;
        for (int64_t x = 0; x < columns; x++) {
            const double weight = c->weights ? c->weights[first + x] : c->weight;
            double light = 0.5 * ((double)one[x] + other[x]), noise = (double)one[x] - other[x];
            for (int i = 0; i < N; i++) {
                const int64_t at = i * plane + first + x;
                const double gain = gains[(6 + i * N + k) * stride + x], a = c->control_one[at], b = c->control_other[at];
                light += gain * weight * (c->control_rest[at] - 0.5 * (a + b));
                noise -= gain * (a - b);
            }
            to[x] = (float)light, between[x] = (float)noise;
        }
    }
}

lf_control_loop OF_VARIANT(lf_control);
int OF_VARIANT(lf_control)(const lf_controlled *c, int64_t first_row, int64_t end_row, float *estimate, float *difference,
                           double *work)
{
    const int64_t columns = c->columns, stride = LF_CONTROL_STRIDE(columns);
    double *sums = work, *values = sums + PRODUCTS * stride, *means = values + 2 * N * stride, *twos = means + PRODUCTS * stride;
    for (int64_t i = 0; i < (2 * PRODUCTS + 2 * N) * stride; i++) work[i] = 0;
    for (int64_t row = first_row - HALF; row < first_row + HALF; row++) add_row(c, row, 1, stride, values, sums);
    for (int64_t row = first_row; row < end_row; row++) {
        add_row(c, row + HALF, 1, stride, values, sums);
        for (int p = 0; p < PRODUCTS; p++) sum_columns(sums + p * stride, columns, twos, means + p * stride);
        scaled_row(c, row, stride, values);
        solve(c, values, stride, means);
        correct_row(c, row, means, stride, estimate, difference);
        add_row(c, row - HALF, -1, stride, values, sums);
    }
    return 0;
}
