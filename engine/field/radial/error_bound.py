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

MISSED, ROUGHLY_MISSED = 1.2, 2.2  # limits of the true worst error over the worst examined; for only a few azimuths
BRIGHTEST = 512  # samples of a PSF
BRIGHT_STEPS, EVEN_STEPS = 8, 2  # to examine: with the worst brightest samples; and evenly spaced, at each wavelength
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
        self._bank, self._brightest = bank, bank.brightest(BRIGHTEST)
        self._heights = _heights_up_to(bank, last_height_mm)
        self.trimmed = 2 * bank.lost[:self._heights]
        self.mirror_symmetric = bank.mirror_symmetric

    def at(self, azimuths: int, steps: np.ndarray) -> np.ndarray:
        """Largest errors of mixing between two azimuths: array (step, height), for int array `steps`, ascending.

        `azimuths` is the number of steps from 0 to 45 degrees.
        """
        return self._between(self._bank, azimuths, steps, parts=4)

    def guessed(self, azimuths: int, steps: np.ndarray) -> np.ndarray:
        """Estimated errors `at` these steps from the brightest samples, some twenty times as fast: array (step,).

        Single steps have much larger errors than others if such a sample crosses the edge of a pixel there.
        """
        return self._between(self._brightest, azimuths, steps, parts=2)[:, 0]

    def _between(self, bank, azimuths, steps, parts):
        """Largest errors at the borders of this number of equal parts of each step."""
        portion = max(1, PORTION_VALUES // ((parts + 1) * bank.heights_mm.size * (2 * bank.radius_px + 1) ** 2))
        errors = np.zeros((steps.size, min(self._heights, bank.heights_mm.size)))
        for start in range(0, steps.size, portion):
            part = slice(start, start + portion)
            places, index = np.unique(parts * steps[part, None] + np.arange(parts + 1), return_inverse=True)
            psfs = bank.at_table_heights(-places * (np.pi / 4 / azimuths / parts))[:, :self._heights]
            first, *inner, last = (psfs[each] for each in index.reshape(-1, parts + 1).T)
            for number, true in enumerate(inner, start=1):
                mixed = first + (last - first) * (number / parts)
                errors[part] = np.maximum(errors[part], np.abs(mixed - true).sum(axis=(2, 3)))
        return errors


def azimuth_error(wavelengths: list[AzimuthErrors], azimuths: int, enough: float = np.inf) -> float:
    """Largest error of trimmed PSFs mixed between the azimuths of a table, or some error above `enough`.

    Parameters
    ----------
    wavelengths : list of AzimuthErrors
    azimuths : int
        Steps from 0 to 45 degrees.
    enough : float
    """
    steps = np.arange(azimuths if all(each.mirror_symmetric for each in wavelengths) else 2 * azimuths)
    with thread_pool() as pool:
        guesses = np.stack(list(pool.map(lambda each: each.guessed(azimuths, steps), wavelengths)))
        first, then = np.zeros((2, *guesses.shape), dtype=bool)
        first.ravel()[np.argsort(guesses, axis=None)[-BRIGHT_STEPS:]] = True
        then[:, np.linspace(0, steps.size - 1, EVEN_STEPS).round().astype(int)] = True
        worst = 0.0
        for look in (first, then & ~first):
            results = pool.map(lambda each, looked: MISSED * each.at(azimuths, steps[looked]) + each.trimmed,
                               wavelengths, look)
            worst = max(worst, max(errors.max(initial=0.0) for errors in results))
            if worst > enough:
                break
    return float(worst)


def isoplanatic_error(bank: PsfBank, psf: np.ndarray, last_height_mm: float, samples: int) -> float:
    """Largest error of using one trimmed PSF, (row, column), for the complete field, from this number of azimuths."""
    heights = _heights_up_to(bank, last_height_mm)
    psfs = bank.at_table_heights(-np.linspace(0, np.pi / 2, samples))[:, :heights]
    errors = [np.abs(np.rot90(psfs, turn, axes=(2, 3)) - psf).sum(axis=(2, 3)) for turn in range(4)]
    return float((ROUGHLY_MISSED * np.max(errors, axis=(0, 1)) + 2 * bank.lost[:heights]).max())


def _heights_up_to(bank, last_height_mm):
    """Number of the table's heights that contribute to PSFs up to this one."""
    return int(np.searchsorted(bank.heights_mm, last_height_mm)) + 1
