"""Pictures have the look of the scene, in which Blender shows and saves its own renders."""

import json

import bpy
import numpy as np
import pytest
from PIL import Image

from lensfield import addon
from lensfield.addon.job.shown import LOOK
from lensfield.addon.scene.compositor import show_file
from lensfield.addon.scene.look import look_from, look_of, shown_pixels, to_text
from lensfield.engine.pictures.spectral_exr import read_attribute, read_parts
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.stray.options import StrayOptions
from refusals import refused
from small_scenes import WAVELENGTHS_NM, light, material, wall

ROUNDING = 1  # of 255
APPLIED = {"lens": "tessar-50mm", "lens_quality": "preview", "stray": StrayOptions("off")}  # as in the scene


@pytest.fixture
def lit_scene(scene):
    light(scene, "POINT", 20.0, color=(1, 0.5, 0.2))
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    view = scene.view_settings
    scene.display_settings.display_device = "sRGB"
    view.view_transform, view.look, view.exposure, view.gamma = "AgX", "AgX - Punchy", 1.5, 1.2
    scene.render.image_settings.file_format = "OPEN_EXR"  # must not matter
    return scene


def pixels(path):
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")).astype(int)


def saved_by_blender(scene, path, folder):
    """What Blender saves for a file of linear light in this scene."""
    image = show_file(None, str(path), "light")
    scene.render.image_settings.file_format, scene.render.dither_intensity = "PNG", 0
    image.save_render(str(folder / "blender.png"), scene=scene)
    return pixels(folder / "blender.png")


def test_pictures_look_as_in_the_scenes_window(lit_scene, tmp_path):
    """And those of another lens, in the look of the render unless another is given."""
    given = {"lens": "tessar-50mm", "wavelengths_nm": WAVELENGTHS_NM, "lens_quality": "preview"}
    result = addon.render_through_lens(lit_scene, **given, output_folder=tmp_path, picture=tmp_path / "so_far.png")
    assert set(bpy.data.images.keys()) <= {"Render Result"} and bpy.data.scenes.keys() == [lit_scene.name]
    assert look_from(read_attribute(result.radiance, LOOK), "file") == look_of(lit_scene)
    lit_scene.view_settings.exposure = -1.0
    applied = addon.apply_lens(result.radiance, **APPLIED,
                               output_folder=tmp_path / "a")
    assert np.array_equal(pixels(applied.after), pixels(result.after))
    other = addon.apply_lens(result.radiance, **APPLIED, output_folder=tmp_path / "b",
                             view_settings=to_text(look_of(lit_scene)))
    assert pixels(other.after).mean() < pixels(result.after).mean() - 10
    assert np.abs(pixels(other.after) - saved_by_blender(lit_scene, result.lens_image, tmp_path)).max() <= ROUNDING
    lit_scene.view_settings.exposure = 1.5
    assert np.abs(pixels(result.after) - saved_by_blender(lit_scene, result.lens_image, tmp_path)).max() <= ROUNDING
    frame = pixels(result.before)
    assert np.abs(frame.mean(axis=(0, 1)) - pixels(tmp_path / "so_far.png").mean(axis=(0, 1))).max() < 3


def test_the_standard_look_has_an_exposure_of_its_own(lit_scene, tmp_path):
    given = {"lens": "tessar-50mm", "wavelengths_nm": WAVELENGTHS_NM, "lens_quality": "preview", "look": "standard"}
    first = addon.render_through_lens(lit_scene, **given, output_folder=tmp_path / "a")
    lit_scene.view_settings.exposure = -3.0
    second = addon.apply_lens(first.radiance, **APPLIED, look="standard", output_folder=tmp_path / "b")
    assert np.array_equal(pixels(first.after), pixels(second.after))


def test_light_in_another_working_space_looks_alike(lit_scene):
    picture = np.linspace(0, 3, 36 * 48 * 3, dtype=np.float32).reshape(36, 48, 3)
    shown = shown_pixels(picture, look_of(lit_scene)).astype(int)
    assert shown.shape == picture.shape and shown[0, 0].max() < 30 < shown[-1, -1].min()
    assert np.all(np.diff(shown[:, 0, 0]) >= 0)  # not mirrored


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"look": 1}', "null"])
def test_a_damaged_look_is_refused(text):
    with refused(InputError, field="look", value="damaged", where="radiance.exr"):
        look_from(text, "radiance.exr")


def test_a_look_that_this_blender_lacks_is_refused(lit_scene):
    look = look_from(json.dumps(json.loads(to_text(look_of(lit_scene))) | {"view_transform": "Kodak"}), "file")
    with refused(InputError, field="view", value="sRGB, Kodak, AgX - Punchy", where="look",
                 match="Kodak.*not in this Blender's colour management"):
        shown_pixels(np.zeros((2, 2, 3), np.float32), look)
    assert "Lensfield Look" not in bpy.data.scenes


def test_images_of_light_are_shown_in_the_scenes_look(lit_scene, tmp_path):
    result = addon.render_through_lens(lit_scene, lens="tessar-50mm", wavelengths_nm=WAVELENGTHS_NM,
                                       lens_quality="preview", output_folder=tmp_path)
    assert show_file(None, str(result.lens_image), "light").use_view_as_render
    assert "R" in read_parts(result.lens_image)[0][1]
