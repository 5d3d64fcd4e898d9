"""Small lamps out of focus: discs of first-order size, wherever the look at depth misses them."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from lensfield import addon
from lensfield.addon.capture.emitters import emitters_of
from lensfield.addon.capture.ready import job_grid
from lensfield.addon.job.job import job_of
from lensfield.addon.shading.lobes import shines
from lensfield.engine.depth.depth_range import blur_px
from lensfield.engine.pictures.spectral_exr import read_exr, read_with_layers
from lensfield.engine.stray.options import StrayOptions
from small_scenes import light, material, set_world, wall

SHAPE_PX = 150, 225
FOCUS_MM, LAMP_M = 1000.0, 12.0
OPTIONS = {"lens": "sonnar-50mm-f1.5", "lens_quality": "preview", "focus": FOCUS_MM, "f_number": 2.0,
           "wavelengths_nm": (550.0,), "stray": StrayOptions("off")}
ACROSS, UP = 31.3, 17.8  # of the lamp, in pixels from the middle: off the middles of pixels


@pytest.fixture
def dark(scene, tmp_path):
    """A black world; the scene's "per_px" is the tangent of a pixel in the capture."""
    scene.render.resolution_y, scene.render.resolution_x = SHAPE_PX
    scene.cycles.samples = 256
    scene.camera.data.clip_start = 0.1
    job = job_of(scene, output_folder=tmp_path, **OPTIONS)
    scene["per_px"] = job_grid(scene, job).pitch_um * 1e-3 / job.lens.capture_focal_length_mm
    return scene


def place_m(scene, across_px=ACROSS, up_px=UP, distance_m=LAMP_M):
    unit_m = scene["per_px"] * distance_m
    return across_px * unit_m, up_px * unit_m, -distance_m


def glow(strength=1e4):
    glowing, shader = material("Glow", "ShaderNodeEmission", (1, 1, 1))
    shader.inputs["Strength"].default_value = strength
    return glowing


def lamp(scene, side_px, strength=1e4, distance_m=LAMP_M):
    square = wall(scene, glow(strength), distance_m, side_px * scene["per_px"] * distance_m)
    square.location = place_m(scene, distance_m=distance_m)
    return square


def rendered(scene, folder, **options):
    return addon.render_through_lens(scene, output_folder=folder, **OPTIONS | options)


def disc_px(result, side_px):
    """Diameter of a lamp's disc, by its second moment without the lamp's and a pixel's."""
    picture = read_exr(result.irradiance).cube[0].astype(float)
    rows, columns = np.indices(picture.shape)
    row, column = ((n - 1) / 2 + off for n, off in zip(SHAPE_PX, (-UP, ACROSS), strict=True))
    near = np.hypot(rows - row, columns - column) < 10
    part = picture[near]
    middle = [(part * at[near]).sum() / part.sum() for at in (rows, columns)]
    square = (part * sum((at[near] - mean) ** 2 for at, mean in zip((rows, columns), middle, strict=True))).sum()
    return np.sqrt(8 * square / part.sum() - 8 / 6 * (1 + side_px**2))


def first_order_px(scene, folder):
    job = job_of(scene, output_folder=folder, **OPTIONS)
    return -blur_px(job.lens, job_grid(scene, job).pitch_um, LAMP_M * 1e3)


def assert_disc(scene, result, folder, side_px):
    assert disc_px(result, side_px) == pytest.approx(first_order_px(scene, folder), rel=0.05)
    check, layers = result.report.scene.depth, read_with_layers(result.radiance)[2].layers
    assert check.nearest_mm == pytest.approx(LAMP_M * 1e3, rel=1e-4) and check.outside_light > 0.99
    depths_mm = np.concatenate([layer.depth_mm[layer.alpha > 0] for layer in layers])
    np.testing.assert_allclose(depths_mm[np.isfinite(depths_mm)], LAMP_M * 1e3, rtol=1e-4)
    return check


@pytest.mark.sample(3)
@pytest.mark.parametrize("side_px", [0.25, 1.0, 4.0])
@pytest.mark.parametrize("grey", [0.0, 0.002])
def test_a_lamp_is_a_disc_of_first_order_size(dark, tmp_path, side_px, grey):
    set_world(dark, (grey,) * 3)
    lamp(dark, side_px, 1e4 / side_px**2)
    check = assert_disc(dark, rendered(dark, tmp_path), tmp_path, side_px)
    assert check.farthest_mm == (np.inf if grey else pytest.approx(LAMP_M * 1e3, rel=1e-4))


def test_a_bright_spot_that_is_no_emitter_is_found_in_the_capture(dark, tmp_path):
    """The sun lights a small white square; the plan is then made again."""
    square = lamp(dark, 2.0)
    square.data.materials[0] = material("White", "ShaderNodeBsdfDiffuse")[0]
    light(dark, "SUN", 1e3)
    assert_disc(dark, rendered(dark, tmp_path), tmp_path, 2.0)


def test_a_dim_spot_out_of_focus_stays_in_one_render(dark, tmp_path):
    """Its light is within the accuracy."""
    wall(dark, material("White", "ShaderNodeBsdfDiffuse")[0], 1.1, 10.0).location = 0, 5.04, -1.1
    lamp(dark, 1.0).data.materials[0] = material("Grey", "ShaderNodeBsdfDiffuse", (0.1, 0.1, 0.1))[0]
    light(dark, "SUN", 1.0)
    assert read_with_layers(rendered(dark, tmp_path).radiance)[2] is None


def test_lamps_in_one_slab_keep_their_light(dark, tmp_path):
    """A holdout cuts through all depths, and forces one slab."""
    set_world(dark, (0.01,) * 3)
    for across, up, distance_m in ((-70, 30, 0.6), (-20, -35, 1.6), (10, 20, 3.0), (20, 24, 6.0), (60, -10, 30.0)):
        square = lamp(dark, 1.3, 3e3, distance_m)
        square.location = place_m(dark, across, up, distance_m)
    several = rendered(dark, tmp_path / "several")
    hole = wall(dark, glow(0.0), 1.0, 0.01)
    hole.location, hole.is_holdout = place_m(dark, 95, -65, 1.0), True
    one = rendered(dark, tmp_path / "one")
    assert "one slab" in one.report.scene.layers and "one slab" not in several.report.scene.layers
    pictures = [read_exr(result.irradiance).cube[0, :, :200].astype(float) for result in (several, one)]
    blocks = [picture.reshape(5, 30, 5, 40).sum(axis=(1, 3)) for picture in pictures]
    np.testing.assert_allclose(blocks[1], blocks[0], rtol=0.02, atol=0.005 * blocks[0].max())


def test_the_check_before_a_render_sees_small_lamps(dark, tmp_path):
    lamp(dark, 0.25)
    assert addon.preflight(dark, output_folder=tmp_path, **OPTIONS).slabs


def test_an_animation_states_that_only_some_frames_are_in_layers(dark, tmp_path):
    wall(dark, glow(1.0), 1.0, 0.1)
    bulb = lamp(dark, 1.0)
    for frame, hidden in ((1, False), (2, True)):
        bulb.hide_render = hidden
        bulb.keyframe_insert("hide_render", frame=frame)
    dark.cycles.samples = 4
    animation = addon.render_animation(dark, [1, 2], output_folder=tmp_path, **OPTIONS)
    assert [bool(result.report.scene.layers) for result in animation.results.values()] == [True, False]
    assert any("1 of 2 frames are in layers of depth, from frame 1 on" in line for line in animation.summary)


def sightings(scene, folder):
    """Rows, columns and depths of emitters in the capture of a scene, the capture's middle as origin."""
    job = job_of(scene, output_folder=folder, **OPTIONS)
    capture = replace(job_grid(scene, job), focal_mm=job.lens.capture_focal_length_mm)
    seen = emitters_of(scene, lambda block: None if shines(block) else np.zeros(1)).seen(capture)
    return seen.row - capture.centre_px[0], seen.column - capture.centre_px[1], seen.planar_mm


def assert_sighted(scene, folder, across_px=ACROSS, up_px=UP, distance_m=LAMP_M):
    row, column, depth_mm = sightings(scene, folder)
    assert np.any((np.abs(row + up_px) < 1.5) & (np.abs(column - across_px) < 1.5)
                  & (np.abs(depth_mm / distance_m - 1e3) < 1))


def of_type(kind, **properties):
    def put(scene):
        made = light(scene, kind, 10.0, **properties)
        made.location, made.visible_camera = place_m(scene), True
    return put


def parented(scene):
    parent = bpy.data.objects.new("Parent", None)
    parent.location, parent.scale = (1.0, -2.0, 3.0), (2.0, 2.0, 2.0)
    scene.collection.objects.link(parent)
    child = lamp(scene, 1.0)
    child.parent, child.location = parent, (np.array(place_m(scene)) - (1.0, -2.0, 3.0)) / 2


def on_vertices(scene):
    mesh = bpy.data.meshes.new("Points")
    mesh.from_pydata([place_m(scene), place_m(scene, 10.0, 10.0)], [], [])
    owner = bpy.data.objects.new("Points", mesh)
    scene.collection.objects.link(owner)
    owner.instance_type, owner.show_instancer_for_render = "VERTS", False
    child = lamp(scene, 1.0)
    child.parent, child.location = owner, (0, 0, 0)


def in_collection(scene):
    inside = bpy.data.collections.new("Inside")
    bulb = lamp(scene, 1.0)
    bulb.location = 0, 0, 0
    scene.collection.objects.unlink(bulb)
    inside.objects.link(bulb)
    empty = bpy.data.objects.new("Empty", None)
    empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", inside, place_m(scene)
    scene.collection.objects.link(empty)


def particles(scene):
    bulb = lamp(scene, 1.0)
    bulb.location = 0, 0, 100
    emitter = wall(scene, material("Dark", "ShaderNodeBsdfDiffuse")[0], side_m=0.01)
    emitter.location = place_m(scene)
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.count, settings.frame_start, settings.frame_end, settings.lifetime = 5, 1, 1, 100
    settings.physics_type, settings.render_type, settings.instance_object = "NO", "OBJECT", bulb
    settings.particle_size = 1.0
    scene.frame_set(3)


def made_by_nodes(scene):
    """A mesh of geometry nodes with their own material, on an object without one."""
    mesh = bpy.data.meshes.new("None")
    owner = bpy.data.objects.new("None", mesh)
    owner.location = place_m(scene)
    scene.collection.objects.link(owner)
    tree = bpy.data.node_groups.new("Make", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    cube, paint, output = (tree.nodes.new(kind) for kind in
                           ("GeometryNodeMeshCube", "GeometryNodeSetMaterial", "NodeGroupOutput"))
    cube.inputs["Size"].default_value = (0.01, 0.01, 0.01)
    paint.inputs["Material"].default_value = glow()
    tree.links.new(cube.outputs["Mesh"], paint.inputs["Geometry"])
    tree.links.new(paint.outputs["Geometry"], output.inputs[0])
    owner.modifiers.new("Nodes", "NODES").node_group = tree


def curve(scene):
    shape = bpy.data.curves.new("Wire", "CURVE")
    shape.dimensions, shape.bevel_depth = "3D", 0.01
    points = shape.splines.new("POLY").points
    points.add(1)
    points[1].co = 0.01, 0, 0, 1
    shape.materials.append(glow())
    owner = bpy.data.objects.new("Wire", shape)
    owner.location = place_m(scene)
    scene.collection.objects.link(owner)


@pytest.mark.every_blender
@pytest.mark.parametrize("put", [
    of_type("POINT", shadow_soft_size=0.02), of_type("SPOT", shadow_soft_size=0.02), of_type("AREA", size=0.02),
    parented, on_vertices, in_collection, particles, made_by_nodes, curve])
def test_emitters_of_all_kinds_are_sighted(dark, tmp_path, put):
    put(dark)
    bpy.context.view_layer.update()
    assert_sighted(dark, tmp_path)


@pytest.mark.parametrize("count", [3, 30, 3000])
def test_many_lamps_are_sighted_at_their_depths(dark, tmp_path, count):
    rng, places = np.random.default_rng(1), []
    glowing = glow()
    for distance_m in np.linspace(3, 30, count):
        across, up = rng.uniform(-100, 100), rng.uniform(-70, 70)
        square = wall(dark, glowing, distance_m, 0.25 * dark["per_px"] * distance_m)
        square.location = place_m(dark, across, up, distance_m)
        places.append((across, up, distance_m))
    bpy.context.view_layer.update()
    row, column, depth_mm = sightings(dark, tmp_path)
    depth_mm, first = np.unique(np.rint(depth_mm), return_index=True)  # a lamp may have two parts
    places = np.array(places)
    np.testing.assert_allclose(depth_mm, places[:, 2] * 1e3, atol=0.6)
    assert np.abs(column[first] - places[:, 0]).max() < 1 and np.abs(row[first] + places[:, 1]).max() < 1


@pytest.mark.parametrize("grey", [0.0, 0.002])
@pytest.mark.parametrize("count", [3, 3000])
def test_all_light_of_many_tiny_lamps_is_out_of_focus(dark, tmp_path, count, grey):
    """The one ray of a pixel's depth misses nearly all of them."""
    set_world(dark, (grey,) * 3)
    rng, mesh = np.random.default_rng(1), bpy.data.meshes.new("Points")
    places = [place_m(dark, *place) for place in rng.uniform((-90, -60), (90, 60), (count, 2))]
    mesh.from_pydata(places, [], [])
    owner = bpy.data.objects.new("Points", mesh)
    dark.collection.objects.link(owner)
    owner.instance_type, owner.show_instancer_for_render = "VERTS", False
    bulb = lamp(dark, 0.25)
    bulb.parent, bulb.location = owner, (0, 0, 0)
    result = rendered(dark, tmp_path)
    layers = read_with_layers(result.radiance)[2].layers
    depths_mm = np.concatenate([layer.depth_mm[layer.alpha > 0] for layer in layers])
    np.testing.assert_allclose(depths_mm[np.isfinite(depths_mm)], LAMP_M * 1e3, rtol=1e-4)
    assert np.isfinite(depths_mm).sum() >= count / 2
    assert result.report.scene.depth.nearest_mm == pytest.approx(LAMP_M * 1e3, rel=1e-4)


def hidden_from_camera(scene):
    lamp(scene, 1.0).visible_camera = False


def without_size(scene):
    of_type("POINT", shadow_soft_size=0.0)(scene)


def portal(scene):
    of_type("AREA", size=0.02)(scene)
    scene.objects["Light"].data.cycles.is_portal = True


def black(scene):
    lamp(scene, 1.0, 0.0)


@pytest.mark.parametrize("put", [hidden_from_camera, without_size, portal, black])
def test_what_the_camera_does_not_see_is_not_sighted(dark, tmp_path, put):
    put(dark)
    bpy.context.view_layer.update()
    assert not sightings(dark, tmp_path)[0].size
