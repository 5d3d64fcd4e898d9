"""Working spaces other than Rec. 709: the same colours, with different values, give the same light."""

import bpy
import numpy as np
import pytest

from cycles_pictures import picture
from lenses import make_lens
from lensfield import addon
from lensfield.addon.scene.camera import capture_grid, set_up_capture
from lensfield.addon.scene.undo import Journal
from lensfield.addon.scene.working_space import colour_basis, rec709_from_working
from lensfield.addon.shading.lint import lint
from lensfield.addon.shading.node_rules import APPROXIMATED, REJECTED
from lensfield.engine.pictures.preview import to_rec709
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.spectra import reflectance_basis
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from small_scenes import light, material, paint_by_nodes, set_world, wall

LENS = make_lens(wavelengths_nm=(380.0, 780.0), sensor_mm=(3.6, 3.6))
NM = np.linspace(400, 700, 16)
SPACES = ["Linear Rec.2020", "ACEScg"]
ROUNDING = 1e-5
HALF = 2**-11  # Cycles converts pictures to another space in half precision
REC2020_TO_REC709 = np.array([[1.660491, -0.587641, -0.072850], [-0.124550, 1.132900, -0.008349],
                              [-0.018151, -0.100579, 1.118730]])  # ITU-R BT.2407

pytestmark = pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="this Blender has one working space")


@pytest.fixture(params=SPACES)
def space(request):
    """Converts the file to a working space, including its colours; and back at the end."""
    def go():
        bpy.ops.wm.set_working_color_space(working_space=request.param)
        assert bpy.data.colorspace.working_space == request.param

    yield go
    bpy.ops.wm.set_working_color_space(working_space="Linear Rec.709")


@pytest.fixture
def room(scene, tmp_path):
    """Colours of every kind: world, lamp, constant, from nodes, from an image, and emission."""
    set_world(scene, (0.3, 0.4, 0.6))
    lamp = light(scene, "POINT", 20.0, color=(1, 0.6, 0.2), shadow_soft_size=0.0).data
    lamp.lensfield.power_unit = "LUMEN"
    image = bpy.data.images.new("Picture", 4, 4)
    image.pixels = [0.8, 0.4, 0.2, 1] * 16
    image.filepath_raw, image.file_format = str(tmp_path / "picture.png"), "PNG"
    image.save()  # Blender refuses another space while images are not saved
    textured, link = paint_by_nodes("Textured", (0, 0, 0))
    texture = textured.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    textured.node_tree.links.new(texture.outputs["Color"], link.to_socket)
    for column, of_material in enumerate((material("Constant", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.1))[0],
                                          paint_by_nodes("Nodes", (0.1, 0.5, 0.3))[0], textured,
                                          material("Glow", "ShaderNodeEmission", (0.5, 0.3, 0.1))[0])):
        wall(scene, of_material, 1.0, 0.08).location.x = 0.08 * (column - 1.5)
    scene.render.resolution_x = scene.render.resolution_y = 12
    return scene


def radiance(scene, folder, **options):
    options = {"spectral": SpectralOptions("reference"), "depth": "off"} | options
    result = addon.render_through_lens(scene, lens=LENS, wavelengths_nm=NM, output_folder=folder, **options)
    return read_exr(result.radiance).frame()


def test_colours_give_the_same_light_in_any_space(room, tmp_path, space):
    known = radiance(room, tmp_path).cube
    space()
    rounded = HALF * np.abs(rec709_from_working()).sum(axis=1).max()
    np.testing.assert_allclose(radiance(room, tmp_path).cube, known, rtol=20 * ROUNDING, atol=rounded * known.mean())


def test_colours_that_cycles_renders_in_rgb_are_preserved(scene, tmp_path, space):
    set_world(scene)
    film = bpy.data.materials.new("Film")
    film.use_nodes = True
    for name, value in {"Base Color": (0, 0, 0, 1), "Roughness": 0.0, "IOR": 3.0, "Thin Film IOR": 1.8,
                        "Thin Film Thickness": 200.0}.items():
        film.node_tree.nodes["Principled BSDF"].inputs[name].default_value = value
    wall(scene, film)
    scene.render.resolution_x = scene.render.resolution_y = 8
    frame = capture_grid(scene, LENS, NM).frame()  # colours depend on the angle
    set_up_capture(scene.camera.data, LENS, frame, Journal())
    space()
    ours = to_rec709(radiance(scene, tmp_path, unfit="render")).mean(axis=(0, 1))
    cycles = rec709_from_working() @ picture(scene, tmp_path).mean(axis=(1, 2))
    np.testing.assert_allclose(ours, cycles, rtol=0.03)  # upsampling preserves colours in any space


def test_a_scene_in_another_space_is_not_rejected(room, space):
    space()
    findings = [finding for finding in lint(room) if finding.socket == "working colour space"]
    assert [finding.verdict for finding in findings] == [APPROXIMATED]
    assert not any(finding.verdict == REJECTED for finding in lint(room))


def test_rec2020_is_converted_to_rec709_by_its_standard(scene):
    np.testing.assert_array_equal(rec709_from_working(), np.eye(3))
    bpy.ops.wm.set_working_color_space(working_space="Linear Rec.2020")
    try:
        np.testing.assert_allclose(rec709_from_working(), REC2020_TO_REC709, atol=5e-6)
        np.testing.assert_allclose(colour_basis(NM) @ np.ones(3), reflectance_basis(NM) @ np.ones(3), rtol=1e-12)
    finally:
        bpy.ops.wm.set_working_color_space(working_space="Linear Rec.709")


def test_colours_outside_rec709_are_clipped_at_zero(scene, tmp_path, space):
    """Green of a wide space has negative red, which is clipped to zero, for constants and for colours from nodes alike.
    """
    space()
    nodes = bpy.data.materials.new("Nodes")
    nodes.use_nodes = True
    tree = nodes.node_tree
    tree.nodes.clear()
    source, emission = tree.nodes.new("ShaderNodeMixRGB"), tree.nodes.new("ShaderNodeEmission")
    source.inputs["Fac"].default_value, source.inputs["Color1"].default_value = 0.0, (0, 1, 0, 1)
    tree.links.new(source.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    wall(scene, nodes)
    set_world(scene)
    by_nodes = radiance(scene, tmp_path).cube
    wall(scene, material("Constant", "ShaderNodeEmission", (0, 1, 0))[0], 0.5)
    constant = radiance(scene, tmp_path).cube
    np.testing.assert_allclose(by_nodes, constant, rtol=10 * ROUNDING, atol=ROUNDING * constant.mean())
    assert (colour_basis(NM)[:, 1] < 0).any() and constant.min() == 0 < constant.max()
