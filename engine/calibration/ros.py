"""ROS's camera_info YAML, which camera_calibration writes and camera_info_manager reads."""

from collections.abc import Sequence

from .views import View, origin


def ros_text(views: Sequence[View]) -> str:
    """The file of one camera."""
    calibration, = (view.calibration for view in views)
    (columns, rows), (fx, fy), (cx, cy) = calibration.size_px, calibration.focal_px, calibration.principal_px
    if calibration.model.fisheye:
        model, count = "equidistant", 4
    else:
        model, count = ("plumb_bob", 5) if len(calibration.coefficients) <= 5 else ("rational_polynomial", 8)
    return "\n".join([
        f"# {origin(calibration)}", f"image_width: {columns}", f"image_height: {rows}", "camera_name: lensfield",
        *_matrix("camera_matrix", (3, 3), (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)), f"distortion_model: {model}",
        *_matrix("distortion_coefficients", (1, count), calibration.opencv_coefficients(count)),
        *_matrix("rectification_matrix", (3, 3), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)),
        *_matrix("projection_matrix", (3, 4), (fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0)), ""])


def _matrix(name, shape, values):
    rows, columns = shape
    return [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: [{', '.join(map(repr, values))}]"]
