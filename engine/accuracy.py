"""How much of a point's light a way of filtering puts into the wrong place: found out before a pixel is filtered.

The error of a picture is the sum of its points' errors: with e the largest ||PSF used - PSF true||_1 over the field,
sum |error| <= e * light for every scene. So it is looked for where the PSFs are, not in the picture. And between two
of the lens data's heights PSFs are mixtures of theirs, in truth as in the polar table, so that they have at most the
errors of the two: the heights of the data are all there is to look at.
"""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

ALL_SEEN, SOME_SEEN = 1.1, 2.2  # the true worst over the worst found is less, where all or some azimuths are looked at


def azimuth_error(bank, azimuths, last_height_mm, samples):
    """Largest error of PSFs mixed between the azimuths of a polar table: halfway between them, where it is greatest.

    Parameters
    ----------
    bank : PsfBank
    azimuths : int
        Steps from 0 to 45 degrees.
    last_height_mm : float
        The heights that count.
    samples : int
        How many steps to look at.
    """
    heights = _heights_up_to(bank, last_height_mm)
    steps = np.unique(np.linspace(0, azimuths - 1, samples).round())

    def errors(some):
        worst, kept = 0.0, {}  # neighbours share an end
        for step in some:
            places = step + np.array((0, 0.5, 1))
            kept = {place: kept[place] if place in kept else
                    bank.at_table_heights(-place * np.pi / 4 / azimuths * np.ones(1))[0, :heights] for place in places}
            before, halfway, after = kept.values()
            worst = max(worst, float(np.abs((before + after) / 2 - halfway).sum(axis=(1, 2)).max()))
        return worst

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        portions = np.array_split(steps, min(steps.size, os.cpu_count()))
        return max(pool.map(errors, portions)) * (ALL_SEEN if steps.size == azimuths else SOME_SEEN)


def isoplanatic_error(bank, psf, last_height_mm, samples):
    """Largest error of using one PSF, (row, column), for the whole field. Parameters as in `azimuth_error`."""
    psfs = bank.at_table_heights(-np.linspace(0, np.pi / 2, samples))[:, :_heights_up_to(bank, last_height_mm)]
    return SOME_SEEN * max(float(np.abs(np.rot90(psfs, turn, axes=(2, 3)) - psf).sum(axis=(2, 3)).max())
                           for turn in range(4))


def _heights_up_to(bank, last_height_mm):
    """How many of the table's heights have a part in the PSFs up to this one."""
    return int(np.searchsorted(bank.heights_mm, last_height_mm)) + 1
