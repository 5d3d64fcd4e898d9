"""The position of the image plane: MTF on the axis against closed forms and PSFs, and the planes chosen by it."""

from dataclasses import replace

import numpy as np
import pytest

from lens_texts import SURFACES
from lensfield.engine import LensError
from lensfield.engine.bake.diffraction import point_spread
from lensfield.engine.bake.quality import QUALITIES
from lensfield.engine.bake.wavefront import trace_wavefronts
from lensfield.engine.library import BUNDLED
from lensfield.engine.prescription.glasses import find_glass
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.prescription.readers import read_prescription
from lensfield.engine.rays.axial_image import FAN, trace_axial_bundles, white_mtf
from lensfield.engine.rays.focus import FULL_FRAME_MM, LINES_PER_MM, WHITE_NM, build_system, focused
from lensfield.engine.rays.rays import HalfPupil, trace_pupil
from lensfield.engine.spectral.spectra import colour_matching
from refusals import refused
from varied_lenses import RADIAL

NM, UM = 550.0, 0.55
SINGLET = Prescription("singlet", SURFACES, ("entrance_pupil_diameter_mm", 5.0), ("angle_deg", 14.0), focus="best")


def bundled(name, **changes):
    return replace(read_prescription(BUNDLED / "prescriptions" / f"{name}.toml"), **changes)


def perfect(f_number, **changes):
    """Flat in front, with a rear hyperboloid of conic -n^2: all axial rays meet at one point, at one wavelength."""
    index, = find_glass("N-BK7", "", "").index_at([NM])
    surfaces = (Surface(thickness_mm=5.0, glass="N-BK7", stop=True), Surface((1 - index) * 50.0, 50.0, conic=-index**2))
    return replace(Prescription("hyperbola", surfaces, ("f_number", f_number), ("angle_deg", 5.0),
                                reference_wavelength_nm=NM), **changes)


def image_plane_mm(lens):
    return build_system(lens).prescription.surfaces[-1].thickness_mm


def mean_mtf(lens, shifts_mm, diagonal_mm):
    """The value that the best focus maximises, in planes shifted from the lens's image plane."""
    bundles = trace_axial_bundles(build_system(lens), WHITE_NM)
    scale = FULL_FRAME_MM / diagonal_mm
    return np.mean([white_mtf(bundles, scale * lines, shifts_mm) for lines in LINES_PER_MM], axis=0)


def spots_um(lens, shifts_mm=(0.0,)):
    """RMS distance of the axial rays from the axis, along one direction, in planes shifted from the lens's image plane.
    """
    system = build_system(lens)
    rays = trace_pupil(system, [0.0], WHITE_NM, HalfPupil(257, 1))
    square_mm2, place_mm, source = (values[..., 0, :, 0] for values in (
        rays.square_height_mm2, rays.position_mm[1], rays.source[1]))
    passing = np.all(square_mm2 <= system.semi_apertures_mm[:, None, None]**2, axis=0)
    light = passing * source * np.gradient(source, axis=1) * colour_matching(WHITE_NM)[:, 1, None]
    light[:, -1] /= 2  # trapezoidal rule
    slope = (rays.direction[1] / rays.direction[2])[:, 0, :, 0]
    landing_mm = place_mm + np.multiply.outer(shifts_mm, slope)
    return 1e3 * np.sqrt(np.sum(light * landing_mm**2, axis=(1, 2)) / light.sum() / 2)


def test_mtf_of_a_perfect_lens_is_that_of_a_disc():
    """In direction cosines the pupil is a disc, evenly lit except for the square of its numerical aperture, 1 / 32."""
    bundle, = trace_axial_bundles(build_system(perfect(16.0)), [NM])
    assert bundle.aperture == pytest.approx(np.sin(np.arctan(1 / 32)), rel=1e-3)
    assert bundle.cutoff_lp_mm == pytest.approx(2e3 * bundle.aperture / UM)
    for share in (0.01, 0.2, 0.5, 0.9, 1.0, 1.5):
        inside = min(share, 1.0)
        expected = 2 / np.pi * (np.arccos(inside) - inside * np.sqrt(1 - inside**2))
        assert bundle.contrast(share * bundle.cutoff_lp_mm, [0.0])[0] == pytest.approx(expected, abs=1 / 32**2)


@pytest.mark.parametrize("name, shift_mm", [("nikkor-28mm", 0.0), ("angenieux-50mm", 0.0), ("angenieux-50mm", 0.03),
                                            ("apple-phone-4mm", -0.004), ("edmund-54852", 0.02)])
def test_mtf_is_that_of_the_psf(name, shift_mm):
    """Against the Fourier transform of the PSF and of its square samples: equal to 0.2 %, except for clipped light."""
    system = build_system(bundled(name))
    bundle, = trace_axial_bundles(system, [NM])
    *before, last = system.prescription.surfaces
    moved = replace(system.prescription, surfaces=(*before, replace(last, thickness_mm=last.thickness_mm + shift_mm)))
    reference = QUALITIES["reference"]
    wavefront = trace_wavefronts(build_system(moved), [0.0], [NM], reference.pupil).one(0, 0)
    pitch_um, samples = 0.25 * UM / bundle.aperture, 401
    psf = point_spread(wavefront, pitch_um, samples, reference.sums)
    offset_mm = 1e-3 * pitch_um * (np.arange(samples) - samples // 2)
    for lp_mm in (20.0, 60.0):
        expected = np.sum(psf * np.cos(2 * np.pi * lp_mm * offset_mm)) / np.sinc(lp_mm * 1e-3 * pitch_um)
        assert bundle.contrast(lp_mm, [shift_mm])[0] == pytest.approx(expected, abs=2e-3 + 1 - psf.sum())


def contrast_about(lens, planes=1500):
    """Mean MTF in the focus, and in planes around it beyond the range of the search."""
    reach_mm = 4 * abs(image_plane_mm(lens) - image_plane_mm(replace(lens, focus="paraxial")))
    best, *about = mean_mtf(lens, [0.0, *np.linspace(-reach_mm, reach_mm, planes)], np.hypot(*lens.sensor_mm))
    return np.array(about), best


@pytest.mark.parametrize("behind_mm, pupil_mm", [(40.0, 202.0), (49.99, None), (50.0, None), (50.01, None)])
def test_a_lens_that_is_telecentric_towards_its_object_is_an_error(behind_mm, pupil_mm):
    """The focal length is 25 mm / 0.5, from the rear vertex, as the front is flat: its principal plane is 2 mm behind
    the front. The stop is imaged by 1/40 - 1/50 = 1/200."""
    surfaces = (Surface(thickness_mm=3.0, glass="1.5/60"), Surface(-25.0, behind_mm),
                Surface(thickness_mm=60.0, stop=True))
    lens = Prescription("telecentric", surfaces, ("stop", 2.0), ("object_height_mm", 4.0), 100.0, focus="paraxial")
    if pupil_mm:
        assert build_system(lens).entrance_pupil_mm == pytest.approx(pupil_mm)
        return
    with pytest.raises(LensError, match="entrance pupil is .*: the lens is telecentric towards its object"):
        build_system(lens)


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", RADIAL)  # others are at the least spot: test_two_sections_focus.py
def test_the_best_focus_has_more_contrast_than_any_other(name):
    about, best = contrast_about(bundled(name, focus="best"))
    assert best > about.max() - 2e-5


def test_the_sharpest_of_several_sharp_planes_is_chosen():
    """For the lines of half the sensor, twice as fine, contrast oscillates as the image plane moves."""
    about, best = contrast_about(bundled("angenieux-50mm", focus="best", sensor_mm=(12.45, 9.35)))
    tops = (np.diff(about[:-1]) > 0) & (np.diff(about[1:]) < 0) & (about[1:-1] > 0.6 * best)
    assert tops.sum() > 1 and best > about.max() - 1e-5


@pytest.mark.parametrize("name, field_um, least_um", [("cooke-speed-panchro-35mm", 37.0, 9.8),
                                                      ("angenieux-50mm", 27.9, 10.5)])
def test_light_off_the_axis_does_not_shift_the_focus(name, field_um, least_um):
    """Spot sizes from another tracer, with a slightly different white."""
    best, field = (bundled(name, focus=focus) for focus in ("best", "field"))
    assert spots_um(field)[0] == pytest.approx(field_um, rel=0.05)
    assert spots_um(best, np.linspace(-0.2, 0.2, 401)).min() == pytest.approx(least_um, rel=0.05)
    assert spots_um(best)[0] < 0.6 * spots_um(field)[0]


def test_the_wide_open_focus_is_retained_when_stopped_down():
    """At full-frame frequencies, the Angenieux's focus shifts by 0.09 mm from f/1.1 to f/4."""
    wide = bundled("angenieux-50mm", focus="best", sensor_mm=(36.0, 24.0))
    stopped = replace(wide, aperture=("f_number", 4.0))
    held = replace(focused(wide), aperture=("f_number", 4.0))
    assert image_plane_mm(held) == image_plane_mm(wide)
    assert build_system(held).stop_semi_aperture_mm == pytest.approx(build_system(stopped).stop_semi_aperture_mm)
    assert image_plane_mm(stopped) - image_plane_mm(held) == pytest.approx(0.09, abs=5e-3)


def test_frequencies_scale_with_the_diagonal():
    """Doubling lens and sensor gives the same focus, except for diffraction; without a sensor, the picture is used."""
    lens = bundled("angenieux-50mm")
    off_mm = [image_plane_mm(each) - image_plane_mm(replace(each, focus="paraxial"))
              for each in (lens, replace(lens.scaled(2), sensor_mm=(49.8, 37.4)))]
    aperture = trace_axial_bundles(build_system(lens), [NM])[0].aperture
    assert off_mm[1] == pytest.approx(2 * off_mm[0], abs=1e-3 * UM / aperture**2)
    alone = replace(lens, sensor_mm=None)
    chief = trace_pupil(build_system(alone), [15.9], [lens.reference_wavelength_nm], HalfPupil(1, 1))
    picture_mm = tuple(chief.chief_height_mm[0, 0] * np.array([1.6, 1.2]))
    assert image_plane_mm(alone) == pytest.approx(image_plane_mm(replace(lens, sensor_mm=picture_mm)), abs=1e-4)


@pytest.mark.parametrize("f_number, sensor_mm", [(64.0, None), (32.0, (1.0, 0.5))])
def test_focus_uses_only_lines_that_diffraction_passes(f_number, sensor_mm):
    """A lens without aberrations at one wavelength and with little colour at others: the focus is as designed."""
    lens = perfect(f_number, focus="best", sensor_mm=sensor_mm)
    colour_mm = 50.0 / 64.2  # between the C and F lines, by the glass's Abbe number
    assert abs(image_plane_mm(lens) - 50.0) < 0.25 * colour_mm


def test_an_aperture_behind_the_stop_cuts_the_axial_beam_too():
    """It is equivalent to a smaller stop that passes the same rays."""
    cut = replace(SINGLET, surfaces=(*SURFACES[:2], replace(SURFACES[2], semi_aperture_mm=4.0)),
                  aperture=("f_number", 4.5), sensor_mm=(36.0, 24.0))
    bundles = trace_axial_bundles(build_system(cut), WHITE_NM)
    fan = trace_pupil(build_system(replace(cut, surfaces=SURFACES)), [0.0], [WHITE_NM[0]], FAN)
    at_last = np.sqrt(fan.square_height_mm2[2].ravel())
    assert bundles[0].aperture == pytest.approx(np.interp(4.0, at_last, -fan.direction[1].ravel()), rel=1e-6)
    radius = np.interp(4.0, at_last, FAN.radii) * build_system(cut).stop_semi_aperture_mm
    smaller = replace(cut, surfaces=SURFACES, aperture=("stop", radius))
    assert image_plane_mm(cut) == pytest.approx(image_plane_mm(smaller), abs=2e-3)


def test_near_the_front_focus_the_image_is_far_away():
    lens = replace(SINGLET, object_distance_mm=48.0, field=("image_height_mm", 20.0), sensor_mm=(36.0, 24.0))
    far_mm = image_plane_mm(lens)
    assert far_mm > 500
    about, best = contrast_about(lens)
    assert best > about.max() - 1e-5


@pytest.mark.parametrize("glass, nm", [("IRG27", 625.0), ("IRG24", 1000.0)])
@pytest.mark.parametrize("focus", ["best", "field"])
def test_wavelengths_outside_the_range_of_a_glass_are_left_out(focus, glass, nm):
    """IRG27 is defined from 600 nm on, IRG24 from 800 nm on, where the reference wavelength decides."""
    surfaces = (SURFACES[0], replace(SURFACES[1], glass=glass, radius_mm=170.0), replace(SURFACES[2], radius_mm=-170.0))
    lens = replace(SINGLET, surfaces=surfaces, reference_wavelength_nm=nm, focus=focus)
    assert image_plane_mm(lens) == pytest.approx(image_plane_mm(replace(lens, focus="paraxial")), rel=0.03)


def test_a_beam_reduced_to_its_chief_ray_has_no_focus():
    surfaces = tuple(replace(surface, semi_aperture_mm=np.inf) for surface in SURFACES)
    with refused(LensError, field="field height", where="singlet",
                 match="only the chief ray gets through here at 450 nm"):
        build_system(replace(SINGLET, surfaces=surfaces, aperture=("stop", 2000.0)))
