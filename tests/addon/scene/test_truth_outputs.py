"""Ground truth in the compositor: outputs of the Lensfield node, compared with the file and with the plain render."""

import bpy
import numpy as np

from laid_images import lay, render_composite
from lensfield.addon.scene.compositor import NAME, compositing_tree, lay_into_compositor, remove_from_compositor
from lensfield.addon.scene.truth_outputs import GROUND_TRUTH, INDICES
from lensfield.engine.pictures.spectral_exr import write_layers_exr
from small_scenes import material, wall

SHAPE = 36, 48
CHANNELS = {"Depth": "Z", "Distance": "Z", "Position": "XYZ", "Normal": "XYZ", "UV": "UVA", "Vector": "XYZW",
            **dict.fromkeys(INDICES, "X"), "CryptoObject00": "rgba"}
OUTPUTS = [name for name in CHANNELS if name not in ("Depth", "CryptoObject00")]
PARTS = "Red", "Green", "Blue", "Alpha"


def planes_of(name, frame):
    """A picture that every mirror and turn changes, for each channel of a pass."""
    down, right = np.indices(SHAPE)
    start = 100 * frame + 10 * list(CHANNELS).index(name)
    return {f"{name}.{channel}": (start + number + 0.01 * down**2 + 0.003 * right**2).astype(np.float32)
            for number, channel in enumerate(CHANNELS[name])}


def lay_truth(scene, folder, passes, frames=(1,)):
    """Lay lens images with ground truth of these passes next to them; returns the Lensfield node."""
    for frame in frames:
        planes = {f"View.Layer.{channel}": plane
                  for name in passes for channel, plane in planes_of(name, frame).items()}
        if planes:
            write_layers_exr(planes, folder / f"unsaved_Scene_{frame:04d}_truth.exr", {})
    lay(scene, folder, frames, shape=SHAPE)
    return compositing_tree(scene).nodes[NAME]


def shown(scene, folder, socket, part, frame=1):
    """A channel of a socket in the scene's composite."""
    tree = compositing_tree(scene)
    output = next(node for node in tree.nodes if node.bl_idname in ("NodeGroupOutput", "CompositorNodeComposite"))
    parts = tree.nodes.new("CompositorNodeSeparateColor")
    tree.links.new(socket, parts.inputs[0])
    tree.links.new(parts.outputs[part], output.inputs[0])
    scene.frame_set(frame)
    picture = render_composite(scene, folder / "composite.exr")[0]
    tree.nodes.remove(parts)
    return picture


def assert_shows(scene, folder, node, name, frame=1, unit_m=1.0):
    """Whether an output shows the file, in Blender units."""
    scale = 1 / unit_m if name in ("Distance", "Position") else 1.0
    parts = PARTS[:3] if name == "UV" else PARTS  # vectors lack a fourth part
    for part, plane in zip(parts, planes_of(name, frame).values(), strict=False):
        picture = shown(scene, folder, node.outputs[name], part, frame)
        np.testing.assert_allclose(picture, plane * scale, rtol=1e-6, err_msg=f"{name} {part}")


def test_outputs_show_the_file_in_blender_units(scene, tmp_path):
    scene.unit_settings.scale_length = 0.01
    node = lay_truth(scene, tmp_path, CHANNELS)
    kinds = {socket.name: socket.type for socket in node.outputs if socket.name in CHANNELS}
    assert kinds == dict.fromkeys(("Depth", "Distance", *INDICES), "VALUE") | dict.fromkeys(
        ("Position", "Normal", "UV", "Vector"), "VECTOR")
    for name in OUTPUTS:
        assert_shows(scene, tmp_path, node, name, unit_m=0.01)


def test_indices_up_to_the_largest_are_exact(scene, tmp_path):
    planes = {f"ViewLayer.{INDICES[0]}.X": np.full(SHAPE, 32767, np.float32)}
    write_layers_exr(planes, tmp_path / "unsaved_Scene_0001_truth.exr", {})
    node = lay_truth(scene, tmp_path, ())
    assert np.all(shown(scene, tmp_path, node.outputs[INDICES[0]], "Red") == 32767)


def test_only_requested_passes_are_outputs(scene, tmp_path):
    node = lay_truth(scene, tmp_path, ("Normal", "CryptoObject00"))
    assert [socket.name for socket in node.outputs][7:] == ["Normal"]
    assert "Normal" not in [socket.name for socket in lay_without_truth(scene, tmp_path).outputs]


def lay_without_truth(scene, folder):
    """Lay frame 1 again, without ground truth."""
    for path in folder.glob("*_truth.exr"):
        path.unlink()
    return lay_truth(scene, folder, ())


def test_frames_without_a_pass_show_the_blender_render(scene, tmp_path):
    """Frame 2 lacks ground truth, frame 3 has another pass, and frame 4 is not rendered through the lens."""
    scene.view_layers[0].use_pass_normal = scene.view_layers[0].use_pass_vector = True
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0]).rotation_euler.x = 0.4
    scene.camera.keyframe_insert("location", frame=1)
    scene.camera.location.x, scene.camera.location.y = 3, 2
    scene.camera.keyframe_insert("location", frame=9)
    lay_truth(scene, tmp_path, ("Normal", "Vector"))
    lay_truth(scene, tmp_path, (), (2,))
    lay_truth(scene, tmp_path, ("UV",), (3,))
    layers = next(n for n in compositing_tree(scene).nodes if n.bl_idname == "CompositorNodeRLayers")
    node = lay_truth(scene, tmp_path, ("Normal", "Vector"))
    assert_shows(scene, tmp_path, node, "Normal")
    for name in ("Normal", "Vector"):
        for frame in (2, 3, 4):
            for part in PARTS[:3]:  # Render Layers' fourth number is lost before 5.2
                ours, expected = (shown(scene, tmp_path, each.outputs[name], part, frame) for each in (node, layers))
                np.testing.assert_array_equal(ours, expected, err_msg=f"{name} {part} at {frame}")
                assert np.any(ours) or part == "Red" and name == "Normal", f"{name} {part} at {frame}"


def test_links_are_taken_over_and_restored(scene, tmp_path):
    scene.view_layers[0].use_pass_normal = True
    tree = compositing_tree(scene)
    tree.nodes.clear()
    layers, blur = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeBlur")
    tree.links.new(layers.outputs["Normal"], blur.inputs["Image"])
    node = lay_truth(scene, tmp_path, ("Normal", "Position"))
    assert blur.inputs["Image"].links[0].from_socket == node.outputs["Normal"]
    assert node.inputs["Normal"].links[0].from_node == layers and not node.inputs["Position"].is_linked
    assert lay_without_truth(scene, tmp_path).outputs["Normal"].is_linked, "the user's link remains"
    assert "Position" not in node.outputs
    assert remove_from_compositor(scene)
    assert blur.inputs["Image"].links[0].from_socket == layers.outputs["Normal"]
    assert not [image for image in bpy.data.images if image.name.startswith(NAME)]


def test_a_copied_scene_keeps_its_links(scene, tmp_path):
    scene.view_layers[0].use_pass_normal = True
    blur = compositing_tree(scene).nodes.new("CompositorNodeBlur")
    blur.name = "Mine"
    node = lay_truth(scene, tmp_path, ("Normal",))
    compositing_tree(scene).links.new(node.outputs["Normal"], blur.inputs["Image"])
    other = scene.copy()
    write_layers_exr({f"View.Layer.{channel}": plane for channel, plane in planes_of("Normal", 1).items()},
                     tmp_path / f"unsaved_{bpy.path.clean_name(other.name)}_0001_truth.exr", {})
    lay(other, tmp_path, shape=SHAPE)
    its = compositing_tree(other).nodes
    assert its[NAME].node_tree != compositing_tree(scene).nodes[NAME].node_tree
    assert its["Mine"].inputs["Image"].links[0].from_socket == its[NAME].outputs["Normal"]
    assert compositing_tree(scene).nodes["Mine"].inputs["Image"].links[0].from_node.name == NAME


def test_a_node_of_an_older_file_gets_the_outputs(scene, tmp_path):
    """A group from before: without ground truth, and without the names of its other nodes."""
    node = lay_without_truth(scene, tmp_path)
    for inner in node.node_tree.nodes:
        if inner.name.endswith((" Scale", " Part")):
            inner.name = inner.bl_label
    tree = compositing_tree(scene)
    blur = tree.nodes.new("CompositorNodeBlur")
    tree.links.new(node.outputs["Depth"], blur.inputs["Image"])
    assert lay_truth(scene, tmp_path, ("Position",)) == node
    assert blur.inputs["Image"].is_linked
    assert_shows(scene, tmp_path, node, "Position")


def test_saved_outputs_work_after_loading(scene, tmp_path):
    lay_truth(scene, tmp_path, ("Vector",), (1, 2))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    scene = bpy.context.scene
    node = compositing_tree(scene).nodes[NAME]
    for frame in (2, 1):
        assert_shows(scene, tmp_path, node, "Vector", frame)


def test_an_undo_removes_the_outputs(scene, tmp_path):
    lay(scene, tmp_path, shape=SHAPE)
    bpy.ops.ed.undo_push(message="Before")
    lay_truth(scene, tmp_path, ("Normal",))
    bpy.ops.ed.undo_push(message="After")
    bpy.ops.ed.undo()
    node = compositing_tree(bpy.context.scene).nodes[NAME]
    assert "Normal" not in node.outputs and GROUND_TRUTH not in node.node_tree.nodes
    bpy.ops.ed.redo()
    scene = bpy.context.scene
    assert_shows(scene, tmp_path, compositing_tree(scene).nodes[NAME], "Normal")


def test_a_damaged_output_is_repaired(scene, tmp_path):
    group = lay_truth(scene, tmp_path, ("Normal", "UV")).node_tree
    group.nodes.remove(group.nodes["Normal Scale"])
    node = lay_truth(scene, tmp_path, ("Normal", "UV"))
    assert [socket.name for socket in node.outputs].count("Normal") == 1
    for name in ("Normal", "UV"):
        assert_shows(scene, tmp_path, node, name)


def test_a_missing_file_shows_the_blender_render(scene, tmp_path):
    node = lay_truth(scene, tmp_path, ("Normal",))
    next(tmp_path.glob("*_truth.exr")).unlink()
    assert not np.any(shown(scene, tmp_path, node.outputs["Normal"], "Red"))
    switch = node.node_tree.nodes["Normal Switch"].inputs["Switch"]
    assert not switch.default_value
    tree = compositing_tree(scene)
    tree.links.new(node.outputs["Normal"], tree.nodes.new("CompositorNodeBlur").inputs["Image"])
    lay_into_compositor(scene, next(tmp_path.glob("*_lens_image.exr")))
    assert "Normal" in node.outputs, "it is linked"


def test_the_cryptomatte_node_reads_the_image_of_the_file(scene, tmp_path):
    node = lay_truth(scene, tmp_path, ("CryptoObject00",))
    image = node.node_tree.nodes[GROUND_TRUTH].image
    assert image.name == f"{NAME} Scene {GROUND_TRUTH}" and image.type == "MULTILAYER"
    lay_without_truth(scene, tmp_path)
    assert GROUND_TRUTH not in node.node_tree.nodes
