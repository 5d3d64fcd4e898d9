"""What the user sets: the scene's lens settings, and spectra on materials, lights and worlds."""

import os
from functools import cache, lru_cache
from zlib import crc32

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ...engine import Options
from ...engine.bake.prescriptions import READERS
from ...engine.blur import METHODS
from ...engine.blur.method import AZIMUTHS, SECTION_SIZE
from ...engine.library import bundled_lenses, find_bundled
from ...engine.plan.options import DEFAULT_ACCURACY, KNOBS, MOST_SUPERSAMPLING, TIER_ACCURACY
from ...engine.spectral.refraction import refraction_names
from ...engine.spectral.spectra import library_names, parse_wavelengths
from ...engine.spectral.wavelength_choice import IMAGE_WAVELENGTHS, STANDARD_COLOUR_ERROR, SpectralOptions
from ..job.named_files import FROM_FILE
from ..scene.compositor import refresh
from ..scene.trust import check_trusted, trust
from ..shading.assigned import spectrum_path
from .previews import lens_picture

DEFAULT_LENS = "tessar-50mm"  # a normal lens for a camera's usual frame, focused far away
FIRST_NM, LAST_NM, NUMBER = (int(word) for word in IMAGE_WAVELENGTHS.split(":"))
PANEL_KNOBS = "section_size", "azimuths"  # of those that the methods have
OWN_LENS = f"A prescription of your own ({', '.join(READERS)}), which has rings to turn, or a lens package (.npz)"
BLEND_RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"}  # paths that start with // lie beside the .blend


def _suggestions(names):
    """What to offer as one types: the names that hold what is typed so far."""
    return lambda self, context, typed: [name for name in names() if typed.lower() in name]


def _spectrum_property(name, description, names, form):
    return StringProperty(name=name, default="", search=_suggestions(names), search_options={"SUGGESTION"},
                          description=f"{description}: a name from the library, {form}",
                          update=lambda spectra, context: trust(spectrum_path(spectra.id_data, name.lower())))


def _emission():
    return _spectrum_property(
        "Emission", "Spectrum in place of the colour of the light; only its shape counts, the strength stays",
        lambda: library_names("light"), "a two-column file (nm, value), or pairs such as 400:0.1, 700:0.2")


class LensfieldWorldSpectra(bpy.types.PropertyGroup):
    """Spectra of a world."""

    emission: _emission()


class LensfieldLightSpectra(bpy.types.PropertyGroup):
    """Spectrum and power of a light."""

    emission: _emission()
    power_unit: EnumProperty(
        name="Power", default="WATT",
        items=[("WATT", "Watts", "The light's own Power, given off between 380 and 780 nm (of a sun, per m\u00b2)"),
               ("LUMEN", "Lumens", "Luminous flux, as lamps are sold by (of a sun, lux), in place of its Power")])
    lumens: FloatProperty(name="Lumens", default=800, min=0, soft_max=1e5,
                          description="Luminous flux in lumens; of a sun, illuminance in lux")


class LensfieldMaterialSpectra(bpy.types.PropertyGroup):
    """Spectra of a material."""

    reflectance: _spectrum_property(
        "Reflectance", "Spectral reflectance in place of the base colour. Empty: the colour is upsampled",
        lambda: library_names("reflectance"), "a two-column file (nm, value), or pairs such as 400:0.1, 700:0.2")
    emission: _emission()
    refraction: _spectrum_property(
        "Refraction", "What the material is made of, by its refractive index. Glass takes it in place of its IOR and "
        "disperses; metals reflect by it where no reflectance is given", refraction_names,
        "or a file of refractiveindex.info (.yml)")


def _lasting_number(name):
    """What a .blend keeps of a lens, whatever lenses come beside it: not its place in the list."""
    return crc32(name.encode()) >> 1  # Blender's numbers have 31 bits


def lens_items(self, context):
    """The lenses to choose from, as Blender's enumerations ask for them: it takes a plain function only."""
    return offered_lenses()


@cache
def offered_lenses():
    """The lenses to choose from: list of (identifier, name, description, icon, number)."""
    bundled = [(name, lens.title, f"{lens.maker}: {', '.join(lens.character)}. {lens.story}",
                lens_picture(name) or "CAMERA_DATA", _lasting_number(name)) for name, lens in bundled_lenses().items()]
    own = FROM_FILE, "From File", OWN_LENS, "FILE_FOLDER", _lasting_number(FROM_FILE)
    return [*bundled, own]


def searched_lens_items(self, context):
    """As `lens_items`, each called by all that it can be searched by."""
    return _searched_lenses()


@cache
def _searched_lenses():
    told = {name: ", ".join((lens.title, f"{lens.focal_length_mm:g}mm", lens.maker, *lens.character))
            for name, lens in bundled_lenses().items()}
    return [(name, told.get(name, title), *rest) for name, title, *rest in offered_lenses()]


def found_lens_items(self, context):
    """As `lens_items`, those alone of which all words are told that are asked for; and the one that is chosen."""
    return _found_lenses(self.lens_words, self.lens)


@lru_cache(maxsize=8)
def _found_lenses(words, chosen):
    found = {chosen, *find_bundled(words.split())} | ({FROM_FILE} if not words.strip() else set())
    return [item for item in offered_lenses() if item[0] in found]


def forget_items():
    """Free the lenses to choose from, and their icons with them."""
    for items in (offered_lenses, _searched_lenses, _found_lenses):
        items.cache_clear()


def _choose_lens(settings, number):
    settings.lens = next(name for name, *_, own in offered_lenses() if own == number)


def _choose_path(field):
    """What is to be done when a path is set, by a user or a script: it is trusted. A file that is opened sets none."""
    return lambda settings, context: trust(bpy.path.abspath(getattr(settings, field)))


def lens_title(name_or_path):
    """What a lens is called in panels: its title, or the name of its file."""
    return {name: title for name, title, *_ in offered_lenses()}.get(name_or_path, os.path.basename(name_or_path))


class LensfieldSettings(bpy.types.PropertyGroup):
    """Settings of the lens render of a scene."""

    lens: EnumProperty(
        name="Lens", description="Lens to render through", default=_lasting_number(DEFAULT_LENS),
        items=lens_items)
    lens_words: StringProperty(
        name="Find", description="Words that are told of a lens, such as zeiss, 1936, 50mm, swirl or soft: you choose "
                                 "among the lenses of which all of them are told")
    found_lens: EnumProperty(name="Lens", description="Lens to render through", items=found_lens_items,
                             get=lambda self: _lasting_number(self.lens), set=_choose_lens)
    lens_file: StringProperty(name="Lens File", description=OWN_LENS, subtype="FILE_PATH", options=BLEND_RELATIVE,
                              update=_choose_path("lens_file"))
    view: EnumProperty(
        name="View", default="LENS", description="What the lens image shows",
        items=[("LENS", "The Lens's", "What the lens sees on its own sensor; Match Camera to Lens shows it beforehand"),
               ("CAMERA", "The Camera's", "What the scene's camera sees, the lens being made as large as that takes: "
                                          "its blur scales with it, and so does the focus of a lens at rest")])
    depth: EnumProperty(
        name="Depth", default="AUTO", description="How what is out of focus is blurred",
        items=[("AUTO", "As Needed", "In layers of depth that are rendered one by one, where the scene is deeper than "
                                     "what is in focus"),
               ("OFF", "Off", "Not at all: everything is as sharp as what is in focus"),
               ("TRACED", "Traced Lens", "Cycles traces its rays through the lens itself: slow, and without "
                                         "diffraction, but true for glass, mirrors and volumes, "
                                         "too. It takes a prescription")])
    focused_wide_open: BoolProperty(
        name="Focused Wide Open", default=False,
        description="Focus at the widest aperture and stop down after that, as with a rangefinder: where a lens's "
                    "focus shifts with its f-stop, the picture is a little off. Else it is focused at its f-stop")
    iris_roundness: FloatProperty(
        name="Roundness", subtype="FACTOR", default=0.0, min=0, max=1,
        description="Of the blades of the camera's aperture, where the lens is stopped down: from straight ones to a "
                    "circle")
    wavelength_mode: EnumProperty(
        name="Wavelengths", default="RANGE",
        items=[("RANGE", "Range", "Evenly spaced wavelengths"), ("LIST", "List", "Wavelengths one by one")])
    wavelength_first_nm: FloatProperty(name="First", description="Shortest wavelength in nm", default=FIRST_NM, min=1,
                                       precision=1)
    wavelength_last_nm: FloatProperty(name="Last", description="Longest wavelength in nm", default=LAST_NM, min=1,
                                      precision=1)
    wavelength_count: IntProperty(name="Number", default=NUMBER, min=1, soft_max=61,
                                  description="Number of wavelengths of the lens image. How many of them are "
                                              "rendered is up to the spectra, below")
    wavelength_list: StringProperty(name="List", description="Ascending wavelengths in nm, such as 450, 550, 650",
                                    default="450, 550, 650")
    tier: EnumProperty(
        name="Quality", default="STANDARD", description="How true colours and blur are to be, and so what they take",
        items=[("PREVIEW", "Preview", "For a look: a single Cycles render of three wavelengths tells all others, "
                                      "roughly: pure reds, greens and blues to 2 %. Up to 10 % of a point's light may "
                                      "land in the wrong place"),
               ("STANDARD", "Standard", "For pictures: Cycles renders as many wavelengths as keep colours within what "
                                        "can just be seen, often 6 to 12; all others follow from them. Up to 1 % of a "
                                        "point's light may land in the wrong place"),
               ("REFERENCE", "Reference", "For measuring: each wavelength is rendered, without clamps or denoising. Up "
                                          "to 0.1 % of a point's light may land in the wrong place"),
               ("RESULT", "Custom", "Say how true colours and blur have to be, or choose the size of sections")])
    colour_error: FloatProperty(
        name="Colour Error", default=STANDARD_COLOUR_ERROR, min=0.001, soft_min=0.05, soft_max=5, precision=2,
        description="CIEDE2000 difference that 95 % of the scene's possible colours are to stay within: 1 is just "
                    "seen. Less takes more Cycles passes")
    unfit: EnumProperty(
        name="Unfit Nodes", default="REFUSE",
        description="Nodes that Cycles renders in red, green and blue alone; Check Scene lists them",
        items=[("REFUSE", "Refuse", "Stop with an error that names the first"),
               ("RENDER", "Render Anyway", "Take the colours that Cycles gives them, made spectra as other colours "
                                           "are. Beyond Preview each wavelength then takes a render")])
    quality: EnumProperty(
        name="Blur", default="ACCURACY", description="How true the lens's blur is to be",
        items=[("ACCURACY", "By Result", "Say how accurate the picture has to be; the quickest way there is chosen"),
               ("KNOBS", "By Section Size", "Choose how it is done: the method, and the size of its sections")])
    accuracy: FloatProperty(
        name="Misplaced Light", subtype="FACTOR", default=DEFAULT_ACCURACY, min=1e-6, max=1, soft_min=0.001,
        soft_max=0.1, precision=4,
        description="The largest part of any point's light that may land in the wrong place: 0.01 leaves at least 99 % "
                    "of it where the lens puts it. Less is slower")
    method: EnumProperty(
        name="Method", default="SECTIONS", description="How the lens's blur is applied",
        items=[("SECTIONS", "Sections", "Section by section, point spread functions varying inside each", 0),
               ("PIXELS", "Pixels", "Every pixel its own point spread function, from a table: for small ones", 1),
               ("PAPER", "Paper", "One point spread function for each section: the method of the paper", 3),
               ("EXACT", "Exact", "Every pixel its own point spread function, without a table: very slow", 2)])
    section_size: IntProperty(name="Section Size", subtype="PIXEL", default=SECTION_SIZE, min=1, soft_max=256,
                              description="Side of the sections. By the paper's method smaller is more accurate and "
                                          "slower; else it is a matter of speed alone")
    azimuths: IntProperty(name="Azimuths", default=AZIMUTHS, min=1, soft_max=256,
                          description="Steps of the table from 0 to 45 degrees. More is more accurate and takes more "
                                      "time and memory")
    supersampling: IntProperty(
        name="Supersampling", default=Options.supersampling, min=1, max=MOST_SUPERSAMPLING,
        description="Filter the picture in so many pixels across and down for each one, where the lens's blur is finer "
                    "than a pixel. It takes as long, and as much memory, as a picture so much larger")
    out_of_field: EnumProperty(
        name="Out of Field", default=Options.out_of_field.upper(),
        description="Pixels beyond the last field height of the lens data",
        items=[("HOLD", "Hold", "Hold the last point spread function and relative illumination"),
               ("VIGNETTE", "Black", "Leave it black")])
    fireflies: EnumProperty(
        name="Fireflies", default=Options.fireflies.upper(), description="Pixels whose light is no finite number",
        items=[("REFUSE", "Refuse", "Stop with an error that names the first"),
               ("CLAMP", "Clamp", "Take the brightest of their neighbours")])
    denoise: EnumProperty(
        name="Denoise", default="SCENE",
        description="Let Cycles denoise its passes. It shifts means by up to 1 %, of dim wavelengths by more",
        items=[("SCENE", "As the Scene", "As Cycles' own Denoise is set; but never in Reference", 2),
               ("ON", "On", "Whatever the scene says", 1),
               ("OFF", "Off", "Whatever the scene says", 0)])
    output_folder: StringProperty(name="Output", description="Folder for the spectral EXRs and the pictures",
                                  default="//lensfield/", subtype="DIR_PATH", options=BLEND_RELATIVE,
                                  update=_choose_path("output_folder"))
    to_compositor: BoolProperty(name="To Compositor", default=True,
                                description="Lay the lens image into the scene's compositor when it is done")
    view_layer: StringProperty(name="View Layer", default="",
                               description="The view layer to render. Empty: the one that is on for rendering")
    compositor_shows: EnumProperty(
        name="Compositor Shows", default="FRESH", update=lambda settings, context: refresh(settings.id_data),
        description="What the Lensfield node of the compositor hands on",
        items=[("FRESH", "Lens Image if Up to Date", "The lens image at frames that have one, unless the scene has "
                                                     "changed since; else the plain render"),
               ("ALWAYS", "Lens Image if Any", "The lens image at frames that have one, even if the scene has changed"),
               ("NEVER", "Plain Render", "What the node is given")])
    compositor_key: StringProperty(options={"HIDDEN"})  # tells the scene's own lens images from those of another file

    def lens_name_or_path(self):
        """What `Lens.load` takes; raises SceneError for a file that is not trusted."""
        path = bpy.path.abspath(self.lens_text())
        if path and self.lens == FROM_FILE:
            check_trusted(path, "scene settings", "lens file")
        return path

    def lens_text(self):
        """The name or the path, as it is set."""
        return self.lens_file if self.lens == FROM_FILE else self.lens

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

    def to_spectral_options(self, **given):
        """How true spectra are asked to be; by what is given alone, if anything is."""
        if given:
            return SpectralOptions(**given)
        if self.tier == "RESULT":
            return SpectralOptions(colour_error=float(f"{self.colour_error:.6g}"))
        return SpectralOptions(self.tier.lower())

    def denoises(self, spectral):
        """Whether Cycles is to denoise its passes, at these SpectralOptions."""
        if self.denoise == "SCENE":
            return self.id_data.cycles.use_denoising and spectral.tier != "reference"
        return self.denoise == "ON"

    def shown_knobs(self):
        """The knobs of the method that the panel has."""
        return [name for name in PANEL_KNOBS if name in METHODS[self.method.lower()].knobs]

    def to_options(self, tier=None, **given):
        """The engine's Options, with what is given in place of what is set: the only bridge to it.

        Accuracy, method and knobs go together: where one of them is given, none is taken from the settings, nor from
        the tier.
        """
        asked = {} if given.keys() & {"accuracy", "method", *KNOBS} else self._blur(tier or self.tier.lower())
        return Options(**asked | {"out_of_field": self.out_of_field.lower(), "fireflies": self.fireflies.lower()}
                       | given)

    def _blur(self, tier):
        if tier in TIER_ACCURACY:
            return {"accuracy": TIER_ACCURACY[tier]}
        if self.quality == "KNOBS":
            blur = {"method": self.method.lower()} | {name: getattr(self, name) for name in self.shown_knobs()}
        else:
            blur = {"accuracy": float(f"{self.accuracy:.6g}")}  # Blender's floats are single: 0.01 is 0.0099999998
        return blur | {"supersampling": self.supersampling}


classes = (LensfieldWorldSpectra, LensfieldLightSpectra, LensfieldMaterialSpectra, LensfieldSettings)

_OWNERS = ((bpy.types.Scene, LensfieldSettings), (bpy.types.Material, LensfieldMaterialSpectra),
           (bpy.types.Light, LensfieldLightSpectra), (bpy.types.World, LensfieldWorldSpectra))


def register_pointers():
    for owner, group in _OWNERS:
        owner.lensfield = PointerProperty(type=group)


def unregister_pointers():
    for owner, _ in reversed(_OWNERS):
        del owner.lensfield
