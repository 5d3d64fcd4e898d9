"""A camera for Isaac Sim and other programs of Omniverse, in USD, with OpenCV's models:
https://docs.omniverse.nvidia.com/kit/docs/omni.usd.schema.omni_lens_distortion/latest/Overview.html

The middle of the upper left pixel is at 0.5, 0.5. Lengths are in mm, the tenth of a unit of a stage in cm.
"""

from collections.abc import Sequence

from .views import View, origin

PINHOLE = "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"
FISHEYE = "k1", "k2", "k3", "k4"
M_PER_UNIT = 0.01


def isaac_text(views: Sequence[View]) -> str:
    """The file with one camera, whose aperture is the frame on the lens's sensor."""
    calibration, = (view.calibration for view in views)
    (columns, rows), (fx, fy), (cx, cy) = calibration.size_px, calibration.focal_px, calibration.principal_px
    schema, names = ("OpenCvFisheye", FISHEYE) if calibration.model.fisheye else ("OpenCvPinhole", PINHOLE)
    model = f"opencv{schema[6:]}"
    values = {"cx": cx + 0.5, "cy": cy + 0.5, "fx": fx, "fy": fy} | dict(
        zip(names, calibration.opencv_coefficients(len(names)), strict=True))
    pitch_mm = calibration.frame.pitch_um * 1e-3
    return "\n".join([
        "#usda 1.0", f"# {origin(calibration)}", "(", '    defaultPrim = "Camera"', f"    metersPerUnit = {M_PER_UNIT}",
        ")", "", 'def Camera "Camera" (',
        f'    prepend apiSchemas = ["OmniLensDistortion{schema}API"]', ")", "{",
        f"    float focalLength = {fy * pitch_mm!r}",
        f"    float horizontalAperture = {columns * pitch_mm!r}", f"    float verticalAperture = {rows * pitch_mm!r}",
        f'    token omni:lensdistortion:model = "{model}"',
        f"    int2 omni:lensdistortion:{model}:imageSize = ({columns}, {rows})",
        *(f"    float omni:lensdistortion:{model}:{name} = {value!r}" for name, value in values.items()), "}", ""])
