"""Raw files of photographs, with the correction of the lens that took them."""

from ..field.lens_correction import lens_correction
from ..image.spectral_image import SpectralImage
from ..lens.lens import Lens
from ..pictures.dng import MountedLens, write_dng
from ..runtime.files import AnyPath
from ..sensor.colour import channel_weights
from ..sensor.exposure import RawImage, raw_grid


def write_raw_file(raw: RawImage, irradiance: SpectralImage, path: AnyPath, lens: Lens | None = None) -> list[str]:
    """Write a raw picture as a DNG file that names and corrects its lens.

    Parameters
    ----------
    raw : RawImage
    irradiance : SpectralImage
        What it is a picture of.
    path : path
    lens : Lens, optional
        The lens of the irradiance; without it, converters cannot straighten the picture.

    Returns
    -------
    list of str
        What is not corrected.
    """
    if lens is None:
        write_dng(raw, path)
        return []
    nm = irradiance.wavelengths_nm
    correction = lens_correction(lens, raw_grid(irradiance.grid, raw.camera), nm, channel_weights(raw.camera, nm))
    write_dng(raw, path, MountedLens(lens.name, lens.efl_mm, lens.f_number_effective), correction)
    return correction.remarks
