"""Coverage: what each pixel's light is made of, by objects, materials and collections."""

import bpy
import numpy as np
import pytest

from lensfield import addon
from lensfield.engine import Options
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts
from small_scenes import material, set_region, set_world, wall

NEAR_M, MIDDLE_M, FAR_M = 0.6, 1.1, 3.0
FAST = {"lens": "zeiss-biotar-50mm", "lens_quality": "preview", "f_number": 2.0, "focus": 1000 * MIDDLE_M,
        "files": "pictures"}
SAMPLES, WORLD = 64, "Background"


def strengths(scene, by_object):
    """Let each object emit grey light of a strength of its own."""
    for name, strength in by_object.items():
        if name == WORLD:
            set_world(scene, strength=strength)
        else:
            nodes = bpy.data.objects[name].active_material.node_tree.nodes
            nodes["Emission"].inputs["Strength"].default_value = strength


def glowing(scene, name, distance_m, side_m, x=0.0, y=0.0):
    """A square that glows, with a material of its own."""
    glow, shader = material(f"Glow of {name}", "ShaderNodeEmission", (1, 1, 1))
    new = wall(scene, glow, distance_m, side_m)
    new.name, new.location.x, new.location.y = name, x, y
    glow.cycles.emission_sampling = "NONE"
    return new


@pytest.fixture
def glows(scene):
    """A near, a middle and a far square before a bright world; the axis is off the middle of the frame."""
    scene.cycles.samples = SAMPLES
    scene.camera.data.shift_x, scene.camera.data.shift_y = 0.06, -0.04
    scene.unit_settings.scale_length = 0.01
    scene.camera.data.clip_start = 0.1
    near = glowing(scene, "N\u00e4h.r", 100 * NEAR_M, 14, 6, 3)
    near.rotation_euler.z = 0.3
    glowing(scene, "Middle", 100 * MIDDLE_M, 20, -14, -6)
    glowing(scene, "Far", 100 * FAR_M, 90, 15, 10)
    return scene


EMISSIONS = {"N\u00e4h.r": 3.0, "Middle": 0.6, "Far": 1.5, WORLD: 1.0}


def render(scene, folder, truth="coverage", detail_off=False, **given):
    given = FAST | given
    if detail_off:
        given["options"] = Options(detail="off")
    given = {name: value for name, value in given.items() if value is not None}
    return addon.render_through_lens(scene, output_folder=folder, truth=truth, **given)


def masks_of(result, layer="Coverage"):
    """The masks by name."""
    (_, channels), = read_parts(result.truth)
    start = f"ViewLayer.{layer} "
    return {name.removeprefix(start).removesuffix(".X"): plane for name, plane in channels.items()
            if name.startswith(start)}


def light_over_white(scene, folder, **given):
    """The lens image over that of a white scene, and the masks."""
    strengths(scene, EMISSIONS)
    result = render(scene, folder / "light", files="irradiance", **given)
    strengths(scene, dict.fromkeys(EMISSIONS, 1.0))
    white = render(scene, folder / "white", files="irradiance", truth="", **given)
    light, even = (read_exr(each.irradiance).cube[0] for each in (result, white))
    return light / even, masks_of(result)


CHANNELS = {"N\u00e4h.r": "N\u00e4h_r", "Middle": "Middle", "Far": "Far", WORLD: WORLD}


@pytest.mark.parametrize("given, worst, typical", [
    ({"detail_off": True}, 0.02, 0.001),  # each slab has one object, whose alpha is the light's
    ({}, 0.1, 0.01),
    ({"lens": "jacobsen-41mm-2x", "f_number": None}, 0.02, 0.001),
    ({"lens": "pentax-fisheye-17mm", "f_number": None, "focus": None}, 0.15, 0.015)],
    ids=["depth", "detail", "anamorphic", "fisheye"])
def test_light_is_the_sum_of_emissions_times_masks(glows, tmp_path, given, worst, typical):
    """The strongest judge: the masks are what the light of each pixel is made of."""
    ratio, masks = light_over_white(glows, tmp_path, wavelengths_nm=(550.0,), **given)
    np.testing.assert_allclose(sum(masks.values()), 1, atol=1e-6)
    made = sum(strength * masks[CHANNELS[name]] for name, strength in EMISSIONS.items())
    spread = EMISSIONS["N\u00e4h.r"] - EMISSIONS["Middle"]
    apart = np.abs(made - ratio) / spread
    assert apart.max() < worst and np.sqrt(np.mean(apart**2)) < typical
    assert min(mask.max() for mask in masks.values()) > 0.5


def test_masks_have_names_for_files_and_only_objects_with_light(glows, tmp_path):
    glowing(glows, "Behind", 400, 20, 6, 3)  # the near square
    glowing(glows, "Aside", 400, 20, 4000, 3)
    result = render(glows, tmp_path)
    assert masks_of(result).keys() == set(CHANNELS.values())
    node = bpy.data.node_groups.new("Masks", "CompositorNodeTree").nodes.new("CompositorNodeImage")
    node.image = bpy.data.images.load(str(result.truth))
    assert {"Coverage N\u00e4h_r", "Coverage Background"} <= {output.name for output in node.outputs}


def test_materials_and_collections_share_the_light_too(glows, tmp_path):
    outer, inner = (bpy.data.collections.new(name) for name in ("Outer", "Inner"))
    glows.collection.children.link(outer)
    outer.children.link(inner)
    for name, collection in (("Middle", inner), ("Far", outer)):
        collection.objects.link(bpy.data.objects[name])
        glows.collection.objects.unlink(bpy.data.objects[name])
    bpy.data.objects["Far"].data.materials[0] = bpy.data.objects["Middle"].active_material
    result = render(glows, tmp_path, "coverage,material-coverage,collection-coverage", detail_off=True)
    objects, materials, collections = (masks_of(result, layer) for layer in (
        "Coverage", "Material Coverage", "Collection Coverage"))
    both = objects["Middle"] + objects["Far"]
    for mask, expected in ((materials["Glow of Middle"], both),
                           (materials["Glow of N\u00e4h_r"], objects["N\u00e4h_r"]),
                           (collections["Inner"], objects["Middle"]), (collections["Outer"], both),
                           (collections["Scene Collection"], objects["N\u00e4h_r"])):
        np.testing.assert_allclose(mask, expected, atol=0.02)  # the number of rays depends on the masks
    for masks in (objects, materials, {name: mask for name, mask in collections.items() if name != "Inner"}):
        np.testing.assert_allclose(sum(masks.values()), 1, atol=1e-6)


def test_a_transparent_film_and_holdouts_are_background(glows, tmp_path):
    glows.render.film_transparent = True
    bpy.data.objects["Far"].is_holdout = True
    masks = masks_of(render(glows, tmp_path, detail_off=True))
    assert masks.keys() == {"N\u00e4h_r", "Middle", "Background"}
    np.testing.assert_allclose(sum(masks.values()), 1, atol=1e-6)
    assert masks["Background"].max() > 0.99


def test_a_region_and_volumes_have_no_masks(glows, tmp_path):
    set_region(glows, 0.25, 0.75, 0.25, 0.75)
    fog = material("Fog", "ShaderNodeVolumeScatter")[0]
    links = fog.node_tree.links
    links.new(links[0].from_socket, links[0].to_node.inputs["Volume"])
    links.remove(links[0])
    bpy.ops.mesh.primitive_cube_add(size=8, location=(0, 0, -40))
    bpy.context.object.data.materials.append(fog)
    total = sum(masks_of(render(glows, tmp_path, depth="off")).values())
    inside = np.zeros(total.shape, bool)
    inside[9:27, 12:36] = True
    np.testing.assert_allclose(total, inside, atol=1e-6)


def test_masks_move_with_the_light(glows, tmp_path):
    """Motion blur softens their edges, as those of the light."""
    near = bpy.data.objects["N\u00e4h.r"]
    for frame, x in ((0, 0.0), (2, 12.0)):
        near.location.x = x
        near.keyframe_insert("location", frame=frame)
    flat = {"depth": "off", "frame": 1, "detail_off": True}
    still = masks_of(render(glows, tmp_path / "still", **flat))["N\u00e4h_r"]
    glows.render.use_motion_blur, glows.render.motion_blur_shutter = True, 1.0
    blurred = masks_of(render(glows, tmp_path / "blurred", **flat))["N\u00e4h_r"]
    between = [np.mean((mask > 0.1) & (mask < 0.9)) for mask in (still, blurred)]
    assert between[1] > 2 * between[0] and blurred.sum() == pytest.approx(still.sum(), rel=0.1)
