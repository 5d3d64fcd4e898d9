"""PSFs resampled to a lens's common grid: orientation, position of the chief ray, and the accuracy of interpolation."""

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.lens_files.psf_grid import PsfGrid, psf_table
from refusals import refused


def grid_with_mark(x, y, centre=(4, 4), shape=(9, 9), **facts):
    """A dim PSF with light at the chief ray, and more light x samples right of it and y samples above it."""
    values = np.full(shape, 1e-3)
    values[centre] = 0.5
    values[centre[0] + y, centre[1] + x] = 1
    return PsfGrid("a.txt", values, 0.25, centre, **facts)


def mark(psf):
    """(v, u) of the brightest sample, relative to the chief ray."""
    row, column = np.unravel_index(psf.argmax(), psf.shape)
    return row - psf.shape[0] // 2, column - psf.shape[1] // 2


# Outwards is up for a point above the axis, and right is right. For a point below the axis outwards is down; with the
# picture turned so that outwards is up, left becomes right.
@pytest.mark.parametrize("side, expected", [("+y", (3, 2)), ("-y", (-3, -2))])
def test_psfs_are_turned_outwards(side, expected):
    psf, pitch = psf_table([[grid_with_mark(x=2, y=3)]], side)
    assert mark(psf[0, 0]) == expected and pitch == 0.25


@pytest.mark.parametrize("y_mm, expected", [(1.5, (3, 2)), (-1.5, (-3, -2)), (0.0, (-3, -2))])
def test_a_stated_image_point_takes_precedence_over_the_side(y_mm, expected):
    psf, _ = psf_table([[grid_with_mark(x=2, y=3, image_mm=(0.0, y_mm))]], "-y")
    assert mark(psf[0, 0]) == expected


def test_all_psfs_must_be_on_one_side():
    grids = [grid_with_mark(2, 3, image_mm=(0.0, y)) for y in (0.0, -1.0)]
    psf, _ = psf_table([grids], "+y")
    assert mark(psf[0, 0]) == mark(psf[0, 1]) == (-3, -2)
    with refused(LensError, field="image point", where="a.txt", match="same side"):
        psf_table([[*grids, grid_with_mark(2, 3, image_mm=(0.0, 1.0))]], "+y")


def test_image_points_off_the_y_axis_are_refused():
    with refused(LensError, field="image point", value="x = 1, y = 1 mm", where="a.txt"):
        psf_table([[grid_with_mark(2, 3, image_mm=(1.0, 1.0))]], "+y")


@pytest.mark.parametrize("centre, shape, window", [((4, 4), (8, 8), 7), ((3, 3), (8, 8), 7), ((4, 4), (9, 9), 9),
                                                   ((5, 2), (9, 9), 13), ((3, 3), (6, 9), 11)])
@pytest.mark.parametrize("side", ["+y", "-y"])
def test_the_chief_ray_is_centred_in_an_odd_window(centre, shape, window, side):
    psf, _ = psf_table([[grid_with_mark(x=1, y=2, centre=centre, shape=shape)]], side)
    assert psf.shape == (1, 1, window, window)
    assert mark(psf[0, 0]) == ((2, 1) if side == "+y" else (-2, -1))


def test_psfs_have_unit_sum_on_any_scale():
    grids = [[PsfGrid("a", scale * np.ones((5, 5)), 0.25, (2, 2)) for scale in (1e-300, 1.0, 1e200)]]
    assert psf_table(grids, "+y")[0].sum(axis=(2, 3)) == pytest.approx(1, abs=1e-6)


def comatic(count, pitch, chief):
    """An aberrated PSF at f/2 and 500 nm, from its pupil integral; rows ascend with y."""
    t = np.linspace(-1, 1, 81)
    y, x = np.meshgrid(t, t, indexing="ij")
    pupil = (x**2 + y**2 <= 1) * np.exp(2j * np.pi * 0.5 * (3 * (x**2 + y**2) * y - 2 * y))
    wave = np.exp(1j * np.pi * np.outer((np.arange(count) - chief) * pitch, t))  # in units of wavelength x f-number
    return np.abs(wave @ pupil @ wave.T)**2


@pytest.mark.parametrize("pitch, misplaced", [(0.48, 2e-3), (0.35, 2e-3)], ids=["as coarse as an FFT", "finer"])
def test_interpolation_preserves_light_and_shape_without_negative_values(pitch, misplaced):
    finest = PsfGrid("fine", comatic(161, 0.3, 80), 0.3, (80, 80))
    coarse = PsfGrid("coarse", comatic(128, pitch, 63), pitch, (63, 63))
    psf, pitch_um = psf_table([[coarse], [finest]], "+y")
    assert pitch_um == 0.3 and psf.min() >= 0
    np.testing.assert_allclose(psf.sum(axis=(2, 3)), 1, atol=1e-6)
    middle = slice(psf.shape[2] // 2 - 80, psf.shape[2] // 2 + 81)
    result, true = psf[0, 0, middle, middle], psf[1, 0, middle, middle]
    assert np.abs(result / result.sum() - true).sum() < misplaced
    v = np.arange(-80, 81)
    assert (result.sum(axis=1) @ v) / result.sum() == pytest.approx(true.sum(axis=1) @ v, abs=0.02)


def test_pitches_that_differ_only_by_rounding_are_equal():
    values = np.random.default_rng(1).random((9, 9))
    psf, _ = psf_table([[PsfGrid("a", values, 0.25, (4, 4)), PsfGrid("b", values, 0.250001, (4, 4))]], "+y")
    np.testing.assert_array_equal(psf[0, 0], psf[0, 1])


@pytest.mark.parametrize("values, pitch, centre, field", [
    (np.ones((2, 5)), 1, (1, 1), "PSF"), (np.zeros((5, 5)), 1, (2, 2), "PSF"),
    (np.full((5, 5), np.nan), 1, (2, 2), "PSF"), (np.full((5, 5), np.inf), 1, (2, 2), "PSF"),
    (np.eye(5) - 0.1, 1, (2, 2), "PSF"), (np.eye(5), 0, (2, 2), "PSF spacing"),
    (np.eye(5), np.nan, (2, 2), "PSF spacing"), (np.eye(5), 1, (5, 2), "PSF centre"),
    (np.eye(5), 1, (2, -1), "PSF centre")],
    ids=["small", "dark", "nan", "inf", "logarithmic", "no pitch", "nan pitch", "row beyond", "column beyond"])
def test_an_invalid_psf_is_refused(values, pitch, centre, field):
    with refused(LensError, field=field):
        PsfGrid("a.txt", values, pitch, centre)


def test_tiny_negative_samples_are_clipped_to_zero():
    assert PsfGrid("a", np.eye(5) - 1e-5, 1, (2, 2)).values.min() == 0


def test_psfs_of_very_different_pitch_are_refused():
    grids = [[PsfGrid("fine", np.eye(5), 1e-4, (2, 2)), PsfGrid("coarse", np.eye(5), 10.0, (2, 2))]]
    with refused(LensError, field="PSFs", where="fine", match="too many"):
        psf_table(grids, "+y")


def test_windows_grow_to_hold_a_chief_ray_near_the_edge():
    values = np.zeros((3, 40))
    values[1, -1] = 1
    psf, _ = psf_table([[PsfGrid("a", values, 1.0, (1, 1))]], "+y")
    assert psf.shape[2:] == (77, 77) and mark(psf[0, 0]) == (0, 38)


def test_light_only_in_the_unpaired_row_is_refused():
    values = np.zeros((8, 8))
    values[0] = 1
    with refused(LensError, field="PSF", value="0 around its centre", where="a.txt"):
        psf_table([[PsfGrid("a.txt", values, 1.0, (4, 4))]], "+y")
