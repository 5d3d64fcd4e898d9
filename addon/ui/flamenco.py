"""Flamenco, Blender Studio's render farm: Lensfield's job type, if Flamenco's add-on is enabled.

The add-on lists the job types of its Manager. The user saves Lensfield's script into the Manager's folder and then
chooses the job type. Flamenco's panel submits the job.
"""

import shutil
from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from ...engine.runtime.errors import InputError, one_line
from ...engine.runtime.files import atomic_path

SCRIPT = Path(__file__).with_name("lensfield_render.js")
JOB_TYPE = SCRIPT.stem.replace("_", "-")  # the Manager's name for it


def is_installed_in():
    """Whether Flamenco's add-on is enabled."""
    return hasattr(bpy.types, "FLAMENCO_OT_submit_job") and hasattr(bpy.types.Scene, "flamenco_job_type")


class LENSFIELD_OT_flamenco_job_type(bpy.types.Operator):
    """Set Flamenco's panel, in the Output properties, to render this scene through its lens"""

    bl_idname = "lensfield.flamenco_job_type"
    bl_label = "Choose Flamenco Job Type"

    @classmethod
    def poll(cls, context):
        return is_installed_in()

    def execute(self, context):
        try:
            context.scene.flamenco_job_type = JOB_TYPE
        except TypeError:  # not one of the add-on's job types
            self.report({"ERROR"}, "Flamenco's Manager has no Lensfield job type: save it to the Manager's scripts "
                                   "folder, restart the Manager, and press Refresh from Manager in Flamenco's panel")
            return {"CANCELLED"}
        self.report({"INFO"}, "Job type chosen: submit the job in the Output properties, under Flamenco")
        return {"FINISHED"}


class LENSFIELD_OT_save_flamenco_job_type(ExportHelper, bpy.types.Operator):
    """Save the script of Lensfield's job type; it belongs in the scripts folder next to flamenco-manager"""

    bl_idname = "lensfield.save_flamenco_job_type"
    bl_label = "Save Flamenco Job Type"

    filename_ext = SCRIPT.suffix
    filter_glob: bpy.props.StringProperty(default=f"*{SCRIPT.suffix}", options={"HIDDEN"})

    def invoke(self, context, event):
        self.filepath = SCRIPT.name
        return super().invoke(context, event)

    def execute(self, context):
        if Path(self.filepath).name != SCRIPT.name:
            self.report({"ERROR"}, f"{self.filepath}: name is {Path(self.filepath).name}: expected {SCRIPT.name}, "
                                   "the name that the Manager knows")
            return {"CANCELLED"}
        try:
            with atomic_path(self.filepath) as temporary:
                shutil.copyfile(SCRIPT, temporary)
        except (InputError, OSError) as error:
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        return {"FINISHED"}


def draw_flamenco(layout):
    """Draw the operators for Flamenco, if its add-on is enabled."""
    if is_installed_in():
        layout.separator()
        layout.operator("lensfield.flamenco_job_type", icon="NETWORK_DRIVE")
        layout.operator("lensfield.save_flamenco_job_type", icon="FILE_SCRIPT")


classes = (LENSFIELD_OT_flamenco_job_type, LENSFIELD_OT_save_flamenco_job_type)
