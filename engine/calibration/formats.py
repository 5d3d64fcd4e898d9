"""The programs that calibrations can be written for, and the models that each of their files can express."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

from ..image.pixel_grid import PixelGrid
from ..lens import Lens
from ..runtime.errors import InputError
from .colmap import colmap_text
from .fit import Calibration, calibrate
from .gyroflow import gyroflow_text
from .isaac import isaac_text
from .kalibr import kalibr_text
from .lensfun import lensfun_text
from .models import (
    BROWN_CONRADY,
    DOUBLE_SPHERE,
    KANNALA_BRANDT,
    PINHOLE,
    POLY3,
    POLY5,
    PTLENS,
    RADIAL,
    RADTAN,
    RATIONAL,
    THIN_PRISM,
    UNDISTORTING,
    Model,
)
from .nerfstudio import nerfstudio_text
from .opencv import opencv_text
from .openlensio import openlensio_text
from .rays import frame_rays
from .ros import ros_text
from .views import View

OPTION = "--for"


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes
    ----------
    title : str
        The program, and its name for the file.
    suffix : str
    models : tuple of Model
        From the simplest.
    text : function (views) -> str
        The contents of a file.
    poses : bool
        Whether it contains the cameras of several frames, and their places.
    """

    title: str
    suffix: str
    models: tuple[Model, ...]
    text: Callable[[Sequence[View]], str]
    poses: bool = False


SHORT = PINHOLE, *RADIAL[:2], RADTAN
POLYNOMIALS = *SHORT, RADIAL[2], BROWN_CONRADY
FORMATS = {
    "opencv": Format("OpenCV's FileStorage", ".yml", (*POLYNOMIALS, RATIONAL, THIN_PRISM, KANNALA_BRANDT), opencv_text),
    "colmap": Format("COLMAP's cameras.txt", ".txt", (*POLYNOMIALS, RATIONAL, KANNALA_BRANDT), colmap_text),
    "nerfstudio": Format("nerfstudio's transforms.json", ".json", (*POLYNOMIALS, KANNALA_BRANDT), nerfstudio_text,
                         poses=True),
    "kalibr": Format("Kalibr's camchain.yaml", ".yaml", (*SHORT, KANNALA_BRANDT, DOUBLE_SPHERE), kalibr_text),
    "ros": Format("ROS's camera_info", ".yaml", (*POLYNOMIALS, RATIONAL, KANNALA_BRANDT), ros_text),
    "isaac": Format("a USD camera of Isaac Sim", ".usda", (*POLYNOMIALS, RATIONAL, THIN_PRISM, KANNALA_BRANDT),
                    isaac_text),
    "openlensio": Format("OpenTrackIO with OpenLensIO", ".json", UNDISTORTING, openlensio_text),
    "lensfun": Format("Lensfun's database", ".xml", (POLY3, POLY5, PTLENS), lensfun_text),
    "gyroflow": Format("Gyroflow's lens profile", ".json", (KANNALA_BRANDT,), gyroflow_text),
}


def check_model(name: str, model: str | None) -> None:
    """Raise an InputError if a format lacks the requested model, if any."""
    names = [each.name for each in FORMATS[name].models]
    if model is not None and model not in names:
        raise InputError("options", "--model", model, f"--for {name} has {', '.join(names)}")


@lru_cache(maxsize=4)  # the frames of an animation mostly share a lens
def calibrated_for(name: str, lens: Lens, frame: PixelGrid, wavelength_nm: float, model: str | None = None
                   ) -> Calibration:
    """The calibration of a lens for a format.

    Parameters
    ----------
    name : str
        A key of FORMATS.
    lens : Lens
    frame : PixelGrid
        Without overscan.
    wavelength_nm : float
    model : str, optional
        Its model; by default, the simplest that fits.

    Raises
    ------
    InputError
        The format lacks this model, or any that describes this lens.
    LensError
        As `frame_rays`.
    """
    return calibrate(lens, frame, wavelength_nm, _suitable(name, lens, frame, wavelength_nm, model))


def _suitable(name, lens, frame, wavelength_nm, requested):
    """The models of a format for a lens: only those of fisheyes for a fisheye, and only the requested one, if any."""
    check_model(name, requested)
    rays, models = frame_rays(lens, frame, wavelength_nm), FORMATS[name].models
    able = [model for model in models if model.fisheye or not rays.fisheye]
    where = f"{lens.name} is a fisheye here, with a distortion of {rays.distortion:.0%}"
    if not able:
        others = [other for other, form in FORMATS.items() if any(model.fisheye for model in form.models)]
        raise InputError("options", OPTION, name, f"{where}: use {', '.join(others)}")
    if requested is None:
        return able
    if requested not in (names := [model.name for model in able]):
        raise InputError("options", "--model", requested, f"{where}: use {', '.join(names)}")
    return [model for model in able if model.name == requested]
