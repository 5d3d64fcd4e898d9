"""Layers of a capture, prepared for lookup by rays: with depth and focus share everywhere."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from ..image.detail import split_by_detail
from ..image.layers import Layer
from ..image.pixel_grid import PixelGrid
from ..image.supersampling import split_pixels
from ..kernels.levels import LayerPlanes, LevelKind, Nearer
from ..lens import Lens
from .depth_range import blur_per_nearness_px, focus_in_capture, focus_range_px, focus_share

NEAREST_MM = 1e-3


@dataclass(frozen=True, eq=False)
class PreparedLayer:
    """A prepared layer, which is not empty.

    Attributes
    ----------
    layer : Layer
    depth : float32 array (row, column, 2)
        Inverse depth per mm, also where the layer is transparent, and the focus share, which is below 0 far from
        anything opaque.
    capture : PixelGrid
    in_focus : float or array (row, column)
        Inverse depth of the plane of focus, per mm: an array if it leans.
    """

    layer: Layer
    depth: np.ndarray
    capture: PixelGrid
    in_focus: float | np.ndarray

    @property
    def goes_on(self) -> tuple[bool, bool, bool, bool]:
        """Whether the layer ends at the capture above, below, left and right: its last pixels continue there."""
        (rows, columns), (down, across) = self.capture.shape_px, self.layer.place
        return down.start == 0, down.stop >= rows, across.start == 0, across.stop >= columns

    @property
    def sides(self) -> tuple[tuple[bool, bool], tuple[bool, bool]]:
        """`goes_on` of rows, and of columns."""
        return self.goes_on[:2], self.goes_on[2:]

    @property
    def axis_px(self) -> tuple[float, float]:
        """Row and column of the axis in the layer's pixels."""
        (row, column), (top, left) = self.capture.centre_px, self.layer.origin_px
        return row - top, column - left

    @property
    def leaning(self) -> bool:
        """Whether the plane of focus leans, so that the focus share varies at a depth."""
        return np.ndim(self.in_focus) > 0

    def in_focus_near(self, right_px: np.ndarray, up_px: np.ndarray) -> float | np.ndarray:
        """Inverse depth in focus at the layer's pixels nearest to places relative to the axis."""
        if not self.leaning:
            return self.in_focus
        row, column = (np.clip(np.rint(at), 0, n - 1).astype(int) for at, n in
                       zip((self.axis_px[0] - up_px, self.axis_px[1] + right_px), self.layer.alpha.shape, strict=True))
        return np.asarray(self.in_focus)[row, column]

    @cached_property
    def focused(self) -> bool:
        """Whether any of it may be in focus."""
        return bool(self.depth[..., 1].max() > 0)

    def largest(self, wavelengths: slice) -> float:
        """The largest absolute radiance at some of the wavelengths."""
        light = self.layer.cube[wavelengths]
        return max(float(light.max()), -float(light.min()))

    @cached_property
    def lit(self) -> np.ndarray:
        """The pixels with light at any wavelength."""
        return np.asarray(self.layer.cube.any(axis=0))

    @property
    def out_of_focus(self) -> bool:
        """Whether any of it is out of focus."""
        return bool(self.depth[..., 1].min(where=self.layer.alpha > 0, initial=1) < 1)

    @property
    def blurred(self) -> bool:
        """Whether any of its light is out of focus."""
        return bool(np.any(self.lit & (self.depth[..., 1] < 1)))

    def near_surfaces(self, reach_px: int) -> "PreparedLayer":
        """The layer with a focus share below 0 where it is transparent to this distance: rays skip it there."""
        alpha, depth = self.layer.alpha, self.depth.copy()
        sides = [2 * min(reach_px, n) + 1 for n in alpha.shape]  # a fisheye's rays reach far beyond the layer
        depth[scipy.ndimage.maximum_filter(alpha, sides) == 0, 1] = -1
        return replace(self, depth=depth)

    def in_place(self, parallax_px: np.ndarray, lens: Lens) -> "PreparedLayer":
        """The layer with light out of focus that lands far from where in-focus PSFs put it: blur extends by parallax.

        Parameters
        ----------
        parallax_px : array (row, column)
            From `parallax_per_nearness_px`.
        lens : Lens
        """
        pitch_um, nearness = self.capture.pitch_um, self.depth[..., 0]
        apart_px = (blur_per_nearness_px(lens, pitch_um) + 2 * parallax_px) * (nearness - self.in_focus)
        share = np.minimum(self.depth[..., 1], focus_share(apart_px, focus_range_px(lens, pitch_um)))
        return replace(self, depth=np.stack([nearness, share], axis=-1, dtype=np.float32))

    def in_parts(self, region: tuple[slice, slice], times: int, wavelengths: slice,
                 wavelengths_nm: np.ndarray) -> "PreparedLayer":
        """The part in a region of the capture at some of the wavelengths, with each pixel split into `times` x `times`.
        """
        layer = self.layer.within(region)
        cube = [split_by_detail(plane, layer.detail, nm, times)
                for plane, nm in zip(layer.cube[wavelengths], wavelengths_nm, strict=True)]
        inside = tuple(slice(side.start + at - own, side.start + at - own + n) for side, at, own, n in zip(
            region, layer.origin_px, self.layer.origin_px, layer.alpha.shape, strict=True))
        alpha = split_pixels(layer.alpha, times)
        depth = [split_pixels(plane, times) for plane in np.moveaxis(self.depth[inside], -1, 0)]
        anywhere_mm = np.broadcast_to(np.float32(1), alpha.shape)  # rays read `depth` instead
        row, column = (times * at for at in layer.origin_px)
        return replace(self, layer=Layer(np.array(cube), alpha, anywhere_mm, (row, column)),
                       depth=np.stack(depth, axis=-1), capture=self.capture.part(region).finer(times))

    def planes(self, wavelengths: slice, scale: float, coarser: tuple[LevelKind | None, ...],
               nearer: Nearer | None) -> LayerPlanes:
        """The layer at some of the wavelengths for the loops, with its light multiplied by `scale`, and sharpened if
        rays gather it; with other levels, and nearer layers."""
        return LayerPlanes(self.layer.cube[wavelengths], self.layer.alpha, scale, self.out_of_focus,
                           self.layer.origin_px, self.capture.centre_px, self.sides, coarser, nearer)


def prepare_layers(layers: Iterable[Layer], capture: PixelGrid, lens: Lens) -> list[PreparedLayer]:
    """Prepare the layers that are not empty."""
    return [_prepared(layer, capture, lens) for layer in layers if layer.alpha.any()]


def _prepared(layer, capture, lens):
    known = (layer.alpha > 0) & (layer.depth_mm > 0)
    nearness = np.zeros(known.shape, np.float32)
    np.divide(1, np.maximum(layer.depth_mm, NEAREST_MM), out=nearness, where=known)
    nearness = filled(nearness, known)
    (top, left), (rows, columns) = layer.origin_px, known.shape
    in_focus = focus_in_capture(lens, capture, top + np.arange(rows)[:, None], left + np.arange(columns))
    blur_px = blur_per_nearness_px(lens, capture.pitch_um) * (nearness - in_focus)
    share = focus_share(blur_px, focus_range_px(lens, capture.pitch_um))
    return PreparedLayer(layer, np.stack([nearness, share], axis=-1, dtype=np.float32), capture, in_focus)


def filled(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Fill unknown values with the mean of the smallest surrounding square of a quadtree that contains known ones."""
    if known.all():
        return values
    rows, columns = known.shape
    padding = ((0, rows % 2), (0, columns % 2))
    blocks = [np.pad(each, padding).reshape((rows + 1) // 2, 2, (columns + 1) // 2, 2).sum(axis=(1, 3))
              for each in (np.where(known, values, 0), known)]
    coarse = filled(blocks[0] / np.maximum(blocks[1], 1), blocks[1] > 0)
    return np.where(known, values, coarse.repeat(2, axis=0).repeat(2, axis=1)[:rows, :columns])
