"""The camera: it captures the lens's view of the scene, with the overscan that the lens needs."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from mathutils import Euler, Vector

from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.overscan import CAMERA_VIEW, FARTHEST, FIT_SAMPLES, LENS_VIEW, choose_capture
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import fitted_projection
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.lens.formats import format_mm
from lensfield.engine.lens.pinhole import fitting_pitch_um as pitch_um
from lensfield.engine.library import described_lenses
from lensfield.engine.plan.options import Options
from lensfield.engine.plan.plan_cache import cached_plan
from lensfield.engine.rays.rings import AT_REST, in_metres
from lensfield.engine.runtime.errors import InputError

from .active_camera import camera_data, camera_settings
from .errors import SceneError
from .instances import rendered_instances
from .lens_cache import lens_on_sensor, scaled_lens
from .lens_facts import DIAGONAL, lens_facts
from .units import metres_per_unit, mm_per_unit

BY_RESULT = Options()
COMPLETE = 0.999  # of the diagonal: less is beyond a lens's field
FARTHEST_M, NEAREST_M = 1e4, 0.01  # for `aim_camera`: bound on coordinates, and least radius of the framed sphere
NEW_FILES_ROTATION = Euler((1.1093, 0.0, 0.8149))
CAMERA_SENSOR_MM = 36.0  # suits Blender's limits on focal lengths; only the ratio to it counts
FISHEYE_TYPE = "FISHEYE_LENS_POLYNOMIAL"
WHOLE_SPHERE = 2 * np.pi  # a field of view that cuts nothing off
EDGE_SAMPLES = 65
MOST_PLANE = 2.0  # times the frame's pixels, for a perspective camera
MOST_ROOM = 1.0
MOST_PLANNED_PX = 256  # radius of a complete PSF; a plan for this size takes some ten seconds
LEAST_VOLUME = 1e-6  # spanned by a camera's unit axes: 0 if its scale along one axis is 0
TO_PERSPECTIVE = ("expected a perspective camera: set Type to Perspective in the camera's properties, then press Match "
                  "Camera to Lens")


def frame_px(scene):
    """Rows and columns of the scene's render, rounded as Blender does."""
    render = scene.render
    return tuple(max(1, side * render.resolution_percentage // 100)
                 for side in (render.resolution_y, render.resolution_x))


@dataclass(frozen=True)
class SceneFrame:
    """The frame of a scene, before its lens is known.

    Attributes
    ----------
    shape_px : (int, int)
    right_up_px : (float, float)
        As `shift_px`.
    sensor_mm : (float, float) or None
        None for the sensor of the lens.
    focal_mm : float or None
        Capture focal length that the lens is scaled to; None for its own size.
    """

    shape_px: tuple[int, int]
    right_up_px: tuple[float, float]
    sensor_mm: tuple[float, float] | None
    focal_mm: float | None

    def factor(self, lens):
        """The scale factor of a lens, or of LensFacts."""
        return 1.0 if self.focal_mm is None else self.focal_mm / lens.capture_focal_length_mm

    def edges_mm(self, lens):
        """Edges of the frame on the sensor of a lens, or of LensFacts, in its own size: as `PixelGrid.edges_mm`."""
        on_sensor = replace(lens, sensor_mm=self.sensor_mm or lens.sensor_mm)
        grid = PixelGrid(self.shape_px, pitch_um(on_sensor, self.shape_px)).shifted(*self.right_up_px)
        return tuple(edge_mm / self.factor(lens) for edge_mm in grid.edges_mm)


def scene_frame(scene, view):
    """The SceneFrame of a scene with a camera, for a view as for `lens_for_view`."""
    shape_px, sensor_mm, focal_mm = frame_px(scene), None, None
    if view == CAMERA_VIEW:
        pixel_mm = _pixel_mm(scene, shape_px)
        sensor_mm, focal_mm = (shape_px[1] * pixel_mm, shape_px[0] * pixel_mm), scene.camera.data.lens  # mm, always
    elif view != LENS_VIEW:
        sensor_mm = format_mm(view)
    return SceneFrame(shape_px, shift_px(scene), sensor_mm, focal_mm)


def frame_grid(scene, lens):
    """The pixels of the scene's frame on a lens's sensor: a PixelGrid. The Shift of the scene's camera moves the sensor
    in the lens's image circle."""
    shape_px = frame_px(scene)
    return PixelGrid(shape_px, pitch_um(lens, shape_px)).shifted(*shift_px(scene))


def camera_pose(scene):
    """From the camera's axes, x to the right, y upwards, z backwards, to the scene in metres: array (4, 4)."""
    pose = np.array(scene.camera.matrix_world.normalized())
    pose[:3, 3] *= metres_per_unit(scene)
    return pose


def to_camera_mm(scene):
    """From Blender units of the scene to the camera's axes, in mm: array (4, 4)."""
    return mm_per_unit(scene) * np.linalg.inv(np.array(scene.camera.matrix_world.normalized()))


def shift_px(scene):
    """The sensor's displacement by the camera's Shift, in pixels to the right and up."""
    camera = camera_data(scene)
    if camera is None:
        return 0.0, 0.0
    return tuple(float(f"{part:.6g}") * unit_px  # as the user entered it: Blender's floats are single precision
                 for part, unit_px in zip((camera.shift_x, camera.shift_y),
                                          _shift_units_px(camera, frame_px(scene), pixel_aspect(scene)),
                                          strict=True))


def pixel_aspect(scene):
    """Width over height of the scene's pixels, as Blender shows them."""
    return scene.render.pixel_aspect_x / scene.render.pixel_aspect_y


def render_region(scene):
    """Blender's render region in the frame: slices of its rows and columns; None without one.

    Raises
    ------
    SceneError
        It is empty.
    """
    render, (rows, columns) = scene.render, frame_px(scene)
    if not render.use_border:
        return None
    top, bottom = (rows - int(side * rows) for side in (render.border_max_y, render.border_min_y))
    left, right = (int(side * columns) for side in (render.border_min_x, render.border_max_x))
    if top >= bottom or left >= right:
        raise SceneError(f"scene {scene.name!r}", "render region", "", "draw one in the camera's view, or clear it")
    return slice(top, bottom), slice(left, right)


def captured_region(region, lens, wavelengths_nm, capture, options=BY_RESULT, room=0.0, others=()):
    """The part of a capture that may contribute light to a region of the frame: slices of its rows and columns.

    Parameters
    ----------
    region : (slice, slice)
        Rows and columns of the frame.
    lens, wavelengths_nm, options, room, others
        As for `capture_grid`.
    capture : PixelGrid
    """
    grid, lenses = replace(capture, focal_mm=capture.focal_mm or lens.capture_focal_length_mm), (lens, *others)
    psf_reach_px = _planned_reach_px(options, lenses, capture, wavelengths_nm)
    reach = max(round(room * max(capture.frame_px)),
                *(field_map(one).reach_px(grid, wavelengths_nm, psf_reach_px) for one in lenses))
    return tuple(slice(max(part.start + overscan - reach, 0), min(part.stop + overscan + reach, n))
                 for part, overscan, n in zip(region, capture.overscan_px, capture.shape_px, strict=True))


def capture_grid(scene, lens, wavelengths_nm, options=BY_RESULT, room=0.0, others=()):
    """The pixels of a scene's capture for a lens: `frame_capture` for the scene's frame."""
    return frame_capture(lens, frame_grid(scene, lens), wavelengths_nm, options, room, others)


def frame_capture(lens, frame, wavelengths_nm, options=BY_RESULT, room=0.0, others=()):
    """The pixels of a capture for a lens: a PixelGrid.

    Its overscan holds the light that the plan spreads into the frame. The light that the plan trims need not be
    captured: beyond the overscan, less of each point's light is missing in the frame than the plan misplaces.

    Parameters
    ----------
    lens : Lens
    frame : PixelGrid
    wavelengths_nm : sequence of float
    options : Options
        Of the plan that will filter the capture.
    room : float
        Least margin to capture beyond each edge, as a fraction of the frame's longer side.
    others : sequence of Lens
        Lenses that share the capture, on the same sensor: the lens at other settings.

    Raises
    ------
    InputError
        `room` is out of range.
    """
    if not 0 <= room <= MOST_ROOM:
        raise InputError("options", "room", room, f"expected 0 to {MOST_ROOM:g}")
    reach_px = 0
    while True:  # a plan may depend on the overscan, so the last one is that of the capture
        capture = _capture_within(reach_px, lens, frame, wavelengths_nm, room, others)
        planned_px = _planned_reach_px(options, (lens, *others), capture, wavelengths_nm)
        if planned_px <= reach_px:
            return capture
        reach_px = planned_px


def _capture_within(reach_px, lens, frame, wavelengths_nm, room, others):
    """The capture for PSFs that reach this far."""
    capture = choose_capture(lens, frame, wavelengths_nm, reach_px)
    grid = replace(capture, focal_mm=lens.capture_focal_length_mm)
    margins = [field_map(other).overscan_px(grid, wavelengths_nm, reach_px) for other in others]
    rows, columns = np.max([capture.overscan_px, *margins], axis=0, initial=round(room * max(frame.shape_px)))
    return capture.with_overscan((rows, columns))


def _planned_reach_px(options, lenses, capture, wavelengths_nm):
    """Largest reach of a PSF in the plans for these lenses, in a capture's pixels.

    For pixels so small that planning would take long, it is the reach of complete PSFs.
    """
    sampling = Sampling(capture, tuple(map(float, wavelengths_nm)))
    complete_px = [field_map(lens).psf_radius_px(capture.pitch_um) for lens in lenses]
    return max(cached_plan(options, lens, sampling).reach_px if reach_px <= MOST_PLANNED_PX else reach_px
               for lens, reach_px in zip(lenses, complete_px, strict=True))


def view_tangents(scene, lens, view, rings=AT_REST):
    """Tangents of the angles of view of a lens, by name or path, at these settings: from the axis to the frame's left,
    lower, right and upper edge.

    Raises
    ------
    LensError, SceneError
        The lens does not exist, or cannot replace the scene's camera.
    """
    check_camera(scene)
    facts = lens_facts(lens, rings)
    return tuple(stretch * edge_mm / facts.capture_focal_length_mm
                 for stretch, edge_mm in zip((facts.squeeze, 1.0) * 2, scene_frame(scene, view).edges_mm(facts),
                                             strict=True))


def in_view(camera, box, lens, capture):
    """Whether a box may be in a capture's view: False if the complete box is outside one of the view's sides.

    Parameters
    ----------
    camera : bpy.types.Object
    box : array (8, 3)
        Its corners in the world.
    lens : Lens
    capture : PixelGrid
    """
    x, y, z = np.array(camera.matrix_world.normalized().inverted())[:3] @ np.c_[box, np.ones(len(box))].T
    tangents = _edge_tangents(lens, capture)
    if tangents is None:
        return True
    left, lower, right, upper = tangents
    sides = -z, x + z * left, y + z * lower, -z * right - x, -z * upper - y
    return all(np.any(side > 0) for side in sides)


@lru_cache(maxsize=4)
def _edge_tangents(lens, capture):
    """The largest tangents at the left, lower, right and upper edge of a capture, outwards; None if its corners show 90
    degrees or more."""
    focal_mm, edges_mm, tangents = lens.capture_focal_length_mm, capture.edges_mm, []
    if capture.projection.angle_rad(capture.farthest_px * capture.pitch_um * 1e-3 / focal_mm) >= np.pi / 2:
        return None
    for side, edge_mm in enumerate(edges_mm):
        along_mm = np.linspace(*edges_mm[1 - side % 2::2], EDGE_SAMPLES)
        radius_mm = np.maximum(np.hypot(edge_mm, along_mm), np.finfo(float).tiny)
        tangent = edge_mm * np.tan(capture.projection.angle_rad(radius_mm / focal_mm)) / radius_mm
        tangent = tangent if side % 2 else tangent * capture.squeeze
        tangents.append(tangent.min() if side < 2 else tangent.max())
    return tangents


def check_camera(scene, view=LENS_VIEW, camera=None):
    """Raise a SceneError unless a lens can replace the camera.

    Parameters
    ----------
    scene : bpy.types.Scene
    view : str
        As for `lens_for_view`.
    camera : bpy.types.Object, optional
        One of the scene's cameras; the active one by default.
    """
    camera = scene.camera if camera is None else camera
    camera_settings(scene, camera)
    where = f"camera {camera.name!r}"
    if camera.data.type == "PANO":
        kind = camera.data.panorama_type
        if kind != FISHEYE_TYPE:  # the type that match_camera_to_lens sets
            raise SceneError(where, "panorama type", kind, TO_PERSPECTIVE)
        if view == CAMERA_VIEW:
            raise SceneError(where, "type", "PANO", TO_PERSPECTIVE)
    elif camera.data.type != "PERSP":
        raise SceneError(where, "type", camera.data.type, TO_PERSPECTIVE)
    if not np.all(np.isfinite(shift := (camera.data.shift_x, camera.data.shift_y))):
        raise SceneError(where, "shift", "{:g}, {:g}".format(*shift), "expected finite numbers")
    if view == CAMERA_VIEW:
        _check_view(camera.data, where)
    _check_pose(camera, where)
    if not camera.data.clip_start < camera.data.clip_end:
        raise SceneError(where, "clipping", f"{camera.data.clip_start:g} to {camera.data.clip_end:g}",
                         "set Clip End beyond Clip Start: the camera sees nothing otherwise")


def _check_view(camera, where):
    """Raise a SceneError for camera data without a valid view: a damaged file may contain any value."""
    for name, value_mm in (("focal length", camera.lens), ("sensor width", camera.sensor_width),
                           ("sensor height", camera.sensor_height)):
        if not 0 < value_mm < np.inf:
            raise SceneError(where, name, f"{value_mm:g} mm", "expected a positive number")


def _check_pose(camera, where):
    """Raise a SceneError for a camera without a valid position or orientation."""
    pose = np.array(camera.matrix_world.normalized())
    if not np.all(np.isfinite(pose)):
        raise SceneError(where, "position", ", ".join(f"{n:g}" for n in camera.matrix_world.translation),
                         "expected finite numbers: clear the location, rotation and scale of the camera and its "
                         "parents")
    if abs(np.linalg.det(pose[:3, :3])) < LEAST_VOLUME:
        raise SceneError(where, "scale", ", ".join(f"{n:g}" for n in camera.matrix_world.to_scale()),
                         "set the scale of the camera and its parents to 1 on all three axes")


def aim_camera(scene, rotation=None):
    """Place the scene's camera so that it frames all rendered objects; points beyond `FARTHEST_M` are ignored.

    Parameters
    ----------
    scene : bpy.types.Scene
    rotation : mathutils.Quaternion, optional
        Its orientation; by default the orientation of a new file's camera.
    """
    boxes = [instance.box for instance in rendered_instances(scene) if instance.obj.type != "LIGHT"]
    corners = np.concatenate(boxes or [np.zeros((1, 3))])
    unit_m = metres_per_unit(scene)
    corners = corners[np.all(np.abs(corners) < FARTHEST_M / unit_m, axis=1)]
    low, high = (corners.min(axis=0), corners.max(axis=0)) if len(corners) else (np.zeros(3), np.zeros(3))
    radius = max(np.linalg.norm(high - low) / 2, NEAREST_M / unit_m)
    camera, frame = scene.camera, frame_px(scene)
    half_angle = np.arctan(_pixel_mm(scene, frame) * min(frame) / 2 / camera.data.lens)
    camera.rotation_euler = rotation.to_euler() if rotation else NEW_FILES_ROTATION
    away = camera.rotation_euler.to_matrix() @ Vector((0, 0, 1))
    camera.location = Vector((low + high) / 2) + away * float(radius / np.sin(half_angle))


def set_up_capture(camera, lens, capture, journal):
    """Set up camera data for a capture: a perspective camera, or a panoramic one with the capture's projection. The
    render's resolution must be `capture.shape_px`, and its pixels `capture.squeeze` times as wide as tall."""
    focal_mm = lens.capture_focal_length_mm
    plane = capture.projection.is_plane
    settings = _perspective(focal_mm / capture.squeeze, capture) if plane else _panoramic(focal_mm, capture)
    for name, value in settings.items():
        journal.set(camera, name, value)


def match_camera_to_lens(camera, facts, frame):
    """Give camera data the view of a lens, by its LensFacts, on a frame, a PixelGrid, for framing by the user.

    Most lenses become a perspective camera with the correct scale on the axis. A lens that would need more than
    MOST_PLANE times the frame's pixels on a plane becomes a fisheye camera with its own distortion: a rendered viewport
    shows the exact frame. Solid viewports show every camera in perspective; the focal length is set so that their left
    and right edges match the lens. The camera's Shift stays. The pixels are `frame.squeeze` times as wide as tall.
    """
    focal_mm, half_mm = facts.capture_focal_length_mm / frame.squeeze, _width_mm(frame) / 2
    if _stretch(facts, frame) ** 2 <= MOST_PLANE:
        _assign(camera, _perspective(focal_mm, frame))
        return
    edge_mm = facts.capture_focal_length_mm * np.tan(facts.angle_rad(half_mm))
    _assign(camera, _perspective(focal_mm * half_mm / edge_mm, frame))
    _assign(camera, _panoramic(focal_mm, replace(frame, projection=_projection(facts, frame))))


def _stretch(facts, frame):
    """How much larger than the frame the part of a plane is that the lens sees, at the frame's farthest corner."""
    last_mm = min(frame.farthest_px * frame.pitch_um * 1e-3, facts.last_mm)
    return facts.capture_focal_length_mm * np.tan(facts.angle_rad(last_mm, DIAGONAL)) / last_mm


def _projection(facts, frame):
    """The panorama that is closest to the distortion of a lens on a frame."""
    focal_mm = facts.capture_focal_length_mm
    last_mm = min(frame.farthest_px * frame.pitch_um * 1e-3, facts.last_mm)
    real_mm = np.linspace(0, last_mm, FIT_SAMPLES)
    return fitted_projection(real_mm / focal_mm, np.tan(facts.angle_rad(real_mm, DIAGONAL)),
                             FARTHEST * last_mm / focal_mm)


@lru_cache(maxsize=4)
def _matching_angle_rad(facts, frame):
    """Half the horizontal angle of view of a panoramic camera that `match_camera_to_lens` has matched to a lens."""
    return _half_angle_rad(_panoramic(facts.capture_focal_length_mm,
                                      replace(frame, projection=_projection(facts, frame))))


def _half_angle_rad(settings):
    """Half the horizontal angle of view of a panoramic camera with these properties, without its Shift."""
    half_mm = settings["sensor_width"] / 2
    return -sum(settings[f"fisheye_polynomial_k{power}"] * half_mm**power for power in range(5))


def is_panorama_of(facts, camera, frame, tolerance):
    """Whether panoramic camera data have the angle of view of a lens, by its LensFacts, on a frame, a PixelGrid, within
    a relative tolerance."""
    angle_rad = _half_angle_rad({name: getattr(camera, name) for name in camera.bl_rna.properties.keys()
                                 if name == "sensor_width" or name.startswith("fisheye_polynomial_k")})
    return abs(angle_rad / _matching_angle_rad(facts, frame) - 1) <= tolerance


def lens_for_view(scene, lens, view):
    """The lens for a scene, with its own view or the view of the camera.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens
    view : str
        "lens": the lens on its own sensor. A sensor, as for `format_mm`: the lens on this one. "camera": the lens
        scaled to the view of the scene's camera, on the camera's sensor.

    Returns
    -------
    Lens
    warning : str
        The consequences of the scaling, or of a sensor or a Shift beyond the lens's field, in one line; "" without any.

    Raises
    ------
    SceneError
        The camera is missing, or lacks a focal length.
    """
    factor, sensor_mm = size_for_view(scene, lens, view)
    if view == CAMERA_VIEW:
        adapted = scaled_lens(lens, factor, sensor_mm)
        warning = size_warning(lens, adapted, factor)
    else:
        adapted = lens if view == LENS_VIEW else lens_on_sensor(lens, sensor_mm)
        warning = "" if view == LENS_VIEW else sensor_warning(adapted)
    return adapted, "; ".join(filter(None, (warning, shift_warning(adapted, frame_grid(scene, adapted)))))


def size_for_view(scene, lens, view):
    """The scale factor of a lens, or of LensFacts, for a view, and its sensor's sides in mm.

    Raises
    ------
    SceneError
        As in `lens_for_view`.
    """
    if view == CAMERA_VIEW:
        check_camera(scene, view)
    frame = scene_frame(scene, view)
    return frame.factor(lens), frame.sensor_mm or lens.sensor_mm


def matching_focal_length_mm(scene, lens):
    """The focal length with which the scene's perspective camera matches the lens's scale on the axis."""
    frame = frame_px(scene)
    return lens.capture_focal_length_mm / (pitch_um(lens, frame) * 1e-3) * _pixel_mm(scene, frame)


def _pixel_mm(scene, frame):
    """Height of a pixel on the camera's own sensor."""
    camera, aspect = scene.camera.data, pixel_aspect(scene)
    side_mm = camera.sensor_height if camera.sensor_fit == "VERTICAL" else camera.sensor_width
    return side_mm / _sized_rows(camera, frame, aspect)


def _sized_rows(camera, frame, aspect):
    """The side of the frame that Blender's Sensor Fit sizes, in heights of its pixels."""
    rows, columns = frame
    return {"VERTICAL": rows, "HORIZONTAL": columns * aspect}.get(camera.sensor_fit, max(rows, columns * aspect))


def _shift_units_px(camera, frame, aspect=1.0):
    """The sensor's displacement by a Shift X and a Shift Y of 1, in pixels: for a panorama, in Cycles, because other
    viewports show it in perspective."""
    side_px = _sized_rows(camera, frame, aspect)
    return frame[::-1] if camera.type == "PANO" else (side_px / aspect, side_px)


def size_warning(lens, adapted, factor):
    """The consequences of scaling a lens to its new sensor, in one line."""
    covered = field_map(adapted).covered_diagonal(adapted.sensor_mm)
    focus = in_metres(adapted.object_distance_mm)
    bundled, change = described_lenses().get(lens.name), "enlarged" if factor > 1 else "reduced"
    return (f"{bundled.title if bundled else lens.name}, {change} to {adapted.efl_mm:.3g} mm to match your camera "
            f"(scaled by {factor:.3g}) and focused at {focus}; its field covers {covered:.0%} "
            "of the frame's diagonal; all blur scales with it, though diffraction would not")


def sensor_warning(lens):
    """A line if a lens's field does not cover its sensor; "" otherwise."""
    covered = field_map(lens).covered_diagonal(lens.sensor_mm)
    if covered > COMPLETE:
        return ""
    return (f"the field of {lens.name} covers {covered:.0%} of the diagonal of a sensor of "
            "{:g} x {:g} mm: the picture darkens or ends beyond it".format(*lens.sensor_mm))


@lru_cache(maxsize=4)
def shift_warning(lens, frame):
    """A line if a sensor is shifted beyond a lens's field; "" otherwise."""
    if frame.centred or (share := field_map(lens).at_wavelength(reference_nm(lens)).share_beyond(frame)) <= 0:
        return ""
    return (f"the Shift moves {share:.2g} of the frame beyond the field of {lens.name}: the picture darkens or ends "
            "there")


def _perspective(focal_mm, grid):
    """The properties of a perspective camera with a grid's view."""
    return _sensor(grid, "PERSP") | {"lens_unit": "MILLIMETERS",
                                     "lens": focal_mm * CAMERA_SENSOR_MM / _width_mm(grid)}


def _panoramic(focal_mm, grid):
    """The properties of a panoramic camera with a grid's projection. Cycles expects its polynomial with the opposite
    sign, for a radius in mm on the camera's sensor."""
    coefficients = np.zeros(5)
    coefficients[1:1 + len(grid.projection.angle_per_radius)] = grid.projection.angle_per_radius
    scale = _width_mm(grid) / CAMERA_SENSOR_MM / focal_mm
    return _sensor(grid, "PANO") | {"panorama_type": FISHEYE_TYPE, "fisheye_fov": WHOLE_SPHERE} | {
        f"fisheye_polynomial_k{power}": -coefficient * scale**power for power, coefficient in enumerate(coefficients)}


def _sensor(grid, camera_type):
    """The properties of a camera of this type with a sensor for a grid, shifted to its place in the image circle."""
    (rows, columns), (row, column) = grid.shape_px, grid.centre_px
    shift_x = ((columns - 1) / 2 - column) / columns
    shift_y = (row - (rows - 1) / 2) / (rows if camera_type == "PANO" else columns * grid.squeeze)
    return {"type": camera_type, "sensor_fit": "HORIZONTAL", "sensor_width": CAMERA_SENSOR_MM, "shift_x": shift_x,
            "shift_y": shift_y}


def _width_mm(grid):
    return grid.shape_px[1] * grid.pitch_um * 1e-3


def _assign(camera, settings):
    for name, value in settings.items():
        setattr(camera, name, value)
