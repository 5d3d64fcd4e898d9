"""check_lens: every check finds its kind of fault, names the field and the place, and passes valid lenses."""

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from lenses import gaussian_psf, make_lens
from lensfield import cli
from lensfield.engine import load_lens
from lensfield.engine.inspection import checks
from lensfield.engine.inspection.finding import SEVERITIES
from lensfield.engine.inspection.info import lens_info, lens_text
from lensfield.engine.inspection.psf_checks import WRAPS
from lensfield.engine.lens import RadialLens
from lensfield.engine.lens_files.package import write_package
from places import SHARED_DATA

WAVELENGTHS_NM = np.arange(400.0, 701.0, 50)
HEIGHTS_MM = np.linspace(0, 3.3, 12)
WINDOW = 48
WAVE, HEIGHT = 2, 5  # the position of single faulty PSFs
PLACE = "at 500 nm and a height of 1.5 mm"


check_lens = lru_cache(maxsize=2)(checks.check_lens)  # for lenses that a test checks more than once


def sound_lens():
    """A valid lens: some distortion, shading and lateral colour, and blur that grows with the field and wavelength."""
    psf = [[gaussian_psf(1 + 0.1 * h + 1e-3 * nm, 1 + 0.05 * h + 1e-3 * nm, 0.4, WINDOW) for h in HEIGHTS_MM]
           for nm in WAVELENGTHS_NM]
    return make_lens(psf, lambda nm, p: p * (0.99 + 2e-5 * (nm - 550) - 5e-3 * p**2), lambda nm, p: 1 - 0.02 * p**2,
                     psf_pitch_um=0.4, wavelengths_nm=WAVELENGTHS_NM, heights_mm=HEIGHTS_MM, transmittance=0.9)


SOUND = sound_lens()


def changed(field, change, wave=slice(None), height=slice(None)):
    """The valid lens with a table changed by a function, completely or at one place."""
    table = getattr(SOUND, field).copy()
    table[wave, height] = change(table[wave, height])
    return replace(SOUND, **{field: table})


def with_psf(psf, **changes):
    """The valid lens with one PSF for the complete field, and with other changes."""
    table = np.broadcast_to(psf, (WAVELENGTHS_NM.size, HEIGHTS_MM.size, *np.shape(psf)))
    return replace(SOUND, psf=table, **changes)


def with_one_psf(psf):
    """The valid lens with one PSF replaced."""
    return changed("psf", lambda _: psf, WAVE, HEIGHT)


def only(lens, field):
    """The single finding, which must be about this field."""
    findings = check_lens(lens)
    assert [finding.field for finding in findings] == [field], "\n".join(map(str, findings))
    return findings[0]


def about(lens, field, text):
    """The finding about this field whose value contains the text."""
    findings = [finding for finding in check_lens(lens) if finding.field == field and text in finding.value]
    assert len(findings) == 1, "\n".join(map(str, check_lens(lens)))
    return findings[0]


def fourier_psf(pupil_samples, window, oversampling=2, defocus=0.0, coma=0.0, spherical=0.0):
    """PSF by an FFT over this many samples across the pupil, aberrations in waves; and the light in the window."""
    size = pupil_samples * oversampling
    y, x = (np.mgrid[:size, :size] - size // 2) / (pupil_samples / 2)
    square = x**2 + y**2
    pupil = (square <= 1) * np.exp(2j * np.pi * (defocus * square + coma * square * y + spherical * square**2))
    psf = np.abs(np.fft.fftshift(np.fft.fft2(np.fft.ifftshift(pupil))))**2
    part = slice(size // 2 - window // 2, size // 2 + window // 2)
    return psf[part, part] / psf[part, part].sum(), psf[part, part].sum() / psf.sum()


def test_a_sound_lens_has_no_findings():
    assert check_lens(SOUND) == []


@pytest.mark.parametrize("changes, severity, field, text", [
    ({"f_number_effective": 0.3}, "error", "f_number_effective", "0.3"),
    ({"f_number_effective": 80.0, "psf_pitch_um": 4.0}, "warning", "f_number_effective", "80"),
    ({"magnification": 0.1}, "warning", "magnification", "0.1"),
    ({"object_distance_mm": np.inf}, "warning", "magnification", "-0.1 with the object at infinity"),
    ({"object_distance_mm": 0.1}, "error", "object_distance_mm", "0.1 mm at a magnification of -0.1"),
    ({"object_distance_mm": 1e5}, "error", "object_distance_mm", "100000 mm"),
    ({"magnification": -0.05}, "warning", "object_distance_mm", "100 mm at a magnification of -0.05"),
    ({"entrance_pupil_mm": 5000.0}, "warning", "entrance_pupil_mm", "5000 mm"),
    ({"entrance_pupil_mm": -200.0}, "error", "entrance_pupil_mm", "-200 mm"),
    ({"heights_mm": HEIGHTS_MM * 1e3, "real_height_mm": SOUND.real_height_mm * 1e3}, "error", "heights_mm", "3300 mm"),
    ({"wavelengths_nm": WAVELENGTHS_NM * 1e-3}, "error", "wavelengths_nm", "0.4 to 0.7 nm"),
    ({"wavelengths_nm": WAVELENGTHS_NM * 10}, "warning", "wavelengths_nm", "4000 to 7000 nm"),
    ({"reference_wavelength_nm": 0.55}, "error", "reference_wavelength_nm", "0.55 nm"),
    ({"reference_wavelength_nm": 710.0}, "note", "reference_wavelength_nm", "710 nm"),
    ({"wavelengths_nm": WAVELENGTHS_NM / 2 + 250}, "note", "wavelengths_nm", "450 to 600 nm"),
    ({"wavelengths_nm": (400, 450, 500, 530, 620, 660, 700)}, "note", "wavelengths_nm", "none between 530 and 620 nm"),
    ({"wavelengths_nm": np.linspace(400, 760, 7)}, None, None, None),
    ({"wavelengths_nm": np.linspace(400, 790, 7)}, "note", "wavelengths_nm", "none between 400 and 465 nm"),
    ({"sensor_mm": (8.0, 6.0)}, "warning", "sensor_mm", "% of 8 x 6 mm is beyond the last real height, 3.077 mm"),
    ({"sensor_mm": (6.0, 4.0)}, "note", "sensor_mm", "5.8% of 6 x 4 mm"),
    ({"sensor_mm": (1.0, 1.0)}, None, None, None),
    ({"transmittance": np.ones(7)}, "note", "transmittance", "1 at all wavelengths"),
    ({"psf_pitch_um": 0.45}, "note", "psf_pitch_um", "0.45 um, where 0.4 um resolves all detail at 400 nm"),
    ({"psf_pitch_um": 400.0}, "error", "psf_pitch_um", "400 um"),
    ({"psf_pitch_um": 0.0004}, "error", "psf_pitch_um", "0.0004 um")], ids=str)
def test_an_implausible_figure_is_named(changes, severity, field, text):
    lens = replace(SOUND, **changes)
    if severity is None:
        assert not [finding for finding in check_lens(lens) if finding.field in changes]
        return
    finding = about(lens, field, text)
    assert finding.severity == severity
    assert {other.field for other in check_lens(lens) if other.severity == "error"} <= {field}


@pytest.mark.parametrize("sigma_um, severity", [(20.0, "warning"), (8.0, "note"), (3.0, None)])
def test_a_lens_out_of_focus_on_its_axis_is_named(sigma_um, severity):
    """A disc of 2.355 sigma contains half of a Gaussian's light: 0.94 %, 0.38 % and 0.14 % of the diagonal of 5 mm."""
    lens = with_psf(gaussian_psf(sigma_um, sigma_um, 2.0, 96), psf_pitch_um=2.0, sensor_mm=(4.0, 3.0))
    findings = [finding for finding in check_lens(lens) if "half the light in a disc of" in finding.value]
    assert [finding.severity for finding in findings] == [severity] * bool(severity)
    if severity:
        reported_um = float(findings[0].value.split()[7])
        assert reported_um == pytest.approx(2.355 * sigma_um, abs=4.0)  # two samples across


@pytest.mark.parametrize("field, change, wave, height, severity, text", [
    ("real_height_mm", lambda _: 0.01, WAVE, 0, "warning", "0.01 mm at 500 nm and a height of 0 mm"),
    ("real_height_mm", lambda mm: 0.1 * mm, slice(None), slice(None), "error",
     "times the paraxial height near the axis"),
    ("real_height_mm", lambda mm: 1e3 * mm, slice(None), slice(None), "error", "near the axis, at "),
    ("real_height_mm", lambda mm: 0.1 * mm, WAVE, slice(None), "error", "at 500 nm"),
    ("real_height_mm", lambda mm: 1.1 * mm, WAVE, slice(None), "warning", "near the axis, at 500 nm"),
    ("real_height_mm", lambda mm: mm + 0.02, WAVE, HEIGHT, "warning", f"um off the fitted polynomial, {PLACE}"),
    ("real_height_mm", lambda mm: mm + 0.002, WAVE, HEIGHT, "note", f"um off the fitted polynomial, {PLACE}"),
    ("relative_illumination", lambda _: 0.7, WAVE, HEIGHT, "warning", f"off the fitted polynomial, {PLACE}"),
    ("relative_illumination", lambda r: 100 * r, slice(None), slice(None), "error", "100 at 400 nm"),
    ("relative_illumination", lambda r: 0.95 * r, WAVE, slice(None), "warning", "0.95 at 500 nm and a height of 0 mm"),
    ("relative_illumination", lambda _: 1.6, WAVE, HEIGHT, "warning", f"1.6 {PLACE}"),
    ("relative_illumination", lambda _: 0.0, WAVE, -1, "note", "0 at 500 nm and a height of 3.3 mm"),
    ("enclosed_energy", lambda _: 0.99, WAVE, HEIGHT, "note", f"0.99 {PLACE}"),
    ("enclosed_energy", lambda _: 0.8, WAVE, HEIGHT, "warning", f"0.8 {PLACE}"),
    ("enclosed_energy", lambda _: 99.0, WAVE, HEIGHT, "error", f"99 {PLACE}"),
    ("enclosed_energy", lambda _: -0.1, WAVE, HEIGHT, "error", f"-0.1 {PLACE}"),
    ("enclosed_energy", lambda _: np.nan, WAVE, HEIGHT, "note", "unknown for 1 of 84 PSFs")])
def test_an_outlier_is_named_with_its_position(field, change, wave, height, severity, text):
    lens = changed(field, change, wave, height)
    assert about(lens, field, text).severity == severity
    assert {finding.field for finding in check_lens(lens) if finding.severity != "note"} <= {field, "sensor_mm"}


def test_a_table_that_folds_back_is_an_error_at_its_height():
    finding = about(changed("real_height_mm", lambda mm: mm - 0.5, WAVE, 11), "real_height_mm", "and 2.")
    assert finding.severity == "error" and "at 500 nm and a height of 3 mm" in finding.value


def test_a_fit_that_folds_back_is_an_error_though_the_table_rises():
    def flattening(nm, height):
        return np.where(height < 2.2, height, 2.2 + 1e-6 * height) if nm[0, 0] == 400 else height

    lens = replace(SOUND, real_height_mm=make_lens(
        real_height_mm=flattening, wavelengths_nm=WAVELENGTHS_NM, heights_mm=HEIGHTS_MM).real_height_mm)
    finding = about(lens, "real_height_mm", "in the polynomial fitted at 400 nm")
    assert finding.severity == "error" and "falling at a paraxial height of 2." in finding.value


def test_too_few_heights_are_reported():
    few = slice(None, None, 3)
    lens = replace(SOUND, psf=SOUND.psf[:, few], **{name: getattr(SOUND, name)[..., few] for name in (
        "heights_mm", "real_height_mm", "relative_illumination", "enclosed_energy", "point_flux")},
        sensor_mm=(1.0, 1.0))
    assert only(lens, "heights_mm").value == "4 heights"


def test_a_lens_of_two_heights_and_one_wavelength_is_checked():
    findings = check_lens(make_lens(wavelengths_nm=(587.6,), heights_mm=(0.0, 3.2)))
    assert {finding.field for finding in findings} == {"wavelengths_nm", "reference_wavelength_nm", "heights_mm",
                                                       "transmittance", "psf_pitch_um"}


def test_half_a_sample_off_centre_is_reported_with_its_size():
    offset = np.arange(WINDOW) - WINDOW // 2
    sideways = np.exp(-0.4**2 * (offset[:, None]**2 + (offset - 0.5)**2) / (2 * 1.5**2))
    sideways /= sideways.sum()
    assert "centroid 0.50 samples sideways" in about(with_psf(sideways), "psf", "mirror image in u").value
    finding = about(with_psf(sideways.T), "psf", "mirrored in v")
    assert finding.severity == "warning" and "centroid 0.50 samples outwards" in finding.value


def test_lopsided_light_is_a_note_up_to_a_tenth():
    core = gaussian_psf(1.5, 1.5, 0.4, WINDOW)
    slightly = with_one_psf(0.98 * core + 0.02 * np.roll(core, 8, axis=1))
    much = with_one_psf(0.8 * core + 0.2 * np.roll(core, 8, axis=1))
    assert about(slightly, "psf", "mirror image in u").severity == "note"
    finding = about(much, "psf", "mirror image in u")
    assert finding.severity == "warning" and PLACE in finding.value


def test_an_axial_psf_that_is_not_round_is_reported():
    assert about(with_psf(gaussian_psf(1.5, 1.0, 0.4, WINDOW)), "psf", "turned by 90 degrees").severity == "warning"


@pytest.mark.parametrize("size", [8, 9, 64, 65])
def test_round_psfs_of_any_size_are_round(size):
    findings = check_lens(with_psf(gaussian_psf(0.05 * size, 0.05 * size, 0.4, size)))
    assert not [finding for finding in findings if finding.severity != "note"], findings


def test_a_psf_far_from_its_chief_ray_is_reported():
    away = np.roll(gaussian_psf(1.0, 1.0, 0.4, WINDOW), 15, axis=0)
    assert about(with_one_psf(away), "psf", f"centroid 15.0 samples outwards and 0.0 sideways {PLACE}")


def test_a_psf_brightest_at_the_border_is_reported():
    swapped = np.fft.fftshift(gaussian_psf(1.0, 1.0, 0.4, WINDOW))
    assert about(with_one_psf(swapped), "psf", f"brightest at its window's border {PLACE}")


def test_a_psf_cut_by_its_window_is_reported_unless_the_enclosed_energy_shows_it():
    wide = with_psf(gaussian_psf(5.0, 5.0, 0.4, WINDOW))
    assert about(wide, "psf", "outermost samples")
    findings = check_lens(replace(wide, enclosed_energy=np.full((7, 12), 0.9)))
    assert not [finding for finding in findings if "outermost" in finding.value]
    assert findings[0].field == "enclosed_energy" and findings[0].value.startswith("0.9 at")


def test_a_tail_that_enters_from_the_opposite_side_is_reported():
    tail = sum(np.roll(gaussian_psf(1.2, 1.2, 0.4, WINDOW), step, axis=0) for step in range(34)) / 34
    finding = about(with_one_psf(tail), "psf", "without a seam")
    assert PLACE in finding.value and WRAPS in finding.remedy


def test_a_tail_that_rises_towards_the_border_is_reported_despite_noise():
    tail = np.roll(gaussian_psf(1.2, 1.2, 0.4, WINDOW), 26, axis=0)
    noise = np.random.default_rng(0).dirichlet(np.ones(WINDOW**2)).reshape(WINDOW, WINDOW)
    finding = about(with_one_psf(0.9 * SOUND.psf[WAVE, HEIGHT] + 0.09 * tail + 0.01 * noise), "psf", "than next to it")
    assert PLACE in finding.value and WRAPS in finding.remedy


def test_light_at_the_border_is_reported_despite_noise():
    noise = np.random.default_rng(0).dirichlet(np.ones(WINDOW**2)).reshape(WINDOW, WINDOW)
    assert PLACE in about(with_one_psf(0.8 * SOUND.psf[WAVE, HEIGHT] + 0.2 * noise), "psf", "outermost samples").value


ABERRATIONS = [{"defocus": 4.0}, {"spherical": 4.0}, {"coma": 5.0}, {"coma": 4.0, "spherical": 3.0},
               {"defocus": 3.0, "coma": 6.0}]


@pytest.mark.parametrize("pupil_samples, oversampling", [(32, 2), (22, 3), (16, 4)])
@pytest.mark.parametrize("aberrations", ABERRATIONS, ids=str)
def test_too_few_pupil_samples_wrap_a_psf_round(aberrations, pupil_samples, oversampling):
    psf, _ = fourier_psf(pupil_samples, pupil_samples * oversampling, oversampling, **aberrations)
    finding = about(with_psf(psf), "psf", "without a seam")
    assert finding.severity == "warning" and WRAPS in finding.remedy


def test_a_wrapped_psf_is_detected_from_five_digits():
    psf, _ = fourier_psf(32, 64, coma=6.0)
    listed = np.vectorize(lambda value: float(f"{value:.4e}"))(psf / psf.max())
    assert about(with_psf(listed / listed.sum()), "psf", "without a seam")


def test_a_period_of_less_than_two_windows_brings_light_to_the_border():
    psf, _ = fourier_psf(48, 64, coma=6.0)
    assert WRAPS in about(with_psf(psf), "psf", "brighter at a border than next to it").remedy


@pytest.mark.parametrize("window", [32, 33, 64, 65])
@pytest.mark.parametrize("width", [0.25, 0.4])
def test_smooth_psfs_cut_by_their_windows_do_not_wrap(window, width):
    cut = gaussian_psf(width * window, width * window, 1, window)
    assert "outermost samples" in about(with_psf(cut), "psf", "of its light").value


@pytest.mark.parametrize("oversampling", [2, 4])
@pytest.mark.parametrize("aberrations", ABERRATIONS, ids=str)
def test_enough_pupil_samples_do_not_wrap_even_if_the_window_cuts(aberrations, oversampling):
    psf, enclosed = fourier_psf(640 // oversampling, 64, oversampling, **aberrations)
    cut = check_lens(with_psf(psf, enclosed_energy=np.full((7, 12), enclosed)))
    assert enclosed < 0.95 and not [finding for finding in cut if WRAPS in finding.remedy], cut


def test_random_sound_psfs_raise_no_alarm_at_their_borders():
    random = np.random.default_rng(1)
    for _ in range(10):
        psf, enclosed = fourier_psf(128, 64, 2, *random.uniform(-1, 1, 3))
        findings = check_lens(with_psf(psf))
        assert enclosed > 0.97 and not [finding for finding in findings if "border" in finding.value], findings


def test_a_psf_that_its_neighbours_do_not_predict_is_reported_with_its_position():
    broken = with_one_psf(gaussian_psf(4.0, 4.0, 0.4, WINDOW))
    for axis in ("heights", "wavelengths"):
        finding = about(broken, "psf", f"from interpolation between the adjacent {axis}")
        assert finding.severity == "warning" and PLACE in finding.value


def test_psfs_that_change_steadily_are_predicted_over_uneven_steps():
    weight = ((HEIGHTS_MM / HEIGHTS_MM[-1])**2)[:, None, None]
    table = (1 - weight) * gaussian_psf(1, 1, 0.4, WINDOW) + weight * gaussian_psf(2.5, 2.5, 0.4, WINDOW)
    uneven = HEIGHTS_MM**2 / HEIGHTS_MM[-1]
    lens = replace(SOUND, heights_mm=uneven, psf=np.stack([table] * 7), sensor_mm=(1.0, 1.0),
                   real_height_mm=np.stack([uneven] * 7))
    assert check_lens(lens) == []


def test_errors_come_first():
    lens = replace(SOUND, transmittance=np.ones(7), f_number_effective=0.4, sensor_mm=(9.0, 9.0))
    severities = [finding.severity for finding in check_lens(lens)]
    assert severities == sorted(severities, key=SEVERITIES.index) and severities[0] == "error"


def test_the_papers_lens_has_only_notes_and_they_are_true():
    lens = load_lens("edmund-54852")
    findings = check_lens(lens)
    assert {finding.severity for finding in findings} == {"note"}
    assert {finding.field for finding in findings} == {"psf_pitch_um", "psf"}


def test_unknown_coatings_are_noted():
    lens = load_lens("edmund-54852")
    unknown = replace(lens, prescription=lens.prescription.coated())
    finding = about(unknown, "coating", "unknown")
    assert finding.severity == "note" and not [each for each in check_lens(lens) if each.field == "coating"]
    assert (lens_info(lens)["coatings"], lens_info(unknown)["coatings"]) == (["single"], ["unknown"])
    assert "coatings                 unknown (unknown ones count as ideal: --coating)" in lens_text(lens_info(unknown))
    assert "coatings" not in lens_text(lens_info(replace(lens, prescription=None)))


def test_the_t_stop_is_of_the_light_that_gets_through():
    """A T-stop of 2 is as bright as f/1.8 at 81 % of the light."""
    lens = replace(SOUND, f_number_effective=1.8, transmittance=np.full(7, 0.81))
    assert lens_info(lens)["t_number_effective"] == pytest.approx(2.0)
    assert "effective T-stop         2.000: T = 0.810 in white light" in lens_text(lens_info(lens))
    edges = replace(lens, transmittance=np.array([0.0, 0.81, 0.81, 0.81, 0.81, 0.81, 0.0]))
    assert lens_info(edges)["transmittance"] > 0.808, "the eye barely sees the ends of the spectrum"


def test_a_traced_fisheye_has_no_errors():
    path = SHARED_DATA / "lens_packages" / "muller_fisheye25.npz"
    if not path.is_file():
        pytest.skip("no shared data at hand")
    with np.load(path) as data:
        psf = np.maximum(data["psf"], 0).swapaxes(0, 1)
        lens = RadialLens(name="Muller fisheye", efl_mm=25.25, magnification=0.0, f_number_effective=3.947,
                          object_distance_mm=np.inf, entrance_pupil_mm=20.0, sensor_mm=(36.0, 24.0),
                          reference_wavelength_nm=550.0, wavelengths_nm=1e3 * data["wl_um"],
                          heights_mm=data["hpar_mm"], real_height_mm=data["hreal_mm"].T,
                          relative_illumination=data["ri"].T, psf=psf / psf.sum(axis=(2, 3), keepdims=True),
                          psf_pitch_um=float(data["pitch_um"]), enclosed_energy=np.full(psf.shape[:2], np.nan),
                          transmittance=np.ones(7))
    severe = [finding for finding in check_lens(lens) if finding.severity != "note"]
    assert {(finding.severity, finding.field) for finding in severe} == {("warning", "psf")}
    assert any("outermost samples at 400 nm and a height of 0 mm" in finding.value for finding in severe)


def check(path, *options):
    return cli.main(["lens", "check", str(path), *options])


def test_the_command_prints_each_finding_and_their_number(capsys):
    assert check("edmund-54852") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("note: sensor_mm: 1.8% of 4.8 x 3.6 mm is beyond")
    assert lines[-1] == f"{len(lines) - 1} note" + "s" * (len(lines) > 2)


def test_the_command_as_json_is_a_list_and_fails_for_an_error(tmp_path, capsys):
    write_package(replace(SOUND, f_number_effective=0.3), tmp_path / "broken.npz")
    assert check(tmp_path / "broken.npz", "--json") == 1
    findings = json.loads(capsys.readouterr().out)
    assert findings[0]["severity"] == "error" and findings[0]["field"] == "f_number_effective"
    assert all(finding.keys() == {"severity", "field", "value", "remedy"} for finding in findings)


def test_the_command_prints_no_findings_for_a_sound_lens(tmp_path, capsys):
    write_package(SOUND, tmp_path / "sound.npz")
    assert check(tmp_path / "sound.npz") == 0
    assert capsys.readouterr().out == "no findings\n"


def test_the_command_reports_a_damaged_package_in_one_line(tmp_path, capsys):
    (tmp_path / "damaged.npz").write_bytes(b"PK\x03\x04")
    assert check(tmp_path / "damaged.npz") == 1
    printed = capsys.readouterr()
    assert printed.out == "" and "lens package is not readable" in printed.err.replace("'", "")
