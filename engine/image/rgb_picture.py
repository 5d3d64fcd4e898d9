"""Plain RGB pictures by any renderer: linear light in three channels, upsampled to spectral radiance."""

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ImageError, InputError
from ..spectral.colour import light_basis
from ..spectral.spectra import BAND_NM
from ..values import Value
from .primaries import chromaticities, to_rec709_matrix
from .spectral_exr import read_parts
from .spectral_image import SpectralImage

MAIN_LAYERS = ("combined", "rgba", "rgb", "beauty")  # what programs call the picture among its passes
GREYS = ("Y", "V")  # luminance in OpenEXR, and what Blender writes for black and white
LARGEST_FRAME_PX = 65536


@dataclass(frozen=True, eq=False, repr=False)
class RgbPicture(Value):
    """A linear picture, as a pinhole camera sees the scene.

    Attributes
    ----------
    rec709 : float32 array (row, column, 3)
        Linear Rec. 709 in Blender's scale; row 0 is the top. The frame in the middle, overscan around it.
    overscan_px : (int, int)
        Rows and columns beyond the frame on each side.
    layer : str
        The layer of the file that it was; "" where that has no name.
    """

    rec709: np.ndarray
    overscan_px: tuple[int, int]
    layer: str

    @property
    def frame_px(self) -> tuple[int, int]:
        """Rows and columns of the frame."""
        return self.rec709.shape[0] - 2 * self.overscan_px[0], self.rec709.shape[1] - 2 * self.overscan_px[1]


def read_rgb_exr(path: str | os.PathLike, layer: str | None = None) -> RgbPicture:
    """Read a plain EXR: R, G and B, or Y alone, of half or single precision, in one part or several.

    The frame is the display window: pixels of it that a trimmed data window lacks are black, those beyond it overscan.
    So every frame of a sequence lies on the same grid. Transparency is left aside: colours are over black as they are.

    Parameters
    ----------
    path : path
    layer : str, optional
        Such as "ViewLayer.Combined"; by default the one without a name, or that of a usual name, or the only one.

    Returns
    -------
    RgbPicture

    Raises
    ------
    ImageError
        No EXR, no colours, several layers to choose from, an unknown colour space, or pixels that are not square.
    """
    parts = read_parts(path)
    try:
        layers = _layers(parts)
        if not layers:
            names = sorted(name for _, channels in parts for name in channels)
            raise ImageError(path, "channels", ", ".join(names),
                             "expected R, G and B, or Y, or spectral channels such as S0.550,000000nm")
        layer = _choose(layers, layer)
        header, planes = layers[layer]
        header = parts[0][0] | header  # what parts share need only be told once
        rec709, overscan = _lay_out(planes, header)
        matrix = to_rec709_matrix(chromaticities(header))
    except ImageError as error:
        raise error.at(path) from None
    if matrix is not None:
        with np.errstate(invalid="ignore", over="ignore"):  # pixels that are not finite are told of where they are used
            rec709 = rec709 @ matrix.T.astype(np.float32)
    return RgbPicture(rec709, overscan, layer)


def _layers(parts):
    """{layer: (header, three planes)} of what a file's parts hold of colour or, where there is none, of greys."""
    colours, greys = {}, {}
    for header, channels in parts:
        components = {}
        for name, plane in channels.items():
            if getattr(plane, "dtype", None) in (np.float16, np.float32) and plane.ndim == 2:
                layer, _, component = name.rpartition(".")
                layer = layer or (header.get("name", "") if len(parts) > 1 else "")
                components.setdefault(layer, {})[component.upper()] = plane
        for layer, planes in components.items():
            if {"R", "G", "B"} <= planes.keys():
                colours.setdefault(layer, (header, [planes[name] for name in "RGB"]))
            elif len(planes.keys() - {"A"}) == 1 and (grey := planes.keys() & set(GREYS)):
                greys.setdefault(layer, (header, [planes[grey.pop()]] * 3))
    return colours or greys


def _choose(layers, wanted):
    """The name of the layer that is the picture."""
    main = [name for name in layers if name.rpartition(".")[2].lower() in MAIN_LAYERS] or list(layers)
    if wanted is None:
        if "" in layers or len(main) == 1:
            return "" if "" in layers else main[0]
        raise ImageError("image", "layers", ", ".join(main), "name one of them as the layer that is the picture")
    if wanted not in layers:
        names = ", ".join(name or "without a name" for name in layers)
        raise ImageError("image", "layers", names, f"there is none called {wanted!r}")
    return wanted


def _lay_out(planes, header):
    """The planes as array (row, column, 3) on the display window, and the overscan on each side of it."""
    (data_left, data_top), (data_right, data_bottom) = np.array(header["dataWindow"], dtype=int)
    (left, top), (right, bottom) = np.array(header["displayWindow"], dtype=int)
    frame = int(bottom - top + 1), int(right - left + 1)
    overscan = (int(max(0, top - data_top, data_bottom - bottom)), int(max(0, left - data_left, data_right - right)))
    if max(frame) > LARGEST_FRAME_PX or any(margin > n for margin, n in zip(overscan, frame, strict=True)):
        raise ImageError("image", "dataWindow", f"{overscan} px beyond a display window of {frame}",
                         f"expected no more overscan than there is frame, of up to {LARGEST_FRAME_PX} px")
    aspect = header.get("pixelAspectRatio", 1.0)
    if abs(aspect - 1) > 1e-4:
        raise ImageError("image", "pixelAspectRatio", float(aspect), "expected square pixels")
    laid = np.zeros((frame[0] + 2 * overscan[0], frame[1] + 2 * overscan[1], 3), dtype=np.float32)
    first_row, first_column = data_top - top + overscan[0], data_left - left + overscan[1]
    for channel, plane in enumerate(planes):
        if plane.shape != (data_bottom - data_top + 1, data_right - data_left + 1):
            raise ImageError("image", "channel", f"of {plane.shape} px", "expected every pixel of the data window")
        laid[first_row:first_row + plane.shape[0], first_column:first_column + plane.shape[1], channel] = plane
    return laid, overscan


def upsample(picture: RgbPicture, wavelengths_nm: ArrayLike, pitch_um: float) -> tuple[SpectralImage, float]:
    """Spectral radiance of a picture, every colour taken for a light (`light_basis`).

    No light is negative: where a colour outside Rec. 709 comes out so at a wavelength, it is black there.

    Parameters
    ----------
    picture : RgbPicture
    wavelengths_nm : ascending sequence of float
    pitch_um : float
        Pixel pitch at the sensor; see `pitch`.

    Returns
    -------
    SpectralImage
    negative : float
        The light that was negative, as a fraction of the rest.

    Raises
    ------
    InputError
        A wavelength at which D65 is not known.
    """
    wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
    for nm in wavelengths_nm:
        if not BAND_NM[0] <= nm <= BAND_NM[1]:
            raise InputError("options", "wavelength", f"{nm:g} nm",
                             "colours reach from {:g} to {:g} nm".format(*BAND_NM))
    cube = np.empty((len(wavelengths_nm), *picture.rec709.shape[:2]), dtype=np.float32)
    lost = kept = 0.0
    with np.errstate(invalid="ignore", over="ignore"):
        for plane, shares in zip(cube, light_basis(wavelengths_nm).astype(np.float32), strict=True):
            np.matmul(picture.rec709, shares, out=plane)
            negative = (plane < 0) & (plane > -np.inf)
            lost -= plane[negative].sum(dtype=np.float64)
            plane[negative] = 0
            kept += plane.sum(dtype=np.float64, where=np.isfinite(plane))
    image = SpectralImage(cube, wavelengths_nm, pitch_um=pitch_um, overscan_px=picture.overscan_px)
    return image, lost / kept if kept else 0.0
