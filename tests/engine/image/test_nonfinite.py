"""NaN and infinite pixels: refused by name, or replaced by the light of their neighbours."""

import sys

import numpy as np
import pytest

from lenses import make_lens
from lensfield.engine import ImageError, Options, Report, SpectralImage, simulate
from lensfield.engine.image.nonfinite import clamp_fireflies, refuse_fireflies
from refusals import refused

E_AXIS = np.pi / 16
pytestmark = pytest.mark.filterwarnings("error")  # NaN pixels raise an error, without numpy warnings


def numbered(shape=(6, 8)):
    return np.arange(float(np.prod(shape)), dtype=np.float32).reshape(shape)


def image(*planes):
    return SpectralImage(np.stack(planes), 500 + 10 * np.arange(len(planes)), pitch_um=20.0)


@pytest.mark.parametrize("value, shown", [(np.nan, "nan"), (np.inf, "inf"), (-np.inf, "-inf")])
def test_the_first_pixel_is_named_by_row_column_and_wavelength(value, shown):
    planes = [numbered(), numbered(), numbered()]
    planes[1][3, 7] = planes[1][5, 0] = planes[2][0, 0] = value
    with pytest.raises(ImageError) as error:
        refuse_fireflies(image(*planes))
    text = str(error.value)
    assert f"row 3, column 7, 510 nm is {shown}:" in text
    assert "2 of 48" in text and "clamp" in text and "\n" not in text


def test_infinities_that_cancel_are_detected():
    plane = numbered()
    plane[1, 1], plane[2, 2] = np.inf, -np.inf
    with refused(ImageError, field="pixel at row 1, column 1, 500 nm", value="inf", where="image"):
        refuse_fireflies(image(plane))


def test_the_largest_floats_are_not_fireflies_even_if_their_sum_overflows():
    plane = np.full((6, 8), np.finfo(np.float32).max)
    refuse_fireflies(image(plane))
    assert clamp_fireflies(plane)[1] == 0


def test_a_clean_plane_is_returned_unchanged():
    plane = numbered()
    mended, count = clamp_fireflies(plane)
    assert mended is plane and count == 0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row, column, brightest", [(2, 3, 28), (0, 0, 9), (5, 7, 46), (0, 7, 15), (3, 0, 33)])
def test_a_firefly_takes_the_brightest_of_its_neighbours(row, column, brightest, value):
    plane = numbered()
    plane[row, column] = value
    mended, count = clamp_fireflies(plane)
    assert count == 1 and mended[row, column] == brightest
    untouched = np.ones(plane.shape, dtype=bool)
    untouched[row, column] = False
    np.testing.assert_array_equal(mended[untouched], numbered()[untouched])


def test_the_given_picture_is_unchanged():
    plane = numbered()
    plane[2, 3] = np.nan
    clamp_fireflies(plane)
    assert np.isnan(plane[2, 3])


def test_adjacent_fireflies_do_not_light_each_other():
    plane = numbered()
    plane[2:5, 3:6] = np.inf
    mended, count = clamp_fireflies(plane)
    # Row r and column c of the plane contain 8 r + c; the pixel in the middle has only non-finite neighbours.
    assert mended[2:5, 3:6].tolist() == [[26, 13, 30], [34, 0, 38], [44, 45, 46]]
    assert count == 9


def test_a_plane_of_nothing_but_fireflies_is_black():
    mended, count = clamp_fireflies(np.full((3, 4), np.nan, dtype=np.float32))
    assert count == 12 and not mended.any()


def test_random_fireflies_match_a_loop_over_pixels():
    rng = np.random.default_rng(4)
    plane = rng.normal(size=(37, 52)).astype(np.float32)
    plane[rng.random(plane.shape) < 0.4] = np.nan
    plane[rng.random(plane.shape) < 0.1] = -np.inf
    bad = ~np.isfinite(plane)
    padded, expected = np.pad(np.where(bad, 0, plane), 1), plane.copy()
    for row, column in np.argwhere(bad):
        expected[row, column] = padded[row:row + 3, column:column + 3].max()
    mended, count = clamp_fireflies(plane)
    np.testing.assert_array_equal(mended, expected)
    assert count == bad.sum() and mended.dtype == np.float32


def test_no_line_runs_once_for_each_firefly():
    """Counts executed lines of Python instead of seconds: a picture of NaN would otherwise take half an hour."""
    def lines(count):
        plane, ran = np.ones((40, 50), np.float32), 0
        plane.ravel()[:count] = np.nan

        def trace(frame, event, _):
            nonlocal ran
            ran += event == "line" and frame.f_code.co_name == "clamp_fireflies"
            return trace

        before = sys.gettrace()
        sys.settrace(trace)
        try:
            clamp_fireflies(plane)
        finally:
            sys.settrace(before)
        return ran

    assert 0 < lines(1) == lines(2000)


@pytest.mark.parametrize("options", [Options(section_size=32, fireflies="clamp"),
                                     Options(method="pixels", azimuths=2, fireflies="clamp"),
                                     Options(method="exact", fireflies="clamp")])
def test_fireflies_of_a_picture_are_clamped_and_counted(options):
    planes = [np.ones((6, 8), np.float32), np.full((6, 8), 2, np.float32)]
    planes[0][2, 3], planes[1][0, 0], planes[1][5, 7] = np.nan, np.inf, -np.inf
    report = Report()
    result = simulate(image(*planes), make_lens(), options, report=report)
    np.testing.assert_allclose(result.cube, E_AXIS * np.array([1, 2])[:, None, None] * np.ones((2, 6, 8)), rtol=1e-6)
    assert report.lens_image.fireflies_clamped == 3


def test_a_clean_picture_has_no_clamped_fireflies():
    report = Report()
    simulate(image(numbered()), make_lens(), Options(section_size=32), report=report)
    assert report.lens_image.fireflies_clamped == 0
