"""The ideal image: irradiance on the sensor before the blur, from distortion and illumination (Eq. 2)."""

from abc import ABC, abstractmethod

import numpy as np

from ..image.pixel_grid import PixelGrid
from ..kernels.footprints import MeshGeometry, RadialGeometry
from ..kernels.footprints import footprints as compiled_footprints
from ..kernels.library import NUMPY, running
from ..runtime.memory import MemoryBudget
from ..runtime.threads import in_bands
from .footprints import RIM_PX, Footprints
from .mirror_symmetry import Planes

BAND_PIXELS = 1 << 16  # processed together


class IdealImage(ABC):
    """Converts radiance to irradiance at one wavelength, on one pixel grid.

    Parameters
    ----------
    capture : PixelGrid
        The radiance's pixel grid.
    planes : Planes
        Planes of the resulting picture; folded if the capture may be folded, too.
    precision : "float32" or "float64"
    memory : MemoryBudget
        For footprints and geometry that the next picture reuses.
    """

    def __init__(self, capture: PixelGrid, planes: Planes, precision: str, memory: MemoryBudget) -> None:
        self._capture, self._planes = Planes(capture, planes.folded), planes
        self._precision, self._memory = precision, memory
        self._parts = planes.grid.pitch_um / capture.pitch_um  # of the capture's pixels across one of the picture's
        self._bands, self._geometry = {}, None

    @abstractmethod
    def compiled_geometry(self) -> RadialGeometry | MeshGeometry:
        """The lens's geometry for the compiled loops."""

    @abstractmethod
    def footprints(self, x_mm: np.ndarray, y_mm: np.ndarray) -> tuple[Footprints, np.ndarray]:
        """Footprints of pixels at these positions, arrays (column,) and (row,), in the capture with a rim of RIM_PX;
        and their irradiance per radiance."""

    def irradiance(self, radiance: np.ndarray) -> np.ndarray:
        """Distorted irradiance of a plane of radiance: array (plane, row, column) of `planes`."""
        if self._precision == "float32" and running() != NUMPY:
            plane = radiance.astype(np.float32, copy=False)
            return self._by_kernels(plane if plane[:1].flags.c_contiguous else plane.copy())
        capture = self._capture.split(radiance, RIM_PX)
        x_mm, y_mm = self._planes.grid.axes_mm()
        ideal = np.empty((len(capture), y_mm.size, x_mm.size), self._precision)

        def work(rows):
            band, factor = self._band(rows, x_mm, y_mm)
            ideal[:, rows] = band.average(capture) * factor

        in_bands(work, y_mm.size, BAND_PIXELS // x_mm.size)
        return ideal

    def _by_kernels(self, radiance):
        """As `irradiance`, with a look-up of all geometry."""
        ideal = np.empty((self._planes.count, *self._planes.grid.shape_px), np.float32)
        geometry, (capture, centre_px) = self._looked_up(), self._capture.together(radiance, RIM_PX)

        def work(rows):
            compiled_footprints(geometry, capture, centre_px, rows, ideal)

        in_bands(work, ideal.shape[1], BAND_PIXELS // ideal.shape[2])
        return ideal

    def _looked_up(self):
        geometry = self._geometry or self.compiled_geometry()
        if not self._geometry and self._memory.take(geometry.nbytes):
            self._geometry = geometry
        return geometry

    def _band(self, rows, x_mm, y_mm):
        """Footprints of a band of rows, and its irradiance per radiance."""
        if rows.start in self._bands:
            return self._bands[rows.start]
        band, factor = self.footprints(x_mm, y_mm[rows])
        factor = factor.astype(self._precision)
        if self._memory.take(band.nbytes + factor.nbytes):
            self._bands[rows.start] = band, factor
        return band, factor
