"""Panels: the lens render in the render properties and the sidebar; spectra on materials, lights and worlds."""

import os

import bpy

from ...engine.errors import InputError
from ..job.bands import pass_count
from ..scene.camera import frame_px, lens_for_view, pitch_um
from ..scene.lens_cache import load_lens
from . import operators
from .animation import draw_animation
from .another_lens import draw_another_lens
from .compositor_panel import draw_compositor
from .preview import draw_preview
from .previews import growing_preview, sheet_path, sheet_preview
from .properties import FROM_FILE
from .window_render import state
from .wrapped import PANEL_MARGINS, draw_wrapped, region_widgets


def draw_settings(layout, scene):
    """The settings of a scene, the same in both places; above them the render under way, or what became of it."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    if state["render"]:
        _draw_under_way(layout.box(), state["render"])
    elif state["notice"]:
        _draw_notice(layout.box().column(align=True))
    settings = scene.lensfield
    layout.prop(settings, "lens")
    if settings.lens == FROM_FILE:
        layout.prop(settings, "lens_file")
    _draw_lens_facts(layout, scene)
    layout.separator()
    _draw_wavelengths(layout, settings)
    layout.separator()
    _draw_quality(layout, settings)
    layout.prop(settings, "out_of_field")
    layout.prop(settings, "fireflies")
    layout.prop(settings, "unfit")
    layout.separator()
    layout.prop_search(settings, "view_layer", scene, "view_layers")
    layout.prop(settings, "denoise")
    layout.prop(settings, "output_folder")
    draw_compositor(layout, scene)
    row = layout.row()
    row.scale_y = 1.5
    row.operator("lensfield.render", icon="RENDER_STILL")
    draw_animation(layout, scene)
    draw_another_lens(layout)
    draw_preview(layout)


def _draw_under_way(layout, render):
    row = layout.row(align=True)
    row.progress(factor=render.fraction, text=f"{render.fraction:.0%}")
    row.operator_context = "INVOKE_DEFAULT"  # here, not in the 3D view
    row.operator("lensfield.cancel", text="", icon="CANCEL")
    draw_wrapped(layout.column(align=True), render.label)
    if render.picture.is_file():
        layout.template_icon(icon_value=growing_preview(render.picture).icon_id, scale=_picture_scale())


def _draw_notice(layout):
    first, *others = state["notice"]
    draw_wrapped(layout, first, state["icon"])
    for line in others:
        draw_wrapped(layout, line, "BLANK1")


def _draw_lens_facts(layout, scene):
    settings = scene.lensfield
    path = settings.lens_name_or_path()
    if not path:
        return
    try:
        lens = load_lens(path)
    except InputError as error:
        layout.label(text=str(error), icon="ERROR")
        return
    _draw_view(layout, scene, lens)
    _draw_sheet(layout, path)


def _draw_view(layout, scene, lens):
    """What the picture will show, and what that takes."""
    layout.prop(scene.lensfield, "view")
    try:
        lens, warning = lens_for_view(scene, lens, scene.lensfield.view.lower())
    except InputError as error:
        layout.label(text=str(error), icon="ERROR")
        return
    frame = frame_px(scene)
    column = layout.column(align=True)
    column.label(text=f"f = {lens.efl_mm:.2f} mm, f/{lens.f_number_effective:.2f}, "
                      f"sensor {lens.sensor_mm[0]:g} x {lens.sensor_mm[1]:g} mm")
    column.label(text=f"{frame[1]} x {frame[0]} px of {pitch_um(lens, frame):.2f} \u00b5m")
    if warning:
        column.label(text=warning, icon="ERROR")
    else:
        column.operator("lensfield.match_camera", icon="CAMERA_DATA")


def _draw_sheet(layout, name_or_path):
    """The picture of what the lens does, in a part of the panel that can be folded."""
    path = sheet_path(name_or_path)
    drawn = path.is_file()
    header, body = layout.panel("lensfield_sheet")
    header.label(text="Lens Sheet" if drawn else "Lens Sheet: to draw it, run")
    if body is None:
        return
    if not drawn:
        body.label(text=f"lensfield lens plot {os.path.basename(name_or_path)}", icon="CONSOLE")
        return
    try:
        preview = sheet_preview(path)
    except InputError as error:
        body.label(text=str(error), icon="ERROR")
        return
    body.template_icon(icon_value=preview.icon_id, scale=_picture_scale())
    body.operator("lensfield.show_sheet", icon="IMAGE_DATA")


def _picture_scale():
    """What makes a square icon as wide as the panel, in units of Blender's widgets."""
    return max(1, region_widgets() - PANEL_MARGINS)


def _draw_wavelengths(layout, settings):
    layout.prop(settings, "wavelength_mode", expand=True)
    if settings.wavelength_mode == "LIST":
        layout.prop(settings, "wavelength_list")
    else:
        column = layout.column(align=True)
        column.prop(settings, "wavelength_first_nm", text="First (nm)")
        column.prop(settings, "wavelength_last_nm", text="Last (nm)")
        column.prop(settings, "wavelength_count")
    _draw_spectra(layout, settings)


def _draw_spectra(layout, settings):
    layout.prop(settings, "tier")
    if settings.tier == "RESULT":
        layout.prop(settings, "colour_error")
    try:
        count = len(settings.wavelengths_nm())
    except InputError as error:
        layout.label(text=error.remedy, icon="ERROR")
        return
    most = pass_count(count)
    renders = f"1 to {most}" if settings.tier in ("STANDARD", "RESULT") and most > 1 else most
    layout.label(text=f"{count} wavelength{'s' * (count > 1)}: {1 if settings.tier == 'PREVIEW' else renders} Cycles "
                      f"render{'s' * (most > 1 and settings.tier != 'PREVIEW')}")
    if count > 1 and settings.tier != "PREVIEW":
        layout.label(text=f"{count} where glass disperses")


def _draw_quality(layout, settings):
    layout.prop(settings, "quality", expand=True)
    if settings.quality == "KNOBS":
        for name in ("method", *settings.shown_knobs()):
            layout.prop(settings, name)
        return
    column = layout.column(align=True)
    column.prop(settings, "accuracy", slider=True)
    row = column.row(align=True)
    for name in operators.ACCURACIES:
        row.operator("lensfield.set_accuracy", text=name.capitalize()).preset = name


class _SettingsPanel:
    bl_label = "Lensfield"

    def draw(self, context):
        draw_settings(self.layout, context.scene)


class LENSFIELD_PT_render(_SettingsPanel, bpy.types.Panel):
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


class LENSFIELD_PT_sidebar(_SettingsPanel, bpy.types.Panel):
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Lensfield"


class _SpectraPanel:
    bl_label = "Lensfield Spectra"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return cls.data_block(context) is not None

    def draw(self, context):
        self.layout.use_property_split = True
        spectra = self.data_block(context).lensfield
        for field in self.fields(spectra):
            self.layout.prop(spectra, field)


class LENSFIELD_PT_material(_SpectraPanel, bpy.types.Panel):
    bl_context = "material"

    @staticmethod
    def data_block(context):
        return context.material

    @staticmethod
    def fields(spectra):
        return "reflectance", "emission", "refraction"


class LENSFIELD_PT_light(_SpectraPanel, bpy.types.Panel):
    bl_context = "data"

    @staticmethod
    def data_block(context):
        return context.light

    @staticmethod
    def fields(spectra):
        return ("emission", "power_unit") + (("lumens",) if spectra.power_unit == "LUMEN" else ())


class LENSFIELD_PT_world(_SpectraPanel, bpy.types.Panel):
    bl_context = "world"

    @staticmethod
    def data_block(context):
        return context.world

    @staticmethod
    def fields(spectra):
        return ("emission",)


classes = (LENSFIELD_PT_render, LENSFIELD_PT_sidebar, LENSFIELD_PT_material, LENSFIELD_PT_light, LENSFIELD_PT_world)
