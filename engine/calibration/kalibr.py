"""Kalibr's camchain.yaml: https://github.com/ethz-asl/kalibr/wiki/yaml-formats"""

from collections.abc import Sequence

from .models import DOUBLE_SPHERE
from .views import View, origin

DISTORTIONS = {"pinhole": "none", "double-sphere": "none", "kannala-brandt": "equidistant"}
"""By model; others are radtan."""


def kalibr_text(views: Sequence[View]) -> str:
    """The file of one camera."""
    calibration, = (view.calibration for view in views)
    sphere = calibration.model is DOUBLE_SPHERE
    intrinsics = [*calibration.coefficients] * sphere + [*calibration.focal_px, *calibration.principal_px]
    distortion = DISTORTIONS.get(calibration.model.name, "radtan")
    coefficients = [] if distortion == "none" else calibration.opencv_coefficients(4)
    return "\n".join([
        f"# {origin(calibration)}", "cam0:", f"  camera_model: {'ds' if sphere else 'pinhole'}",
        f"  intrinsics: {_listed(intrinsics)}",
        f"  distortion_model: {distortion}", f"  distortion_coeffs: {_listed(coefficients)}",
        f"  resolution: {_listed(calibration.size_px)}", "  rostopic: /cam0/image_raw", ""])


def _listed(values):
    return f"[{', '.join(map(repr, values))}]"
