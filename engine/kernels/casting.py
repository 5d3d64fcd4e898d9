"""What `cast` takes: rays of pixels, and layers of a capture."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .arrays import address
from .declarations import NUMBERS, STRUCTURES
from .levels import LayerPlanes, LevelArrays, numpy_levels

TOGETHER = NUMBERS["TOGETHER"]  # maximum number of wavelengths
STOP, QUANTITIES = 2, 6  # numbers for the position of rays in the stop, and at each wavelength
MEETING = np.dtype(STRUCTURES["meeting"])


@dataclass(frozen=True, eq=False)
class LayerArrays:
    """A layer of a capture, prepared for look-up by rays.

    Attributes
    ----------
    planes : LayerPlanes
    depth : float32 array (row, column, 2)
        Of the first level: inverse depth per mm, and the focus share.
    """

    planes: LayerPlanes
    depth: np.ndarray

    @cached_property
    def levels(self) -> tuple[LevelArrays, ...]:
        """The levels; the first has the capture's pixels."""
        return numpy_levels(self.planes)


@dataclass(frozen=True, eq=False)
class HeightRays:
    """The rays of pixels at even distances from the axis, which turn with the pixel.

    Attributes
    ----------
    values : float32 array (height, eight, 2 + 6 wavelengths, 8)
        For eight rays at a time: their position in the stop, tangential and outwards; then for each wavelength their
        position at infinity, outwards and tangential, and its change with the inverse depth, both in pixels; their
        distance from the rims that limit them, in cells, negative for blocked rays; and the light of their cells.
    heights_per_px : float
    """

    values: np.ndarray
    heights_per_px: float

    def from_quarters(self, times: int) -> "HeightRays":
        """The rays of pixels that are `times` as large, a fourth of them from the middle of each quarter, which turns
        with the pixel. The places where they arrive stay in the same pixels."""
        out = self.values[:, :, STOP::QUANTITIES].mean(axis=(1, 2, 3), dtype=float)
        outwards = np.gradient(out) * self.heights_per_px
        around = np.append(outwards[0], out[1:] / np.arange(1, len(out)) * self.heights_per_px)
        return replace(self, values=_from_quarters(self.values, times, outwards, around),
                       heights_per_px=times * self.heights_per_px)

    @property
    def eights(self) -> np.ndarray:
        """The values as array (node, eight, 2 + 6 wavelengths, 8)."""
        return self.values

    @property
    def nodes(self) -> tuple[int, int, float]:
        """Heights, rows of a mesh, and heights in a pixel."""
        return len(self.values), 0, self.heights_per_px

    @property
    def mesh(self) -> tuple[float, float, float, None, int, int, int]:
        """No mesh."""
        return 0.0, 0.0, 0.0, None, 0, 0, 0


@dataclass(frozen=True, eq=False)
class MeshRays:
    """The rays of pixels at the nodes of a mesh with even distances.

    Attributes
    ----------
    values : float32 array (row, column, eight, 2 + 6 wavelengths, 8)
        From the lowest row upwards. As `HeightRays`, with x in place of outwards, and y in place of tangential;
        positions at infinity are relative to `chief_px`.
    chief_px : float32 array (finer row, finer column, wavelength, 2)
        x and y of the chief ray's position at infinity, at the nodes of a mesh with the same ends and several times as
        many steps: chief rays need the most accurate interpolation.
    nodes_per_px : (float, float)
        Rows, and columns.
    first : (float, float)
        Place of the first node upwards and to the right of the axis, in nodes.
    mirrored : (bool, bool)
        Whether pixels below the axis, and to the left of it, have the mirror images of the rays on the other side.
    """

    values: np.ndarray
    chief_px: np.ndarray
    nodes_per_px: tuple[float, float]
    first: tuple[float, float]
    mirrored: tuple[bool, bool]

    def from_quarters(self, times: int) -> "MeshRays":
        """As for `HeightRays`; quarters do not turn."""
        up, right = self.nodes_per_px
        chief = self.chief_px[::self.finer, ::self.finer].mean(axis=2, dtype=float)
        across, upwards = np.gradient(chief[..., 0], axis=1) * right, np.gradient(chief[..., 1], axis=0) * up
        return replace(self, values=_from_quarters(self.values, times, across, upwards),
                       nodes_per_px=(times * up, times * right))

    @property
    def eights(self) -> np.ndarray:
        """The values as array (node, eight, 2 + 6 wavelengths, 8)."""
        return self.values.reshape(-1, *self.values.shape[2:])

    @property
    def nodes(self) -> tuple[int, int, float]:
        """Columns, rows, and columns in a pixel."""
        rows, columns = self.values.shape[:2]
        return columns, rows, self.nodes_per_px[1]

    @property
    def finer(self) -> int:
        """Steps of the finer mesh in a step."""
        return (len(self.chief_px) - 1) // (len(self.values) - 1)

    @property
    def mesh(self) -> tuple[float, float, float, int, int, int, int]:
        """Rows in a pixel, the place of the first column and row, the address of the chief rays, their steps in a step,
        and whether the columns and rows are mirrored."""
        up, right = self.first
        below, left = self.mirrored
        rows, columns = ((count - 1) * self.finer + 1 for count in self.values.shape[:2])
        chief = address(self.chief_px, np.float32, (rows, columns, (self.values.shape[3] - STOP) // QUANTITIES, 2))
        return self.nodes_per_px[0], right, up, chief, self.finer, left, below


@dataclass(frozen=True, eq=False)
class Casting:
    """A sensor, its rays, and the layers of the scene.

    Attributes
    ----------
    rays : HeightRays or MeshRays
    centre_px : (float, float)
        Row and column of the axis on the sensor.
    per_focal : (float, float)
        One over the focal lengths to the right and up, in pixels, of a panoramic capture; 0 for a plane capture.
    shrinkage : float32 array (step,)
        Radii in a panoramic capture over those on a plane, at even steps from 0 to 1 of t / (1 + t), where t is the
        tangent of the angle from the axis.
    blades : float32 array (blade, 2)
        The directions that an iris's blades face; empty without an iris.
    blade_shape : (float, float, float)
        Margin, bend and slope: margin - bend r^2 - slope (position . direction) is the distance from a blade's edge, in
        semi-apertures, negative for blocked rays.
    cell_of_eight : float
        Side of a ray's cell if a pixel has eight rays, in semi-apertures.
    layers : tuple of LayerArrays
        The nearest first.
    faint : tuple of float
        For each wavelength, radiance that is negligible compared with the visible radiance.
    meetings : array (tile row, tile column, layer) of MEETING
        The start of the search for a layer; its number of steps, below 0 if rays cannot meet the layer; whether
        anything in the layer's reachable part may be in focus; whether that part is opaque; the layer's level; and the
        number of cells in a pixel of this level along a side.
    first_eights, eights : int64 arrays (tile row, tile column)
        The first and the number of the groups of eight rays; pixels of tiles with 0 are not written.
    steps : int64 array (tile row, tile column)
        Distance between the pixels that are cast, from 1 to `tile_px`; those between them are interpolated.
    tile_px : int
    """

    rays: HeightRays | MeshRays
    centre_px: tuple[float, float]
    per_focal: tuple[float, float]
    shrinkage: np.ndarray
    blades: np.ndarray
    blade_shape: tuple[float, float, float]
    cell_of_eight: float
    layers: tuple[LayerArrays, ...]
    faint: tuple[float, ...]
    meetings: np.ndarray
    first_eights: np.ndarray
    eights: np.ndarray
    steps: np.ndarray
    tile_px: int

    @property
    def wavelengths(self) -> int:
        return (self.rays.values.shape[-2] - STOP) // QUANTITIES

    def make_levels(self) -> None:
        """Make the levels of all layers, before several threads read them."""
        for layer in self.layers:
            _ = layer.levels


def rays_shape(nodes: int, eights: int, wavelengths: int) -> tuple[int, ...]:
    """The shape of the values of rays at a number of nodes."""
    return nodes, eights, STOP + QUANTITIES * wavelengths, 8


def _from_quarters(values, times, *magnifications):
    """Rays whose positions at infinity are moved, in every four, to the middles of a pixel's quarters.

    `magnifications` are these positions' changes, for both directions, with the place on the sensor: arrays (node...).
    """
    moved, lanes = values.copy(), np.arange(8)
    for axis, (half, magnification) in enumerate(zip((lanes % 2, lanes // 2 % 2), magnifications, strict=True)):
        quarter = times * magnification[..., None] * (half / 2 - 0.25)
        moved[..., STOP + axis::QUANTITIES, :] += quarter[..., None, None, :].astype(np.float32)
    return moved
