"""The camera of a render: its sensor, its raw file, the developed picture, and what other pictures keep."""

import json
from dataclasses import replace

import bpy
import numpy as np
import pytest
import rawpy
from PIL import Image

from lensfield import addon
from lensfield.engine import CameraError, InputError, load_camera
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts
from lensfield.engine.sensor.camera_file import camera_text
from refusals import refused
from small_scenes import material, set_region, wall

WAVELENGTHS_NM = tuple(range(400, 701, 50))
COARSE = replace(load_camera("nikon-d700"), name="coarse", shape_px=(100, 150), pitch_um=240.0)  # 36 x 24 mm


@pytest.fixture
def squares(scene):
    """A dim wall with a bright square on its right."""
    scene.render.resolution_x, scene.render.resolution_y = 72, 40
    scene.cycles.samples = 64
    for name, strength, distance_m, side_m, x_m in (("Dim", 0.2, 3, 20, 0), ("Bright", 1, 2, 0.5, 0.4)):
        glow, shader = material(name, "ShaderNodeEmission")
        shader.inputs["Strength"].default_value = strength
        wall(scene, glow, distance_m, side_m).location.x = x_m
    return scene


def rendered(scene, folder, **given):
    return addon.render_through_lens(scene, lens="tessar-50mm", wavelengths_nm=WAVELENGTHS_NM, output_folder=folder,
                                     lens_quality="preview", depth="off", **given)


def shown(result):
    _, planes = read_parts(result.lens_image)[0]
    return np.stack([planes[channel] for channel in "RGB"], axis=-1)


def test_a_camera_takes_a_picture_on_its_own_sensor(squares, tmp_path):
    plain = rendered(squares, tmp_path / "plain", view="36x24")
    photo = rendered(squares, tmp_path / "photo", camera=COARSE, dng=True, iso=400.0)
    light, other = read_exr(photo.irradiance), read_exr(plain.irradiance)
    assert light.pitch_um == pytest.approx(500) == other.pitch_um
    np.testing.assert_array_equal(light.cube, other.cube)
    with rawpy.imread(str(photo.raw)) as raw:
        numbers = raw.raw_image.astype(float) - 512
    assert numbers.shape == (83, 150), "40 x 72 pixels of 500 um"
    bright, dim = numbers[30:50, 108:120].mean(), numbers[30:50, 20:60].mean()
    assert bright / dim == pytest.approx(5, rel=0.1)
    picture, before = shown(photo), shown(plain)
    assert picture[18:22, 53:56].mean() / picture[18:22, 10:30].mean() == pytest.approx(5, rel=0.1)
    assert 0 < picture.max() <= 1.3 and picture.shape == before.shape
    assert np.ptp(picture[18:22, 10:30].mean(axis=(0, 1))) < 0.05 * picture[18:22, 10:30].mean(), "white is white"
    facts = json.loads(photo.record.read_text())["camera"]
    assert facts["iso"] == 400 and facts["raw_px"] == [83, 150] and facts["metered"]
    after = np.asarray(Image.open(photo.after)).astype(float)
    assert after[18:22, 53:56].mean() > after[18:22, 10:30].mean() > 20
    assert photo.before.read_bytes() == plain.before.read_bytes()
    assert not plain.raw.exists() and "raw" not in plain.report.files
    assert any("coarse" in line or "Nikon" in line for line in photo.messages)


def test_a_render_region_is_metered_and_developed_alone(squares, tmp_path):
    """The dim wall fills the left half: its brightness is ISO 2721's, and the rest stays black."""
    set_region(squares, 0, 0.5, 0, 1)
    picture = shown(rendered(squares, tmp_path, camera=COARSE))
    assert picture[8:32, 4:32].mean() == pytest.approx(10 / 78, rel=0.15)
    assert not picture[:, 36:].any()


def test_the_light_itself_is_shown_if_it_is_not_developed(squares, tmp_path):
    plain = rendered(squares, tmp_path, view="36x24")
    before = shown(plain)
    photo = rendered(squares, tmp_path, camera=COARSE, develop=False, dng=True)
    np.testing.assert_array_equal(shown(photo), before)
    assert photo.raw.exists()
    applied = addon.apply_lens(photo.radiance, lens="tessar-50mm", lens_quality="preview", depth="off")
    assert not applied.raw.exists(), "an old raw file would be another picture's"
    again = addon.apply_lens(photo.radiance, lens="tessar-50mm", lens_quality="preview", depth="off", camera=COARSE,
                             dng=True, noise=False)
    with rawpy.imread(str(again.raw)) as raw:
        assert raw.raw_image.std() > 0
    assert np.abs(shown(again) - before).max() > 0.05


def test_a_changed_exposure_or_camera_renders_a_frame_again(squares, tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(camera_text(COARSE), encoding="utf-8")

    def missing(**given):
        return list(addon.Animation(squares, [1], lens="tessar-50mm", wavelengths_nm=WAVELENGTHS_NM, depth="off",
                                    output_folder=tmp_path / "a", lens_quality="preview", **given).turns)

    rendered(squares, tmp_path / "a", camera=own, iso=400.0, dng=True, frame=1)
    assert missing(camera=own, iso=400.0, dng=True) == [1], "a still is metered by itself, not by its shot"
    addon.render_animation(squares, [1], lens="tessar-50mm", wavelengths_nm=WAVELENGTHS_NM, depth="off", dng=True,
                           output_folder=tmp_path / "a", lens_quality="preview", camera=own, iso=400.0)
    assert missing(camera=own, iso=400.0, dng=True) == []
    assert missing(camera=own, iso=800.0, dng=True) == [1]
    own.write_text(camera_text(replace(COARSE, dark_noise_e=9.0)), encoding="utf-8")
    assert missing(camera=own, iso=400.0, dng=True) == [1]


@pytest.mark.parametrize("given, field, value", [
    ({"camera": replace(COARSE, filters=("RR", "GB"))}, "filters", "RR/GB"), ({"iso": -5.0}, "iso", -5.0),
    ({"camera": replace(COARSE, filters=("RG",)), "dng": True, "develop": False}, "channels", "RG"),
    ({"camera": replace(COARSE, shape_px=(4, 6), pitch_um=6000.0)}, "size", "(3, 6) px")])
def test_a_picture_that_cannot_be_taken_is_refused_before_the_render(squares, given, field, value, tmp_path):
    with refused(InputError, field=field, value=value):
        rendered(squares, tmp_path, **{"camera": COARSE} | given)
    assert not list(tmp_path.iterdir())


def test_an_unknown_camera_is_refused_before_the_render(squares, tmp_path):
    with refused(CameraError, field="camera", value="unknown", where="leica-m3"):
        rendered(squares, tmp_path, camera="leica-m3", view="camera")
    assert not list(tmp_path.iterdir())
    assert addon.camera_words(addon.RenderRequest(camera=COARSE, wavelengths_nm=(500.0, 600.0)))[0].startswith(
        "the wavelengths leave out part")


def test_a_shot_has_the_exposure_of_its_first_frame(squares, tmp_path):
    """The light doubles from frame to frame; a marker cuts to another camera at frame 3; keyframes are metered."""
    strength = bpy.data.materials["Dim"].node_tree.nodes["Emission"].inputs["Strength"]
    for frame in range(1, 5):
        strength.default_value = 0.2 * 2**frame
        strength.keyframe_insert("default_value", frame=frame)
    other = bpy.data.objects.new("Other", squares.camera.data.copy())
    squares.collection.objects.link(other)
    other.matrix_world = squares.camera.matrix_world
    for frame, camera in ((1, squares.camera), (3, other)):
        squares.timeline_markers.new("cut", frame=frame).camera = camera
    squares.frame_start, squares.frame_end = 1, 4

    def seconds(frames, **given):
        animation = addon.render_animation(squares, frames, lens="tessar-50mm", wavelengths_nm=WAVELENGTHS_NM,
                                           depth="off", lens_quality="preview", camera=COARSE, **given)
        facts = [json.loads(result.record.read_text())["camera"] for result in animation.results.values()]
        assert all(each["metered"] for each in facts)
        return [each["shutter_s"] for each in facts]

    first, second, third, fourth = seconds([1, 2, 3, 4], output_folder=tmp_path / "all")
    assert first == second and third == fourth and third < 0.6 * first
    assert seconds([2], output_folder=tmp_path / "farm") == [second], "whatever frames a process renders"
    assert seconds([1, 2, 3, 4], output_folder=tmp_path / "all") == [], "finished frames stay"
    alone = rendered(squares, tmp_path / "alone", camera=COARSE, frame=2)
    assert alone.report.as_dict()["camera"]["shutter_s"] < 0.7 * second, "a still is metered itself"
    squares.timeline_markers.clear()
    squares.camera.data.lensfield.keyframe_insert("shutter_s", frame=1)
    first, second = seconds([1, 2], output_folder=tmp_path / "frames")
    assert second < 0.7 * first
