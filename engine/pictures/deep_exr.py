"""Deep EXR files: each pixel has samples of everything along its ray, each with its depth and alpha.

Samples of volumes also have an end, ZBack; only their beginning, Z, is used.
"""

import os
from dataclasses import dataclass, replace

import numpy as np
import OpenEXR

from ..image.layers import checked_alpha
from ..runtime.errors import ImageError
from ..runtime.values import Value
from .rgb_picture import RgbPicture, in_rec709, overscan_of, windows_of
from .spectral_exr import read_parts

DEEP = OpenEXR.deepscanline, OpenEXR.deeptile
COLOURS = "RGB"
OPAQUE = 1 - 1e-6  # alpha of a layer from which the rest is rounding


@dataclass(frozen=True, eq=False, repr=False)
class DeepPicture(Value):
    """A deep picture: arrays (sample,), by pixel.

    Attributes
    ----------
    shape_px, overscan_px : (int, int)
        Rows and columns of pixels and of overscan, as in `RgbPicture`.
    layer : str
        The name of its part in the file.
    pixel : int array
        Row times columns plus column.
    depth : array
        In the file's unit, from near to far in each pixel.
    alpha : array
        From 0 to 1.
    rec709 : array (sample, 3)
        Premultiplied.
    """

    shape_px: tuple[int, int]
    overscan_px: tuple[int, int]
    layer: str
    pixel: np.ndarray
    depth: np.ndarray
    alpha: np.ndarray
    rec709: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "alpha", checked_alpha(self.alpha, "deep samples"))
        super().__post_init__()

    def at(self, depth: np.ndarray) -> "DeepPicture":
        """The picture with other depths, which may be in any order."""
        order = np.lexsort((depth, self.pixel))
        return replace(self, pixel=self.pixel[order], depth=depth[order], alpha=self.alpha[order],
                       rec709=self.rec709[order])

    def first_depth(self) -> np.ndarray:
        """Depth at which half of a pixel is covered: array (row, column), inf if it never is."""
        covered = 1 - self._clear_before(self.pixel) * (1 - self.alpha)
        place = np.flatnonzero(covered >= 0.5)
        pixel, first = np.unique(self.pixel[place], return_index=True)
        depth = np.full(self.shape_px, np.inf, np.float32)
        depth.ravel()[pixel] = self.depth[place[first]]
        return depth

    @np.errstate(over="ignore", invalid="ignore")  # non-finite pixels are reported where they are used
    def slabs(self, slab: np.ndarray, count: int) -> list[tuple[RgbPicture, np.ndarray, np.ndarray]]:
        """The picture, alpha and nearest depth (row, column) of each slab by itself, near to far.

        Parameters
        ----------
        slab : int array (sample,)
            The slab of each sample; it rises with depth.
        count : int
            Number of slabs.
        """
        group, groups = self.pixel * count + slab, self.shape_px[0] * self.shape_px[1] * count
        before = self._clear_before(group)
        def summed(values):
            return np.bincount(group, before * values, groups).reshape(*self.shape_px, count).astype(np.float32)

        alpha = summed(self.alpha)
        alpha[alpha > OPAQUE] = 1
        rec709 = np.stack([summed(self.rec709[:, channel]) for channel in range(3)], axis=-1)
        depth = np.full(groups, np.inf, np.float32)
        covering = np.flatnonzero(self.alpha > 0)
        covered, first = np.unique(group[covering], return_index=True)
        depth[covered] = self.depth[covering[first]]
        depth = depth.reshape(alpha.shape)
        return [(RgbPicture(np.ascontiguousarray(rec709[:, :, number]), self.overscan_px, self.layer),
                 alpha[..., number], depth[..., number]) for number in range(count)]

    def _clear_before(self, group):
        """Transmission of the samples in front of each sample, within its group: array (sample,)."""
        clear = np.cumsum(np.log1p(-np.clip(self.alpha.astype(float), 0, 1 - 1e-9)))
        before = np.concatenate([[0.0], clear[:-1]])
        begins = np.concatenate([[0], np.flatnonzero(np.diff(group)) + 1]) if group.size else np.array([], int)
        return np.exp(before - np.repeat(before[begins], np.diff(np.append(begins, group.size))))


def read_deep_exr(path: str | os.PathLike, layer: str | None = None) -> DeepPicture | None:
    """Read a deep EXR of R, G, B, A and Z; None for a file that is not deep.

    Parameters
    ----------
    path : path
    layer : str, optional
        The part of this name; the first by default.

    Raises
    ------
    ImageError
        The file is not an EXR, or lacks one of these channels.
    """
    if not any(header["type"] in DEEP for header, _ in read_parts(path, header_only=True)):
        return None
    parts = [(header, channels) for header, channels in read_parts(path) if header["type"] in DEEP]
    names = [str(header.get("name", "")) for header, _ in parts]
    if layer is not None and layer not in names:
        raise ImageError(path, "layers", ", ".join(names), f"no layer is named {layer!r}")
    number = 0 if layer is None else names.index(layer)
    header, channels = parts[number]
    missing = [name for name in (*COLOURS, "A", "Z") if name not in channels]
    if missing:
        raise ImageError(path, "channels", ", ".join(sorted(channels)), f"expected {missing[0]} in deep pixels")
    try:
        return _deep_picture(header, channels, names[number])
    except ImageError as error:
        raise error.at(path) from None


def _deep_picture(header, channels, name):
    begins, ends, frame = windows_of(header)
    overscan = overscan_of(header)
    samples = {channel: [pixel for pixel in channels[channel].ravel() if pixel is not None]
               for channel in (*COLOURS, "A", "Z")}
    sizes = {channel: sum(map(len, pixels)) for channel, pixels in samples.items()}
    if len(set(sizes.values())) > 1:
        raise ImageError("image", "samples", str(sizes), "expected the same number for each channel")
    values = {channel: np.concatenate([np.empty(0, np.float32), *pixels]).astype(np.float32)
              for channel, pixels in samples.items()}
    counts = np.array([0 if pixel is None else len(pixel) for pixel in channels["Z"].ravel()])
    row, column = (np.repeat(places.ravel(), counts) + begin + margin for places, begin, margin in zip(
        np.indices(channels["Z"].shape), begins, overscan, strict=True))
    shape = tuple(n + 2 * margin for n, margin in zip(frame, overscan, strict=True))
    rgb = in_rec709(np.stack([values[channel] for channel in COLOURS], axis=-1), header)
    picture = DeepPicture(shape, overscan, name, row * shape[1] + column, values["Z"], values["A"], rgb)
    return picture.at(values["Z"])
