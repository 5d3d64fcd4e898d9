"""Simple scenes that each test one aspect of depth: a floor through the focus, a closed body, lamps near and far."""

import numpy as np

import truth_scenes
from depth_room import FOCUS_M, add_box, add_mesh, chequer, discs, facing, material, quads

FLOOR_BEGINS_M, FLOOR_ENDS_M = 0.8, 40.0
LAMPS_M = 0.7, 4.5, 25.0
LAMP_PX = 3.0  # wide: small compared with its blur, but the look at depth does not miss it


def floor_scene(lens):
    """A chequered floor that fills the picture, from in front of the focus to far behind it, and glows evenly.

    Its slope puts the focus in the middle of the picture for every lens.
    """
    scene = truth_scenes.empty_scene()
    up = lens.sensor_mm[1] / lens.capture_focal_length_mm  # tangent over all of the picture
    nearness = np.linspace(1 / FLOOR_BEGINS_M, 1 / FLOOR_ENDS_M, 65)
    at_focus = (1 / FLOOR_BEGINS_M - 1 / FOCUS_M) / (1 / FLOOR_BEGINS_M - 1 / FLOOR_ENDS_M)
    tangent = 1.6 * up * (np.linspace(0, 1, 65) - at_focus)
    vertices = np.array([(side / near, rise / near, -1 / near) for near, rise in zip(nearness, tangent, strict=True)
                         for side in (-1.0, 1.0)])
    first = 2 * np.arange(64)[:, None]
    add_mesh(scene, "Floor", vertices, first + (0, 1, 3, 2), glowing_chequer(12 / up))
    return scene


def body_scene(lens):
    """A long box through the focus, dark inside, in even light. Bars in front of it make borders of layers cut it."""
    scene = truth_scenes.empty_scene()
    truth_scenes.set_even_light(scene, 1.0)
    scene.cycles.max_bounces, scene.cycles.diffuse_bounces = 1, 1
    across = lens.squeeze * lens.sensor_mm[0] / lens.capture_focal_length_mm
    body = material("Body", chequer((0.7, 0.7, 0.7), (0.3, 0.3, 0.3), 40))
    add_box(scene, "Body", (0, 0, -1.9), (0.06 * across / 0.3, 0.1 * across / 0.3, 0.8), (0, -0.14, 0), body)
    add_mesh(scene, "Wall", facing(-9, 9, -9, 9, 8.0), [(0, 1, 2, 3)], material("Wall", (0.02, 0.02, 0.02)))
    bars = [facing(x * across * distance_m - 0.003, x * across * distance_m + 0.003, -1, 1, distance_m)
            for x, distance_m in ((-0.05, 1.2), (0.05, 1.5), (0.12, 1.9))]
    quads(scene, "Bars", bars, material("Bars", (0.5, 0.5, 0.5)))
    return scene


def lamp_scene(lens, pitch_mm, distance_m):
    """Small lamps at one distance, on the axis and all over the field: the scene, and their ideal images in mm."""
    scene = truth_scenes.empty_scene()
    width_mm, height_mm = lens.sensor_mm
    places_mm = np.array([(0, 0), (0.25 * width_mm, 0), (-0.2 * width_mm, 0.25 * height_mm)])
    metres = places_mm * (lens.squeeze, 1) / lens.capture_focal_length_mm * distance_m
    radius_m = LAMP_PX / 2 * lens.squeeze * pitch_mm / lens.capture_focal_length_mm * distance_m
    lamps = discs(scene, "Lamps", [(x, y, distance_m) for x, y in metres], radius_m, (1, 1, 1), 1.0, corners=32)
    lamps.active_material.lensfield.emission = truth_scenes.GREY
    return scene, places_mm


def glowing_chequer(squares):
    """Squares of light by direction from the camera: the same number per unit of tangent at any depth."""
    floor = truth_scenes.glow("Floor")
    nodes, links = floor.node_tree.nodes, floor.node_tree.links
    shader = next(node for node in nodes if node.bl_idname == "ShaderNodeEmission")
    floor.lensfield.emission = ""
    place, split, texture = (nodes.new(f"ShaderNode{kind}") for kind in ("NewGeometry", "SeparateXYZ", "TexChecker"))
    over, shift = nodes.new("ShaderNodeVectorMath"), nodes.new("ShaderNodeVectorMath")
    over.operation, shift.inputs[1].default_value = "DIVIDE", (0.0137, 0.0171, 0.3 / squares)
    links.new(place.outputs["Position"], split.inputs[0])
    links.new(place.outputs["Position"], over.inputs[0])
    links.new(split.outputs["Z"], over.inputs[1])
    for name, grey in (("Color1", 0.8), ("Color2", 0.2)):
        texture.inputs[name].default_value = grey, grey, grey, 1
    texture.inputs["Scale"].default_value = squares
    links.new(over.outputs[0], shift.inputs[0])
    links.new(shift.outputs[0], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], shader.inputs["Color"])
    return floor
