"""Detail: how light is distributed inside the pixels of a capture, for lens images sharper than these pixels.

A capture stores the mean radiance of its pixels. Resampling it by the distortion and blurring it treat each pixel as an
even square, which softens details that the lens resolves. A finer picture at a few wavelengths, of the same light,
restores them: inside a pixel, light of any wavelength is distributed as at the nearest of these.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.errors import ImageError
from ..runtime.scratch import SAMPLE_BYTES
from .supersampling import split_pixels

MEAN_SLACK = 1e-2  # of a pixel's light, from rounding to half precision


@dataclass(frozen=True, eq=False)
class Detail:
    """The distribution of light inside pixels, each divided into `times` x `times` parts.

    Attributes
    ----------
    wavelengths_nm : float64 array (band,)
        Ascending.
    shares : float16 array (band, times * row, times * column)
        Radiance of the parts relative to the mean of their pixel: 1 for even pixels.
    times : int

    Raises
    ------
    ImageError
        Shapes do not match; a share is negative or not finite; or the mean of a pixel's shares is not 1.
    """

    wavelengths_nm: np.ndarray
    shares: np.ndarray
    times: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "wavelengths_nm", np.atleast_1d(np.asarray(self.wavelengths_nm, np.float64)))
        object.__setattr__(self, "shares", np.asarray(self.shares, np.float16))
        nm, shares = self.wavelengths_nm, self.shares
        if (shares.ndim != 3 or shares.shape[:1] != nm.shape or not nm.size
                or any(n % self.times for n in self._fine_px)):
            raise ImageError("detail", "shares", f"of shape {shares.shape}",
                             f"expected {nm.size} planes with {self.times} x {self.times} parts of each pixel")
        if not np.all(np.isfinite(nm)) or np.any(nm <= 0) or np.any(np.diff(nm) <= 0):
            raise ImageError("detail", "wavelengths_nm", nm.tolist(), "expected positive and ascending")
        if not (shares.min(initial=0) >= 0  # NaN, too
                and np.all(np.abs(merged(shares.astype(np.float32), self.times) - 1) <= MEAN_SLACK)):
            raise ImageError("detail", "shares", "invalid", "expected 0 or more, with a mean of 1 in each pixel")

    @classmethod
    def of(cls, radiance: np.ndarray, wavelengths_nm: ArrayLike, times: int) -> "Detail":
        """The detail of finer pictures: array (band, times * row, times * column). Dark pixels are even."""
        light = np.maximum(radiance, 0)
        means = merged(light, times)
        per_mean = np.divide(1, means, out=np.zeros_like(means), where=means > np.finfo(np.float32).tiny)
        shares = np.array([plane * split_pixels(each, times) for plane, each in zip(light, per_mean, strict=True)])
        shares += np.array([split_pixels(each == 0, times) for each in per_mean])
        return cls(np.atleast_1d(wavelengths_nm), shares, times)

    @property
    def shape_px(self) -> tuple[int, int]:
        """Rows and columns of the pixels."""
        rows, columns = self._fine_px
        return rows // self.times, columns // self.times

    @property
    def nbytes(self) -> int:
        return self.shares.nbytes

    def within(self, rows: slice, columns: slice) -> "Detail":
        """The detail of some rows and columns. It shares memory with this."""
        return replace(self, shares=self.shares[:, *self._parts(rows, columns)])

    def placed(self, rows: slice, columns: slice, shape_px: tuple[int, int]) -> "Detail":
        """The detail of a larger picture of this shape, in which these are rows and columns; even elsewhere."""
        shares = np.ones((len(self.shares), *(self.times * n for n in shape_px)), np.float16)
        shares[:, *self._parts(rows, columns)] = self.shares
        return replace(self, shares=shares)

    def even_in(self, pixels: np.ndarray) -> "Detail":
        """The detail without some pixels: bool array (row, column)."""
        return replace(self, shares=np.where(split_pixels(pixels, self.times), np.float16(1), self.shares))

    def split(self, picture: np.ndarray, wavelength_nm: float) -> np.ndarray:
        """A picture (row, column) at a wavelength with each pixel split into its parts: float32 array (times * row,
        times * column)."""
        rows, columns = picture.shape
        fine = self._at(wavelength_nm).reshape(rows, self.times, columns * self.times)
        fine *= np.repeat(picture.astype(np.float32, copy=False), self.times, axis=1)[:, None]
        return fine.reshape(self._fine_px)

    @property
    def _fine_px(self):
        return self.shares.shape[1:]

    def _parts(self, *sides):
        return tuple(slice(self.times * side.start, self.times * side.stop) for side in sides)

    def _at(self, wavelength_nm):
        """Shares at a wavelength, interpolated linearly: a new float32 array."""
        last = self.wavelengths_nm.size - 1
        place = float(np.interp(wavelength_nm, self.wavelengths_nm, np.arange(last + 1)))
        below = min(int(place), max(last - 1, 0))
        share = np.float32(place - below)
        shares = self.shares[below].astype(np.float32)
        if share:
            shares *= 1 - share
            above = self.shares[below + 1].astype(np.float32)
            above *= share
            shares += above
        return shares


def split_by_detail(picture: np.ndarray, detail: Detail | None, wavelength_nm: float, times: int) -> np.ndarray:
    """A picture (row, column) with each pixel split: by its detail or, without one, evenly into `times` x `times`.

    With 1, pixels remain whole, with a detail, too.
    """
    return split_pixels(picture, times) if detail is None or times == 1 else detail.split(picture, wavelength_nm)


def splitting_bytes(pixels: int, times: int) -> int:
    """Memory for a plane of pixels that are split by a detail: the parts, and their shares. 0 for whole pixels."""
    return 2 * SAMPLE_BYTES * pixels * times**2 if times > 1 else 0


def merged(cube: np.ndarray, times: int) -> np.ndarray:
    """Means of blocks of `times` x `times` pixels of planes: float32 array (plane, row, column)."""
    count, rows, columns = cube.shape
    in_columns = cube.reshape(count, rows // times, times, columns).sum(axis=2)
    total = sum(in_columns[..., first::times] for first in range(times))
    return total * np.float32(times**-2)
