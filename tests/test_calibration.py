"""The lens that validation/plate_photographs.py makes from a calibration, against OpenCV's equations."""

from dataclasses import replace

import numpy as np
import pytest

from calibration import PIXEL_MM, WAVELENGTH_NM, calibrated_lens, read_calibration
from lensfield.engine.field.field_map import field_map
from lensfield.engine.runtime.errors import InputError, LensError
from refusals import refused

CAL = """\
# of a camera that does not exist; a line such as version=3 in a comment means nothing
version=2
origin=center
camera.0.R=[ 0.0 0.6 -0.8; 1.0 0.0 0.0; 0.0 -0.8 -0.6]
camera.0.T=[ 0.5 -2.0 3.0]   # metres
camera.0.k1= -0.23
camera.0.k2= 0.071
camera.0.k3= -9.5e-3
camera.0.A=[ 95.5 0.00000 71.25; 0.00000 95.5 40.5; 0.00000 0.00000 1.00000]
camera.0.width= 160
camera.0.height= 100
camera.rmsInt= 0.2
"""
K1, K2, K3 = -0.23, 0.071, -0.0095
FOCAL_PX, COLUMN, ROW = 95.5, 71.25, 40.5


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "made.cal"
    path.write_text(CAL)
    return path


@pytest.fixture
def calibration(file):
    return read_calibration(file)


def by_opencv(x, y, p1=0.0, p2=0.0, focal_px=(FOCAL_PX, FOCAL_PX), skew=0.0):
    """Column and row of a point at (x, y, 1): OpenCV's documentation of calib3d, term by term."""
    r2 = x * x + y * y
    radial = 1 + K1 * r2 + K2 * r2**2 + K3 * r2**3
    distorted_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    distorted_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return focal_px[0] * distorted_x + skew * distorted_y + COLUMN, focal_px[1] * distorted_y + ROW


def tangents_of_frame(number=20_000):
    """x and y of points that land in the frame, to its corners."""
    x, y = np.random.default_rng(3).uniform(-1.6, 1.6, (2, number))
    column, row = by_opencv(x, y)
    within = (np.abs(column - 79.5) <= 80) & (np.abs(row - 49.5) <= 50) & (np.hypot(x, y) < 1.6)
    assert within.sum() > number / 10 and np.hypot(column - 159.5, row - 99.5)[within].min() < 3
    return x[within], y[within]


def landed_px(calibration, x, y):
    """Columns and rows where the lens of a calibration has light: array (2, place)."""
    lens, (columns, rows) = calibrated_lens(calibration), calibration.size_px
    focal_mm = lens.capture_focal_length_mm
    landed_mm = field_map(lens).at_wavelength(WAVELENGTH_NM).landing_mm(focal_mm * x, -focal_mm * y)
    return np.stack([(columns - 1) / 2 + landed_mm[0] / PIXEL_MM, (rows - 1) / 2 - landed_mm[1] / PIXEL_MM])


def test_light_lands_where_opencv_has_it(calibration):
    x, y = tangents_of_frame()
    assert np.abs(landed_px(calibration, x, y) - by_opencv(x, y)).max() < 0.02
    assert calibrated_lens(calibration).sensor_mm == pytest.approx((160 * PIXEL_MM, 100 * PIXEL_MM))


def test_points_of_the_world_have_tangents_in_the_camera(calibration):
    in_camera = np.array([[0.3, -0.2, 2.0], [0.0, 0.4, 0.5]])
    in_world = in_camera @ np.array([[0, 0.6, -0.8], [1, 0, 0], [0, -0.8, -0.6]]).T + (0.5, -2, 3)
    tangents = calibration.tangents(in_world)
    assert tangents == pytest.approx(np.array([[0.15, -0.1], [0.0, 0.8]]))
    assert calibration.project(tangents).T == pytest.approx(np.array(by_opencv(*tangents.T)))


def test_the_pinhole_has_the_same_axis(calibration):
    tangents = np.array([[0.0, 0.0], [0.2, 0.5]])
    assert calibration.undistorted.project(tangents) == pytest.approx(
        np.array([[COLUMN, ROW], [COLUMN + 0.2 * FOCAL_PX, ROW + 0.5 * FOCAL_PX]]))


@pytest.mark.parametrize("change, of_opencv", [
    ({"tangential": (2e-3, -5e-4)}, {"p1": 2e-3, "p2": -5e-4}),
    ({"matrix_px": np.array([[97.0, 0, COLUMN], [0, FOCAL_PX, ROW], [0, 0, 1]])}, {"focal_px": (97.0, FOCAL_PX)})],
    ids=["tangential", "pixels that are not square"])
def test_the_lens_contains_what_is_not_symmetric(calibration, change, of_opencv):
    changed = replace(calibration, **change)
    x, y = tangents_of_frame()
    expected = by_opencv(x, y, **of_opencv)
    assert changed.project(np.stack([x, y], axis=1)).T == pytest.approx(np.array(expected))
    inside = np.abs(np.subtract(expected, ((79.5,), (49.5,)))) <= ((80,), (50,))
    assert np.abs(np.subtract(landed_px(changed, x, y), expected))[:, inside.all(axis=0)].max() < 0.02


def test_a_skew_is_refused(calibration):
    skewed = replace(calibration, matrix_px=np.array([[FOCAL_PX, 0.4, COLUMN], [0, FOCAL_PX, ROW], [0, 0, 1]]))
    with refused(LensError, field="A", where="made", match="expected 0"):
        calibrated_lens(skewed)


def test_the_field_ends_before_the_distortion_turns_back(calibration):
    """r - 0.3 r^3 turns back at a height of 0.70, and the frame's corner is at 1.06."""
    turning = replace(calibration, radial=(-0.3, 0.0, 0.0))
    lens = calibrated_lens(turning)
    field = field_map(lens).at_wavelength(WAVELENGTH_NM)
    x_mm, y_mm = PIXEL_MM * (COLUMN - 79.5 + FOCAL_PX * np.array([0.6, 0.72])), PIXEL_MM * (49.5 - ROW)
    assert "folds" in lens.notes and field.within(x_mm, np.full(2, y_mm)).tolist() == [True, False]
    beyond = np.array([[1.5, 0.0], [0.2, 0.1]])
    assert turning.in_frame(beyond).tolist() == [False, True]


@pytest.mark.parametrize("line, other, field", [
    ("version=2", "version=1", "version"), ("version=2", "", "version"), ("version=2", "version=", "version"),
    ("origin=center", "origin=corner", "origin"),
    ("camera.0.width= 160", "", "camera.0.width"), ("-0.23", "minus", "camera.0.k1"),
    ("[ 0.5 -2.0 3.0]", "[ 0.5 -2.0]", "camera.0.T"), ("camera.0.A", "camera.1.A", "camera.0.A")])
def test_bad_files_are_refused(file, line, other, field):
    file.write_text(CAL.replace(line, other, 1))
    with refused(InputError, field=field, where="made.cal"):
        read_calibration(file)
