"""The likely reason for an empty frame, black or transparent all over."""

from dataclasses import dataclass

import numpy as np
from mathutils import Vector

from ..scene.bodies import depths_mm, is_closed
from ..scene.camera import in_view, to_camera_mm
from ..scene.depth import View
from ..scene.instances import SHADED_TYPES, rendered_instances
from ..scene.render_state import rendered_world
from ..scene.units import M_TO_MM, mm_per_unit
from ..scene.volumes import has_volume
from ..shading.lobes import lobes_of, shines
from .remarks import Remark

BLACK, TRANSPARENT = "black", "transparent"
AROUND = [Vector(sign * np.eye(3)[axis]) for axis in range(3) for sign in (-1, 1)]
UNKNOWN = Remark("Empty Frame", BLACK, "no cause found in the scene's settings", "compare with an F12 render")


@dataclass(frozen=True)
class EmptyReasons:
    """Why a frame may come out empty.

    Attributes
    ----------
    unlit, unseen : (str, str) or None
        Why no light reaches the camera, and why no object is visible, each with a remedy.
    sky : bool
        Whether the world emits light, and so is visible where the film shows it.
    """

    unlit: tuple[str, str] | None
    unseen: tuple[str, str] | None
    sky: bool

    def before_render(self, film_transparent):
        """Remarks before a render, if the frame is certain to be empty: list of Remark."""
        if self.unseen and film_transparent:
            return [Remark("Empty Frame", TRANSPARENT, *self.unseen)]
        reason = self.unlit or (None if self.sky else self.unseen)
        return [Remark("Empty Frame", BLACK, *reason)] if reason else []

    def after_render(self, black, transparent):
        """Remarks after a render: list of Remark.

        Parameters
        ----------
        black, transparent : bool
            Whether the complete frame has no light, and no alpha.
        """
        if transparent:
            return [Remark("Empty Frame", TRANSPARENT, *self.unseen) if self.unseen else
                    Remark("Empty Frame", TRANSPARENT, UNKNOWN.becomes, UNKNOWN.remedy)]
        if black:
            reason = self.unlit or self.unseen
            return [Remark("Empty Frame", BLACK, *reason) if reason else UNKNOWN]
        return []


def empty_reasons(scene, lens, capture):
    """The reasons in a scene for an empty frame.

    Parameters
    ----------
    scene : bpy.types.Scene
        Evaluated at the frame, with its original materials.
    lens : Lens
    capture : PixelGrid

    Returns
    -------
    EmptyReasons
    """
    instances, world = list(rendered_instances(scene)), rendered_world(scene)
    lamps = [each for each in instances if each.obj.type == "LIGHT" and shines(each.obj.data)]
    glowing = {material: shines(material) for each in instances for material in each.materials}
    lights = lamps + [each for each in instances if any(glowing[material] for material in each.materials)]
    sky = bool(world) and (shines(world) or has_volume(world))
    unseen = _unseen(scene, [each for each in instances if each.obj.type in SHADED_TYPES], lens, capture)
    if not lights and not sky:
        return EmptyReasons(("no light: no lamp or emissive material, and a black world",
                             "add a light, or set the world's Color and Strength"), unseen, sky)
    return EmptyReasons(None if unseen else _inside(scene, lens, capture, lights), unseen, sky)


def _unseen(scene, shaded, lens, capture):
    """Why no object is visible, and the remedy; None if one may be visible."""
    if not shaded:
        count = sum(obj.type in SHADED_TYPES for obj in scene.objects)
        return (f"all objects ({count}) are hidden from renders" if count else "the scene has no objects to render",
                "enable Renders for them and their collections" if count else "add objects")
    visible = [each for each in shaded if each.obj.visible_camera]
    if not visible:
        return "all objects are hidden from the camera", "enable Camera in their Ray Visibility"
    camera, unit_mm, in_sight = scene.camera.data, mm_per_unit(scene), False
    start_mm, end_mm = camera.clip_start * unit_mm, camera.clip_end * unit_mm
    to_camera = to_camera_mm(scene)
    for each in visible:  # stops at the first in view: there may be a million
        if in_view(scene.camera, each.box, lens, capture):
            in_sight = True
            near_mm, far_mm = depths_mm(each.box, to_camera, capture.projection)
            if near_mm <= end_mm and start_mm <= far_mm:
                return None
    if in_sight:
        return (f"all objects in view are outside the camera's clip range, {start_mm / M_TO_MM:.3g} to "
                f"{end_mm / M_TO_MM:.3g} m", "change Clip Start or End")
    return "no object is in the camera's view", "aim the camera at them, or press Match Camera to Lens"


def _inside(scene, lens, capture, lights):
    """Which closed, opaque mesh without a light surrounds the camera, and the remedy; or None."""
    view = View(scene, lens, capture)
    around = [view.first(view.origin, direction) for direction in AROUND]
    names = {hit and hit.obj.original.name for hit in around}
    if None in names or len(names) > 1:
        return None
    hit = around[0]
    materials = [slot.material for slot in hit.obj.original.material_slots if slot.material]
    if not is_closed(hit.obj.data) or any(lobes_of(material) for material in materials):
        return None
    corners = np.array(hit.obj.bound_box) @ np.array(hit.to_world.to_3x3()).T + np.array(hit.to_world.translation)
    for light in lights:
        middle = light.box.mean(axis=0)
        if np.all((corners.min(axis=0) <= middle) & (middle <= corners.max(axis=0))):
            return None
    return (f"the camera is inside {hit.obj.original.name!r}, a closed mesh that contains no light",
            "move the camera out, or hide the mesh from renders")
