"""The camera: the pinhole that sees what the lens sees, with the overscan that the lens needs."""

from dataclasses import dataclass

from ..engine.capture import overscan_px
from ..engine.psf import psf_radius_px
from .errors import SceneError

CAMERA_SENSOR_MM = 36.0  # Blender's limits on focal lengths are made for this; only the ratio to it counts


@dataclass(frozen=True)
class Framing:
    """Pixel grid of a capture: the sensor's frame in rows and columns, its pitch, and the overscan on each side."""

    frame_px: tuple[int, int]
    pitch_um: float
    overscan_px: tuple[int, int]

    @property
    def capture_px(self):
        return tuple(n + 2 * margin for n, margin in zip(self.frame_px, self.overscan_px))


def frame_px(scene):
    """Rows and columns of the scene's render, rounded as Blender does."""
    render = scene.render
    return tuple(max(1, side * render.resolution_percentage // 100)
                 for side in (render.resolution_y, render.resolution_x))


def pitch_um(lens, frame):
    """Pixel pitch at which the frame, rows and columns, just fits the lens's sensor."""
    return min(1e3 * lens.sensor_mm[0] / frame[1], 1e3 * lens.sensor_mm[1] / frame[0])


def make_framing(scene, lens, wavelengths_nm):
    """The grid to capture a scene on for a lens."""
    frame = frame_px(scene)
    pitch = pitch_um(lens, frame)
    margins = overscan_px(lens, frame, pitch, wavelengths_nm, psf_radius_px(lens, pitch))
    return Framing(frame, pitch, margins)


def check_camera(scene):
    """Raise a SceneError unless the scene has a camera that a lens can stand in for."""
    camera = scene.camera
    if camera is None or camera.type != "CAMERA":
        raise SceneError(f"scene {scene.name!r}", "camera", "missing", "add a camera to render from")
    where = f"camera {camera.name!r}"
    if camera.data.type != "PERSP":
        raise SceneError(where, "type", camera.data.type, "expected a perspective camera")
    if camera.data.shift_x or camera.data.shift_y:
        raise SceneError(where, "shift", f"{camera.data.shift_x:g}, {camera.data.shift_y:g}",
                         "the lens stands centred: set the shift to 0")
    if scene.render.pixel_aspect_x != scene.render.pixel_aspect_y:
        raise SceneError(f"scene {scene.name!r}", "pixel aspect",
                         f"{scene.render.pixel_aspect_x:g}:{scene.render.pixel_aspect_y:g}", "expected square pixels")


def match_camera_to_lens(camera, lens, columns, pixel_pitch_um):
    """Give camera data the view of the lens on a sensor of this many columns."""
    width_mm = columns * pixel_pitch_um * 1e-3
    camera.sensor_fit = "HORIZONTAL"
    camera.sensor_width = CAMERA_SENSOR_MM
    camera.lens_unit = "MILLIMETERS"
    camera.lens = lens.capture_focal_length_mm * CAMERA_SENSOR_MM / width_mm
