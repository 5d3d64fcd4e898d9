"""The parts of the command that need no Blender."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from lensfield import cli
from lensfield.engine import SpectralImage
from lensfield.engine.exr import read_exr, write_exr


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
    last = info["heights"][-1]
    assert last["height_mm"] == 3.0
    assert last["distortion_percent"] == pytest.approx(-8.4, abs=0.1)
    assert last["relative_illumination"] == pytest.approx(1.037, abs=0.002)
    assert abs(last["lateral_colour_um"]) == pytest.approx(13.8, abs=0.3)


def test_lens_info_to_read_shows_the_same_figures(capsys):
    assert run("lens", "info", "edmund-54852") == 0
    page = capsys.readouterr().out
    assert all(text in page for text in ("5.99997 mm", "-0.023954", "-8.40 %", "1.0371", "-13.79 um"))


def test_filter_writes_the_frame_a_picture_and_a_report(radiance, tmp_path, capsys):
    assert run("filter", radiance, "--lens", "edmund-54852", "--section-size", 8, "--order", 1,
               "--output", tmp_path / "out" / "irradiance.exr", "--preview", tmp_path / "out" / "picture.png",
               "--report", tmp_path / "report.json") == 0
    image = read_exr(tmp_path / "out" / "irradiance.exr")
    assert image.cube.shape == (2, 12, 16) and image.lens_name == "edmund-54852"
    assert (tmp_path / "out" / "picture.png").stat().st_size > 0
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["plan"]["section_size"] == 8 and report["plan"]["order"] == 1
    assert {"lens data", "point spread functions", "filtering"} <= report["stages_s"].keys()
    assert report["energy"]["out_w_per_nm"] == pytest.approx(report["energy"]["in_w_per_nm"], rel=1e-12)
    assert str(tmp_path / "out" / "irradiance.exr") in capsys.readouterr().out


@pytest.mark.parametrize("changes, message", [
    ({"radiance": "missing.exr"}, "missing.exr: file is not there"),
    ({"--lens": "no-such-lens"}, "no-such-lens: lens is not there"),
    ({"--section-size": "0"}, "options: section_size is 0"),
    ({"--pitch-um": "-1"}, "pitch_um is -1.0: expected a positive number")])
def test_bad_input_is_one_line_and_leaves_nothing(radiance, tmp_path, capsys, changes, message):
    arguments = {"--lens": "edmund-54852", "--output": str(tmp_path / "irradiance.exr")} | changes
    source = arguments.pop("radiance", str(radiance))
    assert run("filter", source, *(word for pair in arguments.items() for word in pair)) == 1
    printed = capsys.readouterr().err
    assert message in printed and printed.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["radiance.exr"]


def test_targets_of_one_name_are_refused(radiance, tmp_path, capsys):
    assert run("filter", radiance, "--lens", "edmund-54852", "--output", tmp_path / "a.exr",
               "--preview", tmp_path / "." / "a.exr") == 1
    assert "a.exr: file is named twice" in capsys.readouterr().err
    assert not (tmp_path / "a.exr").exists()


def test_a_link_is_written_through_and_a_pipe_is_left_alone(radiance, tmp_path, capsys):
    (tmp_path / "link.exr").symlink_to(tmp_path / "target.exr")
    assert run("filter", radiance, "--lens", "edmund-54852", "--output", tmp_path / "link.exr") == 0
    assert (tmp_path / "link.exr").is_symlink() and read_exr(tmp_path / "target.exr").lens_name == "edmund-54852"
    os.mkfifo(tmp_path / "pipe")
    assert run("filter", radiance, "--lens", "edmund-54852", "--output", tmp_path / "pipe") == 1
    assert "a device or pipe" in capsys.readouterr().err


def test_closed_standard_streams_do_no_harm(tmp_path):
    command = f'"{sys.executable}" -c "from lensfield.cli import console; console()" lens list >&- 2>&- <&-'
    assert subprocess.run(command, shell=True).returncode == 0


def test_dark_pixels_that_are_not_numbers_are_named(tmp_path, capsys):
    cube = np.zeros((1, 4, 6))
    cube[0, 2, 5] = np.nan
    write_exr(SpectralImage(cube, [550], pitch_um=6.0), tmp_path / "nan.exr")
    assert run("filter", tmp_path / "nan.exr", "--lens", "edmund-54852", "--output", tmp_path / "out.exr") == 1
    assert "pixel at row 2, column 5, 550 nm is nan" in capsys.readouterr().err


def test_usage_error_is_status_2(capsys):
    assert run("filter") == 2
    assert "usage" in capsys.readouterr().err


def test_engine_and_command_need_no_blender():
    script = "import sys, lensfield.cli, lensfield.engine; sys.exit('bpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script]).returncode == 0
