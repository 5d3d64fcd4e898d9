"""The render request: the consequences of its fields, without Blender."""

from dataclasses import replace
from pathlib import Path

import pytest

from lensfield.cli import _parser
from lensfield.commands.arguments import given_fields, given_settings, iris_option, stray_option
from lensfield.engine import InputError, Options
from lensfield.engine.lens.iris import Iris
from lensfield.engine.runtime.setting import option_of, settings_of
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions
from lensfield.request import RenderRequest, to_arguments
from refusals import refused

VALUES = {"lens": "tessar-50mm", "focus": 812.5, "f_number": 2.8, "wavelengths_nm": (450.0, 550.25, 650.0),
          "room": 0.125, "view_layer": "-Fog, far", "output_folder": Path("/renders"), "picture": Path("/so_far.png"),
          "state": "abc", "source": "def", "view_settings": '{"gamma": 1.0}',
          "lens_quality": "reference", "focused_wide_open": True,
          "tilt_deg": (4.0, -0.25), "copy": 12,
          "camera": "sony-a7-iv", "iso": 812.5, "shutter_s": 1 / 60, "noise": False, "develop": False, "dng": True}
ENGINE_VALUES = {"accuracy": 0.05, "section_size": 8, "azimuths": 6, "psf_energy": 0.99, "flat_tolerance": 0.001,
                 "supersampling": 2, "colour_error": 0.5, "sensor_error": 0.01, "glare_index": 2.5, "neglected": 0.1}


def parsed(*arguments):
    return _parser().parse_args(["render", "scene.blend", *arguments])


def values_of(owner, name):
    """Different values of a setting: all of its choices, or an example."""
    each = settings_of(owner)[name]
    return list(each.choices) or [(VALUES | ENGINE_VALUES)[name]]


@pytest.mark.parametrize("name", [name for name, each in settings_of(RenderRequest).items() if each.option is not None])
def test_each_field_passes_through_the_command_line(name):
    for value in values_of(RenderRequest, name):
        given = given_fields(parsed(*to_arguments(**{name: value})))
        assert given.keys() == {name}
        assert (tuple(given[name]) if name == "wavelengths_nm" else given[name]) == value


@pytest.mark.parametrize("owner, name", [(owner, name) for owner in (Options, SpectralOptions, StrayOptions)
                                         for name in settings_of(owner)])
def test_each_engine_option_passes_through_the_command_line(owner, name):
    for value in values_of(owner, name):
        given = given_settings(parsed(f"--{option_of(name, settings_of(owner)[name])}={value}"), owner)
        assert given == {name: value}


def test_options_and_iris_pass_through_the_command_line():
    options, spectral = Options(accuracy=0.05, out_of_field="vignette"), SpectralOptions(colour_error=0.5)
    stray = StrayOptions("ghosts,star", cleanliness="dusty")
    words = parsed(*to_arguments(options=options, spectral=spectral, iris=Iris(5, -12.5, 0.25), stray=stray))
    assert Options(**given_settings(words, Options)) == options
    assert SpectralOptions(**given_settings(words, SpectralOptions)) == spectral
    assert iris_option(words) == Iris(5, -12.5, 0.25) and stray_option(words) == stray


def test_a_request_compares_by_its_fields_and_refuses_unknown_choices():
    assert RenderRequest() == RenderRequest() != replace(RenderRequest(), unfit="render")
    for name, each in settings_of(RenderRequest).items():
        if each.choices:
            with refused(InputError, field=name, value="maybe", match=next(iter(each.choices))):
                RenderRequest(**{name: "maybe"})


def test_every_field_has_a_label_and_a_documented_text():
    for name, each in settings_of(RenderRequest).items():
        assert each.name and each.text and not each.text.endswith(".")
        assert f"    {name}\n        {each.text}." in RenderRequest.__doc__
