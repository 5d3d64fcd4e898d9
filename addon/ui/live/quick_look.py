"""Quick Look in the compositor: operators that add and remove it. Its node follows the lens, its rings and the camera.

In a window, a timer compares the scene with what the node shows, and a thread reads the lens. A render on the main
thread, as in background mode, updates the node first.
"""

from dataclasses import replace

import bpy
import numpy as np
from bpy.app.handlers import persistent

from lensfield.engine.field.overscan import CAMERA_VIEW
from lensfield.engine.lens import RadialLens
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.lens.pinhole import fitting_pitch_um, turned_sensor_mm
from lensfield.engine.look.lens_curves import CompositorLens, lens_curves
from lensfield.engine.look.lens_maps import lens_maps
from lensfield.engine.runtime.errors import InputError, one_line
from lensfield.engine.runtime.threads import in_main_thread

from ...job.named_files import check_named_files
from ...scene.active_camera import camera_settings
from ...scene.camera import TO_PERSPECTIVE, SceneFrame, frame_px, pixel_aspect, size_for_view
from ...scene.compositor import LABEL_LENGTH, QUICK_LOOK, lay_group, remove_from_compositor, scene_node
from ...scene.errors import SceneError
from ...scene.lens_facts import lens_facts
from ...scene.quick_look import NAME, new_quick_look, set_lens
from ...scene.requirements import check_scene
from ...scene.units import mm_per_unit
from ..common.background import Answers
from ..common.lens_at_rest import facts_at_rest
from ..common.properties import lens_title
from .live import frame_lens, frame_question

CHECK_S = 1.0
RINGS = "lensfield_rings"  # custom property of the groups: the focus and the f-stop that were last set
MOST_LOOKS = 4  # of scenes
PLACES = 129  # across and up, for the share of the frame without light


def quick_look_question(scene, at_rest):
    """Everything that a scene's Quick Look depends on: hashable arguments of `read_look`."""
    _, (width_mm, _) = size_for_view(scene, at_rest, CAMERA_VIEW)
    return *frame_question(scene, at_rest), width_mm / 2 / scene.camera.data.lens, pixel_aspect(scene)


def read_look(name, stamp, rings, focal_mm, sensor_mm, shape_px, right_up_px, iris, vignette, tangent, aspect):
    """The LensCurves or LensMaps of these arguments, the camera's scale relative to the lens, and the inverse of the
    focus distance in mm.

    Raises
    ------
    InputError
        The lens is not available.
    """
    lens = frame_lens(name, rings, SceneFrame(shape_px, right_up_px, sensor_mm, focal_mm))
    lens = replace(lens, sensor_mm=turned_sensor_mm(lens, shape_px))
    pitch_mm = fitting_pitch_um(lens, shape_px) * 1e-3
    look = compositor_lens(lens, lens_facts(name, rings, focal_mm).f_number, iris, vignette,
                           tuple(part_px * pitch_mm for part_px in right_up_px), pixel_aspect=aspect)
    return look, shape_px[1] / 2 * pitch_mm / lens.capture_focal_length_mm / tangent, focus_nearness(lens)


_looks = Answers(read_look, MOST_LOOKS)


def compositor_lens(lens, *values, pixel_aspect):
    """The LensCurves of a lens, or the LensMaps of one that is not rotationally symmetric; arguments as of
    `lens_maps`."""
    if isinstance(lens, RadialLens):
        return lens_curves(lens, *values)
    return lens_maps(lens, *values, pixel_aspect=pixel_aspect)


def add_quick_look(scene):
    """Add Quick Look to a scene's compositor, or update it.

    Returns
    -------
    str
        What the picture lacks, in one line.

    Raises
    ------
    InputError
        The lens, or the scene's camera, is not available.
    """
    check_named_files()
    _check(scene)
    question = quick_look_question(scene, facts_at_rest(scene, None))
    answer = read_look(*question)
    for layer in scene.view_layers:
        layer.use_pass_z = layer.use_pass_z or layer.use
    _, node = lay_group(scene, QUICK_LOOK, NAME, new_quick_look)
    _show(scene, node, question, answer)
    return " \u00b7 ".join(_words(scene, *answer))


def follow(scene, wait=False):
    """Update a scene's Quick Look node, if it has one: when the lens is read, or at once if `wait`."""
    node = _editable_node(scene)
    if node is None:
        return
    try:
        check_named_files()
        _check(scene)
        at_rest = facts_at_rest(scene, None if wait else 0.0)
        if at_rest is None:
            return
        question = quick_look_question(scene, at_rest)
        if node.node_tree[QUICK_LOOK] != _state(scene, question):
            answer = _looks.to(*question)
            if not wait and not answer.done():
                return
            _show(scene, node, question, answer.result())
        _label(node, lens_title(camera_settings(scene).lens_text()))
    except InputError as error:
        _label(node, one_line(error))


def _check(scene):
    check_scene(scene)
    if not camera_settings(scene).lens_text():
        raise SceneError(f"scene {scene.name!r}", "lens", "missing", "choose a lens, or a lens file")
    if scene.camera.data.type == "PANO":
        raise SceneError(f"camera {scene.camera.data.name!r}", "type", "PANO", TO_PERSPECTIVE)


def _editable_node(scene):
    """The scene's Quick Look node, unless it is linked or belongs to another scene: this one may be its copy."""
    node = scene_node(scene, QUICK_LOOK)
    if node is None or node.id_data.library or node.node_tree.library:
        return None
    first = next(other for other in bpy.data.scenes
                 if (its := scene_node(other, QUICK_LOOK)) and its.node_tree == node.node_tree)
    return node if first == scene else None


def _show(scene, node, question, answer):
    look, scale, nearness_per_mm = answer
    group, unit_mm = node.node_tree, mm_per_unit(scene)
    _turn(node, 1 / nearness_per_mm / unit_mm if nearness_per_mm else 0.0, look.f_number,
          always=scene.camera.data.dof.use_dof)
    set_lens(group, look, scale, unit_mm, not _blender_blurs(scene))
    group[QUICK_LOOK] = _state(scene, question)
    _label(node, lens_title(camera_settings(scene).lens_text()))


def _turn(node, focus_distance, f_number, always):
    """Set the node's focus and f-stop, unless the user has changed them."""
    focus, f_stop = node.inputs["Focus Distance"], node.inputs["F-Stop"]
    present = [focus.default_value, f_stop.default_value]
    if always or list(node.node_tree.get(RINGS, present)) == present:
        focus.default_value, f_stop.default_value = focus_distance, f_number
        node.node_tree[RINGS] = [focus.default_value, f_stop.default_value]


def _state(scene, question):
    return repr((question, mm_per_unit(scene), _blender_blurs(scene)))


def _blender_blurs(scene):
    """Whether the render itself has the blur of the camera's Depth of Field."""
    return scene.camera.data.dof.use_dof and (
        scene.render.engine != "BLENDER_WORKBENCH" or scene.display.shading.use_dof)


def _label(node, text):
    label = f"{NAME}: {text}"[:LABEL_LENGTH]
    if node.label != label:
        node.label = label


def _words(scene, look, scale, _):
    """What a picture lacks."""
    missing = _share_outside(look, scale, frame_px(scene))
    if missing > 0.001:
        yield f"{missing:.1%} of the frame is outside the camera's view and remains transparent"
    if _blender_blurs(scene):
        yield "Blender's own Depth of Field blurs the render"


def _share_outside(look: CompositorLens, scale, shape_px):
    """The share of a frame whose light comes from outside the camera's view."""
    half = np.array(shape_px[::-1]) / 2 * min(np.divide(look.sensor, shape_px[::-1]))
    place = np.stack(np.meshgrid(*(side * np.linspace(-1, 1, PLACES) for side in half)), axis=-1) + look.shift
    return float(np.mean(np.any(abs(scale * look.green_sources(place) - look.shift) > half, axis=-1)))


def check():
    """Update the Quick Look nodes; returns the seconds to the next check."""
    if not bpy.app.is_job_running("RENDER"):
        for scene in bpy.data.scenes:
            follow(scene)
    return CHECK_S


@persistent
def on_render(scene, *_):
    """Update the node before a frame that a script renders."""
    if scene.render.use_compositing and in_main_thread():
        follow(scene, wait=True)


def start_following():
    """Register the handler and the timer, until `stop_following`."""
    bpy.app.handlers.render_pre.append(on_render)
    if not bpy.app.background:
        bpy.app.timers.register(check, first_interval=CHECK_S, persistent=True)


def stop_following():
    """Remove the handler and the timer."""
    bpy.app.handlers.render_pre.remove(on_render)
    if bpy.app.timers.is_registered(check):
        bpy.app.timers.unregister(check)
    _looks.forget()


def draw_quick_look(layout, scene):
    """Draw the buttons of Quick Look, and its node's label."""
    node, row = scene_node(scene, QUICK_LOOK), layout.row(align=True)
    row.operator("lensfield.quick_look", text=f"{'Update' if node else 'Add'} Quick Look", icon="NODE_COMPOSITING")
    if node:
        row.operator("lensfield.remove_quick_look", text="", icon="X")
        layout.label(text=node.label)


class LENSFIELD_OT_quick_look(bpy.types.Operator):
    """Show ordinary renders, by any engine, through the scene's lens: a node in the compositor applies its distortion,
    lateral colour and relative illumination, and blurs by depth. It follows the lens and its rings"""

    bl_idname = "lensfield.quick_look"
    bl_label = "Add Quick Look"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return not bpy.app.is_job_running("RENDER")

    def execute(self, context):
        try:
            words = add_quick_look(context.scene)
        except (InputError, OSError) as error:
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        if words:
            self.report({"INFO"}, words)
        return {"FINISHED"}


class LENSFIELD_OT_remove_quick_look(bpy.types.Operator):
    """Remove Quick Look from the compositor and restore the previous links"""

    bl_idname = "lensfield.remove_quick_look"
    bl_label = "Remove Quick Look"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return scene_node(context.scene, QUICK_LOOK) is not None and not bpy.app.is_job_running("RENDER")

    def execute(self, context):
        remove_from_compositor(context.scene, QUICK_LOOK)
        return {"FINISHED"}


classes = LENSFIELD_OT_quick_look, LENSFIELD_OT_remove_quick_look
