"""RGB pictures from any renderer: linear light in three channels, upsampled to spectral radiance."""

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..image.spectral_image import SpectralImage
from ..runtime.errors import ImageError, InputError
from ..runtime.files import AnyPath
from ..runtime.scratch import folder_if_large, new_array, release_memory
from ..runtime.values import Value
from ..spectral.colour import light_basis
from ..spectral.spectra import BAND_NM
from .primaries import chromaticities, to_rec709_matrix
from .spectral_exr import read_parts

MAIN_LAYERS = ("combined", "rgba", "rgb", "beauty")  # names that programs give to the picture among its passes
GREYS = ("Y", "V")  # luminance in OpenEXR, and Blender's channel for black and white
LARGEST_FRAME_PX = 65536


@dataclass(frozen=True, eq=False, repr=False)
class RgbPicture(Value):
    """A linear pinhole picture of the scene.

    Attributes
    ----------
    rec709 : float32 array (row, column, 3)
        Linear Rec. 709 in Blender's scale; row 0 is the top. The frame is in the middle, with overscan around it.
    overscan_px : (int, int)
        Rows and columns beyond the frame on each side.
    layer : str
        The name of its layer in the file; "" for a layer without a name.
    """

    rec709: np.ndarray
    overscan_px: tuple[int, int]
    layer: str

    @property
    def frame_px(self) -> tuple[int, int]:
        """Rows and columns of the frame."""
        return self.rec709.shape[0] - 2 * self.overscan_px[0], self.rec709.shape[1] - 2 * self.overscan_px[1]


def read_rgb_exr(path: str | os.PathLike, layer: str | None = None) -> RgbPicture:
    """Read an RGB EXR: R, G and B, or Y alone, of half or single precision, in one part or several.

    The frame is the display window. Pixels of it outside a trimmed data window are black; pixels beyond it are
    overscan. All frames of a sequence therefore have the same grid. Alpha is ignored: premultiplied colours are over
    black.

    Parameters
    ----------
    path : path
    layer : str, optional
        Such as "ViewLayer.Combined"; by default the layer without a name, or with a usual name, or the only layer.

    Returns
    -------
    RgbPicture

    Raises
    ------
    ImageError
        The file is not an EXR, has no colours, several possible layers, an unknown colour space, or pixels that are not
        square.
    """
    return rgb_of(read_parts(path), path, layer)


def rgb_of(parts: list[tuple[dict, dict]], path: str | os.PathLike, layer: str | None = None) -> RgbPicture:
    """The result of `read_rgb_exr`, from the result of `read_parts`."""
    try:
        layers = _layers(parts)
        if not layers:
            names = sorted(name for _, channels in parts for name in channels)
            raise ImageError(path, "channels", ", ".join(names),
                             "expected R, G and B, or Y, or spectral channels such as S0.550,000000nm")
        layer = _choose(layers, layer)
        header, planes = layers[layer]
        header = parts[0][0] | header  # attributes shared by all parts may be only in the first
        overscan = overscan_of(header)
        rec709 = in_rec709(np.stack([lay_out(plane, header, overscan) for plane in planes], axis=-1), header)
    except ImageError as error:
        raise error.at(path) from None
    return RgbPicture(rec709, overscan, layer)


def in_rec709(rgb: np.ndarray, header: dict) -> np.ndarray:
    """A file's colours (..., 3) converted to linear Rec. 709."""
    matrix = to_rec709_matrix(chromaticities(header))
    if matrix is None:
        return rgb
    with np.errstate(invalid="ignore", over="ignore"):  # non-finite pixels are reported where they are used
        return rgb @ matrix.T.astype(np.float32)


def _layers(parts):
    """{layer: (header, three planes)} of a file's colour layers; without any, of its grey layers."""
    colours, greys = {}, {}
    for layer, (header, planes) in flat_layers(parts).items():
        if {"R", "G", "B"} <= planes.keys():
            colours[layer] = header, [planes[name] for name in "RGB"]
        elif len(planes.keys() - {"A"}) == 1 and (grey := planes.keys() & set(GREYS)):
            greys[layer] = header, [planes[grey.pop()]] * 3
    return colours or greys


def flat_layers(parts: list[tuple[dict, dict]]) -> dict[str, tuple[dict, dict]]:
    """The result of `read_parts` by layer: {layer: (header, {component in capitals: plane})}, for float channels only.

    A part's channels without a prefix are in the layer named after the part.
    """
    layers: dict[str, tuple[dict, dict]] = {}
    for header, channels in parts:
        for name, plane in channels.items():
            if getattr(plane, "dtype", None) in (np.float16, np.float32) and plane.ndim == 2:
                layer, _, component = name.rpartition(".")
                layer = layer or (header.get("name", "") if len(parts) > 1 else "")
                first, planes = layers.setdefault(layer, (header, {}))
                if first is header:
                    planes[component.upper()] = plane
    return layers


def _choose(layers, wanted):
    """The name of the picture's layer."""
    main = [name for name in layers if name.rpartition(".")[2].lower() in MAIN_LAYERS] or list(layers)
    if wanted is None:
        if "" in layers or len(main) == 1:
            return "" if "" in layers else main[0]
        raise ImageError("image", "layers", ", ".join(main), "name one of them as the picture's layer")
    if wanted not in layers:
        names = ", ".join(name or "without a name" for name in layers)
        raise ImageError("image", "layers", names, f"no layer is named {wanted!r}")
    return wanted


def overscan_of(header: dict) -> tuple[int, int]:
    """Rows and columns by which the data window exceeds the display window, on the side with the larger excess."""
    (top, left), (bottom, right), frame = windows_of(header)
    overscan = max(0, -top, bottom - frame[0]), max(0, -left, right - frame[1])
    if max(frame) > LARGEST_FRAME_PX or any(margin > n for margin, n in zip(overscan, frame, strict=True)):
        raise ImageError("image", "dataWindow", f"{overscan} px beyond a display window of {frame}",
                         f"expected overscan no larger than the frame, and a frame of at most {LARGEST_FRAME_PX} px")
    aspect = header.get("pixelAspectRatio", 1.0)
    if abs(aspect - 1) > 1e-4:
        raise ImageError("image", "pixelAspectRatio", float(aspect), "expected square pixels")
    return overscan


def lay_out(plane: np.ndarray, header: dict, overscan_px: tuple[int, int], empty: float = 0.0) -> np.ndarray:
    """A plane on the display window with the given overscan on each side: float32 array (row, column)."""
    begins, ends, frame = windows_of(header)
    if plane.shape != tuple(end - begin for begin, end in zip(begins, ends, strict=True)):
        raise ImageError("image", "channel", f"of {plane.shape} px", "expected every pixel of the data window")
    laid = np.full([n + 2 * margin for n, margin in zip(frame, overscan_px, strict=True)], empty, np.float32)
    to, of = zip(*((slice(max(0, begin + margin), max(0, end + margin)),
                    slice(max(0, -begin - margin), max(0, n + margin - begin)))
                   for begin, end, n, margin in zip(begins, ends, frame, overscan_px, strict=True)), strict=True)
    laid[to] = plane[of]
    return laid


def windows_of(header: dict) -> tuple[tuple[int, ...], ...]:
    """First row and column of the data, one past the last, and the frame's rows and columns.

    They are relative to the frame's first pixel.
    """
    data, display = (np.array(header[name], dtype=int)[:, ::-1] for name in ("dataWindow", "displayWindow"))
    return tuple(tuple(int(n) for n in corner) for corner in
                 (data[0] - display[0], data[1] + 1 - display[0], display[1] + 1 - display[0]))


def upsample(picture: RgbPicture, wavelengths_nm: ArrayLike, pitch_um: float,
             scratch: AnyPath | None = None) -> tuple[SpectralImage, float]:
    """Spectral radiance of a picture, with every colour interpreted as a light (`light_basis`).

    Negative radiance, which colours outside Rec. 709 have at some wavelengths, is set to 0.

    Parameters
    ----------
    picture : RgbPicture
    wavelengths_nm : ascending sequence of float
    pitch_um : float
        Pixel pitch at the sensor; see `pitch`.
    scratch : path, optional
        Folder for a file to store the planes in if they would take too much memory.

    Returns
    -------
    SpectralImage
    negative : float
        The negative light, as a fraction of the rest.

    Raises
    ------
    InputError
        D65 is unknown at a wavelength.
    """
    wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
    for nm in wavelengths_nm:
        if not BAND_NM[0] <= nm <= BAND_NM[1]:
            raise InputError("options", "wavelength", f"{nm:g} nm",
                             "colours are defined from {:g} to {:g} nm".format(*BAND_NM))
    shape = (len(wavelengths_nm), *picture.rec709.shape[:2])
    cube = new_array(shape, folder_if_large(shape, scratch))
    clipped = positive = 0.0
    with np.errstate(invalid="ignore", over="ignore"):
        for plane, shares in zip(cube, light_basis(wavelengths_nm).astype(np.float32), strict=True):
            np.matmul(picture.rec709, shares, out=plane)
            negative = (plane < 0) & (plane > -np.inf)
            clipped -= plane[negative].sum(dtype=np.float64)
            plane[negative] = 0
            positive += plane.sum(dtype=np.float64, where=np.isfinite(plane))
    release_memory(cube)
    image = SpectralImage(cube, wavelengths_nm, pitch_um=pitch_um, overscan_px=picture.overscan_px, arbitrary=True)
    return image, clipped / positive if positive else 0.0
