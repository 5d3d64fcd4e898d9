"""What the user sets: the scene's lens settings, and spectra on materials, lights and worlds."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..engine import Options
from ..engine.lens_files import bundled_makers
from ..engine.options import DEFAULT_ACCURACY
from ..engine.plan import AZIMUTHS, ORDER, SECTION_SIZE
from ..engine.spectra import library_names, parse_wavelengths

FROM_FILE = "FILE"
KNOBS = {"SECTIONS": ("section_size", "order"), "PIXELS": ("azimuths",), "EXACT": ()}  # of each method
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
        items=[(name, name, f"{maker}. {story}") for name, (maker, story) in bundled_makers().items()]
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
    quality: EnumProperty(
        name="Quality", default="ACCURACY", description="How the lens image's accuracy is asked for",
        items=[("ACCURACY", "By result", "Say how accurate the picture has to be; the quickest way there is chosen"),
               ("KNOBS", "By knobs", "Choose how it is done, for who wants to")])
    accuracy: FloatProperty(
        name="Misplaced Light", subtype="FACTOR", default=DEFAULT_ACCURACY, min=1e-6, max=1, soft_min=0.001,
        soft_max=0.1, precision=4,
        description="The largest part of any point's light that may land in the wrong place: 0.01 leaves at least 99 % "
                    "of it where the lens puts it. Less is slower")
    method: EnumProperty(
        name="Method", default="SECTIONS", description="How the lens's blur is applied",
        items=[("SECTIONS", "Sections", "Section by section, point spread functions varying inside each"),
               ("PIXELS", "Pixels", "Every pixel its own point spread function, from a table: for small ones"),
               ("EXACT", "Exact", "Every pixel its own point spread function, without a table: very slow")])
    section_size: IntProperty(name="Section Size", subtype="PIXEL", default=SECTION_SIZE, min=1, soft_max=256,
                              description="Side of the sections that share one point spread function (order 1) or "
                                          "interpolate between several. Smaller is more accurate and slower")
    order: EnumProperty(name="Order", default=str(ORDER),
                        items=[("1", "1: constant", "One PSF per section, as in the paper"),
                               ("2", "2: bilinear", "PSFs interpolated between the corners of each section"),
                               ("3", "3: quadratic", "PSFs interpolated between 9 nodes in each section"),
                               ("4", "4: cubic", "PSFs interpolated between 16 nodes in each section")])
    azimuths: IntProperty(name="Azimuths", default=AZIMUTHS, min=1, soft_max=256,
                          description="Steps of the table from 0 to 45 degrees. More is more accurate and takes more "
                                      "time and memory")
    out_of_field: EnumProperty(
        name="Out of Field", default=Options.out_of_field.upper(),
        description="Pixels beyond the last field height of the lens data",
        items=[("HOLD", "Hold", "Hold the last point spread function and relative illumination"),
               ("VIGNETTE", "Black", "Leave it black")])
    fireflies: EnumProperty(
        name="Fireflies", default=Options.fireflies.upper(), description="Pixels whose light is no finite number",
        items=[("REFUSE", "Refuse", "Stop with an error that names the first"),
               ("CLAMP", "Clamp", "Take the brightest of their neighbours")])
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
        if self.quality == "KNOBS":
            asked = {"method": self.method.lower()} | {name: int(getattr(self, name)) for name in KNOBS[self.method]}
        else:
            asked = {"accuracy": float(f"{self.accuracy:.6g}")}  # Blender's floats are single: 0.01 is 0.0099999998
        return Options(**asked, out_of_field=self.out_of_field.lower(), fireflies=self.fireflies.lower())


classes = (LensfieldSpectra, LensfieldSettings)

_OWNERS = ((bpy.types.Scene, LensfieldSettings), (bpy.types.Material, LensfieldSpectra),
           (bpy.types.Light, LensfieldSpectra), (bpy.types.World, LensfieldSpectra))


def register_pointers():
    for owner, group in _OWNERS:
        owner.lensfield = PointerProperty(type=group)


def unregister_pointers():
    for owner, _ in reversed(_OWNERS):
        del owner.lensfield
