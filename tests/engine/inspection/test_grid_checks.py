"""check_lens on lenses without rotational symmetry."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import fine_grid_lens, gaussian_psf
from lensfield.engine.inspection.checks import check_lens

NM = np.arange(400.0, 701.0, 50)
X_MM, Y_MM = np.linspace(-2.5, 2.5, 11), np.linspace(-2, 2, 9)
ROW, COLUMN = 6, 2  # of single faults
PLACE = "at 500 nm, x = -1.5 and y = 1 mm"


def sound(mirrored=(False, False), **changes):
    """A valid lens: squeezed, with some distortion, shading and lateral colour, and blur that grows with the field."""
    y_mm, x_mm = (places[places >= 0] if half else places for places, half in zip((Y_MM, X_MM), mirrored, strict=True))
    psf = [[[gaussian_psf(1.2 + 0.1 * abs(y) + 1e-3 * nm, 1 + 0.1 * abs(x) + 1e-3 * nm, 0.4, 48) for x in x_mm]
            for y in y_mm] for nm in NM]
    return fine_grid_lens(
        psf, lambda nm, x, y: (x * (1 + 5e-3 * x**2 + 2e-5 * (nm - 550)), y * (1 + 2e-3 * (x**2 + y**2))),
        lambda nm, x, y: 1 - 0.01 * x**2 - 0.02 * y**2, psf_pitch_um=0.4, wavelengths_nm=NM, mirrored=mirrored,
        **{"squeeze": 2.0, "transmittance": np.full(7, 0.9)} | changes)


SOUND = sound()


def changed(field, change, *at):
    """The valid lens with a table changed by a function at a place."""
    table = getattr(SOUND, field).copy()
    table[at] = change(table[at])
    return replace(SOUND, **{field: table})


def about(lens, field, text):
    """The finding about this field whose value contains the text."""
    findings = [finding for finding in check_lens(lens) if finding.field == field and text in finding.value]
    assert len(findings) == 1, "\n".join(map(str, check_lens(lens)))
    return findings[0]


@pytest.mark.parametrize("mirrored", [(False, False), (True, True), (False, True)])
def test_a_sound_lens_has_no_findings(mirrored):
    assert check_lens(sound(mirrored)) == []


@pytest.mark.parametrize("changes, severity, field, text", [
    ({"squeeze": 8.0}, "warning", "squeeze", "8"),
    ({"squeeze": 0.01}, "warning", "squeeze", "0.01"),
    ({"source_mm": SOUND.source_mm * 1e3}, "error", "source_mm", "up to 2"),
    ({"source_mm": SOUND.source_mm * [1.2, 1.0]}, "warning", "source_mm", "rises 1.2"),
    ({"source_mm": SOUND.source_mm * [1.0, 0.1]}, "error", "source_mm", "times as fast as y next to the middle"),
    ({"within": SOUND.within + 1.5}, "error", "within", "1.5 at its minimum"),
    ({"within": SOUND.within * 1.1}, "note", "sensor_mm", "4.9% of 4.8 x 3.6 mm"),
    ({"sensor_mm": (8.0, 6.0)}, "warning", "sensor_mm", "% of 8 x 6 mm is beyond the end of the field"),
    ({"f_number_effective": 0.3}, "error", "f_number_effective", "0.3"),
    ({"psf_pitch_um": 400.0}, "error", "psf_pitch_um", "400 um")], ids=str)
def test_an_implausible_figure_is_named(changes, severity, field, text):
    assert about(replace(SOUND, **changes), field, text).severity == severity


@pytest.mark.parametrize("field, change, severity, text", [
    ("relative_illumination", lambda _: 1.6, "warning", f"1.6 {PLACE}"),
    ("relative_illumination", lambda _: 0.0, "note", f"0 {PLACE}"),
    ("enclosed_energy", lambda _: 0.8, "warning", f"0.8 {PLACE}"),
    ("psf", lambda psf: np.roll(psf, (-15, 4), (0, 1)), "warning",
     f"centroid -14.2 samples upwards and 4.0 to the right {PLACE}"),
    ("psf", lambda psf: np.fft.fftshift(psf), "warning", f"brightest at its window's border {PLACE}"),
    ("psf", lambda _: gaussian_psf(7, 1, 0.4, 48), "warning", f"between the adjacent rows, {PLACE}")])
def test_an_outlier_is_named_with_its_position(field, change, severity, text):
    assert about(changed(field, change, 2, ROW, COLUMN), field, text).severity == severity


def test_blur_out_of_focus_is_named_in_the_middle():
    wide = np.broadcast_to(gaussian_psf(20, 20, 2.0, 96), (*SOUND.psf.shape[:3], 96, 96))
    assert "at 550 nm, x = 0 and y = 0 mm" in about(replace(SOUND, psf=wide, psf_pitch_um=2.0), "psf",
                                                    "half the light in a disc of").value


@pytest.mark.parametrize("mirrored, axis, text", [
    ((True, False), 0, "mirror image in v, centroid 2.00 samples upwards, at 400 nm"),
    ((False, True), 1, "mirror image in u, centroid 2.00 samples to the right, at 400 nm")])
def test_psfs_on_a_line_of_symmetry_are_symmetric(mirrored, axis, text):
    lens = sound(mirrored)
    assert about(replace(lens, psf=np.roll(lens.psf, 2, axis - 2)), "psf", text).severity == "warning"
    other = replace(lens, psf=np.roll(lens.psf, 2, -1 - axis))
    assert not [finding for finding in check_lens(other) if "mirror image" in finding.value]


def test_light_on_a_line_of_symmetry_comes_from_it():
    lens = sound((True, True))
    moved = replace(lens, source_mm=lens.source_mm + [0.0, 0.01])
    assert about(moved, "source_mm", "y = 0.01 mm at 400 nm").severity == "warning"
    assert not [finding for finding in check_lens(replace(SOUND, source_mm=SOUND.source_mm + 0.01))]


def test_a_folded_cell_is_an_error_though_each_line_rises():
    lens = fine_grid_lens(source_mm=lambda nm, x, y: (x + 2 * y, y + 0.6 * x))
    assert about(lens, "source_mm", "folded at x = -2.5 mm, y = -2 mm at 400 nm").severity == "error"


@pytest.mark.parametrize("mirrored, rows", [(True, 3), (False, 4)])
def test_too_few_nodes_are_reported(mirrored, rows):
    lens = fine_grid_lens(gaussian_psf(1.5, 1.5, 0.4, 48), psf_pitch_um=0.4, rows=rows, mirrored=(mirrored, False))
    assert about(lens, "y_mm", f"{lens.y_mm.size} nodes").severity == "warning"
