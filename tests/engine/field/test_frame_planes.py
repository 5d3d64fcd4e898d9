"""Relative illumination and nearest samples, against the lens's tables and the engine's own distortion."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval
from scipy.ndimage import gaussian_filter

from lenses import make_lens, marked_psf
from lensfield.engine import Options, SpectralImage, load_lens, simulate
from lensfield.engine.field.frame_planes import nearest_samples, pinhole_view, relative_illumination
from lensfield.engine.field.overscan import choose_capture
from lensfield.engine.field.radial.distortion import FieldGeometry
from lensfield.engine.image.irradiance import irradiance_per_radiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import PLANE, Projection
from lensfield.engine.lens.pinhole import fitting_pitch_um
from varied_lenses import varied_lens

FRAME = (91, 121)


def capture_of(lens, nm):
    return choose_capture(lens, PixelGrid(FRAME, fitting_pitch_um(lens, FRAME)), [nm], 5)


@pytest.mark.parametrize("off_px", [(0.0, 0.0), (-7.0, 4.0)], ids=["centred", "off centre"])
@pytest.mark.parametrize("name", ["edmund-54852", "muller-fisheye-25mm"])
def test_nearest_samples_follow_the_distortion_of_the_lens(name, off_px):
    """Look-ups in the capture differ by at most half a pixel from averages over uniform footprints.

    This holds in rows and in columns, with their signs.
    """
    lens, nm = varied_lens(name), 550.0
    capture = capture_of(lens, nm)
    capture = replace(capture, centre_px=tuple(np.add(capture.centre_px, off_px)))
    indices = np.indices(capture.shape_px).astype(float)
    field = FieldGeometry(lens.at_wavelength(nm), lens.name)
    planes = [nearest_samples(plane, lens, capture, nm) for plane in indices]
    assert all(plane.shape == FRAME and np.all(plane == plane.round()) for plane in planes)
    down_px, right_px = (np.arange(n) - at for n, at in zip(FRAME, capture.frame().centre_px, strict=True))
    radius_px = np.hypot(right_px[None, :], down_px[:, None])
    paraxial_mm = field.paraxial_height_mm(radius_px * capture.pitch_um * 1e-3)
    focal_mm = lens.capture_focal_length_mm
    shown = np.linspace(0, 3, 300001)  # of focal lengths
    angles_rad = polyval(shown, (0, *capture.projection.angle_per_radius))
    paraxial_mm = focal_mm * np.interp(np.arctan(paraxial_mm / focal_mm), angles_rad, shown)
    scale = paraxial_mm / (capture.pitch_um * 1e-3) / np.maximum(radius_px, 1e-9)
    for plane, offset_px, centre, count in zip(planes, (down_px[:, None], right_px[None, :]), capture.centre_px,
                                               capture.shape_px, strict=True):
        expected = np.clip(centre + scale * offset_px, 0, count - 1)
        assert np.abs(plane - expected)[radius_px > 0].max() < 0.5 + 1e-6


def test_depths_are_never_mixed():
    lens, nm = load_lens("edmund-54852"), 550.0
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


def test_relative_illumination_includes_the_light_that_psfs_move():
    """The lens's light arrives a twentieth of its height farther out than its chief rays, except next to the axis."""
    moving = np.stack([[gaussian_filter(marked_psf(step, 0), 1.5) for step in range(11)]])  # 10 um per 0.2 mm
    lens = make_lens(moving, None, lambda nm, p: 1 + 0.05 * p**2, wavelengths_nm=(550.0,), psf_pitch_um=10.0,
                     transmittance=0.5)
    grid = PixelGrid((61, 81), 25.0, centre_px=(21.0, 50.0))
    even = simulate(SpectralImage(np.ones((1, *grid.shape_px)), [550.0], grid), lens, Options(accuracy=0.001)).cube[0]
    plane = relative_illumination(lens, grid, 550.0)
    down_px, right_px = np.ogrid[-21:40, -50:31]
    radius_px = np.hypot(down_px, right_px)
    far = (radius_px > 12) & (radius_px < 64)
    far[:8], far[-8:], far[:, :8], far[:, -8:] = False, False, False, False  # light from outside the picture is missing
    one = 40, 20
    np.testing.assert_allclose((plane / plane[one])[far], (even / even[one])[far], rtol=0.02)  # ripples of tables
    chief = 1 + 0.05 * (radius_px * 0.025)**2
    assert np.all(plane[far] < 0.985 * chief[far])


@pytest.mark.parametrize("projection", [PLANE, Projection((0.95, 0.05, -0.1))])
@pytest.mark.parametrize("times", [1.0, 1.3])
def test_a_pinhole_shows_directions_at_their_tangents(projection, times):
    """Of a capture whose pixels contain the tangents of their directions to the right and up."""
    lens = load_lens("edmund-54852")
    focal_mm = lens.capture_focal_length_mm
    frame = PixelGrid((30, 40), 100.0, (12.0, 23.5))
    capture = replace(frame.framed(25), projection=projection, focal_mm=times * focal_mm)
    x_mm, y_mm = np.meshgrid(*capture.axes_mm())
    radius = np.hypot(x_mm, y_mm) / capture.focal_mm
    tangents = np.array([x_mm, y_mm]) / capture.focal_mm * np.tan(projection.angle_rad(radius)) / radius
    expected = np.array(np.meshgrid(*frame.axes_mm())) / focal_mm
    np.testing.assert_allclose(pinhole_view(tangents, lens, capture), expected, atol=2e-3 * np.abs(expected).max())
