"""Build `evening_chess.blend`: a half-size chess set by a window at dusk, with everything that a lens can degrade.

The picture is taken through the 6 mm micro video lens Edmund 54-852, focused at 250 mm, so the scene is a tabletop in
real size, 20 cm wide:

* straight lines into every corner: the glazing bars of the window, the rows of the chess board, its brass inlay;
* points of light up to the corners: fairy lights in front of the window and on the board, the street lamps and the
  lit windows of a paper-theatre town behind it, the first stars;
* a colour chart of 24 patches with measured reflectances, and lamps with measured spectra.

Run it as `.venv/bin/python sample_scenes/build_evening_chess.py`, in the environment that `make` sets up. Lengths in
this file are in millimetres; `mesh_of`, `wire` and `place` turn them into Blender's metres.
A file that is built with the oldest supported Blender opens in all supported versions.
"""

import math
from itertools import pairwise
from pathlib import Path

import bpy
import numpy as np

import lensfield.addon
from lensfield.engine import load_lens
from lensfield.engine.spectral.colour import XYZ_TO_REC709
from lensfield.engine.spectral.spectra import BAND_NM, colour_matching, library_names, load_spectrum, white_density

BLEND_FILE = Path(__file__).resolve().with_name("evening_chess.blend")
LENS_NAME = "edmund-54852"
M_PER_MM = 1e-3
NODES_ARE_OPTIONAL = bpy.app.version < (5, 0, 0)

CAMERA_HEIGHT_MM, CAMERA_PITCH_DEG = 95, 13
SQUARE_MM, SQUARES = 22, 8
BOARD_FAR_MM = 24  # y of the far edge of the squares; the optical axis meets the plane in focus at y = 0
TABLE_Z_MM = -6
WINDOW_Y_MM, WINDOW_HALF_WIDTH_MM, WINDOW_TOP_MM = 50, 189, 158
random = np.random.default_rng(8)


# Colours of spectra

def rec709_of(density_at):
    """Linear Rec. 709 of a spectral density, scaled to (1, 1, 1) for D65 of unit power."""
    nm = np.arange(BAND_NM[0], BAND_NM[1] + 1)
    to_rec709 = colour_matching(nm) @ XYZ_TO_REC709.T
    return np.clip(density_at(nm) @ to_rec709 / (white_density(nm) @ to_rec709), 0, None)


def reflected_rgb(spectrum_name):
    spectrum = load_spectrum(spectrum_name)
    return rec709_of(lambda nm: spectrum.at(nm) * white_density(nm))


def emitted_rgb(spectrum_name):
    return rec709_of(load_spectrum(spectrum_name).density_at)


# Materials

def empty_material(name):
    material = bpy.data.materials.new(name)
    if NODES_ARE_OPTIONAL:
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material


def connect_surface(material, shader):
    output = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])


def surface(name, rgb, roughness, metallic=0.0, coat=0.0):
    """Principled material of a uniform colour."""
    material = empty_material(name)
    shader = material.node_tree.nodes.new("ShaderNodeBsdfPrincipled")
    shader.inputs["Base Color"].default_value = (*rgb, 1)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Metallic"].default_value = metallic
    shader.inputs["Coat Weight"].default_value = coat
    shader.inputs["Coat Roughness"].default_value = 0.06
    connect_surface(material, shader)
    material.diffuse_color = (*rgb, 1)
    return material


def library_surface(name, spectrum, roughness, **finish):
    """Principled material of a measured reflectance, with its colour in daylight for renders in RGB."""
    material = surface(name, reflected_rgb(spectrum), roughness, **finish)
    material.lensfield.reflectance = spectrum
    return material


def grained(name, dark_rgb, light_rgb, roughness, stretch):
    """Wood: two colours mixed by noise that is stretched along one axis (coordinates in metres)."""
    material = surface(name, light_rgb, roughness)
    tree = material.node_tree
    place, scale, noise, mix = (tree.nodes.new(kind) for kind in (
        "ShaderNodeTexCoord", "ShaderNodeMapping", "ShaderNodeTexNoise", "ShaderNodeMix"))
    scale.inputs["Scale"].default_value = stretch
    noise.inputs["Scale"].default_value = 1.0
    noise.inputs["Detail"].default_value = 3.0
    mix.data_type = "RGBA"
    factor, first, second = (mix.inputs[index] for index in (0, 6, 7))
    first.default_value, second.default_value = (*dark_rgb, 1), (*light_rgb, 1)
    tree.links.new(place.outputs["Object"], scale.inputs["Vector"])
    tree.links.new(scale.outputs["Vector"], noise.inputs["Vector"])
    tree.links.new(noise.outputs[0], factor)
    tree.links.new(mix.outputs[2], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return material


def glow(name, radiance, spectrum):
    """Emission of a library spectrum, visible but not sampled, because small lamps cause fireflies."""
    material = empty_material(name)
    shader = material.node_tree.nodes.new("ShaderNodeEmission")
    shader.inputs["Color"].default_value = (*emitted_rgb(spectrum), 1)
    shader.inputs["Strength"].default_value = radiance
    connect_surface(material, shader)
    material.lensfield.emission = spectrum
    material.cycles.emission_sampling = "NONE"
    return material


def dusk_sky():
    """Blue above, an afterglow near the roofs: two emissions whose strengths depend on the height."""
    material = empty_material("Dusk sky")
    tree = material.node_tree
    height = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Object"], height.inputs[0])
    add = tree.nodes.new("ShaderNodeAddShader")
    layers = (((0.08, 0.20, 0.62), 0.75, 0.16, 0.0, 0.13), ((1.0, 0.42, 0.16), 0.55, 0.0, 0.015, 0.075))
    for slot, (rgb, low, high, from_m, to_m) in enumerate(layers):
        fade, emission = tree.nodes.new("ShaderNodeMapRange"), tree.nodes.new("ShaderNodeEmission")
        fade.interpolation_type = "SMOOTHSTEP"
        for socket, value in zip(fade.inputs[1:5], (from_m, to_m, low, high), strict=True):
            socket.default_value = value
        emission.inputs["Color"].default_value = (*rgb, 1)
        tree.links.new(height.outputs["Z"], fade.inputs[0])
        tree.links.new(fade.outputs[0], emission.inputs["Strength"])
        tree.links.new(emission.outputs[0], add.inputs[slot])
    connect_surface(material, add)
    material.cycles.emission_sampling = "NONE"
    return material


# Shapes: (vertices in mm, faces)

def box(size_mm, centre_mm=(0, 0, 0)):
    corners = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return np.array(corners) * size_mm + centre_mm, faces


def upright_quad(x_mm, z_mm, y_mm, width_mm, height_mm):
    """Rectangle that faces the camera; x and z of its lower left corner."""
    left, right, low, high = x_mm, x_mm + width_mm, z_mm, z_mm + height_mm
    return np.array([(left, y_mm, low), (right, y_mm, low), (right, y_mm, high), (left, y_mm, high)]), [(0, 1, 2, 3)]


def lathe(profile_mm, segments=32):
    """Surface of revolution about z of a profile of (radius, height)."""
    angles = np.arange(segments) * 2 * math.pi / segments
    rings = [np.stack([r * np.cos(angles), r * np.sin(angles), np.full(segments, z)], -1) for r, z in profile_mm]
    faces = [(a * segments + i, a * segments + j, (a + 1) * segments + j, (a + 1) * segments + i)
             for a in range(len(profile_mm) - 1) for i, j in enumerate(np.roll(range(segments), -1))]
    return np.concatenate(rings), faces


def ball(radius_mm, centre_mm, segments=8):
    around = np.linspace(-math.pi / 2, math.pi / 2, segments // 2 + 1)
    vertices, faces = lathe(radius_mm * np.stack([np.cos(around), np.sin(around)], -1), segments)
    return vertices + centre_mm, faces


def plate(outline_mm, thickness_mm, bevel_mm):
    """Upright plate with an outline of (x, z), clockwise as seen from the camera, with rounded edges."""
    edges = np.roll(outline_mm, -1, axis=0) - outline_mm
    normals = edges[:, ::-1] * (1, -1) / np.linalg.norm(edges, axis=1)[:, None]
    inwards = normals + np.roll(normals, 1, axis=0)
    inwards /= np.sum(inwards**2, axis=1)[:, None] / 2  # the inset edges stay parallel to the edges
    turns = np.radians((0, 30, 60, 90))
    insets = bevel_mm * (1 - np.sin(turns))
    depths = thickness_mm / 2 - bevel_mm * (1 - np.cos(turns))
    rings = [np.insert(outline_mm + inset * inwards, 1, y, axis=1)
             for inset, y in zip([*insets, *insets[::-1]], [*-depths, *depths[::-1]], strict=True)]
    n, last = len(outline_mm), len(rings) - 1
    sides = [(a * n + i, a * n + (i + 1) % n, (a + 1) * n + (i + 1) % n, (a + 1) * n + i)
             for a in range(last) for i in range(n)]
    front, back = tuple(range(n)), tuple(range(last * n, (last + 1) * n))
    return np.concatenate(rings), [front[::-1], *sides, back]


def bead(radius_mm, centre_mm):
    """Octahedron: sufficiently round for a size of one or two pixels."""
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    return radius_mm * corners + centre_mm, faces


def joined(shapes):
    shapes = list(shapes)
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in shapes[:-1]])
    faces = [tuple(int(start + index) for index in face)
             for start, (_, part) in zip(starts, shapes, strict=True) for face in part]
    return np.concatenate([vertices for vertices, _ in shapes]), faces


def rotated_z(shape, angle):
    cos, sin = math.cos(angle), math.sin(angle)
    return shape[0] @ np.array([(cos, sin, 0), (-sin, cos, 0), (0, 0, 1)]), shape[1]


def rounded(points, steps=4):
    """Catmull-Rom curve through points; a point given twice is a corner."""
    p = np.array([points[0], *points, points[-1]], dtype=float)
    t = np.linspace(0, 1, steps, endpoint=False)[:, None]
    pieces = [b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))
              for a, b, c, d in zip(p[:-3], p[1:-2], p[2:-1], p[3:], strict=True)]
    curve = np.concatenate([*pieces, p[-1:]])
    return curve[np.append(True, np.abs(np.diff(curve, axis=0)).max(axis=1) > 1e-6)]


# Objects

def mesh_of(name, shape, *materials, smooth=True):
    vertices_mm, faces = shape
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata((vertices_mm * M_PER_MM).tolist(), [], faces)
    for material in materials:
        mesh.materials.append(material)
    if smooth:
        mesh.shade_smooth()
        mesh.set_sharp_from_angle(angle=math.radians(40))
        for polygon in mesh.polygons:
            polygon.use_smooth = len(polygon.vertices) <= 4  # normals bent at the rim would crease a large face
    return mesh


def place(name, data, location_mm=(0, 0, 0), rotation_deg=(0, 0, 0)):
    thing = bpy.data.objects.new(name, data)
    thing.location = np.array(location_mm) * M_PER_MM
    thing.rotation_euler = np.radians(rotation_deg)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def bevelled(thing, width_mm):
    bevel = thing.modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments = width_mm * M_PER_MM, 2
    return thing


def only_for_the_camera(thing):
    thing.visible_diffuse = thing.visible_glossy = thing.visible_shadow = False
    return thing


def wire(name, points_mm, radius_mm, material):
    curve = bpy.data.curves.new(name, "CURVE")
    curve.dimensions, curve.bevel_depth, curve.bevel_resolution = "3D", radius_mm * M_PER_MM, 1
    spline = curve.splines.new("POLY")
    spline.points.add(len(points_mm) - 1)
    homogeneous = np.column_stack([np.array(points_mm) * M_PER_MM, np.ones(len(points_mm))])
    spline.points.foreach_set("co", homogeneous.ravel())
    curve.materials.append(material)
    return place(name, curve)


# The board and the chessmen

def make_board(woods, brass):
    half_mm = SQUARE_MM * SQUARES / 2
    centre_mm = (0, BOARD_FAR_MM - half_mm, 0)
    rows = np.arange(SQUARES)
    squares = [upright_quad(0, 0, 0, SQUARE_MM, SQUARE_MM)[0][:, [0, 2, 1]]
               + (column * SQUARE_MM - half_mm, row * SQUARE_MM - half_mm, 0) for row in rows for column in rows]
    mesh = mesh_of("Squares", joined((square, [(0, 1, 2, 3)]) for square in squares), *woods, smooth=False)
    for index, polygon in enumerate(mesh.polygons):
        polygon.material_index = (index + index // SQUARES) % 2
    place("Squares", mesh, centre_mm)
    for name, extra_mm, top_mm, material in (("Inlay", 1.2, -0.02, brass), ("Border", 13, -0.04, woods[0])):
        side = 2 * (half_mm + extra_mm)
        slab = mesh_of(name, box((side, side, 5), (0, 0, top_mm - 2.5)), material, smooth=False)
        bevelled(place(name, slab, centre_mm), 0.5)


def square_mm(file, rank):
    """Centre of a square, files -4 to 3 from the left, ranks from the far edge."""
    return ((file + 0.5) * SQUARE_MM, BOARD_FAR_MM - (rank + 0.5) * SQUARE_MM, 0)


def foot_and_stem(radius_mm, neck_mm):
    """The common profile of all chessmen, up to the collar at the height of the neck."""
    r, n = radius_mm, neck_mm
    return [(0.0, 0), (0.96 * r, 0), (0.96 * r, 0), (r, 0.12 * r), (0.97 * r, 0.3 * r), (0.8 * r, 0.42 * r),
            (0.8 * r, 0.42 * r), (0.78 * r, 0.55 * r), (0.62 * r, 0.7 * r), (0.44 * r, 0.45 * n), (0.34 * r, 0.72 * n),
            (0.33 * r, n - 0.18 * r), (0.33 * r, n - 0.18 * r), (0.62 * r, n - 0.1 * r), (0.62 * r, n + 0.04 * r),
            (0.4 * r, n + 0.14 * r), (0.4 * r, n + 0.14 * r)]


def pawn():
    head = [(2.7, 18.2), (4.1, 20.2), (4.4, 22), (3.9, 24), (2.5, 25.7), (0, 26.3)]
    return lathe(rounded(foot_and_stem(7.6, 16) + head))


def bishop():
    head = [(2.8, 28), (4.3, 30.5), (4.5, 32.5), (3.6, 36), (1.5, 39.4), (0.9, 39.9), (0.9, 39.9), (1.6, 40.7),
            (1.6, 41.9), (0, 42.8)]
    return lathe(rounded(foot_and_stem(8.4, 25.5) + head))


def knight():
    outline = [(-4.4, -1), (-4.2, 0.5), (-3.4, 3), (-1.9, 5.6), (-1, 8), (-2.2, 8.4), (-4.4, 7.2), (-6.3, 6.8),
               (-7.2, 8.2), (-6.8, 10), (-4.9, 12.4), (-3.6, 15), (-3.1, 17), (-2.1, 18.6), (-1, 17.4), (0.4, 16.7),
               (2.4, 15.6), (4.2, 13), (5.3, 9.2), (5.4, 5), (4.8, 2), (4.6, 0.5), (4.5, -1)]
    collar = [(5.2, 12.9), (5.4, 13.8), (4.6, 14.5), (0, 14.7)]
    head = plate(rounded(outline, 3) + (0, 13.4), 5.6, 0.35)
    eyes = [ball(0.75, (-3.5, side * 2.6, 25.4)) for side in (-1, 1)]
    return joined([lathe(rounded(foot_and_stem(8.4, 12) + collar)), head, *eyes])


def rook():
    head = [(3.6, 22.6), (5.6, 23.4), (5.6, 23.4), (5.7, 29.5), (5.7, 29.5), (3.8, 29.5), (3.8, 29.5), (3.8, 27),
            (3.8, 27), (0, 27)]
    merlon = box((1.9, 3.6, 2.4), (4.72, 0, 30.6))
    merlons = [rotated_z(merlon, turn * math.pi / 3) for turn in range(6)]
    return joined([lathe(rounded(foot_and_stem(8.4, 20.5) + head)), *merlons])


def queen():
    head = [(3, 36), (3.9, 39), (5.7, 43.6), (5.7, 43.6), (5.2, 44.2), (4.4, 43.4), (3.4, 44.6), (1.2, 45.8),
            (1.2, 45.8), (1.7, 46.8), (1.5, 48), (0, 48.8)]
    jewels = [rotated_z(ball(0.85, (5.2, 0, 44.1)), turn * math.pi / 5) for turn in range(10)]
    return joined([lathe(rounded(foot_and_stem(9, 32.5) + head)), *jewels])


def king():
    head = [(3.2, 40), (4, 43), (5.4, 48), (5.4, 48), (4.9, 48.8), (2.6, 50.2), (1.3, 50.8), (1.3, 50.8)]
    cross = [box((1.6, 1.5, 7.4), (0, 0, 53.4)), box((4.8, 1.5, 1.6), (0, 0, 54.3))]
    return joined([lathe(rounded(foot_and_stem(9.2, 36.5) + head)), *cross])


def make_men(brass, lacquer):
    shapes = {"King": king(), "Queen": queen(), "Bishop": bishop(), "Knight": knight(), "Rook": rook(),
              "Pawn": pawn()}
    meshes = {name: mesh_of(name, shape, None) for name, shape in shapes.items()}
    standing = {brass: [("King", -2, 1), ("Knight", -1, 2), ("Bishop", -3, 0), ("Rook", -3, 2)],
                lacquer: [("Queen", 0, 1), ("Pawn", -2, 3), ("Pawn", 0, 3), ("Pawn", 2, 3), ("Rook", 3, 1)]}
    for material, men in standing.items():
        for name, file, rank in men:
            make_man(meshes[name], material, square_mm(file, rank), (0, 0, random.uniform(-20, 20)))
    captured_mm = np.add(square_mm(1, 2), (4, -2, 7.3))
    make_man(meshes["Pawn"], brass, captured_mm, (0, 85, 35))


def make_man(mesh, material, location_mm, rotation_deg):
    """Assign the material to the object instead of the mesh, so both sides share the meshes."""
    man = place(f"{material.name} {mesh.name}", mesh, location_mm, rotation_deg)
    man.material_slots[0].link = "OBJECT"
    man.material_slots[0].material = material


# The chart

def make_chart(frame_material, location_mm, rotation_deg):
    patch_mm, pitch_mm = 7.2, 8.1
    names = [name for name in library_names() if name.startswith("chart-")]
    shapes = [upright_quad(column * pitch_mm, (3 - row) * pitch_mm, 0, patch_mm, patch_mm)
              for row in range(4) for column in range(6)]
    materials = [library_surface(name, name, 0.9) for name in names]
    mesh = mesh_of("Chart patches", joined(shapes), *materials, smooth=False)
    mesh.polygons.foreach_set("material_index", np.arange(24, dtype=np.int32))
    width_mm, height_mm = 6 * pitch_mm + 3, 4 * pitch_mm + 3
    card = mesh_of("Chart card", box((width_mm, 1.4, height_mm), (width_mm / 2 - 2, 0.75, height_mm / 2 - 2)),
                   frame_material, smooth=False)
    board = bevelled(place("Chart card", card, location_mm, rotation_deg), 0.4)
    place("Chart patches", mesh).parent = board


# The window and the town

def make_window(paint):
    wide_mm, bar_mm, depth_mm, pane_x_mm, pane_z_mm = 2 * WINDOW_HALF_WIDTH_MM, 1.8, 2.4, 27, 29
    upright = [box((bar_mm, depth_mm, WINDOW_TOP_MM), (x, 0, WINDOW_TOP_MM / 2))
               for x in np.arange(-WINDOW_HALF_WIDTH_MM, WINDOW_HALF_WIDTH_MM + 1, pane_x_mm)]
    across = [box((wide_mm, depth_mm * 0.9, bar_mm), (0, 0, z)) for z in np.arange(33, WINDOW_TOP_MM, pane_z_mm)]
    rail = box((wide_mm, 6, 10), (0, 0, -1))
    bars = mesh_of("Glazing bars", joined([*upright, *across, rail]), paint, smooth=False)
    bevelled(place("Glazing bars", bars, (0, WINDOW_Y_MM, 0)), 0.5)


def house(x_mm, y_mm, width_mm, eaves_mm, ridge_mm):
    """Front of a gabled house with a chimney."""
    right = x_mm + width_mm
    front = np.array([(x_mm, y_mm, TABLE_Z_MM), (right, y_mm, TABLE_Z_MM), (right, y_mm, eaves_mm),
                      (x_mm + width_mm / 2, y_mm, ridge_mm), (x_mm, y_mm, eaves_mm)])
    chimney = upright_quad(x_mm + 0.68 * width_mm, eaves_mm, y_mm + 0.3, 1.8, ridge_mm - eaves_mm + 1)
    return joined([(front, [(0, 1, 2, 3, 4)]), chimney])


def lit_windows(x_mm, y_mm, width_mm, eaves_mm, share):
    columns = int(width_mm // 3)
    margin_mm = (width_mm - 3 * columns + 1.8) / 2
    return [upright_quad(x_mm + margin_mm + 3 * column, z_mm, y_mm - 0.2, 1.2, 1.9)
            for column in range(columns) for z_mm in np.arange(eaves_mm - 3.4, 8, -4.2) if random.random() < share]


def make_street(name, y_mm, eaves_mm, wall, lights, share):
    """A row of houses from one side of the window to the other; a quarter of the lit windows have the second light."""
    houses, windows = [], ([], [])
    x_mm = -WINDOW_HALF_WIDTH_MM
    while x_mm < WINDOW_HALF_WIDTH_MM:
        width_mm, height_mm = random.uniform(10, 18), random.uniform(*eaves_mm)
        houses.append(house(x_mm, y_mm, width_mm, height_mm, height_mm + random.uniform(0.4, 0.7) * width_mm))
        for quad in lit_windows(x_mm, y_mm, width_mm, height_mm, share):
            windows[int(random.random() < 0.25)].append(quad)
        x_mm += width_mm + random.choice((0, 0, 0.6))
    place(f"{name} street", mesh_of(f"{name} street", joined(houses), wall, smooth=False))
    for quads, light in zip(windows, lights, strict=True):
        label = f"{name} windows {light.name}"
        only_for_the_camera(place(label, mesh_of(label, joined(quads), light, smooth=False)))


def make_sky():
    wide_mm = 2.2 * WINDOW_HALF_WIDTH_MM
    quad = upright_quad(-wide_mm / 2, -20, 82, wide_mm, 220)
    place("Sky", mesh_of("Sky", quad, dusk_sky(), smooth=False))
    stars_mm = np.column_stack([random.uniform(-150, 150, 60), np.full(60, 81.0), random.uniform(70, 140, 60)])
    make_beads("Stars", stars_mm, 0.12, glow("Starlight", 20, "illuminant-d75"))


def make_town():
    windows = glow("Tungsten window", 1.0, "illuminant-a"), glow("Fluorescent window", 0.8, "fluorescent-fl11")
    make_street("Far", 72, (30, 46), surface("Far walls", (0.04, 0.05, 0.1), 1.0), windows, 0.3)
    make_street("Near", 64, (14, 27), surface("Near walls", (0.012, 0.014, 0.028), 1.0), windows, 0.4)
    iron = surface("Lamp post", (0.02, 0.02, 0.02), 0.7)
    lamps_mm = np.array([(x, 60.0, 17.0) for x in np.arange(-175.5, 176, 13.5)])
    posts = joined(box((0.35, 0.35, 20), centre - (0, -0.5, 10)) for centre in lamps_mm)
    place("Lamp posts", mesh_of("Lamp posts", posts, iron, smooth=False))
    make_beads("Sodium street lamps", lamps_mm[0::2], 0.45, glow("Sodium lamp", 25, "sodium-lp"))
    make_beads("Mercury street lamps", lamps_mm[1::2], 0.45, glow("Mercury lamp", 25, "mercury"))


# Fairy lights

def make_beads(name, centres_mm, radius_mm, material, shape=bead):
    shapes = (shape(radius_mm, centre) for centre in centres_mm)
    return only_for_the_camera(place(name, mesh_of(name, joined(shapes), material)))


def swag(start_mm, end_mm, sag_mm, count=24):
    """Points on a string that hangs between two hooks."""
    t = np.linspace(0, 1, count)[:, None]
    return np.array(start_mm) * (1 - t) + np.array(end_mm) * t - (0, 0, 4 * sag_mm) * t * (1 - t)


def along(points_mm, spacing_mm):
    """Equally spaced points along a polyline."""
    distance = np.append(0, np.cumsum(np.linalg.norm(np.diff(points_mm, axis=0), axis=1)))
    stations = np.arange(spacing_mm / 2, distance[-1], spacing_mm)
    return np.column_stack([np.interp(stations, distance, axis) for axis in points_mm.T])


def fairy_strings():
    """Strings over the window in three swags, and down each side, over the board, to the lower corners."""
    y = WINDOW_Y_MM - 5
    hooks = [(-135, y, 112), (-54, y, 100), (54, y, 103), (135, y, 113)]
    strings = [swag(start, end, sag) for (start, end), sag in zip(pairwise(hooks), (17, 22, 16), strict=True)]
    for side in (-1, 1):
        lying = [(114, 45, 150), (110, 44, 60), (107, 42, 14), (101, 33, 1), (95, 22, 0.8), (97, 2, 0.8),
                 (83, -18, 0.8), (84, -40, 0.8), (70, -58, 0.8), (69, -74, 0.8), (54, -88, 0.8), (48, -100, 0.8)]
        strings.append(rounded([(side * x_mm, y_mm, z_mm) for x_mm, y_mm, z_mm in lying]))
    return strings


def make_fairy_lights():
    """Each lamp is a bulb that glows in its colour, with a bright filament, about a pixel in size, in front of it."""
    cord = surface("Cord", (0.02, 0.035, 0.02), 0.6)
    filament_radiance = {"illuminant-a": 120, "sodium-lp": 30, "mercury": 60, "led-rgb1": 60}
    order = (0, 2, 0, 1, 0, 3)
    centres = [[] for _ in filament_radiance]
    for number, string_mm in enumerate(fairy_strings()):
        wire(f"Cord {number}", string_mm, 0.16, cord)
        for place_in_string, centre in enumerate(along(string_mm, 6.5)):
            centres[order[place_in_string % len(order)]].append(centre)
    for (spectrum, radiance), centres_mm in zip(filament_radiance.items(), centres, strict=True):
        make_beads(f"Bulbs {spectrum}", centres_mm, 0.75, glow(f"Bulb {spectrum}", 0.6, spectrum), ball)
        filaments_mm = np.array(centres_mm) - (0, 0.8, 0)
        make_beads(f"Filaments {spectrum}", filaments_mm, 0.2, glow(f"Filament {spectrum}", radiance, spectrum))


# The vase

def vase():
    outside = [(0, 0), (7.5, 0), (7.5, 0), (8.2, 0.8), (11.5, 6), (13, 13), (11, 21), (6.2, 27.5), (4.2, 32), (4.4, 35),
               (6, 37.6), (6, 37.6), (5.4, 37.8), (3.8, 35), (3.4, 31), (3.4, 31), (0, 29)]
    return lathe(rounded(outside), 48)


def twig(base_mm, heading_deg, length_mm):
    """Points of a twig that wanders as it grows."""
    points, steps = [np.array(base_mm, dtype=float)], 9
    lean, turn = math.radians(random.uniform(8, 26)), math.radians(heading_deg)
    for _ in range(steps):
        lean += random.normal(0.03, 0.09)
        turn += random.normal(0, 0.25)
        forward = np.array((math.sin(lean) * math.cos(turn), 0.5 * math.sin(lean) * math.sin(turn), math.cos(lean)))
        points.append(points[-1] + forward * length_mm / steps)
    return rounded(points, 3)


def make_vase(location_mm, glaze):
    place("Vase", mesh_of("Vase", vase(), glaze), location_mm)
    bark, berry = surface("Bark", (0.07, 0.04, 0.025), 0.8), library_surface("Berry", "chart-15-red", 0.25)
    berries = []
    for heading_deg in (10, 80, 150, 200, 260, 330, 355):
        points_mm = twig(np.array(location_mm) + (0, 0, 30), heading_deg, random.uniform(42, 64))
        wire("Twig", points_mm, 0.38, bark)
        for point in along(points_mm[9:], 4.6):
            berries.append(ball(random.uniform(0.9, 1.4), point + random.normal(0, 1.1, 3), 10))
    place("Berries", mesh_of("Berries", joined(berries), berry))


# Light, camera, settings

def area_lamp(name, spectrum, watts, size_mm, location_mm, target_mm):
    """Square lamp that is aimed at a target; `watts` is the power between 380 and 780 nm."""
    light = bpy.data.lights.new(name, "AREA")
    light.energy, light.size, light.color = watts, size_mm * M_PER_MM, emitted_rgb(spectrum)
    light.lensfield.emission = spectrum
    x, y, z = np.subtract(target_mm, location_mm)
    tilt_deg, turn_deg = math.degrees(math.atan2(math.hypot(x, y), -z)), math.degrees(math.atan2(-x, y))
    place(name, light, location_mm, (tilt_deg, 0, turn_deg))


def make_lamps():
    area_lamp("Tungsten key", "illuminant-a", 0.4, 80, (-190, -110, 210), (0, 0, 15))
    area_lamp("LED fill", "led-b3", 0.42, 120, (170, -160, 190), (20, 0, 15))
    area_lamp("LED rim", "led-b3", 0.15, 50, (50, 35, 185), (-10, 0, 20))
    world = bpy.data.worlds.new("Room")
    bpy.context.scene.world = world
    if NODES_ARE_OPTIONAL:
        world.use_nodes = True
    world.cycles.sampling_method = "NONE"
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*emitted_rgb("illuminant-d75"), 1)
    background.inputs["Strength"].default_value = 0.025
    world.lensfield.emission = "illuminant-d75"


def make_camera():
    """A pinhole with the lens's view, at the lens's entrance pupil."""
    lens = load_lens(LENS_NAME)
    camera = bpy.data.cameras.new("Edmund 54-852")
    camera.sensor_fit = "HORIZONTAL"
    camera.sensor_width, camera.sensor_height = lens.sensor_mm
    camera.lens = lens.capture_focal_length_mm
    camera.clip_start, camera.clip_end = 0.01, 10
    camera.lensfield.lens = LENS_NAME
    pitch = math.radians(CAMERA_PITCH_DEG)
    focus_mm = lens.object_distance_mm + lens.entrance_pupil_mm
    location_mm = (0, -focus_mm * math.cos(pitch), CAMERA_HEIGHT_MM)
    bpy.context.scene.camera = place("Camera", camera, location_mm, (90 - CAMERA_PITCH_DEG, 0, 0))


def set_render():
    scene = bpy.context.scene
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = 768, 576, 100
    render.use_persistent_data = False
    cycles.device, cycles.samples, cycles.seed = "CPU", 64, 1
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 4, 2, 3
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.blur_glossy = 5.0  # reflections of brass in brass are noisy otherwise
    cycles.light_sampling_threshold = 0.0  # the default drops dim light at random, and radiance per nm is dim
    cycles.use_light_tree = False  # three lamps: choosing among them costs more than it saves
    scene.view_settings.view_transform = "Standard"
    scene.frame_set(1)


def build_scene():
    brass = surface("Brass", (0.76, 0.57, 0.28), 0.22, metallic=1)
    woods = (grained("Walnut", (0.022, 0.011, 0.007), (0.06, 0.03, 0.016), 0.3, (60, 700, 60)),
             grained("Maple", (0.42, 0.28, 0.15), (0.58, 0.42, 0.25), 0.3, (60, 700, 60)))
    make_board(woods, brass)
    table = grained("Table oak", (0.05, 0.028, 0.016), (0.12, 0.07, 0.04), 0.45, (25, 300, 25))
    place("Table", mesh_of("Table", box((900, 700, 10), (0, -200, TABLE_Z_MM - 5)), table, smooth=False))
    make_men(brass, surface("Lacquer", (0.11, 0.009, 0.007), 0.16, coat=1))
    make_chart(surface("Chart black", (0.02, 0.02, 0.02), 0.6), (26.5, 18, 2), (-12, 0, -9))
    make_window(surface("Window paint", (0.5, 0.5, 0.48), 0.7))
    make_town()
    make_sky()
    make_fairy_lights()
    make_vase((-82, 30, -5), library_surface("Glaze", "chart-18-cyan", 0.12, coat=1))
    make_lamps()
    make_camera()


def arrange_windows():
    """Make every view look through the camera, and open the sidebar of the first, next to the render properties."""
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D":
                area.spaces.active.region_3d.view_perspective = "CAMERA"
                area.spaces.active.show_region_ui = screen.name == "Layout"
            elif area.type == "PROPERTIES":
                area.spaces.active.context = "RENDER"


def main():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    lensfield.addon.register()
    set_render()
    build_scene()
    arrange_windows()
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(BLEND_FILE), compress=True)
    lensfield.addon.unregister()  # the 4.5 wheel crashes at exit if classes are still registered


if __name__ == "__main__":
    main()
