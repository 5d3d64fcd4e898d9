"""What pixels of the sensor see along their rays, through layers of a capture."""

from ctypes import byref
from dataclasses import dataclass

import numpy as np

from .library import CAST, LAYER, address, check, chosen, picture

TOGETHER = 6  # wavelengths at most
SEQUENCES = 8  # of rays: neighbouring pixels have different ones
STOP, QUANTITIES = 2, 6  # of eight rays: their place of the stop, and what they have at each wavelength
MEETING = np.dtype([("inverse_depth", np.float32), ("share", np.float32), ("steps", np.int32), ("focused", np.int32),
                    ("opaque", np.int32)])


@dataclass(frozen=True, eq=False)
class SeenLayer:
    """A layer of a capture as rays look it up.

    Attributes
    ----------
    light : float32 array (wavelength, row, column)
        Premultiplied by alpha; rows in one piece, at least 2 x 2 pixels.
    alpha : float32 array (row, column)
    depth : float32 array (row, column, 2)
        Inverse depth per mm, and the share of focus there.
    axis_px : (float, float)
        Row and column of the axis, in this layer's pixels.
    bounds_px : (float, float, float, float)
        Top, bottom, left and right, beyond which there is nothing; infinite where the last pixels go on.
    """

    light: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray
    axis_px: tuple[float, float]
    bounds_px: tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class Casting:
    """A sensor, its rays, and what they meet.

    Attributes
    ----------
    rays : float32 array (height, sequence, eight, 2 + 6 wavelengths, 8)
        Of eight rays at a time: their place of the stop, tangential and outwards; then at each wavelength where they go
        at infinity, outwards and tangential, how that moves with the inverse depth, both in pixels, what is positive
        where they pass, and their light.
    heights_per_px : float
    centre_px : (float, float)
        Row and column of the axis on the sensor.
    per_focal : float
        One over the focal length in pixels of a fisheye capture; 0 of a plane one.
    blades : float32 array (blade, 2)
        The directions that an iris's blades face; empty without one.
    blade_shape : (float, float, float)
        Margin, bend and slope: a ray passes where margin - bend r^2 - slope (place . direction) > 0 for all blades.
    layers : tuple of SeenLayer
        The nearest first.
    faint : tuple of float
        At each wavelength, radiance that counts for nothing beside what is seen.
    meetings : array (tile row, tile column, layer) of MEETING
        Where the search for a layer begins, after how many steps it ends, below 0 where the layer cannot be met; and
        whether something there may be in focus, and whether it covers all there.
    eights : int64 array (tile row, tile column)
        Of rays; pixels of tiles without any are left as they are.
    tile_px : int
    """

    rays: np.ndarray
    heights_per_px: float
    centre_px: tuple[float, float]
    per_focal: float
    blades: np.ndarray
    blade_shape: tuple[float, float, float]
    layers: tuple[SeenLayer, ...]
    faint: tuple[float, ...]
    meetings: np.ndarray
    eights: np.ndarray
    tile_px: int

    @property
    def wavelengths(self) -> int:
        return (self.rays.shape[3] - STOP) // QUANTITIES


def rays_shape(heights: int, eights: int, wavelengths: int) -> tuple[int, ...]:
    """That of `Casting.rays`."""
    return heights, SEQUENCES, eights, STOP + QUANTITIES * wavelengths, 8


def cast(casting: Casting, row: int, blurred: np.ndarray, clear: np.ndarray) -> None:
    """Write the pixels of a row of tiles.

    Parameters
    ----------
    casting : Casting
    row : int
        Of tiles.
    blurred, clear : float32 arrays (wavelength, row, column)
        Radiance out of focus, the mean over the rays' light; and the share of what is in focus that this leaves.

    Raises
    ------
    ValueError
    """
    loops, variant = chosen()
    layers = (LAYER * len(casting.layers))(*map(_layer, casting.layers))
    heights, _, eights = casting.rays.shape[:3]
    of_eight = rays_shape(heights, eights, casting.wavelengths)
    tile_rows, tile_columns = casting.eights.shape
    structure = CAST(address(casting.rays, np.float32, of_eight), heights, eights, casting.wavelengths,
                     *casting.centre_px, casting.heights_per_px, casting.per_focal,
                     address(casting.blades, np.float32), len(casting.blades), *casting.blade_shape,
                     layers, len(layers), (casting.faint + (0.0,) * TOGETHER)[:TOGETHER],
                     address(casting.meetings, MEETING, (tile_rows, tile_columns, len(layers))),
                     address(casting.eights, np.int64), tile_rows, tile_columns, casting.tile_px)
    work = np.empty(32 * casting.wavelengths * casting.tile_px**2, np.float32)
    check(loops.lf_cast(variant, byref(structure), row * tile_columns, (row + 1) * tile_columns,
                        byref(picture(blurred)), byref(picture(clear)), address(work, np.float32)))


def _layer(layer):
    light = picture(layer.light)
    rows, columns = layer.light.shape[1:]
    alpha = layer.alpha
    if alpha.dtype != np.float32 or alpha.strides != layer.light.strides[1:]:
        raise ValueError("an alpha that does not lie in memory as the light does")
    return LAYER(light, alpha.ctypes.data,
                 address(layer.depth, np.float32, (rows, columns, 2)), *layer.axis_px, *layer.bounds_px)
