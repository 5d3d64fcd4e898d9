"""LayeredRadiance: a scene's radiance in layers of depth, each the view of a pinhole in the entrance pupil."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import DTypeLike

from ..runtime.errors import ImageError
from ..runtime.numbers import is_integer
from ..runtime.scratch import zeros_stored_like
from .detail import Detail
from .pixel_grid import PixelGrid
from .sampling import Sampling
from .spectral_image import SpectralImage, check_capture
from .supersampling import merge_columns

BACKGROUND_MM = 1e12  # or more: renderers write a large number for the background, Cycles 1e10 m
ALPHA_SLACK = 1e-3  # accepted excess over the range from 0 to 1, from filters and half floats


@dataclass(frozen=True, eq=False)
class Layer:
    """The part of a scene between two depths, as visible without anything nearer.

    Attributes
    ----------
    cube : float32 array (wavelength, row, column)
        Radiance, premultiplied by alpha.
    alpha : float32 array (row, column)
        Fraction of each pixel that the layer covers.
    depth_mm : float32 array (row, column)
        Depth of the visible surface along the optical axis from the entrance pupil: positive, inf for the world. It has
        no meaning for pixels with alpha 0.
    origin_px : (int, int)
        The layer's first row and column in the capture: empty margins need not be stored.
    detail : Detail or None
        The distribution of its light inside the pixels; None if each pixel is even.

    Raises
    ------
    ImageError
        Shapes do not match; or an alpha or a depth is invalid.
    """

    cube: np.ndarray
    alpha: np.ndarray
    depth_mm: np.ndarray
    origin_px: tuple[int, int] = (0, 0)
    detail: Detail | None = None

    def __post_init__(self) -> None:
        for name in ("cube", "alpha", "depth_mm"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), np.float32))
        if self.cube.ndim != 3 or not self.cube.shape[1:] == self.alpha.shape == self.depth_mm.shape:
            raise ImageError("layer", "planes", f"of {self.cube.shape}, {self.alpha.shape} and {self.depth_mm.shape}",
                             "expected radiance (wavelength, row, column), alpha and depth of the same pixels")
        if np.shape(self.origin_px) != (2,) or not all(map(is_integer, self.origin_px)):
            raise ImageError("layer", "origin_px", self.origin_px, "expected a row and a column")
        if self.detail is not None and self.detail.shape_px != self.alpha.shape:
            raise ImageError("layer", "detail", f"of {self.detail.shape_px} px", f"expected {self.alpha.shape}")
        object.__setattr__(self, "alpha", checked_alpha(self.alpha, "layer"))
        self._check_depth()

    def _check_depth(self):
        wrong = np.argwhere((self.alpha > 0) & ~(self.depth_mm > 0))
        if wrong.size:
            row, column = wrong[0]
            raise ImageError("layer", f"depth_mm at row {row}, column {column}", f"{self.depth_mm[row, column]:g}",
                             "expected a positive number, or inf, where alpha is above 0")

    @property
    def place(self) -> tuple[slice, slice]:
        """The layer's rows and columns in the capture."""
        (top, left), (rows, columns) = self.origin_px, self.alpha.shape
        return slice(top, top + rows), slice(left, left + columns)

    @property
    def nbytes(self) -> int:
        return self.cube.nbytes + self.alpha.nbytes + self.depth_mm.nbytes + (self.detail.nbytes if self.detail else 0)

    def within(self, region: tuple[slice, slice]) -> "Layer":
        """The part in a region of the capture, as a layer for a capture of that region. It shares memory with this."""
        common = [np.clip((here.start, here.stop), side.start, side.stop).tolist()
                  for here, side in zip(self.place, region, strict=True)]
        rows, columns = (slice(first - origin, last - origin)
                         for (first, last), origin in zip(common, self.origin_px, strict=True))
        (top, _), (left, _) = common
        return Layer(self.cube[:, rows, columns], self.alpha[rows, columns], self.depth_mm[rows, columns],
                     (top - region[0].start, left - region[1].start),
                     self.detail and self.detail.within(rows, columns))

    def cropped(self) -> "Layer":
        """The layer without empty rows and columns at its sides; at least one pixel."""
        rows, columns = covered(self.alpha)
        top, left = self.origin_px
        return Layer(self.cube[:, rows, columns].copy(), self.alpha[rows, columns].copy(),
                     self.depth_mm[rows, columns].copy(), (top + rows.start, left + columns.start),
                     self.detail and self.detail.within(rows, columns))


@dataclass(frozen=True, eq=False)
class LayeredRadiance:
    """A scene's radiance in layers of depth, from near to far.

    Attributes
    ----------
    layers : tuple of Layer
        At least one. The last includes the world, unless the film is transparent.
    wavelengths_nm : float64 array (wavelength,)
        Ascending; the same for all layers.
    grid : PixelGrid
        The grid of the capture, which contains the layers. Its columns may be finer than the pixels of the sensor.
    focal_mm : float or None
        Focal length of the capturing pinhole; None for the lens's capture focal length. They differ if a lens on the
        same sensor is focused elsewhere.
    exposure : float
        Factor for pictures of it, as in `SpectralImage`.
    arbitrary : bool
        As in `SpectralImage`.

    Raises
    ------
    ImageError
        The layers are missing or do not fit in the grid; or wavelengths, focal length or exposure are invalid.
    """

    layers: tuple[Layer, ...]
    wavelengths_nm: np.ndarray
    grid: PixelGrid
    focal_mm: float | None = None
    exposure: float = 1.0
    arbitrary: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "layers", tuple(self.layers))
        object.__setattr__(self, "wavelengths_nm", np.atleast_1d(np.asarray(self.wavelengths_nm, np.float64)))
        check_capture("layers", self.wavelengths_nm, self.focal_mm, self.exposure)
        if not self.layers:
            raise ImageError("layers", "layers", "none", "expected at least one")
        rows, columns = self.grid.shape_px
        if len(times := {layer.detail.times for layer in self.layers if layer.detail}) > 1:
            raise ImageError("layers", "detail", f"of {sorted(times)} parts", "expected the same for all layers")
        for number, layer in enumerate(self.layers, 1):
            down, across = layer.place
            if len(layer.cube) != self.wavelengths_nm.size:
                raise ImageError("layers", f"layer {number}", f"of {len(layer.cube)} wavelengths",
                                 f"expected {self.wavelengths_nm.size}")
            if down.start < 0 or across.start < 0 or down.stop > rows or across.stop > columns:
                raise ImageError("layers", f"layer {number}", f"at {layer.origin_px}, of {layer.alpha.shape} px",
                                 f"expected a part of the capture's {self.grid.shape_px} px")

    @property
    def nbytes(self) -> int:
        return sum(layer.nbytes for layer in self.layers)

    @property
    def detail_times(self) -> int:
        """Parts of a pixel, down and across, whose light is known."""
        return max(layer.detail.times if layer.detail else 1 for layer in self.layers)

    @property
    def capture(self) -> PixelGrid:
        """The grid, with the focal length of the pinhole."""
        return replace(self.grid, focal_mm=self.focal_mm)

    @property
    def sampling(self) -> Sampling:
        """The capture in the sensor's pixels, and its wavelengths."""
        return Sampling(self.capture.on_sensor(), tuple(self.wavelengths_nm.tolist()))

    @property
    def light(self) -> np.ndarray:
        """An array (wavelength, row, column) that is stored where the layers are: in memory or in a file."""
        return self.layers[0].cube

    def even(self) -> "LayeredRadiance":
        """The layers without their detail."""
        return replace(self, layers=tuple(replace(layer, detail=None) for layer in self.layers))

    def cropped(self, margin_px: tuple[int, int]) -> "LayeredRadiance":
        """The layers without `margin_px` (rows, columns) of the sensor's pixels on each side of the capture. They share
        memory with these."""
        above, left = margin_px[0], margin_px[1] * self.grid.across
        rows, columns = self.grid.shape_px
        inside = slice(above, rows - above), slice(left, columns - left)
        return replace(self, grid=self.grid.cropped((above, left)),
                       layers=tuple(layer.within(inside) for layer in self.layers))

    def flat(self) -> SpectralImage:
        """The radiance of all layers combined, as visible to the pinhole, in the sensor's pixels; stored in a file if
        the layers are."""
        grid = self.grid.on_sensor()
        cube = zeros_stored_like(self.light, (self.wavelengths_nm.size, *grid.shape_px))
        for index, plane in enumerate(cube):
            plane[:] = self.on_sensor(self.composite(partial(_light, index)))
        return SpectralImage(cube, self.wavelengths_nm, grid, focal_mm=self.focal_mm, exposure=self.exposure,
                             arbitrary=self.arbitrary)

    def flat_alpha(self) -> np.ndarray:
        """Fraction of each of the sensor's pixels that all layers together cover: float32 array (row, column)."""
        clear = np.ones(self.grid.shape_px, np.float32)
        for layer in self.layers:
            clear[layer.place] *= 1 - layer.alpha
        return 1 - self.on_sensor(clear)

    def composite(self, values_of: Callable[[Layer], np.ndarray], dtype: DTypeLike = np.float32) -> np.ndarray:
        """Values of the layers, premultiplied by alpha, as visible to the pinhole: array (row, column) of the capture.
        """
        plane = np.zeros(self.grid.shape_px, dtype)
        for layer in reversed(self.layers):
            part = plane[layer.place]
            part *= 1 - layer.alpha
            part += values_of(layer)
        return plane

    def on_sensor(self, plane: np.ndarray) -> np.ndarray:
        """Means of a plane of the capture over the sensor's pixels."""
        return merge_columns(plane, self.grid.across)

    def with_light(self, cubes: Iterable[np.ndarray]) -> "LayeredRadiance":
        """The same layers with other light: for each layer an array (wavelength, row, column) of the same length."""
        return replace(self, layers=tuple(replace(layer, cube=cube)
                                          for layer, cube in zip(self.layers, cubes, strict=True)))


def _light(index: int, layer: Layer) -> np.ndarray:
    """A layer's light at a wavelength, given as an index."""
    return layer.cube[index]


Radiance = SpectralImage | LayeredRadiance
"""What a lens takes: a flat picture, all in focus, or layers of depth."""


def checked_alpha(alpha: np.ndarray, where: str) -> np.ndarray:
    """Alpha, with rounding errors clipped to the range from 0 to 1.

    Raises
    ------
    ImageError
        A value is NaN, or more than `ALPHA_SLACK` outside that range.
    """
    if not alpha.size or (alpha.min() >= 0 and alpha.max() <= 1):
        return alpha
    wrong = np.argwhere(~((alpha >= -ALPHA_SLACK) & (alpha <= 1 + ALPHA_SLACK)))
    if wrong.size:
        place = " ".join(map(str, wrong[0]))
        raise ImageError(where, f"alpha at {place}", f"{alpha[tuple(wrong[0])]:g}", "expected a number from 0 to 1")
    return np.clip(alpha, 0, 1)


def covered(alpha: np.ndarray) -> tuple[slice, slice]:
    """Slices from the first to the last row and column of a plane with nonzero values; at least one pixel."""
    sides = []
    for axis in (1, 0):
        places = np.flatnonzero(alpha.any(axis=axis))
        sides.append(slice(int(places[0]), int(places[-1]) + 1) if places.size else slice(0, 1))
    return sides[0], sides[1]
