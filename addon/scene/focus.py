"""What the camera's rings have in focus, and how quickly it blurs before and behind that: by first-order optics, at
once, while they are dragged; a lens is baked long after."""

from dataclasses import dataclass, replace

import numpy as np

from ...engine.image.pitch import fitting_pitch_um
from .camera import frame_px, size_for_view
from .depth import M_TO_MM
from .rings import rings_for

NEAREST_FOCAL_LENGTHS = 2.0  # at which a lens images as large as life: no nearer


@dataclass(frozen=True)
class Focus:
    """Where a lens is focused, and its blur in pixels of a render.

    Attributes
    ----------
    focus_m : float
        Distance of what is in focus, along the axis.
    blur_px_m : float
        Blur of what is infinitely far, times that distance.
    """

    focus_m: float
    blur_px_m: float

    def blur_px(self, depth_m):
        """Diameter of the blur at these depths, positive nearer than what is in focus: array."""
        with np.errstate(divide="ignore"):
            return self.blur_px_m * (1 / np.asarray(depth_m) - 1 / self.focus_m)


def focus_now(scene, at_rest):
    """The Focus of a scene's lens, as its camera is set now.

    Parameters
    ----------
    scene : bpy.types.Scene
    at_rest : LensFacts
        Of the lens when it is turned to nothing.

    Raises
    ------
    InputError
        There is no camera that the lens can stand in for.
    """
    rings = rings_for(scene, scene.lensfield.lens_name_or_path())
    size, sensor_mm = size_for_view(scene, at_rest, scene.lensfield.view.lower())
    f_number, focus_mm = at_rest.f_number, at_rest.focus_mm * size
    if at_rest.reach:
        widest, highest, closest_mm = at_rest.reach
        f_number = min(max(rings.f_number or widest, widest), highest)
        focus_mm = focus_mm if rings.focus_mm is None else max(rings.focus_mm, closest_mm * size)
    focus_mm = max(focus_mm, NEAREST_FOCAL_LENGTHS * at_rest.efl_mm * size)
    focal_mm = at_rest.efl_mm * size
    image_mm = focal_mm / (1 - focal_mm / focus_mm)
    if scene.lensfield.view == "CAMERA":  # which stays, whatever is in focus: the lens is made so much smaller
        focal_mm, image_mm = focal_mm * focal_mm / image_mm, focal_mm
    pitch_mm = fitting_pitch_um(replace(at_rest, sensor_mm=sensor_mm), frame_px(scene)) / M_TO_MM
    return Focus(focus_mm / M_TO_MM, focal_mm / f_number * image_mm / pitch_mm / M_TO_MM)
