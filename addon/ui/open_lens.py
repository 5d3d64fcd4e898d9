"""Opening a lens file: the operator, its dialog with a drawing of the lens, and files dropped on a window.

The dialog asks only for what the file does not state. It stores nothing but the answers: each time it is drawn, its
questions and its drawing follow from them and from the file.
"""

import os
from dataclasses import replace
from functools import lru_cache
from math import degrees, isinf, radians
from pathlib import Path
from typing import NamedTuple

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from lensfield.engine.inspection.cross_section import cross_section
from lensfield.engine.library import has_rings
from lensfield.engine.prescription.glasses import glass_names, similar_glasses
from lensfield.engine.prescription.prescription import Prescription
from lensfield.engine.prescription.readers import SUFFIXES, ReadingOptions, read_prescription
from lensfield.engine.prescription.readers.reading import F_NUMBER, FOCAL_LENGTH
from lensfield.engine.prescription.system import System, system_of, unknown_glasses
from lensfield.engine.rays.field_heights import image_radius_mm
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.rings import turned
from lensfield.engine.runtime.errors import InputError, one_line
from lensfield.engine.runtime.files import stamp_of
from lensfield.engine.runtime.inputs import note_who_names

from ..job.named_files import FROM_FILE
from ..scene.active_camera import settings_to_edit
from ..scene.lens_file import lens_file_for_scene
from .common.previews import drawing_preview
from .common.text_wrap import WIDGET_PX, draw_wrapped

WIDTH_PX = 560  # of the dialog, at Blender's default scale
PICTURE = 13  # widgets
DRAWING_PX = 520  # twice the size, for large screens
DROPPED_ON = "VIEW_3D", "PROPERTIES", "IMAGE_EDITOR"
STOPS = "stop", "AS"  # ends of fields in errors about a missing stop
FROM_THE_FILE, ANGLE, HEIGHT = "FILE", "ANGLE", "HEIGHT"
ANSWERED = "--which", FOCAL_LENGTH, F_NUMBER  # fields of errors for which the dialog has a question
OPTICAL_BENCH = ".txt"  # its positions have a default, so no error asks for one
MOST_OPENED = 32


class Opened(NamedTuple):
    """A lens file read by some options.

    Attributes
    ----------
    prescription : Prescription or None
    system : System or None
        Focused and wide open; at the paraxial focus if it cannot be focused.
    lines : tuple of str
        Its main figures.
    error : InputError or None
        Why something is missing.
    """

    prescription: Prescription | None = None
    system: System | None = None
    lines: tuple[str, ...] = ()
    error: InputError | None = None


def opened(path, options):
    """The Opened of a file, cached until the file changes."""
    return _opened(path, stamp_of(path), options)


@lru_cache(maxsize=MOST_OPENED)
def _opened(path, changed, options):
    prescription = system = None
    try:
        prescription = read_prescription(path, options)
        system = build_system(replace(prescription, focus="paraxial"))  # even if it cannot be focused on its field
        lens = turned(prescription)
        system = system_of(lens.prescription)
        return Opened(prescription, system, tuple(_figures(lens, system)))
    except InputError as error:
        return Opened(prescription, system, error=error.at(os.path.basename(path)))


def _figures(lens, system):
    yield lens.prescription.name
    yield f"{system.efl_mm:.4g} mm \u00b7 f/{lens.f_number:.3g}"
    end = abs(system.fields_of([system.last_height_mm])[0])
    yield f"Field \u00b1{degrees(end):.3g}\u00b0" if system.object_at_infinity else f"Field \u00b1{end:.4g} mm"
    yield f"Image circle {2 * image_radius_mm(system):.3g} mm"
    if lens.prescription.sensor_mm:
        yield "Sensor {:.3g} \u00d7 {:.3g} mm".format(*lens.prescription.sensor_mm)
    yield f"Focused {'at infinity' if isinf(lens.focus_mm) else f'at {lens.focus_mm * 1e-3:.3g} m'}"


def _suggested_glasses(self, context, typed):
    names = dict.fromkeys((*similar_glasses(self.name), *(glass_names() if typed else ())))
    return [name for name in names if typed.lower() in name.lower()]


class LensfieldGlass(bpy.types.PropertyGroup):
    """A glass of a file that is in no catalogue (`name`), and the glass to use instead."""

    glass: StringProperty(
        name="Glass", search=_suggested_glasses, search_options={"SUGGESTION"},
        description="Glass to use instead: its name in a catalogue, or its index and Abbe number, such as 1.67/47.1")


class LENSFIELD_OT_open_lens(bpy.types.Operator):
    """Render through the lens in this file: a prescription of Lensfield or of another program, or a lens package. A
    dialog draws the lens and asks for what the file does not state. The answers are stored with the lens in a new file
    next to the .blend"""

    bl_idname = "lensfield.open_lens"
    bl_label = "Open Lens File"
    bl_options = {"UNDO", "INTERNAL"}  # a search would offer it without a file

    filepath: StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    which: StringProperty(
        name="Number", options={"SKIP_SAVE"},
        description="Which lens, or which zoom and focus position, to use if the file contains several")
    field_kind: EnumProperty(
        name="End of the Field", default=FROM_THE_FILE, options={"SKIP_SAVE"},
        description="Limit of the lens's field, which its picture fills",
        items=[(FROM_THE_FILE, "As in the File", "The file states it"),
               (ANGLE, "Half Angle", "The largest angle of light to the axis"),
               (HEIGHT, "Image Height", "The largest paraxial image height: half the diameter of the circle")])
    field_angle: FloatProperty(
        name="Half Angle", subtype="ANGLE", default=radians(20), min=radians(0.1), max=radians(89.9),
        options={"SKIP_SAVE"}, description="Angle to the axis at the edge of the field")
    field_height: FloatProperty(
        name="Image Height (mm)", default=21.6, min=0.001, soft_max=100, options={"SKIP_SAVE"},
        description="Paraxial image height at the edge of the field: 21.6 mm for full frame")
    stop: IntProperty(name="Surface of the Stop", default=0, min=0, options={"SKIP_SAVE"},
                      description="Number of the surface that is the aperture stop. 0: as in the file")
    image_plane: EnumProperty(
        name="Image Plane", default=FROM_THE_FILE, options={"SKIP_SAVE"},
        description="Position of the image plane when the lens is focused as in its file",
        items=[(FROM_THE_FILE, "As in the File", "Where the file has it"),
               ("BEST", "Sharpest", "At the sharpest focus on the axis"),
               ("FIELD", "Sharpest over the Field", "At the most concentrated light over the inner 70 % of the field"),
               ("PARAXIAL", "Paraxial", "At the paraxial focus")])
    glasses: CollectionProperty(type=LensfieldGlass, options={"SKIP_SAVE"})
    allow_mismatch: BoolProperty(
        name="Accept the Surfaces", options={"SKIP_SAVE"},
        description="Use the surfaces even if they contradict the focal length or f-number in the file")

    def invoke(self, context, event):
        self.filepath = self._path()
        if not has_rings(self.filepath):  # a package states everything
            return self.execute(context)
        self.check(context)
        lens = opened(self.filepath, reading_options(self))
        if lens.error and not lens.prescription and lens.error.field not in ANSWERED:
            self.report({"ERROR"}, one_line(lens.error))
            return {"CANCELLED"}
        return context.window_manager.invoke_props_dialog(
            self, width=WIDTH_PX, title=os.path.basename(self.filepath), confirm_text="Use Lens")

    def _path(self):
        """The absolute path of the file, which the user names: errors may quote it."""
        path = bpy.path.abspath(self.filepath)
        note_who_names(path, None)
        return path

    def check(self, context):
        """Add the questions that the file leaves open; Blender calls it after each answer."""
        ask(self)
        return True

    def draw(self, context):
        draw_opened(self.layout, self)

    def execute(self, context):
        try:
            settings = settings_to_edit(context)
            settings.lens_file = lens_file_for_scene(self._path(), reading_options(self))
        except (InputError, OSError) as error:
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        settings.lens = FROM_FILE
        self.report({"INFO"}, f"Lens: {settings.lens_file}")
        return {"FINISHED"}


def reading_options(answers):
    """The ReadingOptions of the operator's answers."""
    field = {ANGLE: ("angle_deg", round(degrees(answers.field_angle), 4)),
             HEIGHT: ("image_height_mm", round(answers.field_height, 4))}
    return ReadingOptions(
        field.get(answers.field_kind), answers.which or None,
        glasses=tuple(f"{each.name}={each.glass}" for each in answers.glasses if each.glass),
        stop=answers.stop or None,
        image_plane=None if answers.image_plane == FROM_THE_FILE else answers.image_plane.lower(),
        allow_mismatch=answers.allow_mismatch)


def ask(answers):
    """Add questions to the operator's answers: the end of the field, the stop, the image plane, and each unknown glass
    of the file, with the index and Abbe number that the file gives for it, if any."""
    while True:
        lens = opened(answers.filepath, reading_options(answers)._replace(glasses=(), allow_mismatch=True))
        lacking = lens.error.field if lens.error else ""
        if lacking == "field" and answers.field_kind == FROM_THE_FILE:
            answers.field_kind = ANGLE
        elif lacking.endswith(STOPS) and not answers.stop:
            answers.stop = 1
        elif lacking.endswith("thickness_mm") and answers.image_plane == FROM_THE_FILE:  # not behind the lens
            answers.image_plane = "BEST"
        else:
            break
    if not lens.prescription:
        return
    unknown = unknown_glasses(lens.prescription)
    for index in reversed(range(len(answers.glasses))):  # of another lens in the file
        if answers.glasses[index].name not in unknown:
            answers.glasses.remove(index)
    for name in [name for name in unknown if name not in answers.glasses]:
        glass = answers.glasses.add()
        glass.name, glass.glass = name, unknown[name]


def draw_opened(layout, answers):
    """Draw the lens, its figures, the questions, and the error or the notes."""
    lens = opened(answers.filepath, reading_options(answers))
    row = layout.row()
    column = row.column()
    if lens.system:
        try:
            preview = drawing_preview(lens.prescription, lambda: cross_section(lens.system, DRAWING_PX))
            column.template_icon(icon_value=preview.icon_id, scale=PICTURE)
        except InputError as error:
            _draw_line(column, error, "ERROR")
    column = row.column(align=True)
    for line in lens.lines:
        column.label(text=line)
    _draw_questions(layout, answers, lens.error)
    if lens.error:
        _draw_line(layout, lens.error, "ERROR")
    elif lens.prescription.notes:
        _draw_line(layout, lens.prescription.notes, "INFO")


def _draw_questions(layout, answers, error):
    layout.use_property_split = True
    layout.use_property_decorate = False
    lacking = error.field if error else ""
    if answers.which or lacking == "--which" or Path(answers.filepath).suffix.lower() == OPTICAL_BENCH:
        layout.prop(answers, "which")
    if answers.field_kind != FROM_THE_FILE:
        layout.prop(answers, "field_kind")
        layout.prop(answers, "field_angle" if answers.field_kind == ANGLE else "field_height")
    for each in answers.glasses:
        layout.prop(each, "glass", text=f"Glass for {each.name}")
    if answers.stop:
        layout.prop(answers, "stop")
    layout.prop(answers, "image_plane")
    if answers.allow_mismatch or lacking in (FOCAL_LENGTH, F_NUMBER):
        layout.prop(answers, "allow_mismatch")


def _draw_line(layout, text, icon):
    draw_wrapped(layout.column(align=True), str(text), icon, widgets=WIDTH_PX / WIDGET_PX)


class LENSFIELD_FH_lens(bpy.types.FileHandler):
    """Opens lens files that are dropped on a 3D viewport, the properties or an Image Editor."""

    bl_idname = "LENSFIELD_FH_lens"
    bl_label = "Lensfield Lens"
    bl_import_operator = "lensfield.open_lens"
    bl_file_extensions = ";".join((*SUFFIXES, ".npz"))

    @classmethod
    def poll_drop(cls, context):
        return context.area is not None and context.area.type in DROPPED_ON


classes = (LensfieldGlass, LENSFIELD_OT_open_lens, LENSFIELD_FH_lens)
