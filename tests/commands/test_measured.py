"""`lensfield lens measured`: packages of calibrations, with the source of their distortion and blur."""

import json

import pytest

from lensfield.cli import main
from lensfield.engine import load_lens
from measured_files import LENSFUN, OPENCV_XML


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "lab.xml"
    path.write_text(OPENCV_XML)
    return path


def run(path, *options):
    return main(["lens", "measured", str(path), *options])


def test_a_calibration_becomes_a_package(file, tmp_path, capsys):
    output = tmp_path / "lab.npz"
    settings = "--sensor", "6.4x4.8", "--f-number", "2.8", "--focus", "1.5m"
    assert run(file, "-o", str(output), *settings, "--name", "Lab") == 0
    printed = capsys.readouterr().out
    assert "(OpenCV: brown-conrady), blur by diffraction at f/2.8, defocus of a thin lens." in printed
    lens = load_lens(output)
    assert (lens.name, lens.object_distance_mm, round(lens.sensor_mm[0], 9)) == ("Lab", 1500, 6.4)
    assert main(["lens", "info", str(output), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["source"] == lens.source
    assert run(file, "-o", str(output)) == 0 and load_lens(output).sensor_mm[0] == pytest.approx(36)


def test_the_blur_of_a_designed_lens(file, tmp_path, capsys):
    output = tmp_path / "lab.npz"
    assert run(file, "-o", str(output), "--blur", "edmund-54852", "--f-number", "4", "--sensor", "4.8x3.6") == 0
    assert "blur and light as designed for edmund-54852 at f/4" in capsys.readouterr().out
    assert load_lens(output).prescription is None


@pytest.mark.parametrize("options, message", [
    (["--as", "kalibr"], "camera is one of 2"), (["--f-number", "0"], "--f-number is 0.0"),
    (["--resolution", "x"], "--resolution is x"), (["--which", "lab"], "--which is lab: leave it out"),
    (["--resolution", "96x62"], "--resolution is 96x62: leave it out: the file is for pictures of 48x31"),
    (["--sensor", "wide"], "--sensor is wide"),
    (["--blur", "cooke-42mm-2x"], "blur is without rotational symmetry"), (["--blur", "none"], "lens is missing"),
    (["--focus", "1mm"], "focus is 1 mm: expected more than the focal length"),
    (["--overscan", "1.2"], "--overscan is 1.2: leave it out")])
def test_bad_options_are_refused_in_one_line(file, tmp_path, capsys, options, message):
    assert run(file, "-o", str(tmp_path / "lab.npz"), *options) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert message in error
    assert not (tmp_path / "lab.npz").exists()


def test_a_lens_of_lensfun_is_named(tmp_path, capsys):
    (tmp_path / "database").mkdir()
    for name, model in (("mine", "Zoom 20-40mm"), ("other", "Zoom 20-50mm")):
        (tmp_path / "database" / f"{name}.xml").write_text(LENSFUN.replace("Zoom 20-40mm", model))
    output = tmp_path / "zoom.npz"
    assert run(tmp_path / "database", "-o", str(output), "--which", "zoom 20-40mm", "--focal-length", "25") == 0
    assert load_lens(output).name == "Optik Zoom 20-40mm"
    assert main(["lens", "measured", "-o", str(output)]) == 1 and "FILE is not given" in capsys.readouterr().err


def test_a_calibration_as_a_lens_is_refused_with_the_command_that_converts_it(tmp_path, capsys):
    path = tmp_path / "lab.yml"
    path.write_text("%YAML:1.0\n")
    assert main(["lens", "info", str(path)]) == 1
    assert "`lensfield lens measured` a calibration" in capsys.readouterr().err
