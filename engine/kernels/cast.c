/* Cast: radiance at pixels of the sensor along the lens's rays, through layers of a capture, the nearest first.

   The point where a ray meets a layer depends on the layer's depth at that point. It is found by iteration: compute the
   ray's position for a depth, look up the depth at that position, and repeat. Positions are in pixels from the axis, to
   the right and upwards. A pixel's rays are interpolated between nodes: between two heights, upon which positions turn
   with the pixel, or between four nodes of a mesh, upon which they may be mirrored. The look-ups of
   a pixel's rays are far apart in memory, but those of neighbouring pixels through the same point of the stop are close
   together. All pixels of a tile are therefore processed with each eight of rays at once.

   A ray stands for a part of the stop, its cell. It looks up the mean over the cell's blur, a square, in a level of the
   layer whose pixels are as large or larger. At a rim, the share of its cell that is open counts. */
#include "variant.h"

#define WIDE (LANES == 4 ? 4 : 8) /* rays in a vector: results do not depend on it */
typedef float rays __attribute__((vector_size(4 * WIDE), aligned(4), may_alias));
typedef int32_t masks __attribute__((vector_size(4 * WIDE), aligned(4), may_alias));
typedef int64_t longs __attribute__((vector_size(4 * WIDE), aligned(8), may_alias));
typedef double pairs __attribute__((vector_size(4 * WIDE), aligned(8), may_alias)); /* of neighbouring floats */
typedef double pair __attribute__((aligned(4), may_alias));

#if defined(__clang__) || __GNUC__ >= 12
#define PICKED(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define PICKED(a, b, ...) __builtin_shuffle(a, b, (masks){__VA_ARGS__})
#endif

#define BLOCKED 2e-3f /* rays with less than this share of their light are no longer followed */

#define APART 0.25f /* square of the distance in pixels from which two depths are two surfaces */

INLINE rays chosen(masks mask, rays yes, rays no) { return (rays)(((masks)yes & mask) | ((masks)no & ~mask)); }
INLINE rays kept(masks mask, rays a) { return (rays)((masks)a & mask); }
#if defined(__AVX__) /* compilers do not recognize these instructions in `chosen` */
INLINE rays larger(rays a, float b) { return __builtin_ia32_maxps256(a, (rays){0} + b); }
INLINE rays smaller(rays a, float b) { return __builtin_ia32_minps256(a, (rays){0} + b); } /* of NaN: b */
#elif defined(__SSE__)
INLINE rays larger(rays a, float b) { return __builtin_ia32_maxps(a, (rays){0} + b); }
INLINE rays smaller(rays a, float b) { return __builtin_ia32_minps(a, (rays){0} + b); }
#else
INLINE rays larger(rays a, float b) { return chosen(a > b, a, (rays){0} + b); }
INLINE rays smaller(rays a, float b) { return chosen(a < b, a, (rays){0} + b); }
#endif
INLINE rays at(const float *p) { return *(const rays *)p; }
INLINE rays between(rays a, rays b, rays weight) { return a + weight * (b - a); }

INLINE int any(masks mask)
{
    const longs two = (longs)mask;
    int64_t one = 0;
    for (int i = 0; i < WIDE / 2; i++) one |= two[i];
    return one != 0;
}

/* Loads the values at positions in a plane and to the right of each, for both halves of the rays, in an order that a
   single shuffle separates. */
INLINE void load_pairs(const float *plane, const int32_t *where, rays *a, rays *b)
{
#define PAIR(n) *(const pair *)(plane + where[n])
#if LANES == 4
    *a = (rays)(pairs){PAIR(0), PAIR(1)};
    *b = (rays)(pairs){PAIR(2), PAIR(3)};
#else
    *a = (rays)(pairs){PAIR(0), PAIR(1), PAIR(4), PAIR(5)};
    *b = (rays)(pairs){PAIR(2), PAIR(3), PAIR(6), PAIR(7)};
#endif
#undef PAIR
}
#if LANES == 4
INLINE rays firsts(rays a, rays b) { return PICKED(a, b, 0, 2, 4, 6); }
INLINE rays seconds(rays a, rays b) { return PICKED(a, b, 1, 3, 5, 7); }
INLINE rays twice_a(rays v) { return PICKED(v, v, 0, 0, 1, 1); }
INLINE rays twice_b(rays v) { return PICKED(v, v, 2, 2, 3, 3); }
#else
INLINE rays firsts(rays a, rays b) { return PICKED(a, b, 0, 2, 8, 10, 4, 6, 12, 14); }
INLINE rays seconds(rays a, rays b) { return PICKED(a, b, 1, 3, 9, 11, 5, 7, 13, 15); }
INLINE rays twice_a(rays v) { return PICKED(v, v, 0, 0, 1, 1, 4, 4, 5, 5); }
INLINE rays twice_b(rays v) { return PICKED(v, v, 2, 2, 3, 3, 6, 6, 7, 7); }
#endif

typedef struct { /* points, among the pixels of a layer, where rays meet it */
    int32_t where[WIDE]; /* the pixel above and to the left */
    rays right, down_a, down_b; /* weights of the pixels to the right, and of those below in the order of load_pairs */
} spots;

INLINE rays looked_up(const float *plane, int64_t row_step, const spots *s)
{
    rays a, b, below_a, below_b;
    load_pairs(plane, s->where, &a, &b);
    load_pairs(plane + row_step, s->where, &below_a, &below_b);
    a = between(a, below_a, s->down_a);
    b = between(b, below_b, s->down_b);
    return between(firsts(a, b), seconds(a, b), s->right);
}

/* Ratio of radii in a panoramic capture to those on a plane, from the square of the tangent of the angle. */
INLINE rays shrunk(const lf_cast_of *c, rays square)
{
    const float last = (float)c->shrinkage_steps;
    rays tangent, a, b;
    int32_t where[WIDE];
    for (int i = 0; i < WIDE; i++) tangent[i] = __builtin_sqrtf(square[i]);
    const rays step = smaller(tangent / (1 + tangent) * last, last);
    masks before = __builtin_convertvector(step, masks);
    before += before == (int32_t)c->shrinkage_steps; /* true is -1 */
    *(masks *)where = before;
    load_pairs(c->shrinkage, where, &a, &b);
    return between(firsts(a, b), seconds(a, b), step - __builtin_convertvector(before, rays));
}

typedef struct { /* rays at a wavelength: positions at infinity and their change with the inverse depth */
    rays x, y, by_x, by_y, light, free, in_focus; /* transmission of all layers in front, and of their in-focus parts */
} pencil;

INLINE void place(const lf_cast_of *c, const pencil *p, rays depth, rays *x, rays *y)
{
    *x = p->x + p->by_x * depth;
    *y = p->y + p->by_y * depth;
    if (c->per_focal_up > 0) {
        const rays right = *x * c->per_focal_right, up = *y * c->per_focal_up, part = shrunk(c, right * right + up * up);
        *x *= part;
        *y *= part;
    }
}

/* The inverse depth at which rays meet a layer, and the focus share there. The search starts at the layer's nearest depth.
   Rays that pass a near surface and meet, behind it, only what it hides do not converge: they stay at its depth, and
   look up what is beside it. */
INLINE void meet(const lf_cast_of *c, const lf_layer *l, const pencil *p, const lf_meeting *m, rays *depth, rays *share)
{
    const lf_level *fine = l->level;
    const float last_x = (float)(fine->light.columns - 1), last_y = (float)(fine->light.rows - 1);
    *depth = (rays){0} + m->inverse_depth;
    *share = (rays){0} + m->share;
    rays depth_before = *depth, share_before = *share;
    for (int32_t n = 0; n < m->steps; n++) {
        rays x, y, a, b;
        int32_t where[WIDE];
        place(c, p, *depth, &x, &y);
        x = larger(smaller(fine->axis_column + 0.5f + x, last_x), 0);
        y = larger(smaller(fine->axis_row + 0.5f - y, last_y), 0);
        *(masks *)where = (__builtin_convertvector(y, masks) * (int32_t)fine->light.columns
                           + __builtin_convertvector(x, masks)) * 2;
        load_pairs(l->depth, where, &a, &b);
        depth_before = *depth;
        share_before = *share;
        *depth = firsts(a, b);
        *share = seconds(a, b);
        if (!any(*depth != depth_before)) return; /* converged */
    }
    if (m->steps < 2) return; /* before was only the start */
    const rays change = depth_before - *depth, x = p->by_x * change, y = p->by_y * change;
    const masks nearer = change > 0, between_pixels = (change != 0) & (x * x + y * y <= APART); /* of one surface */
    *depth = chosen(between_pixels, 0.5f * (depth_before + *depth), chosen(nearer, depth_before, *depth));
    *share = chosen(between_pixels, 0.5f * (share_before + *share), chosen(nearer, share_before, *share));
}

/* The part of a cell that is beyond the border between two pixels, at a distance of its middle from the first one's. */
INLINE rays part_beyond(rays distance, float cells) { return larger(smaller(distance * cells + (0.5f - 0.5f * cells), 1), 0); }

/* Where rays meet a level of a layer at these inverse depths. Returns a mask of the rays that do not miss it. */
INLINE masks find_spots(const lf_cast_of *c, const lf_level *l, const pencil *p, rays depth, float cells, spots *s)
{
    const int32_t columns = (int32_t)l->light.columns, rows = (int32_t)l->light.rows;
    rays x, y;
    place(c, p, depth, &x, &y);
    x = l->axis_column + l->per_px * x;
    y = l->axis_row - l->per_px * y;
    const masks inside = (x > l->left) & (x < l->right) & (y > l->top) & (y < l->bottom);
    x = larger(smaller(x, (float)(columns - 1)), 0);
    y = larger(smaller(y, (float)(rows - 1)), 0);
    masks column = __builtin_convertvector(x, masks), row = __builtin_convertvector(y, masks);
    column += column == columns - 1; /* true is -1 */
    row += row == rows - 1;
    const rays down = part_beyond(y - __builtin_convertvector(row, rays), cells);
    s->right = part_beyond(x - __builtin_convertvector(column, rays), cells);
    s->down_a = twice_a(down);
    s->down_b = twice_b(down);
    *(masks *)s->where = row * (int32_t)l->light.row_step + column;
    return inside;
}

typedef struct { /* a pixel, whose rays are interpolated between nodes */
    const float *low, *high;   /* two neighbouring nodes */
    int64_t above;             /* in a mesh: floats from them to the nodes above */
    float weight, up_weight;   /* of the second node, and of the nodes above */
    float chief[LF_TOGETHER][2]; /* in a mesh: position at infinity that those of the rays are relative to */
    float right[2], up[2];     /* x and y of positions, as sums of the first and the second component */
    float cells;               /* of its rays, in a semi-aperture */
} pixel;

/* A quantity of eight rays at a pixel. */
INLINE rays at_pixel(const pixel *here, int mesh, int64_t where, rays weight, rays up_weight)
{
    const rays below = between(at(here->low + where), at(here->high + where), weight);
    if (!mesh) return below;
    where += here->above;
    return between(below, between(at(here->low + where), at(here->high + where), weight), up_weight);
}

/* The quantities of an eight of rays, of 8 floats each: the place in the stop, then those of each wavelength. */
enum { STOP_TWO, STOP_ONE, OF_STOP };
enum { FAR_ONE, FAR_TWO, MOVED_ONE, MOVED_TWO, CELLS_INSIDE, WEIGHT, OF_WAVELENGTH };

INLINE int64_t floats_before(int64_t wavelength) { return 8 * (OF_STOP + OF_WAVELENGTH * wavelength); }

enum { LIGHT, BLURRED, THROUGH, ALL, SUMS }; /* sums over the rays of a pixel at a wavelength, in eights */

INLINE void add(float *sums, rays a) { *(rays *)sums = *(const rays *)sums + a; }

INLINE rays open_share(rays cells_inside) { return larger(smaller(cells_inside + 0.5f, 1), 0); } /* of a cell that is open */

/* The share of each ray's cell that is between the blades of an iris, for a number of cells in a semi-aperture. */
INLINE rays between_blades(const lf_cast_of *c, const pixel *here, rays second, rays first)
{
    const rays x = second * here->right[1] + first * here->right[0], y = first * here->up[0] + second * here->up[1];
    rays open = (rays){0} + 1;
    for (int64_t n = 0; n < c->blades; n++) {
        const rays along = x * c->normals[2 * n] + y * c->normals[2 * n + 1];
        open *= open_share((c->blade_margin - c->blade_bend * (x * x + y * y) - c->blade_slope * along) * here->cells);
    }
    return open;
}

/* Follows the rays of an eight, from `first`, through the layers. */
INLINE void follow(const lf_cast_of *c, const pixel *here, int mesh, int64_t first, const lf_meeting *meetings, int focused,
                   float *sums)
{
    const int wavelengths = (int)c->wavelengths;
    const rays weight = (rays){0} + here->weight, up_weight = (rays){0} + here->up_weight;
    const rays held = mesh ? larger(smaller(weight, 1), 0) : smaller(weight, 1), up_held = larger(smaller(up_weight, 1), 0);
    const rays through = between_blades(c, here, at(here->low + first + 8 * STOP_TWO), at(here->low + first + 8 * STOP_ONE));
    pencil pencils[LF_TOGETHER];
    masks open = {0};
    for (int w = 0; w < wavelengths; w++) {
        const int64_t of_wavelength = first + floats_before(w);
#define RAYS(quantity, weight, up_weight) at_pixel(here, mesh, of_wavelength + 8 * quantity, weight, up_weight)
        rays one = RAYS(FAR_ONE, weight, up_weight), two = RAYS(FAR_TWO, weight, up_weight);
        if (mesh) one += here->chief[w][0], two += here->chief[w][1];
        const rays by_one = RAYS(MOVED_ONE, weight, up_weight), by_two = RAYS(MOVED_TWO, weight, up_weight);
        const rays part = open_share(RAYS(CELLS_INSIDE, held, up_held)) * through;
        const masks pass = part > 0;
        pencil *p = pencils + w;
        p->light = kept(pass, part * RAYS(WEIGHT, held, up_held));
#undef RAYS
        p->x = one * here->right[0] + two * here->right[1];
        p->y = one * here->up[0] + two * here->up[1];
        p->by_x = by_one * here->right[0] + by_two * here->right[1];
        p->by_y = by_one * here->up[0] + by_two * here->up[1];
        p->free = p->in_focus = kept(pass, (rays){0} + 1);
        open |= pass;
        add(sums + 8 * (SUMS * w + LIGHT), p->light);
    }
    for (int64_t n = 0; n < c->layers && any(open); n++) {
        const lf_layer *l = c->layer + n;
        const lf_level *level = l->level + meetings[n].level;
        if (meetings[n].steps < 0) continue;
        rays depth, in_focus;
        meet(c, l, pencils + wavelengths / 2, meetings + n, &depth, &in_focus);
        const masks covered = open & (in_focus >= 0);
        if (!any(covered)) continue;
        open = (masks){0};
        for (int w = 0; w < wavelengths; w++) {
            pencil *p = pencils + w;
            spots s;
            masks inside = covered;
            rays alpha = (rays){0} + 1;
            if (meetings[n].opaque) find_spots(c, level, p, depth, meetings[n].cells, &s);
            else {
                inside &= find_spots(c, level, p, depth, meetings[n].cells, &s);
                alpha = looked_up(level->alpha, level->light.row_step, &s);
            }
            alpha = kept(inside, alpha);
            const float *plane = level->light.values + w * level->light.plane_step;
            const rays light = kept(inside, looked_up(plane, level->light.row_step, &s));
            const rays visible = p->free * p->light;
            float *to = sums + 8 * SUMS * w;
            if (focused) {
                const rays sharp = visible * in_focus, bright = light + c->faint[w] * alpha;
                add(to + 8 * BLURRED, (visible - sharp) * light);
                add(to + 8 * THROUGH, sharp * bright);
                add(to + 8 * ALL, p->in_focus * p->light * in_focus * bright);
                p->in_focus -= p->in_focus * in_focus * alpha;
                p->in_focus = kept(p->in_focus > BLOCKED, p->in_focus);
            } else
                add(to + 8 * BLURRED, visible * light);
            p->free -= p->free * alpha;
            p->free = kept(p->free > BLOCKED, p->free);
            open |= (focused ? p->in_focus : p->free) > 0;
        }
    }
}

/* The node before a place among `count` nodes, and the place's distance from it. */
INLINE int64_t node_before(double place, int64_t count, float *weight)
{
    const double last = (double)(count - 2), before = place < 0 ? 0 : place < last ? place : last;
    *weight = (float)(place - (double)(int64_t)before);
    return (int64_t)before;
}

/* Interpolates the positions of chief rays at a place, in nodes of the finer mesh. */
INLINE void find_chief(const lf_cast_of *c, double right, double up, pixel *here)
{
    const int64_t size = 2 * c->wavelengths, columns = (c->nodes - 1) * c->finer + 1;
    float across, upwards;
    const float *a = c->chief + node_before(right, columns, &across) * size;
    a += node_before(up, (c->mesh_rows - 1) * c->finer + 1, &upwards) * columns * size;
    const float *b = a + columns * size;
    for (int64_t n = 0; n < size; n++) {
        const float low = a[n] + across * (a[n + size] - a[n]), high = b[n] + across * (b[n + size] - b[n]);
        here->chief[n / 2][n % 2] = low + upwards * (high - low);
    }
}

INLINE pixel pixel_of(const lf_cast_of *c, int mesh, int64_t row, int64_t column, float cells)
{
    const double x = (double)column - c->centre_column, y = c->centre_row - (double)row;
    const int64_t node = c->eights * floats_before(c->wavelengths);
    pixel here = {.cells = cells};
    if (mesh) {
        const int left = c->mirrored_right && x < 0, below = c->mirrored_up && y < 0;
        const double right = (left ? -x : x) * c->nodes_per_px - c->first_right, up = (below ? -y : y) * c->rows_per_px - c->first_up;
        here.above = c->nodes * node;
        here.low = c->rays + node_before(right, c->nodes, &here.weight) * node
                   + node_before(up, c->mesh_rows, &here.up_weight) * here.above;
        find_chief(c, right * (double)c->finer, up * (double)c->finer, &here);
        here.right[0] = left ? -1 : 1;
        here.up[1] = below ? -1 : 1;
    } else {
        const double height = __builtin_sqrt(x * x + y * y);
        here.low = c->rays + node_before(height * c->nodes_per_px, c->nodes, &here.weight) * node;
        here.right[0] = height > 0 ? (float)(x / height) : 0;
        here.right[1] = here.up[0] = height > 0 ? (float)(y / height) : 1;
        here.up[1] = -here.right[0];
    }
    here.high = here.low + node;
    return here;
}

static float sum_of(const float *a) { return ((a[0] + a[1]) + (a[2] + a[3])) + ((a[4] + a[5]) + (a[6] + a[7])); }

/* Divides the sums of a pixel: the radiance of each wavelength in place of LIGHT, and the clear share in place of ALL. */
INLINE void divide(const lf_cast_of *c, int focused, float *sums)
{
    for (int64_t w = 0; w < c->wavelengths; w++, sums += 8 * SUMS) {
        const float light = sum_of(sums + 8 * LIGHT), all = sum_of(sums + 8 * ALL);
        const float part = focused && all > 0 ? sum_of(sums + 8 * THROUGH) / all : 1;
        sums[8 * LIGHT] = light > 0 ? sum_of(sums + 8 * BLURRED) / light : 0;
        sums[8 * ALL] = part < 0 ? 0 : part < 1 ? part : 1;
    }
}

typedef struct { /* a row or a column between those that are cast, counted from the tile's first ones */
    int64_t before, after;
    float weight; /* of the latter */
} crossing;

INLINE crossing crossing_of(int64_t pixel, int64_t step, int64_t count)
{
    const int64_t before = pixel / step, after = before + 1 < count ? before + 1 : before;
    return (crossing){before, after, (float)(pixel % step) / (float)step};
}

/* Writes a tile of a picture from the first values of the pixels that are cast. */
static void fill(const float *values, int64_t each, int64_t step, int64_t tall, int64_t wide, const lf_picture *to, int64_t top,
                 int64_t left, int64_t bottom, int64_t right)
{
    for (int64_t row = top; row < bottom; row++) {
        const crossing y = crossing_of(row - top, step, tall);
        for (int64_t column = left; column < right; column++) {
            const crossing x = crossing_of(column - left, step, wide);
            const float *above = values + y.before * wide * each, *below = values + y.after * wide * each;
            for (int64_t w = 0; w < to->planes; w++) {
                const int64_t a = x.before * each + 8 * SUMS * w, b = x.after * each + 8 * SUMS * w;
                const float upper = above[a] + x.weight * (above[b] - above[a]), lower = below[a] + x.weight * (below[b] - below[a]);
                to->values[w * to->plane_step + row * to->row_step + column] = upper + y.weight * (lower - upper);
            }
        }
    }
}

/* Casts the pixels of a tile. With a step above 1, the last rows and columns may be beyond the tile. */
INLINE void cast_pixels(const lf_cast_of *c, int mesh, int64_t tile, int focused, const lf_picture *blurred,
                        const lf_picture *clear, float *work)
{
    const lf_meeting *meetings = c->meetings + tile * c->layers;
    const int64_t top = tile / c->tile_columns * c->tile_px, left = tile % c->tile_columns * c->tile_px;
    const int64_t bottom = top + c->tile_px < blurred->rows ? top + c->tile_px : blurred->rows;
    const int64_t right = left + c->tile_px < blurred->columns ? left + c->tile_px : blurred->columns;
    const int64_t step = c->tile_step[tile], tall = (bottom - top + step - 2) / step + 1, wide = (right - left + step - 2) / step + 1;
    const int64_t size = floats_before(c->wavelengths), each = 8 * SUMS * c->wavelengths, eights = c->tile_eights[tile];
    const float cells = __builtin_sqrtf((float)eights) / c->cell_of_eight;
    for (int64_t n = 0; n < tall * wide * each; n++) work[n] = 0;
    for (int64_t n = c->first_eights[tile]; n < c->first_eights[tile] + eights; n++) {
        float *sums = work;
        for (int64_t j = 0; j < tall; j++)
            for (int64_t i = 0; i < wide; i++, sums += each) {
                pixel here = pixel_of(c, mesh, top + j * step, left + i * step, cells);
                here.low += n * size, here.high += n * size;
                for (int64_t first = 0; first < 8; first += WIDE) follow(c, &here, mesh, first, meetings, focused, sums + first);
            }
    }
    for (int64_t n = 0; n < tall * wide; n++) divide(c, focused, work + n * each);
    fill(work + 8 * LIGHT, each, step, tall, wide, blurred, top, left, bottom, right);
    fill(work + 8 * ALL, each, step, tall, wide, clear, top, left, bottom, right);
}

lf_cast_loop OF_VARIANT(lf_cast);
/* Writes the pixels of tiles that have rays. */
int OF_VARIANT(lf_cast)(const lf_cast_of *c, int64_t first_tile, int64_t end_tile, const lf_picture *blurred,
                        const lf_picture *clear, float *work)
{
    for (int64_t tile = first_tile; tile < end_tile; tile++) {
        int focused = 0;
        for (int64_t n = 0; n < c->layers; n++) focused |= c->meetings[tile * c->layers + n].focused;
        if (!c->tile_eights[tile]) continue;
        if (c->mesh_rows) cast_pixels(c, 1, tile, focused, blurred, clear, work);
        else if (focused) cast_pixels(c, 0, tile, 1, blurred, clear, work);
        else cast_pixels(c, 0, tile, 0, blurred, clear, work);
    }
    return 0;
}
