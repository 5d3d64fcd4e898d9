/* Reading: digital numbers of pixels, from the mean number of electrons that light frees in each.

   Random numbers are those of Threefry2x32-20 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", 2011) at
   the pixel's place on the sensor: they depend neither on the order of the pixels nor on the size of the picture. Philox,
   of the same authors, takes twice the time here, because compilers shuffle the halves of its products of 64 bits. */
#include "elementary.h"

#define FEW_E 32.0f /* mean electrons below which counts come from Poisson's distribution itself */
#define MOST_E 1e30f
#define MOST_COUNTED 128 /* far more than any count whose mean is FEW_E */
#define BETWEEN_LOOKS 4  /* terms that are added before a look whether any more are needed */
#define PARTS (16 / LANES) /* vectors of eight doubles */

enum { DIFFERENCES, NOISE, COUNTS }; /* what random words are for */

typedef uint32_t eight_uints __attribute__((vector_size(32), aligned(4), may_alias));
typedef uint16_t eight_shorts __attribute__((vector_size(16), aligned(2), may_alias));
typedef int64_t longs __attribute__((vector_size(4 * LANES), aligned(8), may_alias));

typedef struct { eight_uints first, second; } words;

INLINE void mix(words *w, int turn)
{
    w->first += w->second;
    w->second = w->first ^ (w->second << turn | w->second >> (32 - turn));
}

INLINE void mix_four(words *w, int one, int two, int three, int four, uint32_t to_first, uint32_t to_second)
{
    mix(w, one), mix(w, two), mix(w, three), mix(w, four);
    w->first += to_first, w->second += to_second;
}

/* Two random words for each of eight pixels. */
INLINE words draw(int64_t key, eight_uints place, uint32_t plane, uint32_t purpose)
{
    const uint32_t a = (uint32_t)key, b = (uint32_t)((uint64_t)key >> 32), c = 0x1BD11BDA ^ a ^ b;
    words w = {place + a, (place ^ place) + (4 * plane + purpose + b)};
    mix_four(&w, 13, 15, 26, 6, b, c + 1);
    mix_four(&w, 17, 29, 16, 24, c, a + 2);
    mix_four(&w, 13, 15, 26, 6, a, b + 3);
    mix_four(&w, 17, 29, 16, 24, b, c + 4);
    mix_four(&w, 13, 15, 26, 6, c, a + 5);
    return w;
}

INLINE int any_of(eight_ints mask)
{
    int any = 0;
    for (int k = 0; k < 8; k++) any |= mask[k];
    return any;
}

/* Two independent normal numbers from two words, by Box and Muller. */
INLINE void normals(words from, eight_floats *one, eight_floats *other)
{
    const eight_floats share = __builtin_convertvector((eight_ints)(from.first >> 1), eight_floats) * 0x1p-31f + 0x1p-32f;
    const eight_floats radius = square_root(-2 * logarithm(share)); /* the share is up to 1 */
    turned(__builtin_convertvector((eight_ints)from.second, eight_floats) * 0x1p-32f, one, other);
    *one *= radius, *other *= radius;
}

/* Electrons counted for a normal number: the inverse of Poisson's distribution, by its asymptotic series. */
INLINE eight_floats many(eight_floats mean_e, eight_floats normal)
{
    const eight_floats deviation = square_root(mean_e), square = normal * normal;
    const eight_floats count = mean_e + deviation * normal + (square + 2) * (1 / 6.0f - normal / (72 * deviation));
    return rounded(count - 0.5f);
}

/* e to a power from -FEW_E to 0. */
INLINE eight_doubles exponential_of_few(eight_doubles power)
{
    const eight_doubles x = power / 64;
    eight_doubles sum = 1 + x / 12;
    for (int n = 11; n > 0; n--) sum = 1 + x * (1 / (double)n) * sum;
    for (int n = 0; n < 6; n++) sum *= sum;
    return sum;
}

/* Electrons counted for each word: the inverse of Poisson's distribution, by its sum, for means below FEW_E. */
static eight_floats few(eight_floats mean_e, eight_uints word)
{
    double means[8], shares[8];
    for (int k = 0; k < 8; k++) means[k] = mean_e[k], shares[k] = ((double)word[k] + 0.5) * 0x1p-32;
    const doubles *mean = (const doubles *)means, *share = (const doubles *)shares;
    doubles term[PARTS], sum[PARTS];
    longs count[PARTS] = {{0}};
    *(eight_doubles *)term = exponential_of_few(-*(const eight_doubles *)means);
    for (int part = 0; part < PARTS; part++) sum[part] = term[part];
    int64_t above_any = 1;
    for (int n = 1; above_any && n < MOST_COUNTED;) {
        for (const int end = n + BETWEEN_LOOKS; n < end; n++) {
            const double per = 1 / (double)n;
            for (int part = 0; part < PARTS; part++) {
                count[part] -= share[part] > sum[part]; /* -1 where true */
                term[part] *= mean[part] * per;
                sum[part] += term[part];
            }
        }
        longs above = {0};
        for (int part = 0; part < PARTS; part++) above |= share[part] > sum[part];
        above_any = 0;
        for (int k = 0; k < LANES / 2; k++) above_any |= above[k];
    }
    eight_floats counted;
    for (int k = 0; k < 8; k++) counted[k] = (float)((const int64_t *)count)[k];
    return counted;
}

/* Mean electrons of pixels whose response is a factor; not-a-number becomes 0. */
INLINE eight_floats mean_of(const lf_pixels *p, eight_floats light_e, eight_floats response)
{
    const eight_floats zero = {0};
    return smaller(larger(light_e * larger(response, zero) + p->dark_e, zero), zero + MOST_E);
}

/* Electrons that are read from eight pixels, with all that is random. */
INLINE eight_floats noisy_e(const lf_pixels *p, eight_floats light_e, eight_uints place, uint32_t plane)
{
    const eight_floats zero = {0};
    eight_floats response, offset, shot, reading;
    normals(draw(p->pixel_key, place, plane, DIFFERENCES), &response, &offset);
    normals(draw(p->noise_key, place, plane, NOISE), &shot, &reading);
    const eight_floats mean_e = mean_of(p, light_e, 1 + p->prnu * response);
    const eight_ints is_few = mean_e < FEW_E;
    eight_floats counted = many(larger(mean_e, zero + FEW_E), shot);
    if (any_of(is_few))
        counted = chosen(is_few, few(smaller(mean_e, zero + FEW_E), draw(p->noise_key, place, plane, COUNTS).first), counted);
    return smaller(counted, zero + p->full_e) + p->dsnu_e * offset + p->noise_e * reading;
}

/* Digital numbers of eight pixels. */
INLINE eight_shorts digital(const lf_pixels *p, eight_floats signal_e)
{
    const eight_floats zero = {0}, dn = larger(signal_e * p->gain_dn_per_e + p->black_dn, zero);
    return __builtin_convertvector(__builtin_convertvector(rounded(smaller(dn, zero + p->white_dn)), eight_ints), eight_shorts);
}

/* Reads a row of pixels. */
INLINE void read_row(const lf_pixels *p, const float *light_e, int64_t columns, int64_t row, uint32_t plane, int noisy, uint16_t *out)
{
    const eight_floats zero = {0};
    for (int64_t x = 0; x < columns; x += 8) {
        const int64_t count = columns - x < 8 ? columns - x : 8;
        const eight_uints place = (uint32_t)(row << 16 | (p->column + x)) + (eight_uints){0, 1, 2, 3, 4, 5, 6, 7};
        eight_floats some_e = zero;
        if (count == 8) some_e = *(const eight_floats *)(light_e + x);
        for (int64_t k = 0; count < 8 && k < count; k++) some_e[k] = light_e[x + k];
        const eight_shorts numbers = digital(p, noisy ? noisy_e(p, some_e, place, plane)
                                                      : smaller(mean_of(p, some_e, zero + 1), zero + p->full_e));
        if (count == 8) *(eight_shorts *)(out + x) = numbers;
        for (int64_t k = 0; count < 8 && k < count; k++) out[x + k] = numbers[k];
    }
}

lf_read_loop OF_VARIANT(lf_read);
/* Writes the rows of `numbers`, (plane, row, column), from first_row up to end_row. */
int OF_VARIANT(lf_read)(const lf_pixels *p, const lf_picture *light_e, int64_t first_row, int64_t end_row, uint16_t *numbers)
{
    for (int64_t q = 0; q < light_e->planes; q++)
        for (int64_t y = first_row; y < end_row; y++) {
            const float *row = light_e->values + q * light_e->plane_step + y * light_e->row_step;
            uint16_t *out = numbers + (q * light_e->rows + y) * light_e->columns;
            if (p->noisy) read_row(p, row, light_e->columns, p->row + y, (uint32_t)q, 1, out);
            else read_row(p, row, light_e->columns, p->row + y, (uint32_t)q, 0, out);
        }
    return 0;
}
