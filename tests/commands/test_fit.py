"""`lensfield lens fit`: rims fitted to tables, to raw pictures and to Lensfun's database, and the page of the kit."""

import json
from dataclasses import replace

import numpy as np
import pytest

from flat_pictures import flat_light, mounted, write_flat
from lenses import make_lens
from lensfield.engine.fitting.even_light import EvenField
from lensfield.engine.fitting.rims import with_rims
from lensfield.engine.fitting.typical import with_typical_rims
from lensfield.engine.fitting.vignetting import COLUMNS, light_of
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.photographs import NOT_COMPARED, Agreement, Vignetting
from lensfield.engine.prescription.readers import read_prescription
from lensfield.engine.prescription.readers.toml import write_prescription
from point_pictures import point_light, point_rays
from rgb_files import failure, run

NAME, RIMS_MM = "helios-44-2-58mm", {2: 13.9, 10: 11.4}
HEIGHTS_MM = np.linspace(2, 20.5, 8)
SENSOR_MM = 36.0, 24.0


@pytest.fixture(scope="module")
def truth():
    """The lens with known rims, without figures of the library's on photographs."""
    lens = replace(prescription_of(NAME), photographs=None)
    fields = [EvenField(lens, focus_mm, np.array([0.0, 10.0, 21.6])) for focus_mm in (np.inf, 526.0)]
    return with_rims(lens, fields, RIMS_MM)


@pytest.fixture
def table(tmp_path, truth):
    """The light of the lens, as a table."""
    curves = [Vignetting(f_number, focus_mm, HEIGHTS_MM, np.ones(HEIGHTS_MM.size))
              for f_number in (2.0, 2.8, 4.0, 8.0) for focus_mm in (np.inf, 1500.0)]
    rows = [(curve.f_number, curve.focus_mm / 1e3, *at) for curve, light in zip(curves, light_of(truth, curves),
                                                                              strict=True)
            for at in zip(HEIGHTS_MM, light, strict=True)]
    path = tmp_path / "light.csv"
    path.write_text("\n".join([",".join(COLUMNS), *(",".join(f"{value:.6g}" for value in row) for row in rows)]))
    return path


def assert_has_the_rims(path):
    sizes_mm = {index: read_prescription(path).surfaces[index].semi_aperture_mm for index in RIMS_MM}
    assert sizes_mm == pytest.approx(RIMS_MM, rel=0.02)


def test_a_table_of_light_gives_a_prescription(tmp_path, table, capsys):
    assert run("lens", "fit", NAME, "--vignetting", table, "-o", tmp_path / "mine.toml") == 0
    out = capsys.readouterr().out
    assert "rear rim, surface 11: 11." in out and "left out" in out and out.endswith("mine.toml\n")
    assert_has_the_rims(tmp_path / "mine.toml")
    assert run("lens", "info", tmp_path / "mine.toml", "--json", "--wavelengths", 550, "--lens-quality", "preview") == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["provenance"]["apertures"] == "fitted to photographs"
    assert facts["photographs"]["source"] == "light.csv" and facts["photographs"]["illumination"] < 0.01


def test_raw_pictures_give_a_prescription(tmp_path, truth, capsys):
    paths = [tmp_path / f"{f_number}.dng" for f_number in (2.0, 2.8, 4.0, 8.0)]
    for path in paths:
        write_flat(path, flat_light(truth, float(path.stem), SENSOR_MM, (0.06, 0.0)))
    (tmp_path / "own.toml").write_text(write_prescription(prescription_of(NAME)))
    assert run("lens", "fit", tmp_path / "own.toml", "--flat", *paths, "--f-numbers", "2,2.8,4,8",
               "-o", tmp_path / "mine.toml") == 0
    out = capsys.readouterr().out
    assert "2.0.dng: f/2, illumination tilted by 6.0% towards" in out
    assert_has_the_rims(tmp_path / "mine.toml")
    light = read_prescription(tmp_path / "mine.toml").photographs.light
    assert [curve.f_number for curve in light] == [2.0, 2.8, 4.0, 8.0]
    assert np.abs(light[1].light - light_of(truth, light)[1]).max() < 0.01


@pytest.fixture
def point(tmp_path, truth):
    """A raw picture of a distant point through the lens, without contacts."""
    write_flat(tmp_path / "point.dng", point_light(point_rays(truth, 2.0, 13.0), -70.0, SENSOR_MM))
    return tmp_path / "point.dng"


def test_a_point_checks_the_rims_before_and_after_a_fit(tmp_path, truth, point, capsys):
    wide = replace(truth, surfaces=tuple(replace(each, semi_aperture_mm=1.2 * each.semi_aperture_mm)
                                         for each in truth.surfaces))
    (tmp_path / "own.toml").write_text(write_prescription(wide))
    flat = [tmp_path / f"{f_number}.dng" for f_number in (2.0, 4.0)]
    for path in flat:
        write_flat(path, flat_light(truth, float(path.stem), SENSOR_MM))
    assert run("lens", "fit", tmp_path / "own.toml", "--flat", *flat, "--points", point, "--f-numbers", "2,4,2",
               "-o", tmp_path / "mine.toml") == 0
    *_, line, last = capsys.readouterr().out.splitlines()
    assert line.startswith("point.dng: f/2, 15.") and last == str(tmp_path / "mine.toml")
    before, after = (abs(float(each.split(")")[0])) for each in line.split("(")[1:])
    assert before > 0.1 and after < 0.015


def test_a_point_alone_checks_the_rims(point, capsys):
    assert run("lens", "fit", NAME, "--points", point, "--f-numbers", 2) == 0
    line, = capsys.readouterr().out.splitlines()
    assert "; this lens 0.7" in line


def test_a_lens_without_photographs_gets_typical_rims(tmp_path, capsys):
    assert run("lens", "fit", "tessar-50mm", "--typical", "-o", tmp_path / "mine.toml") == 0
    fitted = read_prescription(tmp_path / "mine.toml")
    assert capsys.readouterr().out == f"{tmp_path / 'mine.toml'}\n"
    assert fitted.aperture_origin == "typical of photographed lenses"
    expected = with_typical_rims(prescription_of("tessar-50mm"))
    assert [each.semi_aperture_mm for each in fitted.surfaces] == pytest.approx(
        [each.semi_aperture_mm for each in expected.surfaces])


def test_lenses_unlike_the_photographed_ones_are_a_warning(tmp_path, capsys):
    assert run("lens", "fit", "apple-phone-4mm", "--typical", "-o", tmp_path / "mine.toml") == 0
    warning, path = capsys.readouterr().out.splitlines()
    assert warning.startswith("warning: typical rims are measured for full frame") and path.endswith("mine.toml")


def test_the_size_of_the_cameras_sensor_sets_the_heights(tmp_path, truth, capsys):
    """The same pictures from a smaller sensor are from smaller heights, where the lens cannot be so dark."""
    small_mm, paths = (18.0, 12.0), [tmp_path / f"{f_number}.dng" for f_number in (2.0, 4.0, 8.0)]
    for path in paths:
        write_flat(path, flat_light(truth, float(path.stem), small_mm), mounted(58.6, float(path.stem)))
    assert run("lens", "fit", NAME, "--flat", *paths, "--camera-sensor", "18x12", "-o", tmp_path / "a.toml") == 0
    after = float(capsys.readouterr().out.strip().splitlines()[-2].split()[-1])
    assert after < 0.02


def test_the_kit_is_a_page(tmp_path, capsys):
    assert run("lens", "fit", "--kit", "-o", tmp_path / "kit.md") == 0
    page = (tmp_path / "kit.md").read_text()
    assert page.startswith("# Photographs of a lens\n") and all(
        word in page for word in ("even field", "distant point", "slanted edge", "--f-numbers", "--camera-sensor"))
    assert capsys.readouterr().out == f"{tmp_path / 'kit.md'}\n"
    assert failure(capsys, "lens", "fit", "--kit", "-o", tmp_path / "kit.toml").startswith(
        f"lensfield: {tmp_path / 'kit.toml'}: suffix is .toml")


def test_lensfuns_data_give_a_prescription(tmp_path, capsys):
    pytest.importorskip("lensfunpy", reason="Lensfun's data come with lensfunpy: make test-photographs")
    assert run("lens", "fit", NAME, "--lensfun", "KMZ Helios-44 58mm 1:2", "-o", tmp_path / "mine.toml") == 0
    agreement = read_prescription(tmp_path / "mine.toml").photographs
    assert agreement.source == "Lensfun: KMZ Helios-44 58mm 1:2" and 0 < agreement.illumination < 0.03
    assert not agreement.light, "Lensfun's data stay with Lensfun"


@pytest.mark.parametrize("arguments, line", [
    (("--vignetting", "light.csv"), "options: lens is missing: give the name or the prescription of the lens"),
    (("lens.npz", "--vignetting", "light.csv"), "lens.npz: kind of file is a lens package: it contains no rims"),
    ((NAME, "--flat", "a.dng", "b.dng", "--f-numbers", "2"), "raw pictures: f-numbers is 2: expected 2 f-numbers, one"),
    ((NAME, "--flat", "a.dng", "--f-numbers", "two"), "raw pictures: f-numbers is two: expected 1 f-numbers"),
    ((NAME, "--flat", "a.dng", "--f-numbers", "0"), "raw pictures: f-numbers is 0: expected"),
    ((NAME, "--flat", "a.dng", "--points", "b.dng", "--f-numbers", "2"), "raw pictures: f-numbers is 2: expected 2"),
    ((NAME, "--typical", "--points", "missing.dng"), "missing.dng: raw picture is missing"),
    ((NAME, "--points", "a.dng"), "options: --output is mine.toml: --points only checks rims: omit --output"),
    ((NAME, "--typical", "--camera-sensor", "24x16"), "options: --camera-sensor is 24x16: omit it"),
    (("--kit", "--f-numbers", "2"), "options: --f-numbers is 2: omit it: it is of raw pictures (--flat, --points)"),
    (("--kit", "--points", "a.dng"), "options: --points is given with --kit: write the page first"),
    ((NAME, "--vignetting", "light.csv", "--points", "a.dng", "--focus", "2m"), "options: --focus is 2m: omit it"),
    ((NAME,), "options: photographs is missing: give --flat, --vignetting, --lensfun or --points; or --typical, or"),
    ((NAME, "--flat", "missing.dng"), "missing.dng: raw picture is missing"),
    ((NAME, "--flat", "light.csv"), "light.csv: raw picture is not readable: expected a raw file"),
    ((NAME, "--vignetting", "missing.csv"), "missing.csv: file is missing"),
    ((NAME, "--vignetting", "lens.npz"), "lens.npz: line 1 is"),
    (("nikkor-reflex-500mm", "--vignetting", "light.csv"),
     "nikkor-reflex-500mm: surface 5 is a mirror: the light of an even field needs a lens without mirrors"),
    (("edmund-54852", "--vignetting", "light.csv"), "edmund-54852: ")])
def test_bad_input_is_one_line(tmp_path, monkeypatch, capsys, table, arguments, line):
    monkeypatch.chdir(tmp_path)
    write_package(make_lens(), tmp_path / "lens.npz")
    for name in ("a.dng", "b.dng"):
        (tmp_path / name).write_bytes(b"II*\0")
    assert failure(capsys, "lens", "fit", *arguments, "-o", "mine.toml").startswith(f"lensfield: {line}")
    assert not (tmp_path / "mine.toml").exists()


def test_a_fit_needs_a_file_to_write(capsys):
    assert failure(capsys, "lens", "fit", NAME, "--typical").startswith("lensfield: options: --output is missing: name")


def test_info_and_list_show_the_agreement_with_photographs(tmp_path, truth, capsys):
    agreement = Agreement("the source", "2026-11-29", 0.021, 11.2, 3.4)
    (tmp_path / "own.toml").write_text(write_prescription(replace(truth, photographs=agreement)))
    words = ("compared with photographs of this lens: illumination ± 0.02, distortion ± 11 µm, lateral colour ± 3 µm "
             "(the source)")
    assert run("lens", "info", tmp_path / "own.toml", "--wavelengths", 550, "--lens-quality", "preview") == 0
    assert f"photographs              {words}\n" in capsys.readouterr().out
    assert run("lens", "info", "tessar-50mm", "--wavelengths", 550, "--lens-quality", "preview") == 0
    assert f"photographs              {NOT_COMPARED}\n" in capsys.readouterr().out


def test_the_list_of_compared_lenses_has_their_agreement(capsys):
    assert run("lens", "list", "--compared", "sony") == 0
    line, = capsys.readouterr().out.splitlines()
    assert line.startswith("sony-zeiss-55mm-f1.8") and line.endswith("(Lensfun: Sony FE 55mm f/1.8 ZA)")
    assert f" {prescription_of('sony-zeiss-55mm-f1.8').photographs}" in line
    assert run("lens", "list", "--compared", "tessar") == 0 and not capsys.readouterr().out
