/* Footprints: the ideal picture. Each of its pixels is the average of a capture over the rectangle that the distortion
   maps it to, times a factor.

   The lens's geometry is given as curves over the distance from the axis, or on a coarse mesh, which avoids arrays with
   an element for each pixel. Several pixels of a row are processed at once, and every step is a loop over them that compilers vectorise.
   Neighbouring footprints touch about the same number of rows and columns: all are processed with the largest number,
   with shares of zero for the rest. */
#include "variant.h"

#define TOGETHER 16 /* pixels: their data fit in 4 KB of the stack, the limit on Windows */
#define MOST_TOUCHED (LF_LARGEST_FOOTPRINT + 2)
#define MESH_VALUES 6

typedef struct { /* position and width of some pixels' footprints in one direction */
    double middle[TOGETHER], width[TOGETHER];
} extents;

typedef struct { /* the rows, or columns, of the capture that these touch, and the footprint's share in each */
    int32_t count, last, first[TOGETHER]; /* some may be outside, with shares of zero: only 0 to last are read */
    float share[MOST_TOUCHED][TOGETHER];
} touched;

/* The footprints of pixels of a row, from column x; and the factors on their light. */
static void find_footprints(const lf_geometry *lens, const lf_capture *capture, int32_t x, double down,
                            extents *restrict rows, extents *restrict columns, float *restrict factor)
{
    const double last = (double)lens->samples, centre_column = lens->centre_column, last_px = lens->last_px;
    const double per_px = lens->samples_per_px, *restrict curves = lens->curves;
    const double row = capture->centre_row, column = capture->centre_column;
    const int32_t samples = (int32_t)lens->samples;
    for (int i = 0; i < TOGETHER; i++) {
        const double right = (double)(x + i) - centre_column, distance = __builtin_sqrt(right * right + down * down);
        double at = distance * per_px;
        at = at < last ? at : last; /* NaN too */
        int32_t sample = (int32_t)at;
        sample -= sample == samples;
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

/* As find_footprints, from a mesh, for pixels of row y. */
static void find_on_mesh(const lf_geometry *lens, const lf_capture *capture, int32_t x, int32_t y,
                         extents *restrict rows, extents *restrict columns, float *restrict factor)
{
    const int32_t step = (int32_t)lens->mesh_step, last_row = (int32_t)lens->mesh_rows - 2;
    const int32_t last_column = (int32_t)lens->mesh_columns - 2, row = y / step < last_row ? y / step : last_row;
    const double per_px = 1 / (double)step, down = (double)(y - row * step) * per_px;
    const double *above = lens->mesh + (int64_t)row * lens->mesh_columns * MESH_VALUES;
    for (int32_t i = 0, end; i < TOGETHER; i = end) { /* pixels in the same cell */
        const int32_t cell = (x + i) / step < last_column ? (x + i) / step : last_column, first = cell * step;
        const double *left = above + (int64_t)cell * MESH_VALUES, *left_below = left + lens->mesh_columns * MESH_VALUES;
        double from[MESH_VALUES], rise[MESH_VALUES];
        for (int k = 0; k < MESH_VALUES; k++) {
            const double right = left[k + MESH_VALUES] + down * (left_below[k + MESH_VALUES] - left[k + MESH_VALUES]);
            from[k] = left[k] + down * (left_below[k] - left[k]);
            rise[k] = (right - from[k]) * per_px;
        }
        end = cell < last_column && first + step - x < TOGETHER ? first + step - x : TOGETHER;
        for (int32_t p = i; p < end; p++) {
            const double on = (double)(x + p - first);
            rows->middle[p] = capture->centre_row + from[0] + on * rise[0];
            columns->middle[p] = capture->centre_column + from[1] + on * rise[1];
            rows->width[p] = from[2] + on * rise[2];
            columns->width[p] = from[3] + on * rise[3];
            factor[p] = from[5] + on * rise[5] <= 1 ? (float)(from[4] + on * rise[4]) : 0;
        }
    }
}

/* The rows or columns, of `length`, that footprints of at least a pixel's width touch. The area outside is empty. */
static void find_touched(const extents *restrict e, int64_t length, touched *restrict t)
{
    const double lowest = -2.0 - LF_LARGEST_FOOTPRINT, highest = (double)length + 1;
    const int32_t end = (int32_t)length;
    float begin[TOGETHER], per_px[TOGETHER]; /* relative to the middle of the first pixel */
    int32_t widest = 0;
    for (int i = 0; i < TOGETHER; i++) {
        double width = e->width[i] > 1 ? e->width[i] : 1; /* NaN too */
        width = width < LF_LARGEST_FOOTPRINT ? width : LF_LARGEST_FOOTPRINT;
        double from = e->middle[i] - width / 2;
        from = from > lowest ? from : lowest; /* NaN too */
        from = from < highest ? from : highest;
        t->first[i] = (int32_t)(from + 0.5 - lowest) + (int32_t)lowest; /* rounded down */
        begin[i] = (float)(from - (double)t->first[i]);
        per_px[i] = 1 / (float)width;
        const int32_t whole = (int32_t)(width - 1e-9);
        widest = whole > widest ? whole : widest;
    }
    t->count = 2 + widest;
    t->last = end - 1;
    for (int k = 0; k < 2 + widest; k++)
        for (int i = 0; i < TOGETHER; i++) {
            const int32_t pixel = t->first[i] + k;
            float before = ((float)k - 0.5f - begin[i]) * per_px[i];
            float up_to = ((float)k + 0.5f - begin[i]) * per_px[i];
            before = before < 0 ? 0 : before;
            before = before < 1 ? before : 1;
            up_to = up_to < 1 ? up_to : 1;
            t->share[k][i] = ((pixel >= 0) & (pixel < end)) ? up_to - before : 0;
        }
}

INLINE int64_t touched_pixel(const touched *t, int k, int i)
{
    const int32_t pixel = t->first[i] + k;
    return pixel < 0 ? 0 : pixel < t->last ? pixel : t->last;
}

INLINE int is_inside(const touched *t, int i) { return t->first[i] >= 0 && t->first[i] + t->count <= t->last + 1; }

typedef float four_floats __attribute__((vector_size(16), aligned(4), may_alias));

/* The averages of four planes over the footprint of a pixel. `inside`: whether the capture contains all of it. */
INLINE four_floats average_of_four(const lf_capture *c, const touched *rows, const touched *columns, int i, int inside)
{
    four_floats sum = {0};
    for (int j = 0; j < rows->count; j++) {
        const float *from = c->values + (inside ? rows->first[i] + j : touched_pixel(rows, j, i)) * c->row_step;
        four_floats in_row = {0};
        for (int k = 0; k < columns->count; k++) {
            const int64_t column = inside ? columns->first[i] + k : touched_pixel(columns, k, i);
            in_row += columns->share[k][i] * *(const four_floats *)(from + 4 * column);
        }
        sum += rows->share[j][i] * in_row;
    }
    return sum;
}

/* Writes four planes of n pixels, from those at `to`. */
static void average_four(const lf_capture *c, const touched *rows, const touched *columns, const float *factor, int n,
                         float *to, int64_t plane_step)
{
    for (int i = 0; i < n; i++) {
        const four_floats mean = is_inside(rows, i) && is_inside(columns, i) ? average_of_four(c, rows, columns, i, 1)
                                                                             : average_of_four(c, rows, columns, i, 0);
        for (int q = 0; q < 4; q++) to[q * plane_step + i] = mean[q] * factor[i];
    }
}

/* Writes n pixels of one plane at `to`. */
static void average_one(const lf_capture *c, const touched *rows, const touched *columns, const float *factor, int n,
                        float *to)
{
    float in_row[TOGETHER], sum[TOGETHER] = {0};
    for (int j = 0; j < rows->count; j++) {
        for (int i = 0; i < n; i++) in_row[i] = 0;
        for (int k = 0; k < columns->count; k++)
            for (int i = 0; i < n; i++)
                in_row[i] += columns->share[k][i]
                             * c->values[touched_pixel(rows, j, i) * c->row_step + touched_pixel(columns, k, i)];
        for (int i = 0; i < n; i++) sum[i] += rows->share[j][i] * in_row[i];
    }
    for (int i = 0; i < n; i++) to[i] = sum[i] * factor[i];
}

lf_footprints_loop OF_VARIANT(lf_footprints);
/* Writes rows of `out`, by index, from first_row up to end_row. */
int OF_VARIANT(lf_footprints)(const lf_geometry *lens, const lf_capture *capture, int64_t first_row, int64_t end_row,
                              const lf_picture *out)
{
    extents down, across;
    touched rows, columns;
    float factor[TOGETHER];
    for (int64_t y = first_row; y < end_row; y++)
        for (int64_t x = 0; x < out->columns; x += TOGETHER) {
            const int n = out->columns - x < TOGETHER ? (int)(out->columns - x) : TOGETHER;
            float *to = out->values + y * out->row_step + x;
            if (lens->mesh) find_on_mesh(lens, capture, (int32_t)x, (int32_t)y, &down, &across, factor);
            else find_footprints(lens, capture, (int32_t)x, (double)y - lens->centre_row, &down, &across, factor);
            find_touched(&down, capture->rows, &rows);
            find_touched(&across, capture->columns, &columns);
            if (out->planes == 4) average_four(capture, &rows, &columns, factor, n, to, out->plane_step);
            else average_one(capture, &rows, &columns, factor, n, to);
        }
    return 0;
}
