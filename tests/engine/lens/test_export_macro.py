"""Macros that export a lens, run in stand-ins of the programs that they are written for."""

import json
import re
import sys
import tomllib
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

import codev_seq
import opticstudio
import zpl
from lens_program import ENTRANCE_PUPIL_MM, MARGINAL_COSINE, OUTERMOST_MM, LensInProgram
from lensfield.cli import main
from lensfield.engine import InputError, LensError
from lensfield.engine.lens.export_macro import MACROS, PROGRAMS, ExportOptions, export_macro
from lensfield.engine.lens.readers import import_lens
from places import ROOT, SHARED_DATA

FEW = ExportOptions(heights=3, last_height_mm=2.0, wavelengths_nm=(450.0, 587.6, 650.25), psf_samples=32,
                    psf_pitch_um=0.25, pupil_samples=64, sensor_mm=(3.2, 2.4))

# Every word of the two macros, and where it is documented or was seen at work.
ISET_ZPL = "ISET_RT_ZEMAX_2D.ZPL and ISET_RT_ZEMAX.ZPL, macros of the paper's authors (isetcam, opticalimage/raytrace)"
ZEMAX_CONVERTER = "Zemax's own macro 'Convert CODE V to OpticStudio' 2.06"
NUMERIC_FUNCTIONS = "OpticStudio help, ZPL, Numeric Functions"
PYZDDE = "PyZDDE 2.0.3, docstrings of zGetSystemProperty, zOperandValue, zGetTextFile and zModifySettings"
OPTIC_GOST = "JSONexport.zpl of OpticGOST (vignetting factors by function)"
HPS_SETTINGS = "a public ZPL batch that sets HPS_PUPILSAMP, HPS_IMAGESAMP and HPS_IMAGEDELTA; zemax.com/kb/articles/171"
OPEV = "support.zemax.com 1500005487661 (OPEV, OCOD)"
ZPL_SOURCES = {
    ISET_ZPL: "FOR NEXT IF ENDIF OUTPUT SCREEN PRINT FORMAT EXP UPDATE SETVIG RAYTRACE PWAV WAVL NUMWAVE NUMFIELD FLDX "
              "FLDY GETTEXTFILE Hps BEEP $FILENAME $PATHNAME $LENSNAME $STR THIC NSUR RELI RAYY",
    ZEMAX_CONVERTER: "GOSUB SUB RETURN END ELSE $LEFTSTRING SLEN SYSP",
    NUMERIC_FUNCTIONS: "ABSO CURV NFLD NWAV FWGT WWGT RAYE RAYM SYPR",
    OPTIC_GOST: "FVDX FVDY FVCX FVCY FVAN",
    OPEV: "OPEV OCOD",
    "ZPL help, DECLARE (double arrays)": "DECLARE DOUBLE",
    PYZDDE + "; zemax.com/kb/articles/171": "MODIFYSETTINGS",
    HPS_SETTINGS: "HPS_PUPILSAMP HPS_IMAGESAMP HPS_IMAGEDELTA"}
SYSTEM_CODES = {30, 70, *range(100, 110), 200, 201, 202, 203}  # by PyZDDE: units, ray aiming, fields, wavelengths
OPERANDS = {"ENPP", "EFFL", "PMAG", "PIMH"}

ISET_SEQ = "ISET_RT_CODEV.SEQ, macro of the paper's authors (isetcam, opticalimage/raytrace/codev)"
NASA = "NASA's MATLAB toolkit for CODE V: cvr.seq, cvfw.seq, cvrsi.seq, cvsave.m"
SEQ_SOURCES = {
    ISET_SEQ: "STR IF ELS END FOR CONCAT NUM_TO_STR BUF DEL PUT EXP SEP B I J RES REF WL W THI S RED EFL XIM YIM SET "
              "VIG PSF TGR GRI LIS N INT WBF GO Y R SI F TRA FUL NO NRD YES FND BUF.I BUF.NUM",
    NASA: "LCL NUM M Z TIT SAV RSI RER",
    "public sequences that were run in CODE V 11.5": "ABSF CUY DIM FMT WRI Q"}


def words_of(sources):
    return {word for words in sources.values() for word in words.split()}


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_placeholder_is_filled(program):
    text = export_macro(program, FEW)
    assert "@{" not in text and "${" not in text
    assert text.isascii()


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_head_tells_options_and_how_far_it_was_tested(program):
    head = export_macro(program, FEW)[:2600]
    for words in ("3, from 0 to 2 mm", "3, from 450 to 650.25 nm", "32 x 32 samples, 0.25 um apart", "3.2 x 2.4 mm",
                  f"lensfield lens export-macro {program}"):
        assert words in head
    assert "not in the program itself" in re.sub(r"[\s!]+", " ", head)


@pytest.mark.parametrize("program, lines", [
    ("zemax", ["heights_n = 3", "waves_n = 3", "last_mm = 2", "pitch_um = 0.25", "psf_code = 1", "pupil_code = 2",
               "sensor_w_mm = 3.2", "sensor_h_mm = 2.4", "DECLARE nm_of, DOUBLE, 1, 3", "nm_of(3) = 650.25",
               "DECLARE real_of, DOUBLE, 1, 9"]),
    ("codev", ["^HEIGHTS == 3", "^WAVES == 3", "^LAST == 2", "^SAMPLES == 32", "^PITCHMM == 0.00025",
               "^PITCHUM == 0.25", "^GRID == 64", "^RAYS == 64", "^SENSORW == 3.2", "^SENSORH == 2.4", "LCL NUM ^NM(3)",
               "^NM(3) == 650.25"]),
    ("zospy", ["HEIGHTS = 3", "LAST_HEIGHT_MM = 2  # 0: that of the outermost field", "    650.25,", "PSF_SAMPLES = 32",
               "PSF_PITCH_UM = 0.25", "PUPIL_SAMPLES = 64", "SENSOR_MM = [3.2, 2.4]  # 0: not told"])])
def test_options_land_where_they_should(program, lines):
    assert set(lines) <= set(export_macro(program, FEW).splitlines())


def test_the_fft_grid_holds_two_windows():
    assert "^GRID == 256" in export_macro("codev", ExportOptions(psf_samples=128, pupil_samples=64))


@pytest.mark.parametrize("program, longest", [("zemax", 120), ("codev", 80), ("zospy", 120)])
def test_lines_stay_short(program, longest):
    """ZPL's limit is some 360 characters; 80 columns are what CODE V takes in any version."""
    assert max(map(len, export_macro(program, FEW).splitlines())) <= longest


@pytest.mark.parametrize("program, comment, strings", [
    ("zemax", "!", r'"[^"]*"'), ("codev", "!", r'''"[^"]*"|'[^']*\'''')])
def test_quotes_and_brackets_balance_on_every_line(program, comment, strings):
    for line in export_macro(program, FEW).splitlines():
        if not line.lstrip().startswith(comment):
            rest = re.sub(strings, "", line)
            assert '"' not in rest and "'" not in rest, line
            assert rest.count("(") == rest.count(")"), line


def test_zpl_uses_documented_words_alone():
    macro = export_macro("zemax", FEW)
    assert zpl.words(macro) == words_of(ZPL_SOURCES)
    assert {int(code) for code in re.findall(r"SY[SP][PR]\W(\d+)", macro)} <= SYSTEM_CODES
    assert set(re.findall(r'OCOD\("(\w+)"\)', macro)) == OPERANDS


def test_codev_uses_documented_words_alone():
    assert codev_seq.words(export_macro("codev", FEW)) == words_of(SEQ_SOURCES)


@pytest.mark.parametrize("opening, closing", [("FOR", "NEXT"), ("IF", "ENDIF"), ("SUB", "RETURN")])
def test_zpl_blocks_balance(opening, closing):
    first = [line.split()[0] for line in zpl.statements(export_macro("zemax", FEW))]
    assert first.count(opening) == first.count(closing) > 0
    assert not any(" THEN " in line for line in zpl.statements(export_macro("zemax", FEW)))


@pytest.mark.parametrize("word", ["FOR", "IF"])
def test_codev_blocks_balance(word):
    commands = codev_seq.statements(export_macro("codev", FEW))
    opened = [command for command in commands if command.startswith(word + " ")]
    assert len(opened) == commands.count("END " + word) > 0


class Zemax:
    """Runs the macro as OpticStudio would, on a lens called triplet.zmx."""

    name, psf_suffix = "zemax", "txt"
    FIELDS = [dict.fromkeys(zpl.FIELD_CODES.values(), 0.0) | {"y": y, "weight": 1.0, "vcy": y / 9}
              for y in (0.0, 14.0, 20.0)]

    def run(self, folder, lens, options=FEW, title="Triplet"):
        (folder / "triplet-lensfield").mkdir()
        lens.fields = deepcopy(self.FIELDS)
        return zpl.run(export_macro("zemax", options), lens, folder / "triplet.zmx", title)

    def folder(self, folder):
        return folder / "triplet-lensfield"


class CodeV:
    """Runs the macro as CODE V would, in its default folder."""

    name, psf_suffix = "codev", "txt"
    FIELDS = [{"x": 0.0, "y": y} for y in (0.0, 1.0, OUTERMOST_MM)]

    def run(self, folder, lens, options=FEW, title="Triplet"):
        (folder / "lensfield_export").mkdir()
        lens.fields = deepcopy(self.FIELDS)
        return codev_seq.run(export_macro("codev", options), lens, folder, title)

    def folder(self, folder):
        return folder / "lensfield_export"


class Zospy:
    """Runs the script with a stand-in for zospy."""

    name, psf_suffix = "zospy", "json"
    FIELDS = [opticstudio.FIELD_VALUES | {"Y": y, "Weight": 2.0, "VCY": y / 9, "Comment": f"{y} deg"}
              for y in (0.0, 14.0, 20.0)]

    def __init__(self, monkeypatch):
        self.monkeypatch = monkeypatch

    def run(self, folder, lens, options=FEW, title="Triplet"):
        lens.fields = deepcopy(self.FIELDS)
        self.studio = opticstudio.OpticStudio(lens, r"C:\Lenses\triplet.zmx", title)
        self.script(options)["main"](str(folder / "triplet.zmx"), self.folder(folder))

    def script(self, options):
        for name, module in opticstudio.zospy_modules(self.studio).items():
            self.monkeypatch.setitem(sys.modules, name, module)
        names = {"__name__": "macro"}
        exec(compile(export_macro("zospy", options), "zospy.py", "exec"), names)
        return names

    def folder(self, folder):
        return folder / "triplet-lensfield"


@pytest.fixture(params=["zemax", "codev", "zospy"])
def macro(request, monkeypatch):
    return {"zemax": Zemax, "codev": CodeV, "zospy": lambda: Zospy(monkeypatch)}[request.param]()


def read(folder):
    return tomllib.loads((folder / "lens.toml").read_text(encoding="utf-8"))


def test_the_description_is_whole(macro, tmp_path):
    macro.run(tmp_path, LensInProgram())
    facts = read(macro.folder(tmp_path))
    assert facts["format"] == "lensfield-export" and facts["version"] == 1 and facts["program"] == macro.name
    assert facts["name"] == "Triplet" and "lensfield" in facts["source"]
    assert facts["efl_mm"] == pytest.approx(6.0)
    assert facts["magnification"] == pytest.approx(-0.024)
    assert facts["f_number_effective"] == pytest.approx(0.5 / MARGINAL_COSINE)
    assert facts["entrance_pupil_mm"] == pytest.approx(ENTRANCE_PUPIL_MM)
    assert facts["reference_wavelength_nm"] == pytest.approx(587.6)
    assert facts["object_distance_mm"] == 250
    assert facts["sensor_mm"] == [3.2, 2.4]
    assert facts["wavelengths_nm"] == [450, 587.6, 650.25]
    assert facts["heights_mm"] == [0, 1, 2]
    assert facts["image_side"] == "+y"
    assert (facts["real_height"], facts["relative_illumination"]) == ("real_height.txt", "ri.txt")
    assert facts["psf"] == f"psf_{{height}}_{{wavelength}}.{macro.psf_suffix}"
    assert ("psf_pitch_um" in facts) == (macro.name == "codev")
    assert facts.get("psf_pitch_um", 0.25) == 0.25


def traced_heights(lens):
    """Paraxial image heights of FEW's object points, [height][wavelength]."""
    return np.outer([0, 1, 2], [lens.scale(nm) / lens.scale(587.6) for nm in FEW.wavelengths_nm])


@pytest.mark.parametrize("object_mm", [250.0, 1e10])
def test_tables_hold_one_object_point_at_every_wavelength(macro, tmp_path, object_mm):
    lens = LensInProgram(object_mm)
    macro.run(tmp_path, lens)
    real = np.loadtxt(macro.folder(tmp_path) / "real_height.txt")
    light = np.loadtxt(macro.folder(tmp_path) / "ri.txt")
    heights = traced_heights(lens)
    assert np.ptp(heights[2]) > 5e-3  # lateral colour that would be lost at one paraxial height
    np.testing.assert_allclose(real, lens.real_height(heights), rtol=1e-8)
    np.testing.assert_allclose(light, lens.relative_illumination(heights), rtol=1e-8)


def test_an_object_at_infinity_is_told_as_such(macro, tmp_path):
    lens = LensInProgram(1e10)
    macro.run(tmp_path, lens)
    facts = read(macro.folder(tmp_path))
    assert facts["object_distance_mm"] == float("inf")
    assert facts["magnification"] == pytest.approx(lens.magnification(587.6), abs=1e-6)


def test_without_last_height_and_sensor_the_lens_tells_its_own(macro, tmp_path):
    macro.run(tmp_path, LensInProgram(), ExportOptions(heights=2, wavelengths_nm=(550.0,), psf_samples=32))
    facts = read(macro.folder(tmp_path))
    assert facts["heights_mm"] == pytest.approx([0, OUTERMOST_MM])
    assert "sensor_mm" not in facts


@pytest.fixture(params=["+y", "-y"])
def image_side(request, monkeypatch):
    """Image points of positive paraxial heights above the axis, and below it."""
    upright = LensInProgram.real_height
    if request.param == "-y":
        monkeypatch.setattr(LensInProgram, "real_height", lambda lens, height: -upright(lens, height))
    return request.param


def test_the_export_becomes_a_lens(macro, tmp_path, image_side):
    lens = LensInProgram()
    macro.run(tmp_path, lens)
    assert read(macro.folder(tmp_path))["image_side"] == image_side
    imported, heights = import_lens(macro.folder(tmp_path)), traced_heights(lens)
    np.testing.assert_allclose(imported.real_height_mm, abs(lens.real_height(heights)).T, rtol=1e-8)
    np.testing.assert_allclose(imported.relative_illumination, lens.relative_illumination(heights).T, rtol=1e-8)
    assert imported.name == "Triplet" and imported.sensor_mm == (3.2, 2.4)
    assert imported.psf_pitch_um == pytest.approx(0.25)
    for w, h in np.ndindex(3, 3):
        expected = lens.psf(heights[h, w], 32, 0.25)[1:, 1:]
        outwards = expected[::-1] if image_side == "-y" else expected
        np.testing.assert_allclose(imported.psf[w, h] / imported.psf[w, h].max(), outwards / outwards.max(), atol=1e-3)


def assert_as_it_was(macro, lens):
    in_studio = macro.name == "zospy" and [field.values() for field in macro.studio.SystemData.Fields.all]
    assert (in_studio or lens.fields) == macro.FIELDS
    assert (lens.field_type, lens.primary) == ("angle", 2)
    assert lens.wavelengths_nm == pytest.approx([486.1, 587.6, 656.3])


def test_the_system_is_left_as_it_was(macro, tmp_path):
    lens = LensInProgram()
    macro.run(tmp_path, lens)
    assert_as_it_was(macro, lens)


def test_only_the_folder_of_the_macro_is_written(macro, tmp_path):
    macro.run(tmp_path, LensInProgram())
    assert list(tmp_path.iterdir()) == [macro.folder(tmp_path)]
    names = {path.name for path in macro.folder(tmp_path).iterdir()}
    psfs = {f"psf_{h}_{w}.{macro.psf_suffix}" for h in (1, 2, 3) for w in (1, 2, 3)}
    assert names - {"huygens.cfg", "lens_before_export.len"} == {"lens.toml", "real_height.txt", "ri.txt"} | psfs


def assert_stopped(macro, tmp_path, lens, reason, options=FEW):
    """The reason is told, the lens is as it was, and what was written is not taken for a lens."""
    if macro.name == "zospy":
        with pytest.raises(SystemExit, match=reason):
            macro.run(tmp_path, lens, options)
    else:
        stops = [line for line in macro.run(tmp_path, lens, options) if line.startswith("Stopped:")]
        assert len(stops) == 1 and reason in stops[0]
    assert_as_it_was(macro, lens)
    with pytest.raises(LensError):
        import_lens(macro.folder(tmp_path))


def test_a_lens_that_changes_with_the_wavelength_is_refused(macro, tmp_path):
    assert_stopped(macro, tmp_path, LensInProgram(solve=True), "olves change the lens")


def test_inches_are_refused(macro, tmp_path):
    assert_stopped(macro, tmp_path, LensInProgram(units=2), "not millimetres")
    assert not any(tmp_path.rglob("lens.toml"))


def test_a_lost_chief_ray_is_told(macro, tmp_path):
    assert_stopped(macro, tmp_path, LensInProgram(), "chief ray is lost", replace(FEW, last_height_mm=5.0))


def test_a_lens_with_fields_on_the_axis_alone_needs_a_last_height(macro, tmp_path, monkeypatch):
    monkeypatch.setattr(macro, "FIELDS", macro.FIELDS[:1])
    monkeypatch.setattr(zpl, "OUTERMOST_MM", 0.0)
    monkeypatch.setattr(opticstudio, "OUTERMOST_MM", 0.0)
    assert_stopped(macro, tmp_path, LensInProgram(), "--last-height", replace(FEW, last_height_mm=None))


def test_at_the_end_the_next_step_is_told(macro, tmp_path, capsys):
    lines = macro.run(tmp_path, LensInProgram()) or capsys.readouterr().out.splitlines()
    assert re.search(r"lensfield lens import .+ -o .*\.npz", lines[-1 if macro.name != "zemax" else -2])


def test_a_lens_without_title_has_the_name_of_its_file(tmp_path):
    Zemax().run(tmp_path, LensInProgram(), title="")
    assert read(tmp_path / "triplet-lensfield")["name"] == "triplet"


def test_zemax_is_stopped_by_decimal_commas(tmp_path, monkeypatch):
    number = zpl._Machine.number
    monkeypatch.setattr(zpl._Machine, "number", lambda machine, value: number(machine, value).replace(".", ","))
    assert "decimal comma" in Zemax().run(tmp_path, LensInProgram())[0]
    assert list((tmp_path / "triplet-lensfield").iterdir()) == []


def test_the_script_asks_for_the_psfs_that_were_wanted(tmp_path, monkeypatch):
    macro, lens = Zospy(monkeypatch), LensInProgram()
    macro.run(tmp_path, lens)
    assert macro.studio.connections == ["standalone"] and macro.studio.loaded == [str(tmp_path / "triplet.zmx")]
    nm, heights, settings = zip(*macro.studio.psfs)
    assert np.allclose(np.reshape(nm, (3, 3)).T, FEW.wavelengths_nm)
    assert np.allclose(np.reshape(heights, (3, 3)).T, traced_heights(lens))
    wanted = {"image_sampling": "32x32", "pupil_sampling": "64x64", "image_delta": 0.25, "field": 1, "wavelength": 1,
              "use_centroid": False, "normalize": False, "psf_type": "Linear"}
    assert all(one.items() >= wanted.items() for one in settings)


def test_the_script_restores_the_system_after_an_error(tmp_path, monkeypatch):
    macro, lens = Zospy(monkeypatch), LensInProgram()
    monkeypatch.setattr(opticstudio.HuygensPSF, "run", lambda psf, oss: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        macro.run(tmp_path, lens)
    assert_as_it_was(macro, lens)


def test_the_script_refuses_fields_that_cannot_be_set(tmp_path, monkeypatch):
    macro, lens = Zospy(monkeypatch), LensInProgram()
    monkeypatch.setattr(Zospy, "FIELDS", [values | {"Ignore": True} for values in Zospy.FIELDS])
    assert_stopped(macro, tmp_path, lens, "Field 1 cannot be set")


@pytest.mark.parametrize("case", ["zemax", "zospy"])
def test_a_dark_axis_is_told(case, tmp_path, monkeypatch):
    monkeypatch.setattr(LensInProgram, "relative_illumination", lambda lens, height: 0.0)
    assert_stopped(Zemax() if case == "zemax" else Zospy(monkeypatch), tmp_path, LensInProgram(), "o light on the axis")


def test_zemax_is_told_where_rays_are_not_aimed(tmp_path):
    assert "ray aiming is off" in Zemax().run(tmp_path, LensInProgram(ray_aiming=False))[0]
    assert import_lens(tmp_path / "triplet-lensfield").name == "Triplet"


@pytest.mark.parametrize("fields, wavelengths_nm, reason", [
    (201, [550.0], "more than 200 fields"), (1, [500.0 + n for n in range(25)], "more than 24 wavelengths")])
def test_zemax_does_not_start_what_it_could_not_put_back(fields, wavelengths_nm, reason, tmp_path, monkeypatch):
    monkeypatch.setattr(Zemax, "FIELDS", Zemax.FIELDS[:1] * fields)
    lens = LensInProgram(wavelengths_nm=wavelengths_nm, primary=1)
    assert reason in Zemax().run(tmp_path, lens)[0]
    assert lens.fields == Zemax.FIELDS and not any((tmp_path / "triplet-lensfield").iterdir())


def test_the_script_takes_the_open_lens(tmp_path, monkeypatch):
    macro = Zospy(monkeypatch)
    macro.run(tmp_path, LensInProgram())
    macro.script(FEW)["main"]("-", tmp_path / "open")
    assert macro.studio.connections == ["standalone", "extension"] and len(macro.studio.loaded) == 1
    assert read(tmp_path / "open")["name"] == "Triplet"


def test_the_script_writes_into_a_new_folder_only(tmp_path, monkeypatch):
    macro = Zospy(monkeypatch)
    macro.folder(tmp_path).mkdir()
    (macro.folder(tmp_path) / "notes.txt").write_text("mine")
    with pytest.raises(SystemExit, match="not empty"):
        macro.run(tmp_path, LensInProgram())
    assert [path.name for path in macro.folder(tmp_path).iterdir()] == ["notes.txt"]


@pytest.mark.skipif(not SHARED_DATA.exists(), reason="needs the recorded exports of shared/data")
def test_the_stand_in_writes_what_zospy_was_seen_to_write():
    recorded = json.loads((SHARED_DATA / "vendor_exports" / "zospy" / "huygens_psf_24.2.2.json").read_text())
    written = opticstudio.as_recorded(np.ones((64, 64)).tolist(), 0.6827813965, opticstudio.HUYGENS_SETTINGS)
    assert written.keys() == recorded.keys() and written["data"].keys() == recorded["data"].keys()
    assert written["settings"].keys() == recorded["settings"].keys()
    np.testing.assert_allclose(written["data"]["index"], recorded["data"]["index"], atol=1e-7)


@pytest.mark.parametrize("options, field", [
    ({"heights": 1}, "heights"), ({"heights": 1001}, "heights"), ({"last_height_mm": 0.0}, "last_height_mm"),
    ({"last_height_mm": float("nan")}, "last_height_mm"), ({"wavelengths_nm": ()}, "wavelengths_nm"),
    ({"wavelengths_nm": (500.0, 400.0)}, "wavelengths_nm"), ({"wavelengths_nm": (-1.0, 400.0)}, "wavelengths_nm"),
    ({"psf_samples": 60}, "psf_samples"), ({"pupil_samples": 16}, "pupil_samples"),
    ({"psf_pitch_um": -1.0}, "psf_pitch_um"), ({"sensor_mm": (4.8, 0.0)}, "sensor_mm")])
def test_values_that_cannot_be_are_told_in_one_line(options, field):
    with pytest.raises(InputError) as caught:
        ExportOptions(**options)
    assert caught.value.field == field and "\n" not in str(caught.value)


def test_an_unknown_program_is_refused():
    with pytest.raises(InputError, match="zemax, codev, zospy"):
        export_macro("oslo", FEW)


def test_the_command_prints_the_macro(capsys):
    assert main(["lens", "export-macro", "zemax"]) == 0
    assert capsys.readouterr().out == export_macro("zemax", ExportOptions())


def test_the_command_writes_a_file_for_windows(tmp_path, capsys):
    path = tmp_path / "export.seq"
    assert main(["lens", "export-macro", "codev", "-o", str(path), "--heights", "3", "--last-height", "2",
                 "--wavelengths", "450,587.6,650.25", "--psf-samples", "32", "--psf-pitch-um", "0.25",
                 "--pupil-samples", "64", "--sensor", "3.2x2.4"]) == 0
    assert path.read_bytes() == export_macro("codev", FEW).replace("\n", "\r\n").encode("ascii")
    assert list(tmp_path.iterdir()) == [path] and capsys.readouterr().out == ""


@pytest.mark.parametrize("arguments, told", [
    (["--sensor", "3"], "--sensor is 3"), (["--wavelengths", "700:400:3"], "wavelengths is 700:400:3"),
    (["--psf-samples", "50"], "psf_samples is 50")])
def test_the_command_tells_bad_values(arguments, told, capsys):
    assert main(["lens", "export-macro", "zospy", *arguments]) == 1
    assert told in capsys.readouterr().err


def test_templates_are_installed_with_the_package():
    package = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    patterns = package["lensfield.engine"]
    assert all(any(path in (ROOT / "engine").glob(pattern) for pattern in patterns) for path in MACROS.iterdir())
    assert {path.name for path in MACROS.iterdir()} == set(PROGRAMS.values())
