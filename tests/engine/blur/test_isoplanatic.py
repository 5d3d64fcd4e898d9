"""Sections with one PSF each, against plain convolution and against the exact operator."""

import numpy as np
import pytest
from scipy.ndimage import convolve

from blurring import blurred
from lenses import placed_psfs
from lensfield.engine import load_lens
from lensfield.engine.blur.exact import ExactSections
from lensfield.engine.blur.isoplanatic import IsoplanaticSections
from lensfield.engine.runtime.memory import MemoryBudget

RADIUS = 3
SHAPES = [(1, 1), (1, 9), (7, 1), (20, 33), (31, 17), (32, 32)]


def one_psf(rows, columns):
    """The same asymmetric PSF everywhere."""
    psf = np.random.default_rng(7).random((2 * RADIUS + 1, 2 * RADIUS + 1))
    return np.broadcast_to(psf / psf.sum(), (len(rows), *psf.shape))


def varying_psf(rows, columns, radius=RADIUS):
    """A Gaussian whose width and position vary smoothly over the plane."""
    offset = np.arange(-radius, radius + 1)
    sigma = 0.8 + 0.3 * np.sin(np.asarray(rows) / 40)[:, None, None]
    shift = 0.5 * np.cos(np.asarray(columns) / 30)[:, None, None]
    psf = np.exp(-((offset[:, None] - shift)**2 + (offset + shift)**2) / (2 * sigma**2))
    return psf / psf.sum(axis=(1, 2), keepdims=True)


def middles(length, section_size):
    return (np.arange(-(-length // section_size)) + 0.5) * section_size - 0.5


def sections(shape, section_size, psfs=varying_psf, radius=RADIUS, space_px=None, memory_bytes=0):
    places = [middles(length, section_size) for length in shape]
    space_px = space_px or section_size + 2 * radius
    return IsoplanaticSections(section_size, space_px, radius, psfs, places, MemoryBudget(memory_bytes))


def in_sections(plane, *args, single_range=0, **how):
    return blurred(plane, sections(plane.shape, *args, **how), single_range)


def exactly(plane, psfs=varying_psf, radius=RADIUS):
    return blurred(plane, ExactSections(32, radius, psfs))


def full_convolution(plane, psf):
    return convolve(np.pad(plane, RADIUS), psf, mode="constant")


def noise(shape):
    return np.random.default_rng(11).random(shape)


def relative_error(result, truth):
    return np.linalg.norm(result - truth) / np.linalg.norm(truth)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("section_size", [1, 7, 16, 50])
def test_an_isoplanatic_lens_is_a_convolution(section_size, shape):
    plane = noise(shape)
    truth = full_convolution(plane, one_psf([0], [0])[0])
    np.testing.assert_allclose(in_sections(plane, section_size, one_psf), truth, atol=1e-13)


@pytest.mark.parametrize("shape", SHAPES)
def test_one_position_can_represent_all_sections(shape):
    plane, middle = noise(shape), [np.array([(n - 1) / 2]) for n in shape]
    truth = full_convolution(plane, varying_psf(*middle)[0])
    one = IsoplanaticSections(7, 13, RADIUS, varying_psf, middle, MemoryBudget(0))
    np.testing.assert_allclose(blurred(plane, one), truth, atol=1e-13)


@pytest.mark.parametrize("shape", SHAPES)
def test_sections_of_one_pixel_equal_the_exact_operator(shape):
    plane = noise(shape)
    np.testing.assert_allclose(in_sections(plane, 1), exactly(plane), atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("section_size", [1, 7, 50])
def test_the_canvas_contains_all_light(section_size, shape):
    plane = noise(shape)
    canvas = in_sections(plane, section_size)
    assert canvas.shape == (shape[0] + 2 * RADIUS, shape[1] + 2 * RADIUS)
    assert canvas.sum() == pytest.approx(plane.sum(), rel=1e-12)


def test_error_halves_with_the_section_size():
    plane = noise((64, 96)) - 0.5
    errors = [relative_error(in_sections(plane, size), exactly(plane)) for size in (16, 8, 4)]
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 2.0, rtol=0.15)


def test_a_larger_space_does_not_change_the_result():
    plane = noise((20, 30))
    np.testing.assert_allclose(in_sections(plane, 8, space_px=64), in_sections(plane, 8), atol=1e-14)


@pytest.mark.parametrize("row, column", [(0, 0), (0, 3), (3, 0), (3, 3), (4, 4), (9, 11)])
def test_a_point_in_a_section_corner_does_not_wrap_around(row, column):
    radius = 6  # farther than a section of 4
    plane = np.zeros((10, 12))
    plane[row, column] = 5.0
    canvas = in_sections(plane, 4, lambda r, c: varying_psf(r, c, radius), radius)
    lit = np.zeros(canvas.shape, dtype=bool)
    lit[row:row + 2 * radius + 1, column:column + 2 * radius + 1] = True
    assert np.abs(canvas[~lit]).max(initial=0) < 1e-14
    assert canvas[lit].sum() == pytest.approx(5.0, rel=1e-13)


def test_light_stays_positive_next_to_a_highlight():
    plane = np.full((40, 40), 1e-3)
    plane[19, 23] = 1e6
    canvas = in_sections(plane, 16)
    assert canvas.min() > -1e-9  # 1e-15 of the highlight
    assert canvas[RADIUS:-RADIUS, RADIUS:-RADIUS].min() > 0.2e-3  # a corner pixel keeps about a quarter


def test_single_precision_suffices_for_low_contrast_pictures():
    plane = 1 + noise((40, 50))
    double, single = in_sections(plane, 16), in_sections(plane.astype(np.float32), 16, single_range=np.inf)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, double, atol=2e-6 * double.max())
    assert np.abs(single - double).max() > 1e-10  # single precision was used


@pytest.mark.parametrize("space_px", [None, 32, 128])
def test_rounding_errors_stay_within_reach_of_a_highlight_at_any_fft_size(space_px):
    """Rounding of bright light in single precision is limited to the reach of the PSF, whatever the FFT size.

    One section and everything within its reach are bright, and the light beyond is dim: single precision is sufficient
    there. Beyond the PSF's reach, a larger FFT contains only rounding errors of the bright light.
    """
    plane = np.full((16, 160), 1e-3, dtype=np.float32)
    plane[:, :64] = 1e6
    result = in_sections(plane, 16, one_psf, space_px=space_px, single_range=1e3)
    truth = in_sections(plane.astype(float), 16, one_psf)
    dim = (slice(2 * RADIUS, -2 * RADIUS), slice(64 + 2 * RADIUS + 1, -2 * RADIUS))
    np.testing.assert_allclose(result[dim], truth[dim], rtol=1e-5)


def test_a_black_plane_stays_black():
    assert not in_sections(np.zeros((20, 20)), 8).any()


def test_blurring_is_linear():
    first, second = noise((20, 30)), noise((30, 20)).T
    both = in_sections(first + 3 * second, 8)
    np.testing.assert_allclose(both, in_sections(first, 8) + 3 * in_sections(second, 8), atol=1e-13)


def test_edmund_error_halves_with_the_section():
    """In a corner of the frame, 1.4 to 1.9 mm from the axis."""
    plane = noise((48, 64)) - 0.5
    psfs, radius = placed_psfs(load_lens("edmund-54852"), 587.6, 6.25, (175, -185))
    truth = exactly(plane, psfs, radius)
    sixteen, eight, four = (relative_error(in_sections(plane, size, psfs, radius), truth) for size in (16, 8, 4))
    assert sixteen / eight == pytest.approx(2.0, abs=0.2) and eight / four == pytest.approx(2.0, abs=0.2)


def counted(requested):
    """`varying_psf`, which records the requested positions."""
    def psfs(rows, columns):
        requested.extend(zip(rows, columns, strict=True))
        return varying_psf(rows, columns)

    return psfs


def test_otfs_are_computed_for_lit_sections_only():
    requested, plane = [], np.zeros((40, 40))
    plane[12, 25] = 1  # in section (1, 2) of 10 px
    in_sections(plane, 10, counted(requested))
    assert requested == [(14.5, 24.5)]


def test_cached_otfs_are_reused_and_do_not_change_the_result():
    requested = []
    cached = sections((30, 40), 10, counted(requested), space_px=16, memory_bytes=1e9)
    first, second = noise((30, 40)), np.zeros((30, 40))
    second[3, 4] = 7
    results = [blurred(plane, cached) for plane in (second, first, second)]
    assert len(requested) == len(set(requested)) == 3 * 4
    np.testing.assert_array_equal(results[0], results[2])
    np.testing.assert_array_equal(results[1], in_sections(first, 10))
