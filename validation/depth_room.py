"""A lit room with depth: all the difficulties of a lens image from layers, from half a metre away to outdoors.

The camera is at the origin, looks along -z, and should be focused at 2 m. A floor slants through the focus, and a beam,
a closed body, crosses it. In front of it are leaves with sharp points, blades of grass that taper to nothing, bars of
three widths, hairs and a glossy ball. Behind it are hairs, a pillar, a wall with a window, and lamps in the room and
outdoors.
"""

import bpy
import numpy as np

FOCUS_M = 2.0
BARS = (0.068, 0.0030), (0.092, 0.0015), (0.113, 0.0004)
"""Positions and widths of the bars in front of the focus, in metres."""
BARS_M, CITY_M, STRING_M = 0.85, 25.0, 4.5


def build_room():
    """A new scene of the room, to be rendered by Cycles on the CPU."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _set_cycles(scene)
    _add_camera_and_sky(scene)
    _add_room(scene)
    _add_focused_objects(scene)
    _add_near_objects(scene, np.random.default_rng(4))
    _add_lamps(scene)
    return scene


def _set_cycles(scene):
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    cycles = scene.cycles
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 3, 2, 2
    scene.render.resolution_percentage = 100


def _add_camera_and_sky(scene):
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.clip_start, camera.data.clip_end = 1e-3, 1e4
    scene.collection.objects.link(camera)
    scene.camera, scene.world = camera, bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value, background.inputs["Strength"].default_value = (0.6, 0.8, 1, 1), 0.12


def _add_room(scene):
    floor = material("Floor", chequer((0.75, 0.6, 0.4), (0.12, 0.08, 0.06), 14), glossy=0.25, roughness=0.25)
    quads(scene, "Floor", [[(-4, -0.128, -0.6), (4, -0.128, -0.6), (4, -0.29, -6), (-4, -0.29, -6)]], floor)
    wall = material("Wall", noise((0.7, 0.65, 0.5), (0.25, 0.3, 0.35), 6))
    around_the_window = facing(-4, 0.2, -1, 3, 5.5), facing(1.1, 4, -1, 3, 5.5), facing(0.2, 1.1, -1, 0.02, 5.5)
    quads(scene, "Wall", around_the_window, wall)
    outdoors = material("Outdoors", noise((0.02, 0.03, 0.05), (0.1, 0.1, 0.08), 0.6))
    quads(scene, "Outdoors", [facing(-40, 40, -20, 30, 30)], outdoors)
    pillar = material("Pillar", chequer((0.6, 0.6, 0.6), (0.3, 0.3, 0.3), 14))
    quads(scene, "Pillar", [facing(-0.44, -0.32, -1, 1, 3.2)], pillar)
    fence = [facing(x - width / 2, x + width / 2, -0.3, 0.11, 2.8)
             for x, width in ((0.26, 0.012), (0.30, 0.006), (0.33, 0.003), (0.35, 0.0015))]
    quads(scene, "Fence", fence, material("Fence", (0.04, 0.04, 0.05)))
    hairs(scene, "Hairs behind", (-0.15, 0.05), (0.02, 0.2), 2.7, 7, 0.0012, np.random.default_rng(7))


def _add_focused_objects(scene):
    ball = material("Ball", chequer((0.8, 0.1, 0.08), (0.8, 0.75, 0.7), 30), glossy=0.3, roughness=0.15)
    add_ball(scene, "Ball", (0.105, -0.08, -2.0), 0.09, ball)
    card = material("Card", noise((0.03, 0.03, 0.04), (0.85, 0.85, 0.8), 60))
    quads(scene, "Card", [facing(-0.29, -0.16, 0.03, 0.16, FOCUS_M)], card)
    # from 1.45 to 2.9 m, through the focus: a closed body, which borders of layers must not open
    beam = material("Beam", chequer((0.1, 0.3, 0.7), (0.7, 0.7, 0.3), 45))
    add_box(scene, "Beam", (-0.17, -0.105, -2.1), (0.05, 0.05, 0.75), (0, -0.22, 0), beam)
    hairs(scene, "Hairs", (-0.02, 0.06), (-0.15, 0.17), 1.7, 5, 0.0006, np.random.default_rng(5))


def _add_near_objects(scene, random):
    steel = material("Steel", (0.2, 0.2, 0.2), glossy=0.8, roughness=0.2)
    add_ball(scene, "Steel", (-0.05, -0.095, -1.15), 0.045, steel)
    leaf = material("Leaf", noise((0.05, 0.25, 0.03), (0.3, 0.5, 0.1), 40))
    for number in range(9):
        root = np.array([-0.16 + 0.013 * number, 0.16 - 0.02 * random.random(), -0.74 - 0.012 * number])
        turn = -1.2 + 0.25 * random.random() - 0.04 * number
        half = (0.010 + 0.006 * random.random()) * np.sin(np.pi * np.linspace(0, 1, 9)) ** 1.2
        way = np.linspace(0, 0.09 + 0.04 * random.random(), 9)
        middle = root + way[:, None] * (np.cos(turn), np.sin(turn), 0.25 * (number % 3 - 1))
        strip(scene, "Leaf", middle, half, (-np.sin(turn), np.cos(turn), 0), leaf)
    for number in range(14):
        along = np.linspace(0, 1, 7)
        lean, tall = 0.03 * random.standard_normal(), 0.09 + 0.05 * random.random()
        middle = np.stack([0.02 + 0.009 * number + lean * along**2, -0.16 + tall * along,
                           np.full(7, -0.9 - 0.007 * number)], axis=1)
        strip(scene, "Grass", middle, 0.0012 * (1 - along), (1, 0, 0), leaf)
    bars = [facing(x - width / 2, x + width / 2, -0.3, 0.3, BARS_M) for x, width in BARS]
    quads(scene, "Bars", bars, material("Bars", (0.05, 0.05, 0.06)))


def _add_lamps(scene):
    discs(scene, "String", [(-0.7 + 0.15 * number, 0.33 + 0.04 * np.cos(number), STRING_M) for number in range(8)],
          0.02, (1, 0.75, 0.4), 22)
    discs(scene, "City", [(1.2 + 0.75 * (number % 5) + 0.2 * (number // 5), 0.5 + 0.75 * (number // 5), CITY_M)
                          for number in range(15)], 0.1, (1, 0.9, 0.7), 22)
    for place, turn, power, size in (((0.6, 1.6, -1.2), (-0.2, 0.1, 0), 28, 1.0),
                                     ((-0.8, 1.9, -3.8), (0, 0, 0), 60, 1.5),
                                     ((-0.5, 0.6, 0.4), (0.9, -0.4, 0), 7, 0.6)):
        lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "AREA"))
        lamp.data.energy, lamp.data.size, lamp.location, lamp.rotation_euler = power, size, place, turn
        lamp.visible_camera = False
        scene.collection.objects.link(lamp)


def hairs(scene, name, between_x, between_y, distance_m, count, width_m, random):
    """Bent strips of constant width that taper to a point at the end."""
    along = np.linspace(0, 1, 13)
    hair = material(name, (0.1, 0.05, 0.03))
    for x in np.linspace(*between_x, count):
        bend = 0.04 * random.standard_normal()
        middle = np.stack([x + bend * along * (1 - along) * 4, between_y[0] + (between_y[1] - between_y[0]) * along,
                           np.full(13, -distance_m) - 0.02 * random.random()], axis=1)
        strip(scene, name, middle, width_m / 2 * np.minimum(1, 4 * (1 - along)), (1, 0, 0), hair)


def facing(x0, x1, y0, y1, distance_m):
    """Corners of a rectangle facing the camera."""
    return [(x0, y0, -distance_m), (x1, y0, -distance_m), (x1, y1, -distance_m), (x0, y1, -distance_m)]


def quads(scene, name, corners, shade):
    """An object of rectangles, by their corners (quad, 4, 3)."""
    corners = np.reshape(corners, (-1, 3))
    return add_mesh(scene, name, corners, np.arange(len(corners)).reshape(-1, 4), shade)


def strip(scene, name, middle, half, side, shade):
    """A strip along points (point, 3), with the width `half` on either side."""
    offset = half[:, None] * np.asarray(side, dtype=float)
    vertices = np.stack([middle + offset, middle - offset], axis=1).reshape(-1, 3)
    first = 2 * np.arange(len(middle) - 1)[:, None]
    return add_mesh(scene, name, vertices, first + (0, 1, 3, 2), shade)


def discs(scene, name, places, radius_m, colour, strength, corners=16):
    """Flat round lamps at positions (x, y, distance), visible only to the camera."""
    angle = 2 * np.pi * np.arange(corners) / corners
    rim = radius_m * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    vertices = (np.array(places)[:, None] * (1, 1, -1) + rim).reshape(-1, 3)
    lamp = add_mesh(scene, name, vertices, np.arange(len(vertices)).reshape(-1, corners), glow(name, colour, strength))
    lamp.visible_diffuse = lamp.visible_glossy = lamp.visible_shadow = False
    return lamp


def add_ball(scene, name, place, radius_m, shade):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=radius_m, location=place)
    bpy.ops.object.shade_smooth()
    return _named(name, shade)


def add_box(scene, name, place, half_sizes_m, turn, shade):
    bpy.ops.mesh.primitive_cube_add(size=2, location=place, rotation=turn)
    bpy.context.object.scale = half_sizes_m
    return _named(name, shade)


def _named(name, shade):
    created = bpy.context.object
    created.name = name
    created.data.materials.append(shade)
    return created


def add_mesh(scene, name, vertices, faces, shade):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(vertices, dtype=float).tolist(), [], np.asarray(faces).tolist())
    mesh.materials.append(shade)
    created = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(created)
    return created


def glow(name, colour, strength):
    """A lamp's material: visible, but not sampled."""
    lamp, nodes, links = _blank(name)
    shader = nodes.new("ShaderNodeEmission")
    shader.inputs["Color"].default_value, shader.inputs["Strength"].default_value = (*colour, 1), strength
    links.new(shader.outputs[0], nodes["Output"].inputs["Surface"])
    lamp.cycles.emission_sampling = "NONE"
    return lamp


def material(name, colour, glossy=0.0, roughness=0.5):
    """A diffuse material with a colour, or a function that adds a texture to its nodes, and a share of gloss."""
    created, nodes, links = _blank(name)
    shader = diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    if glossy:
        gloss, shader = nodes.new("ShaderNodeBsdfAnisotropic"), nodes.new("ShaderNodeMixShader")
        gloss.inputs["Roughness"].default_value = roughness
        gloss.inputs["Color"].default_value = (0.9, 0.9, 0.9, 1)
        shader.inputs[0].default_value = glossy
        links.new(diffuse.outputs[0], shader.inputs[1])
        links.new(gloss.outputs[0], shader.inputs[2])
    links.new(shader.outputs[0], nodes["Output"].inputs["Surface"])
    if callable(colour):
        links.new(colour(nodes, links), diffuse.inputs["Color"])
    else:
        diffuse.inputs["Color"].default_value = (*colour, 1)
    return created


def chequer(one, other, scale):
    """Squares of two colours, in world coordinates."""
    def add(nodes, links):
        texture = nodes.new("ShaderNodeTexChecker")
        texture.inputs["Color1"].default_value, texture.inputs["Color2"].default_value = (*one, 1), (*other, 1)
        texture.inputs["Scale"].default_value = scale
        links.new(_place(nodes, links), texture.inputs["Vector"])
        return texture.outputs["Color"]

    return add


def noise(one, other, scale):
    """Noise between two colours, in world coordinates."""
    def add(nodes, links):
        texture, ramp = nodes.new("ShaderNodeTexNoise"), nodes.new("ShaderNodeValToRGB")
        texture.inputs["Scale"].default_value, texture.inputs["Detail"].default_value = scale, 6
        for element, colour, place in zip(ramp.color_ramp.elements, (one, other), (0.4, 0.6), strict=True):
            element.color, element.position = (*colour, 1), place
        links.new(_place(nodes, links), texture.inputs["Vector"])
        links.new(texture.outputs[0], ramp.inputs[0])
        return ramp.outputs[0]

    return add


def _place(nodes, links):
    """World coordinates, shifted to keep faces off the borders of squares."""
    place, shift = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeVectorMath")
    shift.inputs[1].default_value = 0.0137, 0.0171, 0.0091
    links.new(place.outputs["Position"], shift.inputs[0])
    return shift.outputs[0]


def _blank(name):
    blank = bpy.data.materials.new(name)
    blank.use_nodes = True
    nodes = blank.node_tree.nodes
    nodes.clear()
    nodes.new("ShaderNodeOutputMaterial").name = "Output"
    return blank, nodes, blank.node_tree.links
