"""The Lensfield panel, in the render properties and in the sidebar of the 3D view; and the panel of a camera, in its
properties, with its lens and its body.

From the top, always in the same places: the lens of the active camera, its focus and f-stop, the buttons, and the
status. Everything else is in subpanels, closed by default.
"""

import os
from dataclasses import replace
from math import isinf

import bpy

from lensfield.engine.field.overscan import LENS_VIEW
from lensfield.engine.lens.formats import crop_factor
from lensfield.engine.library import has_rings
from lensfield.engine.runtime.errors import InputError

from ..capture.remarks import MANY_SAMPLES, SAME_VIEW
from ..job.job import folder_for, is_temporary
from ..job.named_files import FROM_FILE, named_files
from ..job.result import Result
from ..scene.active_camera import camera_data, camera_settings
from ..scene.camera import (
    COMPLETE,
    FISHEYE_TYPE,
    frame_grid,
    frame_px,
    is_panorama_of,
    matching_focal_length_mm,
    size_for_view,
)
from ..scene.requirements import check_scene
from ..scene.rings import FEWEST_BLADES
from .animation import draw_animation
from .another_lens import draw_another_lens
from .camera_panel import draw_camera, draw_exposure
from .camera_presets import draw_presets
from .common.lens_worker import lens_request, requested_lens
from .common.listed_settings import draw_listed
from .common.panel_pictures import draw_picture
from .common.plain_words import plain_line
from .common.previews import growing_preview, sheet_preview
from .common.properties import lens_title
from .common.session import session
from .common.text_wrap import draw_wrapped
from .comparison import CHOOSE, draw_compare
from .compositor_panel import draw_compositor, draw_shown
from .favourites import draw_favourite
from .fit_lens import MARK, agreement_of, agreement_text, draw_fit
from .fixes import draw_refusal
from .lint_panel import draw_check
from .live.live import draw_live, draw_live_status
from .live.quick_look import draw_quick_look
from .open_measured import draw_open_measured
from .plan_line import plan_text
from .preview.preview_panel import draw_preview, draw_preview_status
from .sheets import drawn_sheet, stored_sheet
from .trust_panel import draw_named_files

OF_CAMERA = "view", "body", "sheet"  # the parts that need a camera
LENS_PICTURE, OFFERED_PICTURE = 6, 8  # widgets
STATUS_LINES = 2


def draw_settings(layout, scene):
    """Draw the complete panel for a scene, the same in every editor."""
    camera = camera_data(scene)
    if _draw_untrusted(layout, camera):
        if session.render:
            _draw_progress(layout, session.render)
            _draw_stage(layout, session.render)
        return
    if camera:
        _draw_lens(layout, scene, camera)
        _draw_rings(layout, camera)
    _draw_buttons(layout, scene)
    refusal = _draw_status(layout, scene)
    _draw_notes(layout, scene, refusal)
    header, body = layout.panel("lensfield_notice")
    header.label(text="Last Render", icon=session.last_render.icon if session.last_render.lines else "NONE")
    if body:
        _draw_last(body)
    for name, title, draw in _PARTS:
        if name in OF_CAMERA and not camera:
            continue
        header, body = layout.panel(f"lensfield_{name}", default_closed=True)
        header.label(text=title)
        if name == "body":
            draw_exposure(header, scene, camera)
        if body:
            draw(body, scene)


def draw_camera_settings(layout, scene, camera):
    """Draw the panel of a camera, which may differ from the scene's camera."""
    if _draw_untrusted(layout, camera):
        return
    _draw_lens(layout, scene, camera)
    _draw_rings(layout, camera)
    if camera != camera_data(scene):
        layout.label(text="Not the scene's active camera", icon="INFO")
    for name, title, draw in (("lens", "Field of View and Copy", _draw_view), ("body", "Camera", draw_camera)):
        header, body = layout.panel(f"lensfield_camera_{name}", default_closed=True)
        header.label(text=title)
        if body:
            draw(body, scene, camera)


def _draw_untrusted(layout, camera):
    """Set a panel up. If the .blend names files that the user has not chosen, draw these instead; returns whether."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    if named := named_files():
        draw_named_files(layout, named)
        if camera and camera.lensfield.lens == FROM_FILE:
            layout.prop(camera.lensfield, "lens", text="Other Lens")
    return bool(named)


def _draw_lens(layout, scene, camera):
    """Draw the lens: its picture or file, its name, which opens a search, and its main figures."""
    settings = camera.lensfield
    if settings.lens == FROM_FILE:
        layout.prop(settings, "lens_file")
        column = layout.column(align=True)
        draw_open_measured(column)
        if settings.lens_file:
            options = column.operator("lensfield.open_lens", text="Lens File Options", icon="OPTIONS")
            options.filepath = settings.lens_name_or_path()
            draw_fit(column)
    else:
        layout.template_icon_view(settings, "lens", show_labels=True, scale=LENS_PICTURE,
                                  scale_popup=OFFERED_PICTURE)
    row = layout.row(align=True)
    row.operator("lensfield.search_lens", text=lens_title(settings.lens_text()) or "Choose Lens", icon="VIEWZOOM")
    draw_favourite(row, settings.lens)
    if camera != camera_data(scene):
        return
    facts = _facts(scene)
    row = layout.row()
    row.label(text=_figures(*facts) if facts else "")
    if agreement_of(scene):
        row.operator("lensfield.show_sheet", text="", icon=MARK, emboss=False)
    if facts and facts[0].source:
        draw_wrapped(layout.column(align=True), facts[0].source, "INFO")
    if facts and facts[0].squeeze != 1:
        layout.label(text=f"{facts[0].squeeze:.2f}\u00d7 anamorphic squeeze")
    draw_compare(layout)


def _facts(scene):
    """LensFacts, their scale in this scene, the sensor's sides in mm, and the frame's PixelGrid; None without them."""
    try:
        settings = camera_settings(scene)
        facts = lens_request(scene).facts if settings.lens_text() else None
        if not facts:
            return None
        factor, sensor_mm = size_for_view(scene, facts, settings.view_text())
        return facts, factor, sensor_mm, frame_grid(scene, replace(facts, sensor_mm=sensor_mm))
    except InputError:  # `_draw_status` shows it
        return None


def _figures(facts, factor, sensor_mm, _):
    """Focal length, f-number and sensor of a lens, as photographers write them."""
    return "{:.3g} mm \u00b7 f/{:.3g} \u00b7 {:.3g} \u00d7 {:.3g} mm".format(
        facts.efl_mm * factor, facts.f_number, *sensor_mm)


def _draw_rings(layout, camera):
    """Draw focus and f-stop, the camera's Depth of Field, which controls lenses with rings."""
    settings, dof = camera.lensfield, camera.dof
    column = layout.column(align=True)
    column.active = has_rings(settings.lens_name_or_path())
    row = column.row()
    row.use_property_split = False  # to leave room for the long label
    row.prop(dof, "use_dof", text="Use Camera's Depth of Field")
    column.operator("lensfield.click_focus", icon="EYEDROPPER")
    rings = column.column(align=True)
    rings.active = dof.use_dof
    rings.prop(dof, "focus_object", text="Focus on")
    distance = rings.column()
    distance.active = dof.focus_object is None
    distance.prop(dof, "focus_distance", text="Distance")
    rings.prop(dof, "aperture_fstop", text="F-Stop")


def _draw_buttons(layout, scene):
    """Draw the buttons, with the progress of a running render in place of the main one."""
    pair = layout.split(factor=0.5, align=True)
    draw_preview(pair)
    draw_live(pair)
    if session.render:
        _draw_progress(layout, session.render)
    else:
        row = layout.row(align=True)
        row.scale_y = 1.5
        row.operator("lensfield.render", icon="RENDER_STILL")
    draw_animation(layout, scene)


def _draw_status(layout, scene):
    """Draw the status: the stage of a running render, the progress of the bake, what a render takes, or why it is
    refused; returns the refusal, or None. It has at least two lines, so that sections rarely move."""
    if session.render:
        _draw_stage(layout, session.render)
        return None
    column = layout.column(align=True)
    try:
        check_scene(scene)
        if not camera_settings(scene).lens_text():
            draw_wrapped(column, "Choose a lens", "INFO", least_lines=STATUS_LINES)
            return None
        lens, request = requested_lens(scene), lens_request(scene)
        if lens is None:
            column.progress(factor=request.fraction, text=request.label)
            column.label()
        else:
            draw_wrapped(column, plan_text(scene, lens), "TIME", least_lines=STATUS_LINES)
    except InputError as error:
        draw_refusal(column, error)
        return error
    return None


def _draw_notes(layout, scene, refusal):
    """Draw what the user should know before a render, next to a refusal, if any."""
    draw_preview_status(layout, refusal)
    draw_live_status(layout)
    column = layout.column(align=True)
    if facts := _facts(scene):
        for word in facts[0].words:
            draw_wrapped(column, word, "INFO")
        shifted, covered = not facts[3].centred, _field_of_view(*facts)[2]
        if (shifted or camera_settings(scene).view_text() != LENS_VIEW) and covered < COMPLETE:
            way = "way to the shifted picture's farthest corner" if shifted else "picture's diagonal"
            draw_wrapped(column, f"The lens covers {covered:.0%} of the {way}", "INFO")
        if camera_settings(scene).view != "CAMERA" and not _sees_alike(scene, replace(facts[0], sensor_mm=facts[2])):
            draw_wrapped(column, "Your camera has a different field of view", "INFO")
            column.operator("lensfield.match_camera", icon="CAMERA_DATA")
    if scene.cycles.samples >= MANY_SAMPLES:
        draw_wrapped(column, f"{scene.cycles.samples} samples per render may take hours", "ERROR")
        column.operator("lensfield.sensible_samples", icon="LIGHT_DATA")
    draw_shown(layout, scene)


def _draw_view_and_depth(layout, scene):
    _draw_view(layout, scene, camera_data(scene))
    layout.prop(scene.lensfield, "depth")
    layout.column().prop(scene.lensfield, "out_of_field", expand=True)


def _draw_view(layout, scene, camera):
    """Draw a lens's view, its limits, shift and tilt, the copy, the coating, and the iris."""
    settings, dof = camera.lensfield, camera.dof
    layout.prop(settings, "view")
    if settings.view == "SENSOR":
        layout.prop(settings, "sensor_mm")
    if facts := camera == camera_data(scene) and _facts(scene):
        across_deg, up_deg, _ = _field_of_view(*facts)
        view = f"{across_deg:.3g}\u00b0 \u00d7 {up_deg:.3g}\u00b0, crop factor {crop_factor(facts[2]):.3g}"
        for line in (view, *_limits(*facts)):
            draw_wrapped(layout, line)
    shift = layout.column(align=True)
    shift.prop(camera, "shift_x")
    shift.prop(camera, "shift_y", text="Y")
    if not has_rings(settings.lens_name_or_path()):
        return
    layout.column(align=True).prop(settings, "tilt_deg")
    layout.prop(settings, "focused_wide_open")
    copy = layout.column(align=True)
    copy.prop(settings, "copy")
    if settings.copy:
        copy.prop(settings, "copy_grade")
    layout.prop(settings, "coating")
    blades = layout.column(align=True)
    blades.prop(dof, "aperture_blades", text="Iris Blades")
    if dof.aperture_blades >= FEWEST_BLADES:
        blades.prop(dof, "aperture_rotation", text="Rotation")
        blades.prop(settings, "iris_roundness")


def _field_of_view(lens, factor, _, frame):
    """The `LensFacts.field_on` of the frame."""
    return lens.field_on([edge_mm / factor for edge_mm in frame.edges_mm])


def _limits(facts, factor, *_):
    """Lines on the focus of a lens, the range of its rings, and its scale."""
    yield f"Focused {'at infinity' if isinf(facts.focus_mm) else f'at {facts.focus_mm * factor * 1e-3:.3g} m'}"
    if facts.reach:
        widest, highest, closest_mm = facts.reach
        stops = f"f/{widest:.3g} to f/{highest:.3g}" if highest > widest else f"f/{widest:.3g} only"
        yield f"{stops}, closest focus {closest_mm * factor * 1e-3:.3g} m"
    else:
        yield "Fixed focus and f-stop"
    if factor != 1:
        yield f"Lens and blur scaled {factor:.3g}\u00d7 to match the camera"


def _sees_alike(scene, facts):
    """Whether the scene's camera has the view of LensFacts, within SAME_VIEW."""
    if scene.camera.type != "CAMERA":
        return False
    camera = scene.camera.data
    if camera.type != "PANO" or camera.panorama_type != FISHEYE_TYPE:
        return camera.type == "PERSP" and abs(matching_focal_length_mm(scene, facts) / camera.lens - 1) <= SAME_VIEW
    return is_panorama_of(facts, camera, frame_grid(scene, facts), SAME_VIEW)


def _draw_last(layout):
    """Draw the picture of the last render and its report, with file names instead of complete paths; and the button
    that applies another lens to it."""
    draw_another_lens(layout)
    if session.render:
        return
    image, sheet = session.last_render.lens_image, session.last_render.sheet
    picture = sheet or (image and Result.from_file(image, "lens_image").after)
    if picture and picture.is_file():
        draw_picture(layout, growing_preview, picture)
        layout.operator("lensfield.show_picture", icon="IMAGE_DATA")
        if sheet:
            draw_wrapped(layout, CHOOSE, "RESTRICT_SELECT_OFF")
    column, shown = layout.column(align=True), session.last_render.picture
    for line in session.last_render.lines:
        draw_wrapped(column, plain_line(line.replace(f"{shown.parent}{os.sep}", "") if shown else line), "DOT")


def _draw_progress(layout, render):
    """Draw the progress of a running render, and the button that cancels it."""
    row = layout.row(align=True)
    row.scale_y = 1.5
    row.progress(factor=render.fraction, text=f"{render.fraction:.0%}")
    row.operator_context = "INVOKE_DEFAULT"  # invoke in this region, not in the 3D view
    row.operator("lensfield.cancel", text="", icon="CANCEL")


def _draw_stage(layout, render):
    """Draw the stage of a running render, and the light so far."""
    draw_wrapped(layout.column(align=True), render.label, least_lines=STATUS_LINES)
    if render.picture.is_file():
        draw_picture(layout, growing_preview, render.picture)


def _draw_sheet(layout, scene):
    """Draw how closely the lens agrees with photographs, and its sheet at the current focus and f-stop."""
    if text := agreement_text(scene):
        draw_wrapped(layout.column(align=True), text, MARK)
    draw_fit(layout)
    try:
        path = _sheet(scene)
    except InputError as error:
        draw_wrapped(layout, str(error), "ERROR")
        return
    if not path:
        draw_wrapped(layout, "The sheet appears once the lens is baked", "INFO")
        return
    draw_picture(layout, sheet_preview, path)
    layout.operator("lensfield.show_sheet", icon="IMAGE_DATA")


def _sheet(scene):
    """The file of the lens sheet; None until it is drawn."""
    name = camera_settings(scene).lens_name_or_path()
    if not name or (stored := stored_sheet(name)):
        return name and stored
    lens = requested_lens(scene)
    return lens and drawn_sheet(lens, agreement_of(scene))


def _draw_stray(layout, scene):
    settings = scene.lensfield
    layout.prop(settings, "stray_light")
    if settings.stray_light == "PARTS":
        layout.prop(settings, "stray_parts")
    column = layout.column()
    column.active = settings.stray_light != "OFF"
    draw_listed(column, scene, "stray")


def _draw_wavelengths(layout, scene):
    settings = scene.lensfield
    layout.prop(settings, "wavelength_mode", expand=True)
    if settings.wavelength_mode == "LIST":
        layout.prop(settings, "wavelength_list")
    else:
        column = layout.column(align=True)
        column.prop(settings, "wavelength_first_nm", text="First (nm)")
        column.prop(settings, "wavelength_last_nm", text="Last (nm)")
        column.prop(settings, "wavelength_count")
    draw_listed(layout, scene, "wavelengths")


def _draw_quality(layout, scene):
    settings = scene.lensfield
    layout.prop(settings, "tier")
    if settings.tier == "RESULT":
        layout.prop(settings, "colour_error")
        layout.prop(settings, "quality", expand=True)
        if settings.quality == "KNOBS":
            for name in ("method", *settings.shown_knobs()):
                layout.prop(settings, name)
        else:
            layout.prop(settings, "accuracy", slider=True)
        layout.prop(settings, "supersampling")
    draw_listed(layout, scene, "quality")


def _draw_output(layout, scene):
    settings = scene.lensfield
    layout.prop(settings, "output_folder")
    layout.prop(settings, "files")
    layout.column(heading="Ground Truth").prop(settings, "truth")
    if is_temporary(settings.output_folder):
        draw_wrapped(layout.column(align=True), f"File not saved: pictures go to {folder_for(scene)}", "INFO")
    if facts := _facts(scene):
        rows, columns = frame_px(scene)
        layout.label(text=f"{columns} \u00d7 {rows} px, pixel pitch {facts[3].pitch_um:.2f} \u00b5m")
    layout.prop_search(settings, "view_layer", scene, "view_layers")
    draw_compositor(layout, scene)
    draw_quick_look(layout, scene)


def _draw_body(layout, scene):
    draw_camera(layout, scene, camera_data(scene))


_PARTS = (("view", "View and Depth", _draw_view_and_depth), ("stray", "Stray Light", _draw_stray),
          ("body", "Camera", _draw_body), ("sheet", "Lens Sheet", _draw_sheet),
          ("wavelengths", "Wavelengths and Spectra", _draw_wavelengths), ("quality", "Quality", _draw_quality),
          ("check", "Scene Check", draw_check), ("output", "Output", _draw_output))


class _Panel:
    bl_label = "Lensfield"

    def draw_header_preset(self, context):
        draw_presets(self.layout, context)

    def draw(self, context):
        draw_settings(self.layout, context.scene)


class LENSFIELD_PT_render(_Panel, bpy.types.Panel):
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


class LENSFIELD_PT_camera(_Panel, bpy.types.Panel):
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "data"

    @classmethod
    def poll(cls, context):
        return context.camera is not None

    def draw(self, context):
        draw_camera_settings(self.layout, context.scene, context.camera)


class LENSFIELD_PT_sidebar(_Panel, bpy.types.Panel):
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Lensfield"


classes = (LENSFIELD_PT_render, LENSFIELD_PT_camera, LENSFIELD_PT_sidebar)
