"""Even light stays even, so that it need not be filtered: where that is so, and what PSFs' lean makes of it."""


import numpy as np

from ..field.psf_bank import PlacedPsfs
from ..field.psf_table import PsfCells
from ..threads import thread_pool


def flat_slope(table: PsfCells, psfs: PlacedPsfs, tolerance: float) -> float:
    """Relative change of light from pixel to pixel that blur may ignore for this relative error; 0 where none.

    A pixel's light comes from pixels whose distance, the steps along x and y, is on the mean `steps_px`; it then
    differs from that of even light by no more than the slope times this. And even light stays even, as `even_light`
    has it, but for what the PSFs' spread changes over the field.
    """
    distance_px = table.mean_distance_px
    field_px = psfs.field.last_real_mm / (psfs.planes.picture.pitch_um * 1e-3)
    steps_px = np.sqrt(2) * distance_px + 1
    return max(tolerance - 2 * (distance_px / field_px) ** 2, 0) / 2 / steps_px


def even_light(light: np.ndarray, flat: np.ndarray, section_size: int, psfs: PlacedPsfs,
               table: PsfCells) -> tuple[np.ndarray, np.ndarray]:
    """Which pixels lie in flat sections, and what they come to: arrays (plane, row, column).

    Even light stays even but where PSFs lean more, or less, from place to place: where the light of a pixel moves by m
    on the mean, its density becomes 1 - div m.

    Parameters
    ----------
    light : array (plane, row, column)
    flat : bool array (section row, section column)
        See `SectionNeeds`.
    section_size : int
    psfs : PlacedPsfs
    table : PsfCells
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
    """How far down and to the right light moves on the mean, from these rows and columns: two arrays."""
    (rows, down_sign), (columns, right_sign) = (psfs.planes.mirrored_into(*at) for at in ((rows, 0), (columns, 1)))
    places = np.meshgrid(rows, columns, indexing="ij")
    offsets = table.mean_offsets_px(*psfs.place(*(axis.ravel() for axis in places)))
    down, right = offsets.reshape(2, rows.size, columns.size)
    return down_sign[:, None] * down, right_sign * right
