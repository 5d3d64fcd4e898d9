"""Parts of the command that do not require Blender."""

import json
import os
import platform
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from lenses import make_lens
from lensfield import __version__, cli
from lensfield.commands import filter
from lensfield.commands.arguments import check_outputs, engine_options
from lensfield.engine import InputError, Options, SpectralImage
from lensfield.engine.blur.exact import Exact
from lensfield.engine.blur.isoplanatic import OnePsf, Paper
from lensfield.engine.blur.pixels import Pixels
from lensfield.engine.blur.polar_sections import Sections
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.pictures.spectral_exr import read_exr, write_exr
from lensfield.engine.plan.plan import Plan
from lensfield.engine.runtime.build_identity import build_identity
from refusals import refused

PLAN = Plan(method=Sections(32, 64, 11), psf_radius_px=10, psf_energy=1 - 1e-6, taps=200.0, precision="float32",
            single_range=np.inf, flat_tolerance=0.0, folded=True, out_of_field="hold")


@pytest.fixture
def radiance(tmp_path):
    path = tmp_path / "radiance.exr"
    write_exr(SpectralImage(np.ones((2, 18, 24)), [450, 650], pitch_um=200.0, overscan_px=(3, 4)), path)
    return path


def run(*arguments):
    return cli.main([str(argument) for argument in arguments])


def test_lens_info_as_json_has_the_first_order_data(capsys):
    assert run("lens", "info", "edmund-54852", "--json") == 0
    info = json.loads(capsys.readouterr().out)
    assert info["efl_mm"] == pytest.approx(5.99997, abs=1e-4)
    assert info["magnification"] == pytest.approx(-0.023954, abs=1e-6)
    assert info["f_number_effective"] == pytest.approx(0.5 / 0.265, abs=0.01)
    assert info["wavelengths_nm"][0] == 400 and len(info["heights"]) == len(info["heights_mm"])
    heights_mm = [row["height_mm"] for row in info["heights"]]
    assert heights_mm[-1] > 3.0  # half of the sensor's diagonal
    at_3_mm = {name: np.interp(3.0, heights_mm, [row[name] for row in info["heights"]]) for name in (
        "distortion_percent", "relative_illumination", "lateral_colour_um")}
    assert at_3_mm["distortion_percent"] == pytest.approx(-8.4, abs=0.1)
    assert at_3_mm["relative_illumination"] == pytest.approx(1.037, abs=0.003)
    assert abs(at_3_mm["lateral_colour_um"]) == pytest.approx(13.8, abs=0.3)


def test_notes_do_not_disturb_json(capsys):
    assert run("lens", "info", "tessar-50mm", "--f-number", "2", "--json", "--lens-quality", "preview") == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["name"] == "tessar-50mm" and "f/2 is wider than this lens opens" in err


def test_lens_info_as_text_shows_the_same_figures(capsys):
    assert run("lens", "info", "edmund-54852", "--json") == 0
    info = json.loads(capsys.readouterr().out)
    assert run("lens", "info", "edmund-54852") == 0
    page = capsys.readouterr().out
    assert all(text in page for text in ("6.00003 mm", "-0.023954", "Edmund Optics"))
    for row in info["heights"]:
        line = next(line for line in page.splitlines() if line.strip().startswith(f"{row['height_mm']:.3f} mm"))
        assert f"{row['distortion_percent']:.2f} %" in line and f"{row['lateral_colour_um']:.2f} um" in line
        assert f"{row['relative_illumination']:.4f}" in line


def test_lens_info_of_a_glass_known_over_a_part_of_the_spectrum(tmp_path, capsys):
    file = tmp_path / "condenser.toml"
    file.write_text("""format = "lensfield-prescription"
version = 1
aperture = { f_number = 12 }
field = { angle_deg = 8 }
surfaces = [{ radius_mm = 50, thickness_mm = 3, glass = "SCHOTT B270", stop = true },
            { radius_mm = -50, thickness_mm = 47.1 }]
""")
    assert run("lens", "info", file, "--lens-quality", "preview") == 1
    assert "known from 435.83 to 656.27 nm only, not at 400 nm: give wavelengths" in capsys.readouterr().err
    assert run("lens", "info", file, "--lens-quality", "preview", "--wavelengths", "440:650:3", "--json") == 0
    assert json.loads(capsys.readouterr().out)["wavelengths_nm"] == [440, 545, 650]


def test_lens_info_takes_no_wavelengths_for_a_package(tmp_path, capsys):
    write_package(make_lens(), tmp_path / "my.npz")
    assert run("lens", "info", tmp_path / "my.npz", "--wavelengths", "450,550") == 1
    assert "options: --wavelengths is 450,550: a lens package has its own" in capsys.readouterr().err


def test_filter_writes_the_frame_a_preview_and_a_report(radiance, tmp_path, capsys):
    assert run("filter", radiance, "--lens", "edmund-54852", "--method", "paper", "--section-size", 8,
               "--output", tmp_path / "out" / "irradiance.exr", "--preview", tmp_path / "out" / "picture.png",
               "--report", tmp_path / "report.json") == 0
    image = read_exr(tmp_path / "out" / "irradiance.exr")
    assert image.cube.shape == (2, 12, 16) and image.lens_name == "edmund-54852"
    assert (tmp_path / "out" / "picture.png").stat().st_size > 0
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["plan"]["section_size"] == 8 and report["plan"]["method"] == "paper"
    assert {"plan", "lens data", "filtering"} <= report["stages_s"].keys()
    assert report["energy"]["out_w_per_nm"] == pytest.approx(report["energy"]["in_w_per_nm"], rel=1e-12)
    assert str(tmp_path / "out" / "irradiance.exr") in capsys.readouterr().out


@pytest.mark.parametrize("changes, message", [
    ({"radiance": "missing.exr"}, "missing.exr: file is missing"),
    ({"--lens": "no-such-lens"}, "no-such-lens: lens is missing"),
    ({"--section-size": "0"}, "options: section_size is 0"),
    ({"--accuracy": "-1"}, "options: accuracy is -1.0: expected a number above 0"),
    ({"--accuracy": "0.01", "--azimuths": "3"}, "options: azimuths is 3: leave it out: the accuracy determines it"),
    ({"--accuracy": "0.01", "--method": "exact"},
     "options: accuracy is 0.01: leave it out: the method 'exact' uses its own settings"),
    ({"--method": "pixels", "--section-size": "16"}, "section_size is 16: leave it out: the method is 'pixels'"),
    ({"--psf-energy": "2"}, "options: psf_energy is 2.0: expected a number above 0 and up to 1"),
    ({"--pitch-um": "-1"}, "pitch_um is -1.0: expected a positive number")])
def test_bad_input_is_a_one_line_error_and_leaves_no_files(radiance, tmp_path, capsys, changes, message):
    arguments = {"--lens": "edmund-54852", "--output": str(tmp_path / "irradiance.exr")} | changes
    source = arguments.pop("radiance", str(radiance))
    assert run("filter", source, *(word for pair in arguments.items() for word in pair)) == 1
    printed = capsys.readouterr().err
    assert message in printed and printed.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["radiance.exr"]


@pytest.mark.parametrize("arguments, options", [
    ("", Options()),
    ("--accuracy 0.05", Options(accuracy=0.05)),
    ("--accuracy 0.05 --method pixels", Options(accuracy=0.05, method="pixels")),
    ("--section-size 8 --precision float64 --psf-energy 0.99 --flat-tolerance 0.001",
     Options(section_size=8, precision="float64", psf_energy=0.99, flat_tolerance=0.001)),
    ("--method pixels --azimuths 16", Options(method="pixels", azimuths=16)),
    ("--method paper --out-of-field vignette --fireflies clamp",
     Options(method="paper", out_of_field="vignette", fireflies="clamp"))])
def test_the_command_line_sets_the_options(arguments, options):
    line = f"filter in.exr --lens edmund-54852 --output out.exr {arguments}".split()
    assert engine_options(cli._parser().parse_args(line)) == options


@pytest.mark.parametrize("changes, text", [
    ({}, "32 px sections between 11 azimuths, single precision"),
    ({"method": Pixels(32, 8), "precision": "float64"}, "a PSF for every pixel, from 8 azimuths, double precision"),
    ({"method": Paper(16, 64), "precision": "float64"},
     "16 px sections with one PSF each, as in the paper, double precision"),
    ({"method": OnePsf(32, 64)}, "one PSF for the picture, single precision"),
    ({"method": Exact(), "precision": "float64"}, "a PSF for every pixel, without a table, double precision"),
    ({"error_bound": 0.0083, "uniform_light_error": 0.0021, "seconds": 0.42, "memory_mb": 310.2},
     "32 px sections between 11 azimuths, single precision: at most 0.83 % of any point's light misplaced, "
     "uniform light within 0.21 %; about 0.4 s, 310 MB")], ids=str)
def test_a_plan_is_described_in_one_line(changes, text):
    assert replace(PLAN, **changes).text == text


def test_the_plan_is_printed_before_the_work(radiance, tmp_path, capsys, monkeypatch):
    def refuse(*_, **__):
        raise MemoryError("no room for it")

    monkeypatch.setattr(filter, "lens_image", refuse)
    assert run("filter", radiance, "--lens", "edmund-54852", "--section-size", 8,
               "--output", tmp_path / "out.exr") == 1
    assert capsys.readouterr().out.startswith("plan: 8 px sections between 32 azimuths, ")


def test_the_printed_plan_is_executed(radiance, tmp_path, capsys):
    assert run("filter", radiance, "--lens", "edmund-54852", "--accuracy", "0.05", "--output", tmp_path / "out.exr",
               "--report", tmp_path / "report.json") == 0
    plan = json.loads((tmp_path / "report.json").read_text())["plan"]
    printed = capsys.readouterr().out.splitlines()[0]
    assert printed.startswith("plan: ") and f"at most {100 * plan['error_bound']:.2g} % of" in printed
    assert plan["azimuths"] == 0 or f" {plan['azimuths']} azimuths" in printed


def test_light_beyond_the_lens_data_is_reported_with_its_treatment(tmp_path, capsys):
    write_exr(SpectralImage(np.ones((1, 36, 48)), [550], pitch_um=200.0), tmp_path / "wide.exr")
    assert run("filter", tmp_path / "wide.exr", "--lens", "edmund-54852", "--output", tmp_path / "out.exr") == 0
    assert "of the frame is outside the lens data: its edge continues" in capsys.readouterr().out


@pytest.fixture
def inputs(radiance, tmp_path, monkeypatch):
    """A working folder: a radiance, a lens package and a .blend, each with alternative names."""
    monkeypatch.chdir(tmp_path)
    radiance.rename("x.exr")
    write_package(make_lens(), Path("my.npz"))
    Path("t.blend").write_bytes(b"BLENDER")
    Path("folder").mkdir()
    Path("link.png").symlink_to("x.exr")
    os.link("my.npz", "hard.exr")
    os.link("t.blend", "blend.json")
    return tmp_path


FILTER = "filter", "x.exr", "--lens", "my.npz"
RENDER = "render", "t.blend", "--lens", "edmund-54852", "--output", "folder"


@pytest.mark.parametrize("arguments, message", [
    ((*FILTER, "--output", "x.exr"), "x.exr: file is one of the inputs"),
    ((*FILTER, "--output", "folder/../x.exr"), "x.exr: file is one of the inputs"),
    ((*FILTER, "--output", "my.npz"), "my.npz: suffix is .npz: expected .exr"),
    ((*FILTER, "--output", "hard.exr"), "hard.exr: file is one of the inputs"),
    ((*FILTER, "--output", "out.exr", "--preview", "link.png"), "link.png: file is one of the inputs"),
    ((*FILTER, "--output", "out.exr", "--report", "x.exr"), "x.exr: suffix is .exr: expected .json"),
    ((*FILTER, "--output", "out.exr", "--report", "blend.txt"), "suffix is .txt: expected .json"),
    ((*RENDER, "--report", "t.blend"), "t.blend: suffix is .blend: expected .json"),
    ((*RENDER, "--report", "blend.json"), "blend.json: file is one of the inputs"),
    (("lens", "plot", "my.npz", "-o", "my.npz"), "my.npz: suffix is .npz: expected .png"),
    (("lens", "export-macro", "zemax", "-o", "my.npz"), "my.npz: suffix is .npz: expected .zpl"),
    (("lens", "import", "my.npz", "-o", "my.npz"), "my.npz: file is one of the inputs")],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "")
def test_no_output_may_be_an_input_or_of_another_kind(inputs, capsys, arguments, message):
    before = {path: path.read_bytes() for path in inputs.iterdir() if path.is_file()}
    assert run(*arguments) == 1
    assert message in capsys.readouterr().err
    assert {path: path.read_bytes() for path in inputs.iterdir() if path.is_file()} == before


@pytest.mark.parametrize("one, other", [("a.exr", "./a.exr"), ("a.exr", "A.EXR"), ("there.exr", "too.exr")])
def test_no_two_outputs_may_be_the_same_file(tmp_path, monkeypatch, one, other):
    monkeypatch.chdir(tmp_path)
    Path("there.exr").touch()
    os.link("there.exr", "too.exr")
    with refused(InputError, field="file", value="named twice",
                 match="named twice: use a different name for each output"):
        check_outputs([(Path(one), ".exr"), (None, ".png"), (Path(other), ".exr")])


def test_a_link_is_followed_and_a_pipe_is_refused(radiance, tmp_path, capsys):
    (tmp_path / "link.exr").symlink_to(tmp_path / "target.exr")
    assert run("filter", radiance, "--lens", "edmund-54852", "--output", tmp_path / "link.exr") == 0
    assert (tmp_path / "link.exr").is_symlink() and read_exr(tmp_path / "target.exr").lens_name == "edmund-54852"
    os.mkfifo(tmp_path / "pipe.exr")
    assert run("filter", radiance, "--lens", "edmund-54852", "--output", tmp_path / "pipe.exr") == 1
    assert "a device or pipe" in capsys.readouterr().err


def test_a_link_loop_is_an_error_and_a_dangling_link_is_followed(radiance, tmp_path, capsys):
    (tmp_path / "loop.exr").symlink_to(tmp_path / "loop.exr")
    assert run("filter", radiance, "--lens", "edmund-54852", "--output", tmp_path / "loop.exr") == 1
    assert "loop.exr: file is not accessible: Too many levels of symbolic links: remove the" in capsys.readouterr().err
    (tmp_path / "deep.exr").symlink_to(tmp_path / "new" / "folder.exr")
    assert run("filter", radiance, "--lens", "edmund-54852", "--output", tmp_path / "deep.exr") == 0
    assert (tmp_path / "new" / "folder.exr").is_file()


@pytest.mark.parametrize("line", [
    "filter {0}.exr --lens edmund-54852 --output out.exr", "filter in.exr --lens edmund-54852 --output {0}.exr",
    "filter in.exr --lens edmund-54852 --output {0}/out.exr", "filter in.exr --lens {0} --output out.exr",
    "filter in.exr --lens {0}.npz --output out.exr",
    "filter in.exr --lens edmund-54852 --output out.exr --report {0}.json",
    "lens info {0}.toml", "lens plot edmund-54852 -o {0}.png", "lens stmap edmund-54852 --resolution 12x9 --output {0}",
    "lens convert {0}.zmx -o out.toml", "lens import {0} -o out.npz", "lens export-macro zemax -o {0}.zpl",
    "farm openjd {0}.blend --job job --output out"])
def test_a_name_of_300_characters_is_a_one_line_error_with_a_remedy(radiance, tmp_path, capsys, monkeypatch, line):
    monkeypatch.chdir(tmp_path)
    Path("in.exr").write_bytes(radiance.read_bytes())
    assert run(*line.format("n" * 300).split()) == 1
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1 and "Errno" not in printed
    assert printed.startswith("lensfield: ") and "nnnnnn" in printed and " is not " in printed
    assert "File name too long" in printed or "expected a file of kind" in printed


def test_closed_standard_streams_do_no_harm(tmp_path):
    command = f'"{sys.executable}" -c "from lensfield.cli import console; console()" lens list >&- 2>&- <&-'
    assert subprocess.run(command, shell=True).returncode == 0


def test_the_version_names_what_reports_of_errors_need(capsys):
    assert run("--version") == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith(f"lensfield {__version__}, build {build_identity()} (inner loops: ")
    assert f"Python {platform.python_version()}, {platform.platform()}, " in second
    assert f"numpy {np.__version__}, scipy {version('scipy')}, OpenEXR {version('OpenEXR')}" in second


@pytest.mark.parametrize("arguments", ["lens info edmund-54852", "lens list", "lens check edmund-54852", "--help",
                                       "lens export-macro zemax", "--version"])
def test_a_closed_pipe_causes_no_error_message(arguments):
    """As in `lensfield lens info edmund-54852 | head`."""
    command = [sys.executable, "-c", "from lensfield.cli import console; console()", *arguments.split()]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode in (0, cli.UNHEARD)  # argparse itself ignores failed writes


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full on this system")
@pytest.mark.parametrize("arguments", ["lens info edmund-54852", "lens list", "--help", "--version"])
def test_standard_output_on_a_full_disk_is_a_one_line_error(arguments):
    command = [sys.executable, "-c", "from lensfield.cli import console; console()", *arguments.split()]
    with open("/dev/full", "w") as full:
        completed = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert (completed.returncode, completed.stderr) == (1, "lensfield: standard output: No space left on device\n")


def test_nan_pixels_in_a_black_picture_are_named(tmp_path, capsys):
    cube = np.zeros((1, 4, 6))
    cube[0, 2, 5] = np.nan
    write_exr(SpectralImage(cube, [550], pitch_um=6.0), tmp_path / "nan.exr")
    assert run("filter", tmp_path / "nan.exr", "--lens", "edmund-54852", "--output", tmp_path / "out.exr") == 1
    assert "pixel at row 2, column 5, 550 nm is nan" in capsys.readouterr().err
    assert run("filter", tmp_path / "nan.exr", "--lens", "edmund-54852", "--output", tmp_path / "out.exr",
               "--fireflies", "clamp") == 0
    assert not read_exr(tmp_path / "out.exr").cube.any()


@pytest.mark.parametrize("arguments, error", [
    ("", "lensfield: the following arguments are required: COMMAND; see lensfield --help"),
    ("lenses", "lensfield: argument COMMAND: invalid choice: 'lenses' (choose from "),
    ("filter", "lensfield filter: the following arguments are required: RADIANCE.exr, --output, --lens; see lensfield "
               "filter --help"),
    ("lens calibration x --for blender", "lensfield lens calibration: argument --for: invalid choice: 'blender' "),
    ("lens plot x --ghosts a", "lensfield lens plot: argument --ghosts: invalid float value: 'a'; see "),
    ("lens fit --kit --typical", "lensfield lens fit: argument --typical: not allowed with argument --kit; see "),
    ("lint x.blend --lense a\nb", "lensfield lint: unknown arguments: --lense a b; see lensfield lint --help")])
def test_a_usage_error_is_one_line_and_status_2(capsys, arguments, error):
    assert run(*arguments.split(" ") if arguments else ()) == 2
    out, err = capsys.readouterr()
    assert not out and err.startswith(error) and err.count("\n") == 1


def test_engine_and_command_need_no_blender():
    script = "import sys, lensfield.cli, lensfield.engine; sys.exit('bpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script]).returncode == 0
