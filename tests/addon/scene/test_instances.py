"""The set of rendered objects, against Cycles itself, which renders a glowing square or a black picture."""

import bpy
import numpy as np
import pytest

from cycles_pictures import picture
from lensfield.addon.scene.instances import materials_of, rendered_blocks, rendered_instances
from small_scenes import give, light, material, wall


@pytest.fixture
def source(scene):
    """A glowing square in front of the camera, not in a collection yet."""
    square = wall(scene, material("Glow", "ShaderNodeEmission", (1, 1, 1))[0])
    scene.collection.objects.unlink(square)
    return square


def in_scene(scene, source):
    scene.collection.objects.link(source)


def hidden_in_the_viewport(scene, source):
    in_scene(scene, source)
    source.hide_viewport = True


def hidden_by_its_eye(scene, source):
    in_scene(scene, source)
    source.hide_set(True)


def hidden_in_renders(scene, source):
    in_scene(scene, source)
    source.hide_render = True


def child_collection(scene, source):
    outer, inner = (bpy.data.collections.new(name) for name in ("Outer", "Inner"))
    scene.collection.children.link(outer)
    outer.children.link(inner)
    inner.objects.link(source)
    return outer, scene.view_layers[0].layer_collection.children["Outer"]


def in_a_collection_hidden_in_the_viewport(scene, source):
    child_collection(scene, source)[0].hide_viewport = True


def in_a_collection_hidden_in_renders(scene, source):
    child_collection(scene, source)[0].hide_render = True


def in_an_excluded_collection(scene, source):
    child_collection(scene, source)[1].exclude = True


def included_within_an_excluded_collection(scene, source):
    layer_collection = child_collection(scene, source)[1]
    layer_collection.exclude = True
    layer_collection.children["Inner"].exclude = False


def instanced(scene, source):
    collection = bpy.data.collections.new("Library")
    collection.objects.link(source)
    instancer = bpy.data.objects.new("Instancer", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    scene.collection.objects.link(instancer)
    return instancer, collection


def instanced_by_what_the_viewport_hides(scene, source):
    instanced(scene, source)[0].hide_viewport = True


def instanced_though_hidden_in_the_viewport(scene, source):
    instanced(scene, source)
    source.hide_viewport = True


def instanced_but_hidden_in_renders(scene, source):
    instanced(scene, source)
    source.hide_render = True


def instanced_from_a_collection_hidden_in_renders(scene, source):
    instanced(scene, source)[1].hide_render = True


def by_particles_though_hidden_in_renders(scene, source):
    """Many small ones, all over a square that does not glow itself."""
    in_scene(scene, source)
    source.hide_render, source.location.z = True, 5
    host = wall(scene, material("Dark", "ShaderNodeBsdfDiffuse", (0, 0, 0))[0])
    host.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = host.particle_systems[0].settings
    settings.type, settings.count, settings.use_advanced_hair, settings.hair_length = "HAIR", 400, True, 1.0
    settings.render_type, settings.instance_object, settings.particle_size = "OBJECT", source, 0.1


def by_nodes(scene, source):
    """An object whose geometry nodes create the source as an instance."""
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    info = tree.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value, info.inputs["As Instance"].default_value = source, True
    tree.links.new(info.outputs["Geometry"], tree.nodes.new("NodeGroupOutput").inputs[0])
    host = bpy.data.objects.new("Host", bpy.data.meshes.new("Empty mesh"))
    host.location = source.location  # the instance moves with it
    scene.collection.objects.link(host)
    host.modifiers.new("Nodes", "NODES").node_group = tree
    return host


def given_to_nodes_by_the_modifier(scene, source):
    host = by_nodes(scene, source)
    tree = host.modifiers[0].node_group
    info = next(node for node in tree.nodes if node.bl_idname == "GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = None
    socket = tree.interface.new_socket("Object", in_out="INPUT", socket_type="NodeSocketObject")
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs["Object"], info.inputs["Object"])
    give(host.modifiers[0], socket.identifier, source)
    return host


def given_by_a_modifier_that_the_viewport_leaves_out(scene, source):
    given_to_nodes_by_the_modifier(scene, source).modifiers[0].show_viewport = False


def by_nodes_though_hidden_in_renders(scene, source):
    by_nodes(scene, source)
    in_scene(scene, source)
    source.hide_render = True


def by_nodes_of_what_the_viewport_hides(scene, source):
    by_nodes(scene, source).hide_viewport = True


def by_nodes_that_the_viewport_leaves_out(scene, source):
    by_nodes(scene, source).modifiers[0].show_viewport = False


@pytest.mark.parametrize("arrange", [
    in_scene, hidden_in_the_viewport, hidden_by_its_eye, hidden_in_renders, in_a_collection_hidden_in_the_viewport,
    in_a_collection_hidden_in_renders, in_an_excluded_collection, included_within_an_excluded_collection, instanced,
    instanced_by_what_the_viewport_hides, instanced_though_hidden_in_the_viewport, instanced_but_hidden_in_renders,
    instanced_from_a_collection_hidden_in_renders, by_particles_though_hidden_in_renders, by_nodes,
    given_to_nodes_by_the_modifier, given_by_a_modifier_that_the_viewport_leaves_out,
    by_nodes_though_hidden_in_renders, by_nodes_of_what_the_viewport_hides, by_nodes_that_the_viewport_leaves_out],
    ids=lambda arrange: arrange.__name__)
def test_rendered_instances_are_exactly_those_that_cycles_renders(scene, source, tmp_path, arrange):
    arrange(scene, source)
    shines = picture(scene, tmp_path).max() > 0.5
    assert (source in {instance.obj for instance in rendered_instances(scene)}) == shines
    assert (bpy.data.materials["Glow"] in rendered_blocks(scene)) == shines


@pytest.mark.parametrize("hide", [False, True], ids=["seen in the viewport", "hidden in the viewport"])
def test_instances_are_placed_as_in_cycles(scene, source, hide):
    parent = bpy.data.objects.new("Parent", None)
    parent.location = 0, 3, 0
    scene.collection.objects.link(parent)
    instancer, collection = instanced(scene, source)
    instancer.parent, instancer.location.x, instancer.hide_viewport = parent, 20, hide
    collection.instance_offset = 0, 0, 4
    instance = next(one for one in rendered_instances(scene) if one.obj == source)
    np.testing.assert_allclose(instance.matrix_world[:3, 3], (20, 3, -1 - 4), atol=1e-6)  # the wall is at z = -1
    np.testing.assert_allclose(instance.box.min(axis=0), (15, -2, -5), atol=1e-6)  # it is 10 m wide
    np.testing.assert_allclose(instance.box.max(axis=0), (25, 8, -5), atol=1e-6)


def test_only_material_slots_used_by_faces_count(scene):
    used, unused = (material(name, "ShaderNodeBsdfDiffuse")[0] for name in ("Used", "Unused"))
    square = wall(scene, unused)
    square.data.materials.append(used)
    assert materials_of(square) == {unused}
    square.data.polygons[0].material_index = 1
    assert materials_of(square) == {used}
    assert rendered_blocks(scene)[used] == ("Wall",) and unused not in rendered_blocks(scene)


@pytest.mark.parametrize("hide", [False, True], ids=["seen in the viewport", "hidden in the viewport"])
def test_materials_set_by_geometry_nodes_count(scene, hide):
    in_slot, by_node = (material(name, "ShaderNodeBsdfDiffuse")[0] for name in ("Own", "By node"))
    square = wall(scene, in_slot)
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    setter = tree.nodes.new("GeometryNodeSetMaterial")
    setter.inputs["Material"].default_value = by_node
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs[0], setter.inputs[0])
    tree.links.new(setter.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    square.modifiers.new("Nodes", "NODES").node_group = tree
    square.hide_viewport = hide
    assert by_node in rendered_blocks(scene)


def test_lights_worlds_and_overrides_count(scene):
    lamp = light(scene, "POINT", 10.0)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0])
    assert rendered_blocks(scene) == {scene.world: (), lamp.data: ("Light",), bpy.data.materials["Paint"]: ("Wall",)}
    lamp.hide_render = True
    layer = scene.view_layers[0]
    layer.world_override, layer.material_override = bpy.data.worlds.new("Other"), bpy.data.materials.new("Clay")
    assert rendered_blocks(scene) == {layer.world_override: (), layer.material_override: ("Wall",)}


def test_instances_of_a_scene_not_in_the_window(scene):
    other = bpy.data.scenes.new("Other")
    square = wall(other, material("Paint", "ShaderNodeBsdfDiffuse")[0])
    assert {instance.obj for instance in rendered_instances(other)} == {square}
    assert square not in {instance.obj for instance in rendered_instances(scene)}
