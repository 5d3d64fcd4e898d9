"""Inputs of geometry nodes are part of the fingerprint, wherever Blender stores them."""

import bpy
import pytest

from lensfield.addon.scene.compositor import fingerprint_anew
from small_scenes import give, material, wall


@pytest.fixture
def modifier(scene):
    """A modifier whose nodes have inputs for a size and a material."""
    tree = bpy.data.node_groups.new("Set", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        tree.interface.new_socket(name="Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    for kind in ("Float", "Material"):
        tree.interface.new_socket(name=kind, in_out="INPUT", socket_type=f"NodeSocket{kind}")
    modifier = wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0]).modifiers.new("Set", "NODES")
    modifier.node_group = tree
    return modifier


def give_to(modifier, name, value):
    return give(modifier, next(item.identifier for item in modifier.node_group.interface.items_tree
                               if item.name == name and item.in_out == "INPUT"), value)


@pytest.mark.parametrize("name", ["Float", "Material"])
def test_inputs_of_geometry_nodes_modifiers_count(scene, modifier, name):
    values = (1.0, 2.0) if name == "Float" else (bpy.data.materials["Paint"], bpy.data.materials.new("Other"))
    prints = []
    for value in (*values, values[0]):
        give_to(modifier, name, value)
        prints.append(fingerprint_anew(scene))
    assert prints[0] == prints[2] != prints[1]


def test_animated_values_count_by_their_keyframes(scene, modifier):
    for frame, value in ((1, 1.0), (5, 3.0)):
        owner, path = give_to(modifier, "Float", value)
        owner.keyframe_insert(path, frame=frame)
    prints = []
    for frame in (1, 3, 5):
        scene.frame_set(frame)
        prints.append(fingerprint_anew(scene))
    assert len(set(prints)) == 1


def test_open_panels_of_a_modifier_do_not_count(scene, modifier):
    before = fingerprint_anew(scene)
    modifier.open_warnings_panel = not modifier.open_warnings_panel
    assert fingerprint_anew(scene) == before
