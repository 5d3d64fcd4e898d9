"""The ideal image of a rotationally symmetric lens, from curves over the distance from the axis."""

import numpy as np

from ...image.irradiance import irradiance_per_radiance
from ...image.pixel_grid import PixelGrid
from ...kernels.footprints import RadialGeometry
from ...lens.radial_lens import RadialLens
from ...runtime.memory import MemoryBudget
from ..footprints import RIM_PX, Footprints
from ..ideal_image import IdealImage
from ..mirror_symmetry import Planes
from .capture import capture_radius
from .distortion import FieldGeometry, footprints, squeeze

CURVE_SAMPLES = 1 << 13  # linear interpolation between them is accurate to 3e-9 of the field
ROUNDING = 1e-9  # of heights


class RadialIdealImage(IdealImage):
    """Converts radiance to irradiance.

    Parameters
    ----------
    lens : RadialLens
    field : FieldGeometry
    transmittance : float
        Field and transmittance are those at this wavelength.
    capture, planes, precision, memory
        See `IdealImage`.
    vignette : bool
        Whether pixels beyond the last field height stay black; otherwise relative illumination is constant there, or
        0 if the lens data end where the light does.
    """

    def __init__(self, lens: RadialLens, field: FieldGeometry, transmittance: float, capture: PixelGrid,
                 planes: Planes, *, vignette: bool, precision: str, memory: MemoryBudget) -> None:
        super().__init__(capture, planes, precision, memory)
        self._field = field
        self._per_radiance = irradiance_per_radiance(transmittance, lens.f_number_effective)
        self._capture_radius = capture_radius(capture, lens)
        self._last_height_mm = lens.heights_mm[-1] * (1 + ROUNDING) if vignette or lens.dark_beyond else np.inf

    def compiled_geometry(self) -> RadialGeometry:
        """The geometry as curves, with a sample at the end of the lens data, where curves may have a kink."""
        pitch_mm, far_px = self._planes.grid.pitch_um * 1e-3, self._planes.grid.farthest_px
        inside_px = min(self._field.last_real_mm / pitch_mm, far_px)
        per_px = np.ceil(CURVE_SAMPLES * inside_px / far_px) / inside_px
        real_mm = np.arange(np.ceil(far_px * per_px) + 1) * (pitch_mm / per_px)
        height_mm, tangential, radial = squeeze(real_mm, self._field, self._capture_radius)
        return RadialGeometry.of(
            self._planes.grid.centre_px, per_px, self._parts * tangential, self._parts * radial,
            self._per_radiance * self._field.relative_flux(height_mm),
            float(self._field.real_height_mm(np.array(self._last_height_mm))) / pitch_mm)

    def footprints(self, x_mm: np.ndarray, y_mm: np.ndarray) -> tuple[Footprints, np.ndarray]:
        """See `IdealImage`."""
        band, height_mm = footprints(self._capture.grid.framed(RIM_PX), x_mm, y_mm, self._field,
                                     self._capture_radius, self._precision, self._parts)
        factor = self._per_radiance * self._field.relative_flux(height_mm)
        return band, np.where(height_mm > self._last_height_mm, 0, factor)
