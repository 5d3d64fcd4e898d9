"""Pictures in the pixels of a sensor: means over each pixel's square, so that the light on an area stays the same."""

import numpy as np
import scipy


def pixel_means(picture: np.ndarray, pitch_um: float, shape_px: tuple[int, int], wanted_um: float) -> np.ndarray:
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

    Returns
    -------
    array (row, column)
    """
    if pitch_um == wanted_um and picture.shape == tuple(shape_px):
        return picture
    down, across = (_shares(n, pitch_um, wanted, wanted_um)
                    for n, wanted in zip(picture.shape, shape_px, strict=True))
    return (across @ (down @ picture).T).T


def _shares(number, pitch_um, wanted, wanted_um):
    """Shares of each wanted pixel's side that the pixels of a row cover: sparse array (wanted, number)."""
    edges_um, wanted_um_edges = (size_um * (np.arange(n + 1) - n / 2)
                                 for n, size_um in ((number, pitch_um), (wanted, wanted_um)))
    first = np.clip(np.searchsorted(edges_um, wanted_um_edges[:-1], "right") - 1, 0, number - 1)
    most = int(np.ceil(wanted_um / pitch_um)) + 1
    rows = np.repeat(np.arange(wanted), most)
    columns = np.minimum(first[:, None] + np.arange(most), number - 1).ravel()
    repeated = np.concatenate([[False], (np.diff(columns) == 0) & (np.diff(rows) == 0)])
    ends, starts = (choose(edges_um[columns + step], wanted_um_edges[rows + step])
                    for step, choose in ((1, np.minimum), (0, np.maximum)))
    shares = np.where(repeated, 0, np.maximum(ends - starts, 0)) / wanted_um
    return scipy.sparse.csr_array((shares.astype(np.float32), (rows, columns)), shape=(wanted, number))
