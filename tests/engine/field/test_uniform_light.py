"""Uniform light on the sensor: computed for single pixels, and as uniform as in finer pixels."""

import numpy as np
import pytest

from lenses import comatic_lens
from lensfield.engine import Options, SpectralImage, simulate
from lensfield.engine.bake.bake import bake
from lensfield.engine.field.radial.distortion import FieldGeometry
from lensfield.engine.field.radial.psf_bank import PsfBank
from lensfield.engine.field.radial.uniform_light import UniformLight, unevenness
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.library import load_lens, package_path, prescription_of
from lensfield.engine.rays.rings import turned
from varied_lenses import RADIAL

WIDTHS_PX, NM, MOST = (192, 640, 1920), (450.0, 550.0, 650.0), 0.01


def uniform_light(lens, nm, pitch_mm):
    optics = lens.at_wavelength(nm)
    field, bank = FieldGeometry(optics, lens.name), PsfBank.of(optics, 1e3 * pitch_mm).trimmed(0.9999)
    return UniformLight(bank, field, pitch_mm), bank, field


@pytest.mark.parametrize("centre_px", [(14.5, 19.5), (12.0, 20.3)])
@pytest.mark.parametrize("method", ["exact", "pixels", "sections"])
def test_a_pixel_is_as_bright_as_in_the_picture(method, centre_px):
    lens, pitch_mm = comatic_lens(transmittance=0.6), 8e-3
    grid = PixelGrid((30, 41), 1e3 * pitch_mm, centre_px)
    even = SpectralImage(np.full((1, *grid.shape_px), 2.0), [550.0], grid)
    picture = simulate(even, lens, Options(method=method)).cube[0]
    rows, columns = np.array([10, 12, 15, 17]), np.array([18, 20, 22, 25])
    light, _, _ = uniform_light(lens, 550.0, pitch_mm)
    expected = light.at(columns - centre_px[1], centre_px[0] - rows)
    radiance = 2 * 0.6 * np.pi / 4 / lens.f_number_effective**2
    np.testing.assert_allclose(picture[rows, columns] / radiance, expected, rtol=2e-3 if method == "exact" else 1e-2)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", RADIAL)  # test_grid_field.py has the test for the others
def test_uniform_light_is_uniform_at_every_pitch(name):
    """On the axis, where PSFs of adjacent pixels differ most, and over the field against the finest pixels; the heights
    of a preview are few for an f/1.2 with glow."""
    lens = load_lens(name) if package_path(name) else bake(turned(prescription_of(name)).prescription,
                                                          quality="preview", wavelengths_nm=NM)
    places_mm = np.linspace(0.1, 0.9, 5) * min(lens.real_height_mm[:, -1].min(), np.hypot(*lens.sensor_mm) / 2)
    for nm in NM[::2]:
        along = {}
        for width_px in WIDTHS_PX:
            pitch_mm = lens.sensor_mm[0] / width_px
            light, bank, field = uniform_light(lens, nm, pitch_mm)
            assert unevenness(bank, field, PixelGrid((2, width_px), 1e3 * pitch_mm)) < 1.25 * MOST
            along[width_px] = light.at(0.8 * places_mm / pitch_mm, 0.6 * places_mm / pitch_mm)
        for width_px in WIDTHS_PX[:2]:
            np.testing.assert_allclose(along[width_px], along[WIDTHS_PX[-1]], rtol=MOST)
