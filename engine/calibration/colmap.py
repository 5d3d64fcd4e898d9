"""COLMAP's cameras.txt: https://colmap.github.io/format.html. The middle of the upper left pixel is at 0.5, 0.5."""

from collections.abc import Sequence

from .fit import Calibration
from .views import View, origin

MODELS = {"pinhole": "PINHOLE", "radial-1": "OPENCV", "radial-2": "OPENCV", "radtan": "OPENCV",
          "kannala-brandt": "OPENCV_FISHEYE"}
"""Other models are parts of FULL_OPENCV."""
COUNTS = {"PINHOLE": 0, "OPENCV": 4, "OPENCV_FISHEYE": 4, "FULL_OPENCV": 8}


def colmap_text(views: Sequence[View]) -> str:
    """The file with the camera of each view."""
    lines = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    for number, view in enumerate(views, 1):
        lines += [f"# {origin(view.calibration)}", f"{number} {_camera(view.calibration)}"]
    return "\n".join([*lines, ""])


def _camera(calibration: Calibration):
    model = MODELS.get(calibration.model.name, "FULL_OPENCV")
    principal_px = (place + 0.5 for place in calibration.principal_px)
    values = *calibration.focal_px, *principal_px, *calibration.opencv_coefficients(COUNTS[model])
    return " ".join([model, *map(str, calibration.size_px), *map(repr, values)])
