"""Gyroflow's lens profile, as Gyroflow itself reads it (src/core/lens_profile.rs and stabilization/frame_transform.rs).

The middle of the upper left pixel is at 0, 0. A profile describes the picture after its stretch; the lens that is read
is in front of the picture as recorded, before it.
"""

from pathlib import Path

from ..calibration.models import PINHOLE
from .camera import ModelledCamera
from .documents import matrix, read_fields, size_in, table_at
from .opencv import fisheye_camera, intrinsics
from .options import MeasuredOptions

LEAST_STRETCH = 0.01  # smaller values mean no stretch


def read_gyroflow(path: Path, options: MeasuredOptions) -> ModelledCamera:
    """The camera in Gyroflow's lens profile.

    Raises
    ------
    LensError
        A field is missing or damaged, or the profile has another model than the usual one, or a digital lens.
    """
    table = read_fields(path)
    if table.values.get("distortion_model") not in (None, "", "opencv_fisheye"):
        raise table.refusal("distortion_model", "expected opencv_fisheye, Gyroflow's usual model")
    if table.values.get("digital_lens"):
        raise table.refusal("digital_lens", "expected none: a profile of the optical picture")
    parameters = table_at(table, "fisheye_params")
    columns, rows = size_in(table_at(table, "calib_dimension"), ("w", "h"))
    recorded_px = round(columns / _stretch(table, "horizontal")), round(rows / _stretch(table, "vertical"))
    across, down = recorded_px[0] / columns, recorded_px[1] / rows
    (fx, fy), (cx, cy) = intrinsics(path, matrix(parameters, "camera_matrix", (3, 3)))
    if not table.flag("asymmetrical"):
        cx, cy = columns / 2, rows / 2
    crop = 1.0 if table.values.get("crop") is None else table.number("crop")
    model, values = fisheye_camera(path, matrix(parameters, "distortion_coeffs").tolist())
    if not any(values):
        model, values = PINHOLE, ()
    return ModelledCamera(path.stem, f"Gyroflow: {model.name}", recorded_px, (fx * across / crop, fy * down / crop),
                          (cx * across, cy * down), model, values)


def _stretch(table, direction):
    stretch = table.number(f"input_{direction}_stretch", 1.0)
    return stretch if stretch > LEAST_STRETCH else 1.0
