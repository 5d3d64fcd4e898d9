"""Pictures in the pixels of a sensor: means over each pixel's square, so that the light on an area stays the same."""

import numpy as np
import scipy


def pixel_means(picture: np.ndarray, pitch_um: float, shape_px: tuple[int, int], wanted_um: float,
                aperture: float = 1.0, some: tuple[slice, slice] = (slice(None), slice(None))) -> np.ndarray:
    """A picture in other pixels with the same middle.

    Parameters
    ----------
    picture : array (row, column)
        Means over squares of the pitch.
    pitch_um : float
    shape_px : (int, int)
        Rows and columns of the result; beyond the picture it is 0.
    wanted_um : float
        Their pitch.
    aperture : float
        Side of the square in the middle of each over which to average, in their pitches, up to 1.
    some : (slice, slice)
        Rows and columns of the result to return.

    Returns
    -------
    array (row, column)
    """
    if pitch_um == wanted_um and picture.shape == tuple(shape_px):
        return picture[some]
    down, across = (_shares(n, pitch_um, wanted, wanted_um, aperture)[each]
                    for n, wanted, each in zip(picture.shape, shape_px, some, strict=True))
    return down @ np.ascontiguousarray((across @ picture.T).T)


def _shares(number, pitch_um, wanted, wanted_um, aperture):
    """Shares of the side of each wanted pixel's aperture that a row's pixels cover: sparse array (wanted, number)."""
    edges_um, side_um = pitch_um * (np.arange(number + 1) - number / 2), aperture * wanted_um
    starts_um = wanted_um * (np.arange(wanted) + 0.5 - wanted / 2) - side_um / 2
    first = np.clip(np.searchsorted(edges_um, starts_um, "right") - 1, 0, number - 1)
    most = int(np.ceil(side_um / pitch_um)) + 1
    rows = np.repeat(np.arange(wanted), most)
    columns = np.minimum(first[:, None] + np.arange(most), number - 1).ravel()
    repeated = np.concatenate([[False], (np.diff(columns) == 0) & (np.diff(rows) == 0)])
    overlaps_um = (np.minimum(edges_um[columns + 1], starts_um[rows] + side_um)
                   - np.maximum(edges_um[columns], starts_um[rows]))
    shares = np.where(repeated, 0, np.maximum(overlaps_um, 0)) / side_um
    return scipy.sparse.csr_array((shares.astype(np.float32), (rows, columns)), shape=(wanted, number))
