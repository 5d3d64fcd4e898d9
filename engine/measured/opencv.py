"""Calibrations by OpenCV's models: its own FileStorage, ROS, Kalibr and nerfstudio.

The middle of the upper left pixel is at 0, 0, except for nerfstudio, where it is at 0.5, 0.5.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..calibration.models import (
    BROWN_CONRADY,
    DOUBLE_SPHERE,
    KANNALA_BRANDT,
    PINHOLE,
    RADTAN,
    RATIONAL,
    THIN_PRISM,
    Model,
)
from ..runtime.errors import LensError
from ..runtime.toml_fields import TomlTable
from .camera import ModelledCamera
from .documents import matrix, read_fields, size_in, table_at
from .options import MeasuredOptions

PINHOLES = PINHOLE, RADTAN, BROWN_CONRADY, RATIONAL, THIN_PRISM
MATRIX = "camera_matrix", "cameramatrix", "intrinsic_matrix", "mtx", "k", "m", "m1"
COEFFICIENTS = "distortion_coefficients", "distcoeffs", "dist_coeffs", "dist", "d", "d1"
SIZES = ("image_width", "image_height"), ("width", "height")
FISHEYE = "opencv-fisheye"


def pinhole_camera(where: object, coefficients: Sequence[float]) -> tuple[Model, tuple[float, ...]]:
    """The model of OpenCV's coefficients k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty.

    Raises
    ------
    LensError
        There are more than these, or the sensor is tilted by the last two.
    """
    values = tuple(map(float, coefficients))
    if len(values) > 14 or any(values[12:]):
        raise LensError(where, "distortion coefficients", f"{len(values)} numbers",
                        "expected at most 12, and 0 for a tilted sensor's tx and ty")
    model = next(each for each in PINHOLES if len(each.coefficients) >= min(len(values), 12))
    return model, (*values[:12], *(0.0,) * (len(model.coefficients) - len(values)))


def fisheye_camera(where: object, coefficients: Sequence[float]) -> tuple[Model, tuple[float, ...]]:
    """The model of the coefficients k1 k2 k3 k4 of OpenCV's fisheye.

    Raises
    ------
    LensError
        There are other than four.
    """
    if len(coefficients) != 4:
        raise LensError(where, "distortion coefficients", f"{len(coefficients)} numbers",
                        "expected the four of a fisheye")
    return KANNALA_BRANDT, tuple(map(float, coefficients))


def read_opencv(path: Path, options: MeasuredOptions) -> ModelledCamera:
    """The camera in a file of `cv2.FileStorage`: YAML, XML or JSON.

    The file states by `camera_model` or `fisheye_model` whether it is a fisheye. Names of fields differ between
    programs; several common ones are known.
    """
    return _read_opencv(path, options, fisheye=None)


def read_opencv_fisheye(path: Path, options: MeasuredOptions) -> ModelledCamera:
    """As `read_opencv`, for coefficients of `cv2.fisheye`, whatever the file states."""
    return _read_opencv(path, options, fisheye=True)


def _read_opencv(path, options, fisheye):
    table = read_fields(path)
    names = {name.lower().replace(" ", "_"): name for name in table.values}
    lens = _field(table, names, MATRIX), _field(table, names, COEFFICIENTS)
    if fisheye is None:
        fisheye = table.values.get(names.get("camera_model", "")) == "fisheye" or bool(
            table.values.get(names.get("fisheye_model", "")))
    size_px = next((size_in(table, (names[width], names[height])) for width, height in SIZES
                    if width in names and height in names), options.size_px)
    if size_px is None:
        raise LensError(path, SIZES[0][0], "missing", "give the size of the pictures: --resolution 1920x1080")
    return _camera(path, "OpenCV", size_px, matrix(table, lens[0], (3, 3)), matrix(table, lens[1]), fisheye)


def _field(table, names, known):
    return next((names[name] for name in known if name in names), known[0])


def _camera(path, program, size_px, camera, coefficients, fisheye):
    """The camera of a matrix and coefficients."""
    focal_px, principal_px = intrinsics(path, camera)
    model, values = (fisheye_camera if fisheye else pinhole_camera)(path, coefficients)
    return ModelledCamera(path.stem, _program(program, model), size_px, focal_px, principal_px, model, values)


def intrinsics(where: object, camera: np.ndarray) -> tuple[tuple[float, float], tuple[float, float]]:
    """fx and fy, cx and cy of OpenCV's camera matrix (3, 3).

    Raises
    ------
    LensError
        It is skewed, or no camera matrix.
    """
    (fx, skew, cx), (lower, fy, cy), last = camera.tolist()
    if skew or lower or last != [0, 0, 1]:
        raise LensError(where, "camera matrix", camera.tolist(), "expected fx 0 cx, 0 fy cy, 0 0 1")
    return (fx, fy), (cx, cy)


def _program(program, model):
    return f"{program}: {model.name}"


def read_ros(path: Path, options: MeasuredOptions) -> ModelledCamera:
    """The camera in ROS's camera_info YAML."""
    table = read_fields(path)
    kind = table.choice("distortion_model", ("plumb_bob", "rational_polynomial", "equidistant", "fisheye"))
    return _camera(path, "ROS", size_in(table, SIZES[0]), matrix(table, "camera_matrix", (3, 3)),
                   matrix(table, "distortion_coefficients"), kind in ("equidistant", "fisheye"))


def read_kalibr(path: Path, options: MeasuredOptions) -> ModelledCamera:
    """A camera in Kalibr's camchain.yaml."""
    chain = read_fields(path)
    table = table_at(chain, options.chosen(path, [name for name, value in chain.values.items()
                                                  if isinstance(value, dict)], "camera"))
    sphere = table.choice("camera_model", ("pinhole", "ds")) == "ds"
    *shape, fx, fy, cx, cy = table.numbers("intrinsics", 6 if sphere else 4)
    columns, rows = (int(side) for side in matrix(table, "resolution", (2,)))
    kind = table.choice("distortion_model", ("none",) if sphere else ("none", "radtan", "equidistant"))
    if sphere:
        model, values = DOUBLE_SPHERE, tuple(shape)
    elif kind == "none":
        model, values = PINHOLE, ()
    else:
        read = fisheye_camera if kind == "equidistant" else pinhole_camera
        model, values = read(path, table.numbers("distortion_coeffs", 4))
    return ModelledCamera(path.stem, _program("Kalibr", model), (columns, rows), (fx, fy), (cx, cy), model, values)


def read_nerfstudio(path: Path, options: MeasuredOptions) -> ModelledCamera:
    """The camera in nerfstudio's transforms.json; of the frame whose `file_path` is named, if frames differ."""
    table = read_fields(path)
    if "fl_x" not in table:
        table = _frame(table, options)
    kind = table.text("camera_model", "OPENCV")
    if kind not in ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "OPENCV_FISHEYE"):
        raise table.refusal("camera_model", "expected OPENCV, PINHOLE or OPENCV_FISHEYE")
    fisheye = kind == "OPENCV_FISHEYE"
    for further in () if fisheye else ("k4", "k5", "k6"):
        if table.number(further, 0.0):
            raise table.refusal(further, "expected 0: programs disagree about its meaning")
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    model, values = (fisheye_camera if fisheye else pinhole_camera)(path, [table.number(name, 0.0) for name in names])
    fx = table.number("fl_x")
    return ModelledCamera(
        path.stem, _program("nerfstudio", model), size_in(table, ("w", "h")), (fx, table.number("fl_y", fx)),
        (table.number("cx") - 0.5, table.number("cy") - 0.5), model, values)


def _frame(table, options):
    frames = table.values.get("frames")
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise table.refusal("fl_x", "expected focal lengths at the top of the file or in each frame")
    by_name = {str(frame.get("file_path")): frame for frame in frames}
    name = options.chosen(table.path, list(by_name), "frame")
    top = {field: value for field, value in table.values.items() if field != "frames"}
    return TomlTable(table.path, top | by_name[name], f"frame {name}, ")
