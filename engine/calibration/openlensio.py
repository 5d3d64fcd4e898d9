"""OpenTrackIO 1.0.1, with the lens model OpenLensIO: https://www.opentrackio.org

Lengths on the sensor are in mm, to the right and downwards. Radial coefficients alternate between the numerator and the
denominator, and OpenCV's coefficients, in focal lengths F, become k / F^2n and p / F. The default model,
Brown-Conrady D-U, leads from distorted to undistorted places. Distances along the axis are in metres. The entrance
pupil's counts from the image plane, towards the object.
"""

import json
import uuid
from collections.abc import Sequence
from typing import Any

import numpy as np

from .fit import Calibration
from .views import View, origin

NUMERATOR, DENOMINATOR = ("k1", "k2", "k3"), ("k4", "k5", "k6")
M_PER_MM = 1e-3
NAMESPACE = uuid.UUID("5d1a9b1c-2f37-5b07-8f1c-6a5d0c2b7e11")  # of samples: equal calibrations have equal names


def openlensio_text(views: Sequence[View]) -> str:
    """A sample with the lens and the sensor of one camera."""
    calibration, = (view.calibration for view in views)
    (columns, rows), pitch_mm = calibration.size_px, calibration.frame.pitch_um * 1e-3
    contents = {
        "static": {
            "camera": {"activeSensorPhysicalDimensions": {"height": rows * pitch_mm, "width": columns * pitch_mm},
                       "activeSensorResolution": {"height": rows, "width": columns}},
            "lens": {"model": " ".join(calibration.lens.split()), "calibrationHistory": [origin(calibration)]}},
        "lens": _lens(calibration, pitch_mm),
        "protocol": {"name": "OpenTrackIO", "version": [1, 0, 1]}}
    name = uuid.uuid5(NAMESPACE, json.dumps(contents))
    return json.dumps(contents | {"sampleId": f"urn:uuid:{name}"}, indent=2) + "\n"


def _lens(calibration: Calibration, pitch_mm: float) -> dict[str, Any]:
    focal_mm = calibration.focal_px[0] * pitch_mm
    coefficients = dict.fromkeys((*NUMERATOR, *DENOMINATOR, "p1", "p2"), 0.0) | calibration.by_name
    radial = [coefficients[name] / focal_mm**(2 * power)
              for power, pair in enumerate(zip(NUMERATOR, DENOMINATOR, strict=True), 1) for name in pair]
    (columns, rows), (cx, cy) = calibration.size_px, calibration.principal_px
    lens: dict[str, Any] = {
        "distortion": [{"model": "Brown-Conrady D-U", "radial": radial,
                        "tangential": [coefficients[name] / focal_mm for name in ("p1", "p2")],
                        "overscan": _overscan(calibration)}],
        "fStop": calibration.f_stop, "pinholeFocalLength": focal_mm,
        "projectionOffset": {"x": (cx - (columns - 1) / 2) * pitch_mm, "y": (cy - (rows - 1) / 2) * pitch_mm}}
    if np.isfinite(calibration.focus_mm):
        lens["focusDistance"] = calibration.focus_mm * M_PER_MM
    if calibration.entrance_pupil_mm is not None:
        lens["entrancePupilOffset"] = calibration.entrance_pupil_mm * M_PER_MM
    return lens


def _overscan(calibration):
    """Width of a centred picture that contains all of the undistorted frame, relative to the width of the frame."""
    columns, rows = calibration.size_px
    left, up, right, down = calibration.overscan_px
    return max(1.0, 1 + 2 * max(left, right) / columns, 1 + 2 * max(up, down) / rows)
