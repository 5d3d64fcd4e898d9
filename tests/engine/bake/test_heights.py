"""The choice of field heights, the widths of windows, and wavefronts that fold at the exit pupil."""

import numpy as np
import pytest

from lensfield.engine.bake.diffraction import point_spread
from lensfield.engine.bake.heights import adaptive_heights_mm
from lensfield.engine.bake.quality import QUALITIES
from lensfield.engine.bake.wavefront import trace_wavefronts
from lensfield.engine.bake.window import needed_width_um, pitch_for_um
from lensfield.engine.library import BUNDLED
from lensfield.engine.prescription.readers import read_prescription
from lensfield.engine.rays.field_heights import even_heights_mm
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.rays import HalfPupil, trace_pupil
from perfect_lens import perfect_wavefronts

PREVIEW = QUALITIES["preview"]
COUNT = 9


def system_of_bundled(name):
    return build_system(read_prescription(BUNDLED / "prescriptions" / f"{name}.toml"))


@pytest.fixture(scope="module")
def triplet():
    return system_of_bundled("cooke-triplet-50mm")


def psfs_at(system, heights_mm):
    wavefronts = trace_wavefronts(system, heights_mm, [550.0], PREVIEW.pupil)
    psfs = np.array([point_spread(wavefronts.one(0, height), 12.0, 41, PREVIEW.sums)
                     for height in range(len(heights_mm))])
    return psfs / psfs.sum(axis=(1, 2), keepdims=True)


def errors_between(system, heights_mm):
    """L1 errors of PSFs interpolated half way between two heights."""
    psfs = psfs_at(system, heights_mm)
    between = psfs_at(system, (heights_mm[1:] + heights_mm[:-1]) / 2)
    return np.abs((psfs[1:] + psfs[:-1]) / 2 - between).sum(axis=(1, 2))


def test_even_heights_are_even_over_the_picture(triplet):
    heights_mm = even_heights_mm(triplet, COUNT)
    real_mm = trace_pupil(triplet, heights_mm, [587.5618], HalfPupil(1, 1)).chief_height_mm[0]
    np.testing.assert_allclose(np.diff(real_mm), real_mm[-1] / (COUNT - 1), rtol=1e-5)
    assert (heights_mm[0], heights_mm[-1]) == (0, triplet.last_height_mm)


def test_heights_lie_where_blur_changes(triplet):
    heights_mm, _ = adaptive_heights_mm(triplet, [550.0], 0.0, COUNT, least=5)
    assert (heights_mm[0], heights_mm[-1], heights_mm.size) == (0, triplet.last_height_mm, COUNT)
    assert np.all(np.diff(heights_mm) > 0)
    assert errors_between(triplet, heights_mm).max() < 0.8 * errors_between(
        triplet, even_heights_mm(triplet, COUNT)).max()


def test_the_number_of_heights_follows_the_interpolation_error(triplet):
    """On average over the picture, verified in a different window with different sums."""
    for tolerance in (0.1, 0.05):
        heights_mm, error = adaptive_heights_mm(triplet, [550.0], tolerance, 99)
        mean_error = np.average(errors_between(triplet, heights_mm), weights=np.diff(heights_mm))
        assert error <= tolerance and mean_error < 1.2 * tolerance and 9 < heights_mm.size < 40
    coarse_mm, error = adaptive_heights_mm(triplet, [550.0], tolerance, 12)
    assert coarse_mm.size == 12 and error > tolerance


@pytest.mark.parametrize("f_number", [4.0, 16.0])
def test_a_window_encloses_the_light_of_airys_pattern(f_number):
    """Outside a square of this half side, the share of the light is 0.9 wavelength / (pi^2 NA half side)."""
    width_um = needed_width_um(perfect_wavefronts(f_number, [0, 5]))
    aperture = np.sin(np.arctan(0.5 / f_number))
    assert width_um == pytest.approx(2 * 0.9 * 0.55 / (np.pi**2 * aperture * 0.005), rel=0.05)


def test_defocus_widens_the_window_by_less_than_its_disc():
    sharp_um, blurred_um = (needed_width_um(perfect_wavefronts(4.0, [0], defocus_mm=defocus_mm))
                            for defocus_mm in (0.0, 2.0))
    assert 2000 / 4.0 < blurred_um < 2000 / 4.0 + sharp_um


def test_light_missing_from_coarse_sums_does_not_widen_the_window():
    """For corners whose beams are cut deeply by apertures; the window once grew to metres."""
    system = system_of_bundled("enna-lithagon-24mm")
    wavefronts = trace_wavefronts(system, [system.last_height_mm], [587.56], PREVIEW.pupil)
    rays_um = 2e3 * np.abs(wavefronts.spot_mm[:, 0, 0][:, wavefronts.one(0, 0).passing]).max()
    assert needed_width_um(wavefronts) < 3 * rays_um


def test_no_light_passes_beyond_the_rays():
    """Where apertures leave a third of the stop, the rays end at its rim, but polynomials of the edges continue."""
    system = system_of_bundled("sony-zeiss-55mm-f1.8")
    wavefronts = trace_wavefronts(system, [0.98 * system.last_height_mm], [450.0, 600.0], PREVIEW.pupil)
    for wavelength in range(2):
        one = wavefronts.one(wavelength, 0)
        rays_um = 2e3 * np.abs(wavefronts.spot_mm[:, wavelength, 0][:, one.passing]).max()
        assert point_spread(one, 2 * rays_um / 65, 65, PREVIEW.sums).sum() > 0.99, "within twice the width of the rays"


def test_psfs_can_be_summed_at_every_pitch():
    """Including pitches at which the pupil fills the length of the transform, or exceeds it by a row."""
    perfect = perfect_wavefronts(2.8, [0]).one(0, 0)
    assert all(0.9 < point_spread(perfect, pitch_um, 65, PREVIEW.sums).sum() < 1.01 for pitch_um in range(2, 80))


@pytest.mark.parametrize("width_um, pitch_um", [(100.0, 1.7), (990.0, 16.0), (65 / 1.05, 1.0)])
def test_pitches_have_two_digits(width_um, pitch_um):
    assert pitch_for_um(width_um, 65) == pitch_um


def test_a_phone_whose_rays_cross_before_the_exit_pupil_has_valid_psfs():
    phone = system_of_bundled("apple-phone-4mm")
    heights_mm = np.array([0.9, 0.95]) * phone.last_height_mm
    wavefronts = trace_wavefronts(phone, heights_mm, [400.0], PREVIEW.pupil)
    for height in range(2):
        psf = point_spread(wavefronts.one(0, height), 3.0, 121, PREVIEW.sums)
        assert 0.99 < psf.sum() <= 1.01 and psf.max() == psf[58:63, 58:63].max()


def test_rays_that_nearly_cross_before_the_exit_pupil_keep_their_light_in_place():
    """At two thirds of the phone's field some rays almost cross; a denser grid of rays gives the same light."""
    phone, reference = system_of_bundled("apple-phone-4mm"), QUALITIES["reference"]
    height_mm = even_heights_mm(phone, 4)[2]
    few, many = (point_spread(trace_wavefronts(phone, [height_mm], [420.0], pupil).one(0, 0), 1.0, 61, reference.sums)
                 for pupil in (reference.pupil, HalfPupil(61, 97)))
    assert np.abs(few - many).sum() < 0.002
