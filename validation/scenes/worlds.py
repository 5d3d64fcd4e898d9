"""Worlds: flat, images, skies, gradients, volumes, and what light paths make of them."""

from math import radians

import bpy
import numpy as np

from .kit import background, image, keyed, ordinary, shaded, world_from

SKY_STRENGTH = 0.05


@ordinary()
def flat_world(stage):
    """A flat world alone, without lamps"""
    stage.remove(stage.lamp)
    background(stage.world).inputs["Strength"].default_value = 0.8


@ordinary()
def no_world(stage):
    """A scene without a world"""
    stage.scene.world = None


@ordinary()
def black_world(stage):
    """A world of strength 0"""
    background(stage.world).inputs["Strength"].default_value = 0


@ordinary()
def world_without_nodes(stage):
    """A world that has never been opened in the shader editor"""
    stage.scene.world = world = bpy.data.worlds.new("Plain")
    world.color = 0.2, 0.15, 0.1


def panorama(rows=32):
    """Pixels of a room: a bright window, a warm lamp, blue above and brown below."""
    row, column = np.indices((rows, 2 * rows)) / rows
    pixels = np.where((row > 0.5)[..., None], (0.3, 0.4, 0.7), (0.25, 0.18, 0.12)) * (0.6 + 0.4 * row[..., None])
    pixels[(row > 0.55) & (row < 0.75) & (column > 0.8) & (column < 1.05)] = 5, 5, 4.6
    pixels[(row > 0.6) & (row < 0.7) & (column > 1.6) & (column < 1.68)] = 14, 8, 3
    return pixels


def add_panorama(stage, strength=0.6):
    """Light the world by an HDRI; returns its node."""
    tree = stage.world.node_tree
    node = tree.nodes.new("ShaderNodeTexEnvironment")
    node.image = image("room.exr", panorama(), "Linear Rec.709", stage.folder / "room.exr", is_float=True)
    world_from(stage.world, node, strength)
    return node


@ordinary()
def hdri(stage):
    """An HDRI from a file, turned about the vertical"""
    stage.remove(stage.lamp)
    tree, node = stage.world.node_tree, add_panorama(stage)
    mapping, place = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
    mapping.inputs["Rotation"].default_value[2] = radians(70)
    tree.links.new(place.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], node.inputs["Vector"])


@ordinary()
def hdri_mirror_ball(stage):
    """An HDRI in the mirror-ball projection"""
    node = add_panorama(stage, 0.4)
    node.projection = "MIRROR_BALL"


@ordinary()
def hdri_with_another_backdrop(stage):
    """An HDRI that lights the scene, in front of a plain colour for the camera (Light Path: Is Camera Ray)"""
    tree, shader = stage.world.node_tree, background(stage.world)
    add_panorama(stage)
    backdrop, mix, path = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Background", "MixShader", "LightPath"))
    backdrop.inputs["Color"].default_value = 0.1, 0.12, 0.15, 1
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputWorld")
    for source, sink in ((path.outputs["Is Camera Ray"], mix.inputs[0]), (shader.outputs[0], mix.inputs[1]),
                         (backdrop.outputs[0], mix.inputs[2]), (mix.outputs[0], output.inputs["Surface"])):
        tree.links.new(source, sink)


def _sky(stage, kind, strength=SKY_STRENGTH, **values):
    node = stage.world.node_tree.nodes.new("ShaderNodeTexSky")
    node.sky_type = kind
    for name, value in values.items():
        setattr(node, name, value)
    stage.remove(stage.lamp)
    world_from(stage.world, node, strength)


def sky_kinds():
    """Names of the sky models of this Blender."""
    return tuple(bpy.types.ShaderNodeTexSky.bl_rna.properties["sky_type"].enum_items.keys())


@ordinary()
def sky_with_sun(stage):
    """The newest physical sky, with its sun disc"""
    kind = "MULTIPLE_SCATTERING" if "MULTIPLE_SCATTERING" in sky_kinds() else "NISHITA"
    _sky(stage, kind, 0.02, sun_elevation=radians(25), sun_rotation=radians(130), sun_size=radians(4))


@ordinary()
def sky_single_scattering(stage):
    """The physical sky of single scattering, without a sun disc"""
    kind = "SINGLE_SCATTERING" if "SINGLE_SCATTERING" in sky_kinds() else "NISHITA"
    _sky(stage, kind, sun_disc=False, sun_elevation=radians(12))


@ordinary()
def sky_preetham(stage):
    """Preetham's sky"""
    _sky(stage, "PREETHAM", 0.08, turbidity=3.0, sun_direction=(0.4, 0.5, 0.6))


@ordinary()
def sky_hosek_wilkie(stage):
    """Hosek and Wilkie's sky"""
    _sky(stage, "HOSEK_WILKIE", 0.3, turbidity=4.0, ground_albedo=0.4, sun_direction=(-0.5, 0.4, 0.5))


@ordinary()
def gradient_world(stage):
    """A gradient from the horizon up, through a ramp"""
    tree = stage.world.node_tree
    place, parts, ramp = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "SeparateXYZ", "ValToRGB"))
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (0.8, 0.45, 0.25, 1), (0.1, 0.2, 0.5, 1)
    tree.links.new(place.outputs["Generated"], parts.inputs[0])
    tree.links.new(parts.outputs["Z"], ramp.inputs[0])
    world_from(stage.world, ramp)


@ordinary()
def noise_world(stage):
    """A world of procedural clouds, which does not change with the frame"""
    node = stage.world.node_tree.nodes.new("ShaderNodeTexNoise")
    node.inputs["Scale"].default_value = 3
    world_from(stage.world, node, 0.7, socket="Color" if "Color" in node.outputs else 1)


@ordinary()
def world_volume(stage):
    """Thin haze in the whole world"""
    tree = stage.world.node_tree
    node = tree.nodes.new("ShaderNodeVolumePrincipled")
    node.inputs["Density"].default_value = 0.15
    output = next(each for each in tree.nodes if each.bl_idname == "ShaderNodeOutputWorld")
    tree.links.new(node.outputs[0], output.inputs["Volume"])


@ordinary()
def world_volume_barely(stage):
    """A world volume that no one can see (density 1e-6), with lamps out of focus in front of the sky"""
    tree = stage.world.node_tree
    node = tree.nodes.new("ShaderNodeVolumeScatter")
    node.inputs["Density"].default_value = 1e-6
    output = next(each for each in tree.nodes if each.bl_idname == "ShaderNodeOutputWorld")
    tree.links.new(node.outputs[0], output.inputs["Volume"])


@ordinary()
def world_hidden_from_camera(stage):
    """A world that the camera does not see (Ray Visibility: Camera off)"""
    stage.world.cycles_visibility.camera = False


@ordinary()
def world_hidden_from_glossy(stage):
    """A world that mirrors do not show"""
    stage.world.cycles_visibility.glossy = False
    stage.ball.data.materials[0] = shaded("Mirror", "ShaderNodeBsdfAnisotropic", Roughness=0.05)[0]


@ordinary()
def keyframed_world(stage):
    """A world whose strength is keyframed, at frame 7"""
    keyed(background(stage.world).inputs["Strength"], "default_value", {1: 0.2, 11: 1.2})
    stage.scene.frame_set(7)


@ordinary()
def world_ambient_occlusion(stage):
    """Fast global illumination: the bounces of the world are replaced by ambient occlusion"""
    stage.scene.cycles.use_fast_gi, stage.scene.cycles.fast_gi_method = True, "REPLACE"
    stage.scene.cycles.ao_bounces = stage.scene.cycles.ao_bounces_render = 1
    stage.world.light_settings.distance = 0.5


@ordinary()
def world_window_texture(stage):
    """A backplate of camera rays, by Texture Coordinate: Window"""
    tree, shader = stage.world.node_tree, background(stage.world)
    backdrop, mix, path, place, picture = (tree.nodes.new(f"ShaderNode{kind}") for kind in (
        "Background", "MixShader", "LightPath", "TexCoord", "TexImage"))
    rows, columns = np.indices((64, 96))
    picture.image = image("plate.png", np.stack([(rows // 8 + columns // 8) % 2 * 0.6 + 0.1, rows / 90, columns / 140],
                                                axis=-1))
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputWorld")
    for source, sink in ((place.outputs["Window"], picture.inputs["Vector"]),
                         (picture.outputs[0], backdrop.inputs["Color"]), (path.outputs["Is Camera Ray"], mix.inputs[0]),
                         (shader.outputs[0], mix.inputs[1]), (backdrop.outputs[0], mix.inputs[2]),
                         (mix.outputs[0], output.inputs["Surface"])):
        tree.links.new(source, sink)
