"""Raw files of photographs, with the correction of the lens that took them."""

from ..field.lens_correction import lens_correction
from ..image.spectral_image import SpectralImage
from ..lens.lens import Lens
from ..pictures.dng import MountedLens, write_dng
from ..runtime.errors import ImageError
from ..runtime.files import AnyPath
from ..sensor.colour import channel_weights
from ..sensor.exposure import RawImage, raw_grid


def write_raw_file(raw: RawImage, irradiance: SpectralImage, path: AnyPath, lens: Lens | None = None) -> list[str]:
    """Write a raw picture as a DNG file that names and corrects its lens.

    Parameters
    ----------
    raw : RawImage
    irradiance : SpectralImage
        Subject of the picture.
    path : path
    lens : Lens, optional
        The lens of the irradiance. Without it, converters cannot straighten the picture, and the file states only the
        name and the f-number of the lens.

    Returns
    -------
    list of str
        Parts that are not corrected.

    Raises
    ------
    ImageError
        The irradiance names another lens.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import Exposure, SpectralImage, expose, load_camera, write_raw_file
    >>> light = SpectralImage(np.full((3, 12, 16), 2e-4), [450, 550, 650], pitch_um=30, quantity="irradiance")
    >>> raw = expose(light, load_camera("sony-a7-iv"), Exposure(shutter_s=1 / 60, iso=100.0))
    >>> write_raw_file(raw, light, "shot.dng")
    []
    """
    if lens is None:
        write_dng(raw, path, MountedLens(irradiance.lens_name, f_number=irradiance.f_number_effective))
        return []
    check_lens(irradiance, lens)
    nm = irradiance.wavelengths_nm
    correction = lens_correction(lens, raw_grid(irradiance.grid, raw.camera), nm, channel_weights(raw.camera, nm))
    write_dng(raw, path, MountedLens(lens.name, lens.efl_mm, lens.f_number_effective), correction)
    return correction.remarks


def check_lens(irradiance: SpectralImage, lens: Lens) -> None:
    """Refuse to correct a lens image for a lens that did not make it.

    Raises
    ------
    ImageError
        The irradiance names another lens.
    """
    if irradiance.lens_name not in ("", lens.name):
        raise ImageError("lens image", "lens", irradiance.lens_name,
                         f"expected {lens.name}, for which the raw file would be corrected")
