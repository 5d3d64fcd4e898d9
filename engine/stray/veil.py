"""Veiling glare: light that the surfaces and the barrel of a lens scatter over the picture.

A surface scatters around the direction of a ray by the Harvey-Shack model (J. E. Harvey, Light-scattering
characteristics of optical surfaces, University of Arizona, 1976): (1 + (b / knee)^2)^(slope / 2) at the difference b of
direction cosines. By Lagrange's invariant, this is the distance y b / u' on the sensor, with the height y of the
marginal ray at the surface and its slope u' behind the lens. Polished surfaces scatter the share
(2 pi dn roughness / wavelength)^2, with the step dn of the refractive index. Particles larger than a wavelength scatter
twice the light that falls on them (H. C. van de Hulst, Light scattering by small particles, 1957). The barrel reflects
diffusely, and its light falls off as cos^4.
"""

from dataclasses import dataclass, replace
from itertools import groupby
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from ..field.field_map import field_map
from ..field.mirror_symmetry import Planes
from ..image.pixel_grid import PixelGrid
from ..image.spectral_image import SpectralImage
from ..lens import Lens
from ..rays.focus import build_system
from ..runtime.errors import InputError
from ..runtime.memory import MemoryBudget
from .arrivals import Arrivals, arrivals
from .cells import Cells, spread_from_afar, spread_in_cells, transformed

ROUGH_KNEE, ROUGH_SLOPE = 0.01, -1.5  # of polish
DUST_KNEE, DUST_SLOPE = 0.03, -2.5  # of particles of some 20 um
HAZE_KNEE, HAZE_SLOPE = 0.3, -3.0  # of droplets of some um
DIFFUSE_KNEE, DIFFUSE_SLOPE = 0.5, -4.0  # cos^4, from a barrel as far from the sensor as the field reaches
TYPICAL_STEPS = (0.6,) * 12  # steps of the index in a lens without a prescription
LEAST_STEP = 0.2  # of the index at a surface that air can reach
TRAP_AREA = 0.05  # of the chart
CHART_PX = 240  # along the shorter side of the chart for a glare index


@dataclass(frozen=True)
class Cleanliness:
    """What scatters light in a lens.

    Attributes
    ----------
    roughness_nm : float
        RMS, of each surface.
    dust, haze : float
        Share of the area that particles cover on the two outer surfaces, and droplets on each surface next to air.
    barrel : float
        Share of the light that the barrel sends to the sensor's plane.
    """

    roughness_nm: float
    dust: float
    haze: float
    barrel: float


CLEANLINESS = {"new": Cleanliness(1.0, 2e-4, 0.0, 0.008), "dusty": Cleanliness(1.0, 8e-3, 0.0, 0.008),
               "hazy": Cleanliness(2.0, 2e-3, 2e-3, 0.008)}
"""Estimates. They give full-frame lenses glare indices of about 0.3 %, 1.5 %, and 2 to 4 %."""


@dataclass(frozen=True)
class Lobe:
    """Light that is scattered around the place of a point's image.

    Attributes
    ----------
    share : float
        Of the point's light, at the reference wavelength.
    power : float
        Of the wavelength, to which the share is proportional.
    lever_mm : float
        Distance on the sensor per difference of direction cosines.
    knee, slope : float
        See this module.
    farthest : float
        Largest difference of direction cosines.
    """

    share: float
    power: float
    lever_mm: float
    knee: float
    slope: float
    farthest: float = 1.0

    def spread(self, distance_mm: np.ndarray) -> np.ndarray:
        """The share of a point's light per mm^2."""
        difference = distance_mm / self.lever_mm
        bright = (1 + (difference / self.knee) ** 2) ** (self.slope / 2)
        rest = self.slope + 2
        all_light = 2 * np.pi * self.knee**2 / rest * ((1 + (self.farthest / self.knee) ** 2) ** (rest / 2) - 1)
        return np.where(difference <= self.farthest, self.share * bright / (all_light * self.lever_mm**2), 0)


@dataclass(frozen=True)
class Veil:
    """How a lens scatters light.

    Attributes
    ----------
    lobes : tuple of Lobe
        By power.
    reference_nm : float
    """

    lobes: tuple[Lobe, ...]
    reference_nm: float

    def share(self, wavelengths_nm: ArrayLike) -> np.ndarray:
        """The share of a point's light that is scattered, and that its image therefore loses: array (wavelength,)."""
        relative = np.asarray(wavelengths_nm) / self.reference_nm
        return np.sum([lobe.share * relative**lobe.power for lobe in self.lobes], axis=0)

    def scaled(self, factor: float) -> Self:
        """A veil of so many times the light."""
        return replace(self, lobes=tuple(replace(lobe, share=factor * lobe.share) for lobe in self.lobes))


def veil_of(lens: Lens, cleanliness: str) -> Veil:
    """The veil of a lens of one of `CLEANLINESS`. Without a prescription, it has typical surfaces in its pupil."""
    state, nm = CLEANLINESS[cleanliness], float(lens.nearest_nm(lens.reference_wavelength_nm))
    steps, levers_mm = _surfaces(lens)
    lobes = [Lobe((2 * np.pi * step * state.roughness_nm / nm) ** 2, -2.0, lever_mm, ROUGH_KNEE, ROUGH_SLOPE)
             for step, lever_mm in zip(steps, levers_mm, strict=True)]
    in_air = levers_mm[steps > LEAST_STEP]
    lobes += [Lobe(2 * state.dust, 0.0, lever_mm, DUST_KNEE, DUST_SLOPE) for lever_mm in in_air[[0, -1]]]
    lobes += [Lobe(2 * state.haze, 0.0, lever_mm, HAZE_KNEE, HAZE_SLOPE) for lever_mm in in_air if state.haze]
    lobes.append(Lobe(state.barrel, 0.0, 2 * field_map(lens).extent_mm, DIFFUSE_KNEE, DIFFUSE_SLOPE, np.inf))
    return Veil(tuple(lobes), nm)


def _surfaces(lens):
    """Steps of the index, and levers in mm, of the surfaces of a lens: arrays (surface,)."""
    if lens.prescription is None:
        return np.array(TYPICAL_STEPS), np.full(len(TYPICAL_STEPS), lens.efl_mm)
    system = build_system(lens.prescription)
    steps = np.abs(np.diff(system.indices_at([lens.reference_wavelength_nm])[:, 0]))
    levers_mm = np.abs(system.marginal_heights_mm / system.marginal_slope)
    return steps[steps > 0], levers_mm[steps > 0]


def veil_with_index(lens: Lens, frame: PixelGrid, cleanliness: str, index: float) -> Veil:
    """The veil of a lens with this glare index on a sensor's frame, distributed as that of a cleanliness.

    Raises
    ------
    InputError
        More than all light would be scattered.
    """
    veil = veil_of(lens, cleanliness)
    clean, scattered = _photographed(lens, frame, veil)
    white, trap = _patches(clean.shape)
    lost = float(veil.share(veil.reference_nm)) * clean[white].mean() - scattered[white].mean()
    veil = veil.scaled(index * clean[white].mean() / (scattered[trap].mean() + index * lost))
    if not veil.share(lens.wavelengths_nm).max() < 1:
        raise InputError("stray light", "glare index", f"{index:.3g}",
                         f"more than all light would be scattered by the {cleanliness} {lens.name}: reduce it")
    return veil


def glare_index(lens: Lens, frame: PixelGrid, veil: Veil) -> float:
    """The glare index of a lens on a sensor's frame at its reference wavelength: `index_in` its image of the chart."""
    clean, scattered = _photographed(lens, frame, veil)
    return index_in((1 - float(veil.share(veil.reference_nm))) * clean + scattered)


def glare_chart(lens: Lens, frame: PixelGrid, wavelengths_nm: np.ndarray) -> SpectralImage:
    """The radiance of a chart for image flare as in ISO 18844: white, with a light trap in the middle.

    The white area fills the frame, and the trap, a square, TRAP_AREA of it.
    """
    cube = np.ones((len(wavelengths_nm), *frame.shape_px), np.float32)
    cube[:, *_square(frame.shape_px, 1)] = 0
    return SpectralImage(cube, wavelengths_nm, grid=replace(frame, squeeze=lens.squeeze))


def index_in(irradiance: np.ndarray) -> float:
    """The glare index in an image of the chart, array (row, column): the irradiance in the middle of the trap over the
    one of the white area around it."""
    white, trap = _patches(irradiance.shape)
    return float(irradiance[trap].mean() / irradiance[white].mean())


def _patches(shape_px):
    """The pixels that are measured: masks (row, column) of the white area and of the trap."""
    white, trap = (np.zeros(shape_px, bool) for _ in range(2))
    trap[_square(shape_px, 0.5)] = white[_square(shape_px, 2)] = True
    white[_square(shape_px, 1.5)] = False
    return white, trap


def _square(shape_px, size):
    """Rows and columns of a square in the middle, `size` times as wide as the trap."""
    side = size * np.sqrt(TRAP_AREA * np.prod(shape_px))
    return tuple(slice(round((n - side) / 2), round((n + side) / 2)) for n in shape_px)


def _photographed(lens, frame, veil):
    """The chart through a lens, on coarse pixels: its sharp image without losses, and the scattered light."""
    coarser = min(frame.shape_px) / CHART_PX
    shape = [round(n / coarser) for n in frame.shape_px]
    middle = [(at + 0.5) / coarser - 0.5 for at in frame.centre_px]
    frame = PixelGrid((shape[0], shape[1]), frame.pitch_um * coarser, (middle[0], middle[1]))
    chart = glare_chart(lens, frame, np.array([veil.reference_nm]))
    image = field_map(lens).at_wavelength(veil.reference_nm).ideal_image(
        chart.grid, Planes(frame, False), vignette=False, precision="float32", memory=MemoryBudget(0))
    scattered = np.zeros_like(chart.cube)
    add_veil(scattered, frame, arrivals(chart, lens), veil)
    return image.irradiance(chart.cube[0])[0], scattered[0]


def add_veil(cube: np.ndarray, frame: PixelGrid, light: Arrivals, veil: Veil) -> np.ndarray:
    """Add the scattered light to the irradiance of a sensor's frame. Light that is scattered beyond it is lost.

    Parameters
    ----------
    cube : float32 array (wavelength, row, column)
    frame : PixelGrid
    light : Arrivals
    veil : Veil

    Returns
    -------
    array (wavelength,)
        `Veil.share`, by which the lens image must be dimmed.
    """
    spreads = [((light.wavelengths_nm / veil.reference_nm) ** power, spread)
               for power, spread in _spreads(veil, frame.pitch_um)]
    corners = spread_in_cells(frame, light, spreads) + spread_from_afar(frame, light, spreads)
    Cells(frame.shape_px).add_corners(cube, corners)
    return veil.share(light.wavelengths_nm)


def prepare_veil(frame: PixelGrid, veil: Veil) -> None:
    """Compute what `add_veil` needs for any light."""
    for _, spread in _spreads(veil, frame.pitch_um):
        transformed(frame.shape_px, spread)


def _spreads(veil, pitch_um):
    """The powers of a veil's lobes, and the Spread of the lobes of each."""
    return [(power, _Scatter(tuple(lobes), pitch_um * 1e-3))
            for power, lobes in groupby(veil.lobes, lambda lobe: lobe.power)]


@dataclass(frozen=True)
class _Scatter:
    """The Spread of some lobes, in pixels of this pitch."""

    lobes: tuple[Lobe, ...]
    pitch_mm: float

    def __call__(self, right_px, up_px):
        distance_mm = self.pitch_mm * np.hypot(right_px, up_px)
        return self.pitch_mm**2 * sum(lobe.spread(distance_mm) for lobe in self.lobes)
