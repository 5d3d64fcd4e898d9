/* Holds every variant of the loops against plain ones in double precision, on random shapes: driver ROUNDS SEED

   One line for each variant that this processor can run: how far each loop was off, as a part of what rounding to its
   precision can come to, and a hash of all bits that came out, which is to be the same for all. Of what goes in nothing
   is rounded otherwise by other compilers or libraries: so it is to be the same on all machines, too. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "kernels.h"

#define MOST_VARIANTS 4
#define SINGLE (1.0 / (1 << 24)) /* what a rounding to single precision is off by, at most, as a part of the value */
#define DOUBLE (SINGLE * SINGLE / 32)

static uint64_t state;
static uint64_t hash[MOST_VARIANTS];
#define LOOPS 16 /* spreading, footprints, turning, waves, casting, extremes, excess, spots, tracing, aiming, fitting,
                    collecting, reading, ghosts' rays and light, controls */
static double worst[MOST_VARIANTS][LOOPS];

static uint32_t random_bits(void)
{
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(state >> 33);
}
static int64_t below(int64_t n) { return random_bits() % (uint32_t)n; }
static double unit(void) { return random_bits() / 2147483648.0; }

static void *room(int64_t count, size_t size)
{
    void *p = calloc((size_t)count + 1, size);
    if (!p) abort();
    return p;
}
#define ROOM(type, count) ((type *)room(count, sizeof(type)))

static int runs(int variant) { return lf_variant(variant) && lf_runs_here(variant); }

static void expect(int right, const char *what)
{
    if (right) return;
    printf("%s\n", what);
    exit(1);
}

static void take_bits(int variant, const void *values, int64_t bytes)
{
    for (const unsigned char *c = values; bytes--; c++) hash[variant] = (hash[variant] ^ *c) * 1099511628211u;
}

static void take_deviation(int variant, int loop, double deviation, double bound)
{
    if (!(deviation / bound <= worst[variant][loop])) worst[variant][loop] = deviation / bound; /* NaN too */
}

/* Spreading: PSFs of noise in a circle of its own for each height, packed into pieces as the loop wants them. */

typedef struct {
    int64_t side, heights, azimuths;
    double *psf; /* (height, azimuth, row, column) */
    lf_table packed;
} psf_table;

static const double *psf_at(const psf_table *t, int64_t height, int64_t azimuth)
{
    return t->psf + (height * t->azimuths + azimuth) * t->side * t->side;
}

static psf_table random_table(void)
{
    const int64_t radius = below(6) ? below(12) : below(70), side = 2 * radius + 1, most = 8 * LF_LONGEST - 3;
    psf_table t = {side, 2 + below(4), below(3) ? 2 + below(7) : 2, 0, {0}};
    int64_t reach[8];
    t.psf = ROOM(double, t.heights * t.azimuths * side * side);
    for (int64_t h = 0; h < t.heights; h++) {
        reach[h] = below(radius + 1);
        for (int64_t i = 0; i < t.azimuths * side * side; i++) {
            const int64_t down = i / side % side - radius, right = i % side - radius;
            if (down * down + right * right <= reach[h] * reach[h])
                t.psf[h * t.azimuths * side * side + i] = (float)unit();
        }
    }
    const int64_t intervals = t.heights - 1, pieces = intervals * side * (side / most + 1);
    int64_t *begin = ROOM(int64_t, intervals), *length = ROOM(int64_t, intervals), *first = ROOM(int64_t, intervals);
    int64_t *counts = ROOM(int64_t, intervals * (LF_LONGEST + 1)), *row = ROOM(int64_t, pieces);
    int64_t *column = ROOM(int64_t, pieces), *taps_of = ROOM(int64_t, pieces);
    int64_t size = LF_SLACK, count = 0;
    for (int64_t b = 0; b < intervals; b++) {
        const int64_t wide = reach[b] > reach[b + 1] ? reach[b] : reach[b + 1];
        begin[b] = size;
        first[b] = count;
        for (int64_t eights = 1; eights <= LF_LONGEST; eights++)
            for (int64_t y = -wide; y <= wide; y++) {
                int64_t half = 0;
                while ((half + 1) * (half + 1) + y * y <= wide * wide) half++;
                for (int64_t x = radius - half; x <= radius + half; x += most) {
                    const int64_t taps = radius + half + 1 - x < most ? radius + half + 1 - x : most;
                    if ((taps + 3 + 7) / 8 != eights) continue;
                    row[count] = y + radius, column[count] = x, taps_of[count++] = taps;
                    counts[b * (LF_LONGEST + 1) + eights]++;
                    length[b] += 8 * eights;
                }
            }
        size += 2 * t.azimuths * length[b];
    }
    size += LF_SLACK;
    float *taps = ROOM(float, size);
    for (int64_t b = 0; b < intervals; b++)
        for (int64_t k = 0; k < 2 * t.azimuths; k++) {
            float *to = taps + begin[b] + k * length[b];
            const double *psf = psf_at(&t, b + k / t.azimuths, k % t.azimuths);
            for (int64_t n = first[b]; n < (b + 1 < intervals ? first[b + 1] : count); n++) {
                for (int64_t i = 0; i < taps_of[n]; i++) to[i] = (float)psf[row[n] * side + column[n] + i];
                to += (taps_of[n] + 3 + 7) / 8 * 8;
            }
        }
    free(taps_of);
    t.packed = (lf_table){taps, size, side, intervals, begin, length, first, counts, row, column, count};
    return t;
}

static void free_table(psf_table *t)
{
    const lf_table *p = &t->packed;
    const void *all[] = {t->psf, p->taps, p->begin, p->length, p->first_piece, p->counts, p->row, p->column};
    for (size_t n = 0; n < sizeof all / sizeof *all; n++) free((void *)all[n]);
}

/* Heights that grow evenly but for a jitter, and the curve of them over the distance from the axis. */
static lf_places random_places(const psf_table *t, int64_t rows, int64_t columns)
{
    const int64_t quarter = t->azimuths < 4 || below(2) ? t->azimuths - 1 : (t->azimuths - 1) / 4 + 1;
    const int64_t samples = 4 * t->heights + below(50);
    double *height = ROOM(double, t->heights), *paraxial = ROOM(double, samples + 1);
    int32_t *interval = ROOM(int32_t, samples + 1);
    for (int64_t h = 0; h < t->heights; h++) height[h] = (double)h + (h ? unit() / 2 : 0);
    for (int64_t n = 0; n <= samples; n++) {
        paraxial[n] = 1.2 * height[t->heights - 1] * (double)n / (double)samples;
        while (interval[n] < t->heights - 2 && height[interval[n] + 1] <= paraxial[n]) interval[n]++;
    }
    const int folded = quarter == t->azimuths - 1; /* azimuths of a quarter turn alone */
    return (lf_places){folded ? -0.5 * (double)below(2) : unit() * (double)rows,
                       folded ? -0.5 * (double)below(2) : unit() * (double)columns,
                       (double)samples / (1 + unit() * (double)(rows + columns)), paraxial, interval, height, samples,
                       t->heights, t->azimuths, quarter, 0, 0, 0, 0, 0, 0};
}

/* A grid of nodes with two columns of cells: the cell of interval n has the table's heights n and n + 1 as its corners
   on the left and, at the second azimuth, on the right. */
static lf_places random_cells(const psf_table *t, int64_t rows, int64_t columns)
{
    const int64_t down = 1 + below(rows), across = 1 + below(columns); /* the last ones continue */
    const int32_t intervals = (int32_t)t->heights - 1, wide = intervals / 2;
    int32_t *row_cell = ROOM(int32_t, down), *column_cell = ROOM(int32_t, across);
    float *row_on = ROOM(float, down), *column_on = ROOM(float, across);
    for (int64_t y = 0; y < down; y++) row_cell[y] = (int32_t)below(intervals - wide), row_on[y] = (float)unit();
    for (int64_t x = 0; x < across; x++) column_cell[x] = (int32_t)below(wide + 1), column_on[x] = (float)unit();
    lf_places p = {0};
    p.azimuths = 2, p.rows = down, p.columns = across;
    p.row_cell = row_cell, p.column_cell = column_cell, p.row_on = row_on, p.column_on = column_on;
    return p;
}

static void mix_at(const psf_table *t, int64_t low, int64_t before, double up, double on, double *psf)
{
    for (int64_t i = 0; i < t->side * t->side; i++)
        psf[i] = (1 - up) * ((1 - on) * psf_at(t, low, before)[i] + on * psf_at(t, low, before + 1)[i])
                 + up * ((1 - on) * psf_at(t, low + 1, before)[i] + on * psf_at(t, low + 1, before + 1)[i]);
}

/* The PSF of a pixel, from its definition: array (row, column) of the square. */
static void mix(const psf_table *t, const lf_places *p, int64_t y, int64_t x, double *psf)
{
    if (p->row_cell) {
        const int64_t row = y < p->rows ? y : p->rows - 1, column = x < p->columns ? x : p->columns - 1;
        mix_at(t, p->row_cell[row] + p->column_cell[column], 0, p->row_on[row], p->column_on[column], psf);
        return;
    }
    const double down = (double)y - p->centre_row, right = (double)x - p->centre_column, pi = 3.141592653589793;
    double azimuth = atan2(down, right), at = sqrt(right * right + down * down) * p->samples_per_px;
    azimuth = (azimuth < 0 ? azimuth + 2 * pi : azimuth) * (double)p->quarter_steps / (pi / 2);
    azimuth = fmin(azimuth, (double)(p->azimuths - 1));
    at = fmin(at, (double)p->samples);
    const int64_t before = azimuth < (double)(p->azimuths - 1) ? (int64_t)azimuth : p->azimuths - 2;
    const int64_t sample = at < (double)p->samples ? (int64_t)at : p->samples - 1;
    const double mm = p->paraxial[sample] + (at - (double)sample) * (p->paraxial[sample + 1] - p->paraxial[sample]);
    int64_t low = 0;
    while (low < p->heights - 2 && mm >= p->height[low + 1]) low++;
    const double up = fmin((mm - p->height[low]) / (p->height[low + 1] - p->height[low]), 1);
    mix_at(t, low, before, up, azimuth - (double)before, psf);
}

static void try_spreading(void)
{
    const int64_t planes = below(2) ? 1 : 4, rows = 1 + below(9), columns = 1 + below(40), size = 1 + below(9);
    const int64_t down = (rows + size - 1) / size, across = (columns + size - 1) / size;
    psf_table t = random_table();
    const int in_cells = t.azimuths == 2 && below(2);
    const lf_places places = in_cells ? random_cells(&t, rows, columns) : random_places(&t, rows, columns);
    float *values = ROOM(float, planes * rows * columns);
    uint8_t *lit = ROOM(uint8_t, down * across);
    for (int64_t i = 0; i < planes * rows * columns; i++) values[i] = below(3) ? (float)unit() : 0;
    for (int64_t i = 0; i < down * across; i++) lit[i] = below(5) > 0;
    const lf_picture light = {values, planes, rows, columns, rows * columns, columns};
    const lf_sections sections = {lit, down, across, size};
    const int64_t out_rows = rows + t.side - 1, out_columns = columns + t.side - 1, step = out_columns + LF_SLACK;
    const int64_t count = planes * out_rows * step;
    double *truth = ROOM(double, count), *terms = ROOM(double, count), *psf = ROOM(double, t.side * t.side);
    for (int64_t y = 0; y < rows; y++)
        for (int64_t x = 0; x < columns; x++) {
            if (!lit[y / size * across + x / size]) continue;
            mix(&t, &places, y, x, psf);
            for (int64_t q = 0; q < planes; q++)
                for (int64_t i = 0; i < t.side * t.side; i++) {
                    const int64_t to = (q * out_rows + y + i / t.side) * step + x + i % t.side;
                    truth[to] += psf[i] * values[(q * rows + y) * columns + x];
                    terms[to]++;
                }
        }
    const int64_t bytes = lf_spread_work(t.packed.pieces, columns);
    expect(bytes > 0, "spreading refused its size");
    void *work = room(bytes, 1);
    for (int v = 0; runs(v); v++) {
        float *result = ROOM(float, count);
        const lf_picture out = {result, planes, out_rows, step, out_rows * step, step};
        lf_picture narrow = out;
        narrow.columns--;
        expect(lf_spread(v, &places, &t.packed, &light, &sections, 0, rows, &narrow, work) == LF_BAD_SIZE &&
               lf_spread(v, &places, &t.packed, &light, &sections, 0, rows + 1, &out, work) == LF_BAD_SIZE,
               "spreading took a size that cannot be");
        expect(!lf_spread(v, &places, &t.packed, &light, &sections, 0, rows, &out, work), "spreading refused its sizes");
        take_bits(v, result, count * 4);
        /* Each pixel adds a product of values up to 1 whose weights are rounded, and the sum is rounded each time. */
        for (int64_t i = 0; i < count; i++)
            take_deviation(v, 0, fabs(result[i] - truth[i]),
                           SINGLE * (truth[i] * (terms[i] + 10) + 8 * terms[i]) + 1e-30);
        free(result);
    }
    free_table(&t);
    void *all[] = {(void *)places.paraxial, (void *)places.interval, (void *)places.height, (void *)places.row_cell,
                   (void *)places.column_cell, (void *)places.row_on, (void *)places.column_on, values, lit, truth, terms, psf, work};
    for (size_t n = 0; n < sizeof all / sizeof *all; n++) free(all[n]);
}

/* Footprints: of captures that planes see from all sides; of lenses with curves of any kind, then only that nothing
   is read from outside, which the sanitizers see. */

static double overlap(double middle, double width, int64_t pixel)
{
    const double from = fmax((double)pixel - 0.5, middle - width / 2), to = fmin((double)pixel + 0.5, middle + width / 2);
    return to > from ? (to - from) / width : 0;
}

static double area_mean(const lf_capture *c, int64_t plane, double row, double high, double column, double wide)
{
    double sum = 0;
    for (int64_t j = 0; j < c->rows; j++) {
        const double in_row = overlap(c->centre_row + row, fmax(high, 1), j);
        for (int64_t i = 0; in_row > 0 && i < c->columns; i++)
            sum += in_row * overlap(c->centre_column + column, fmax(wide, 1), i)
                   * c->values[j * c->row_step + i * c->planes + plane];
    }
    return sum;
}

static double footprint_on_mesh(const lf_geometry *lens, const lf_capture *c, int64_t plane, int64_t y, int64_t x)
{
    const int64_t step = lens->mesh_step, last_row = lens->mesh_rows - 2, last_column = lens->mesh_columns - 2;
    const int64_t row = y / step < last_row ? y / step : last_row, column = x / step < last_column ? x / step : last_column;
    const double down = (double)(y - row * step) / (double)step, on = (double)(x - column * step) / (double)step;
    double value[6];
    for (int k = 0; k < 6; k++) {
        const double *at = lens->mesh + 6 * (row * lens->mesh_columns + column) + k, *below_it = at + 6 * lens->mesh_columns;
        value[k] = (1 - down) * ((1 - on) * at[0] + on * at[6]) + down * ((1 - on) * below_it[0] + on * below_it[6]);
    }
    return value[5] > 1 ? 0 : value[4] * area_mean(c, plane, value[0], value[2], value[1], value[3]);
}

static double footprint(const lf_geometry *lens, const lf_capture *c, int64_t plane, int64_t y, int64_t x)
{
    if (lens->mesh) return footprint_on_mesh(lens, c, plane, y, x);
    const double down = (double)y - lens->centre_row, right = (double)x - lens->centre_column;
    const double distance = sqrt(right * right + down * down), at = fmin(distance * lens->samples_per_px, (double)lens->samples);
    const int64_t sample = at < (double)lens->samples ? (int64_t)at : lens->samples - 1;
    double curve[3];
    for (int k = 0; k < 3; k++) {
        const double low = lens->curves[3 * sample + k], high = lens->curves[3 * sample + 3 + k];
        curve[k] = low + (at - (double)sample) * (high - low);
    }
    if (distance > lens->last_px) return 0;
    const double cos_squared = distance > 0 ? right * right / (distance * distance) : 0;
    const double high = curve[1] + (curve[0] - curve[1]) * cos_squared, wide = curve[0] + (curve[1] - curve[0]) * cos_squared;
    return curve[2] * area_mean(c, plane, down * curve[0], high, right * curve[0], wide);
}

/* A mesh of `values` numbers over a picture, each random: numbers of any kind, or footprints in a capture. */
static lf_geometry random_mesh(int64_t rows, int tame, const lf_capture *c, const double *wild)
{
    lf_geometry lens = {0};
    lens.mesh_step = 1 + below(20), lens.mesh_rows = 2 + rows / lens.mesh_step, lens.mesh_columns = 2 + below(4);
    double *mesh = ROOM(double, 6 * lens.mesh_rows * lens.mesh_columns);
    for (int64_t i = 0; i < 6 * lens.mesh_rows * lens.mesh_columns; i++) {
        const double length = (double)(i % 6 ? c->columns : c->rows);
        mesh[i] = !tame && below(2) ? wild[below(9)] : i % 6 < 2 ? length * (unit() - 0.5) : i % 6 < 4 ? 0.5 + 1.5 * unit()
                  : i % 6 == 4 ? unit() : 1.3 * unit();
    }
    lens.mesh = mesh;
    return lens;
}

static void try_footprints(void)
{
    static const double wild[] = {NAN, INFINITY, -INFINITY, -1e300, 1e300, 0, -0.5, 40, 1e-320};
    const int64_t planes = below(2) ? 1 : 4, rows = 1 + below(30), columns = 1 + below(50), samples = 1 + below(40);
    const int64_t down = 1 + below(50), across = 1 + below(60);
    const int tame = below(4) > 0;
    double *curves = ROOM(double, 3 * (samples + 1));
    for (int64_t i = 0; i < 3 * (samples + 1); i++)
        curves[i] = !tame && below(2) ? wild[below(9)] : i % 3 == 2 ? unit() : 0.5 + 1.5 * unit();
    const int64_t row_step = planes * across + below(5);
    float *values = ROOM(float, down * row_step);
    for (int64_t i = 0; i < down * row_step; i++) values[i] = (float)unit();
    const lf_geometry by_curves = {unit() * (double)rows, unit() * (double)columns, (double)samples / (1 + 60 * unit()),
                                   curves, samples, below(3) ? 1e9 : 40 * unit(), 0, 0, 0, 0};
    const lf_capture c = {values, planes, down, across, row_step, unit() * (double)down, unit() * (double)across};
    const lf_geometry lens = below(2) ? by_curves : random_mesh(rows, tame, &c, wild);
    for (int v = 0; runs(v); v++) {
        float *result = ROOM(float, planes * rows * columns);
        const lf_picture out = {result, planes, rows, columns, rows * columns, columns};
        expect(lf_footprints(v, &lens, &c, 0, rows + 1, &out) == LF_BAD_SIZE, "footprints took a size that cannot be");
        expect(!lf_footprints(v, &lens, &c, 0, rows, &out), "footprints refused their sizes");
        if (tame) take_bits(v, result, planes * rows * columns * 4);
        for (int64_t i = 0; tame && i < planes * rows * columns; i++) /* 18 sums of 18 rounded shares of values up to 1 */
            take_deviation(v, 1, fabs(result[i] - footprint(&lens, &c, i / (rows * columns), i / columns % rows, i % columns)),
                           2 * (18 + 4) * SINGLE);
        free(result);
    }
    free(curves), free(values), free((void *)lens.mesh);
}

/* Extremes and excess of sections, pixel by pixel. */

static void try_sections(void)
{
    const int64_t planes = 1 + below(4), rows = 1 + below(60), columns = 1 + below(90), size = 1 + below(40);
    const int64_t down = (rows + size - 1) / size, across = (columns + size - 1) / size, step = columns + below(5);
    float *values = ROOM(float, planes * rows * step);
    for (int64_t i = 0; i < planes * rows * step; i++) values[i] = below(3) ? (float)(unit() - 0.3) : 0;
    const lf_picture light = {values, planes, rows, columns, rows * step, step};
    const float level = below(2) ? (float)unit() : 0;
    float *truth = ROOM(float, 4 * down * across);
    double *sums = ROOM(double, planes * down * across);
    for (int64_t i = 0; i < down * across; i++) truth[down * across + i] = truth[2 * down * across + i] = INFINITY;
    for (int64_t q = 0; q < planes; q++)
        for (int64_t y = 0; y < rows; y++)
            for (int64_t x = 0; x < columns; x++) {
                const float *at = values + (q * rows + y) * step + x, here = fabsf(*at);
                float *of = truth + y / size * across + x / size;
                of[0] = fmaxf(of[0], here);
                if (here > 0) of[down * across] = fminf(of[down * across], here);
                of[2 * down * across] = fminf(of[2 * down * across], here);
                if (x + 1 < columns) of[3 * down * across] = fmaxf(of[3 * down * across], fabsf(fabsf(at[1]) - here));
                if (y + 1 < rows) of[3 * down * across] = fmaxf(of[3 * down * across], fabsf(fabsf(at[step]) - here));
                if (*at > level) sums[(q * down + y / size) * across + x / size] += *at - level;
            }
    for (int v = 0; runs(v); v++) {
        float *result = ROOM(float, 4 * down * across);
        double *excess = ROOM(double, planes * down * across);
        const int64_t count = down * across;
        const lf_extremes_of out = {result, result + count, result + 2 * count, result + 3 * count, down, across, size};
        const lf_excess_of above = {excess, down, across, size};
        lf_extremes_of odd = out;
        odd.rows++;
        expect(lf_extremes(v, &light, &odd, 0, 1) == LF_BAD_SIZE && lf_extremes(v, &light, &out, 0, down + 1) == LF_BAD_SIZE
               && lf_excess(v, &light, level, &above, 1, 0) == LF_BAD_SIZE, "sections took a size that cannot be");
        expect(!lf_extremes(v, &light, &out, 0, 1) && !lf_extremes(v, &light, &out, 1, down)
               && !lf_excess(v, &light, level, &above, 0, down), "sections refused their sizes");
        take_bits(v, result, 4 * count * 4), take_bits(v, excess, planes * count * 8);
        take_deviation(v, 5, memcmp(result, truth, (size_t)(4 * count) * 4) != 0, 0.5); /* exact */
        for (int64_t i = 0; i < planes * count; i++) /* up to 1600 additions */
            take_deviation(v, 6, fabs(excess[i] - sums[i]), 1600 * DOUBLE * (sums[i] + 1));
        free(result), free(excess);
    }
    free(values), free(truth), free(sums);
}

/* Turning, by angles whose sine and cosine are fractions, for those are the same everywhere. */

static double rise(double x) /* integral of 1 - |x| from -1 */
{
    return x < -1 ? 0 : x < 0 ? (1 + x) * (1 + x) / 2 : x < 1 ? 1 - (1 - x) * (1 - x) / 2 : 1;
}

static double reached(double middle, double width, int64_t pixel)
{
    return (rise(middle + width / 2 - (double)pixel) - rise(middle - width / 2 - (double)pixel)) / width;
}

static void try_turning(void)
{
    const int64_t count = 1 + below(300), heights = 8 * (1 + below(3)), radius = 3 + below(10), side = 2 * radius + 1;
    const int64_t size = side * side * heights;
    double *v_px = ROOM(double, count), *u_px = ROOM(double, count), *energy = ROOM(double, count * heights);
    double *truth = ROOM(double, size);
    const lf_samples samples = {v_px, u_px, energy, count, heights, 0.1 + 0.9 * unit()};
    const double reach = (double)radius - 0.5;
    for (int64_t n = 0; n < count; n++)
        do v_px[n] = reach * (2 * unit() - 1), u_px[n] = reach * (2 * unit() - 1);
        while (v_px[n] * v_px[n] + u_px[n] * u_px[n] > reach * reach);
    for (int64_t i = 0; i < count * heights; i++) energy[i] = unit();
    const double half = below(9) ? 4 * unit() - 2 : 0, cosine = (1 - half * half) / (1 + half * half);
    const double sine = 2 * half / (1 + half * half), width = samples.size_px;
    for (int64_t n = 0; n < count; n++) {
        const double down = -v_px[n] * sine + u_px[n] * cosine, right = v_px[n] * cosine + u_px[n] * sine;
        for (int64_t i = 0; i < side * side; i++) {
            const double share = reached(down, width, i / side - radius) * reached(right, width, i % side - radius);
            for (int64_t h = 0; share > 0 && h < heights; h++) truth[i * heights + h] += share * energy[n * heights + h];
        }
    }
    for (int v = 0; runs(v); v++) {
        double *result = ROOM(double, size);
        expect(!lf_turn(v, &samples, cosine, sine, side, result), "turning refused its sizes");
        take_bits(v, result, size * 8);
        /* A share is a difference of numbers up to the radius over a width of no less than a tenth; values are up to 1. */
        for (int64_t i = 0; i < size; i++)
            take_deviation(v, 2, fabs(result[i] - truth[i]), (double)count * 100 * (double)radius * DOUBLE);
        free(result);
    }
    const double beyond[] = {NAN, 1e9, (double)radius, -(double)radius}; /* but for the first two: by little */
    const int64_t one = below(count), by = below(4);
    v_px[one] = beyond[by] * cosine, u_px[one] = beyond[by] * sine;
    for (int v = 0; runs(v); v++)
        expect(lf_turn(v, &samples, cosine, sine, side, truth) == LF_OUTSIDE, "turning took a sample outside");
    free(v_px), free(u_px), free(energy), free(truth);
}

/* Waves, of polynomials whose terms fall off, as those of smooth wavefronts do; and of others, for the sanitizers. */

static double chebyshev(double at, const double *terms, const float *single, int64_t count)
{
    double sum = 0, before = 1, now = at;
    for (int64_t n = 0; n < count; n++) {
        sum += (terms ? terms[n] : single[n]) * before;
        const double next = 2 * at * now - before;
        before = now, now = next;
    }
    return sum;
}

/* What of a cell passes, and by how much rounding may change that. */
static double passing(const lf_wavefront *w, const double *tightest, int64_t row, int64_t column, double rounding,
                      double *off)
{
    const int64_t middle = row < 1 ? 1 : row > w->rows - 2 ? w->rows - 2 : row;
    const double *here = tightest + row * w->columns + column, *above = tightest + (middle + 1) * w->columns + column;
    double change = fabs(above[0] - above[-2 * w->columns]);
    if (column > 0 && column < w->columns - 1) change += fabs(here[1] - here[-1]);
    change = fmax(change, 1e-12);
    const double share = 0.5 + 2 * (1 - here[0]) / change;
    *off = 2 * rounding / change + fabs(share - 0.5) * 4 * rounding / change + 8 * SINGLE;
    return fmin(fmax(share, 0), 1);
}

static void try_waves(void)
{
    static const float wild[] = {NAN, INFINITY, -INFINITY, -1e30f, 1e30f, 1e-40f};
    const int64_t rows = 3 + below(40), columns = 8 * (1 + below(8)), path_terms = 3 + below(11), limits = 1 + below(3);
    const int64_t edge_terms = 1 + below(8), size = rows * columns, square = 1 + below(2);
    const int tame = below(4) > 0;
    double *across = ROOM(double, columns), *up = ROOM(double, rows), *path = ROOM(double, rows * path_terms);
    float *edges = ROOM(float, rows * (1 + limits) * edge_terms), *work = ROOM(float, 3 * (columns + 16));
    double *tightest = ROOM(double, size), *table = ROOM(double, path_terms * columns), largest = 0;
    float *edge_table = ROOM(float, edge_terms * columns);
    for (int64_t c = 0; c < columns; c++) {
        const double x = ((double)c + unit()) / ((double)columns - 1);
        across[c] = square == 1 ? 2 * x * x - 1 : 2 * x - 1;
        double value = 1, next = across[c]; /* by recurrence, which has the same bits on all machines */
        for (int64_t n = 0; n < path_terms || n < edge_terms; n++) {
            const double after = 2 * across[c] * next - value;
            if (n < path_terms) table[n * columns + c] = value;
            if (n < edge_terms) edge_table[n * columns + c] = (float)value;
            value = next, next = after;
        }
    }
    for (int64_t row = 0; row < rows; row++) up[row] = 2.1 * ((double)row + unit()) / (double)rows - 1.05;
    for (int64_t i = 0; i < rows * path_terms; i++) path[i] = 200 * (unit() - 0.5) / (double)(1 + i % path_terms);
    for (int64_t i = 0; i < rows * (1 + limits) * edge_terms; i++) {
        const int64_t term = i % edge_terms;
        edges[i] = !tame && !below(9) ? wild[below(6)] : (float)(2 * unit() / (double)(1 + term * term));
    }
    for (int64_t row = 0; row < rows; row++) { /* limits that grow with the row, as those of a smooth wavefront */
        float *limit = edges + row * (1 + limits) * edge_terms;
        for (int64_t n = 1; tame && n <= limits; n++)
            for (int64_t k = 0; k < edge_terms; k++)
                limit[n * edge_terms + k] = (float)((0.4 + 1.2 * (double)row / (double)rows) / (double)(1 + 2 * k));
    }
    for (int64_t i = 0; i < size; i++)
        for (int64_t n = 1; n <= limits; n++) {
            const float *terms = edges + (i / columns * (1 + limits) + n) * edge_terms;
            const double value = chebyshev(across[i % columns], 0, terms, edge_terms);
            tightest[i] = n > 1 ? fmax(tightest[i], value) : value;
        }
    for (int64_t i = 0; i < rows * (1 + limits) * edge_terms; i++) largest = fmax(largest, fabs(edges[i]));
    const double rounding = 4 * SINGLE * largest * (double)(edge_terms * edge_terms); /* of the sum of terms */
    const lf_wavefront w = {table, edge_table, up, path, edges, rows, columns, path_terms, edge_terms, limits, square,
                            0.2f, 2.5f};
    lf_wavefront odd = w;
    odd.columns--;
    for (int v = 0; runs(v); v++) {
        float *result = ROOM(float, 2 * size);
        const lf_picture out = {result, 2, rows, columns, size, columns}, narrow = {result, 2, rows, columns - 1, size, columns};
        double light[2], sums[2] = {0}, off = 0;
        expect(lf_waves(v, &odd, &out, light, work) == LF_BAD_SIZE && lf_waves(v, &w, &narrow, light, work) == LF_BAD_SIZE,
               "waves took a size that cannot be");
        expect(!lf_waves(v, &w, &out, light, work), "waves refused their sizes");
        if (tame) take_bits(v, result, 2 * size * 4), take_bits(v, light, 16);
        for (int64_t i = 0; tame && i < size; i++) {
            const int64_t row = i / columns, column = i % columns;
            double share_off;
            double share = passing(&w, tightest, row, column, rounding, &share_off);
            const int inside = table[square * columns + column] <= 1 - 2 * up[row] * up[row];
            const double waves = chebyshev(across[column], path + row * path_terms, 0, path_terms);
            double power = chebyshev(across[column], 0, edges + row * (1 + limits) * edge_terms, edge_terms);
            power = fmin(fmax(power, w.least), w.most) - w.most;
            const double whole = exp(power / 2), angle = -2 * 3.141592653589793 * (waves - rint(waves));
            if (!inside) share = share_off = 0;
            const double bound = whole * share_off + share * (rounding + 20 * SINGLE) + 1e-30;
            take_deviation(v, 3, fabs(result[i] - whole * share * cos(angle)), bound);
            take_deviation(v, 3, fabs(result[size + i] - whole * share * sin(angle)), bound);
            sums[0] += whole * whole * share, sums[1] += whole * whole * share * share, off += 2 * bound;
        }
        for (int k = 0; tame && k < 2; k++) take_deviation(v, 3, fabs(light[k] - sums[k]), off + 1e-30);
        free(result);
    }
    free(across), free(up), free(path), free(edges), free(work), free(tightest), free(table), free(edge_table);
}

/* Spots: tubes of random shapes, as their definition has it; of numbers of any kind, for the sanitizers. */

static double in_sample(double middle, double extent, int64_t sample)
{
    return fmax(0, fmin(middle + extent / 2, (double)sample + 1) - fmax(middle - extent / 2, (double)sample)) / extent;
}

static void box(double *out, int64_t side, double x, double y, double width, double height, double light)
{
    width = fmax(width, 0.01), height = fmax(height, 0.01);
    for (int64_t i = 0; i < side * side; i++)
        out[i] += light * in_sample(y, height, i / side) * in_sample(x, width, i % side);
}

/* A quantity in the middle of a part, or its change along or around it. */
static double of_part(const lf_bundle *b, int64_t quantity, int64_t r, int64_t a, int what)
{
    double corner[4], parts = (double)b->parts;
    for (int k = 0; k < 4; k++) {
        const double *cell = b->corners + (quantity * b->radii + r / b->parts) * b->azimuths + a / b->parts;
        const double u = ((double)(r % b->parts) + (k & 2 ? 1 : 0)) / parts, v = ((double)(a % b->parts) + (k & 1)) / parts;
        corner[k] = (1 - u) * ((1 - v) * cell[0] + v * cell[1]) + u * ((1 - v) * cell[b->azimuths] + v * cell[b->azimuths + 1]);
    }
    if (what == 0) return (corner[0] + corner[1] + corner[2] + corner[3]) / 4;
    return what == 1 ? (corner[2] + corner[3] - corner[0] - corner[1]) / 2 : (corner[1] + corner[3] - corner[0] - corner[2]) / 2;
}

static double spot_of(const lf_bundle *b, int64_t r, int64_t a, double *out)
{
    double q[7][3];
    for (int k = 0; k < 7; k++)
        for (int what = 0; what < 3; what++) q[k][what] = of_part(b, k, r, a, what);
    const double change = fabs(q[6][1]) + fabs(q[6][2]), share = fmin(fmax(0.5 + (1 - q[6][0]) / fmax(change, 1e-12), 0), 1);
    const double light = share * fabs(q[2][1] * q[3][2] - q[2][2] * q[3][1]);
    const double across = q[6][1] * q[5][2] - q[6][2] * q[5][1], up = q[6][2] * q[4][1] - q[6][1] * q[4][2];
    const double slope = fmax(hypot(across, up), 1e-300), area = fabs(q[4][1] * q[5][2] - q[4][2] * q[5][1]);
    const double near = fmax((1 - q[6][0] - change / 2) * area / slope, 0), far = (1 - q[6][0] + change / 2) * area / slope;
    const double width = fabs(q[0][1]) + fabs(q[0][2]), height = fabs(q[1][1]) + fabs(q[1][2]);
    if (light <= 0) return 0;
    if (near > 8 || far <= near) {
        box(out, b->side, q[0][0], q[1][0], width, height, light);
        return light;
    }
    for (double inner = 1 / far, outer; inner < 2 * (double)b->side; inner = outer) {
        outer = fmin(1.25 * inner + 0.25, near > 0 ? 1 / near : INFINITY);
        for (int side = -1; side <= 1; side += 2)
            box(out, b->side, q[0][0] + side * across / slope * (inner + outer) / 2,
                q[1][0] + side * up / slope * (inner + outer) / 2, fmax(width, fabs(across / slope) * (outer - inner)),
                fmax(height, fabs(up / slope) * (outer - inner)), light / (far - near) / 2 * (1 / inner - 1 / outer));
        if (outer >= 1 / near) break;
    }
    return light;
}

/* All light of a cell, in as many parts as it covers samples, times 1.5. */
static double cell_of(const lf_bundle *b, int64_t r, int64_t a, double *out)
{
    lf_bundle one = *b;
    one.parts = 1;
    double extent = 0, all = 0;
    for (int k = 0; k < 2; k++) extent = fmax(extent, 1.5 * (fabs(of_part(&one, k, r, a, 1)) + fabs(of_part(&one, k, r, a, 2))));
    one.parts = extent < (double)b->parts - 1 ? 1 + (int64_t)extent : b->parts;
    for (int64_t n = 0; n < one.parts * one.parts; n++)
        all += spot_of(&one, r * one.parts + n / one.parts, a * one.parts + n % one.parts, out);
    return all;
}

static void try_spots(void)
{
    static const double wild[] = {NAN, INFINITY, -INFINITY, -1e300, 1e300, 1e-320};
    const int64_t radii = 2 + below(5), azimuths = 2 + below(5), parts = 1 + below(3), side = 1 + below(20);
    const int64_t plane = radii * azimuths;
    const int tame = below(4) > 0;
    double *corners = ROOM(double, 7 * plane), *truth = ROOM(double, side * side), all = 0;
    for (int64_t i = 0; i < 7 * plane; i++) {
        const int64_t quantity = i / plane, r = i % plane / azimuths, a = i % azimuths;
        const double even = quantity == 6 ? 1.4 * (double)r / (double)radii : (double)(quantity % 2 ? r + 1 : a + r / 2);
        const double scale = quantity < 2 ? (double)side / 4 : quantity < 4 ? 1 : quantity < 6 ? 3 : 0.3;
        corners[i] = !tame && !below(9) ? wild[below(6)] : quantity == 6 ? even + 0.2 * unit() : scale * (even + 0.3 * unit());
    }
    const lf_bundle b = {corners, radii, azimuths, parts, side};
    lf_bundle bare = b;
    bare.radii = 1;
    for (int64_t n = 0; n < (radii - 1) * (azimuths - 1); n++) all += cell_of(&b, n / (azimuths - 1), n % (azimuths - 1), truth);
    for (int v = 0; runs(v); v++) {
        double *result = ROOM(double, side * side), light = 0;
        expect(lf_spots(v, &bare, result, &light) == LF_BAD_SIZE, "spots took a size that cannot be");
        expect(!lf_spots(v, &b, result, &light), "spots refused their sizes");
        if (tame) take_bits(v, result, side * side * 8), take_bits(v, &light, 8);
        for (int64_t i = 0; tame && i < side * side; i++) take_deviation(v, 7, fabs(result[i] - truth[i]), 1e3 * DOUBLE * all);
        if (tame) take_deviation(v, 7, fabs(light - all), 1e3 * DOUBLE * all);
        free(result);
    }
    free(corners), free(truth);
}

/* Tracing, of one ray after the other; and aiming, by tracing the rays that were found. */

#define MOST_SURFACES 4

static double sag_of(const lf_system *s, int64_t n, double x, double y, double *by_x, double *by_y)
{
    const double *shape = s->shapes + n * (3 + s->even_terms + s->odd_terms), c = shape[0], square = x * x + y * y;
    const double rest = sqrt(1 - (1 + shape[1]) * c * c * square), r = sqrt(square);
    double sag = c * square / (1 + rest), power = 1, slope = c / (2 * rest);
    for (int64_t k = 0; k < s->even_terms; k++, power *= square)
        sag += shape[3 + k] * power * square, slope += ((double)k + 1) * shape[3 + k] * power;
    power = r;
    for (int64_t k = 0; k < s->odd_terms; k++, power *= square)
        sag += shape[3 + s->even_terms + k] * power, slope += ((double)k + 0.5) * shape[3 + s->even_terms + k] * power / square;
    *by_x = 2 * slope * x, *by_y = 2 * slope * y;
    return sag;
}

static double biconic_of(const lf_system *s, int64_t n, double x, double y, double *by_x, double *by_y)
{
    const double *shape = s->shapes + n * (3 + s->even_terms + s->odd_terms), *section = s->sections + n * (2 + s->even_terms);
    const double bend = section[0] * x * x + shape[0] * y * y;
    const double end_x = (1 + section[1]) * section[0] * section[0], end_y = (1 + shape[1]) * shape[0] * shape[0];
    const double rest = sqrt(1 - end_x * x * x - end_y * y * y), both = (1 + rest) * (1 + rest);
    double sag = bend / (1 + rest);
    *by_x = 2 * section[0] * x / (1 + rest) + bend / both * end_x * x / rest;
    *by_y = 2 * shape[0] * y / (1 + rest) + bend / both * end_y * y / rest;
    for (int64_t k = 0; k < s->even_terms; k++) {
        const double p = section[2 + k], square = (1 - p) * x * x + (1 + p) * y * y, power = (double)k + 1;
        sag += shape[3 + k] * pow(square, power);
        *by_x += shape[3 + k] * power * pow(square, power - 1) * 2 * (1 - p) * x;
        *by_y += shape[3 + k] * power * pow(square, power - 1) * 2 * (1 + p) * y;
    }
    return sag;
}

/* With an axis at a radius from the vertex: (radius - sag)^2 + across^2 = (radius - profile)^2. */
static double toroid_of(double radius, double profile, double slope, double across, double *by_across, double *by_along)
{
    const double left = copysign(sqrt((radius - profile) * (radius - profile) - across * across), radius);
    *by_across = across / left, *by_along = (radius - profile) * slope / left;
    return radius - left;
}

static double relief(const lf_system *s, int64_t n, double x, double y, double *by_x, double *by_y)
{
    const int64_t kind = s->kinds ? s->kinds[n] : LF_REVOLUTION;
    double slope, none;
    if (kind == LF_REVOLUTION) return sag_of(s, n, x, y, by_x, by_y);
    if (kind == LF_BICONIC) return biconic_of(s, n, x, y, by_x, by_y);
    if (kind == LF_TOROID_Y) {
        const double profile = biconic_of(s, n, 0, y, &none, &slope);
        return toroid_of(1 / s->sections[n * (2 + s->even_terms)], profile, slope, x, by_x, by_y);
    }
    const double profile = biconic_of(s, n, x, 0, &slope, &none);
    return toroid_of(1 / s->shapes[n * (3 + s->even_terms + s->odd_terms)], profile, slope, y, by_y, by_x);
}

/* Into the frame of a surface, side 1, and back, side -1. */
static void change_frame(const lf_system *s, int64_t n, int side, double *at, double *along)
{
    if (!s->poses) return;
    const double *offset = s->poses + 12 * n, *matrix = offset + 3;
    double place[3] = {0}, way[3] = {0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double m = side > 0 ? matrix[3 * j + i] : matrix[3 * i + j];
            place[i] += m * (side > 0 ? at[j] - offset[j] : at[j]), way[i] += m * along[j];
        }
    for (int i = 0; i < 3; i++) at[i] = place[i] + (side > 0 ? 0 : offset[i]), along[i] = way[i];
}

static void bend(const lf_system *s, int64_t n, const double *at, double *along, double ratio)
{
    double by_x, by_y, inwards = 0, square = 0;
    relief(s, n, at[0], at[1], &by_x, &by_y);
    double normal[3] = {-by_x, -by_y, 1};
    const double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + 1), side = along[2] < 0 ? -1 : 1;
    for (int k = 0; k < 3; k++) normal[k] *= side / length, inwards += normal[k] * along[k];
    for (int k = 0; k < 3; k++) along[k] = ratio * (along[k] - inwards * normal[k]), square += along[k] * along[k];
    for (int k = 0; k < 3; k++) along[k] += sqrt(1 - square) * normal[k];
}

/* To a surface and through it; the optical path, and the squares of height, x and y. */
static double passed(const lf_system *s, int64_t n, double *at, double *along, double before, double behind, double *squares)
{
    change_frame(s, n, 1, at, along);
    double way = -at[2] / along[2], by_x, by_y;
    for (int step = 0; step < 60; step++) {
        const double x = at[0] + way * along[0], y = at[1] + way * along[1], sag = relief(s, n, x, y, &by_x, &by_y);
        way -= (at[2] + way * along[2] - sag) / (along[2] - by_x * along[0] - by_y * along[1]);
    }
    for (int k = 0; k < 3; k++) at[k] += way * along[k];
    squares[1] = at[0] * at[0], squares[2] = at[1] * at[1], squares[0] = squares[1] + squares[2];
    bend(s, n, at, along, before / behind);
    change_frame(s, n, -1, at, along);
    return before * way;
}

/* Rows of the output of tracing. */
static void note_squares(const lf_system *s, int64_t n, const double *squares, double *rows)
{
    rows[n] = squares[0];
    for (int k = 0; s->rectangles && s->rectangles[n] && k < 2; k++) rows[s->rectangles[n] + k] = squares[1 + k];
}

static void traced_ray(const lf_system *s, const double *start, double *out)
{
    const int64_t size = 3 + s->even_terms + s->odd_terms;
    double by_x, by_y, at[3] = {start[0], start[1], relief(s, s->stop, start[0], start[1], &by_x, &by_y)};
    const double length = sqrt(1 + start[2] * start[2] + start[3] * start[3]);
    double along[3] = {0}, back[3], from[3], squares[3], path = 0;
    change_frame(s, s->stop, -1, at, along);
    along[0] = start[2] / length, along[1] = start[3] / length, along[2] = 1 / length;
    for (int k = 0; k < 3; k++) from[k] = at[k], back[k] = -along[k];
    for (int64_t n = s->stop - 1; n >= 0; n--) {
        from[2] += s->shapes[n * size + 2];
        path += passed(s, n, from, back, s->indices[n + 1], s->indices[n], squares);
        note_squares(s, n, squares, out + 13);
    }
    squares[1] = start[0] * start[0], squares[2] = start[1] * start[1], squares[0] = squares[1] + squares[2];
    note_squares(s, s->stop, squares, out + 13);
    change_frame(s, s->stop, 1, at, along);
    bend(s, s->stop, at, along, s->indices[s->stop] / s->indices[s->stop + 1]);
    change_frame(s, s->stop, -1, at, along);
    for (int64_t n = s->stop + 1; n < s->surfaces; n++) {
        at[2] -= s->shapes[(n - 1) * size + 2];
        path += passed(s, n, at, along, s->indices[n], s->indices[n + 1], squares);
        note_squares(s, n, squares, out + 13);
    }
    at[2] -= s->shapes[(s->surfaces - 1) * size + 2];
    change_frame(s, s->surfaces, 1, at, along);
    const double way = -at[2] / along[2];
    for (int k = 0; k < 3; k++) {
        out[k] = from[k], out[3 + k] = -back[k], out[6 + k] = at[k] + way * along[k], out[9 + k] = along[k];
    }
    out[12] = path + s->indices[s->surfaces] * way;
}

/* A small displacement: an offset, and the matrix of turns about x and y. Systems differ in the last bits of cosines, so
   angles are given by the tangents of their halves. */
static void displace(double *pose)
{
    const double half_x = 0.05 * (2 * unit() - 1), half_y = 0.05 * (2 * unit() - 1);
    const double cx = (1 - half_x * half_x) / (1 + half_x * half_x), sx = 2 * half_x / (1 + half_x * half_x);
    const double cy = (1 - half_y * half_y) / (1 + half_y * half_y), sy = 2 * half_y / (1 + half_y * half_y);
    const double matrix[9] = {cy, sy * sx, sy * cx, 0, cx, -sx, -sy, cy * sx, cy * cx};
    for (int k = 0; k < 3; k++) pose[k] = 0.2 * (2 * unit() - 1);
    for (int k = 0; k < 9; k++) pose[3 + k] = matrix[k];
}

static void try_tracing(void)
{
    const int64_t surfaces = 1 + below(MOST_SURFACES), even = below(4), odd = below(3), size = 3 + even + odd, count = 1 + below(20);
    int64_t quantities = 13 + surfaces;
    const int tame = below(4) > 0;
    double *shapes = ROOM(double, surfaces * size), *starts = ROOM(double, 4 * count), *truth = ROOM(double, 13 + 3 * surfaces);
    double *sections = ROOM(double, surfaces * (2 + even)), *poses = ROOM(double, 12 * (surfaces + 1));
    int64_t kinds[MOST_SURFACES], rectangles[MOST_SURFACES];
    double indices[MOST_SURFACES + 1], aims[4] = {1, 0.96, 0, 0.28}, guess[2] = {0, 0.2};
    for (int64_t n = 0; n < surfaces; n++) {
        shapes[n * size] = 0.02 * (2 * unit() - 1), shapes[n * size + 1] = 2 * unit() - 1.5, shapes[n * size + 2] = 2 + 3 * unit();
        for (int64_t k = 3; k < size; k++) shapes[n * size + k] = 1e-5 * (2 * unit() - 1) / (double)(1 << 5 * (k < 3 + even ? k - 3 : k - 3 - even));
        if (!tame && !below(3)) shapes[n * size + below(size)] = below(2) ? NAN : 1e300;
        double *section = sections + n * (2 + even);
        kinds[n] = below(LF_TOROID_X + 1), section[0] = 0.02 * (2 * unit() - 1), section[1] = 2 * unit() - 1.5;
        for (int64_t k = 0; k < even; k++) section[2 + k] = kinds[n] == LF_BICONIC ? 2 * unit() - 1 : 0;
        for (int k = 0; kinds[n] && k < 2; k++) { /* radii that the sum of squares resolves */
            double *curvature = k ? section : shapes + n * size;
            *curvature = copysign(0.004 + fabs(*curvature), *curvature);
        }
    }
    for (int64_t n = 0; n <= surfaces; n++) indices[n] = n % 2 ? 1.5 + 0.3 * unit() : 1;
    for (int64_t n = 0; n < 4 * count; n++) starts[n] = (n < 2 * count ? 3 : 0.2) * (2 * unit() - 1) + (n < count ? 4 : 0);
    for (int64_t n = 0; n <= surfaces; n++) displace(poses + 12 * n);
    lf_system s = {shapes, indices, surfaces, below(surfaces), even, odd, 0, 0, 0, 0};
    for (int64_t n = 0; n < surfaces; n++) rectangles[n] = 0;
    if (below(2)) {
        s.rectangles = rectangles;
        for (int64_t n = 0; n < surfaces; n++)
            if (!below(3)) rectangles[n] = quantities - 13, quantities += 2;
    }
    if (below(2)) s.kinds = kinds, s.sections = sections;
    if (below(2)) s.poses = poses;
    lf_system bare = s;
    bare.stop = surfaces;
    const lf_targets t = {aims, guess, starts, starts + count, 2, count, LF_ANGLE, 1, 1e-3};
    for (int v = 0; runs(v); v++) {
        double *out = ROOM(double, quantities * count), *found = ROOM(double, 6 * count);
        expect(lf_trace(v, &bare, starts, count, out) == LF_BAD_SIZE, "tracing took a size that cannot be");
        expect(lf_aim(v, &bare, &t, found) == LF_BAD_SIZE, "aiming took a size that cannot be");
        expect(!lf_trace(v, &s, starts, count, out), "tracing refused its sizes");
        expect(!lf_aim(v, &s, &t, found), "aiming refused its sizes");
        if (tame) take_bits(v, out, quantities * count * 8), take_bits(v, found, 6 * count * 8);
        for (int64_t ray = 0; tame && ray < count; ray++) {
            const double start[4] = {starts[ray], starts[count + ray], starts[2 * count + ray], starts[3 * count + ray]};
            traced_ray(&s, start, truth);
            for (int64_t k = 0; k < quantities; k++) take_deviation(v, 8, fabs(out[k * count + ray] - truth[k]), 1e3 * DOUBLE * 50);
        }
        for (int64_t n = 0; tame && n < 2 * count; n++) {
            const double start[4] = {starts[n % count], starts[count + n % count], found[n], found[2 * count + n]};
            traced_ray(&s, start, truth);
            take_deviation(v, 9, fabs(truth[3]), 3e-12);
            take_deviation(v, 9, fabs(truth[4] * aims[n / count] - truth[5] * aims[2 + n / count]), 3e-12);
        }
        free(out), free(found);
    }
    free(shapes), free(starts), free(truth), free(sections), free(poses);
}

/* Ghosts: rays reflected at two surfaces, one by one; and the light of meshes that nothing blocks, which must be that of
   their triangles. */

typedef struct { double at[3], along[3], light[LF_GHOST_WAVES], limit, stop[2 * LF_CROSSINGS]; int crossings; } ghost_ray;

/* Between values of a table that are `apart` numbers apart. */
static double linear(const double *table, int64_t apart, int64_t steps, double place)
{
    const int64_t step = (int64_t)fmin(fmax(place, 0), (double)steps - 1);
    const double *here = table + step * apart;
    return here[0] + (fmin(fmax(place, 0), (double)steps) - (double)step) * (here[apart] - here[0]);
}

static void ghost_meets(const lf_system *s, const lf_beam *b, int64_t n, int reflecting, double before, double behind, ghost_ray *r)
{
    double by_x, by_y, squares[3], along[3], back[3];
    for (int k = 0; k < 3; k++) along[k] = r->along[k];
    passed(s, n, r->at, r->along, before, behind, squares);
    const double square = squares[0] * b->per_semi_aperture[n] * b->per_semi_aperture[n];
    change_frame(s, n, 1, r->at, along);
    relief(s, n, r->at[0], r->at[1], &by_x, &by_y);
    const double length = sqrt(1 + by_x * by_x + by_y * by_y), normal[3] = {-by_x / length, -by_y / length, 1 / length};
    double cosine = 0;
    for (int k = 0; k < 3; k++) cosine += along[k] * normal[k];
    for (int k = 0; k < 3; k++) back[k] = along[k] - 2 * cosine * normal[k];
    if (n == s->stop) {
        for (int k = 0; k < 2; k++) r->stop[2 * r->crossings + k] = r->at[k] * b->per_semi_aperture[n];
        r->crossings++;
    } else r->limit = fmax(r->limit, square);
    for (int k = 0; k < 2; k++) r->limit = fmax(r->limit, pow(r->at[k] * b->per_half_width[2 * n + k], 2));
    change_frame(s, n, -1, r->at, back);
    for (int64_t w = 0; w < b->waves; w++) {
        const double share = linear(b->reflectances + n * (b->steps + 1) * LF_GHOST_WAVES + w, LF_GHOST_WAVES, b->steps,
                                    before * before * (1 - cosine * cosine) * b->steps_per_unit);
        r->light[w] *= reflecting ? share : 1 - share;
    }
    for (int k = 0; reflecting && k < 3; k++) r->along[k] = back[k];
}

static void plain_ghost(const lf_system *s, const lf_beam *b, int64_t near, int64_t far, double across, double up, double *out)
{
    const int64_t size = 3 + s->even_terms + s->odd_terms;
    ghost_ray r = {{0}, {0}, {0}, 0, {0}, 0};
    for (int64_t w = 0; w < b->waves; w++) r.light[w] = 1;
    for (int k = 0; k < 3; k++) r.at[k] = across * b->across[k] + up * b->up[k], r.along[k] = b->along[k];
    for (int64_t n = 0; n < far; n++) ghost_meets(s, b, n, 0, s->indices[n], s->indices[n + 1], &r), r.at[2] -= s->shapes[n * size + 2];
    ghost_meets(s, b, far, 1, s->indices[far], s->indices[far], &r);
    for (int64_t n = far - 1; n >= near; n--) {
        r.at[2] += s->shapes[n * size + 2];
        ghost_meets(s, b, n, n == near, s->indices[n + 1], s->indices[n == near ? n + 1 : n], &r);
    }
    for (int64_t n = near + 1; n <= s->surfaces; n++) {
        r.at[2] -= s->shapes[(n - 1) * size + 2];
        if (n < s->surfaces) ghost_meets(s, b, n, 0, s->indices[n], s->indices[n + 1], &r);
    }
    change_frame(s, s->surfaces, 1, r.at, r.along);
    for (int k = 0; k < 2; k++) out[k] = r.at[k] - r.at[2] / r.along[2] * r.along[k];
    out[2] = r.limit;
    for (int64_t w = 0; w < b->waves; w++) out[LF_GHOST_QUANTITIES + w] = r.light[w];
    for (int k = 0; k < 2 * LF_CROSSINGS; k++) out[3 + k] = r.stop[k < 2 * r.crossings ? k : k % 2 + 2 * (r.crossings - 1)];
}

static void try_ghost_rays(void)
{
    const int64_t surfaces = 3 + below(4), even = below(3), size = 3 + even, steps = 5, side = 2 + below(5), rays = side * side, waves = 1 + below(LF_GHOST_WAVES);
    const int64_t quantities = LF_GHOST_QUANTITIES + waves, first_light = LF_GHOST_QUANTITIES * rays, pairs = 1 + below(4);
    double *work = ROOM(double, 3 * surfaces * LF_GHOST_ABREAST);
    double *shapes = ROOM(double, surfaces * size), *poses = ROOM(double, 12 * (surfaces + 1)), *tables = ROOM(double, surfaces * (steps + 1) * LF_GHOST_WAVES);
    double indices[16], per_mm[16], per_half_width[32], truth[LF_GHOST_QUANTITIES + LF_GHOST_WAVES], box[16] = {-2 * unit(), 3 * unit() / (double)side, -2 * unit(), 3 * unit() / (double)side};
    for (int64_t k = 4; k < 16; k++) box[k] = box[k - 4]; /* of pairs that share their paths */
    if (below(2)) box[8] -= 0.1;
    for (int64_t n = 0; n < surfaces; n++) {
        shapes[n * size] = 0.02 * (2 * unit() - 1), shapes[n * size + 1] = 2 * unit() - 1.5, shapes[n * size + 2] = 2 + 3 * unit();
        for (int64_t k = 3; k < size; k++) shapes[n * size + k] = 1e-5 * (2 * unit() - 1);
        per_mm[n] = below(3) ? 0.1 + 0.1 * unit() : 0;
        const int64_t rectangular = below(2);
        for (int64_t k = 2 * n; k < 2 * n + 2; k++) per_half_width[k] = rectangular ? 0.1 + 0.1 * unit() : 0;
    }
    for (int64_t n = 0; n < surfaces * (steps + 1) * LF_GHOST_WAVES; n++) tables[n] = unit();
    for (int64_t n = 0; n <= surfaces; n++) indices[n] = n % 2 ? 1.5 + 0.3 * unit() : 1, displace(poses + 12 * n);
    const lf_system s = {shapes, indices, surfaces, below(surfaces), even, 0, 0, 0, below(2) ? poses : 0, 0};
    int64_t pair[8], wrong[8];
    for (int64_t k = 0; k < 8; k += 2) pair[k + 1] = 1 + below(surfaces - 1), pair[k] = below(pair[k + 1]), wrong[k] = wrong[k + 1] = 1;
    const double slope = 0.2 * (2 * unit() - 1), c = sqrt(1 - slope * slope);
    lf_beam b = {tables, per_mm, per_half_width, pair, box, {1, 0, 0}, {0, c, -slope}, {0, slope, c}, {0, 0, 0}, INFINITY, 2, INFINITY, steps, waves, pairs, side, side, 0};
    for (int v = 0; runs(v); v++) {
        double *all = ROOM(double, pairs * quantities * rays);
        b.surfaces = wrong;
        expect(lf_ghost_rays(v, &s, &b, all, work) == LF_BAD_SIZE, "ghosts took surfaces that cannot be");
        b.surfaces = pair;
        expect(!lf_ghost_rays(v, &s, &b, all, work), "ghosts refused their sizes");
        for (int64_t n = 0; n < pairs; n++) {
            const double *out = all + n * quantities * rays, *of = box + 4 * n;
            for (int64_t k = 0; k < quantities * rays; k++)
                if (out[first_light + k % rays] == out[first_light + k % rays]) take_bits(v, out + k, 8); /* of rays that are not lost */
            for (int64_t ray = 0; ray < rays; ray++) {
                plain_ghost(&s, &b, pair[2 * n], pair[2 * n + 1], of[0] + (double)(ray % side) * of[1], of[2] + (double)(ray / side) * of[3], truth);
                for (int64_t k = 0; k < quantities && out[first_light + ray] == out[first_light + ray]; k++)
                    take_deviation(v, 13, fabs(out[k * rays + ray] - truth[k]), 1e4 * DOUBLE * 50);
            }
        }
        free(all);
    }
    free(work);
    free(shapes), free(poses), free(tables);
}

static void try_ghost_light(void)
{
    const int64_t side = 2 + below(6), mesh = side * side, rows = 40 + below(30), columns = 40 + below(30), levels = 1 + below(3);
    const int64_t waves = 1 + below(LF_GHOST_WAVES), quantities = LF_GHOST_QUANTITIES + waves, last = quantities - 1;
    static const float normals[6] = {1, 0, -0.5f, 0.866f, -0.5f, -0.866f};
    const int tame = below(3) > 0;
    double *rays = ROOM(double, quantities * mesh), cell = unit(), pixels = 100 + 4000 * unit(), blur = 0, sum = 0;
    for (int64_t n = 0; n < mesh; n++) {
        rays[n] = 8 * ((double)(n % side) / (double)(side - 1) - 0.5) + (tame ? 0.3 : 9) * (unit() - 0.5);
        rays[mesh + n] = 8 * ((double)(n / side) / (double)(side - 1) - 0.5) + (tame ? 0.3 : 9) * (unit() - 0.5);
        rays[2 * mesh + n] = 0.2;
        for (int64_t w = LF_GHOST_QUANTITIES; w < quantities; w++) rays[w * mesh + n] = unit();
        for (int k = 3; !tame && k < LF_GHOST_QUANTITIES; k++) rays[k * mesh + n] = 3 * (unit() - 0.5);
        if (!tame && !below(9)) rays[below(3) * mesh + n] = below(2) ? NAN : 1e300;
        if (!tame && !below(9)) rays[LF_GHOST_QUANTITIES * mesh + n] = NAN;
    }
    for (int64_t n = 0; n < mesh; n++)
        if (n % side < side - 1 && n / side < side - 1) { /* its two triangles */
            const double *a = rays + last * mesh + n;
            const int left = 2 * (n % side) < side - 1;
            sum += (a[0] + a[1] + a[side] + a[side + 1] + (left ? a[1] + a[side] : a[0] + a[side + 1])) / 6 * cell;
        }
    const int64_t crossings = tame ? 0 : below(LF_CROSSINGS + 1);
    const double irradiance[LF_GHOST_WAVES] = {1, 1, 1, 1, 1, 1, 1, 1};
    lf_meshes m = {rays, &crossings, &cell, &pixels, &blur, irradiance, normals, 1, waves, side, side, 3, !tame && below(2), 0.5f, 0, 1, 1,
                   0.6, 0.8, (double)rows / 2, (double)columns / 2, 3};
    for (int v = 0; runs(v); v++) {
        lf_picture pictures[3];
        double light[LF_GHOST_WAVES], *work = ROOM(double, lf_ghost_work(side, 2 * side));
        for (int64_t k = 0; k < levels; k++) {
            const int64_t high = ((rows - 1) >> k) + 1 + 2 * LF_GHOST_RIM, wide = ((columns - 1) >> k) + 1 + 2 * LF_GHOST_RIM;
            pictures[k] = (lf_picture){ROOM(float, waves * high * (wide + 8)), waves, high, wide, high * (wide + 8), wide + 8};
        }
        expect(lf_ghost_light(v, &m, pictures, 0, light, work) == LF_BAD_SIZE, "ghosts took no pictures");
        expect(!lf_ghost_light(v, &m, pictures, levels, light, work), "ghosts refused their pictures");
        for (int64_t w = 0; w < waves; w++)
            if (light[w] == light[w]) take_bits(v, light + w, 8); /* the signs of NaN differ */
        for (int64_t k = 0; k < levels; k++) {
            const float *values = pictures[k].values;
            for (int64_t n = 0; n < waves * pictures[k].plane_step; n++)
                if (values[n] == values[n]) take_bits(v, values + n, 4);
            free(pictures[k].values);
        }
        if (tame) take_deviation(v, 14, fabs(light[waves - 1] - sum), 0.1 * sum); /* pixels of an uneven light */
        free(work);
    }
    free(rays);
}

/* Fitting, of polynomials, which are to be found again. */

static double chebyshev_of(int64_t n, double x)
{
    double before = x, here = 1;
    for (; n > 0; n--) {
        const double next = 2 * x * here - before;
        before = here, here = next;
    }
    return here;
}

static void try_fitting(void)
{
    const int64_t degree = 1 + below(6), step = 1 + below(2), ups = degree + 1, acrosses = degree / step + 1;
    const int64_t quantities = 1 + below(3), places = 60 + below(60);
    double *x = ROOM(double, 3 * places), *values = ROOM(double, quantities * places), *truth = ROOM(double, quantities * ups * acrosses);
    for (int64_t n = 0; n < 3 * places; n++) x[n] = n < 2 * places ? 2 * unit() - 1 : 0.5 + unit();
    for (int64_t n = 0; n < quantities * ups * acrosses; n++)
        truth[n] = n / acrosses % ups + step * (n % acrosses) <= degree ? 2 * unit() - 1 : 0;
    for (int64_t n = 0; n < quantities * places; n++)
        for (int64_t k = 0; k < ups * acrosses; k++)
            values[n] += truth[n / places * ups * acrosses + k] * chebyshev_of(k / acrosses, x[places + n % places])
                         * chebyshev_of(step * (k % acrosses), x[n % places]);
    const lf_scattered s = {x, x + places, x + 2 * places, values, places, quantities, degree, step};
    lf_scattered bare = s;
    bare.places = 0;
    for (int v = 0; runs(v); v++) {
        double *out = ROOM(double, quantities * ups * acrosses), *residual = ROOM(double, places + 7);
        double *work = ROOM(double, lf_fit_work(places, degree, step));
        expect(lf_fit(v, &bare, out, residual, work) == LF_BAD_SIZE, "fitting took a size that cannot be");
        expect(!lf_fit(v, &s, out, residual, work), "fitting refused its sizes");
        take_bits(v, out, quantities * ups * acrosses * 8), take_bits(v, residual, places * 8);
        for (int64_t n = 0; n < quantities * ups * acrosses; n++) take_deviation(v, 10, fabs(out[n] - truth[n]), 1e7 * DOUBLE);
        free(out), free(residual), free(work);
    }
    free(x), free(values), free(truth);
}

/* Casting, of layers that are even in depth and let half of the light by, through rays that all pass, as its definition
   has it; of layers of any depth, irises and vignetting, for the bits; of numbers of any kind, for the sanitizers. */

/* The part of a cell that is in a pixel, at a distance of less than a pixel between their middles. */
static double part_in(double distance, double cells) { return fmin(fmax((0.5 - fabs(distance)) * cells + 0.5, 0), 1); }

/* The mean of a plane's pixels over a cell. */
static double pixel_of(const lf_level *l, const float *plane, double row, double column, double cells)
{
    const double y = fmin(fmax(row, 0), (double)l->light.rows - 1), x = fmin(fmax(column, 0), (double)l->light.columns - 1);
    double sum = 0;
    for (int64_t j = (int64_t)y; j <= (int64_t)y + 1 && j < l->light.rows; j++)
        for (int64_t i = (int64_t)x; i <= (int64_t)x + 1 && i < l->light.columns; i++)
            sum += part_in(y - (double)j, cells) * part_in(x - (double)i, cells) * plane[j * l->light.row_step + i];
    return sum;
}

/* Radius in a panoramic capture over that on a plane. */
static double shrunk(const lf_cast_of *c, double tangent)
{
    const double step = tangent / (1 + tangent) * (double)c->shrinkage_steps;
    const int64_t before = step < (double)c->shrinkage_steps - 1 ? (int64_t)step : c->shrinkage_steps - 1;
    return c->shrinkage[before] + (step - (double)before) * (c->shrinkage[before + 1] - c->shrinkage[before]);
}

/* The node before a place among `count` nodes, and the place's distance from it. */
static int64_t node_before(double place, int64_t count, double *weight)
{
    const int64_t before = (int64_t)fmin(fmax(place, 0), (double)(count - 2));
    *weight = place - (double)before;
    return before;
}

typedef struct { /* a pixel's place among the nodes, and the axes of its rays' positions */
    int64_t node;
    double weight, up_weight, right[2], up[2], chief[2];
} place;

static place place_of(const lf_cast_of *c, double x, double y, int64_t w)
{
    const double height = hypot(x, y);
    if (!c->mesh_rows) {
        place p = {.right = {height > 0 ? x / height : 0, height > 0 ? y / height : 1}};
        p.node = node_before(height * c->nodes_per_px, c->nodes, &p.weight);
        p.up[0] = p.right[1], p.up[1] = -p.right[0];
        return p;
    }
    place p = {.right = {c->mirrored_right && x < 0 ? -1 : 1, 0}, .up = {0, c->mirrored_up && y < 0 ? -1 : 1}};
    const double across = p.right[0] * x * c->nodes_per_px - c->first_right, upwards = p.up[1] * y * c->rows_per_px - c->first_up;
    p.node = node_before(across, c->nodes, &p.weight) + c->nodes * node_before(upwards, c->mesh_rows, &p.up_weight);
    double on, higher;
    const int64_t columns = (c->nodes - 1) * c->finer + 1;
    const int64_t column = node_before(across * (double)c->finer, columns, &on);
    const int64_t row = node_before(upwards * (double)c->finer, (c->mesh_rows - 1) * c->finer + 1, &higher);
    for (int k = 0; k < 4; k++)
        for (int axis = 0; axis < 2; axis++)
            p.chief[axis] += (k % 2 ? on : 1 - on) * (k / 2 ? higher : 1 - higher)
                             * c->chief[(((row + k / 2) * columns + column + k % 2) * c->wavelengths + w) * 2 + axis];
    return p;
}

/* A quantity of a ray at a pixel; `held` between the nodes. */
static double at_place(const lf_cast_of *c, const place *p, int64_t where, int held)
{
    const int64_t size = c->eights * (16 + 48 * c->wavelengths);
    double weight = held ? fmin(p->weight, 1) : p->weight, up_weight = p->up_weight;
    if (c->mesh_rows && held) weight = fmax(weight, 0), up_weight = fmin(fmax(up_weight, 0), 1);
    double sum = 0;
    for (int k = 0; k < (c->mesh_rows ? 4 : 2); k++)
        sum += (k % 2 ? weight : 1 - weight) * (k / 2 ? up_weight : 1 - up_weight)
               * c->rays[(p->node + k % 2 + k / 2 * c->nodes) * size + where];
    return sum;
}

/* What a pixel's rays add up to: light, blurred, through and all. */
static void rays_of(const lf_cast_of *c, const lf_meeting *meetings, int64_t first, int64_t eights, int64_t row, int64_t column, int64_t w,
                    double sums[4])
{
    const place p = place_of(c, (double)column - c->centre_column, c->centre_row - (double)row, w);
    for (int64_t ray = 8 * first; ray < 8 * (first + eights); ray++) {
        double got[6], free = 1, in_focus = 1;
        for (int k = 0; k < 6; k++)
            got[k] = at_place(c, &p, ray / 8 * (16 + 48 * c->wavelengths) + 16 + 48 * w + 8 * k + ray % 8, k >= 4);
        got[0] += p.chief[0], got[1] += p.chief[1];
        got[5] *= fmin(fmax(got[4] + 0.5, 0), 1);
        sums[0] += got[5];
        for (int64_t n = 0; n < c->layers; n++) {
            const lf_level *l = c->layer[n].level + meetings[n].level;
            if (meetings[n].steps < 0) continue;
            const double q = meetings[n].inverse_depth, s = meetings[n].share, one = got[0] + q * got[2], two = got[1] + q * got[3];
            const double x = one * p.right[0] + two * p.right[1], y = one * p.up[0] + two * p.up[1];
            const double part = c->per_focal_up > 0 ? shrunk(c, hypot(x * c->per_focal_right, y * c->per_focal_up)) : 1;
            const double at_row = l->axis_row - l->per_px * part * y, at_column = l->axis_column + l->per_px * part * x;
            const double light = pixel_of(l, l->light.values + w * l->light.plane_step, at_row, at_column, meetings[n].cells);
            const double alpha = meetings[n].opaque ? 1 : pixel_of(l, l->alpha, at_row, at_column, meetings[n].cells);
            sums[1] += got[5] * free * (1 - s) * light;
            sums[2] += got[5] * free * s * (light + c->faint[w] * alpha);
            sums[3] += got[5] * in_focus * s * (light + c->faint[w] * alpha);
            free *= 1 - alpha;
            in_focus *= 1 - s * alpha;
        }
    }
}

static void try_casting(void)
{
    static const float wild[] = {NAN, INFINITY, -INFINITY, -1e30f, 1e30f, 1e-40f};
    const int kind = (int)below(3); /* tame, lively, wild */
    const int64_t rows = 1 + below(20), columns = 1 + below(20), tile = 1 + below(9), layers = 1 + below(3);
    const int64_t wavelengths = 1 + below(LF_TOGETHER), nodes = 2 + below(4), eights = 1 + below(3), size = 16 + 48 * wavelengths;
    const int64_t mesh_rows = below(2) ? 2 + below(3) : 0, finer = 1 + below(4);
    const int64_t chiefs = mesh_rows ? ((mesh_rows - 1) * finer + 1) * ((nodes - 1) * finer + 1) * 2 * wavelengths : 0;
    const int64_t down = (rows + tile - 1) / tile, across = (columns + tile - 1) / tile, blades = kind ? below(7) : 0;
    const int64_t count = nodes * (mesh_rows ? mesh_rows : 1) * eights * size;
    float *chief = ROOM(float, chiefs);
    for (int64_t i = 0; i < chiefs; i++) chief[i] = (float)(10 * (unit() - 0.5));
    float *rays = ROOM(float, count), *normals = ROOM(float, 2 * blades), *work = ROOM(float, 32 * tile * tile * wavelengths);
    for (int64_t i = 0; i < count; i++) {
        const int64_t at = i % size, quantity = at < 16 ? -1 : (at - 16) / 8 % 6;
        rays[i] = (float)(quantity == 5 ? 0.1 + unit() : quantity == 4 ? (kind ? 2 * unit() - 1 : unit() - 0.4) :
                          quantity < 0 ? 2 * unit() - 1 : 30 * (unit() - 0.5));
        if (kind == 2 && !below(20)) rays[i] = wild[below(6)];
    }
    for (int64_t i = 0; i < 2 * blades; i++) normals[i] = (float)(2 * unit() - 1);
    lf_layer *layer = ROOM(lf_layer, layers);
    for (int64_t n = 0; n < layers; n++) {
        layer[n].levels = 1 + below(3);
        for (int64_t k = 0; k < layer[n].levels; k++) {
            const int64_t tall = 2 + below(20), wide = 2 + below(20), step = wide + below(4);
            float *light = ROOM(float, wavelengths * tall * step), *alpha = ROOM(float, tall * step);
            for (int64_t i = 0; i < wavelengths * tall * step; i++)
                light[i] = kind == 2 && !below(9) ? wild[below(6)] : (float)unit();
            for (int64_t i = 0; i < tall * step; i++) alpha[i] = (float)(kind && below(2) ? below(2) : 0.5 * unit());
            const float edge = kind && below(2) ? -0.5f : -INFINITY;
            layer[n].level[k] = (lf_level){{light, wavelengths, tall, wide, tall * step, step}, alpha,
                                           (float)(unit() * (double)tall), (float)(unit() * (double)wide), 1 / (float)(1 << k),
                                           edge, -edge + (float)(tall - 1), edge, -edge + (float)(wide - 1)};
        }
        const int64_t pixels = layer[n].level->light.rows * layer[n].level->light.columns;
        float *depth = ROOM(float, 2 * pixels);
        for (int64_t i = 0; i < 2 * pixels; i++)
            depth[i] = kind == 2 && !below(9) ? wild[below(6)] : (float)(i % 2 && !below(4) ? -1 : unit());
        layer[n].depth = depth;
    }
    lf_meeting *meetings = ROOM(lf_meeting, down * across * layers);
    int64_t *tile_eights = ROOM(int64_t, down * across), *first_eights = ROOM(int64_t, down * across);
    int64_t *tile_step = ROOM(int64_t, down * across);
    for (int64_t i = 0; i < down * across * layers; i++)
        meetings[i] = (lf_meeting){(float)unit(), 0, kind ? (int32_t)below(5) - 1 : (int32_t)below(2) - 1, 0,
                                   i % layers == layers - 1 && below(2), (int32_t)below(layer[i % layers].levels), 1 + (float)(below(2) * unit())};
    for (int64_t i = 0; i < down * across; i++) {
        tile_eights[i] = below(eights + 1);
        tile_step[i] = 1 + below(2) * below(tile);
        first_eights[i] = below(eights - tile_eights[i] + 1);
        for (int64_t n = 0; n < layers && i % 2; n++)
            meetings[i * layers + n].focused = 1, meetings[i * layers + n].share = (float)unit();
    }
    const int64_t steps = 1 + below(9);
    float *shrinkage = ROOM(float, steps + 1);
    for (int64_t i = 0; i <= steps; i++) shrinkage[i] = (float)(1 - 0.7 * (double)i / (double)steps + 0.2 * unit());
    const float per_focal = below(2) ? 0 : (float)(0.2 * unit());
    lf_cast_of c = {.rays = rays, .nodes = nodes, .eights = eights, .wavelengths = wavelengths, .mesh_rows = mesh_rows,
                    .centre_row = 30 * (unit() - 0.2), .centre_column = 30 * (unit() - 0.2), .nodes_per_px = unit(),
                    .chief = chiefs ? chief : 0, .finer = finer, .per_focal_right = (mesh_rows ? 1.5f : 1) * per_focal,
                    .per_focal_up = per_focal, .shrinkage = shrinkage, .shrinkage_steps = steps,
                    .normals = normals, .blades = blades, .blade_margin = 0.8f,
                    .blade_bend = 0.2f, .blade_slope = 0.7f, .cell_of_eight = 0.6f, .layer = layer, .layers = layers,
                    .meetings = meetings, .first_eights = first_eights, .tile_eights = tile_eights, .tile_step = tile_step, .tile_rows = down, .tile_columns = across, .tile_px = tile};
    if (mesh_rows) { /* few pixels are far beyond its ends, where places are rounded more */
        c.nodes_per_px *= (double)nodes / 30, c.rows_per_px = (double)mesh_rows / 30 * unit();
        c.mirrored_right = (int32_t)below(2), c.mirrored_up = (int32_t)below(2);
        c.first_right = c.mirrored_right ? 0 : -unit() * (double)(nodes - 1);
        c.first_up = c.mirrored_up ? 0 : -unit() * (double)(mesh_rows - 1);
    }
    for (int w = 0; w < LF_TOGETHER; w++) c.faint[w] = (float)(0.1 * unit());
    const int64_t plane = rows * columns;
    lf_cast_of odd = c;
    odd.tile_px = 0;
    for (int v = 0; runs(v); v++) {
        float *result = ROOM(float, 2 * wavelengths * plane);
        const lf_picture blurred = {result, wavelengths, rows, columns, plane, columns};
        const lf_picture clear = {result + wavelengths * plane, wavelengths, rows, columns, plane, columns};
        expect(lf_cast(v, &c, 0, down * across + 1, &blurred, &clear, work) == LF_BAD_SIZE
               && lf_cast(v, &odd, 0, 1, &blurred, &clear, work) == LF_BAD_SIZE, "casting took a size that cannot be");
        expect(!lf_cast(v, &c, 0, down * across, &blurred, &clear, work), "casting refused its sizes");
        if (kind < 2) take_bits(v, result, 2 * wavelengths * plane * 4);
        /* Places of up to 100 pixels and more are rounded some ten times; a pixel more or less changes values by up to 1. */
        const double bound = 1e3 * SINGLE * (double)layers;
        for (int64_t i = 0; kind == 0 && i < wavelengths * plane; i++) {
            const int64_t row = i % plane / columns, column = i % columns, of = row / tile * across + column / tile;
            if (!tile_eights[of]) continue;
            const int64_t step = tile_step[of], above = row % tile / step * step, before = column % tile / step * step;
            const double down_part = (double)(row % tile - above) / (double)step, right_part = (double)(column % tile - before) / (double)step;
            double truth[2] = {0}, least = INFINITY;
            for (int64_t n = 0; n < 4; n++) {
                const double part = (n / 2 ? down_part : 1 - down_part) * (n % 2 ? right_part : 1 - right_part);
                double sums[4] = {0};
                if (part == 0) continue;
                rays_of(&c, meetings + of * layers, first_eights[of], tile_eights[of], row / tile * tile + above + n / 2 * step,
                        column / tile * tile + before + n % 2 * step, i / plane, sums);
                truth[0] += part * sums[1] / sums[0], truth[1] += part * (sums[3] > 0 ? sums[2] / sums[3] : 1);
                least = fmin(least, sums[3] / sums[0]);
            }
            take_deviation(v, 4, fabs(result[i] - truth[0]), bound);
            take_deviation(v, 4, fabs(result[wavelengths * plane + i] - truth[1]), bound / fmax(least, bound));
        }
        free(result);
    }
    for (int64_t n = 0; n < layers; n++) {
        for (int64_t k = 0; k < layer[n].levels; k++) free(layer[n].level[k].light.values), free((void *)layer[n].level[k].alpha);
        free((void *)layer[n].depth);
    }
    void *all[] = {chief, rays, normals, work, layer, meetings, first_eights, tile_eights, tile_step, shrinkage};
    for (size_t n = 0; n < sizeof all / sizeof *all; n++) free(all[n]);
}

/* Collecting and reading, pixel by pixel; of numbers of any kind, for the sanitizers. */

static void try_collecting(void)
{
    const int64_t planes = 1 + below(13), rows = 1 + below(9), columns = 1 + below(150), step = columns + below(5);
    const int64_t down = 1 + below(5), across = 1 + below(70);
    float *values = ROOM(float, planes * rows * step), *weights = ROOM(float, down * planes * across);
    for (int64_t i = 0; i < planes * rows * step; i++) values[i] = (float)unit();
    for (int64_t i = 0; i < down * planes * across; i++) weights[i] = (float)unit();
    const lf_picture light = {values, planes, rows, columns, rows * step, step};
    const lf_filters f = {weights, down, across};
    lf_filters bare = f;
    bare.columns = 0;
    for (int v = 0; runs(v); v++) {
        float *result = ROOM(float, rows * columns);
        const lf_picture out = {result, 1, rows, columns, rows * columns, columns};
        expect(lf_collect(v, &light, &bare, 0, rows, &out) == LF_BAD_SIZE
               && lf_collect(v, &light, &f, 0, rows + 1, &out) == LF_BAD_SIZE, "collecting took a size that cannot be");
        expect(!lf_collect(v, &light, &f, 0, rows, &out), "collecting refused its sizes");
        take_bits(v, result, rows * columns * 4);
        for (int64_t i = 0; i < rows * columns; i++) {
            const int64_t y = i / columns, x = i % columns;
            double sum = 0;
            for (int64_t q = 0; q < planes; q++)
                sum += (double)values[(q * rows + y) * step + x] * weights[(y % down * planes + q) * across + x % across];
            take_deviation(v, 11, fabs(result[i] - sum), SINGLE * (double)(planes + 2) * sum);
        }
        free(result);
    }
    free(values), free(weights);
}

/* Random words, from the definition of Threefry2x32-20. */
static void threefry(int64_t key, uint32_t first, uint32_t second, uint32_t out[2])
{
    static const int turns[] = {13, 15, 26, 6, 17, 29, 16, 24};
    uint32_t keys[3] = {(uint32_t)key, (uint32_t)((uint64_t)key >> 32), 0x1BD11BDA};
    keys[2] ^= keys[0] ^ keys[1];
    first += keys[0], second += keys[1];
    for (uint32_t round = 1; round <= 20; round++) {
        const int turn = turns[(round - 1) % 8];
        first += second;
        second = (second << turn | second >> (32 - turn)) ^ first;
        if (round % 4 == 0) first += keys[round / 4 % 3], second += keys[(round / 4 + 1) % 3] + round / 4;
    }
    out[0] = first, out[1] = second;
}

/* Two normal numbers of a pixel. */
static void two_normals(int64_t key, uint32_t place, uint32_t of, double out[2])
{
    uint32_t w[2];
    threefry(key, place, of, w);
    const float share = (float)(int32_t)(w[0] >> 1) * 0x1p-31f + 0x1p-32f; /* rounded: a logarithm near 0 depends on it */
    const double radius = sqrt(-2 * log(share)), angle = 2 * 3.141592653589793 * (int32_t)w[1] * 0x1p-32;
    out[0] = radius * cos(angle), out[1] = -radius * sin(angle);
}

/* A pixel's digital number before it is rounded, and by how much rounding may change it. */
static double number_of(const lf_pixels *p, double light_e, uint32_t place, uint32_t plane, double *off)
{
    double differences[2] = {0}, noise[2] = {0}, counted, at;
    if (p->noisy) two_normals(p->pixel_key, place, 4 * plane, differences), two_normals(p->noise_key, place, 4 * plane + 1, noise);
    const double mean_e = fmax(light_e * fmax(1 + p->prnu * differences[0], 0) + p->dark_e, 0), z = noise[0];
    double off_e = mean_e * 32 * SINGLE;
    if (!p->noisy) counted = mean_e;
    else if (mean_e < 32) {
        uint32_t w[2], n = 0;
        threefry(p->noise_key, place, 4 * plane + 2, w);
        double term = exp(-mean_e), sum = term;
        const double share = (w[0] + 0.5) * 0x1p-32;
        for (; share > sum && n < 200; sum += term) term *= mean_e / ++n;
        counted = n;
        off_e = fabs(share - sum) < 1e-5 || fabs(share - sum + term) < 1e-5; /* the mean is rounded */
    } else {
        at = mean_e + sqrt(mean_e) * z + (z * z + 2) / 6 - (z * z * z + 2 * z) / (72 * sqrt(mean_e));
        counted = floor(at);
        off_e = fabs(at - rint(at)) < off_e + 1e-4 * sqrt(mean_e); /* an electron more or less */
    }
    if (p->noisy && fabs(mean_e - 32) < 1e-3) off_e = 100; /* the other way of counting */
    const double full_e = fmin(counted, p->full_e), dn = (full_e + p->dsnu_e * differences[1] + p->noise_e * noise[1]) * p->gain_dn_per_e;
    *off = 0.5 + p->gain_dn_per_e * (off_e + 2e-5 * (p->dsnu_e + p->noise_e)) + 8 * SINGLE * (fabs(dn) + p->black_dn);
    return fmin(fmax(dn + p->black_dn, 0), p->white_dn);
}

static void try_reading(void)
{
    static const float wild[] = {NAN, INFINITY, -INFINITY, -1e30f, 1e30f, 1e-40f}, levels[] = {1, 40, 300, 1e4f};
    const int64_t planes = 1 + below(3), rows = 1 + below(5), columns = 1 + below(60), step = columns + below(5);
    const int tame = below(4) > 0;
    float *values = ROOM(float, planes * rows * step);
    const float level = levels[below(4)];
    for (int64_t i = 0; i < planes * rows * step; i++)
        values[i] = !tame && !below(9) ? wild[below(6)] : (float)(unit() * level);
    const lf_picture light = {values, planes, rows, columns, rows * step, step};
    const int64_t keys[2] = {(int64_t)(random_bits() * 0x9E3779B97F4A7C15u), (int64_t)(random_bits() * 0x9E3779B97F4A7C15u)};
    const lf_pixels p = {keys[0], keys[1], below(60000), below(60000), (float)(0.05 * unit()), (float)(3 * unit()),
                         (float)unit(), (float)(10 + 9000 * unit()), (float)(5 * unit()), (float)(0.05 + 4 * unit()),
                         (float)below(100), (float)((1 << (8 + below(9))) - 1), below(4) > 0};
    lf_pixels odd = p;
    odd.column = LF_MOST_SENSOR;
    for (int v = 0; runs(v); v++) {
        uint16_t *result = ROOM(uint16_t, planes * rows * columns);
        expect(lf_read(v, &odd, &light, 0, rows, result) == LF_BAD_SIZE && lf_read(v, &p, &light, 0, rows + 1, result) == LF_BAD_SIZE,
               "reading took a size that cannot be");
        expect(!lf_read(v, &p, &light, 0, rows, result), "reading refused its sizes");
        take_bits(v, result, planes * rows * columns * 2); /* of any numbers: not-a-number counts as 0 */
        for (int64_t i = 0; tame && i < planes * rows * columns; i++) {
            const int64_t q = i / (rows * columns), y = i / columns % rows, x = i % columns;
            double off;
            const double dn = number_of(&p, values[(q * rows + y) * step + x], (uint32_t)((p.row + y) << 16 | (p.column + x)),
                                        (uint32_t)q, &off);
            take_deviation(v, 12, fabs(result[i] - dn), off);
        }
        free(result);
    }
    free(values);
}

/* Controls, by sums over the window of each pixel; light that is not finite counts as none in them. */

static double scaled_mean(const float *one, const float *other, const float *scale, int64_t at, int64_t pixel)
{
    const double value = ((double)one[at] + other[at]) / 2 * scale[pixel];
    return isfinite(value) ? value : 0;
}

static void gains_at(const lf_controlled *c, int64_t y, int64_t x, double gains[3][3])
{
    const int half = LF_WINDOW_PX / 2;
    double rows[3][6] = {{0}}; /* the normal equations, and their right sides */
    for (int64_t v = y - half; v <= y + half; v++)
        for (int64_t u = x - half; u <= x + half; u++) {
            if (v < 0 || v >= c->rows || u < 0 || u >= c->columns || (v == y && u == x)) continue;
            double light[6];
            for (int k = 0; k < 3; k++) {
                const int64_t pixel = v * c->columns + u, at = k * c->rows * c->columns + pixel;
                light[k] = scaled_mean(c->control_one, c->control_other, c->scale, at, pixel);
                light[3 + k] = scaled_mean(c->one, c->other, c->scale, at, pixel);
            }
            for (int i = 0; i < 3; i++)
                for (int k = 0; k < 6; k++) rows[i][k] += light[i] * light[k] / (LF_WINDOW_PX * LF_WINDOW_PX);
        }
    const double ridge = c->ridge * (rows[0][0] + rows[1][1] + rows[2][2]) / 3 + c->least_ridge;
    for (int i = 0; i < 3; i++) rows[i][i] += ridge, rows[i][3 + i] += ridge * c->ratios[i];
    for (int i = 0; i < 3; i++) {
        for (int k = 5; k >= i; k--) rows[i][k] /= rows[i][i];
        for (int j = 0; j < 3; j++)
            for (int k = 5; k >= i && j != i; k--) rows[j][k] -= rows[j][i] * rows[i][k];
    }
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) gains[i][k] = rows[i][3 + k];
}

static void try_control(void)
{
    const int64_t rows = 1 + below(20), columns = 1 + below(40), plane = rows * columns, count = 3 * plane;
    float *values = ROOM(float, 5 * count), *scale = ROOM(float, plane), *weights = ROOM(float, plane);
    for (int64_t i = 0; i < 5 * count; i++) values[i] = below(9) ? (float)(0.1 + unit()) : 0;
    for (int64_t i = 0; i < plane; i++) scale[i] = (float)(0.2 + unit()), weights[i] = (float)unit();
    if (!below(4)) scale[below(plane)] = INFINITY;
    const lf_controlled c = {values, values + count, values + 2 * count, values + 3 * count, values + 4 * count, scale,
                             below(2) ? weights : 0, (float)unit(), {0.5f, 1, 2}, 1e-3, 1e-4, rows, columns};
    lf_controlled bare = c;
    bare.columns = 0;
    expect(lf_control_work(0) == 0, "a control without columns has room");
    for (int v = 0; runs(v); v++) {
        float *light = ROOM(float, count), *noise = ROOM(float, count);
        double *work = ROOM(double, lf_control_work(columns));
        expect(lf_control(v, &bare, 0, rows, light, noise, work) == LF_BAD_SIZE
               && lf_control(v, &c, 0, rows + 1, light, noise, work) == LF_BAD_SIZE, "a control took a size that cannot be");
        expect(!lf_control(v, &c, 0, 1, light, noise, work) && !lf_control(v, &c, 1, rows, light, noise, work),
               "a control refused its sizes");
        take_bits(v, light, count * 4), take_bits(v, noise, count * 4);
        for (int64_t pixel = 0; pixel < plane; pixel++) {
            double gains[3][3];
            gains_at(&c, pixel / columns, pixel % columns, gains);
            for (int k = 0; k < 3; k++) {
                const int64_t at = k * plane + pixel;
                double sum = (c.one[at] + (double)c.other[at]) / 2, between = (double)c.one[at] - c.other[at], size = fabs(sum) + 1;
                for (int i = 0; i < 3; i++) {
                    const int64_t of = i * plane + pixel;
                    const double mean = ((double)c.control_one[of] + c.control_other[of]) / 2;
                    sum += gains[i][k] * (c.weights ? c.weights[pixel] : c.weight) * (c.control_rest[of] - mean);
                    between -= gains[i][k] * ((double)c.control_one[of] - c.control_other[of]);
                    size += fabs(gains[i][k]);
                }
                take_deviation(v, 15, fmax(fabs(light[at] - sum), fabs(noise[at] - between)), 4 * SINGLE * size);
            }
        }
        free(light), free(noise), free(work);
    }
    free(values), free(scale), free(weights);
}

int main(int argc, char **argv)
{
    const int rounds = argc > 1 ? atoi(argv[1]) : 100;
    state = argc > 2 ? strtoull(argv[2], 0, 10) : 0;
    expect(lf_abi() == LF_ABI, "the library is of another ABI");
    expect(lf_spread_work(-1, 1) == 0 && lf_spread_work(1, (int64_t)1 << 60) == 0, "sizes that cannot be have room");
    for (int i = 0; i < rounds; i++) try_spreading(), try_footprints(), try_sections(), try_turning(), try_waves(), try_casting(), try_spots(), try_tracing(), try_ghost_rays(), try_ghost_light(), try_fitting(),
                                     try_collecting(), try_reading(), try_control();
    int off = 0;
    for (int v = 0; runs(v); v++) {
        printf("%-7s off by", lf_variant(v));
        for (int loop = 0; loop < LOOPS; loop++) {
            printf(" %.2f", worst[v][loop]);
            off |= !(worst[v][loop] <= 1);
        }
        printf(" of rounding  bits %016llx\n", (unsigned long long)hash[v]);
        off |= hash[v] != hash[0];
    }
    return off;
}
