"""Texture Coordinate > Window spans the picture's frame, as in a plain render, whatever overscan a capture has."""

import bpy
import numpy as np
import pytest

from lenses import gaussian_psf, make_lens, tinted
from lensfield import addon
from lensfield.addon.render.preflight import preflight
from lensfield.addon.scene.render_state import effective_samples
from lensfield.engine import load_lens
from lensfield.engine.pictures.spectral_exr import read_exr
from small_scenes import background, material, set_world, wall

NM = (550.0, 562.0)
ROWS, COLUMNS = 42, 64
PIXEL = 0.5  # uncertainty of a sample's place in its pixel, with one sample
LENSES = {"panorama": lambda: tinted(load_lens("edmund-54852")),
          "plane": lambda: tinted(make_lens(gaussian_psf(9, 14, 2.5, 41), efl_mm=9.0))}


def shine_by_window(tree, socket, axis, group=False):
    """Feed a strength with a Window coordinate plus 1, in the tree or from a node group within it."""
    inside = bpy.data.node_groups.new("Window", "ShaderNodeTree") if group else tree
    coordinates, separate, add = (inside.nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "SeparateXYZ", "Math"))
    add.inputs[1].default_value = 1
    inside.links.new(coordinates.outputs["Window"], separate.inputs[0])
    inside.links.new(separate.outputs[axis], add.inputs[0])
    output = add.outputs[0]
    if group:
        inside.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketFloat")
        inside.links.new(output, inside.nodes.new("NodeGroupOutput").inputs[0])
        user = tree.nodes.new("ShaderNodeGroup")
        user.node_tree = inside
        output = user.outputs[0]
    tree.links.new(output, socket)


def radiance(scene, folder, lens, **options):
    result = addon.render_through_lens(scene, lens=lens, wavelengths_nm=NM, output_folder=folder, **options)
    return read_exr(result.radiance).frame().cube[0].astype(float)


def check(scene, folder, shine, lens, **options):
    """Compare with the frame's coordinates: the ratio to an even light is 1 more than these."""
    even = radiance(scene, folder / "even", lens, **options)
    samples = effective_samples(scene)
    for axis, n, coordinate in ((0, COLUMNS, (np.arange(COLUMNS) + 0.5)[None] / COLUMNS),
                                (1, ROWS, (ROWS - 0.5 - np.arange(ROWS))[:, None] / ROWS)):
        shine(axis)
        ratio = radiance(scene, folder / f"axis {axis}", lens, **options) / even
        np.testing.assert_allclose(ratio - 1, np.broadcast_to(coordinate, ratio.shape), atol=1.2 * PIXEL / n)
        assert abs((ratio - 1 - coordinate).mean()) < 5 / np.sqrt(12 * samples * ratio.size) / n


@pytest.fixture
def small_frame(scene):
    scene.render.resolution_x, scene.render.resolution_y = COLUMNS, ROWS
    scene.unit_settings.scale_length = 0.01
    scene.camera.data.shift_x, scene.camera.data.shift_y = 0.1, -0.05
    scene.camera.rotation_euler = 0.3, -0.2, 0.1
    return scene


@pytest.mark.parametrize("lens, group", [("panorama", False), ("plane", True)])
def test_a_backdrop_by_the_world_fills_the_frame(small_frame, tmp_path, lens, group):
    set_world(small_frame)
    strength = background(small_frame).inputs["Strength"]
    check(small_frame, tmp_path, lambda axis: shine_by_window(small_frame.world.node_tree, strength, axis, group),
          LENSES[lens](), depth="off")


@pytest.mark.parametrize("depth", ["off", "auto"])
def test_a_material_in_window_coordinates_fills_the_frame(small_frame, tmp_path, depth):
    """Also in slabs, whose capture is larger."""
    glow, shader = material("Glow", "ShaderNodeEmission", (1, 1, 1))
    shader.inputs["Strength"].default_value = 1
    near, far = (wall(small_frame, glow, metres * 100, 3000) for metres in (0.1, 3))
    for part in (near, far):
        part.matrix_world = small_frame.camera.matrix_basis @ part.matrix_basis
    near.location.x += 1503  # the edge of the near one is in view
    small_frame.cycles.samples = 16
    check(small_frame, tmp_path, lambda axis: shine_by_window(glow.node_tree, shader.inputs["Strength"], axis),
          load_lens("edmund-54852"), depth=depth)


@pytest.mark.every_blender
def test_a_traced_lens_has_no_window_coordinates(small_frame, tmp_path):
    shine_by_window(small_frame.world.node_tree, background(small_frame).inputs["Strength"], 0, group=True)
    for depth, expected in (("traced", ["of 'World'"]), ("auto", [])):
        remarks = preflight(small_frame, output_folder=tmp_path, lens="edmund-54852", depth=depth).remarks
        assert [remark.value for remark in remarks if remark.what == "Window Coordinates"] == expected
