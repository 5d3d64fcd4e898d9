"""Lenses from calibrations: their kinds, units, ends of the field, blur and light."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from lensfield import load_lens
from lensfield.engine.calibration.models import KANNALA_BRANDT, RADIAL, RADTAN, RATIONAL
from lensfield.engine.field.field_map import field_map
from lensfield.engine.inspection.checks import check_lens
from lensfield.engine.lens import GridLens, RadialLens
from lensfield.engine.lens_files.package import package_bytes, read_package, write_package
from lensfield.engine.measured.blur import Designed
from lensfield.engine.measured.camera import ModelledCamera
from lensfield.engine.measured.diffraction import perfect_psfs
from lensfield.engine.measured.files import lens_of
from lensfield.engine.measured.lens import measured_lens
from lensfield.engine.measured.options import MeasuredOptions
from lensfield.engine.runtime.errors import InputError, LensError
from measuring import off_px
from refusals import refused

SIZE_PX = 640, 410
MIDDLE_PX = 319.5, 204.5
SENSOR = MeasuredOptions(sensor_mm=(16.0, 12.0))


def camera(model=RADIAL[1], coefficients=(-0.2, 0.05), focal_px=(500.0, 500.0), principal_px=MIDDLE_PX, **more):
    return ModelledCamera("made", "test", SIZE_PX, focal_px, principal_px, model, coefficients, **more)


def project(calibrated):
    return lambda directions: calibrated.pixels(directions[:, :2])


def test_a_symmetric_calibration_is_a_radial_lens():
    lens = lens_of(camera(), SENSOR)
    assert isinstance(lens, RadialLens) and off_px(lens, SIZE_PX, project(camera())) < 1e-3
    assert lens.sensor_mm == (16.0, pytest.approx(410 / 40))
    assert lens.efl_mm == lens.capture_focal_length_mm == pytest.approx(500 / 40)
    assert not [finding for finding in check_lens(lens) if finding.severity != "note"]


@pytest.mark.parametrize("change", [
    {"focal_px": (500.0, 506.0)}, {"principal_px": (330.0, 199.5)},
    {"model": RADTAN, "coefficients": (-0.2, 0.05, 0.004, -0.002)},
    {"model": RATIONAL, "coefficients": (0.3, 0.1, 0, 0, 0.02, 0.7, 0.2, 0.05), "focal_px": (300.0, 300.0)}])
def test_any_other_calibration_is_a_grid(change):
    calibrated = camera(**change)
    lens = lens_of(calibrated, SENSOR)
    assert isinstance(lens, GridLens) and off_px(lens, SIZE_PX, project(calibrated)) <= 0.02
    assert lens.squeeze == 1 and lens.capture_focal_length_mm == pytest.approx(calibrated.focal_px[1] / 40)
    assert not [finding for finding in check_lens(lens) if finding.severity != "note"]


def test_pixels_that_are_twice_as_wide_are_a_squeezed_picture():
    calibrated = camera(RADTAN, (-0.1, 0.02, 0.003, 0.001), (300.0, 600.0), (310.0, 210.0))
    lens = lens_of(calibrated, SENSOR)
    assert lens.squeeze == pytest.approx(2) and off_px(lens, SIZE_PX, project(calibrated)) <= 0.02


def test_a_lens_is_focused_as_a_thin_one():
    """At 1 m: 1/f is 1/1000 + 1/(image distance), and the f-number in image space is 1 - m times as high."""
    lens = lens_of(camera(), replace(SENSOR, focus_mm=1000.0, f_number=4.0))
    image_mm = 12.5
    assert lens.capture_focal_length_mm == pytest.approx(image_mm) and lens.magnification == pytest.approx(-0.0125)
    assert 1 / lens.efl_mm == pytest.approx(1 / 1000 + 1 / image_mm)
    assert lens.f_number_effective == pytest.approx(4 * 1.0125)
    assert off_px(lens, SIZE_PX, project(camera())) < 1e-3
    with refused(LensError, field="focus", match="more than the focal length, 12.5 mm"):
        lens_of(camera(), replace(SENSOR, focus_mm=12.0))


def test_the_blur_is_airy_s():
    """The light in circles of Airy's pattern is 1 - J0^2 - J1^2, at every wavelength."""
    psfs = perfect_psfs(11.0, np.array([400.0, 550.0, 700.0]))
    reach = psfs.psf.shape[-1] // 2
    distance_um = psfs.pitch_um * np.hypot(*np.mgrid[-reach:reach + 1, -reach:reach + 1])

    def encircled(radius_um, nm):
        phase = np.pi * radius_um / (nm * 1e-3 * 11)
        return 1 - scipy.special.j0(phase)**2 - scipy.special.j1(phase)**2

    for psf, nm, enclosed in zip(psfs.psf, (400, 550, 700), psfs.enclosed, strict=True):
        for samples in (4, 8, 12):
            inside = np.clip(0.5 + samples - distance_um / psfs.pitch_um, 0, 1)
            assert np.sum(psf * inside) * enclosed == pytest.approx(encircled(samples * psfs.pitch_um, nm), abs=4e-3)
        assert encircled((reach + 0.5) * psfs.pitch_um, nm) < enclosed < 1 and psf.sum() == pytest.approx(1)
    assert psfs.enclosed.min() >= 0.985


def test_a_fold_ends_the_field_and_is_reported():
    """r - 0.3 r^3 turns back at r = 1.05, where the height is 0.70: 351 px from the axis."""
    lens = lens_of(camera(coefficients=(-0.3, 0.0)), SENSOR)
    end_px = lens.real_height_mm[0, -1] * 40
    assert 340 < end_px < 351
    assert lens.notes == (f"From {end_px:.0f} px from the axis, inside the frame, the distortion folds: the lens data "
                          f"end there, {end_px / np.hypot(320, 205):.0%} of the way to the frame's edge.")
    grid = lens_of(camera(coefficients=(-0.3, 0.0), principal_px=(310.0, 204.5)), SENSOR)
    field = field_map(grid).at_wavelength(540)
    at = (np.array([310 + 300, 310 - 300.0]) - 319.5) / 40
    assert field.within(at, np.zeros(2)).all()
    corner = field.within(np.array([7.9]), np.array([-5.0]))
    assert "folds" in grid.notes and not corner[0]
    assert "folds" not in lens_of(camera(), SENSOR).notes


def test_a_calibration_that_leads_back_inside_the_frame_is_refused():
    """A fisheye's picture by tangents: near the corners, light from farther up lands farther down."""
    wild = camera(RADTAN, (-0.171, 0.0156, -0.0068, 0.0059), (250.0, 240.0))
    with refused(LensError, field="distortion", match="model for fisheyes"):
        lens_of(wild, SENSOR)


def test_a_fisheye_of_half_the_world_is_covered_up_to_80_degrees():
    calibrated = camera(KANNALA_BRANDT, (0.01, -0.002, 0, 0), (220.0, 220.0))
    lens = lens_of(calibrated, SENSOR)
    assert "80 degrees" in lens.notes
    assert np.degrees(np.arctan(lens.heights_mm[-1] / lens.capture_focal_length_mm)) == pytest.approx(80, abs=0.1)


def test_the_blur_and_the_light_of_a_designed_lens():
    """The PSF at a place is the designed one at the same distance, turned to its azimuth; distortion stays measured."""
    design = load_lens("tessar-50mm", quality="preview", wavelengths_nm=[550])
    size_px = 360, 240
    calibrated = ModelledCamera("made", "test", size_px, (500.0, 500.0), (184.0, 117.0), RADTAN,
                                (-0.2, 0.05, 0.003, 0.0))
    lens = measured_lens(calibrated, (36.0, 24.0), np.inf, lambda magnification: Designed(design))
    assert off_px(lens, size_px, project(calibrated), 550.0) < 0.02 and "as designed for tessar-50mm" in lens.source
    row, column = lens.y_mm.size - 1, 0
    distance_mm = np.hypot(lens.x_mm[column], lens.y_mm[row])
    light = Designed(design).at(np.array([distance_mm]))
    assert lens.relative_illumination[0, row, column] == pytest.approx(light.relative_illumination[0, 0])

    def moments(psf):
        along = np.arange(psf.shape[-1]) - psf.shape[-1] // 2
        return np.array([np.sum(psf * along[:, None]), np.sum(psf * along)])

    (outwards, _), (up, right) = moments(light.psf[0, 0]), moments(lens.psf[0, row, column])
    towards = np.array([lens.y_mm[row], lens.x_mm[column]]) / distance_mm
    assert [up, right] == pytest.approx(outwards * towards, abs=0.05) and abs(outwards) > 0.2
    assert lens.prescription is None
    with refused(LensError, field="blur", where=lens.name):
        Designed(lens)


def test_packages_keep_measured_lenses(tmp_path):
    lens = lens_of(camera(focal_px=(500.0, 506.0)), SENSOR, name="Lab camera")
    write_package(lens, tmp_path / "lens.npz")
    renewed = read_package(tmp_path / "lens.npz")
    assert (renewed.name, renewed.source, renewed.notes) == ("Lab camera", lens.source, lens.notes)
    np.testing.assert_array_equal(renewed.source_mm, lens.source_mm)
    assert len(package_bytes(lens)) < 3e6


def test_frames_without_a_size_are_refused():
    with refused(LensError, field="sensor"):
        lens_of(camera(), replace(SENSOR, sensor_mm=(0.0, 10.0)))
    with refused(InputError, field="--f-number"):
        replace(SENSOR, f_number=0.3)
