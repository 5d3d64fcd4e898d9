"""Stray light on the sensor's frame: ghosts, veil and star together, and what is left out of them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from ..image.irradiance import irradiance_per_radiance
from ..image.layers import LayeredRadiance
from ..image.nonfinite import clamp_fireflies, count_nonfinite
from ..image.pixel_grid import PixelGrid
from ..image.sources import Sources
from ..image.spectral_image import SpectralImage
from ..lens import Lens
from ..lens.entrance_pupil import entrance_pupil_area_mm2
from ..lens.iris import Iris, Opening, opening
from ..prescription.system import system_of
from ..runtime.scratch import zeros_stored_like
from .arrivals import Arrivals, arrivals, fields_in_cells
from .ghost_nodes import GhostNodes, ghost_nodes
from .ghosts import ghosts
from .merging import merged_sources
from .options import AUTO, GHOSTS, STAR, VEIL, StrayOptions
from .picture_sources import picture_sources
from .star import add_stars, prepare_stars, star_share
from .veil import Veil, add_veil, prepare_veil, veil_of, veil_with_index

MOST_SOURCES = 32  # of ghosts
MOST_PAIRS = 10
MOST_VEILS = 4  # in memory, for the next frames


@dataclass(frozen=True, eq=False)
class StrayLight:
    """The stray light of a picture.

    Attributes
    ----------
    cube : float32 array (wavelength, row, column) or None
        Irradiance of the sensor's frame, W m^-2 nm^-1; None if no part was computed.
    remaining : array (wavelength,)
        Share of the lens image's light that its own place keeps: the rest is in the cube.
    sums : dict of str: float
        Sum over the cube of each part that was computed.
    predicted : dict of str: float
        Predicted light of each part that was left out, relative to the light of the lens image.
    sources : int
        Number of sources of ghosts.
    pairs : tuple of (int, int, float)
        The strongest ghosts: the surfaces that reflect, counted from 1, and their share of the ghosts' light.
    neglected : float
        Light of the ghosts that are left out, as a sum over the cube.
    words : tuple of str
        What cannot be computed for this lens, and the remedy.
    """

    cube: np.ndarray | None
    remaining: np.ndarray
    sums: Mapping[str, float] = field(default_factory=dict)
    predicted: Mapping[str, float] = field(default_factory=dict)
    sources: int = 0
    pairs: tuple[tuple[int, int, float], ...] = ()
    neglected: float = 0.0
    words: tuple[str, ...] = ()


def stray_light(radiance: SpectralImage, lens: Lens, options: StrayOptions, accuracy: float, *,
                layers: LayeredRadiance | None = None, outside: Sources | None = None, iris: Iris | None = None
                ) -> StrayLight | None:
    """Compute the stray light that a picture causes on the sensor's frame.

    "auto" predicts the light of each part first and leaves out those below the accuracy.

    Parameters
    ----------
    radiance : SpectralImage
        Scene radiance as for `simulate`, in memory or in a file; the stray light is stored likewise.
    lens : Lens
    options : StrayOptions
    accuracy : float
        Of the lens image: the share of light that may be misplaced.
    layers : LayeredRadiance, optional
        The radiance in layers, which have the distances of sources.
    outside : Sources, optional
        Sources outside the radiance, of the same wavelengths.
    iris : Iris, optional
        The shape of the stop; by default a circle of the same area.

    Returns
    -------
    StrayLight, or None if no part is to be considered

    Raises
    ------
    LensError
        A wavelength is outside the data of a glass or coating.
    """
    considered = options.parts(accuracy)
    if not considered:
        return None
    optics = _Optics(lens, radiance.grid, tuple(map(float, radiance.wavelengths_nm)), options, opening(iris, lens))
    scene = _Scene(_finite(radiance), optics, layers, outside)
    word = no_ghosts(lens, radiance.wavelengths_nm) if GHOSTS in considered else ""
    predicted = {part: scene.share(_PARTS[part].share(optics)) for part in considered if part != GHOSTS or not word}
    wanted = [part for part in predicted if options.stray_light != AUTO or predicted[part] > accuracy]
    left_out = {part: share for part, share in predicted.items() if part not in wanted}
    result = StrayLight(None, np.ones(len(radiance.wavelengths_nm)), predicted=left_out, words=(word,) if word else ())
    if wanted:
        shape = len(radiance.wavelengths_nm), *radiance.frame_px
        result = replace(result, cube=zeros_stored_like(radiance.light, shape))
    for part in wanted:
        result = _with_part(result, part, scene)
    return result


def prepare_stray_light(grid: PixelGrid, wavelengths_nm: tuple[float, ...], lens: Lens, options: StrayOptions,
                        accuracy: float, *, outside: Sources | None = None, iris: Iris | None = None
                        ) -> Iterator[None]:
    """Compute, step by step, what `stray_light` needs for any light in pictures of these pixels.

    The results are in caches. Without sources outside, parts that "auto" leaves out for white light are not prepared.
    """
    optics = _Optics(lens, grid, wavelengths_nm, options, opening(iris, lens))
    for part in options.parts(accuracy):
        if part == GHOSTS and no_ghosts(lens, np.array(wavelengths_nm)):
            continue
        yield
        if outside or options.stray_light != AUTO or _PARTS[part].share(optics).mean() > accuracy:
            yield from _PARTS[part].prepare(optics, outside)


def _finite(radiance):
    """The radiance with NaN and infinite pixels replaced."""
    if not any(map(count_nonfinite, radiance.cube)):
        return radiance
    return replace(radiance, cube=np.stack([clamp_fireflies(plane)[0] for plane in radiance.cube]))


def _with_part(result, part, scene):
    before = sum(result.sums.values())
    result = _PARTS[part].add(result, scene)
    return replace(result, sums={**result.sums, part: float(result.cube.sum(dtype=np.float64)) - before})


@dataclass(frozen=True, eq=False)
class _Optics:
    """What stray light depends on, apart from the light."""

    lens: Lens
    grid: PixelGrid
    wavelengths_nm: tuple[float, ...]
    options: StrayOptions
    opening: Opening

    @property
    def veil(self) -> Veil:
        return _veil(self.lens, self.grid.frame(), self.options)

    @property
    def ghost_nodes(self) -> GhostNodes:
        assert self.lens.prescription is not None  # as `no_ghosts` finds
        return ghost_nodes(system_of(self.lens.prescription), self.opening, self.wavelengths_nm)

    @property
    def farthest_rad(self) -> float:
        """Angle to the axis at the picture's farthest corner."""
        radius_mm = self.grid.farthest_px * self.grid.pitch_um * 1e-3
        focal_mm = self.grid.focal_mm or self.lens.capture_focal_length_mm
        return float(self.grid.projection.angle_rad(np.array(radius_mm / focal_mm)))


@lru_cache(maxsize=MOST_VEILS)
def _veil(lens, frame, options):
    if options.glare_index:
        return veil_with_index(lens, frame, options.cleanliness, options.glare_index / 100)
    return veil_of(lens, options.cleanliness)


@dataclass(frozen=True, eq=False)
class _Scene:
    """What stray light depends on."""

    radiance: SpectralImage
    optics: _Optics
    layers: LayeredRadiance | None
    outside: Sources | None

    @property
    def lens(self):
        return self.optics.lens

    @cached_property
    def inside_light(self):
        """Irradiance of the frame's own light, summed over its pixels: array (wavelength,)."""
        frame = self.radiance.frame().cube.sum(axis=(1, 2), dtype=np.float64)
        return irradiance_per_radiance(self._transmittance, self.lens.f_number_effective) * np.maximum(frame, 0)

    @cached_property
    def all_light(self):
        """As `inside_light`, with the light of sources outside the picture through the entrance pupil."""
        if self.outside is None:
            return self.inside_light
        facing = self.outside.irradiance * np.maximum(self.outside.directions[:, 2:], 0)
        pupil_px = entrance_pupil_area_mm2(self.lens) / self._pixel_mm2
        return self.inside_light + facing.sum(axis=0) * self._transmittance * pupil_px

    @cached_property
    def arrivals(self) -> Arrivals:
        """All light where it arrives on the sensor's plane."""
        return arrivals(self.radiance, self.lens, self.outside, self.layers)

    @cached_property
    def _transmittance(self):
        return np.array([self.lens.at_wavelength(nm).transmittance for nm in self.optics.wavelengths_nm])

    @property
    def _pixel_mm2(self):
        return (self.radiance.pitch_um * 1e-3) ** 2

    def share(self, of_each):
        """Shares (wavelength,) of all light, as a share of the frame's own; infinite in a black one."""
        with np.errstate(over="ignore"):
            return float(np.dot(of_each, self.all_light) / max(self.inside_light.sum(), np.finfo(float).tiny))

    def as_sum(self, watts):
        """Light on the sensor in W/nm as a sum over pixels."""
        return float(watts / (self._pixel_mm2 * 1e-6))


def no_ghosts(lens: Lens, wavelengths_nm: np.ndarray) -> str:
    """Why a lens has no ghosts, and the remedy; "" if it has."""
    if lens.prescription is None:
        return f"{lens.name}: lens data without a prescription have no ghosts; use a prescription"
    if lens.prescription.mirrors:
        return f"{lens.name}: ghosts of mirror lenses are not computed; choose other stray light"
    if not _pairs_share(lens, wavelengths_nm).any():
        return f"{lens.name}: its coatings are unknown and count as ideal, without ghosts; choose them (--coating)"
    return ""


def _pairs_share(lens, wavelengths_nm):
    """Sum over all pairs of surfaces of the product of their reflectances for light along the axis: (wavelength,)."""
    reflected = system_of(lens.prescription).reflectances(wavelengths_nm, [0.0])[..., 0]
    return (reflected.sum(axis=0) ** 2 - (reflected**2).sum(axis=0)) / 2


def _ghosts_share(optics):
    return _pairs_share(optics.lens, optics.wavelengths_nm)


def _prepare_ghosts(optics, outside):
    yield from optics.ghost_nodes.prepare(optics.farthest_rad, outside)


def _add_ghosts(result, scene):
    sources = picture_sources(scene.radiance, scene.lens.capture_focal_length_mm, scene.layers)
    if scene.outside is not None:
        sources = Sources.together([sources, scene.outside])
    sources = merged_sources(sources, MOST_SOURCES)
    if not len(sources):
        return result
    found = ghosts(scene.lens.prescription, sources, scene.radiance.grid, scene.optics.opening,
                   scene.optics.options.neglected)
    for plane, more in zip(result.cube, found.irradiance, strict=True):
        plane += more
    light = np.nansum(found.light, axis=(0, 2))
    total = max(light.sum(), np.finfo(float).tiny)
    pairs = tuple((*found.pairs[index].tolist(), float(light[index] / total))
                  for index in np.argsort(-light, kind="stable")[:MOST_PAIRS] if light[index])
    return replace(result, sources=len(sources), pairs=pairs, neglected=scene.as_sum(found.neglected.sum()))


def _veil_share(optics):
    return optics.veil.share(optics.wavelengths_nm)


def _prepare_veil(optics, _):
    prepare_veil(optics.grid.frame(), optics.veil)
    yield
    fields_in_cells(optics.lens, optics.wavelengths_nm, optics.grid)


def _add_veil(result, scene):
    lost = add_veil(result.cube, scene.radiance.grid.frame(), scene.arrivals, scene.optics.veil)
    return replace(result, remaining=result.remaining - lost)


def _star_share(optics):
    return star_share(optics.lens, optics.opening, np.array(optics.wavelengths_nm))


def _prepare_star(optics, _):
    prepare_stars(optics.lens, optics.opening, optics.grid.frame(), np.array(optics.wavelengths_nm))
    yield
    fields_in_cells(optics.lens, optics.wavelengths_nm, optics.grid)


def _add_star(result, scene):
    lost = add_stars(result.cube, scene.lens, scene.optics.opening, scene.radiance.grid.frame(), scene.arrivals)
    return replace(result, remaining=result.remaining - lost)


@dataclass(frozen=True)
class _Part:
    """A kind of stray light.

    Attributes
    ----------
    share : callable (_Optics) -> array (wavelength,)
        Its share of a point's light, predicted.
    prepare : callable (_Optics, Sources or None) -> iterator
        Steps that compute its data that do not depend on light.
    add : callable (StrayLight, _Scene) -> StrayLight
    """

    share: Callable
    prepare: Callable
    add: Callable


_PARTS = {GHOSTS: _Part(_ghosts_share, _prepare_ghosts, _add_ghosts),
          VEIL: _Part(_veil_share, _prepare_veil, _add_veil), STAR: _Part(_star_share, _prepare_star, _add_star)}
