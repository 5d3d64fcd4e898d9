/* Surfaces of a lens, and several rays at once: where rays meet a surface, its normal there, and refraction. Lengths are
   in mm, from the vertex of a surface; as in engine/prescription/surfaces.py. */
#ifndef LENSFIELD_SURFACES_H
#define LENSFIELD_SURFACES_H
#include "variant.h"

#define NEWTON_STEPS 50 /* to an asphere */
#define CONVERGED_MM 1e-13
#define GOOD_MM 1e-9
#define LEAST_SQUARE 1e-24 /* mm^2: the slope of a term in r is undefined at the vertex */
#define LEAST_ROOT 1e-6    /* a step may pass beyond the conic's end before it reaches the surface */

/* Rays at once, each with a result that does not depend on the others: as many as doubles in a vector of the processor,
   because gcc compares the numbers of wider vectors one by one. */
#define RAYS (LANES / 2)

#define APART __attribute__((noinline)) /* to keep the stack of each function small */

typedef int64_t longs __attribute__((vector_size(4 * LANES), aligned(8), may_alias));
typedef struct { doubles x, y, z; } triple;
typedef struct { triple position, direction; doubles path; } ray;

INLINE doubles even(double value) { return (doubles){0} + value; }
INLINE doubles chosen(longs mask, doubles yes, doubles no)
{
    return (doubles)(((longs)yes & mask) | ((longs)no & ~mask));
}
INLINE doubles at_least(doubles a, double least) { return chosen(a < least, even(least), a); } /* keeps NaN */
INLINE doubles size(doubles a) { return (doubles)((longs)a & INT64_MAX); }
INLINE doubles signed_as(doubles a, doubles sign)
{
    return (doubles)(((longs)a & INT64_MAX) | ((longs)sign & INT64_MIN));
}
INLINE doubles root(doubles a)
{
    for (int k = 0; k < RAYS; k++) a[k] = __builtin_sqrt(a[k]);
    return a;
}
INLINE int any(longs mask)
{
    int64_t all = 0;
    for (int k = 0; k < RAYS; k++) all |= mask[k];
    return all != 0;
}
INLINE triple moved(triple a, doubles along, triple b)
{
    return (triple){a.x + along * b.x, a.y + along * b.y, a.z + along * b.z};
}
INLINE triple times(doubles a, triple b) { return (triple){a * b.x, a * b.y, a * b.z}; }
INLINE doubles product(triple a, triple b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

/* Values from `from`, the last one for lanes beyond the end. */
INLINE doubles loaded(const double *from, int64_t count)
{
    doubles values;
    for (int k = 0; k < RAYS; k++) values[k] = from[k < count ? k : count - 1];
    return values;
}
INLINE void stored(double *to, int64_t count, doubles values)
{
    for (int k = 0; k < RAYS && k < count; k++) to[k] = values[k];
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
INLINE void sag_and_slope(const lf_system *s, int64_t n, doubles square, doubles *sag, doubles *slope)
{
    const double *shape = shape_of(s, n), *terms = shape + 3, *odd = terms + s->even_terms, curvature = shape[0];
    const doubles rest = root(at_least(1 - (1 + shape[1]) * (curvature * curvature) * square, LEAST_ROOT * LEAST_ROOT));
    doubles powers = even(0), change = even(0);
    for (int64_t k = s->even_terms; k > 0; k--) {
        change = change * square + (double)k * terms[k - 1];
        powers = (powers + terms[k - 1]) * square;
    }
    *sag = curvature * square / (1 + rest) + powers;
    *slope = curvature / (2 * rest) + change;
    if (!s->odd_terms) return;
    const doubles off_axis = at_least(square, LEAST_SQUARE);
    doubles raised = root(off_axis);
    for (int64_t k = 0; k < s->odd_terms; k++, raised *= off_axis) {
        *sag += odd[k] * raised;
        *slope += ((double)k + 0.5) * odd[k] * raised / off_axis;
    }
}

typedef struct { doubles sag, by_x, by_y; } relief; /* sag, and its derivatives */

/* As _biconic and _toroid of engine/prescription/surfaces.py. */
static relief biconic(const double *shape, const double *section, int64_t terms, doubles x, doubles y)
{
    const double bend_x = section[0], bend_y = shape[0];
    const double end_x = (1 + section[1]) * (bend_x * bend_x), end_y = (1 + shape[1]) * (bend_y * bend_y);
    const doubles square_x = x * x, square_y = y * y;
    const doubles rest = root(at_least(1 - end_x * square_x - end_y * square_y, LEAST_ROOT * LEAST_ROOT));
    doubles sag = (bend_x * square_x + bend_y * square_y) / (1 + rest);
    const doubles steeper = chosen(rest > LEAST_ROOT, sag / (2 * rest * (1 + rest)), even(0));
    doubles slope_x = bend_x / (1 + rest) + steeper * end_x, slope_y = bend_y / (1 + rest) + steeper * end_y;
    for (int64_t k = 0; k < terms; k++) {
        const double skew = section[2 + k], power = (double)(k + 1);
        const doubles square = (1 - skew) * square_x + (1 + skew) * square_y;
        doubles raised = even(shape[3 + k]);
        for (int64_t j = 0; j < k; j++) raised *= square;
        sag += raised * square;
        slope_x += power * (1 - skew) * raised, slope_y += power * (1 + skew) * raised;
    }
    return (relief){sag, 2 * slope_x * x, 2 * slope_y * y};
}

/* Of a profile, whose sag and slope are given, turned about an axis parallel to it; by_x is across the profile. */
static relief toroid(double bend, doubles profile, doubles slope, doubles across)
{
    const doubles there = bend / (1 - bend * profile), share = there * across;
    const doubles rest = root(at_least(1 - share * share, LEAST_ROOT * LEAST_ROOT));
    const doubles steeper = chosen(rest > LEAST_ROOT, 1 / rest, 2 / (1 + rest));
    return (relief){profile + share * across / (1 + rest), share * steeper, slope * steeper};
}

static APART relief of_two_sections(const lf_system *s, int64_t n, doubles x, doubles y)
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

INLINE relief relief_of(const lf_system *s, int64_t n, doubles x, doubles y)
{
    if (kind_of(s, n) != LF_REVOLUTION) return of_two_sections(s, n, x, y);
    doubles sag, slope;
    sag_and_slope(s, n, x * x + y * y, &sag, &slope);
    return (relief){sag, 2 * slope * x, 2 * slope * y};
}

/* Sag, and its derivative along a ray. */
INLINE void sag_along(const lf_system *s, int64_t n, int of_revolution, doubles x, doubles y, triple along,
                      doubles *sag, doubles *rise)
{
    if (of_revolution) {
        doubles slope;
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
INLINE doubles newton(const lf_system *s, int64_t n, int of_revolution, doubles x, doubles y, triple along)
{
    doubles distance = even(0), last = even(0), sag, rise;
    longs active = distance == distance;
    for (int step = 0; step < NEWTON_STEPS && any(active); step++) {
        sag_along(s, n, of_revolution, x + distance * along.x, y + distance * along.y, along, &sag, &rise);
        const doubles change = (sag - distance * along.z) / (rise - along.z);
        distance = chosen(active, distance - change, distance);
        last = chosen(active, size(change), last);
        active &= last > CONVERGED_MM;
    }
    return chosen(last < GOOD_MM, distance, even(__builtin_nan("")));
}
static doubles distance_to_asphere(const lf_system *s, int64_t n, doubles x, doubles y, triple along)
{
    return newton(s, n, 1, x, y, along);
}
static APART doubles distance_to_two_sections(const lf_system *s, int64_t n, doubles x, doubles y, triple along)
{
    return newton(s, n, 0, x, y, along);
}

/* The unit normal at a point of a surface, towards the image at the vertex. */
static triple normal_at(const lf_system *s, int64_t n, triple at)
{
    const double *shape = shape_of(s, n), curvature = shape[0];
    triple normal;
    if (is_conic(s, n)) {
        normal = (triple){-curvature * at.x, -curvature * at.y, 1 - curvature * (1 + shape[1]) * at.z};
    } else {
        const relief here = relief_of(s, n, at.x, at.y);
        normal = (triple){-here.by_x, -here.by_y, even(1)};
    }
    const doubles length = root(product(normal, normal));
    return (triple){normal.x / length, normal.y / length, normal.z / length};
}

/* The distance along a ray to a surface, in its own frame. */
static doubles distance_to(const lf_system *s, int64_t n, const ray *r)
{
    const double *shape = shape_of(s, n), curvature = shape[0];
    const triple along = r->direction;
    const doubles to_plane = -r->position.z / along.z;
    const doubles x = r->position.x + to_plane * along.x, y = r->position.y + to_plane * along.y;
    if (is_conic(s, n)) {
        const doubles b = along.z - curvature * (x * along.x + y * along.y), square = curvature * (x * x + y * y);
        const doubles under = b * b - curvature * (1 + shape[1] * (along.z * along.z)) * square;
        return to_plane + square / (b + signed_as(root(under), along.z));
    }
    if (kind_of(s, n) == LF_REVOLUTION) return to_plane + distance_to_asphere(s, n, x, y, along);
    return to_plane + distance_to_two_sections(s, n, x, y, along);
}

/* The direction behind a surface with this normal, by Snell's law: the ratio is of the index in front to the one behind. */
INLINE triple refracted(triple direction, triple normal, doubles cosine, double ratio)
{
    const doubles after = signed_as(root(1 - ratio * ratio * (1 - cosine * cosine)), cosine);
    return moved(times(even(ratio), direction), after - ratio * cosine, normal);
}
#endif
