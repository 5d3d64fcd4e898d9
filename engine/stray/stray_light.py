"""Stray light on the sensor's frame: ghosts, veil and star together, and what is left out of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..depth.iris import Iris
from ..image.irradiance import irradiance_per_radiance
from ..image.layers import LayeredRadiance
from ..image.spectral_image import SpectralImage
from ..lens import Lens
from ..lens.entrance_pupil import entrance_pupil_size_mm
from ..runtime.scratch import zeros_stored_like
from .options import AUTO, GHOSTS, STAR, VEIL, StrayOptions
from .sources import Sources


@dataclass(frozen=True, eq=False)
class StrayLight:
    """The stray light of a picture.

    Attributes
    ----------
    cube : float32 array (wavelength, row, column) or None
        Irradiance of the sensor's frame, W m^-2 nm^-1; None if no part was computed.
    sums : dict of str: float
        Sum over the cube of each part that was computed.
    predicted : dict of str: float
        Predicted light of each part that was left out, as a share of the lens image's.
    sources : int
        Number of sources of ghosts and stars.
    pairs : tuple of (int, int, float)
        The strongest ghosts: the surfaces that reflect, counted from 1, and their share of the ghosts' light.
    neglected : float
        Upper limit of the light of neglected ghosts, as a sum over the cube.
    words : tuple of str
        What cannot be computed for this lens, and the remedy.
    """

    cube: np.ndarray | None = None
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
    chosen = options.parts(accuracy)
    if not chosen:
        return None
    light = _light(radiance, lens, outside)
    predicted = {part: _SHARE[part](lens, options, light) for part in chosen}
    wanted = [part for part in chosen if options.stray_light != AUTO or predicted[part] > accuracy]
    left_out = {part: share for part, share in predicted.items() if part not in wanted}
    if not wanted:
        return StrayLight(predicted=left_out)
    cube = zeros_stored_like(radiance.light, (len(radiance.wavelengths_nm), *radiance.frame_px))
    sums = {}
    for part in wanted:
        _ADD[part](cube, lens, options, light)
        sums[part] = float(cube.sum(dtype=np.float64)) - sum(sums.values())
    return StrayLight(cube, sums, left_out)


@dataclass(frozen=True, eq=False)
class _Light:
    """Irradiance that the lens would put on the frame, per wavelength, as sums over its pixels.

    Attributes
    ----------
    inside : array (wavelength,)
        Of the frame's light.
    outside : array (wavelength,)
        Of sources outside the radiance, if their light through the entrance pupil fell on the frame.
    """

    inside: np.ndarray
    outside: np.ndarray

    def share(self, of_each):
        """The share of the frame's light that these shares of all light at each wavelength are."""
        return float(np.dot(of_each, self.inside + self.outside) / max(self.inside.sum(), np.finfo(float).tiny))


def _light(radiance, lens, outside):
    transmittance = np.array([lens.at_wavelength(nm).transmittance for nm in radiance.wavelengths_nm])
    frame = radiance.frame().cube.sum(axis=(1, 2), dtype=np.float64)
    inside = irradiance_per_radiance(transmittance, lens.f_number_effective) * np.maximum(frame, 0)
    if outside is None:
        return _Light(inside, np.zeros_like(inside))
    facing = outside.irradiance * np.maximum(outside.directions[:, 2:], 0)
    pupil_mm2 = np.pi / 4 * np.prod(entrance_pupil_size_mm(lens))
    return _Light(inside, facing.sum(axis=0) * transmittance * pupil_mm2 / (radiance.pitch_um * 1e-3)**2)


def _veil_share(lens, options, light):
    return light.share(np.full(light.inside.size, _index(options)))


def _add_veil(cube, lens, options, light):
    cube += (_index(options) * (light.inside + light.outside) / cube[0].size)[:, None, None].astype(np.float32)


def _index(options):
    return options.glare_index / 100 or {"new": 0.01, "dusty": 0.03, "hazy": 0.06}[options.cleanliness]


_SHARE = {VEIL: _veil_share, GHOSTS: lambda *_: 0.0, STAR: lambda *_: 0.0}
_ADD = {VEIL: _add_veil, GHOSTS: lambda *_: None, STAR: lambda *_: None}
