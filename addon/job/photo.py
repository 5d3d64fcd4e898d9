"""The camera of a job: its raw picture of the lens image, and the developed one."""

from dataclasses import dataclass, replace

import numpy as np

from lensfield.engine import load_camera, photograph
from lensfield.engine.photo.photograph import CameraFacts, held, missing_channels, missing_text
from lensfield.engine.photo.raw_file import write_raw_file
from lensfield.engine.pictures.develop import check_demosaicable, developed_in
from lensfield.engine.pictures.dng import check_channels
from lensfield.engine.pictures.preview import auto_exposure, to_rec709
from lensfield.engine.sensor.exposure import FRAMES, covered_px
from lensfield.engine.sensor.metering import developed_white, metered_rec709, usual_exposure

DEVELOPED_EXPOSURE = 1.0  # of a developed picture: white is where the camera saturates


@dataclass(frozen=True)
class ShownExposure:
    """The exposure that a picture of a preview has, or that a camera's meter chooses for it."""

    shutter_s: float
    iso: float


def chosen_camera(request):
    """The Camera of a request, "" without one.

    Raises
    ------
    CameraError
        It is unknown, or its file is damaged.
    """
    return load_camera(request.camera) if request.camera else ""


def check_photo(request, grid):
    """Raise an InputError unless a request's camera can take, develop and write a picture of a lens image on this
    PixelGrid."""
    camera = chosen_camera(request)
    if not camera:
        return
    camera = held(camera, grid.frame_px)
    usual_exposure(camera, request.iso or None, request.shutter_s or None)
    if request.dng or request.develop:
        check_channels(camera)
    if request.develop:
        check_demosaicable(camera, covered_px(grid, camera), grid.pitch_um)


def camera_words(request):
    """What users should know about a request's camera before the render: list of lines."""
    camera = chosen_camera(request)
    line = missing_text(missing_channels(camera, request.wavelengths_nm)) if camera else ""
    return [line] if line else []


def take_photo(request, irradiance, lens, result):
    """Take a picture of the lens image with a request's camera, and write its raw file if it is requested.

    Parameters
    ----------
    request : RenderRequest
    irradiance : SpectralImage
    lens : Lens
    result : Result

    Returns
    -------
    RawImage
    """
    shutter_s, iso = request.exposure
    raw = photograph(irradiance, chosen_camera(request), iso, shutter_s, report=result.report, noise=request.noise,
                     frame=result.frame % FRAMES)
    facts = replace(result.report.parts.of(CameraFacts), metered=not (request.iso and request.shutter_s))
    if request.dng:
        facts = replace(facts, uncorrected=tuple(write_raw_file(raw, irradiance, result.raw, lens)))
        result.report.files["raw"] = str(result.raw)
    result.report.add(facts)
    return raw


def exposed(request, irradiance):
    """A lens image in linear Rec. 709 (row, column, 3) and its ShownExposure: as the request's camera develops it, but
    without noise and with the colours of the eye. As it is, and None, without a camera.

    Parameters
    ----------
    request : RenderRequest
    irradiance : SpectralImage
    """
    picture, camera = to_rec709(irradiance), chosen_camera(request)
    if not camera:
        return picture, None
    f_number, light = irradiance.f_number_effective, to_rec709(replace(irradiance, exposure=1.0))
    exposure = metered_rec709(light, camera, f_number, request.iso or None, request.shutter_s or None)
    if request.develop:
        picture = np.minimum(developed_white(camera, exposure, f_number) * light, 1, dtype=np.float32)
    return picture, ShownExposure(exposure.shutter_s, exposure.iso)


def shown_picture(request, irradiance, raw):
    """The lens image as pictures show it: linear Rec. 709 (row, column, 3), its exposure in PNGs, and the light's.

    Parameters
    ----------
    request : RenderRequest
    irradiance : SpectralImage
    raw : RawImage or None
    """
    light = to_rec709(irradiance)
    exposure = auto_exposure(light)
    if raw is None or not request.develop:
        return light, exposure, exposure
    return developed_in(raw, irradiance.frame_px, irradiance.pitch_um), DEVELOPED_EXPOSURE, exposure
