/* Spots: the light of a bundle of rays in the squares of a window, as tubes between neighbouring rays.

   Diffraction at the edge of the aperture is included as a deflection of the rays near it: see engine/bake/spots.py. */
#include "variant.h"

#define UNDEFLECTED 8 /* distance from the edge beyond which rays are deflected by less than 1/8 of a sample */
#define NARROW 0.25   /* samples: least range of deflections that one box represents, and */
#define WIDER 1.25    /* the ratio of the largest to the smallest of them, if that is wider */
#define PER_SAMPLE 1.5 /* parts of a cell along each side, for each sample that it covers, up to the bundle's limit */
#define SMALLEST 0.01 /* samples: least side of a box */

/* A quantity in the middle of a part of a cell, and its change across the part. */
typedef struct { double value, along, around; } quantity;

INLINE double larger(double a, double b) { return a > b ? a : b; }
INLINE double smaller(double a, double b) { return a < b ? a : b; }
INLINE double size(double a) { return a < 0 ? -a : a; }

INLINE quantity in_part(const double *corner, int64_t azimuths, double r, double a, double part)
{
    const double here = corner[0], next = corner[1], out = corner[azimuths], last = corner[azimuths + 1];
    const double twist = here - next - out + last;
    return (quantity){here + r * (out - here) + a * (next - here) + r * a * twist,
                      (out - here + a * twist) * part, (next - here + r * twist) * part};
}

/* Adds the light of a box around (x, y) to the samples that it covers, by area. */
static void add_box(double *out, int64_t side, double x, double y, double width, double height, double light)
{
    width = larger(width, SMALLEST), height = larger(height, SMALLEST);
    const double left = x - width / 2, right = x + width / 2, top = y - height / 2, bottom = y + height / 2;
    const double end = (double)side;
    if (!(right > 0 && left < end && bottom > 0 && top < end)) return; /* NaN too */
    const int64_t first_row = top > 0 ? (int64_t)top : 0, first_column = left > 0 ? (int64_t)left : 0;
    const double per_area = light / (width * height);
    for (int64_t row = first_row; row < side && (double)row < bottom; row++) {
        const double in_row = per_area * (smaller(bottom, (double)(row + 1)) - larger(top, (double)row));
        for (int64_t column = first_column; column < side && (double)column < right; column++)
            out[row * side + column] += in_row * (smaller(right, (double)(column + 1)) - larger(left, (double)column));
    }
}

/* Adds the light of a part of a cell whose rays are between `near` and `far` of the edge, deflected to both sides. */
static void add_deflected(double *out, int64_t side, quantity x, quantity y, double across, double up, double near,
                          double far, double light)
{
    const double width = size(x.along) + size(x.around), height = size(y.along) + size(y.around);
    const double last = 2 * (double)side, per_distance = light / (far - near) / 2;
    double inner = 1 / far;
    for (int more = 1; more && inner < last;) {
        double outer = WIDER * inner + NARROW;
        if (outer * near >= 1) outer = 1 / near, more = 0;
        const double middle = (inner + outer) / 2, extent = outer - inner;
        const double share = per_distance * (1 / inner - 1 / outer);
        const double wide = larger(width, size(across) * extent), high = larger(height, size(up) * extent);
        add_box(out, side, x.value + across * middle, y.value + up * middle, wide, high, share);
        add_box(out, side, x.value - across * middle, y.value - up * middle, wide, high, share);
        inner = outer;
    }
}

/* Adds the light of a part of a cell, and returns it. */
static double add_part(const lf_bundle *b, const double *corner, double r, double a, double part, double *out)
{
    const int64_t plane = b->radii * b->azimuths;
    const quantity edge = in_part(corner + 6 * plane, b->azimuths, r, a, part);
    const double change = size(edge.along) + size(edge.around), inside = 1 - edge.value;
    const double share = smaller(1, 0.5 + inside / larger(change, 1e-12));
    if (!(share > 0)) return 0; /* NaN too */
    quantity q[6]; /* x, y; source x, y; cosine x, y */
    for (int k = 0; k < 6; k++) q[k] = in_part(corner + k * plane, b->azimuths, r, a, part);
    const double lit = share * size(q[2].along * q[3].around - q[2].around * q[3].along);
    if (!(lit > 0)) return 0;
    const double area = q[4].along * q[5].around - q[4].around * q[5].along;
    const double across = edge.along * q[5].around - edge.around * q[5].along;
    const double up = edge.around * q[4].along - edge.along * q[4].around;
    const double slope = __builtin_sqrt(across * across + up * up); /* of the limit, times the area */
    const double per = size(area) / larger(slope, 1e-300), middle = inside * per, half = change * per / 2;
    const double near = larger(middle - half, 0), far = middle + half;
    if (near > UNDEFLECTED || !(far > near))
        add_box(out, b->side, q[0].value, q[1].value, size(q[0].along) + size(q[0].around),
                size(q[1].along) + size(q[1].around), lit);
    else
        add_deflected(out, b->side, q[0], q[1], across / slope, up / slope, near, far, lit);
    return lit;
}

/* Parts of a cell along each side. */
static int64_t parts_of(const lf_bundle *b, const double *corner)
{
    const quantity x = in_part(corner, b->azimuths, 0.5, 0.5, 1);
    const quantity y = in_part(corner + b->radii * b->azimuths, b->azimuths, 0.5, 0.5, 1);
    const double extent = larger(size(x.along) + size(x.around), size(y.along) + size(y.around));
    return PER_SAMPLE * extent < (double)b->parts - 1 ? 1 + (int64_t)(PER_SAMPLE * extent) : b->parts; /* NaN: the limit */
}

lf_spots_loop OF_VARIANT(lf_spots);
/* Adds to out, (row, column) of a square of `side` samples, and returns all light in `light`. */
int OF_VARIANT(lf_spots)(const lf_bundle *b, double *out, double *light)
{
    double all = 0;
    for (int64_t cell = 0; cell + b->azimuths + 1 < b->radii * b->azimuths; cell++) {
        const double *corner = b->corners + cell;
        if (cell % b->azimuths == b->azimuths - 1) continue;
        const int64_t parts = parts_of(b, corner);
        const double part = 1 / (double)parts;
        for (int64_t n = 0; n < parts * parts; n++)
            all += add_part(b, corner, ((double)(n / parts) + 0.5) * part, ((double)(n % parts) + 0.5) * part, part, out);
    }
    *light = all;
    return 0;
}
