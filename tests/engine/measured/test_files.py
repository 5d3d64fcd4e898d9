"""Files of measured lenses: kinds, foreign files, and damage."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine.calibration.models import KANNALA_BRANDT, RADTAN, RATIONAL
from lensfield.engine.lens import RadialLens
from lensfield.engine.measured.files import KINDS, kind_of, lens_of, read_measured
from lensfield.engine.measured.options import MeasuredOptions
from lensfield.engine.pictures.spectral_exr import write_planes_exr, write_rgb_exr
from lensfield.engine.runtime.errors import InputError, LensError
from measured_files import (
    COLUMNS,
    LENSFUN,
    OPENCV_XML,
    OPTIONS,
    PLACES_PX,
    ROWS,
    as_json,
    foreign_map,
    measured_files,
    options_for,
)
from measuring import lens_directions
from refusals import refused

NONE = MeasuredOptions()


@pytest.fixture
def files(tmp_path):
    """Paths of valid files, by kind."""
    paths = {}
    for kind, (name, contents) in measured_files(tmp_path).items():
        (tmp_path / kind).mkdir()
        paths[kind] = tmp_path / kind / name
        paths[kind].write_bytes(contents)
    return paths


@pytest.mark.parametrize("kind", KINDS)
def test_the_kind_of_a_file_follows_from_its_contents(files, kind):
    assert kind_of(files[kind]) == kind.replace("opencv-fisheye", "opencv")
    straight = read_measured(files[kind], options_for(kind), kind).straight(PLACES_PX)
    assert np.isfinite(straight.tangents).all() and straight.end[0] >= 1


def test_opencv_xml_with_names_of_its_sample_program(tmp_path):
    path = tmp_path / "out_camera_data.xml"
    path.write_text(OPENCV_XML)
    camera = read_measured(path, NONE)
    assert (camera.size_px, camera.focal_px, camera.principal_px) == ((48, 31), (40, 40), (22, 16))
    assert camera.coefficients == (-0.2, 0.05, 1e-3, -2e-3, 0.01)
    path.write_text(OPENCV_XML.replace("<image_Width>48</image_Width>", ""))
    with refused(LensError, field="image_width", value="missing", match="--resolution"):
        read_measured(path, NONE)
    assert read_measured(path, replace(NONE, size_px=(96, 62))).size_px == (96, 62)


def test_four_coefficients_are_a_fisheye_s_if_the_user_says_so(tmp_path, files):
    text = files["opencv-fisheye"].read_text().replace("camera_model: fisheye\n", "")
    path = tmp_path / "c.yml"
    path.write_text(text)
    assert read_measured(path, NONE).model is RADTAN
    assert read_measured(path, NONE, "opencv-fisheye").model is KANNALA_BRANDT


COLMAP = """# Camera list
1 SIMPLE_RADIAL 640 480 500.0 320.0 240.0 -0.1
2 RADIAL_FISHEYE 640 480 300.0 321.5 239.0 0.02 -0.003
3 FULL_OPENCV 640 480 500 510 320 240 0.1 0.2 0.001 0.002 0.3 0.4 0.5 0.6
4 THIN_PRISM_FISHEYE 640 480 500 510 320 240 0 0 0 0 0 0 0 0
"""


def test_colmap_s_cameras_are_chosen_by_their_number(tmp_path):
    path = tmp_path / "cameras.txt"
    path.write_text(COLMAP)
    first, second, third = (read_measured(path, MeasuredOptions(which)) for which in "123")
    assert first.focal_px == (500, 500) and first.principal_px == (319.5, 239.5) and first.symmetric
    assert second.model is KANNALA_BRANDT and second.coefficients == (0.02, -0.003, 0, 0) and not second.symmetric
    assert third.model is RATIONAL and third.coefficients == (0.1, 0.2, 0.001, 0.002, 0.3, 0.4, 0.5, 0.6)
    with refused(LensError, field="camera", value="one of 4", match="--which: 1, 2, 3, 4"):
        read_measured(path, NONE)
    with refused(LensError, field="camera 4, MODEL", value="THIN_PRISM_FISHEYE", match="expected SIMPLE_PINHOLE"):
        read_measured(path, MeasuredOptions("4"))
    assert isinstance(lens_of(first, NONE), RadialLens)


def test_a_frame_of_nerfstudio_is_chosen_by_its_picture(tmp_path, files):
    text = files["nerfstudio"].read_text()
    camera = {name: value for name, value in zip(("fl_x", "fl_y"), (44.0, 45.0), strict=True)}
    frames = [{"file_path": "a.png"} | camera, {"file_path": "b.png", "fl_x": 50.0, "fl_y": 51.0}]
    path = tmp_path / "transforms.json"
    path.write_text(as_json(text, fl_x=None, fl_y=None, frames=frames))
    assert read_measured(path, MeasuredOptions("b.png")).focal_px == (50, 51)
    with refused(LensError, field="frame", value="one of 2", match="--which: a.png, b.png"):
        read_measured(path, NONE)


DAMAGE = [
    ("opencv", "dt: d", "dt: ", None), ("opencv", "data: [ 40.0", "data: [ x", "camera_matrix"),
    ("opencv", "[ 40.0, 0.0,", "[ .Nan, 0.0,", "camera_matrix"),
    ("opencv", "[ 40.0, 0.0,", "[ 40.0, 0.5,", "camera matrix"),
    ("opencv", "[ 40.0, 0.0,", "[ 0.0, 0.0,", "focal length"), ("opencv", "camera_matrix", "other", "camera_matrix"),
    ("opencv", "image_width: 48", "image_width: 48.5", "image_width"), ("opencv", "%YAML:1.0", "{[", "file"),
    ("opencv", ", 22.0, ", ", 9000.0, ", "principal point"),
    ("opencv", "image_height: 31", "image_height: 1", "picture size"),
    ("opencv", "[ 0.2, 0.06", "[ inf, 0.06", "distortion_coefficients"),
    ("opencv", "[ 0.2, 0.06", "[ 1, 2, 3, 4, 5, 6, 7, 8, 0.2, 0.06", "distortion_coefficients"),
    ("colmap", "OPENCV 48 31", "OPENCV 48", "camera 1"), ("colmap", "OPENCV", "CUBE", "camera 1, MODEL"),
    ("colmap", "41.0", "nan", "focal length"), ("colmap", "1 OPENCV", "# OPENCV", "camera"),
    ("nerfstudio", '"fl_x": 40.0', '"fl_x": "wide"', "fl_x"), ("nerfstudio", '"w": 48', '"w": true', "w"),
    ("nerfstudio", '"cx"', '"k4": 0.1, "cx"', "k4"),
    ("nerfstudio", '"OPENCV"', '"OMNI"', "camera_model"), ("nerfstudio", '"cx"', '"ccx"', "cx"),
    ("kalibr", "camera_model: ds", "camera_model: omni", "cam0, camera_model"),
    ("kalibr", "intrinsics: [-0.1, ", "intrinsics: [", "cam0, intrinsics"),
    ("kalibr", "resolution: [48, 31]", "resolution: [48]", "cam0, resolution"),
    ("ros", "distortion_model: equidistant", "distortion_model: cube", "distortion_model"),
    ("ros", "cols: 4", "cols: 5", "distortion_coefficients"),
    ("ros", "0.03, -0.01, ", "0.03, ", "distortion_coefficients"),
    ("gyroflow", '"w": 48', '"w": -4', "calib_dimension, w"),
    ("gyroflow", '"opencv_fisheye"', '"sony"', "distortion_model"),
    ("gyroflow", '"input_horizontal_stretch": 1.0', '"input_horizontal_stretch": "2:1"', "input_horizontal_stretch"),
    ("gyroflow", '"fisheye_params"', '"digital_lens": "gopro_superview", "fisheye_params"', "digital_lens"),
    ("gyroflow", '"fisheye_params"', '"params"', "fisheye_params"),
    ("lensfun", "<type>stereographic", "<type>panoramic", "Optik Zoom 20-40mm, type"),
    ("lensfun", 'a="0.01"', 'a="nan"', "Optik Zoom 20-40mm, a"),
    ("lensfun", 'model="ptlens" focal="20"', 'model="acm" focal="20"', "Optik Zoom 20-40mm, distortion model"),
    ("lensfun", 'focal="20" aperture="8"', 'focal="20"', "Optik Zoom 20-40mm, aperture"),
    ("lensfun", "4:3", "0.5", "Optik Zoom 20-40mm, aspect-ratio"),
    ("lensfun", "<cropfactor>1.5</cropfactor><aspect", "<cropfactor>0</cropfactor><aspect",
     "Optik Zoom 20-40mm, cropfactor"),
    ("lensfun", "<lensdatabase version", "<!DOCTYPE a [<!ENTITY b \"c\">]><lensdatabase version", "file"),
    ("lensfun", "</lensdatabase>", "", "file")]


@pytest.mark.parametrize("kind, old, new, field", DAMAGE)
def test_damage_is_reported_in_one_line(files, kind, old, new, field):
    path = files[kind]
    contents = path.read_text()
    assert old in contents
    path.write_text(contents.replace(old, new, 1))
    if field is None:
        read_measured(path, options_for(kind), kind)
        return
    with refused(LensError, field=field):
        read_measured(path, options_for(kind), kind)


def test_other_files_are_refused(tmp_path):
    for name, contents, field in (("a.json", "{}", "kind of file"), ("a.yml", "- 1\n", "file"),
                                  ("a.png", "", "kind of file"), ("map.exr", "", "direction"),
                                  ("cameras.bin", "", "kind of file")):
        path = tmp_path / name
        path.write_text(contents)
        with refused(LensError, field=field, where=name):
            read_measured(path, NONE)
    with refused(LensError, field="file", value="missing"):
        read_measured(tmp_path / "none.yml", NONE)


def test_lensfun_s_lenses_and_focal_lengths_are_chosen(tmp_path):
    (tmp_path / "one.xml").write_text(LENSFUN)
    (tmp_path / "two.xml").write_text(LENSFUN.replace("Zoom 20-40mm", "Other zoom"))
    with refused(LensError, field="lens", value="one of 2", match="Optik Zoom 20-40mm"):
        read_measured(tmp_path, OPTIONS)
    with refused(LensError, field="lens", value="zoom", match="Optik Zoom 20-40mm, Optik Other zoom"):
        read_measured(tmp_path, replace(OPTIONS, which="zoom"))
    named = replace(OPTIONS, which="zoom 20-40MM", sensor_mm=None)
    assert read_measured(tmp_path, named).name == "Optik Zoom 20-40mm"
    with refused(LensError, field="focal length", value="from 20 to 40 mm", match="--focal-length"):
        read_measured(tmp_path, replace(named, focal_mm=None))
    with refused(LensError, field="--focal-length", value=50, match="expected 20 to 40 mm"):
        read_measured(tmp_path, replace(named, focal_mm=50.0))
    lens = lens_of(read_measured(tmp_path, replace(named, focal_mm=20.0)), replace(named, focal_mm=20.0))
    assert lens.sensor_mm == pytest.approx((0.8 * 43.2666 / 1.5, 0.6 * 43.2666 / 1.5), rel=1e-5)
    corner = np.interp(np.hypot(*lens.sensor_mm) / 2, lens.real_height_mm[4], lens.relative_illumination[4])
    assert corner == pytest.approx(0.6, abs=1e-3)
    assert np.all(lens.real_height_mm[6, 1:] > lens.real_height_mm[4, 1:])  # red is larger than green


def test_a_foreign_stmap_distorts_as_its_formula(tmp_path):
    """x (1 + k r^2), in half widths, is the undistorted place of a pixel of the lens's picture, with and without
    overscan, whichever way t counts, and in whatever channels."""
    size_px, strength, focal_mm = (COLUMNS, ROWS), -0.1, 30.0
    places = foreign_map(strength)
    upside_down = places * (1, -1, 1) + (0, 1, 0)
    cases = [(places, 1.0), (upside_down, 1.0), (foreign_map(strength, overscan=1.25), 1.25)]
    for number, (contents, overscan) in enumerate(cases):
        path = tmp_path / f"map{number}.exr"
        if number == 1:
            write_planes_exr({"forward.u": np.float32(contents[..., 0]), "forward.v": np.float32(contents[..., 1])},
                             path, {})
        else:
            write_rgb_exr(contents, path)
        options = MeasuredOptions(focal_mm=focal_mm, sensor_mm=(36.0, 36.0 * ROWS / COLUMNS), overscan=overscan)
        lens = lens_of(read_measured(path, options, "stmap-distort"), options)
        pixels, directions, inside = lens_directions(lens, size_px)
        off = (pixels - (np.array(size_px) - 1) / 2) / (COLUMNS / 2)
        expected = off * (1 + strength * np.sum(off**2, axis=1, keepdims=True)) * 18 / focal_mm
        assert inside.all() and np.abs(directions[:, :2] - expected).max() * focal_mm / 36 * COLUMNS < 0.02


def test_stmaps_without_places_or_a_focal_length_are_refused(tmp_path):
    path = tmp_path / "undistort.exr"
    for change, field in ((lambda places: places[:, ::-1], "red"), (lambda places: places * (1, 0, 1), "green"),
                          (lambda places: np.where(np.indices((ROWS, COLUMNS)).sum(axis=0)[..., None] < 9, 0, places),
                           "place"), (lambda places: places * np.nan, "place")):
        write_rgb_exr(change(foreign_map(0.1)), path)
        with refused(LensError, field=field):
            read_measured(path, OPTIONS)
    write_rgb_exr(foreign_map(0.1), path)
    with refused(LensError, field="focal length", value="missing", match="--focal-length, --sensor"):
        read_measured(path, NONE)
    write_planes_exr({"Z": np.ones((4, 4), np.float32)}, path, {})
    with refused(LensError, field="channels"):
        read_measured(path, OPTIONS)


@pytest.mark.parametrize("options, field", [
    ({"focal_mm": -1.0}, "--focal-length"), ({"f_number": float("nan")}, "--f-number"), ({"focus_mm": 0.0}, "--focus"),
    ({"overscan": 0.5}, "--overscan")])
def test_impossible_options_are_refused(options, field):
    with refused(InputError, field=field):
        MeasuredOptions(**options)


@pytest.mark.parametrize("options, field", [({"focal_mm": 35.0}, "--focal-length"), ({"overscan": 1.2}, "--overscan")])
def test_options_that_a_kind_does_not_take_are_refused(files, options, field):
    with refused(InputError, field=field):
        read_measured(files["opencv"], MeasuredOptions(**options))
