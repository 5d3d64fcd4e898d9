/* Tracing: rays through the surfaces of a lens, from the stop to both sides, and the search for rays that come from an
   object point or go to an image point. Lengths are in mm, from the vertex of a surface; see engine/rays/trace.py and
   engine/rays/aiming.py. */
#include "surfaces.h"

#define CHIEF_STEPS 4
#define SLOPE_STEP 1e-6    /* for derivatives with respect to slope */
#define STEPS 16           /* of Broyden's method */
#define LONGEST_STEP 0.2   /* in slope */
#define CONVERGED 2e-12    /* error at the point */

static void refract(const lf_system *s, int64_t n, ray *r, double before, double behind)
{
    const triple normal = normal_at(s, n, r->position);
    r->direction = refracted(r->direction, normal, product(r->direction, normal), before / behind);
}

/* To a surface, in its own frame, and through it. */
static void pass(const lf_system *s, int64_t n, ray *r, double before, double behind)
{
    const doubles distance = distance_to(s, n, r);
    r->position = moved(r->position, distance, r->direction);
    r->path += before * distance;
    refract(s, n, r, before, behind);
}

static ray started(const lf_system *s, doubles x, doubles y, doubles slope_x, doubles slope_y)
{
    const doubles length = root(1 + slope_x * slope_x + slope_y * slope_y), zero = even(0);
    ray r = {{x, y, relief_of(s, s->stop, x, y).sag}, {zero, zero, zero}, zero};
    leave(s, s->stop, &r);
    return (ray){r.position, {slope_x / length, slope_y / length, 1 / length}, zero};
}

INLINE void note(const lf_system *s, double *squares, int64_t step, int64_t n, int64_t count, triple at)
{
    if (!squares) return;
    stored(squares + n * step, count, at.x * at.x + at.y * at.y);
    if (!s->rectangles || !s->rectangles[n]) return;
    double *to = squares + s->rectangles[n] * step;
    stored(to, count, at.x * at.x), stored(to + step, count, at.y * at.y);
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
        note(s, squares, step, n, count, r.position);
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
    note(s, squares, step, s->stop, count, r.position);
    refract(s, s->stop, &r, s->indices[s->stop], s->indices[s->stop + 1]);
    leave(s, s->stop, &r);
    for (int64_t n = s->stop + 1; n < s->surfaces; n++) {
        r.position.z -= shape_of(s, n - 1)[2];
        enter(s, n, &r);
        pass(s, n, &r, s->indices[n], s->indices[n + 1]);
        note(s, squares, step, n, count, r.position);
        leave(s, n, &r);
    }
    r.position.z -= shape_of(s, s->surfaces - 1)[2];
    enter(s, s->surfaces, &r);
    const doubles to_image = -r.position.z / r.direction.z;
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
    for (int64_t first = 0; first < rays_count; first += RAYS) {
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

typedef struct { doubles x, y; } pair;

/* Errors of rays at their targets. */
static pair missed(const lf_system *s, const lf_targets *t, pair target, doubles x, doubles y, pair slope)
{
    const ray on_stop = started(s, x, y, slope.x, slope.y);
    if (t->kind == LF_IMAGE_HEIGHT) {
        const ray on = traced_on(s, &on_stop, 0, 0, 0);
        return (pair){on.position.x / t->scale, (on.position.y - target.x) / t->scale};
    }
    const ray back = traced_back(s, &on_stop, 0, 0, 0);
    if (t->kind == LF_ANGLE)
        return (pair){back.direction.x, back.direction.y * target.x - back.direction.z * target.y};
    const doubles way = (t->scale + back.position.z) / back.direction.z;
    return (pair){(back.position.x - way * back.direction.x) / -t->scale,
                  (back.position.y - way * back.direction.y - target.x) / -t->scale};
}

typedef struct { doubles slope, by_slope_x, by_slope_y, by_x, by_y; } chief; /* ray, and derivatives of its error */

static APART chief chief_rays(const lf_system *s, const lf_targets *t, pair target, doubles guess)
{
    const doubles zero = even(0);
    doubles slope = guess;
    for (int n = 0; n < CHIEF_STEPS; n++) {
        const doubles here = missed(s, t, target, zero, zero, (pair){zero, slope}).y;
        const doubles ahead = missed(s, t, target, zero, zero, (pair){zero, slope + SLOPE_STEP}).y;
        slope -= here * SLOPE_STEP / (ahead - here);
    }
    const pair middle = missed(s, t, target, zero, zero, (pair){zero, slope});
    const doubles step = even(t->step);
    return (chief){slope,
                   (missed(s, t, target, zero, zero, (pair){even(SLOPE_STEP), slope}).x - middle.x) / SLOPE_STEP,
                   (missed(s, t, target, zero, zero, (pair){zero, slope + SLOPE_STEP}).y - middle.y) / SLOPE_STEP,
                   (missed(s, t, target, step, zero, (pair){zero, slope}).x - middle.x) / t->step,
                   (missed(s, t, target, zero, step, (pair){zero, slope}).y - middle.y) / t->step};
}

INLINE doubles error_of(pair miss)
{
    const doubles x = size(miss.x), y = size(miss.y);
    return chosen((x > y) | (x != x), x, y); /* NaN if either is */
}

/* Broyden's method; returns the error. */
static APART doubles searched(const lf_system *s, const lf_targets *t, pair target, doubles x, doubles y,
                              pair *slope, doubles by_slope_x, doubles by_slope_y)
{
    pair miss = missed(s, t, target, x, y, *slope);
    doubles error = error_of(miss), xx = 1 / by_slope_x, yy = 1 / by_slope_y, xy = even(0), yx = even(0);
    longs active = error > CONVERGED;
    for (int n = 0; n < STEPS && any(active); n++, active &= error > CONVERGED) {
        pair step = {-(xx * miss.x + xy * miss.y), -(yx * miss.x + yy * miss.y)};
        const doubles part = LONGEST_STEP / at_least(root(step.x * step.x + step.y * step.y), 1e-30);
        const doubles shorter = chosen(part > 1, even(1), part);
        step.x *= shorter, step.y *= shorter;
        const pair next = {slope->x + step.x, slope->y + step.y}, then = missed(s, t, target, x, y, next);
        const pair rise = {then.x - miss.x, then.y - miss.y};
        const pair change = {xx * rise.x + xy * rise.y, yx * rise.x + yy * rise.y};
        const doubles along = step.x * change.x + step.y * change.y;
        const doubles per = chosen(size(along) < 1e-300, even(0), 1 / along);
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
    for (int64_t first = 0; first < t->rays; first += RAYS) {
        const int64_t count = t->rays - first;
        const doubles x = loaded(t->x + first, count), y = loaded(t->y + first, count);
        pair found = {-x * all->by_x[lane] / by_slope_x, slope - y * all->by_y[lane] / by_slope_y};
        double *to = out + field * t->rays + first;
        const doubles error = searched(s, t, target, x, y, &found, even(by_slope_x), even(by_slope_y));
        stored(to, count, found.x), stored(to + plane, count, found.y), stored(to + 2 * plane, count, error);
    }
}

lf_aim_loop OF_VARIANT(lf_aim);
int OF_VARIANT(lf_aim)(const lf_system *s, const lf_targets *t, double *out)
{
    for (int64_t first = 0; first < t->fields; first += RAYS) {
        const int64_t count = t->fields - first;
        const pair target = {loaded(t->targets + first, count), loaded(t->targets + t->fields + first, count)};
        const chief all = chief_rays(s, t, target, loaded(t->guess + first, count));
        for (int lane = 0; lane < RAYS && lane < count; lane++) aimed(s, t, first + lane, &all, lane, out);
    }
    return 0;
}
