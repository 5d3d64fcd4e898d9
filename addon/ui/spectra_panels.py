"""Panels for the spectra of materials, lights and worlds."""

import bpy


class _SpectraPanel:
    bl_label = "Lensfield Spectra"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_options = {"DEFAULT_CLOSED"}

    block = ""  # attribute of the context with the data-block
    fields = ()

    @classmethod
    def poll(cls, context):
        return getattr(context, cls.block) is not None

    def draw(self, context):
        self.layout.use_property_split = True
        for field in self.fields:
            self.layout.prop(getattr(context, self.block).lensfield, field)


class LENSFIELD_PT_material(_SpectraPanel, bpy.types.Panel):
    bl_context = "material"
    block, fields = "material", ("reflectance", "emission", "refraction")


class LENSFIELD_PT_light(_SpectraPanel, bpy.types.Panel):
    bl_context = "data"
    block, fields = "light", ("emission", "power_unit")

    def draw(self, context):
        super().draw(context)
        if context.light.lensfield.power_unit == "LUMEN":
            self.layout.prop(context.light.lensfield, "lumens")


class LENSFIELD_PT_world(_SpectraPanel, bpy.types.Panel):
    bl_context = "world"
    block, fields = "world", ("emission",)


classes = (LENSFIELD_PT_material, LENSFIELD_PT_light, LENSFIELD_PT_world)
