"""PSFs as samples of light, to be turned and distributed over the sensor's pixels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, Self

import numpy as np
import scipy

from ..image.sampling import Sampling
from ..kernels.library import NUMPY, running
from ..kernels.turning import TurnableSamples, turn
from ..lens.lens import Lens
from ..runtime.errors import ImageError
from ..runtime.memory import check_room

BATCH_SAMPLES = 1 << 16  # PSF samples that are processed together, to fit in the processor's cache
COPIES = 3  # of the samples of all PSFs, while they are computed
LITTLE_BYTES = 1 << 24  # always available: to ask for less takes a fifth of the time of a bank
LARGEST_PSF_RADIUS_PX = 2048
RINGS = 4  # circles for trimming between adjacent samples
FEW_PX = 3  # radius of trimmed PSFs up to which their errors are computed in pixels, not bounded by the lost light
SLACK_PX = 1e-6  # for rounding


class PsfData(Protocol):
    """Lens data with PSFs (..., v, u)."""

    @property
    def psf(self) -> np.ndarray: ...
    @property
    def psf_pitch_um(self) -> float: ...


@dataclass(frozen=True, eq=False, kw_only=True)
class PsfSamples:
    """Some PSFs of a lens at one wavelength, as samples of light in small squares.

    A pixel shines evenly from its area: each sample lands from every point of the pixel.

    Attributes
    ----------
    samples : array (PSF, sample)
        The light of each sample; unit sum for each PSF.
    lost : array (PSF,)
        The fraction of each PSF that was trimmed.
    v_px, u_px : arrays (sample,)
        Positions relative to the chief ray, as in the lens data.
    sample_size_px : float
        Side of a sample, which is a square.
    radius_px : int
        Largest reach of a PSF from the pixel of its chief ray, in any direction.
    """

    samples: np.ndarray
    lost: np.ndarray
    v_px: np.ndarray
    u_px: np.ndarray
    sample_size_px: float
    radius_px: int

    @property
    def nbytes(self) -> int:
        return self.samples.nbytes + self.u_px.nbytes + self.v_px.nbytes

    def trimmed(self, energy: float, radius_px: int | None = None) -> Self:
        """Trim each PSF to the smallest circle around the chief ray that contains this energy, and normalise (Eq. 9).

        Parameters
        ----------
        energy : float
            The fraction of every complete PSF that is used.
        radius_px : int, optional
            Radius of the result, which limits the circles; by default the smallest sufficient one.
        """
        if energy >= 1:
            return self
        support_px = self.support_px(energy)
        if radius_px is None:
            radius_px = self.radius_within_px(support_px)
        support_px = np.minimum(support_px, radius_px - SLACK_PX - self.sample_size_px / 2)
        limits_px = support_px * (1 + 1e-9)
        used = self._distance_px <= limits_px.max()
        samples = np.compress(used, self.samples, axis=1)
        samples *= self._distance_px[used] <= limits_px[:, None]
        light = samples.sum(axis=1)
        samples /= light[:, None]
        return replace(self, samples=samples, lost=1 - light * (1 - self.lost), v_px=self.v_px[used],
                       u_px=self.u_px[used], radius_px=radius_px)

    def halo(self, energy: float, wider_energy: float, radius_px: int) -> Self:
        """PSFs trimmed to a wider energy minus PSFs trimmed to this energy: light around these, and the same amount
        less inside. Their sums are zero."""
        wide = self.trimmed(wider_energy, radius_px)
        within = wide._distance_px <= wide.support_px(energy)[:, None] * (1 + 1e-9)
        core = np.where(within, wide.samples, 0)
        return replace(wide, samples=wide.samples - core / core.sum(axis=1, keepdims=True))

    def support_px(self, energy: float) -> np.ndarray:
        """Radii of the smallest circles around the chief ray that contain this fraction of each complete PSF, or all of
        the PSF here: array (PSF,)."""
        return self.enclosed.support_px(energy)

    def radius_within_px(self, support_px: np.ndarray) -> int:
        """Largest reach of PSFs in circles of these radii from the pixel of their chief ray."""
        return min(self.radius_px, samples_reach_px(support_px.max(), self.sample_size_px))

    @cached_property
    def _distance_px(self):
        return np.hypot(self.v_px, self.u_px)

    @cached_property
    def enclosed(self) -> "EnclosedLight":
        """The light in circles around the chief ray."""
        ring = np.ceil(self._distance_px / self.sample_size_px * RINGS - 1e-6).astype(np.int32)
        outwards = np.argsort(ring, kind="stable")
        rings, first = np.unique(ring[outwards], return_index=True)
        inside = np.cumsum(np.add.reduceat(np.take(self.samples, outwards, axis=1), first, axis=1), axis=1)
        return EnclosedLight(rings * (self.sample_size_px / RINGS), inside / inside[:, -1:] * (1 - self.lost[:, None]))

    def turned(self, angle_rad: np.ndarray) -> np.ndarray:
        """All PSFs turned so that v points to these angles, from the right upwards: float64 array (angle, PSF, row,
        column), odd square, unit sums, the chief ray in the middle, row 0 at the top."""
        size, samples = 2 * self.radius_px + 1, self.v_px.size
        if running() != NUMPY:
            return np.moveaxis(turn(self._turnable, angle_rad, size), 3, 1)
        result = np.empty((angle_rad.size, len(self.samples), size * size))
        step = max(1, BATCH_SAMPLES // 9 // samples)  # nine pixels for each sample
        for start in range(0, angle_rad.size, step):
            part = result[start:start + step]
            pixels, shares = self._shares(angle_rad[start:start + step])
            shares = np.stack(shares, axis=2).transpose(1, 0, 2)
            pixels = np.stack(pixels, axis=2).transpose(1, 0, 2) + np.arange(len(part))[:, None] * size * size
            onto_pixels = scipy.sparse.csc_matrix(
                (shares.ravel(), pixels.ravel(), np.arange(samples + 1) * 9 * len(part)),
                (len(part) * size * size, samples))
            part[:] = (onto_pixels @ self.samples.T).reshape(len(part), size * size, -1).swapaxes(1, 2)
        return result.reshape(*result.shape[:2], size, size)

    @cached_property
    def _turnable(self):
        return TurnableSamples.of(self.samples, self.v_px, self.u_px, self.sample_size_px)

    def share_out(self, energy: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
        """Distribute other light of the samples, array (n, sample), over the pixels that it reaches, at n angles."""
        size = 2 * self.radius_px + 1
        stack = np.arange(len(energy))[:, None] * size * size
        pixels = np.zeros(len(energy) * size * size)
        for index, share in zip(*self._shares(angle_rad), strict=True):
            pixels += np.bincount((stack + index).ravel(), (energy * share).ravel(), minlength=pixels.size)
        return pixels.reshape(-1, size, size)

    def _shares(self, angle_rad):
        """The nine pixels that each sample reaches, and its share in each of them: 9 arrays (angle, sample)."""
        cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
        right = self.v_px * cos + self.u_px * sin  # v runs outwards, along (cos, sin); u along (sin, -cos)
        down = -self.v_px * sin + self.u_px * cos
        row, in_rows = self._split(down)
        column, in_columns = self._split(right)
        size = 2 * self.radius_px + 1
        return ([(row + i) * size + column + j for i, j in np.ndindex(3, 3)],
                [in_row * in_column for in_row in in_rows for in_column in in_columns])

    def _split(self, offset_px):
        """First of three pixels that a sample at this offset reaches from all of a pixel, and the shares in them.

        If a point of light is moved by an offset, from all of a pixel, a share of 1 - |offset| remains in it. The
        sample is a square that is not turned, which preserves second moments.
        """
        width_px = self.sample_size_px
        start = offset_px - width_px / 2 + self.radius_px
        pixel = np.minimum(start.astype(int), 2 * self.radius_px - 2)
        start = start - pixel
        end = start + width_px
        first = (np.maximum(1 - start, 0) ** 2 - np.maximum(1 - end, 0) ** 2) / (2 * width_px)
        last = (np.maximum(end - 1, 0) ** 2 - np.maximum(start - 1, 0) ** 2) / (2 * width_px)
        return pixel, (first, 1 - first - last, last)


@dataclass(frozen=True, eq=False)
class EnclosedLight:
    """The light of PSFs in circles around the chief ray.

    Attributes
    ----------
    radii_px : array (circle,)
    inside : array (PSF, circle)
        Fraction of each complete PSF.
    """

    radii_px: np.ndarray
    inside: np.ndarray

    def support_px(self, energy: float) -> np.ndarray:
        """See `PsfSamples.support_px`."""
        return self.radii_px[self._circle(energy)]

    def lost(self, energy: float) -> np.ndarray:
        """The fraction of each PSF outside the smallest circle that contains this fraction: array (PSF,)."""
        return 1 - self.inside[np.arange(len(self.inside)), self._circle(energy)]

    def _circle(self, energy):
        return np.argmax(self.inside >= np.minimum(energy, self.inside[:, -1:]) - 1e-9, axis=1)


def samples_of(psf: np.ndarray, psf_pitch_um: float, pixel_pitch_um: float) -> PsfSamples:
    """PSFs (PSF, v, u) of the lens data, complete, for pixels of this pitch.

    Raises
    ------
    ImageError
        If there is not enough memory for PSFs of this resolution.
    """
    window, steps = psf.shape[-1], refinement(psf_pitch_um, pixel_pitch_um)
    finest = psf.shape[0] * ((window - 1) * steps + 1) ** 2
    needed_bytes = COPIES * np.dtype(np.float64).itemsize * finest
    if needed_bytes > LITTLE_BYTES:
        check_room("point spread functions", needed_bytes, "give larger pixels")
    refined = _refine(psf, steps).reshape(psf.shape[0], -1)
    sample_size_px = psf_pitch_um / steps / pixel_pitch_um
    offset_px = (np.arange((window - 1) * steps + 1) - window // 2 * steps) * sample_size_px
    v_px, u_px = np.repeat(offset_px, offset_px.size), np.tile(offset_px, offset_px.size)
    used = refined.any(axis=0)
    samples = np.compress(used, refined, axis=1)
    samples /= samples.sum(axis=1, keepdims=True)
    return PsfSamples(samples=samples, lost=np.zeros(len(samples)), v_px=v_px[used], u_px=u_px[used],
                      sample_size_px=sample_size_px,
                      radius_px=_complete_radius_px(window, psf_pitch_um, pixel_pitch_um))


def psf_radius_px(optics: PsfData, pixel_pitch_um: float) -> int:
    """Largest reach in pixels of the complete PSFs of a lens, at any azimuth, from the pixel of the chief ray."""
    return _complete_radius_px(optics.psf.shape[-1], optics.psf_pitch_um, pixel_pitch_um)


def supported_radius_px(optics: PsfData, pixel_pitch_um: float) -> int:
    """As `psf_radius_px`, for pixels on which the PSFs will be used.

    Raises
    ------
    ImageError
        If the pixel pitch is so small that PSFs exceed LARGEST_PSF_RADIUS_PX.
    """
    radius_px = psf_radius_px(optics, pixel_pitch_um)
    if radius_px > LARGEST_PSF_RADIUS_PX:
        raise ImageError("image", "pitch_um", pixel_pitch_um, f"a point spread function would reach {radius_px} px; "
                         f"at most {LARGEST_PSF_RADIUS_PX} px are supported")
    return radius_px


def _complete_radius_px(window, psf_pitch_um, pixel_pitch_um):
    sample_px = psf_pitch_um / refinement(psf_pitch_um, pixel_pitch_um) / pixel_pitch_um
    return samples_reach_px(np.hypot(1, 1) * (window // 2) * psf_pitch_um / pixel_pitch_um, sample_px)


def samples_reach_px(distance_px: float, sample_size_px: float) -> int:
    """Largest reach of samples up to this distance from the chief ray, from the pixel of the chief ray."""
    return int(np.ceil(distance_px + sample_size_px / 2 + SLACK_PX))


def refinement(psf_pitch_um: float, pixel_pitch_um: float) -> int:
    """Samples per sample of the table, in each direction: at most sqrt(0.5) px wide.

    Turned squares overlap and leave gaps; with wider ones, uniform light would have ripples of more than 1 %.
    """
    return max(1, int(np.ceil(np.sqrt(2) * psf_pitch_um / pixel_pitch_um - 1e-9)))


def _refine(psf, steps):
    """PSFs with `steps` samples for each sample of the table, by linear interpolation along both axes."""
    psf = psf.astype(np.float64)
    for axis in (-1, -2) if steps > 1 else ():
        psf = np.moveaxis(psf, axis, -1)
        refined = np.empty((*psf.shape[:-1], (psf.shape[-1] - 1) * steps + 1))
        refined[..., ::steps] = psf
        rise = np.diff(psf) / steps
        for step in range(1, steps):
            refined[..., step::steps] = psf[..., :-1] + step * rise
        psf = np.moveaxis(refined, -1, axis)
    return psf


def telling_wavelengths(lens: Lens, sampling: Sampling) -> Sequence[float] | np.ndarray:
    """The wavelengths that determine the largest error: the picture's, or adjacent ones of the lens data if fewer.

    Between wavelengths of the lens data, PSFs are mixtures, and so are their errors.
    """
    around = lens.wavelengths_around(sampling.wavelengths_nm)
    return around if len(around) < len(sampling.wavelengths_nm) else sampling.wavelengths_nm


def covered_px(support_px: np.ndarray, sample_size_px: float) -> np.ndarray:
    """Number of pixels that a PSF in a circle of this radius reaches from all of a pixel."""
    side_px = 2 + sample_size_px  # of the square that each sample reaches
    return np.pi * support_px**2 + 4 * side_px * support_px + side_px**2
