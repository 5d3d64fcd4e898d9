/* Extremes of the light of square sections, without regard to its sign: the brightest and the dimmest pixels, and the
   largest step from a pixel to the next one to the right or below.

   The bits of floats without their signs, taken as integers, are in the order of the floats. All values here are such
   integers, because vectors of them can be compared without branches. */
#include "variant.h"

#define NO_SIGN 0x7fffffff
#define INFINITE 0x7f800000

typedef int32_t ints __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
typedef int32_t int_of_float __attribute__((may_alias));

typedef struct { /* of vectors of pixels, and of the pixels at the ends of rows, one at a time */
    ints brightest, dimmest, least, step;
    int32_t brightest_one, dimmest_one, least_one, step_one;
} extremes;

INLINE ints larger(ints a, ints b) { return (a & (a > b)) | (b & ~(a > b)); }
INLINE ints smaller(ints a, ints b) { return (a & (a < b)) | (b & ~(a < b)); }
INLINE int32_t larger_one(int32_t a, int32_t b) { return a > b ? a : b; }
INLINE int32_t smaller_one(int32_t a, int32_t b) { return a < b ? a : b; }

INLINE ints sizes(const float *light) { return *(const ints *)light & NO_SIGN; }
INLINE int32_t size_of(const float *light) { return *(const int_of_float *)light & NO_SIGN; }

INLINE ints steps(ints from, ints to) { return (ints)((floats)from - (floats)to) & NO_SIGN; }

INLINE int32_t step_of(const float *from, const float *to)
{
    const float step = __builtin_fabsf(*from) - __builtin_fabsf(*to);
    return size_of(&step);
}

/* Adds the n pixels of a row; the first n_right of them have another pixel to the right. */
INLINE void add_pixels(const float *row, const float *below, int64_t n, int64_t n_right, extremes *e)
{
    int64_t x = 0;
    for (; x + LANES <= n; x += LANES) {
        const ints light = sizes(row + x);
        e->brightest = larger(light, e->brightest);
        e->dimmest = smaller(light | ((light == 0) & INFINITE), e->dimmest);
        e->least = smaller(light, e->least);
        e->step = larger(steps(light, sizes(below + x)), e->step);
    }
    for (; x < n; x++) {
        const int32_t light = size_of(row + x);
        e->brightest_one = larger_one(light, e->brightest_one);
        e->dimmest_one = smaller_one(light ? light : INFINITE, e->dimmest_one);
        e->least_one = smaller_one(light, e->least_one);
        e->step_one = larger_one(step_of(row + x, below + x), e->step_one);
    }
    for (x = 0; x + LANES <= n_right; x += LANES)
        e->step = larger(steps(sizes(row + x), sizes(row + x + 1)), e->step);
    for (; x < n_right; x++)
        e->step_one = larger_one(step_of(row + x, row + x + 1), e->step_one);
}

lf_extremes_loop OF_VARIANT(lf_extremes);
/* Writes the extremes of the sections in the rows of sections from first_row up to end_row. */
int OF_VARIANT(lf_extremes)(const lf_picture *light, const lf_extremes_of *out, int64_t first_row, int64_t end_row)
{
    const int64_t size = out->size_px, columns = light->columns;
    for (int64_t i = first_row; i < end_row; i++)
        for (int64_t j = 0; j < out->columns; j++) {
            const int64_t end_y = (i + 1) * size < light->rows ? (i + 1) * size : light->rows;
            const int64_t x = j * size, end_x = x + size < columns ? x + size : columns;
            const ints none = {0};
            extremes e = {none, none + INFINITE, none + INFINITE, none, 0, INFINITE, INFINITE, 0};
            for (int64_t q = 0; q < light->planes; q++)
                for (int64_t y = i * size; y < end_y; y++) {
                    const float *row = light->values + q * light->plane_step + y * light->row_step + x;
                    const float *below = y + 1 < light->rows ? row + light->row_step : row;
                    add_pixels(row, below, end_x - x, end_x < columns ? end_x - x : end_x - x - 1, &e);
                }
            for (int k = 0; k < LANES; k++) {
                e.brightest_one = larger_one(e.brightest[k], e.brightest_one);
                e.dimmest_one = smaller_one(e.dimmest[k], e.dimmest_one);
                e.least_one = smaller_one(e.least[k], e.least_one);
                e.step_one = larger_one(e.step[k], e.step_one);
            }
            const int64_t section = i * out->columns + j;
            *(int_of_float *)(out->brightest + section) = e.brightest_one;
            *(int_of_float *)(out->dimmest + section) = e.dimmest_one;
            *(int_of_float *)(out->least + section) = e.least_one;
            *(int_of_float *)(out->step + section) = e.step_one;
        }
    return 0;
}
