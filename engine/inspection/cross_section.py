"""The cross section of a lens: its glasses, mirrors, stop and image plane, and the rays of three fields.

Lenses without rotational symmetry have two, along y and along x, through the axis of the undisturbed design.
"""

from dataclasses import dataclass

import numpy as np

from ..prescription.prescription import Pose
from ..prescription.surfaces import from_surface_frame, sag_and_gradient
from ..prescription.system import System
from ..rays.fields import find_fields, trace_fields, view_of
from ..rays.rays import HalfPupil, Pupil, trace_pupil
from ..rays.trace import points_from_image
from ..runtime.errors import LensError
from .axes import Panel
from .canvas import Box, Page, Pen
from .style import INK, PALE_INK, TEXT

GLASS_COLOUR, RAY_COLOURS = "#DCE9F2", ("#0072B2", "#009E73", "#D55E00")
X, Y = 0, 1  # sections
FIELDS = 0.0, 0.7, 1.0  # of the last image height
FAN = HalfPupil(4, 2)
FANS = [Pupil(FAN.radii, FAN.azimuths + turn) for turn in (np.pi / 2, 0)]  # along x and y
POINTS = 41  # of a surface's profile
IN_FRONT = 0.2  # length of the rays before the first surface, in lengths of the lens
ROOM = 1.02  # semi-diameter of surfaces without one, in heights of their outermost ray
MARGIN = 0.03  # of a picture
DPI = 100
RAY_PT, GLASS_PT, STOP_PT = 0.6, 0.8, 2.2
SOLID_PEN = Pen(INK, 1.6)  # of mirrors and obstructions, and of the image plane


@dataclass(frozen=True, eq=False)
class Shape:
    """A line of a cross section, or an outline.

    Attributes
    ----------
    points_mm : array (point, 2)
        Along the axis, and height; NaN where a ray is lost.
    pen : Pen
    fill : str or None
        The colour of the area within an outline.
    """

    points_mm: np.ndarray
    pen: Pen
    fill: str | None = None


def cross_section(system: System, side_px: int) -> np.ndarray:
    """A square picture of a lens's cross section: uint8 array (row, column, 4)."""
    sections = [section_shapes(system, section) for section in ((Y,) if system.prescription.radial else (Y, X))]
    page = Page(side_px / DPI, side_px / DPI, DPI)
    width, height = (1 - 2 * MARGIN) * page.width, (1 - 2 * MARGIN) * page.height / len(sections)
    low_mm, high_mm = _ends_mm([shape for shapes in sections for shape in shapes])
    for number, (name, shapes) in enumerate(zip("yx", sections, strict=False)):
        place = Box(MARGIN * page.width, (1 - MARGIN) * page.height - (number + 1) * height, width, height)
        draw_shapes(page, place, shapes, low_mm, high_mm)
        if len(sections) > 1:
            page.write(place.left, place.top, name, TEXT, PALE_INK)
    pixels = page.pixels()
    return np.concatenate([pixels, np.full_like(pixels[..., :1], 255)], axis=-1)


def draw_cross_section(page: Page, place: Box, system: System) -> Panel:
    """Draw a lens's section along y, as large as the place permits, and return its panel, with millimetres on both
    axes."""
    shapes = section_shapes(system, Y)
    return draw_shapes(page, place, shapes, *_ends_mm(shapes))


def draw_shapes(page: Page, place: Box, shapes: list[Shape], low_mm: np.ndarray, high_mm: np.ndarray) -> Panel:
    """Draw shapes between two corners in the middle of a place, as large as it permits."""
    panel = Panel.to_scale(page, place, low_mm, high_mm)
    for shape in shapes:
        if shape.fill:
            page.areas([panel.places(*shape.points_mm.T)], shape.fill)
        page.lines([panel.places(*shape.points_mm.T)], shape.pen)
    return panel


def _ends_mm(shapes):
    """The lower left and the upper right corner of shapes."""
    points_mm = np.concatenate([shape.points_mm for shape in shapes])
    return np.nanmin(points_mm, axis=0), np.nanmax(points_mm, axis=0)


def section_shapes(system: System, section: int = Y) -> list[Shape]:
    """A lens's section along y (1) or x (0), from the back to the front, without rays if its field is larger than it
    transmits."""
    prescription = system.prescription
    fans_mm, image_mm = _fans_mm(system, section)
    vertices_mm, semi_mm = _vertices_mm(system), _semi_diameters_mm(system, section, fans_mm)
    rows = list(zip(prescription.surfaces, vertices_mm, semi_mm, strict=False))  # the last vertex is the image plane
    glasses = [shape for front, rear in zip(rows, rows[1:], strict=False) if front[0].glass
               for shape in _glass(front, rear, section)]
    solids = [shape for row in rows for shape in _mirror_or_obstruction(*row, section)]
    rays = [Shape(ray_mm, Pen(colour, RAY_PT)) for colour, fan_mm in zip(RAY_COLOURS, fans_mm, strict=False)
            for ray_mm in fan_mm.T]  # of three fields, or of none
    image = _placed(prescription.image_pose, vertices_mm[-1], section, image_mm)
    return [*glasses, *solids, *rays, *_stop(system, vertices_mm[prescription.stop_index], section),
            Shape(image, SOLID_PEN)]


def _glass(front, rear, section):
    """The glass between two surfaces, (surface, vertex, semi-diameter) each; mirrors have holes."""
    hole_mm = max((surface.semi_obstruction_mm for surface, *_ in (front, rear) if surface.mirror), default=0.0)
    parts = [[_profile(surface, vertex_mm, section, ends_mm) for ends_mm in _parts_mm(hole_mm, semi_mm)]
             for surface, vertex_mm, semi_mm in (front, rear)]
    return [Shape(np.concatenate([ahead, behind[::-1], ahead[:1]]), Pen(INK, GLASS_PT), GLASS_COLOUR)
            for ahead, behind in zip(*parts, strict=False)]


def _mirror_or_obstruction(surface, vertex_mm, semi_mm, section):
    hole_mm = surface.semi_obstruction_mm
    if surface.mirror:
        parts_mm = _parts_mm(hole_mm, semi_mm)
    else:
        parts_mm = [(-hole_mm, hole_mm)] if hole_mm else []
    return [Shape(_profile(surface, vertex_mm, section, ends_mm), SOLID_PEN) for ends_mm in parts_mm]


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


def _stop(system, vertex_mm, section):
    pose = system.prescription.surfaces[system.prescription.stop_index].pose
    return [Shape(_placed(pose, vertex_mm, section, [semi_mm, 1.3 * semi_mm]), Pen(INK, STOP_PT))
            for semi_mm in (-system.stop_semi_aperture_mm, system.stop_semi_aperture_mm)]
