"""Colours become spectra: radiance against closed forms, with spectra evaluated by hand from their files."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from lensfield.addon.capture.bands import passes
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.shading.wiring import single_shader
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.spectra import LIBRARY, emission_basis, reflectance_basis, white_density
from noise import ROUNDING
from refusals import refused
from small_scenes import (
    WAVELENGTHS_NM,
    background,
    light,
    material,
    paint_by_nodes,
    radiance_on_axis,
    render,
    set_world,
    wall,
)

NM = np.array(WAVELENGTHS_NM)
FLAT = "380:1, 780:1"
FLAT_DENSITY = 1 / 400  # unit integral over 380 to 780 nm
PRECISION = 1e-3  # for surfaces lit by a lamp: the cosines of pixels next to the axis lose 2e-4


def patch(name):
    path, = LIBRARY["light"].parent.glob(f"*/{name}.spd")
    nm, value = np.loadtxt(path).T
    return np.interp(NM, nm, value)


def test_each_pass_carries_three_wavelengths():
    assert [band.tolist() for band in passes([400, 500, 600, 700])] == [[700, 700, 400], [600, 600, 500]]
    assert [band.tolist() for band in passes(range(400, 900, 100))] == [[800, 700, 400], [600, 600, 500]]
    assert [band.tolist() for band in passes(range(400, 700, 50))] == [[600, 550, 400], [650, 500, 450]]
    assert [band.tolist() for band in passes([400, 500])] == [[500, 500, 400]]


def test_world_of_flat_spectrum_spreads_its_strength_over_the_band(scene, tmp_path):
    set_world(scene, strength=2.0)
    scene.world.lensfield.emission = FLAT
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), 2.0 * FLAT_DENSITY, rtol=ROUNDING)


def test_white_world_is_daylight(scene, tmp_path):
    set_world(scene)
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), white_density(NM), rtol=ROUNDING)


def test_coloured_world_is_upsampled(scene, tmp_path):
    set_world(scene, colour=(0.9, 0.5, 0.1))
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), emission_basis(NM) @ (0.9, 0.5, 0.1), rtol=ROUNDING)


def test_assigned_reflectance_under_a_flat_world(scene, tmp_path):
    set_world(scene)
    scene.world.lensfield.emission = FLAT
    painted, _ = material("Paint", "ShaderNodeBsdfDiffuse")
    painted.lensfield.reflectance = "chart-15-red"
    wall(scene, painted)
    expected = patch("chart-15-red") * FLAT_DENSITY  # a white furnace: radiance = reflectance x world
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), expected, rtol=ROUNDING)


def test_constant_colour_is_upsampled_under_a_flat_world(scene, tmp_path):
    set_world(scene)
    scene.world.lensfield.emission = FLAT
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    expected = reflectance_basis(NM) @ (0.7, 0.3, 0.05) * FLAT_DENSITY
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), expected, rtol=ROUNDING)


def test_colour_computed_by_nodes_is_upsampled_like_a_constant(scene, tmp_path):
    set_world(scene)
    scene.world.lensfield.emission = FLAT
    wall(scene, paint_by_nodes("Paint", (0.7, 0.3, 0.05))[0])
    expected = reflectance_basis(NM) @ (0.7, 0.3, 0.05) * FLAT_DENSITY
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), expected, rtol=ROUNDING)


def test_colours_inside_node_groups_are_upsampled(scene, tmp_path):
    set_world(scene)
    scene.world.lensfield.emission = FLAT
    wall(scene, in_group(material("Paint", "ShaderNodeBsdfDiffuse")[0], (0.7, 0.3, 0.05)))
    expected = reflectance_basis(NM) @ (0.7, 0.3, 0.05) * FLAT_DENSITY
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), expected, rtol=ROUNDING)


def test_emission_material_keeps_its_strength_with_the_assigned_spectrum(scene, tmp_path):
    glowing, shader = material("Glow", "ShaderNodeEmission", (1, 0.2, 0))
    shader.inputs["Strength"].default_value = 3.0
    glowing.lensfield.emission = FLAT
    wall(scene, glowing)
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), 3.0 * FLAT_DENSITY, rtol=ROUNDING)


@pytest.mark.parametrize("reflectance", [0.25, 0.5])
def test_point_lamp_with_a_flat_spectrum_has_absolute_power(scene, tmp_path, reflectance):
    watts, distance_m = 100.0, 2.0
    light(scene, "POINT", watts, shadow_soft_size=0.0).data.lensfield.emission = FLAT
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (reflectance,) * 3)[0], distance_m)
    expected = watts * FLAT_DENSITY / (4 * np.pi * distance_m**2) * reflectance / np.pi
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), expected, rtol=PRECISION)


def test_lamp_spectrum_replaces_its_colour(scene, tmp_path):
    lamp = light(scene, "POINT", 100.0, color=(0.1, 0.2, 1.0), shadow_soft_size=0.0).data
    lamp.lensfield.emission = "illuminant-a"
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0])
    red_to_blue = patch("illuminant-a")[2] / patch("illuminant-a")[0]
    measured = radiance_on_axis(scene, tmp_path)
    assert measured[2] / measured[0] == pytest.approx(red_to_blue, rel=ROUNDING)


def test_coloured_lamp_is_upsampled(scene, tmp_path):
    light(scene, "POINT", 4 * np.pi**2, color=(1.0, 0.5, 0.25), shadow_soft_size=0.0)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0])
    expected = white_density(NM) * (reflectance_basis(NM) @ (1.0, 0.5, 0.25))
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), expected, rtol=PRECISION)


def test_lamp_temperature_follows_planck(scene, tmp_path):
    if "use_temperature" not in bpy.types.Light.bl_rna.properties:
        pytest.skip("this Blender's lamps have no temperature")
    light(scene, "POINT", 100.0, use_temperature=True, temperature=2856.0, shadow_soft_size=0.0)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0])
    measured = radiance_on_axis(scene, tmp_path)
    assert measured[2] / measured[0] == pytest.approx(patch("illuminant-a")[2] / patch("illuminant-a")[0], rel=0.01)


def test_world_colour_computed_by_nodes_is_upsampled_as_light(scene, tmp_path):
    set_world(scene)
    tree = scene.world.node_tree
    colour = tree.nodes.new("ShaderNodeRGB")
    colour.outputs[0].default_value = (0.2, 0.6, 0.4, 1)
    tree.links.new(colour.outputs[0], background(scene).inputs["Color"])
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), emission_basis(NM) @ (0.2, 0.6, 0.4), rtol=ROUNDING)


def test_animated_lamp_is_evaluated_at_the_frame(scene, tmp_path):
    lamp = light(scene, "POINT", 10.0, shadow_soft_size=0.0).data
    lamp.lensfield.emission = FLAT
    lamp.keyframe_insert("energy", frame=1)
    lamp.energy = 1000.0
    lamp.keyframe_insert("energy", frame=5)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0])
    scene.frame_set(1)
    scene.frame_current = 5  # as scripts do: nothing is evaluated yet
    expected = 1000 * FLAT_DENSITY / (4 * np.pi**2)
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), expected, rtol=PRECISION)


def test_animation_is_evaluated_in_a_scene_not_in_the_window(scene, tmp_path):
    set_world(scene)
    scene.world.lensfield.emission = FLAT
    strength = background(scene).inputs["Strength"]
    for frame, value in ((1, 1.0), (5, 5.0)):
        strength.default_value = value
        strength.keyframe_insert("default_value", frame=frame)
    other = scene.copy()
    scene.frame_set(1)
    cube = read_exr(render(other, tmp_path, WAVELENGTHS_NM, frame=5).radiance).cube
    np.testing.assert_allclose(cube, 5 * FLAT_DENSITY, rtol=ROUNDING)
    assert bpy.context.window is None or bpy.context.window.scene == scene


def test_assigned_spectrum_applies_inside_groups(scene, tmp_path):
    set_world(scene)
    scene.world.lensfield.emission = FLAT
    for name, reflectance in (("Plain", ""), ("Measured", "380:0.1, 780:0.1")):  # the same group, two materials
        grouped = in_group(material(name, "ShaderNodeBsdfDiffuse")[0], (0.8, 0.8, 0.8))
        grouped.lensfield.reflectance = reflectance
        wall(scene, grouped, 1.0 if reflectance else 2.0)
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), 0.1 * FLAT_DENSITY, rtol=ROUNDING)


def in_group(painted, colour):
    """The material with its shader in a node group that all materials share."""
    group = bpy.data.node_groups.get("Paint group")
    if group is None:
        group = bpy.data.node_groups.new("Paint group", "ShaderNodeTree")
        group.interface.new_socket(name="Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
        shader = group.nodes.new("ShaderNodeBsdfDiffuse")
        shader.inputs["Color"].default_value = (*colour, 1)
        group.links.new(shader.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    node = painted.node_tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    output = next(n for n in painted.node_tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial")
    painted.node_tree.links.new(node.outputs[0], output.inputs["Surface"])
    return painted


def test_muted_link_is_not_followed(scene, tmp_path):
    set_world(scene)
    scene.world.lensfield.emission = FLAT
    painted, link = paint_by_nodes("Paint", (0.1, 0.1, 0.1), socket_colour=(0.5, 0.5, 0.5))
    link.is_muted = True
    wall(scene, painted)
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), 0.5 * FLAT_DENSITY, rtol=ROUNDING)


@pytest.mark.parametrize("node_type", ["ShaderNodeRGB", "NodeReroute"])
def test_a_source_without_a_value_leaves_the_socket_colour(scene, tmp_path, node_type):
    set_world(scene)
    scene.world.lensfield.emission = FLAT
    painted, shader = material("Paint", "ShaderNodeBsdfDiffuse", (0.5, 0.5, 0.5))
    source = painted.node_tree.nodes.new(node_type)
    source.mute = node_type == "ShaderNodeRGB"
    painted.node_tree.links.new(source.outputs[0], shader.inputs["Color"])
    wall(scene, painted)
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), 0.5 * FLAT_DENSITY, rtol=ROUNDING)


def test_lamp_with_disabled_nodes_uses_its_colour(scene, tmp_path):
    lamp = light(scene, "POINT", 100.0, shadow_soft_size=0.0).data
    lamp.lensfield.emission = FLAT
    lamp.use_nodes = True
    next(n for n in lamp.node_tree.nodes if n.bl_idname == "ShaderNodeEmission").inputs["Strength"].default_value = 7
    lamp.use_nodes = False
    if lamp.use_nodes:
        pytest.skip("this Blender's lamps always use their nodes")
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0])
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), 100 * FLAT_DENSITY / (4 * np.pi**2), rtol=PRECISION)


@pytest.mark.skipif(bpy.app.version >= (5, 0, 0), reason="since 5.0 materials and worlds always use their nodes")
def test_material_and_world_without_nodes_are_upsampled(scene, tmp_path):
    painted = material("Paint", "ShaderNodeBsdfDiffuse", (0, 0, 0))[0]
    painted.use_nodes = False
    painted.diffuse_color = (0.7, 0.3, 0.05, 1)
    scene.world.use_nodes = False
    scene.world.color = (0.2, 0.6, 0.4)
    wall(scene, painted)
    expected = (reflectance_basis(NM) @ (0.7, 0.3, 0.05)) * (emission_basis(NM) @ (0.2, 0.6, 0.4))
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), expected, rtol=ROUNDING)


def test_blocks_without_use_nodes_get_their_shader(scene):
    """As of Blender 6.0, which removes the property."""
    block = SimpleNamespace(node_tree=material("Paint", "ShaderNodeBsdfDiffuse", (0, 0, 0))[0].node_tree)
    single_shader(block, "ShaderNodeEmission", "ShaderNodeOutputMaterial", (0.7, 0.3, 0.05, 1))
    shader, output = block.node_tree.nodes
    assert shader.inputs["Color"].default_value[:3] == pytest.approx((0.7, 0.3, 0.05))
    assert output.inputs["Surface"].links[0].from_node == shader


def test_lamp_temperature_keeps_the_lamps_nodes(scene, tmp_path):
    if "use_temperature" not in bpy.types.Light.bl_rna.properties:
        pytest.skip("this Blender's lamps have no temperature")
    lamp = light(scene, "POINT", 100.0, use_temperature=True, temperature=2856.0, shadow_soft_size=0.0).data
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0])
    open_lamp = radiance_on_axis(scene, tmp_path)
    lamp.use_nodes = True
    gobo = lamp.node_tree.nodes.new("ShaderNodeRGB")
    gobo.outputs[0].default_value = (0.1, 0.1, 0.1, 1)
    emission = next(n for n in lamp.node_tree.nodes if n.bl_idname == "ShaderNodeEmission")
    lamp.node_tree.links.new(gobo.outputs[0], emission.inputs["Color"])
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path), 0.1 * open_lamp, rtol=ROUNDING)


def test_world_override_of_the_view_layer_is_substituted(scene, tmp_path):
    set_world(scene)
    other = bpy.data.worlds.new("Override")
    other.use_nodes = True
    other.lensfield.emission = FLAT
    scene.view_layers[0].world_override = other
    measured = radiance_on_axis(scene, tmp_path)
    np.testing.assert_allclose(measured / measured[0], 1, rtol=ROUNDING)


def test_complex_indices_vary_with_wavelength_and_not_with_the_pass(scene, tmp_path):
    """Wavelengths at or beyond a channel's own must look the same in R, G and B."""
    set_world(scene)
    scene.world.lensfield.emission = FLAT
    conductor, shader = metal("Metal")
    shader.inputs["IOR"].default_value = (0.2, 0.9, 1.3)
    shader.inputs["Extinction"].default_value = (3.9, 2.4, 1.9)
    wall(scene, conductor)
    n, k = np.array([1.3, 0.9, 0.2]), np.array([1.9, 2.4, 3.9])
    normal_incidence = ((n - 1)**2 + k**2) / ((n + 1)**2 + k**2)
    in_passes = radiance_on_axis(scene, tmp_path, [450.0, 549.1, 650.0, 700.0])
    np.testing.assert_allclose(in_passes, normal_incidence[[0, 1, 2, 2]] * FLAT_DENSITY, rtol=PRECISION)
    for band_nm, expected in (([420.0, 435.0, 450.0], in_passes[0]), ([650.0, 675.0, 700.0], in_passes[2])):
        np.testing.assert_allclose(radiance_on_axis(scene, tmp_path, band_nm), expected, rtol=ROUNDING)


def metal(name):
    """A mirror of a physical conductor."""
    new = bpy.data.materials.new(name)
    new.use_nodes = True
    new.node_tree.nodes.clear()
    shader = new.node_tree.nodes.new("ShaderNodeBsdfMetallic")
    shader.fresnel_type = "PHYSICAL_CONDUCTOR"
    shader.inputs["Roughness"].default_value = 0
    output = new.node_tree.nodes.new("ShaderNodeOutputMaterial")
    new.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return new, shader


def test_every_pass_updates_all_spectra(scene, tmp_path):
    """World, material, lamp and upsampled nodes must all follow when only scene properties change between passes."""
    set_world(scene, (0.3, 0.5, 0.7))
    light(scene, "POINT", 20.0, color=(1, 0.5, 0.2), shadow_soft_size=0.0)
    wall(scene, paint_by_nodes("Paint", (0.7, 0.3, 0.05))[0])
    nm = np.linspace(400, 700, 9)
    lamp = 20.0 / (4 * np.pi**2) * white_density(nm) * (reflectance_basis(nm) @ (1, 0.5, 0.2))
    world = emission_basis(nm) @ (0.3, 0.5, 0.7)
    expected = (lamp + world) * (reflectance_basis(nm) @ (0.7, 0.3, 0.05))
    np.testing.assert_allclose(radiance_on_axis(scene, tmp_path, nm), expected, rtol=PRECISION)


def test_bad_spectrum_names_material_and_value(scene, tmp_path):
    painted, _ = material("Paint", "ShaderNodeBsdfDiffuse")
    painted.lensfield.reflectance = "no-such-paint"
    wall(scene, painted)
    with refused(SceneError, field="reflectance spectrum", value="no-such-paint", where="material 'Paint'"):
        radiance_on_axis(scene, tmp_path)
