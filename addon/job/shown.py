"""Pictures as they are shown: in the look of the scene, or in plain sRGB with an exposure of their own."""

import numpy as np

from lensfield.engine.image.irradiance import irradiance_per_radiance
from lensfield.engine.pictures.preview import auto_exposure, save_png, srgb_pixels, to_rec709
from lensfield.engine.spectral.colour import REC709_LUMINANCE, rec709_weights

from ...request import BY_SCENE
from ..scene.look import look_from, shown_pixels

LOOK = "lensfield:look"  # attribute of a radiance file


def look_for(request):
    """The Look of a request's pictures; None for sRGB."""
    return look_from(request.view_settings, "options") if request.look == BY_SCENE and request.view_settings else None


def pixels_of(rec709, exposure, look):
    """A linear Rec. 709 picture (row, column, 3) in a Look or, for None, in sRGB at an exposure: uint8 array."""
    return shown_pixels(rec709, look) if look else srgb_pixels(rec709, exposure)


def write_shown(rec709, path, exposure, look):
    """Write a picture as of `pixels_of` as a PNG, which appears complete or not at all."""
    save_png(pixels_of(rec709, exposure, look), path)


def write_growing(radiance, complete, job):
    """Write a job's picture of the light so far: grey until all wavelengths are rendered."""
    scale = 1 / irradiance_per_radiance(1.0, job.lens.f_number_effective) if job.traced else 1.0
    picture = scale * (to_rec709(radiance) if complete else _grey(radiance))
    write_shown(picture, job.picture, auto_exposure(picture), look_for(job))


def _grey(radiance):
    """The brightness of light with an even spectrum, as linear Rec. 709 (row, column, 3)."""
    luminance = (rec709_weights(radiance.wavelengths_nm) @ REC709_LUMINANCE).sum() * radiance.exposure
    return np.stack([luminance * radiance.cube.mean(axis=0)] * 3, axis=-1)
