/* Tracing: rays through the surfaces of a lens, from the stop to both sides, and the search for rays that come from an
   object point or go to an image point. Lengths are in mm, from the vertex of a surface; see engine/rays/trace.py and
   engine/rays/aiming.py. Every variant processes eight rays at once. */
#include "variant.h"

#define NEWTON_STEPS 50 /* to an asphere */
#define CONVERGED_MM 1e-13
#define GOOD_MM 1e-9
#define LEAST_SQUARE 1e-24 /* mm^2: the slope of a term in r is undefined at the vertex */
#define LEAST_ROOT 1e-6    /* a step may pass beyond the conic's end before it reaches the surface */
#define CHIEF_STEPS 4
#define SLOPE_STEP 1e-6    /* for derivatives with respect to slope */
#define STEPS 16           /* of Broyden's method */
#define LONGEST_STEP 0.2   /* in slope */
#define CONVERGED 2e-12    /* error at the point */

#define APART __attribute__((noinline)) /* to keep the stack of each function small */

typedef struct { eight_doubles x, y, z; } triple;
typedef struct { triple position, direction; eight_doubles path; } ray;

INLINE eight_doubles even(double value) { return (eight_doubles){0} + value; }
INLINE eight_doubles chosen(eight_longs mask, eight_doubles yes, eight_doubles no)
{
    return (eight_doubles)(((eight_longs)yes & mask) | ((eight_longs)no & ~mask));
}
INLINE eight_doubles at_least(eight_doubles a, double least) { return chosen(a < least, even(least), a); } /* keeps NaN */
INLINE eight_doubles size(eight_doubles a) { return (eight_doubles)((eight_longs)a & INT64_MAX); }
INLINE eight_doubles signed_as(eight_doubles a, eight_doubles sign)
{
    return (eight_doubles)(((eight_longs)a & INT64_MAX) | ((eight_longs)sign & INT64_MIN));
}
INLINE eight_doubles root(eight_doubles a)
{
    for (int k = 0; k < 8; k++) a[k] = __builtin_sqrt(a[k]);
    return a;
}
INLINE int any(eight_longs mask)
{
    int64_t all = 0;
    for (int k = 0; k < 8; k++) all |= mask[k];
    return all != 0;
}
INLINE triple moved(triple a, eight_doubles along, triple b)
{
    return (triple){a.x + along * b.x, a.y + along * b.y, a.z + along * b.z};
}
INLINE triple times(eight_doubles a, triple b) { return (triple){a * b.x, a * b.y, a * b.z}; }
INLINE eight_doubles product(triple a, triple b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

/* Values from `from`, the last one for lanes beyond the end. */
INLINE eight_doubles loaded(const double *from, int64_t count)
{
    eight_doubles values;
    for (int k = 0; k < 8; k++) values[k] = from[k < count ? k : count - 1];
    return values;
}
INLINE void stored(double *to, int64_t count, eight_doubles values)
{
    for (int k = 0; k < 8 && k < count; k++) to[k] = values[k];
}

INLINE const double *shape_of(const lf_system *s, int64_t n) { return s->shapes + n * (3 + s->even_terms + s->odd_terms); }

INLINE int64_t kind_of(const lf_system *s, int64_t n) { return s->kinds ? s->kinds[n] : LF_REVOLUTION; }

INLINE int is_conic(const lf_system *s, int64_t n)
{
    if (kind_of(s, n) != LF_REVOLUTION) return 0;
    const double *terms = shape_of(s, n) + 3;
    for (int64_t k = 0; k < s->even_terms + s->odd_terms; k++)
        if (terms[k] != 0) return 0;
    return 1;
}

/* Sag of a surface of revolution, and its derivative with respect to the squared distance from the axis. */
INLINE void sag_and_slope(const lf_system *s, int64_t n, eight_doubles square, eight_doubles *sag, eight_doubles *slope)
{
    const double *shape = shape_of(s, n), *terms = shape + 3, *odd = terms + s->even_terms, curvature = shape[0];
    const eight_doubles rest = root(at_least(1 - (1 + shape[1]) * (curvature * curvature) * square, LEAST_ROOT * LEAST_ROOT));
    eight_doubles powers = even(0), change = even(0);
    for (int64_t k = s->even_terms; k > 0; k--) {
        change = change * square + (double)k * terms[k - 1];
        powers = (powers + terms[k - 1]) * square;
    }
    *sag = curvature * square / (1 + rest) + powers;
    *slope = curvature / (2 * rest) + change;
    if (!s->odd_terms) return;
    const eight_doubles off_axis = at_least(square, LEAST_SQUARE);
    eight_doubles raised = root(off_axis);
    for (int64_t k = 0; k < s->odd_terms; k++, raised *= off_axis) {
        *sag += odd[k] * raised;
        *slope += ((double)k + 0.5) * odd[k] * raised / off_axis;
    }
}

typedef struct { eight_doubles sag, by_x, by_y; } relief; /* sag, and its derivatives */

/* As _biconic and _toroid of engine/prescription/surfaces.py. */
static relief biconic(const double *shape, const double *section, int64_t terms, eight_doubles x, eight_doubles y)
{
    const double bend_x = section[0], bend_y = shape[0];
    const double end_x = (1 + section[1]) * (bend_x * bend_x), end_y = (1 + shape[1]) * (bend_y * bend_y);
    const eight_doubles square_x = x * x, square_y = y * y;
    const eight_doubles rest = root(at_least(1 - end_x * square_x - end_y * square_y, LEAST_ROOT * LEAST_ROOT));
    eight_doubles sag = (bend_x * square_x + bend_y * square_y) / (1 + rest);
    const eight_doubles steeper = chosen(rest > LEAST_ROOT, sag / (2 * rest * (1 + rest)), even(0));
    eight_doubles slope_x = bend_x / (1 + rest) + steeper * end_x, slope_y = bend_y / (1 + rest) + steeper * end_y;
    for (int64_t k = 0; k < terms; k++) {
        const double skew = section[2 + k], power = (double)(k + 1);
        const eight_doubles square = (1 - skew) * square_x + (1 + skew) * square_y;
        eight_doubles raised = even(shape[3 + k]);
        for (int64_t j = 0; j < k; j++) raised *= square;
        sag += raised * square;
        slope_x += power * (1 - skew) * raised, slope_y += power * (1 + skew) * raised;
    }
    return (relief){sag, 2 * slope_x * x, 2 * slope_y * y};
}

/* Of a profile, whose sag and slope are given, turned about an axis parallel to it; by_x is across the profile. */
static relief toroid(double bend, eight_doubles profile, eight_doubles slope, eight_doubles across)
{
    const eight_doubles there = bend / (1 - bend * profile), share = there * across;
    const eight_doubles rest = root(at_least(1 - share * share, LEAST_ROOT * LEAST_ROOT));
    const eight_doubles steeper = chosen(rest > LEAST_ROOT, 1 / rest, 2 / (1 + rest));
    return (relief){profile + share * across / (1 + rest), share * steeper, slope * steeper};
}

static APART relief of_two_sections(const lf_system *s, int64_t n, eight_doubles x, eight_doubles y)
{
    const double *shape = shape_of(s, n), *section = s->sections + n * (2 + s->even_terms);
    const int64_t terms = s->even_terms;
    if (kind_of(s, n) == LF_BICONIC) return biconic(shape, section, terms, x, y);
    if (kind_of(s, n) == LF_TOROID_Y) {
        const relief along_y = biconic(shape, section, terms, even(0), y);
        return toroid(section[0], along_y.sag, along_y.by_y, x);
    }
    const relief along_x = biconic(shape, section, terms, x, even(0));
    const relief turned = toroid(shape[0], along_x.sag, along_x.by_x, y);
    return (relief){turned.sag, turned.by_y, turned.by_x};
}

INLINE relief relief_of(const lf_system *s, int64_t n, eight_doubles x, eight_doubles y)
{
    if (kind_of(s, n) != LF_REVOLUTION) return of_two_sections(s, n, x, y);
    eight_doubles sag, slope;
    sag_and_slope(s, n, x * x + y * y, &sag, &slope);
    return (relief){sag, 2 * slope * x, 2 * slope * y};
}

/* Sag, and its derivative along a ray. */
INLINE void sag_along(const lf_system *s, int64_t n, int of_revolution, eight_doubles x, eight_doubles y, triple along,
                      eight_doubles *sag, eight_doubles *rise)
{
    if (of_revolution) {
        eight_doubles slope;
        sag_and_slope(s, n, x * x + y * y, sag, &slope);
        *rise = 2 * slope * (x * along.x + y * along.y);
        return;
    }
    const relief here = of_two_sections(s, n, x, y);
    *sag = here.sag;
    *rise = here.by_x * along.x + here.by_y * along.y;
}

/* A matrix, or its transpose, times a vector. */
INLINE triple tilted(const double *m, int64_t row, int64_t column, triple a)
{
    return (triple){m[0] * a.x + m[column] * a.y + m[2 * column] * a.z,
                    m[row] * a.x + m[row + column] * a.y + m[row + 2 * column] * a.z,
                    m[2 * row] * a.x + m[2 * row + column] * a.y + m[2 * row + 2 * column] * a.z};
}
/* Into the frame of a surface, or of the image plane, from its place on the axis; and back. */
static void enter(const lf_system *s, int64_t n, ray *r)
{
    if (!s->poses) return;
    const double *offset = s->poses + 12 * n;
    const triple from = {r->position.x - offset[0], r->position.y - offset[1], r->position.z - offset[2]};
    r->position = tilted(offset + 3, 1, 3, from);
    r->direction = tilted(offset + 3, 1, 3, r->direction);
}
static void leave(const lf_system *s, int64_t n, ray *r)
{
    if (!s->poses) return;
    const double *offset = s->poses + 12 * n;
    const triple from = tilted(offset + 3, 3, 1, r->position);
    r->position = (triple){from.x + offset[0], from.y + offset[1], from.z + offset[2]};
    r->direction = tilted(offset + 3, 3, 1, r->direction);
}

/* Distances from the vertex plane, by Newton's method; NaN without convergence. */
INLINE eight_doubles newton(const lf_system *s, int64_t n, int of_revolution, eight_doubles x, eight_doubles y, triple along)
{
    eight_doubles distance = even(0), last = even(0), sag, rise;
    eight_longs active = distance == distance;
    for (int step = 0; step < NEWTON_STEPS && any(active); step++) {
        sag_along(s, n, of_revolution, x + distance * along.x, y + distance * along.y, along, &sag, &rise);
        const eight_doubles change = (sag - distance * along.z) / (rise - along.z);
        distance = chosen(active, distance - change, distance);
        last = chosen(active, size(change), last);
        active &= last > CONVERGED_MM;
    }
    return chosen(last < GOOD_MM, distance, even(__builtin_nan("")));
}
static eight_doubles distance_to_asphere(const lf_system *s, int64_t n, eight_doubles x, eight_doubles y, triple along)
{
    return newton(s, n, 1, x, y, along);
}
static APART eight_doubles distance_to_two_sections(const lf_system *s, int64_t n, eight_doubles x, eight_doubles y, triple along)
{
    return newton(s, n, 0, x, y, along);
}

static void refract(const lf_system *s, int64_t n, ray *r, double before, double behind)
{
    const double *shape = shape_of(s, n), curvature = shape[0], ratio = before / behind;
    const triple at = r->position;
    triple normal;
    if (is_conic(s, n)) {
        normal = (triple){-curvature * at.x, -curvature * at.y, 1 - curvature * (1 + shape[1]) * at.z};
    } else {
        const relief here = relief_of(s, n, at.x, at.y);
        normal = (triple){-here.by_x, -here.by_y, even(1)};
    }
    const eight_doubles length = root(product(normal, normal));
    normal = (triple){normal.x / length, normal.y / length, normal.z / length};
    const eight_doubles cosine = product(r->direction, normal);
    const eight_doubles after = signed_as(root(1 - ratio * ratio * (1 - cosine * cosine)), cosine);
    r->direction = moved(times(even(ratio), r->direction), after - ratio * cosine, normal);
}

/* To a surface, in its own frame, and through it. */
static void pass(const lf_system *s, int64_t n, ray *r, double before, double behind)
{
    const double *shape = shape_of(s, n), curvature = shape[0];
    const triple along = r->direction;
    const eight_doubles to_plane = -r->position.z / along.z;
    const eight_doubles x = r->position.x + to_plane * along.x, y = r->position.y + to_plane * along.y;
    eight_doubles distance;
    if (is_conic(s, n)) {
        const eight_doubles b = along.z - curvature * (x * along.x + y * along.y), square = curvature * (x * x + y * y);
        const eight_doubles under = b * b - curvature * (1 + shape[1] * (along.z * along.z)) * square;
        distance = to_plane + square / (b + signed_as(root(under), along.z));
    } else if (kind_of(s, n) == LF_REVOLUTION) {
        distance = to_plane + distance_to_asphere(s, n, x, y, along);
    } else {
        distance = to_plane + distance_to_two_sections(s, n, x, y, along);
    }
    r->position = moved(r->position, distance, along);
    r->path += before * distance;
    refract(s, n, r, before, behind);
}

static ray started(const lf_system *s, eight_doubles x, eight_doubles y, eight_doubles slope_x, eight_doubles slope_y)
{
    const eight_doubles length = root(1 + slope_x * slope_x + slope_y * slope_y), zero = even(0);
    ray r = {{x, y, relief_of(s, s->stop, x, y).sag}, {zero, zero, zero}, zero};
    leave(s, s->stop, &r);
    return (ray){r.position, {slope_x / length, slope_y / length, 1 / length}, zero};
}

INLINE void note(double *squares, int64_t step, int64_t n, int64_t count, triple at)
{
    if (squares) stored(squares + n * step, count, at.x * at.x + at.y * at.y);
}

/* By parts, because compilers for ARM copy all of it by memcpy, which the library does not have. */
INLINE ray copy_of(const ray *r) { return (ray){r->position, r->direction, r->path}; }

/* From the stop back to the first surface; squared heights are written if requested. */
static ray traced_back(const lf_system *s, const ray *from, double *squares, int64_t step, int64_t count)
{
    ray r = copy_of(from);
    r.direction = times(even(-1), r.direction);
    for (int64_t n = s->stop - 1; n >= 0; n--) {
        r.position.z += shape_of(s, n)[2];
        enter(s, n, &r);
        pass(s, n, &r, s->indices[n + 1], s->indices[n]);
        note(squares, step, n, count, r.position);
        leave(s, n, &r);
    }
    r.direction = times(even(-1), r.direction);
    return r;
}

/* From the stop, before refraction there, to the image plane. */
static ray traced_on(const lf_system *s, const ray *from, double *squares, int64_t step, int64_t count)
{
    ray r = copy_of(from);
    enter(s, s->stop, &r);
    note(squares, step, s->stop, count, r.position);
    refract(s, s->stop, &r, s->indices[s->stop], s->indices[s->stop + 1]);
    leave(s, s->stop, &r);
    for (int64_t n = s->stop + 1; n < s->surfaces; n++) {
        r.position.z -= shape_of(s, n - 1)[2];
        enter(s, n, &r);
        pass(s, n, &r, s->indices[n], s->indices[n + 1]);
        note(squares, step, n, count, r.position);
        leave(s, n, &r);
    }
    r.position.z -= shape_of(s, s->surfaces - 1)[2];
    enter(s, s->surfaces, &r);
    const eight_doubles to_image = -r.position.z / r.direction.z;
    r.position = moved(r.position, to_image, r.direction);
    r.path += s->indices[s->surfaces] * to_image;
    return r;
}

INLINE void stored_triple(double *to, int64_t step, int64_t count, triple values)
{
    stored(to, count, values.x), stored(to + step, count, values.y), stored(to + 2 * step, count, values.z);
}

lf_trace_loop OF_VARIANT(lf_trace);
int OF_VARIANT(lf_trace)(const lf_system *s, const double *rays, int64_t rays_count, double *out)
{
    for (int64_t first = 0; first < rays_count; first += 8) {
        const int64_t count = rays_count - first;
        const double *in = rays + first;
        double *to = out + first, *squares = to + 13 * rays_count;
        const ray on_stop = started(s, loaded(in, count), loaded(in + rays_count, count),
                                    loaded(in + 2 * rays_count, count), loaded(in + 3 * rays_count, count));
        const ray back = traced_back(s, &on_stop, squares, rays_count, count);
        const ray on = traced_on(s, &on_stop, squares, rays_count, count);
        stored_triple(to, rays_count, count, back.position);
        stored_triple(to + 3 * rays_count, rays_count, count, back.direction);
        stored_triple(to + 6 * rays_count, rays_count, count, on.position);
        stored_triple(to + 9 * rays_count, rays_count, count, on.direction);
        stored(to + 12 * rays_count, count, back.path + on.path);
    }
    return 0;
}

typedef struct { eight_doubles x, y; } pair;

/* Errors of rays at their targets. */
static pair missed(const lf_system *s, const lf_targets *t, pair target, eight_doubles x, eight_doubles y, pair slope)
{
    const ray on_stop = started(s, x, y, slope.x, slope.y);
    if (t->kind == LF_IMAGE_HEIGHT) {
        const ray on = traced_on(s, &on_stop, 0, 0, 0);
        return (pair){on.position.x / t->scale, (on.position.y - target.x) / t->scale};
    }
    const ray back = traced_back(s, &on_stop, 0, 0, 0);
    if (t->kind == LF_ANGLE)
        return (pair){back.direction.x, back.direction.y * target.x - back.direction.z * target.y};
    const eight_doubles way = (t->scale + back.position.z) / back.direction.z;
    return (pair){(back.position.x - way * back.direction.x) / -t->scale,
                  (back.position.y - way * back.direction.y - target.x) / -t->scale};
}

typedef struct { eight_doubles slope, by_slope_x, by_slope_y, by_x, by_y; } chief; /* ray, and derivatives of its error */

static APART chief chief_rays(const lf_system *s, const lf_targets *t, pair target, eight_doubles guess)
{
    const eight_doubles zero = even(0);
    eight_doubles slope = guess;
    for (int n = 0; n < CHIEF_STEPS; n++) {
        const eight_doubles here = missed(s, t, target, zero, zero, (pair){zero, slope}).y;
        const eight_doubles ahead = missed(s, t, target, zero, zero, (pair){zero, slope + SLOPE_STEP}).y;
        slope -= here * SLOPE_STEP / (ahead - here);
    }
    const pair middle = missed(s, t, target, zero, zero, (pair){zero, slope});
    const eight_doubles step = even(t->step);
    return (chief){slope,
                   (missed(s, t, target, zero, zero, (pair){even(SLOPE_STEP), slope}).x - middle.x) / SLOPE_STEP,
                   (missed(s, t, target, zero, zero, (pair){zero, slope + SLOPE_STEP}).y - middle.y) / SLOPE_STEP,
                   (missed(s, t, target, step, zero, (pair){zero, slope}).x - middle.x) / t->step,
                   (missed(s, t, target, zero, step, (pair){zero, slope}).y - middle.y) / t->step};
}

INLINE eight_doubles error_of(pair miss)
{
    const eight_doubles x = size(miss.x), y = size(miss.y);
    return chosen((x > y) | (x != x), x, y); /* NaN if either is */
}

/* Broyden's method; returns the error. */
static APART eight_doubles searched(const lf_system *s, const lf_targets *t, pair target, eight_doubles x, eight_doubles y,
                              pair *slope, eight_doubles by_slope_x, eight_doubles by_slope_y)
{
    pair miss = missed(s, t, target, x, y, *slope);
    eight_doubles error = error_of(miss), xx = 1 / by_slope_x, yy = 1 / by_slope_y, xy = even(0), yx = even(0);
    eight_longs active = error > CONVERGED;
    for (int n = 0; n < STEPS && any(active); n++, active &= error > CONVERGED) {
        pair step = {-(xx * miss.x + xy * miss.y), -(yx * miss.x + yy * miss.y)};
        const eight_doubles part = LONGEST_STEP / at_least(root(step.x * step.x + step.y * step.y), 1e-30);
        const eight_doubles shorter = chosen(part > 1, even(1), part);
        step.x *= shorter, step.y *= shorter;
        const pair next = {slope->x + step.x, slope->y + step.y}, then = missed(s, t, target, x, y, next);
        const pair rise = {then.x - miss.x, then.y - miss.y};
        const pair change = {xx * rise.x + xy * rise.y, yx * rise.x + yy * rise.y};
        const eight_doubles along = step.x * change.x + step.y * change.y;
        const eight_doubles per = chosen(size(along) < 1e-300, even(0), 1 / along);
        const pair gain = {(step.x - change.x) * per, (step.y - change.y) * per};
        const pair row = {step.x * xx + step.y * yx, step.x * xy + step.y * yy};
        xx += gain.x * row.x, xy += gain.x * row.y, yx += gain.y * row.x, yy += gain.y * row.y;
        miss = then;
        slope->x = chosen(active, next.x, slope->x), slope->y = chosen(active, next.y, slope->y);
        error = chosen(active, error_of(then), error);
    }
    return error;
}

/* Searches the rays of a field through all points of the stop, from guesses that are linear in these. */
static APART void aimed(const lf_system *s, const lf_targets *t, int64_t field, const chief *all, int lane, double *out)
{
    const int64_t plane = t->fields * t->rays;
    const pair target = {even(t->targets[field]), even(t->targets[t->fields + field])};
    const double slope = all->slope[lane], by_slope_x = all->by_slope_x[lane], by_slope_y = all->by_slope_y[lane];
    for (int64_t first = 0; first < t->rays; first += 8) {
        const int64_t count = t->rays - first;
        const eight_doubles x = loaded(t->x + first, count), y = loaded(t->y + first, count);
        pair found = {-x * all->by_x[lane] / by_slope_x, slope - y * all->by_y[lane] / by_slope_y};
        double *to = out + field * t->rays + first;
        const eight_doubles error = searched(s, t, target, x, y, &found, even(by_slope_x), even(by_slope_y));
        stored(to, count, found.x), stored(to + plane, count, found.y), stored(to + 2 * plane, count, error);
    }
}

lf_aim_loop OF_VARIANT(lf_aim);
int OF_VARIANT(lf_aim)(const lf_system *s, const lf_targets *t, double *out)
{
    for (int64_t first = 0; first < t->fields; first += 8) {
        const int64_t count = t->fields - first;
        const pair target = {loaded(t->targets + first, count), loaded(t->targets + t->fields + first, count)};
        const chief all = chief_rays(s, t, target, loaded(t->guess + first, count));
        for (int lane = 0; lane < 8 && lane < count; lane++) aimed(s, t, first + lane, &all, lane, out);
    }
    return 0;
}
