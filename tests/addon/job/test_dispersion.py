"""Glass refracts each wavelength by its own index, as Snell's law requires; metals reflect by Fresnel's equations."""

from functools import cache

import bmesh
import bpy
import numpy as np
import pytest
from scipy.optimize import brentq

from lenses import make_lens
from lensfield import addon
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.spectral.refraction import load_refraction
from lensfield.engine.spectral.spectra import load_spectrum
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from noise import ROUNDING
from refusals import refused
from small_scenes import light, material, set_world, wall

NM = np.array([420.0, 550.0, 680.0])
FLAT, FLAT_DENSITY = "380:1, 780:1", 1 / 400
COLUMNS, ROWS = 96, 12
PITCH_MM = 4.8 / COLUMNS
WEDGE = np.tan(np.radians(20))  # slope of the prism's back
FRONT_M, BACK_M, WALL_M, EDGE_M = -1.0, -1.5, -6.0, 1.5
SAMPLES = 128
PIXEL = 0.1  # of a pixel; 5 sigma for an edge that splits the samples of 12 rows are 0.06, if they were random


@cache
def lens():
    return make_lens(wavelengths_nm=(380.0, 780.0), sensor_mm=(4.8, 4.8 * ROWS / COLUMNS))


@pytest.fixture
def small(scene):
    scene.render.resolution_x, scene.render.resolution_y = COLUMNS, ROWS
    scene.cycles.max_bounces = 8
    return scene


def rendered(scene, folder, nm=NM, tier="standard", **options):
    options = {"spectral": SpectralOptions(tier), "depth": "off"} | options
    result = addon.render_through_lens(scene, lens=lens(), wavelengths_nm=nm, output_folder=folder, **options)
    return read_exr(result.radiance).frame().cube.astype(np.float64), result.report.as_dict()


def prism(scene, of_material):
    """A prism whose front faces the camera; its back is the plane z = BACK_M - WEDGE x."""
    mesh = bpy.data.meshes.new("Prism")
    corners = [(x, y, z) for z in (0, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    points = [(x, y, FRONT_M if z == 0 else BACK_M - WEDGE * x) for x, y, z in corners]
    mesh.from_pydata(points, [], [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)])
    shape = bmesh.new()
    shape.from_mesh(mesh)
    bmesh.ops.recalc_face_normals(shape, faces=shape.faces)  # by which Cycles enters and leaves the glass
    shape.to_mesh(mesh)
    shape.free()
    mesh.materials.append(of_material)
    obj = bpy.data.objects.new("Prism", mesh)
    scene.collection.objects.link(obj)
    return obj


def bright_half(scene):
    """A glowing wall far behind the prism, which ends at x = EDGE_M."""
    glow, _ = material("Glow", "ShaderNodeEmission", (1, 1, 1))
    glow.lensfield.emission = FLAT
    half = wall(scene, glow, -WALL_M, side_m=20)
    half.location.x = EDGE_M - 10
    return half


def glass(name="sf10", node_type="ShaderNodeBsdfRefraction"):
    new = bpy.data.materials.new("Glass")
    new.use_nodes = True
    tree = new.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(node_type)
    shader.inputs["Roughness"].default_value = 0
    if node_type == "ShaderNodeBsdfPrincipled":
        shader.inputs["Transmission Weight"].default_value = 1
        shader.inputs["Base Color"].default_value = (1, 1, 1, 1)
    else:
        shader.inputs["Color"].default_value = (1, 1, 1, 1)
    tree.links.new(shader.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    new.lensfield.refraction = name
    return new


def refracted(direction, normal, ratio):
    """Refraction of unit vectors by Snell's law; the normal is against the direction, the ratio n1 / n2."""
    cosine = -direction @ normal
    return ratio * direction + (ratio * cosine - np.sqrt(1 - ratio**2 * (1 - cosine**2))) * normal


def met_on_the_wall(x_mm, index):
    """Intersection of the wall behind the prism and a ray from the camera, x_mm off the middle of the picture."""
    ray = np.array([x_mm, 0, -lens().capture_focal_length_mm])
    ray /= np.linalg.norm(ray)
    place = ray * FRONT_M / ray[2]
    ray = refracted(ray, np.array([0.0, 0, 1]), 1 / index)
    back = np.array([WEDGE, 0, 1]) / np.hypot(WEDGE, 1)
    place = place + ray * ((np.array([0, 0, BACK_M]) - place) @ back) / (ray @ back)
    ray = refracted(ray, back, index)
    return (place + ray * (WALL_M - place[2]) / ray[2])[0]


def edge_by_snell(index):
    """Column of the wall's edge in the picture, in pixels from the left border."""
    half_mm = COLUMNS * PITCH_MM / 2
    x_mm = brentq(lambda x: met_on_the_wall(x, index) - EDGE_M, -half_mm, half_mm)
    return (x_mm + half_mm) / PITCH_MM


def visible_edges(picture):
    """The edge's column in a picture, for each wavelength, from the value of the pixel that the edge divides."""
    edges = []
    for line in picture.mean(axis=1):
        last = np.flatnonzero(line > 0.5 * line.max())[-1]
        lit = line[:last - 1] if line[last] < 0.9 * line[last - 2] else line[:last + 1]
        part = line[lit.size:]
        dark = part[3:6].mean()  # reflections in the glass
        edges.append(lit.size + (part[:3] - dark).sum() / (lit[-1] - dark))
    return np.array(edges)


def schott_sf10(nm):
    """Sellmeier's formula with the coefficients of Schott's catalogue."""
    um2 = (np.asarray(nm) * 1e-3)**2
    b, c = (1.62153902, 0.256287842, 1.64447552), (0.0122241457, 0.0595736775, 147.468793)
    return np.sqrt(1 + sum(strength * um2 / (um2 - pole) for strength, pole in zip(b, c, strict=True)))


@pytest.mark.parametrize("node_type", ["ShaderNodeBsdfRefraction", "ShaderNodeBsdfGlass", "ShaderNodeBsdfPrincipled"])
def test_each_wavelength_is_refracted_by_snells_law(small, tmp_path, node_type):
    small.cycles.samples = SAMPLES
    bright_half(small)
    prism(small, glass(node_type=node_type))
    picture, facts = rendered(small, tmp_path)
    assert facts["passes"] == 3 and facts["wavelengths_per_pass"] == 1 and facts["rendered_nm"] == list(NM)
    assert "'Prism' of 'Glass' is in view and disperses" in facts["scene_plan"]
    expected = [edge_by_snell(index) for index in schott_sf10(NM)]
    assert np.ptp(expected) > 3
    np.testing.assert_allclose(visible_edges(picture), expected, atol=PIXEL)


def test_without_glass_the_edge_is_at_its_projected_position(small, tmp_path):
    """Tests the measurement: without glass the edge is at the same place for all wavelengths."""
    small.cycles.samples = SAMPLES
    bright_half(small).location.x = 0.5 - 10
    expected = COLUMNS / 2 + 0.5 / -WALL_M * lens().capture_focal_length_mm / PITCH_MM
    np.testing.assert_allclose(visible_edges(rendered(small, tmp_path)[0]), expected, atol=PIXEL)


@pytest.mark.every_blender
@pytest.mark.parametrize("tier", ["standard", "reference"])
def test_each_wavelength_has_a_separate_pass(small, tmp_path, tier):
    bright_half(small)
    prism(small, glass("n-bk7"))
    _, facts = rendered(small, tmp_path, np.linspace(400, 700, 7), tier)
    assert facts["passes"] == 7 and facts["wavelengths_per_pass"] == 1


def test_preview_refracts_all_wavelengths_like_the_d_line(small, tmp_path):
    small.cycles.samples = SAMPLES
    bright_half(small)
    prism(small, glass())
    picture, facts = rendered(small, tmp_path, tier="preview")
    assert facts["passes"] == 1
    np.testing.assert_allclose(visible_edges(picture), edge_by_snell(schott_sf10(587.5618)), atol=PIXEL)


def behind_the_camera(obj):
    obj.location.z = 5


def off_to_the_side(obj):
    obj.location.x = 5


def hidden(obj):
    obj.hide_render = True


@pytest.mark.parametrize("put", [behind_the_camera, off_to_the_side, hidden], ids=lambda put: put.__name__)
def test_glass_out_of_view_costs_nothing(small, tmp_path, put):
    bright_half(small)
    put(prism(small, glass()))
    _, facts = rendered(small, tmp_path, np.linspace(400, 700, 7))
    assert facts["passes"] == 1 and facts["wavelengths_per_pass"] == 3
    assert "disperses" not in facts["scene_plan"]


def test_glass_in_an_instance_is_in_view(small, tmp_path):
    bright_half(small)
    inside = bpy.data.collections.new("Optics")
    obj = prism(small, glass())
    small.collection.objects.unlink(obj)
    inside.objects.link(obj)
    obj.location.z = 50  # away from the instance
    empty = bpy.data.objects.new("Instancer", None)
    empty.instance_type, empty.instance_collection, empty.location.z = "COLLECTION", inside, -50
    small.collection.objects.link(empty)
    assert rendered(small, tmp_path)[1]["wavelengths_per_pass"] == 1


def test_an_index_without_a_name_does_not_disperse(small, tmp_path):
    small.cycles.samples = SAMPLES
    bright_half(small)
    unnamed = glass("")
    next(node for node in unnamed.node_tree.nodes if "IOR" in node.inputs).inputs["IOR"].default_value = 1.65
    prism(small, unnamed)
    picture, facts = rendered(small, tmp_path)
    assert facts["passes"] == 1
    np.testing.assert_allclose(visible_edges(picture), edge_by_snell(1.65), atol=PIXEL)


def test_an_assigned_refraction_overrides_an_index_from_nodes(small, tmp_path):
    small.cycles.samples = SAMPLES
    bright_half(small)
    crown = glass()
    value = crown.node_tree.nodes.new("ShaderNodeValue")
    value.outputs[0].default_value = 1.2
    shader = next(node for node in crown.node_tree.nodes if "IOR" in node.inputs)
    crown.node_tree.links.new(value.outputs[0], shader.inputs["IOR"])
    prism(small, crown)
    expected = [edge_by_snell(index) for index in schott_sf10(NM)]
    np.testing.assert_allclose(visible_edges(rendered(small, tmp_path)[0]), expected, atol=PIXEL)


def test_a_wavelength_outside_the_data_of_the_glass_is_refused(small, tmp_path):
    bright_half(small)
    prism(small, glass("acrylic"))
    with refused(InputError, field="refraction", value="acrylic", where="material 'Glass'",
                 match="acrylic.*390 nm.*400"):
        rendered(small, tmp_path, [390.0, 500.0])


def mirror(node_type, name, **settings):
    new = bpy.data.materials.new("Metal")
    new.use_nodes = True
    tree = new.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(node_type)
    for key, value in settings.items():
        setattr(shader, key, value)
    shader.inputs["Roughness"].default_value = 0
    if "Metallic" in shader.inputs:
        shader.inputs["Metallic"].default_value = 1
    tree.links.new(shader.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    new.lensfield.refraction = name
    return new


def under_flat_sky(scene, metal, tilt_degrees=0.0):
    set_world(scene)
    scene.world.lensfield.emission = FLAT
    wall(scene, metal, 2.0).rotation_euler.y = np.radians(tilt_degrees)


METALS = [("ShaderNodeBsdfMetallic", {"fresnel_type": "PHYSICAL_CONDUCTOR"}),
          ("ShaderNodeBsdfMetallic", {"fresnel_type": "F82"}), ("ShaderNodeBsdfAnisotropic", {}),
          ("ShaderNodeBsdfPrincipled", {})]


def fresnel(name, nm, angle_degrees=0.0):
    """Reflectance of unpolarised light off a metal in air, by Fresnel's equations for a complex index."""
    refraction = load_refraction(name)
    index = refraction.n_at(nm) + 1j * refraction.k_at(nm)
    cosine = np.cos(np.radians(angle_degrees))
    inside = np.sqrt(1 - (1 - cosine**2) / index**2)
    across = abs((cosine - index * inside) / (cosine + index * inside))**2
    along = abs((index * cosine - inside) / (index * cosine + inside))**2
    return (across + along) / 2


@pytest.mark.parametrize("node_type, settings", METALS, ids=lambda value: str(value))
@pytest.mark.parametrize("name", ["gold", "silver", "iron"])
def test_metals_reflect_according_to_their_index(small, tmp_path, node_type, settings, name):
    under_flat_sky(small, mirror(node_type, name, **settings))
    picture, facts = rendered(small, tmp_path)
    measured = picture[:, 4:8, 44:52].mean(axis=(1, 2)) / FLAT_DENSITY
    np.testing.assert_allclose(measured, fresnel(name, NM), rtol=ROUNDING)
    assert facts["passes"] == 1  # metals do not refract


def test_gold_is_gold():
    """Against Babar and Weaver, and common experience: yellow, because it absorbs blue."""
    blue, green, red = fresnel("gold", NM)
    assert 0.35 < blue < 0.45 and 0.7 < green < 0.85 and 0.93 < red < 0.99
    assert min(fresnel("silver", NM)) > 0.93


@pytest.mark.parametrize("tilt_degrees", [45, 70])
def test_physical_conductor_off_the_normal(small, tmp_path, tilt_degrees):
    metal = mirror("ShaderNodeBsdfMetallic", "gold", fresnel_type="PHYSICAL_CONDUCTOR")
    under_flat_sky(small, metal, tilt_degrees)
    measured = rendered(small, tmp_path)[0][:, 4:8, 46:50].mean(axis=(1, 2)) / FLAT_DENSITY
    precision = 1e-3 if bpy.app.version >= (5, 0, 0) else 0.01  # older versions approximate Fresnel's equations
    np.testing.assert_allclose(measured, fresnel("gold", NM, tilt_degrees), rtol=precision)


def test_an_assigned_reflectance_overrides_that_of_the_metal(small, tmp_path):
    metal = mirror("ShaderNodeBsdfPrincipled", "gold")
    metal.lensfield.reflectance = "400:0.5, 700:0.5"
    under_flat_sky(small, metal)
    measured = rendered(small, tmp_path)[0][:, 4:8, 44:52].mean(axis=(1, 2)) / FLAT_DENSITY
    np.testing.assert_allclose(measured, 0.5, rtol=ROUNDING)


def test_glass_keeps_its_colour(small, tmp_path):
    """A refractive index is not a reflectance: coloured glass stays unchanged."""
    small.cycles.samples = SAMPLES
    set_world(small)
    small.world.lensfield.emission = FLAT
    tinted = glass()
    tinted.lensfield.reflectance = "400:0.2, 700:0.8"
    prism(small, tinted)
    measured = rendered(small, tmp_path)[0][:, 4:8, 44:52].mean(axis=(1, 2)) / FLAT_DENSITY
    np.testing.assert_allclose(measured, np.interp(NM, [400, 700], [0.2, 0.8])**2, rtol=0.01)  # on entry and on exit


def test_radiance_stays_absolute_with_lamps_and_glass(small, tmp_path):
    """If each wavelength has a separate pass, a spiky lamp still contributes its means."""
    small.cycles.diffuse_bounces = 0  # light that glass reflects to the wall differs between wavelengths
    light(small, "POINT", 10.0, shadow_soft_size=0.0).data.lensfield.emission = "sodium-lp"
    wall(small, material("White", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0], 1.0)
    aside = prism(small, glass())
    aside.scale, aside.location = (0.01, 0.01, 0.01), (0.05, 0, -0.5)
    nm = np.array([450.0, 500.0, 589.0, 600.0, 650.0])
    picture, facts = rendered(small, tmp_path, nm)
    assert facts["wavelengths_per_pass"] == 1
    measured = picture[:, 4:8, 4:8].mean(axis=(1, 2))
    sodium = load_spectrum("sodium-lp").band_means(nm)
    np.testing.assert_allclose(measured / measured[2], sodium / sodium[2], rtol=ROUNDING, atol=1e-9)
    slope = (COLUMNS / 2 - 6) * PITCH_MM / lens().capture_focal_length_mm  # of the ray to the axis
    assert measured[2] == pytest.approx(10 / (4 * np.pi**2) * sodium[2] / (1 + slope**2)**1.5, rel=1e-3)
