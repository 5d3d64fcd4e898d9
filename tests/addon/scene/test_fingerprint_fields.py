"""Every setting that affects a render is in the scene's fingerprint: each is changed separately, and restored."""

import bpy
import pytest

from lensfield.addon.scene import fingerprint
from lensfield.addon.scene.compositor import fingerprint_anew
from lensfield.addon.scene.fingerprint import RENDER
from small_scenes import light, material, set_world, wall

VALUES = {  # different from those of the fixture `scene`
    "resolution_x": 52, "resolution_y": 38, "resolution_percentage": 50, "pixel_aspect_x": 1.5, "pixel_aspect_y": 1.5,
    "film_transparent": True, "use_border": True, "border_min_x": 0.25, "border_max_x": 0.75, "border_min_y": 0.25,
    "border_max_y": 0.75, "use_motion_blur": True, "motion_blur_shutter": 0.25, "motion_blur_position": "START",
    "use_simplify": True, "simplify_subdivision_render": 2, "simplify_child_particles_render": 0.5}


@pytest.fixture
def furnished(scene):
    """A wall in a nested collection, a lamp and a world; and a second layer, material and camera."""
    outer, inner = bpy.data.collections.new("Outer"), bpy.data.collections.new("Inner")
    scene.collection.children.link(outer)
    outer.children.link(inner)
    painted = wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0])
    inner.objects.link(painted)
    scene.collection.objects.unlink(painted)
    light(scene, "SPOT", 20.0)
    set_world(scene, (0.1, 0.2, 0.3))
    scene.view_layers.new("Other")
    material("Clay", "ShaderNodeBsdfDiffuse")
    scene.collection.objects.link(bpy.data.objects.new("Second", bpy.data.cameras.new("Second")))
    bpy.context.view_layer.update()
    return scene


def assert_it_counts(scene, owner, name, value):
    """Checks that the fingerprint changes with this value, and is restored with the previous one."""
    usual, before = getattr(owner, name), fingerprint_anew(scene)
    assert usual != value, "the test changes nothing"
    setattr(owner, name, value)
    changed = fingerprint_anew(scene)
    setattr(owner, name, usual)
    assert changed != before == fingerprint_anew(scene)


def test_all_render_settings_have_a_test_value():
    assert set(VALUES) >= {"film_transparent", "motion_blur_shutter"} and set(VALUES) == set(RENDER)


@pytest.mark.parametrize("name", VALUES)
def test_render_settings_count(furnished, name):
    assert_it_counts(furnished, furnished.render, name, VALUES[name])


@pytest.mark.parametrize("name, value", [
    ("samples", 17), ("seed", 5), ("film_exposure", 2.0), ("pixel_filter_type", "BOX"), ("filter_width", 2.5),
    ("max_bounces", 3), ("blur_glossy", 0.5), ("sample_clamp_direct", 1.0), ("film_transparent_glass", True),
    ("use_denoising", True), ("caustics_reflective", False), ("dicing_rate", 2.0)])
def test_cycles_settings_count(furnished, name, value):
    if name == "seed":
        value += furnished.cycles.seed
    assert_it_counts(furnished, furnished.cycles, name, value)


@pytest.mark.parametrize("collection", ["Outer", "Inner"])
@pytest.mark.parametrize("name", ["exclude", "holdout", "indirect_only"])
@pytest.mark.parametrize("layer", [0, 1])
def test_collection_settings_of_view_layers_count(furnished, layer, collection, name):
    of_layer = furnished.view_layers[layer].layer_collection.children["Outer"]
    of_layer = of_layer if collection == "Outer" else of_layer.children["Inner"]
    assert_it_counts(furnished, of_layer, name, True)


@pytest.mark.parametrize("layer", [0, 1])
@pytest.mark.parametrize("name", ["use", "samples", "material_override"])
def test_view_layer_settings_count(furnished, layer, name):
    """The scene already uses the material of the override, which therefore adds no data-block."""
    value = {"use": False, "samples": 3, "material_override": bpy.data.materials["Paint"]}[name]
    assert_it_counts(furnished, furnished.view_layers[layer], name, value)


def test_the_nodes_of_a_material_override_count(furnished):
    clay = furnished.view_layers[1].material_override = bpy.data.materials["Clay"]
    shader = next(node for node in clay.node_tree.nodes if node.bl_idname == "ShaderNodeBsdfDiffuse")
    assert_it_counts(furnished, shader.inputs["Roughness"], "default_value", 0.5)


def test_camera_and_world_of_the_scene_count(furnished):
    assert_it_counts(furnished, furnished, "camera", bpy.data.objects["Second"])
    assert_it_counts(furnished, furnished, "world", bpy.data.worlds.new("Other"))


def test_a_camera_bound_to_a_marker_counts(furnished):
    unbound = fingerprint_anew(furnished)
    marker = furnished.timeline_markers.new("Cut", frame=7)
    assert fingerprint_anew(furnished) == unbound
    marker.camera = bpy.data.objects["Second"]
    assert fingerprint_anew(furnished) != unbound
    assert_it_counts(furnished, marker, "frame", 9)


@pytest.mark.parametrize("name, value", [
    ("is_holdout", True), ("is_shadow_catcher", True), ("visible_camera", False), ("visible_shadow", False),
    ("visible_glossy", False), ("hide_render", True), ("show_instancer_for_render", False),
    ("pass_index", 3), ("location", (0.1, 0.0, -1.0)),
    ("rotation_euler", (0.0, 0.2, 0.0)), ("scale", (1.0, 2.0, 1.0))])
def test_object_properties_count(furnished, name, value):
    obj = bpy.data.objects["Wall"]
    if isinstance(value, tuple):
        usual = tuple(getattr(obj, name))
        before = fingerprint_anew(furnished)
        setattr(obj, name, value)
        changed = fingerprint_anew(furnished)
        setattr(obj, name, usual)
        assert changed != before == fingerprint_anew(furnished)
    else:
        assert_it_counts(furnished, obj, name, value)


@pytest.mark.parametrize("kind, name, value", [
    ("cameras", "clip_start", 0.5), ("cameras", "clip_end", 7.0), ("cameras", "lens", 35.0),
    ("lights", "energy", 30.0), ("lights", "shadow_soft_size", 0.5), ("lights", "spot_size", 0.5)])
def test_camera_and_light_data_count(furnished, kind, name, value):
    owner = furnished.camera.data if kind == "cameras" else bpy.data.lights["Light"]
    assert_it_counts(furnished, owner, name, value)


def test_the_order_in_which_add_ons_register_does_not_count(furnished, monkeypatch):
    """It differs between a window, where a user switches add-ons off and on, and the processes that it starts."""
    found = set()
    for name in ("cycles", "lensfield", "cycles"):
        group = type(getattr(bpy.data.lights[0], name))
        delattr(bpy.types.Light, name)
        setattr(bpy.types.Light, name, bpy.props.PointerProperty(type=group))
        monkeypatch.setattr(fingerprint, "_fields", {})
        found.add(fingerprint_anew(furnished))
    assert len(found) == 1


def test_mesh_vertices_count(furnished):
    vertex = bpy.data.objects["Wall"].data.vertices[0]
    usual, before = tuple(vertex.co), fingerprint_anew(furnished)
    vertex.co.y += 0.25
    changed = fingerprint_anew(furnished)
    vertex.co = usual
    assert changed != before == fingerprint_anew(furnished)
