"""capture_planes(): the planes that a lens images at each wavelength, for flat radiance and for layers."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import replace

from ..image.detail import split_by_detail
from ..image.layers import Radiance
from ..image.nonfinite import clamp_fireflies, clamp_layers, refuse_fireflies
from ..image.spectral_image import RADIANCE, SpectralImage
from ..lens import Lens
from ..lens.iris import Iris, opening
from ..rays.grid_rays import LensRays
from ..runtime.errors import ImageError
from .cast import CastPlane, cast


def capture_planes(radiance: Radiance, lens: Lens, rays: Callable[[float], LensRays], *, fireflies: str,
                   most_rays: int, most_of_lamps: int, finest_px: float, iris: Iris | None, times: int,
                   progress: Callable[[float], object],
                   stage: Callable[[str], AbstractContextManager[object]]) -> Iterator[CastPlane]:
    """Yield the planes of a capture, wavelength by wavelength. Flat radiance counts as in focus.

    Parameters
    ----------
    radiance : SpectralImage or LayeredRadiance
    lens : Lens
    rays : callable (reach) -> LensRays
        Called only for layers: traces the lens's rays, as far out as the iris reaches.
    fireflies : "refuse" or "clamp"
        See `Options`.
    most_rays, most_of_lamps, finest_px : int, int, float
        See `cast`.
    iris : Iris or None
    times : int
        Parts of a pixel, down and across, in the planes' in-focus radiance.
    progress : callable (fraction)
        For layers it reports casting, which takes longest.
    stage : callable (name) -> context manager
        Times a stage.

    Raises
    ------
    ImageError
        If the image is not radiance, or a pixel is not finite.
    """
    if isinstance(radiance, SpectralImage) and radiance.quantity != RADIANCE:
        raise ImageError("image", "quantity", radiance.quantity, f"expected {RADIANCE}")
    if fireflies == "refuse":
        refuse_fireflies(radiance)
    if isinstance(radiance, SpectralImage):
        return _in_focus(radiance, fireflies == "clamp", times, progress)
    layered, clamped = clamp_layers(radiance) if fireflies == "clamp" else (radiance, 0)

    def trace():
        with stage("rays"):
            return rays(opening(iris, lens).reach)

    planes = cast(layered, lens, trace, most_rays=most_rays, most_of_lamps=most_of_lamps, finest_px=finest_px,
                  iris=iris, times=times, progress=progress)
    return _in_depth(planes, clamped, stage)


def _in_focus(image, clamp, times, progress):
    for number, (plane, nm) in enumerate(zip(image.cube, image.wavelengths_nm, strict=True), 1):
        plane, clamped = clamp_fireflies(plane) if clamp else (plane, 0)
        yield CastPlane(split_by_detail(plane, image.detail, nm, times), clamped=clamped)
        progress(number / len(image.cube))


def _in_depth(planes, clamped, stage):
    """The planes of layers; the first one counts the clamped pixels of all wavelengths."""
    while True:
        with stage("casting"):
            plane = next(planes, None)
        if plane is None:
            return
        yield replace(plane, clamped=clamped)
        del plane  # it refers to the memory of all planes of a group
        clamped = 0
