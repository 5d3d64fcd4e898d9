"""The user's scene is exactly restored: after success, after an error, after cancelling at any step."""


import bpy
import numpy as np
import pytest

from lensfield.addon.job.job import Job
from lensfield.addon.job.steps import RenderPass
from lensfield.addon.render.render import render_steps, run
from lensfield.addon.scene.camera import capture_grid
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.render_state import guard_render_state, stand_in_camera
from lensfield.addon.scene.undo import Journal
from lensfield.engine import load_lens
from lensfield.engine.spectral.spectra import reflectance_basis
from noise import ROUNDING
from refusals import refused
from small_scenes import WAVELENGTHS_NM, give, light, material, radiance_on_axis, render, set_world, wall
from snapshot import COMPOSITOR, differences, snapshot

pytestmark = pytest.mark.every_blender


@pytest.fixture
def rich_scene(scene):
    """A scene with easily disturbed data: links, groups, animation, a shared material, unusual render settings."""
    set_world(scene, (0.2, 0.3, 0.4))
    painted, shader = material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.2, 0.1))
    noise = painted.node_tree.nodes.new("ShaderNodeTexNoise")
    painted.node_tree.links.new(noise.outputs["Color"], shader.inputs["Color"])
    wall(scene, painted)
    wall(scene, painted, 2.0).material_slots[0].link = "OBJECT"
    glow, emission = material("Glow", "ShaderNodeEmission")
    emission.inputs["Strength"].default_value = 2
    emission.inputs["Strength"].keyframe_insert("default_value", frame=1)
    wall(scene, glow, 3.0)
    glow.use_fake_user = True
    lamp = light(scene, "AREA", 5.0, color=(1, 0.5, 0.2)).data
    lamp.keyframe_insert("color", frame=1)
    scene.camera.data.dof.use_dof = True
    scene.camera.data.lens = 35
    scene.render.filepath = "//somewhere"
    scene.render.film_transparent = True
    scene.cycles.film_exposure = 2.5
    scene.cycles.sample_clamp_indirect = 10
    scene["my property"] = 7
    scene["lensfield_0"] = 42
    set_format(scene, "PNG", "RGBA", "8")
    scene.frame_set(3)
    return scene


def set_format(scene, file_format, color_mode, color_depth):
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = {"OPEN_EXR_MULTILAYER": "MULTI_LAYER_IMAGE", "FFMPEG": "VIDEO"}.get(file_format, "IMAGE")
    image.file_format, image.color_mode, image.color_depth = file_format, color_mode, color_depth
    if file_format.startswith("OPEN_EXR"):
        image.linear_colorspace_settings.name = "ACEScg"


def job(folder):
    return Job(lens=load_lens("edmund-54852"), wavelengths_nm=np.array((450.0, 550.0, 600.0, 650.0)),
               output_folder=folder, denoise="off", frame=1, clamp=True)


@pytest.mark.parametrize("truth", ["", "depth,position,normal,uv,flow,index,cryptomatte,coverage"])
def test_scene_is_the_same_after_success(rich_scene, tmp_path, truth):
    rich_scene.camera.keyframe_insert("location", frame=1)
    rich_scene.camera.location.x += 1
    rich_scene.camera.keyframe_insert("location", frame=3)
    rich_scene.frame_set(3)
    before = snapshot()
    render(rich_scene, tmp_path, frame=1, truth=truth)
    assert not differences(before, snapshot())


@pytest.mark.parametrize("file_format, color_mode, color_depth", [
    ("PNG", "RGBA", "16"), ("PNG", "BW", "8"), ("JPEG", "RGB", "8"), ("TIFF", "RGBA", "8"), ("OPEN_EXR", "RGB", "16"),
    ("OPEN_EXR_MULTILAYER", "RGBA", "32"), ("FFMPEG", "RGB", "8")])
def test_every_file_format_is_restored(rich_scene, tmp_path, file_format, color_mode, color_depth):
    set_format(rich_scene, file_format, color_mode, color_depth)
    before, of_pass = snapshot(), job(tmp_path)
    with Journal() as journal:
        capture = capture_grid(rich_scene, of_pass.lens, of_pass.wavelengths_nm)
        guard_render_state(rich_scene, of_pass, capture, tmp_path / "pass.exr", journal)
        assert rich_scene.render.image_settings.file_format == "OPEN_EXR_MULTILAYER"
    assert not differences(before, snapshot())


def test_a_marker_bound_camera_renders_and_the_scene_camera_is_restored(rich_scene, tmp_path):
    scene_camera = rich_scene.camera
    for frame, camera_type in ((1, "PERSP"), (2, "ORTHO")):
        camera = bpy.data.objects.new(f"Bound {frame}", bpy.data.cameras.new(f"Bound {frame}"))
        camera.data.type = camera_type
        rich_scene.collection.objects.link(camera)
        rich_scene.timeline_markers.new(f"Cut {frame}", frame=frame).camera = camera
    rich_scene.frame_set(3)
    rich_scene.camera = scene_camera
    before = snapshot()
    render(rich_scene, tmp_path, frame=1)
    assert not differences(before, snapshot())
    rich_scene.camera = None  # a marker binds one, so the scene is not refused
    render(rich_scene, tmp_path, frame=1)
    rich_scene.camera = scene_camera
    with refused(SceneError, field="type", value="ORTHO", where="camera 'Bound 2'"):
        render(rich_scene, tmp_path, frame=2)
    assert not differences(before, snapshot())


def test_an_undo_that_fails_does_not_prevent_the_others():
    undone = []
    with pytest.raises(ZeroDivisionError), Journal() as journal:
        journal.on_exit(lambda: undone.append("first"))
        journal.on_exit(lambda: 1 / 0)
        journal.on_exit(lambda: undone.append("last"))
    assert undone == ["last", "first"]


def test_a_snapshot_detects_changes(rich_scene):
    before = snapshot()
    bpy.data.materials["Paint"].node_tree.nodes["Noise Texture"].inputs["Scale"].default_value += 1
    rich_scene.cycles.film_exposure = 3
    assert len(differences(before, snapshot())) == 2


@pytest.mark.parametrize("steps_before_cancel", [1, 2, 3, 4])
def test_scene_is_the_same_after_cancelling(rich_scene, tmp_path, steps_before_cancel):
    before = snapshot()
    steps = render_steps(rich_scene, job(tmp_path))
    step, answer = None, None
    for _ in range(steps_before_cancel):
        step = steps.send(answer)
        if isinstance(step, RenderPass):
            bpy.ops.render.render(write_still=True)
        else:
            answer = step.call(lambda fraction: None)
    steps.close()
    assert not differences(before, snapshot())
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_scene_is_the_same_after_an_error(rich_scene, tmp_path):
    bpy.data.lights["Light"].lensfield.emission = "no-such-lamp"
    before = snapshot()
    with refused(SceneError, field="emission spectrum", value="no-such-lamp", where="area light 'Light'"):
        run(render_steps(rich_scene, job(tmp_path)))
    assert not differences(before, snapshot())
    assert not list(tmp_path.iterdir())


def assign_everywhere(scene, painted):
    """Use a material in every way that Blender has: by meshes, objects, layers, nodes and their modifiers."""
    square = wall(scene, painted)
    square.data.materials.append(painted)
    square.material_slots[1].link = "OBJECT"
    square.material_slots[1].material = painted
    square.material_slots[1].link = "DATA"  # it keeps the object's material, unused
    other = wall(scene, material("Other", "ShaderNodeBsdfDiffuse")[0])
    other.material_slots[0].link = "OBJECT"
    other.material_slots[0].material = painted
    scene.view_layers[0].material_override = painted
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    tree.nodes.new("GeometryNodeSetMaterial").inputs["Material"].default_value = painted
    tree.interface.new_socket("Material", socket_type="NodeSocketMaterial")
    modifier = other.modifiers.new("Nodes", "NODES")
    modifier.node_group = tree
    give(modifier, tree.interface.items_tree[0].identifier, painted)
    painted.use_fake_user = True


def test_a_stand_in_is_used_wherever_the_original_was(scene):
    painted, _ = material("Paint", "ShaderNodeBsdfDiffuse")
    assign_everywhere(scene, painted)
    bpy.context.view_layer.update()
    before, users = snapshot(), bpy.data.user_map(subset={painted})[painted]
    with pytest.raises(ZeroDivisionError), Journal() as journal:
        stand_in = journal.stand_in(painted)
        assert not bpy.data.user_map(subset={painted})[painted] and not painted.users
        assert bpy.data.user_map(subset={stand_in})[stand_in] == users and len(users) == 5
        assert stand_in.users == before["materials", "Paint"]["users"] - 1
        wall(scene, stand_in, 2.0).name = "New"
        raise ZeroDivisionError
    assert bpy.data.objects["New"].material_slots[0].material == painted
    bpy.data.meshes.remove(bpy.data.objects["New"].data)  # also removes the object
    assert not differences(before, snapshot())


SOURCES = {"mesh": None, "cube": "GeometryNodeMeshCube", "volume": "GeometryNodeVolumeCube",
           "instances": "GeometryNodeInstanceOnPoints"}


def set_on_geometry(square, painted, source):
    """Give a square without material slots a material by geometry nodes, which may replace its shape."""
    square.data.materials.clear()
    tree = set_by_nodes(square, painted)
    for in_out in ("INPUT", "OUTPUT"):
        tree.interface.new_socket(name="Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    geometry = tree.nodes.new("NodeGroupInput").outputs[0]
    if SOURCES[source]:
        made = tree.nodes.new(SOURCES[source])
        if source == "instances":
            tree.links.new(geometry, made.inputs["Points"])
            tree.links.new(tree.nodes.new("GeometryNodeMeshCube").outputs[0], made.inputs["Instance"])
        geometry = made.outputs[0]
    tree.links.new(geometry, tree.nodes["Set Material"].inputs["Geometry"])
    tree.links.new(tree.nodes["Set Material"].outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])


def evaluated_materials(scene):
    """The originals of all materials that the evaluated scene's shapes have, as a window's redraw reads them."""
    scene.view_layers[0].update()
    shapes = [instance.object.data for instance in scene.view_layers[0].depsgraph.object_instances]
    return {slot.original for shape in shapes for slot in getattr(shape, "materials", ()) if slot}


@pytest.mark.parametrize("source", SOURCES)
def test_evaluated_geometry_has_the_stand_in_and_then_the_original(scene, tmp_path, source):
    """Otherwise it would keep a pointer to freed memory."""
    painted, _ = material("Paint", "ShaderNodeBsdfDiffuse")
    set_on_geometry(wall(scene, painted), painted, source)
    set_format(scene, "PNG", "RGBA", "8")
    assert evaluated_materials(scene) == {painted}
    before = snapshot()
    with Journal() as journal:
        stand_in = journal.stand_in(painted)
        assert evaluated_materials(scene) == {stand_in}
    assert evaluated_materials(scene) == {painted}
    render(scene, tmp_path)
    assert not differences(before, snapshot())


def test_uv_project_keeps_the_view_of_the_users_camera(scene):
    """A capture is wider, and may be shifted or panoramic."""
    square = wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0])
    square.data.uv_layers.new()
    projector = square.modifiers.new("Project", "UV_PROJECT")
    projector.projectors[0].object = scene.camera
    scene.camera.data.shift_x = 0.1

    def coordinates():
        square.update_tag()
        scene.view_layers[0].update()
        shape = square.evaluated_get(scene.view_layers[0].depsgraph).data
        return np.array([entry.uv[:] for entry in shape.uv_layers[0].data])

    expected, before = coordinates(), snapshot()
    with Journal() as journal:
        stand_in_camera(scene, journal)
        scene.camera.data.lens, scene.camera.data.shift_x = 20.0, 0.0
        np.testing.assert_allclose(coordinates(), expected, atol=1e-6)
    assert not differences(before, snapshot())


def link_from_file(path, blocks):
    """Write the objects to a file, remove them and their data from this one, and link them instead."""
    bpy.data.libraries.write(str(path), set(blocks))
    bpy.data.batch_remove([*blocks, *bpy.data.meshes, *bpy.data.materials, *bpy.data.node_groups])
    with bpy.data.libraries.load(str(path), link=True) as (available, linked):
        linked.objects = available.objects
    for obj in linked.objects:
        bpy.context.scene.collection.objects.link(obj)


def set_by_nodes(square, painted):
    square.modifiers.new("Nodes", "NODES").node_group = tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    tree.nodes.new("GeometryNodeSetMaterial").inputs["Material"].default_value = painted
    return tree


def set_for_the_object(square, painted):
    square.name = "Nodes"
    square.material_slots[0].link = "OBJECT"
    square.material_slots[0].material = painted


@pytest.mark.parametrize("use", [set_by_nodes, set_for_the_object], ids=lambda use: use.__name__)
def test_a_user_that_cannot_take_a_stand_in_is_named_and_all_changes_are_undone(scene, tmp_path, use):
    painted, _ = material("Paint", "ShaderNodeBsdfDiffuse")
    square = wall(scene, painted)
    use(square, painted)
    link_from_file(tmp_path / "library.blend", [square])
    here = [material(f"Painted here {index}", "ShaderNodeBsdfDiffuse")[0] for index in range(2)]
    squares = [wall(scene, one) for one in here]
    bpy.context.view_layer.update()
    before = snapshot()
    message = "material 'Paint': user is 'Nodes', linked from another file: make it local"
    with pytest.raises(SceneError, match=message), Journal() as journal:
        stand_ins = [journal.stand_in(one) for one in here]
        assert [square.data.materials[0] for square in squares] == stand_ins
        journal.stand_in(bpy.data.materials["Paint"])
    # Blender itself marks data-blocks as directly linked once they are assigned to; nothing else may differ.
    assert not [line for line in differences(before, snapshot()) if "is_library_indirect" not in line]


def test_linked_objects_are_substituted_and_restored(scene, tmp_path):
    set_world(scene)
    scene.world.lensfield.emission = "380:1, 780:1"
    painted, _ = material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.2, 0.1))
    wall(scene, painted)
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {bpy.data.objects["Wall"]})
    bpy.data.objects.remove(bpy.data.objects["Wall"])
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (available, linked):
        linked.objects = available.objects
    scene.collection.objects.link(linked.objects[0])
    set_format(scene, "PNG", "RGBA", "8")
    bpy.context.view_layer.update()
    before = snapshot()
    measured = radiance_on_axis(scene, tmp_path)
    np.testing.assert_allclose(measured, reflectance_basis(WAVELENGTHS_NM) @ (0.7, 0.2, 0.1) / 400, rtol=ROUNDING)
    # Blender itself marks data-blocks as directly linked once they are assigned to; nothing else may differ.
    assert not [line for line in differences(before, snapshot()) if "is_library_indirect" not in line]


def test_only_the_compositor_changes_on_request(rich_scene, tmp_path):
    before = snapshot()
    render(rich_scene, tmp_path, to_compositor=True)
    changed = differences(before, snapshot())
    assert changed
    assert not [line for line in changed if not any(word in line for word in COMPOSITOR)]


def test_scene_is_the_same_after_an_unexpected_failure(rich_scene, tmp_path, monkeypatch):
    before = snapshot()
    monkeypatch.setattr("lensfield.addon.capture.finished_passes.read_pass", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run(render_steps(rich_scene, job(tmp_path)))
    assert not differences(before, snapshot())
