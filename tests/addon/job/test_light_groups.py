"""Lamps with several spectra, in light groups: their light adds up as if each shone alone, and the scene is restored.
"""

from functools import cache

import bpy
import numpy as np
import pytest
from scipy.integrate import trapezoid

from lenses import make_lens
from lensfield import addon
from lensfield.addon.shading.lamps import MOST_GROUPS
from lensfield.engine import Options
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.spectra import blackbody, colour_matching, emission_basis, load_spectrum, white_density
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from noise import assert_means
from small_scenes import background, light, material, set_world, view_factor, wall
from snapshot import differences, snapshot

NM = np.array([420.0, 450.0, 550.0, 589.0, 610.0, 650.0])
FLAT, FLAT_DENSITY = "380:1, 780:1", 1 / 400
SPIKY, SMOOTH = "sodium-lp", "illuminant-a"
STEP = 1 / (4 * np.pi**2)  # radiance of a white wall at 1 m per watt of a point lamp
PRECISION = 1e-3
BY_CHANCE = 4096  # samples if Cycles chooses between lamps at random: 5 sigma of noise are below the precision


@pytest.fixture(autouse=True)
def few_pixels(scene):
    scene.render.resolution_x, scene.render.resolution_y = 8, 6
    scene.render.image_settings.file_format = "PNG"  # a factory scene has no colour space to restore


@cache
def narrow_lens():
    """A lens with a view of 1.5 degrees, so that all pixels are the same: to 1e-4, by the cosines about the axis."""
    return make_lens(wavelengths_nm=(380.0, 780.0), sensor_mm=(0.24, 0.18))


def cube(scene, folder, nm=NM, lens=None, **options):
    options = {"spectral": SpectralOptions("reference"), "depth": "off"} | options
    result = addon.render_through_lens(scene, lens=lens or narrow_lens(), wavelengths_nm=nm, output_folder=folder,
                                       **{"options": Options(detail="off")} | options)
    return read_exr(result.radiance).frame().cube.astype(np.float64), result.report.as_dict()


def radiance(scene, folder, nm=NM, **options):
    """Spectral radiance: array (wavelength, row, column)."""
    return cube(scene, folder, nm, **options)[0]


def lamps_of(scene, folder, nm=NM, **options):
    return cube(scene, folder, nm, **options)[1]["lamps"]


def point(scene, spectrum, watts=10.0, **properties):
    new = light(scene, "POINT", watts, shadow_soft_size=0.0, **properties)
    new.data.lensfield.emission = spectrum
    return new


def glowing(name, spectrum, strength=1.0, colour=(1, 1, 1)):
    emitter, shader = material(name, "ShaderNodeEmission", colour)
    shader.inputs["Strength"].default_value = strength
    emitter.lensfield.emission = spectrum
    return emitter


def density(spectrum, nm=NM):
    """By its definition: unit power between 380 and 780 nm; for the spiky lamp, the means that a picture gets."""
    loaded = load_spectrum(spectrum)
    return loaded.band_means(nm) if spectrum == SPIKY else loaded.density_at(nm)


def red_wall(scene, distance_m=1.0):
    painted, _ = material("Paint", "ShaderNodeBsdfDiffuse")
    painted.lensfield.reflectance = "chart-15-red"
    return wall(scene, painted, distance_m)


def white_wall(scene, distance_m=1.0):
    return wall(scene, material("White", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0], distance_m)


def red(nm=NM):
    return load_spectrum("chart-15-red").at(nm)


@pytest.mark.parametrize("first, second", [(SPIKY, "led-b3"), ("illuminant-a", "mercury"), (SPIKY, "")])
def test_light_of_two_lamps_is_the_sum_of_each_alone(scene, tmp_path, first, second):
    red_wall(scene)
    lamps = [point(scene, first, 10.0), point(scene, second, 3.0)]
    lamps[1].location = (0.3, 0.2, 0)
    alone = []
    for lamp in lamps:
        lamp.hide_render = True
        alone.append(radiance(scene, tmp_path))
        lamp.hide_render = False
    scene.cycles.samples = BY_CHANCE
    assert_means(radiance(scene, tmp_path), sum(alone), PRECISION)
    first, second = (picture.mean(axis=(1, 2)) for picture in alone)
    assert np.ptp(first / first.max() - second / second.max()) > 0.3


@pytest.mark.every_blender
def test_each_lamp_keeps_its_spectrum_on_a_coloured_wall(scene, tmp_path):
    scene.cycles.samples = BY_CHANCE
    red_wall(scene)
    point(scene, SPIKY, 10.0)
    point(scene, SMOOTH, 3.0)
    point(scene, FLAT, 5.0)
    expected = STEP * red() * (10 * density(SPIKY) + 3 * density(SMOOTH) + 5 * FLAT_DENSITY)
    assert_means(radiance(scene, tmp_path), expected, PRECISION)


def test_several_lamps_need_no_extra_passes_in_a_grey_scene(scene, tmp_path):
    scene.cycles.samples = BY_CHANCE
    white_wall(scene)
    for spectrum in (SPIKY, "mercury", "led-rgb1", FLAT):
        point(scene, spectrum)
    picture, facts = cube(scene, tmp_path)
    assert facts["passes"] == 1 and len(facts["lamps"]) == 4
    expected = 10 * STEP * (density(SPIKY) + FLAT_DENSITY + sum(
        load_spectrum(name).band_means(NM) for name in ("mercury", "led-rgb1")))
    assert_means(picture, expected, PRECISION)


@pytest.mark.parametrize("count", [9, 31])
@pytest.mark.parametrize("spectrum", [SPIKY, "mercury", "fluorescent-fl11", "588.9:0, 589:1, 589.1:0"])
def test_the_picture_has_the_full_power_of_spiky_lamps(scene, tmp_path, spectrum, count):
    """By the trapezoidal rule over the picture's wavelengths, for any position of the lines."""
    nm = np.linspace(380, 780, count)
    white_wall(scene)
    point(scene, spectrum, 10.0)
    assert_means(trapezoid(radiance(scene, tmp_path, nm), nm, axis=0), 10 * STEP, PRECISION)


def test_the_picture_has_the_full_power_of_spiky_lamps_that_share_a_group(scene, tmp_path):
    """Two on one object: their spectra are in the colours."""
    nm = np.linspace(380, 780, 31)
    glow = two_coloured_wall(scene, SPIKY, "mercury")
    left, right = halves(scene, tmp_path, nm)
    for half, strength in zip((left, right), glow, strict=True):
        assert_means(trapezoid(half, nm, axis=0), strength)


def two_coloured_wall(scene, left, right):
    """One object, its left half of one glowing material and its right half of another; their strengths."""
    mesh = bpy.data.meshes.new("Halves")
    corners = [(-5, -5, -1), (0, -5, -1), (5, -5, -1), (5, 5, -1), (0, 5, -1), (-5, 5, -1)]
    mesh.from_pydata(corners, [], [(0, 1, 4, 5), (1, 2, 3, 4)])
    for name, spectrum, strength in (("Left", left, 2.0), ("Right", right, 3.0)):
        mesh.materials.append(glowing(name, spectrum, strength))
    mesh.polygons[1].material_index = 1
    scene.collection.objects.link(bpy.data.objects.new("Halves", mesh))
    return 2.0, 3.0


def halves(scene, folder, nm=NM, **options):
    picture, _ = cube(scene, folder, nm, **options)
    return picture[:, :, :3], picture[:, :, 5:]


def test_an_object_can_have_two_glowing_materials(scene, tmp_path):
    two_coloured_wall(scene, SMOOTH, "led-b3")
    left, right = halves(scene, tmp_path)
    assert_means(left, 2 * density(SMOOTH))
    assert_means(right, 3 * load_spectrum("led-b3").density_at(NM))


def test_a_material_of_a_shared_group_also_glows_on_a_separate_object(scene, tmp_path):
    """The object has a single spectrum, but its material shares a group with several spectra."""
    two_coloured_wall(scene, SMOOTH, "led-b3")
    bpy.data.objects["Halves"].location.z = -5
    wall(scene, bpy.data.materials["Left"], 0.5)
    point(scene, FLAT)
    assert_means(radiance(scene, tmp_path), 2 * density(SMOOTH))


def test_a_material_can_combine_a_blackbody_and_a_colour(scene, tmp_path):
    both, first = material("Both", "ShaderNodeEmission", (0.2, 0.5, 0.9))
    tree = both.node_tree
    second, add = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeAddShader")
    tree.links.new(blackbody_node(tree, 3000.0).outputs[0], second.inputs["Color"])
    for index, shader in enumerate((first, second)):
        tree.links.new(shader.outputs[0], add.inputs[index])
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(add.outputs[0], output.inputs["Surface"])
    wall(scene, both)
    expected = emission_basis(NM) @ (0.2, 0.5, 0.9) + planck_of_white_luminance(3000.0)
    assert_means(radiance(scene, tmp_path), expected)


def blackbody_node(tree, temperature_k):
    node = tree.nodes.new("ShaderNodeBlackbody")
    node.inputs[0].default_value = temperature_k
    return node


def planck_of_white_luminance(temperature_k):
    """Planck's law, as bright as D65 of 1 W m^-2 sr^-1 between 380 and 780 nm: the meaning of Blender's node."""
    fine_nm = np.linspace(380, 780, 4001)
    planck = 1 / (fine_nm**5 * np.expm1(1.438776877e7 / (fine_nm * temperature_k)))
    y_bar = colour_matching(fine_nm)[:, 1]
    gain = trapezoid(white_density(fine_nm) * y_bar, fine_nm) / trapezoid(planck * y_bar, fine_nm)
    return gain * np.interp(NM, fine_nm, planck)


@pytest.mark.parametrize("temperature_k", [1900.0, 6500.0])
@pytest.mark.parametrize("glows", ["mesh", "world", "light"])
def test_blackbody_nodes_have_the_luminance_of_white(scene, tmp_path, glows, temperature_k):
    expected = planck_of_white_luminance(temperature_k)
    if glows == "world":
        tree, socket = scene.world.node_tree, background(scene).inputs["Color"]
    elif glows == "mesh":
        glow, shader = material("Glow", "ShaderNodeEmission")
        wall(scene, glow)
        tree, socket = glow.node_tree, shader.inputs["Color"]
    else:
        white_wall(scene)
        lamp = point(scene, "", 10.0).data
        lamp.use_nodes = True
        tree = lamp.node_tree
        socket = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeEmission").inputs["Color"]
        expected = 10 * STEP * expected
    tree.links.new(blackbody_node(tree, temperature_k).outputs[0], socket)
    assert_means(radiance(scene, tmp_path), expected, PRECISION)
    assert lamps_of(scene, tmp_path) == [f"blackbody of {temperature_k:g} K"]


def test_world_and_lamps_have_separate_spectra(scene, tmp_path):
    scene.cycles.samples = BY_CHANCE
    set_world(scene, strength=0.3)
    scene.world.lensfield.emission = SMOOTH
    red_wall(scene)
    point(scene, SPIKY, 10.0)
    point(scene, "", 4.0, color=(0.4, 0.2, 1.0))
    expected = red() * (0.3 * density(SMOOTH) + STEP * (10 * density(SPIKY) + 4 * emission_basis(NM) @ (0.4, 0.2, 1)))
    assert_means(radiance(scene, tmp_path), expected, PRECISION)


def test_a_world_override_shines_in_a_separate_group(scene, tmp_path):
    set_world(scene, strength=5.0)
    scene.world.lensfield.emission = SPIKY
    other = bpy.data.worlds.new("Override")
    other.use_nodes = True
    shader = next(node for node in other.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")
    shader.inputs["Color"].default_value, shader.inputs["Strength"].default_value = (1, 1, 1, 1), 0.5
    other.lensfield.emission = SMOOTH
    scene.view_layers[0].world_override = other
    white_wall(scene)
    for spectrum in (SPIKY, SPIKY):
        point(scene, spectrum, 10.0)
    expected = 0.5 * density(SMOOTH) + 20 * STEP * density(SPIKY)
    assert_means(radiance(scene, tmp_path), expected, PRECISION)


def test_light_of_a_temperature_lamp_and_a_spectral_lamp_adds_up(scene, tmp_path):
    if "use_temperature" not in bpy.types.Light.bl_rna.properties:
        pytest.skip("this Blender's lamps have no temperature")
    scene.cycles.samples = BY_CHANCE
    red_wall(scene)
    point(scene, "", 10.0, use_temperature=True, temperature=2700.0)
    point(scene, SPIKY, 3.0)
    expected = red() * STEP * (10 * planck_of_white_luminance(2700.0) + 3 * density(SPIKY))
    assert_means(radiance(scene, tmp_path), expected, PRECISION)


@pytest.mark.parametrize("more", [0, 1, 5])
def test_light_of_more_lamps_than_groups_adds_up(scene, tmp_path, more):
    scene.cycles.samples = BY_CHANCE
    red_wall(scene)
    kelvin = 2000 + 250 * np.arange(MOST_GROUPS + more)
    for temperature in kelvin:
        point(scene, planck_pairs(temperature), 1.0)
    picture, facts = cube(scene, tmp_path)
    assert len(facts["lamps"]) == MOST_GROUPS
    expected = red() * STEP * sum(blackbody(temperature).density_at(NM) for temperature in kelvin)
    assert_means(picture, expected, PRECISION)


BAND = np.arange(380, 781, 10)


def planck_pairs(temperature_k):
    """Planck's law as an emission to assign."""
    return ", ".join(f"{nm}:{value}" for nm, value in zip(BAND, blackbody(temperature_k).at(BAND), strict=True))


def test_spiky_lamps_are_the_last_to_share_a_group(scene, tmp_path):
    """A line between two rendered wavelengths would be lost, or far too bright."""
    scene.cycles.samples = BY_CHANCE
    white_wall(scene)
    for temperature in 2000 + 250 * np.arange(MOST_GROUPS + 2):
        point(scene, planck_pairs(temperature), 1.0)
        light(scene, "POINT", 0.0, shadow_soft_size=0.0).data.lensfield.emission = FLAT
    point(scene, SPIKY, 10.0)
    nm = np.linspace(380, 780, 11)
    assert_means(trapezoid(radiance(scene, tmp_path, nm), nm, axis=0), (10 + MOST_GROUPS + 2) * STEP, PRECISION)


@pytest.mark.every_blender
def test_denoising_puts_all_lamps_in_one_group(scene, tmp_path):
    """OIDN receives only the full picture, and may shift it by 1 %; a dim wavelength by 0.1 % of the brightest."""
    scene.cycles.samples = BY_CHANCE
    red_wall(scene)
    point(scene, "led-b3", 10.0)
    point(scene, SMOOTH, 3.0)
    picture, facts = cube(scene, tmp_path, denoise="on")
    assert len(facts["lamps"]) == 1
    expected = STEP * red() * (10 * load_spectrum("led-b3").density_at(NM) + 3 * density(SMOOTH))
    np.testing.assert_allclose(picture.mean(axis=(1, 2)), expected, rtol=0.01, atol=1e-3 * expected.max())


def test_light_groups_of_the_user_are_ignored_and_restored(scene, tmp_path):
    scene.cycles.samples = BY_CHANCE
    layer = scene.view_layers[0]
    for name in ("lensfield_1", "key", "fill"):
        layer.lightgroups.add(name=name)
    red_wall(scene)
    key, fill, set_world_strength = point(scene, SPIKY, 10.0), point(scene, SMOOTH, 3.0), 0.2
    key.lightgroup, fill.lightgroup, scene.world.lightgroup = "key", "lensfield_1", "fill"
    set_world(scene, strength=set_world_strength)
    scene.world.lensfield.emission = FLAT
    bpy.context.view_layer.update()
    before = snapshot()
    expected = red() * (STEP * (10 * density(SPIKY) + 3 * density(SMOOTH)) + set_world_strength * FLAT_DENSITY)
    assert_means(radiance(scene, tmp_path), expected, PRECISION)
    assert not differences(before, snapshot())


def test_light_groups_of_the_user_are_ignored_with_a_single_lamp(scene, tmp_path):
    """The first lamp then contains all light, whatever group the user assigned."""
    scene.view_layers[0].lightgroups.add(name="key")
    white_wall(scene)
    point(scene, SMOOTH, 10.0).lightgroup = "key"
    assert_means(radiance(scene, tmp_path), 10 * STEP * density(SMOOTH), PRECISION)


def test_instances_of_a_collection_glow(scene, tmp_path):
    """The objects are only in the instanced collection; an empty instances it."""
    inside = bpy.data.collections.new("Lamps")
    for child, z in ((point(scene, SPIKY, 10.0), 0.0), (wall(scene, glowing("Glow", SMOOTH, 0.7), 0.0), -0.5)):
        child.location.z = z
        scene.collection.objects.unlink(child)
        inside.objects.link(child)
    white_wall(scene).hide_render = True
    empty = bpy.data.objects.new("Instancer", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", inside
    scene.collection.objects.link(empty)
    point(scene, FLAT)  # creates several groups
    assert_means(radiance(scene, tmp_path), 0.7 * density(SMOOTH))
    bpy.data.objects["Wall"].hide_render = True
    bpy.data.objects["Wall.001"].hide_render = False
    expected = 10 * STEP * (density(SPIKY) + FLAT_DENSITY)
    assert_means(radiance(scene, tmp_path), expected, PRECISION)


def test_geometry_nodes_set_the_glowing_material(scene, tmp_path):
    obj = white_wall(scene)
    glow = glowing("Glow", SMOOTH, 0.7)
    tree = bpy.data.node_groups.new("Set", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        tree.interface.new_socket(name="Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    node = tree.nodes.new("GeometryNodeSetMaterial")
    node.inputs["Material"].default_value = glow
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs[0], node.inputs["Geometry"])
    tree.links.new(node.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    obj.modifiers.new("Set", "NODES").node_group = tree
    point(scene, FLAT)
    assert_means(radiance(scene, tmp_path), 0.7 * density(SMOOTH))


def test_glowing_materials_may_be_linked_to_objects(scene, tmp_path):
    """Two objects with one mesh, each with a different glowing material."""
    near = wall(scene, glowing("Near", SMOOTH, 0.7), 1.0)
    far = bpy.data.objects.new("Far", near.data)
    far.location.z = -2
    scene.collection.objects.link(far)
    far.material_slots[0].link = "OBJECT"
    far.material_slots[0].material = glowing("Other", SPIKY, 0.5)
    assert_means(radiance(scene, tmp_path), 0.7 * density(SMOOTH))
    near.hide_render = True
    assert_means(radiance(scene, tmp_path), 0.5 * density(SPIKY))


def test_linked_lamps_shine_in_their_groups(scene, tmp_path):
    scene.cycles.samples = BY_CHANCE
    lamp = point(scene, SPIKY, 10.0)
    lamp.name = "Sodium"
    glow = wall(scene, glowing("Glow", SMOOTH, 0.7), -3.0)  # behind the camera
    glow.name = "Glow"
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {lamp, glow})
    for linked in (lamp, glow):
        bpy.data.objects.remove(linked)
    bpy.data.batch_remove([bpy.data.lights["Light"], bpy.data.meshes["Wall"], bpy.data.materials["Glow"]])
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (available, linked):
        linked.objects = available.objects
    for obj in linked.objects:
        scene.collection.objects.link(obj)
    white_wall(scene)
    point(scene, FLAT, 5.0)
    bpy.context.view_layer.update()
    before = snapshot()
    measured = radiance(scene, tmp_path)
    # Blender itself marks data-blocks as directly linked once they are assigned to; nothing else may differ.
    assert not [line for line in differences(before, snapshot()) if "is_library_indirect" not in line]
    expected = (STEP * (10 * density(SPIKY) + 5 * FLAT_DENSITY)
                + 0.7 * view_factor(10, 4) * density(SMOOTH))
    assert_means(measured, expected, PRECISION)


def test_unlit_scene_is_black(scene, tmp_path):
    white_wall(scene)
    assert not cube(scene, tmp_path)[0].any()


@pytest.mark.parametrize("fails", [False, True])
def test_scene_and_groups_are_restored_afterwards(scene, tmp_path, monkeypatch, fails):
    two_coloured_wall(scene, SMOOTH, SPIKY)
    bpy.data.objects["Halves"].location.z = 3
    red_wall(scene)
    for spectrum in (SPIKY, SMOOTH, FLAT):
        point(scene, spectrum)
    scene.view_layers[0].lightgroups.add(name="mine")
    bpy.context.view_layer.update()
    before = snapshot()
    if fails:
        monkeypatch.setattr("lensfield.addon.capture.finished_passes.read_pass", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            radiance(scene, tmp_path, depth="auto")
    else:
        radiance(scene, tmp_path, depth="auto")
    assert not differences(before, snapshot())


def test_a_shared_dull_material_does_not_merge_light_groups(scene, tmp_path):
    """A grey material shared by a lamp's object and an object with two spectra does not put that lamp in their group.
    """
    dull, _ = material("Dull", "ShaderNodeBsdfDiffuse")
    corners = [(x, y, -4.0) for x in (-3, -1, 1, 3) for y in (-1, 1)]
    three = bpy.data.meshes.new("Three")
    three.from_pydata(corners, [], [(0, 2, 3, 1), (2, 4, 5, 3), (4, 6, 7, 5)])
    pair = bpy.data.meshes.new("Pair")
    pair.from_pydata([(x, y, -1.0) for x in (-9, 0, 9) for y in (-9, 9)], [], [(0, 2, 3, 1), (2, 4, 5, 3)])
    for mesh, materials in ((three, (glowing("Left", SMOOTH), glowing("Right", "led-b3"), dull)),
                            (pair, (glowing("Lines", SPIKY, 2.0), dull))):
        for index, one in enumerate(materials):
            mesh.materials.append(one)
            mesh.polygons[index].material_index = index
        scene.collection.objects.link(bpy.data.objects.new(mesh.name, mesh))
    picture, _ = cube(scene, tmp_path)
    assert_means(picture[:, :, :3], 2 * density(SPIKY))


def test_a_view_layer_may_have_any_name(scene, tmp_path):
    scene.view_layers[0].name = "My.Layer: 1/2"
    point(scene, FLAT)
    point(scene, SMOOTH)
    white_wall(scene)
    assert radiance(scene, tmp_path).min() > 0
