"""nerfstudio's transforms.json: https://docs.nerf.studio/quickstart/data_conventions.html

Poses are in the axes of OpenGL and Blender. The middle of the upper left pixel is at 0.5, 0.5.
"""

import json
from collections.abc import Sequence
from typing import Any

from .fit import Calibration
from .views import View, origin


def nerfstudio_text(views: Sequence[View]) -> str:
    """The file with the cameras of all views: with the intrinsics at the top if all share them, else in each frame."""
    cameras = [_camera(view.calibration) for view in views]
    shared = all(camera == cameras[0] for camera in cameras)
    frames = [{"file_path": view.picture, "transform_matrix": view.pose.tolist()} | ({} if shared else camera)
              for view, camera in zip(views, cameras, strict=True) if view.pose is not None]
    worst = max((view.calibration for view in views), key=lambda calibration: calibration.largest_px)
    head: dict[str, Any] = {"origin": origin(worst), "rms_px": worst.rms_px,
                            "largest_px": worst.largest_px}
    return json.dumps(head | (cameras[0] if shared else {"camera_model": cameras[0]["camera_model"]})
                      | {"frames": frames}, indent=2) + "\n"


def _camera(calibration: Calibration):
    (columns, rows), (fx, fy), (cx, cy) = calibration.size_px, calibration.focal_px, calibration.principal_px
    fisheye = calibration.model.fisheye
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    coefficients = calibration.opencv_coefficients(len(names))
    return {"camera_model": "OPENCV_FISHEYE" if fisheye else "OPENCV", "w": columns, "h": rows, "fl_x": fx, "fl_y": fy,
            "cx": cx + 0.5, "cy": cy + 0.5} | dict(zip(names, coefficients, strict=True))
