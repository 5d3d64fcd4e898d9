"""The panel of an extension that was updated while Blender runs: the engine of the earlier version is still loaded."""

import bpy

import lensfield


class LENSFIELD_PT_restart(bpy.types.Panel):
    """Asks for a restart of Blender, in place of Lensfield's panels."""

    bl_label = "Lensfield"
    bl_category = "Lensfield"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"

    def draw(self, context):
        column = self.layout.column(align=True)
        column.label(text="Restart Blender to finish the update", icon="INFO")
        column.label(text=f"Version {lensfield.__version__} of the engine is loaded, from")
        column.label(text=lensfield.__path__[0])


def register():
    """Called when the extension and the engine that is loaded have different versions."""
    bpy.utils.register_class(LENSFIELD_PT_restart)


def unregister():
    """Undo `register`."""
    bpy.utils.unregister_class(LENSFIELD_PT_restart)
