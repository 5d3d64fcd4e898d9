"""Sets: complete pictures, with the things together that the other themes have one by one."""

from math import radians

import bpy
import numpy as np

from .kit import (
    background,
    box,
    checks,
    cone,
    glowing,
    image,
    keyed,
    look_at,
    mesh_of,
    node_for,
    ordinary,
    painted,
    plane,
    principled,
    shaded,
    sphere,
)
from .lamps import portal
from .objects import hair_curves
from .worlds import add_panorama, sky_with_sun

FLAME_ORANGE = 4.6
"""CIEDE2000 between the orange paint's spectrum in the flame's light and the product of red, green and blue."""


@ordinary()
def interior_with_screens(stage):
    """A room with a portal in its window, two television screens, and a dark glossy table"""
    portal(stage)
    stage.floor.data.materials[0] = painted("Lacquer", (0.05, 0.04, 0.04), 0.2)
    for number, (place, turn) in enumerate((((-0.3, 0.6, 0.3), 20), ((0.45, 0.5, 0.35), -25))):
        screen = painted(f"Screen {number}", (0.02, 0.02, 0.02), 0.3, Emission_Strength=2.0 + 2 * number)
        picture = image(f"screen {number}.png", checks(5 + number, 7, first=(0.2, 0.6, 0.9)))
        node_for(screen, "ShaderNodeTexImage", "Emission Color").image = picture
        television = stage.link(f"Screen {number}", plane(0.16, screen), place)
        television.rotation_euler = radians(90), 0, radians(turn)


@ordinary()
def product_shot(stage):
    """A bottle and a watch on a glossy sweep, by an HDRI, a soft box and a rim light, on a transparent film"""
    add_panorama(stage, 0.5)
    stage.scene.render.film_transparent = True
    stage.lamp.data.shape, stage.lamp.data.size, stage.lamp.data.size_y = "RECTANGLE", 0.5, 0.9
    rim = stage.link("Rim", bpy.data.lights.new("Rim", "AREA"), (0.8, 0.7, 0.6))
    rim.data.energy, rim.data.size, rim.data.color = 8, 0.2, (1, 0.9, 0.8)
    look_at(rim, (0, 0, 0.1))
    stage.floor.data.materials[0] = painted("Sweep", (0.6, 0.6, 0.62), 0.15, Coat_Weight=0.5)
    stage.ball.data.materials[0] = painted("Steel", (0.7, 0.68, 0.65), 0.2, Metallic=1.0)
    bottle = stage.link("Bottle", box((0.12, 0.12, 0.34), painted("Bottle", (0.9, 0.95, 0.9), 0.05,
                                                                  Transmission_Weight=1.0)), (0.0, -0.25, 0.17))
    bottle.modifiers.new("Bevel", "BEVEL").width = 0.02
    stage.cube.location.x = 0.32


@ordinary()
def hair_against_the_sky(stage):
    """A turning head of hair in front of a physical sky with its sun, with motion blur"""
    sky_with_sun(stage)
    hair_curves(stage)
    hair = bpy.data.objects["Hair"]
    stage.ball.location.z = hair.location.z = 0.3
    for head in (stage.ball, hair):
        keyed(head, "rotation_euler", {1: 0.0, 5: radians(60)}, 2)
    stage.scene.render.use_motion_blur = True
    stage.scene.frame_set(3)


@ordinary(paint=FLAME_ORANGE)
def bonfire(stage):
    """A fire of glowing gas at night, with smoke over it, embers, and string lights behind"""
    background(stage.world).inputs["Strength"].default_value = 0.02
    stage.remove(stage.lamp, stage.cone)
    flame = shaded("Flame", "ShaderNodeVolumePrincipled", Density=0.5, Emission_Strength=25.0,
                   Emission_Color=(1.0, 0.35, 0.08, 1))[0]
    smoke = shaded("Smoke", "ShaderNodeVolumeScatter", Density=0.7)[0]
    stage.link("Flame", cone(0.09, 0.28, flame), (0.0, -0.1, 0.0))
    stage.link("Smoke", box((0.3, 0.3, 0.3), smoke), (0.02, -0.1, 0.46))
    rng = np.random.default_rng(6)
    for number in range(12):
        stage.link(f"Ember {number}", sphere(0.004, glowing(f"Ember {number}", (1, 0.3, 0.05), 20), rings=6),
                   rng.uniform((-0.15, -0.2, 0.1), (0.15, 0.0, 0.5)))
        bulb = sphere(0.012, glowing(f"Bulb {number}", (1, 0.8, 0.5), 6), rings=8)
        stage.link(f"Bulb {number}", bulb, (-0.9 + 0.16 * number, 1.1, 0.45 + 0.05 * (number % 2)))


@ordinary()
def forest(stage):
    """A forest: forty instances of two trees with leaves cut out by alpha, in a low sun"""
    stage.lamp.data.energy = 0
    sun = stage.link("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.color, sun.data.angle = 3, (1, 0.8, 0.55), radians(1)
    sun.rotation_euler = radians(60), 0, radians(40)
    trees = [_tree(number) for number in range(2)]
    rng = np.random.default_rng(8)
    for number in range(40):
        empty = stage.link(f"Tree {number}", None, (*rng.uniform((-0.8, 0.2), (0.8, 1.6)), 0))
        empty.instance_type, empty.instance_collection = "COLLECTION", trees[number % 2]
        empty.rotation_euler.z, empty.scale = rng.uniform(0, 6), (rng.uniform(0.7, 1.3),) * 3


def _tree(number):
    """A collection with a trunk and forty leaves, each cut out of a square by the alpha of an image."""
    rows, columns = np.indices((32, 32)) / 31 - 0.5
    inside = np.hypot(rows, 2 * columns) < 0.45
    leaf = painted(f"Leaf {number}", (1, 1, 1))
    node = node_for(leaf, "ShaderNodeTexImage")
    colour = [0.15 + 0.2 * number + 0 * rows, 0.4 + 0.2 * rows, 0.05 + 0 * rows]
    node.image = image(f"leaf {number}.png", np.stack([*colour, inside], axis=-1))
    leaf.node_tree.links.new(node.outputs["Alpha"], principled(leaf).inputs["Alpha"])
    rng, corners = np.random.default_rng(number), []
    for _ in range(40):
        centre = rng.normal((0, 0, 0.2), (0.05, 0.05, 0.04))
        across, along = rng.normal(0, 0.02, (2, 3))
        corners += [centre - across - along, centre + across - along, centre + across + along, centre - across + along]
    crown = mesh_of("Crown", corners, np.arange(160).reshape(40, 4), leaf)
    layer = crown.uv_layers.new(name="UVMap")
    for loop in range(160):
        layer.data[loop].uv = ((0, 0), (1, 0), (1, 1), (0, 1))[loop % 4]
    source = bpy.data.collections.new(f"Tree {number}")
    trunk = cone(0.012, 0.2, painted("Bark", (0.15, 0.1, 0.06)), "Trunk")
    for name, data in (("Crown", crown), ("Trunk", trunk)):
        source.objects.link(bpy.data.objects.new(name, data))
    return source
