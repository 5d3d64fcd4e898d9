"""The fraction of a point's light that a method misplaces, computed before any pixel is filtered.

The error of a picture is the sum of its points' errors: with e the largest ||PSF used - PSF true||_1 over the field,
sum |error| <= e * light for every scene. The error is therefore sought among the PSFs, not in the picture. Between two
heights of the lens data, the true PSFs and the table's are the same mixtures of the PSFs at these heights, so their
errors are at most those at the two heights: it is sufficient to examine the heights of the data.

PSFs have two errors. Trimmed light is missing outside and, because the rest is normalised, in excess by the same amount
inside: at most twice the lost energy. Of PSFs in a few pixels, much of it is missing and in excess in the same pixels,
so these PSFs are compared with complete ones. And between the azimuths of a table, PSFs are mixed.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np

from ...runtime.threads import thread_pool
from ..psf_samples import FEW_PX
from .psf_bank import PsfBank

MISSED, ROUGHLY_MISSED = 1.15, 1.3  # limits of the true worst error over the worst examined; for one wide PSF
STEPS = 5  # evenly spaced, to examine at each wavelength: errors are largest halfway, and nearly the same in all steps,
# but larger where rows of samples coincide with the pixels' diagonals: next to the middle step of a quarter turn
TRIM_AZIMUTHS = 9  # at which PSFs are compared with less trimmed ones
QUADRANT_AZIMUTHS = 9  # at which one PSF is compared
PORTION_VALUES = 1 << 20  # of PSFs that are processed together


class AzimuthErrors:
    """Errors of the PSFs of one wavelength that are mixed between the azimuths of a table.

    Parameters
    ----------
    bank : PsfBank
        Trimmed PSFs.
    make_complete : callable () -> PsfBank
        Returns the complete PSFs. It is called for PSFs in a few pixels.
    last_height_mm : float
        The largest height that counts.
    """

    def __init__(self, bank: PsfBank, make_complete: Callable[[], PsfBank], last_height_mm: float) -> None:
        self._bank, self._complete = bank.up_to(last_height_mm), None
        if bank.radius_px <= FEW_PX and bank.lost.any():
            self._complete = make_complete().up_to(last_height_mm)
        self.mirror_symmetric = bank.mirror_symmetric

    @cached_property
    def _trimmed(self):
        """Errors by trimming alone: array (height,)."""
        return trim_error(self._bank, self._complete) if self._complete else 2 * self._bank.lost

    def at(self, azimuths: int, steps: np.ndarray) -> np.ndarray:
        """Errors of mixing halfway between two azimuths, or of this and of trimming PSFs in a few pixels: array (step,
        height), for int array `steps`, ascending.

        `azimuths` is the number of steps from 0 to 45 degrees.
        """
        bank, step = self._bank, np.pi / 4 / azimuths
        true, errors = self._complete or bank, np.empty((steps.size, bank.heights_mm.size))
        rim = [(0, 0), (0, 0), *[(true.radius_px - bank.radius_px,) * 2] * 2]
        portion = max(1, PORTION_VALUES // (3 * bank.heights_mm.size * (2 * true.radius_px + 1) ** 2))
        for start in range(0, steps.size, portion):
            part = steps[start:start + portion]
            places, index = np.unique(part[:, None] + np.arange(2), return_inverse=True)
            first, last = bank.at_table_heights(-places * step)[index.reshape(-1, 2).T]
            middle = true.at_table_heights(-(part + 0.5) * step)
            errors[start:start + portion] = np.abs(np.pad((first + last) / 2, rim) - middle).sum(axis=(2, 3))
        return errors

    def largest(self, azimuths: int, steps: np.ndarray) -> float:
        """Limit of the largest error with this table, trimming included, if the errors of these steps represent it."""
        errors = self.at(azimuths, steps).max(axis=0)
        if self._complete:
            return MISSED * float(np.maximum(errors, self._trimmed).max())
        return float((MISSED * errors + self._trimmed).max())


def azimuth_error(wavelengths: list[AzimuthErrors], azimuths: int) -> float:
    """Largest error of trimmed PSFs mixed between the azimuths of a table.

    Parameters
    ----------
    wavelengths : list of AzimuthErrors
    azimuths : int
        Steps from 0 to 45 degrees.
    """
    number = azimuths if all(each.mirror_symmetric for each in wavelengths) else 2 * azimuths
    steps = np.unique(np.linspace(0, number - 1, STEPS).round().astype(int))
    with thread_pool() as pool:
        return max(pool.map(lambda each: each.largest(azimuths, steps), wavelengths))


def trim_error(bank: PsfBank, complete: PsfBank) -> np.ndarray:
    """Largest errors of trimmed PSFs at some azimuths, by complete ones of the same heights: array (height,)."""
    azimuths = np.linspace(0, np.pi / (4 if bank.mirror_symmetric else 2), TRIM_AZIMUTHS)
    rim, errors = complete.radius_px - bank.radius_px, np.zeros(bank.lost.size)
    for azimuth in azimuths[:, None]:
        used = np.pad(bank.at_table_heights(azimuth)[0], ((0, 0), (rim, rim), (rim, rim)))
        errors = np.maximum(errors, np.abs(used - complete.at_table_heights(azimuth)[0]).sum(axis=(1, 2)))
    return errors


def isoplanatic_error(bank: PsfBank, make_complete: Callable[[], PsfBank], psf: np.ndarray, last_height_mm: float,
                      turns: int, enough: float) -> float:
    """Largest error of using one trimmed PSF for the complete field, or some error above `enough`.

    Parameters
    ----------
    bank : PsfBank
        Trimmed PSFs.
    make_complete : callable () -> PsfBank
        Returns the complete PSFs. It is called for PSFs in a few pixels.
    psf : array (row, column)
        The one PSF.
    last_height_mm : float
        The largest height that counts.
    turns : int
        Quadrants that count: the first one, where rows grow downwards and columns to the right, or all 4.
    enough : float
    """
    worst, few = 0.0, bank.radius_px <= FEW_PX
    true = (make_complete() if few else bank).up_to(last_height_mm)
    missed = MISSED if few else ROUGHLY_MISSED
    psf = np.pad(psf, true.radius_px - bank.radius_px)
    for part in (true.last_height, true):  # mostly, the last PSF differs most, and alone it takes little time
        for azimuth_rad in np.linspace(0, np.pi / 2, QUADRANT_AZIMUTHS):
            (psfs,) = part.at_table_heights(np.array([-azimuth_rad]))
            errors = [np.abs(np.rot90(psfs, turn, axes=(1, 2)) - psf).sum(axis=(1, 2)) for turn in range(turns)]
            worst = max(worst, float((missed * np.max(errors, axis=0) + 2 * part.lost).max()))
            if worst > enough:
                return worst
    return worst
