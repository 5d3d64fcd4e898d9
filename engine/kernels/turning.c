/* Turning: the PSFs of all heights, turned to one azimuth and resampled to the pixel grid.

   A PSF consists of samples, small squares of light. From all of a pixel, each reaches up to nine pixels, which receive
   its light by area. The heights share this geometry, so it is computed once per sample, and the sample's light at all
   heights is added to the nine pixels at once: heights are the innermost axis of the output. */
#include "variant.h"

INLINE double positive_square(double number) { return number > 0 ? number * number : 0; }

/* The first of the three pixels of a row, or column, that a sample reaches from all of a pixel, and its shares in them:
   a share of 1 - |offset| of a point of light stays in the pixel. Pixels count from the edge of the output. Returns 0
   unless the light is in the output. */
INLINE int first_pixel(double offset, double width, int64_t radius, int64_t *pixel, double share[3])
{
    double start = offset - width / 2 + (double)radius;
    if (!(start >= 0 && start + width <= (double)(2 * radius))) return 0; /* NaN too */
    *pixel = (int64_t)start;
    if (*pixel > 2 * radius - 2) *pixel = 2 * radius - 2;
    start -= (double)*pixel;
    const double end = start + width;
    share[0] = (positive_square(1 - start) - positive_square(1 - end)) / (2 * width);
    share[2] = (positive_square(end - 1) - positive_square(start - 1)) / (2 * width);
    share[1] = 1 - share[0] - share[2];
    return 1;
}

lf_turn_loop OF_VARIANT(lf_turn);
/* Adds to out: (row, column, height) of a square of `side` pixels, with the chief ray in the middle. */
int OF_VARIANT(lf_turn)(const lf_samples *samples, double cosine, double sine, int64_t side, double *out)
{
    const double width = samples->size_px; /* of a square that is not turned, which preserves second moments */
    const int64_t radius = side / 2, heights = samples->heights;
    for (int64_t n = 0; n < samples->count; n++) {
        const double v = samples->v_px[n], u = samples->u_px[n];
        double in_row[3], in_column[3];
        int64_t row, column;
        if (!first_pixel(-v * sine + u * cosine, width, radius, &row, in_row) ||
            !first_pixel(v * cosine + u * sine, width, radius, &column, in_column))
            return LF_OUTSIDE;
        double *first = out + (row * side + column) * heights;
        for (int64_t h = 0; h < heights; h += LANES / 2) {
            doubles energy = *(const doubles *)(samples->energy + n * heights + h);
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    *(doubles *)(first + (i * side + j) * heights + h) += in_row[i] * in_column[j] * energy;
        }
    }
    return 0;
}
