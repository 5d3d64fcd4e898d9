/* Excess: the light of square sections above a level, summed over their pixels. */
#include "variant.h"

#define TOGETHER 16 /* columns with separate sums, for compilers to vectorise; the same in all variants */

INLINE void add_pixels(const float *restrict row, int n, float level, double *restrict sums)
{
    for (int i = 0; i < n; i++) sums[i] += row[i] > level ? (double)(row[i] - level) : 0;
}

lf_excess_loop OF_VARIANT(lf_excess);
/* Writes the sums of the sections in the rows of sections from first_row up to end_row. */
int OF_VARIANT(lf_excess)(const lf_picture *light, float level, const lf_excess_of *out, int64_t first_row, int64_t end_row)
{
    const int64_t size = out->size_px;
    for (int64_t q = 0; q < light->planes; q++)
        for (int64_t i = first_row; i < end_row; i++)
            for (int64_t j = 0; j < out->columns; j++) {
                const int64_t end_y = (i + 1) * size < light->rows ? (i + 1) * size : light->rows;
                const int64_t end_x = (j + 1) * size < light->columns ? (j + 1) * size : light->columns;
                double sums[TOGETHER] = {0};
                for (int64_t y = i * size; y < end_y; y++) {
                    const float *row = light->values + q * light->plane_step + y * light->row_step;
                    int64_t x = j * size;
                    for (; x + TOGETHER <= end_x; x += TOGETHER) add_pixels(row + x, TOGETHER, level, sums);
                    add_pixels(row + x, (int)(end_x - x), level, sums);
                }
                for (int k = 1; k < TOGETHER; k++) sums[0] += sums[k];
                out->sums[(q * out->rows + i) * out->columns + j] = sums[0];
            }
    return 0;
}
