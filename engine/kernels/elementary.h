/* Elementary functions of eight floats, with the same bits in all variants. */
#ifndef LENSFIELD_ELEMENTARY_H
#define LENSFIELD_ELEMENTARY_H
#include "variant.h"

typedef int32_t eight_ints __attribute__((vector_size(32), aligned(4), may_alias));

#define WHOLE_SINGLE 12582912.0f /* adding and subtracting it rounds a float below 2^22 to an integer */

INLINE eight_floats chosen(eight_ints mask, eight_floats yes, eight_floats no)
{
    return (eight_floats)(((eight_ints)yes & mask) | ((eight_ints)no & ~mask));
}
INLINE eight_floats larger(eight_floats a, eight_floats b) { return chosen(a > b, a, b); }
INLINE eight_floats smaller(eight_floats a, eight_floats b) { return chosen(a < b, a, b); }

INLINE eight_floats rounded(eight_floats a) { return (a + WHOLE_SINGLE) - WHOLE_SINGLE; }

INLINE eight_floats square_root(eight_floats a)
{
    for (int k = 0; k < 8; k++) a[k] = __builtin_sqrtf(a[k]);
    return a;
}

/* The natural logarithm of positive numbers to 1e-7, by the polynomial of Cephes' logf. */
INLINE eight_floats logarithm(eight_floats a)
{
    const eight_ints bits = (eight_ints)a, twos = (bits - 0x3f3504f3) >> 23; /* of a / sqrt(1/2) */
    const eight_floats x = (eight_floats)(bits - (twos << 23)) - 1, square = x * x;
    const eight_floats power = __builtin_convertvector(twos, eight_floats);
    const eight_floats series = 3.3333331174e-1f + x * (-2.4999993993e-1f + x * (2.0000714765e-1f + x * (
                                -1.6668057665e-1f + x * (1.4249322787e-1f + x * (-1.2420140846e-1f + x * (
                                1.1676998740e-1f + x * (-1.1514610310e-1f + x * 7.0376836292e-2f)))))));
    return power * 0.693359375f + (x + (x * square * series - 0.5f * square - power * 2.12194440e-4f));
}

/* Cosine and minus sine of waves between -1/2 and 1/2, by Taylor series of half the angle to 2e-7. */
INLINE void turned(eight_floats waves, eight_floats *cosine, eight_floats *minus_sine)
{
    const eight_floats x = waves * 3.14159265f, square = x * x;
    const eight_floats sine = x * (1 + square * (-1.66666667e-1f + square * (8.33333333e-3f + square * (
                              -1.98412698e-4f + square * (2.75573192e-6f + square * -2.50521084e-8f)))));
    const eight_floats half = 1 + square * (-0.5f + square * (4.16666667e-2f + square * (-1.38888889e-3f + square * (
                              2.48015873e-5f + square * (-2.75573192e-7f + square * 2.08767570e-9f)))));
    *cosine = 1 - 2 * sine * sine;
    *minus_sine = -2 * sine * half;
}
#endif
