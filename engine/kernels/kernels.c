/* The variants, and those that this machine can run; and calls of the loops after checks of their sizes. */
#include "kernels.h"

/* Compilers copy large structures by this function, which is not linked. The barriers keep them from replacing the loops
   by a call of it. */
void *memcpy(void *to, const void *from, __SIZE_TYPE__ bytes)
{
    typedef uint64_t __attribute__((may_alias, aligned(1))) word;
    __SIZE_TYPE__ done = 0;
    for (; done + sizeof(word) <= bytes; done += sizeof(word)) {
        *(word *)((char *)to + done) = *(const word *)((const char *)from + done);
        __asm__ volatile("" ::: "memory");
    }
    for (; done < bytes; done++) {
        ((char *)to)[done] = ((const char *)from)[done];
        __asm__ volatile("" ::: "memory");
    }
    return to;
}

typedef struct {
    const char *name;
    lf_spread_loop *spread;
    lf_extremes_loop *extremes;
    lf_excess_loop *excess;
    lf_footprints_loop *footprints;
    lf_turn_loop *turn;
    lf_waves_loop *waves;
    lf_trace_loop *trace;
    lf_aim_loop *aim;
    lf_ghost_rays_loop *ghost_rays;
    lf_ghost_light_loop *ghost_light;
    lf_fit_loop *fit;
    lf_spots_loop *spots;
    lf_cast_loop *cast;
    lf_collect_loop *collect;
    lf_read_loop *read;
    lf_control_loop *control;
} variant;

#define DECLARED(v) \
    lf_spread_loop lf_spread_##v; \
    lf_extremes_loop lf_extremes_##v; \
    lf_excess_loop lf_excess_##v; \
    lf_footprints_loop lf_footprints_##v; \
    lf_turn_loop lf_turn_##v; \
    lf_waves_loop lf_waves_##v; \
    lf_trace_loop lf_trace_##v; \
    lf_aim_loop lf_aim_##v; \
    lf_ghost_rays_loop lf_ghost_rays_##v; \
    lf_ghost_light_loop lf_ghost_light_##v; \
    lf_fit_loop lf_fit_##v; \
    lf_spots_loop lf_spots_##v; \
    lf_cast_loop lf_cast_##v; \
    lf_collect_loop lf_collect_##v; \
    lf_read_loop lf_read_##v; \
    lf_control_loop lf_control_##v;
#define LISTED(v) \
    {#v, lf_spread_##v, lf_extremes_##v, lf_excess_##v, lf_footprints_##v, lf_turn_##v, lf_waves_##v, lf_trace_##v, \
     lf_aim_##v, lf_ghost_rays_##v, lf_ghost_light_##v, lf_fit_##v, lf_spots_##v, lf_cast_##v, lf_collect_##v, \
     lf_read_##v, lf_control_##v}

#if defined(__x86_64__)
DECLARED(base) DECLARED(avx2) DECLARED(avx512)
static const variant variants[] = {LISTED(base), LISTED(avx2), LISTED(avx512)};
#else
DECLARED(neon)
static const variant variants[] = {LISTED(neon)};
#endif
#define VARIANTS ((int)(sizeof variants / sizeof *variants))

static int within(int64_t n, int64_t low, int64_t high) { return n >= low && n <= high; }

int lf_abi(void) { return LF_ABI; }
const char *lf_sources(void) { return LF_SOURCES; }
const char *lf_variant(int n) { return within(n, 0, VARIANTS - 1) ? variants[n].name : 0; }

#if defined(__x86_64__)
typedef struct { unsigned a, b, c, d; } registers;

/* The instruction itself, because a compiler's built-in test requires its run-time library. */
static registers cpuid(unsigned leaf)
{
    registers r;
    __asm__ volatile("cpuid" : "=a"(r.a), "=b"(r.b), "=c"(r.c), "=d"(r.d) : "a"(leaf), "c"(0));
    return r;
}

#define BIT(n) (1u << (n))
static int has(unsigned value, unsigned bits) { return (value & bits) == bits; }

int lf_runs_here(int n)
{
    if (n == 0) return 1;
    if (!within(n, 1, VARIANTS - 1) || cpuid(0).a < 7) return 0;
    if (!has(cpuid(1).c, BIT(27) | BIT(28))) return 0; /* OSXSAVE, AVX */
    unsigned saved, high; /* the registers that the system saves for each thread: it may be older than the processor */
    __asm__ volatile("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
    const unsigned features = cpuid(7).b;
    if (n == 1) return has(saved, 0x06) && has(features, BIT(5));           /* AVX2 */
    return has(saved, 0xe6) && has(features, BIT(5) | BIT(16) | BIT(17) | BIT(31)); /* AVX-512 F, DQ, VL */
}
#else
int lf_runs_here(int n) { return n == 0; } /* every 64-bit ARM has NEON */
#endif

#define MOST ((int64_t)1 << 40) /* elements: far more than in practice, while sums and bytes of them fit in an int64 */
#define MOST_PX ((int64_t)1 << 24)

/* Whether a picture's sizes are valid and its rows and planes do not overlap. */
static int fits(const lf_picture *p)
{
    return within(p->planes, 1, MOST_PX) && within(p->rows, 0, MOST_PX) && within(p->columns, 1, MOST_PX)
           && (p->rows <= 1 || within(p->row_step, p->columns, MOST_PX * 2))
           && (p->rows == 0 || p->planes == 1 || within(p->plane_step, p->columns + (p->rows - 1) * p->row_step, MOST));
}

static int has_rows(const lf_picture *p, int64_t first_row, int64_t end_row)
{
    return within(first_row, 0, end_row) && end_row <= p->rows;
}

/* Whether all accesses of the loop to a table, and its writes, are within bounds. */
static int table_fits(const lf_table *t, int64_t azimuths)
{
    if (!within(t->size, 0, MOST) || !within(t->side, 1, 1 << 16)) return 0;
    for (int64_t b = 0; b < t->intervals; b++) {
        int64_t length = 0, piece = t->first_piece[b];
        if (!within(piece, 0, t->pieces)) return 0;
        for (int64_t eights = 1; eights <= LF_LONGEST; eights++) {
            const int64_t count = t->counts[b * (LF_LONGEST + 1) + eights], taps = eights * 8;
            if (!within(count, 0, t->pieces - piece)) return 0;
            for (int64_t end = piece + count; piece < end; piece++) /* its last taps extend beyond the square */
                if (!within(t->row[piece], 0, t->side - 1) || !within(t->column[piece], 0, t->side + 10 - taps)) return 0;
            length += count * taps;
        }
        if (length != t->length[b] || !within(t->begin[b], LF_SLACK, t->size - LF_SLACK - 2 * azimuths * length)) return 0;
    }
    return 1;
}

/* Whether all look-ups of positions in a table are within bounds. */
static int places_fit(const lf_places *p, const lf_table *t)
{
    if (!p->row_cell) {
        if (!within(p->samples, 1, MOST_PX) || !within(p->heights, 2, 1 << 15) || !within(p->azimuths, 2, 1 << 15)
            || !within(p->quarter_steps, 1, 1 << 15) || t->intervals != p->heights - 1)
            return 0;
        for (int64_t n = 0; n <= p->samples; n++)
            if (!within(p->interval[n], 0, p->heights - 2)) return 0;
        return 1;
    }
    if (p->azimuths != 2 || !within(p->rows, 1, MOST_PX) || !within(p->columns, 1, MOST_PX)) return 0;
    int64_t last_row = 0, last_column = 0;
    for (int64_t y = 0; y < p->rows; y++) {
        if (!within(p->row_cell[y], 0, t->intervals - 1)) return 0;
        last_row = p->row_cell[y] > last_row ? p->row_cell[y] : last_row;
    }
    for (int64_t x = 0; x < p->columns; x++) {
        if (!within(p->column_cell[x], 0, t->intervals - 1)) return 0;
        last_column = p->column_cell[x] > last_column ? p->column_cell[x] : last_column;
    }
    return last_row + last_column < t->intervals;
}

int64_t lf_spread_work(int64_t pieces, int64_t columns)
{
    if (!within(pieces, 0, MOST) || !within(columns, 1, MOST_PX)) return 0;
    return 8 * pieces + 24 * (columns + 4) + 64 + 16 * (LF_PORTION * 8 + LF_SLACK); /* as in laid_out of spreading.c */
}

int lf_spread(int variant, const lf_places *places, const lf_table *t, const lf_picture *light,
              const lf_sections *sections, int64_t first_row, int64_t end_row, const lf_picture *out, void *work)
{
    if (!within(variant, 0, VARIANTS - 1) || !fits(light) || !fits(out) || !has_rows(light, first_row, end_row)
        || (light->planes != 1 && light->planes != 4) || out->planes != light->planes)
        return LF_BAD_SIZE;
    if (!places_fit(places, t) || !within(t->pieces, 0, MOST) || !table_fits(t, places->azimuths)) return LF_BAD_SIZE;
    if (out->rows < end_row - first_row + t->side - 1 || out->columns < light->columns + t->side - 1 + LF_SLACK)
        return LF_BAD_SIZE;
    if (!within(sections->size_px, 1, MOST_PX) || !within(sections->rows, 1, MOST_PX) ||
        !within(sections->columns, 1, MOST_PX) || sections->rows * sections->size_px < light->rows ||
        sections->columns * sections->size_px < light->columns)
        return LF_BAD_SIZE;
    return variants[variant].spread(places, t, light, sections, first_row, end_row, out, work);
}

/* Whether rows of sections are within a picture that is divided into these sections. */
static int divides(const lf_picture *p, int64_t rows, int64_t columns, int64_t size_px, int64_t first_row,
                   int64_t end_row)
{
    return fits(p) && within(size_px, 1, MOST_PX) && rows == (p->rows + size_px - 1) / size_px
           && columns == (p->columns + size_px - 1) / size_px && within(first_row, 0, end_row) && end_row <= rows;
}

int lf_extremes(int variant, const lf_picture *light, const lf_extremes_of *out, int64_t first_row, int64_t end_row)
{
    if (!within(variant, 0, VARIANTS - 1)
        || !divides(light, out->rows, out->columns, out->size_px, first_row, end_row))
        return LF_BAD_SIZE;
    return variants[variant].extremes(light, out, first_row, end_row);
}

int lf_excess(int variant, const lf_picture *light, float level, const lf_excess_of *out, int64_t first_row,
              int64_t end_row)
{
    if (!within(variant, 0, VARIANTS - 1)
        || !divides(light, out->rows, out->columns, out->size_px, first_row, end_row))
        return LF_BAD_SIZE;
    return variants[variant].excess(light, level, out, first_row, end_row);
}

int lf_footprints(int variant, const lf_geometry *lens, const lf_capture *capture, int64_t first_row, int64_t end_row,
                  const lf_picture *out)
{
    if (!within(variant, 0, VARIANTS - 1) || (capture->planes != 1 && capture->planes != 4)
        || !within(capture->rows, 1, MOST_PX) || !within(capture->columns, 1, MOST_PX) || !fits(out)
        || !has_rows(out, first_row, end_row) || capture->planes != out->planes)
        return LF_BAD_SIZE;
    if (lens->mesh ? !within(lens->mesh_rows, 2, MOST_PX) || !within(lens->mesh_columns, 2, MOST_PX)
                         || !within(lens->mesh_step, 1, MOST_PX)
                   : !within(lens->samples, 1, MOST_PX))
        return LF_BAD_SIZE;
    return variants[variant].footprints(lens, capture, first_row, end_row, out);
}

int lf_turn(int variant, const lf_samples *samples, double cosine, double sine, int64_t side, double *out)
{
    if (!within(variant, 0, VARIANTS - 1) || !within(samples->count, 0, MOST) || !within(samples->heights, 8, 1 << 16)
        || samples->heights % 8 || !within(side, 3, 1 << 14) || side % 2 == 0
        || !(samples->size_px > 0 && samples->size_px <= 1))
        return LF_BAD_SIZE;
    return variants[variant].turn(samples, cosine, sine, side, out);
}

int lf_waves(int variant, const lf_wavefront *w, const lf_picture *out, double *light, float *work)
{
    if (!within(variant, 0, VARIANTS - 1) || !within(w->rows, 3, MOST_PX) || !within(w->columns, 8, MOST_PX)
        || w->columns % 8 || !within(w->square, 1, 2) || !within(w->path_terms, w->square + 1, 1 << 10) || !within(w->edge_terms, 1, 1 << 10)
        || !within(w->limits, 1, 1 << 10) || !fits(out) || out->planes != 2 || out->rows != w->rows
        || out->columns < w->columns)
        return LF_BAD_SIZE;
    return variants[variant].waves(w, out, light, work);
}

/* Whether all look-ups of surfaces are within bounds. */
static int is_system(const lf_system *s)
{
    if (!within(s->surfaces, 1, 1 << 16) || !within(s->stop, 0, s->surfaces - 1) || !within(s->even_terms, 0, 1 << 10)
        || !within(s->odd_terms, 0, 1 << 10) || !s->kinds != !s->sections)
        return 0;
    for (int64_t n = 0; s->kinds && n < s->surfaces; n++)
        if (!within(s->kinds[n], LF_REVOLUTION, LF_TOROID_X)) return 0;
    return 1;
}

int lf_trace(int variant, const lf_system *s, const double *rays, int64_t count, double *out)
{
    if (!within(variant, 0, VARIANTS - 1) || !is_system(s) || !within(count, 0, MOST / (13 + s->surfaces)))
        return LF_BAD_SIZE;
    return variants[variant].trace(s, rays, count, out);
}

int lf_aim(int variant, const lf_system *s, const lf_targets *t, double *out)
{
    if (!within(variant, 0, VARIANTS - 1) || !is_system(s) || !within(t->fields, 0, MOST_PX)
        || !within(t->rays, 0, MOST_PX) || !within(t->kind, LF_ANGLE, LF_IMAGE_HEIGHT))
        return LF_BAD_SIZE;
    return variants[variant].aim(s, t, out);
}

int lf_ghost_rays(int variant, const lf_system *s, const lf_beam *b, double *out, double *work)
{
    if (!within(variant, 0, VARIANTS - 1) || !is_system(s) || !within(b->steps, 1, MOST_PX)
        || !within(b->waves, 1, LF_GHOST_WAVES) || !within(b->pairs, 0, MOST_PX)
        || !within(b->rows, 2, 1 << 10) || !within(b->columns, 2, 1 << 10) || !(b->steps_per_unit >= 0 && b->steps_per_unit < 1e300))
        return LF_BAD_SIZE;
    for (int64_t pair = 0; pair < b->pairs; pair++) {
        const int64_t near = b->surfaces[2 * pair], far = b->surfaces[2 * pair + 1];
        if (far >= 0 && (!within(far, 0, s->surfaces - 1) || !within(near, 0, far - 1))) return LF_BAD_SIZE;
    }
    return variants[variant].ghost_rays(s, b, out, work);
}

int64_t lf_ghost_work(int64_t rows, int64_t columns)
{
    if (!within(rows, 2, 1 << 10) || !within(columns, 2, 1 << 11)) return 0;
    return 15 * rows * columns; /* corners of ghosts.c */
}

int lf_ghost_light(int variant, const lf_meshes *m, const lf_picture *levels, int64_t count, double *light, double *work)
{
    if (!within(variant, 0, VARIANTS - 1) || !within(m->pairs, 0, MOST_PX) || !within(m->blades, 0, 1 << 10)
        || !within(m->waves, 1, LF_GHOST_WAVES) || !within(m->rows, 2, 1 << 10) || !within(m->columns, 2, 1 << 10) || !within(count, 1, 64))
        return LF_BAD_SIZE;
    for (int64_t n = 0; n < count; n++)
        if (!fits(levels + n) || levels[n].planes != m->waves || !within(levels[n].rows, 2, MOST_PX)
            || !within(levels[n].row_step, levels[n].columns + 8, MOST_PX * 2))
            return LF_BAD_SIZE;
    for (int64_t pair = 0; pair < m->pairs; pair++)
        if (!within(m->crossings[pair], 0, LF_CROSSINGS)) return LF_BAD_SIZE;
    return variants[variant].ghost_light(m, levels, count, light, work);
}

int64_t lf_fit_work(int64_t places, int64_t degree, int64_t step)
{
    if (!within(places, 1, MOST_PX) || !within(degree, 1, 1 << 6) || !within(step, 1, 2)) return 0;
    const int64_t acrosses = degree / step + 1, terms = acrosses * (degree + 1) - step * (acrosses * (acrosses - 1) / 2);
    return (places + 7) / 8 * 8 * (degree + 1 + acrosses + terms) + terms * (terms + 2); /* as in lf_fit of fitting.c */
}

int lf_fit(int variant, const lf_scattered *s, double *out, double *residual, double *work)
{
    if (!within(variant, 0, VARIANTS - 1) || !lf_fit_work(s->places, s->degree, s->step)
        || !within(s->quantities, 0, 1 << 10))
        return LF_BAD_SIZE;
    return variants[variant].fit(s, out, residual, work);
}

int lf_spots(int variant, const lf_bundle *b, double *out, double *light)
{
    if (!within(variant, 0, VARIANTS - 1) || !within(b->radii, 2, 1 << 12) || !within(b->azimuths, 2, 1 << 12)
        || !within(b->parts, 1, 1 << 10) || !within(b->side, 1, 1 << 14))
        return LF_BAD_SIZE;
    return variants[variant].spots(b, out, light);
}

/* Whether all look-ups of rays in a layer are within bounds. */
static int layer_fits(const lf_layer *l, int64_t wavelengths)
{
    if (!within(l->levels, 1, LF_LEVELS)) return 0;
    for (int64_t n = 0; n < l->levels; n++) {
        const lf_picture *p = &l->level[n].light;
        if (!fits(p) || p->planes != wavelengths || !within(p->rows, 2, 1 << 20) || !within(p->columns, 2, 1 << 20)
            || !within(p->row_step, p->columns, INT32_MAX / p->rows) || !within(p->columns, 2, INT32_MAX / 2 / p->rows))
            return 0;
    }
    return 1;
}

int lf_cast(int variant, const lf_cast_of *c, int64_t first_tile, int64_t end_tile, const lf_picture *blurred,
            const lf_picture *clear, float *work)
{
    if (!within(variant, 0, VARIANTS - 1) || !within(c->wavelengths, 1, LF_TOGETHER) || !fits(blurred) || !fits(clear)
        || blurred->planes != c->wavelengths || clear->planes != c->wavelengths || clear->rows != blurred->rows
        || clear->columns != blurred->columns || !within(c->nodes, 2, MOST_PX) || !(c->mesh_rows == 0 || (within(c->mesh_rows, 2, MOST_PX) && within(c->finer, 1, 1 << 10)))
        || !within(c->eights, 1, MOST_PX) || !within(c->blades, 0, MOST_PX) || !within(c->layers, 1, 1 << 10)
        || !within(c->tile_px, 1, MOST_PX) || !within(c->tile_columns, 1, MOST_PX) || !within(c->tile_rows, 1, MOST_PX)
        || !within(c->shrinkage_steps, 1, 1 << 20) || !within(first_tile, 0, end_tile) || end_tile > c->tile_rows * c->tile_columns)
        return LF_BAD_SIZE;
    for (int64_t n = 0; n < c->layers; n++)
        if (!layer_fits(c->layer + n, c->wavelengths)) return LF_BAD_SIZE;
    for (int64_t tile = first_tile; tile < end_tile; tile++) {
        if (!within(c->tile_eights[tile], 0, c->eights)
            || !within(c->first_eights[tile], 0, c->eights - c->tile_eights[tile])
            || !within(c->tile_step[tile], 1, c->tile_px))
            return LF_BAD_SIZE;
        for (int64_t n = 0; n < c->layers; n++)
            if (!within(c->meetings[tile * c->layers + n].level, 0, c->layer[n].levels - 1)) return LF_BAD_SIZE;
    }
    return variants[variant].cast(c, first_tile, end_tile, blurred, clear, work);
}

int lf_collect(int variant, const lf_picture *light, const lf_filters *f, int64_t first_row, int64_t end_row,
               const lf_picture *out)
{
    if (!within(variant, 0, VARIANTS - 1) || !fits(light) || !fits(out) || out->planes != 1 || out->rows != light->rows
        || out->columns != light->columns || !has_rows(out, first_row, end_row) || !within(f->rows, 1, MOST_PX)
        || !within(f->columns, 1, MOST_PX))
        return LF_BAD_SIZE;
    return variants[variant].collect(light, f, first_row, end_row, out);
}

int lf_read(int variant, const lf_pixels *p, const lf_picture *light_e, int64_t first_row, int64_t end_row,
            uint16_t *numbers)
{
    if (!within(variant, 0, VARIANTS - 1) || !fits(light_e) || !has_rows(light_e, first_row, end_row)
        || !within(p->row, 0, LF_MOST_SENSOR - light_e->rows)
        || !within(p->column, 0, LF_MOST_SENSOR - light_e->columns) || !(p->white_dn >= 0 && p->white_dn <= 65535))
        return LF_BAD_SIZE;
    return variants[variant].read(p, light_e, first_row, end_row, numbers);
}

int64_t lf_control_work(int64_t columns)
{
    return within(columns, 1, MOST_PX) ? 37 * LF_CONTROL_STRIDE(columns) : 0;
}

int lf_control(int variant, const lf_controlled *c, int64_t first_row, int64_t end_row, float *estimate, float *difference,
               double *work)
{
    if (!within(variant, 0, VARIANTS - 1) || !within(c->rows, 0, MOST_PX) || !within(c->columns, 1, MOST_PX)
        || !within(first_row, 0, end_row) || end_row > c->rows)
        return LF_BAD_SIZE;
    return variants[variant].control(c, first_row, end_row, estimate, difference, work);
}
