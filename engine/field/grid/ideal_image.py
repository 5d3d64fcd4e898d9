"""The ideal image of a lens without rotational symmetry, from its geometry at each pixel or on a coarse mesh."""

import numpy as np

from ...image.irradiance import irradiance_per_radiance
from ...image.pixel_grid import PixelGrid
from ...kernels.footprints import MeshGeometry
from ...lens.grid_lens import GridLens
from ...runtime.memory import MemoryBudget
from ..footprints import RIM_PX, Footprints
from ..ideal_image import IdealImage
from ..in_capture import in_capture
from ..mirror_symmetry import Planes
from .geometry import ROUNDING, FieldEnd, GridGeometry

COARSEST_PX = 16  # largest step of a mesh
MESH_ERROR_PX = 5e-4  # of positions between its points
ALONG_FIELD = 256  # points at least, along its longer side: errors of up to about 1e-5 of the light between them


class GridIdealImage(IdealImage):
    """Converts radiance to irradiance.

    Parameters
    ----------
    lens : GridLens
    geometry : GridGeometry
    end : FieldEnd or None
        Where pixels stay black; with None, relative illumination is constant beyond the field.
    transmittance : float
        Geometry and transmittance are those at this wavelength.
    capture, planes, precision, memory
        See `IdealImage`.
    """

    def __init__(self, lens: GridLens, geometry: GridGeometry, end: FieldEnd | None, transmittance: float,
                 capture: PixelGrid, planes: Planes, *, precision: str, memory: MemoryBudget) -> None:
        super().__init__(capture, planes, precision, memory)
        self._lens, self._of_lens, self._end = lens, geometry, end
        self._per_radiance = irradiance_per_radiance(transmittance, lens.f_number_effective)

    def compiled_geometry(self) -> MeshGeometry:
        """The geometry on a mesh that is fine enough for linear interpolation of positions and of light."""
        coarse = self._mesh(COARSEST_PX)[..., :2]
        bends = [np.abs(np.diff(coarse, 2, axis=axis)).max() for axis in (0, 1)]
        step = COARSEST_PX * np.sqrt(8 * MESH_ERROR_PX / max(sum(bends), np.finfo(float).tiny))
        field_px = max(np.ptp(self._of_lens.x_mm), np.ptp(self._of_lens.y_mm)) / (self._planes.picture.pitch_um * 1e-3)
        step = int(np.clip(min(step, field_px / ALONG_FIELD), 1, COARSEST_PX))
        return MeshGeometry.of(self._mesh(step), step)

    def footprints(self, x_mm: np.ndarray, y_mm: np.ndarray) -> tuple[Footprints, np.ndarray]:
        """See `IdealImage`."""
        grid = self._capture.grid.framed(RIM_PX)
        down, right, height, width, factor, end = self._at(x_mm, y_mm)
        band = Footprints.of(grid.centre_px[0] + down, grid.centre_px[1] + right, height, width, grid.shape_px,
                             self._precision)
        return band, np.where(end > 1, 0, factor)

    def _mesh(self, step_px):
        """See `MeshGeometry.of`; at least three rows and columns."""
        rows, columns = (step_px * np.arange(max(-(-(n - 1) // step_px), 2) + 1) for n in self._planes.grid.shape_px)
        return np.stack(self._at(*self._planes.grid.position_mm(rows, columns)), axis=-1)

    def _at(self, x_mm, y_mm):
        """Rows and columns from the axis to footprints in the capture, in pixels; their heights and widths; their
        irradiance per radiance; and their distances relative to the end of the field: six arrays (row, column)."""
        x_mm, y_mm = x_mm[None, :], y_mm[:, None]
        (capture_x_mm, capture_y_mm), by_capture = in_capture(self._of_lens.source_mm(x_mm, y_mm), self._lens,
                                                              self._capture.picture)
        slopes = np.einsum("ij...,jk...->ik...", by_capture, self._of_lens.source_slopes(x_mm, y_mm))
        width, height = (self._parts * extent for extent in _stretch(slopes))
        pitch_mm = self._capture.picture.pitch_um * 1e-3
        factor = self._per_radiance * self._of_lens.relative_flux(x_mm, y_mm)
        end = self._end(x_mm, y_mm) / (1 + ROUNDING) if self._end else np.zeros_like(factor)
        return -capture_y_mm / pitch_mm, capture_x_mm / pitch_mm, height, width, factor, end


def _stretch(slopes):
    """Extent along x and y of a unit square after a linear map, array (2, 2, ...), apart from the map's rotation.

    These are the diagonal elements of the square root of J J^T. For a map without rotation they are those of J.
    """
    (a, b), (c, d) = slopes
    determinant = np.abs(a * d - b * c)
    squares = a * a + b * b, c * c + d * d
    root = np.sqrt(squares[0] + squares[1] + 2 * determinant)
    return tuple((square + determinant) / root for square in squares)
