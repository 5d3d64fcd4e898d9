"""The compositor step, with the node trees of 4.x and of 5.x."""

import json
import os
import subprocess
import sys

import bpy
import numpy as np
import pytest

from laid_images import lay, read_rgb, render_composite, shows_lens_image
from lensfield.addon.scene.compositor import (
    NAME,
    STATE,
    compositing_tree,
    compositor_state,
    fingerprint_anew,
    fingerprint_now,
    lay_into_compositor,
    lens_image,
    refresh,
    remove_from_compositor,
    unreplaced_passes,
)
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.working_space import rec709_from_working
from lensfield.engine.pictures.spectral_exr import write_rgb_exr
from lensfield.engine.stray.options import StrayOptions
from small_scenes import adjust, background, material, render, set_world, wall
from waiting import LAST_RESORT_S


def lensfield_nodes(scene):
    return [node for node in compositing_tree(scene).nodes if node.name == NAME]


def tree_facts(tree):
    """The contents of a tree, for comparison with its earlier contents."""
    return (sorted((node.bl_idname, node.name, node.mute) for node in tree.nodes),
            sorted((link.from_node.name, link.from_socket.name, link.to_node.name, link.to_socket.identifier)
                   for link in tree.links)) if tree else None


def current_tree(scene):
    return scene.compositing_node_group if hasattr(scene, "compositing_node_group") else scene.node_tree


def test_frames_without_a_lens_image_show_the_blender_render(scene, tmp_path):
    lay(scene, tmp_path, frames=(2, 3, 5))
    shown = [frame for frame in range(1, 7) if shows_lens_image(scene, tmp_path, frame)]
    assert shown == [2, 3, 5]
    assert compositor_state(scene) == ("plain render, frame 6 has no lens image", "INFO")
    scene.frame_set(5)
    assert lensfield_nodes(scene)[0].label == "Lensfield: lens image"


def test_frames_can_be_added_one_at_a_time(scene, tmp_path):
    for frame in (4, 2):
        lay(scene, tmp_path, frames=(frame,))
    assert [shows_lens_image(scene, tmp_path, frame) for frame in (1, 2, 3, 4)] == [False, True, False, True]


def test_an_edit_shows_the_blender_render_and_its_undo_the_lens_image(scene, tmp_path):
    lay(scene, tmp_path)
    assert shows_lens_image(scene, tmp_path)
    scene.camera.location.x = 1
    assert not shows_lens_image(scene, tmp_path)
    assert lensfield_nodes(scene)[0].label == "Lensfield: plain render, the scene has changed since"
    scene.camera.location.x = 0
    assert shows_lens_image(scene, tmp_path)


@pytest.mark.parametrize("change", [
    lambda scene: setattr(scene.cycles, "samples", 5), lambda scene: set_world(scene, strength=0.0),
    lambda scene: setattr(scene.camera.data, "clip_end", 10),
    lambda scene: setattr(scene.render, "film_transparent", True),
    lambda scene: scene.collection.objects.link(bpy.data.objects.new("Empty", None)),
    lambda scene: setattr(scene.objects["Wall"].data.vertices[0].co, "x", -4),
    lambda scene: setattr(scene.objects["Wall"], "hide_render", True),
    lambda scene: setattr(scene.objects["Wall"].active_material.lensfield, "reflectance", "brick-red"),
    lambda scene: scene.objects["Wall"].modifiers.new("Bevel", "BEVEL"),
    lambda scene: scene.objects["Wall"].active_material.node_tree.links.clear(),
    lambda scene: scene.objects["Wall"].keyframe_insert("location", frame=4)])
def test_changes_that_affect_the_render_outdate_a_lens_image(scene, tmp_path, change):
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0])
    lay(scene, tmp_path)
    assert shows_lens_image(scene, tmp_path)
    change(scene)
    scene.objects["Wall"].data.update_tag()
    assert not shows_lens_image(scene, tmp_path)


@pytest.mark.parametrize("change", [
    lambda scene: scene.camera.select_set(True), lambda scene: adjust(scene, lens="nikkor-28mm", tilt_deg=(0.1, 0.0)),
    lambda scene: setattr(scene.view_settings, "exposure", 2),
    lambda scene: setattr(scene.camera, "hide_viewport", True),
    lambda scene: compositing_tree(scene).nodes.new("CompositorNodeExposure"),
    lambda scene: setattr(background(scene), "location", (100, 100)), lambda scene: scene.update_tag(),
    lambda scene: scene.objects["Wall"].data.attributes.new(".select_vert", "BOOLEAN", "POINT"),
    lambda scene: bpy.data.objects.new("Loose", None), lambda scene: scene.frame_set(9)])
def test_changes_that_do_not_affect_the_render_keep_a_lens_image_current(scene, tmp_path, change):
    scene.camera.keyframe_insert("location", frame=1)
    scene.camera.location.x = 3
    scene.camera.keyframe_insert("location", frame=9)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0])
    lay(scene, tmp_path)
    change(scene)
    bpy.context.view_layer.update()
    assert shows_lens_image(scene, tmp_path)


def test_an_outdated_lens_image_is_shown_on_request(scene, tmp_path):
    lay(scene, tmp_path)
    set_world(scene, strength=0.0)
    bpy.context.view_layer.update()
    scene.lensfield.compositor_shows = "ALWAYS"
    assert shows_lens_image(scene, tmp_path) and compositor_state(scene) == (
        "lens image, the scene has changed since", "ERROR")
    scene.lensfield.compositor_shows = "NEVER"
    assert not shows_lens_image(scene, tmp_path)


def test_the_label_of_a_negative_frame_says_why_it_is_not_shown(scene, tmp_path):
    lay(scene, tmp_path, frames=(-5,))
    scene.frame_set(-5)
    assert lensfield_nodes(scene)[0].label == "Lensfield: plain render, frames below 0 cannot be shown"


def test_only_the_frame_rendered_again_is_current(scene, tmp_path):
    lay(scene, tmp_path, frames=(1, 2))
    scene.cycles.samples = 7
    lay(scene, tmp_path, frames=(2,))
    assert [shows_lens_image(scene, tmp_path, frame) for frame in (1, 2)] == [False, True]


def test_a_render_started_before_a_change_is_outdated_on_arrival(scene, tmp_path):
    path, = lay(scene, tmp_path)
    before = fingerprint_now(scene)
    assert before == fingerprint_anew(scene)
    scene.camera.location.x = 1
    lay_into_compositor(scene, path, fingerprint=before)
    assert not shows_lens_image(scene, tmp_path)


def test_a_missing_file_shows_the_blender_render_and_is_reported(scene, tmp_path):
    path, = lay(scene, tmp_path)
    path.unlink()
    assert not shows_lens_image(scene, tmp_path)
    assert compositor_state(scene) == ("plain render, the file of frame 1 is missing", "ERROR")
    assert lensfield_nodes(scene)[0].label == "Lensfield: plain render, the file of frame 1 is missing"


@pytest.mark.parametrize("state", ["x", "[1]", "[" * 10**5, "5", '{"frames": 5}', '{"frames": {"x": 1, "1e9": 2}}', 5,
                                   '{"scene": 1, "created_layers": [], "frames": null}', b"\xff"])
def test_an_invalid_node_state_in_an_untrusted_file_is_harmless(scene, tmp_path, state):
    lay(scene, tmp_path)
    lensfield_nodes(scene)[0].node_tree[STATE] = state
    refresh(scene)
    assert compositor_state(scene)[0].startswith("plain render")
    lay(scene, tmp_path)
    assert compositor_state(scene)[0] == "lens image"


def test_an_invalid_fingerprint_in_an_untrusted_file_is_harmless(scene, tmp_path):
    lay(scene, tmp_path)
    group = lensfield_nodes(scene)[0].node_tree
    frame, key = str(scene.frame_current), scene.lensfield.compositor_key
    group[STATE] = json.dumps(json.loads(group[STATE]) | {"frames": {frame: 5}, "scene": key})
    refresh(scene)
    assert compositor_state(scene)[0] == f"plain render, frame {frame} has no lens image"


def test_node_has_outputs_for_data_passes(scene, tmp_path):
    lay(scene, tmp_path)
    node, tree = lensfield_nodes(scene)[0], compositing_tree(scene)
    output = next(n for n in tree.nodes if n.bl_idname in ("NodeGroupOutput", "CompositorNodeComposite")).inputs[0]
    means = {}
    for name in ("Alpha", "Depth", "Stray Light", "Relative Illumination", "STMap Distort"):
        tree.links.new(node.outputs[name], output)
        means[name] = [float(render_composite(scene, tmp_path / "composite.exr")[0].mean())
                       for frame in (1, 2) if not scene.frame_set(frame)]
    fallback = {"Alpha": 1.0, "Depth": pytest.approx(1e10)}  # for the black, opaque world
    assert means == {"Alpha": [0.5, fallback["Alpha"]], "Depth": [7.0, fallback["Depth"]],
                     "Stray Light": [0.5, 0.0], "Relative Illumination": [0.25, 0.25], "STMap Distort": [0.25, 0.25]}


@pytest.mark.parametrize("scale, system, units", [(0.1, "METRIC", 70.0), (0.1, "NONE", 7.0), (2.0, "IMPERIAL", 3.5)])
def test_depth_is_in_blender_units_like_blenders_depth_pass(scene, tmp_path, scale, system, units):
    scene.unit_settings.system, scene.unit_settings.scale_length = system, scale
    lay(scene, tmp_path)
    node, tree = lensfield_nodes(scene)[0], compositing_tree(scene)
    output = next(n for n in tree.nodes if n.bl_idname in ("NodeGroupOutput", "CompositorNodeComposite")).inputs[0]
    tree.links.new(node.outputs["Depth"], output)
    assert float(render_composite(scene, tmp_path / "composite.exr")[0].mean()) == pytest.approx(units, rel=1e-6)


def test_removing_deletes_a_tree_that_lensfield_created(scene, tmp_path):
    used = getattr(scene, "use_nodes", None)
    lay(scene, tmp_path)
    assert bpy.ops.lensfield.remove_from_compositor() == {"FINISHED"}
    assert getattr(scene, "use_nodes", None) == used
    assert not hasattr(scene, "compositing_node_group") or current_tree(scene) is None
    assert not [block for kind in (bpy.data.images, bpy.data.actions, bpy.data.node_groups) for block in kind
                if block.name.startswith(NAME)]
    assert not remove_from_compositor(scene) and compositor_state(scene) == ("", "NONE")


def test_removing_restores_the_artists_tree(scene, tmp_path):
    scene.view_layers[0].use_pass_z = scene.view_layers[0].use_pass_mist = True
    tree = compositing_tree(scene)
    tree.nodes.clear()
    layers, over = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeAlphaOver")
    blur, exposure = tree.nodes.new("CompositorNodeBlur"), tree.nodes.new("CompositorNodeExposure")
    modern = hasattr(scene, "compositing_node_group")
    output = tree.nodes.new("NodeGroupOutput" if modern else "CompositorNodeComposite")
    for name, target in (("Image", exposure.inputs[0]), ("Alpha", over.inputs[0]), ("Depth", blur.inputs[0]),
                         ("Mist", blur.inputs[1])):
        tree.links.new(layers.outputs[name], target)
    tree.links.new(exposure.outputs[0], output.inputs[0])
    before = tree_facts(tree)
    lay(scene, tmp_path)
    fed = {link.to_socket for link in tree.links if link.from_node == layers}
    assert exposure.inputs[0] not in fed and over.inputs[0] not in fed and blur.inputs[1] in fed
    lensfield_nodes(scene)[0].location = 900, 900
    assert remove_from_compositor(scene)
    assert tree_facts(tree) == before


def test_removing_keeps_nodes_added_after_the_lensfield_node(scene, tmp_path):
    lay(scene, tmp_path)
    tree, node = compositing_tree(scene), lensfield_nodes(scene)[0]
    exposure, target = tree.nodes.new("CompositorNodeExposure"), node.outputs["Image"].links[0].to_socket
    tree.links.new(node.outputs["Image"], exposure.inputs[0])
    tree.links.new(exposure.outputs[0], target)
    remove_from_compositor(scene)
    assert current_tree(scene) == tree and [node.bl_idname for node in tree.nodes].count("CompositorNodeExposure") == 1
    assert exposure.outputs[0].links[0].to_socket == target


def test_a_lens_image_survives_saving_moving_and_reloading(scene, tmp_path):
    home = tmp_path / "home"
    (home / "lensfield").mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(home / "scene.blend"))
    scene.lensfield.output_folder = "//lensfield/"
    lay(scene, home / "lensfield")
    assert lens_image(scene).filepath == bpy.path.native_pathsep("//lensfield/unsaved_Scene_0001_lens_image.exr")
    bpy.ops.wm.save_mainfile()
    home.rename(tmp_path / "moved")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "moved" / "scene.blend"))
    scene = bpy.context.scene
    assert shows_lens_image(scene, tmp_path) and not shows_lens_image(scene, tmp_path, 2)
    bpy.context.scene.camera.location.x = 1
    assert not shows_lens_image(scene, tmp_path)


def test_blender_without_the_add_on_shows_the_same_frames(scene, tmp_path):
    lay(scene, tmp_path, frames=(2,))
    render_composite(scene, tmp_path / "composite.exr")  # sets the format
    scene.render.filepath = str(tmp_path / "frame_")
    scene.frame_end = 3
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    code = (f"import os, bpy; bpy.ops.wm.open_mainfile(filepath={str(tmp_path / 'scene.blend')!r}); "
            "bpy.ops.render.render(animation=True); os._exit(0)")
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, "PYTHONPATH": ""},
                   timeout=LAST_RESORT_S)
    assert [read_rgb(tmp_path / f"frame_{frame:04d}.exr")[0].mean() for frame in (1, 2, 3)] == [0, 10, 0]


def test_a_lens_image_of_another_size_fills_the_frame(scene, tmp_path):
    path, = lay(scene, tmp_path)
    rows = np.broadcast_to(np.linspace(0, 1, 72)[:, None, None], (72, 96, 3))
    write_rgb_exr(rows, path)
    lay_into_compositor(scene, path)
    composite = render_composite(scene, tmp_path / "composite.exr")[0]
    np.testing.assert_allclose(composite, np.broadcast_to(np.linspace(0, 1, 36)[:, None], (36, 48)), atol=0.02)


def test_the_group_works_in_another_file(scene, tmp_path):
    lay(scene, tmp_path)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "scene.blend")) as (data_from, data_to):
        data_to.node_groups = [name for name in data_from.node_groups if name.startswith(NAME)]
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    tree = compositing_tree(scene)
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree = data_to.node_groups[0]
    output = next(n for n in tree.nodes if n.bl_idname in ("NodeGroupOutput", "CompositorNodeComposite"))
    tree.links.new(node.outputs["Image"], output.inputs[0])
    scene.render.resolution_x, scene.render.resolution_y = 48, 36
    assert shows_lens_image(scene, tmp_path) and not shows_lens_image(scene, tmp_path, 2)


def test_passes_without_a_lens_image_are_named(scene):
    scene.view_layers[0].use_pass_mist = True
    tree = compositing_tree(scene)
    layers, exposure = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeExposure")
    tree.links.new(layers.outputs["Image"], exposure.inputs["Image"])
    assert unreplaced_passes(scene, ()) == []
    tree.links.new(layers.outputs["Mist"], exposure.inputs["Image"])
    assert unreplaced_passes(scene, ("normal",)) == ["Mist"]


def test_composite_is_the_lens_image(scene, tmp_path):
    set_world(scene, (0.6, 0.4, 0.2))
    result = render(scene, tmp_path, to_compositor=True, depth="off")
    composite = render_composite(scene, tmp_path / "composite.exr")
    np.testing.assert_allclose(composite, read_rgb(result.lens_image), rtol=1e-5)
    assert composite.mean() > 0.1


@pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="this Blender has one working space")
@pytest.mark.parametrize("space", ["Linear Rec.2020", "ACEScg"])
def test_composite_is_the_lens_image_in_other_working_spaces(scene, tmp_path, space):
    set_world(scene, (0.6, 0.4, 0.2))
    bpy.ops.wm.set_working_color_space(working_space=space)
    try:
        result = render(scene, tmp_path, to_compositor=True, depth="off")
        composite = render_composite(scene, tmp_path / "composite.exr")  # in the working space
        expected = np.tensordot(np.linalg.inv(rec709_from_working()), read_rgb(result.lens_image), axes=1)
    finally:
        bpy.ops.wm.set_working_color_space(working_space="Linear Rec.709")
    np.testing.assert_allclose(composite, expected, rtol=1e-4)


def test_lens_image_is_as_bright_as_the_world(scene, tmp_path):
    set_world(scene, (0.6, 0.4, 0.2))
    lossless = {"coating": "ideal", "stray": StrayOptions("off")}
    picture = read_rgb(render(scene, tmp_path, np.linspace(400, 700, 31), depth="off", **lossless).lens_image)
    np.testing.assert_allclose(picture[:, 17:19, 23:25].mean(axis=(1, 2)), (0.6, 0.4, 0.2), rtol=0.02)


def test_downstream_nodes_receive_the_lens_image(scene, tmp_path):
    set_world(scene)
    tree = compositing_tree(scene)
    tree.nodes.clear()
    layers = tree.nodes.new("CompositorNodeRLayers")
    exposure = tree.nodes.new("CompositorNodeExposure")
    exposure.inputs["Exposure"].default_value = 1.0
    modern = hasattr(scene, "compositing_node_group")
    output = tree.nodes.new("NodeGroupOutput" if modern else "CompositorNodeComposite")
    tree.links.new(layers.outputs["Image"], exposure.inputs["Image"])
    tree.links.new(exposure.outputs["Image"], output.inputs[0])

    result = render(scene, tmp_path, to_compositor=True, depth="off")
    composite = render_composite(scene, tmp_path / "composite.exr")
    np.testing.assert_allclose(composite, 2 * read_rgb(result.lens_image), rtol=1e-4)
    assert exposure.inputs["Image"].links[0].from_node.name == NAME
    assert lensfield_nodes(scene)[0].inputs["Image"].links[0].from_node == layers


def test_second_render_refreshes_the_same_node(scene, tmp_path):
    set_world(scene, strength=1.0)
    render(scene, tmp_path, to_compositor=True, depth="off")
    first = render_composite(scene, tmp_path / "composite.exr")
    set_world(scene, strength=3.0)
    render(scene, tmp_path, to_compositor=True, depth="off")
    assert len(lensfield_nodes(scene)) == 1
    np.testing.assert_allclose(render_composite(scene, tmp_path / "composite.exr"), 3 * first, rtol=2.0**-10)


def test_each_scene_keeps_its_lens_image(scene, tmp_path):
    set_world(scene)
    render(scene, tmp_path / "one", to_compositor=True, depth="off")
    other = scene.copy()
    other.name = "Other"
    set_world(other, strength=2.0)
    render(other, tmp_path / "two", to_compositor=True, depth="off")
    paths = [lens_image(s).filepath for s in (scene, other)]
    assert [path.split("/")[-2] for path in paths] == ["one", "two"]


def test_a_scene_copied_before_its_first_lens_render_gets_a_separate_composite(scene, tmp_path):
    tree = compositing_tree(scene)
    tree.nodes.clear()
    layers = tree.nodes.new("CompositorNodeRLayers")
    modern = hasattr(scene, "compositing_node_group")
    output = tree.nodes.new("NodeGroupOutput" if modern else "CompositorNodeComposite")
    tree.links.new(layers.outputs["Image"], output.inputs[0])
    other = scene.copy()
    render(other, tmp_path, to_compositor=True, depth="off")
    assert lens_image(scene) is None and lens_image(other)
    node = next(n for n in compositing_tree(other).nodes if n.name == NAME)
    assert node.outputs["Image"].is_linked


def test_a_renamed_scene_keeps_its_lens_image(scene, tmp_path):
    render(scene, tmp_path / "one", to_compositor=True, depth="off")
    other = scene.copy()
    scene.name = "Renamed"
    render(other, tmp_path / "two", to_compositor=True, depth="off")
    assert [lens_image(s).filepath.split("/")[-2] for s in (scene, other)] == ["one", "two"]


def test_an_emptied_group_is_repaired(scene, tmp_path):
    node = lens_node(scene, tmp_path)
    node.node_tree.nodes.clear()
    assert lens_node(scene, tmp_path) == node and lens_image(scene).filepath


def lens_node(scene, folder):
    render(scene, folder, to_compositor=True, depth="off")
    return lensfield_nodes(scene)[0]


def test_other_scenes_in_the_composite_are_left_alone(scene, tmp_path):
    set_world(scene)
    backdrop = bpy.data.scenes.new("Backdrop")
    tree = compositing_tree(scene)
    tree.nodes.clear()
    exposure = tree.nodes.new("CompositorNodeExposure")
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = backdrop
    tree.links.new(layers.outputs["Image"], exposure.inputs["Image"])
    render(scene, tmp_path, to_compositor=True, depth="off")
    assert not layers.mute and exposure.inputs["Image"].links[0].from_node == layers


def test_several_view_layers_are_rejected_by_name(scene, tmp_path):
    scene.view_layers.new("Foreground")
    with pytest.raises(SceneError, match="view layers for rendering is ViewLayer, Foreground: choose one"):
        render(scene, tmp_path)


@pytest.mark.parametrize("folder", ["plain", "with space"])
def test_operator_renders_with_the_settings(scene, tmp_path, folder):
    set_world(scene)
    settings = scene.lensfield
    settings.wavelength_mode = "LIST"
    settings.wavelength_list = "500, 600"
    settings.output_folder = str(tmp_path / folder)
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    assert sorted(path.name for path in (tmp_path / folder).iterdir()) == [f"unsaved_Scene_{end}" for end in (
        "0001_after.png", "0001_before.png", "0001_depth.exr", "0001_irradiance.exr", "0001_lens_image.exr",
        "0001_radiance.exr", "0001_report.json", "0001_stray_light.exr", "relative_illumination.exr",
        "stmap_distort.exr", "stmap_undistort.exr")]
    assert lensfield_nodes(scene)


@pytest.mark.parametrize("settings, message", [
    ({"wavelength_mode": "LIST", "wavelength_list": "700, 500"}, "options: wavelengths is 700, 500: expected"),
    ({"wavelength_last_nm": 900.0}, "tessar-50mm: wavelength is .* nm: the lens data spans 400 to 700 nm"),
    ({"lens": "FILE", "lens_file": "/no/such/lens.npz"}, "/no/such/lens.npz: lens is missing"),
    ({"lens": "FILE", "lens_file": ""}, "camera settings: lens file is empty"),
    ({"output_folder": " "}, "scene settings: output folder is empty")])
def test_operator_reports_bad_settings_in_one_line(scene, tmp_path, settings, message):
    scene.lensfield.output_folder = str(tmp_path)
    adjust(scene, **settings)
    with pytest.raises(RuntimeError, match=message) as caught:
        bpy.ops.lensfield.render()
    assert "Traceback" not in str(caught.value)
