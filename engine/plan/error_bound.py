"""How much of a point's light a way of filtering puts into the wrong place: found out before a pixel is filtered.

The error of a picture is the sum of its points' errors: with e the largest ||PSF used - PSF true||_1 over the field,
sum |error| <= e * light for every scene. So it is looked for where the PSFs are, not in the picture. And between two
of the lens data's heights PSFs are mixtures of theirs, in truth as in the table, so that they have at most the
errors of the two: the heights of the data are all there is to look at.

PSFs err in two ways. What is trimmed of one is missing outside and, for the rest is normalised, as much too much
inside: twice the energy lost. And between the azimuths of a table they are mixed.
"""


import numpy as np

from ..field.psf_bank import PsfBank
from ..threads import thread_pool

MISSED, ROUGHLY_MISSED = 1.2, 2.2  # the true worst over the worst found is less; where a few azimuths stand for all
BRIGHTEST = 512  # samples of a PSF
BRIGHT_STEPS, EVEN_STEPS = 8, 2  # between azimuths: where the brightest err most, and evenly, at each wavelength
PORTION_VALUES = 1 << 20  # of PSFs in work at once


class AzimuthErrors:
    """Errors of the PSFs of one wavelength that are mixed between the azimuths of a table.

    Parameters
    ----------
    bank : PsfBank
    last_height_mm : float
        The heights that count.
    """

    def __init__(self, bank: PsfBank, last_height_mm: float) -> None:
        self._bank, self._brightest = bank, bank.brightest(BRIGHTEST)
        self._heights = _heights_up_to(bank, last_height_mm)
        self.trimmed = 2 * bank.lost[:self._heights]
        self.mirror_symmetric = bank.mirror_symmetric

    def at(self, azimuths: int, steps: np.ndarray) -> np.ndarray:
        """Largest errors of mixing between two azimuths: array (step, height), for int array `steps`, ascending.

        There are so many `azimuths`, steps from 0 to 45 degrees.
        """
        return self._between(self._bank, azimuths, steps, parts=4)

    def guessed(self, azimuths: int, steps: np.ndarray) -> np.ndarray:
        """What the brightest samples tell of the errors `at` these steps, some twenty times as quickly: array (step,).

        Where such a sample crosses the edge of a pixel, single steps stand out from the others.
        """
        return self._between(self._brightest, azimuths, steps, parts=2)[:, 0]

    def _between(self, bank, azimuths, steps, parts):
        """Largest errors found at the borders of so many equal parts of each step."""
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
    """Largest error of trimmed PSFs mixed between the azimuths of a table, or some error of more than `enough`.

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
            found = pool.map(lambda each, looked: MISSED * each.at(azimuths, steps[looked]) + each.trimmed,
                             wavelengths, look)
            worst = max(worst, max(errors.max(initial=0.0) for errors in found))
            if worst > enough:
                break
    return float(worst)


def isoplanatic_error(bank: PsfBank, psf: np.ndarray, last_height_mm: float, samples: int) -> float:
    """Largest error of using one trimmed PSF, (row, column), for the whole field, found at so many azimuths."""
    heights = _heights_up_to(bank, last_height_mm)
    psfs = bank.at_table_heights(-np.linspace(0, np.pi / 2, samples))[:, :heights]
    errors = [np.abs(np.rot90(psfs, turn, axes=(2, 3)) - psf).sum(axis=(2, 3)) for turn in range(4)]
    return float((ROUGHLY_MISSED * np.max(errors, axis=(0, 1)) + 2 * bank.lost[:heights]).max())


def _heights_up_to(bank, last_height_mm):
    """How many of the table's heights have a part in the PSFs up to this one."""
    return int(np.searchsorted(bank.heights_mm, last_height_mm)) + 1
