/* Footprints: the ideal picture. Each of its pixels is the average of a capture over the rectangle that the distortion
   maps it to, times a factor.

   The lens's geometry is given as curves over the distance from the axis, which avoids arrays with an element for each
   pixel. Several pixels of a row are processed at once, and every step is a loop over them that compilers vectorise.
   Neighbouring footprints touch about the same number of rows and columns: all are processed with the largest number,
   with shares of zero for the rest. */
#include "variant.h"

#define TOGETHER 16 /* pixels: their data fit in 4 KB of the stack, the limit on Windows */
#define MOST_TOUCHED (LF_LARGEST_FOOTPRINT + 2)

typedef struct { /* position and width of some pixels' footprints in one direction */
    double middle[TOGETHER], width[TOGETHER];
} extents;

typedef struct { /* the rows, or columns, of the capture that these touch, and the footprint's share in each */
    int32_t count, last, first[TOGETHER]; /* some may be outside, with shares of zero: only 0 to last are read */
    float share[MOST_TOUCHED][TOGETHER];
} touched;

/* The footprints of n pixels of a row, from column x; and the factors on their light. */
static void find_footprints(const lf_geometry *lens, const lf_capture *capture, int64_t x, int n, double down,
                            extents *restrict rows, extents *restrict columns, float *restrict factor)
{
    const double last = (double)lens->samples, centre_column = lens->centre_column, last_px = lens->last_px;
    const double per_px = lens->samples_per_px, *restrict curves = lens->curves;
    const double row = capture->centre_row, column = capture->centre_column;
    for (int i = 0; i < n; i++) {
        const double right = (double)(x + i) - centre_column, distance = __builtin_sqrt(right * right + down * down);
        double at = distance * per_px;
        at = at < last ? at : last; /* NaN too */
        int32_t sample = (int32_t)at;
        sample -= sample == (int32_t)last;
        const int32_t low = 3 * sample, high = low + 3;
        const double on = at - (double)sample;
        const double tangential = curves[low] + on * (curves[high] - curves[low]);
        const double radial = curves[low + 1] + on * (curves[high + 1] - curves[low + 1]);
        const double light = curves[low + 2] + on * (curves[high + 2] - curves[low + 2]);
        const double squares = right * right + down * down;
        const double cos_squared = right * right / (squares > 0 ? squares : 1);
        factor[i] = distance <= last_px ? (float)light : 0;
        rows->middle[i] = row + down * tangential;
        rows->width[i] = radial + (tangential - radial) * cos_squared;
        columns->middle[i] = column + right * tangential;
        columns->width[i] = tangential + (radial - tangential) * cos_squared;
    }
}

/* The rows or columns, of `length`, that n footprints of at least a pixel's width touch. The area outside is empty. */
static void find_touched(const extents *restrict e, int n, int64_t length, touched *restrict t)
{
    const double lowest = -2.0 - LF_LARGEST_FOOTPRINT, highest = (double)length + 1;
    double begin[TOGETHER], per_px[TOGETHER];
    int32_t widest = 0;
    for (int i = 0; i < n; i++) {
        double width = e->width[i] > 1 ? e->width[i] : 1; /* NaN too */
        width = width < LF_LARGEST_FOOTPRINT ? width : LF_LARGEST_FOOTPRINT;
        double from = e->middle[i] - width / 2;
        from = from > lowest ? from : lowest; /* NaN too */
        from = from < highest ? from : highest;
        begin[i] = from;
        per_px[i] = 1 / width;
        t->first[i] = (int32_t)(from + 0.5 - lowest) + (int32_t)lowest; /* rounded down */
        const int32_t whole = (int32_t)(width - 1e-9);
        widest = whole > widest ? whole : widest;
    }
    t->count = 2 + widest;
    t->last = (int32_t)length - 1;
    for (int k = 0; k < 2 + widest; k++)
        for (int i = 0; i < n; i++) {
            const int32_t pixel = t->first[i] + k, inside = (pixel >= 0) & (pixel < (int32_t)length);
            double before = ((double)pixel - 0.5 - begin[i]) * per_px[i];
            double up_to = ((double)pixel + 0.5 - begin[i]) * per_px[i];
            before = before < 0 ? 0 : before < 1 ? before : 1;
            up_to = up_to < 1 ? up_to : 1;
            t->share[k][i] = inside ? (float)(up_to - before) : 0;
        }
}

INLINE int64_t touched_pixel(const touched *t, int k, int i)
{
    const int32_t pixel = t->first[i] + k;
    return pixel < 0 ? 0 : pixel < t->last ? pixel : t->last;
}

typedef float four_floats __attribute__((vector_size(16)));

typedef struct { /* the captures of four planes; the first one again for missing planes */
    const float *first[4];
    int64_t row_step[4], step[4];
} four_captures;

/* The averages of four captures over the footprint of a pixel. `inside`: whether they contain all of the footprint. */
INLINE four_floats average_of_four(const four_captures *c, const touched *rows, const touched *columns, int i,
                                   int inside)
{
    const int64_t first_column = inside ? columns->first[i] : 0;
    four_floats sum = {0};
    for (int j = 0; j < rows->count; j++) {
        const int64_t row = inside ? rows->first[i] + j : touched_pixel(rows, j, i);
        const float *from[4];
        for (int q = 0; q < 4; q++) from[q] = c->first[q] + row * c->row_step[q] + first_column * c->step[q];
        four_floats in_row = {0};
        for (int k = 0; k < columns->count; k++) {
            const int64_t column = inside ? 0 : touched_pixel(columns, k, i);
            const four_floats light = {from[0][column * c->step[0]], from[1][column * c->step[1]],
                                       from[2][column * c->step[2]], from[3][column * c->step[3]]};
            in_row += columns->share[k][i] * light;
            for (int q = 0; q < 4; q++) from[q] += inside ? c->step[q] : 0;
        }
        sum += rows->share[j][i] * in_row;
    }
    return sum;
}

INLINE int is_inside(const touched *t, int i) { return t->first[i] >= 0 && t->first[i] + t->count <= t->last + 1; }

lf_footprints_loop OF_VARIANT(lf_footprints);
/* Writes rows of `out`, by index, from first_row up to end_row. */
int OF_VARIANT(lf_footprints)(const lf_geometry *lens, const lf_capture *capture, int64_t first_row, int64_t end_row,
                              const lf_picture *out)
{
    extents down, across;
    touched rows, columns;
    float factor[TOGETHER], in_row[TOGETHER], sum[TOGETHER];
    four_captures four;
    for (int q = 0; q < 4; q++) {
        const int plane = q < (int)out->planes ? q : 0;
        four.first[q] = capture->first[plane];
        four.row_step[q] = capture->row_step[plane], four.step[q] = capture->step[plane];
    }
    for (int64_t y = first_row; y < end_row; y++)
        for (int64_t x = 0; x < out->columns; x += TOGETHER) {
            const int n = out->columns - x < TOGETHER ? (int)(out->columns - x) : TOGETHER;
            find_footprints(lens, capture, x, n, (double)y - lens->centre_row, &down, &across, factor);
            find_touched(&down, n, capture->rows, &rows);
            find_touched(&across, n, capture->columns, &columns);
            if (out->planes > 1) {
                float *to = out->values + y * out->row_step + x;
                for (int i = 0; i < n; i++) {
                    const four_floats mean = is_inside(&rows, i) && is_inside(&columns, i)
                                                 ? average_of_four(&four, &rows, &columns, i, 1)
                                                 : average_of_four(&four, &rows, &columns, i, 0);
                    for (int q = 0; q < (int)out->planes; q++) to[q * out->plane_step + i] = mean[q] * factor[i];
                }
                continue;
            }
            for (int64_t plane = 0; plane < out->planes; plane++) {
                const int64_t row_step = capture->row_step[plane], step = capture->step[plane];
                const float *from = capture->first[plane];
                float *to = out->values + plane * out->plane_step + y * out->row_step + x;
                for (int i = 0; i < n; i++) sum[i] = 0;
                for (int j = 0; j < rows.count; j++) {
                    for (int i = 0; i < n; i++) in_row[i] = 0;
                    for (int k = 0; k < columns.count; k++)
                        for (int i = 0; i < n; i++) {
                            const int64_t row = touched_pixel(&rows, j, i), column = touched_pixel(&columns, k, i);
                            in_row[i] += columns.share[k][i] * from[row * row_step + column * step];
                        }
                    for (int i = 0; i < n; i++) sum[i] += rows.share[j][i] * in_row[i];
                }
                for (int i = 0; i < n; i++) to[i] = sum[i] * factor[i];
            }
        }
    return 0;
}
