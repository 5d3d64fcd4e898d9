/* Lensfield's inner loops in C, called from Python by ctypes.

   Sizes and strides are int64 and count elements, not bytes. Nothing here allocates, keeps or calls anything: so any
   number of threads may call it at once, and the library needs no libc, no libm and no Python. Every loop gives 0, or
   says which of its arguments cannot be.

   Each loop is compiled once for each instruction set, a *variant*, from the same lines of C and without fused
   multiply-adds: all variants, compilers and machines give the same bits.

   A function keeps less than 4 KB on the stack: Windows gives more only to those who ask its run-time library.

   How a loop is added: NAME.c here, with a function OF_VARIANT(lf_NAME) of a type that is declared below; that type's
   line in `variant`, the checks of its sizes and its call in kernels.c; NAME in LOOPS of build.py; its Python face in
   NAME.py; its plain form in double in tests/engine/kernels/driver.c. LF_ABI goes up whenever a declaration changes. */
#ifndef LENSFIELD_KERNELS_H
#define LENSFIELD_KERNELS_H
#include <stdint.h>

#define LF_ABI 5

enum { LF_OUTSIDE = 1, LF_BAD_SIZE = 2 };

#if defined(_WIN32)
#define LF_API __declspec(dllexport)
#else
#define LF_API __attribute__((visibility("default")))
#endif

typedef struct { /* a stack of planes; the pixels of a row lie side by side */
    float *values;
    int64_t planes, rows, columns;
    int64_t plane_step, row_step;
} lf_picture;

/* spreading */

#define LF_LONGEST 8 /* the largest piece of a row of taps, in eights */
#define LF_PORTION 64 /* eights of taps that go together: 16 KB of four PSFs and their mixtures, which any cache holds */
#define LF_SLACK 16  /* zeros before and behind the taps of a table; room behind each row that is spread onto */

typedef struct { /* where among the heights and azimuths of a table the pixels of a picture lie */
    double centre_row, centre_column; /* of the axis */
    double samples_per_px;
    const double *paraxial;  /* (samples + 1): paraxial height, over the distance from the axis */
    const int32_t *interval; /* (samples + 1): the last of the heights that is no larger; no two are passed in a step */
    const double *height;    /* (heights): those of the table */
    int64_t samples, heights;
    int64_t azimuths, quarter_steps; /* clockwise from the right, both ends included; steps in a quarter turn */
} lf_places;

typedef struct {         /* PSFs, in pieces: see spreading.c */
    const float *taps;   /* from begin[interval]: (2 heights, azimuth, length[interval]) */
    int64_t size, side;  /* of all taps; of the square of pixels that PSFs lie in */
    int64_t intervals;   /* between two heights */
    const int64_t *begin, *length, *first_piece; /* (interval) */
    const int64_t *counts;       /* (interval, LF_LONGEST + 1): how many pieces have 0, 1 .. eights of taps */
    const int64_t *row, *column; /* (piece): its first tap in the square */
    int64_t pieces;
} lf_table;

typedef struct { /* which square sections of a picture to spread */
    const uint8_t *lit; /* (section row, section column) */
    int64_t rows, columns, size_px;
} lf_sections;

typedef int lf_spread_loop(const lf_places *, const lf_table *, const lf_picture *light, const lf_sections *,
                           int64_t first_row, int64_t end_row, const lf_picture *out, void *work);

/* footprints */

#define LF_LARGEST_FOOTPRINT 16 /* pixels; where the lens squeezes the picture more, the middle stands for it */

typedef struct { /* the lens's geometry over the distance from the axis */
    double centre_row, centre_column, samples_per_px;
    const double *curves; /* (samples + 1, 3): ideal per real distance, the slope of that, and a factor on light */
    int64_t samples;
    double last_px;       /* the distance beyond which all is black */
} lf_geometry;

typedef struct { /* a capture, as the planes of a folded picture see it: some of its rows and columns run backwards */
    const float *first[4];        /* (plane): where the first row and column begin */
    int64_t row_step[4], step[4]; /* (plane): to the next row, to the next column */
    int64_t planes, rows, columns;
    double centre_row, centre_column; /* of the axis, in all planes */
} lf_capture;

typedef int lf_footprints_loop(const lf_geometry *, const lf_capture *, int64_t first_row, int64_t end_row,
                               const lf_picture *out);

/* turning */

typedef struct { /* the light of PSFs in small squares */
    const double *v_px, *u_px; /* (sample): where they lie, outwards and along the tangent */
    const double *energy;      /* (sample, height) */
    int64_t count, heights;    /* heights: a multiple of 8 */
    double size_px;
} lf_samples;

typedef int lf_turn_loop(const lf_samples *, double cosine, double sine, int64_t side, double *out);

/* waves */

typedef struct { /* a wavefront over an even grid of direction cosines, between -1 and 1 up to its rim */
    const double *across; /* (columns): 2 x^2 - 1 */
    const double *up;     /* (rows): y */
    const double *path;   /* (row, path_terms): Chebyshev's coefficients over `across`, in waves */
    const float *edges;   /* (row, 1 + limits, edge_terms): of the density's logarithm; of what passes up to 1 */
    int64_t rows, columns, path_terms, edge_terms, limits; /* columns: a multiple of 8 */
    float least, most;    /* logarithms of the density; the light is in shares of the most */
} lf_wavefront;

typedef int lf_waves_loop(const lf_wavefront *, const lf_picture *out, double *light, float *work);

/* cast */

#define LF_TOGETHER 6  /* wavelengths at most */
#define LF_SEQUENCES 8 /* of rays: of the pixels of a tile's two rows and four columns each has another one */

typedef struct {         /* a part of the scene that nothing of it hides, as a pinhole sees it; cut out of a capture */
    lf_picture light;    /* (wavelength): premultiplied by alpha; at least 2 x 2 pixels */
    const float *alpha;  /* with the same steps */
    const float *depth;  /* (row, column, 2): inverse depth, and the share of focus there; below 0 where nothing is near */
    float axis_row, axis_column;      /* of the axis, in this layer's pixels */
    float top, bottom, left, right;   /* beyond which there is nothing; infinite where the last pixels go on */
} lf_layer;

typedef struct {          /* how a tile's rays find a layer */
    float inverse_depth, share; /* where the search begins */
    int32_t steps;        /* of it; below 0 where they cannot meet the layer */
    int32_t focused;      /* whether something there may be in focus */
    int32_t opaque;       /* whether it covers all of what they can meet */
} lf_meeting;

typedef struct {
    const float *rays;    /* (height, LF_SEQUENCES, eight of rays, 2 + 6 wavelengths, 8): their place of the stop, tangential and
                             outwards; outwards and tangential, where they go at infinity and how that moves with the inverse
                             depth, both in pixels; what is positive where they pass; their light */
    int64_t heights, eights, wavelengths;
    double centre_row, centre_column, heights_per_px; /* of the axis on the sensor */
    float per_focal;      /* one over a fisheye capture's focal length in pixels; 0 of a plane one */
    const float *normals; /* (blade, 2): of an iris */
    int64_t blades;
    float blade_margin, blade_bend, blade_slope; /* a ray passes where margin - bend r^2 - slope (place . normal) > 0 */
    const lf_layer *layer; /* the nearest first */
    int64_t layers;
    float faint[LF_TOGETHER]; /* (wavelength): radiance that counts for nothing beside what is seen */
    const lf_meeting *meetings; /* (tile, layer) */
    const int64_t *tile_eights; /* (tile): rays, in eights */
    int64_t tile_rows, tile_columns, tile_px;
} lf_cast_of;

typedef int lf_cast_loop(const lf_cast_of *, int64_t first_tile, int64_t end_tile, const lf_picture *blurred,
                         const lf_picture *clear, float *work);

/* what the library gives */

LF_API int lf_abi(void);
LF_API const char *lf_sources(void);    /* the digest of the sources that it was made from */
LF_API const char *lf_variant(int n);   /* a variant's name, the simplest being 0; NULL after the last */
LF_API int lf_runs_here(int variant);   /* whether this processor, and its system, can run it: ask before using it */

LF_API int64_t lf_spread_work(int64_t pieces, int64_t columns); /* bytes that lf_spread works in; 0 for bad sizes */
LF_API int lf_spread(int variant, const lf_places *, const lf_table *, const lf_picture *light, const lf_sections *,
                     int64_t first_row, int64_t end_row, const lf_picture *out, void *work);
LF_API int lf_footprints(int variant, const lf_geometry *, const lf_capture *, int64_t first_row, int64_t end_row,
                         const lf_picture *out);
LF_API int lf_turn(int variant, const lf_samples *, double cosine, double sine, int64_t side, double *out);
LF_API int lf_waves(int variant, const lf_wavefront *, const lf_picture *out, double *light, float *work);
LF_API int lf_cast(int variant, const lf_cast_of *, int64_t first_tile, int64_t end_tile, const lf_picture *blurred,
                   const lf_picture *clear, float *work); /* work: 32 floats for each pixel of a tile and wavelength */
#endif
