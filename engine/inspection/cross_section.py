"""The cross section of a lens: its glasses, mirrors, stop and image plane, and the rays of three fields.

Lenses without rotational symmetry have two, along y and along x, through the axis of the undisturbed design.
"""

from typing import TYPE_CHECKING

import numpy as np

from ..prescription.prescription import Pose
from ..prescription.surfaces import from_surface_frame, sag_and_gradient
from ..prescription.system import System
from ..rays.fields import find_fields, trace_fields, view_of
from ..rays.rays import HalfPupil, Pupil, trace_pupil
from ..rays.trace import points_from_image
from ..runtime.errors import LensError
from .style import INK, PALE_INK, TEXT, require_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GLASS_COLOUR, RAY_COLOURS = "#DCE9F2", ("#0072B2", "#009E73", "#D55E00")
X, Y = 0, 1  # sections
FIELDS = 0.0, 0.7, 1.0  # of the last image height
FAN = HalfPupil(4, 2)
FANS = [Pupil(FAN.radii, FAN.azimuths + turn) for turn in (np.pi / 2, 0)]  # along x and y
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
    sections = (Y,) if system.prescription.radial else (Y, X)
    height = (1 - 2 * MARGIN) / len(sections)
    panels = [figure.add_axes((MARGIN, 1 - MARGIN - (number + 1) * height, 1 - 2 * MARGIN, height))
              for number in range(len(sections))]
    for panel, section in zip(panels, sections, strict=True):
        draw_cross_section(panel, system, section)
    if len(panels) > 1:
        _relate(panels)
    canvas.draw()
    return np.array(canvas.buffer_rgba())


def _relate(panels):
    """Draw sections at the same scale, and name them."""
    left, bottom, right, top = np.transpose([[*panel.get_xlim(), *panel.get_ylim()] for panel in panels])[[0, 2, 1, 3]]
    for panel, name in zip(panels, "yx", strict=True):
        panel.set(xlim=(left.min(), right.max()), ylim=(bottom.min(), top.max()))
        panel.text(0, 1, name, fontsize=TEXT, color=PALE_INK, va="top", transform=panel.transAxes)


def draw_cross_section(panel: "Axes", system: System, section: int = Y) -> None:
    """Draw a lens's section along y (1) or x (0), without rays if its field is larger than it transmits."""
    prescription = system.prescription
    fans_mm, image_mm = _fans_mm(system, section)
    vertices_mm, semi_mm = _vertices_mm(system), _semi_diameters_mm(system, section, fans_mm)
    rows = list(zip(prescription.surfaces, vertices_mm, semi_mm, strict=False))  # the last vertex is the image plane
    for front, rear in zip(rows, rows[1:], strict=False):
        if front[0].glass:
            _draw_glass(panel, front, rear, section)
    for row in rows:
        _draw_mirror_or_obstruction(panel, *row, section)
    for colour, fan_mm in zip(RAY_COLOURS, fans_mm, strict=False):  # of three, or of none
        panel.plot(*fan_mm, color=colour, linewidth=0.6)
    _draw_stop(panel, system, vertices_mm[prescription.stop_index], section)
    panel.plot(*_placed(prescription.image_pose, vertices_mm[-1], section, image_mm).T, color=INK, linewidth=1.6)
    panel.set_aspect("equal")
    panel.axis("off")


def _draw_glass(panel, front, rear, section):
    """Fill the glass between two surfaces, (surface, vertex, semi-diameter) each; mirrors have holes."""
    hole_mm = max((surface.semi_obstruction_mm for surface, *_ in (front, rear) if surface.mirror), default=0.0)
    parts = [[_profile(surface, vertex_mm, section, ends_mm) for ends_mm in _parts_mm(hole_mm, semi_mm)]
             for surface, vertex_mm, semi_mm in (front, rear)]
    for ahead, behind in zip(*parts, strict=False):
        outline = np.concatenate([ahead, behind[::-1]])
        panel.fill(*outline.T, facecolor=GLASS_COLOUR, edgecolor=INK, linewidth=0.8)


def _draw_mirror_or_obstruction(panel, surface, vertex_mm, semi_mm, section):
    hole_mm = surface.semi_obstruction_mm
    if surface.mirror:
        parts_mm = _parts_mm(hole_mm, semi_mm)
    else:
        parts_mm = [(-hole_mm, hole_mm)] if hole_mm else []
    for ends_mm in parts_mm:
        panel.plot(*_profile(surface, vertex_mm, section, ends_mm).T, color=INK, linewidth=1.6)


def _parts_mm(hole_mm, semi_mm):
    """Heights of a surface's parts: below and above a hole, or from rim to rim."""
    return [(-semi_mm, -hole_mm), (hole_mm, semi_mm)] if 0 < hole_mm < semi_mm else [(-semi_mm, semi_mm)]


def _vertices_mm(system):
    """Vertices of the surfaces and of the image plane, along the axis."""
    return np.cumsum([0.0, *(surface.thickness_mm for surface in system.prescription.surfaces)])


def _fans_mm(system, section):
    """The rays of each field in a section: list of arrays (z and height, point, ray), empty if a chief ray is lost; and
    the ends of the image, in the image plane's own frame. Rays start in front of the lens; lost and blocked ones are
    NaN."""
    try:
        rays, origin_mm = (_rays_over_heights if system.prescription.radial else _rays_over_places)(system, section)
    except LensError:
        return [], [-system.last_height_mm, system.last_height_mm]
    position_mm = rays.position_mm + np.reshape(origin_mm, (2, 1, 1, 1, 1))
    image_plane = np.stack([*position_mm, np.zeros_like(position_mm[0])])[:, 0]
    with np.errstate(invalid="ignore"):
        points_mm, direction = points_from_image(system.prescription, system.indices_at(rays.wavelengths_nm)[:, 0],
                                                 image_plane, rays.direction[:, 0])
        blocked = np.any(system.limits(rays.square_height_mm2[:, 0]) > 1, axis=0)
    passing = ~(blocked | rays.lost[0])
    points_mm = np.where(passing, points_mm, np.nan)
    along_mm = np.sum(points_mm[0] * direction, axis=0)
    vertices_mm = _vertices_mm(system)
    start_mm = (np.nanmin(along_mm, axis=(1, 2), keepdims=True, initial=0.0) + vertices_mm.min()
                - IN_FRONT * np.ptp(vertices_mm))
    lines_mm = np.concatenate([[points_mm[0] + (start_mm - along_mm) * direction], points_mm])[:, [2, section]]
    fans_mm = [field.reshape(*field.shape[:2], -1).swapaxes(0, 1) for field in np.moveaxis(lines_mm, 2, 0)]
    reach_mm = np.max(rays.position_mm[section, 0], initial=0.0, where=passing)
    return fans_mm, origin_mm[section] + np.array([-reach_mm, reach_mm])


def _rays_over_heights(system, _):
    """Rays of a rotationally symmetric lens in its meridional plane, and the middle of the image."""
    nm = [system.prescription.reference_wavelength_nm]
    return trace_pupil(system, system.last_height_mm * np.array(FIELDS), nm, FAN), np.zeros(2)


def _rays_over_places(system, section):
    """Rays to places on the sensor, of another lens, and the middle of its image."""
    view, nm = view_of(system), [system.prescription.reference_wavelength_nm]
    reach_mm = system.prescription.sensor_mm[section] / 2 if system.prescription.sensor_mm else system.last_height_mm
    places_mm = np.multiply.outer(np.eye(2)[section], reach_mm * np.array(FIELDS))
    return trace_fields(system, view, find_fields(system, view, places_mm, nm), FANS[section]), view.origin_mm


def _semi_diameters_mm(system, section, fans_mm):
    """The semi-diameter of each surface: its own, or the height of its outermost ray."""
    stated_mm = np.array([min(surface.semi_aperture_mm, *surface.half_widths_mm[section:section + 1], np.inf)
                          for surface in system.prescription.surfaces])
    marginal_mm = (system.across if section == X else system).marginal_heights_mm
    reached_mm = np.maximum.reduce([np.abs(marginal_mm),
                                    *(np.nanmax(np.abs(fan_mm[1, 1:-1]), axis=-1, initial=0.0) for fan_mm in fans_mm)])
    return np.where(np.isfinite(stated_mm), stated_mm, ROOM * reached_mm)


def _profile(surface, vertex_mm, section, ends_mm):
    """Points of a surface between two heights: array (point, 2) of z and height."""
    heights_mm = np.linspace(*ends_mm, POINTS)
    sag_mm = sag_and_gradient(surface, *_own_places(surface.pose, section, heights_mm))[0]
    return _placed(surface.pose, vertex_mm, section, heights_mm, sag_mm)


def _own_places(pose: Pose | None, section, heights_mm):
    """x and y in a surface's own frame, along the section."""
    along = np.eye(2)[section] if pose is None else pose.rotation[section, :2]
    return np.multiply.outer(along / np.hypot(*along), heights_mm)


def _placed(pose: Pose | None, vertex_mm, section, heights_mm, sag_mm=0.0):
    """Points on a surface along a section, as z and height in the lens: array (point, 2)."""
    x_mm, y_mm = _own_places(pose, section, heights_mm)
    own_mm = np.stack([x_mm, y_mm, np.broadcast_to(sag_mm, x_mm.shape)])
    position_mm, _ = from_surface_frame(pose, own_mm, own_mm)
    return np.stack([vertex_mm + position_mm[2], position_mm[section]], axis=1)


def _draw_stop(panel, system, vertex_mm, section):
    pose = system.prescription.surfaces[system.prescription.stop_index].pose
    for semi_mm in (-system.stop_semi_aperture_mm, system.stop_semi_aperture_mm):
        edge_mm = _placed(pose, vertex_mm, section, [semi_mm, 1.3 * semi_mm])
        panel.plot(*edge_mm.T, color=INK, linewidth=2.2, solid_capstyle="butt")
