"""The panel for a .blend that names files which the user has not chosen in this session: paths and a Trust button."""

import bpy

from ..job.named_files import named_files, trust_named_files
from .common.areas import redraw_panels
from .common.text_wrap import draw_wrapped

MOST_SHOWN = 20
WORDS = {"lens": "Lens", "camera": "Camera", "spectrum": "Spectrum", "output": "Output folder"}


def draw_named_files(layout, named):
    """Draw the paths that a .blend names, and the button that trusts them."""
    column = layout.column(align=True)
    draw_wrapped(column, "This file refers to other files. Nothing is read or rendered until you trust them:", "ERROR")
    for path, kind in list(named.items())[:MOST_SHOWN]:
        draw_wrapped(column, f"{WORDS[kind]}: {path}")
    if len(named) > MOST_SHOWN:
        column.label(text=f"{len(named) - MOST_SHOWN} more")
    column.operator("lensfield.trust", icon="CHECKMARK")


class LENSFIELD_OT_trust(bpy.types.Operator):
    """Let Lensfield read the lens and spectra that this file refers to, and write to its output folder, until Blender
    closes. Files that Blender lets run scripts (Preferences > Save & Load > Auto Run Python Scripts) are trusted"""

    bl_idname = "lensfield.trust"
    bl_label = "Trust"

    @classmethod
    def poll(cls, context):
        return bool(named_files())

    def execute(self, context):
        trust_named_files()
        redraw_panels()  # in all areas, not only the clicked one
        return {"FINISHED"}


classes = (LENSFIELD_OT_trust,)
