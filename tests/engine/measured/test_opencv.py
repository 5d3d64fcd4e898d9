"""OpenCV writes files, projects and undistorts as the lenses that are read from them.

Without OpenCV, these tests are skipped: make test-calibration runs them.
"""

import numpy as np
import pytest

from lensfield.engine.measured.files import lens_of, read_measured
from lensfield.engine.measured.options import MeasuredOptions
from lensfield.engine.pictures.spectral_exr import write_rgb_exr
from measuring import lens_directions, off_px

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: make test-calibration")
SIZE_PX, MOST_PX = (801, 533), 0.02
MATRIX = np.array([[610.0, 0, 391.7], [0, 604.0, 281.3], [0, 0, 1]])
PINHOLES = {"five": [-0.28, 0.11, 0.002, -0.003, -0.02], "eight": [0.2, 0.06, 0.003, 0.002, 0.01, 0.45, 0.12, 0.02],
            "twelve": [-0.25, 0.1, 0.004, -0.003, 0.01, 0.02, 0.01, 0.005, 0.003, -0.001, 0.002, 0.001]}
FISHEYE = [0.04, -0.02, 0.006, -0.001]
OPTIONS = MeasuredOptions(sensor_mm=(8.0, 5.33), f_number=4.0, focus_mm=700.0)


def write(path, matrix, coefficients, fisheye):
    """As OpenCV's sample program writes its results."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, side in zip(("image_width", "image_height"), SIZE_PX, strict=True):
        file.write(name, side)
    file.write("camera_matrix", matrix)
    file.write("distortion_coefficients", np.array(coefficients)[:, None])
    file.write("fisheye_model", int(fisheye))
    file.release()


def by_opencv(directions, coefficients, fisheye=False):
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    return project(directions[:, None], np.zeros(3), np.zeros(3), MATRIX, np.array(coefficients))[0][:, 0]


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
@pytest.mark.parametrize("name", PINHOLES)
def test_opencv_projects_as_the_lens(tmp_path, name, suffix):
    path = tmp_path / f"camera{suffix}"
    write(path, MATRIX, PINHOLES[name], fisheye=False)
    lens = lens_of(read_measured(path, OPTIONS), OPTIONS)
    assert off_px(lens, SIZE_PX, lambda directions: by_opencv(directions, PINHOLES[name])) <= MOST_PX
    pixels, directions, inside = lens_directions(lens, SIZE_PX)
    stop = cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12
    straight = cv2.undistortPointsIter(pixels[:, None], MATRIX, np.array(PINHOLES[name]), None, None, stop)[:, 0]
    assert np.abs((straight - directions[:, :2]) * 604)[inside].max() < 3 * MOST_PX  # of the undistorted picture


def test_opencv_projects_as_the_fisheye(tmp_path):
    path = tmp_path / "camera.yml"
    write(path, MATRIX, FISHEYE, fisheye=True)
    lens = lens_of(read_measured(path, OPTIONS), OPTIONS)
    assert off_px(lens, SIZE_PX, lambda directions: by_opencv(directions, FISHEYE, True)) <= MOST_PX


@pytest.mark.parametrize("direction", ["distort", "undistort"])
def test_opencv_s_maps_as_stmaps(tmp_path, direction):
    """`initUndistortRectifyMap` has the place in the lens's picture of each undistorted pixel, and `undistortPoints`
    the reverse; the undistorted picture is half as large again."""
    coefficients, overscan = np.array(PINHOLES["five"]), 1.5
    columns, rows = SIZE_PX
    matrix = np.array([[610.0, 0, (columns - 1) / 2], [0, 610.0, (rows - 1) / 2], [0, 0, 1]])
    larger = round(columns * overscan), round(rows * overscan)
    wide = matrix.copy()
    wide[:2, 2] = (larger[0] - 1) / 2, (larger[1] - 1) / 2
    if direction == "undistort":
        x, y = cv2.initUndistortRectifyMap(MATRIX, coefficients, None, wide, larger, cv2.CV_32FC1)
        size = columns, rows
    else:
        pixels = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 1, 2).astype(float)
        stop = cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-10
        x, y = np.moveaxis(cv2.undistortPointsIter(pixels, MATRIX, coefficients, None, wide, stop)
                           .reshape(rows, columns, 2), -1, 0)
        size = larger
    path = tmp_path / f"lens_{direction}.exr"
    write_rgb_exr(np.stack([(x + 0.5) / size[0], 1 - (y + 0.5) / size[1], 0 * x], axis=-1), path)
    options = MeasuredOptions(focal_mm=6.1, sensor_mm=(8.01, 5.33), overscan=overscan)
    lens = lens_of(read_measured(path, options), options)
    assert lens.sensor_mm == pytest.approx((8.01, 5.33))
    assert off_px(lens, SIZE_PX, lambda directions: by_opencv(directions, coefficients)) <= MOST_PX
