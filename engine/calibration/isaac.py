"""A camera for Isaac Sim and other programs of Omniverse, in USD, with a lens distortion by NVIDIA's schemas:
https://docs.omniverse.nvidia.com/kit/docs/omni.usd.schema.omni_lens_distortion/latest/Overview.html

The middle of the upper left pixel is at 0.5, 0.5. Lengths are in mm: USD counts them in tenths of the stage's unit, a
centimetre. The angle of f-theta's polynomial is in radians, its radius in pixels, and `maxFov` in degrees from edge to
edge.
"""

from collections.abc import Sequence
from typing import Any

from .fit import Calibration
from .models import FTHETA
from .views import View, origin

PINHOLE = "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"
FISHEYE = "k1", "k2", "k3", "k4"
SCHEMAS = {"opencvPinhole": "OpenCvPinhole", "opencvFisheye": "OpenCvFisheye", "ftheta": "Ftheta"}
M_PER_UNIT = 0.01
Attributes = list[tuple[str, str, Any]]
"""Types, names and values."""


def isaac_text(views: Sequence[View]) -> str:
    """The file with one camera, whose aperture is the frame on the lens's sensor."""
    calibration, = (view.calibration for view in views)
    (columns, rows), pitch_mm = calibration.size_px, calibration.frame.pitch_um * 1e-3
    model, attributes = (_ftheta if calibration.model is FTHETA else _opencv)(calibration)
    return "\n".join([
        "#usda 1.0", f"# {origin(calibration)}", "(", '    defaultPrim = "Camera"', f"    metersPerUnit = {M_PER_UNIT}",
        ")", "", 'def Camera "Camera" (',
        f'    prepend apiSchemas = ["OmniLensDistortion{SCHEMAS[model]}API"]', ")", "{",
        f"    float focalLength = {calibration.focal_px[1] * pitch_mm!r}",
        f"    float horizontalAperture = {columns * pitch_mm!r}", f"    float verticalAperture = {rows * pitch_mm!r}",
        f'    token omni:lensdistortion:model = "{model}"',
        *(f"    {kind} omni:lensdistortion:{model}:{name} = {value!r}" for kind, name, value in attributes), "}", ""])


def _opencv(calibration: Calibration) -> tuple[str, Attributes]:
    model, names = ("opencvFisheye", FISHEYE) if calibration.model.fisheye else ("opencvPinhole", PINHOLE)
    (fx, fy), (cx, cy) = calibration.focal_px, calibration.principal_px
    values = {"cx": cx + 0.5, "cy": cy + 0.5, "fx": fx, "fy": fy} | dict(
        zip(names, calibration.opencv_coefficients(len(names)), strict=True))
    return model, [("int2", "imageSize", calibration.size_px), *(("float", *each) for each in values.items())]


def _ftheta(calibration: Calibration) -> tuple[str, Attributes]:
    (columns, rows), (cx, cy) = calibration.size_px, calibration.principal_px
    polynomial = [value / calibration.focal_px[0]**power
                  for power, value in enumerate((0.0, 1.0, *calibration.coefficients))]
    return "ftheta", [
        ("float", "nominalWidth", columns), ("float", "nominalHeight", rows),
        ("float2", "opticalCenter", (cx + 0.5, cy + 0.5)), ("float", "maxFov", 2 * calibration.largest_angle_deg),
        *(("float", f"k{power}", value) for power, value in enumerate(polynomial))]
