"""The focus distance of the camera's rings, and the blur in front of it and behind it: by first-order optics, fast
enough to follow a drag, and long before a lens is baked."""

from dataclasses import dataclass, replace

import numpy as np

from lensfield.engine.lens.pinhole import fitting_pitch_um

from .active_camera import camera_settings
from .camera import frame_px, size_for_view
from .lens_facts import lean_per_m
from .rings import rings_for
from .units import M_TO_MM

NEAREST_FOCAL_LENGTHS = 2.0  # closest focus, at magnification 1


@dataclass(frozen=True)
class Focus:
    """Where a lens is focused, and its blur in pixels of a render.

    Attributes
    ----------
    focus_m : float
        Focus distance along the axis.
    blur_px_m : float
        Blur of infinitely distant points, times that distance.
    lean_per_m : (float, float)
        Rise of the inverse depth in focus with the tangents of angles to the right and up.
    """

    focus_m: float
    blur_px_m: float
    lean_per_m: tuple[float, float] = (0.0, 0.0)

    def blur_px(self, depth_m, tangents=(0.0, 0.0)):
        """Diameter of the blur at these depths, and in these directions to the right and up, positive if nearer than
        the plane of focus: array."""
        in_focus = 1 / self.focus_m + sum(per_m * tangent for per_m, tangent in
                                          zip(self.lean_per_m, tangents, strict=True))
        with np.errstate(divide="ignore"):
            return self.blur_px_m * (1 / np.asarray(depth_m) - in_focus)


def focus_now(scene, at_rest):
    """The Focus of a scene's lens, by the camera's current settings.

    Parameters
    ----------
    scene : bpy.types.Scene
    at_rest : LensFacts
        Of the lens with its rings at rest.

    Raises
    ------
    InputError
        The lens cannot replace the scene's camera.
    """
    settings = camera_settings(scene)
    lens = settings.lens_name_or_path()
    rings = rings_for(scene, lens)
    size, sensor_mm = size_for_view(scene, at_rest, settings.view_text())
    f_number, focus_mm = at_rest.f_number, at_rest.focus_mm * size
    if at_rest.reach:
        widest, highest, closest_mm = at_rest.reach
        f_number = min(max(rings.f_number or widest, widest), highest)
        focus_mm = focus_mm if rings.focus_mm is None else max(rings.focus_mm, closest_mm * size)
    focus_mm = max(focus_mm, NEAREST_FOCAL_LENGTHS * at_rest.efl_mm * size)
    focal_mm = at_rest.efl_mm * size
    image_mm = focal_mm / (1 - focal_mm / focus_mm)
    if settings.view == "CAMERA":  # the view is the same at every focus, so the lens is scaled down
        focal_mm, image_mm = focal_mm * focal_mm / image_mm, focal_mm
    pitch_mm = fitting_pitch_um(replace(at_rest, sensor_mm=sensor_mm), frame_px(scene)) / M_TO_MM
    wider = max(1.0, at_rest.squeeze**-2)  # as in `blur_per_nearness_px`
    return Focus(focus_mm / M_TO_MM, wider * focal_mm / f_number * image_mm / pitch_mm / M_TO_MM,
                 tuple(per_m / size for per_m in lean_per_m(lens, rings.tilt_deg)))
