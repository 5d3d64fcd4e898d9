/* Collecting: the light of each pixel through its own filter, summed over the planes of a picture. */
#include "variant.h"

INLINE void add_products(float *restrict sums, const float *restrict light, const float *restrict weights, int64_t count)
{
    for (int64_t i = 0; i < count; i++) sums[i] += light[i] * weights[i];
}

lf_collect_loop OF_VARIANT(lf_collect);
/* Writes the rows of the only plane of `out` from first_row up to end_row. */
int OF_VARIANT(lf_collect)(const lf_picture *light, const lf_filters *f, int64_t first_row, int64_t end_row,
                           const lf_picture *out)
{
    for (int64_t y = first_row; y < end_row; y++) {
        const float *row = light->values + y * light->row_step;
        const float *weights = f->weights + y % f->rows * light->planes * f->columns;
        for (int64_t x = 0; x < out->columns; x += f->columns) {
            const int64_t count = out->columns - x < f->columns ? out->columns - x : f->columns;
            float *sums = out->values + y * out->row_step + x;
            for (int64_t i = 0; i < count; i++) sums[i] = 0;
            for (int64_t q = 0; q < light->planes; q++)
                add_products(sums, row + q * light->plane_step + x, weights + q * f->columns, count);
        }
    }
    return 0;
}
