/* Spreading: the light of every pixel, spread by its PSF.

   A pixel's PSF is interpolated from four PSFs of the table: at the heights below and above, and at the azimuths before
   and after its position; or at the corners of its cell in a grid of nodes. Adding a PSF to the picture costs a read and a write of every pixel that it reaches, so FOUR
   neighbouring pixels of a row are processed at once. Their PSFs are interpolated side by side, each shifted by one
   more tap to the right, and summed with the pixels' light as weights before they are added to the picture. The planes
   of a folded picture share the PSFs.

   Taps are stored in *pieces*: a row of a PSF's taps, or a part of it, padded to the next multiple of eight with at
   least three zeros at its end. A shift by up to three taps moves these zeros to the front of the next piece, so the
   loop does not have to handle the beginnings of rows. Pieces are sorted by size. Each size has an inner loop with a
   constant length, and only the pieces within the PSFs between two heights are processed. */
#include "variant.h"

#define FOUR 4
#define RUN 8 /* groups of four pixels to process with each portion of the table while it is cached */
#define ATAN_TERMS 14
#define MIXTURE_STEP (LF_PORTION * 8 + LF_SLACK) /* between the mixtures of four pixels */

typedef float four_floats __attribute__((vector_size(4 * FOUR), aligned(4), may_alias));
typedef int32_t four_ints __attribute__((vector_size(4 * FOUR), aligned(4), may_alias));

typedef struct { /* four pixels of a row */
    const float *psfs[FOUR];  /* the first of the table's four PSFs for each */
    float weight[FOUR][4];    /* of the table's four PSFs */
    float light[4][FOUR];     /* (plane, pixel) */
    float *out;               /* the first pixel of the square of PSFs */
} four_pixels;

typedef struct { /* positions of a row's pixels: (column) */
    double *sample;              /* of the curve of heights */
    int32_t *interval, *azimuth; /* in the table: the height below, and the azimuth before */
    float *up, *on;              /* fractions from these to the next */
} row_places;

/* arctan(t) for t from 0 to 1, right to 1e-11. */
INLINE double arctan(double t)
{
    static const double term[ATAN_TERMS] = {0.9999999999982004, -0.3333333326254709, 0.1999999534286548,
        -0.1428559243462209, 0.1110942872658185, -0.09076800877134047, 0.0761425741442088, -0.06366109812151624,
        0.05045587086468524, -0.03526805537018975, 0.0199376976275484, -0.008242022886406635, 0.002162828043635403,
        -0.0002666058550987925};
    double square = t * t, sum = term[ATAN_TERMS - 1];
    for (int k = ATAN_TERMS - 2; k >= 0; k--) sum = sum * square + term[k];
    return t * sum;
}

/* Positions of a row's pixels. In double precision, because for a bright pixel even the smallest weight of a wrong PSF
   is visible. Compilers vectorise both loops: `restrict` arguments, local copies of the numbers, and 32-bit integers,
   because AVX2 converts no others to floating point. */
static void find_azimuths(const lf_places *p, int32_t columns, double down, double *restrict sample_at,
                          int32_t *restrict azimuth_before, float *restrict on)
{
    const double quarter = (double)p->quarter_steps, per_rad = quarter * 0.63661977236758134;
    const double last_azimuth = (double)(p->azimuths - 1);
    const double centre_column = p->centre_column, samples_per_px = p->samples_per_px;
    const double far_down = down < 0 ? -down : down;
    for (int32_t x = 0; x < columns; x++) {
        const double right = (double)x - centre_column, far_right = right < 0 ? -right : right;
        const double larger = far_right > far_down ? far_right : far_down;
        const double smaller = far_right > far_down ? far_down : far_right;
        double azimuth = arctan(smaller / (larger > 1e-20 ? larger : 1e-20)) * per_rad;
        azimuth = far_down > far_right ? quarter - azimuth : azimuth;
        azimuth = right < 0 ? 2 * quarter - azimuth : azimuth;
        azimuth = down < 0 ? 4 * quarter - azimuth : azimuth;
        azimuth = azimuth < last_azimuth ? azimuth : last_azimuth; /* NaN too */
        azimuth = azimuth > 0 ? azimuth : 0;
        int32_t before = (int32_t)azimuth;
        before -= before == (int32_t)last_azimuth;
        azimuth_before[x] = before;
        on[x] = (float)(azimuth - (double)before);
        sample_at[x] = __builtin_sqrt(right * right + down * down) * samples_per_px;
    }
}

static void find_heights(int32_t columns, const double *restrict sample_at, int32_t samples,
                         const double *restrict paraxial, const int32_t *restrict intervals,
                         const double *restrict heights, int32_t last_interval, int32_t *restrict interval,
                         float *restrict up)
{
    const double last_sample = (double)samples;
    for (int32_t x = 0; x < columns; x++) {
        const double at = sample_at[x] < last_sample ? sample_at[x] : last_sample; /* NaN too */
        int32_t sample = (int32_t)at;
        sample -= sample == samples;
        const double low = paraxial[sample], high = paraxial[sample + 1];
        const double height = low + (at - (double)sample) * (high - low);
        int32_t below = intervals[sample];
        below += (below < last_interval) & (height >= heights[below + 1]);
        const double above = (height - heights[below]) / (heights[below + 1] - heights[below]);
        const double risen = above > 0 ? above : 0; /* NaN too */
        interval[x] = below;
        up[x] = (float)(risen < 1 ? risen : 1);
    }
}

/* Positions of row y's pixels in a grid of nodes, beyond whose end they continue. */
static void find_cells(const lf_places *p, int64_t y, int64_t columns, const row_places *row)
{
    const int64_t at = y < p->rows ? y : p->rows - 1;
    for (int64_t x = 0; x < columns; x++) {
        const int64_t column = x < p->columns ? x : p->columns - 1;
        row->interval[x] = p->row_cell[at] + p->column_cell[column];
        row->azimuth[x] = 0;
        row->up[x] = p->row_on[at];
        row->on[x] = p->column_on[column];
    }
}

static void find_row(const lf_places *p, int64_t y, int64_t columns, const row_places *row)
{
    if (p->row_cell) {
        find_cells(p, y, columns, row);
        return;
    }
    find_azimuths(p, (int32_t)columns, (double)y - p->centre_row, row->sample, row->azimuth, row->on);
    find_heights((int32_t)columns, row->sample, (int32_t)p->samples, p->paraxial, p->interval, p->height,
                 (int32_t)p->heights - 2, row->interval, row->up);
}

/* Writes the first `taps` taps of a weighted sum of four PSFs: at two azimuths, and at the same azimuths of the next
   height. The weights are copied, because the compiler must assume that the sums overwrite `weight`. */
INLINE void mix(const float *psf, int64_t azimuth_step, int64_t height_step, const float *weight, int64_t taps,
                int add, float *mixture)
{
    const float here = weight[0], next = weight[1], higher = weight[2], higher_next = weight[3];
    const float *above = psf + height_step;
    for (int64_t i = 0; i < taps; i += LANES) {
        floats sum = here * *(const floats *)(psf + i) + next * *(const floats *)(psf + azimuth_step + i)
                     + higher * *(const floats *)(above + i) + higher_next * *(const floats *)(above + azimuth_step + i);
        if (add) sum += *(const floats *)(mixture + i);
        *(floats *)(mixture + i) = sum;
    }
}

/* Adds the light of four PSFs to a vector in a row of `planes` planes. */
#define ADD_FOUR(vector, planes) \
    const vector a = *(const vector *)(psfs + i), b = *(const vector *)(psfs + step + i); \
    const vector c = *(const vector *)(psfs + 2 * step + i), d = *(const vector *)(psfs + 3 * step + i); \
    for (int q = 0; q < planes; q++) { \
        vector *to = (vector *)(out + q * plane_step + i); \
        *to = *to + light[q][0] * a + light[q][1] * b + light[q][2] * c + light[q][3] * d; \
    }

/* Adds a row of `eights` * 8 taps of four PSFs, `step` apart in memory, to some planes. */
INLINE void add_four(int eights, const float *psfs, int64_t step, int planes, const float (*light)[FOUR], float *out,
                     int64_t plane_step)
{
    int i = 0;
    for (; i + LANES <= 8 * eights; i += LANES) { ADD_FOUR(floats, planes) }
    if (LANES > 8 && i < 8 * eights) { ADD_FOUR(eight_floats, planes) }
}

/* Adds a row of `eights` * 8 taps to the picture. */
INLINE void add_one(int eights, const float *taps, float *out)
{
    int i = 0;
    for (; i + LANES <= 8 * eights; i += LANES) *(floats *)(out + i) += *(const floats *)(taps + i);
    if (LANES > 8 && i < 8 * eights) *(eight_floats *)(out + i) += *(const eight_floats *)(taps + i);
}

/* Adds pieces of one size to the picture, with as many planes at once as the registers can hold the light of. */
INLINE void add_pieces(int eights, const float *psfs, int64_t step, int64_t pieces, const int64_t *offset, int planes,
                       four_pixels *four, int64_t plane_step)
{
    const int at_once = LANES == 16 ? 4 : 2;
    if (planes == 1)
        for (int64_t r = 0; r < pieces; r++) add_one(eights, psfs + r * 8 * eights, four->out + offset[r]);
    else
        for (int q = 0; q < 4; q += at_once) {
            float light[4][FOUR]; /* a copy: the compiler must assume that the sums overwrite `four` */
            for (int k = 0; k < at_once * FOUR; k++) light[k / FOUR][k % FOUR] = four->light[q + k / FOUR][k % FOUR];
            for (int64_t r = 0; r < pieces; r++)
                add_four(eights, psfs + r * 8 * eights, step, at_once, light, four->out + q * plane_step + offset[r],
                         plane_step);
        }
}

/* Spreads some groups of four pixels with heights in the same interval. */
static void spread_run(const lf_table *t, int64_t azimuths, int64_t interval, four_pixels *run, int count,
                       float *mixtures, const int64_t *offset, int planes, int64_t plane_step)
{
    const int64_t length = t->length[interval];
    int64_t done = 0, piece = t->first_piece[interval];
    for (int eights = 1; eights <= LF_LONGEST; eights++) {
        int64_t left = t->counts[interval * (LF_LONGEST + 1) + eights];
        while (left) {
            const int64_t pieces = left * eights > LF_PORTION ? LF_PORTION / eights : left, taps = pieces * eights * 8;
            for (four_pixels *four = run; four < run + count; four++) {
                for (int k = 0; k < FOUR; k++) {
                    const float *psf = four->psfs[k] + done;
                    if (planes == 1 && k) mix(psf, length, azimuths * length, four->weight[k], taps, 1, mixtures + k);
                    else
                        mix(psf, length, azimuths * length, four->weight[k], taps, 0,
                            mixtures + (planes == 1 ? 0 : k * MIXTURE_STEP) + k); /* for one plane they are summed */
                }
                switch (eights) {
#define CASE(n) case n: add_pieces(n, mixtures, MIXTURE_STEP, pieces, offset + piece, planes, four, plane_step); break;
                    CASE(1) CASE(2) CASE(3) CASE(4) CASE(5) CASE(6) CASE(7) CASE(8)
#undef CASE
                }
            }
            left -= pieces, done += taps, piece += pieces;
        }
    }
}

/* The layout of `work`: see lf_spread_work. */
typedef struct {
    int64_t *offset; /* (piece): from the corner of the square of PSFs to the piece, in the picture */
    row_places row;
    float *mixtures; /* of a portion of the table, for each of four pixels */
} workplace;

INLINE workplace laid_out(void *work, int64_t pieces, int64_t columns)
{
    const int64_t room = columns + FOUR;
    workplace w = {.offset = work};
    w.row.sample = (double *)(w.offset + pieces);
    w.row.interval = (int32_t *)(w.row.sample + room);
    w.row.azimuth = w.row.interval + room;
    w.row.up = (float *)(w.row.azimuth + room);
    w.row.on = w.row.up + room;
    w.mixtures = (float *)(((uintptr_t)(w.row.on + room) + 63) & ~(uintptr_t)63);
    for (int k = 0; k < FOUR; k++)
        for (int i = 0; i < k; i++) w.mixtures[k * MIXTURE_STEP + i] = 0; /* in front of the shifted taps */
    return w;
}

/* The light of four pixels from column x of row y, by plane. Returns 0 if all of it is black. */
INLINE int light_of_four(const lf_picture *light, const lf_sections *sections, int64_t y, int64_t x, int in_one,
                         four_floats of[4])
{
    const uint8_t *lit = sections->lit + y / sections->size_px * sections->columns;
    const float *from = light->values + y * light->row_step + x;
    four_ints any = {0};
    for (int q = 0; q < (int)light->planes; q++, from += light->plane_step) {
        if (in_one) of[q] = *(const four_floats *)from;
        else
            for (int k = 0; k < FOUR; k++)
                of[q][k] = x + k < light->columns && lit[(x + k) / sections->size_px] ? from[k] : 0;
        any |= (four_ints)of[q];
    }
    return ((any[0] | any[1] | any[2] | any[3]) & 0x7fffffff) != 0; /* NaN too */
}

lf_spread_loop OF_VARIANT(lf_spread);
/* Adds the light of rows first_row up to end_row to `out`, whose first row is the row of first_row's topmost tap. */
int OF_VARIANT(lf_spread)(const lf_places *places, const lf_table *t, const lf_picture *light,
                          const lf_sections *sections, int64_t first_row, int64_t end_row, const lf_picture *out,
                          void *work)
{
    const int64_t columns = light->columns;
    const int planes = (int)light->planes;
    const workplace w = laid_out(work, t->pieces, columns);
    for (int64_t n = 0; n < t->pieces; n++) w.offset[n] = t->row[n] * out->row_step + t->column[n];
    for (int64_t y = first_row; y < end_row; y++) {
        const uint8_t *lit = sections->lit + y / sections->size_px * sections->columns;
        four_pixels run[RUN];
        int64_t run_interval = 0;
        int waiting = 0, found = 0;
        int64_t section = 0, section_end = sections->size_px; /* of column x */
        for (int64_t x = 0; x < columns; x += FOUR) {
            for (; x >= section_end; section_end += sections->size_px) section++;
            if (!lit[section] && x + FOUR <= section_end) continue;
            const int in_one = lit[section] && x + FOUR <= section_end && x + FOUR <= columns;
            four_floats of[4];
            if (!light_of_four(light, sections, y, x, in_one, of)) continue;
            if (!found) {
                find_row(places, y, columns, &w.row);
                for (int64_t n = columns; n < columns + FOUR; n++) { /* a group may extend beyond the row */
                    w.row.interval[n] = w.row.interval[columns - 1];
                    w.row.azimuth[n] = w.row.azimuth[columns - 1];
                    w.row.up[n] = w.row.on[n] = 0;
                }
                found = 1;
            }
            for (int done = 0, next; done < FOUR; done = next) { /* once, unless heights pass a height of the table */
                const int64_t interval = w.row.interval[x + done], length = t->length[interval];
                for (next = done + 1; next < FOUR && w.row.interval[x + next] == interval;) next++;
                if (waiting == RUN || (waiting && interval != run_interval)) {
                    spread_run(t, places->azimuths, run_interval, run, waiting, w.mixtures, w.offset, planes, out->plane_step);
                    waiting = 0;
                }
                run_interval = interval;
                four_pixels *four = run + waiting++;
                four->out = out->values + (y - first_row) * out->row_step + x;
                for (int k = 0; k < FOUR; k++) {
                    const int is = k >= done && k < next;
                    const int64_t at = x + (is ? k : done); /* the group's other pixels use the first one's, times zero */
                    const float up = w.row.up[at], on = w.row.on[at];
                    const float own = planes > 1 ? 1 : is ? of[0][k] : 0;
                    four->psfs[k] = t->taps + t->begin[interval] + w.row.azimuth[at] * length;
                    four->weight[k][0] = (1 - up) * (1 - on) * own;
                    four->weight[k][1] = (1 - up) * on * own;
                    four->weight[k][2] = up * (1 - on) * own;
                    four->weight[k][3] = up * on * own;
                    for (int q = 0; q < planes; q++) four->light[q][k] = is ? of[q][k] : 0;
                }
            }
        }
        if (waiting) spread_run(t, places->azimuths, run_interval, run, waiting, w.mixtures, w.offset, planes, out->plane_step);
    }
    return 0;
}
