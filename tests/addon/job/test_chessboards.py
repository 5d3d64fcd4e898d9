"""OpenCV's calibration of chessboards returns the exported numbers: from exact corners, and from a rendered picture.

Without OpenCV, these tests are skipped: make test-calibration runs them.
"""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed: make test-calibration")

from chessboards import (  # noqa: E402  # it imports cv2
    FRAME_PX,
    LENSES,
    boards,
    detected_px,
    exact_px,
    opencv_calibration,
    picture_of,
    taken_lens,
)
from lensfield.engine.calibration.formats import calibrated_for  # noqa: E402
from lensfield.engine.calibration.rays import frame_rays  # noqa: E402

EXACT_PX, RENDERED_PX = 0.05, 0.2


@pytest.mark.parametrize("name", LENSES)
def test_opencv_calibrates_exact_corners_as_exported(name):
    lens, frame, nm = taken_lens(name)
    calibration = calibrated_for("opencv", lens, frame, nm)
    exact = [(board.corners_m, exact_px(lens, frame, nm, board.in_camera(board.corners_m)))
             for board in boards(calibration, frame_rays(lens, frame, nm))]
    rms_px, matrix = opencv_calibration(calibration, exact)
    assert rms_px < EXACT_PX
    farthest = np.hypot(*FRAME_PX) / 2 / calibration.focal_px[1]
    assert abs(matrix[1, 1] - calibration.focal_px[1]) * farthest < 20 * EXACT_PX  # it trades size for distance
    for board in boards(calibration, frame_rays(lens, frame, nm)):
        points = board.in_camera(board.corners_m)
        off_px = calibration.pixels(points) - exact_px(lens, frame, nm, points)
        assert np.hypot(*off_px.T).max() < 2 * EXACT_PX


@pytest.mark.parametrize("name", [LENSES[0]])
def test_corners_in_a_picture_are_where_the_exported_numbers_have_them(name):
    lens, frame, nm = taken_lens(name)
    calibration = calibrated_for("opencv", lens, frame, nm)
    board = boards(calibration, frame_rays(lens, frame, nm))[0]
    expected_px = calibration.pixels(board.in_camera(board.corners_m))
    corners_px = detected_px(picture_of(board, lens), expected_px)
    assert np.sqrt(np.mean(np.sum((corners_px - expected_px)**2, axis=1))) < RENDERED_PX
