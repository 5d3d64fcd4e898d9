"""Rectangles at which rays from the sensor aim: on a plane at the rear vertex, parallel to the sensor.

The rectangle of a sensor point encloses the part of the exit pupil that is visible from it.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..prescription.prescription import Prescription, Surface
from ..prescription.surfaces import to_surface_frame
from ..prescription.system import System
from .trace import trace_both_ways
from .view import View, sensor_axes

BINS = 32  # of sensor heights, with a rectangle each
CELLS = 8  # along each side of a film, with a rectangle each
SEARCH = 96, 48  # rays along the sides of the searched half of a rectangle
CELL_SEARCH = 48, 48
MOST_DOUBLINGS = 12  # the search starts at twice the paraxial beam, and doubles until it encloses all passing rays
ZOOMS = 2  # afterwards
ENDS = slice(None, -1), slice(1, None)  # of the cells, among the nodes between them
LEAST_PASSING = 8  # rays: too few for an extent below this


@dataclass(frozen=True, eq=False)
class Bins:
    """Rectangles of a rotationally symmetric lens, by the sensor point's distance from the axis.

    Attributes
    ----------
    bin_mm : float
        Bin size of sensor heights from the axis; there is a rectangle per bin.
    to_pupil : float
        The line from a sensor point through the centre of the exit pupil crosses the rectangles' plane at this multiple
        of the sensor point's height.
    low_mm, high_mm, half_mm : arrays (bin,)
        Ends of the rectangles along the line away from the axis, relative to that crossing, and half of their extent
        across; 0 if no light gets through.
    """

    bin_mm: float
    to_pupil: float
    low_mm: np.ndarray
    high_mm: np.ndarray
    half_mm: np.ndarray


@dataclass(frozen=True, eq=False)
class Cells:
    """Rectangles of any lens, by the cell of a mesh over the film that contains the sensor point.

    Coordinates are x and y in the frame of the sensor.

    Attributes
    ----------
    away_mm : float
        From the sensor to the rectangles' plane.
    first_mm, cell_mm : arrays (2,)
        Where the mesh begins, and the size of its cells.
    to_pupil : array (2,)
        Rectangles count from this multiple of the sensor point: about the centre of the exit pupil, for each section.
    low_mm, high_mm : arrays (2, row, column)
        Ends of the rectangles; 0 if no light gets through.
    """

    away_mm: float
    first_mm: np.ndarray
    cell_mm: np.ndarray
    to_pupil: np.ndarray
    low_mm: np.ndarray
    high_mm: np.ndarray


def aim_bins(system: System, indices: np.ndarray, farthest_mm: float) -> Bins:
    """Search the rectangles of a rotationally symmetric lens.

    Parameters
    ----------
    system : System
    indices : array (surface + 1,)
        At one wavelength.
    farthest_mm : float
        From the axis to the last sensor point.
    """
    to_pupil, beam_mm = _to_pupil(system, system), abs(system.marginal_heights_mm[-1])
    away_mm, passes = system.prescription.surfaces[-1].thickness_mm, _passing(system, indices)
    extents = []
    for height_mm in np.linspace(0, farthest_mm, BINS + 1):
        extents.append(_searched(lambda x_mm, y_mm, height_mm=height_mm: passes(
            (height_mm, 0.0), (to_pupil * height_mm + x_mm, y_mm, -away_mm)), beam_mm, SEARCH, mirrored=True))
    low, high, _, half = np.array(extents).reshape(-1, 4).T
    return Bins(farthest_mm / BINS, to_pupil, np.minimum(low[:-1], low[1:]), np.maximum(high[:-1], high[1:]),
                np.maximum(half[:-1], half[1:]))


def aim_cells(system: System, view: View, indices: np.ndarray, edges_mm: tuple[float, float, float, float]) -> Cells:
    """Search the rectangles of any lens.

    Parameters
    ----------
    system : System
    view : View
    indices : array (surface + 1,)
        At one wavelength.
    edges_mm : (float, float, float, float)
        Left, lower, right and upper edge of the film in the upright picture.
    """
    first_mm, last_mm = (view.origin_mm - edges_mm[side:side + 2] for side in (2, 0))  # the image is upside down
    vertex_mm = _rear_vertex_mm(system.prescription)
    to_pupil = np.array([_to_pupil(system, section) for section in (system.across, system)])
    towards_mm = (1 - to_pupil) * vertex_mm[:2]
    beam_mm = max(abs(section.marginal_heights_mm[-1]) for section in (system.across, system))
    passes, extents = _passing(system, indices), []
    for place_mm in np.stack(np.meshgrid(*np.linspace(first_mm, last_mm, CELLS + 1).T), axis=-1).reshape(-1, 2):
        middle_x, middle_y = towards_mm + to_pupil * place_mm
        extents.append(_searched(lambda x_mm, y_mm, place_mm=place_mm, middle_x=middle_x, middle_y=middle_y: passes(
            place_mm, (middle_x + x_mm, middle_y + y_mm, vertex_mm[2])), beam_mm, CELL_SEARCH))
    low, high = np.array(extents).reshape(CELLS + 1, CELLS + 1, 2, 2).transpose(3, 2, 0, 1)
    return Cells(-float(vertex_mm[2]), first_mm, (last_mm - first_mm) / CELLS, to_pupil,
                 np.min(_corners(low), axis=0) + towards_mm[:, None, None],
                 np.max(_corners(high), axis=0) + towards_mm[:, None, None])


def _corners(nodes):
    """The values of nodes (..., row, column) at the four corners of the cells between them."""
    return [nodes[..., rows, columns] for rows in ENDS for columns in ENDS]


def _to_pupil(system, section):
    return 1 / (1 - system.prescription.surfaces[-1].thickness_mm / section.exit_pupil_mm)


def _rear_vertex_mm(prescription):
    """Place of the last surface on the axis, in the frame of the sensor: array (3,)."""
    on_axis = np.array([0.0, 0.0, -prescription.surfaces[-1].thickness_mm])
    return to_surface_frame(prescription.image_pose, on_axis, on_axis)[0]


def _searched(passes, beam_mm, rays, mirrored=False):
    """Extent along x and y of the passing rays from a sensor point: `passes` is a function of x and y, which count from
    about the middle of these rays. If mirrored, only rays with y > 0 are searched."""
    for doublings in range(MOST_DOUBLINGS):
        half_mm = beam_mm * 2.0 ** (doublings + 1)
        square = (-half_mm, half_mm), (0.0 if mirrored else -half_mm, half_mm)
        extent, complete = _passing_extent(passes, square, rays, mirrored)
        if complete:
            break
    for _ in range(ZOOMS):
        extent, _ = _passing_extent(passes, extent, rays, mirrored)
    return extent


def _passing_extent(passes, extent, rays, mirrored):
    """Bounds of the passing rays among a rectangle's rays, plus a step of the search; and whether they stay clear of
    the rectangle's edge."""
    (across, step_x), (up, step_y) = (np.linspace(*ends, number, retstep=True)
                                      for ends, number in zip(extent, rays, strict=True))
    x, y = np.meshgrid(across, up)
    through = passes(x, y)
    if through.sum() < LEAST_PASSING:
        return ((0.0, 0.0), (0.0, 0.0)), False
    edge = through[-1 if mirrored else [0, -1]].any() or through[:, [0, -1]].any()
    lower = 0.0 if mirrored else y[through].min() - step_y
    return ((x[through].min() - step_x, x[through].max() + step_x), (lower, y[through].max() + step_y)), not edge


def _passing(system, indices):
    """Function of a sensor point (x, y) and of points (x, y, z), arrays (row, column), in the frame of the sensor:
    whether the ray from the first through the others passes."""
    sensor_first, indices = _sensor_as_stop(system.prescription), np.append(indices, indices[-1]).reshape(-1, 1, 1, 1)
    axes, stop = sensor_axes(system.prescription), system.prescription.stop_index

    def passes(place_mm, points_mm):
        points_mm = np.stack(np.broadcast_arrays(*points_mm))
        towards = np.tensordot(axes.T, np.reshape([*place_mm, 0.0], (3, 1, 1)) - points_mm, 1)
        with np.errstate(invalid="ignore"):
            traced = trace_both_ways(sensor_first, indices, *np.reshape(place_mm, (2, 1, 1, 1)),
                                     *(towards[:2] / towards[2])[:, None])
            through = np.isfinite(traced.before[:, 0]).all(axis=0)
            squares_mm2 = np.delete(traced.square_mm2[:, 0], len(system.glasses), axis=0)  # without the sensor's
            through &= np.all(system.limits(squares_mm2) <= 1, axis=0)
            return through & (squares_mm2[stop] <= system.stop_semi_aperture_mm**2)

    return passes


def _sensor_as_stop(prescription: Prescription) -> Prescription:
    """The lens with its sensor as another surface, from which rays start."""
    surfaces = (replace(surface, stop=False, gaps_mm=()) for surface in prescription.surfaces)
    sensor = Surface(thickness_mm=1.0, stop=True, pose=prescription.image_pose)
    return replace(prescription, surfaces=(*surfaces, sensor), image_pose=None, focused_at_mm=())
