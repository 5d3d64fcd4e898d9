/* Lensfield's inner loops in C, called from Python by ctypes.

   Sizes and strides are int64 and count elements, not bytes. The functions do not allocate memory, store state or call
   other libraries. They are therefore thread-safe, and the library depends neither on libc nor libm nor Python. Every
   loop returns 0, or an error code for invalid arguments.

   Each loop is compiled once for each instruction set, a *variant*, from the same lines of C and without fused
   multiply-adds: all variants, compilers and machines produce the same bits.

   A function uses less than 4 KB of the stack: on Windows, more requires a call to the run-time library.

   To add a loop: NAME.c here, with a function OF_VARIANT(lf_NAME) of a type that is declared below; that type's line in
   `variant`, the checks of its sizes and its call in kernels.c; NAME in LOOPS of build.py; its Python interface in
   NAME.py; a simple version in double precision in tests/engine/kernels/driver.c. Increment LF_ABI if a declaration
   changes. */
#ifndef LENSFIELD_KERNELS_H
#define LENSFIELD_KERNELS_H
#include <stdint.h>

#define LF_ABI 15

enum { LF_OUTSIDE = 1, LF_BAD_SIZE = 2 };

#if defined(_WIN32)
#define LF_API __declspec(dllexport)
#else
#define LF_API __attribute__((visibility("default")))
#endif

typedef struct { /* a stack of planes; the pixels of a row are contiguous */
    float *values;
    int64_t planes, rows, columns;
    int64_t plane_step, row_step;
} lf_picture;

/* spreading */

#define LF_LONGEST 8 /* the largest piece of a row of taps, in eights */
#define LF_PORTION 64 /* eights of taps in a batch: 16 KB of four PSFs and their mixtures, which fit in any cache */
#define LF_SLACK 16  /* zeros before and after the taps of a table; room after each output row */

typedef struct { /* positions of a picture's pixels among the heights and azimuths of a table; or among the cells of a
                    grid of nodes: each is an interval of the table, with the nodes to its right as the second azimuth */
    double centre_row, centre_column; /* of the axis */
    double samples_per_px;
    const double *paraxial;  /* (samples + 1): paraxial height, over the distance from the axis */
    const int32_t *interval; /* (samples + 1): the last height that is not larger; a step passes at most one height */
    const double *height;    /* (heights): the table's heights */
    int64_t samples, heights;
    int64_t azimuths, quarter_steps; /* clockwise from the right, both ends included; steps in a quarter turn */
    const int32_t *row_cell, *column_cell; /* (row), (column): their sum is a pixel's cell; NULL for heights and azimuths */
    const float *row_on, *column_on; /* fractions on to the nodes below, and to the right */
    int64_t rows, columns;
} lf_places;

typedef struct {         /* PSFs, in pieces: see spreading.c */
    const float *taps;   /* from begin[interval]: (2 heights, azimuth, length[interval]) */
    int64_t size, side;  /* number of all taps; side of the PSFs' square of pixels */
    int64_t intervals;   /* between two heights */
    const int64_t *begin, *length, *first_piece; /* (interval) */
    const int64_t *counts;       /* (interval, LF_LONGEST + 1): number of pieces with 0, 1 .. eights of taps */
    const int64_t *row, *column; /* (piece): its first tap in the square */
    int64_t pieces;
} lf_table;

typedef struct { /* the square sections of a picture to spread */
    const uint8_t *lit; /* (section row, section column) */
    int64_t rows, columns, size_px;
} lf_sections;

typedef int lf_spread_loop(const lf_places *, const lf_table *, const lf_picture *light, const lf_sections *,
                           int64_t first_row, int64_t end_row, const lf_picture *out, void *work);

/* extremes */

typedef struct { /* of the size of the light in square sections of all planes: (section row, section column) */
    float *brightest, *dimmest, *least; /* dimmest: except black pixels, or infinity if all are black */
    float *step; /* the largest step from a pixel to the next one to the right or below */
    int64_t rows, columns, size_px;
} lf_extremes_of;

typedef int lf_extremes_loop(const lf_picture *light, const lf_extremes_of *, int64_t first_row, int64_t end_row);

/* excess */

typedef struct {
    double *sums; /* (plane, section row, section column) */
    int64_t rows, columns, size_px;
} lf_excess_of;

typedef int lf_excess_loop(const lf_picture *light, float level, const lf_excess_of *, int64_t first_row,
                           int64_t end_row);

/* footprints */

#define LF_LARGEST_FOOTPRINT 16 /* pixels; larger footprints are represented by their middle */

typedef struct { /* the lens's geometry over the distance from the axis; or on a mesh over the picture's pixels */
    double centre_row, centre_column, samples_per_px;
    const double *curves; /* (samples + 1, 3): ratio of ideal to real distance, its derivative, and a factor on light */
    int64_t samples;
    double last_px;       /* the distance beyond which the picture is black */
    const double *mesh;   /* (row, column, 6): rows and columns from the axis to the footprint in the capture; its height
                             and width; a factor on light; and a number above 1 where the picture is black; or NULL */
    int64_t mesh_rows, mesh_columns, mesh_step; /* step: in pixels */
} lf_geometry;

typedef struct { /* the planes of a capture, flipped so that rows and columns run away from the axis if there are four */
    const float *values; /* (row, column, plane): the planes of a pixel are averaged together */
    int64_t planes, rows, columns; /* planes: 1 or 4 */
    int64_t row_step;
    double centre_row, centre_column; /* of the axis, in all planes */
} lf_capture;

typedef int lf_footprints_loop(const lf_geometry *, const lf_capture *, int64_t first_row, int64_t end_row,
                               const lf_picture *out);

/* turning */

typedef struct { /* the light of PSFs in small squares */
    const double *v_px, *u_px; /* (sample): positions, outwards and along the tangent */
    const double *energy;      /* (sample, height) */
    int64_t count, heights;    /* heights: a multiple of 8 */
    double size_px;            /* up to 1 */
} lf_samples;

typedef int lf_turn_loop(const lf_samples *, double cosine, double sine, int64_t side, double *out);

/* waves */

typedef struct { /* a wavefront over an even grid of direction cosines, between -1 and 1 up to its rim */
    const double *across; /* (path_terms, columns): Chebyshev's polynomials of x, all of them or the even ones */
    const float *across_edges; /* (edge_terms, columns): in single precision */
    const double *up;     /* (rows): y */
    const double *path;   /* (row, path_terms): Chebyshev's coefficients over `across`, in waves */
    const float *edges;   /* (row, 1 + limits, edge_terms): of the density's logarithm; of limits, which pass up to 1 */
    int64_t rows, columns, path_terms, edge_terms, limits; /* columns: a multiple of 8 */
    int64_t square;       /* the term 2 x^2 - 1 among the path's: 1 of the even ones, 2 of all */
    float least, most;    /* limits of the density's logarithm; the light is relative to the largest density */
} lf_wavefront;

typedef int lf_waves_loop(const lf_wavefront *, const lf_picture *out, double *light, float *work);

/* tracing */

#define LF_REVOLUTION 0 /* kinds of surfaces */
#define LF_BICONIC 1
#define LF_TOROID_Y 2   /* with its profile along y */
#define LF_TOROID_X 3

typedef struct { /* a lens at a wavelength, in mm */
    const double *shapes;  /* (surface, 3 + even_terms + odd_terms): curvature; conic constant; distance to the next
                              surface or the image plane; coefficients of r^2, r^4 ... and of r, r^3 ... */
    const double *indices; /* (surfaces + 1): refractive index in front of each surface and behind the last */
    int64_t surfaces, stop, even_terms, odd_terms;
    const int64_t *kinds;   /* (surface); 0 if all are of revolution, and so is: */
    const double *sections; /* (surface, 2 + even_terms): curvature and conic constant along x, with those in shapes along
                               y; p of each term, with (1 - p) x^2 + (1 + p) y^2 for r^2 */
    const double *poses;    /* (surface + 1, 12): offset, and the matrix of the tilt by rows, of the surfaces and of the
                               image plane; 0 if all are on the axis */
    const int64_t *rectangles; /* (surface): the row of x^2 among the traced squares, in front of y^2; 0: no rectangular
                                  aperture, and for all of them */
} lf_system;

typedef int lf_trace_loop(const lf_system *, const double *rays, int64_t count, double *out);

#define LF_ANGLE 0         /* targets: the cosine and the sine of the angle of a beam from infinity */
#define LF_OBJECT_HEIGHT 1 /* targets: the height of an object point, and 0 */
#define LF_IMAGE_HEIGHT 2  /* targets: the height of an image point, and 0 */

typedef struct {
    const double *targets; /* (2, field) */
    const double *guess;   /* (field): slope of the chief ray at the stop */
    const double *x, *y;   /* (ray): points of the stop */
    int64_t fields, rays, kind;
    double scale;          /* object distance, or the length that an image height is relative to */
    double step;           /* on the stop, for derivatives */
} lf_targets;

typedef int lf_aim_loop(const lf_system *, const lf_targets *, double *out);

/* ghosts */

#define LF_CROSSINGS 3 /* of the stop by light that is reflected twice */
#define LF_GHOST_QUANTITIES 9 /* of a ray, in front of its light at each wavelength */
#define LF_GHOST_WAVES 8 /* the most wavelengths whose light has the same paths */
#define LF_GHOST_ABREAST 16 /* the most rays that are traced at once */
#define LF_GHOST_RIM 2 /* pixels around each picture of ghosts */

typedef struct { /* light in front of a lens: rays through a grid in its cross section through the first vertex */
    const double *reflectances; /* (surface, steps + 1, LF_GHOST_WAVES): at even steps of (n sin)^2 from 0 */
    const double *per_semi_aperture; /* (surface): one over the semi-aperture in mm; 0 for unlimited surfaces */
    const double *per_half_width;    /* (surface, 2): the same along x and y of a rectangular aperture */
    const int64_t *surfaces;    /* (pair, 2): that reflect, the nearer one to the object first; the second below 0: none */
    const double *boxes;        /* (pair, 4): first place and step, across and up */
    double across[3], up[3], along[3]; /* axes of the cross section, and the light's direction through the first vertex */
    double source[3], distance; /* of light from a finite distance: its place, and its distance from the viewpoint */
    double steps_per_unit, farthest; /* farthest: rays beyond this square of height over semi-aperture are lost */
    int64_t steps, waves, pairs, rows, columns, finite;
} lf_beam;

typedef int lf_ghost_rays_loop(const lf_system *, const lf_beam *, double *out, double *work);

typedef struct { /* grids of rays behind the lens */
    const double *rays;      /* (pair, quantity, row, column): position x, y on the sensor in mm; the largest square of
                                height over semi-aperture; positions x, y in the stop at each crossing; and the light at
                                each wavelength */
    const int64_t *crossings; /* (pair) */
    const double *cells;     /* (pair): cross section of the light in a cell, in mm^2 */
    const double *pixels;    /* (pair): the number to spend */
    const double *blur;      /* (pair): the least area of a pixel, in pixels of the first level */
    const double *irradiance; /* (pair, wavelength): of the light */
    const float *normals;    /* (blade, 2): of an iris, as in lf_cast_of */
    int64_t pairs, waves, rows, columns, blades, mirrored; /* mirrored: column 0 is the middle of a mesh with mirrored halves */
    float blade_margin, blade_bend, blade_slope, reach; /* reach: of the opening, in semi-apertures */
    double cosine, sine;     /* of the light's azimuth, by which rays are turned */
    double centre_row, centre_column, px_per_mm; /* of the first level, without its rim */
} lf_meshes;

typedef int lf_ghost_light_loop(const lf_meshes *, const lf_picture *levels, int64_t count, double *light, double *work);

/* fitting */

typedef struct { /* values at scattered places */
    const double *x, *y;   /* (place): from -1 to 1 */
    const double *weight;  /* (place) */
    const double *values;  /* (quantity, place) */
    int64_t places, quantities, degree, step; /* step: of the powers of x, 2 or 1 */
} lf_scattered;

typedef int lf_fit_loop(const lf_scattered *, double *out, double *residual, double *work);

/* spots */

typedef struct { /* rays at the corners of the cells of half a pupil */
    const double *corners; /* (7, radius, azimuth): position x, y in samples from the window's corner; two coordinates
                              over whose area the light is even; direction cosines x, y, scaled so that a ray at the
                              distance t from the edge is deflected by 1/t samples; the tightest limit, which passes
                              light up to 1 */
    int64_t radii, azimuths;
    int64_t parts; /* the most of a cell along each side */
    int64_t side;  /* of the window, in samples */
} lf_bundle;

typedef int lf_spots_loop(const lf_bundle *, double *out, double *light);

/* cast */

#define LF_TOGETHER 6  /* limit of wavelengths in one call */
#define LF_LEVELS 17  /* limit of a layer's resolutions */

typedef struct {         /* a layer at one resolution */
    lf_picture light;    /* (wavelength): premultiplied by alpha; at least 2 x 2 pixels */
    const float *alpha;  /* with the same steps */
    float axis_row, axis_column, per_px; /* of the axis, in this level's pixels; its pixels in a pixel of the capture */
    float top, bottom, left, right;      /* limits of the layer; infinite for sides at which the last pixels continue */
} lf_level;

typedef struct {         /* a layer of the scene, cropped from a pinhole's capture */
    lf_level level[LF_LEVELS]; /* the first one has the capture's pixels */
    int64_t levels;
    const float *depth;  /* (row, column, 2) of the first level: inverse depth, and focus share, below 0 far from surfaces */
} lf_layer;

typedef struct {          /* the search of a tile's rays for a layer */
    float inverse_depth, share; /* its start */
    int32_t steps;        /* its number of steps; below 0 if rays cannot meet the layer */
    int32_t focused;      /* whether anything in the layer's reachable part may be in focus */
    int32_t opaque;       /* whether that part is opaque */
    int32_t level;        /* of the layer, for light and alpha */
    float cells;          /* in a pixel of the level along a side, at least 1 */
} lf_meeting;

typedef struct {
    const float *rays;    /* (node, eight of rays, 2 + 6 wavelengths, 8): their position in the stop, along the second
                             direction and the first; for each wavelength their position at infinity, along the first
                             direction and the second, and its change with the inverse depth, both in pixels; their
                             distance from the rims that limit them, in cells, negative for blocked rays; their cells'
                             light. Directions are outwards and tangential, or in a mesh to the right and up */
    int64_t nodes, eights, wavelengths; /* nodes: heights, or columns of a mesh */
    int64_t mesh_rows;    /* 0: nodes are heights */
    double centre_row, centre_column, nodes_per_px; /* of the axis on the sensor */
    double rows_per_px, first_right, first_up; /* of a mesh: the first node's position, in nodes from the axis */
    const float *chief;   /* (row, column, wavelength, 2) of a finer mesh: positions at infinity that those of a mesh's rays
                             are relative to */
    int64_t finer;        /* times as many of its nodes in a pixel, along an axis */
    int32_t mirrored_right, mirrored_up; /* whether pixels on the left, or below, have the mirror images of its rays */
    float per_focal_right, per_focal_up; /* one over a panoramic capture's focal lengths in pixels; 0 for a plane capture */
    const float *shrinkage; /* radii in a panoramic capture over those on a plane, at even steps from 0 to 1 of
                               t / (1 + t), where t is the tangent of the angle from the axis */
    int64_t shrinkage_steps;
    const float *normals; /* (blade, 2): of an iris */
    int64_t blades;
    float blade_margin, blade_bend, blade_slope; /* margin - bend r^2 - slope (position . normal): distance from an edge */
    float cell_of_eight;  /* side of a ray's cell if a pixel has eight rays, in the unit of these distances */
    const lf_layer *layer; /* the nearest first */
    int64_t layers;
    float faint[LF_TOGETHER]; /* (wavelength): radiance that is negligible compared with the visible radiance */
    const lf_meeting *meetings; /* (tile, layer) */
    const int64_t *first_eights, *tile_eights; /* (tile): the first and the number of its rays, in eights */
    const int64_t *tile_step; /* (tile): distance between pixels that are cast; those between them are interpolated */
    int64_t tile_rows, tile_columns, tile_px;
} lf_cast_of;

typedef int lf_cast_loop(const lf_cast_of *, int64_t first_tile, int64_t end_tile, const lf_picture *blurred,
                         const lf_picture *clear, float *work);

/* collecting */

typedef struct { /* the filters of a sensor's pixels, repeated over the picture */
    const float *weights; /* (row, plane, column): factors on the light */
    int64_t rows, columns;
} lf_filters;

typedef int lf_collect_loop(const lf_picture *light, const lf_filters *, int64_t first_row, int64_t end_row,
                            const lf_picture *out);

/* reading */

#define LF_MOST_SENSOR 65536 /* rows and columns of a sensor */

typedef struct { /* a sensor's pixels, as they are read in an exposure */
    int64_t pixel_key, noise_key; /* of random numbers: for the pixels' differences, and for the exposure */
    int64_t row, column;          /* of the picture's first pixel on the sensor */
    float prnu, dsnu_e;           /* differences of their response and of their dark signal */
    float dark_e, full_e, noise_e; /* mean dark signal, full well, noise of the reading */
    float gain_dn_per_e, black_dn, white_dn;
    int32_t noisy;                /* 0: without anything random */
} lf_pixels;

typedef int lf_read_loop(const lf_pixels *, const lf_picture *light_e, int64_t first_row, int64_t end_row,
                         uint16_t *numbers);

/* control */

#define LF_CHANNELS 3   /* wavelengths in a pass */
#define LF_WINDOW_PX 11 /* side of a regression's window */

typedef struct { /* a picture from few samples, and a control of many; each (channel, row, column) */
    const float *one, *other; /* the picture after each half of its few samples */
    const float *control_one, *control_other, *control_rest; /* the control after the same, and after its other samples */
    const float *scale;   /* (row, column): of errors, in the regression */
    const float *weights; /* (row, column): share of the rest in the samples of the control; 0: everywhere the same, and */
    float weight;
    float ratios[LF_CHANNELS]; /* of the channels' means */
    double ridge, least_ridge; /* weight of these ratios, relative to the control's mean square, and at least */
    int64_t rows, columns;
} lf_controlled;

#define LF_CONTROL_STRIDE(columns) (((columns) + 7) / 8 * 8 + 16) /* doubles in a row of its workspace */

typedef int lf_control_loop(const lf_controlled *, int64_t first_row, int64_t end_row, float *estimate, float *difference,
                            double *work);

/* the library's functions */

LF_API int lf_abi(void);
LF_API const char *lf_sources(void);    /* the digest of the sources that it was built from */
LF_API const char *lf_variant(int n);   /* a variant's name, from 0, the simplest; NULL after the last */
LF_API int lf_runs_here(int variant);   /* whether this processor and its system can run it: check before using it */

LF_API int64_t lf_spread_work(int64_t pieces, int64_t columns); /* bytes of workspace for lf_spread; 0 for bad sizes */
LF_API int lf_spread(int variant, const lf_places *, const lf_table *, const lf_picture *light, const lf_sections *,
                     int64_t first_row, int64_t end_row, const lf_picture *out, void *work);
LF_API int lf_extremes(int variant, const lf_picture *light, const lf_extremes_of *, int64_t first_row,
                       int64_t end_row); /* rows of sections, as for lf_excess */
LF_API int lf_excess(int variant, const lf_picture *light, float level, const lf_excess_of *, int64_t first_row,
                     int64_t end_row);
LF_API int lf_footprints(int variant, const lf_geometry *, const lf_capture *, int64_t first_row, int64_t end_row,
                         const lf_picture *out);
LF_API int lf_turn(int variant, const lf_samples *, double cosine, double sine, int64_t side, double *out);
LF_API int lf_waves(int variant, const lf_wavefront *, const lf_picture *out, double *light, float *work);
LF_API int lf_trace(int variant, const lf_system *, const double *rays, int64_t count, double *out);
LF_API int lf_aim(int variant, const lf_system *, const lf_targets *, double *out);
LF_API int lf_ghost_rays(int variant, const lf_system *, const lf_beam *, double *out, /* (pair, quantity, row, column) */
                         double *work); /* (3 surfaces, LF_GHOST_ABREAST) */
LF_API int64_t lf_ghost_work(int64_t rows, int64_t columns); /* doubles of workspace for lf_ghost_light; 0 for bad sizes */
LF_API int lf_ghost_light(int variant, const lf_meshes *, const lf_picture *levels, int64_t count, double *light,
                          double *work); /* levels: each with pixels twice as large as the one before, a rim, and eight
                                            more floats behind each row; planes are wavelengths; light: (pair, wavelength) */
LF_API int64_t lf_fit_work(int64_t places, int64_t degree, int64_t step); /* doubles of workspace for lf_fit; 0 for bad
                                                                             sizes */
LF_API int lf_fit(int variant, const lf_scattered *, double *out, double *residual,
                  double *work); /* out: (quantity, power of y, power of x over the step); residual: places, padded to eights */
LF_API int lf_spots(int variant, const lf_bundle *, double *out, double *light);
LF_API int lf_cast(int variant, const lf_cast_of *, int64_t first_tile, int64_t end_tile, const lf_picture *blurred,
                   const lf_picture *clear, float *work); /* work: 32 floats for each pixel of a tile and wavelength */
LF_API int lf_collect(int variant, const lf_picture *light, const lf_filters *, int64_t first_row, int64_t end_row,
                      const lf_picture *out);
LF_API int64_t lf_control_work(int64_t columns); /* doubles of workspace for lf_control; 0 for bad sizes */
LF_API int lf_control(int variant, const lf_controlled *, int64_t first_row, int64_t end_row, float *estimate,
                      float *difference, double *work); /* both (channel, row, column) */
LF_API int lf_read(int variant, const lf_pixels *, const lf_picture *light_e, int64_t first_row, int64_t end_row,
                   uint16_t *numbers); /* numbers: (plane, row, column) */
#endif
