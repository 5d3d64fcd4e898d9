"""PSFs and illumination of a perfect lens, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import j0, j1

from lensfield.engine import LensError
from lensfield.engine.bake import diffraction
from lensfield.engine.bake.diffraction import Sums, point_spread
from lensfield.engine.bake.pupil_fit import fit_pupils
from lensfield.engine.bake.quality import QUALITIES
from lensfield.engine.bake.spots import spot_diagram
from perfect_lens import EFL_MM, perfect_wavefronts
from refusals import refused

UM = 0.55
PROMISED = {"preview": 0.03, "standard": 0.01, "reference": 0.002}  # share of the light in the wrong place
FINE = Sums(degree=16, oversampling=4.0, repeat=4.0)


def psf_at(f_number, angle_deg, pitch_um, samples, sums=FINE, **lens):
    return point_spread(perfect_wavefronts(f_number, [angle_deg], **lens).one(0, 0), pitch_um, samples, sums)


def aperture(f_number):
    return np.sin(np.arctan(0.5 / f_number))


def radius_um(pitch_um, samples):
    offset_um = (np.arange(samples) - samples // 2) * pitch_um
    return np.hypot(offset_um[:, None], offset_um)


def airy(f_number, pitch_um, samples):
    """The Airy pattern, 1 in the middle, for the numerical aperture of the marginal ray."""
    x = 2 * np.pi * aperture(f_number) / UM * radius_um(pitch_um, samples)
    return np.where(x == 0, 1.0, (2 * j1(x) / np.where(x == 0, 1, x)) ** 2)


def half_width(profile):
    """Full width at half maximum about the middle, in samples."""
    profile = profile[profile.size // 2:] / profile[profile.size // 2]
    after = np.argmax(profile < 0.5)
    return 2 * (after - 1 + (profile[after - 1] - 0.5) / (profile[after - 1] - profile[after]))


@pytest.mark.parametrize("f_number", [4.0, 8.0, 16.0])
def test_the_axial_psf_is_airys_pattern(f_number):
    pitch_um = 0.06 * f_number
    psf = psf_at(f_number, 0, pitch_um, 101)
    np.testing.assert_allclose(psf / psf.max(), airy(f_number, pitch_um, 101), atol=2e-3)


@pytest.mark.parametrize("quality", QUALITIES)
def test_the_enclosed_light_matches_airys_pattern(quality):
    """Rayleigh: 1 - J0^2 - J1^2 of the light is within a circle; outside a square is 0.9 of that outside its circle."""
    for pitch_um, samples in ((0.25, 101), (1.0, 201)):
        psf = psf_at(5.0, 0, pitch_um, samples, QUALITIES[quality].sums)
        ring = 1.21967 / 2 * UM / aperture(5.0) * 1.002
        v = 2 * np.pi * aperture(5.0) / UM * ring
        assert psf[radius_um(pitch_um, samples) < ring].sum() == pytest.approx(1 - j0(v)**2 - j1(v)**2, abs=5e-3)
        beyond = 0.9 * UM / (np.pi**2 * aperture(5.0) * pitch_um * samples / 2)
        assert psf.sum() == pytest.approx(1 - beyond, abs=1e-3)


@pytest.mark.parametrize("f_number, pitch_um", [(4.0, 6.3), (2.0, 6.3)])
@pytest.mark.parametrize("quality", QUALITIES)
def test_samples_are_means_over_squares(quality, f_number, pitch_um):
    """Of the fine samples within each square, in a window that contains 99.4 % of the light."""
    ratio = 21
    coarse = psf_at(f_number, 0, pitch_um, 21, QUALITIES[quality].sums)
    fine = psf_at(f_number, 0, pitch_um / ratio, 21 * ratio)
    assert np.abs(coarse - fine.reshape(21, ratio, 21, ratio).sum(axis=(1, 3))).sum() < PROMISED[quality]


@pytest.mark.parametrize("waves", [0.5, 1.0, 2.5])
def test_defocus_dims_the_middle_by_the_sinc_of_its_waves(waves):
    """Born and Wolf 8.8.2: axial intensity follows the squared sinc of the waves at the pupil's edge."""
    defocus_mm = waves * UM * 1e-3 / (1 - np.cos(np.arctan(0.5 / 20.0)))
    sharp = psf_at(20.0, 0, 0.5, 51)
    blurred = psf_at(20.0, 0, 0.5, 51, defocus_mm=defocus_mm)
    assert blurred[25, 25] / sharp[25, 25] == pytest.approx(np.sinc(waves)**2, abs=4e-3)


@pytest.mark.parametrize("angle_deg", [10, 20, 30, 40])
def test_off_the_axis_the_psf_widens_with_the_oblique_cone(angle_deg):
    """The cone narrows by cos^2 towards the chief ray, and meets the plane obliquely in the tangential direction."""
    axis, psf = psf_at(8.0, 0, 0.25, 121), psf_at(8.0, angle_deg, 0.25, 121)
    cosine = np.cos(np.radians(angle_deg))
    assert half_width(psf[60]) / half_width(axis[60]) == pytest.approx(1 / cosine, rel=0.01)
    assert half_width(psf[:, 60]) / half_width(axis[:, 60]) == pytest.approx(1 / cosine**3, rel=0.01)


def test_its_illumination_falls_with_the_fourth_power_of_the_cosine():
    angles_deg = np.array([0, 10, 20, 30, 40])
    area = perfect_wavefronts(8.0, angles_deg).areas(24, 32)[0][0]
    np.testing.assert_allclose(area / area[0], np.cos(np.radians(angles_deg))**4, rtol=0.015)
    assert area[0] == pytest.approx(np.pi * aperture(8.0)**2, rel=1e-9)


def test_its_beam_has_the_apparent_width_of_its_pupil():
    angles_deg = np.array([0, 10, 20, 30, 40])
    area = perfect_wavefronts(8.0, angles_deg).areas(24, 32)[1][0]
    np.testing.assert_allclose(area, np.pi * (EFL_MM / 16)**2 * np.cos(np.radians(angles_deg)), rtol=1e-9)


def test_wavefronts_are_interpolated_between_wavelengths():
    """Phases are recomputed, and paths stay the same."""
    blue, red = (perfect_wavefronts(8.0, [0, 20], nm) for nm in (450.0, 650.0))
    assert blue.at([500.0]).chief_height_mm[0, 1] == pytest.approx(EFL_MM * np.tan(np.radians(20)))
    np.testing.assert_allclose(blue.at([650.0]).path_mm, red.path_mm)


def test_lengthened_waves_leave_the_light_where_rays_go():
    """Defocused by 0.5 mm at f/2: a disc of 250 um, whose edge is blurred by less than a pixel of 25 um."""
    few, all_of_them = (psf_at(2.0, 0, 25.0, 15, Sums(12, 1.0, 1.5, fringes), defocus_mm=0.5)
                        for fringes in (12.0, np.inf))
    assert 1e-4 < np.abs(few - all_of_them).sum() < 0.05


@pytest.mark.parametrize("fringes", [8.0, 10.0, 10.0000001, 12.0, 60.0])
def test_a_few_parts_per_sample_resolve_all_waves(fringes):
    """Down to one part per fringe; and 60 fringes are reduced to 12."""
    psf = psf_at(5.0, 0, fringes * UM / (2 * aperture(5.0)), 15, Sums(12, 0.5, 1.0, 12.0))
    assert psf.sum() == pytest.approx(1, abs=0.02) and psf.max() == psf[7, 7]


@pytest.mark.parametrize("angle_deg", [0, 12])
def test_wide_boxes_repeat_closer_without_more_error(angle_deg, monkeypatch):
    """A blurred disc of 250 um at f/2 has up to 450 fringes: its box is surrounded by a fraction of its width."""
    blurred = {"defocus_mm": 0.5, "pitch_um": 10.0, "samples": 45}
    close = psf_at(2.0, angle_deg, sums=QUALITIES["reference"].sums, **blurred)
    monkeypatch.setattr(diffraction, "FEW_FRINGES", np.inf)
    far = psf_at(2.0, angle_deg, sums=QUALITIES["reference"].sums, **blurred)
    assert 0 < np.abs(close - far).sum() < PROMISED["reference"]


def test_waves_are_not_lengthened_where_samples_are_fine():
    wavefront = perfect_wavefronts(5.0, [0]).one(0, 0)
    sums = Sums(12, 1.0, 1.5, 4.0)
    np.testing.assert_array_equal(point_spread(wavefront, 2.0, 21, sums),
                                  point_spread(wavefront, 2.0, 21, replace(sums, fringes=np.inf)))


@pytest.mark.parametrize("pitch_um, sums, defocus_mm", [(2000.0, QUALITIES["preview"].sums, 0.0), (40.0, FINE, 20.0)])
def test_unbounded_blur_is_refused(pitch_um, sums, defocus_mm):
    """Waves lengthened a hundredfold, or a sum of a billion terms."""
    with refused(LensError, field="window", where="PSF", match="too wide"):
        psf_at(2.0, 0, pitch_um, 401, sums, defocus_mm=defocus_mm)


def off_axis_in_defocus(fringes):
    """A wavefront of f/2 at 20 degrees, 0.3 mm out of focus, and the pitch of samples with this number of fringes."""
    wavefront = perfect_wavefronts(2.0, [20], defocus_mm=0.3).one(0, 0)
    return wavefront, fringes / fit_pupils([wavefront], 12, [1e3 * UM])[0].fringes(1e3 * UM, 1.0)


def test_rays_approach_waves_as_samples_hold_more_fringes():
    """For a defocused disc, in proportion to the width of the light that its edge spreads, in samples."""
    errors = []
    for fringes, samples in ((12, 61), (36, 21)):
        wavefront, pitch_um = off_axis_in_defocus(fringes)
        waves = point_spread(wavefront, pitch_um, samples, Sums(12, 2.0, 1.5))
        rays = spot_diagram(wavefront, pitch_um, samples)
        errors.append(np.abs(rays - waves).sum())
        assert rays.sum() == pytest.approx(waves.sum(), abs=1e-3)
        assert np.abs(rays[::-1] - waves).sum() > 10 * errors[-1], "the disc is off the axis"
    assert errors[0] < 0.03 and errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize("f_number, pitch_um, samples", [(2.8, 6.0, 101), (5.0, 6.0, 65), (16.0, 12.0, 65)])
def test_rays_bend_at_the_edge_as_airys_pattern_spreads(f_number, pitch_um, samples):
    """Light outside of a circle of radius r is wavelength / (pi^2 NA r), at distances of several fringes."""
    psf = spot_diagram(perfect_wavefronts(f_number, [0]).one(0, 0), pitch_um, samples)
    for share in (0.25, 0.5, 0.9):
        circle_um = share * pitch_um * samples / 2
        outside = 1 - psf[radius_um(pitch_um, samples) < circle_um].sum()
        assert outside == pytest.approx(UM / (np.pi**2 * aperture(f_number) * circle_um), rel=0.1)


def test_waves_fade_out_where_they_would_be_lengthened():
    """The PSF changes from waves to rays without a step, and is the spot diagram from three times on."""
    psfs = []
    for times in (0.999, 1.001, 1.7, 2.999, 3.001):
        wavefront, pitch_um = off_axis_in_defocus(8 * times)
        fine = Sums(12, 2.0, 1.5, 8.0, 0.02)
        psfs.append((point_spread(wavefront, pitch_um, 31, fine), spot_diagram(wavefront, pitch_um, 31)))
    assert np.abs(psfs[0][0] - psfs[1][0]).sum() < 0.01
    assert np.abs(psfs[3][0] - psfs[4][0]).sum() < 0.01
    np.testing.assert_array_equal(*psfs[4])
    assert [np.abs(psf - rays).sum() > 1e-3 for psf, rays in psfs[1:4]] == [True, True, False]
