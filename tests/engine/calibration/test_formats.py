"""The files of calibrations: each program's convention of pixels, coefficients and poses, and refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from calibrated import FOCAL_PX, FRAME, HEIGHTS_MM, modelled_lens, radial_lens
from lenses import make_lens
from lensfield.cli import main
from lensfield.engine import InputError
from lensfield.engine.calibration.fit import Calibration, calibrate
from lensfield.engine.calibration.formats import FORMATS, calibrated_for
from lensfield.engine.calibration.models import BROWN_CONRADY, KANNALA_BRANDT, MODELS, RADTAN, RATIONAL, THIN_PRISM
from lensfield.engine.calibration.views import View
from lensfield.engine.image.pixel_grid import PixelGrid
from refusals import refused

POSE = np.array([[0.0, -1, 0, 2], [1, 0, 0, 3], [0, 0, 1, 4], [0, 0, 0, 1]])


def fit_of(model, coefficients=None):
    """A calibration with different values everywhere."""
    coefficients = coefficients or tuple(0.01 * number for number in range(1, len(model.coefficients) + 1))
    return Calibration(model, FRAME, (400.0, 410.0), (42.0, 61.0), coefficients, 0.02, 0.05, 1.0, 'a "lens"\nof two',
                       np.inf, 2.8, 550.0, 12.0)


def text(name, *calibrations):
    return FORMATS[name].text([View(calibration) for calibration in calibrations])


def opencv_numbers(contents):
    """The matrices and fields of an OpenCV file, by a reader of plain YAML."""
    return yaml.safe_load(contents.replace("%YAML:1.0\n---\n", "").replace("!!opencv-matrix", ""))


@pytest.mark.parametrize("model, kind, coefficients", [
    (BROWN_CONRADY, "pinhole", [0.01, 0.02, 0.03, 0.04, 0.05]), (RADTAN, "pinhole", [0.01, 0.02, 0.03, 0.04, 0]),
    (THIN_PRISM, "pinhole", [0.01 * number for number in range(1, 13)]),
    (KANNALA_BRANDT, "fisheye", [0.01, 0.02, 0.03, 0.04])])
def test_opencv(model, kind, coefficients):
    fields = opencv_numbers(text("opencv", fit_of(model)))
    assert fields["camera_model"] == kind and (fields["image_width"], fields["image_height"]) == (140, 90)
    assert fields["camera_matrix"]["data"] == [400, 0, 42, 0, 410, 61, 0, 0, 1]
    np.testing.assert_allclose(fields["distortion_coefficients"]["data"], coefficients, rtol=1e-12)
    assert fields["distortion_coefficients"]["cols"] == len(coefficients)
    assert (fields["rms_px"], fields["largest_px"]) == (0.02, 0.05)
    assert fields["origin"].startswith('Made by Lensfield: a "lens" of two, f/2.8, focused at infinity, 550 nm')


@pytest.mark.parametrize("model, line", [
    (MODELS["pinhole"], "PINHOLE 140 90 400.0 410.0 42.5 61.5"),
    (MODELS["radial-1"], "OPENCV 140 90 400.0 410.0 42.5 61.5 0.01 0.0 0.0 0.0"),
    (RADTAN, "OPENCV 140 90 400.0 410.0 42.5 61.5 0.01 0.02 0.03 0.04"),
    (BROWN_CONRADY, "FULL_OPENCV 140 90 400.0 410.0 42.5 61.5 0.01 0.02 0.03 0.04 0.05 0.0 0.0 0.0"),
    (RATIONAL, "FULL_OPENCV 140 90 400.0 410.0 42.5 61.5 0.01 0.02 0.03 0.04 0.05 0.06 0.07 0.08"),
    (KANNALA_BRANDT, "OPENCV_FISHEYE 140 90 400.0 410.0 42.5 61.5 0.01 0.02 0.03 0.04")])
def test_colmap(model, line):
    fit = replace(fit_of(model), coefficients=tuple(round(each, 2) for each in fit_of(model).coefficients))
    lines = text("colmap", fit).splitlines()
    assert [each for each in lines if not each.startswith("#")] == [f"1 {line}"]


def test_nerfstudio_shares_intrinsics_that_do_not_change():
    fit = fit_of(BROWN_CONRADY)
    views = [View(fit, POSE, "a.png"), View(fit, np.eye(4), "b.png")]
    contents = json.loads(FORMATS["nerfstudio"].text(views))
    assert contents["camera_model"] == "OPENCV" and (contents["w"], contents["h"]) == (140, 90)
    assert [contents[name] for name in ("fl_x", "fl_y", "cx", "cy")] == [400, 410, 42.5, 61.5]
    np.testing.assert_allclose([contents[name] for name in ("k1", "k2", "p1", "p2", "k3")], fit.coefficients)
    assert contents["frames"] == [{"file_path": "a.png", "transform_matrix": POSE.tolist()},
                                  {"file_path": "b.png", "transform_matrix": np.eye(4).tolist()}]


def test_nerfstudio_states_intrinsics_of_each_frame_that_change():
    near = replace(fit_of(KANNALA_BRANDT), focal_px=(420.0, 420.0), largest_px=0.08)
    views = [View(fit_of(KANNALA_BRANDT), POSE, "a.png"), View(near, POSE, "b.png")]
    contents = json.loads(FORMATS["nerfstudio"].text(views))
    assert contents["camera_model"] == "OPENCV_FISHEYE" and "fl_x" not in contents and contents["largest_px"] == 0.08
    assert [frame["fl_x"] for frame in contents["frames"]] == [400, 420]
    assert all("k4" in frame and "p1" not in frame for frame in contents["frames"])


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_takes_the_fit_of_an_ordinary_lens_and_names_its_maker(name):
    fit = calibrated_for(name, radial_lens(lambda t: t * (1 - 0.9 * t**2)), FRAME, 550.0)
    assert fit.largest_px < 0.1 and "Made by Lensfield" in text(name, fit)
    np.testing.assert_allclose(fit.focal_px, FOCAL_PX, rtol=1e-3)


def fisheye():
    return radial_lens(np.arctan, np.linspace(0, 30, 65)), PixelGrid((90, 140), 150.0)


def test_a_fisheye_chooses_its_model():
    for name in ("opencv", "colmap", "nerfstudio"):
        assert calibrated_for(name, *fisheye(), 550.0).model is KANNALA_BRANDT


def test_a_fisheye_refuses_a_pinhole():
    with refused(InputError, field="--model", value="rational", match="is a fisheye here.*use kannala-brandt"):
        calibrated_for("opencv", *fisheye(), 550.0, "rational")


def test_a_format_refuses_a_model_that_it_lacks():
    with refused(InputError, field="--model", value="thin-prism", match="--for colmap has pinhole, .*, kannala-brandt"):
        calibrated_for("colmap", make_lens(heights_mm=HEIGHTS_MM), FRAME, 550.0, "thin-prism")


def test_an_ordinary_lens_may_have_the_model_of_a_fisheye():
    lens = radial_lens(lambda t: t * (1 - 0.9 * t**2))
    assert calibrated_for("opencv", lens, FRAME, 550.0, "kannala-brandt").largest_px < 0.01


def test_the_command_prints_the_residual_and_writes_each_wavelength(tmp_path, capsys):
    output = tmp_path / "lens.txt"
    command = ["lens", "calibration", "edmund-54852", "--for", "colmap", "-o", str(output), "--resolution", "320x240"]
    assert main([*command, "--wavelength", "610,465"]) == 0
    printed = capsys.readouterr().out
    assert "RMS 0.0" in printed and "610 nm" in printed and not output.exists()
    reds, blues = ((tmp_path / f"lens_{nm}nm.txt").read_text().splitlines()[-1].split()[4] for nm in (610, 465))
    assert reds != blues
    assert main(command) == 0 and output.exists()


def test_a_lens_that_no_model_describes_is_reported(tmp_path, capsys):
    output = tmp_path / "lens.json"
    assert main(["lens", "calibration", "muller-fisheye-25mm", "--for", "opencv", "--model", "double-sphere", "-o",
                 str(output), "--resolution", "320x240"]) == 1
    assert main(["lens", "calibration", "edmund-54852", "--for", "nerfstudio", "--model", "pinhole", "-o", str(output),
                 "--resolution", "320x240"]) == 0
    printed = capsys.readouterr()
    assert "the requested model is not within 0.1 px" in printed.out and "--for opencv has" in printed.err


def test_wavelengths_must_be_numbers(tmp_path, capsys):
    assert main(["lens", "calibration", "edmund-54852", "--for", "colmap", "-o", str(tmp_path / "lens.txt"),
                 "--resolution", "320x240", "--wavelength", "red"]) == 1
    assert "--wavelength is red" in capsys.readouterr().err


def test_a_model_of_a_lens_without_symmetry_keeps_its_tangential_terms():
    fit = calibrate(modelled_lens(RADTAN, (-0.4, 0.5, 0.011, -0.007)), FRAME, 550.0, [RADTAN])
    assert opencv_numbers(text("opencv", fit))["distortion_coefficients"]["data"][2:4] == list(fit.coefficients[2:4])
