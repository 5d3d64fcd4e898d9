"""Colours of wavelengths, and of points of white light."""

import numpy as np
import pytest

from lenses import gaussian_psf, make_lens
from lensfield.engine.inspection.white_light import wavelength_colours, white_psfs
from lensfield.engine.spectral.colour import XYZ_TO_REC709
from lensfield.engine.spectral.spectra import colour_matching


@pytest.mark.parametrize("nm, order", [(450, "bgr"), (480, "bgr"), (540, "gbr"), (590, "rgb"), (650, "rbg")])
def test_wavelengths_have_their_colours(nm, order):
    colour = dict(zip("rgb", wavelength_colours([nm])[0], strict=True))
    assert max(colour, key=colour.get) == order[0]


def test_colours_of_wavelengths_are_distinct_and_readable_on_white():
    colours = wavelength_colours(np.arange(400, 701, 50))
    assert np.all((colours >= 0) & (colours <= 1))
    apart = np.abs(colours[:, None] - colours).max(axis=-1)
    assert apart[~np.eye(7, dtype=bool)].min() > 0.1
    assert (colours @ [0.2126, 0.7152, 0.0722]).max() < 0.65


def test_invisible_wavelengths_are_grey():
    assert np.ptp(wavelength_colours([250.0, 900.0, 10600.0]), axis=1).max() == 0


def test_a_lens_without_colour_errors_makes_white_points():
    lens = make_lens(gaussian_psf(3, 5, 2.5, 17))
    white = white_psfs(lens, [0, 10])
    middle = white.shape[1] // 2
    assert white[1, middle - 8:middle + 9] == pytest.approx(np.repeat(lens.psf[0, 0][..., None], 3, axis=-1), abs=1e-9)


def test_lateral_colour_moves_each_primary_by_its_light():
    """The centroid of each primary's light is the mean displacement of its wavelengths."""
    lens = make_lens(real_height_mm=lambda nm, p: p * (1 + 5e-5 * (nm - 550)), psf_pitch_um=2.5)
    white = white_psfs(lens, [0, 10])
    assert white.sum(axis=(1, 2)) == pytest.approx(1)
    nm = np.arange(380.0, 781)
    moved_um = 2e3 * 5e-5 * (np.clip(nm, 400, 700) - 550)
    rec709 = colour_matching(nm) @ XYZ_TO_REC709.T
    expected_um = moved_um @ rec709 / rec709.sum(axis=0)
    offset_um = 2.5 * (np.arange(white.shape[1]) - white.shape[1] // 2)
    middle_um = np.einsum("v,hvuc->hc", offset_um, white)
    np.testing.assert_allclose(middle_um[1], expected_um, atol=1e-6)
    np.testing.assert_allclose(middle_um[0], 0, atol=1e-9)
    assert middle_um[1, 0] > middle_um[1, 1] > middle_um[1, 2]


@pytest.mark.parametrize("wavelengths_nm", [(550.0,), (600.0, 700.0), (850.0, 950.0)])
def test_points_stay_white_where_the_lens_data_hold_few_colours(wavelengths_nm):
    white = white_psfs(make_lens(gaussian_psf(3, 3, 2.5, 9), wavelengths_nm=wavelengths_nm), [0])
    assert white.sum(axis=(1, 2)) == pytest.approx(1) and np.ptp(white, axis=-1).max() < 1e-6
