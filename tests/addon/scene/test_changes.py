"""Values that change after a copy of a file was saved, applied to the copy: it becomes equal, or a copy is needed."""

import bpy
import pytest

from lensfield.addon.scene.changes import DIFFERENT, changed_blocks, structure_digest, take_changes, write_changes
from lensfield.addon.scene.compositor import fingerprint_anew
from lensfield.engine import InputError
from small_scenes import background, light, material, paint_by_nodes, set_world, wall


@pytest.fixture
def furnished(scene):
    """A wall below a rotated and scaled parent, next to a copy with a constraint and a keyframe; lamp, world, group."""
    paint, _ = material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))
    first, second = wall(scene, paint), wall(scene, paint_by_nodes("Other", (0.1, 0.5, 0.2))[0])
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    parent.rotation_euler, parent.scale = (0.1, 0.2, 0.3), (1, 2, 3)
    bpy.context.view_layer.update()
    first.parent, first.matrix_parent_inverse = parent, parent.matrix_world.inverted()
    second.constraints.new("COPY_ROTATION").target = first
    for frame in (1, 5):
        second.location.x = frame
        second.keyframe_insert("location", index=0, frame=frame)
    group = bpy.data.collections.new("Group")
    scene.collection.children.link(group)
    group.objects.link(light(scene, "SPOT", 20.0))
    set_world(scene, (0.1, 0.2, 0.3))
    tree = bpy.data.node_groups.new("Grow", "GeometryNodeTree")
    tree.nodes.new("GeometryNodeTransform").name = "Transform"
    second.modifiers.new("Grow", "NODES").node_group = tree
    scene.frame_set(1)
    bpy.context.view_layer.update()
    return scene


def written(scene, change, folder):
    """Save copy.blend and change the scene; returns whether values may express this, and changes.json is written."""
    changed = {}

    def note(scene, depsgraph):
        changed.update(changed_blocks(depsgraph, changed))

    bpy.context.view_layer.update()
    before = structure_digest(scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "copy.blend"), copy=True, compress=False)
    bpy.app.handlers.depsgraph_update_post.append(note)
    change(scene)
    bpy.context.view_layer.update()
    bpy.app.handlers.depsgraph_update_post.remove(note)
    return structure_digest(scene) == before and write_changes(folder / "changes.json", scene, changed, DIFFERENT)


def taken(folder):
    """The scene of the copy with the changes."""
    bpy.ops.wm.open_mainfile(filepath=str(folder / "copy.blend"))
    take_changes(bpy.context.scene, folder / "changes.json")
    return bpy.context.scene


def block(kind, name):
    return getattr(bpy.data, kind)[name]


def move(scene):
    wall = block("objects", "Wall")
    wall.location, wall.delta_scale = (0.1, 0.2, -1.3), (1, 1, 1.5)


def turn_by_quaternion(scene):
    wall = block("objects", "Wall")
    wall.rotation_mode, wall.rotation_quaternion = "QUATERNION", (0.8, 0.6, 0, 0)


def put_back_in_parent(scene):
    block("objects", "Wall").matrix_parent_inverse.identity()
    block("objects", "Wall").update_tag(refresh={"OBJECT"})


def move_parent_and_camera(scene):
    block("objects", "Parent").location.y += 0.25
    scene.camera.rotation_euler.x += 0.01


def zoom(scene):
    camera = scene.camera.data
    camera.lens, camera.clip_end, camera.dof.use_dof, camera.dof.aperture_fstop = 33.3, 70.0, True, 1.7


def move_and_change_the_lens(scene):
    """Blender announces the lens file as a change of the camera, whose values stay as they are."""
    scene.camera.data.lensfield.lens_file = "own.toml"
    block("objects", "Wall").location.x = 0.2


def brighten(scene):
    lamp = block("lights", "Light")
    lamp.energy, lamp.color, lamp.spot_size = 33.0, (1, 0.5, 0.25), 1.0
    background(scene).inputs["Strength"].default_value = 0.7


def paint_anew(scene):
    shader = next(node for node in block("materials", "Paint").node_tree.nodes if "Roughness" in node.inputs)
    shader.inputs["Color"].default_value, shader.inputs["Roughness"].default_value = (0.2, 0.3, 0.4, 1), 0.3


def hide(scene):
    block("objects", "Wall.001").hide_render = True
    block("collections", "Group").hide_render = True


def hide_in_renders(scene):
    """Blender announces nothing for the modifier alone."""
    block("objects", "Wall.001").modifiers["Grow"].show_render = False
    block("objects", "Wall.001").location.y = 0.2


def another_frame(scene):
    scene.frame_set(3)


def move_keyed(scene):
    """By hand, without a keyframe: a copy loses that, too."""
    block("objects", "Wall.001").location = 7, 0.5, -1


CHANGES = [move, turn_by_quaternion, put_back_in_parent, move_parent_and_camera, zoom, move_and_change_the_lens,
           brighten, paint_anew, hide, hide_in_renders, another_frame, move_keyed]


@pytest.mark.parametrize("change", CHANGES)
def test_a_copy_with_the_changed_values_equals_a_later_copy(furnished, change, tmp_path):
    original = fingerprint_anew(furnished), furnished.frame_current
    assert written(furnished, change, tmp_path)
    expected = fingerprint_anew(furnished), furnished.frame_current
    assert expected != original
    later = tmp_path / "later.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(later), copy=True, compress=False)
    scene = taken(tmp_path)
    assert (fingerprint_anew(scene), scene.frame_current) == expected
    places = matrices(scene)
    bpy.ops.wm.open_mainfile(filepath=str(later))
    assert places == matrices(bpy.context.scene)


def matrices(scene):
    scene.frame_set(scene.frame_current)
    return {obj.name: [tuple(row) for row in obj.matrix_world] for obj in scene.objects}


def edit_mesh(scene):
    mesh = block("objects", "Wall").data
    mesh.vertices[0].co.z += 0.1
    mesh.update()


def add_object(scene):
    scene.collection.objects.link(bpy.data.objects.new("New", None))


def add_modifier(scene):
    block("objects", "Wall").modifiers.new("Bevel", "BEVEL")


def assign_material(scene):
    block("objects", "Wall").data.materials[0] = block("materials", "Other")
    block("objects", "Wall").data.update_tag()


def change_film(scene):
    scene.cycles.film_exposure = 2.0


def rename(scene):
    block("objects", "Wall").name = "Door"


def change_custom_property(scene):
    block("objects", "Wall")["tint"] = 0.5
    block("objects", "Wall").update_tag()


def simulate(scene):
    block("objects", "Wall").location.x = 0.1
    block("objects", "Wall").modifiers.new("Cloth", "CLOTH")


@pytest.mark.parametrize("change", [edit_mesh, add_object, add_modifier, assign_material, change_film, rename,
                                    change_custom_property, simulate])
def test_other_changes_need_a_copy(furnished, change, tmp_path):
    if written(furnished, change, tmp_path):
        with pytest.raises(InputError, match="copy the file again"):
            taken(tmp_path)


def test_objects_of_the_same_name_in_two_files_are_not_confused(furnished, tmp_path):
    library = tmp_path / "lamps.blend"
    bpy.data.libraries.write(str(library), {block("objects", "Light")})
    with bpy.data.libraries.load(str(library), link=True) as (_, to):
        to.objects = ["Light"]
    linked, = to.objects
    furnished.collection.objects.link(linked)
    local = bpy.data.objects["Light", None]
    assert written(furnished, lambda _: setattr(local, "location", (0.4, 0, 0)), tmp_path)
    taken(tmp_path)
    assert {bool(obj.library): obj.location.x for obj in bpy.data.objects if obj.name == "Light"} == {
        False: pytest.approx(0.4), True: 0.0}
