"""OpenCV's YAML, for `cv2.FileStorage`: the camera matrix, and coefficients for `calib3d` or its module `fisheye`."""

import json
from collections.abc import Sequence

from .views import View, origin

LENGTHS = 5, 8, 12  # of arrays that OpenCV accepts


def opencv_text(views: Sequence[View]) -> str:
    """The file of one camera."""
    calibration, = (view.calibration for view in views)
    (columns, rows), (fx, fy), (cx, cy) = calibration.size_px, calibration.focal_px, calibration.principal_px
    fisheye = calibration.model.fisheye
    count = 4 if fisheye else next(length for length in LENGTHS if length >= len(calibration.coefficients))
    return "\n".join([
        "%YAML:1.0", "---", f"origin: {json.dumps(origin(calibration), ensure_ascii=False)}",
        f"camera_model: {'fisheye' if fisheye else 'pinhole'}",
        f"image_width: {columns}", f"image_height: {rows}",
        *_matrix("camera_matrix", (3, 3), (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)),
        *_matrix("distortion_coefficients", (1, count), calibration.opencv_coefficients(count)),
        f"rms_px: {calibration.rms_px:.6f}", f"largest_px: {calibration.largest_px:.6f}", ""])


def _matrix(name, shape, values):
    rows, columns = shape
    return [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d",
            f"   data: [ {', '.join(map(repr, map(float, values)))} ]"]
