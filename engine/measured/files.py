"""Files with the measured distortion of a lens: their kinds, and the lens in each."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ..lens import Lens
from ..library import LensSource, fits_all_frames, load_lens
from ..rays.rings import Rings
from ..runtime.errors import LensError
from ..runtime.inputs import check_input, reading
from .blur import SYMMETRIC, WAVELENGTHS_NM, Blur, Designed, Diffraction
from .camera import Measured
from .colmap import read_colmap
from .documents import OPENCV_ROOT, read_fields, read_xml
from .gyroflow import read_gyroflow
from .lens import measured_lens
from .lensfun import read_lensfun
from .opencv import (
    COEFFICIENTS,
    MATRIX,
    read_kalibr,
    read_nerfstudio,
    read_opencv,
    read_opencv_fisheye,
    read_ros,
)
from .options import MeasuredOptions
from .stmap import direction_of, read_distort, read_undistort

DEFAULT_WIDTH_MM = 36.0  # as of Blender's cameras


class Kind(NamedTuple):
    """A kind of file.

    Attributes
    ----------
    title : str
    read : function (path, options) -> Measured
    takes : tuple of str
        Names of the options that not all kinds take.
    """

    title: str
    read: Callable[[Path, MeasuredOptions], Measured]
    takes: tuple[str, ...] = ()


OF_SEVERAL, OF_STMAPS = ("which",), ("focal_mm", "overscan")
KINDS = {
    "opencv": Kind("OpenCV's FileStorage, in YAML, XML or JSON", read_opencv),
    "opencv-fisheye": Kind("the same, of cv2.fisheye", read_opencv_fisheye),
    "colmap": Kind("COLMAP's cameras.txt", read_colmap, OF_SEVERAL),
    "nerfstudio": Kind("nerfstudio's transforms.json", read_nerfstudio, OF_SEVERAL),
    "kalibr": Kind("Kalibr's camchain.yaml", read_kalibr, OF_SEVERAL),
    "ros": Kind("ROS's camera_info", read_ros),
    "gyroflow": Kind("Gyroflow's lens profile", read_gyroflow),
    "lensfun": Kind("Lensfun's database", read_lensfun, ("which", "focal_mm")),
    "stmap-distort": Kind("an STMap that distorts a picture, in EXR", read_distort, OF_STMAPS),
    "stmap-undistort": Kind("an STMap that undistorts a picture, in EXR", read_undistort, OF_STMAPS)}


def read_measured(path: Path, options: MeasuredOptions, kind: str | None = None) -> Measured:
    """The camera in a file of one of KINDS.

    Parameters
    ----------
    path : Path
        A file; or a folder, of Lensfun's database.
    options : MeasuredOptions
    kind : str, optional
        A key of KINDS; by default, the one of the file's contents.

    Raises
    ------
    LensError
        The file is missing or damaged, is of no known kind, or lacks something that the options do not state either.
    InputError
        This kind of file does not take one of the options, or is for pictures of another size.
    """
    if not path.is_dir():
        check_input(path, "file", f"expected one of {', '.join(KINDS)}", error=LensError)
    with reading(path):
        kind = kind or kind_of(path)
        options.check_taken(KINDS[kind].takes, kind)
        try:
            measured = KINDS[kind].read(path, options)
        except (OverflowError, ArithmeticError) as error:
            raise LensError(path, "file", "damaged", str(error)) from None
    options.check_size(measured.size_px)
    return measured


def kind_of(path: Path) -> str:
    """The key of KINDS for a file, by its suffix and contents.

    Raises
    ------
    LensError
        The file is of none, or an STMap whose name says neither that it distorts nor that it undistorts.
    """
    suffix = path.suffix.lower()
    if path.is_dir():
        return "lensfun"
    if suffix == ".exr":
        direction = direction_of(path)
        if direction is None:
            raise LensError(path, "direction", "unknown", "expected distort or undistort in the name of an STMap: use "
                                                         "--as stmap-distort or --as stmap-undistort")
        return f"stmap-{direction}"
    if suffix in (".txt", ".bin"):
        return "colmap"
    if suffix == ".xml":
        return "opencv" if read_xml(path).tag == OPENCV_ROOT else "lensfun"
    if suffix in (".json", ".yml", ".yaml"):
        return _kind_of_fields(read_fields(path).values, path)
    raise LensError(path, "kind of file", suffix or "without a suffix", f"name it with --as: {', '.join(KINDS)}")


def _kind_of_fields(fields, path):
    """The kind of YAML or JSON with these fields."""
    tables = [each for each in fields.values() if isinstance(each, dict)]
    if "fisheye_params" in fields:
        return "gyroflow"
    if "fl_x" in fields or "frames" in fields:
        return "nerfstudio"
    if any("intrinsics" in each for each in tables):
        return "kalibr"
    if "distortion_model" in fields and "camera_matrix" in fields:
        return "ros"
    if any(str(name).lower().replace(" ", "_") in (*MATRIX, *COEFFICIENTS) for name in fields):
        return "opencv"
    raise LensError(path, "kind of file", "unknown", f"name it with --as: {', '.join(KINDS)}")


def blur_rings(options: MeasuredOptions) -> Rings:
    """The settings of the lens whose blur a measured lens has."""
    return Rings(options.focus_mm, options.f_number)


def lens_of(measured: Measured, options: MeasuredOptions, blur: LensSource | None = None,
            progress: Callable[[float, str], object] = lambda fraction, label: None, name: str | None = None) -> Lens:
    """The lens with a measured distortion.

    Parameters
    ----------
    measured : Measured
    options : MeasuredOptions
        The sensor is by default as wide as the file states, or 36 mm.
    blur : LensSource, optional
        A lens with a prescription, whose blur and light it has at this f-number and focus; by default, the blur of
        diffraction and even light.
    progress : function (fraction, label)
        Of the bake of this lens.
    name : str, optional
        A name to use instead of the one in the file.

    Raises
    ------
    LensError
        As `measured_lens` and `load_lens`.
    """
    columns, rows = measured.size_px
    width_mm = measured.width_mm or DEFAULT_WIDTH_MM
    sensor_mm = options.sensor_mm or (width_mm, width_mm * rows / columns)

    rings = blur_rings(options)
    if blur is not None and not fits_all_frames(blur, rings):
        raise LensError(blur, "blur", "without rotational symmetry", SYMMETRIC)

    def blur_at(magnification: float) -> Blur:
        if blur is None:
            return Diffraction(options.f_number, magnification)
        return Designed(load_lens(blur, rings, progress=progress, wavelengths_nm=WAVELENGTHS_NM))

    lens = measured_lens(measured, sensor_mm, options.focus_mm, blur_at)
    return lens if name is None else replace(lens, name=name)
