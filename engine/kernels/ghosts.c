/* Ghosts: rays that two surfaces reflect, over a grid across the light that enters a lens; and their light on the sensor,
   with each cell of the grid as two triangles. See engine/stray/ghosts.py. Lengths are in mm, of pictures in pixels. */
#include "surfaces.h"

typedef int32_t eight_ints __attribute__((vector_size(32), aligned(4), may_alias));

/* rays */

#define BLOCKS 2 /* vectors of rays that go side by side: the processor computes one while it waits for another's roots */
#define ABREAST (BLOCKS * RAYS)

typedef struct {
    ray rays[BLOCKS];
    doubles light[BLOCKS]; /* in front of the lens */
    doubles *places;       /* (surface that is met, BLOCKS): of the light's (n sin)^2 in the table of reflectances */
    doubles limit[BLOCKS]; /* the largest square of height over semi-aperture, or of a place over the half-widths of a
                              rectangle */
    doubles stop_x[LF_CROSSINGS][BLOCKS], stop_y[LF_CROSSINGS][BLOCKS];
    longs alive[BLOCKS];
    int crossings, lives; /* lives: whether any ray does */
    int64_t met; /* number of surfaces */
} passage;

/* The place of (n sin)^2 in the table of reflectances. */
INLINE doubles place_of(const lf_beam *b, doubles square)
{
    doubles place = square * b->steps_per_unit;
    place = chosen(place > 0, place, even(0)); /* NaN: 0 */
    return chosen(place < (double)b->steps, place, even((double)b->steps));
}

/* The part of light at each wavelength that a surface reflects; between the table's, by linear interpolation. */
INLINE eight_doubles reflectance(const lf_beam *b, int64_t n, double place)
{
    const int64_t first = place < (double)b->steps ? (int64_t)place : b->steps - 1;
    const double *table = b->reflectances + (n * (b->steps + 1) + first) * LF_GHOST_WAVES;
    const eight_doubles *here = (const eight_doubles *)table;
    return here[0] + (place - (double)first) * (here[1] - here[0]);
}

/* What is left of a ray's light on the way through a pair's surfaces, by its places in the table. */
static APART void leave_light(const lf_system *s, const lf_beam *b, int64_t pair, double light, const double *place,
                              double *left)
{
    const int64_t near = b->surfaces[2 * pair], far = b->surfaces[2 * pair + 1];
    eight_doubles rest = (eight_doubles){0} + light;
    for (int64_t n = 0; n < (far < 0 ? s->surfaces : far); n++, place += ABREAST) rest *= 1 - reflectance(b, n, *place);
    if (far >= 0) {
        rest *= reflectance(b, far, *place), place += ABREAST;
        for (int64_t n = far - 1; n > near; n--, place += ABREAST) rest *= 1 - reflectance(b, n, *place);
        rest *= reflectance(b, near, *place), place += ABREAST;
        for (int64_t n = near + 1; n < s->surfaces; n++, place += ABREAST) rest *= 1 - reflectance(b, n, *place);
    }
    *(eight_doubles *)left = rest;
}

/* The larger number; the first if the second is NaN. */
INLINE doubles larger_of(doubles a, doubles b) { return chosen(b > a, b, a); }

/* To a surface, and reflected or refracted there; `heading` is the sign of the direction behind it. */
static void meet(const lf_system *s, const lf_beam *b, int64_t n, int reflecting, double heading, double before,
                 double behind, passage *p)
{
    const double per_mm = b->per_semi_aperture[n];
    const int stop = n == s->stop, crossing = p->crossings < LF_CROSSINGS ? p->crossings : LF_CROSSINGS - 1;
    doubles square[BLOCKS], cosine[BLOCKS];
    triple normal[BLOCKS];
    for (int k = 0; k < BLOCKS; k++) {
        ray *r = p->rays + k;
        enter(s, n, r);
        r->position = moved(r->position, distance_to(s, n, r), r->direction);
    }
    for (int k = 0; k < BLOCKS; k++) {
        const triple at = p->rays[k].position;
        square[k] = (at.x * at.x + at.y * at.y) * (per_mm * per_mm);
        const doubles x = at.x * b->per_half_width[2 * n], y = at.y * b->per_half_width[2 * n + 1];
        p->limit[k] = larger_of(p->limit[k], larger_of(x * x, y * y));
        if (stop) p->stop_x[crossing][k] = at.x * per_mm, p->stop_y[crossing][k] = at.y * per_mm;
        else p->limit[k] = larger_of(p->limit[k], square[k]);
        normal[k] = normal_at(s, n, at);
        cosine[k] = product(p->rays[k].direction, normal[k]);
    }
    for (int k = 0; k < BLOCKS; k++)
        p->places[p->met * BLOCKS + k] = place_of(b, (before * before) * (1 - cosine[k] * cosine[k]));
    p->met++;
    longs lives = {0};
    for (int k = 0; k < BLOCKS; k++) {
        ray *r = p->rays + k;
        if (reflecting) r->direction = moved(r->direction, -2 * cosine[k], normal[k]);
        else r->direction = refracted(r->direction, normal[k], cosine[k], before / behind);
        leave(s, n, r);
        const longs still = (r->direction.z * heading > 0) & (square[k] < b->farthest);
        p->alive[k] &= still, lives |= still;
        r->position.x = chosen(still, r->position.x, even(__builtin_nan(""))); /* ends all iterations */
    }
    if (stop && p->crossings < LF_CROSSINGS) p->crossings++;
    p->lives = any(lives);
}

/* Moves the rays on along the axis, to places relative to a vertex that is so far behind the last one. */
INLINE void move_on(double along, passage *p)
{
    for (int k = 0; k < BLOCKS; k++) p->rays[k].position.z -= along;
}

/* On through the surfaces from `first` up to `end`, from a place relative to `first`. */
static void onwards(const lf_system *s, const lf_beam *b, int64_t first, int64_t end, passage *p)
{
    for (int64_t n = first; n < end && p->lives; n++) {
        meet(s, b, n, 0, 1, s->indices[n], s->indices[n + 1], p);
        move_on(shape_of(s, n)[2], p);
    }
}

/* Starts a vector of rays at places of the beam's cross section through the first vertex. */
INLINE void started(const lf_beam *b, doubles across, doubles up, ray *r, doubles *light)
{
    r->position = (triple){across * b->across[0] + up * b->up[0], across * b->across[1] + up * b->up[1],
                           across * b->across[2] + up * b->up[2]};
    r->direction = (triple){even(b->along[0]), even(b->along[1]), even(b->along[2])};
    *light = even(1);
    if (!b->finite) return;
    const triple from = {r->position.x - b->source[0], r->position.y - b->source[1], r->position.z - b->source[2]};
    const doubles square = product(from, from), length = root(square);
    *light = b->distance * b->distance / square * (product(from, r->direction) / length);
    r->direction = (triple){from.x / length, from.y / length, from.z / length};
}

/* Starts the rays from number `start` of a box. */
static APART void start_box(const lf_beam *b, const double *box, int64_t start, double *work, passage *p)
{
    const int64_t rays = b->rows * b->columns;
    for (int block = 0; block < BLOCKS; block++) {
        doubles across, up;
        for (int k = 0; k < RAYS; k++) {
            const int64_t next = start + block * RAYS + k, n = next < rays ? next : rays - 1;
            across[k] = box[0] + (double)(n % b->columns) * box[1], up[k] = box[2] + (double)(n / b->columns) * box[3];
        }
        started(b, across, up, p->rays + block, p->light + block);
        p->limit[block] = even(0), p->alive[block] = (longs){0} - 1;
        for (int k = 0; k < LF_CROSSINGS; k++) p->stop_x[k][block] = p->stop_y[k][block] = even(0);
    }
    p->crossings = 0, p->lives = 1, p->met = 0, p->places = (doubles *)work;
}

/* On through the surfaces from `first` to the image plane, from a place relative to `first`; stores what arrives there of
   the rays from number `start`. */
static APART void arrive(const lf_system *s, const lf_beam *b, int64_t pair, int64_t start, int64_t first, passage *p,
                         double *out)
{
    onwards(s, b, first, s->surfaces, p);
    const int64_t rays = b->rows * b->columns;
    for (int block = 0; block < BLOCKS && start + block * RAYS < rays; block++) {
        ray *r = p->rays + block;
        enter(s, s->surfaces, r);
        r->position = moved(r->position, -r->position.z / r->direction.z, r->direction);
        const int64_t ray = start + block * RAYS, count = rays - ray;
        double *to = out + pair * (LF_GHOST_QUANTITIES + b->waves) * rays + ray;
        stored(to, count, r->position.x), stored(to + rays, count, r->position.y);
        stored(to + 2 * rays, count, p->limit[block]);
        for (int k = 0; k < LF_CROSSINGS; k++) {
            const int last = k < p->crossings ? k : p->crossings > 0 ? p->crossings - 1 : 0;
            stored(to + (3 + 2 * k) * rays, count, p->stop_x[last][block]);
            stored(to + (4 + 2 * k) * rays, count, p->stop_y[last][block]);
        }
        for (int k = 0; k < RAYS && k < count; k++) {
            double left[LF_GHOST_WAVES];
            const int alive = p->alive[block][k] != 0;
            if (alive) leave_light(s, b, pair, p->light[block][k], (double *)p->places + block * RAYS + k, left);
            for (int64_t w = 0; w < b->waves; w++)
                to[(LF_GHOST_QUANTITIES + w) * rays + k] = alive ? left[w] : __builtin_nan("");
        }
    }
}

/* From a place relative to the vertex behind `near`, reflected at `near`, and on to the image plane. */
static APART void reflected_again(const lf_system *s, const lf_beam *b, int64_t pair, int64_t start, const passage *back,
                                  double *out)
{
    const int64_t near = b->surfaces[2 * pair];
    passage p = *back;
    move_on(-shape_of(s, near)[2], &p);
    if (p.lives) meet(s, b, near, 1, 1, s->indices[near + 1], s->indices[near + 1], &p);
    move_on(shape_of(s, near)[2], &p);
    arrive(s, b, pair, start, near + 1, &p, out);
}

/* Reflected at the far surface of a pair; then the pairs with the same one, in turn, up to the first whose near surface is
   not in front of the last one's, or up to `end`. They share the way back. Returns the number of the next pair. */
static APART int64_t reflected(const lf_system *s, const lf_beam *b, int64_t pair, int64_t end, int64_t start,
                               const passage *there, double *out)
{
    const int64_t far = b->surfaces[2 * pair + 1];
    passage p = *there;
    if (p.lives) meet(s, b, far, 1, -1, s->indices[far], s->indices[far], &p);
    int64_t at = far; /* the last surface that was met */
    for (; pair < end && b->surfaces[2 * pair + 1] == far && b->surfaces[2 * pair] < at; pair++) {
        for (; at - 1 > b->surfaces[2 * pair]; at--) {
            move_on(-shape_of(s, at - 1)[2], &p);
            if (p.lives) meet(s, b, at - 1, 0, -1, s->indices[at], s->indices[at - 1], &p);
        }
        reflected_again(s, b, pair, start, &p, out);
    }
    return pair;
}

/* The paths of pairs from one box, by rays from number `start`. Pairs share the way to the far surface, as long as it is
   not in front of the last one's. */
static APART void traced(const lf_system *s, const lf_beam *b, int64_t pair, int64_t end, int64_t start, double *out,
                         double *work)
{
    while (pair < end) {
        passage p;
        start_box(b, b->boxes + 4 * pair, start, work, &p);
        if (b->surfaces[2 * pair + 1] < 0) {
            arrive(s, b, pair++, start, 0, &p, out);
            continue;
        }
        for (int64_t at = 0; pair < end && b->surfaces[2 * pair + 1] >= at;) {
            const int64_t far = b->surfaces[2 * pair + 1];
            onwards(s, b, at, far, &p);
            pair = reflected(s, b, pair, end, start, &p, out), at = far;
        }
    }
}

static int same_box(const double *a, const double *b) { return a[0] == b[0] && a[1] == b[1] && a[2] == b[2] && a[3] == b[3]; }

lf_ghost_rays_loop OF_VARIANT(lf_ghost_rays);
int OF_VARIANT(lf_ghost_rays)(const lf_system *s, const lf_beam *b, double *out, double *work)
{
    for (int64_t pair = 0, end; pair < b->pairs; pair = end) {
        for (end = pair + 1; end < b->pairs && same_box(b->boxes + 4 * pair, b->boxes + 4 * end);) end++;
        for (int64_t start = 0; start < b->rows * b->columns; start += ABREAST) traced(s, b, pair, end, start, out, work);
    }
    return 0;
}

/* light */

#define FARTHEST_PX 1e6
#define LEAST_PX2 1e-12 /* added to areas: rays that meet in a point */
#define MOST_POINTS 2048
#define SHARED_FROM 3 /* up to 4 times its pixels, a mesh is shared with the next level */
#define DIAGONAL 1.4 /* of a cell, over its side */
#define QUANTITIES (1 + 2 * LF_CROSSINGS) /* limit, and positions in the stop */

typedef struct {
    double x, y, area; /* in pixels of the first level; of the triangles around it */
    eight_floats own, light; /* light of its ray, at each wavelength; light of these triangles, and then their irradiance */
    float values[QUANTITIES];
    int32_t reached; /* whether its ray reaches the sensor */
} corner;

typedef struct { /* a triangle at one level */
    double x[3], y[3], twice_area, longest;
    const corner *corners[3];
    eight_floats own; /* mean light of its rays */
    float per_limit, per_stop[LF_CROSSINGS]; /* one over the change across a pixel, or between points */
    int cut; /* whether anything may block its light */
} triangle;

typedef struct {
    const lf_meshes *mesh;
    const lf_picture *out;
    int crossings;
    float part;
    double scale, frame_rows, frame_columns; /* the frame ends inside of the last pixels of a coarse picture */
    eight_floats per_light, sums[LF_GHOST_WAVES]; /* irradiance per light; light on the frame at each wavelength, in parts */
} canvas;

INLINE double larger(double a, double b) { return a > b ? a : b; }
INLINE double smaller(double a, double b) { return a < b ? a : b; }
INLINE double magnitude(double a) { return a < 0 ? -a : a; }
INLINE eight_floats fewer(eight_floats a, eight_floats b)
{
    const eight_ints mask = a < b;
    return (eight_floats)(((eight_ints)a & mask) | ((eight_ints)b & ~mask));
}
INLINE eight_floats more(eight_floats a, eight_floats b) { return -fewer(-a, -b); }
INLINE eight_floats all(float value) { return (eight_floats){0} + value; }
/* The first integer that is not below a number. */
INLINE int64_t up_to(double a)
{
    const int64_t whole = (int64_t)a;
    return whole + ((double)whole < a);
}

/* Distance from the edge of the opening, in semi-apertures; negative outside. */
INLINE eight_floats inside(const lf_meshes *m, eight_floats x, eight_floats y)
{
    const eight_floats square = x * x + y * y, bent = m->blade_margin - m->blade_bend * square;
    eight_floats margin = (m->reach * m->reach - square) * (0.5f / m->reach);
    for (int64_t k = 0; k < m->blades; k++)
        margin = fewer(margin, bent - m->blade_slope * (x * m->normals[2 * k] + y * m->normals[2 * k + 1]));
    return margin;
}

/* The part of the light that nothing blocks. */
INLINE eight_floats open_part(const canvas *c, const triangle *t, const eight_floats *values)
{
    eight_floats distance = (1 - values[0]) * t->per_limit;
    for (int k = 0; k < c->crossings; k++)
        distance = fewer(distance, inside(c->mesh, values[1 + 2 * k], values[2 + 2 * k]) * t->per_stop[k]);
    return fewer(more(distance + 0.5f, all(0)), all(1));
}

/* Adds light at each wavelength, shared by the four pixels around a place. */
INLINE void add_point(canvas *c, double x, double y, eight_floats light)
{
    const lf_picture *out = c->out;
    if (!(x >= 0 && y >= 0 && x < (double)(out->columns - 1) && y < (double)(out->rows - 1))) return;
    const int64_t column = (int64_t)x, row = (int64_t)y;
    const float right = (float)(x - (double)column), down = (float)(y - (double)row);
    const double from_left = x - (LF_GHOST_RIM - 0.5), from_top = y - (LF_GHOST_RIM - 0.5);
    const int on_frame = from_left >= 0 && from_top >= 0 && from_left < c->frame_columns && from_top < c->frame_rows;
    float *to = out->values + row * out->row_step + column;
    for (int64_t w = 0; w < c->mesh->waves; w++, to += out->plane_step) {
        float *below = to + out->row_step;
        to[0] += light[w] * (1 - right) * (1 - down), to[1] += light[w] * right * (1 - down);
        below[0] += light[w] * (1 - right) * down, below[1] += light[w] * right * down;
        if (on_frame) c->sums[w][0] += light[w];
    }
}

/* The weights of the corners in the middle of a narrow triangle at places along its longest side, from corner 0 to 1;
   and its relative height there. */
INLINE void across(eight_floats place, float foot, eight_floats *weights, eight_floats *height)
{
    const eight_floats rising = place / (float)larger(foot, 1e-6), falling = (1 - place) / (float)larger(1 - foot, 1e-6);
    *height = fewer(rising, falling);
    const eight_floats third = fewer(*height, all(1)) * 0.5f;
    const eight_floats shift = third * foot;
    weights[2] = third, weights[1] = place - shift, weights[0] = 1 - weights[1] - third;
}

/* A triangle narrower than a pixel, as points along its longest side, which is from corner 0 to 1. They have the light of
   its own rays: areas next to each other may differ widely here. */
static APART void draw_points(canvas *c, const triangle *t)
{
    const int64_t count = t->longest < MOST_POINTS - 1 ? 1 + (int64_t)t->longest : MOST_POINTS;
    const double side_x = t->x[1] - t->x[0], side_y = t->y[1] - t->y[0];
    const double along = (t->x[2] - t->x[0]) * side_x + (t->y[2] - t->y[0]) * side_y;
    const float foot = (float)smaller(larger(along / larger(side_x * side_x + side_y * side_y, 1e-30), 0), 1);
    eight_floats weights[3], height;
    double heights = 0;
    for (int64_t n = 0; n < count; n++) across(all(((float)n + 0.5f) / (float)count), foot, weights, &height), heights += height[0];
    for (int64_t first = 0; first < count; first += 8) {
        eight_floats place, values[QUANTITIES];
        for (int k = 0; k < 8; k++) place[k] = ((float)(first + k) + 0.5f) / (float)count;
        across(place, foot, weights, &height);
        for (int q = 0; q < 1 + 2 * c->crossings; q++)
            values[q] = t->corners[0]->values[q] * weights[0] + t->corners[1]->values[q] * weights[1]
                        + t->corners[2]->values[q] * weights[2];
        eight_floats part = height * (c->part / (float)heights);
        if (t->cut) part *= open_part(c, t, values);
        for (int k = 0; k < 8 && first + k < count; k++)
            add_point(c, t->x[0] * weights[0][k] + t->x[1] * weights[1][k] + t->x[2] * weights[2][k],
                      t->y[0] * weights[0][k] + t->y[1] * weights[1][k] + t->y[2] * weights[2][k],
                      t->own * c->per_light * part[k]);
    }
}

/* The columns of a row whose middles are in the triangle: from the first up to the end. Triangles with a common side
   share it without gaps or overlap, because its columns come from the same operations. */
INLINE void columns_of(const triangle *t, double row, int64_t columns, int64_t *first, int64_t *end)
{
    double left = 1e300, right = -1e300;
    for (int k = 0; k < 3; k++) {
        const int next = k == 2 ? 0 : k + 1;
        const int a = t->y[k] < t->y[next] ? k : next, b = a == k ? next : k;
        if (!(t->y[a] <= row && row < t->y[b])) continue;
        const double x = t->x[a] + (row - t->y[a]) * ((t->x[b] - t->x[a]) / (t->y[b] - t->y[a]));
        left = smaller(left, x), right = larger(right, x);
    }
    *first = up_to(smaller(larger(left, 0), (double)columns)), *end = up_to(smaller(larger(right, 0), (double)columns));
}

/* Adds light to eight pixels of a row at each wavelength: irradiance that rises evenly from the first corner, at these
   distances across and down, times parts. */
INLINE void add_eight(canvas *c, const eight_floats *light, eight_floats beside, float down, eight_floats part,
                      eight_floats on_frame, float *to)
{
    for (int64_t w = 0; w < c->mesh->waves; w++, to += c->out->plane_step) {
        const eight_floats value = (light[0][w] + light[2][w] * down + beside * light[1][w]) * part;
        *(eight_floats *)to += value;
        c->sums[w] += value * on_frame;
    }
}

static APART void draw_pixels(canvas *c, triangle *t)
{
    float by_x[QUANTITIES], by_y[QUANTITIES];
    const int count = 1 + 2 * c->crossings;
    const corner *const *at = t->corners;
    const double x1 = t->x[1] - t->x[0], y1 = t->y[1] - t->y[0], x2 = t->x[2] - t->x[0], y2 = t->y[2] - t->y[0];
    const float right1 = (float)(x1 / t->twice_area), down1 = (float)(y1 / t->twice_area);
    const float right2 = (float)(x2 / t->twice_area), down2 = (float)(y2 / t->twice_area);
    for (int q = 0; t->cut && q < count; q++) {
        const float rise1 = at[1]->values[q] - at[0]->values[q], rise2 = at[2]->values[q] - at[0]->values[q];
        by_x[q] = rise1 * down2 - rise2 * down1, by_y[q] = rise2 * right1 - rise1 * right2;
    }
    const eight_floats rise1 = at[1]->light - at[0]->light, rise2 = at[2]->light - at[0]->light;
    const eight_floats light[3] = {at[0]->light, rise1 * down2 - rise2 * down1, rise2 * right1 - rise1 * right2};
    const lf_picture *out = c->out;
    const double top = smaller(smaller(t->y[0], t->y[1]), t->y[2]), bottom = larger(larger(t->y[0], t->y[1]), t->y[2]);
    const int64_t end_row = up_to(smaller(larger(bottom, 0), (double)out->rows));
    const eight_floats lanes = {0, 1, 2, 3, 4, 5, 6, 7};
    const float left = LF_GHOST_RIM, right = (float)(LF_GHOST_RIM + c->frame_columns);
    const double last = LF_GHOST_RIM + c->frame_rows;
    for (int64_t row = up_to(larger(top, 0)); row < end_row; row++) {
        const float on_frame = row < LF_GHOST_RIM ? 0 : (float)smaller(larger(last - (double)row, 0), 1);
        int64_t first, end;
        columns_of(t, (double)row, out->columns, &first, &end);
        const float down = (float)((double)row - t->y[0]);
        for (; first < end; first += 8) {
            const eight_floats beside = lanes + (float)((double)first - t->x[0]);
            eight_floats part = all(c->part);
            if (t->cut) {
                eight_floats values[QUANTITIES];
                for (int q = 0; q < count; q++) values[q] = at[0]->values[q] + by_y[q] * down + beside * by_x[q];
                part *= open_part(c, t, values);
            }
            part = (eight_floats)((eight_ints)part & (lanes < (float)(end - first)));
            const eight_floats inside = fewer(more(right - (float)first - lanes, all(0)), all(1)) * on_frame;
            add_eight(c, light, beside, down, part, (eight_floats)((eight_ints)inside & (lanes >= left - (float)first)),
                      out->values + row * out->row_step + first);
        }
    }
}

INLINE float change_of(const triangle *t, int q)
{
    const float a = t->corners[0]->values[q], b = t->corners[1]->values[q], c = t->corners[2]->values[q];
    return (float)(larger(larger(a, b), c) - smaller(smaller(a, b), c));
}

/* Sets the changes across a pixel, and whether anything may block the light; returns 0 if all of it is blocked. */
static int is_lit(const canvas *c, triangle *t)
{
    float lowest = 1e30f, highest = -1e30f;
    const double scale = DIAGONAL / larger(t->longest, 1);
    for (int k = 0; k < c->crossings; k++) {
        const float x = change_of(t, 1 + 2 * k), y = change_of(t, 2 + 2 * k);
        t->per_stop[k] = (float)(1 / larger(scale * (double)larger(x, y), 1e-9));
    }
    t->per_limit = (float)(1 / larger(scale * change_of(t, 0), 1e-9));
    for (int n = 0; n < 3; n++) {
        const float distance = (1 - t->corners[n]->values[0]) * t->per_limit;
        highest = (float)larger(highest, distance), lowest = (float)smaller(lowest, distance);
    }
    if (highest <= -0.5f) return 0;
    t->cut = lowest < 0.5f;
    for (int k = 0; k < c->crossings; k++) {
        eight_floats x = all(0), y = all(0);
        for (int n = 0; n < 3; n++) x[n] = t->corners[n]->values[1 + 2 * k], y[n] = t->corners[n]->values[2 + 2 * k];
        const eight_floats distance = inside(c->mesh, x, y) * t->per_stop[k];
        const float closest = (float)larger(larger(distance[0], distance[1]), distance[2]);
        if (closest < -2.5 * larger(t->longest, 1)) return 0;
        t->cut |= smaller(smaller(distance[0], distance[1]), distance[2]) < 0.5;
    }
    return 1;
}

static void draw(canvas *c, const corner *const *at)
{
    const double scale = c->scale;
    triangle t;
    double sides[3];
    for (int k = 0; k < 3; k++) {
        const corner *a = at[(k + 1) % 3], *b = at[(k + 2) % 3];
        sides[k] = (a->x - b->x) * (a->x - b->x) + (a->y - b->y) * (a->y - b->y);
    }
    const int apex = sides[0] > sides[1] ? (sides[0] > sides[2] ? 0 : 2) : (sides[1] > sides[2] ? 1 : 2);
    for (int k = 0; k < 3; k++) { /* the last corner is opposite to the longest side */
        const corner *a = at[(apex + 1 + k) % 3];
        t.x[k] = (a->x + 0.5) * scale - 0.5 + LF_GHOST_RIM, t.y[k] = (a->y + 0.5) * scale - 0.5 + LF_GHOST_RIM;
        t.corners[k] = a;
    }
    const double columns = (double)c->out->columns, rows = (double)c->out->rows;
    if (!(smaller(smaller(t.x[0], t.x[1]), t.x[2]) < columns && larger(larger(t.x[0], t.x[1]), t.x[2]) >= 0
          && smaller(smaller(t.y[0], t.y[1]), t.y[2]) < rows && larger(larger(t.y[0], t.y[1]), t.y[2]) >= 0))
        return;
    t.twice_area = (t.x[1] - t.x[0]) * (t.y[2] - t.y[0]) - (t.x[2] - t.x[0]) * (t.y[1] - t.y[0]);
    t.longest = __builtin_sqrt(sides[apex]) * scale;
    t.own = (at[0]->own + at[1]->own + at[2]->own) / 3;
    if (!is_lit(c, &t)) return;
    if (magnitude(t.twice_area) < t.longest) draw_points(c, &t);
    else draw_pixels(c, &t);
}

/* The limit of a ray less a twelfth of its second differences, by which linear interpolation overestimates a convex
   quantity on average; next to the edge, as if mirrored there. */
INLINE double limit_of(const double *limits, const lf_meshes *m, int64_t row, int64_t column)
{
    const int64_t across = m->columns, last_row = m->rows - 1, last_column = m->columns - 1;
    const double above = limits[row > 0 ? -across : across], below = limits[row < last_row ? across : -across];
    const double before = limits[column > 0 ? -1 : 1], behind = limits[column < last_column ? 1 : -1];
    return limits[0] - ((before + behind - 2 * limits[0]) + (above + below - 2 * limits[0])) / 12;
}

/* The corners of a mesh, of which half may be given, turned about the axis. */
static APART void laid_out(const lf_meshes *m, int64_t pair, int64_t columns, corner *corners)
{
    const int64_t plane = m->rows * m->columns, middle = columns - m->columns;
    for (int64_t n = 0; n < m->rows * columns; n++) {
        const int64_t column = n % columns - middle, left = column < 0;
        const double *in = m->rays + pair * (LF_GHOST_QUANTITIES + m->waves) * plane + n / columns * m->columns
                           + (left ? -column : column);
        corner *to = corners + n;
        const double x = left ? -in[0] : in[0], y = in[plane];
        to->x = m->centre_column + (x * m->cosine - y * m->sine) * m->px_per_mm;
        to->y = m->centre_row - (x * m->sine + y * m->cosine) * m->px_per_mm;
        to->values[0] = (float)limit_of(in + 2 * plane, m, n / columns, left ? -column : column);
        for (int k = 0; k < LF_CROSSINGS; k++) {
            const double stop_x = (left ? -1 : 1) * in[(3 + 2 * k) * plane], stop_y = in[(4 + 2 * k) * plane];
            to->values[1 + 2 * k] = (float)(stop_x * m->cosine - stop_y * m->sine);
            to->values[2 + 2 * k] = (float)(stop_x * m->sine + stop_y * m->cosine);
        }
        to->light = to->own = all(0), to->area = 0;
        for (int64_t w = 0; w < m->waves; w++) to->own[w] = (float)in[(LF_GHOST_QUANTITIES + w) * plane];
        to->reached = magnitude(to->x) < FARTHEST_PX && magnitude(to->y) < FARTHEST_PX
                      && in[LF_GHOST_QUANTITIES * plane] >= 0;
    }
}

/* The corners of one of the two triangles of a cell; returns whether rays reach all of them. The diagonals are mirror
   images on both sides of the middle. */
INLINE int is_triangle(const corner *corners, int64_t columns, int64_t row, int64_t column, int second, const corner **at)
{
    const corner *a = corners + row * columns + column, *b = a + 1, *c = a + columns, *d = c + 1;
    const int left = 2 * column < columns - 1;
    at[0] = left ? (second ? d : a) : (second ? c : b);
    at[1] = left ? b : a, at[2] = left ? c : d;
    return at[0]->reached && at[1]->reached && at[2]->reached;
}

/* The irradiance of the light at each wavelength, times a factor. */
INLINE eight_floats irradiance_of(const lf_meshes *m, int64_t pair, double factor)
{
    eight_floats result = all(0);
    for (int64_t w = 0; w < m->waves; w++) result[w] = (float)(m->irradiance[pair * m->waves + w] * factor);
    return result;
}

/* Turns the light of rays into irradiance, and returns the area on the sensor that is lit, in pixels. The irradiance at a
   corner is the light of the triangles around it over their area: it stays finite where the mesh folds, and the
   triangles together have their light. */
static APART double irradiated(const lf_meshes *m, int64_t pair, const lf_picture *out, int64_t columns, corner *corners)
{
    const double limit = (double)m->reach * m->reach;
    const double width = (double)(out->columns - 2 * LF_GHOST_RIM), height = (double)(out->rows - 2 * LF_GHOST_RIM);
    const corner *at[3];
    double lit = 0;
    for (int64_t row = 0; row + 1 < m->rows; row++)
        for (int64_t column = 0; column + 1 < columns; column++)
            for (int second = 0; second < 2; second++) {
                if (!is_triangle(corners, columns, row, column, second, at)) continue;
                const eight_floats light = (at[0]->own + at[1]->own + at[2]->own) * (float)(m->cells[pair] / 6);
                const double area = magnitude((at[1]->x - at[0]->x) * (at[2]->y - at[0]->y)
                                              - (at[2]->x - at[0]->x) * (at[1]->y - at[0]->y)) / 2 + LEAST_PX2;
                int open = 0;
                for (int k = 0; k < 3; k++) {
                    corner *each = (corner *)at[k];
                    each->light += light, each->area += area;
                    const float *v = each->values;
                    open |= v[0] < 1 && v[1] * v[1] + v[2] * v[2] < limit && each->x > 0 && each->x < width && each->y > 0
                            && each->y < height;
                }
                lit += open ? area : 0;
            }
    const eight_floats per_px2 = irradiance_of(m, pair, m->px_per_mm * m->px_per_mm);
    for (int64_t n = 0; n < m->rows * columns; n++)
        if (corners[n].area > 0) corners[n].light *= per_px2 / (float)corners[n].area;
    return lit;
}

static void draw_mesh(canvas *c, int64_t columns, const corner *corners)
{
    const corner *at[3];
    for (int64_t row = 0; row + 1 < c->mesh->rows; row++)
        for (int64_t column = 0; column + 1 < columns; column++)
            for (int second = 0; second < 2; second++)
                if (is_triangle(corners, columns, row, column, second, at)) draw(c, at);
}

lf_ghost_light_loop OF_VARIANT(lf_ghost_light);
/* Each mesh is shared by two levels, so that pictures of moving lamps are continuous. */
int OF_VARIANT(lf_ghost_light)(const lf_meshes *m, const lf_picture *levels, int64_t count, double *light, double *work)
{
    corner *corners = (corner *)work;
    const int64_t columns = m->mirrored ? 2 * m->columns - 1 : m->columns;
    for (int64_t pair = 0; pair < m->pairs; pair++) {
        laid_out(m, pair, columns, corners);
        const double area = irradiated(m, pair, levels, columns, corners);
        double over = larger(area / m->pixels[pair], m->blur[pair]), scale = 1;
        int64_t level = 0;
        for (; over >= 4 && level + 1 < count; level++) over /= 4, scale /= 2;
        const double blurred = (m->blur[pair] * scale * scale - 1) / 3; /* gives the blur its variance */
        const float coarser = level + 1 < count ? (float)larger(larger(blurred, over - SHARED_FROM), 0) : 0;
        for (int64_t w = 0; w < m->waves; w++) light[pair * m->waves + w] = 0;
        for (int k = 0; k < 2; k++) {
            const float part = k ? coarser : 1 - coarser;
            if (!(part > 0)) continue;
            canvas c;
            c.mesh = m, c.out = levels + level + k, c.crossings = (int)m->crossings[pair], c.part = part;
            c.scale = scale / (1 + k);
            for (int w = 0; w < LF_GHOST_WAVES; w++) c.sums[w] = all(0);
            c.frame_rows = (double)(levels->rows - 2 * LF_GHOST_RIM) * c.scale;
            c.frame_columns = (double)(levels->columns - 2 * LF_GHOST_RIM) * c.scale;
            const double px2_per_mm2 = c.scale * c.scale * m->px_per_mm * m->px_per_mm;
            c.per_light = irradiance_of(m, pair, m->cells[pair] / 2 * px2_per_mm2);
            draw_mesh(&c, columns, corners);
            for (int64_t w = 0; w < m->waves; w++)
                for (int n = 0; n < 8; n++) light[pair * m->waves + w] += c.sums[w][n] / px2_per_mm2;
        }
    }
    return 0;
}
