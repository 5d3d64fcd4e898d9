"""The cross section of a lens along y: its glasses, stop and image plane, and the rays of three fields."""

from typing import TYPE_CHECKING

import numpy as np

from ..prescription.prescription import Surface
from ..prescription.surfaces import out_of_own_frame, sag_and_gradient
from ..prescription.system import System
from ..rays.rays import FullPupil, trace_pupil
from ..rays.trace import points_from_image
from ..runtime.errors import LensError
from .style import INK, require_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GLASS_COLOUR, RAY_COLOURS = "#DCE9F2", ("#0072B2", "#009E73", "#D55E00")
FIELDS = 0.0, 0.7, 1.0  # of the last image height
FAN = FullPupil(4, 2)
POINTS = 41  # of a surface's profile
IN_FRONT = 0.2  # length of the rays before the first surface, in lengths of the lens
ROOM = 1.02  # semi-diameter of surfaces without one, in heights of their outermost ray
MARGIN = 0.03
DPI = 100


def cross_section(system: System, side_px: int) -> np.ndarray:
    """A square picture of a lens's cross section: uint8 array (row, column, 4).

    Raises
    ------
    InputError
        matplotlib is not installed.
    """
    figure_class = require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = figure_class(figsize=(side_px / DPI, side_px / DPI), dpi=DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    panel = figure.add_axes((MARGIN, MARGIN, 1 - 2 * MARGIN, 1 - 2 * MARGIN))
    draw_cross_section(panel, system)
    canvas.draw()
    return np.array(canvas.buffer_rgba())


def draw_cross_section(panel: "Axes", system: System) -> None:
    """Draw a lens's cross section, without rays if its field is larger than it transmits."""
    fans_mm = _fans_mm(system)
    vertices_mm, semi_mm = _vertices_mm(system), _semi_diameters_mm(system, fans_mm)
    profiles = [_profile(surface, vertex_mm, semi) for surface, vertex_mm, semi in
                zip(system.prescription.surfaces, vertices_mm, semi_mm, strict=False)]  # the last is the image plane
    for surface, front, rear in zip(system.prescription.surfaces, profiles, profiles[1:], strict=False):
        if surface.glass:
            outline = np.concatenate([front, rear[::-1]])
            panel.fill(*outline.T, facecolor=GLASS_COLOUR, edgecolor=INK, linewidth=0.8)
    for colour, fan_mm in zip(RAY_COLOURS, fans_mm, strict=False):  # of three, or of none
        panel.plot(*fan_mm, color=colour, linewidth=0.6)
    _draw_stop(panel, system, vertices_mm[system.prescription.stop_index])
    image_mm = max((np.nanmax(fan_mm[1, -1], initial=0.0) for fan_mm in fans_mm), default=system.last_height_mm)
    image_plane = Surface(pose=system.prescription.image_pose)
    panel.plot(*_profile(image_plane, vertices_mm[-1], image_mm)[[0, -1]].T, color=INK, linewidth=1.6)
    panel.set_aspect("equal")
    panel.axis("off")


def _vertices_mm(system):
    """Vertices of the surfaces and of the image plane, along the axis."""
    return np.cumsum([0.0, *(surface.thickness_mm for surface in system.prescription.surfaces)])


def _fans_mm(system):
    """The rays of each field in the meridional plane: list of arrays (z and y, point, ray); empty if a chief ray is
    lost. Rays start in front of the lens; lost and blocked ones are NaN."""
    nm = [system.prescription.reference_wavelength_nm]
    try:
        rays = trace_pupil(system, system.last_height_mm * np.array(FIELDS), nm, FAN)
    except LensError:
        return []
    image_plane = np.stack([*rays.position_mm, np.zeros_like(rays.position_mm[0])])[:, 0]
    with np.errstate(invalid="ignore"):
        points_mm, direction = points_from_image(system.prescription, system.indices_at(nm)[:, 0], image_plane,
                                                 rays.direction[:, 0])
        blocked = np.any(rays.square_height_mm2[:, 0] > np.reshape(system.semi_apertures_mm**2, (-1, 1, 1, 1)), axis=0)
    points_mm = np.where(blocked | rays.lost[0], np.nan, points_mm)
    along_mm = np.sum(points_mm[0] * direction, axis=0)
    start_mm = np.nanmin(along_mm, axis=(1, 2), keepdims=True, initial=0.0) - IN_FRONT * _vertices_mm(system)[-1]
    lines_mm = np.concatenate([[points_mm[0] + (start_mm - along_mm) * direction], points_mm])[:, [2, 1]]
    return [field.reshape(*field.shape[:2], -1).swapaxes(0, 1) for field in np.moveaxis(lines_mm, 2, 0)]


def _semi_diameters_mm(system, fans_mm):
    """The semi-diameter of each surface: its own, or the height of its outermost ray."""
    stated_mm = np.array([surface.semi_aperture_mm for surface in system.prescription.surfaces])
    reached_mm = np.maximum.reduce([np.abs(system.marginal_heights_mm),
                                    *(np.nanmax(np.abs(fan_mm[1, 1:-1]), axis=-1, initial=0.0) for fan_mm in fans_mm)])
    return np.where(np.isfinite(stated_mm), stated_mm, ROOM * reached_mm)


def _profile(surface, vertex_mm, semi_mm):
    """Points of a surface from its lower to its upper rim: array (point, 2) of z and y."""
    up = np.eye(3)[1] if surface.pose is None else surface.pose.rotation[1]  # the lens's y in the surface's own frame
    x_mm, y_mm = np.linspace(-semi_mm, semi_mm, POINTS) * (up[:2] / np.hypot(*up[:2]))[:, None]
    points_mm = np.stack([x_mm, y_mm, sag_and_gradient(surface, x_mm, y_mm)[0]])
    _, y_mm, z_mm = out_of_own_frame(surface.pose, points_mm, points_mm)[0]
    return np.stack([vertex_mm + z_mm, y_mm], axis=1)


def _draw_stop(panel, system, vertex_mm):
    semi_mm = system.stop_semi_aperture_mm
    for side in (-1, 1):
        panel.plot(2 * [vertex_mm], [side * semi_mm, 1.3 * side * semi_mm], color=INK, linewidth=2.2,
                   solid_capstyle="butt")
