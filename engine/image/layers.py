"""LayeredRadiance: a scene's radiance in layers of depth, each as a pinhole in the entrance pupil sees it by itself."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..errors import ImageError
from ..scratch import beside
from .pixel_grid import PixelGrid
from .spectral_image import SpectralImage


@dataclass(frozen=True, eq=False)
class Layer:
    """What of a scene lies between two depths, seen without what is nearer.

    Attributes
    ----------
    cube : float32 array (wavelength, row, column)
        Radiance, premultiplied by alpha.
    alpha : float32 array (row, column)
        How much of each pixel the layer covers.
    depth_mm : float32 array (row, column)
        Along the optical axis from the entrance pupil, of what each pixel shows; inf for what is infinitely far, as
        the world is. Where alpha is 0 it says nothing.
    origin_px : (int, int)
        Row and column of the capture where the layer begins: where it holds nothing it need not be kept.

    Raises
    ------
    ImageError
        Arrays that do not fit one another.
    """

    cube: np.ndarray
    alpha: np.ndarray
    depth_mm: np.ndarray
    origin_px: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        for name in ("cube", "alpha", "depth_mm"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), np.float32))
        if self.cube.ndim != 3 or not self.cube.shape[1:] == self.alpha.shape == self.depth_mm.shape:
            raise ImageError("layer", "planes", f"of {self.cube.shape}, {self.alpha.shape} and {self.depth_mm.shape}",
                             "expected radiance (wavelength, row, column), alpha and depth of the same pixels")

    @property
    def place(self) -> tuple[slice, slice]:
        """Its rows and columns of the capture."""
        (top, left), (rows, columns) = self.origin_px, self.alpha.shape
        return slice(top, top + rows), slice(left, left + columns)

    @property
    def nbytes(self) -> int:
        return self.cube.nbytes + self.alpha.nbytes + self.depth_mm.nbytes

    def within(self, region: tuple[slice, slice]) -> "Layer":
        """What of it lies in a region of the capture, for a capture of that region alone; it shares its memory."""
        common = [np.clip((here.start, here.stop), side.start, side.stop).tolist()
                  for here, side in zip(self.place, region, strict=True)]
        rows, columns = (slice(first - origin, last - origin)
                         for (first, last), origin in zip(common, self.origin_px, strict=True))
        (top, _), (left, _) = common
        return Layer(self.cube[:, rows, columns], self.alpha[rows, columns], self.depth_mm[rows, columns],
                     (top - region[0].start, left - region[1].start))

    def cropped(self) -> "Layer":
        """The layer without the rows and columns on its sides that it does not cover; of one pixel at the least."""
        rows, columns = covered(self.alpha)
        top, left = self.origin_px
        return Layer(self.cube[:, rows, columns].copy(), self.alpha[rows, columns].copy(),
                     self.depth_mm[rows, columns].copy(), (top + rows.start, left + columns.start))


@dataclass(frozen=True, eq=False)
class LayeredRadiance:
    """A scene's radiance in layers of depth, from near to far.

    Attributes
    ----------
    layers : tuple of Layer
        At least one. The last holds the world as well, unless the film is transparent.
    wavelengths_nm : float64 array (wavelength,)
        Ascending; those of each layer.
    grid : PixelGrid
        Of the capture, in which the layers lie.
    focal_mm : float or None
        Of the pinhole that captured it; None for the lens's own. A lens that is focused elsewhere has another one, and
        sees the layers on the same sensor.
    exposure : float
        What pictures of it are multiplied by, as `SpectralImage` has it.

    Raises
    ------
    ImageError
        No layer, or one that does not fit.
    """

    layers: tuple[Layer, ...]
    wavelengths_nm: np.ndarray
    grid: PixelGrid
    focal_mm: float | None = None
    exposure: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "layers", tuple(self.layers))
        object.__setattr__(self, "wavelengths_nm", np.atleast_1d(np.asarray(self.wavelengths_nm, np.float64)))
        if not self.layers:
            raise ImageError("layers", "layers", "none", "expected at least one")
        rows, columns = self.grid.shape_px
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

    def dark(self) -> SpectralImage:
        """A black picture of the same grid and wavelengths, which takes no memory."""
        cube = np.broadcast_to(np.float32(0), (self.wavelengths_nm.size, *self.grid.shape_px))
        grid = replace(self.grid, focal_mm=self.focal_mm)
        return SpectralImage(cube, self.wavelengths_nm, grid, focal_mm=self.focal_mm, exposure=self.exposure)

    def cropped(self, margin_px: tuple[int, int]) -> "LayeredRadiance":
        """The layers without `margin_px` (rows, columns) on each side of the capture; they share their memory."""
        (above, left), (rows, columns) = margin_px, self.grid.shape_px
        inside = slice(above, rows - above), slice(left, columns - left)
        return replace(self, grid=self.grid.cropped(margin_px),
                       layers=tuple(layer.within(inside) for layer in self.layers))

    def flat(self) -> SpectralImage:
        """The radiance that the pinhole sees of all layers; in a file, where theirs is."""
        cube = beside(self.layers[0].cube, (self.wavelengths_nm.size, *self.grid.shape_px))
        for layer in reversed(self.layers):
            part = cube[:, *layer.place]
            part *= 1 - layer.alpha
            part += layer.cube
        return SpectralImage(cube, self.wavelengths_nm, self.grid, focal_mm=self.focal_mm, exposure=self.exposure)

    def flat_alpha(self) -> np.ndarray:
        """How much of each pixel all layers cover: float32 array (row, column)."""
        clear = np.ones(self.grid.shape_px, np.float32)
        for layer in self.layers:
            clear[layer.place] *= 1 - layer.alpha
        return 1 - clear

    def flat_depth_mm(self) -> np.ndarray:
        """The depth of what is nearest in each pixel: float32 array (row, column), inf where nothing is."""
        depth_mm = np.full(self.grid.shape_px, np.inf, np.float32)
        for layer in reversed(self.layers):
            np.copyto(depth_mm[layer.place], layer.depth_mm, where=layer.alpha > 0)
        return depth_mm

    def with_light(self, cubes: Iterable[np.ndarray]) -> "LayeredRadiance":
        """The same layers with other light: of each an array (wavelength, row, column), of as many wavelengths."""
        return replace(self, layers=tuple(replace(layer, cube=cube)
                                          for layer, cube in zip(self.layers, cubes, strict=True)))


def light_of(radiance: SpectralImage | LayeredRadiance) -> np.ndarray:
    """An array (wavelength, row, column) of its light, in memory or in a file as all of it is."""
    return radiance.layers[0].cube if isinstance(radiance, LayeredRadiance) else radiance.cube


def covered(alpha: np.ndarray) -> tuple[slice, slice]:
    """From the first to the last row and column of a plane in which something is not 0; of one pixel at the least."""
    sides = []
    for axis in (1, 0):
        places = np.flatnonzero(alpha.any(axis=axis))
        sides.append(slice(int(places[0]), int(places[-1]) + 1) if places.size else slice(0, 1))
    return sides[0], sides[1]
