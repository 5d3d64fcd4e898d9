"""The second main function: sensor irradiance becomes a raw picture of a camera."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..image.nonfinite import count_nonfinite
from ..image.spectral_image import SpectralImage
from ..sensor.camera import Camera
from ..sensor.electrons import missing_response
from ..sensor.exposure import RawImage, expose
from ..sensor.metering import exposure_factor, metered, usual_exposure
from ..simulation.report import Report
from ..simulation.report_parts import Part, Parts

MISSING_LIMIT = 0.01  # of a channel's response
DARKEST = 0.01  # share of the pixels
COMPLETE = 0.98  # of the lens image: sizes of sensors are rounded
BLOCK_PX = 12  # a multiple of the sides of usual filter arrays


@dataclass(frozen=True)
class CameraFacts(Part):
    """Facts about a raw picture.

    Attributes
    ----------
    camera, title : str
    shutter_s, iso : float
    metered : bool
        Whether the camera's meter chose the exposure.
    factor : float or None
        Scale of light in arbitrary units, which suits the exposure; None for light in W m^-2 nm^-1.
    raw_px : (int, int)
        Rows and columns.
    saturated : float
        Share of the pixels.
    darkest_snr : float
        As in `darkest_snr`.
    resampled : float or None
        As in `RawImage`.
    covered : float
        Share of the lens image that the sensor covers.
    nonfinite : int
        NaN and infinite values of the lens image.
    missing : tuple of (str, float)
        Share of each channel's response beyond the wavelengths of the light.
    uncorrected : tuple of str
        What the raw file does not correct of the lens, a line for each.
    """

    camera: str
    title: str
    shutter_s: float
    iso: float
    metered: bool
    factor: float | None
    raw_px: tuple[int, int]
    saturated: float
    darkest_snr: float
    resampled: float | None
    covered: float
    nonfinite: int
    missing: tuple[tuple[str, float], ...]
    uncorrected: tuple[str, ...] = ()

    def remarks(self, parts: Parts) -> Iterator[str]:
        chosen = " (metered)" if self.metered else ""
        yield (f"{self.title or self.camera}: {shutter_text(self.shutter_s)} at ISO {self.iso:.0f}{chosen}; "
               f"{self.saturated:.2%} of the pixels saturated, signal-to-noise ratio of the darkest "
               f"{DARKEST:.0%}: {self.darkest_snr:.2g}")
        if self.factor is not None:
            yield "the light is in arbitrary units: it was scaled so that this exposure is the metered one"
        if self.resampled:
            yield (f"pixels of the lens image are {self.resampled:.3g} times as large as the camera's pixels: "
                   "resampled to {1} x {0} px".format(*self.raw_px))
        if self.covered < COMPLETE:
            yield f"the camera's sensor covers {self.covered:.0%} of the lens image: the picture lacks the rest"
        if self.nonfinite:
            yield f"{self.nonfinite} values of the lens image are not finite: NaN counts as black"
        if line := missing_text(self.missing):
            yield line
        yield from self.uncorrected

    def as_dict(self) -> dict[str, Any]:
        return {"camera": super().as_dict() | {"missing": dict(self.missing)}}


def photograph(irradiance: SpectralImage, camera: Camera, iso: float | None = None, shutter_s: float | None = None, *,
               factor: float | None = None, report: Report | None = None, **others: Any) -> RawImage:
    """Take a picture with a camera whose sensor is where the lens image is.

    For a picture that is higher than wide, the camera is turned.

    Parameters
    ----------
    irradiance : SpectralImage
        W m^-2 nm^-1. In arbitrary units it is scaled so that the exposure is the metered one.
    camera : Camera
    iso, shutter_s : float, optional
        A missing shutter is metered, at the camera's base ISO if the ISO is missing, too; so is an ISO that alone is
        missing.
    factor : float, optional
        For light in arbitrary units, instead of the one that suits the exposure: `CameraFacts.factor` of a sequence's
        first frame.
    report : Report, optional
        Gets CameraFacts.
    others : by name
        Further fields of `Exposure`: seed, frame, serial, noise.

    Raises
    ------
    ImageError
        The picture is not irradiance.
    InputError
        A value is not valid.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import Options, SpectralImage, load_camera, load_lens, photograph, simulate
    >>> nm = [450, 550, 650]
    >>> radiance = SpectralImage(np.ones((3, 24, 32)), nm, pitch_um=15)
    >>> irradiance = simulate(radiance, load_lens("edmund-54852"), Options(accuracy=0.1))
    >>> raw = photograph(irradiance, load_camera("sony-a7-iv"), iso=100)  # the shutter is metered
    >>> raw.exposure.iso, raw.numbers.dtype
    (100, dtype('uint16'))
    """
    camera = held(camera, irradiance.frame_px)
    if irradiance.arbitrary:
        exposure = usual_exposure(camera, iso, shutter_s, **others)
        factor = exposure_factor(irradiance, camera, exposure) if factor is None else factor
        light = replace(irradiance, cube=irradiance.cube * np.float32(factor), arbitrary=False)
    else:
        exposure, light = metered(irradiance, camera, iso, shutter_s, **others), irradiance
    raw = expose(light, camera, exposure)
    if report:
        report.add(CameraFacts(
            camera.name, camera.title, exposure.shutter_s, exposure.iso, iso is None or shutter_s is None,
            factor if irradiance.arbitrary else None, raw.numbers.shape[-2:], raw.saturated, darkest_snr(raw),
            raw.resampled, covered_share(irradiance, camera), sum(map(count_nonfinite, irradiance.cube)),
            missing_channels(camera, irradiance.wavelengths_nm)))
    return raw


def held(camera: Camera, frame_px: tuple[int, int]) -> Camera:
    """The camera as it is held for a picture of these rows and columns."""
    rows, columns = camera.shape_px
    return camera.turned if (rows - columns) * (frame_px[0] - frame_px[1]) < 0 else camera


def covered_share(irradiance: SpectralImage, camera: Camera) -> float:
    """Share of the lens image's area that the sensor covers."""
    return math.prod(min(1.0, n * camera.pitch_um / (picture * irradiance.pitch_um))
                     for n, picture in zip(camera.shape_px, irradiance.frame_px, strict=True))


def darkest_snr(raw: RawImage) -> float:
    """Signal-to-noise ratio, over time and pixels, of a pixel in the darkest hundredth of a raw picture.

    It compares means of blocks of pixels, because the darkest single pixels are noisy rather than dark.
    """
    camera, iso = raw.camera, raw.exposure.iso
    dark_e = camera.dark_current_e_per_s * raw.exposure.shutter_s
    rows, columns = (max(1, n // BLOCK_PX) for n in raw.numbers.shape[-2:])
    blocks = raw.numbers[..., :rows * BLOCK_PX, :columns * BLOCK_PX]
    blocks = blocks.reshape(-1, rows, blocks.shape[-2] // rows, columns, blocks.shape[-1] // columns)
    darkest_dn = np.quantile(blocks.mean(axis=(0, 2, 4), dtype=np.float64), DARKEST)
    light_e = max(0.0, float(darkest_dn - camera.black_dn) / camera.gain_at(iso) - dark_e)
    quantised_e2 = 1 / 12 / camera.gain_at(iso)**2
    variance_e2 = (light_e + dark_e + camera.dark_noise_at(iso)**2 + quantised_e2 + camera.dsnu_e**2
                   + (camera.prnu * light_e)**2)
    return light_e / float(np.sqrt(variance_e2))


def missing_channels(camera: Camera, wavelengths_nm: np.ndarray) -> tuple[tuple[str, float], ...]:
    """(channel, share of its response beyond these wavelengths), for a picture's light."""
    return tuple(zip(camera.channels, missing_response(camera, wavelengths_nm).tolist(), strict=True))


def missing_text(missing: tuple[tuple[str, float], ...]) -> str:
    """A line on the channels that miss a noticeable part of their response; "" if none does."""
    listed = ", ".join(f"{share:.1%} of {channel}" for channel, share in missing if share > MISSING_LIMIT)
    return f"the wavelengths leave out part of the camera's response: {listed}; add wavelengths" if listed else ""


def shutter_text(shutter_s: float) -> str:
    """An exposure time as cameras show it."""
    return f"1/{1 / shutter_s:.0f} s" if shutter_s < 0.3 else f"{shutter_s:.3g} s"
