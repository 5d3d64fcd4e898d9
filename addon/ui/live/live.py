"""Live: the camera's view through the lens while the artist works, from the viewport's own picture.

A draw handler replaces the camera's frame in 3D viewports. A thread reads the lens and makes its tables when the lens,
its rings or the frame change; until they are finished, the previous ones are drawn, with the current focus and f-stop.

Rendered viewports would blur by Blender's own depth of field, too. It is switched off in the evaluated copy of the
camera, which only viewports use: neither the file nor renders change.
"""

import traceback
from dataclasses import astuple, dataclass, field
from functools import lru_cache, partial
from math import inf
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent

from lensfield.engine.depth.depth_range import blur_per_nearness_px
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.overscan import LENS_VIEW
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.entrance_pupil import focus_nearness, focus_rise
from lensfield.engine.lens.iris import opening
from lensfield.engine.lens.pinhole import fitting_pitch_um
from lensfield.engine.library.bodies import load_camera
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.look.lens_tables import COLOURS_NM, LensTables, lens_tables
from lensfield.engine.runtime.background_work import Work
from lensfield.engine.runtime.errors import InputError, one_line
from lensfield.engine.runtime.files import stamp_of
from lensfield.engine.sensor.metering import developed_white, metered_rec709

from ...job.named_files import check_named_files
from ...job.photo import ShownExposure
from ...scene.active_camera import camera_settings
from ...scene.camera import SceneFrame, check_camera, frame_px, pixel_aspect, shift_px, size_for_view
from ...scene.focus import Focus, focus_now
from ...scene.lens_cache import lens_on_sensor, load_lens, scaled_lens
from ...scene.lens_facts import lens_facts
from ...scene.requirements import check_scene
from ...scene.rings import rings_for, scene_iris
from ...scene.units import metres_per_unit
from ..common.areas import areas, redraw_panels
from ..common.background import Answers
from ..common.lens_at_rest import facts_at_rest
from ..common.plain_words import plain
from ..common.session import session
from ..common.shown_exposure import exposure_text
from ..common.text_wrap import draw_wrapped
from . import lens_view

QUALITY = "preview"
ONLY_SOLID = "Live shows a panoramic camera in Solid viewports only"
STUDIO_LIGHT = "Live shows the camera's exposure with Scene Lights and Scene World, in the viewport's shading options"
NO_DEPTH = "Live shows no defocus: turn on Viewport Overlays to give this viewport its depth"


@dataclass(frozen=True, eq=False)
class Frame:
    """A lens on the frame of a scene.

    Attributes
    ----------
    tables : LensTables
    tangents : (float, float, float, float)
        Of the angles from the axis to the frame's left, lower, right and upper edge, if its pixels are square.
    focus : Focus
        Of the lens, in pixels of the scene's render.
    f_number_effective : float
    transmittance : float
        For green light.
    """

    tables: LensTables
    tangents: tuple[float, float, float, float]
    focus: Focus
    f_number_effective: float
    transmittance: float


@dataclass
class Live:
    """The state of the live view.

    Attributes
    ----------
    handlers : list
        The draw handlers.
    question : tuple
        Everything that the requested frame depends on.
    answer : Work or None
        Of its Frame.
    shown : (Frame, lens_view.Tables) or None
        The newest frame, on the graphics processor.
    framebuffer : gpu.types.GPUFrameBuffer or None
        The viewport's light, before Blender draws it.
    note : str
        What the view does not show, and why.
    exposure : ShownExposure or None
        Of the camera's body.
    exposed : tuple
        The scene's session_uid and the camera's settings of that exposure.
    """

    handlers: list = field(default_factory=list)
    question: tuple = ()
    answer: Work | None = None
    shown: Any = None
    framebuffer: Any = None
    note: str = ""
    exposure: ShownExposure | None = None
    exposed: tuple = ()

    def shows_exposure_of(self, scene):
        """Whether the view has the exposure of a scene's camera as it is set."""
        return self.exposed == _exposed(scene)


def start(scene):
    """Switch the live view on.

    Raises
    ------
    SceneError
        The scene does not have a camera that a lens can replace.
    """
    check_named_files()
    check_scene(scene)
    session.live, session.live_failure = Live(), ""
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    if not bpy.app.background:
        session.live.handlers = [bpy.types.SpaceView3D.draw_handler_add(handler, (), "WINDOW", when)
                                 for handler, when in ((_remember_framebuffer, "PRE_VIEW"), (_draw, "POST_VIEW"))]
    _evaluate_cameras()
    _redraw()


def end(why=""):
    """Switch the live view off, if it is on; `why` is the reason, if the user did not request it."""
    live, session.live = session.live, None
    if live is None:
        return
    session.live_failure = why
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    for handler in live.handlers:
        bpy.types.SpaceView3D.draw_handler_remove(handler, "WINDOW")
    _frames.forget()
    lens_view.forget()
    _evaluate_cameras()
    _redraw()


def _evaluate_cameras():
    """Let Blender evaluate all cameras again: with its own depth of field only while the view is off."""
    for camera in bpy.data.cameras:
        camera.update_tag()


@persistent
def hide_blenders_blur(scene, depsgraph=None):
    """Switch Blender's own depth of field off in viewports, and redraw them if settings of the scene have changed."""
    if depsgraph is None or depsgraph.mode != "VIEWPORT" or scene.camera is None or scene.camera.type != "CAMERA":
        return
    dof = scene.camera.evaluated_get(depsgraph).data.dof
    if dof.use_dof:
        dof.use_dof = False
    if depsgraph.id_type_updated("SCENE"):
        _redraw()


@persistent
def on_load(*_):
    """Switch the live view off before another file is loaded."""
    end()


_HANDLERS = {"depsgraph_update_post": hide_blenders_blur, "frame_change_post": hide_blenders_blur,
             "load_pre": on_load}


def _redraw():
    for area in areas("PROPERTIES", "VIEW_3D"):
        area.tag_redraw()


def frame_question(scene, at_rest):
    """Everything that a scene's Frame depends on: hashable arguments of `read_frame`.

    Parameters
    ----------
    scene : bpy.types.Scene
    at_rest : LensFacts
        Of the lens with its rings at rest.
    """
    settings = camera_settings(scene)
    name = settings.lens_name_or_path()
    focal_mm = scene.camera.data.lens if settings.view == "CAMERA" else None
    _, sensor_mm = size_for_view(scene, at_rest, settings.view_text())
    if settings.view_text() == LENS_VIEW:
        sensor_mm = None  # at another focus, a lens that states no sensor has another one
    return (name, stamp_of(name), rings_for(scene, name), focal_mm, sensor_mm, frame_px(scene), shift_px(scene),
            scene_iris(scene, name), scene.lensfield.out_of_field == "VIGNETTE")


def read_frame(name, stamp, rings, focal_mm, sensor_mm, shape_px, right_up_px, iris, vignette):
    """The Frame of these arguments, as `frame_question` returns them.

    Raises
    ------
    InputError
        The lens is not available.
    """
    lens = frame_lens(name, rings, SceneFrame(shape_px, right_up_px, sensor_mm, focal_mm))
    grid = PixelGrid(shape_px, fitting_pitch_um(lens, shape_px)).shifted(*right_up_px)
    tables = lens_tables(lens, lens_rays(lens, opening(iris, lens).reach), grid, iris, vignette)
    tangents = tuple(edge_mm / lens.capture_focal_length_mm for edge_mm in grid.edges_mm)
    per_nearness_px_m, nearness_per_m = blur_per_nearness_px(lens, grid.pitch_um) / 1e3, focus_nearness(lens) * 1e3
    lean_per_m = tuple((focus_rise(lens) * 1e3).tolist())
    focus_m = 1 / nearness_per_m if nearness_per_m else inf
    green = field_map(lens).at_wavelength(COLOURS_NM[1])
    return Frame(tables, tangents, Focus(focus_m, per_nearness_px_m, lean_per_m), lens.f_number_effective,
                 green.transmittance)


_frames = Answers(read_frame, most=1)


def frame_lens(name, rings, frame: SceneFrame):
    """The Lens of a scene's frame."""
    facts = lens_facts(name, rings, frame.focal_mm)
    lens = load_lens(name, facts.rings, QUALITY, wavelengths_nm=COLOURS_NM,
                     edges_mm=None if facts.radial else frame.edges_mm(facts))
    if frame.focal_mm is not None:
        return scaled_lens(lens, frame.factor(lens), frame.sensor_mm)
    return lens_on_sensor(lens, frame.sensor_mm) if frame.sensor_mm else lens


def _remember_framebuffer():
    import gpu

    if session.live:
        session.live.framebuffer = gpu.state.active_framebuffer_get()


def _draw():
    live, space, view = session.live, bpy.context.space_data, bpy.context.region_data
    if (live is None or view.view_perspective != "CAMERA" or space.camera is None
            or space.camera != bpy.context.scene.camera or live.framebuffer is None):
        return
    try:
        _draw_frame(live, bpy.context.scene, space, view, bpy.context.region)
    except InputError as error:  # of the scene, which the user can mend
        _report(live, plain(error))
    except Exception as error:  # each redraw would fail again
        traceback.print_exc()
        bpy.app.timers.register(partial(end, one_line(error)))
    finally:
        live.framebuffer = None


def _draw_frame(live, scene, space, view, region):
    check_camera(scene, camera_settings(scene).view_text())
    if space.camera.data.type == "PANO" and space.shading.type != "SOLID":
        _report(live, ONLY_SOLID)
        return
    at_rest = facts_at_rest(scene)
    if at_rest is None:  # the viewports are redrawn once it is read
        return
    frame = _newest(live, frame_question(scene, at_rest))
    if frame is None:
        return
    seen = lens_view.View.of(view.window_matrix, region.width, region.height)
    px_per_tangent = np.multiply(seen.px_per_tangent, (pixel_aspect(scene), 1.0))
    first_px, last_px = (np.multiply(corner, px_per_tangent) + seen.middle_px
                         for corner in (frame.tangents[:2], frame.tangents[2:]))
    frame_rectangle = *first_px, *(last_px - first_px)
    has_depth = lens_view.draw(live.framebuffer, live.shown[1], seen, frame_rectangle,
                               _defocus(scene, live, frame, at_rest, frame_rectangle),
                               transparent=space.shading.type == "SOLID" or scene.render.film_transparent,
                               exposure_of=_metering(live, scene, space, frame))
    _report(live, NO_DEPTH if not has_depth else STUDIO_LIGHT if _is_unexposed(scene, space.shading) else "")


def _is_unexposed(scene, shading):
    """Whether a camera's exposure is not shown, because a studio lights the viewport."""
    return shading.type == "MATERIAL" and bool(_body(scene)) and not _has_scene_light(scene, shading)


def _metering(live, scene, space, frame):
    """The function that meters a viewport's light by the camera's body, notes the exposure, and returns the factor of
    the light; None without a body, or without the light of the scene."""
    camera, film = _body(scene), _film_exposure(scene, space.shading)
    if not (camera and film and _has_scene_light(scene, space.shading)):
        return None
    settings, transmitted = camera_settings(scene), frame.transmittance / film

    def exposure_of(light):
        exposure = metered_rec709(transmitted * light, camera, frame.f_number_effective, settings.iso or None,
                                  settings.shutter_s or None)
        _note_exposure(live, ShownExposure(exposure.shutter_s, exposure.iso), _exposed(scene))
        white = developed_white(camera, exposure, frame.f_number_effective)
        return white * transmitted if scene.lensfield.develop else lens_view.AS_IT_IS

    return exposure_of


def _body(scene):
    """The Camera of a scene's body; None without one."""
    name = camera_settings(scene).body_name_or_path()
    return _loaded_body(name, stamp_of(name)) if name else None


@lru_cache(maxsize=1)
def _loaded_body(name, stamp):
    return load_camera(name)


def _exposed(scene):
    """Everything of a scene's settings that its exposure depends on."""
    settings = camera_settings(scene)
    return scene.session_uid, settings.body, settings.body_file, settings.iso, settings.shutter_s


def _has_scene_light(scene, shading):
    """Whether a viewport has the light of the scene and its world, not of a studio."""
    if shading.type == "RENDERED" and scene.render.engine != "BLENDER_WORKBENCH":
        return shading.use_scene_lights_render and shading.use_scene_world_render
    return shading.type == "MATERIAL" and shading.use_scene_lights and shading.use_scene_world


def _film_exposure(scene, shading):
    """The factor of a viewport's light, which a camera does not have."""
    by_cycles = shading.type == "RENDERED" and scene.render.engine == "CYCLES"
    return scene.cycles.film_exposure if by_cycles else 1.0


def _note_exposure(live, exposure, exposed):
    before, live.exposure, live.exposed = live.exposure, exposure, exposed
    if before is None or exposure_text(*astuple(before)) != exposure_text(*astuple(exposure)):
        bpy.app.timers.register(redraw_panels, first_interval=0.0)  # not while a region is drawn


def _report(live, note):
    """Show a note in the panels, or none."""
    if note != live.note:
        live.note = note
        for area in areas("PROPERTIES"):  # in viewports, the panel is being drawn
            area.tag_redraw()


def _newest(live, question):
    """The newest Frame for a question, or the one before; None without one."""
    live.question, live.answer = question, _frames.to(*question)
    if live.answer.done():
        frame = live.answer.result()
        if live.shown is None or live.shown[0] is not frame:
            live.shown = frame, lens_view.Tables(frame.tables)
    return live.shown[0] if live.shown else None


def _defocus(scene, live, frame, at_rest, frame_rectangle):
    """The Defocus of the newest frame's lens; while a ring turns, to first order."""
    focus, (rows, _) = frame.focus if live.answer.done() else focus_now(scene, at_rest), frame_px(scene)
    *_, height_px = frame_rectangle
    return lens_view.Defocus(focus.blur_px_m * height_px / rows, 1 / focus.focus_m, focus.lean_per_m,
                             metres_per_unit(scene))


def draw_live(layout):
    """Draw the live view's button."""
    layout.operator("lensfield.live", icon="SHADING_RENDERED", depress=session.live is not None)


def draw_live_status(layout):
    """Draw the reason for a failure of the live view, or its note."""
    text = session.live.note if session.live else session.live_failure and f"Live switched off: {session.live_failure}"
    if text:
        draw_wrapped(layout, text, "ERROR" if session.live is None else "INFO")


class LENSFIELD_OT_live(bpy.types.Operator):
    """Show the camera's view through the lens in 3D viewports while you work: distortion, lateral colour, relative
    illumination, and defocus by depth, in any shading and without a render"""

    bl_idname = "lensfield.live"
    bl_label = "Live"

    def execute(self, context):
        if session.live:
            end()
            return {"FINISHED"}
        try:
            start(context.scene)
        except (InputError, OSError) as error:
            self.report({"ERROR"}, plain(error))
            return {"CANCELLED"}
        return {"FINISHED"}


classes = (LENSFIELD_OT_live,)
