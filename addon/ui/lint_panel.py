"""The linter's findings in a panel, each with a button that selects the objects concerned."""

import bpy

from lensfield.engine.runtime.errors import InputError

from ..render.preflight import preflight
from ..scene.active_camera import camera_settings
from ..scene.rings import rings_for
from ..shading.lint import counts_text
from ..shading.node_rules import APPROXIMATED, REJECTED, SEPARATED
from .common.lens_worker import is_baking
from .common.session import Check, session
from .common.text_wrap import draw_wrapped
from .operators import nothing_renders

ICONS = {REJECTED: "CANCEL", SEPARATED: "MOD_ARRAY", APPROXIMATED: "ERROR"}
"""Icons of the verdicts with a line for each finding in the panel; the others are only counted."""
MOST_LINES = 40  # more would not fit into a panel
UNFIT = "Refused because of the rejected nodes below. To render anyway, change Wavelengths and Spectra > Unfit Nodes"


class LENSFIELD_OT_lint(bpy.types.Operator):
    """Check whether the scene can be rendered, in how many Cycles passes, and how its settings and nodes are handled"""

    bl_idname = "lensfield.lint"
    bl_label = "Check Scene"

    @classmethod
    def poll(cls, context):
        if not bpy.app.background and is_baking(context.scene):
            cls.poll_message_set("The lens is being baked: wait for it")
            return False
        return nothing_renders()

    def execute(self, context):
        result = preflight(context.scene)
        session.check = Check(context.scene.session_uid, checked_settings(context.scene), result)
        first = result.refusals[0] if result.refusals else result.plan.text
        self.report({"INFO"}, f"{counts_text(result.findings)}. {first}")
        return {"FINISHED"}


class LENSFIELD_OT_select_object(bpy.types.Operator):
    """Select the objects that this line is about"""

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
            self.report({"WARNING"}, "Check the scene first")
            return {"CANCELLED"}
        names = finding.object_names
        visible = [obj for obj in context.view_layer.objects if obj.name in names and obj.visible_get()]
        if not visible:
            self.report({"WARNING"}, "None of these objects is visible here: " + ", ".join(names))
            return {"CANCELLED"}
        for obj in context.view_layer.objects:
            obj.select_set(obj in visible)
        context.view_layer.objects.active = visible[0]
        return {"FINISHED"}


def draw_check(layout, scene):
    """Draw the check's button, and the result of this scene's last check."""
    layout.operator("lensfield.lint", icon="VIEWZOOM")
    if session.check.scene_uid != scene.session_uid:
        return
    if session.check.settings != checked_settings(scene):
        draw_wrapped(layout.column(align=True), "Settings have changed since this check", "INFO")
    draw_preflight(layout, session.check.result)


def checked_settings(scene):
    """The settings on which a check depends, with an error's text in place of the request if they are not valid."""
    try:
        lens = camera_settings(scene).lens_text()
        settings = scene.lensfield.to_request(lens=lens), rings_for(scene, lens)
    except InputError as error:
        settings = str(error)
    return settings, scene.frame_current


def draw_preflight(layout, result):
    """Draw the result of a check: the plan, the refusals, the remarks on settings, and the findings on nodes."""
    column = layout.column(align=True)
    if result.plan:
        draw_wrapped(column, result.plan.text, "RENDER_STILL")
    listed = {finding.place for finding in result.findings}
    for refusal in result.refusals:
        draw_wrapped(column, UNFIT if refusal.where in listed else str(refusal), "CANCEL")
    for remark in result.remarks:
        draw_wrapped(column, str(remark), "INFO")
    _draw_findings(layout, result.findings)


def _draw_findings(layout, findings):
    shown = [(index, finding) for index, finding in enumerate(findings) if finding.verdict in ICONS]
    column = layout.column(align=True)
    for index, finding in shown[:MOST_LINES]:
        row = column.row()
        draw_wrapped(row.column(align=True), str(finding), ICONS[finding.verdict], reserved=bool(finding.object_names))
        if finding.object_names:
            row.operator("lensfield.select_object", text="", icon="RESTRICT_SELECT_OFF").finding = index
    if len(shown) > MOST_LINES:
        column.label(text=f"{len(shown) - MOST_LINES} more: lensfield lint lists all of them")
    layout.label(text=counts_text(findings), icon="INFO")


def _finding(index):
    findings = session.check.result.findings
    return findings[index] if 0 <= index < len(findings) else None


classes = (LENSFIELD_OT_lint, LENSFIELD_OT_select_object)
