"""The lens image with its stray light: `simulate`, and light by reflection, scatter or diffraction."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..image.layers import LayeredRadiance
from ..image.sources import Sources
from ..image.spectral_image import SpectralImage
from ..lens import Lens
from ..lens.iris import Iris
from ..plan.options import DEFAULT_ACCURACY, Options
from ..stray.options import StrayOptions
from ..stray.stray_light import StrayLight, stray_light
from .report import Report
from .report_parts import Part, Parts
from .simulate import simulate

MOST_PAIRS = 3  # that a remark names


@dataclass(frozen=True)
class StrayFacts(Part):
    """Facts about the stray light of a lens image.

    Attributes
    ----------
    shares : dict of str: float
        Light of each part that was computed, relative to the light of the lens image without it; if that is black,
        relative to the stray light.
    predicted : dict of str: float
        Predicted shares of parts that were left out because they are below the accuracy.
    sources : int
        Number of sources of ghosts and stars.
    pairs : tuple of (int, int, float)
        The strongest ghosts: the surfaces that reflect, in the order in which they do, counted from 1 at the front;
        and their share of the light of all ghosts.
    neglected : float
        Estimate of the ghosts' light that was left out, relative to the light of the lens image.
    words : tuple of str
        What could not be computed, and the remedy.
    """

    shares: dict[str, float]
    predicted: dict[str, float]
    sources: int
    pairs: tuple[tuple[int, int, float], ...]
    neglected: float
    words: tuple[str, ...]

    def remarks(self, parts: Parts) -> Iterator[str]:
        if self.shares:
            yield "stray light, relative to the lens image: " + ", ".join(
                f"{name} {share:.2g}" for name, share in self.shares.items())
        if self.pairs:
            strongest = ", ".join(f"{first} and {second} ({share:.0%})"
                                  for first, second, share in self.pairs[:MOST_PAIRS])
            yield f"strongest ghosts: surfaces {strongest} of their light; about {self.neglected:.2g} is neglected"
        if self.predicted:
            yield "stray light below the accuracy, left out: " + ", ".join(
                f"{name} about {share:.2g}" for name, share in self.predicted.items())
        yield from self.words

    def as_dict(self) -> dict[str, Any]:
        return {"stray_light": super().as_dict()}


def lens_image(radiance: SpectralImage, lens: Lens, options: Options, stray: StrayOptions, *,
               layers: LayeredRadiance | None = None, outside: Sources | None = None, iris: Iris | None = None,
               report: Report | None = None, **others: Any) -> tuple[SpectralImage, SpectralImage | None]:
    """Compute the spectral irradiance on the sensor behind a lens, including stray light.

    Parameters
    ----------
    radiance : SpectralImage
        As for `simulate`.
    lens : Lens
    options : Options
    stray : StrayOptions
    layers : LayeredRadiance, optional
        The radiance in layers, for out-of-focus light.
    outside : Sources, optional
        Sources outside the radiance, of the same wavelengths.
    iris : Iris, optional
    report : Report, optional
        Also gets StrayFacts.
    others : by name
        Further arguments of `simulate`.

    Returns
    -------
    SpectralImage, SpectralImage or None
        Irradiance of the sensor's frame, and the stray light in it; None without any.

    Raises
    ------
    LensError, ImageError
        As for `simulate`.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import Options, SpectralImage, StrayOptions, lens_image, load_lens
    >>> radiance = SpectralImage(np.ones((24, 32)), wavelengths_nm=[550], pitch_um=15)
    >>> lens = load_lens("edmund-54852")
    >>> irradiance, stray = lens_image(radiance, lens, Options(accuracy=0.1), StrayOptions("veil", cleanliness="dusty"))
    >>> bool(0 < stray.cube.sum() < 0.01 * irradiance.cube.sum())
    True
    """
    report = report or Report()
    with report.stage("stray light"):
        added = stray_light(radiance, lens, stray, options.accuracy or DEFAULT_ACCURACY, layers=layers,
                            outside=outside, iris=iris)
    irradiance = simulate(layers or radiance, lens, options, iris=iris, report=report, **others)
    if added is None:
        return irradiance, None
    report.add(_facts(added, irradiance))
    if added.cube is None:
        return irradiance, None
    for plane, share, of_stray in zip(irradiance.cube, added.remaining, added.cube, strict=True):
        plane *= np.float32(share)
        plane += of_stray
    return irradiance, replace(irradiance, cube=added.cube)


def _facts(added: StrayLight, irradiance: SpectralImage) -> StrayFacts:
    """Facts about stray light that is not in the irradiance yet. In a black picture, shares are of all stray light."""
    light = float(irradiance.cube.sum(dtype=np.float64))
    light = light if light > 0 else sum(added.sums.values()) or 1.0
    return StrayFacts({name: sum_ / light for name, sum_ in added.sums.items()}, dict(added.predicted), added.sources,
                      added.pairs, added.neglected / light, added.words)
