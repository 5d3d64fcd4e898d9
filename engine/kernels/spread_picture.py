"""Spread all of a picture's light at once, on the graphics processor."""

import numpy as np

from .gpu import usable_gpu
from .gpu_calls import leaving_to_c
from .gpu_spread import gpu_spread
from .spreading import PackedTable, TablePlaces

LEAST_TAPS = 1e9  # of all pixels, a tenth of a processor second in C: fewer are not worth opening a device
TAPS_PER_BYTE = 12  # transferred: with fewer, C takes less time than the transfer alone, on a few cores


def spread_picture(table: PackedTable, places: TablePlaces, light: np.ndarray, lit: np.ndarray,
                   section_px: int) -> tuple[np.ndarray, str] | None:
    """The picture, as by `kernels.spreading.spread`, and the name of the graphics processor.

    None if C is to spread the light: because it takes less time than the transfer of light and PSFs would, without a
    graphics processor, or after an error and a warning.
    """
    if _is_little_work(table, light, lit, section_px):
        return None
    gpu = usable_gpu()
    if gpu:
        with leaving_to_c(gpu):
            return gpu_spread(gpu, table, places, light, lit, section_px), gpu.name
    return None


def _is_little_work(table, light, lit, section_px):
    """Whether lit pixels have few taps, also for the bytes that are transferred: the same in each run."""
    taps = float(table.taps_by_interval.mean()) * np.count_nonzero(lit) * section_px**2 * len(light)
    return taps < max(LEAST_TAPS, TAPS_PER_BYTE * (2 * light.nbytes + table.nbytes))
