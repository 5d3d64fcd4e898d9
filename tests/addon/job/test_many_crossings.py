"""Light through many layers of saturated colour: spectra in Cycles against powers computed by hand."""

import bpy
import numpy as np
import pytest

from cycles_pictures import picture
from lenses import make_lens
from lensfield import addon, cli
from lensfield.addon import preflight
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz
from lensfield.engine.spectral.spectra import colour_matching, reflectance_basis, white_density
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from small_scenes import material, set_world, wall

NM = np.linspace(400, 700, 21)
GREEN = np.array((0.05, 0.6, 0.1))
PANES = 7
WIDE, HIGH = 48, 16  # px
SINGLE = 1e-4  # rounding to single precision in Cycles and in the sums
DENSITY, THICKNESS_M = 2.5, 0.4
FACING = 0.02  # share of the path through the slab, added towards the picture's corners


@pytest.fixture
def panes(scene):
    """A white sky behind 0 to PANES layers of green glass that do not refract, more of them to the right."""
    set_world(scene)
    glass, shader = material("Green Glass", "ShaderNodeBsdfRefraction", GREEN)
    shader.inputs["IOR"].default_value, shader.inputs["Roughness"].default_value = 1.0, 0.0
    for index in range(PANES):
        pane = wall(scene, glass, 0.5 + 0.02 * index)
        pane.name = f"Pane {index}"
    follow_all_paths(scene)
    return scene


def follow_all_paths(scene):
    """Keep Cycles from ending paths at random."""
    cycles = scene.cycles
    cycles.max_bounces = cycles.transmission_bounces = cycles.volume_bounces = PANES + 1
    cycles.min_light_bounces = cycles.min_transparent_bounces = PANES + 1
    scene.render.resolution_x, scene.render.resolution_y, cycles.samples = WIDE, HIGH, 4


def relative_radiance(scene, folder, tier, lens=None):
    """Radiance of the middle pixel relative to white of strength 1, at NM; and the report."""
    result = addon.render_through_lens(scene, lens=lens or make_lens(), wavelengths_nm=NM, output_folder=folder,
                                       spectral=SpectralOptions(tier), depth="off")
    frame = read_exr(result.radiance).frame().cube
    rows, columns = frame.shape[1:]
    return frame[:, rows // 2, columns // 2].astype(float) / white_density(NM), result.report


def colour_error(true, estimated):
    matching = white_density(NM)[:, None] * colour_matching(NM)
    white = matching.sum(axis=0)
    return float(ciede2000(lab_from_xyz(true @ matching, white), lab_from_xyz(estimated @ matching, white)))


@pytest.mark.parametrize("count", [2, PANES])
def test_panes_multiply_spectra_here_and_rgb_in_cycles(panes, tmp_path, count):
    for index, pane in enumerate(each for each in panes.collection.objects if each.name.startswith("Pane")):
        pane.hide_render = index >= count
    light, _ = relative_radiance(panes, tmp_path, "reference")
    np.testing.assert_allclose(light, (reflectance_basis(NM) @ GREEN)**count, rtol=SINGLE, atol=SINGLE * 0.01)
    for tier in ("preview", "standard"):
        estimated, report = relative_radiance(panes, tmp_path, tier)
        assert colour_error(light, estimated) <= 1.05 * report.scene.predicted_colour_error + 0.05
    middle = picture(panes, tmp_path, 4, WIDE, HIGH)[:, HIGH // 2, WIDE // 2]
    np.testing.assert_allclose(middle, GREEN**count, rtol=1e-3, atol=1e-6)


def test_saturated_glass_is_reported_before_and_after_the_render(panes, tmp_path, capsys):
    expected = "Saturated Colours 'Pane 0' (and 6 more) of 'Green Glass': up to CIEDE2000 "
    remarks = preflight(panes, output_folder=tmp_path).remarks
    remark, = (str(each) for each in remarks if each.what == "Saturated Colours")
    assert remark.startswith(expected) and "an RGB render after" in remark
    _, report = relative_radiance(panes, tmp_path, "standard")
    assert remark in report.remarks()
    assert report.scene.rgb_difference == pytest.approx(float(remark.split("CIEDE2000 ")[1].split()[0]), abs=0.05)
    blend = str(tmp_path / "panes.blend")
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    assert cli.main(["lint", blend, "--output", str(tmp_path / "out")]) == 0
    assert remark in capsys.readouterr().out


@pytest.mark.parametrize("colour", [(0.6, 0.6, 0.6), (0.97, 0.98, 0.97)])
def test_grey_and_nearly_clear_glass_is_not_reported(panes, tmp_path, colour):
    node = next(node for node in bpy.data.materials["Green Glass"].node_tree.nodes if "IOR" in node.inputs)
    node.inputs["Color"].default_value = (*colour, 1)
    assert not [each for each in preflight(panes, output_folder=tmp_path).remarks if each.what == "Saturated Colours"]
    assert relative_radiance(panes, tmp_path, "standard")[1].scene.rgb_difference < 1


@pytest.mark.every_blender
def test_a_red_volume_absorbs_exponentially_at_each_wavelength(scene, tmp_path):
    """Beer and Lambert: exp(-(1 - s) density thickness), where Cycles in RGB has exp(-(1 - c) density thickness)."""
    red = np.array((0.8, 0.05, 0.1))
    set_world(scene)
    fog = bpy.data.materials.new("Fog")
    fog.use_nodes = True
    fog.node_tree.nodes.clear()
    shader = fog.node_tree.nodes.new("ShaderNodeVolumeAbsorption")
    shader.inputs["Color"].default_value, shader.inputs["Density"].default_value = (*red, 1), DENSITY
    fog.node_tree.links.new(shader.outputs[0],
                            fog.node_tree.nodes.new("ShaderNodeOutputMaterial").inputs["Volume"])
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0.1, 0, -1))
    bpy.context.object.scale = 4, 4, THICKNESS_M
    bpy.context.object.data.materials.append(fog)
    follow_all_paths(scene)
    depth = DENSITY * THICKNESS_M
    light, report = relative_radiance(scene, tmp_path, "reference")
    np.testing.assert_allclose(light, np.exp(-(1 - reflectance_basis(NM) @ red) * depth), rtol=FACING)
    np.testing.assert_allclose(picture(scene, tmp_path, 4, WIDE, HIGH)[:, HIGH // 2, WIDE // 2],
                               np.exp(-(1 - red) * depth), rtol=FACING)
    assert any(line.startswith("Saturated Colours 'Cube' of 'Fog'") and "an optical depth of" in line
               for line in report.remarks())
