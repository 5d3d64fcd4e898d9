"""Applying another lens to a cached picture: the same result as a new render through that lens."""

import json
from dataclasses import replace

import bpy
import numpy as np
import pytest

from lensfield import addon
from lensfield.addon.render import refilter
from lensfield.engine import ImageError, InputError, Options, load_lens
from lensfield.engine.field.field_map import field_map
from lensfield.engine.pictures.spectral_exr import (
    read_exr,
    read_parts,
    read_with_layers,
    read_with_planes,
    write_exr,
)
from lensfield.engine.runtime import scratch
from lensfield.engine.stray.options import StrayOptions
from noise import assert_means
from refusals import refused
from small_scenes import WAVELENGTHS_NM, material, wall


@pytest.fixture
def window(scene):
    """A glowing square off the axis in front of a dim wall, without noise except at the edges."""
    scene.cycles.samples = 256
    for name, strength, distance_m, side_m, x_m in (("Dim", 0.2, 3, 20, 0), ("Bright", 2, 2, 0.9, 0.35)):
        glow, shader = material(name, "ShaderNodeEmission", (0.8, 0.5, 0.2))
        shader.inputs["Strength"].default_value = strength
        wall(scene, glow, distance_m, side_m).location.x = x_m
    return scene


def rendered(scene, folder, lens, **options):
    given = {"lens": lens, "wavelengths_nm": WAVELENGTHS_NM, "output_folder": folder, "lens_quality": "preview"}
    return addon.render_through_lens(scene, **given | options)


def apply_lens(radiance, lens, folder=None, **options):
    given = {"lens": lens, "output_folder": folder, "lens_quality": "preview", "stray": StrayOptions("off")}
    return addon.apply_lens(radiance, **given | options)


def blocks(path):
    """An irradiance's means over blocks of 12 x 12 px, large enough to make the pixels' noise small."""
    image = read_exr(path)
    rows, columns = (n // 12 for n in image.frame_px)
    return image, image.cube.reshape(len(image.cube), rows, 12, columns, 12).transpose(0, 1, 3, 2, 4)


@pytest.mark.sample(1)
@pytest.mark.parametrize("first, second", [("tessar-50mm", "cooke-triplet-50mm"), ("tessar-50mm", "nikkor-28mm")])
def test_in_the_cameras_view_another_lens_equals_a_fresh_render(window, tmp_path, first, second):
    """For any size of either lens."""
    window.camera.data.lens = 30
    options = {"view": "camera"}
    original = rendered(window, tmp_path, first, **options)
    applied = apply_lens(original.radiance, second, tmp_path / "applied", **options)
    fresh = rendered(window, tmp_path / "fresh", second, **options)
    (image, pixels), (other, expected) = blocks(applied.irradiance), blocks(fresh.irradiance)
    assert image.lens_name == other.lens_name and np.isclose(image.pitch_um, other.pitch_um)
    assert_means(pixels, expected, rtol=0.002, noise=0.03)


@pytest.mark.parametrize("name, camera_mm", [("muller-fisheye-25mm", 18), ("edmund-54852", 30)])
def test_a_panorama_serves_other_lenses(window, tmp_path, name, camera_mm):
    """Except for resampling of edges."""
    window.camera.data.lens = camera_mm
    options = {"view": "camera"}
    original = rendered(window, tmp_path, name, **options)
    assert not read_exr(original.radiance).projection.is_plane
    applied = apply_lens(original.radiance, "tessar-50mm", tmp_path / "applied", **options)
    fresh = rendered(window, tmp_path / "fresh", "tessar-50mm", **options)
    (_, pixels), (_, expected) = (blocks(result.irradiance) for result in (applied, fresh))
    light = expected.mean(axis=(-2, -1))
    assert np.abs(pixels.mean(axis=(-2, -1)) - light).max() < 0.01 * light.max()


def test_lenses_with_the_same_view_need_no_scaling(window, tmp_path):
    """The same lens stopped down: equal to its own render, without remarks."""
    original = rendered(window, tmp_path, "nikkor-28mm")
    applied = apply_lens(original.radiance, "nikkor-28mm", tmp_path / "applied", f_number=4.0)
    fresh = rendered(window, tmp_path / "fresh", "nikkor-28mm", f_number=4.0)
    assert applied.report.file.lens_warning == ""
    (_, pixels), (_, expected) = blocks(applied.irradiance), blocks(fresh.irradiance)
    assert_means(pixels, expected, rtol=0.002, noise=0.03)


def test_reapplying_the_lens_of_the_render_gives_the_same_files(window, tmp_path):
    window.render.film_transparent, window.cycles.film_exposure = True, 2.5
    bpy.data.objects["Wall"].hide_render = True
    original = rendered(window, tmp_path, "tessar-50mm", stray=StrayOptions())
    applied = apply_lens(original.radiance, "tessar-50mm", tmp_path / "applied", stray=StrayOptions())
    for first, second in zip(original.files, applied.files, strict=True):
        if first.suffix == ".exr":
            (_, planes), (_, others) = read_parts(first)[0], read_parts(second)[0]
            assert planes.keys() == others.keys()
            assert all(np.array_equal(planes[name], others[name]) for name in planes)
    assert original.after.read_bytes() == applied.after.read_bytes()


def test_a_picture_too_large_for_memory_gives_the_same_files(window, tmp_path, monkeypatch):
    options = {"depth": "off", "stray": StrayOptions("veil")}
    original, folders, in_file = rendered(window, tmp_path, "edmund-54852", **options), [], scratch._in_file
    monkeypatch.setattr(scratch, "_in_file", lambda shape, folder: folders.append(folder) or in_file(shape, folder))
    monkeypatch.setattr(scratch, "available_bytes", lambda: 0)
    applied = apply_lens(original.radiance, "edmund-54852", tmp_path / "applied", **options)
    assert folders == [tmp_path / "applied"] * 3  # radiance, stray light and irradiance
    for first, second in zip(original.files, applied.files, strict=True):
        assert first.suffix == ".json" or first.read_bytes() == second.read_bytes()  # reports contain seconds


def test_the_field_of_view_of_the_first_lens_is_preserved_and_reported(window, tmp_path):
    original = rendered(window, tmp_path, "tessar-50mm")
    result = apply_lens(original.radiance, "nikkor-28mm")
    (warning,) = (line for line in result.messages if "sensor" in line)
    assert "the captured view equals a sensor of 18.3 x 13.7 mm (the lens's own is 36 x 24 mm)" in warning
    tessar, nikkor = (load_lens(name, quality="preview") for name in ("tessar-50mm", "nikkor-28mm"))
    image = read_exr(result.irradiance)
    assert np.isclose(image.pitch_um / nikkor.capture_focal_length_mm,
                      read_exr(original.radiance).pitch_um / tessar.capture_focal_length_mm)
    assert json.loads(result.record.read_text())["radiance"] == str(original.radiance) in result.messages[1]
    scaled = apply_lens(original.radiance, "nikkor-28mm", tmp_path / "scaled", view="camera")
    assert np.allclose(read_exr(scaled.irradiance).cube, image.cube, rtol=1e-4)
    assert "Nikkor 28 mm f/2.8 (1999), enlarged to " in "".join(scaled.messages)


def test_a_lens_on_the_sensor_of_the_render_is_no_surprise(window, tmp_path):
    original = rendered(window, tmp_path, "tessar-50mm", view="mft")
    applied = apply_lens(original.radiance, "tessar-50mm", tmp_path / "applied", view="mft")
    assert [line for line in (*original.messages, *applied.messages) if "sensor of" in line] == []
    assert np.array_equal(*(read_exr(result.irradiance).cube for result in (original, applied)))
    own = apply_lens(original.radiance, "tessar-50mm", tmp_path / "own")
    assert any("equals a sensor of 17.3 x 13 mm" in line for line in own.messages)


def test_a_lens_that_needs_more_than_was_captured_is_refused_and_changes_no_file(window, tmp_path):
    window.render.resolution_x, window.render.resolution_y, window.cycles.samples = 192, 144, 1
    original = rendered(window, tmp_path, "tessar-50mm")
    before = [path.read_bytes() for path in original.files]
    with pytest.raises(ImageError, match=r"_radiance.exr: overscan is \d+ x \d+ px: edmund-54852 needs \d+ x \d+ px "
                                         "beyond the frame: render again through it"):
        apply_lens(original.radiance, "edmund-54852")
    assert [path.read_bytes() for path in original.files] == before


def test_a_capture_that_cannot_serve_a_lens_is_refused_before_its_light_is_read(window, tmp_path, monkeypatch):
    window.render.resolution_x, window.render.resolution_y, window.cycles.samples = 192, 144, 1
    original = rendered(window, tmp_path, "tessar-50mm")

    def read(*_):
        raise AssertionError("read")

    monkeypatch.setattr(refilter, "_read", read)
    with refused(ImageError, field="overscan", where="unsaved_Scene_0001_radiance.exr"):
        apply_lens(original.radiance, "edmund-54852")
    with pytest.raises(AssertionError, match="read"):
        apply_lens(original.radiance, "tessar-50mm")


@pytest.mark.parametrize("accuracy, lacks", [(0.1, False), (0.0005, True)])
def test_a_border_that_will_lack_light_is_announced_and_reported(window, tmp_path, accuracy, lacks):
    """The capture is planned for a coarse accuracy, so it has no overscan for the light that this trims."""
    window.render.resolution_x, window.render.resolution_y, window.cycles.samples = 192, 144, 1
    original = rendered(window, tmp_path, "tessar-50mm", options=Options(accuracy=0.1), depth="off")
    labels = []
    result = apply_lens(original.radiance, "tessar-50mm", tmp_path / "fine", options=Options(accuracy=accuracy),
                        progress=lambda fraction, label: labels.append(label))
    before_light = [label for label in labels if label.startswith("Reading radiance")]
    assert ("border will lack light" in before_light[0]) == lacks
    assert any("the border lacks light" in line for line in result.messages) == lacks


def test_an_animation_treats_a_frame_with_another_lens_as_pending(window, tmp_path):
    window.lensfield.output_folder, window.camera.data.lensfield.lens = str(tmp_path), "tessar-50mm"
    options = {"wavelengths_nm": WAVELENGTHS_NM, "lens_quality": "preview"}
    (result,) = addon.render_animation(window, [1], **options).results.values()
    assert not addon.Animation(window, [1], **options).pending
    apply_lens(result.radiance, "cooke-triplet-50mm")
    assert addon.Animation(window, [1], **options).pending == [1]


@pytest.mark.parametrize("depth", ["auto", "off"])
def test_a_few_missing_pixels_of_overscan_are_repeated(window, tmp_path, depth):
    """A capture with one pixel less on each side gives nearly the same picture, and says so."""
    original = rendered(window, tmp_path, "nikkor-28mm", depth=depth)
    complete = apply_lens(original.radiance, "nikkor-28mm", tmp_path / "complete", depth=depth)
    radiance, planes, layers = read_with_layers(original.radiance)
    needed = field_map(load_lens("nikkor-28mm", quality="preview")).overscan_px(
        radiance.grid, radiance.wavelengths_nm, 0)
    margin = [own - least + 1 for own, least in zip(radiance.overscan_px, needed, strict=True)]
    inside = tuple(slice(rim, n - rim) for rim, n in zip(margin, radiance.grid.shape_px, strict=True))
    short = replace(radiance, cube=radiance.cube[:, *inside], grid=radiance.grid.cropped(margin),
                    detail=radiance.detail and radiance.detail.within(*inside))
    if layers:
        layers = layers.cropped(np.subtract(layers.grid.on_sensor().overscan_px, short.overscan_px))
    path = tmp_path / "short_0001_radiance.exr"
    write_exr(short, path, {"Z": planes["Z"][inside]}, layers)
    applied = apply_lens(path, "nikkor-28mm", tmp_path / "short", depth=depth)
    assert any("nikkor-28mm shows 1 px more beyond the frame than was captured" in line for line in applied.messages)
    assert not any("than was captured" in line for line in complete.messages)
    (first, second) = (read_exr(result.irradiance).cube for result in (applied, complete))
    assert first.shape == second.shape and first[:, (0, -1)].min() > 0
    assert np.abs(first - second)[:, 2:-2, 2:-2].max() < 0.02 * second.max()
    assert np.abs(first - second).max() < 0.2 * second.max()


def test_extra_room_serves_lenses_that_need_more_overscan(window, tmp_path):
    window.render.resolution_x, window.render.resolution_y, window.cycles.samples = 192, 144, 1
    original = rendered(window, tmp_path, "tessar-50mm", room=0.1)
    assert read_exr(original.radiance).overscan_px == (19, 19)
    assert apply_lens(original.radiance, "edmund-54852").report.file
    with pytest.raises(InputError, match="room is -1: expected 0 to 1"):
        rendered(window, tmp_path, "tessar-50mm", room=-1)


def test_bad_input_names_the_remedy(window, tmp_path):
    original = rendered(window, tmp_path, "tessar-50mm")
    image, planes = read_with_planes(original.radiance)
    old = tmp_path / "Old_0001_radiance.exr"
    write_exr(replace(image, focal_mm=None), old, {"Z": planes["Z"]})
    for path, field, words in ((old, "lensfield:focalMm", "older Lensfield wrote the file: render again"),
                               (tmp_path / "Gone_0001_radiance.exr", "file", "is missing"),
                               (original.irradiance, "file", "such as shot_Scene_0001_radiance.exr")):
        with refused(InputError, field=field, where=path.name, match=words):
            apply_lens(path, "tessar-50mm")
    with refused(InputError, field="view", value="mine"):
        apply_lens(original.radiance, "tessar-50mm", view="mine")


def test_fields_that_need_a_scene_are_refused(tmp_path):
    path = tmp_path / "unsaved_Scene_0001_radiance.exr"
    with pytest.raises(TypeError, match="unexpected keyword argument 'denoise'"):
        addon.apply_lens(path, lens="tessar-50mm", denoise="on")
    with pytest.raises(InputError, match="focus is camera: expected a distance"):
        addon.apply_lens(path, lens="tessar-50mm", focus="camera")
