"""Build `night_portrait.blend`: a milliner's mannequin in a wet street at night, with lamps at every depth.

The picture is a portrait of 4:5 with a 100 mm lens, focused on the face at 1.9 m. It shows depth:

* lamps from 1 m to 90 m, each small enough to show the shape of the lens's pupil at its place in the picture;
* strings of bulbs in a ring around the face, where a Petzval lens's blur swirls and cat's eyes narrow;
* detail in focus: a ribbed scarf, a brooch of glass beads, pearls, painted lashes;
* lamps with measured spectra: tungsten, sodium, mercury and light-emitting diodes.

Run it as `.venv/bin/python sample_scenes/build_night_portrait.py`, in the environment that `make` sets up. Lengths in
this file are in millimetres. The face, the hat and the clothes are implicit surfaces: `sculpted` makes meshes of them.
"""

import math
from pathlib import Path

import bpy
import numpy as np

import lensfield.addon
from build_evening_chess import (
    M_PER_MM,
    NODES_ARE_OPTIONAL,
    area_lamp,
    arrange_windows,
    ball,
    box,
    connect_surface,
    emitted_rgb,
    empty_material,
    glow,
    joined,
    mesh_of,
    only_for_the_camera,
    place,
    surface,
    wire,
)

BLEND_FILE = Path(__file__).resolve().with_name("night_portrait.blend")
LENS_NAME = "kodak-petzval-100mm"

CAMERA_MM, CAMERA_PITCH_DEG = (0, -2000, 1660), 2  # the axis meets the face
FOCAL_LENGTH_MM, SENSOR_MM = 100, (27, 33.75)
RESOLUTION_PX = 640, 800
FACE_MM = (0, 0, 1560)  # the head's centre
HEAD_TURN_DEG, HEAD_TILT_DEG = -27, 6
RIM_SLOPE = np.array((0.12, 0.20))  # of the hat: its height above the rim grows along x and y
HOUSE_X_MM = 3600  # fronts, to both sides of the axis
FOCUS_MM = 1915  # to the nearer eye
GRAIN_MM = 1000 / 2**14  # of sculpted vertices: few binary digits in metres, so that the file compresses
random = np.random.default_rng(5)


# Implicit surfaces: functions of points (..., 3) in mm, negative inside; distances are approximate

def ellipsoid(centre, radii):
    def field(points):
        scaled = (points - centre) / radii
        length, slope = np.linalg.norm(scaled, axis=-1), np.linalg.norm(scaled / radii, axis=-1)
        return length * (length - 1) / np.maximum(slope, 1e-9)
    return field


def capsule(start, end, start_radius, end_radius):
    start, axis = np.array(start, float), np.subtract(end, start)

    def field(points):
        along = np.clip((points - start) @ axis / (axis @ axis), 0, 1)
        return np.linalg.norm(points - start - along[..., None] * axis, axis=-1) - (
            start_radius + along * (end_radius - start_radius))
    return field


def half_space(point, normal):
    """Everything behind a plane."""
    normal = np.array(normal) / np.linalg.norm(normal)
    return lambda points: (points - point) @ normal


def union(*fields, blend_mm):
    """Polynomial smooth minimum, one field after another."""
    def field(points):
        value = fields[0](points)
        for other in fields[1:]:
            value = smooth_minimum(value, other(points), blend_mm)
        return value
    return field


def without(field, removed, blend_mm):
    return lambda points: smooth_maximum(field(points), -removed(points), blend_mm)


def smooth_minimum(first, second, blend_mm):
    overlap = np.maximum(blend_mm - np.abs(first - second), 0) / blend_mm
    return np.minimum(first, second) - overlap**2 * blend_mm / 4


def smooth_maximum(first, second, blend_mm):
    return -smooth_minimum(-first, -second, blend_mm)


def mirrored(field):
    """The field on the side x > 0, on both sides."""
    return lambda points: field(np.concatenate([np.abs(points[..., :1]), points[..., 1:]], -1))


def sculpted(field, low_mm, high_mm, step_mm, of_grid=lambda points: points):
    """Surface nets: the zero of a field in a box, open where the box cuts it, as (vertices in mm, quads). `of_grid`
    turns points of the grid and the box into points of the field: edges along the grid are smooth, others have steps.
    """
    axes = [np.arange(low, high + step_mm, step_mm) for low, high in zip(low_mm, high_mm, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    values = np.stack([field(of_grid(plane)) for plane in points])
    crossings, weights = np.zeros((*np.subtract(values.shape, 1), 3)), np.zeros(np.subtract(values.shape, 1))
    for axis in range(3):
        _add_crossings(values, axis, crossings, weights)
    inside = weights > 0
    index = np.full(weights.shape, -1)
    index[inside] = np.arange(inside.sum())
    vertices = (np.argwhere(inside) + crossings[inside] / weights[inside][:, None]) * step_mm + low_mm
    vertices = np.round(of_grid(vertices) / GRAIN_MM) * GRAIN_MM
    return vertices, np.concatenate([_quads(values, axis, index) for axis in range(3)]).tolist()


def _add_crossings(values, axis, crossings, weights):
    """Add to each cell the points where the field changes sign on its four edges along an axis."""
    near, far = _ends(values, axis)
    cut = (near < 0) != (far < 0)
    fraction = np.where(cut, near / np.where(cut, near - far, 1), 0)
    others = [other for other in range(3) if other != axis]
    shape = weights.shape
    for corner in np.ndindex(2, 2):
        edge = [slice(None)] * 3
        for other, side in zip(others, corner, strict=True):
            edge[other] = slice(side, side + shape[other])
        edge = tuple(edge)
        weights += cut[edge]
        crossings[..., axis] += fraction[edge]
        for other, side in zip(others, corner, strict=True):
            crossings[..., other] += cut[edge] * side


def _ends(values, axis):
    return values.take(range(values.shape[axis] - 1), axis), values.take(range(1, values.shape[axis]), axis)


def _quads(values, axis, index):
    """A quad around each edge along an axis that the surface cuts, facing outwards."""
    near, far = _ends(values, axis)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    inner = [slice(None)] * 3
    inner[first] = inner[second] = slice(1, -1)
    near, far = near[tuple(inner)], far[tuple(inner)]
    cells = np.argwhere((near < 0) != (far < 0))
    outwards = (near < 0)[tuple(cells.T)]
    step = np.eye(3, dtype=int)
    ring = [cells, cells + step[first], cells + step[first] + step[second], cells + step[second]]
    corners = np.stack([index[tuple(each.T)] for each in ring], -1)
    return np.where(outwards[:, None], corners, corners[:, ::-1])


# The sitter, in the head's coordinates: x to her left, -y the direction she faces, z up

def bare_head():
    skull = union(ellipsoid((0, 14, 34), (75, 95, 88)), ellipsoid((0, -24, -30), (58, 60, 84)), blend_mm=40)
    face = union(skull, ellipsoid((0, -64, -99), (20, 19, 15)), mirrored(ellipsoid((40, -52, -20), (22, 24, 20))),
                 ellipsoid((0, -66, 30), (46, 20, 13)), blend_mm=26)
    face = without(face, mirrored(ellipsoid((32, -92, 6), (19, 19, 13))), blend_mm=16)
    lids = mirrored(ellipsoid((30, -64, 4), (17, 18, 14)))
    nose = union(capsule((0, -80, 22), (0, -101, -24), 6.5, 8.5), ellipsoid((0, -103, -29), (10, 11, 9)),
                 mirrored(ellipsoid((9, -92, -32), (7.5, 9, 6))), blend_mm=9)
    face = union(union(face, lids, blend_mm=5), nose, blend_mm=9)
    face = union(face, ellipsoid((0, -84, -60), (21, 11, 6)), ellipsoid((0, -82, -71), (17, 12, 7)), blend_mm=6)
    face = without(face, capsule((-20, -90, -66), (20, -90, -66), 0.5, 0.5), blend_mm=6)
    neck = capsule((0, 22, -60), (0, 40, -230), 47, 52)
    return union(face, neck, blend_mm=30)


def lips(points):
    """Negative at the painted lips."""
    return np.minimum(ellipsoid((0, -94, -60), (21, 16, 6.5))(points), ellipsoid((0, -92, -71), (18, 16, 7.5))(points))


def hair(points):
    """A bob that shows below the hat, in waves."""
    bob = union(ellipsoid((0, 26, -2), (88, 96, 96)), mirrored(ellipsoid((70, -6, -52), (22, 46, 44))), blend_mm=30)
    face = ellipsoid((0, -78, -40), (58, 80, 105))
    waves = 2.2 * np.sin((points[..., 2] + 0.35 * points[..., 1]) / 6.5) + 0.9 * np.sin(points[..., 1] / 2.6)
    below = half_space((0, 0, -92), (0, 0, -1))(points)
    return np.maximum(without(bob, face, 14)(points) + waves, below)


def cloche(points):
    """A bell with a narrow brim that rises in front, tilted to one side."""
    outside, height = _bell(points)
    return smooth_maximum(smooth_maximum(outside, -(outside + 11), 5), 8 - height, 8)


def band(points):
    outside, height = _bell(points)
    return smooth_maximum(np.abs(outside + 1) - 5, np.abs(height - 52) - 13, 4)


def _bell(points):
    """The hat's outer surface, and the height above its tilted rim, where it flares."""
    height = points[..., 2] + points[..., :2] @ RIM_SLOPE
    return ellipsoid((0, 15, 40), (93, 113, 100))(points) - 24 * np.exp(-np.maximum(height - 8, 0) / 15), height


def above_rim(points):
    """Points of the head from points whose z is the height above the hat's rim."""
    return points - np.stack([np.zeros(points.shape[:-1])] * 2 + [points[..., :2] @ RIM_SLOPE], -1)


def scarf(points):
    """Two ribbed turns around the neck."""
    turns = [_ribbed_turn(points, (2, 26, -172), 88, (46, 40), (0.10, -0.16)),
             _ribbed_turn(points, (-4, 20, -128), 76, (33, 30), (-0.16, -0.22))]
    return smooth_minimum(*turns, 4)


def _ribbed_turn(points, centre, radius_mm, section_mm, slope):
    x, y, z = np.moveaxis(points - centre, -1, 0)
    z = z - slope[0] * x - slope[1] * y
    around, out = np.arctan2(y, x), np.hypot(x, y * 0.94) - radius_mm
    turn = np.arctan2(z / section_mm[1], out / section_mm[0])
    ribs = 2.6 * np.sin(11 * turn + 1.5 * np.sin(3 * around)) + 0.8 * np.sin(70 * around)
    return np.hypot(out / section_mm[0], z / section_mm[1]) * min(section_mm) - min(section_mm) - ribs


def coat():
    return union(ellipsoid((0, 60, -470), (165, 108, 260)), mirrored(capsule((40, 50, -215), (150, 60, -292), 62, 58)),
                 mirrored(capsule((158, 58, -300), (196, 48, -600), 56, 56)),
                 capsule((0, 45, -300), (0, 34, -190), 80, 62), blend_mm=45)


def sitter_part(name, field, low_mm, high_mm, step_mm, *materials, **of_grid):
    thing = place(name, mesh_of(name, sculpted(field, low_mm, high_mm, step_mm, **of_grid), *materials))
    mesh = thing.data
    for polygon in mesh.polygons:
        polygon.use_smooth = True
    smooth = thing.modifiers.new("Smooth", "SUBSURF")
    smooth.levels, smooth.render_levels = 0, 1
    return thing


def paint_lips(mesh):
    centres = np.empty(3 * len(mesh.polygons), np.float32)
    mesh.polygons.foreach_get("center", centres)
    painted = lips(centres.reshape(-1, 3) / M_PER_MM) < 0
    mesh.polygons.foreach_set("material_index", painted.astype(np.int32))


def on_surface(field, point, direction):
    """Intersection of a ray with a field, by steps of the field's distance."""
    point, direction = np.array(point, float), np.array(direction) / np.linalg.norm(direction)
    for _ in range(80):
        point += 0.7 * field(point[None])[0] * direction
    return point


def painted_lines(head, ink):
    """Lashes of closed eyes and thin brows, projected onto the face."""
    for side in (-1, 1):
        lash = [(side * (30 + 17 * t), -130, 1 - 5 * (1 - t * t)) for t in np.linspace(-1, 1, 15)]
        brow = [(side * (31 + 22 * t), -130, 27 + 5 * (1 - t * t) - 3 * t) for t in np.linspace(-1, 1, 15)]
        for name, line, radius_mm in (("Lash", lash, 1.2), ("Brow", brow, 1.0)):
            wire(name, [on_surface(head, point, (0, 1, 0)) for point in line], radius_mm, ink)


def make_jewels():
    pearl = surface("Pearl", (0.85, 0.8, 0.74), 0.15, coat=1)
    glass = surface("Brooch", (0.75, 0.8, 0.9), 0.04, metallic=1)
    place("Earrings", mesh_of("Earrings", joined(ball(7.5, (side * 80, -34, -72), 24) for side in (-1, 1)), pearl))
    centre = on_surface(cloche, (-72, -150, 62), (0.28, 1, 0))
    beads = [ball(5.5, centre, 12)]
    for ring, count in ((10, 7), (18, 13)):
        for angle in np.arange(count) * 2 * math.pi / count:
            across = np.array((math.cos(angle), -0.35 * math.cos(angle), math.sin(angle)))
            beads.append(ball(3.6, centre + ring * across, 10))
    place("Brooch beads", mesh_of("Brooch beads", joined(beads), glass))


def make_sitter():
    head = bare_head()
    ivory = surface("Ivory", (0.72, 0.5, 0.39), 0.42, coat=0.25)
    rouge = surface("Rouge", (0.42, 0.025, 0.03), 0.25, coat=0.5)
    felt = surface("Felt", (0.10, 0.012, 0.022), 0.9)
    ribbon = surface("Ribbon", (0.012, 0.010, 0.014), 0.35)
    wool = surface("Wool", (0.36, 0.17, 0.035), 0.95)
    before = set(bpy.data.objects)
    paint_lips(sitter_part("Head", head, (-95, -130, -190), (95, 60, 70), 3, ivory, rouge).data)
    sitter_part("Hair", hair, (-105, -90, -110), (105, 135, 70), 4, surface("Hair", (0.02, 0.011, 0.007), 0.35))
    sitter_part("Cloche", cloche, (-140, -150, 0), (140, 170, 160), 3.4, felt, of_grid=above_rim)
    sitter_part("Band", band, (-140, -150, 30), (140, 170, 75), 3.4, ribbon, of_grid=above_rim)
    painted_lines(head, surface("Ink", (0.008, 0.006, 0.006), 0.4))
    make_jewels()
    parts = set(bpy.data.objects) - before
    turned = place("Head turned", None, FACE_MM, (0, HEAD_TILT_DEG, HEAD_TURN_DEG))
    for part in parts:
        part.parent = turned
    body = place("Body turned", None, FACE_MM, (0, 0, HEAD_TURN_DEG / 3))
    cloth = surface("Coat", (0.010, 0.016, 0.034), 0.75)
    sitter_part("Scarf", scarf, (-150, -130, -240), (150, 180, -80), 4.2, wool).parent = body
    sitter_part("Coat", coat(), (-290, -80, -480), (290, 200, -110), 12, cloth).parent = body


# The street

def towards(x_deg, z_deg, distance_mm):
    """A position from its direction relative to the axis, and its distance along the axis from the camera."""
    pitch = math.radians(CAMERA_PITCH_DEG)
    right, up = math.tan(math.radians(x_deg)), math.tan(math.radians(z_deg))
    ahead = np.array((right, math.cos(pitch) + up * math.sin(pitch), up * math.cos(pitch) - math.sin(pitch)))
    return np.array(CAMERA_MM) + distance_mm * ahead


def make_bulbs(name, places_mm, radius_mrad, radiance, light):
    """Balls with the same angular radius from the camera, glowing in a library spectrum or a colour.

    Only the camera sees them, because such small lamps would cause fireflies: `reflected_light` lights the street.
    """
    material = glow(name, radiance, light) if isinstance(light, str) else coloured_glow(name, radiance, light)
    shapes = [ball(radius_mrad * 1e-3 * np.linalg.norm(point - CAMERA_MM), point, 12) for point in places_mm]
    only_for_the_camera(place(name, mesh_of(name, joined(shapes), material)))


def coloured_glow(name, radiance, rgb):
    material = empty_material(name)
    shader = material.node_tree.nodes.new("ShaderNodeEmission")
    shader.inputs["Color"].default_value = (*rgb, 1)
    shader.inputs["Strength"].default_value = radiance
    connect_surface(material, shader)
    material.cycles.emission_sampling = "NONE"
    return material


def hanging(start, end, sag_deg, count):
    """Directions of bulbs on a cord: (x, z) in degrees and metres, from one end to the other."""
    t = np.linspace(0, 1, count)
    points = np.outer(1 - t, start) + np.outer(t, end)
    points[:, 1] -= 4 * sag_deg * t * (1 - t)
    return points


STRINGS = [  # ends as (x deg, z deg, metres), sag in degrees, bulbs
    ((-9.0, 9.2, 5.0), (9.0, 8.4, 6.0), 2.6, 11),
    ((-9.0, 5.0, 9.0), (9.5, 7.4, 9.0), 2.2, 13),
    ((-9.5, 2.0, 12), (-1.8, 7.4, 30), 1.4, 13),
    ((9.5, 0.2, 11), (2.6, 6.2, 32), 1.4, 13),
]
STREET_LAMPS = [  # (degrees from the axis, metres above the ground, metres from the camera), spectrum
    ((-6.6, 2.8, 16), "sodium-hp1"), ((-5.4, 2.6, 26), "sodium-hp1"), ((-4.2, 2.9, 44), "sodium-hp1"),
    ((6.6, 2.3, 20), "led-b5"), ((5.2, 2.4, 34), "led-b5"), ((4.1, 2.6, 55), "led-b5"), ((-7.2, 0.9, 20), "mercury"),
    ((7.4, 0.9, 18), "mercury"), ((-3.1, 3.0, 70), "sodium-hp1"), ((3.0, 3.2, 80), "led-b5"),
]
CARS = [((-4.5, 0.7, 38), "led-b4"), ((-5.4, 0.7, 38), "led-b4"), ((-5.7, 0.7, 22), "led-b4"),
        ((-7.6, 0.7, 22), "led-b4")]
TAIL_LAMPS = [(4.5, 0.8, 34), (5.6, 0.8, 34), (5.6, 0.8, 20), (7.5, 0.8, 20)]
SIGNALS = {"Red signal": ((5.6, 3.3, 28), (1.0, 0.03, 0.01)), "Green signal": ((-3.4, 3.3, 60), (0.02, 1.0, 0.35))}


def above_ground(x_deg, height_m, distance_m):
    x, y, _ = CAMERA_MM
    return np.array((x + 1000 * distance_m * math.tan(math.radians(x_deg)), y + 1000 * distance_m, 1000 * height_m))


def make_strings():
    cord, warm, cool = surface("Cord", (0.01, 0.01, 0.01), 0.6), [], []
    for number, (start, end, sag_deg, count) in enumerate(STRINGS):
        points = [towards(x, z, 1000 * metres) for x, z, metres in hanging(start, end, sag_deg, count)]
        wire(f"Cord {number}", points, 4, cord)
        for index, point in enumerate(points):
            (cool if index % 4 == 2 else warm).append(point + (0, 0, -20))
    make_bulbs("Warm bulbs", warm, 1.15, 75, "illuminant-a")
    make_bulbs("Cool bulbs", cool, 1.15, 70, "led-b5")


def make_foreground():
    points = [towards(x, z, 1000 * metres) for x, z, metres in hanging((-9.5, -4.0, 1.0), (-1, -11.0, 1.15), 1.2, 7)]
    points += [towards(x, z, 1000 * metres) for x, z, metres in hanging((2.5, -11, 1.1), (9.5, -5.5, 0.95), 1.0, 6)]
    make_bulbs("Near bulbs", points, 1.2, 60, "illuminant-a")


def make_far_lights():
    """Lit windows of the houses on both sides, dim and large, and small signs in front of them."""
    lit = ([], [])
    for side in (-1, 1):
        for y in np.arange(26000, 88000, 2600):
            for z in (1200, 4600, 8000):
                if random.random() < 0.3:
                    x = side * (HOUSE_X_MM - 30)
                    corners = [(x, y + dy, z + dz) for dy, dz in ((0, 0), (1500, 0), (1500, 1900), (0, 1900))]
                    lit[int(random.random() < 0.3)].append((np.array(corners, float), [(0, 1, 2, 3)]))
    for shapes, radiance, spectrum in ((lit[0], 0.55, "led-b1"), (lit[1], 0.5, "fluorescent-fl2")):
        name = f"Windows {spectrum}"
        only_for_the_camera(place(name, mesh_of(name, joined(shapes), glow(name, radiance, spectrum), smooth=False)))
    signs = [towards(random.choice((-1, 1)) * random.uniform(2.4, 7.0), random.uniform(1.2, 7.0),
                     1000 * random.uniform(40, 88)) for _ in range(26)]
    make_bulbs("Blue signs", signs[:16], 0.8, 26, (0.04, 0.35, 1.0))
    make_bulbs("Pink signs", signs[16:], 0.8, 26, (1.0, 0.08, 0.35))


def make_lamps():
    by_spectrum = {}
    for direction, spectrum in STREET_LAMPS + CARS:
        by_spectrum.setdefault(spectrum, []).append(above_ground(*direction))
    radiances = {"sodium-hp1": 130, "led-b5": 120, "mercury": 110, "led-b4": 150}
    for spectrum, places_mm in by_spectrum.items():
        make_bulbs(f"Lamps {spectrum}", places_mm, 1.5, radiances[spectrum], spectrum)
    tails = [above_ground(*direction) for direction in TAIL_LAMPS]
    make_bulbs("Tail lamps", tails, 1.2, 80, (1.0, 0.02, 0.01))
    for name, (direction, rgb) in SIGNALS.items():
        make_bulbs(name, [above_ground(*direction)], 1.4, 110, rgb)


def wet_asphalt():
    material = surface("Wet asphalt", (0.012, 0.013, 0.016), 0.11)
    tree = material.node_tree
    noise, bump = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeBump")
    noise.inputs["Scale"].default_value, noise.inputs["Detail"].default_value = 9.0, 2.0
    bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = 0.25, 0.02
    tree.links.new(noise.outputs[0], bump.inputs["Height"])
    tree.links.new(bump.outputs[0], tree.nodes["Principled BSDF"].inputs["Normal"])
    return material


def reflected_light(name, rgb, watts, direction, spectrum=""):
    """The light of a lamp on the street and the houses; the camera sees its ball instead."""
    light = bpy.data.lights.new(name, "POINT")
    light.energy, light.shadow_soft_size, light.color = watts, 0.05, rgb
    light.lensfield.emission = spectrum
    place(name, light, above_ground(*direction) - (0, 200, 0)).visible_camera = False


def make_street():
    ground = box((60000, 140000, 100), (0, 65000, -50))
    place("Ground", mesh_of("Ground", ground, wet_asphalt(), smooth=False))
    houses = [box((4000, 66000, height), (side * (HOUSE_X_MM + 2000), 57000, height / 2))
              for side, height in ((-1, 11000), (1, 13000))] + [box((9000, 4000, 16000), (0, 96000, 8000))]
    place("Houses", mesh_of("Houses", joined(houses), surface("Facade", (0.07, 0.05, 0.05), 0.8), smooth=False))
    for number, (direction, spectrum) in enumerate(STREET_LAMPS[:6] + CARS[:3:2]):
        reflected_light(f"Street light {number}", emitted_rgb(spectrum), 40, direction, spectrum)
    for number, direction in enumerate(TAIL_LAMPS[::2]):
        reflected_light(f"Tail light {number}", (1.0, 0.02, 0.01), 22, direction)
    for name, (direction, rgb) in SIGNALS.items():
        reflected_light(name, rgb, 40, direction)


def light_sitter():
    area_lamp("Shop window", "illuminant-a", 52, 600, (-1400, -1000, 1900), (0, 0, 1520))
    area_lamp("Rim", "led-b5", 34, 400, (1100, 800, 2100), (0, 0, 1560))
    area_lamp("Fill", "led-b4", 2.2, 900, (1200, -1900, 1500), (0, 0, 1500))
    world = bpy.data.worlds.new("Night")
    bpy.context.scene.world = world
    if NODES_ARE_OPTIONAL:
        world.use_nodes = True
    world.cycles.sampling_method = "NONE"
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.12, 0.25, 0.6, 1)
    background.inputs["Strength"].default_value = 0.012


def make_camera():
    camera = bpy.data.cameras.new("Portrait")
    camera.sensor_fit = "VERTICAL"
    camera.sensor_width, camera.sensor_height = SENSOR_MM
    camera.lens = FOCAL_LENGTH_MM
    camera.clip_start, camera.clip_end = 0.1, 200
    camera.dof.use_dof, camera.dof.focus_distance = True, FOCUS_MM * M_PER_MM
    camera.dof.aperture_fstop = 0.5  # wider than any lens
    camera.lensfield.lens, camera.lensfield.view = LENS_NAME, "CAMERA"
    bpy.context.scene.camera = place("Camera", camera, CAMERA_MM, (90 - CAMERA_PITCH_DEG, 0, 0))


def set_render():
    scene = bpy.context.scene
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y = RESOLUTION_PX
    render.resolution_percentage = 100
    cycles.device, cycles.samples, cycles.seed = "CPU", 96, 1
    cycles.use_adaptive_sampling, cycles.use_denoising = False, True
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 3, 1, 2
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_indirect = 4
    view = scene.view_settings
    view.view_transform, view.look, view.exposure = "AgX", "AgX - Punchy", 0.35
    scene.frame_set(1)


def main():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    lensfield.addon.register()
    set_render()
    make_sitter()
    make_street()
    make_strings()
    make_foreground()
    make_far_lights()
    make_lamps()
    light_sitter()
    make_camera()
    arrange_windows()
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(BLEND_FILE), compress=True)
    lensfield.addon.unregister()  # the 4.5 wheel crashes at exit if classes are still registered


if __name__ == "__main__":
    main()
