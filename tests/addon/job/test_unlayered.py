"""Limits of one depth per pixel: glass, mirrors and volumes, detected by rays before a render."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from mathutils import Euler, Vector

from lensfield.addon import preflight, render_through_lens
from lensfield.addon.capture.unlayered import MIRRORED, REFRACTED, VOLUME, unlayered
from lensfield.addon.scene import depth
from lensfield.addon.scene.camera import capture_grid
from lensfield.addon.scene.depth import View
from lensfield.addon.shading.lobes import STRAIGHT, glows_within, lobes_of
from lensfield.engine import load_lens
from small_scenes import material, wall

FAST = load_lens("edmund-54852").scaled(10)  # f/1.8, 60 mm
PANE_SHARE = 0.25


@pytest.fixture(autouse=True)
def fine_pixels(scene):
    scene.render.resolution_x, scene.render.resolution_y = 960, 720


def shader(node_type, roughness=0.0):
    surface, node = material(node_type, node_type)
    if "Roughness" in node.inputs:
        node.inputs["Roughness"].default_value = roughness
    return surface


def look(scene, lens=FAST):
    bpy.context.view_layer.update()
    grid = capture_grid(scene, lens, [550.0])
    return unlayered(scene, lens, grid), grid


def shares(scene, lens=FAST):
    return {kind: content.share for kind, content in look(scene, lens)[0].items()}


def room(scene, of_material, distance_m=2.0):
    """A square that covers a quarter of the picture, a wall far behind it, and one behind the camera."""
    grid = capture_grid(scene, FAST, [550.0])
    rows_mm, columns_mm = (n * grid.pitch_um * 1e-3 for n in grid.frame().shape_px)
    side_m = distance_m * np.sqrt(PANE_SHARE * rows_mm * columns_mm) / FAST.capture_focal_length_mm
    pane = wall(scene, of_material, distance_m, side_m)
    pane.name = "Pane"
    grey = shader("ShaderNodeBsdfDiffuse")
    wall(scene, grey, 12.0, 100.0).name = "Far"
    wall(scene, grey, -5.0, 100.0).name = "Behind"
    return pane


@pytest.mark.every_blender
@pytest.mark.parametrize("node_type, roughness, kind", [
    ("ShaderNodeBsdfGlass", 0.0, REFRACTED), ("ShaderNodeBsdfRefraction", 0.0, REFRACTED),
    ("ShaderNodeBsdfGlossy", 0.0, MIRRORED), ("ShaderNodeBsdfMetallic", 0.0, MIRRORED),
    ("ShaderNodeBsdfGlass", 0.6, None), ("ShaderNodeBsdfGlossy", 0.3, None),  # too rough to focus through
    ("ShaderNodeBsdfDiffuse", 0.0, None), ("ShaderNodeBsdfTransparent", 0.0, None)])
def test_glass_and_mirrors_are_detected_with_their_share(scene, node_type, roughness, kind):
    if node_type == "ShaderNodeBsdfMetallic":
        pane_material = bpy.data.materials.new("Metal")
        pane_material.use_nodes = True
        principled = next(n for n in pane_material.node_tree.nodes if n.bl_idname == "ShaderNodeBsdfPrincipled")
        principled.inputs["Metallic"].default_value, principled.inputs["Roughness"].default_value = 1.0, roughness
    else:
        pane_material = shader(node_type, roughness)
    room(scene, pane_material)
    by_kind, _ = look(scene)
    assert by_kind.keys() == ({kind} if kind else set())
    if kind:
        assert by_kind[kind].share == pytest.approx(PANE_SHARE, abs=0.08)  # a row of rays around its rim
        assert by_kind[kind].names == ("Pane",)


def test_glass_in_focus_with_its_surroundings_is_not_reported(scene):
    room(scene, shader("ShaderNodeBsdfGlass"))
    assert shares(scene) and not shares(scene, FAST.scaled(0.03))  # a small lens has all of them in focus


def test_a_pane_invisible_to_the_camera_is_ignored(scene):
    room(scene, shader("ShaderNodeBsdfGlass")).visible_camera = False
    assert not shares(scene)


def test_objects_close_behind_glass_are_not_reported(scene):
    room(scene, shader("ShaderNodeBsdfGlass"))
    wall(scene, shader("ShaderNodeBsdfDiffuse"), 2.001, 100.0)
    assert not shares(scene)


@pytest.mark.parametrize("node_type", ["ShaderNodeBsdfGlossy", "ShaderNodeBsdfGlass"])
def test_images_in_a_small_ball_are_close_to_the_ball(scene, node_type):
    """By the optics of curved mirrors and lenses: R / 2 behind and about R in front of its surface."""
    room(scene, shader("ShaderNodeBsdfDiffuse"), distance_m=20.0)
    for radius_m, reported in ((0.004, False), (4.0, True)):
        bpy.ops.mesh.primitive_uv_sphere_add(radius=radius_m, location=(0, 0, -0.5 - radius_m), segments=64,
                                             ring_count=32)
        ball = bpy.context.object
        ball.data.materials.append(shader(node_type))
        bpy.ops.object.shade_smooth()
        scene.camera.data.lens = 50
        assert bool(shares(scene)) == reported
        bpy.data.objects.remove(ball)


def test_visible_fog_is_detected_with_its_share(scene):
    room(scene, shader("ShaderNodeBsdfDiffuse"))
    fog, node = material("Fog", "ShaderNodeVolumeScatter")
    output = fog.node_tree.get_output_node("CYCLES")
    fog.node_tree.links.remove(output.inputs["Surface"].links[0])
    fog.node_tree.links.new(node.outputs[0], output.inputs["Volume"])
    bpy.ops.mesh.primitive_cube_add(size=2, location=(0, 0, -8), scale=(20, 20, 1))
    box = bpy.context.object
    box.data.materials.append(fog)
    by_kind, _ = look(scene)
    assert by_kind.keys() == {VOLUME} and by_kind[VOLUME].names == ("Cube",)
    assert by_kind[VOLUME].share == pytest.approx(1 - PANE_SHARE, abs=0.08), "not before the square, which hides it"
    node.inputs["Density"].default_value = 0
    assert not shares(scene)
    node.inputs["Density"].default_value = 1
    box.location.z = 8
    assert not shares(scene), "behind the camera"


def test_fog_of_the_world_fills_the_picture(scene):
    tree = scene.world.node_tree
    node = tree.nodes.new("ShaderNodeVolumeScatter")
    tree.links.new(node.outputs[0], tree.get_output_node("CYCLES").inputs["Volume"])
    assert shares(scene) == {VOLUME: 1.0}
    absorbs = tree.nodes.new("ShaderNodeVolumeAbsorption")
    tree.links.new(absorbs.outputs[0], tree.get_output_node("CYCLES").inputs["Volume"])
    assert not glows_within(scene.world) and not shares(scene)


def test_mixes_are_evaluated_for_constant_factors_and_camera_rays():
    mixed, glass = material("Mixed", "ShaderNodeBsdfGlass")
    tree, output = mixed.node_tree, mixed.node_tree.get_output_node("CYCLES")
    mix, clear = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfTransparent")
    for shader_node, socket in ((glass, mix.inputs[1]), (clear, mix.inputs[2])):
        tree.links.new(shader_node.outputs[0], socket)
    tree.links.new(mix.outputs[0], output.inputs["Surface"])

    def by_way():
        return {lobe.way: lobe.share for lobe in lobes_of(mixed)}

    mix.inputs[0].default_value = 0.25
    assert by_way() == pytest.approx({REFRACTED: 0.75, STRAIGHT: 0.25})
    path = tree.nodes.new("ShaderNodeLightPath")
    tree.links.new(path.outputs["Is Shadow Ray"], mix.inputs[0])
    assert by_way() == {REFRACTED: 1.0}
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    assert by_way() == {STRAIGHT: 1.0}


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_mirror_shows_objects_in_front_of_it(scene, turn):
    """Seen at an angle, objects to the side of the camera."""
    pane = room(scene, shader("ShaderNodeBsdfGlossy"))
    pane.rotation_euler = Euler((0, turn, 0))
    behind = scene.objects["Behind"]
    bpy.context.view_layer.update()
    assert shares(scene).keys() == {MIRRORED}
    place = pane.matrix_world @ Vector((0, 0, 0.02))
    behind.location, behind.rotation_euler = place, pane.rotation_euler
    behind.visible_camera = False  # it is in front of the mirror, and only visible in it
    assert not shares(scene)


@pytest.mark.parametrize("has_rays", [True, False])
def test_remarks_name_the_share_the_objects_and_the_remedy(scene, tmp_path, has_rays):
    room(scene, shader("ShaderNodeBsdfGlass"))
    lens = FAST if has_rays else replace(FAST, prescription=None)
    line, = (str(each) for each in preflight(scene, output_folder=tmp_path, lens=lens).remarks if each.what == "Glass")
    assert line.startswith("Glass 'Pane': about 2") and "Ray Visibility" in line
    assert ("Traced Lens" in line) == has_rays


@pytest.mark.sample(1)
@pytest.mark.parametrize("requested_depth, count", [("auto", 1), ("off", 0), ("traced", 0)])
def test_glass_is_reported_before_a_render_with_one_depth_per_pixel(scene, tmp_path, requested_depth, count):
    room(scene, shader("ShaderNodeBsdfGlass"))
    scene.camera.data.lensfield.lens = "sonnar-50mm-f1.5"
    scene.lensfield.depth = requested_depth.upper()
    for options in ({}, {"depth": requested_depth}):
        result = preflight(scene, output_folder=tmp_path, lens_quality="preview", **options)
        assert sum(remark.what == "Glass" for remark in result.remarks) == count
        scene.lensfield.depth = "AUTO"


def test_a_pane_in_focus_hides_objects_out_of_focus(scene, tmp_path):
    """Every recorded depth is in focus then, and nothing is rendered in layers."""
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 2.0, 1.5
    wall(scene, shader("ShaderNodeBsdfGlass"), 2.0, 100.0).name = "Pane"
    wall(scene, shader("ShaderNodeBsdfDiffuse"), 12.0, 100.0)
    scene.camera.data.lensfield.lens = "sonnar-50mm-f1.5"
    result = preflight(scene, output_folder=tmp_path, lens_quality="preview")
    line, = (str(remark) for remark in result.remarks if remark.what == "Glass")
    assert line.startswith("Glass 'Pane': about 100% of the picture is visible through it") and result.slabs is None


def test_the_report_repeats_the_remarks(scene, tmp_path):
    scene.render.resolution_x, scene.render.resolution_y = 48, 36
    scene.cycles.samples = 1
    room(scene, shader("ShaderNodeBsdfGlass"))
    result = render_through_lens(scene, lens=FAST.scaled(10), wavelengths_nm=[550.0], output_folder=tmp_path,
                                 view="lens")
    assert [remark for remark in result.report.remarks() if remark.startswith("Glass 'Pane': about")]


def test_content_counts_if_one_lens_of_the_capture_blurs_it(scene):
    room(scene, shader("ShaderNodeBsdfGlass"))
    bpy.context.view_layer.update()
    small = replace(FAST, f_number_effective=1e4)
    grid = capture_grid(scene, FAST, [550.0])
    alone, shared = unlayered(scene, small, grid), unlayered(scene, small, grid, [FAST])
    assert not alone and shared == unlayered(scene, FAST, grid)


def test_a_search_beyond_the_time_limit_ends_with_the_share_so_far(scene, monkeypatch):
    """For all rays so far, which are distributed over the picture in random order."""
    room(scene, shader("ShaderNodeBsdfGlass"))
    now_s = iter(np.arange(0.0, 1e3, 0.01))
    monkeypatch.setattr(depth.time, "monotonic", lambda: next(now_s))
    monkeypatch.setattr(depth, "LONGEST_S", 1.0)
    by_kind, _ = look(scene)
    assert by_kind[REFRACTED].share == pytest.approx(PANE_SHARE, abs=0.08) and next(now_s) < 1.1


def test_without_glass_mirrors_or_fog_no_ray_is_cast(scene, monkeypatch):
    room(scene, shader("ShaderNodeBsdfDiffuse"))
    monkeypatch.setattr(View, "first", None)
    assert not shares(scene)
