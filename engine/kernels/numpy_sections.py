"""The light of square sections in numpy: for machines without a library, for double precision, and as the reference of
tests."""

import numpy as np


def numpy_excess(light: np.ndarray, level: float, section_px: int, rows: slice, out: np.ndarray) -> None:
    """As `kernels.excess.excess`."""
    for i in range(*rows.indices(out.shape[1])):
        band = np.maximum(light[:, i * section_px:(i + 1) * section_px] - light.dtype.type(level), 0)
        out[:, i] = np.add.reduceat(band.sum(axis=1, dtype=np.float64), np.arange(0, band.shape[2], section_px), axis=1)


def numpy_extremes(light: np.ndarray, section_px: int, rows: slice, out: np.ndarray) -> None:
    """As `kernels.extremes.extremes`."""
    for i in range(*rows.indices(out.shape[1])):
        band, below = (np.abs(light[:, start:start + section_px]) for start in (i * section_px, i * section_px + 1))
        lit = np.where(band > 0, band, np.inf)
        step = np.abs(below - band[:, :below.shape[1]]).max(axis=(0, 1), initial=0)
        right = np.abs(np.diff(band, axis=2)).max(axis=(0, 1))
        np.maximum(step[:-1], right, out=step[:-1])
        out[:, i] = [extreme.reduceat(values, np.arange(0, values.size, section_px)) for extreme, values in (
            (np.maximum, band.max(axis=(0, 1))), (np.minimum, lit.min(axis=(0, 1))),
            (np.minimum, band.min(axis=(0, 1))), (np.maximum, step))]
