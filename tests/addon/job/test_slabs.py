"""Captures in slabs of depth: together they equal a single render, and each includes areas hidden by nearer slabs."""

from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from PIL import Image

from lensfield import addon
from lensfield.addon.capture import slabs
from lensfield.addon.scene.bodies import EVERYWHERE_MM, uncut_depths_mm
from lensfield.addon.scene.camera import capture_grid
from lensfield.engine import InputError, load_lens
from lensfield.engine.image.projection import FISHEYE, PLANE
from lensfield.engine.pictures.spectral_exr import read_exr, read_with_layers, read_with_planes
from lensfield.engine.runtime import scratch
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions
from noise import assert_means
from refusals import refused
from small_scenes import WAVELENGTHS_NM, light, material, set_world, wall
from snapshot import differences, snapshot

LENS = "edmund-54852"  # focused at 25 cm, f/1.8: an object at 5 cm is blurred by three of these pixels
NO_STRAY = StrayOptions("off")
CUT_MM = 60.0, 200.0, 700.0
NEAR_M, MIDDLE_M, WALL_M = 0.05, 0.3, 3.0
WITHIN_PIXEL = 0.01
"""Relative difference in depth between a sample of a panorama, which has a distance, and the middle of its pixel: half
the diagonal of a pixel, 0.1 mm, is 0.012 rad; times the tangent of 26 degrees at a corner."""


def glowing(scene, name, colour, strength, distance_m, side_m, x_m=0.0, turned=0.0):
    glow, shader = material(name, "ShaderNodeEmission", colour)
    shader.inputs["Strength"].default_value = strength
    square = wall(scene, glow, distance_m, side_m)
    square.name, square.location.x, square.rotation_euler.z = name, x_m, turned
    return square


@pytest.fixture
def deep(scene):
    """Glowing squares from 5 cm to 3 m and a floor through them, in front of a blue sky."""
    set_world(scene, (0.2, 0.4, 0.9), 0.5)
    glowing(scene, "Near", (1, 0.2, 0.1), 1.5, NEAR_M, 0.012, 0.01, 0.3)
    glowing(scene, "Middle", (0.2, 1, 0.1), 0.7, MIDDLE_M, 0.1, -0.03, 0.5)
    glowing(scene, "Wall", (0.8, 0.8, 0.8), 0.3, WALL_M, 1.2)
    floor = glowing(scene, "Floor", (0.5, 0.4, 0.3), 0.8, 1.0, 20.0)
    floor.location, floor.rotation_euler.x = (0, -0.03, 0), np.pi / 2 * 0.95
    scene.cycles.samples = 256
    return scene


@pytest.fixture
def cut(monkeypatch):
    """Cuts at CUT_MM, whatever the plan."""
    plan = slabs.plan_slabs

    def forced(*arguments, **named):
        planned = plan(*arguments, **named)
        margins = (planned.margin_px,) * (len(CUT_MM) + 1)
        return replace(planned, borders_mm=CUT_MM, margins_px=margins) if planned.needed else planned

    monkeypatch.setattr(slabs, "plan_slabs", forced)


def rendered(scene, folder, depth="auto", lens=LENS, **options):
    result = addon.render_through_lens(scene, lens=lens, wavelengths_nm=WAVELENGTHS_NM, output_folder=folder / depth,
                                       depth=depth, **options)
    return result, *read_with_layers(result.radiance)


def both(scene, folder, **options):
    """The radiance without layers, the radiance with layers, and the layers."""
    _, single, _, none = rendered(scene, folder, "off", **options)
    _, flat, _, layered = rendered(scene, folder, "auto", **options)
    assert none is None and layered is not None and flat.grid == single.grid
    return single.cube.astype(np.float64), flat.cube.astype(np.float64), layered


def blocks(cube, side_px=12):
    rows, columns = (n // side_px for n in cube.shape[1:])
    cube = cube[:, :rows * side_px, :columns * side_px]
    return cube.reshape(len(cube), rows, side_px, columns, side_px).swapaxes(2, 3).reshape(-1, side_px, side_px)


def assert_alike(single, flat, rtol=0.003, noise=0.3):
    """Compares the means of all blocks that are not dark."""
    single, flat = blocks(single), blocks(flat)
    lit = single.mean(axis=(1, 2)) > 0.05 * single.max()
    assert lit.sum() >= 3
    assert_means(flat[lit], single[lit], rtol=rtol, noise=noise)


def assert_same_as_single(single, flat):
    """Compares the means; and every pixel in areas of a single, uniform surface."""
    assert_alike(single, flat)
    around = np.stack([single[:, down:single.shape[1] - 2 + down, across:single.shape[2] - 2 + across]
                       for down in range(3) for across in range(3)])
    even = np.ptp(around, axis=0).max(axis=0) <= 1e-4 * single.max()
    assert even.mean() > 0.5
    np.testing.assert_allclose(flat[:, 1:-1, 1:-1][:, even], single[:, 1:-1, 1:-1][:, even], rtol=0.01)


def test_slabs_together_equal_a_single_render(deep, cut, tmp_path):
    single, flat, layered = both(deep, tmp_path)
    assert_same_as_single(single, flat)
    assert len(layered.layers) == len(CUT_MM) + 2  # plus the sky
    assert layered.focal_mm == read_exr(tmp_path / "auto" / "unsaved_Scene_0001_radiance.exr").focal_mm


@pytest.mark.parametrize("depth, region, files", [
    ("auto", None, len(CUT_MM) + 2 + 2),  # light of slabs and sky, their combination, and the irradiance
    ("auto", (0.3, 0.7), len(CUT_MM) + 1 + 2), ("off", None, 2), ("off", (0.3, 0.7), 3)])
def test_light_too_large_for_memory_gives_the_same_files(deep, cut, tmp_path, monkeypatch, depth, region, files):
    deep.cycles.samples, deep.render.film_transparent = 2, bool(region)
    if region:
        deep.render.use_border = True
        deep.render.border_min_x, deep.render.border_max_x = region
    folders, in_file = [], scratch._in_file
    monkeypatch.setattr(scratch, "_in_file", lambda shape, folder: folders.append(folder) or in_file(shape, folder))
    plenty = rendered(deep, tmp_path / "plenty", depth)[0]
    assert not folders
    monkeypatch.setattr(scratch, "available_bytes", lambda: 0)
    little = rendered(deep, tmp_path / "little", depth)[0]
    assert folders == [tmp_path / "little" / depth] * files
    for one, other in zip(plenty.files, little.files, strict=True):
        assert one.suffix == ".json" or one.read_bytes() == other.read_bytes()  # reports contain seconds
    assert {path.name for path in little.record.parent.glob("[!.]*")} == {path.name for path in little.files}


def test_a_disk_without_room_for_light_is_reported_before_the_first_pass(deep, tmp_path, monkeypatch):
    monkeypatch.setattr(scratch, "available_bytes", lambda: 0)
    monkeypatch.setattr(scratch.shutil, "disk_usage", lambda folder: SimpleNamespace(free=10_000))
    with pytest.raises(InputError, match=r"scratch is [\d.e-]+ GB: only 1e-05 GB are free there: give another folder"):
        rendered(deep, tmp_path)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.every_blender
def test_each_layer_lies_between_its_cuts(deep, cut, tmp_path):
    """Every covered pixel has a depth, including edges, which a depth pass with one sample misses."""
    layered = rendered(deep, tmp_path)[3]
    *layers, sky = layered.layers
    x_mm, y_mm = layered.grid.axes_mm()
    cosine = np.cos(layered.grid.projection.angle_rad(np.hypot(x_mm, y_mm[:, None]) / layered.focal_mm))
    for layer, near_mm, far_mm in zip(layers, (0, *CUT_MM), (*CUT_MM, 1e6), strict=True):
        covered = (layer.depth_mm / cosine[layer.place])[layer.alpha > 0]  # a panorama clips by distance
        assert covered.size and np.all((covered > near_mm * (1 - 1e-5)) & (covered < far_mm * (1 + 1e-5)))
    assert np.all(np.isinf(sky.depth_mm)) and np.all(sky.alpha == 1)


def test_layers_include_hidden_areas_and_are_no_larger_than_needed(deep, cut, tmp_path):
    deep.objects["Floor"].hide_render = True
    near, middle, far, sky = rendered(deep, tmp_path)[3].layers  # 70 cm to 2 m is empty
    assert near.alpha.size < far.alpha.size < sky.alpha.size
    deep.objects["Near"].hide_render = deep.objects["Middle"].hide_render = True
    alone = rendered(deep, tmp_path / "alone", "off")[1]
    rows, columns = far.alpha.shape
    inside = far.alpha[2:-2, 2:-2]  # excludes a rim and edges
    assert np.all(inside == 1)
    np.testing.assert_allclose(far.cube[:, rows // 2, columns // 2],
                               alone.frame().cube[:, *(n // 2 for n in alone.frame_px)], rtol=1e-5)


def test_fully_hidden_slabs_are_left_out(deep, tmp_path):
    """It is not rendered, and has no layer."""
    deep.objects["Near"].scale = 100, 100, 1
    result, image, _, layered = rendered(deep, tmp_path, picture=tmp_path / "picture.png")
    (layer,) = layered.layers
    with Image.open(tmp_path / "picture.png") as picture:
        assert picture.size == (48, 36) and np.array(picture).max() > 50
    assert np.all(layer.alpha == 1) and np.all(image.cube > 0)
    np.testing.assert_allclose(layer.depth_mm, 50, rtol=WITHIN_PIXEL)
    assert "one slab" in result.report.scene.layers


def test_a_scene_in_focus_equals_a_single_render_bit_for_bit(deep, tmp_path):
    for name in ("Near", "Wall", "Floor"):
        deep.objects[name].hide_render = True
    deep.objects["Middle"].scale = 20, 20, 1
    single, flat = (rendered(deep, tmp_path, depth) for depth in ("off", "auto"))
    assert single[3] is None and flat[3] is None and not flat[0].report.scene.layers
    np.testing.assert_array_equal(flat[1].cube, single[1].cube)
    np.testing.assert_array_equal(flat[2]["Z"], single[2]["Z"])


@pytest.mark.parametrize("film", [False, True])
def test_an_object_in_focus_before_a_black_world_equals_a_single_render(deep, tmp_path, film):
    """Unless the world is lit, and the film shows it."""
    options = {"focus": 2e3, "lens": "nikkor-58mm-f1.4", "lens_quality": "preview"}
    for name in ("Near", "Wall", "Floor"):
        deep.objects[name].hide_render = True
    deep.objects["Middle"].location, deep.objects["Middle"].scale = (-0.2, 0.1, -2), (5, 5, 1)
    deep.cycles.samples, deep.render.film_transparent = 1, film
    if not film:
        assert rendered(deep, tmp_path, "auto", **options)[3] is not None
        set_world(deep, (0, 0, 0), 0)
    assert not addon.preflight(deep, output_folder=tmp_path, **options).slabs
    single, flat = (rendered(deep, tmp_path / "black", depth, **options) for depth in ("off", "auto"))
    assert flat[3] is None and flat[0].report.scene.depth.outside_fraction == 0
    np.testing.assert_array_equal(flat[1].cube, single[1].cube)


def lamps(scene):
    """Lamps with two spectra, on walls that scatter: a light group for each."""
    set_world(scene, (0, 0, 0), 0)
    for name in ("Near", "Middle", "Wall", "Floor"):
        scene.objects[name].data.materials[0] = material(name, "ShaderNodeBsdfDiffuse", (0.7, 0.5, 0.3))[0]
    for spectrum, x_m in (("sodium-lp", -0.02), ("illuminant-a", 0.02)):
        lamp = light(scene, "POINT", 0.01, shadow_soft_size=0.0)
        lamp.location.x, lamp.data.lensfield.emission = x_m, spectrum


def motion(scene):
    near = scene.objects["Near"]
    near.keyframe_insert("location", frame=0)
    near.location.x += 0.02
    near.keyframe_insert("location", frame=2)
    scene.render.use_motion_blur = True


def transparent_film(scene):
    scene.render.film_transparent = scene.cycles.film_transparent_glass = True


def test_slabs_work_with_a_render_region(deep, cut, tmp_path):
    render_region(deep)
    single, flat, _ = both(deep, tmp_path)
    region = read_with_planes(tmp_path / "auto" / "unsaved_Scene_0001_radiance.exr")[1]["region"]
    inside = np.ix_(*(np.flatnonzero((region == 1).any(axis=axis)) for axis in (1, 0)))
    assert_alike(*(cube[:, *inside] for cube in (single, flat)))


def render_region(scene):
    scene.render.use_border = True
    scene.render.border_min_x, scene.render.border_max_x = 0.3, 0.8
    scene.render.border_min_y, scene.render.border_max_y = 0.2, 0.6


def clip_camera(scene):
    scene.camera.data.clip_start, scene.camera.data.clip_end = 0.06, 2.0


def panes(scene):
    """Two half-transparent panes, one behind the other."""
    for name in ("Near", "Middle"):
        tree = scene.objects[name].data.materials[0].node_tree
        mix, clear = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("MixShader", "BsdfTransparent"))
        shader = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeEmission")
        output = tree.get_output_node("CYCLES")
        tree.links.new(shader.outputs[0], mix.inputs[1])
        tree.links.new(clear.outputs[0], mix.inputs[2])
        tree.links.new(mix.outputs[0], output.inputs["Surface"])
    scene.cycles.samples = 1024


@pytest.mark.sample(2)
@pytest.mark.parametrize("change, rtol", [(lamps, 0.01), (motion, 0.01), (transparent_film, 0.003), (panes, 0.01)])
def test_slabs_work_with_other_features(deep, cut, tmp_path, change, rtol):
    change(deep)
    single, flat, layered = both(deep, tmp_path, spectral=SpectralOptions("reference"))
    assert len(layered.layers) >= 3
    assert_alike(single, flat, rtol)


def test_slabs_work_with_the_clip_range_of_the_camera(deep, cut, tmp_path):
    clip_camera(deep)
    single, flat, layered = both(deep, tmp_path)
    assert_same_as_single(single, flat)
    depths_mm = [layer.depth_mm[layer.alpha > 0] for layer in layered.layers[:-1]]
    assert min(depth.min() for depth in depths_mm) >= 60 and max(depth.max() for depth in depths_mm) < 2000


def test_slabs_work_with_denoising(deep, cut, tmp_path):
    single, flat, _ = both(deep, tmp_path, denoise="on")
    assert_alike(single, flat, 0.02)


def test_slabs_work_with_fisheyes(deep, cut, tmp_path):
    """Fisheye cameras clip by distance."""
    single, flat, layered = both(deep, tmp_path, lens="muller-fisheye-25mm", lens_quality="preview")
    assert not layered.grid.projection.is_plane
    assert_same_as_single(single, flat)


def test_slabs_work_with_animation(deep, cut, tmp_path):
    near = deep.objects["Near"]
    near.keyframe_insert("location", frame=1)
    near.location.z = -0.055
    near.keyframe_insert("location", frame=2)
    animation = addon.render_animation(deep, [1, 2], lens=LENS, wavelengths_nm=WAVELENGTHS_NM, output_folder=tmp_path)
    depths_mm = [read_with_layers(result.radiance)[2].layers[0].depth_mm.min() for result in animation.results.values()]
    np.testing.assert_allclose(depths_mm, [50, 55], rtol=WITHIN_PIXEL)
    assert not addon.Animation(deep, [1, 2], lens=LENS, wavelengths_nm=WAVELENGTHS_NM, output_folder=tmp_path).pending
    assert addon.Animation(deep, [1, 2], lens=LENS, wavelengths_nm=WAVELENGTHS_NM, output_folder=tmp_path,
                           depth="off").pending == [1, 2]


def test_reapplying_the_same_lens_gives_the_same_picture(deep, cut, tmp_path):
    original = rendered(deep, tmp_path)[0]
    applied = addon.apply_lens(original.radiance, lens=LENS, output_folder=tmp_path / "applied", stray=NO_STRAY)
    np.testing.assert_allclose(read_exr(applied.irradiance).cube, read_exr(original.irradiance).cube, rtol=1e-4,
                               atol=1e-9)
    assert "was captured" not in applied.report.file.lens_warning
    off = addon.apply_lens(original.radiance, lens=LENS, output_folder=tmp_path / "off", depth="off",
                           stray=NO_STRAY)
    single = rendered(deep, tmp_path, "off")[0]
    assert_alike(read_exr(single.irradiance).cube.astype(float), read_exr(off.irradiance).cube.astype(float))
    with refused(InputError, field="depth", value="traced"):
        addon.apply_lens(original.radiance, lens=LENS, depth="traced")


def test_the_button_uses_layers_unless_depth_is_off(deep, cut, tmp_path):
    settings = deep.lensfield
    deep.camera.data.lensfield.lens, settings.output_folder = LENS, str(tmp_path / "auto")
    settings.to_compositor = False
    original = rendered(deep, tmp_path)[0]
    for depth in ("AUTO", "OFF"):
        settings.depth = depth
        assert bpy.ops.lensfield.apply_lens() == {"FINISHED"}
        ours = addon.apply_lens(original.radiance, lens=LENS, output_folder=tmp_path / depth,
                                options=settings.to_options(), depth=depth.lower(), stray=NO_STRAY)
        assert bool(ours.report.file.layers) == (depth == "AUTO")
        np.testing.assert_array_equal(read_exr(original.irradiance).cube, read_exr(ours.irradiance).cube)


def test_refocusing_a_capture_equals_a_fresh_render(deep, tmp_path):
    """Within the pixels and the noise, which are different in the two renders."""
    lens, near_mm = "tessar-50mm", 400.0
    options = {"lens": lens, "view": "camera", "lens_quality": "preview", "stray": NO_STRAY}
    deep.camera.data.lens = 35
    for name, distance_m in (("Near", 0.25), ("Middle", 0.6)):
        square = deep.objects[name]
        square.location.x *= distance_m / -square.location.z
        square.scale *= distance_m / -square.location.z
        square.location.z = -distance_m
    far, near = (rendered(deep, tmp_path / f"{focus_mm:g}", focus=focus_mm, room=0.1, **options)[0]
                 for focus_mm in (2e3, near_mm))
    applied = addon.apply_lens(far.radiance, output_folder=tmp_path / "applied", focus=near_mm, **options)
    fresh, refocused = (read_exr(result.irradiance).cube.astype(float) for result in (near, applied))
    assert_alike(fresh, refocused, 0.02, noise=1.0)
    other = read_exr(far.irradiance).cube
    assert np.abs(refocused - fresh).mean() < 0.2 * np.abs(other - fresh).mean()


def test_blur_that_needs_more_than_was_captured_is_reported(deep, tmp_path):
    """The in-focus picture ends just beyond the frame; out of focus, light from farther outside would reach it."""
    deep.render.resolution_x, deep.render.resolution_y, deep.cycles.samples = 192, 144, 4
    near = deep.objects["Near"]
    near.location, near.scale = (0, 0, -0.4), (100, 100, 1)
    options = {"lens": "sonnar-50mm-f1.5", "lens_quality": "preview"}
    original = rendered(deep, tmp_path, focus=400.0, f_number=2.8, **options)[0]
    for focus_mm, warned in ((400.0, False), (np.inf, True)):
        applied = addon.apply_lens(original.radiance, output_folder=tmp_path / "applied", focus=focus_mm, f_number=2.8,
                                   **options)
        assert ("needs light from" in applied.report.file.lens_warning) == warned


def test_the_scene_is_restored(deep, cut, tmp_path):
    transparent_film(deep)
    deep.render.film_transparent = False
    deep.render.use_persistent_data = False
    deep.render.image_settings.file_format = "PNG"
    bpy.context.view_layer.update()
    before = snapshot()
    rendered(deep, tmp_path)
    assert not differences(before, snapshot())


def fog(scene):
    """A cube of fog, from 20 to 40 cm."""
    bpy.ops.mesh.primitive_cube_add(size=0.2, location=(0, 0, -0.3))
    dust = bpy.data.materials.new("Fog")
    dust.use_nodes = True
    tree = dust.node_tree
    tree.nodes.clear()
    scatter, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("VolumeScatter", "OutputMaterial"))
    tree.links.new(scatter.outputs[0], output.inputs["Volume"])
    bpy.context.object.data.materials.append(dust)


def test_depth_behind_clear_panes_is_that_of_the_wall(scene, tmp_path):
    """Six tinted panes that let two thirds of the light through; the lens is focused on the wall."""
    wall(scene, material("Wall", "ShaderNodeEmission")[0], 0.25, 1.0)
    pane = material("Pane", "ShaderNodeBsdfTransparent", (0.9, 0.6, 0.5))[0]
    for distance_m in np.linspace(0.05, 0.2, 6):
        wall(scene, pane, distance_m, 0.02).location.x = 0.01
    assert scene.cycles.min_transparent_bounces == 0
    depth_m = read_with_planes(rendered(scene, tmp_path)[0].radiance)[1]["Z"]
    np.testing.assert_allclose(depth_m, 0.25, rtol=1e-5)


@pytest.mark.parametrize("projection, volume_ends_mm, body_ends_mm", [
    (PLANE, 400, 1100), (FISHEYE, 1e3 * np.hypot(0.4, np.hypot(0.1, 0.1)), 1e3 * np.hypot(1.1, np.hypot(0.2, 0.1)))])
def test_bodies_and_volumes_are_not_cut(deep, projection, volume_ends_mm, body_ends_mm):
    """Of a panorama, the corners of their boxes are farthest."""
    lens = load_lens(LENS)
    grid = replace(capture_grid(deep, lens, WAVELENGTHS_NM), projection=projection)
    assert uncut_depths_mm(deep, lens, grid, ()) == ([], [])  # squares are not bodies
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.1, location=(0.1, 0, -1))
    bpy.ops.mesh.primitive_cube_add(size=0.1, location=(0, 0, 1))  # behind the camera
    bpy.ops.mesh.primitive_cube_add(size=30, location=(0, 0, 0))  # a room
    fog(deep)
    (volume,), (body,) = uncut_depths_mm(deep, lens, grid, ())
    np.testing.assert_allclose(volume, (200, volume_ends_mm), rtol=1e-5)
    (volume,), _ = uncut_depths_mm(deep, lens, grid, {bpy.context.object.name})
    np.testing.assert_allclose(volume, (200, np.inf), rtol=1e-5)
    np.testing.assert_allclose(body, (900, body_ends_mm), rtol=1e-5)
    tree = deep.world.node_tree
    tree.links.new(tree.nodes.new("ShaderNodeVolumeScatter").outputs[0],
                   tree.get_output_node("CYCLES").inputs["Volume"])
    assert uncut_depths_mm(deep, lens, grid, ())[0][0] == EVERYWHERE_MM


def red_fog(scene):
    fog(scene)
    tree = bpy.data.materials["Fog"].node_tree
    absorption = tree.nodes.new("ShaderNodeVolumeAbsorption")
    absorption.inputs["Color"].default_value, absorption.inputs["Density"].default_value = (0.9, 0.1, 0.2, 1), 8.0
    tree.links.new(absorption.outputs[0], tree.get_output_node("CYCLES").inputs["Volume"])


def red_pane(scene):
    pane = wall(scene, material("Film", "ShaderNodeBsdfTransparent", (0.9, 0.1, 0.2))[0], 0.15, 0.06)
    pane.location.x = -0.02


@pytest.mark.parametrize("put", [red_fog, red_pane])
def test_coloured_volumes_and_panes_tint_their_background(deep, tmp_path, put):
    """They tint the wall and the sky, although slabs are composited by alpha, which has no colour."""
    put(deep)
    single, flat, layered = both(deep, tmp_path)
    assert len(layered.layers) > 1
    assert_alike(single, flat)


def test_a_cut_body_does_not_show_its_dark_inside(scene, cut, tmp_path):
    """A box's side crosses a border, and its outside has the same brightness there as in a single render."""
    set_world(scene)
    scene.cycles.samples = 256
    bpy.ops.mesh.primitive_cube_add(size=0.16, location=(-0.1, 0, -0.325))
    bpy.context.object.scale.z = 0.55 / 0.16  # from 5 to 60 cm
    bpy.context.object.data.materials.append(material("Grey", "ShaderNodeBsdfDiffuse")[0])
    single, flat, layered = both(scene, tmp_path)
    assert len(layered.layers) > 2  # the noise is the same, too
    rows = np.s_[:, single.shape[1] // 2 - 8:single.shape[1] // 2 + 8]
    single, flat = (cube[rows].mean(axis=(0, 1)) for cube in (single, flat))
    np.testing.assert_allclose(flat, single, rtol=0.01)


def by_object(scene):
    scene.objects["Near"].is_holdout = True


def by_collection(scene):
    holdouts = bpy.data.collections.new("Holdouts")
    scene.collection.children.link(holdouts)
    holdouts.objects.link(scene.objects["Near"])
    scene.collection.objects.unlink(scene.objects["Near"])
    scene.view_layers[0].layer_collection.children["Holdouts"].holdout = True


def by_shader(scene):
    tree = scene.objects["Near"].data.materials[0].node_tree
    tree.links.new(tree.nodes.new("ShaderNodeHoldout").outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])


def by_shader_in_a_group(scene):
    inside = bpy.data.node_groups.new("Hole", "ShaderNodeTree")
    inside.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    inside.links.new(inside.nodes.new("ShaderNodeHoldout").outputs[0], inside.nodes.new("NodeGroupOutput").inputs[0])
    tree = scene.objects["Near"].data.materials[0].node_tree
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = inside
    tree.links.new(group.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])


@pytest.mark.parametrize("hold_out", [by_object, by_collection, by_shader, by_shader_in_a_group])
def test_holdouts_hide_objects_behind_them(deep, tmp_path, hold_out):
    hold_out(deep)
    single, flat, layered = both(deep, tmp_path)
    assert len(layered.layers) == 1
    assert_same_as_single(single, flat)


def test_a_world_full_of_fog_is_one_slab(deep, tmp_path):
    tree = deep.world.node_tree
    scatter = tree.nodes.new("ShaderNodeVolumeScatter")
    scatter.inputs["Density"].default_value = 0.05
    tree.links.new(scatter.outputs[0], tree.get_output_node("CYCLES").inputs["Volume"])
    single, flat, layered = both(deep, tmp_path)
    assert len(layered.layers) == 1 and np.all(layered.layers[0].alpha == 1)
    assert_alike(single, flat, 0.02)
