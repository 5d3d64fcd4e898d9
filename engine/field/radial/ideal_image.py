"""The ideal image: irradiance on the sensor before the blur, from distortion and illumination (Eq. 2)."""


import numpy as np

from ...image.irradiance import irradiance_per_radiance
from ...image.pixel_grid import PixelGrid
from ...kernels.footprints import RadialGeometry
from ...kernels.footprints import footprints as compiled_footprints
from ...kernels.library import NUMPY, running
from ...lens.radial_lens import RadialLens
from ...runtime.memory import MemoryBudget
from ...runtime.threads import in_bands
from ..mirror_symmetry import Planes
from .capture import capture_radius
from .distortion import RIM_PX, FieldGeometry, footprints, squeeze

BAND_PIXELS = 1 << 16  # processed together
CURVE_SAMPLES = 1 << 13  # linear interpolation between them is accurate to 3e-9 of the field
ROUNDING = 1e-9  # of heights


class IdealImage:
    """Converts radiance to irradiance at one wavelength, on one pixel grid.

    Parameters
    ----------
    lens : RadialLens
    field : FieldGeometry
    transmittance : float
        Field and transmittance are those at this wavelength.
    capture : PixelGrid
        The radiance's pixel grid.
    planes : Planes
        Planes of the resulting picture; folded if the capture may be folded, too.
    vignette : bool
        Whether pixels beyond the last field height stay black; otherwise relative illumination is constant there.
    precision : "float32" or "float64"
    memory : MemoryBudget
        For footprints and curves that the next picture reuses.
    """

    def __init__(self, lens: RadialLens, field: FieldGeometry, transmittance: float, capture: PixelGrid,
                 planes: Planes, *, vignette: bool, precision: str, memory: MemoryBudget) -> None:
        self._field = field
        self._per_radiance = irradiance_per_radiance(transmittance, lens.f_number_effective)
        self._capture_radius = capture_radius(capture, lens)
        self._capture, self._planes = Planes(capture, planes.folded), planes
        self._last_height_mm = lens.heights_mm[-1] * (1 + ROUNDING) if vignette else np.inf
        self._precision, self._memory = precision, memory
        self._parts = planes.grid.pitch_um / capture.pitch_um  # of the capture's pixels across one of the picture's
        self._bands, self._curves = {}, None

    def irradiance(self, radiance: np.ndarray) -> np.ndarray:
        """Distorted irradiance of a plane of radiance: array (plane, row, column) of `planes`."""
        if self._compiled:
            return self._by_kernels(radiance.astype(np.float32, copy=False))
        capture = self._capture.split(radiance, RIM_PX)
        x_mm, y_mm = self._planes.grid.axes_mm()
        ideal = np.empty((len(capture), y_mm.size, x_mm.size), self._precision)

        def work(rows):
            band, factor = self._band(rows, x_mm, y_mm)
            ideal[:, rows] = band.average(capture) * factor

        in_bands(work, y_mm.size, BAND_PIXELS // x_mm.size)
        return ideal

    @property
    def _compiled(self):
        return self._precision == "float32" and running() != NUMPY

    def _by_kernels(self, radiance):
        """As `irradiance`, with a lookup of all geometry by the distance from the axis."""
        ideal = np.empty((self._planes.count, *self._planes.grid.shape_px), np.float32)
        geometry, (capture, centre_px) = self._geometry(), self._capture.together(radiance, RIM_PX)

        def work(rows):
            compiled_footprints(geometry, capture, centre_px, rows, ideal)

        in_bands(work, ideal.shape[1], BAND_PIXELS // ideal.shape[2])
        return ideal

    def _geometry(self):
        """The geometry as curves, with a sample at the end of the lens data, where curves may have a kink."""
        if self._curves:
            return self._curves
        pitch_mm, far_px = self._planes.grid.pitch_um * 1e-3, self._planes.grid.farthest_px
        inside_px = min(self._field.last_real_mm / pitch_mm, far_px)
        per_px = np.ceil(CURVE_SAMPLES * inside_px / far_px) / inside_px
        real_mm = np.arange(np.ceil(far_px * per_px) + 1) * (pitch_mm / per_px)
        height_mm, tangential, radial = squeeze(real_mm, self._field, self._capture_radius)
        curves = RadialGeometry.of(
            self._planes.grid.centre_px, per_px, self._parts * tangential, self._parts * radial,
            self._per_radiance * self._field.relative_flux(height_mm),
            self._field.real_height_mm(self._last_height_mm) / pitch_mm)
        if self._memory.take(curves.nbytes):
            self._curves = curves
        return curves

    def _band(self, rows, x_mm, y_mm):
        """Footprints of a band of rows, and its irradiance per radiance."""
        if rows.start in self._bands:
            return self._bands[rows.start]
        band, height_mm = footprints(self._capture.grid.framed(RIM_PX), x_mm, y_mm[rows], self._field,
                                     self._capture_radius, self._precision, self._parts)
        factor = self._per_radiance * self._field.relative_flux(height_mm)
        factor = np.where(height_mm > self._last_height_mm, 0, factor).astype(self._precision)
        if self._memory.take(band.nbytes + factor.nbytes):
            self._bands[rows.start] = band, factor
        return band, factor
