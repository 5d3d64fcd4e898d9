"""Uniform light stays uniform, without a filter, except for the change of the PSFs' mean offset over the field."""


import numpy as np

from ..field.field_map import Cells, PlacedPsfs
from ..runtime.threads import thread_pool


def flat_slope(table: Cells, psfs: PlacedPsfs, tolerance: float) -> float:
    """Relative change of light between adjacent pixels that may be left unfiltered at this relative error; 0 for none.

    A pixel's light comes from pixels at an average distance, in steps along x and y, of `steps_px`. It therefore
    differs from uniform light by at most the slope times this distance. The tolerance also includes the change of the
    PSFs' width over the field, which `even_light` ignores.
    """
    distance_px = table.mean_distance_px
    field_px = psfs.extent_mm / (psfs.planes.picture.pitch_um * 1e-3)
    steps_px = np.sqrt(2) * distance_px + 1
    return max(tolerance - 2 * (distance_px / field_px) ** 2, 0) / 2 / steps_px


def even_light(light: np.ndarray, flat: np.ndarray, section_size: int, psfs: PlacedPsfs,
               table: Cells) -> tuple[np.ndarray, np.ndarray]:
    """The pixels of flat sections, and their light after the blur: arrays (plane, row, column).

    Uniform light stays uniform, except where the mean offset of the PSFs' light changes over the field: if the light of
    a pixel moves by m on average, its density becomes 1 - div m.

    Parameters
    ----------
    light : array (plane, row, column)
    flat : bool array (section row, section column)
        See `SectionNeeds`.
    section_size : int
    psfs : PlacedPsfs
    table : Cells
    """
    mask, values = np.zeros(light.shape, dtype=bool), np.zeros_like(light)

    def write_down(section):
        i, j = section
        down, right = _mean_offsets_px(np.arange(-1, section_size + 1) + i * section_size,
                                       np.arange(-1, section_size + 1) + j * section_size, psfs, table)
        density = 1 - (down[2:, 1:-1] - down[:-2, 1:-1]) / 2 - (right[1:-1, 2:] - right[1:-1, :-2]) / 2
        inside = (slice(None), slice(i * section_size, (i + 1) * section_size),
                  slice(j * section_size, (j + 1) * section_size))
        mask[inside] = True
        values[inside] = light[inside] * density[:light[inside].shape[1], :light[inside].shape[2]]

    with thread_pool() as pool:
        list(pool.map(write_down, np.argwhere(flat)))
    return psfs.planes.without_doubles(mask), psfs.planes.without_doubles(values)


def _mean_offsets_px(rows, columns, psfs, table):
    """Mean offset of light from these rows and columns, downwards and to the right: two arrays."""
    (rows, down_sign), (columns, right_sign) = (psfs.planes.mirrored_into(*at) for at in ((rows, 0), (columns, 1)))
    places = np.meshgrid(rows, columns, indexing="ij")
    offsets = table.mean_offsets_px(psfs.place(*(axis.ravel() for axis in places)))
    down, right = offsets.reshape(2, rows.size, columns.size)
    return down_sign[:, None] * down, right_sign * right
