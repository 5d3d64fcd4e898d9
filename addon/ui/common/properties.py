"""The user's settings: the lens and the body of cameras, the scene's, and spectra of materials, lights and worlds."""

import os
import unicodedata
from dataclasses import replace
from functools import cache, partial
from math import degrees, isfinite, radians
from pathlib import Path
from zlib import crc32

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from lensfield.engine import Options
from lensfield.engine.blur import METHODS
from lensfield.engine.lens.formats import FORMATS
from lensfield.engine.lens.iris import Iris
from lensfield.engine.library import described_lenses
from lensfield.engine.library.bodies import described_cameras
from lensfield.engine.plan.options import AUTO, KNOBS, TIER_ACCURACY
from lensfield.engine.prescription.readers import SUFFIXES
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.inputs import note_who_names
from lensfield.engine.runtime.setting import settings_of
from lensfield.engine.spectral.refraction import refraction_names
from lensfield.engine.spectral.spectra import library_names, parse_wavelengths
from lensfield.engine.spectral.wavelength_choice import IMAGE_WAVELENGTHS, SpectralOptions
from lensfield.engine.stray.options import OFF, PARTS, StrayOptions

from ....request import CAMERA, RenderRequest, view_on_sensor
from ...job.job import folder_for
from ...job.named_files import FROM_FILE
from ...scene.active_camera import camera_settings
from ...scene.compositor import refresh
from ...scene.linked import stated_path
from ...scene.trust import check_trusted, trust
from ...shading.assigned import spectrum_path
from .favourite_lenses import favourite_lenses
from .plain_words import sentence
from .previews import lens_picture
from .shown_exposure import fixed_value

DEFAULT_LENS = "tessar-50mm"  # a normal lens for a camera's usual frame, focused far away
FIRST_NM, LAST_NM, NUMBER = (int(word) for word in IMAGE_WAVELENGTHS.split(":"))
PANEL_KNOBS = "section_size", "azimuths"  # the knobs of methods that the panel shows
NOT_OFFERED = {"method": AUTO}
"""Choices without an item: the user sets an accuracy instead."""
MORE_ITEMS = {"tier": [("RESULT", "Custom", "Set the accuracy of colours and blur, or the size of sections")],
              "view": [("SENSOR", "Custom Sensor", "The lens's field of view on a sensor of your size")],
              "stray_light": [("PARTS", "Chosen Parts", "Only the parts you tick, even if they are faint")]}
"""Items that only the panel has."""
FAVOURITE, COMPARED = "\u2605 ", "\U0001F4F7 "  # marks in the names of lenses: a star, and a camera
NO_BODY = "NONE"
OWN_BODY = "Your own camera (.toml), with the parameters of EMVA 1288"
OWN_LENS = f"Your own prescription ({', '.join(SUFFIXES)}), with adjustable focus and f-stop, or a lens package (.npz)"
OVERRIDABLE = {"LIBRARY_OVERRIDABLE"}  # in library overrides of cameras
BLEND_RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"}  # paths that start with // are relative to the .blend


def _suggestions(names):
    """A search callback that suggests the names that contain the typed text."""
    return lambda self, context, typed: [name for name in names() if typed.lower() in name]


def _spectrum_property(name, description, names, form):
    return StringProperty(name=name, default="", search=_suggestions(names), search_options={"SUGGESTION"},
                          description=f"{description}: a name from the library, {form}",
                          update=lambda spectra, context: trust(spectrum_path(spectra.id_data, name.lower())))


def _emission():
    return _spectrum_property(
        "Emission", "Spectrum that replaces the colour of the light; only its shape matters, the strength is unchanged",
        lambda: library_names("light"), "a two-column file (nm, value), or pairs such as 400:0.1, 700:0.2")


class LensfieldWorldSpectra(bpy.types.PropertyGroup):
    """Spectra of a world."""

    emission: _emission()


class LensfieldLightSpectra(bpy.types.PropertyGroup):
    """Spectrum and power of a light."""

    emission: _emission()
    power_unit: EnumProperty(
        name="Power", default="BLENDER",
        items=[("BLENDER", "As in Blender", "The light's own Power. A light with a temperature is as bright as in "
                "Blender, which gives every temperature the luminance of white", 2),
               ("WATT", "Watts", "The light's own Power, emitted between 380 and 780 nm whatever its temperature (for "
                "a sun, per m\u00b2)", 0),
               ("LUMEN", "Lumens", "Luminous flux, as printed on a lamp's package, instead of Power (for a sun, lux)",
                1)])
    lumens: FloatProperty(name="Lumens", default=800, min=0, soft_max=1e5,
                          description="Luminous flux in lumens; for a sun, illuminance in lux")


class LensfieldMaterialSpectra(bpy.types.PropertyGroup):
    """Spectra of a material."""

    reflectance: _spectrum_property(
        "Reflectance", "Spectral reflectance that replaces the base colour (if empty, the colour is upsampled)",
        lambda: library_names("reflectance"), "a two-column file (nm, value), or pairs such as 400:0.1, 700:0.2")
    emission: _emission()
    refraction: _spectrum_property(
        "Refraction", "Substance that sets the refractive index. Glass uses it instead of its IOR, and disperses; "
        "metals without a reflectance reflect by it", refraction_names,
        "or a file of refractiveindex.info (.yml)")


def _lasting_number(name):
    """The number that identifies a lens or a camera in a .blend, whatever its position in the list."""
    return crc32(name.encode()) >> 8  # buttons and pickers pass numbers through floats, which are exact to 24 bits


def lens_items(self, context):
    """The lenses to choose from, as an items callback: Blender accepts only a plain function."""
    return offered_lenses()


@cache
def offered_lenses():
    """The lenses to choose from, favourites first, by title: list of (identifier, name, description, icon, number).
    Names start with marks of favourites and of lenses that were compared with photographs."""
    favourites, lenses = favourite_lenses(), described_lenses()
    bundled = [(name, f"{FAVOURITE * (name in favourites)}{COMPARED * bool(lenses[name].photographs)}"
                      f"{lenses[name].title}", _tooltip(lenses[name]), lens_picture(name) or "CAMERA_DATA",
                _lasting_number(name))
               for name in sorted(lenses, key=lambda name: (name not in favourites, _collated(lenses[name].title)))]
    from_file = FROM_FILE, "From File", OWN_LENS, "FILE_FOLDER", _lasting_number(FROM_FILE)
    return [*bundled, from_file]


def _tooltip(lens):
    """Maker, character, story and agreement with photographs."""
    agreement = f"\n{sentence(str(lens.photographs))}" if lens.photographs else ""
    return f"{lens.maker}: {', '.join(lens.character)}. {lens.story}{agreement}"


def _collated(title):
    """A title as sorted, without accents and case."""
    return unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode().casefold()


def body_items(self, context):
    """The camera bodies to choose from, as an items callback."""
    return _offered_bodies()


@cache
def _offered_bodies():
    bundled = [(name, camera.title, "{:.3g} \u00d7 {:.3g} mm, {} \u00d7 {} pixels".format(
        *camera.size_mm, *reversed(camera.shape_px)), "CAMERA_DATA", _lasting_number(name))
        for name, camera in described_cameras().items()]
    none = NO_BODY, "None", "The lens image is the light on the sensor", "X", _lasting_number(NO_BODY)
    return [none, *bundled, (FROM_FILE, "From File", OWN_BODY, "FILE_FOLDER", _lasting_number(FROM_FILE))]


def searched_lens_items(self, context):
    """Like `lens_items`, with all searchable words in each name."""
    return _searched_lenses()


@cache
def _searched_lenses():
    facts = {name: (f"{lens.focal_length_mm:g}mm", lens.maker, *lens.character)
             for name, lens in described_lenses().items()}
    return [(name, ", ".join((title, *facts.get(name, ()))), *rest) for name, title, *rest in offered_lenses()]


def matching_lenses(words):
    """The names of all lenses whose searchable text contains these words."""
    return {name for name, text, *_ in _searched_lenses()
            if all(word in text.lower() for word in words.lower().split())}


def forget_items():
    """Clear the cached items, which refer to icons."""
    for items in (offered_lenses, _searched_lenses, _offered_bodies):
        items.cache_clear()


def _choose_path(field):
    """An update callback that trusts the path when a user or a script sets it. Opening a file does not call it."""
    return lambda settings, context: trust(stated_path(settings.id_data, field))


def _auto(name, title):
    """The switch of a camera's exposure setting that is automatic at 0."""
    def is_auto(settings):
        return getattr(settings, name) == 0

    def set_auto(settings, auto):
        if auto != is_auto(settings):
            setattr(settings, name, 0.0 if auto else fixed_value(settings.id_data, name))

    return BoolProperty(name="Auto", get=is_auto, set=set_auto, options=set(), override=OVERRIDABLE,
                        description=f"The camera's meter chooses the {title}. Turned off, the {title} stays as it "
                                    "was metered, until you change it")


def lens_title(name_or_path):
    """The name of a lens in panels: its title, or its file name."""
    lens = described_lenses().get(name_or_path)
    return lens.title if lens else os.path.basename(name_or_path)


def offered_title(name):
    """The name of a bundled lens with its marks, as the list shows it."""
    return next(title for offered, title, *_ in offered_lenses() if offered == name)


def _as_set(number):
    """The number that the user entered: in Blender's single precision 0.01 is 0.0099999998."""
    return float(f"{number:.6g}")


def _property(name, each):
    """The Blender property of a setting."""
    default = each.default if each.panel_default is None else each.panel_default
    common = {"name": each.name, "description": each.text, "override": OVERRIDABLE if each.owner == CAMERA else set()}
    if each.several:
        items = [(value.upper(), *texts, 1 << number) for number, (value, texts) in enumerate(each.choices.items())]
        return EnumProperty(items=items, options={"ENUM_FLAG"}, default=set(), **common)
    if each.choices:
        return EnumProperty(items=_items(name, each), default=default.upper(), **common)
    if each.kind is bool:
        return BoolProperty(default=default, **common)
    common |= {"default": default, "subtype": each.subtype}
    if each.kind is Path:
        return StringProperty(options=BLEND_RELATIVE, update=_choose_path(name), **common)
    if each.kind is str:
        return StringProperty(**common)
    limits = tuple(map(radians, each.limits)) if each.subtype == "EULER" else each.limits or ()
    common |= _finite(zip(("min", "max"), limits, strict=False))
    common |= _finite(zip(("soft_min", "soft_max"), each.soft_limits or (), strict=False))
    if each.kind is int:
        return IntProperty(**common)
    if isinstance(default, tuple):
        return FloatVectorProperty(size=len(default), **common)
    if each.precision is not None:
        common["precision"] = each.precision
    return FloatProperty(**common)


def _items(name, each):
    """The items of an EnumProperty; identifiers are the setting's choices in capitals."""
    offered = [(value.upper(), *texts) for value, texts in each.choices.items() if value != NOT_OFFERED.get(name)]
    return [(*item, number) for number, item in enumerate([*offered, *MORE_ITEMS.get(name, ())])]


def _finite(limits):
    return {name: value for name, value in limits if isfinite(value)}


class _Settings:
    """Base of groups of settings: their values as the fields of requests and options store them."""

    __slots__ = ()

    def value_of(self, name):
        """The value of a setting."""
        value, kind = getattr(self, name), self.bl_rna.properties[name].type
        if isinstance(value, set):
            return ",".join(choice for choice in SETTINGS[name].choices if choice.upper() in value)
        if self.bl_rna.properties[name].subtype == "EULER":  # in radians
            return tuple(_as_set(degrees(each)) for each in value)
        return value.lower() if kind == "ENUM" else _as_set(value) if kind == "FLOAT" else value


class LensfieldCameraSettings(_Settings, bpy.types.PropertyGroup):
    """Settings of a camera: fields of a RenderRequest that describe its lens and its body."""

    __slots__ = ()  # names without a property raise an AttributeError

    lens: EnumProperty(
        name="Lens", description="Lens to render through", default=_lasting_number(DEFAULT_LENS),
        items=lens_items, override=OVERRIDABLE)
    lens_file: StringProperty(name="Lens File", description=OWN_LENS, subtype="FILE_PATH", options=BLEND_RELATIVE,
                              update=_choose_path("lens_file"), override=OVERRIDABLE)
    body: EnumProperty(
        name="Camera", default=_lasting_number(NO_BODY), items=body_items, override=OVERRIDABLE,
        description="Camera that takes a picture of the lens image. Its sensor replaces the lens's sensor")
    body_file: StringProperty(name="Camera File", description=OWN_BODY, subtype="FILE_PATH", options=BLEND_RELATIVE,
                              update=_choose_path("body_file"), override=OVERRIDABLE)
    auto_iso: _auto("iso", "ISO")
    auto_shutter: _auto("shutter_s", "shutter")
    iris_roundness: _property("iris_roundness", replace(settings_of(Iris)["roundness"], owner=CAMERA))
    sensor_mm: FloatVectorProperty(name="Sensor (mm)", description="Width and height of the sensor", size=2,
                                   default=FORMATS["fullframe"][1], min=0.1, max=1000, precision=2,
                                   override=OVERRIDABLE)

    def lens_name_or_path(self):
        """The name or path for `load_lens`; raises SceneError for an untrusted file."""
        if self.lens != FROM_FILE:
            return self.lens
        if path := stated_path(self.id_data, "lens_file"):
            check_trusted(path, "camera settings", "lens file", "lensfield lens check FILE quotes it")
        return path

    def lens_text(self):
        """The name or the path, as entered."""
        return self.lens_file if self.lens == FROM_FILE else self.lens

    def body_name_or_path(self):
        """The name or path for `load_camera`, "" for none; raises an InputError for no file, an untrusted one, or a
        camera that Lensfield no longer has."""
        if not self.body:  # the .blend has another version's number
            raise InputError("camera settings", "camera body", "unknown",
                             "choose one that this version of Lensfield has")
        if self.body != FROM_FILE:
            return "" if self.body == NO_BODY else self.body
        if not self.body_file:
            raise InputError("camera settings", "camera file", "empty", "choose a file (.toml), or another camera")
        path = stated_path(self.id_data, "body_file")
        check_trusted(path, "camera settings", "camera file", "lensfield camera info FILE quotes it")
        return path

    def view_text(self):
        """The field of view in the syntax of `lensfield render --view`, on the camera's sensor if there is one."""
        return view_on_sensor(self.chosen_view(), self.body_name_or_path())

    def chosen_view(self):
        """As `view_text`, without regard to the camera's sensor."""
        return "{:.6g}x{:.6g}".format(*self.sensor_mm) if self.view == "SENSOR" else self.view.lower()

    def readers(self, body_given):
        """Functions that return the camera's fields of a RenderRequest, by name. Another body, if one is given, decides
        on the sensor."""
        listed = {name: partial(self.value_of, name) for name in CAMERA_SETTINGS}
        return listed | {"lens": self.lens_name_or_path, "camera": self.body_name_or_path,
                         "view": self.chosen_view if body_given else self.view_text}


class LensfieldSettings(_Settings, bpy.types.PropertyGroup):
    """Settings of a scene's lens render: fields of a RenderRequest that all cameras share, and the wavelengths."""

    __slots__ = ()

    wavelength_mode: EnumProperty(
        name="Wavelengths", description="How the wavelengths of the lens image are specified", default="RANGE",
        items=[("RANGE", "Range", "Evenly spaced wavelengths"), ("LIST", "List", "Individual wavelengths")])
    wavelength_first_nm: FloatProperty(name="First", description="Shortest wavelength in nm", default=FIRST_NM, min=1,
                                       precision=1)
    wavelength_last_nm: FloatProperty(name="Last", description="Longest wavelength in nm", default=LAST_NM, min=1,
                                      precision=1)
    wavelength_count: IntProperty(name="Number", default=NUMBER, min=1, soft_max=61,
                                  description="Number of wavelengths of the lens image. The quality and the scene's "
                                              "spectra determine how many of them Cycles renders")
    wavelength_list: StringProperty(name="List", description="Ascending wavelengths in nm, such as 450, 550, 650",
                                    default="450, 550, 650")
    stray_parts: EnumProperty(
        name="Parts", description="Parts of the stray light", options={"ENUM_FLAG"},
        default={part.upper() for part in PARTS},
        items=[(part.upper(), *texts, 1 << number) for number, (part, texts) in enumerate(PARTS.items())])
    quality: EnumProperty(
        name="Blur", default="ACCURACY", description="Accuracy of the lens's blur",
        items=[("ACCURACY", "By Result", "Set the accuracy of the picture; the fastest method that reaches it is used"),
               ("KNOBS", "By Section Size", "Set the method and the size of its sections")])
    compositor_shows: EnumProperty(
        name="Compositor Shows", default="FRESH", update=lambda settings, context: refresh(settings.id_data),
        description="Output of the Lensfield node in the compositor",
        items=[("FRESH", "Lens Image if Up to Date", "The lens image at frames that have one, unless the scene "
                                                     "has changed since; otherwise, the plain render"),
               ("ALWAYS", "Lens Image if Any", "The lens image at frames that have one, even if the scene has changed"),
               ("NEVER", "Plain Render", "The node's input")])
    compositor_key: StringProperty(options={"HIDDEN"})  # distinguishes the scene's lens images from other files' images

    def wavelengths_text(self):
        """The wavelengths in the syntax of `lensfield render --wavelengths`."""
        if self.wavelength_mode == "LIST":
            return self.wavelength_list
        if self.wavelength_count == 1:
            return f"{self.wavelength_first_nm:g}"
        return f"{self.wavelength_first_nm:g}:{self.wavelength_last_nm:g}:{self.wavelength_count}"

    def wavelengths_nm(self):
        """Ascending array of wavelengths; raises InputError."""
        return parse_wavelengths(self.wavelengths_text())

    def to_request(self, **given):
        """The RenderRequest of the settings of the scene and of its active camera, except for the given fields; None
        counts as not given.

        Raises
        ------
        InputError
            The camera is missing, the lens's file is not trusted, or the wavelengths are not valid.
        """
        given = {name: value for name, value in given.items() if value is not None}
        for file in (given.get("lens"), given.get("camera")):
            if isinstance(file, str | os.PathLike):
                note_who_names(file, None)
        listed = {name: partial(self.value_of, name) for name in settings_of(RenderRequest) if name in SCENE_SETTINGS}
        readers = camera_settings(self.id_data).readers("camera" in given) | listed | {
            "wavelengths_nm": self.wavelengths_nm, "options": self.to_options,
            "spectral": self.to_spectral_options, "stray": self.to_stray_options, "output_folder": lambda: None}
        request = RenderRequest(**{name: read() for name, read in readers.items() if name not in given} | given)
        return replace(request, wavelengths_nm=tuple(map(float, request.wavelengths_nm)),
                       output_folder=folder_for(self.id_data, request.output_folder))

    def without_camera(self, **given):
        """As `to_request`, with the defaults of the fields that describe a camera, except for the given fields."""
        return self.to_request(**{name: each.default for name, each in settings_of(RenderRequest).items()
                                  if each.owner == CAMERA} | given)

    def to_spectral_options(self, **given):
        """The SpectralOptions of these settings; if any fields are given, of the given fields only."""
        if given:
            return SpectralOptions(**given)
        if self.tier == "RESULT":
            return SpectralOptions(colour_error=self.value_of("colour_error"))
        return SpectralOptions(self.value_of("tier"))

    def to_stray_options(self, **given):
        """The StrayOptions of these settings, except for the given fields."""
        values = {name: self.value_of(name) for name in settings_of(StrayOptions)}
        if self.stray_light == "PARTS":
            values["stray_light"] = ",".join(part for part in PARTS if part.upper() in self.stray_parts) or OFF
        return StrayOptions(**values | given)

    def shown_knobs(self):
        """The knobs of the chosen method that the panel shows."""
        return [name for name in PANEL_KNOBS if name in METHODS[self.value_of("method")].knobs]

    def to_options(self, tier=None, **given):
        """The engine's Options from these settings, except for the given fields: the only bridge to the engine.

        Accuracy, method and knobs belong together: if one of them is given, none is taken from the settings or from
        the tier.
        """
        blur = {} if given.keys() & {"accuracy", "method", *KNOBS} else self._blur(tier or self.value_of("tier"))
        listed = {name: self.value_of(name) for name, each in settings_of(Options).items() if each.panel}
        return Options(**blur | listed | given)

    def _blur(self, tier):
        if tier in TIER_ACCURACY:
            return {"accuracy": TIER_ACCURACY[tier]}
        if self.quality == "KNOBS":
            blur = {"method": self.value_of("method")} | {name: getattr(self, name) for name in self.shown_knobs()}
        else:
            blur = {"accuracy": self.value_of("accuracy")}
        return blur | {"supersampling": self.supersampling}


SETTINGS = {name: each for owner in (RenderRequest, SpectralOptions, StrayOptions, Options)
            for name, each in settings_of(owner).items() if each.panel is not None}
CAMERA_SETTINGS = [name for name, each in SETTINGS.items() if each.owner == CAMERA]
SCENE_SETTINGS = [name for name, each in SETTINGS.items() if each.owner != CAMERA]
for _group, _names in ((LensfieldCameraSettings, CAMERA_SETTINGS), (LensfieldSettings, SCENE_SETTINGS)):
    _group.__annotations__ |= {name: _property(name, SETTINGS[name]) for name in _names}
classes = (LensfieldWorldSpectra, LensfieldLightSpectra, LensfieldMaterialSpectra, LensfieldCameraSettings,
           LensfieldSettings)

_OWNERS = ((bpy.types.Scene, LensfieldSettings), (bpy.types.Camera, LensfieldCameraSettings),
           (bpy.types.Material, LensfieldMaterialSpectra), (bpy.types.Light, LensfieldLightSpectra),
           (bpy.types.World, LensfieldWorldSpectra))


def register_pointers():
    for owner, group in _OWNERS:
        owner.lensfield = PointerProperty(type=group, override=OVERRIDABLE)


def unregister_pointers():
    for owner, _ in reversed(_OWNERS):
        del owner.lensfield
