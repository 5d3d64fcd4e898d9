"""PSFs and illumination of a perfect lens, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import j1

from lensfield.engine.bake.diffraction import point_spread
from lensfield.engine.bake.wavefront import sample_pupil, trace_wavefronts
from perfect_lens import EFL_MM, perfect_system

NM = 550.0


def wavefront_at(system, angle_deg):
    """All paths to the image point are the same: that is what makes a lens perfect."""
    wavefront, = trace_wavefronts(system, EFL_MM * np.tan(np.radians(angle_deg)), [NM])
    return replace(wavefront, path=np.zeros_like(wavefront.path))


def airy(system, pitch_um, samples):
    """Airy's pattern, 1 in the middle, of the numerical aperture of the marginal ray."""
    aperture = np.sin(np.arctan(0.5 / system.prescription.aperture[1]))
    offset_um = (np.arange(samples) - samples // 2) * pitch_um
    x = 2 * np.pi * aperture / (NM * 1e-3) * np.hypot(offset_um[:, None], offset_um)
    return np.where(x == 0, 1.0, (2 * j1(x) / np.where(x == 0, 1, x)) ** 2)


def half_width(profile):
    """Full width at half maximum about the middle, in samples."""
    profile = profile[profile.size // 2:] / profile[profile.size // 2]
    after = np.argmax(profile < 0.5)
    return 2 * (after - 1 + (profile[after - 1] - 0.5) / (profile[after - 1] - profile[after]))


@pytest.mark.parametrize("f_number", [4.0, 8.0, 16.0])
def test_on_the_axis_it_is_airys_pattern(f_number):
    system = perfect_system(f_number)
    pitch_um = 0.06 * f_number
    psf, _ = point_spread(wavefront_at(system, 0), pitch_um, 101)
    np.testing.assert_allclose(psf / psf.max(), airy(system, pitch_um, 101), atol=2e-3)


def test_the_light_inside_is_that_of_airys_pattern():
    """Rayleigh: 1 - J0^2 - J1^2 of the light within the first dark ring, 83.8 %."""
    system = perfect_system(8.0)
    psf, _ = point_spread(wavefront_at(system, 0), 0.25, 101)
    offset_um = (np.arange(101) - 50) * 0.25
    ring_um = 1.21967 * NM * 1e-3 * 8.0 * 1.002
    assert psf[np.hypot(offset_um[:, None], offset_um) < ring_um].sum() == pytest.approx(0.8378, abs=3e-3)


@pytest.mark.parametrize("angle_deg", [10, 20, 30, 40])
def test_off_the_axis_it_is_as_wide_as_the_oblique_cone_makes_it(angle_deg):
    """The cone narrows by cos^2 to the chief ray, and lies slantwise to the plane in the tangential direction."""
    system = perfect_system(8.0)
    axis, _ = point_spread(wavefront_at(system, 0), 0.25, 121)
    psf, _ = point_spread(wavefront_at(system, angle_deg), 0.25, 121)
    cosine = np.cos(np.radians(angle_deg))
    assert half_width(psf[60]) / half_width(axis[60]) == pytest.approx(1 / cosine, rel=0.01)
    assert half_width(psf[:, 60]) / half_width(axis[:, 60]) == pytest.approx(1 / cosine**3, rel=0.01)


@pytest.mark.parametrize("angle_deg", [10, 20, 30, 40])
def test_its_illumination_falls_with_the_fourth_power_of_the_cosine(angle_deg):
    system = perfect_system(8.0)
    areas = [sample_pupil(wavefront_at(system, angle), 24, 32).ray_area.sum() for angle in (0, angle_deg)]
    assert areas[1] / areas[0] == pytest.approx(np.cos(np.radians(angle_deg)) ** 4, rel=0.015)


def test_its_chief_rays_draw_a_true_picture():
    system = perfect_system(8.0)
    for angle_deg in (5, 25, 44):
        assert wavefront_at(system, angle_deg).chief_height_mm == pytest.approx(
            EFL_MM * np.tan(np.radians(angle_deg)), abs=1e-9)
