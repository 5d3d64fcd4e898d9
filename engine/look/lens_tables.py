"""A lens in small tables, for a graphics processor that shows it while an artist works.

Light comes from a direction, is dimmed by the relative illumination, and spreads over the picture by the lens's rays.
The tables have nodes at even distances over the frame, from edge to edge, and are interpolated between them.
"""

from dataclasses import dataclass

import numpy as np

from ..depth.depth_range import blur_per_nearness_px
from ..field.field_map import field_map
from ..image.pixel_grid import PixelGrid
from ..image.projection import FISHEYE
from ..lens import Lens
from ..lens.entrance_pupil import focus_nearness
from ..lens.iris import Iris, opening
from ..rays.grid_rays import LensRays
from ..rays.stop_places import cell_size

COLOURS_NM = 610.0, 550.0, 465.0  # red, green, blue
STEEPEST_RAD = 1.55  # a plane shows no light from behind
NODES = 193  # down and across the frame: bilinear interpolation is accurate to 0.1 px of 1080 rows, even of fisheyes
BOKEH_NODES = 17
RAYS = 64  # of a place, one of `RAY_COUNTS`


@dataclass(frozen=True, eq=False)
class LensTables:
    """A lens on a frame. Axes x to the right, y up; the first node is at the lower left.

    Attributes
    ----------
    angle_rad : float32 array (row, column, colour, 2)
        Directions of the light of red, green and blue in front of the lens, at NODES x NODES places: x and y of a
        vector away from the axis, as long as the angle from the axis. A lens that squeezes the picture shows more
        across than up.
    illumination : float32 array (row, column)
        Light, relative to the axis, at the same places.
    shifts, aberrations : float32 arrays (row, column, ray, 2)
        The rays of BOKEH_NODES x BOKEH_NODES places: x and y of their positions in the plane of an ideal image without
        squeeze, relative to the chief ray's, are the shifts, times the radius of the blur on the axis, plus the
        aberrations, which are tangents. The blur of a point nearer than the focus is positive, a farther one's is
        negative.
    light : float32 array (row, column, ray)
        The light of these rays, relative to the light of the place.
    stop_radius : float32 array (ray,)
        Their distance from the middle of the stop, relative to its rim.
    """

    angle_rad: np.ndarray
    illumination: np.ndarray
    shifts: np.ndarray
    aberrations: np.ndarray
    light: np.ndarray
    stop_radius: np.ndarray


def lens_tables(lens: Lens, rays: LensRays, frame: PixelGrid, iris: Iris | None = None,
                vignette: bool = False) -> LensTables:
    """The tables of a lens on a frame.

    Parameters
    ----------
    lens : Lens
        Its data cover `COLOURS_NM`.
    rays : LensRays
        Its rays, as far out as the iris reaches.
    frame : PixelGrid
        Without overscan and squeeze.
    iris : Iris, optional
        The blades that stop the lens down; by default the stop is round.
    vignette : bool
        Whether the area beyond the lens data is black.
    """
    x_mm, y_mm = _nodes_mm(frame, NODES)
    angle_rad, illumination = colour_directions(lens, x_mm[None, :], y_mm[:, None], vignette)
    return LensTables(angle_rad.astype(np.float32), illumination.astype(np.float32), *_bokeh(lens, rays, frame, iris))


def _nodes_mm(frame, count):
    """x_mm (column,) and y_mm (row,) of nodes from edge to edge of a frame."""
    rows, columns = frame.shape_px
    x_mm, _ = frame.position_mm(0, np.linspace(-0.5, columns - 0.5, count))
    _, y_mm = frame.position_mm(np.linspace(rows - 0.5, -0.5, count), 0)
    return x_mm, y_mm


def colour_directions(lens: Lens, x_mm: np.ndarray, y_mm: np.ndarray,
                      vignette: bool) -> tuple[np.ndarray, np.ndarray]:
    """Where the light of places in the image plane comes from, and how bright it is.

    Parameters
    ----------
    lens : Lens
    x_mm, y_mm : arrays
        From the axis to the right and up; their shapes are broadcast.
    vignette : bool
        Whether the area beyond the lens data is black.

    Returns
    -------
    angle_rad : array (..., colour, 2)
        Of `COLOURS_NM`, as `LensTables.angle_rad`.
    illumination : array (...)
        Relative to the axis.
    """
    equidistant = PixelGrid((1, 1), 1.0, projection=FISHEYE)
    fields = [field_map(lens).at_wavelength(nm) for nm in COLOURS_NM]
    angle_rad = np.stack([np.stack(field.source_mm(x_mm, y_mm, equidistant), axis=-1)
                          for field in fields], axis=-2) / lens.capture_focal_length_mm
    _, green, _ = fields
    illumination = green.relative_illumination(x_mm, y_mm)
    return angle_rad, illumination * green.within(x_mm, y_mm) if vignette else illumination


def _bokeh(lens, rays, frame, iris):
    """The fields of LensTables from `shifts` on."""
    stop, (_, green_nm, _), pitch_mm = opening(iris, lens), COLOURS_NM, frame.pitch_um * 1e-3
    field, per_nearness_px = field_map(lens), blur_per_nearness_px(lens, frame.pitch_um) / 2
    sample = field.pixel_rays(rays, frame).sample(np.array([green_nm]), lens.capture_focal_length_mm, RAYS, stop.reach)
    nodes_px = (each_mm / pitch_mm for each_mm in np.meshgrid(*_nodes_mm(frame, BOKEH_NODES)))
    right_px, up_px = sample.known_places(*nodes_px)
    far_px, moved_px, light, place = sample.bundles(right_px, up_px)
    chief_mm = field.at_wavelength(green_nm).source_mm(right_px * pitch_mm, up_px * pitch_mm)
    chief_px = np.stack((lens.squeeze * chief_mm[0], chief_mm[1]), axis=-1)[:, :, None] / pitch_mm
    aberrations_px = far_px + np.asarray(focus_nearness(lens, *chief_mm))[..., None, None] * moved_px - chief_px
    light = light * stop.open_share(place, cell_size(RAYS) * stop.reach)
    total = np.maximum(light.sum(axis=-1, keepdims=True), np.finfo(np.float32).tiny)
    tables = (moved_px / per_nearness_px, aberrations_px * pitch_mm / lens.capture_focal_length_mm, light / total,
              np.linalg.norm(place[:, 0, 0], axis=0) / stop.reach)
    return [each.astype(np.float32) for each in tables]
