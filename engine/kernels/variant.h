/* Common definitions for all loops. They require the name of the variant to compile, VARIANT, and its number of floats
   in a vector, LANES. */
#ifndef LENSFIELD_VARIANT_H
#define LENSFIELD_VARIANT_H
#include "kernels.h"

#define JOINED_(a, b) a##_##b
#define JOINED(a, b) JOINED_(a, b)
#define OF_VARIANT(name) JOINED(name, VARIANT)

/* Vectors at any address of a float or double. */
typedef float floats __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
typedef float eight_floats __attribute__((vector_size(32), aligned(4), may_alias));
typedef double doubles __attribute__((vector_size(4 * LANES), aligned(8), may_alias));
typedef double eight_doubles __attribute__((vector_size(64), aligned(8), may_alias));
typedef int64_t eight_longs __attribute__((vector_size(64), aligned(8), may_alias));

#define INLINE static inline __attribute__((always_inline)) /* propagates the caller's constants */
#endif
