"""The field map of a rotationally symmetric lens. `field_map` documents its methods."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...image.pixel_grid import PixelGrid
from ...image.sampling import Sampling
from ...lens.radial_lens import RadialLens
from ...rays.ray_table import RayTable
from ...runtime.memory import MemoryBudget
from ..mirror_symmetry import Planes
from ..psf_samples import psf_radius_px, telling_wavelengths
from .capture import capture_radius, light_extent_mm, overscan_px, reach_px
from .distortion import FieldGeometry, PolynomialFit, squeeze
from .first_order import first_order_rays
from .ideal_image import RadialIdealImage
from .layout import RadialLayout
from .pencils import PixelRays, packed_values
from .picture_psfs import PicturePsfs
from .psf_bank import PlacedPsfs, PsfBank
from .psf_table import PsfTables
from .uniform_light import picture_illumination

CURVE_HEIGHTS = 385  # linear interpolation between them is accurate to 1e-3, next to rims that vignette
Part = Callable[[PsfBank], PsfBank]


class RadialField:
    """A rotationally symmetric lens at one wavelength.

    Parameters
    ----------
    lens : RadialLens
    wavelength_nm : float

    Raises
    ------
    LensError
        If the wavelength is outside the lens data, or the distortion folds the field.
    """

    def __init__(self, lens: RadialLens, wavelength_nm: float) -> None:
        self._lens, self._optics = lens, lens.at_wavelength(wavelength_nm)
        self._geometry = FieldGeometry(self._optics, lens.name)
        self.transmittance = self._optics.transmittance

    @property
    def nbytes(self) -> int:
        return self._geometry.nbytes

    @property
    def distortion(self) -> PolynomialFit:
        return self._geometry.distortion

    @property
    def illumination(self) -> PolynomialFit:
        return self._geometry.illumination

    def source_mm(self, x_mm: np.ndarray, y_mm: np.ndarray,
                  capture: PixelGrid | None = None) -> tuple[np.ndarray, np.ndarray]:
        radius = capture_radius(capture, self._lens) if capture else None
        _, scale, _ = squeeze(np.hypot(x_mm, y_mm), self._geometry, radius)
        return scale * x_mm, scale * y_mm

    def landing_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        paraxial_mm = np.hypot(x_mm, y_mm)
        real_mm = self._geometry.real_height_mm(paraxial_mm)
        scale = 1 / self._geometry.paraxial_per_real(real_mm, paraxial_mm)
        return scale * x_mm, scale * y_mm

    def relative_illumination(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        heights_mm = np.linspace(0, self._geometry.last_real_mm, CURVE_HEIGHTS)
        curve = picture_illumination(self._optics, self._geometry, heights_mm)
        return np.interp(np.hypot(x_mm, y_mm), heights_mm, curve, right=0.0 if self._lens.dark_beyond else None)

    def relative_flux(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        return self._geometry.relative_flux(self._geometry.paraxial_height_mm(np.hypot(x_mm, y_mm)))

    def within(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        return np.hypot(x_mm, y_mm) <= self._geometry.last_real_mm

    def share_beyond(self, frame: PixelGrid) -> float:
        if self._lens.dark_beyond:
            return 0.0
        last_mm, (x_mm, y_mm) = self._geometry.last_real_mm, frame.axes_mm()
        half_mm = np.sqrt(np.maximum(last_mm**2 - y_mm**2, 0))
        inside = np.searchsorted(x_mm, half_mm, side="right") - np.searchsorted(x_mm, -half_mm)
        return 1 - float(inside[np.abs(y_mm) <= last_mm].sum()) / (x_mm.size * y_mm.size)

    def psfs(self, part: Part, planes: Planes) -> PlacedPsfs:
        return PlacedPsfs(lambda: part(PsfBank.of(self._optics, planes.picture.pitch_um)), self._geometry, planes)

    def ideal_image(self, capture: PixelGrid, planes: Planes, *, vignette: bool, precision: str,
                    memory: MemoryBudget) -> RadialIdealImage:
        return RadialIdealImage(self._lens, self._geometry, self.transmittance, capture, planes, vignette=vignette,
                                precision=precision, memory=memory)


@dataclass(frozen=True)
class RadialFieldMap:
    """A rotationally symmetric lens."""

    lens: RadialLens

    @property
    def rotationally_symmetric(self) -> bool:
        return True

    @property
    def mirror_symmetric(self) -> bool:
        return self.lens.mirror_symmetric

    @property
    def extent_mm(self) -> float:
        return float(self.lens.real_height_mm[:, -1].min())

    def at_wavelength(self, wavelength_nm: float) -> RadialField:
        return RadialField(self.lens, wavelength_nm)

    @property
    def light_extent_mm(self) -> float:
        return light_extent_mm(self.lens)

    def covered_diagonal(self, sensor_mm: tuple[float, float]) -> float:
        if self.lens.dark_beyond:
            return 1.0
        nm = self.lens.nearest_nm(self.lens.reference_wavelength_nm)
        return min(1.0, 2 * float(self.lens.real_height_at(nm)[-1]) / np.hypot(*sensor_mm))

    def overscan_px(self, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
                    psf_radius_px: int) -> tuple[int, int]:
        return overscan_px(self.lens, capture, wavelengths_nm, psf_radius_px)

    def reach_px(self, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray, psf_radius_px: int) -> int:
        return reach_px(self.lens, capture, wavelengths_nm, psf_radius_px)

    def psf_radius_px(self, pitch_um: float) -> int:
        return psf_radius_px(self.lens, pitch_um)

    def table_wavelengths(self, sampling: Sampling) -> Sequence[float] | np.ndarray:
        return telling_wavelengths(self.lens, sampling)

    def layout(self, pitch_um: float) -> RadialLayout:
        return RadialLayout.of(self.lens, pitch_um)

    def node_psfs(self, sampling: Sampling, planes: Planes, part: Part, steps: int, precision: str) -> PsfTables:
        return PsfTables(self.lens, sampling.wavelengths_nm, planes, part, steps, precision)

    def first_order_rays(self, reach: float) -> RayTable:
        return first_order_rays(self.lens, reach)

    def packed_ray_values(self, count: int, wavelengths: int) -> int:
        return packed_values(count, wavelengths)

    def pixel_rays(self, table: RayTable, sensor: PixelGrid) -> PixelRays:
        return PixelRays(table, sensor)

    def picture_psfs(self, sampling: Sampling, most_energy: float) -> PicturePsfs:
        return PicturePsfs(self.lens, sampling, most_energy)
