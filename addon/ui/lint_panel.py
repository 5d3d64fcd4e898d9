"""The linter's findings in a panel, each with a button that selects what it is about."""

import bpy

from ...engine.errors import InputError
from ..job.job import job_from_settings
from ..job.scene_plan import foresee
from ..shading.lint import counts_text, lint
from ..shading.node_rules import APPROXIMATED, REJECTED, SEPARATED
from .operators import nothing_renders

ICONS = {REJECTED: "CANCEL", SEPARATED: "MOD_ARRAY", APPROXIMATED: "ERROR"}
"""Of the verdicts that have a line each in the panel; of the others their number is enough."""
MOST_LINES = 40  # a panel has no room for more

checked = {"scene": None, "findings": (), "plan": ""}
"""What the last check found, how the scene would be rendered, and the session_uid of the scene, which no other has
until Blender ends."""


class LENSFIELD_OT_lint(bpy.types.Operator):
    """Judge every node that reaches the render, and tell how many Cycles renders it will take, and why"""

    bl_idname = "lensfield.lint"
    bl_label = "Check Scene"

    @classmethod
    def poll(cls, context):
        return nothing_renders()

    def execute(self, context):
        scene = context.scene
        checked["scene"], checked["findings"] = scene.session_uid, lint(scene)
        try:
            checked["plan"] = foresee(scene, job_from_settings(scene)).text
        except InputError as error:
            checked["plan"] = str(error)
        self.report({"INFO"}, f"{counts_text(checked['findings'])}. {checked['plan']}")
        return {"FINISHED"}


class LENSFIELD_OT_select_object(bpy.types.Operator):
    """Select the objects that a finding is about"""

    bl_idname = "lensfield.select_object"
    bl_label = "Select Objects"
    bl_options = {"UNDO", "INTERNAL"}

    finding: bpy.props.IntProperty(options={"HIDDEN"})

    @classmethod
    def description(cls, context, properties):
        return str(_finding(properties.finding) or cls.__doc__)  # the line in the panel may be cut off

    @classmethod
    def poll(cls, context):
        return context.mode == "OBJECT"

    def execute(self, context):
        finding = _finding(self.finding)
        if finding is None:
            self.report({"WARNING"}, "check the scene first")
            return {"CANCELLED"}
        names = finding.object_names
        found = [obj for obj in context.view_layer.objects if obj.name in names and obj.visible_get()]
        if not found:
            self.report({"WARNING"}, "none of its objects is visible here: " + ", ".join(names))
            return {"CANCELLED"}
        for obj in context.view_layer.objects:
            obj.select_set(obj in found)
        context.view_layer.objects.active = found[0]
        return {"FINISHED"}


class _LintPanel:
    bl_label = "Scene Check"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        self.layout.operator("lensfield.lint", icon="VIEWZOOM")
        if checked["scene"] == context.scene.session_uid:
            self.layout.label(text=checked["plan"], icon="RENDER_STILL")
            _draw_findings(self.layout, checked["findings"])


class LENSFIELD_PT_lint(_LintPanel, bpy.types.Panel):
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_parent_id = "LENSFIELD_PT_render"


class LENSFIELD_PT_lint_sidebar(_LintPanel, bpy.types.Panel):
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Lensfield"
    bl_parent_id = "LENSFIELD_PT_sidebar"


def _draw_findings(layout, findings):
    told = [(index, finding) for index, finding in enumerate(findings) if finding.verdict in ICONS]
    column = layout.column(align=True)
    for index, finding in told[:MOST_LINES]:
        row = column.row()
        row.label(text=str(finding), icon=ICONS[finding.verdict])
        if finding.object_names:
            row.operator("lensfield.select_object", text="", icon="RESTRICT_SELECT_OFF").finding = index
    if len(told) > MOST_LINES:
        column.label(text=f"{len(told) - MOST_LINES} more: lensfield lint tells them")
    layout.label(text=counts_text(findings), icon="INFO")


def _finding(index):
    findings = checked["findings"]
    return findings[index] if 0 <= index < len(findings) else None


classes = (LENSFIELD_OT_lint, LENSFIELD_OT_select_object, LENSFIELD_PT_lint, LENSFIELD_PT_lint_sidebar)
