"""Lost rays, extrapolated from the traced ones, so that splines over the stop have no edge."""

from functools import lru_cache

import numpy as np
import scipy

TRUSTED = -0.3  # least margin of blocked rays that are used to extrapolate; rays with less nearly graze a surface
LOST = -1.0  # margin of a ray that does not reach the sensor for other reasons than apertures
ORDER = 4  # of the differences that extrapolation minimizes
FAINT = 1e-5  # weight of first differences relative to these, in case too few rays are known


def without_lost(values: np.ndarray, margin: np.ndarray, known: np.ndarray, *, around: bool = False) -> np.ndarray:
    """Quantities of rays with the lost ones extrapolated.

    Parameters
    ----------
    values : array (quantity, wavelength, place, radius, azimuth)
        As `ray_table.traced_quantities`.
    margin : array (wavelength, place, radius, azimuth)
    known : bool array, same shape
        Rays that reach their place. The others' values are not used.
    around : bool
        Whether the azimuths go around the stop, so that the last is next to the first.

    Returns
    -------
    array (quantity, wavelength, place, radius, azimuth)
        With the margin as the fifth quantity.
    """
    *entrance, path_mm, cosine_x, cosine_y = continued(values, _trusted(known, np.nan_to_num(margin), around),
                                                       around=around)
    beyond, = continued(margin[None], known, around=around)
    margin = np.where(known, margin, np.where(beyond < 0, beyond, LOST))
    within = np.minimum.accumulate(margin, axis=-2)  # beyond a lost ray no ray passes again
    return np.stack([*entrance, _bounded(np.where(known, margin, within)), path_mm, cosine_x, cosine_y])


def _bounded(margin):
    """Compress margins below half of LOST so that none is less than LOST: splines between larger ones would overshoot
    and let blocked rays pass."""
    half = LOST / 2
    return np.where(margin < half, LOST - half**2 / np.minimum(margin, half), margin)


def _trusted(known, margin, around):
    """Rays to extrapolate from: passing rays, and blocked rays that are neither far out nor next to lost ones."""
    beyond = int(around)
    lost = np.pad(~known, [(0, 0)] * 3 + [(beyond, beyond)], mode="wrap")
    near_lost = scipy.ndimage.binary_dilation(lost, np.ones((1, 1, 3, 3)))[..., beyond:lost.shape[-1] - beyond]
    return known & ((margin > 0) | (margin > TRUSTED) & ~near_lost)


def continued(values: np.ndarray, known: np.ndarray, *, order: int = ORDER, around: bool = False) -> np.ndarray:
    """Values with the unknown ones chosen to minimize differences along the last two axes.

    Parameters
    ----------
    values : array (quantity, ..., radius, azimuth)
    known : bool array (..., radius, azimuth)
    order : int
        Of the differences: they vanish for polynomials of a lower degree.
    around : bool
        Whether the azimuths go around the stop, so that the last is next to the first.
    """
    values = values.copy()
    squares = _squared_differences(*known.shape[-2:], order, around)
    for place in np.argwhere(~known.all(axis=(-2, -1))):
        traced, index = known[*place].ravel(), (slice(None), *place)
        rows, missing = values[index].reshape(len(values), -1), np.flatnonzero(~traced)
        factors = scipy.sparse.linalg.splu(squares[missing][:, missing], permc_spec="MMD_AT_PLUS_A",
                                           diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        rows[:, missing] = factors.solve(-(squares @ np.where(traced, rows, 0.0).T)[missing]).T
        values[index] = rows.reshape(len(values), *known.shape[-2:])
    return values


@lru_cache(maxsize=4)
def _squared_differences(radii, azimuths, highest, around):
    """Sparse matrix of the sum of squared differences over radii and azimuths."""
    def over(count, order, circle):
        steps = np.diff(np.pad(np.eye(count), ((0, order * circle), (0, 0)), mode="wrap"), order, axis=0)
        return scipy.sparse.csr_matrix(steps.T @ steps)

    return sum(faint**2 * (scipy.sparse.kron(over(radii, order, False), scipy.sparse.eye(azimuths))
                           + scipy.sparse.kron(scipy.sparse.eye(radii), over(azimuths, order, around)))
               for order, faint in ((highest, 1.0), (1, FAINT))).tocsc()
