"""Depth of surfaces in fog and smoke."""

import bpy
import numpy as np
import pytest

from lensfield.engine.pictures.spectral_exr import read_parts, read_with_layers
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from small_scenes import light, material, render, set_world, wall
from snapshot import differences, snapshot

WALL_M, DENSITY = 2.5, 0.6


def in_world(scene):
    """Fog in the whole world."""
    tree = scene.world.node_tree
    link_volume(tree, tree.get_output_node("CYCLES"))


def in_box(scene):
    """A box of smoke, a material without a surface."""
    gas = bpy.data.materials.new("Smoke")
    gas.use_nodes = True
    gas.node_tree.nodes.clear()
    link_volume(gas.node_tree, gas.node_tree.nodes.new("ShaderNodeOutputMaterial"))
    box(scene, gas)


def in_clear_box(scene):
    """The same in a box with a transparent surface."""
    gas, _ = material("Clear", "ShaderNodeBsdfTransparent", (1, 1, 1))
    link_volume(gas.node_tree, gas.node_tree.get_output_node("CYCLES"))
    box(scene, gas)


def link_volume(tree, output):
    node = tree.nodes.new("ShaderNodeVolumeScatter")
    node.inputs["Density"].default_value = DENSITY
    tree.links.new(node.outputs[0], output.inputs["Volume"])


def box(scene, of_material):
    bpy.ops.mesh.primitive_cube_add(size=1.5, location=(0.1, 0.05, -1.3))
    bpy.context.object.data.materials.append(of_material)


@pytest.fixture
def foggy(scene, request):
    """A wall that fills an off-centre picture, behind fog, lit from the camera."""
    set_world(scene, strength=0.1)
    wall(scene, material("Wall", "ShaderNodeBsdfDiffuse")[0], WALL_M)
    light(scene, "POINT", 50.0).location = (0.3, 0.2, 0)
    scene.render.resolution_x, scene.render.resolution_y, scene.camera.data.shift_x = 32, 20, 0.1
    scene.unit_settings.scale_length = 0.5
    scene.render.image_settings.file_format = "PNG"
    request.param(scene)
    bpy.context.view_layer.update()
    return scene


@pytest.mark.parametrize("foggy", [in_world, in_box, in_clear_box], indirect=True)
@pytest.mark.parametrize("depth, tier", [("auto", "standard"), ("auto", "preview"), ("off", "standard")])
def test_the_depth_in_fog_is_that_of_the_wall_behind(foggy, tmp_path, depth, tier):
    before = snapshot()
    result = render(foggy, tmp_path, np.linspace(430, 670, 9), depth=depth, spectral=SpectralOptions(tier))
    assert not differences(before, snapshot())
    (_, depth), = read_parts(result.depth)
    np.testing.assert_allclose(depth["Y"], WALL_M * 0.5, rtol=1e-3)
    if depth == "auto" and result.report.scene.layers:
        _, _, layered = read_with_layers(result.radiance)
        assert all(np.isfinite(layer.depth_mm[layer.alpha == 1]).all() for layer in layered.layers if layer.alpha.any())
