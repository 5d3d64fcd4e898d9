"""The field map of a lens without rotational symmetry. `field_map` documents its methods."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from ...image.pixel_grid import PixelGrid
from ...image.sampling import Sampling
from ...lens.grid_lens import GridLens
from ...rays.grid_rays import GridRayTable
from ...runtime.memory import MemoryBudget
from ..in_capture import in_capture
from ..mirror_symmetry import Planes
from ..psf_samples import psf_radius_px, telling_wavelengths
from .capture import overscan_px, reach_px
from .first_order import first_order_rays
from .geometry import FieldEnd, GridGeometry, SplineFit
from .ideal_image import GridIdealImage
from .layout import GridLayout
from .node_psfs import NodePsfs, Part, PlacedPsfs
from .nodes import PlaneNodes
from .pencils import PixelRays, packed_values
from .picture_psfs import PicturePsfs
from .psf_table import PsfTables
from .uniform_light import picture_illumination

DIAGONAL_PLACES = 1025


class GridField:
    """A lens without rotational symmetry at one wavelength.

    Parameters
    ----------
    lens : GridLens
    wavelength_nm : float
    end : FieldEnd
        Of the lens.

    Raises
    ------
    LensError
        If the wavelength is outside the lens data, or the distortion folds the field.
    """

    def __init__(self, lens: GridLens, wavelength_nm: float, end: FieldEnd) -> None:
        self._lens, self._optics, self._end = lens, lens.at_wavelength(wavelength_nm), end
        self._geometry = GridGeometry(self._optics, lens.name)
        self.transmittance = self._optics.transmittance

    @property
    def nbytes(self) -> int:
        return self._geometry.nbytes

    @property
    def distortion(self) -> SplineFit:
        return self._geometry.distortion

    @property
    def illumination(self) -> SplineFit:
        return self._geometry.illumination

    def source_mm(self, x_mm: np.ndarray, y_mm: np.ndarray,
                  capture: PixelGrid | None = None) -> tuple[np.ndarray, np.ndarray]:
        ideal_mm = self._geometry.source_mm(x_mm, y_mm)
        return in_capture(ideal_mm, self._lens, capture)[0] if capture else ideal_mm

    def landing_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._geometry.landing_mm(x_mm, y_mm)

    def relative_illumination(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        light, grid = picture_illumination(self._optics, self._geometry)

        def at(x_mm, y_mm):
            return scipy.ndimage.map_coordinates(light, np.broadcast_arrays(*grid.index_of(x_mm, y_mm)), order=1,
                                                 mode="nearest")

        return at(x_mm, y_mm) / at(np.zeros(1), np.zeros(1))

    def relative_flux(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        return self._geometry.relative_flux(x_mm, y_mm)

    def within(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        return self._end.within(x_mm, y_mm)

    def share_beyond(self, frame: PixelGrid) -> float:
        return self._end.share_beyond(frame)

    def psfs(self, part: Part, planes: Planes) -> PlacedPsfs:
        return PlacedPsfs(NodePsfs(self._optics, planes.picture.pitch_um, part), _extent_mm(self._lens),
                          PlaneNodes.of(self._optics, planes.grid), planes)

    def ideal_image(self, capture: PixelGrid, planes: Planes, *, vignette: bool, precision: str,
                    memory: MemoryBudget) -> GridIdealImage:
        return GridIdealImage(self._lens, self._geometry, self._end if vignette else None, self.transmittance, capture,
                              planes, precision=precision, memory=memory)


@dataclass(frozen=True)
class GridFieldMap:
    """A lens without rotational symmetry."""

    lens: GridLens

    @property
    def rotationally_symmetric(self) -> bool:
        return False

    @property
    def mirror_symmetric(self) -> bool:
        return all(self.lens.mirrored)

    @property
    def extent_mm(self) -> float:
        return _extent_mm(self.lens)

    @property
    def light_extent_mm(self) -> float:
        return np.inf

    def at_wavelength(self, wavelength_nm: float) -> GridField:
        return GridField(self.lens, wavelength_nm, self._end)

    @cached_property
    def _end(self):
        return FieldEnd(self.lens)

    def covered_diagonal(self, sensor_mm: tuple[float, float]) -> float:
        share = np.linspace(0, 1, DIAGONAL_PLACES)
        half_mm = np.outer(np.array(sensor_mm) / 2, share)
        inside = np.all([self._end.within(x * half_mm[0], y * half_mm[1]) for x in (-1, 1) for y in (-1, 1)], axis=0)
        return float(share[np.argmin(inside) - 1]) if not inside.all() else 1.0

    def overscan_px(self, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
                    psf_radius_px: int) -> tuple[int, int]:
        return overscan_px(self.lens, capture, wavelengths_nm, psf_radius_px)

    def reach_px(self, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray, psf_radius_px: int) -> int:
        return reach_px(self.lens, capture, wavelengths_nm, psf_radius_px)

    def psf_radius_px(self, pitch_um: float) -> int:
        return psf_radius_px(self.lens, pitch_um)

    def table_wavelengths(self, sampling: Sampling) -> Sequence[float] | np.ndarray:
        return telling_wavelengths(self.lens, sampling)

    def layout(self, pitch_um: float) -> GridLayout:
        return GridLayout.of(self.lens, pitch_um)

    def node_psfs(self, sampling: Sampling, planes: Planes, part: Part, steps: int,
                  precision: str) -> PsfTables:
        return PsfTables(self.lens, sampling.wavelengths_nm, planes, part, precision)

    def picture_psfs(self, sampling: Sampling, most_energy: float) -> PicturePsfs:
        return PicturePsfs(self.lens, sampling, most_energy)

    def first_order_rays(self, reach: float) -> GridRayTable:
        return first_order_rays(self.lens, reach)

    def packed_ray_values(self, count: int, wavelengths: int) -> int:
        return packed_values(self.lens.mirrored, count, wavelengths)

    def pixel_rays(self, table: GridRayTable, sensor: PixelGrid) -> PixelRays:
        return PixelRays(table, sensor)


def _extent_mm(lens):
    """Distance from the axis that the lens data reach along both sides of the field."""
    return float(min(np.abs(lens.x_mm[[0, -1]]).max(), np.abs(lens.y_mm[[0, -1]]).max()))
