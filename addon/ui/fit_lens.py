"""Fitting the rims of a lens to the user's photographs, and how closely a lens agrees with photographs."""

import re
from contextlib import suppress
from pathlib import Path

import bpy
from bpy.props import CollectionProperty, FloatProperty, FloatVectorProperty, StringProperty

from lensfield.engine.fitting.even_light import check_even_light
from lensfield.engine.fitting.fit import fit_to_files
from lensfield.engine.fitting.flat_fields import read_flat_fields
from lensfield.engine.fitting.raw_light import f_numbers_of
from lensfield.engine.fitting.vignetting import COLUMNS, read_vignetting
from lensfield.engine.library import bundled_names, has_rings, prescription_of
from lensfield.engine.prescription.photographs import MM_PER_M, NOT_COMPARED
from lensfield.engine.runtime.errors import InputError, one_line
from lensfield.engine.runtime.inputs import note_who_names

from ..job.named_files import FROM_FILE
from ..scene.active_camera import camera_in, settings_to_edit
from ..scene.lens_file import stored_lens
from .common.lens_worker import lens_request
from .common.plain_words import sentence
from .common.stepped import Stepped

TABLE = ".csv"
PICTURES = "*.dng;*.cr2;*.cr3;*.nef;*.nrw;*.arw;*.raf;*.rw2;*.orf;*.pef;*.srw;*.3fr;*.fff;*.iiq;*.rwl;*.x3f"
MARK = "RESTRICT_RENDER_OFF"  # a camera
FITTED = re.compile(r"-fitted(-\d+)?$")


def agreement_of(scene):
    """The Agreement of the scene's lens with photographs; None without one, or until the lens is read."""
    facts = _facts(scene)
    return facts and facts.photographs


def agreement_text(scene):
    """How closely the scene's lens agrees with photographs, as a sentence; empty until the lens is read."""
    facts = _facts(scene)
    return sentence(str(facts.photographs or NOT_COMPARED)) if facts else ""


def _facts(scene):
    """The LensFacts of the scene's lens; None until they are read, and without a lens."""
    with suppress(InputError):
        return lens_request(scene).facts
    return None


def fitted_name(name_or_path):
    """The name of the file of a fitted lens, without its suffix."""
    name = name_or_path if name_or_path in bundled_names() else Path(name_or_path).stem
    return f"{FITTED.sub('', name)}-fitted"


def draw_fit(layout):
    """Draw the button that fits a lens to photographs."""
    layout.operator("lensfield.fit_lens", icon="IMAGE_REFERENCE")


class LENSFIELD_OT_fit_lens(Stepped, bpy.types.Operator):
    """Fit the rims of this lens, which shape cat's eyes and dark corners, to photographs that you took through it: raw
    pictures of an even field, one for each f-stop, or a table of its light (.csv). The fitted lens is stored in a new
    file, and the camera uses it"""

    bl_idname = "lensfield.fit_lens"
    bl_label = "Fit to Photographs"
    bl_options = {"UNDO"}
    meanwhile = {"RUNNING_MODAL"}

    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    filter_glob: StringProperty(default=f"{PICTURES};*{TABLE}", options={"HIDDEN"})
    f_numbers: StringProperty(
        name="F-Numbers", options={"SKIP_SAVE"},
        description="Of the pictures, in the order of their names, for a lens that does not report them, such as "
                    "2, 2.8, 4. Empty: as in the files")
    focus_m: FloatProperty(
        name="Focus (m)", min=0, soft_max=100, precision=2, options={"SKIP_SAVE"},
        description="Distance from the lens's entrance pupil that the lens was set to. 0: infinity")
    sensor_mm: FloatVectorProperty(
        name="Sensor (mm)", size=2, min=0, max=1000, precision=2, options={"SKIP_SAVE"},
        description="Width and height of the camera's sensor. 0: the sensor of the lens")

    @classmethod
    def poll(cls, context):
        camera = camera_in(context)
        if camera is None or not has_rings(camera.lensfield.lens_text()):
            cls.poll_message_set("Lens packages contain no rims: open the prescription of the lens" if camera else
                                 "Add a camera first")
            return False
        return True

    def invoke(self, context, event):
        try:
            lens = prescription_of(settings_to_edit(context).lens_name_or_path())
            check_even_light(lens)
        except InputError as error:
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        self.sensor_mm = lens.sensor_mm or (0, 0)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context):
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        for name in ("f_numbers", "focus_m", "sensor_mm"):
            self.layout.prop(self, name)

    def steps(self, context):
        """Read the photographs, fit the lens, store it, and let the camera use it."""
        settings, paths = settings_to_edit(context), self._paths()
        name, curves = settings.lens_name_or_path(), []
        lens = prescription_of(name)
        for read, more in enumerate(self._curves(paths, lens), 1):
            curves += more
            yield read / (len(paths) + 1)
        fit = fit_to_files(lens, curves, paths)
        settings.lens_file = stored_lens(fit.prescription, fitted_name(name))
        settings.lens = FROM_FILE
        self.report({"INFO"}, "; ".join([f"Lens: {settings.lens_file}", *map(str, fit.rims),
                                         fit.prescription.photographs.differences]))

    def _paths(self):
        """The files in the order of their names. The user names them: errors may quote them."""
        paths = [Path(bpy.path.abspath(self.directory), name) for name in sorted(each.name for each in self.files)]
        if not paths:
            raise InputError("photographs", "files", "none", f"choose raw pictures, or a table ({TABLE}) with the "
                             f"columns {', '.join(COLUMNS)}")
        for path in paths:
            note_who_names(path, None)
        return paths

    def _curves(self, paths, lens):
        """The curves in each file in turn."""
        if [path.suffix.lower() for path in paths] == [TABLE]:
            yield read_vignetting(paths[0])
            return
        sensor_mm, focus_mm = tuple(self.sensor_mm), round(self.focus_m * MM_PER_M, 3)  # single precision
        f_numbers = f_numbers_of(self.f_numbers, len(paths))
        for field in read_flat_fields(paths, lens, f_numbers, sensor_mm if all(sensor_mm) else None,
                                      focus_mm or float("inf")):
            self.report({"INFO"}, str(field))
            yield [field.curve]


classes = (LENSFIELD_OT_fit_lens,)
