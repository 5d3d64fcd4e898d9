"""Colours that multiply light many times: glass by its crossings, volumes by their optical depth."""

import bpy
import numpy as np
import pytest

from lensfield.addon.shading.assigned import AssignedSpectra
from lensfield.addon.shading.repeated import UNKNOWN_DEPTH, repeated_colours, tinting_objects
from lensfield.engine.spectral.spectra import channel_basis, load_spectrum, reflectance_basis
from small_scenes import material, wall

NM = np.array([430.0, 540.0, 620.0])
COLOUR = 0.1, 0.8, 0.3
SPECTRUM = reflectance_basis(NM) @ COLOUR
BOX_M = 0.5, 0.2, 0.3
LONGEST_M = np.linalg.norm(BOX_M)


def repeated(scene):
    scene.view_layers[0].update()
    return repeated_colours(scene, scene.world, AssignedSpectra(NM))


def body(scene, of_material, name="Body"):
    """A closed box of BOX_M, half of it by its mesh and half by its object's scale."""
    bpy.ops.mesh.primitive_cube_add(size=2)
    box = bpy.context.object
    box.name, box.scale = name, np.array(BOX_M) / 2
    box.data.materials.append(of_material)
    return box


def volume(node_type, **inputs):
    shown = bpy.data.materials.new("Fog")
    shown.use_nodes = True
    tree = shown.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(node_type)
    for name, value in inputs.items():
        socket = shader.inputs[name.replace("_", " ")]
        socket.default_value = (*value, 1) if socket.type == "RGBA" else value
    tree.links.new(shader.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Volume"])
    return shown


@pytest.mark.parametrize("node_type", ["ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction", "ShaderNodeBsdfTranslucent"])
def test_light_crosses_glass_up_to_the_bounce_limit(scene, node_type):
    scene.cycles.max_bounces, scene.cycles.transmission_bounces = 20, 7
    wall(scene, material("Glass", node_type, COLOUR)[0])
    each, = repeated(scene)
    assert each.place == "'Wall' of 'Glass'" and not each.volume
    np.testing.assert_allclose(each.colour.curve(NM), SPECTRUM)
    np.testing.assert_allclose(each.colour.rgb, COLOUR, atol=0.003)
    assert each.colour.powers[0] == 1 and each.colour.powers[-1] == 7


def test_transparency_has_a_separate_bounce_limit(scene):
    scene.cycles.transparent_max_bounces = 5
    wall(scene, material("Film", "ShaderNodeBsdfTransparent", COLOUR)[0])
    assert repeated(scene)[0].colour.powers[-1] == 5


@pytest.mark.parametrize("weight, is_glass", [(0.0, False), (0.5, True), (1.0, True)])
def test_principled_glass_uses_the_square_root_of_its_colour(scene, weight, is_glass):
    scene.cycles.max_bounces = 12
    glass = bpy.data.materials.new("Glass")
    glass.use_nodes = True
    shader = next(node for node in glass.node_tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")
    shader.inputs["Base Color"].default_value = (*COLOUR, 1)
    shader.inputs["Transmission Weight"].default_value = weight
    wall(scene, glass)
    colours = [each.colour for each in repeated(scene)]
    assert len(colours) == is_glass
    for colour in colours:
        np.testing.assert_allclose(colour.curve(NM), np.sqrt(SPECTRUM))
        np.testing.assert_allclose(colour.rgb, np.sqrt(COLOUR), atol=0.003)


@pytest.mark.parametrize("node_type", ["ShaderNodeBsdfDiffuse", "ShaderNodeEmission"])
def test_paint_and_light_are_not_repeated(scene, node_type):
    wall(scene, material("Paint", node_type, COLOUR)[0])
    assert not repeated(scene)


def test_an_assigned_reflectance_replaces_the_colour(scene):
    glass = material("Glass", "ShaderNodeBsdfGlass", COLOUR)[0]
    glass.lensfield.reflectance = "chart-15-red"
    wall(scene, glass)
    np.testing.assert_allclose(repeated(scene)[0].colour.curve(NM), load_spectrum("chart-15-red").at(NM))


def test_a_colour_from_nodes_is_unknown(scene):
    glass, shader = material("Glass", "ShaderNodeBsdfGlass")
    glass.node_tree.links.new(glass.node_tree.nodes.new("ShaderNodeTexImage").outputs[0], shader.inputs["Color"])
    wall(scene, glass)
    assert not repeated(scene)


def test_hidden_glass_does_not_count(scene):
    wall(scene, material("Glass", "ShaderNodeBsdfGlass", COLOUR)[0]).hide_render = True
    assert not repeated(scene)


@pytest.mark.parametrize("fog, extinction", [
    (lambda: volume("ShaderNodeVolumeAbsorption", Color=COLOUR, Density=3.0), lambda colour: 1 - colour),
    (lambda: volume("ShaderNodeVolumeScatter", Color=COLOUR, Density=3.0), lambda colour: colour),
    (lambda: volume("ShaderNodeVolumePrincipled", Color=COLOUR, Density=3.0, **{"Absorption_Color": (1, 1, 1)}),
     lambda colour: colour),
    (lambda: volume("ShaderNodeVolumePrincipled", Color=COLOUR, Density=3.0), lambda colour: np.ones(3))],
    ids=["absorption", "scatter", "white principled", "black principled"])
def test_a_volume_is_as_deep_as_its_longest_path(scene, fog, extinction):
    body(scene, fog())
    each, = repeated(scene)
    assert each.volume and each.place == "'Body' of 'Fog'"
    np.testing.assert_allclose(each.colour.curve(NM), np.exp(-extinction(SPECTRUM)), rtol=1e-6)
    np.testing.assert_allclose(each.colour.rgb, np.exp(-extinction(np.array(COLOUR))), rtol=0.003)
    assert each.colour.powers[-1] == pytest.approx(3.0 * LONGEST_M, rel=1e-5)


def test_volume_coefficients_give_lengths_per_channel(scene):
    absorption, scatter = np.array((2.0, 0.5, 1.0)), np.array((0.5, 0.25, 0.0))
    body(scene, volume("ShaderNodeVolumeCoefficients", Absorption_Coefficients=absorption,
                       Scatter_Coefficients=scatter))
    each, = repeated(scene)
    np.testing.assert_allclose(each.colour.curve(NM), np.exp(-channel_basis(NM) @ (absorption + scatter)), rtol=1e-6)
    assert each.colour.powers[-1] == pytest.approx(LONGEST_M, rel=1e-5)


def test_the_largest_body_counts_and_zero_density_does_not(scene):
    fog = volume("ShaderNodeVolumeAbsorption", Color=COLOUR, Density=1.0)
    body(scene, fog)
    body(scene, fog, "Other").scale *= 3
    each, = repeated(scene)
    assert each.place == "'Body' (and 1 more) of 'Fog'"
    assert each.colour.powers[-1] == pytest.approx(3 * LONGEST_M, rel=1e-5)
    next(node for node in fog.node_tree.nodes if "Density" in node.inputs).inputs["Density"].default_value = 0
    assert not repeated(scene)


@pytest.mark.parametrize("colour, tints", [((0.5, 0.5, 0.5), False), (COLOUR, True), (None, True)])
def test_coloured_transparency_tints_the_background(scene, colour, tints):
    film, shader = material("Film", "ShaderNodeBsdfTransparent", colour or (1, 1, 1))
    if colour is None:
        film.node_tree.links.new(film.node_tree.nodes.new("ShaderNodeTexImage").outputs[0], shader.inputs["Color"])
    wall(scene, film)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", COLOUR)[0]).name = "Other"
    assert tinting_objects(scene) == ({"Wall"} if tints else set())


@pytest.mark.parametrize("fog, tints", [
    (lambda: volume("ShaderNodeVolumeAbsorption", Color=COLOUR), True),
    (lambda: volume("ShaderNodeVolumeAbsorption", Color=(0.2, 0.2, 0.2)), False),
    (lambda: volume("ShaderNodeVolumePrincipled", Color=COLOUR), False),
    (lambda: volume("ShaderNodeVolumeCoefficients", Absorption_Coefficients=(1, 2, 1)), True)],
    ids=["red", "grey", "smoke that absorbs all alike", "coefficients"])
def test_volumes_with_coloured_absorption_tint_the_background(scene, fog, tints):
    body(scene, fog())
    scene.view_layers[0].update()
    assert tinting_objects(scene) == ({"Body"} if tints else set())


def test_a_world_volume_has_unknown_depth(scene):
    tree = scene.world.node_tree
    shader = tree.nodes.new("ShaderNodeVolumeAbsorption")
    shader.inputs["Color"].default_value = (*COLOUR, 1)
    tree.links.new(shader.outputs[0], tree.get_output_node("CYCLES").inputs["Volume"])
    each, = repeated(scene)
    assert each.place == "the world 'World'" and each.colour.powers[-1] == pytest.approx(UNKNOWN_DEPTH)
