"""PSFs of a bake, in threads."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from threading import Event

import numpy as np

from ..runtime.threads import thread_count
from .diffraction import WORST_FIT_WAVES, point_spread
from .pupil_fit import fit_pupils
from .quality import Quality
from .wavefront import Wavefronts

HIGHER_DEGREES = 16, 20, 24  # of polynomials, for wavefronts that a quality's own do not fit
SURVEY_SHARE = 0.2  # approximate share of the bake's time, for the progress bar


def psfs_of(traced: Wavefronts, wavefronts: Wavefronts, height: int, pitch_um: float, samples: int, quality: Quality,
            stopped: Event) -> tuple[np.ndarray, float]:
    """PSFs of a height, or of a place on the sensor, at all wavelengths.

    Parameters
    ----------
    traced, wavefronts : Wavefronts
        At the traced wavelengths, and at the wavelengths of the PSFs.
    height : int
    pitch_um : float
    samples : int
    quality : Quality
    stopped : Event
        If it is set, the rest of the PSFs is left 0.

    Returns
    -------
    array (wavelength, v, u)
        Shares of all light.
    float
        Number of the finest fringes in a sample.
    """
    nm = wavefronts.wavelengths_nm
    fits = _fits([traced.one(wavelength, height) for wavelength in range(traced.wavelengths_nm.size)],
                 quality.sums.degree, nm)
    psfs = np.zeros((nm.size, samples, samples))
    for wavelength, fit in enumerate(fits):
        if stopped.is_set():
            break
        psfs[wavelength] = point_spread(wavefronts.one(wavelength, height), pitch_um, samples, quality.sums, fit)
    return psfs, fits[0].fringes(nm[0], pitch_um)


def _fits(traced, degree, wavelengths_nm):
    """The `fit_pupils` of the lowest degree, from the given one, that fits the wavefronts, or else of the highest."""
    for higher in (degree, *(each for each in HIGHER_DEGREES if each > degree)):
        fits = fit_pupils(traced, higher, wavelengths_nm)
        if fits[0].error_um < WORST_FIT_WAVES * wavelengths_nm.min() * 1e-3:
            break
    return fits


def in_threads(compute: Callable[[int, Event], object], number: int, workers: int | None,
               progress: Callable[[float, str], object]) -> None:
    """Call a function for all integers below a number; its event is set if the bake ends early.

    Parameters
    ----------
    compute : function (integer, Event)
    number : int
    workers : int or None
        Threads; None for one per core.
    progress : function (fraction, label)
    """
    stopped = Event()
    with ThreadPoolExecutor(workers or thread_count()) as pool:
        futures = [pool.submit(compute, one, stopped) for one in range(number)]
        try:
            for count, future in enumerate(as_completed(futures), 1):
                future.result()
                progress(SURVEY_SHARE + (1 - SURVEY_SHARE) * count / number, "Computing PSFs")
        except BaseException:
            stopped.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
