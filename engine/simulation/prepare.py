"""What a lens image needs for any light, computed in steps while the light is rendered."""

from collections.abc import Iterator
from dataclasses import dataclass

from ..image.pixel_grid import PixelGrid
from ..image.sampling import Sampling
from ..image.sources import Sources
from ..lens import Lens
from ..lens.iris import Iris, opening
from ..library.rays import lens_rays
from ..plan.options import DEFAULT_ACCURACY, OFF, Options
from ..plan.plan_cache import cached_plan
from ..runtime.memory import available_bytes
from ..stray.options import StrayOptions
from ..stray.stray_light import prepare_stray_light
from .channel_cache import ChannelCache


@dataclass(frozen=True, eq=False)
class Expected:
    """Light that is not rendered yet.

    Attributes
    ----------
    sampling : Sampling
        Of the radiance, or of its layers.
    grid : PixelGrid
        Of the radiance as the pinhole sees it.
    detail_times, across : int
        Parts of a pixel, down and across, whose light will be known; and columns of a layer in one of the sensor.
    layered : bool
    outside : Sources or None
        Of stray light, which the radiance will not contain.
    needed_bytes : float
        Memory that the render will take.
    """

    sampling: Sampling
    grid: PixelGrid
    detail_times: int
    across: int
    layered: bool
    outside: Sources | None
    needed_bytes: float


def preparation(expected: Expected, lens: Lens, options: Options, stray: StrayOptions, cache: ChannelCache,
                iris: Iris | None = None) -> Iterator[None]:
    """Compute, step by step, what `lens_image` needs for any light.

    The results are in caches: a lens image is the same without these steps, or after some of them.

    Parameters
    ----------
    expected : Expected
    lens, options, stray, iris
        As for `lens_image`.
    cache : ChannelCache
        The cache for `lens_image`, which must not use it before the last step. It is filled only if there is memory for
        its limit after the render has taken its share.

    Raises
    ------
    LensError, ImageError, InputError
        As from `lens_image`.
    """
    yield from prepare_stray_light(expected.grid, expected.sampling.wavelengths_nm, lens, stray,
                                   options.accuracy or DEFAULT_ACCURACY, outside=expected.outside, iris=iris)
    plan = cached_plan(options, lens, expected.sampling, 1 if options.detail == OFF else expected.detail_times)
    yield
    if available_bytes() > expected.needed_bytes + cache.limit_bytes:
        for channel in cache.channels(lens, expected.sampling, plan, expected.across):
            if not channel.cached:
                break
            yield
    if expected.layered:
        lens_rays(lens, opening(iris, lens).reach)
