"""Radiance at pixels of the sensor along their rays, through layers of a capture."""

from ctypes import addressof, byref

import numpy as np

from .arrays import address, picture
from .casting import MEETING, TOGETHER, Casting, rays_shape
from .declarations import NUMBERS, STRUCTURES
from .library import NUMPY, check, chosen, running
from .numpy_cast import numpy_cast

LEVELS = NUMBERS["LEVELS"]  # maximum number of resolutions of a layer
CAST, LAYER, LEVEL = (STRUCTURES[name] for name in ("cast_of", "layer", "level"))


def cast(casting: Casting, row: int, blurred: np.ndarray, clear: np.ndarray) -> None:
    """Write the pixels of a row of tiles.

    Parameters
    ----------
    casting : Casting
    row : int
        Index of the row of tiles.
    blurred, clear : float32 arrays (wavelength, row, column)
        Out-of-focus radiance, as a mean weighted with the rays' light; and the share of in-focus light that it does not
        cover.

    Raises
    ------
    ValueError
    """
    if running() == NUMPY:
        numpy_cast(casting, row, blurred, clear)
        return
    loops, variant = chosen()
    layers = (LAYER * len(casting.layers))(*map(_layer, casting.layers))
    values, (nodes, rows, nodes_per_px) = casting.rays.eights, casting.rays.nodes
    of_eight = rays_shape(nodes * max(rows, 1), values.shape[1], casting.wavelengths)
    tile_rows, tile_columns = casting.eights.shape
    structure = CAST(address(values, np.float32, of_eight), nodes, values.shape[1], casting.wavelengths, rows,
                     *casting.centre_px, nodes_per_px, *casting.rays.mesh, *casting.per_focal,
                     address(casting.shrinkage, np.float32), len(casting.shrinkage) - 1,
                     address(casting.blades, np.float32), len(casting.blades), *casting.blade_shape,
                     casting.cell_of_eight, addressof(layers), len(layers),
                     (casting.faint + (0.0,) * TOGETHER)[:TOGETHER],
                     address(casting.meetings, MEETING, (tile_rows, tile_columns, len(layers))),
                     address(casting.first_eights, np.int64, casting.eights.shape),
                     address(casting.eights, np.int64), address(casting.steps, np.int64, casting.eights.shape),
                     tile_rows, tile_columns, casting.tile_px)
    work = np.empty(32 * casting.wavelengths * casting.tile_px**2, np.float32)
    check(loops.lf_cast(variant, byref(structure), row * tile_columns, (row + 1) * tile_columns,
                        byref(picture(blurred)), byref(picture(clear)), address(work, np.float32)))


def _layer(layer):
    levels = (LEVEL * LEVELS)(*map(_level, layer.levels))
    return LAYER(levels, len(layer.levels), address(layer.depth, np.float32, (*layer.levels[0].alpha.shape, 2)))


def _level(level):
    light, alpha = picture(level.light), level.alpha
    if alpha.dtype != np.float32 or alpha.strides != level.light.strides[1:]:
        raise ValueError("the strides of alpha differ from the light's")
    return LEVEL(light, alpha.ctypes.data, *level.axis_px, level.per_px, *level.bounds_px)
