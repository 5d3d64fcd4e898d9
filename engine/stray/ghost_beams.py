"""Light of small sources in front of a lens: its direction, and its cross section that the first surface lets in."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ..image.sources import Sources
from ..kernels.ghost_meshes import Blades
from ..kernels.ghosts import MOST_WAVES, Beam, Coated, Openings
from ..kernels.tracing import TracedSurfaces
from ..lens.iris import Opening
from ..prescription.surfaces import sag_and_gradient
from ..prescription.system import System
from ..rays.fields import view_of
from ..rays.trace import traced_surfaces
from ..rays.view import View
from .ghost_bands import Band

INVARIANT_STEPS = 128  # for each unit of (n sin)^2, over which reflectances are interpolated
OUTLINE_RADII, OUTLINE_AZIMUTHS = 5, 32  # points of the first surface
MOST_COATINGS = 4  # in memory, for the next frames
STEEPEST = 0.02  # cosine of the angle to the axis of the lens, beyond which no light enters


@dataclass(frozen=True, eq=False)
class Coatings:
    """What the surfaces of a lens do to light of several wavelengths.

    Attributes
    ----------
    indices : array (surface + 1, wavelength)
        Refractive indices.
    reflectances : array (surface, step, wavelength)
        As in `Coated`.
    """

    indices: np.ndarray
    reflectances: np.ndarray

    def of(self, band: Band) -> Coated:
        """What they do to the light of a band."""
        reflectances = np.zeros((*self.reflectances.shape[:2], MOST_WAVES))
        reflectances[..., :band.waves.size] = self.reflectances[..., band.waves]
        return Coated(self.indices[:, band.traced], band.waves.size, reflectances, INVARIANT_STEPS)


@dataclass(frozen=True, eq=False)
class GhostLens:
    """A lens prepared for tracing ghosts.

    Attributes
    ----------
    system : System
    view : View
    surfaces : TracedSurfaces
    opening : Opening
    openings : Openings
    pairs : int array (pair, 2)
        Surfaces that reflect, the nearer one to the object first. Pairs with the same far surface follow each other,
        from the back to the front, because the loops share their paths.
    """

    system: System
    view: View
    surfaces: TracedSurfaces
    opening: Opening
    openings: Openings
    pairs: np.ndarray

    @cached_property
    def radial(self) -> bool:
        """Whether sources may be turned into one meridional plane."""
        return self.system.prescription.radial

    @property
    def blades(self) -> Blades:
        """The stop's opening, for the loops."""
        return Blades(self.opening.iris.directions, self.opening.shape, self.opening.reach)

    def crossings(self, pairs: np.ndarray) -> np.ndarray:
        """How often the light of each pair crosses the stop, or is reflected there: int array (pair,)."""
        stop = self.system.prescription.stop_index
        near, far = pairs.T
        return 1 + 2 * ((near < stop) & (stop < far)) + ((stop == near) | (stop == far))

    def glass_transmittance(self, wavelengths_nm: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """T of the glass that the light of each pair passes, along the axis: array (pair, wavelength)."""
        gaps = np.arange(len(self.system.glasses))
        times = 1 + 2 * ((gaps >= pairs[:, :1]) & (gaps < pairs[:, 1:]))
        return np.exp(-times @ self.system.optical_depths(wavelengths_nm))


@lru_cache(maxsize=MOST_COATINGS)
def coatings_of(system: System, wavelengths_nm: tuple[float, ...]) -> Coatings:
    """What the surfaces of a lens do to light of these wavelengths."""
    indices = system.indices_at(wavelengths_nm)
    invariants = np.arange(int(np.ceil(INVARIANT_STEPS * indices.max() ** 2)) + 1) / INVARIANT_STEPS
    return Coatings(indices, np.moveaxis(system.reflectances(wavelengths_nm, invariants), 1, -1))


def ghost_lens(system: System, opening: Opening, wavelengths_nm: np.ndarray) -> GhostLens:
    """Prepare a lens; its pairs are of surfaces that reflect at any of the wavelengths."""
    reflecting = np.flatnonzero(system.reflectances(wavelengths_nm, [0.0]).max(axis=(1, 2)) > 0)
    far, near = np.tril_indices(len(reflecting), -1)
    near = far - 1 - near
    return GhostLens(system, view_of(system), traced_surfaces(system.prescription), opening,
                     _openings(system), np.stack([reflecting[near], reflecting[far]], axis=1))


def _openings(system):
    per_half_width = np.zeros((len(system.glasses), 2))
    for index in system.prescription.rectangles:
        per_half_width[index] = 1 / np.array(system.prescription.surfaces[index].half_widths_mm)
    return Openings(1 / system.all_semi_apertures_mm, per_half_width)


def beam_of(lens: GhostLens, direction: np.ndarray, distance_mm: float) -> tuple[Beam, float]:
    """The light of a source, and the azimuth by which to turn it, in radians.

    Parameters
    ----------
    lens : GhostLens
    direction : array (3,)
    distance_mm : float
        As in `Sources`.
    """
    azimuth_rad = 0.0
    along = lens.view.axes.T @ direction
    if lens.radial:
        azimuth_rad = float(np.arctan2(along[1], along[0]) - np.pi / 2)
        along = np.array([0.0, np.hypot(along[0], along[1]), along[2]])
    source_mm = lens.view.viewpoint_mm - distance_mm * along if np.isfinite(distance_mm) else np.full(3, np.inf)
    if np.isfinite(distance_mm):
        along = -source_mm / np.linalg.norm(source_mm)
    across = np.array([1.0, 0.0, 0.0]) - along[0] * along
    across /= np.linalg.norm(across)
    return Beam(np.stack([across, np.cross(along, across), along]), source_mm, distance_mm), azimuth_rad


def beams_of(lens: GhostLens, sources: Sources) -> dict[int, tuple[Beam, float]]:
    """The results of `beam_of` by the numbers of sources, for those whose light can enter the lens."""
    entering = np.flatnonzero((sources.directions @ lens.view.axes)[:, 2] > STEEPEST)
    return {int(number): beam_of(lens, sources.directions[number], float(sources.distance_mm[number]))
            for number in entering}


def entrance_mm(lens: GhostLens, beam: Beam) -> np.ndarray:
    """Limits of the cross section of the light that meets the first surface: left, right, lower, upper."""
    surface = lens.system.prescription.surfaces[0]
    radius_mm = front_radius_mm(lens) * np.linspace(0, 1, OUTLINE_RADII)[:, None]
    azimuth = 2 * np.pi * np.arange(OUTLINE_AZIMUTHS) / OUTLINE_AZIMUTHS
    x, y = radius_mm * np.cos(azimuth), radius_mm * np.sin(azimuth)
    points = np.stack([x, y, sag_and_gradient(surface, x, y)[0]]).reshape(3, -1)
    if np.isfinite(beam.distance_mm):
        from_source = points - beam.source_mm[:, None]
        away = np.linalg.norm(beam.source_mm) / (beam.axes[2] @ from_source)
        points = beam.source_mm[:, None] + from_source * away
    across, up = beam.axes[:2] @ points
    return np.array([0.0 if lens.radial else across.min(), across.max(), up.min(), up.max()])


def front_radius_mm(lens: GhostLens) -> float:
    """Semi-aperture of the first surface, or what the field's light needs there if it is unlimited."""
    system = lens.system
    if system.prescription.stop_index == 0:
        return float(system.stop_semi_aperture_mm * lens.opening.reach)
    halves_mm = system.prescription.surfaces[0].half_widths_mm
    widest_mm = min(system.semi_apertures_mm[0], np.hypot(halves_mm[0], halves_mm[1]) if halves_mm else np.inf)
    if np.isfinite(widest_mm):
        return float(widest_mm)
    return float(abs(system.marginal_heights_mm[0]) * lens.opening.reach
                 + abs(system.entrance_pupil_mm * system.last_height_mm / system.efl_mm))
