"""Opening a calibration, an STMap or an entry of Lensfun's database as the lens of a camera."""

from math import inf
from pathlib import Path

import bpy
from bpy.props import EnumProperty, FloatProperty, FloatVectorProperty, IntVectorProperty, StringProperty

from lensfield.engine.measured.files import DEFAULT_WIDTH_MM, KINDS, lens_of, read_measured
from lensfield.engine.measured.options import MeasuredOptions
from lensfield.engine.runtime.errors import InputError, one_line
from lensfield.engine.runtime.inputs import note_who_names

from ..job.named_files import FROM_FILE
from ..scene.active_camera import settings_to_edit
from ..scene.lens_file import stored_package

BY_CONTENTS = "CONTENTS"
MM_PER_M, DIGITS = 1e3, 4
PROPERTIES = "kind", "which", "sensor_mm", "focal_mm", "size_px", "overscan", "f_number", "focus_m"


def draw_open_measured(layout):
    """Draw the button that opens a calibration."""
    layout.operator("lensfield.open_measured", icon="DRIVER_DISTANCE")


class LENSFIELD_OT_open_measured(bpy.types.Operator):
    """Render through a lens as another program has measured it: a calibration of OpenCV, COLMAP, nerfstudio, Kalibr,
    ROS or Gyroflow, an STMap, or an entry of Lensfun's database. The lens is stored in a new package, and the camera
    uses it"""

    bl_idname = "lensfield.open_measured"
    bl_label = "Open Calibration"
    bl_options = {"UNDO"}

    filepath: StringProperty(subtype="FILE_PATH", options={"HIDDEN", "SKIP_SAVE"})
    filter_glob: StringProperty(default="*.yml;*.yaml;*.json;*.xml;*.txt;*.exr", options={"HIDDEN"})
    kind: EnumProperty(
        name="Kind", default=BY_CONTENTS, options={"SKIP_SAVE"}, description="The program of the file",
        items=[(BY_CONTENTS, "By Contents", "Recognise the file by its contents"),
               *((name.upper(), name, kind.title) for name, kind in KINDS.items())])
    which: StringProperty(
        name="Name in the File", options={"SKIP_SAVE"},
        description="Which one, if the file contains several: a camera, a frame's picture, or a lens's maker and model")
    sensor_mm: FloatVectorProperty(
        name="Sensor (mm)", size=2, min=0, max=1000, precision=2, options={"SKIP_SAVE"},
        description=f"Width and height of the sensor that the picture fits on. 0: as in the file, or "
                    f"{DEFAULT_WIDTH_MM:g} mm wide")
    focal_mm: FloatProperty(
        name="Focal Length (mm)", min=0, max=10_000, precision=2, options={"SKIP_SAVE"},
        description="Of an STMap, or of a zoom lens in Lensfun's database. 0: as in the file")
    size_px: IntVectorProperty(
        name="Resolution", size=2, min=0, max=65536, options={"SKIP_SAVE"},
        description="Size of the calibrated pictures in pixels. 0: as in the file")
    overscan: FloatProperty(
        name="Overscan", default=MeasuredOptions.overscan, min=1, max=10, options={"SKIP_SAVE"},
        description="Of an STMap: width of the undistorted picture relative to the lens's picture")
    f_number: FloatProperty(
        name="F-Stop", default=MeasuredOptions.f_number, min=0.5, max=256, precision=1, options={"SKIP_SAVE"},
        description="Sets diffraction and depth of field")
    focus_m: FloatProperty(
        name="Focus (m)", min=0, soft_max=100, precision=2, options={"SKIP_SAVE"},
        description="Distance to the plane of focus. 0: infinity")

    def invoke(self, context, event):
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context):
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        for name in PROPERTIES:
            self.layout.prop(self, name)

    def execute(self, context):
        path = Path(bpy.path.abspath(self.filepath))
        note_who_names(path, None)  # the user names it: errors may quote it
        try:
            settings, options = settings_to_edit(context), self._options()
            kind = None if self.kind == BY_CONTENTS else self.kind.lower()
            lens = lens_of(read_measured(path, options, kind), options)
            settings.lens_file = stored_package(lens, path.stem)
        except (InputError, OSError) as error:
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        settings.lens = FROM_FILE
        self.report({"INFO"}, " ".join([f"Lens: {settings.lens_file}.", lens.source, *lens.notes.splitlines()]))
        return {"FINISHED"}

    def _options(self):
        """The MeasuredOptions of the operator's properties; 0 is what the file states. Blender's floats are single
        precision."""
        entered = self.focal_mm, self.f_number, self.focus_m, self.overscan, *self.sensor_mm
        focal_mm, f_number, focus_m, overscan, *sensor_mm = (round(each, DIGITS) for each in entered)
        return MeasuredOptions(
            self.which or None, tuple(self.size_px) if all(self.size_px) else None, focal_mm or None,
            tuple(sensor_mm) if all(sensor_mm) else None, f_number, MM_PER_M * focus_m or inf, overscan)


classes = (LENSFIELD_OT_open_measured,)
