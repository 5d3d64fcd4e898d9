"""Lamps: kinds, sizes, colours, shapes, textures, and light linking."""

from math import radians

import bpy
import numpy as np

from .kit import (
    background,
    box,
    checks,
    collection,
    glowing,
    image,
    look_at,
    node_for,
    ordinary,
    painted,
    plane,
    sphere,
)

WARM_BLUE = 9.7
"""CIEDE2000 between the blue paint's spectrum in the light of 2800 K and the product of red, green and blue."""
RED_BLUE = 2.0
"""The same in equal light of the red lamp and of the world; in that of the lamp alone it is 3.4."""
IES = """IESNA:LM-63-2002
[TEST] narrow downlight
TILT=NONE
1 1000 1 7 1 1 2 0 0 0
1 1 100
0 15 30 45 60 75 90
0
1000 800 300 120 60 20 0
"""


def _night(stage, strength=0.15):
    background(stage.world).inputs["Strength"].default_value = strength


def _lamp(stage, kind, energy, place=(-0.5, -0.5, 0.9), **values):
    """Replace the key lamp; returns the lamp's data."""
    stage.remove(stage.lamp)
    lamp = stage.link("Lamp", bpy.data.lights.new("Lamp", kind), place)
    look_at(lamp, (0, 0.05, 0.05))
    lamp.data.energy = energy
    for name, value in values.items():
        setattr(lamp.data, name, value)
    return lamp.data


@ordinary()
def sun(stage):
    """A warm sun of half a degree"""
    _lamp(stage, "SUN", 3.0, color=(1, 0.85, 0.65), angle=radians(0.5))


@ordinary()
def sun_without_size(stage):
    """A sun of angle 0, whose shadows are sharp"""
    _lamp(stage, "SUN", 2.5, angle=0.0)


@ordinary()
def point_lamp(stage):
    """A point lamp with a soft radius, from watts"""
    _night(stage)
    _lamp(stage, "POINT", 12, shadow_soft_size=0.08, color=(1, 0.7, 0.4))


@ordinary()
def point_lamp_without_size(stage):
    """A point lamp of radius 0"""
    _night(stage)
    _lamp(stage, "POINT", 10, shadow_soft_size=0.0)


@ordinary()
def spot(stage):
    """A spot with a blend, in a dim room"""
    _night(stage)
    _lamp(stage, "SPOT", 40, spot_size=radians(38), spot_blend=0.4, shadow_soft_size=0.02)


@ordinary()
def square_spot(stage):
    """A square spot that projects an image (Texture Coordinate: Normal)"""
    _night(stage)
    lamp = _lamp(stage, "SPOT", 60, spot_size=radians(50), use_square=True, shadow_soft_size=0.0)
    lamp.use_nodes = True
    tree = lamp.node_tree
    emission = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeEmission")
    place, mapping, picture = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "Mapping", "TexImage"))
    picture.image, picture.extension = image("slide.png", checks()), "REPEAT"
    tree.links.new(place.outputs["Normal"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], picture.inputs["Vector"])
    tree.links.new(picture.outputs[0], emission.inputs["Color"])


@ordinary()
def area_disk(stage):
    """A disk lamp with a narrow spread"""
    _night(stage)
    _lamp(stage, "AREA", 14, shape="DISK", size=0.25, spread=radians(60))


@ordinary()
def area_rectangle(stage):
    """A long strip light in view of a glossy ball"""
    _night(stage)
    _lamp(stage, "AREA", 10, (-0.5, -0.2, 0.6), shape="RECTANGLE", size=0.8, size_y=0.08)
    stage.ball.data.materials[0] = painted("Polished", (0.1, 0.1, 0.1), 0.08)


@ordinary()
def area_textured(stage):
    """A soft box with a pattern of nodes on it, which glass shows"""
    _night(stage)
    lamp = _lamp(stage, "AREA", 20, size=0.5)
    lamp.use_nodes = True
    tree = lamp.node_tree
    emission = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeEmission")
    place, picture = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeTexImage")
    picture.image = image("gel.png", checks(first=(0.9, 0.5, 0.3), second=(0.3, 0.4, 0.8)))
    tree.links.new(place.outputs["Parametric"], picture.inputs["Vector"])
    tree.links.new(picture.outputs[0], emission.inputs["Color"])


@ordinary()
def ies_lamp(stage):
    """A lamp with an IES file"""
    _night(stage)
    path = stage.folder / "lamp.ies"
    path.write_text(IES)
    lamp = _lamp(stage, "POINT", 5, (-0.2, 0.1, 0.9), shadow_soft_size=0.01)
    lamp.use_nodes = True
    tree = lamp.node_tree
    emission = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeEmission")
    node = tree.nodes.new("ShaderNodeTexIES")
    node.mode, node.filepath = "EXTERNAL", str(path)
    tree.links.new(node.outputs[0], emission.inputs["Strength"])


@ordinary()
def portal(stage):
    """A room with a window, and a portal in it"""
    stage.remove(stage.lamp)
    walls = painted("Wall", (0.7, 0.66, 0.6))
    for name, sides, place in (("Back", (3, 0.02, 1.4), (0, 1.1, 0.7)), ("Right", (0.02, 3, 1.4), (1, 0, 0.7)),
                               ("Ceiling", (3, 3.4, 0.02), (0, 0, 1.4)), ("Front", (3, 0.02, 1.4), (0, -1.6, 0.7)),
                               ("Left", (0.02, 1.2, 1.4), (-1, -1, 0.7)),
                               ("Far Left", (0.02, 1.2, 1.4), (-1, 1.0, 0.7))):
        stage.link(name, box(sides, walls, name), place)
    background(stage.world).inputs["Strength"].default_value = 3
    window = stage.link("Portal", bpy.data.lights.new("Portal", "AREA"), (-1, 0, 0.7))
    window.rotation_euler = 0, -radians(90), 0
    window.data.shape, window.data.size, window.data.size_y = "RECTANGLE", 1.4, 0.8
    window.data.cycles.is_portal = True


@ordinary(colour=1.5, paint=WARM_BLUE)
def lamp_temperature(stage):
    """A lamp of 2800 K by its Temperature"""
    _night(stage)
    lamp = _lamp(stage, "AREA", 12, size=0.3)
    if hasattr(lamp, "use_temperature"):  # added in 4.5
        lamp.use_temperature, lamp.temperature = True, 2800


@ordinary(colour=1.5, paint=WARM_BLUE)
def lamp_blackbody(stage):
    """A lamp of 2800 K by a Blackbody node"""
    _night(stage)
    lamp = _lamp(stage, "AREA", 12, size=0.3)
    lamp.use_nodes = True
    tree = lamp.node_tree
    node, emission = tree.nodes.new("ShaderNodeBlackbody"), next(
        node for node in tree.nodes if node.bl_idname == "ShaderNodeEmission")
    node.inputs[0].default_value = 2800
    tree.links.new(node.outputs[0], emission.inputs["Color"])


@ordinary()
def lamp_exposure(stage):
    """A lamp by exposure, without normalisation"""
    lamp = _lamp(stage, "AREA", 4, size=0.3)
    for name, value in (("exposure", 1.0), ("normalize", False)):
        if hasattr(lamp, name):
            setattr(lamp, name, value)
    if not getattr(lamp, "normalize", True):
        lamp.energy = 40


@ordinary()
def light_falloff(stage):
    """A lamp with linear falloff by nodes"""
    _night(stage)
    lamp = _lamp(stage, "POINT", 8, shadow_soft_size=0.05)
    lamp.use_nodes = True
    tree = lamp.node_tree
    node, emission = tree.nodes.new("ShaderNodeLightFalloff"), next(
        node for node in tree.nodes if node.bl_idname == "ShaderNodeEmission")
    node.inputs["Strength"].default_value = 1.0
    tree.links.new(node.outputs["Linear"], emission.inputs["Strength"])


@ordinary()
def light_linking(stage):
    """A red lamp that lights the ball alone"""
    _red(stage).light_linking.receiver_collection = _only(stage, "Receivers")


@ordinary(paint=RED_BLUE)
def shadow_linking(stage):
    """A red lamp that only the ball blocks"""
    _red(stage).light_linking.blocker_collection = _only(stage, "Blockers")


def _red(stage):
    lamp = stage.link("Red", bpy.data.lights.new("Red", "AREA"), (0.7, -0.6, 0.8))
    lamp.data.energy, lamp.data.color, lamp.data.size = 12, (1, 0.15, 0.1), 0.2
    look_at(lamp, (0, 0, 0.1))
    return lamp


def _only(stage, name):
    only = bpy.data.collections.new(name)
    only.objects.link(stage.ball)
    return only


@ordinary()
def lamp_without_shadow(stage):
    """A fill lamp without shadows"""
    stage.lamp.data.use_shadow = False


@ordinary()
def lamp_hidden_from_glossy(stage):
    """A lamp without highlights (Ray Visibility: Glossy off)"""
    stage.lamp.visible_glossy = False
    stage.ball.data.materials[0] = painted("Polished", (0.4, 0.05, 0.05), 0.15)


@ordinary()
def mesh_lamp(stage):
    """A glowing tube instead of lamps"""
    _night(stage)
    stage.remove(stage.lamp)
    stage.link("Tube", box((0.6, 0.03, 0.03), glowing("Tube", (0.6, 0.8, 1), 25)), (-0.15, 0.2, 0.5))


@ordinary()
def emission_texture(stage):
    """A screen: emission by an image"""
    _night(stage)
    screen = painted("Screen", (0.02, 0.02, 0.02))
    node_for(screen, "ShaderNodeTexImage", "Emission Color").image = image("screen.png", checks(6, 8))
    screen.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 3
    wall = stage.link("Screen", plane(0.2, screen), (0.2, 0.25, 0.24))
    wall.rotation_euler.x = radians(90)


@ordinary()
def many_lamps(stage):
    """Forty small coloured lamps, with the light tree"""
    _night(stage, 0.05)
    stage.remove(stage.lamp)
    rng = np.random.default_rng(3)
    for number in range(40):
        lamp = stage.link(f"Lamp {number}", bpy.data.lights.new(f"Lamp {number}", "POINT"),
                          rng.uniform((-0.7, -0.5, 0.3), (0.7, 0.7, 0.8)))
        lamp.data.energy, lamp.data.shadow_soft_size = 0.4, 0.06
        lamp.data.color = rng.uniform(0.2, 1, 3)


@ordinary(paint=RED_BLUE)
def without_light_tree(stage):
    """Two lamps without the light tree, with a light threshold"""
    stage.scene.cycles.use_light_tree = False
    stage.scene.cycles.light_sampling_threshold = 0.01
    _red(stage)


@ordinary()
def distant_small_lamps(stage):
    """Small lamps on a black world, far behind the plane of focus"""
    stage.scene.world = None
    stage.remove(stage.lamp, stage.floor, stage.cone)
    stage.scene.cycles.samples *= 4  # for the noise of their edges
    for number, (x, z) in enumerate(((-1.5, 0.3), (-0.6, 0.0), (1.0, -0.1)), 4):
        stage.link(f"Mark {number}", sphere(0.1, glowing(f"Far {number}", (1, 0.9, 0.7), 12)), (x, 5, z))


@ordinary()
def caustic_lamp(stage):
    """Shadow caustics through a lens of glass"""
    stage.lamp.data.size = 0.5  # few pictures contain a smaller one in the glass: a very bright pixel
    stage.lamp.data.cycles.is_caustics_light = True
    stage.floor.cycles.is_caustics_receiver = stage.ball.cycles.is_caustics_caster = True
    glass = painted("Glass", (1, 1, 1), 0.0)
    glass.node_tree.nodes["Principled BSDF"].inputs["Transmission Weight"].default_value = 1
    stage.ball.data.materials[0] = glass


@ordinary()
def lamps_in_a_hidden_collection(stage):
    """A lamp in a collection that is off for renders"""
    lamp = _red(stage)
    collection(stage, "Off", lamp).hide_render = True
