/* Turning: the PSFs of all heights, turned to one azimuth and resampled to the pixel grid.

   A PSF consists of samples, small squares of light. When turned, each covers up to four pixels, which receive its
   light by area. The heights share this geometry, so it is computed once per sample, and the sample's light at all
   heights is added to the four pixels at once: heights are the innermost axis of the output. */
#include "variant.h"

/* The first of the two pixels of a row, or column, that a turned sample covers from `start`, and the sample's share in
   it. Pixels count from -radius. Returns 0 unless both are in the square. */
INLINE int first_pixel(double start, double per_px, int64_t radius, int64_t *pixel, double *share)
{
    double from_edge = start + 0.5 + (double)radius;
    if (!(from_edge >= 0 && from_edge < (double)(2 * radius))) return 0; /* NaN too */
    *pixel = (int64_t)from_edge;
    *share = ((double)(*pixel - radius) + 0.5 - start) * per_px;
    if (!(*share < 1)) *share = 1;
    return 1;
}

lf_turn_loop OF_VARIANT(lf_turn);
/* Adds to out: (row, column, height) of a square of `side` pixels, with the chief ray in the middle. */
int OF_VARIANT(lf_turn)(const lf_samples *samples, double cosine, double sine, int64_t side, double *out)
{
    /* Squares as wide as the turned samples: at 0 and 45 degrees they tile the plane without gaps. */
    const double width = ((cosine < 0 ? -cosine : cosine) + (sine < 0 ? -sine : sine)) * samples->size_px;
    const int64_t radius = side / 2, heights = samples->heights;
    for (int64_t n = 0; n < samples->count; n++) {
        const double v = samples->v_px[n], u = samples->u_px[n];
        double in_row, in_column;
        int64_t row, column;
        if (!first_pixel(-v * sine + u * cosine - width / 2, 1 / width, radius, &row, &in_row) ||
            !first_pixel(v * cosine + u * sine - width / 2, 1 / width, radius, &column, &in_column))
            return LF_OUTSIDE;
        const double share[4] = {in_row * in_column, in_row * (1 - in_column),
                                 (1 - in_row) * in_column, (1 - in_row) * (1 - in_column)};
        double *first = out + (row * side + column) * heights;
        double *pixel[4] = {first, first + heights, first + side * heights, first + side * heights + heights};
        for (int64_t h = 0; h < heights; h += LANES / 2) {
            doubles energy = *(const doubles *)(samples->energy + n * heights + h);
            for (int k = 0; k < 4; k++) *(doubles *)(pixel[k] + h) += share[k] * energy;
        }
    }
    return 0;
}
