"""Relative illumination and nearest samples, against the lens's tables and the engine's own distortion."""

import numpy as np
import pytest

from lensfield.engine import Lens, Options, SpectralImage, simulate
from lensfield.engine.field.distortion import FieldGeometry
from lensfield.engine.field.frame_planes import nearest_samples, relative_illumination
from lensfield.engine.field.overscan import choose_capture
from lensfield.engine.image.irradiance import irradiance_per_radiance
from lensfield.engine.image.pitch import fitting_pitch_um
from lensfield.engine.image.pixel_grid import PixelGrid
from varied_lenses import varied_lens

FRAME = (91, 121)


def capture_of(lens, nm):
    return choose_capture(lens, PixelGrid(FRAME, fitting_pitch_um(lens, FRAME)), [nm], 5)


@pytest.mark.parametrize("name", ["edmund-54852", "muller-fisheye-25mm"])
def test_nearest_samples_lie_where_the_lens_puts_them(name):
    """Positions of the capture, looked up, differ by half a pixel at most from those that even footprints average."""
    lens, nm = varied_lens(name), 550.0
    capture = capture_of(lens, nm)
    rows, columns = np.indices(capture.shape_px).astype(float)
    field = FieldGeometry(lens.at_wavelength(nm), lens.name)
    x_mm, y_mm = capture.frame().axes_mm()
    seen = [nearest_samples(plane, lens, capture, nm) for plane in (rows, columns)]
    assert all(plane.shape == FRAME and np.all(plane == plane.round()) for plane in seen)
    paraxial_mm = field.paraxial_height_mm(np.hypot(x_mm[None, :], y_mm[:, None]))
    if capture.projection == "equidistant":
        paraxial_mm = lens.capture_focal_length_mm * np.arctan(paraxial_mm / lens.capture_focal_length_mm)
    radius_px = np.hypot(seen[0] - capture.centre_px[0], seen[1] - capture.centre_px[1])
    assert np.abs(radius_px - paraxial_mm / (capture.pitch_um * 1e-3)).max() < 0.5 * np.sqrt(2) + 1e-6


def test_no_two_depths_are_mixed():
    lens, nm = Lens.load("edmund-54852"), 550.0
    capture = capture_of(lens, nm)
    depth = np.where(np.indices(capture.shape_px).sum(axis=0) % 7 < 3, 2.0, 1e10)
    assert set(np.unique(nearest_samples(depth, lens, capture, nm))) == {2.0, 1e10}


@pytest.mark.parametrize("name", ["edmund-54852", "muller-fisheye-25mm"])
def test_relative_illumination_is_that_of_even_light(name):
    lens, nm = varied_lens(name), 550.0
    capture = capture_of(lens, nm)
    even = simulate(SpectralImage(np.ones((1, *capture.shape_px)), [nm], capture), lens, Options(accuracy=0.01)).cube[0]
    axis = irradiance_per_radiance(lens.at_wavelength(nm).transmittance, lens.f_number_effective)
    inner = slice(8, -8), slice(8, -8)
    np.testing.assert_allclose(relative_illumination(lens, capture.frame(), nm)[inner], even[inner] / axis, rtol=0.02)
