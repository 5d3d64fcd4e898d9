"""Parts of the ordinary scenes: a table with a few things on it, a lamp, a world, and a camera.

A function decorated with `ordinary` makes a scene of the set, which has the function's name; the first line of its
docstring is the title. It takes a Stage and changes it. Objects whose names start with "Mark" are small lamps, whose
places and sizes in the picture are measured.
"""

from dataclasses import dataclass, field
from math import radians
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

SHAPE_PX, SAMPLES = (64, 96), 64  # rows and columns
FOCUS_M = 1.25
MARK_WATTS = 8.0  # strength of the marks' emission
PAINTS = {"Table": (0.5, 0.48, 0.45), "Orange": (0.8, 0.3, 0.06), "Blue": (0.08, 0.2, 0.6), "Green": (0.1, 0.42, 0.12)}
ORDINARY = {}
"""The scenes by name, in order."""


@dataclass(frozen=True, eq=False)
class Ordinary:
    """An ordinary scene.

    Attributes
    ----------
    name, theme, title : str
    build : callable (Stage)
        Makes the scene.
    refused : str
        Words of the expected error if Lensfield refuses the scene; otherwise "".
    colour : float
        CIEDE2000 between the scene's spectra and products of red, green and blue, in addition to the predicted error of
        few wavelengths: for lamps and glass whose spectra are not smooth.
    paint : float
        The same for the paint that differs most, which may fill a block.
    layers : bool
        Whether it is also compared in layers of depth, with the depth of field of Cycles.
    request : dict
        Fields of the RenderRequest that an artist would set for it.
    plain : dict
        Of `PlainRender`: what differs in the render that it is compared with.
    remark : str
        Words that Lensfield's report must contain.
    differs : str
        The same for a scene that Lensfield renders otherwise than Cycles, as this remark states: "" if it agrees.
    """

    name: str
    theme: str
    title: str
    build: object
    refused: str = ""
    colour: float = 0.0
    paint: float = 0.0
    layers: bool = True
    request: dict = field(default_factory=dict)
    plain: dict = field(default_factory=dict)
    remark: str = ""
    differs: str = ""


def ordinary(**facts):
    """Enter a function among the ORDINARY scenes; its module is the theme."""
    def entered(build):
        name = build.__name__
        ORDINARY[name] = Ordinary(name, build.__module__.rpartition(".")[2].replace("_", " "),
                                  build.__doc__.strip().splitlines()[0].rstrip("."), build, **facts)
        return build

    return entered


@dataclass(frozen=True, eq=False)
class Stage:
    """A scene to begin with.

    Attributes
    ----------
    scene : bpy.types.Scene
    folder : Path
        For files of the scene, which is saved there.
    camera, lamp, floor, ball, cube, cone : bpy.types.Object
    world : bpy.types.World
    """

    scene: object
    folder: Path
    camera: object
    lamp: object
    world: object
    floor: object
    ball: object
    cube: object
    cone: object

    def link(self, name, data, location=(0, 0, 0)):
        """A new object in the scene."""
        return link(self.scene, name, data, location)

    def remove(self, *things):
        """Remove objects from the scene."""
        for thing in things:
            bpy.data.objects.remove(thing)


def set_stage(folder, shape_px=SHAPE_PX, samples=SAMPLES):
    """An orange ball, a blue cube and a green cone on a grey table, by an area lamp and a grey world; three marks."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if hasattr(bpy.data, "colorspace"):  # added in 5.0; otherwise the previous file's
        bpy.ops.wm.set_working_color_space(working_space="Linear Rec.709")
    scene = bpy.context.scene
    _set_cycles(scene, shape_px, samples)
    camera = link(scene, "Camera", bpy.data.cameras.new("Camera"), (0.07, -1.24, 0.36))
    scene.camera, camera.data.lens = camera, 42
    look_at(camera, (0.02, 0, 0.12))
    camera.data.dof.focus_distance = FOCUS_M
    world = scene.world = bpy.data.worlds.new("World")
    world.use_nodes = True
    background(world).inputs["Color"].default_value = (0.35, 0.4, 0.5, 1)
    lamp = link(scene, "Key", bpy.data.lights.new("Key", "AREA"), (-0.9, -0.7, 1.1))
    lamp.data.energy, lamp.data.size = 12, 0.3
    look_at(lamp, (0, 0, 0.1))
    floor = link(scene, "Table", plane(1.6, painted("Table", PAINTS["Table"])), (0, 0.4, 0))
    ball = link(scene, "Ball", sphere(0.13, painted("Orange", PAINTS["Orange"], 0.35)), (-0.19, 0, 0.13))
    cube = link(scene, "Cube", box((0.18, 0.18, 0.18), painted("Blue", PAINTS["Blue"])), (0.2, -0.12, 0.09))
    cube.rotation_euler.z = radians(25)
    cone_ = link(scene, "Cone", cone(0.11, 0.3, painted("Green", PAINTS["Green"])), (0.1, 0.45, 0))
    for number, place in enumerate(((-0.33, -0.2, 0.3), (0.36, 0.1, 0.27), (0.02, 0.7, 0.36)), 1):
        link(scene, f"Mark {number}", sphere(0.02, glowing(f"Mark {number}", (1, 0.9, 0.8), MARK_WATTS)), place)
    return Stage(scene, Path(folder), camera, lamp, world, floor, ball, cube, cone_)


def _set_cycles(scene, shape_px, samples):
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.samples = samples
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.sampling_pattern = "TABULATED_SOBOL"  # independent noise in each pixel
    scene.render.resolution_y, scene.render.resolution_x = shape_px
    scene.render.resolution_percentage = 100


def link(scene, name, data, location=(0, 0, 0)):
    """A new object in a scene's own collection."""
    new = bpy.data.objects.new(name, data)
    new.location = location
    scene.collection.objects.link(new)
    return new


def look_at(thing, place):
    """Turn a camera or a lamp towards a place."""
    thing.rotation_euler = (Vector(place) - thing.location).to_track_quat("-Z", "Y").to_euler()


def background(world):
    """The Background node of a world."""
    return next(node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")


def world_from(world, node, strength=1.0, socket=0):
    """Link a node of a world to its Background."""
    shader = background(world)
    shader.inputs["Strength"].default_value = strength
    world.node_tree.links.new(node.outputs[socket], shader.inputs["Color"])


def painted(name, colour, roughness=0.5, **inputs):
    """A Principled material; `inputs` sets others, with underscores for spaces."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    shader = principled(material)
    shader.inputs["Base Color"].default_value = (*colour, 1)
    shader.inputs["Roughness"].default_value = roughness
    for input_name, value in inputs.items():
        shader.inputs[input_name.replace("_", " ")].default_value = value
    return material


def principled(material):
    """The Principled BSDF of a `painted` material."""
    return next(node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")


def shaded(name, node_type, **inputs):
    """A material of one shader node; returns it and the node."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    shader, output = nodes.new(node_type), nodes.new("ShaderNodeOutputMaterial")
    for input_name, value in inputs.items():
        shader.inputs[input_name.replace("_", " ")].default_value = value
    material.node_tree.links.new(shader.outputs[0], output.inputs["Volume" if "Volume" in node_type else "Surface"])
    return material, shader


def glowing(name, colour, strength):
    """A material that emits."""
    return shaded(name, "ShaderNodeEmission", Color=(*colour, 1), Strength=strength)[0]


def paint(thing, material):
    """Give an object one material."""
    thing.data.materials.clear()
    thing.data.materials.append(material)


def node_for(material, node_type, socket="Base Color", output=0, **values):
    """A new node that is linked to an input of a material's first shader; `values` sets its properties."""
    tree = material.node_tree
    node = tree.nodes.new(node_type)
    for name, value in values.items():
        setattr(node, name, value)
    shader = next(each for each in tree.nodes if socket in each.inputs and each.outputs
                  and each.outputs[0].type == "SHADER")
    tree.links.new(node.outputs[output], shader.inputs[socket])
    return node


def mesh_of(name, corners, faces, material):
    """A mesh with a material."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(map(float, corner)) for corner in corners], [], [tuple(map(int, face)) for face in faces])
    if material:
        mesh.materials.append(material)
    return mesh


def plane(half, material, name="Plane", rows=1):
    """A square with UVs, of this half side."""
    at = np.linspace(-half, half, rows + 1)
    corners = [(x, y, 0) for y in at for x in at]
    faces = [(row * (rows + 1) + column + np.array((0, 1, rows + 2, rows + 1)))
             for row in range(rows) for column in range(rows)]
    mesh = mesh_of(name, corners, faces, material)
    layer = mesh.uv_layers.new(name="UVMap")
    for loop in mesh.loops:
        x, y, _ = corners[loop.vertex_index]
        layer.data[loop.index].uv = ((x / half + 1) / 2, (y / half + 1) / 2)
    return mesh


def box(sides, material, name="Box"):
    """A box centred on its origin."""
    corners = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    faces = (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)
    return mesh_of(name, np.multiply(corners, sides), faces, material)


def sphere(radius, material, name="Ball", smooth=True, rings=16):
    """A ball of quads and two caps, with UVs of longitude and latitude."""
    columns = 2 * rings
    corners = [(0, 0, -radius), (0, 0, radius)]
    for ring in range(1, rings):
        tilt = np.pi * ring / rings - np.pi / 2
        corners += [(radius * np.cos(tilt) * np.cos(turn), radius * np.cos(tilt) * np.sin(turn), radius * np.sin(tilt))
                    for turn in 2 * np.pi * np.arange(columns) / columns]
    def at(ring, column):
        return 2 + (ring - 1) * columns + column % columns
    faces = [(0, at(1, c + 1), at(1, c)) for c in range(columns)]
    faces += [(at(r, c), at(r, c + 1), at(r + 1, c + 1), at(r + 1, c)) for r in range(1, rings - 1)
              for c in range(columns)]
    faces += [(1, at(rings - 1, c), at(rings - 1, c + 1)) for c in range(columns)]
    mesh = mesh_of(name, corners, faces, material)
    mesh.polygons.foreach_set("use_smooth", [smooth] * len(faces))
    return mesh


def cone(radius, height, material, name="Cone", sides=24):
    """A cone on the table."""
    turns = 2 * np.pi * np.arange(sides) / sides
    corners = [*((radius * np.cos(t), radius * np.sin(t), 0) for t in turns), (0, 0, height)]
    faces = [*((n, (n + 1) % sides, sides) for n in range(sides)), tuple(range(sides))[::-1]]
    return mesh_of(name, corners, faces, material)


def image(name, pixels, colour_space="sRGB", path=None, is_float=False):
    """An image of values (row, column, 3 or 4), row 0 at the bottom: packed, or saved to a path."""
    pixels = np.asarray(pixels, np.float32)
    if pixels.shape[-1] == 3:
        pixels = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
    rows, columns = pixels.shape[:2]
    new = bpy.data.images.new(name, columns, rows, alpha=True, float_buffer=is_float)
    new.colorspace_settings.name = colour_space
    new.pixels.foreach_set(pixels.ravel())
    new.update()
    if path is None:
        new.pack()
    else:
        new.filepath_raw, new.file_format = str(path), "OPEN_EXR" if is_float else "PNG"
        new.save()
    return new


def checks(rows=8, columns=8, first=(0.85, 0.2, 0.1), second=(0.15, 0.35, 0.8), times=4):
    """Pixels of a chequerboard, with one yellow field that shows turns and mirrors."""
    row, column = np.indices((rows, columns))
    pixels = np.where(((row + column) % 2)[..., None] == 0, first, second)
    pixels[1, 2] = 0.95, 0.85, 0.1
    return pixels.repeat(times, axis=0).repeat(times, axis=1)


def keyed(owner, path, values, index=-1):
    """Keyframe a property: values by frame, with straight lines between them."""
    for frame, value in values.items():
        if index < 0:
            setattr(owner, path, value)
        else:
            getattr(owner, path)[index] = value
        owner.keyframe_insert(path, frame=frame, index=index)
    action = (owner if isinstance(owner, bpy.types.ID) else owner.id_data).animation_data.action
    for curve in curves_of(action):
        curve.extrapolation = "LINEAR"
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"


def curves_of(action):
    """The F-curves of an action, if there is one."""
    if action is None:
        return []
    if hasattr(action, "layers") and action.layers:
        return [curve for layer in action.layers for strip in layer.strips for bag in strip.channelbags
                for curve in bag.fcurves]
    return list(action.fcurves)


def collection(stage, name, *things):
    """A new collection of the scene that things move to."""
    new = bpy.data.collections.new(name)
    stage.scene.collection.children.link(new)
    for thing in things:
        stage.scene.collection.objects.unlink(thing)
        new.objects.link(thing)
    return new


def layer_collection(layer, name):
    """A view layer's entry for a collection."""
    return next(child for child in layer.layer_collection.children if child.name == name)

