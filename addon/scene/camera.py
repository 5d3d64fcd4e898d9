"""The camera: what sees the scene as the lens does, with the overscan that the lens needs."""

from dataclasses import replace

import numpy as np
from mathutils import Euler, Vector

from ...engine.bake.rings import AT_REST, in_metres
from ...engine.errors import InputError
from ...engine.field.distortion import FieldGeometry
from ...engine.field.overscan import VIEWS, choose_capture, overscan_px, reach_px
from ...engine.field.psf_bank import psf_radius_px
from ...engine.image.pitch import fitting_pitch_um as pitch_um
from ...engine.image.pixel_grid import PLANE, PixelGrid
from ...engine.lens.curves import field_angle_rad, reference_nm
from .errors import SceneError
from .instances import rendered_instances
from .lens_cache import scaled_lens
from .lens_facts import lens_facts

FARTHEST_M, NEAREST_M = 1e4, 0.01  # of what a new camera is aimed at
NEW_FILES_ROTATION = Euler((1.1093, 0.0, 0.8149))
CAMERA_SENSOR_MM = 36.0  # Blender's limits on focal lengths are made for this; only the ratio to it counts
FISHEYE_TYPE = "FISHEYE_LENS_POLYNOMIAL"
WHOLE_SPHERE = 2 * np.pi  # a field of view that cuts nothing off
FIT_SAMPLES = 257
MOST_ROOM = 1.0
TO_PERSPECTIVE = ("a lens sees in perspective: choose Perspective for the Type in the camera's properties, then Match "
                  "Camera to Lens to frame by")


def frame_px(scene):
    """Rows and columns of the scene's render, rounded as Blender does."""
    render = scene.render
    return tuple(max(1, side * render.resolution_percentage // 100)
                 for side in (render.resolution_y, render.resolution_x))


def render_region(scene):
    """The part of the frame that Blender's render region takes: slices of its rows and columns; None without one.

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


def captured_region(region, lens, wavelengths_nm, capture, room=0.0, others=()):
    """The part of a capture that light for a region of the frame may come from: slices of its rows and columns.

    Parameters
    ----------
    region : (slice, slice)
        Rows and columns of the frame.
    lens, wavelengths_nm, room, others
        As for `capture_grid`.
    capture : PixelGrid
    """
    seen = replace(capture, focal_mm=capture.focal_mm or lens.capture_focal_length_mm)
    reach = max(round(room * max(capture.frame_px)),
                *(reach_px(one, seen, wavelengths_nm, psf_radius_px(one, capture.pitch_um)) for one in (lens, *others)))
    return tuple(slice(max(part.start + overscan - reach, 0), min(part.stop + overscan + reach, n))
                 for part, overscan, n in zip(region, capture.overscan_px, capture.shape_px, strict=True))


def capture_grid(scene, lens, wavelengths_nm, room=0.0, others=()):
    """The pixels to capture a scene with for a lens: `frame_capture` for its render's size."""
    return frame_capture(lens, frame_px(scene), wavelengths_nm, room, others)


def frame_capture(lens, shape_px, wavelengths_nm, room=0.0, others=()):
    """The pixels to capture a scene with for a lens: a PixelGrid.

    Parameters
    ----------
    lens : Lens
    shape_px : (int, int)
        Rows and columns of the frame.
    wavelengths_nm : sequence of float
    room : float
        How much of the frame's longer side to capture beyond each edge at the least.
    others : sequence of Lens
        That are to see the same capture, on the same sensor: the lens, turned otherwise.

    Raises
    ------
    InputError
        Room that cannot be.
    """
    if not 0 <= room <= MOST_ROOM:
        raise InputError("options", "room", room, f"expected 0 to {MOST_ROOM:g}")
    frame = PixelGrid(shape_px, pitch_um(lens, shape_px))
    capture = choose_capture(lens, frame, wavelengths_nm, psf_radius_px(lens, frame.pitch_um))
    seen = replace(capture, focal_mm=lens.capture_focal_length_mm)
    margins = [overscan_px(other, seen, wavelengths_nm, psf_radius_px(other, frame.pitch_um)) for other in others]
    rows, columns = np.max([capture.overscan_px, *margins], axis=0, initial=round(room * max(shape_px)))
    return PixelGrid.around_frame(shape_px, frame.pitch_um, (rows, columns), capture.projection)


def view_tangents(scene, lens, view, rings=AT_REST):
    """Tangents of half the angles across and down that a lens, by name or path, shows of a scene when it is turned so.

    Raises
    ------
    LensError, SceneError
        No such lens, or no camera that it can stand in for.
    """
    check_camera(scene)
    facts, (rows, columns) = lens_facts(lens, rings), frame_px(scene)
    factor, sensor_mm = size_for_view(scene, facts, view)
    half_pixel = min(sensor_mm[0] / columns, sensor_mm[1] / rows) / 2 / (factor * facts.capture_focal_length_mm)
    return columns * half_pixel, rows * half_pixel


def in_view(camera, box, lens, capture):
    """Whether a box may be in a capture's view: it is not, where all of it lies behind one of the view's sides.

    Parameters
    ----------
    camera : bpy.types.Object
    box : array (8, 3)
        Its corners in the world.
    lens : Lens
    capture : PixelGrid
    """
    if capture.projection != PLANE:
        return True
    x, y, z = np.linalg.inv(np.array(camera.matrix_world.normalized()))[:3] @ np.c_[box, np.ones(len(box))].T
    rows_mm, columns_mm = (n * capture.pitch_um * 1e-3 / 2 for n in capture.shape_px)
    sides = [-z, *(sign * along * lens.capture_focal_length_mm - z * half_mm
                   for along, half_mm in ((x, columns_mm), (y, rows_mm)) for sign in (-1, 1))]
    return all(np.any(side > 0) for side in sides)


def check_camera(scene):
    """Raise a SceneError unless the scene has a camera that a lens can stand in for."""
    camera = scene.camera
    if camera is None or camera.type != "CAMERA":
        raise SceneError(f"scene {scene.name!r}", "camera", "missing", "add a camera to render from")
    where = f"camera {camera.name!r}"
    if camera.data.type == "PANO":
        kind = camera.data.panorama_type
        if kind != FISHEYE_TYPE:  # the one that match_camera_to_lens makes
            raise SceneError(where, "panorama type", kind, TO_PERSPECTIVE)
    elif camera.data.type != "PERSP":
        raise SceneError(where, "type", camera.data.type, TO_PERSPECTIVE)
    if camera.data.shift_x or camera.data.shift_y:
        raise SceneError(where, "shift", f"{camera.data.shift_x:g}, {camera.data.shift_y:g}",
                         "the lens stands centred: set the shift to 0")
    if scene.render.pixel_aspect_x != scene.render.pixel_aspect_y:
        raise SceneError(f"scene {scene.name!r}", "pixel aspect",
                         f"{scene.render.pixel_aspect_x:g}:{scene.render.pixel_aspect_y:g}", "expected square pixels")


def aim_camera(scene, rotation=None):
    """Place the scene's camera so that all that is rendered is within its view, or as much of it as is finite.

    Parameters
    ----------
    scene : bpy.types.Scene
    rotation : mathutils.Quaternion, optional
        Which way it looks; as the camera of a new file by default.
    """
    boxes = [instance.box for instance in rendered_instances(scene) if instance.obj.type != "LIGHT"]
    corners = np.concatenate(boxes or [np.zeros((1, 3))])
    corners = corners[np.all(np.abs(corners) < FARTHEST_M, axis=1)]
    low, high = (corners.min(axis=0), corners.max(axis=0)) if len(corners) else (np.zeros(3), np.zeros(3))
    radius_m = max(np.linalg.norm(high - low) / 2, NEAREST_M)
    camera, frame = scene.camera, frame_px(scene)
    half_angle = np.arctan(_pixel_mm(camera.data, frame) * min(frame) / 2 / camera.data.lens)
    camera.rotation_euler = rotation.to_euler() if rotation else NEW_FILES_ROTATION
    away = camera.rotation_euler.to_matrix() @ Vector((0, 0, 1))
    camera.location = Vector((low + high) / 2) + away * float(radius_m / np.sin(half_angle))


def set_up_capture(camera, lens, capture):
    """Make camera data the camera of a capture: a perspective one, or an equidistant fisheye of the same scale on the
    axis. The render's resolution is to be `capture.shape_px`."""
    width_mm = capture.shape_px[1] * capture.pitch_um * 1e-3
    if capture.projection == PLANE:
        _make_perspective(camera, lens.capture_focal_length_mm, width_mm)
    else:
        _make_fisheye(camera, [1 / lens.capture_focal_length_mm], width_mm)


def match_camera_to_lens(camera, lens, columns, pixel_pitch_um, projection=PLANE):
    """Give camera data the view of the lens on a sensor of this many columns, for the user to frame by.

    A lens that is captured as a plane becomes a perspective camera, true on the axis. A wide one becomes a fisheye
    camera with the lens's own distortion: a rendered viewport shows the very frame. Solid viewports show every camera
    in perspective; its focal length is set so that they reach as far to the left and right as the lens does.
    """
    width_mm = columns * pixel_pitch_um * 1e-3
    if projection == PLANE:
        _make_perspective(camera, lens.capture_focal_length_mm, width_mm)
    else:
        _make_perspective(camera, width_mm / 2 / np.tan(_field_angle(lens, width_mm / 2)), width_mm)
        _make_fisheye(camera, _field_polynomial(lens, width_mm), width_mm)


def lens_for_view(scene, lens, view):
    """The lens to see a scene through, as its own view or the camera's is asked for.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens
    view : "lens" or "camera"
        The lens on its own sensor; or at the size that gives the scene's camera its own view, on the camera's sensor.

    Returns
    -------
    Lens
    warning : str
        One line that says what another size means; "" for none.

    Raises
    ------
    SceneError
        There is no camera, or one without a focal length.
    """
    factor, sensor_mm = size_for_view(scene, lens, view)
    if view == "lens":
        return lens, ""
    adapted = scaled_lens(lens, factor, sensor_mm)
    return adapted, size_warning(lens, adapted, factor)


def size_for_view(scene, lens, view):
    """How many times as large a lens, or one of these LensFacts, is for a view, and its sensor's sides in mm.

    Raises
    ------
    SceneError
        As `lens_for_view`.
    """
    if view not in VIEWS:
        raise InputError("options", "view", view, f"expected {' or '.join(VIEWS)}")
    if view == "lens":
        return 1.0, lens.sensor_mm
    check_camera(scene)
    camera, frame = scene.camera.data, frame_px(scene)
    if camera.type != "PERSP":
        raise SceneError(f"camera {scene.camera.name!r}", "type", camera.type, TO_PERSPECTIVE)
    pixel_mm = _pixel_mm(camera, frame)
    factor = camera.lens / lens.capture_focal_length_mm  # camera.lens is in mm, in whatever unit Blender shows it
    return factor, (frame[1] * pixel_mm, frame[0] * pixel_mm)


def matching_focal_length_mm(scene, lens):
    """The focal length with which the scene's perspective camera would show what the lens does, on the axis."""
    frame = frame_px(scene)
    return lens.capture_focal_length_mm / (pitch_um(lens, frame) * 1e-3) * _pixel_mm(scene.camera.data, frame)


def _pixel_mm(camera, frame):
    """Size of a pixel on the camera's own sensor, by Blender's rules of how a render fits it."""
    if camera.sensor_fit == "VERTICAL":
        return camera.sensor_height / frame[0]
    if camera.sensor_fit == "HORIZONTAL":
        return camera.sensor_width / frame[1]
    return camera.sensor_width / max(frame)


def size_warning(lens, adapted, factor):
    """One line that says what it means that a lens is made larger or smaller, for the sensor that it then has."""
    covered = covered_diagonal(adapted, adapted.sensor_mm)
    focus = in_metres(adapted.object_distance_mm)
    return (f"{lens.name} made {factor:.3g} times as large: f = {adapted.efl_mm:.3g} mm, focused at {focus}; its field "
            f"covers {covered:.0%} of the frame's diagonal; all its blur scales alike, though diffraction would not")


def covered_diagonal(lens, sensor_mm):
    """How much of a sensor's diagonal the lens data cover, 1 at the most."""
    return min(1.0, 2 * lens.real_height_at(reference_nm(lens))[-1] / np.hypot(*sensor_mm))


def _make_perspective(camera, focal_length_mm, width_mm):
    camera.type = "PERSP"
    camera.sensor_fit = "HORIZONTAL"
    camera.sensor_width = CAMERA_SENSOR_MM
    camera.lens_unit = "MILLIMETERS"
    camera.lens = focal_length_mm * CAMERA_SENSOR_MM / width_mm


def _make_fisheye(camera, angle_per_radius, width_mm):
    """Make camera data a fisheye whose view at r mm from the middle is at the angle sum of angle_per_radius[n] r^(n+1).

    Cycles takes the polynomial with its sign turned, and r on the camera's sensor in mm.
    """
    camera.type = "PANO"
    camera.sensor_fit = "HORIZONTAL"
    camera.sensor_width = CAMERA_SENSOR_MM
    camera.panorama_type = FISHEYE_TYPE
    camera.fisheye_fov = WHOLE_SPHERE
    coefficients = np.zeros(5)
    coefficients[1:1 + len(angle_per_radius)] = angle_per_radius
    for power, coefficient in enumerate(coefficients):
        setattr(camera, f"fisheye_polynomial_k{power}", -coefficient * (width_mm / CAMERA_SENSOR_MM) ** power)


def _field_angle(lens, real_height_mm):
    """Angle from the axis, seen from the entrance pupil, of what the lens images at this height from the axis."""
    field = FieldGeometry(lens.at_wavelength(reference_nm(lens)), lens.name)
    return field_angle_rad(lens, field.paraxial_height_mm(real_height_mm))


def _field_polynomial(lens, width_mm):
    """Field angle by powers 1 to 4 of the real height, fitted over the lens data and over half the sensor's width."""
    last_mm = max(width_mm / 2, lens.real_height_mm[:, -1].min())
    radius_mm = np.linspace(0, last_mm, FIT_SAMPLES)
    powers = (radius_mm[:, None] / last_mm) ** np.arange(1, 5)
    coefficients = np.linalg.lstsq(powers, _field_angle(lens, radius_mm), rcond=None)[0]
    return coefficients / last_mm ** np.arange(1, 5)
