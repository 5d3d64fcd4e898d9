"""What the user sets: the scene's lens settings, and spectra on materials, lights and worlds."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..engine import Options
from ..engine.lens_files import bundled_names
from ..engine.spectra import library_names, parse_wavelengths

FROM_FILE = "FILE"
BLEND_RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"}  # paths that start with // lie beside the .blend


def _spectrum_suggestions(self, context, edit_text):
    return [name for name in library_names() if edit_text.lower() in name]


def _spectrum_property(name, description):
    return StringProperty(
        name=name, default="", search=_spectrum_suggestions, search_options={"SUGGESTION"},
        description=f"{description}: a name from the library, a two-column file (nm, value), or pairs such as "
                    "400:0.1, 700:0.2. Empty: the colour is upsampled")


class LensfieldSpectra(bpy.types.PropertyGroup):
    """Spectra of a material, light or world."""

    reflectance: _spectrum_property("Reflectance", "Spectral reflectance in place of the base colour")
    emission: _spectrum_property("Emission", "Spectral power in place of the colour of the light; only its shape "
                                             "counts, the strength stays")


class LensfieldSettings(bpy.types.PropertyGroup):
    """Settings of the lens render of a scene."""

    lens: EnumProperty(
        name="Lens", description="Lens data to render through", default="edmund-54852",
        items=[(name, name, "Lens that comes with Lensfield") for name in bundled_names()]
              + [(FROM_FILE, "From file", "A lens package of your own (.npz)")])
    lens_file: StringProperty(name="Lens File", description="Lens package (.npz)", subtype="FILE_PATH",
                              options=BLEND_RELATIVE)
    wavelength_mode: EnumProperty(
        name="Wavelengths", default="RANGE",
        items=[("RANGE", "Range", "Evenly spaced wavelengths"), ("LIST", "List", "Wavelengths one by one")])
    wavelength_first_nm: FloatProperty(name="First", description="Shortest wavelength in nm", default=400, min=1,
                                       precision=1)
    wavelength_last_nm: FloatProperty(name="Last", description="Longest wavelength in nm", default=700, min=1,
                                      precision=1)
    wavelength_count: IntProperty(name="Number", default=9, min=1, soft_max=61,
                                  description="Number of wavelengths; three are rendered in each Cycles pass")
    wavelength_list: StringProperty(name="List", description="Ascending wavelengths in nm, such as 450, 550, 650",
                                    default="450, 550, 650")
    section_size: IntProperty(name="Section Size", subtype="PIXEL", default=Options.section_size, min=1, soft_max=256,
                              description="Side of the sections that share one point spread function (order 1) or "
                                          "interpolate between four (order 2). Smaller is more accurate and slower")
    order: EnumProperty(name="Order", default=str(Options.order),
                        items=[("1", "1: constant", "One PSF per section, as in the paper"),
                               ("2", "2: bilinear", "PSFs interpolated between the corners of each section"),
                               ("3", "3: quadratic", "PSFs interpolated between 9 nodes in each section"),
                               ("4", "4: cubic", "PSFs interpolated between 16 nodes in each section")])
    out_of_field: EnumProperty(
        name="Out of Field", default=Options.out_of_field.upper(),
        description="Pixels beyond the last field height of the lens data",
        items=[("HOLD", "Hold", "Hold the last point spread function and relative illumination"),
               ("VIGNETTE", "Black", "Leave it black")])
    denoise: BoolProperty(name="Denoise", default=False,
                          description="Let Cycles denoise its passes. It shifts means by up to 1 %, unequally between "
                                      "wavelengths")
    output_folder: StringProperty(name="Output", description="Folder for the spectral EXRs and the pictures",
                                  default="//lensfield/", subtype="DIR_PATH", options=BLEND_RELATIVE)
    to_compositor: BoolProperty(name="To Compositor", default=True,
                                description="Lay the lens image into the scene's compositor when it is done")

    def lens_name_or_path(self):
        """What `Lens.load` takes."""
        return bpy.path.abspath(self.lens_file) if self.lens == FROM_FILE else self.lens

    def wavelengths_text(self):
        """The wavelengths as `lensfield render --wavelengths` takes them."""
        if self.wavelength_mode == "LIST":
            return self.wavelength_list
        if self.wavelength_count == 1:
            return f"{self.wavelength_first_nm:g}"
        return f"{self.wavelength_first_nm:g}:{self.wavelength_last_nm:g}:{self.wavelength_count}"

    def wavelengths_nm(self):
        """Ascending array of wavelengths; raises InputError."""
        return parse_wavelengths(self.wavelengths_text())

    def to_options(self):
        """The engine's Options: the only bridge to it."""
        return Options(section_size=self.section_size, order=int(self.order), out_of_field=self.out_of_field.lower())


classes = (LensfieldSpectra, LensfieldSettings)

_OWNERS = ((bpy.types.Scene, LensfieldSettings), (bpy.types.Material, LensfieldSpectra),
           (bpy.types.Light, LensfieldSpectra), (bpy.types.World, LensfieldSpectra))


def register_pointers():
    for owner, group in _OWNERS:
        owner.lensfield = PointerProperty(type=group)


def unregister_pointers():
    for owner, _ in reversed(_OWNERS):
        del owner.lensfield
