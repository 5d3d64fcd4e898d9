"""A wavelength's plane is independent of the other wavelengths in its pass, for every kind of shader.

Three wavelengths are rendered in several combinations: together; each in another channel, with other wavelengths; and
each alone, with three identical channels, which cannot mix. The planes must be the same, pixel by pixel. If a shader
chooses randomly between lobes, or between channels as volumes and subsurface scattering do, all channels together
determine the choice: then the noise differs, and only means over the picture must be the same, within one per cent.
Cycles' Filter Glossy depends on that choice, and its sampling of principled hair is approximate.

Exceptions, where channels do interact, are also tested below, by Cycles alone, to detect changes in Blender.
"""

from dataclasses import dataclass, field

import bpy
import numpy as np
import OpenEXR
import pytest

from lenses import make_lens
from lensfield import addon
from lensfield.engine import Options
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from noise import assert_means, surely_apart
from small_scenes import set_world

TOGETHER_NM = [450, 550, 650]
COMPANIONS_NM = {450: [400, 450, 500], 550: [550, 600, 680], 650: [520, 650, 700]}  # in green, blue and green
STRONG_COLOUR = (0.9, 0.35, 0.08)
ONLY_ITS_BLUE = STRONG_COLOUR[2:] * 3
OTHER_COLOUR = (0.1, 0.5, 0.8)
FILTER_GLOSSY = 5.0  # more than usual: 1 is Blender's default
EXACT = 1e-5  # of a pixel and of the mean radiance: 160 operations with errors of 2^-24, all in one direction
COUPLED = 0.01  # of the mean radiance: larger systematic differences are coupling; 5 sigma of noise are less


@dataclass(frozen=True)
class Kind:
    """A shader with some inputs and properties set, and enough samples to make its noise small."""

    name: str
    node_type: str
    inputs: dict = field(default_factory=dict)
    properties: dict = field(default_factory=dict)
    output: str = "Surface"
    samples: int = 64


def principled(name, samples=64, **inputs):
    """A principled shader with a strong base colour; inputs by their names, with _ for a space."""
    settings = {"Base Color": STRONG_COLOUR} | {key.replace("_", " "): value for key, value in inputs.items()}
    return Kind(f"principled, {name}", "ShaderNodeBsdfPrincipled", settings, samples=samples)


def coloured(name, node_type, output="Surface", properties=None, samples=64, **inputs):
    settings = {"Color": STRONG_COLOUR} | {key.replace("_", " "): value for key, value in inputs.items()}
    return Kind(name, node_type, settings, properties or {}, output, samples)


EXACT_KINDS = [
    coloured("diffuse", "ShaderNodeBsdfDiffuse"),
    coloured("diffuse, rough", "ShaderNodeBsdfDiffuse", Roughness=0.7),
    coloured("glossy", "ShaderNodeBsdfAnisotropic", Roughness=0.3),
    coloured("glossy, anisotropic", "ShaderNodeBsdfAnisotropic", Roughness=0.3, Anisotropy=0.6),
    Kind("metallic, F82", "ShaderNodeBsdfMetallic", {"Base Color": STRONG_COLOUR, "Edge Tint": OTHER_COLOUR},
         {"fresnel_type": "F82"}),
    Kind("metallic, conductor", "ShaderNodeBsdfMetallic", {"IOR": (0.2, 0.9, 1.4), "Extinction": (3.9, 2.5, 1.8)},
         {"fresnel_type": "PHYSICAL_CONDUCTOR"}),
    coloured("glass", "ShaderNodeBsdfGlass", Roughness=0.2),
    coloured("refraction", "ShaderNodeBsdfRefraction", Roughness=0.2),
    coloured("translucent", "ShaderNodeBsdfTranslucent"),
    coloured("transparent", "ShaderNodeBsdfTransparent"),
    coloured("sheen", "ShaderNodeBsdfSheen"),
    coloured("sheen, Ashikhmin", "ShaderNodeBsdfSheen", properties={"distribution": "ASHIKHMIN"}),
    coloured("toon", "ShaderNodeBsdfToon", Size=0.6, Smooth=0.3),
    coloured("toon, glossy", "ShaderNodeBsdfToon", properties={"component": "GLOSSY"}, Size=0.6, Smooth=0.3),
    coloured("hair, reflection", "ShaderNodeBsdfHair"),
    coloured("hair, transmission", "ShaderNodeBsdfHair", properties={"component": "Transmission"}),
    principled("metallic", Metallic=1.0, Roughness=0.3),
    coloured("volume absorption", "ShaderNodeVolumeAbsorption", output="Volume", Density=2.0),
]
NOISY_KINDS = [
    coloured("emission", "ShaderNodeEmission"),
    coloured("subsurface scattering", "ShaderNodeSubsurfaceScattering", samples=400, Scale=0.2, Radius=(1, 0.3, 0.1)),
    coloured("hair, principled", "ShaderNodeBsdfHairPrincipled", samples=256, properties={"model": "CHIANG"}),
    coloured("hair, principled, Huang", "ShaderNodeBsdfHairPrincipled", samples=128, properties={"model": "HUANG"}),
    Kind("hair, principled, absorption", "ShaderNodeBsdfHairPrincipled",
         {"Absorption Coefficient": (0.2, 0.5, 1.5)}, {"model": "CHIANG", "parametrization": "ABSORPTION"},
         samples=320),
    principled("base"),
    principled("metallic and diffuse", Metallic=0.5),
    principled("specular", Specular_IOR_Level=1.0, Roughness=0.2),
    principled("transmission", samples=256, Transmission_Weight=1.0, Roughness=0.2),
    principled("subsurface", samples=400, Subsurface_Weight=1.0, Subsurface_Scale=0.2, Subsurface_Radius=(1, 0.3, 0.1)),
    principled("coat", Coat_Weight=1.0, Coat_Roughness=0.1),
    principled("tinted coat", Coat_Weight=1.0, Coat_Roughness=0.1, Coat_Tint=OTHER_COLOUR),
    principled("white sheen", Sheen_Weight=1.0),
    principled("emission", Emission_Color=OTHER_COLOUR, Emission_Strength=0.5),
    principled("alpha", samples=128, Alpha=0.5),
    coloured("volume scatter", "ShaderNodeVolumeScatter", output="Volume", samples=400, Density=2.0),
    Kind("volume, principled", "ShaderNodeVolumePrincipled",
         {"Color": STRONG_COLOUR, "Absorption Color": OTHER_COLOUR, "Density": 2.0, "Emission Color": OTHER_COLOUR,
          "Emission Strength": 0.1}, output="Volume", samples=320),
    Kind("volume coefficients", "ShaderNodeVolumeCoefficients",
         {"Absorption Coefficients": (0.2, 0.5, 1.5), "Scatter Coefficients": (1.5, 0.8, 0.3)}, output="Volume",
         samples=256),
]


@pytest.mark.sample(5)
@pytest.mark.parametrize("kind", EXACT_KINDS, ids=lambda kind: kind.name)
def test_other_wavelengths_in_a_pass_change_no_pixel(scene, tmp_path, kind):
    furnish(scene, kind)
    scene.cycles.samples = 8  # the noise is identical here
    alone, *companies = in_companies(scene, tmp_path)
    for planes in companies:
        np.testing.assert_allclose(planes, alone, rtol=EXACT, atol=EXACT * alone.mean())


@pytest.mark.sample(4)
@pytest.mark.parametrize("kind", NOISY_KINDS, ids=lambda kind: kind.name)
def test_other_wavelengths_in_a_pass_change_only_the_noise(scene, tmp_path, kind):
    furnish(scene, kind)
    alone, *companies = in_companies(scene, tmp_path)
    for planes in companies:
        assert_means(planes, alone, rtol=COUPLED, noise=COUPLED)


def test_filter_glossy_was_on_in_the_tests_above(scene, tmp_path):
    """It roughens glossy lobes after a bounce by the probability of the path, which depends on all channels."""
    furnish(scene, principled("glass", samples=4, Transmission_Weight=1.0, Roughness=0.2))
    blurred = radiance(scene, tmp_path, TOGETHER_NM)
    scene.cycles.blur_glossy = 0.0
    assert np.any(radiance(scene, tmp_path, TOGETHER_NM) != blurred)


@pytest.mark.every_blender
def test_planes_of_a_coloured_ball_differ_between_wavelengths(scene, tmp_path):
    """If all planes were equal, the tests above would prove nothing."""
    furnish(scene, EXACT_KINDS[0])
    blue, green, red = radiance(scene, tmp_path, TOGETHER_NM)[:, 6:12, 9:15].mean(axis=(1, 2))
    assert green > 1.1 * blue and red > 1.5 * green


@pytest.mark.parametrize("tint, lobe", [("Specular Tint", {"Specular IOR Level": 1.0}),
                                        ("Sheen Tint", {"Sheen Weight": 1.0})])
def test_coloured_tints_couple_channels(scene, tmp_path, tint, lobe):
    """The brightest channel of a lobe's tint determines the light that reaches the lobes below."""
    grey = lobe | {"Base Color": (0.5, 0.5, 0.5)}
    coupled, alone = (blue_of(scene, tmp_path, grey | {tint: colour}) for colour in (STRONG_COLOUR, ONLY_ITS_BLUE))
    assert surely_apart(coupled, alone) > COUPLED * alone.mean()


@pytest.mark.parametrize("colour, lobe", [("Base Color", {}), ("Coat Tint", {"Coat Weight": 1.0})])
def test_other_coloured_inputs_do_not_couple_channels(scene, tmp_path, colour, lobe):
    grey = lobe | {"Base Color": (0.5, 0.5, 0.5)}
    coupled, alone = (blue_of(scene, tmp_path, grey | {colour: value}) for value in (STRONG_COLOUR, ONLY_ITS_BLUE))
    assert_means(coupled, alone, rtol=COUPLED, noise=COUPLED)


@pytest.mark.parametrize("kind", [
    Kind("thin film", "ShaderNodeBsdfPrincipled",
         {"Base Color": (0, 0, 0), "Thin Film Thickness": 400.0, "Thin Film IOR": 1.8}),
    Kind("melanin", "ShaderNodeBsdfHairPrincipled", {"Melanin": 0.5, "Tint": (1, 1, 1)},
         {"model": "CHIANG", "parametrization": "MELANIN"}),
    Kind("blackbody", "ShaderNodeVolumePrincipled",
         {"Color": (0.5, 0.5, 0.5), "Blackbody Intensity": 1.0, "Temperature": 1500.0}, output="Volume"),
], ids=lambda kind: kind.name)
def test_shaders_with_built_in_red_green_and_blue_colour_a_grey_scene(scene, tmp_path, kind):
    furnish(scene, kind, wall_colour=(0.5, 0.5, 0.5))
    red, green, blue = rgb(scene, tmp_path)
    assert max(surely_apart(green, red), surely_apart(blue, red)) > COUPLED * red.mean()


def in_companies(scene, folder):
    """The planes of TOGETHER_NM: each alone, together, and in other channels with other wavelengths."""
    alone = [radiance(scene, folder, [each])[0] for each in TOGETHER_NM]
    shifted = [radiance(scene, folder, COMPANIONS_NM[each])[COMPANIONS_NM[each].index(each)] for each in TOGETHER_NM]
    return np.stack(alone), radiance(scene, folder, TOGETHER_NM), np.stack(shifted)


def furnish(scene, kind, wall_colour=OTHER_COLOUR):
    """A ball with the shader in front of a coloured wall, under a grey sky and a white lamp."""
    scene.cycles.samples = kind.samples
    scene.cycles.max_bounces = 8
    # By default, Cycles ends paths at random by their brightest channel.
    scene.cycles.min_light_bounces = scene.cycles.min_transparent_bounces = 8
    scene.cycles.light_sampling_threshold = 0
    scene.cycles.blur_glossy = FILTER_GLOSSY
    scene.render.resolution_x, scene.render.resolution_y = 24, 18
    set_world(scene, strength=1.0)
    scene.world.lensfield.emission = "380:1, 780:1"
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.3, location=(0, 0, -1.2))
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(material_of(kind))
    wall = Kind("wall", "ShaderNodeBsdfDiffuse", {"Color": wall_colour})
    bpy.ops.mesh.primitive_plane_add(size=4, location=(0, 0, -2))
    bpy.context.object.data.materials.append(material_of(wall))
    bpy.ops.object.light_add(type="AREA", location=(0.6, 0.6, -0.6), rotation=(-0.7, 0.7, 0))
    bpy.context.object.data.energy = 5
    bpy.context.object.data.size = 1.0


def material_of(kind):
    material = bpy.data.materials.new(kind.name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(kind.node_type)
    for name, value in kind.properties.items():
        setattr(shader, name, value)
    for name, value in kind.inputs.items():
        socket = shader.inputs[name]
        socket.default_value = (*value, 1) if socket.type == "RGBA" else value
    tree.links.new(shader.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs[kind.output])
    return material


def radiance(scene, folder, wavelengths_nm):
    """Spectral radiance by the add-on, (wavelength, row, column); with a simple lens, to save time."""
    every_wavelength = SpectralOptions(tier="reference")
    result = addon.render_through_lens(scene, lens=make_lens(), wavelengths_nm=wavelengths_nm, output_folder=folder,
                                       spectral=every_wavelength, depth="off", options=Options(detail="off"))
    return read_exr(result.radiance).cube.astype(np.float64)


def blue_of(scene, folder, inputs):
    """The blue channel of a picture of a principled ball, by Cycles alone."""
    for left_over in list(scene.collection.objects):
        if left_over.type != "CAMERA":
            bpy.data.objects.remove(left_over)
    furnish(scene, Kind("tinted", "ShaderNodeBsdfPrincipled", inputs))
    return rgb(scene, folder)[2]


def rgb(scene, folder):
    """A render by Cycles without the add-on: float64 array (channel, row, column)."""
    scene.cycles.use_denoising = False  # uses all channels at once,
    scene.cycles.sample_clamp_indirect = 0  # and clamping uses their sum: both would couple them
    path = folder / "plain.exr"
    image = scene.render.image_settings
    image.file_format, image.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True, scene=scene.name)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return np.stack([file.parts[0].channels[name].pixels for name in "RGB"]).astype(np.float64)
