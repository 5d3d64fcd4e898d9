"""A colour linked to a shader input: Cycles treats it as emission, and so does its spectrum."""

import bpy
import numpy as np
import pytest

from cycles_pictures import picture
from lensfield.addon.shading.lint import lint
from lensfield.addon.shading.node_rules import APPROXIMATED, REJECTED
from lensfield.engine.spectral.spectra import emission_basis, load_spectrum, white_density
from small_scenes import WAVELENGTHS_NM, material, radiance_on_axis, set_world, wall

COLOUR = (0.9, 0.5, 0.1)
NM = np.array(WAVELENGTHS_NM)


def rgb_node(tree, colour=COLOUR):
    node = tree.nodes.new("ShaderNodeRGB")
    node.outputs[0].default_value = (*colour, 1)
    return node.outputs[0]


def output_of(tree):
    return next(node for node in tree.nodes if node.bl_idname.startswith("ShaderNodeOutput")).inputs["Surface"]


def onto_surface(tree):
    tree.links.new(rgb_node(tree), output_of(tree))


def into_mix_shader(tree):
    mix = tree.nodes.new("ShaderNodeMixShader")
    mix.inputs["Fac"].default_value = 0.5
    for socket in mix.inputs[1:]:
        tree.links.new(rgb_node(tree), socket)
    tree.links.new(mix.outputs[0], output_of(tree))


def through_reroute(tree):
    reroute = tree.nodes.new("NodeReroute")
    tree.links.new(rgb_node(tree), reroute.inputs[0])
    tree.links.new(reroute.outputs[0], output_of(tree))


def out_of_group(tree, socket_type="NodeSocketShader"):
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    group.interface.new_socket(name="Out", in_out="OUTPUT", socket_type=socket_type)
    group.links.new(rgb_node(group), group.nodes.new("NodeGroupOutput").inputs[0])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    tree.links.new(node.outputs[0], output_of(tree))


def out_of_group_as_colour(tree):
    out_of_group(tree, "NodeSocketColor")


def into_group(tree):
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    for side in ("INPUT", "OUTPUT"):
        group.interface.new_socket(name="Shader", in_out=side, socket_type="NodeSocketShader")
    group.links.new(group.nodes.new("NodeGroupInput").outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    tree.links.new(rgb_node(tree), node.inputs[0])
    tree.links.new(node.outputs[0], output_of(tree))


def from_nodes(tree):
    mix = tree.nodes.new("ShaderNodeMixRGB")
    mix.inputs["Fac"].default_value = 0.0
    tree.links.new(rgb_node(tree), mix.inputs["Color1"])
    tree.links.new(mix.outputs[0], output_of(tree))


WAYS = [onto_surface, into_mix_shader, through_reroute, out_of_group, out_of_group_as_colour, into_group, from_nodes]


@pytest.fixture
def glowing(scene):
    """A wall that fills the view; returns the tree of its material."""
    new, _ = material("Glow", "ShaderNodeBsdfDiffuse")
    wall(scene, new)
    return new.node_tree


@pytest.mark.parametrize("link", WAYS)
def test_a_colour_glows_as_in_cycles(scene, glowing, tmp_path, link):
    link(glowing)
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), emission_basis(NM) @ COLOUR, rtol=1e-4)
    np.testing.assert_allclose(picture(scene, tmp_path).mean(axis=(1, 2)), COLOUR, rtol=1e-4)


@pytest.mark.parametrize("link", WAYS)
def test_a_colour_as_a_shader_is_approximated(scene, glowing, link):
    link(glowing)
    findings = lint(scene)
    assert findings[0].verdict == APPROXIMATED and "emits light" in findings[0].text
    assert not any(finding.verdict == REJECTED for finding in findings)


def test_a_number_glows_white(scene, glowing, tmp_path):
    number = glowing.nodes.new("ShaderNodeValue")
    number.outputs[0].default_value = 0.7
    glowing.links.new(number.outputs[0], output_of(glowing))
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), 0.7 * white_density(NM), rtol=1e-4)
    np.testing.assert_allclose(picture(scene, tmp_path).mean(axis=(1, 2)), 0.7, rtol=1e-4)


def test_a_world_with_only_a_colour_glows(scene, tmp_path):
    onto_surface(scene.world.node_tree)
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), emission_basis(NM) @ COLOUR, rtol=1e-4)
    np.testing.assert_allclose(picture(scene, tmp_path).mean(axis=(1, 2)), COLOUR, rtol=1e-4)


def test_an_assigned_emission_replaces_the_colour(scene, glowing, tmp_path):
    onto_surface(glowing)
    bpy.data.materials["Glow"].lensfield.emission = "illuminant-a"
    expected = load_spectrum("illuminant-a").density_at(NM)
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), expected, rtol=1e-4)


def test_a_colour_glows_in_a_separate_light_group(scene, glowing, tmp_path):
    """Otherwise daylight would have the spectrum of the other light group."""
    onto_surface(glowing)
    set_world(scene)
    scene.world.lensfield.emission = "sodium-lp"
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), emission_basis(NM) @ COLOUR, rtol=1e-4)


def test_a_blackbody_without_a_shader_follows_plancks_law(scene, glowing, tmp_path):
    body = glowing.nodes.new("ShaderNodeBlackbody")
    body.inputs[0].default_value = 2856.0
    glowing.links.new(body.outputs[0], output_of(glowing))
    measured = radiance_on_axis(scene, tmp_path)
    expected = load_spectrum("illuminant-a").density_at(NM)
    np.testing.assert_allclose(measured / measured[1], expected / expected[1], rtol=2e-3)
