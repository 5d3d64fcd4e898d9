"""Macros that export a lens: their commands are documented, options end up in them, and their output is read.

The tests do not contain an interpreter for the macros, which would share its author's misconceptions.
"""

import ast
import json
import re
import sys
import tomllib
from types import ModuleType

import numpy as np
import pytest

from lensfield.cli import main
from lensfield.engine import InputError
from lensfield.engine.lens_files import import_lens
from lensfield.engine.lens_files.export_macro import MACROS, PROGRAMS, ExportOptions, export_macro
from lensfield.engine.lens_files.zospy import LINEAR
from lensfield.engine.runtime.text import number_table
from places import ROOT
from refusals import refused
from vendor_files import check_same_lens, export_folder, exported_lens, vendor_export

FEW = ExportOptions(heights=3, last_height_mm=2.0, wavelengths_nm=(450.0, 587.6, 650.25), psf_samples=32,
                    psf_pitch_um=0.25, pupil_samples=64, sensor_mm=(3.2, 2.4))
MACRO = {program: export_macro(program, FEW) for program in PROGRAMS}

FILLED = {
    "zemax": """\
!   field heights          3, from 0 to 2 mm
!   wavelengths            3, from 450 to 650.25 nm
!   PSF                    32 x 32 samples, 0.25 um apart
!   pupil sampling         64 x 64
!   sensor                 3.2 x 2.4 mm
heights_n = 3
waves_n = 3
last_mm = 2
pitch_um = 0.25
psf_code = 1
pupil_code = 2
sensor_w_mm = 3.2
sensor_h_mm = 2.4
DECLARE nm_of, DOUBLE, 1, 3
nm_of(1) = 450
nm_of(2) = 587.6
nm_of(3) = 650.25
DECLARE real_of, DOUBLE, 1, 9
DECLARE light_of, DOUBLE, 1, 9
""",
    "codev": """\
!   field heights   3, from 0 to 2 mm
!   wavelengths     3, from 450 to 650.25 nm
!   PSF             32 x 32 samples, 0.25 um apart
!   FFT grid        64 x 64
!   rays for light  64 across the pupil
!   sensor          3.2 x 2.4 mm
^HEIGHTS == 3
^WAVES == 3
^LAST == 2
^SAMPLES == 32
^PITCHMM == 0.00025
^PITCHUM == 0.25
^GRID == 64
^RAYS == 64
^SENSORW == 3.2
^SENSORH == 2.4
LCL NUM ^NM(3)
^NM(1) == 450
^NM(2) == 587.6
^NM(3) == 650.25
""",
    "zospy": """\
    field heights      3, from 0 to 2 mm
    wavelengths        3, from 450 to 650.25 nm
    PSF                32 x 32 samples, 0.25 um apart
    pupil sampling     64 x 64
    sensor             3.2 x 2.4 mm
HEIGHTS = 3
LAST_HEIGHT_MM = 2  # 0: that of the outermost field
    450,
    587.6,
    650.25,
PSF_SAMPLES = 32
PSF_PITCH_UM = 0.25
PUPIL_SAMPLES = 64
SENSOR_MM = [3.2, 2.4]  # 0: not told
@contextmanager
"""}
"""The lines that each macro's template leaves open, with the options FEW."""

# The layout of lens.toml from each macro: Zemax by PRINT under FORMAT .9 EXP, CODE V by cells separated by tabs.
DESCRIPTION = {
    "zemax": """\
format = 'lensfield-export'
version = 1
program = 'zemax'
name = '''Triplet'''
source = 'exported from Zemax OpticStudio by the macro of lensfield'
notes = '''lens file TRIPLET.ZMX'''
efl_mm = 6.000000000E+000
magnification = -2.400000000E-002
f_number_effective = 2.000000000E+000
entrance_pupil_mm = 4.000000000E+000
reference_wavelength_nm = 5.876000000E+002
object_distance_mm = 2.500000000E+002
sensor_mm = [3.200000000E+000, 2.400000000E+000]
wavelengths_nm = [
4.500000000E+002,
5.876000000E+002,
6.502500000E+002,
]
heights_mm = [
0.000000000E+000,
1.000000000E+000,
2.000000000E+000,
]
image_side = '-y'
real_height = 'real_height.txt'
relative_illumination = 'ri.txt'
psf = 'psf_{height}_{wavelength}.txt'
""",
    "codev": """\
format = 'lensfield-export'\t\t
version = 1\t\t
program = 'codev'\t\t
name = '''Triplet'''\t\t
source = 'exported from CODE V by the macro of lensfield'\t\t
image_side = '-y'\t\t
real_height = 'real_height.txt'\t\t
relative_illumination = 'ri.txt'\t\t
psf = 'psf_{height}_{wavelength}.txt'\t\t
psf_pitch_um =\t5.00000000000000000e-01\t
efl_mm =\t6.00000000000000000e+00\t
magnification =\t-2.40000000000000005e-02\t
f_number_effective =\t2.00000000000000000e+00\t
entrance_pupil_mm =\t4.00000000000000000e+00\t
reference_wavelength_nm =\t5.87600000000000023e+02\t
object_distance_mm =\t2.50000000000000000e+02\t
sensor_mm = [\t\t
\t3.20000000000000018e+00\t,
\t2.39999999999999991e+00\t]
wavelengths_nm = [\t\t
\t4.50000000000000000e+02\t,
\t5.87600000000000023e+02\t,
\t6.50250000000000000e+02\t,
]\t\t
heights_mm = [\t\t
\t0.00000000000000000e+00\t,
\t1.00000000000000000e+00\t,
\t2.00000000000000000e+00\t,
]\t\t
"""}

# Every word of the macros, with its documentation or an observed use.
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


ZOSPY = "zospy 2.1.5 (github.com/MREYE-LUMC/ZOSPy), "
ZOSPY_SOURCES = {
    ZOSPY + "zospy/zpcore.py and analyses/base.py": "ZOS connect load run data to_json constants",
    ZOSPY + "stubs of ZOSAPI": "SystemData LDE MFE SystemFile",
    ZOSPY + "stubs of ZOSAPI.SystemData":
        "Fields NumberOfFields GetField AddField RemoveField GetFieldType SetFieldType SetVignetting X Y "
        "Wavelengths NumberOfWavelengths GetWavelength AddWavelength RemoveWavelength MakePrimary IsPrimary Wavelength "
        "Weight Units LensUnits TitleNotes Title",
    ZOSPY + "stubs of ZOSAPI.Editors.LDE and .MFE": "NumberOfSurfaces GetSurfaceAt Thickness Radius GetOperandValue",
    ZOSPY + "stubs of the constants": "Editors MeritOperandType ZemaxSystemUnits Millimeters FieldType "
                                      "ParaxialImageHeight",
    "Python": "argv exit dumps inf isinf items iterdir exists mkdir join name stem write_text"}
ZOSPY_OPERANDS = {"ENPP", "EFFL", "PMAG", "PIMH", "REAB", "REAY", "RELI"}  # stubs of the constants, MeritOperandType
ZOSPY_FIELD_VALUES = ("X", "Y", "Weight", "VDX", "VDY", "VCX", "VCY", "VAN", "TAN", "Comment", "Ignore")  # IField


def words_of(sources):
    return {word for words in sources.values() for word in words.split()}


def commands(program):
    """The commands of a ZPL or CODE V macro one by one, without comments."""
    lines = [line.strip() for line in MACRO[program].splitlines()]
    lines = [line for line in lines if line and not line.startswith("!")]
    if program == "zemax":
        return lines
    return [part.strip() for line in lines for part in ([line] if '"' in line else line.split(";"))]


def code(program):
    """The commands without quoted texts."""
    return "\n".join(re.sub(r""""[^"]*"|'[^']*'""", '""', command) for command in commands(program))


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_macro_is_its_template_filled_with_the_options(program):
    template = set((MACROS / PROGRAMS[program]).read_text(encoding="ascii").splitlines())
    assert [line for line in MACRO[program].splitlines() if line not in template] == FILLED[program].splitlines()


@pytest.mark.parametrize("options", [FEW, ExportOptions()], ids=["few", "default"])
@pytest.mark.parametrize("program", PROGRAMS)
def test_no_placeholder_remains(program, options):
    text = export_macro(program, options)
    assert "@{" not in text and "${" not in text and text.isascii()


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_head_states_the_origin_and_testing_of_the_macro(program):
    head = re.sub(r"[\s!]+", " ", MACRO[program][:2600])
    assert f"lensfield lens export-macro {program}" in head and "not in the program itself" in head


def test_the_fft_grid_holds_two_windows():
    assert "^GRID == 256" in export_macro("codev", ExportOptions(psf_samples=128, pupil_samples=64))


@pytest.mark.parametrize("program, longest", [("zemax", 120), ("codev", 80), ("zospy", 120)])
def test_lines_stay_short(program, longest):
    """ZPL's limit is about 360 characters; every version of CODE V accepts 80 columns."""
    assert max(map(len, MACRO[program].splitlines())) <= longest


@pytest.mark.parametrize("program", ["zemax", "codev"])
def test_quotes_and_brackets_balance_in_every_command(program):
    for command in code(program).splitlines():
        rest = command.replace('""', "")
        assert '"' not in rest and "'" not in rest and rest.count("(") == rest.count(")"), command


def test_zpl_uses_documented_words_only():
    """The macro's own names contain an underscore."""
    words = set(re.findall(r"\$?\b[A-Za-z]\w*\$?", code("zemax")))
    assert {word for word in words if "_" not in word or word.startswith("HPS_")} == words_of(ZPL_SOURCES)
    assert {int(number) for number in re.findall(r"SY[SP][PR]\W(\d+)", code("zemax"))} == SYSTEM_CODES
    assert set(re.findall(r'OCOD\("(\w+)"\)', MACRO["zemax"])) == OPERANDS


def test_codev_uses_documented_words_only():
    """Numbered words, such as R1, are compared without their numbers; variables begin with ^."""
    words = re.findall(r"(?<![\^$\w])[A-Z][\w.]*", code("codev").replace("..", " "))
    assert {re.sub(r"\d+$", "", word) for word in words} == words_of(SEQ_SOURCES)


def test_zospy_uses_documented_names_only():
    tree = ast.parse(MACRO["zospy"])
    assert {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)} == words_of(ZOSPY_SOURCES)
    assert set(re.findall(r'operand\(oss, "(\w+)"', MACRO["zospy"])) == ZOSPY_OPERANDS
    assert script()["FIELD_VALUES"] == ZOSPY_FIELD_VALUES


def test_zospy_is_called_with_settings_of_a_real_export():
    path = vendor_export("zospy") / "huygens_psf_24.2.2.json"
    call, = (node for node in ast.walk(ast.parse(MACRO["zospy"]))
             if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "HuygensPSF")
    settings = {keyword.arg: getattr(keyword.value, "value", None) for keyword in call.keywords}
    assert settings.keys() <= json.loads(path.read_text(encoding="utf-8"))["settings"].keys()
    assert all(settings.get(name, expected) == expected for name, expected in LINEAR.items())


@pytest.mark.parametrize("opening, closing", [("FOR", "NEXT"), ("IF", "ENDIF"), ("SUB", "RETURN")])
def test_zpl_blocks_balance(opening, closing):
    first = [command.split()[0] for command in commands("zemax")]
    assert first.count(opening) == first.count(closing) > 0
    assert " THEN " not in code("zemax")


@pytest.mark.parametrize("word", ["FOR", "IF"])
def test_codev_blocks_balance(word):
    opened = [command for command in commands("codev") if command.startswith(word + " ")]
    assert len(opened) == commands("codev").count("END " + word) > 0


@pytest.mark.parametrize("program, target, name", [
    ("zemax", r"^(?:DECLARE |FOR |SUB )?([a-z]\w*\$?)(?=[ (,]|$)", r"([a-z]+_\w+\$?)"),
    ("codev", r"^(?:LCL NUM |FOR |STR )?\^([A-Z]\w*)", r"[\^$]([A-Z]\w*)")])
def test_every_variable_is_both_set_and_used(program, target, name):
    text = code(program)
    assert set(re.findall(target, text, re.MULTILINE)) == set(re.findall(name, re.sub(target, "", text, flags=re.M)))


def script():
    """The names of the zospy script, imported without zospy."""
    modules = {name: ModuleType(name) for name in ("zospy", "zospy.analyses", "zospy.analyses.psf")}
    modules["zospy.analyses.psf"].HuygensPSF = None
    names = {"__name__": "macro"}
    with pytest.MonkeyPatch.context() as patch:
        for name, module in modules.items():
            patch.setitem(sys.modules, name, module)
        exec(compile(MACRO["zospy"], "zospy.py", "exec"), names)
    return names


@pytest.mark.parametrize("value", [6.0, -2.4e-2, 1e-7, 3, float("inf"), "a \"b\" \\ ½", [450, 587.6], [0.0]], ids=str)
def test_the_script_writes_toml(value):
    assert tomllib.loads(f"value = {script()['toml'](value)}") == {"value": value}


def test_tables_written_by_the_script_can_be_read(tmp_path):
    table = np.array([[0.0, 0.0], [0.98765432104, -1e-12], [1.9, 2.1]])  # height, wavelength
    script()["write_table"](tmp_path / "ri.txt", table.tolist())
    read = number_table((tmp_path / "ri.txt").read_text(), "ri.txt", "ri", (2, 3))
    np.testing.assert_allclose(read, table.T, rtol=1e-9)


def description(program):
    """lens.toml as a macro writes it."""
    if program != "zospy":
        return DESCRIPTION[program]
    facts = tomllib.loads(DESCRIPTION["zemax"]) | {"program": "zospy", "psf": "psf_{height}_{wavelength}.json",
                                                   "notes": "lens file C:\\Lenses\\TRIPLET.ZMX"}
    return "".join(f"{name} = {script()['toml'](value)}\n" for name, value in facts.items())


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_output_of_a_macro_can_be_imported(tmp_path, program):
    lens = exported_lens(waves=3, wavelengths_nm=np.array(FEW.wavelengths_nm), heights_mm=np.arange(3.0))
    export_folder(tmp_path, lens, program, "-y")
    (tmp_path / "lens.toml").write_text(description(program), encoding="utf-8")
    read = import_lens(tmp_path)
    check_same_lens(read, lens)
    assert (read.name, read.sensor_mm) == ("Triplet", pytest.approx((3.2, 2.4)))
    assert (read.efl_mm, read.magnification, read.f_number_effective, read.entrance_pupil_mm, read.object_distance_mm,
            read.reference_wavelength_nm) == pytest.approx((6, -0.024, 2, 4, 250, 587.6))


WRITING = {"zemax": "\nSUB write_description", "codev": "IF ^REAL < 0", "zospy": "\ndef export("}
"""The start of the description's output in each macro."""


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_macro_writes_exactly_these_fields(program):
    pattern = r'"([a-z]\w*)"(?:: |\] =)' if program == "zospy" else r'"(\w+) ='
    written = re.findall(pattern, MACRO[program].partition(WRITING[program])[2])
    assert set(written) == tomllib.loads(description(program)).keys()


@pytest.mark.parametrize("program, text", [("zemax", r'PRINT "([^"]*)"'), ("codev", r'BUF PUT B5 \S+ J1 "([^"]*)"')])
def test_a_macro_writes_exactly_these_texts(program, text):
    texts = re.findall(text, MACRO[program].partition(WRITING[program])[2])
    assert len(texts) > 12
    assert [text for text in texts if text not in DESCRIPTION[program]] == ["object_distance_mm = inf"]


@pytest.mark.parametrize("options, field", [
    ({"heights": 1}, "heights"), ({"heights": 1001}, "heights"), ({"last_height_mm": 0.0}, "last_height_mm"),
    ({"last_height_mm": float("nan")}, "last_height_mm"), ({"wavelengths_nm": ()}, "wavelengths_nm"),
    ({"wavelengths_nm": (500.0, 400.0)}, "wavelengths_nm"), ({"wavelengths_nm": (-1.0, 400.0)}, "wavelengths_nm"),
    ({"psf_samples": 60}, "psf_samples"), ({"pupil_samples": 16}, "pupil_samples"),
    ({"psf_pitch_um": -1.0}, "psf_pitch_um"), ({"sensor_mm": (4.8, 0.0)}, "sensor_mm")])
def test_invalid_values_are_one_line_errors(options, field):
    with refused(InputError, field=field):
        ExportOptions(**options)


def test_an_unknown_program_is_refused():
    with refused(InputError, field="program", value="oslo", match="zemax, codev, zospy"):
        export_macro("oslo", FEW)


def test_the_command_prints_the_macro(capsys):
    assert main(["lens", "export-macro", "zemax"]) == 0
    assert capsys.readouterr().out == export_macro("zemax", ExportOptions())


def test_the_command_writes_windows_line_endings(tmp_path, capsys):
    path = tmp_path / "export.seq"
    assert main(["lens", "export-macro", "codev", "-o", str(path), "--heights", "3", "--last-height", "2",
                 "--wavelengths", "450,587.6,650.25", "--psf-samples", "32", "--psf-pitch-um", "0.25",
                 "--pupil-samples", "64", "--sensor", "3.2x2.4"]) == 0
    assert path.read_bytes() == export_macro("codev", FEW).replace("\n", "\r\n").encode("ascii")
    assert list(tmp_path.iterdir()) == [path] and capsys.readouterr().out == ""


@pytest.mark.parametrize("arguments, message", [
    (["--sensor", "3"], "--sensor is 3"), (["--wavelengths", "700:400:3"], "wavelengths is 700:400:3"),
    (["--psf-samples", "50"], "psf_samples is 50")])
def test_the_command_reports_invalid_values(arguments, message, capsys):
    assert main(["lens", "export-macro", "zospy", *arguments]) == 1
    assert message in capsys.readouterr().err


def test_templates_are_installed_with_the_package():
    package = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    patterns = package["lensfield.engine"]
    assert all(any(path in (ROOT / "engine").glob(pattern) for pattern in patterns) for path in MACROS.iterdir())
    assert {path.name for path in MACROS.iterdir()} == set(PROGRAMS.values())
