/* Fitting: Chebyshev polynomials over x and y, often even in x, to values at scattered places by weighted least squares.

   The normal equations are solved by Cholesky's method, with iterative refinement. Sums over places are sums of eight
   parts, for vectors of any length. */
#include "variant.h"

#define RIDGE 1e-15 /* relative to the sum of squares: keeps terms that the places do not determine at 0 */
#define SOLUTIONS 3 /* the first one and its refinements */

INLINE int64_t padded(int64_t places) { return (places + 7) / 8 * 8; }
INLINE double total(eight_doubles parts)
{
    return ((parts[0] + parts[4]) + (parts[1] + parts[5])) + ((parts[2] + parts[6]) + (parts[3] + parts[7]));
}
INLINE double product(const double *a, const double *b, int64_t count)
{
    eight_doubles sum = {0};
    for (int64_t n = 0; n < count; n += 8) sum += *(const eight_doubles *)(a + n) * *(const eight_doubles *)(b + n);
    return total(sum);
}

/* T_n of x, (count, places), from n = 0. */
static void chebyshev(const double *x, int64_t places, int64_t count, double *out)
{
    for (int64_t n = 0; n < places; n++) out[n] = 1;
    for (int64_t n = 0; n < places && count > 1; n++) out[places + n] = x[n];
    for (int64_t power = 2; power < count; power++) {
        double *next = out + power * places;
        const double *last = next - places, *before = last - places;
        for (int64_t n = 0; n < places; n++) next[n] = 2 * x[n] * last[n] - before[n];
    }
}

/* The upper triangle of basis times its transpose, (terms, terms). */
static void sum_squares(const double *basis, int64_t terms, int64_t places, double *squares)
{
    for (int64_t i = 0; i < terms; i++) {
        const double *row = basis + i * places;
        int64_t j = i;
        for (; j + 4 <= terms; j += 4) {
            const double *columns = basis + j * places;
            eight_doubles sums[4] = {{0}};
            for (int64_t n = 0; n < places; n += 8)
                for (int k = 0; k < 4; k++)
                    sums[k] += *(const eight_doubles *)(row + n) * *(const eight_doubles *)(columns + k * places + n);
            for (int k = 0; k < 4; k++) squares[i * terms + j + k] = total(sums[k]);
        }
        for (; j < terms; j++) squares[i * terms + j] = product(row, basis + j * places, places);
    }
}

/* Replaces the upper triangle of a matrix by its factor U, where the matrix is the transpose of U times U. */
static void factor(double *matrix, int64_t terms)
{
    for (int64_t k = 0; k < terms; k++) {
        double *row = matrix + k * terms;
        const double pivot = __builtin_sqrt(row[k]);
        for (int64_t j = k; j < terms; j++) row[j] /= pivot;
        for (int64_t i = k + 1; i < terms; i++) {
            double *other = matrix + i * terms;
            const double share = row[i];
            for (int64_t j = i; j < terms; j++) other[j] -= share * row[j];
        }
    }
}

static void solve(const double *factor, int64_t terms, double *x)
{
    for (int64_t k = 0; k < terms; k++) {
        const double *row = factor + k * terms, value = x[k] /= row[k];
        for (int64_t j = k + 1; j < terms; j++) x[j] -= row[j] * value;
    }
    for (int64_t k = terms - 1; k >= 0; k--) {
        const double *row = factor + k * terms;
        for (int64_t j = k + 1; j < terms; j++) x[k] -= row[j] * x[j];
        x[k] /= row[k];
    }
}

lf_fit_loop OF_VARIANT(lf_fit);
int OF_VARIANT(lf_fit)(const lf_scattered *s, double *out, double *residual, double *work)
{
    const int64_t places = padded(s->places), ups = s->degree + 1, acrosses = s->degree / s->step + 1;
    double *up = work, *across = up + ups * places, *basis = across + acrosses * places;
    int64_t terms = 0;
    double *x = basis, *weight = residual; /* until these are written */
    for (int64_t n = 0; n < places; n++) {
        const int64_t from = n < s->places ? n : s->places - 1;
        x[n] = s->step == 2 ? 2 * s->x[from] * s->x[from] - 1 : s->x[from];
        weight[n] = n < s->places ? s->weight[n] : 0;
        x[places + n] = s->y[from];
    }
    chebyshev(x, places, acrosses, across);
    chebyshev(x + places, places, ups, up);
    for (int64_t term = 0; term < acrosses; term++)
        for (int64_t power = 0; power <= s->degree - s->step * term; power++, terms++)
            for (int64_t n = 0; n < places; n++)
                basis[terms * places + n] = up[power * places + n] * across[term * places + n] * weight[n];
    double *squares = basis + terms * places, *change = squares + terms * terms, *found = change + terms, trace = 0;
    sum_squares(basis, terms, places, squares);
    for (int64_t k = 0; k < terms; k++) trace += squares[k * terms + k];
    for (int64_t k = 0; k < terms; k++) squares[k * terms + k] += RIDGE * trace;
    factor(squares, terms);
    for (int64_t quantity = s->quantities - 1; quantity >= 0; quantity--) { /* the first one's residual remains */
        for (int64_t n = 0; n < places; n++)
            residual[n] = n < s->places ? s->values[quantity * s->places + n] * s->weight[n] : 0;
        for (int64_t k = 0; k < terms; k++) found[k] = 0;
        for (int pass = 0; pass < SOLUTIONS; pass++) {
            for (int64_t k = 0; k < terms; k++) change[k] = product(basis + k * places, residual, places);
            solve(squares, terms, change);
            for (int64_t k = 0; k < terms; k++) {
                found[k] += change[k];
                for (int64_t n = 0; n < places; n++) residual[n] -= change[k] * basis[k * places + n];
            }
        }
        double *to = out + quantity * ups * acrosses;
        for (int64_t term = 0, k = 0; term < acrosses; term++)
            for (int64_t power = 0; power < ups; power++)
                to[power * acrosses + term] = power <= s->degree - s->step * term ? found[k++] : 0;
    }
    return 0;
}
