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
    FISHEYE_POLY5,
    FTHETA,
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
    on_request : tuple of Model
        Further models, which are used only if they are requested.
    """

    title: str
    suffix: str
    models: tuple[Model, ...]
    text: Callable[[Sequence[View]], str]
    poses: bool = False
    on_request: tuple[Model, ...] = ()

    @property
    def all_models(self) -> tuple[Model, ...]:
        """Also those on request."""
        return *self.models, *self.on_request


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
                    isaac_text, on_request=(FTHETA,)),
    "openlensio": Format("OpenTrackIO with OpenLensIO", ".json", UNDISTORTING, openlensio_text),
    "lensfun": Format("Lensfun's database", ".xml", (POLY3, POLY5, PTLENS, *FISHEYE_POLY5), lensfun_text),
    "gyroflow": Format("Gyroflow's lens profile", ".json", (KANNALA_BRANDT,), gyroflow_text),
}


def check_model(name: str, model: str | None) -> None:
    """Raise an InputError if a format lacks the requested model, if any."""
    names = [each.name for each in FORMATS[name].all_models]
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


def calibrated_alike(name: str, cameras: Sequence[tuple[Lens, PixelGrid, float]], model: str | None = None
                     ) -> list[Calibration]:
    """The calibrations of several lenses, frames and wavelengths in nm for a format, as by `calibrated_for`: all by
    models of fisheyes if one of them needs such a model, because a file states the kind once."""
    fits = [calibrated_for(name, *camera, model) for camera in cameras]
    kinds = {fit.model.fisheye for fit in fits}
    if len(kinds) == 1:
        return fits
    wide = next(fit.model.name for fit in fits if fit.model.fisheye)
    return [fit if fit.model.fisheye else calibrated_for(name, *camera, wide)
            for fit, camera in zip(fits, cameras, strict=True)]


def _suitable(name, lens, frame, wavelength_nm, requested):
    """The models of a format that can describe a lens; only the requested one, if any."""
    check_model(name, requested)
    kind, able = _kind(lens, frame_rays(lens, frame, wavelength_nm))
    models = [model for model in FORMATS[name].models if able(model)]
    if not models:
        others = [other for other, form in FORMATS.items() if any(map(able, form.models))]
        raise InputError("options", OPTION, name, f"{lens.name} is {kind}: use {', '.join(others)}")
    if requested is None:
        return models
    by_name = {model.name: model for model in FORMATS[name].all_models if able(model)}
    if requested not in by_name:
        raise InputError("options", "--model", requested, f"{lens.name} is {kind}: use {', '.join(by_name)}")
    return [by_name[requested]]


def _kind(lens, rays):
    """The kind of a lens, in words, and whether a model can describe it, as a function."""
    if rays.fisheye:
        return f"a fisheye here, with a distortion of {rays.distortion:.0%}", lambda model: model.fisheye
    if lens.squeeze != 1:
        return f"anamorphic, with a squeeze of {lens.squeeze:.3g}", lambda model: not model.one_focal
    return "an ordinary lens", lambda model: True
