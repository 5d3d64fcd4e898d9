"""A scene's settings: the resulting options of the engine, their panels, and the data that renders of a session share.
"""


import bpy
import numpy as np
import pytest

from layouts import Layout
from lensfield import addon
from lensfield.addon.render.render import shared_cache
from lensfield.addon.scene.lens_cache import load_lens
from lensfield.addon.ui.common.properties import LensfieldSettings, offered_lenses
from lensfield.addon.ui.panels import draw_settings
from lensfield.engine import Options, simulate
from lensfield.engine.blur import METHODS
from lensfield.engine.library import BUNDLED
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.plan.options import DEFAULT_ACCURACY
from lensfield.engine.simulation import channel_cache
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions
from places import SAMPLE_SCENE
from small_scenes import WAVELENGTHS_NM, light, material, render, set_world, wall

CUSTOM = {"tier": "RESULT"}


@pytest.mark.parametrize("settings, options", [
    ({}, Options(accuracy=DEFAULT_ACCURACY)),
    ({"tier": "PREVIEW"}, Options(accuracy=0.1)),
    ({"tier": "REFERENCE", "accuracy": 0.2, "quality": "KNOBS"}, Options(accuracy=0.001)),
    (CUSTOM | {"accuracy": 0.003}, Options(accuracy=0.003)),
    (CUSTOM | {"accuracy": 1e-6}, Options(accuracy=1e-6)),
    (CUSTOM | {"accuracy": 0.1, "section_size": 8, "method": "EXACT"}, Options(accuracy=0.1)),
    ({"out_of_field": "VIGNETTE", "fireflies": "CLAMP"},
     Options(accuracy=DEFAULT_ACCURACY, out_of_field="vignette", fireflies="clamp")),
    (CUSTOM | {"quality": "KNOBS"}, Options(section_size=32, azimuths=32, method="sections")),
    (CUSTOM | {"quality": "KNOBS", "section_size": 8, "azimuths": 6, "accuracy": 0.1, "fireflies": "CLAMP"},
     Options(method="sections", section_size=8, azimuths=6, fireflies="clamp")),
    (CUSTOM | {"quality": "KNOBS", "method": "PAPER", "section_size": 16}, Options(method="paper", section_size=16)),
    (CUSTOM | {"quality": "KNOBS", "method": "PIXELS", "azimuths": 16}, Options(method="pixels", azimuths=16)),
    (CUSTOM | {"quality": "KNOBS", "method": "EXACT"}, Options(method="exact")),
    (CUSTOM | {"supersampling": 4}, Options(accuracy=DEFAULT_ACCURACY, supersampling=4)),
    (CUSTOM | {"quality": "KNOBS", "method": "EXACT", "supersampling": 2}, Options(method="exact", supersampling=2)),
    ({"supersampling": 4}, Options(accuracy=DEFAULT_ACCURACY))], ids=str)
def test_settings_determine_the_options(scene, settings, options):
    for name, value in settings.items():
        setattr(scene.lensfield, name, value)
    assert scene.lensfield.to_options() == options


@pytest.mark.parametrize("settings, given, options", [
    (CUSTOM | {"accuracy": 0.1, "fireflies": "CLAMP"}, {"out_of_field": "vignette"},
     Options(accuracy=0.1, fireflies="clamp", out_of_field="vignette")),
    ({"fireflies": "CLAMP"}, {"fireflies": "refuse", "section_size": 8}, Options(section_size=8)),
    (CUSTOM | {"quality": "KNOBS", "method": "PAPER"}, {"accuracy": 0.1}, Options(accuracy=0.1)),
    ({"accuracy": 0.1}, {"tier": "reference"}, Options(accuracy=0.001)),
    ({}, {"tier": "reference", "method": "paper"}, Options(method="paper")),
    ({"accuracy": 0.1}, {"method": "exact"}, Options(method="exact")),
    (CUSTOM | {"accuracy": 0.1}, {"supersampling": 2}, Options(accuracy=0.1, supersampling=2))], ids=str)
def test_given_options_override_settings(scene, settings, given, options):
    for name, value in settings.items():
        setattr(scene.lensfield, name, value)
    assert scene.lensfield.to_options(**given) == options


def test_given_spectral_options_override_settings(scene):
    scene.lensfield.tier = "REFERENCE"
    assert scene.lensfield.to_spectral_options() == SpectralOptions("reference")
    assert scene.lensfield.to_spectral_options(sensor_error=0.01) == SpectralOptions(sensor_error=0.01)


def test_the_panel_has_every_method():
    methods = LensfieldSettings.bl_rna.properties["method"].enum_items
    assert {method.identifier.lower() for method in methods} == set(METHODS)


@pytest.mark.parametrize("settings, shown", [
    ({}, set()),
    (CUSTOM, {"accuracy"}),
    (CUSTOM | {"quality": "KNOBS"}, {"method", "section_size", "azimuths"}),
    (CUSTOM | {"quality": "KNOBS", "method": "PAPER"}, {"method", "section_size"}),
    (CUSTOM | {"quality": "KNOBS", "method": "PIXELS"}, {"method", "azimuths"}),
    (CUSTOM | {"quality": "KNOBS", "method": "EXACT"}, {"method"})], ids=str)
def test_panels_show_only_relevant_settings(scene, settings, shown):
    for name, value in settings.items():
        setattr(scene.lensfield, name, value)
    layout = Layout()
    draw_settings(layout, scene)
    either = {"accuracy", "method", "section_size", "azimuths"}
    assert either & set(layout.shown) == shown
    assert ("supersampling" in layout.shown) == (settings.get("tier") == "RESULT")
    assert {"lens", "tier", "out_of_field", "fireflies", "lensfield.render"} <= set(layout.shown)


def test_a_file_without_an_accuracy_gets_the_default():
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLE_SCENE))
    assert bpy.context.scene.lensfield.to_options().accuracy == DEFAULT_ACCURACY


def lit_scene(scene):
    light(scene, "POINT", 20.0, color=(1, 0.5, 0.2), shadow_soft_size=0.0)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])


def test_a_render_meets_its_requested_accuracy(scene, tmp_path):
    lit_scene(scene)
    result = render(scene, tmp_path, options=Options(accuracy=0.02))
    assert result.report.lens_image.plan.error_bound <= 0.02
    radiance, image = read_exr(result.radiance), read_exr(result.irradiance)
    true = simulate(radiance, load_lens("edmund-54852"), Options(method="exact"))
    for plane, true_plane in zip(image.cube.astype(float), true.cube, strict=True):
        assert np.abs(plane - true_plane).sum() <= 0.02 * true_plane.sum()


@pytest.mark.parametrize("options", [
    Options(), Options(method="paper", section_size=16), Options(method="pixels", azimuths=8)], ids=repr)
def test_later_renders_share_the_lens_and_give_the_same_results(scene, tmp_path, monkeypatch, options):
    shared_cache.cache_clear()
    lit_scene(scene)
    first = render(scene, tmp_path / "first", options=options, stray=StrayOptions("off"))
    created = []
    monkeypatch.setattr(channel_cache, "Channel", lambda *arguments, **_: created.append(arguments))
    again = render(scene, tmp_path / "again", options=options, stray=StrayOptions("off"))
    set_world(scene, strength=0.3)
    other = render(scene, tmp_path / "other", options=options, stray=StrayOptions("off"))
    assert not created
    monkeypatch.undo()
    assert np.array_equal(read_exr(again.irradiance).cube, read_exr(first.irradiance).cube)
    alone = simulate(read_exr(other.radiance), load_lens("edmund-54852"), options)
    assert np.array_equal(read_exr(other.irradiance).cube, alone.cube)
    assert not np.array_equal(alone.cube, read_exr(first.irradiance).cube)


def test_a_changed_lens_file_is_read_again(tmp_path):
    path = tmp_path / "lens.npz"
    path.write_bytes((BUNDLED / "edmund-54852.npz").read_bytes())
    lens = load_lens(path)
    assert load_lens(path) is lens and load_lens(str(path)) is lens
    path.touch()
    assert load_lens(path) is not lens


def test_the_shared_cache_is_freed_with_the_addon(scene, tmp_path):
    render(scene, tmp_path, WAVELENGTHS_NM[:1])
    assert shared_cache.cache_info().currsize == 1
    addon.unregister()
    try:
        assert shared_cache.cache_info().currsize == 0
    finally:
        addon.register()


def test_a_saved_lens_stays_the_same_when_others_are_added(scene):
    """A .blend stores an enum's number: a position in the list would mean another lens after an addition."""
    numbers = {name: number for name, *_, number in offered_lenses()}
    assert numbers["edmund-54852"] == 14858370 and numbers["FILE"] == 12192475
    assert len(set(numbers.values())) == len(numbers)
