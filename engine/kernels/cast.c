/* Cast: what a pixel of the sensor sees along the lens's rays, through layers of a capture, the nearest first.

   Eight rays of a pixel go together in every variant. A ray meets a layer where the layer's own depth puts it: its
   place for a depth is looked up, the depth at that place, and so on. Places are in pixels from the axis, to the right
   and upwards, and turn with the pixel, whose rays are those of its distance from the axis. */
#include "variant.h"

typedef int32_t eight_ints __attribute__((vector_size(32), aligned(4), may_alias));
typedef double four_doubles __attribute__((vector_size(32), aligned(8), may_alias));
typedef double two_floats __attribute__((aligned(4), may_alias));

#if defined(__clang__) || __GNUC__ >= 12
#define PICKED(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define PICKED(a, b, ...) __builtin_shuffle(a, b, (eight_ints){__VA_ARGS__})
#endif

#define ARCTAN_TERMS 0.0028340643f, -0.0160050305f, 0.0425876075f, -0.0749544544f, 0.106367541f, -0.142025705f, \
    0.199924836f, -0.333330668f, 0.999999984f
#define BLOCKED 2e-3f /* the share of a ray that is no longer followed */
INLINE eight_floats chosen(eight_ints mask, eight_floats yes, eight_floats no)
{
    return (eight_floats)(((eight_ints)yes & mask) | ((eight_ints)no & ~mask));
}
INLINE eight_floats kept(eight_ints mask, eight_floats a) { return (eight_floats)((eight_ints)a & mask); }
INLINE eight_floats larger(eight_floats a, eight_floats b) { return chosen(a > b, a, b); }
INLINE eight_floats smaller(eight_floats a, eight_floats b) { return chosen(a < b, a, b); } /* of NaN: b */
INLINE eight_floats all_of(float a) { return (eight_floats){a, a, a, a, a, a, a, a}; }
INLINE eight_floats at(const float *p) { return *(const eight_floats *)p; }
INLINE eight_floats between(eight_floats a, eight_floats b, eight_floats weight) { return a + weight * (b - a); }

INLINE int any(eight_ints mask)
{
    int32_t one = 0;
    for (int i = 0; i < 8; i++) one |= mask[i];
    return one != 0;
}

INLINE float sum_of(eight_floats a) { return ((a[0] + a[1]) + (a[2] + a[3])) + ((a[4] + a[5]) + (a[6] + a[7])); }

/* What lies at places of a plane and to the right of them: as (0, right of 0, 1, right of 1, 4 .. 5) and (2 .. 3, 6 .. 7). */
INLINE void load_pairs(const float *plane, const int32_t *where, eight_floats *a, eight_floats *b)
{
#define PAIR(n) *(const two_floats *)(plane + where[n])
    *a = (eight_floats)(four_doubles){PAIR(0), PAIR(1), PAIR(4), PAIR(5)};
    *b = (eight_floats)(four_doubles){PAIR(2), PAIR(3), PAIR(6), PAIR(7)};
#undef PAIR
}
INLINE eight_floats first_of(eight_floats a, eight_floats b) { return PICKED(a, b, 0, 2, 8, 10, 4, 6, 12, 14); }
INLINE eight_floats second_of(eight_floats a, eight_floats b) { return PICKED(a, b, 1, 3, 9, 11, 5, 7, 13, 15); }

typedef struct { /* where among the pixels of a layer eight rays meet it */
    int32_t above[8], below[8];
    eight_floats right, down_a, down_b; /* shares of the pixels to the right, and below as load_pairs has them */
} spots;

INLINE eight_floats looked_up(const float *plane, const spots *s)
{
    eight_floats a, b, below_a, below_b;
    load_pairs(plane, s->above, &a, &b);
    load_pairs(plane, s->below, &below_a, &below_b);
    a = between(a, below_a, s->down_a);
    b = between(b, below_b, s->down_b);
    return between(first_of(a, b), second_of(a, b), s->right);
}

/* Where rays at a tangent x, y are shown by a fisheye, as a part of that: arctan(r) / r, to 1e-7. */
INLINE eight_floats shrunk(eight_floats square)
{
    static const float terms[] = {ARCTAN_TERMS};
    const eight_ints far = square > 1;
    eight_floats r;
    for (int i = 0; i < 8; i++) r[i] = __builtin_sqrtf(square[i]);
    const eight_floats z = chosen(far, 1 / chosen(far, square, all_of(1)), square);
    eight_floats series = all_of(terms[0]);
    for (int n = 1; n < (int)(sizeof terms / sizeof *terms); n++) series = series * z + terms[n];
    return chosen(far, (1.57079633f - series / r) / r, series);
}

typedef struct { /* eight rays at a wavelength: places at infinity and how they move with the inverse depth */
    eight_floats x, y, by_x, by_y, light, free, in_focus; /* what passes of all coverage in front, and of that in focus alone */
} pencil;

INLINE void place(const pencil *p, eight_floats q, float per_focal, eight_floats *x, eight_floats *y)
{
    *x = p->x + p->by_x * q;
    *y = p->y + p->by_y * q;
    if (per_focal > 0) {
        const eight_floats right = *x * per_focal, up = *y * per_focal, part = shrunk(right * right + up * up);
        *x *= part;
        *y *= part;
    }
}

/* The inverse depth at which rays meet a layer, and the share of focus there. */
INLINE void meet(const lf_layer *l, const pencil *p, const lf_meeting *m, float per_focal, eight_floats *depth, eight_floats *share)
{
    eight_floats q = all_of(m->inverse_depth), s = all_of(m->share);
    const float last_x = (float)(l->light.columns - 1), last_y = (float)(l->light.rows - 1);
    for (int32_t n = 0; n < m->steps; n++) {
        eight_floats x, y, a, b;
        int32_t where[8];
        place(p, q, per_focal, &x, &y);
        x = larger(smaller(l->axis_column + 0.5f + x, all_of(last_x)), all_of(0));
        y = larger(smaller(l->axis_row + 0.5f - y, all_of(last_y)), all_of(0));
        *(eight_ints *)where = (__builtin_convertvector(y, eight_ints) * (int32_t)l->light.columns
                                + __builtin_convertvector(x, eight_ints)) * 2;
        load_pairs(l->depth, where, &a, &b);
        q = first_of(a, b);
        s = second_of(a, b);
    }
    *depth = q, *share = s;
}

/* Where rays meet a layer at these inverse depths: the mask is of those that do not pass beside it. */
INLINE eight_ints find_spots(const lf_layer *l, const pencil *p, eight_floats q, float per_focal, spots *s)
{
    const int32_t columns = (int32_t)l->light.columns, rows = (int32_t)l->light.rows;
    eight_floats x, y;
    place(p, q, per_focal, &x, &y);
    x = l->axis_column + x;
    y = l->axis_row - y;
    const eight_ints inside = (x > l->left) & (x < l->right) & (y > l->top) & (y < l->bottom);
    x = larger(smaller(x, all_of((float)(columns - 1))), all_of(0));
    y = larger(smaller(y, all_of((float)(rows - 1))), all_of(0));
    eight_ints column = __builtin_convertvector(x, eight_ints), row = __builtin_convertvector(y, eight_ints);
    column += column == columns - 1; /* true is -1 */
    row += row == rows - 1;
    s->right = x - __builtin_convertvector(column, eight_floats);
    const eight_floats down = y - __builtin_convertvector(row, eight_floats);
    s->down_a = PICKED(down, down, 0, 0, 1, 1, 4, 4, 5, 5);
    s->down_b = PICKED(down, down, 2, 2, 3, 3, 6, 6, 7, 7);
    const eight_ints above = row * (int32_t)l->light.row_step + column;
    *(eight_ints *)s->above = above;
    *(eight_ints *)s->below = above + (int32_t)l->light.row_step;
    return inside;
}

typedef struct { /* what the rays of a pixel add up to, at a wavelength */
    eight_floats light, blurred, through, all;
} sums;

/* The eight rays from `rays` on, of the height before and that behind, through the layers. */
INLINE void follow(const lf_cast_of *c, const float *rays, const float *next, float weight, float right, float up,
                   const lf_meeting *meetings, int focused, sums *total)
{
    const int wavelengths = (int)c->wavelengths;
    const eight_floats share = all_of(weight), held = all_of(weight < 1 ? weight : 1);
    pencil pencils[LF_TOGETHER];
    eight_ints open = {0};
    const eight_floats stop_x = at(rays), stop_y = at(rays + 8);
    const eight_floats blade_x = stop_x * up + stop_y * right, blade_y = stop_y * up - stop_x * right;
    eight_ints through = (eight_ints){0} == 0;
    for (int64_t n = 0; n < c->blades; n++) {
        const float *normal = c->normals + 2 * n;
        const eight_floats out = blade_x * normal[0] + blade_y * normal[1];
        through &= c->blade_margin - c->blade_bend * (blade_x * blade_x + blade_y * blade_y) - c->blade_slope * out > 0;
    }
    for (int w = 0; w < wavelengths; w++) {
        const float *a = rays + 16 + 48 * w, *b = next + 16 + 48 * w;
        const eight_floats out = between(at(a), at(b), share), across = between(at(a + 8), at(b + 8), share);
        const eight_floats by_out = between(at(a + 16), at(b + 16), share), by_across = between(at(a + 24), at(b + 24), share);
        pencil *p = pencils + w;
        const eight_ints pass = (between(at(a + 32), at(b + 32), held) > 0) & through;
        p->light = kept(pass, between(at(a + 40), at(b + 40), held));
        p->x = out * right + across * up;
        p->y = out * up - across * right;
        p->by_x = by_out * right + by_across * up;
        p->by_y = by_out * up - by_across * right;
        p->free = p->in_focus = kept(pass, all_of(1));
        open |= pass;
        total[w].light += p->light;
    }
    for (int64_t n = 0; n < c->layers && any(open); n++) {
        const lf_layer *l = c->layer + n;
        if (meetings[n].steps < 0) continue;
        eight_floats q, in_focus;
        meet(l, pencils + wavelengths / 2, meetings + n, c->per_focal, &q, &in_focus);
        open = (eight_ints){0};
        for (int w = 0; w < wavelengths; w++) {
            pencil *p = pencils + w;
            spots s;
            const eight_ints inside = find_spots(l, p, q, c->per_focal, &s);
            const eight_floats alpha = kept(inside, l->alpha ? looked_up(l->alpha, &s) : all_of(1));
            const eight_floats light = kept(inside, looked_up(l->light.values + w * l->light.plane_step, &s));
            const eight_floats seen = p->free * p->light;
            if (focused) {
                const eight_floats sharp = seen * in_focus, bright = light + c->faint[w] * alpha;
                total[w].blurred += (seen - sharp) * light;
                total[w].through += sharp * bright;
                total[w].all += p->in_focus * p->light * in_focus * bright;
                p->in_focus -= p->in_focus * in_focus * alpha;
                p->free -= p->free * alpha;
                open |= p->in_focus > BLOCKED;
            } else {
                total[w].blurred += seen * light;
                p->free -= p->free * alpha;
                open |= p->free > BLOCKED;
            }
        }
    }
}

/* Which of the sequences of rays a pixel has: neighbours another one. */
INLINE uint32_t scattered(uint32_t row, uint32_t column)
{
    uint32_t hash = row * 73856093u ^ column * 19349663u;
    hash = (hash ^ hash >> 13) * 0x5bd1e995u;
    return hash ^ hash >> 15;
}

INLINE void cast_pixel(const lf_cast_of *c, int64_t row, int64_t column, int64_t eights, const lf_meeting *meetings, int focused,
                       const lf_picture *blurred, const lf_picture *clear)
{
    const double x = (double)column - c->centre_column, y = c->centre_row - (double)row, height = __builtin_sqrt(x * x + y * y);
    const float right = height > 0 ? (float)(x / height) : 0, up = height > 0 ? (float)(y / height) : 1;
    const double step = height * c->heights_per_px, last = (double)(c->heights - 2);
    const int64_t before = (int64_t)(step < last ? step : last), size = 16 + 48 * c->wavelengths;
    const int64_t sequence = scattered((uint32_t)row, (uint32_t)column) % (uint32_t)c->sequences;
    const float *rays = c->rays + (before * c->sequences + sequence) * c->eights * size;
    const float *next = rays + c->sequences * c->eights * size;
    sums total[LF_TOGETHER];
    for (int64_t w = 0; w < c->wavelengths; w++) total[w] = (sums){{0}, {0}, {0}, {0}}; /* all at once would be memset's */
    for (int64_t n = 0; n < eights; n++)
        follow(c, rays + n * size, next + n * size, (float)(step - (double)before), right, up, meetings, focused, total);
    for (int64_t w = 0; w < c->wavelengths; w++) {
        const float light = sum_of(total[w].light), all = sum_of(total[w].all);
        const int64_t to = row * blurred->row_step + column, other = row * clear->row_step + column;
        blurred->values[w * blurred->plane_step + to] = light > 0 ? sum_of(total[w].blurred) / light : 0;
        const float part = focused && all > 0 ? sum_of(total[w].through) / all : 1;
        clear->values[w * clear->plane_step + other] = part < 0 ? 0 : part < 1 ? part : 1;
    }
}

lf_cast_loop OF_VARIANT(lf_cast);
/* Writes the pixels of rows of tiles that have rays. */
int OF_VARIANT(lf_cast)(const lf_cast_of *c, int64_t first_tile, int64_t end_tile, const lf_picture *blurred,
                        const lf_picture *clear)
{
    for (int64_t tile = first_tile; tile < end_tile; tile++) {
        const int64_t eights = c->tile_eights[tile], top = tile / c->tile_columns * c->tile_px;
        const int64_t left = tile % c->tile_columns * c->tile_px, end_row = top + c->tile_px, end_column = left + c->tile_px;
        const lf_meeting *meetings = c->meetings + tile * c->layers;
        int focused = 0;
        for (int64_t n = 0; n < c->layers; n++) focused |= meetings[n].focused;
        for (int64_t row = top; eights && row < (end_row < blurred->rows ? end_row : blurred->rows); row++)
            for (int64_t column = left; column < (end_column < blurred->columns ? end_column : blurred->columns); column++)
                if (focused) cast_pixel(c, row, column, eights, meetings, 1, blurred, clear);
                else cast_pixel(c, row, column, eights, meetings, 0, blurred, clear);
    }
    return 0;
}
