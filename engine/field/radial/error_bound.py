"""The fraction of a point's light that a method misplaces, computed before any pixel is filtered.

The error of a picture is the sum of its points' errors: with e the largest ||PSF used - PSF true||_1 over the field,
sum |error| <= e * light for every scene. The error is therefore sought among the PSFs, not in the picture. Between two
heights of the lens data, the true PSFs and the table's are the same mixtures of the PSFs at these heights, so their
errors are at most those at the two heights: it is sufficient to examine the heights of the data.

PSFs have two errors. Trimmed light is missing outside and, because the rest is normalised, in excess by the same amount
inside: twice the lost energy. And between the azimuths of a table, PSFs are mixed.
"""

import numpy as np

from ...runtime.threads import thread_pool
from .psf_bank import PsfBank

MISSED, ROUGHLY_MISSED = 1.15, 2.2  # limits of the true worst error over the worst examined; for only a few azimuths
STEPS = 5  # evenly spaced, to examine at each wavelength: errors are largest halfway, and nearly the same in all steps,
# but larger where rows of samples coincide with the pixels' diagonals: next to the middle step of a quarter turn
PORTION_VALUES = 1 << 20  # of PSFs that are processed together


class AzimuthErrors:
    """Errors of the PSFs of one wavelength that are mixed between the azimuths of a table.

    Parameters
    ----------
    bank : PsfBank
    last_height_mm : float
        The largest height that counts.
    """

    def __init__(self, bank: PsfBank, last_height_mm: float) -> None:
        self._bank = bank.up_to(last_height_mm)
        self.trimmed = 2 * self._bank.lost
        self.mirror_symmetric = bank.mirror_symmetric

    def at(self, azimuths: int, steps: np.ndarray) -> np.ndarray:
        """Errors of mixing halfway between two azimuths: array (step, height), for int array `steps`, ascending.

        `azimuths` is the number of steps from 0 to 45 degrees.
        """
        bank = self._bank
        portion = max(1, PORTION_VALUES // (3 * bank.heights_mm.size * (2 * bank.radius_px + 1) ** 2))
        errors = np.empty((steps.size, bank.heights_mm.size))
        for start in range(0, steps.size, portion):
            part = slice(start, start + portion)
            places, index = np.unique(2 * steps[part, None] + np.arange(3), return_inverse=True)
            psfs = bank.at_table_heights(-places * (np.pi / 8 / azimuths))
            first, true, last = (psfs[each] for each in index.reshape(-1, 3).T)
            errors[part] = np.abs((first + last) / 2 - true).sum(axis=(2, 3))
        return errors

    def largest(self, azimuths: int, steps: np.ndarray) -> float:
        """Limit of the largest error with this table, trimming included, if the errors of these steps represent it."""
        return float((MISSED * self.at(azimuths, steps) + self.trimmed).max())


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


def isoplanatic_error(bank: PsfBank, psf: np.ndarray, last_height_mm: float, samples: int, enough: float) -> float:
    """Largest error of using one trimmed PSF, (row, column), for the complete field, from this number of azimuths; or
    some error above `enough`."""
    bank, worst = bank.up_to(last_height_mm), 0.0
    for part in (bank.last_height, bank):  # mostly, the last PSF differs most, and alone it takes little time
        for azimuth_rad in np.linspace(0, np.pi / 2, samples):
            (psfs,) = part.at_table_heights(np.array([-azimuth_rad]))
            errors = [np.abs(np.rot90(psfs, turn, axes=(1, 2)) - psf).sum(axis=(1, 2)) for turn in range(4)]
            worst = max(worst, float((ROUGHLY_MISSED * np.max(errors, axis=0) + 2 * part.lost).max()))
            if worst > enough:
                return worst
    return worst
