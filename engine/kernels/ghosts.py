"""Rays that two surfaces of a lens reflect, and their light on the sensor."""

from collections.abc import Sequence
from ctypes import byref
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .arrays import address, picture
from .declarations import NUMBERS, STRUCTURES
from .ghost_meshes import LIGHT, Blades, Meshes
from .library import NUMPY, check, chosen, running
from .numpy_ghosts import numpy_draw_ghosts
from .tracing import TracedSurfaces

BEAM, MESHES, PICTURE = (STRUCTURES[name] for name in ("beam", "meshes", "picture"))
CROSSINGS, RIM, MOST_WAVES, ABREAST = (NUMBERS[name] for name in ("CROSSINGS", "GHOST_RIM", "GHOST_WAVES",
                                                                  "GHOST_ABREAST"))
SLACK = 8  # floats behind each row


@dataclass(frozen=True, eq=False)
class Beam:
    """Light in front of a lens, from a point.

    Attributes
    ----------
    axes : array (3, 3)
        Axes across and up its cross section through the first vertex, and its direction there: one in each row.
    source_mm : array (3,)
        Place of the point, from the first vertex; ignored at infinity.
    distance_mm : float
        Of the point from the viewpoint, for which its irradiance is given; inf for infinity.
    """

    axes: np.ndarray
    source_mm: np.ndarray
    distance_mm: float


@dataclass(frozen=True, eq=False)
class Coated:
    """What the surfaces of a lens do to light along the paths of one wavelength.

    Attributes
    ----------
    indices : array (surface + 1,)
        Refractive indices.
    waves : int
        Number of wavelengths whose light has these paths, up to MOST_WAVES.
    reflectances : array (surface, step, MOST_WAVES)
        At even steps of (n sin(angle))^2 from 0; the first `waves` ones count.
    steps_per_unit : float
    """

    indices: np.ndarray
    waves: int
    reflectances: np.ndarray
    steps_per_unit: float


class Openings(NamedTuple):
    """The apertures of a lens.

    Attributes
    ----------
    per_semi_aperture : array (surface,)
        One over the semi-aperture of each surface in mm, and of the stop's opening; 0 for unlimited surfaces.
    per_half_width : array (surface, 2)
        One over the half-widths of rectangular apertures along x and y; 0 without one.
    """

    per_semi_aperture: np.ndarray
    per_half_width: np.ndarray


def ghost_rays(surfaces: TracedSurfaces, coated: Coated, openings: Openings, beam: Beam, pairs: np.ndarray,
               boxes: np.ndarray, shape: tuple[int, int], farthest: float = np.inf) -> np.ndarray:
    """Trace rays on even grids across a beam, reflected at two surfaces, to the image plane.

    Parameters
    ----------
    surfaces : TracedSurfaces
    coated : Coated
    openings : Openings
    beam : Beam
    pairs : int array (pair, 2)
        Surfaces that reflect, the one nearer to the object first; (-1, -1) for light that is not reflected.
    boxes : array (pair, 4)
        First place and step in mm, across and up.
    shape : (int, int)
        Rows (up) and columns (across).
    farthest : float
        Rays beyond this square of a height over its semi-aperture are lost.

    Returns
    -------
    array (pair, LIGHT + wave, row, column)
        Position x, y on the image plane in mm; the largest square of a height over its semi-aperture, except at the
        stop, or of a place over the half-widths of a rectangle; positions x, y at each crossing of the stop, in
        semi-apertures, the last one again if there are fewer than CROSSINGS; and the part of the irradiance that is
        left at each wavelength, on the beam's cross section, NaN for lost rays.

    Raises
    ------
    ValueError
        Sizes are invalid.
    """
    loops, variant = chosen()
    system, _arrays = surfaces.system(coated.indices)
    per_mm, per_half, boxes = (np.ascontiguousarray(each, np.float64) for each in (*openings, boxes))
    reflectances = np.ascontiguousarray(coated.reflectances, np.float64)
    pairs = np.ascontiguousarray(pairs, np.int64)
    count, steps = len(surfaces.shapes), reflectances.shape[1] - 1
    source = np.where(np.isfinite(beam.source_mm), beam.source_mm, 0)
    request = BEAM(address(reflectances, np.float64, (count, steps + 1, MOST_WAVES)),
                   address(per_mm, np.float64, (count,)), address(per_half, np.float64, (count, 2)),
                   address(pairs, np.int64, (len(boxes), 2)), address(boxes, np.float64, (len(boxes), 4)),
                   *(tuple(axis) for axis in beam.axes), tuple(source), beam.distance_mm, coated.steps_per_unit,
                   farthest, steps, coated.waves, len(boxes), *shape, int(np.isfinite(beam.distance_mm)))
    out, work = np.empty((len(boxes), LIGHT + coated.waves, *shape)), np.empty((3 * count, ABREAST))
    check(loops.lf_ghost_rays(variant, byref(system), byref(request), address(out, np.float64),
                              address(work, np.float64)))
    return out


def ghost_levels(waves: int, shape_px: tuple[int, int], count: int) -> list[np.ndarray]:
    """Black pictures for `draw_ghosts`, each with half as many pixels per side as the one before, and a rim: float32
    arrays (wave, row, column)."""
    sizes = [tuple(-(-n // 2**level) + 2 * RIM for n in shape_px) for level in range(count)]
    return [np.zeros((waves, rows, columns + SLACK), np.float32)[:, :, :columns] for rows, columns in sizes]


def draw_ghosts(meshes: Meshes, blades: Blades, centre_px: tuple[float, float], px_per_mm: float,
                levels: Sequence[np.ndarray]) -> np.ndarray:
    """Add the irradiance of ghosts to pictures, in W m^-2 nm^-1.

    Parameters
    ----------
    meshes : Meshes
    blades : Blades
    centre_px : (float, float)
        Row and column of the image plane's origin, in the first picture without its rim.
    px_per_mm : float
    levels : sequence of float32 arrays (wave, row, column)
        From `ghost_levels`. A ghost is drawn into the two that suit its size best, in parts that vary continuously.

    Returns
    -------
    array (pair, wave)
        Light of each ghost in the pictures, as irradiance times mm^2.

    Raises
    ------
    ValueError
        Sizes are invalid.
    """
    if running() == NUMPY:
        return numpy_draw_ghosts(meshes, blades, centre_px, px_per_mm, levels)
    loops, variant = chosen()
    rays = np.ascontiguousarray(meshes.rays, np.float64)
    pairs, quantities, rows, columns = rays.shape
    waves = quantities - LIGHT
    irradiance = np.ascontiguousarray(meshes.irradiance, np.float64)
    crossings = np.ascontiguousarray(meshes.crossings, np.int64)
    per_pair = [np.ascontiguousarray(each, np.float64) for each in (meshes.cells_mm2, meshes.pixels, meshes.blur)]
    normals = np.ascontiguousarray(blades.normals, np.float32)
    request = MESHES(address(rays, np.float64), address(crossings, np.int64, (pairs,)),
                     *(address(each, np.float64, (pairs,)) for each in per_pair),
                     address(irradiance, np.float64, (pairs, waves)), normals.ctypes.data, pairs, waves,
                     rows, columns, len(normals), meshes.mirrored, *blades.shape, blades.reach,
                     np.cos(meshes.azimuth_rad), np.sin(meshes.azimuth_rad), *centre_px, px_per_mm)
    full = 2 * columns - 1 if meshes.mirrored else columns
    light, work = np.zeros((pairs, waves)), np.empty(loops.lf_ghost_work(rows, full))
    pictures = (PICTURE * len(levels))(*(picture(level) for level in levels))
    check(loops.lf_ghost_light(variant, byref(request), pictures, len(levels), address(light, np.float64),
                               address(work, np.float64)))
    return light
