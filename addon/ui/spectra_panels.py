"""Panels of the spectra of materials, lights and worlds."""

import bpy


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


classes = (LENSFIELD_PT_material, LENSFIELD_PT_light, LENSFIELD_PT_world)
