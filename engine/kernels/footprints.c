/* Footprints: the ideal picture, each of its pixels the average of a capture over the rectangle that distortion gives
   it there, times a factor.

   The lens's geometry comes as curves over the distance from the axis, so that no array is made of what differs from
   pixel to pixel. */
#include "variant.h"

#define MOST_TOUCHED (LF_LARGEST_FOOTPRINT + 2)

typedef struct { /* which pixels of a row, or column, an interval touches, and the share of it that lies in each */
    int64_t first;
    int count;
    float share[MOST_TOUCHED];
} touched;

/* Of an interval, made at least a pixel wide, on a row of `length` pixels. What lies outside touches none. */
INLINE void touch(double middle, double width, int64_t length, touched *t)
{
    const double lowest = -2.0 - LF_LARGEST_FOOTPRINT, highest = (double)length + 1;
    if (!(width > 1)) width = 1;
    if (!(width <= LF_LARGEST_FOOTPRINT)) width = LF_LARGEST_FOOTPRINT;
    double begin = middle - width / 2;
    if (!(begin > lowest)) begin = lowest; /* NaN too: an index stays within an int64 */
    if (begin > highest) begin = highest;
    const double end = begin + width, per_px = 1 / width;
    int64_t pixel = (int64_t)(begin + 0.5 - lowest) + (int64_t)lowest; /* rounded down */
    double before = 0;
    t->first = pixel > 0 ? pixel : 0;
    t->count = 0;
    for (; (double)pixel - 0.5 < end && pixel < length && t->count < MOST_TOUCHED; pixel++) {
        double up_to = ((double)pixel + 0.5 - begin) * per_px;
        if (!(up_to < 1)) up_to = 1;
        if (pixel >= 0) t->share[t->count++] = (float)(up_to - before);
        before = up_to;
    }
}

lf_footprints_loop OF_VARIANT(lf_footprints);
/* Writes rows of `out`, by index, from first_row up to end_row. */
int OF_VARIANT(lf_footprints)(const lf_geometry *lens, const lf_capture *capture, int64_t first_row, int64_t end_row,
                              const lf_picture *out)
{
    const double most = (double)lens->samples;
    for (int64_t y = first_row; y < end_row; y++) {
        const double down = (double)y - lens->centre_row;
        for (int64_t x = 0; x < out->columns; x++) {
            const double right = (double)x - lens->centre_column, distance = __builtin_sqrt(right * right + down * down);
            double at = distance * lens->samples_per_px;
            if (!(at < most)) at = most; /* NaN too */
            int64_t sample = (int64_t)at;
            sample -= sample == lens->samples;
            const double *low = lens->curves + 3 * sample, *high = low + 3, on = at - (double)sample;
            const double tangential = low[0] + on * (high[0] - low[0]), radial = low[1] + on * (high[1] - low[1]);
            const float factor = distance <= lens->last_px ? (float)(low[2] + on * (high[2] - low[2])) : 0;
            const double cos_squared = distance > 0 ? right * right / (distance * distance) : 0;
            touched rows, columns;
            touch(capture->centre_row + down * tangential, radial + (tangential - radial) * cos_squared, capture->rows,
                  &rows);
            touch(capture->centre_column + right * tangential, tangential + (radial - tangential) * cos_squared,
                  capture->columns, &columns);
            for (int64_t plane = 0; plane < out->planes; plane++) {
                const int64_t row_step = capture->row_step[plane], step = capture->step[plane];
                const float *from = capture->first[plane] + rows.first * row_step + columns.first * step;
                float sum = 0;
                for (int j = 0; j < rows.count; j++, from += row_step) {
                    float in_row = 0;
                    for (int i = 0; i < columns.count; i++) in_row += columns.share[i] * from[i * step];
                    sum += rows.share[j] * in_row;
                }
                out->values[plane * out->plane_step + y * out->row_step + x] = sum * factor;
            }
        }
    }
    return 0;
}
