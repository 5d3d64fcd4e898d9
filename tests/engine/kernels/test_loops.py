"""Each loop in C against plain numpy, in every variant that this machine can run; all of them give the same bits."""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from lenses import comatic_lens, lopsided_lens
from lensfield.engine.bake.diffraction import waves as numpy_waves
from lensfield.engine.field.footprints import RIM_PX
from lensfield.engine.field.radial.distortion import footprints as numpy_footprints
from lensfield.engine.field.radial.psf_bank import PsfBank
from lensfield.engine.field.radial.psf_table import PsfTable, TurnedPsfs
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.kernels.collecting import collect
from lensfield.engine.kernels.control import BAND_ROWS, control
from lensfield.engine.kernels.excess import excess
from lensfield.engine.kernels.extremes import extremes
from lensfield.engine.kernels.footprints import MeshGeometry, RadialGeometry, footprints
from lensfield.engine.kernels.library import NUMPY, available
from lensfield.engine.kernels.numpy_reading import random_words
from lensfield.engine.kernels.numpy_sections import numpy_excess, numpy_extremes
from lensfield.engine.kernels.pixels import Pixels, key
from lensfield.engine.kernels.reading import read
from lensfield.engine.kernels.spots import spots
from lensfield.engine.kernels.spreading import PackedTable, TablePlaces, spread
from lensfield.engine.kernels.tracing import ANGLE, TracedSurfaces, aim, trace
from lensfield.engine.kernels.turning import TurnableSamples, turn
from lensfield.engine.kernels.waves import waves
from loops import using

pytestmark = pytest.mark.skipif(len(available()) < 2, reason="no library of the loops: no compiler")
EPSILON = np.finfo(np.float32).eps
PITCH_UM = 8.0


def in_every_variant(loop):
    """The result of a loop, which is the same in every variant."""
    results = []
    for name in available()[1:]:
        with using(name):
            results.append(loop())
    for other in results[1:]:
        np.testing.assert_array_equal(other, results[0])
    return results[0]


@pytest.mark.parametrize("lens", [comatic_lens(), lopsided_lens()], ids=["comatic", "lopsided"])
@pytest.mark.parametrize("azimuth_rad", [0.0, np.pi / 4, 0.3, -2.0, np.pi])
def test_turn_matches_the_psf_bank(lens, azimuth_rad):
    bank = PsfBank.of(lens.at_wavelength(550.0), PITCH_UM)
    samples = TurnableSamples.of(bank.samples, bank.v_px, bank.u_px, bank.sample_size_px)
    turned = in_every_variant(lambda: turn(samples, [azimuth_rad, 1.0], 2 * bank.radius_px + 1))
    with using(NUMPY):
        expected = bank.at_table_heights([azimuth_rad, 1.0])
    np.testing.assert_allclose(np.moveaxis(turned, 3, 1), expected, atol=1e-13)


@pytest.mark.parametrize("v_px", [2.0, -3.0, 1e300, np.nan, -np.inf])
def test_turn_refuses_light_outside_the_square(v_px):
    samples = TurnableSamples.of(np.ones((1, 1)), np.array([v_px]), np.zeros(1), 0.5)
    with pytest.raises(ValueError, match="outside"):
        turn(samples, [0.0], 3)


FIELD = SimpleNamespace(paraxial_height_mm=lambda real_mm: real_mm,
                        paraxial_slope=lambda height_mm: 1 + 0.3 * height_mm,
                        paraxial_per_real=lambda real_mm, height_mm: 1 + 0.15 * height_mm)
"""A lens that compresses a capture increasingly towards the edge; its curves are straight, like look-up tables."""


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (33, 1), (30, 41)])
@pytest.mark.parametrize("planes", [1, 4])
@pytest.mark.parametrize("centre_px", [(-0.5, -0.5), (7.25, 30.0), (500.0, -900.0)])
def test_footprints_match_numpy(shape, planes, centre_px):
    capture = np.random.default_rng(1).random((50, 60), np.float32)
    captures = np.stack([capture, capture[::-1], capture[:, ::-1], capture[::-1, ::-1]][:planes], axis=2)
    grid = PixelGrid((50, 60), PITCH_UM, (centre_px[0] + 3, centre_px[1] + 2))
    y_mm, x_mm = ((np.arange(n) - centre) * PITCH_UM * 1e-3 for n, centre in zip(shape, centre_px, strict=True))
    expected, height_mm = numpy_footprints(grid.framed(RIM_PX), x_mm, -y_mm, FIELD)
    last_px = 25.3
    factor = np.where(height_mm > last_px * PITCH_UM * 1e-3, 0, 1 / (1 + height_mm))
    far_px = np.hypot(*(abs(centre) + n for n, centre in zip(shape, centre_px, strict=True)))
    samples = 1 << 16
    curve_mm = np.arange(samples + 1) * far_px / samples * PITCH_UM * 1e-3
    geometry = RadialGeometry.of(centre_px, samples / far_px, 1 + 0.15 * curve_mm, 1 + 0.3 * curve_mm,
                                 1 / (1 + curve_mm), last_px)  # not a straight line, but exact at the samples

    def loop():
        out = np.full((planes, *shape), np.nan, np.float32)
        half = shape[0] // 2
        footprints(geometry, captures, grid.centre_px, slice(half), out)
        footprints(geometry, captures, grid.centre_px, slice(half, None), out)
        return out

    # Shares, products and sums are rounded to single precision: up to 18 rows and columns, with an error of at most an
    # ulp each on average.
    framed = np.pad(np.moveaxis(captures, 2, 0), ((0, 0), (RIM_PX, RIM_PX), (RIM_PX, RIM_PX))).astype(np.float64)
    np.testing.assert_allclose(in_every_variant(loop), expected.average(framed) * factor, rtol=40 * EPSILON,
                               atol=40 * EPSILON)


SECTIONED = pytest.mark.parametrize("shape, section_px", [((1, 1, 1), 1), ((4, 33, 70), 32), ((1, 40, 19), 7),
                                                          ((2, 64, 96), 32), ((3, 5, 50), 64)])


def section_light(shape):
    """Light with black and negative pixels, in a view whose rows are not next to each other."""
    planes, rows, columns = shape
    random = np.random.default_rng(columns)
    light = random.uniform(-0.3, 1, (planes, rows, columns + 3)).astype(np.float32)[:, :, :columns]
    light[random.random(shape) < 0.2] = 0
    return light


def sections_of(shape, section_px):
    return tuple(-(-n // section_px) for n in shape[1:])


@SECTIONED
def test_extremes_match_numpy(shape, section_px):
    light, sections = section_light(shape), sections_of(shape, section_px)
    expected = np.empty((4, *sections), np.float32)
    numpy_extremes(light, section_px, slice(None), expected)

    def loop():
        out = np.full_like(expected, np.nan)
        extremes(light, section_px, slice(1), out)
        extremes(light, section_px, slice(1, None), out)
        return out

    np.testing.assert_array_equal(in_every_variant(loop), expected)


@SECTIONED
@pytest.mark.parametrize("level", [0, 0.4])
def test_excess_matches_numpy(shape, section_px, level):
    light, sections = section_light(shape), sections_of(shape, section_px)
    expected = np.empty((shape[0], *sections))
    numpy_excess(light, level, section_px, slice(None), expected)

    def loop():
        out = np.full_like(expected, np.nan)
        excess(light, level, section_px, slice(1), out)
        excess(light, level, section_px, slice(1, None), out)
        return out

    np.testing.assert_allclose(in_every_variant(loop), expected, rtol=1e-12)


def test_footprints_never_read_out_of_bounds():
    wild = np.array([np.nan, np.inf, -np.inf, -1e300, 1e300, 0, -0.5, 40, 1e-320, 1])
    random = np.random.default_rng(2)
    for _ in range(50):
        geometry = RadialGeometry.of((3.0, 4.0), 0.7, *random.choice(wild, (3, 30)), random.choice(wild))
        for planes in (1, 4):
            out = np.empty((planes, 9, 9), np.float32)
            capture = np.ones((5, 7, planes), np.float32)
            footprints(geometry, capture, (2.0, 3.0), slice(None), out)  # may crash otherwise
            mesh = MeshGeometry.of(random.choice(wild, (3, 4, 6)), 3)
            footprints(mesh, capture, (2.0, 3.0), slice(None), out)


def random_psfs(heights, azimuths, side, random, quarter_turns=4):
    """PSFs with so many azimuths in each quarter turn, and a smaller radius at some heights."""
    psfs = np.zeros((heights, azimuths, side, side), np.float32)
    for height, of_height in enumerate(psfs):
        reach = random.integers(0, side // 2 + 1) if height else side // 2
        inside = np.hypot(*(np.indices((side, side)) - side // 2)) <= reach
        of_height[:, inside] = random.random((azimuths, inside.sum()))
    black = np.zeros((heights, azimuths, 1), np.float32)
    return TurnedPsfs(np.concatenate([psfs.reshape(heights, azimuths, -1), black], axis=2), False, quarter_turns,
                      np.arange(heights, dtype=float))


def packed_table(turned):
    return turned.pieces()


def table_places(turned, centre_px, samples_per_px, heights):
    """Table positions for a curve of heights over the distance from the axis."""
    return TablePlaces.of(centre_px, samples_per_px, heights, turned.heights_mm,
                          (turned.azimuths - 1) // turned.quarter_turns, turned.quarter_turns)


def spread_by_numpy(table, light, height_of_px, centre_px):
    planes, rows, columns = light.shape
    row, column = np.mgrid[:rows, :columns]
    down, right = row.ravel() - centre_px[0], column.ravel() - centre_px[1]
    *taps, psfs = table.mixed((height_of_px(np.hypot(down, right)), np.arctan2(-down, right)))
    reach = 2 * table.radius_px
    out = np.zeros((planes, rows + reach, columns + reach))
    for psf, down, right in zip(psfs.astype(np.float64), *taps, strict=True):
        out[:, down:down + rows, right:right + columns] += light * psf.reshape(rows, columns)
    return out


@pytest.mark.parametrize("planes", [1, 4])
@pytest.mark.parametrize("shape, centre_px", [((1, 1), (0.0, 0.0)), ((1, 21), (-0.5, -0.5)), ((20, 1), (0.0, -3.0)),
                                              ((13, 22), (-0.5, 0.0)), ((14, 23), (6.3, 11.7))])
@pytest.mark.parametrize("side", [1, 3, 9, 35, 75, 141])
def test_spread_matches_numpy(planes, shape, centre_px, side):
    random = np.random.default_rng(side)
    quarter_turns = 1 if max(centre_px) <= 0 else 4
    turned = random_psfs(4, 5, side, random, quarter_turns)
    light = random.random((planes, *shape), np.float32)
    light[:, random.random(shape) < 0.3] = 0
    far_px = np.hypot(*shape) + 3
    places = table_places(turned, centre_px, 30 / far_px, np.linspace(0, 3.2, 31))  # including heights beyond the last
    packed = packed_table(turned)
    lit = np.ones((3, 4), bool)

    def loop():
        half = shape[0] // 2
        out = np.zeros((planes, shape[0] + side - 1, shape[1] + side - 1), np.float32)
        for rows in (slice(half), slice(half, None)):
            part = spread(packed, places, light, lit, 8, rows)
            out[:, rows.start or 0:][:, :part.shape[1]] += part
        return out

    expected = spread_by_numpy(PsfTable(turned), light, lambda px: px * 3.2 / far_px, centre_px)
    # Every pixel adds a rounding error to each sum. Positions between the table's nodes have single precision, and the
    # steps of the PSFs, up to 1 in a table of noise, amplify their error.
    pixels = min(light[0].size, side**2)
    tolerance = (np.sqrt(pixels) + 4 + 40 * quarter_turns) * EPSILON
    np.testing.assert_allclose(in_every_variant(loop), expected, rtol=0, atol=tolerance * max(expected.max(), 1))


def test_spread_skips_unlit_sections():
    random = np.random.default_rng(5)
    turned = random_psfs(3, 4, 5, random)
    light = random.random((1, 10, 11), np.float32)
    lit = np.array([[True, False, True], [False, True, False], [False, False, True]])
    places, packed = table_places(turned, (4.0, 5.0), 1.0, np.linspace(0, 2, 12)), packed_table(turned)
    masked = light * np.kron(lit, np.ones((4, 4)))[:10, :11].astype(np.float32)
    everywhere = np.ones_like(lit)
    np.testing.assert_array_equal(in_every_variant(lambda: spread(packed, places, light, lit, 4, slice(None))),
                                  in_every_variant(lambda: spread(packed, places, masked, everywhere, 4, slice(None))))


@pytest.mark.parametrize("scale", [1e-37, 1.0, 1e30])
def test_spread_is_proportional_to_the_light(scale):
    random = np.random.default_rng(6)
    turned = random_psfs(2, 2, 9, random)
    places, packed = table_places(turned, (4.0, 5.0), 1.0, np.linspace(0, 1, 12)), packed_table(turned)
    light = 1 + random.random((4, 6, 7), np.float32)
    loop = in_every_variant(lambda: spread(packed, places, light * np.float32(scale), np.ones((1, 1), bool), 8,
                                           slice(None)))
    expected = in_every_variant(lambda: spread(packed, places, light, np.ones((1, 1), bool), 8, slice(None)))
    np.testing.assert_allclose(loop / scale, expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("rows", [0, 3, 200])
def test_positions_in_a_cropped_picture_match_the_full_picture(rows):
    random = np.random.default_rng(7)
    turned = random_psfs(3, 4, 5, random)
    places, packed = table_places(turned, (4.0, 5.0), 1.0, np.linspace(0, 2, 12)), packed_table(turned)
    full = np.zeros((1, rows + 4, 11), np.float32)
    full[:, rows:] = random.random((1, 4, 11))
    lit = np.ones((rows + 4, 1), bool)
    np.testing.assert_array_equal(
        in_every_variant(lambda: spread(packed, places.lower(rows), full[:, rows:], lit, 11, slice(None))),
        in_every_variant(lambda: spread(packed, places, full, lit, 11, slice(rows, None))))


def test_unevenly_spaced_heights_are_interpolated_exactly():
    """Both sides of a height are right where a step of the curve crosses it; beyond the last height it is constant."""
    heights = np.array([0.0, 1.0, 1.5, 5.0])
    square = np.zeros((4, 2, 2), np.float32)
    square[:, :, 0] = heights[:, None] ** 2  # a PSF of one pixel
    turned = TurnedPsfs(square, False, 1, heights)
    packed, places = packed_table(turned), table_places(turned, (0.0, 0.0), 0.7, np.arange(8) * 0.9)
    light, lit = np.ones((1, 1, 60), np.float32), np.ones((1, 1), bool)
    spreads = in_every_variant(lambda: spread(packed, places, light, lit, 60, slice(None)))
    at = np.minimum(np.arange(60) * 0.7, 7) * 0.9
    np.testing.assert_allclose(spreads[0, 0], np.interp(at, heights, heights**2), rtol=0, atol=100 * EPSILON)


def test_a_table_without_light_spreads_none():
    turned = TurnedPsfs(np.zeros((2, 2, 10), np.float32), False, 4, np.arange(2.0))
    places = table_places(turned, (0.0, 0.0), 1.0, np.zeros(2))
    assert not spread(packed_table(turned), places, np.ones((1, 2, 2), np.float32), np.ones((1, 1), bool), 2,
                      slice(None)).any()


def test_arrays_of_the_wrong_type_or_shape_are_refused():
    geometry = RadialGeometry.of((0.0, 0.0), 1.0, *np.ones((3, 5)))
    capture, out = np.ones((4, 4, 1), np.float32), np.ones((1, 4, 4), np.float32)
    for wrong in (capture.astype(float), capture[:, :, 0], capture[:, ::-1], np.ones((4, 4, 2), np.float32)[:, :, :1]):
        with pytest.raises(ValueError, match="expected float32"):
            footprints(geometry, wrong, (0.0, 0.0), slice(None), out)
    for wrong in (out.astype(float), out[0], out[:, :, ::-1], out.swapaxes(1, 2), out[:, :, ::2]):
        with pytest.raises(ValueError, match="expected float32"):
            footprints(geometry, capture, (0.0, 0.0), slice(None), wrong)
    for planes in (2, 4):
        with pytest.raises(ValueError, match="sizes"):
            footprints(geometry, np.ones((4, 4, planes), np.float32), (0.0, 0.0), slice(None), out)


MESH = MeshGeometry.of(np.ones((2, 3, 6)), 2)
CELLS = TablePlaces.in_cells((np.array([0, 1]), np.zeros(2)), (np.array([0, 0, 1]), np.zeros(3)), 2)


def test_meshes_and_cells_of_impossible_sizes_are_refused():
    capture, out = np.ones((4, 4, 1), np.float32), np.ones((1, 4, 4), np.float32)
    footprints(MESH, capture, (0.0, 0.0), slice(None), out)
    for field, value in (("mesh_rows", 1), ("mesh_columns", 1), ("mesh_step", 0)):
        broken = MeshGeometry.of(np.ones((2, 3, 6)), 2)
        setattr(broken._structure, field, value)
        with pytest.raises(ValueError, match="sizes"):
            footprints(broken, capture, (0.0, 0.0), slice(None), out)
    packed = PackedTable.of(np.ones((4, 9), bool), 2, lambda cell, pixels, out: out.fill(cell))
    light, lit = np.ones((1, 2, 3), np.float32), np.ones((1, 1), bool)
    assert np.isfinite(spread(packed, CELLS, light, lit, 3, slice(None))).all()
    for cells in ([0, 2], [-1, 0], [0, 1 << 30]):
        wrong = TablePlaces.in_cells((np.array(cells), np.zeros(2)), (np.array([0, 0, 1]), np.zeros(3)), 2)
        with pytest.raises(ValueError, match="sizes"):
            spread(packed, wrong, light, lit, 3, slice(None))


def test_light_of_a_cell_is_mixed_from_its_four_corners():
    """A PSF of one pixel: 1 and 2 above, 4 and 8 below, times 10 to the power of the cell."""
    def fill(cell, pixels, out):
        out[:] = np.where(pixels == 0, 10.0**cell * np.array([[1, 2], [4, 8]])[..., None], 0)

    packed = PackedTable.of(np.ones((4, 1), bool), 2, fill)
    places = TablePlaces.in_cells((np.array([0, 1]), np.array([0.25, 0.5])),
                                  (np.array([0, 1, 1]), np.array([0.0, 0.5, 1.0])), 2)
    light = np.ones((1, 3, 5), np.float32)  # beyond the last row and column, they continue
    result = in_every_variant(lambda: spread(packed, places, light, np.ones((1, 1), bool), 5, slice(None)))
    expected = [[1.75, 26.25, 35, 35, 35], [250, 3750, 5000, 5000, 5000], [250, 3750, 5000, 5000, 5000]]
    np.testing.assert_allclose(result[0], expected, rtol=1e-6)
    below = in_every_variant(lambda: spread(packed, places.lower(1), light, np.ones((1, 1), bool), 5, slice(1)))
    np.testing.assert_allclose(below[0], expected[1:2], rtol=1e-6)


def a_wavefront(rows, columns, limits):
    """Polynomials of rows, and their positions: terms decrease as in smooth wavefronts."""
    random = np.random.default_rng(5)
    path = random.normal(size=(rows, 9)) * 100 * 0.4 ** np.arange(9)
    edges = np.tile(random.normal(size=(1 + limits, 7)) * 0.3 ** np.arange(7), (rows, 1, 1))
    y = np.linspace(-1.02, 1.02, rows)
    edges[:, 1:, 0] = 0.6 + np.square(y)[:, None] / 2
    return path, edges.astype(np.float32), (np.arange(columns) + 0.5) / columns * 1.02, y


@pytest.mark.parametrize("rows, columns, limits", [(3, 8, 1), (50, 24, 3), (201, 104, 2)])
def test_waves_match_numpy(rows, columns, limits):
    """Except for about one cell at the rim, which rounding includes or excludes."""
    wavefront = (*a_wavefront(rows, columns, limits), (-0.5, 1.0))
    results = []

    def compute_waves():
        out = np.full((2, rows, columns + 3), 7, np.float32)
        results.append(waves(*wavefront, out))
        return out

    result, expected = in_every_variant(compute_waves), np.full((2, rows, columns + 3), 7, np.float32)
    assert set(results) == {results[0]} and results[0] == pytest.approx(numpy_waves(*wavefront, expected), abs=2)
    assert np.all(result[..., columns:] == 7)
    off = np.abs(result - expected).max(axis=0)
    assert np.count_nonzero(off > 100 * EPSILON) <= 2 and np.count_nonzero(expected) > expected.size / 4


def test_waves_refuse_mismatched_shapes():
    path, edges, x, y = a_wavefront(9, 16, 1)
    for wrong in ((path, edges, x[:15], y), (path[:2], edges[:2], x, y[:2]), (path, edges[:, :1], x, y),
                  (path[1:], edges, x, y)):
        with pytest.raises(ValueError, match="rows|invalid sizes"):
            waves(*wrong, (0.0, 1.0), np.empty((2, wrong[3].size, wrong[2].size), np.float32))
    with pytest.raises(ValueError, match="invalid sizes"):
        waves(path, edges, x, y, (0.0, 1.0), np.empty((2, 9, 15), np.float32))


def a_bundle(shape, random):
    """Rays at corners of cells: astigmatic, with a vignetted rim."""
    radius, azimuth = np.meshgrid(np.linspace(0, 1, shape[0]), np.linspace(0, np.pi, shape[1]), indexing="ij")
    x, y = radius * np.sin(azimuth), radius * np.cos(azimuth)
    corners = np.stack([8 * x**3 + 10, 3 * y - 2 * radius**2 + 11, x, y, 40 * x, 50 * y, radius**2 * (1.1 + 0.4 * y)])
    return corners + 0.01 * random.random(corners.shape)


@pytest.mark.parametrize("shape, parts, side", [((2, 3), 1, 16), ((9, 13), 1, 21), ((7, 9), 3, 24)])
def test_spots_match_numpy(shape, parts, side):
    corners, lights = a_bundle(shape, np.random.default_rng(2)), []

    def compute_spots():
        out, light = spots(corners, parts, side)
        lights.append(light)
        return out

    result = in_every_variant(compute_spots)
    with using(NUMPY):
        expected, light = spots(corners, parts, side)
    assert set(lights) == {lights[0]} and lights[0] == pytest.approx(light, rel=1e-12)
    np.testing.assert_allclose(result, expected, atol=1e-12)
    assert 0 < result.sum() < light


def test_spots_refuse_mismatched_shapes():
    corners = a_bundle((3, 3), np.random.default_rng(2))
    with pytest.raises(ValueError, match="expected contiguous"):
        spots(corners[:6], 1, 5)
    with pytest.raises(ValueError, match="invalid sizes"):
        spots(corners, 0, 5)


SINGLET = TracedSurfaces(np.array([[1 / 30, -0.5, 4.0, 1e-5], [-1 / 50, 0.0, 40.0, 0.0]]), 0, 0, 1)
MEDIA = np.array([1.0, 1.5, 1.0])


def test_rays_are_the_same_in_every_variant():
    rays = np.random.default_rng(3).uniform(-0.5, 0.5, (4, 21)) * np.array([[9.0], [9.0], [1.0], [1.0]])
    traced = in_every_variant(lambda: np.concatenate(trace(SINGLET, MEDIA, rays)))
    assert np.isfinite(traced).any()
    targets = np.array([[1.0, 0.98, 0.95, 0.9], [0.0, 0.199, 0.312, 0.436]])
    in_every_variant(lambda: aim(SINGLET, MEDIA, ANGLE, np.inf, targets, targets[1], rays[:2], 1e-3))


def test_rays_refuse_mismatched_shapes():
    with pytest.raises(ValueError, match="expected contiguous"):
        trace(SINGLET, MEDIA[:2], np.zeros((4, 3)))
    with pytest.raises(ValueError, match="expected contiguous"):
        trace(SINGLET, MEDIA, np.zeros((3, 3)))
    with pytest.raises(ValueError, match="invalid sizes"):
        trace(TracedSurfaces(SINGLET.shapes, 2, 0, 1), MEDIA, np.zeros((4, 3)))
    with pytest.raises(ValueError, match="expected contiguous"):
        aim(SINGLET, MEDIA, ANGLE, np.inf, np.zeros((2, 3)), np.zeros(2), np.zeros((2, 5)), 1e-3)
    with pytest.raises(ValueError, match="invalid sizes"):
        aim(SINGLET, MEDIA, 3, np.inf, np.zeros((2, 3)), np.zeros(3), np.zeros((2, 5)), 1e-3)


@pytest.mark.parametrize("planes, cell", [(12, (2, 2)), (3, (6, 6)), (1, (1, 1)), (4, (3, 64))])
def test_collect_equals_numpy(planes, cell):
    random = np.random.default_rng(4)
    light = random.random((planes, 21, 160), np.float32)[:, 2:, 3:]
    weights = random.random((cell[0], planes, cell[1]), np.float32)

    def collected():
        out = np.full((19, 157), np.nan, np.float32)
        for rows in (slice(0, 7), slice(7, 8), slice(8, 19)):
            collect(light, weights, rows, out)
        return out

    result = in_every_variant(collected)
    with using(NUMPY):
        np.testing.assert_array_equal(collected(), result)
    row, column = np.indices(result.shape)
    exact = (np.moveaxis(weights, 1, 2)[row % cell[0], column % cell[1]] * np.moveaxis(light, 0, 2)).sum(axis=2)
    np.testing.assert_allclose(result, exact, rtol=1e-5)


def test_collect_refuses_mismatched_shapes():
    out = np.zeros((5, 6), np.float32)
    with pytest.raises(ValueError, match="weights of 2 planes"):
        collect(np.zeros((3, 5, 6), np.float32), np.ones((1, 2, 1), np.float32), slice(0, 5), out)
    with pytest.raises(ValueError, match="invalid sizes"):
        collect(np.zeros((2, 5, 7), np.float32), np.ones((1, 2, 1), np.float32), slice(0, 5), out)


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("shape", [(1, 1), (BAND_ROWS + 1, 7), (2 * BAND_ROWS + 5, 70)])
def test_control_equals_numpy(shape, even):
    """The control explains most of the picture, and a pixel is not finite."""
    random = np.random.default_rng(6)
    of_control = random.gamma(2.0, 1.0, (3, 3, *shape)).astype(np.float32)
    halves = np.einsum("hiyx,ic->hcyx", of_control[:2], random.random((3, 3))).astype(np.float32)
    scale = (1 / of_control[0].mean(axis=0)).astype(np.float32)
    scale[shape[0] // 2, shape[1] // 2] = np.inf
    weight = 0.9 if even else random.random(shape, np.float32)

    def controlled():
        return np.stack(control(halves, of_control[:2], of_control[2], scale, np.array([0.5, 1.0, 2.0]), weight, 1e-3,
                                1e-4))

    result = in_every_variant(controlled)
    with using(NUMPY):
        np.testing.assert_allclose(controlled(), result, rtol=2e-3, atol=2e-4 * np.abs(result).max())


def test_control_refuses_mismatched_shapes():
    halves = np.ones((2, 3, 4, 5), np.float32)
    with pytest.raises(ValueError, match="of shape"):
        control(halves, halves, halves[0, :, 1:], halves[0, 0], np.ones(3), 0.5, 1e-3, 1e-4)


PIXELS = Pixels(pixel_key=3**39, noise_key=-(5**27), place=(40, 65500), prnu=0.01, dsnu_e=1.5, dark_e=0.2,
                full_e=9000.0, noise_e=3.0, gain_dn_per_e=0.3, black_dn=64.0, white_dn=4095, noisy=True)


@pytest.mark.parametrize("noisy", [True, False])
@pytest.mark.parametrize("columns", [1, 8, 35])
def test_read_equals_numpy(columns, noisy):
    random = np.random.default_rng(5)
    light_e = (10 ** random.uniform(-2, 4.2, (3, 30, columns))).astype(np.float32)
    light_e[1, :6, 0] = np.nan, np.inf, -np.inf, -5, 1e-42, 3e38
    pixels = replace(PIXELS, noisy=noisy)

    def numbers():
        out = np.full(light_e.shape, 7, np.uint16)
        for rows in (slice(0, 1), slice(1, 29)):
            read(pixels, light_e, rows, out)
        return out

    result = in_every_variant(numbers)
    with using(NUMPY):
        np.testing.assert_array_equal(numbers(), result)
    assert np.all(result[:, 29] == 7) and result[:, :29].max() > 2000
    if not noisy:
        assert result[1, :6, 0].tolist() == [64, 64 + 2700, 64, 64, 64, 64 + 2700]


def test_read_refuses_pixels_beyond_the_largest_sensor():
    light_e = np.zeros((1, 2, 37), np.float32)
    with pytest.raises(ValueError, match="invalid sizes"):
        read(PIXELS, light_e, slice(0, 2), np.zeros(light_e.shape, np.uint16))
    with pytest.raises(ValueError, match="expected contiguous uint16"):
        read(PIXELS, light_e, slice(0, 2), np.zeros((2, 37), np.uint16))


def test_keys_of_large_numbers_differ():
    numbers = list(product((0, 1, 2**32 - 1, 2**32, 2**63 - 1), repeat=3))
    assert len({key(*each) for each in numbers}) == len(numbers)


@pytest.mark.parametrize("of, counter, words", [
    (0, (0, 0), (0x6B200159, 0x99BA4EFE)), (-1, (0xFFFFFFFF, 0xFFFFFFFF), (0x1CB996FC, 0xBB002BE7)),
    (0x0370734413198A2E, (0x243F6A88, 0x85A308D3), (0xC4923A9C, 0x483DF7A0))])
def test_random_words_are_threefrys(of, counter, words):
    """The known answers of Random123, the authors' library."""
    (row, column), (plane, purpose) = divmod(counter[0], 2**16), divmod(counter[1], 4)
    assert tuple(random_words(of, row, np.array([column]), plane, purpose)[:, 0]) == words
