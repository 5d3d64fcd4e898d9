"""Absolute spectral radiance, W m^-2 sr^-1 nm^-1, of each kind of light, to 0.1 %: by closed forms.

A Lambertian wall that receives E watts per square metre from a lamp has L = reflectance E / pi. Each test states
Blender's use of a lamp's watts; the spectrum spreads them over 380 to 780 nm.
"""

import operator
from functools import cache

import bpy
import numpy as np
import pytest
from scipy.integrate import trapezoid

import cycles_pictures
from lenses import make_lens
from lensfield import addon
from lensfield.engine import Options
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.spectra import colour_matching, load_spectrum, reflectance_basis, white_density
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from noise import assert_means
from small_scenes import light, material, set_world, view_factor, wall

NM = np.array([450.0, 550.0, 589.0, 650.0])
WATTS, DISTANCE_M = 100.0, 2.0
SPECTRA = ["380:1, 780:1", "illuminant-a", "sodium-lp"]
FLAT = SPECTRA[0]
BAND_NM = np.linspace(380, 780, 400001)
PRECISION = 1e-3


@pytest.fixture(autouse=True)
def few_pixels(scene):
    scene.render.resolution_x, scene.render.resolution_y = 8, 6


@cache
def narrow_lens():
    """A lens with a view of 1.5 degrees, so that all pixels are the same: to 1e-4, by the cosines about the axis."""
    return make_lens(wavelengths_nm=(380.0, 780.0), sensor_mm=(0.24, 0.18))


def radiance(scene, folder, nm=NM):
    """Spectral radiance: array (wavelength, row, column)."""
    result = addon.render_through_lens(scene, lens=narrow_lens(), wavelengths_nm=nm, output_folder=folder,
                                       spectral=SpectralOptions("reference"), depth="off",
                                       options=Options(detail="off"))
    return read_exr(result.radiance).frame().cube.astype(np.float64)


def density(name, nm=NM):
    """Density of a watt between 380 and 780 nm at these wavelengths, per nm, by brute force.

    Each wavelength represents the interval between its neighbours, weighted towards its own position.
    """
    spectrum = load_spectrum(name)
    power = np.interp(BAND_NM, spectrum.wavelengths_nm, spectrum.values, left=0, right=0)
    power /= trapezoid(power, BAND_NM)
    if name != "sodium-lp":
        return np.interp(nm, BAND_NM, power)
    hats = [np.interp(BAND_NM, nm, unit, left=0, right=0) for unit in np.eye(len(nm))]
    return np.array([trapezoid(power * hat, BAND_NM) / trapezoid(hat, BAND_NM) for hat in hats])


@pytest.fixture
def wall_at(scene):
    """A white wall at DISTANCE_M."""
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0], DISTANCE_M)
    scene.cycles.max_bounces = 0


def check(scene, folder, per_watt, spectrum, watts=WATTS):
    assert_means(radiance(scene, folder), watts * np.multiply.outer(density(spectrum), per_watt), PRECISION)


def lamp(scene, kind, spectrum, **properties):
    new = light(scene, kind, properties.pop("watts", WATTS), **properties)
    new.data.lensfield.emission = spectrum
    return new


@pytest.mark.parametrize("spectrum", SPECTRA)
def test_point(scene, wall_at, tmp_path, spectrum):
    """I = P / 4 pi in all directions, over h^2, and off a wall over pi."""
    lamp(scene, "POINT", spectrum, shadow_soft_size=0.0)
    check(scene, tmp_path, 1 / (4 * np.pi * DISTANCE_M**2) / np.pi, spectrum)


def test_point_with_a_radius(scene, wall_at, tmp_path):
    """A ball of radius r gives E = P / 4 pi h^2 on the axis, like a point."""
    lamp(scene, "POINT", FLAT, shadow_soft_size=0.3, use_soft_falloff=False)
    scene.cycles.samples = 256
    check(scene, tmp_path, 1 / (4 * np.pi * DISTANCE_M**2) / np.pi, FLAT)


@pytest.mark.parametrize("spectrum", SPECTRA)
@pytest.mark.parametrize("cone_degrees", [40, 150])
def test_spot(scene, wall_at, tmp_path, spectrum, cone_degrees):
    """I = P / 4 pi on the axis, independent of the cone."""
    lamp(scene, "SPOT", spectrum, shadow_soft_size=0.0, spot_size=np.radians(cone_degrees), spot_blend=0.0)
    check(scene, tmp_path, 1 / (4 * np.pi * DISTANCE_M**2) / np.pi, spectrum)


@pytest.mark.parametrize("spectrum", SPECTRA)
@pytest.mark.parametrize("shape, area", [("SQUARE", 0.25), ("DISK", 0.25 * np.pi / 4), ("RECTANGLE", 0.125),
                                         ("ELLIPSE", 0.125 * np.pi / 4)])
def test_area_facing_the_camera(scene, tmp_path, spectrum, shape, area):
    """L = P / pi A."""
    facing = lamp(scene, "AREA", spectrum, shape=shape, size=0.5, size_y=0.25)
    facing.location.z, facing.rotation_euler.x, facing.visible_camera = -0.3, np.pi, True
    check(scene, tmp_path, 1 / (np.pi * area), spectrum)


def test_area_on_a_wall(scene, wall_at, tmp_path):
    """On the axis of a disk of radius r, E = pi L r^2 / (r^2 + h^2) with L = P / pi A."""
    radius = 0.01
    lamp(scene, "AREA", FLAT, shape="DISK", size=2 * radius)
    check(scene, tmp_path, 1 / np.pi**2 / (radius**2 + DISTANCE_M**2), FLAT)


@pytest.mark.parametrize("spread_degrees", [90, 30])
def test_an_area_with_a_smaller_spread_keeps_its_power(scene, wall_at, tmp_path, spread_degrees):
    """At an angle a its intensity is 1 - tan(a) / tan(spread / 2), and the rest is brighter to compensate."""
    lamp(scene, "AREA", FLAT, shape="DISK", size=1e-3, spread=np.radians(spread_degrees))
    slope = 1 / np.tan(np.radians(spread_degrees) / 2)
    angle = np.linspace(0, np.radians(spread_degrees) / 2, 100001)
    gain = 0.5 / trapezoid((1 - slope * np.tan(angle)) * np.sin(angle) * np.cos(angle), angle)
    pixel = 0.24 / 8 / narrow_lens().capture_focal_length_mm
    y, x = np.meshgrid((np.arange(6) - 2.5) * pixel, (np.arange(8) - 3.5) * pixel, indexing="ij")
    check(scene, tmp_path, gain * (1 - slope * np.hypot(x, y)) / (np.pi * DISTANCE_M)**2, FLAT)


@pytest.mark.parametrize("spectrum", SPECTRA)
@pytest.mark.parametrize("tilt_degrees, angle_degrees", [(0, 0.0), (60, 0.0), (0, 0.5)])
def test_sun(scene, wall_at, tmp_path, spectrum, tilt_degrees, angle_degrees):
    """E = S cos(tilt)."""
    sun = lamp(scene, "SUN", spectrum, watts=3.0, angle=np.radians(angle_degrees))
    sun.rotation_euler.x = np.radians(tilt_degrees)
    check(scene, tmp_path, np.cos(np.radians(tilt_degrees)) / np.pi, spectrum, watts=3.0)


@pytest.mark.parametrize("spectrum", SPECTRA)
@pytest.mark.parametrize("on_a_wall", [False, True])
def test_world(scene, tmp_path, spectrum, on_a_wall):
    """L = s; and the same off a white wall under it."""
    set_world(scene, strength=2.5)
    scene.world.lensfield.emission = spectrum
    if on_a_wall:
        wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0])
    check(scene, tmp_path, 1.0, spectrum, watts=2.5)


@pytest.mark.parametrize("node_type, strength", [("ShaderNodeEmission", "Strength"),
                                                 ("ShaderNodeBsdfPrincipled", "Emission Strength")])
@pytest.mark.parametrize("spectrum", SPECTRA)
def test_mesh(scene, tmp_path, spectrum, node_type, strength):
    """L = s."""
    glow = bpy.data.materials.new("Glow")
    glow.use_nodes = True
    tree = glow.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(node_type)
    shader.inputs[strength].default_value = 7.0
    tree.links.new(shader.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    glow.lensfield.emission = spectrum
    wall(scene, glow)
    check(scene, tmp_path, 1.0, spectrum, watts=7.0)


def test_mesh_on_a_wall(scene, wall_at, tmp_path):
    """A square behind the camera gives pi L times the share of the wall's hemisphere that it covers."""
    glow, shader = material("Glow", "ShaderNodeEmission")
    shader.inputs["Strength"].default_value = 7.0
    glow.lensfield.emission = "illuminant-a"
    side_m, behind_m = 0.2, 0.5
    wall(scene, glow, -behind_m, side_m)
    check(scene, tmp_path, view_factor(side_m, DISTANCE_M + behind_m), "illuminant-a", watts=7.0)


def test_strengths_multiply(scene, wall_at, tmp_path):
    """Watts, 2^exposure of the lamp and the strength of its nodes."""
    strong = lamp(scene, "POINT", "illuminant-a", shadow_soft_size=0.0).data
    strong.use_nodes = True
    emission = next(node for node in strong.node_tree.nodes if node.bl_idname == "ShaderNodeEmission")
    emission.inputs["Strength"].default_value = 3.0
    factor = 3.0
    if hasattr(strong, "exposure"):
        strong.exposure, factor = 1.5, factor * 2**1.5
    check(scene, tmp_path, factor / (4 * np.pi**2 * DISTANCE_M**2), "illuminant-a")


@pytest.mark.parametrize("colour", [(1.0, 0.5, 0.25), (0.2, 0.6, 0.4)])
def test_colour_multiplies_daylight(scene, wall_at, tmp_path, colour):
    light(scene, "POINT", WATTS, color=colour, shadow_soft_size=0.0)
    expected = WATTS / (4 * np.pi**2 * DISTANCE_M**2) * white_density(NM) * (reflectance_basis(NM) @ colour)
    assert_means(radiance(scene, tmp_path), expected, PRECISION)


def warm_light(scene, kind, temperature_k, unit, **properties):
    if "use_temperature" not in bpy.types.Light.bl_rna.properties:
        pytest.skip("this Blender's lamps have no temperature")
    new = light(scene, kind, WATTS, use_temperature=True, temperature=temperature_k, **properties)
    new.data.lensfield.power_unit = unit
    return new


def test_in_watts_a_temperature_distributes_them_by_plancks_law(scene, wall_at, tmp_path):
    """Unlike in Blender, where a temperature preserves the luminance: watts are watts between 380 and 780 nm."""
    warm_light(scene, "POINT", 3200.0, "WATT", shadow_soft_size=0.0)
    planck = 1 / (BAND_NM**5 * np.expm1(1.438776877e7 / (BAND_NM * 3200)))
    planck /= trapezoid(planck, BAND_NM)
    expected = WATTS / (4 * np.pi**2 * DISTANCE_M**2) * np.interp(NM, BAND_NM, planck)
    assert_means(radiance(scene, tmp_path), expected, PRECISION)


@pytest.mark.parametrize("kind", ["POINT", "SUN"])
@pytest.mark.parametrize("temperature_k", [1800.0, 2800.0, 9000.0])
def test_a_temperature_is_as_bright_as_in_blender(scene, wall_at, tmp_path, kind, temperature_k):
    """Against Cycles' own render, whose colours fit Planck's law to half a per cent."""
    warm_light(scene, kind, temperature_k, "BLENDER", color=(1.0, 0.9, 0.8))
    scene.camera.data.lens = 1000.0  # mm: as narrow as the lens
    of_blender = np.tensordot([0.2126, 0.7152, 0.0722], cycles_pictures.picture(scene, tmp_path), 1).mean()
    nm = np.arange(380.0, 782.5, 5.0)
    of_a_watt = 683 * trapezoid(white_density(nm) * colour_matching(nm)[:, 1], nm)
    assert luminance(scene, tmp_path).mean() / of_a_watt == pytest.approx(of_blender, rel=0.02)


def luminance(scene, folder, step_nm=5.0):
    """cd m^-2: array (row, column)."""
    nm = np.arange(380, 780 + step_nm / 2, step_nm)
    return 683 * trapezoid(radiance(scene, folder, nm) * colour_matching(nm)[:, 1, None, None], nm, axis=0)


LUMENS = [dict(spectrum=FLAT), dict(spectrum="sodium-lp"), dict(spectrum=""), dict(spectrum="", color=(0.1, 0.2, 0.9)),
          dict(spectrum="", use_temperature=True, temperature=2700.0, color=(0.1, 0.8, 0.4)),
          dict(spectrum="illuminant-a", color=(0.1, 0.2, 0.9))]


@pytest.mark.sample(2)
@pytest.mark.parametrize("properties", LUMENS, ids=str)
def test_lumens_of_a_point(scene, wall_at, tmp_path, properties):
    """Phi / 4 pi candela give Phi / 4 pi h^2 lux, and off a white wall 1 / pi of that in cd m^-2."""
    if "use_temperature" in properties and "use_temperature" not in bpy.types.Light.bl_rna.properties:
        pytest.skip("this Blender's lamps have no temperature")
    lumens = 800.0
    data = lamp(scene, "POINT", watts=17.0, shadow_soft_size=0.0, **properties).data
    data.lensfield.power_unit, data.lensfield.lumens = "LUMEN", lumens
    if hasattr(data, "exposure"):
        data.exposure = 2.0  # applies to watts alone
    expected = lumens / (4 * np.pi**2 * DISTANCE_M**2)
    step_nm = 2.5 if data.color[0] < 0.2 else 5.0  # the spectra of saturated colours are steep
    assert_means(luminance(scene, tmp_path, step_nm), expected, PRECISION)


@pytest.mark.every_blender
def test_lumens_of_an_area(scene, tmp_path):
    """M = Phi / A lux leave the lamp: Phi / pi A in cd m^-2."""
    facing = lamp(scene, "AREA", "led-b3", shape="SQUARE", size=0.5)
    facing.location.z, facing.rotation_euler.x, facing.visible_camera = -0.3, np.pi, True
    facing.data.lensfield.power_unit, facing.data.lensfield.lumens = "LUMEN", 800.0
    assert_means(luminance(scene, tmp_path), 800.0 / (np.pi * 0.25), PRECISION)


@pytest.mark.parametrize("normalize", [True, False])
def test_lumens_of_an_area_do_not_depend_on_its_normalisation(scene, tmp_path, normalize):
    facing = lamp(scene, "AREA", "led-b3", shape="SQUARE", size=0.2)
    if not hasattr(facing.data, "normalize"):
        pytest.skip("this Blender's lamps are always normalised")
    facing.location.z, facing.rotation_euler.x, facing.visible_camera = -0.2, np.pi, True
    facing.data.normalize = normalize
    facing.data.lensfield.power_unit, facing.data.lensfield.lumens = "LUMEN", 800.0
    assert_means(luminance(scene, tmp_path), 800.0 / (np.pi * 0.04), PRECISION)


@pytest.mark.parametrize("blend", [0.0, 0.6])
def test_lumens_of_a_spot_are_emitted_into_its_cone(scene, wall_at, tmp_path, blend):
    """Integrated by hand over the cosine, from the rim to the axis, with Cycles' smoothstep at the rim."""
    lumens, half_angle = 1000.0, 0.45
    data = lamp(scene, "SPOT", FLAT, spot_size=2 * half_angle, spot_blend=blend, shadow_soft_size=0.0).data
    data.lensfield.power_unit, data.lensfield.lumens = "LUMEN", lumens
    cosine = np.linspace(np.cos(half_angle), 1, 20001)
    u = (cosine - cosine[0]) / (1 - cosine[0]) / max(blend, 1e-9)
    share = np.where(u < 1, u**2 * (3 - 2 * u), 1)
    candela = lumens / (2 * np.pi * trapezoid(share, cosine))
    assert_means(luminance(scene, tmp_path), candela / DISTANCE_M**2 / np.pi, PRECISION)


@pytest.mark.every_blender
def test_lux_of_a_sun(scene, wall_at, tmp_path):
    sun = lamp(scene, "SUN", "", angle=0.0).data
    sun.lensfield.power_unit, sun.lensfield.lumens = "LUMEN", 100000.0
    assert_means(luminance(scene, tmp_path), 100000.0 / np.pi, PRECISION)


@pytest.mark.parametrize("owner, name, value", [
    ("cycles", "film_exposure", 2.5), ("view_settings", "exposure", 3.0),
    ("view_settings", "gamma", 2.0), ("view_settings", "view_transform", "Standard"),
    ("unit_settings", "scale_length", 0.001), ("cycles", "sample_clamp_direct", 0.001),
    ("cycles", "sample_clamp_indirect", 0.001), ("render", "filter_size", 5.0),
    ("cycles", "pixel_filter_type", "BLACKMAN_HARRIS"),
    ("render", "resolution_percentage", 75),
    ("render", "use_motion_blur", True), ("render", "dither_intensity", 2.0),
    ("render.image_settings", "color_mode", "BW"), ("cycles", "use_denoising", True),
    ("cycles", "use_fast_gi", True), ("cycles", "use_light_tree", False),
    ("render", "use_simplify", True), ("cycles", "use_adaptive_sampling", True)])
def test_render_settings_do_not_change_the_radiance(scene, wall_at, tmp_path, owner, name, value):
    scene.cycles.max_bounces = 2
    lamp(scene, "POINT", FLAT, shadow_soft_size=0.0)
    set_world(scene, strength=0.5)
    scene.world.lensfield.emission = FLAT
    setattr(operator.attrgetter(owner)(scene), name, value)
    expected = (WATTS / (4 * np.pi**2 * DISTANCE_M**2) + 0.5) / 400
    assert_means(radiance(scene, tmp_path), expected, PRECISION)


def test_a_black_lamp_in_lumens_is_refused_in_one_line(scene, wall_at, tmp_path):
    data = lamp(scene, "POINT", "", color=(0, 0, 0)).data
    data.lensfield.power_unit = "LUMEN"
    with pytest.raises(ValueError, match="light 'Light': color is black: choose another colour"):
        radiance(scene, tmp_path)
