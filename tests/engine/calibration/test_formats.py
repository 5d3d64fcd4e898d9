"""The files of calibrations: each program's convention of pixels, coefficients and poses, and refusals."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from calibrated import FOCAL_MM, FOCAL_PX, FRAME, HEIGHTS_MM, modelled_lens, radial_lens
from lenses import make_lens
from lensfield.cli import main
from lensfield.engine import InputError
from lensfield.engine.calibration.fit import Calibration, calibrate
from lensfield.engine.calibration.formats import FORMATS, calibrated_alike, calibrated_for
from lensfield.engine.calibration.models import (
    BROWN_CONRADY,
    DOUBLE_SPHERE,
    KANNALA_BRANDT,
    MODELS,
    POLY3,
    RADTAN,
    RATIONAL,
    THIN_PRISM,
    UNDISTORTING,
)
from lensfield.engine.calibration.views import View, overscan_lines
from lensfield.engine.image.pixel_grid import PixelGrid
from refusals import refused

POSE = np.array([[0.0, -1, 0, 2], [1, 0, 0, 3], [0, 0, 1, 4], [0, 0, 0, 1]])


def fit_of(model, coefficients=None):
    """A calibration with different values everywhere."""
    coefficients = coefficients or tuple(0.01 * number for number in range(1, len(model.coefficients) + 1))
    return Calibration(model, FRAME, (400.0, 410.0), (42.0, 61.0), coefficients, 0.02, 0.05, 1.0, 'a "lens"\nof two',
                       np.inf, 2.8, 550.0, 12.0, (0.12, 0.17, 0.26, 0.075), 2.7, 66.5)


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
    fit = calibrated_for(name, radial_lens(lambda t: t * (1 - 0.9 * t**2)), PixelGrid((90, 140), 22.0), 550.0)
    assert fit.largest_px < 0.1 and "Made by Lensfield" in text(name, fit)
    np.testing.assert_allclose(fit.focal_px, FOCAL_PX, rtol=1e-3)


def test_kalibr():
    fields = yaml.safe_load(text("kalibr", fit_of(RADTAN)))["cam0"]
    assert (fields["camera_model"], fields["distortion_model"]) == ("pinhole", "radtan")
    assert fields["intrinsics"] == [400, 410, 42, 61] and fields["resolution"] == [140, 90]
    np.testing.assert_allclose(fields["distortion_coeffs"], [0.01, 0.02, 0.03, 0.04])
    fields = yaml.safe_load(text("kalibr", fit_of(DOUBLE_SPHERE)))["cam0"]
    assert (fields["camera_model"], fields["distortion_model"]) == ("ds", "none")
    assert fields["intrinsics"] == [0.01, 0.02, 400, 410, 42, 61] and fields["distortion_coeffs"] == []
    assert yaml.safe_load(text("kalibr", fit_of(KANNALA_BRANDT)))["cam0"]["distortion_model"] == "equidistant"


@pytest.mark.parametrize("model, kind, count", [(BROWN_CONRADY, "plumb_bob", 5), (RATIONAL, "rational_polynomial", 8),
                                                (KANNALA_BRANDT, "equidistant", 4)])
def test_ros(model, kind, count):
    fields = yaml.safe_load(text("ros", fit_of(model)))
    assert fields["distortion_model"] == kind and (fields["image_width"], fields["image_height"]) == (140, 90)
    assert fields["camera_matrix"]["data"] == [400, 0, 42, 0, 410, 61, 0, 0, 1]
    assert fields["projection_matrix"]["data"] == [400, 0, 42, 0, 0, 410, 61, 0, 0, 0, 1, 0]
    np.testing.assert_allclose(fields["distortion_coefficients"]["data"], 0.01 * np.arange(1, count + 1))


def undistorted(radial, tangential, x, y):
    """The undistorted place of a place, by equations 16 and 17 of OpenLensIO 1.0."""
    (k1, k2, k3, k4, k5, k6), (p1, p2), r = radial, tangential, x**2 + y**2
    scale = (1 + k1 * r + k3 * r**2 + k5 * r**3) / (1 + k2 * r + k4 * r**2 + k6 * r**3)
    return x * scale + 2 * p1 * x * y + p2 * (r + 2 * x**2), y * scale + 2 * p2 * x * y + p1 * (r + 2 * y**2)


@pytest.mark.parametrize("radial, tangential, place, expected", [
    ((0.1, 0, 0, 0, 0, 0), (0, 0), (1, 2), (1.5, 3)), ((-0.1, 0, 0, 0, 0, 0), (0, 0), (1, 2), (0.5, 1)),
    ((0, 0, 0, 0, 0, 0), (0.1, 0), (1, 1), (1.2, 1.4))], ids=["barrel", "pincushion", "tangential"])
def test_the_oracle_of_opentrackio_reads_the_equations_alike(radial, tangential, place, expected):
    """Vectors of github.com/Frontier-Stageworks/opentrackio-proof, battery-tester/semantic_oracle/fixtures.json."""
    np.testing.assert_allclose(undistorted(radial, tangential, *place), expected, rtol=1e-12)


def test_openlensio_is_in_millimetres_and_alternates():
    """By equation 10, the undistorted place of a pixel is the place of its light."""
    fit = calibrate(modelled_lens(RADTAN, (-0.4, 0.5, 0.011, -0.007)), FRAME, 550.0, [UNDISTORTING[-1]])
    contents = json.loads(text("openlensio", fit))
    lens, camera = contents["lens"], contents["static"]["camera"]
    assert camera["activeSensorResolution"] == {"height": 90, "width": 140}
    np.testing.assert_allclose(camera["activeSensorPhysicalDimensions"]["width"], 3.08)
    assert lens["focusDistance"] == 0.105 and contents["protocol"]["version"] == [1, 0, 1]
    distortion, = lens["distortion"]
    direction = np.array([0.11, -0.08, 1.0])
    (column, row), offset = fit.pixels(direction), lens["projectionOffset"]
    x, y = ((column - 69.5) * 0.022 - offset["x"], (row - 44.5) * 0.022 - offset["y"])
    straight = undistorted(distortion["radial"], distortion["tangential"], x, y)
    np.testing.assert_allclose(straight, lens["pinholeFocalLength"] * direction[:2], atol=1e-6)
    assert fit.largest_px < 0.05 and np.hypot(*np.subtract(straight, (x, y))) > 5e-3 and distortion["overscan"] > 1


def test_openlensio_states_the_entrance_pupil_in_metres_and_its_f_number():
    lens = json.loads(text("openlensio", fit_of(UNDISTORTING[0])))["lens"]
    assert (lens["entrancePupilOffset"], lens["fStop"]) == (0.0665, 2.7)
    of_tables = replace(fit_of(UNDISTORTING[0]), entrance_pupil_mm=None)
    assert "entrancePupilOffset" not in json.loads(text("openlensio", of_tables))["lens"]


@pytest.mark.parametrize("changes", [{}, {"focus_mm": 500.0, "entrance_pupil_mm": None}])
def test_a_sample_is_valid_by_opentrackios_schema(changes):
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed: make test-calibration")
    schema = json.loads((Path(__file__).parents[2] / "data/opentrackio_schema.json").read_text())
    sample = json.loads(text("openlensio", replace(fit_of(UNDISTORTING[-1]), **changes)))
    jsonschema.Draft202012Validator(schema).validate(sample)
    sample["lens"]["entrancePupil"] = 1.0
    with pytest.raises(jsonschema.ValidationError, match="entrancePupil"):
        jsonschema.Draft202012Validator(schema).validate(sample)


def test_openlensio_names_equal_calibrations_alike_and_leaves_infinity_out():
    first, second = (json.loads(text("openlensio", fit_of(UNDISTORTING[0]))) for _ in range(2))
    assert first == second and first["sampleId"].startswith("urn:uuid:") and "focusDistance" not in first["lens"]
    other = json.loads(text("openlensio", replace(fit_of(UNDISTORTING[0]), f_number=4.0)))
    assert other["sampleId"] != first["sampleId"]


def test_gyroflow():
    contents = json.loads(text("gyroflow", fit_of(KANNALA_BRANDT)))
    assert contents["calib_dimension"] == {"w": 140, "h": 90} and contents["distortion_model"] == "opencv_fisheye"
    assert contents["fisheye_params"]["camera_matrix"] == [[400, 0, 42], [0, 410, 61], [0, 0, 1]]
    np.testing.assert_allclose(contents["fisheye_params"]["distortion_coeffs"], [0.01, 0.02, 0.03, 0.04])
    assert contents["asymmetrical"]  # otherwise, Gyroflow takes the middle of the frame instead of cx and cy
    assert contents["calibrator_version"]  # Gyroflow 1.6.3: load_from_data refuses a profile without it
    assert contents["camera_brand"] and contents["camera_model"]  # its list leaves out profiles without either


def test_lensfun_needs_the_axis_in_the_middle():
    with refused(InputError, field="--for", value="lensfun", match="expected the optical axis in the middle"):
        text("lensfun", fit_of(POLY3))


def test_overscan_holds_the_undistorted_frame():
    """The fit's focal lengths times tangents of 0.12 left, 0.17 up, 0.26 right and 0.075 down, from 42, 61."""
    fit = fit_of(BROWN_CONRADY)
    np.testing.assert_allclose(fit.overscan_px, (48 - 42.5, 69.7 - 61.5, 104 - 97.5, 30.75 - 28.5))
    line, = overscan_lines(fit)
    assert "6 px more on the left, 7 on the right, 9 above, 3 below" in line
    assert '"153 102 6 3 146 93 1 undistorted"' in line
    centred = json.loads(text("openlensio", fit))["lens"]["distortion"][0]["overscan"]
    assert centred == pytest.approx(max(1 + 2 * 6.5 / 140, 1 + 2 * 8.2 / 90))
    across = replace(fit, tangents=(0.12, 0.17, 0.36, 0.075))
    centred = json.loads(text("openlensio", across))["lens"]["distortion"][0]["overscan"]
    assert centred == pytest.approx(1 + 2 * 46.5 / 140)


def fisheye():
    return radial_lens(np.arctan, np.linspace(0, 30, 65)), PixelGrid((90, 140), 150.0)


def test_a_fisheye_chooses_its_model():
    for name in ("opencv", "colmap", "nerfstudio", "kalibr", "ros", "isaac", "gyroflow"):
        assert calibrated_for(name, *fisheye(), 550.0).model is KANNALA_BRANDT


def test_a_format_without_fisheyes_refuses_one_and_names_others():
    with refused(InputError, field="--for", value="openlensio", match="fisheye here.*: use opencv, .*, lensfun, gyro"):
        calibrated_for("openlensio", *fisheye(), 550.0)


@pytest.mark.parametrize("kind, mapped", [
    ("fisheye", np.arctan), ("equisolid", lambda t: 2 * np.sin(np.arctan(t) / 2)),
    ("stereographic", lambda t: 2 * np.tan(np.arctan(t) / 2))])
def test_lensfun_has_the_type_of_the_fisheye(kind, mapped):
    lens, frame = radial_lens(mapped, np.linspace(0, 40, 65)), PixelGrid((90, 140), 200.0)
    fit = calibrated_for("lensfun", lens, frame, 550.0, f"poly5-{kind}")
    np.testing.assert_allclose([*fit.focal_px, *fit.coefficients], [FOCAL_MM / 0.2] * 2 + [0, 0], rtol=1e-3, atol=2e-3)
    assert fit.largest_px < 0.01 and f"<type>{kind}</type>" in text("lensfun", fit)
    assert calibrated_for("lensfun", *fisheye(), 550.0).model.name == "poly5-fisheye"


def test_a_format_with_one_focal_length_refuses_an_anamorphic_lens():
    lens = modelled_lens(RADTAN, (-0.4, 0.5, 0.011, -0.007), squeeze=1.5)
    with refused(InputError, field="--for", value="openlensio", match="anamorphic, with a squeeze of 1.5: use opencv"):
        calibrated_for("openlensio", lens, FRAME, 550.0)


def test_a_fisheye_s_model_serves_a_lens_that_no_shorter_one_describes():
    lens, frame = radial_lens(lambda t: t / np.hypot(1, t), np.linspace(0, 13, 65)), PixelGrid((90, 140), 80.0)
    assert calibrate(lens, frame, 550.0, [RADTAN]).largest_px > 0.1
    assert calibrated_for("kalibr", lens, frame, 550.0).model is KANNALA_BRANDT


def test_a_fisheye_refuses_a_pinhole():
    with refused(InputError, field="--model", value="rational", match="is a fisheye here.*: use kannala-brandt"):
        calibrated_for("opencv", *fisheye(), 550.0, "rational")


def test_a_format_refuses_a_model_that_it_lacks():
    with refused(InputError, field="--model", value="thin-prism", match="--for colmap has pinhole, .*, kannala-brandt"):
        calibrated_for("colmap", make_lens(heights_mm=HEIGHTS_MM), FRAME, 550.0, "thin-prism")


def test_all_cameras_of_a_file_have_models_of_one_kind():
    ordinary = radial_lens(lambda t: t * (1 - 0.9 * t**2)), FRAME, 550.0
    assert not calibrated_alike("nerfstudio", [ordinary, ordinary])[0].model.fisheye
    fits = calibrated_alike("nerfstudio", [ordinary, (*fisheye(), 550.0), ordinary])
    assert [fit.model for fit in fits] == 3 * [KANNALA_BRANDT] and fits[0].largest_px < 0.05


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


@pytest.mark.parametrize("wavelengths", ["red", "550,550"])
def test_wavelengths_must_be_numbers_and_differ(tmp_path, capsys, wavelengths):
    assert main(["lens", "calibration", "edmund-54852", "--for", "colmap", "-o", str(tmp_path / "lens.txt"),
                 "--resolution", "320x240", "--wavelength", wavelengths]) == 1
    assert f"--wavelength is {wavelengths}" in capsys.readouterr().err


def test_a_model_of_a_lens_without_symmetry_keeps_its_tangential_terms():
    fit = calibrate(modelled_lens(RADTAN, (-0.4, 0.5, 0.011, -0.007)), FRAME, 550.0, [RADTAN])
    assert opencv_numbers(text("opencv", fit))["distortion_coefficients"]["data"][2:4] == list(fit.coefficients[2:4])
