"""Sources of stray light beyond the picture: their light against rendered white cards, and what hides them."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from lensfield import addon
from lensfield.engine.image.directions import directions
from lensfield.engine.pictures.spectral_exr import read_exr, read_sources
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions
from lensfield.engine.stray.picture_sources import picture_sources
from small_scenes import light, material, render, set_world, wall

QUICK = {"spectral": SpectralOptions("preview"), "depth": "off", "lens_quality": "preview",
         "stray": StrayOptions("off")}


def sources(scene, folder):
    return read_sources(render(scene, folder, **QUICK).radiance)


def lamp(scene, kind, place, watts=50.0, aim=(0, 0, 0), **properties):
    """A lamp that shines at a point."""
    new = light(scene, kind, watts, **properties)
    new.location = place
    new.rotation_mode = "QUATERNION"
    new.rotation_quaternion = (new.location - type(new.location)(aim)).to_track_quat("Z", "Y")
    return new


LAMPS = [("POINT", {"shadow_soft_size": 0.0}), ("POINT", {"shadow_soft_size": 0.2}),
         ("SPOT", {"shadow_soft_size": 0.05, "spot_size": 0.8, "spot_blend": 0.7, "aim": (0.35, 0.1, 0.1)}),
         ("SUN", {"angle": 0.1}),
         ("AREA", {"shape": "RECTANGLE", "size": 0.5, "size_y": 0.2, "aim": (0.9, 0.2, 0.3)}),
         ("AREA", {"shape": "DISK", "size": 0.3, "spread": 1.2, "aim": (0.4, -0.2, 0.3)})]
if "normalize" in bpy.types.Light.bl_rna.properties:
    LAMPS += [(kind, properties | {"normalize": False}) for kind, properties in LAMPS if properties.get(
        "shadow_soft_size") != 0]


@pytest.mark.sample(4)
@pytest.mark.parametrize("kind, properties", LAMPS, ids=str)
def test_a_lamp_gives_the_irradiance_of_a_rendered_white_card(scene, tmp_path, kind, properties):
    """The card is in the camera's place and faces the source; another camera looks at it."""
    place = (1.2, 0.5, -1.6)
    one = lamp(scene, kind, place, **properties)
    one.data.color = (0.9, 0.4, 0.2)
    source = sources(scene, tmp_path / "sources")
    assert set(source.names) == {"Light"}
    vector = (source.irradiance[:, :1] * source.directions).sum(axis=0) * (1, 1, -1)
    aimed = np.array(place) / np.linalg.norm(place)
    np.testing.assert_allclose(vector / np.linalg.norm(vector), aimed, atol=0.01)

    card = wall(scene, material("Card", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0], 0.0, 0.02)
    towards = type(one.location)(aimed)
    card.rotation_mode, card.rotation_quaternion = "QUATERNION", towards.to_track_quat("Z", "Y")
    camera = scene.camera
    beside = (towards + 0.8 * towards.orthogonal()).normalized()
    camera.location = 0.05 * beside
    camera.rotation_mode, camera.rotation_quaternion = "QUATERNION", beside.to_track_quat("Z", "Y")
    scene.cycles.max_bounces, scene.cycles.samples = 0, 256
    picture = read_exr(render(scene, tmp_path / "card",
                              **QUICK | {"spectral": SpectralOptions("reference")}).radiance)
    row, column = (n // 2 for n in picture.cube.shape[1:])
    card_light = np.pi * picture.cube[:, row - 2:row + 2, column - 2:column + 2].mean(axis=(1, 2))
    np.testing.assert_allclose(source.irradiance.T @ (source.directions * (1, 1, -1) @ aimed), card_light, rtol=0.02)


def glow(scene, place, side_m, strength=100.0):
    """A glowing square that faces the camera."""
    glowing, shader = material("Glow", "ShaderNodeEmission", (0.9, 0.5, 0.3))
    shader.inputs["Strength"].default_value = strength
    square = wall(scene, glowing, 0.0, side_m)
    square.name, square.location = "Glow", place
    square.rotation_mode = "QUATERNION"
    square.rotation_quaternion = (-square.location).to_track_quat("Z", "Y")
    return square


def total(sources):
    """Irradiance at the first wavelength."""
    return sources.irradiance[:, 0].sum()


@pytest.mark.every_blender
def test_a_glowing_square_gives_its_radiance_times_its_solid_angle(scene, tmp_path):
    square = glow(scene, (1.5, 0, -1.0), 0.2)
    radiance = read_exr(render_in_view(scene, square, tmp_path)).cube.max(axis=(1, 2))
    found = sources(scene, tmp_path / "sources")
    distance = np.hypot(1.5, 1.0)
    half = 0.1 / distance
    sr = 4 * np.arctan2(half**2, np.sqrt(1 + 2 * half**2))
    np.testing.assert_allclose(found.irradiance.sum(axis=0), sr * radiance, rtol=5e-3)
    np.testing.assert_allclose(found.distance_mm, 1000 * distance, rtol=5e-3)
    np.testing.assert_allclose(np.pi * np.square(found.radius_rad).sum(), sr, rtol=0.3)


def render_in_view(scene, square, folder):
    place, turn = square.location.copy(), square.rotation_quaternion.copy()
    square.location, square.rotation_quaternion = (0, 0, -1), (1, 0, 0, 0)
    path = render(scene, folder / "view", **QUICK).radiance
    square.location, square.rotation_quaternion = place, turn
    return path


def irradiance_inside(folder, scene):
    """Irradiance at the entrance pupil from the picture, at the first wavelength, and from outside."""
    result = render(scene, folder, **QUICK)
    inside = picture_sources(read_exr(result.radiance), 1.0)
    return total(inside), total(read_sources(result.radiance))


def test_a_lamp_that_leaves_the_picture_passes_to_the_sources_outside(scene, tmp_path):
    """Its light is the same in steps of a fraction of its width."""
    square = glow(scene, (0, 0, -1.0), 0.04)
    scene.cycles.samples = 64
    inside, outside = irradiance_inside(tmp_path, scene)
    assert outside == 0
    edge = border_right(tmp_path)
    shares = []
    for step in np.linspace(-0.03, 0.03, 7):
        square.location, square.rotation_quaternion = (edge + step, 0, -1), (1, 0, 0, 0)
        there = np.array(irradiance_inside(tmp_path, scene)) * (1 + (edge + step)**2)**1.5 / inside
        assert there.sum() == pytest.approx(1, abs=0.03)
        shares.append(there[0])
    assert shares[0] == pytest.approx(1, abs=0.03) and shares[-1] == 0 and np.all(np.diff(shares) <= 0.03)


def border_right(folder):
    """x in metres of the capture's right edge, at 1 m."""
    image = picture_in(folder)
    right, _, ahead = directions(replace(image.grid, focal_mm=image.focal_mm), image.centre_px[0],
                                 image.cube.shape[2] - 0.5)
    return right / ahead


def picture_in(folder):
    return read_exr(next(folder.glob("*_radiance.exr")))


def test_lamps_count_wherever_they_are_unless_the_camera_shows_them(scene, tmp_path):
    one = lamp(scene, "POINT", (0.02, 0, -1.0), shadow_soft_size=0.01)
    assert len(sources(scene, tmp_path)) == 1
    one.visible_camera = True
    assert len(sources(scene, tmp_path)) == 0
    one.data.shadow_soft_size = 0.0  # a point makes no image
    assert len(sources(scene, tmp_path)) == 1
    one.location.z = 1.0
    assert len(sources(scene, tmp_path)) == 0
    one.location = 0, 0, 0
    assert len(sources(scene, tmp_path)) == 0


def test_objects_hide_lamps_and_glass_does_not(scene, tmp_path):
    lamp(scene, "POINT", (2.0, 0, -2.0), shadow_soft_size=0.0)
    free = total(sources(scene, tmp_path))
    shield = wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0], 1.0, 0.5)
    shield.location.x = 1.0
    assert len(sources(scene, tmp_path)) == 0
    shield.hide_render = True
    assert total(sources(scene, tmp_path)) == free
    shield.hide_render = False
    shield.data.materials[0] = material("Pane", "ShaderNodeBsdfTransparent", (1, 1, 1))[0]
    assert total(sources(scene, tmp_path)) == pytest.approx(free)


def test_part_of_the_entrance_pupil_in_shadow(scene, tmp_path):
    """A screen close to the lens, up to its axis."""
    lamp(scene, "SUN", (1.0, 0, -1.0))
    free = total(sources(scene, tmp_path))
    screen = wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0], 0.0, 1.0)
    screen.location, screen.rotation_euler = (0.01, 0.5, -0.01), (0, np.radians(-45), 0)
    assert 0.3 < total(sources(scene, tmp_path)) / free < 0.7


def test_an_even_world_fills_what_the_picture_does_not_show(scene, tmp_path):
    set_world(scene, (0.3, 0.5, 0.9), 2.0)
    inside, outside = irradiance_inside(tmp_path, scene)
    radiance = picture_in(tmp_path).cube[0].mean()
    assert inside + outside == pytest.approx(2 * np.pi * radiance, rel=2e-3)
    scene.render.film_transparent = True
    assert irradiance_inside(tmp_path, scene)[1] == 0


def test_units_instances_and_many_lamps(scene, tmp_path):
    """In centimetres, instanced by a collection, and hundreds of them: the light of all, in at most 256 sources."""
    scene.unit_settings.scale_length = 0.01
    scene.camera.data.clip_start, scene.camera.data.clip_end = 0.1, 1e5
    lamps = bpy.data.collections.new("Lamps")
    for index in range(300):
        one = lamp(scene, "POINT", (150 + index, 10 * (index % 7), -200 + index % 5), 1.0, shadow_soft_size=0.0)
        scene.collection.objects.unlink(one)
        lamps.objects.link(one)
    instance = bpy.data.objects.new("Instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", lamps
    scene.collection.objects.link(instance)
    found = sources(scene, tmp_path)
    one_watt = sources_of_one(scene, lamps, tmp_path)
    squares = sum(1 / ((150 + index)**2 + (10 * (index % 7))**2 + (index % 5 - 200)**2) for index in range(300))
    assert len(found) == 256 and total(found) == pytest.approx(squares * one_watt, rel=1e-3)
    assert 2400 < found.distance_mm.min() < 2600 and found.directions[:, 2].min() > 0


def sources_of_one(scene, lamps, folder):
    """Irradiance from a lamp of a watt at a distance of one unit."""
    for each in lamps.objects[1:]:
        each.hide_render = True
    found = sources(scene, folder)
    return total(found) * (150**2 + 200**2)


def test_lamps_that_are_not_counted_are_reported(scene, tmp_path):
    computed = lamp(scene, "POINT", (1, 0, -1.0)).data
    computed.use_nodes = True
    tree = computed.node_tree
    emission = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeEmission")
    tree.links.new(tree.nodes.new("ShaderNodeLightFalloff").outputs[0], emission.inputs["Strength"])
    linked = lamp(scene, "POINT", (-1, 0, -1.0))
    linked.light_linking.receiver_collection = bpy.data.collections.new("Receivers")
    negative = lamp(scene, "POINT", (-1, 1, -1.0), watts=-10.0)
    result = render(scene, tmp_path, **QUICK | {"stray": StrayOptions("veil")})
    assert negative.data.energy == -10 and len(read_sources(result.radiance)) == 0
    lines = [line for line in result.report.scene.scene_remarks if "stray" in line]
    assert lines == ["no stray light from light 'Light': nodes compute their light",
                     "no stray light from light 'Light.001': they light only linked objects"]


def test_a_world_of_nodes_is_rendered_in_parts(scene, tmp_path):
    """A sun of 3 degrees in a gradient of blue, at 45 degrees to the right and up from the axis, behind a wall."""
    tree, sun = scene.world.node_tree, np.array([0.6, 0.3, -0.7])
    sun /= np.linalg.norm(sun)
    geometry, dot, greater, mix = (tree.nodes.new(name) for name in (
        "ShaderNodeNewGeometry", "ShaderNodeVectorMath", "ShaderNodeMath", "ShaderNodeMixRGB"))
    dot.operation, greater.operation = "DOT_PRODUCT", "GREATER_THAN"
    dot.inputs[1].default_value = -sun
    greater.inputs[1].default_value = np.cos(np.radians(1.5))
    mix.inputs[1].default_value, mix.inputs[2].default_value = (0.1, 0.2, 0.4, 1), (30000, 20000, 10000, 1)
    background = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeBackground")
    for source, socket in ((geometry.outputs["Incoming"], dot.inputs[0]), (dot.outputs["Value"], greater.inputs[0]),
                           (greater.outputs[0], mix.inputs[0]), (mix.outputs[0], background.inputs["Color"])):
        tree.links.new(source, socket)
    found = read_sources(render(scene, tmp_path, **QUICK | {"stray": StrayOptions("veil")}).radiance)
    brightest = found.chosen(np.flatnonzero(found.directions @ (sun * (1, 1, -1)) > np.cos(np.radians(3))))
    assert total(brightest) > 0.5 * total(found)
    middle = brightest.irradiance[:, 0] @ brightest.directions
    np.testing.assert_allclose(middle / np.linalg.norm(middle), sun * (1, 1, -1), atol=2e-3)
    set_world(scene)
    tree.links.remove(background.inputs["Color"].links[0])
    background.inputs["Color"].default_value = (30000, 20000, 10000, 1)
    even, outside = irradiance_inside(tmp_path, scene)
    np.testing.assert_allclose(total(brightest), (even + outside) * (1 - np.cos(np.radians(1.5))), rtol=0.06)


def test_a_capture_at_any_wavelengths_goes_through_a_lens_again(scene, tmp_path):
    """The names of channels round wavelengths, but not the sources beyond the picture; both are used together."""
    lamp(scene, "POINT", (1.2, 0.5, -1.6))
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0], 3.0)
    options = {name: value for name, value in QUICK.items() if name != "spectral"} | {"stray": StrayOptions("veil")}
    first = render(scene, tmp_path, [450.0, 1600 / 3, 650.0], **options)
    again = addon.apply_lens(first.radiance, lens="edmund-54852", output_folder=tmp_path / "again", **options)
    once, twice = (read_exr(result.irradiance).cube for result in (first, again))
    np.testing.assert_allclose(twice, once, rtol=1e-4, atol=1e-5 * once.max())
