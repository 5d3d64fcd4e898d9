"""Textures: colour spaces, coordinates, attributes, UDIM tiles, sequences, and missing files."""

import bpy
import numpy as np

from .kit import box, checks, image, node_for, ordinary, painted, principled

COLOUR_SPACES = ("ACES2065-1", "ACEScg", "AgX Base Display P3", "AgX Base Rec.1886", "AgX Base sRGB", "AgX Log",
                 "Display P3", "Filmic Log", "Filmic sRGB", "Linear CIE-XYZ D65", "Linear CIE-XYZ E",
                 "Linear DCI-P3 D65", "Linear FilmLight E-Gamut", "Linear Rec.2020", "Linear Rec.709", "Non-Color",
                 "Rec.1886", "Rec.2020", "sRGB")


def _textured(stage, picture, thing="floor", **values):
    """Paint an object with an image; returns its node."""
    material = painted("Textured", (1, 1, 1))
    node = node_for(material, "ShaderNodeTexImage", **values)
    node.image = picture
    getattr(stage, thing).data.materials[0] = material
    return node


def _linked(node, socket, output, kind="ShaderNodeTexCoord"):
    tree = node.id_data
    source = tree.nodes.new(kind)
    tree.links.new(source.outputs[output], node.inputs[socket])
    return source


@ordinary()
def srgb_texture(stage):
    """An sRGB image, packed"""
    _textured(stage, image("checks.png", checks()))


@ordinary()
def texture_file(stage):
    """An image next to the .blend, by a relative path"""
    picture = image("tiles.png", checks(), path=stage.folder / "tiles.png")
    picture.filepath = str(stage.folder / "tiles.png")
    _textured(stage, picture)


@ordinary()
def float_texture(stage):
    """A linear float image with values above 1"""
    _textured(stage, image("bright.exr", checks(first=(1.6, 0.4, 0.2)), "Linear Rec.709",
                           stage.folder / "bright.exr", is_float=True))


@ordinary()
def non_color_texture(stage):
    """A Non-Color image as a roughness, and another as a colour"""
    node = node_for(stage.floor.data.materials[0], "ShaderNodeTexImage", "Roughness")
    node.image = image("rough.png", checks(first=(0.2, 0.2, 0.2), second=(0.8, 0.8, 0.8)), "Non-Color")
    _textured(stage, image("data.png", checks(), "Non-Color"), "cube")


@ordinary()
def acescg_texture(stage):
    """An ACEScg image"""
    _textured(stage, image("aces.exr", checks(), "ACEScg", stage.folder / "aces.exr", is_float=True))


@ordinary()
def display_texture(stage):
    """Images in Filmic sRGB and Rec. 1886"""
    _textured(stage, image("filmic.png", checks(), "Filmic sRGB"))
    _textured(stage, image("broadcast.png", checks(), "Rec.1886"), "cube")


@ordinary()
def every_colour_space(stage):
    """A wall of tiles, each in one of Blender's colour spaces"""
    for number, space in enumerate(COLOUR_SPACES):
        material = painted(space, (1, 1, 1))
        picture = image(f"{space}.png", np.tile((0.45, 0.4, 0.35), (4, 4, 1)))
        try:
            picture.colorspace_settings.name = space
        except TypeError:  # of another Blender
            continue
        node_for(material, "ShaderNodeTexImage").image = picture
        row, column = divmod(number, 10)
        stage.link(space, box((0.065, 0.02, 0.065), material), (-0.32 + 0.075 * column, -0.4, 0.04 + 0.075 * row))


@ordinary()
def alpha_modes(stage):
    """Alpha: premultiplied, channel packed and none"""
    for thing, mode in (("ball", "PREMUL"), ("cube", "CHANNEL_PACKED"), ("floor", "NONE")):
        pixels = np.concatenate([checks(), np.full((32, 32, 1), 0.5)], axis=-1)
        picture = image(f"{mode}.png", pixels)
        picture.alpha_mode = mode
        _textured(stage, picture, thing)


@ordinary()
def generated_texture(stage):
    """A generated colour grid"""
    picture = bpy.data.images.new("Grid", 64, 64)
    picture.generated_type = "COLOR_GRID"
    _textured(stage, picture)


@ordinary()
def box_projection(stage):
    """Box projection by object coordinates of another object"""
    empty = stage.link("Frame", None, (0.1, 0, 0))
    empty.rotation_euler.z, empty.scale = 0.5, (0.3, 0.3, 0.3)
    node = _textured(stage, image("box.png", checks()), projection="BOX")
    node.projection_blend = 0.3
    _linked(node, "Vector", "Object").object = empty


@ordinary()
def camera_coordinates(stage):
    """Texture coordinates of the camera"""
    _linked(_textured(stage, image("camera.png", checks())), "Vector", "Camera")


@ordinary()
def window_coordinates(stage):
    """Texture coordinates of the window"""
    _linked(_textured(stage, image("window.png", checks())), "Vector", "Window")


@ordinary()
def window_coordinates_shifted(stage):
    """Texture coordinates of the window, with a shifted camera"""
    stage.camera.data.shift_x, stage.camera.data.shift_y = 0.1, -0.06
    window_coordinates(stage)


@ordinary()
def reflection_coordinates(stage):
    """Reflection, normal and generated coordinates"""
    for thing, output in (("ball", "Reflection"), ("cube", "Generated"), ("cone", "Normal")):
        _linked(_textured(stage, image(f"{output}.png", checks()), thing), "Vector", output)


@ordinary()
def vertex_colours(stage):
    """Colour attributes of corners and of points"""
    colours = stage.cube.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    values = np.random.default_rng(4).uniform(0.05, 0.9, (8, 4)).astype(np.float32)
    colours.data.foreach_set("color", values.ravel())
    material = painted("Painted", (1, 1, 1))
    node_for(material, "ShaderNodeVertexColor", output="Color").layer_name = "Paint"
    stage.cube.data.materials[0] = material


@ordinary()
def attributes(stage):
    """Attributes of the object, the view layer and the mesh"""
    stage.ball["tint"] = (0.7, 0.2, 0.5)
    stage.scene["mood"] = (0.2, 0.5, 0.4)
    weights = stage.cone.data.attributes.new("weight", "FLOAT", "POINT")
    weights.data.foreach_set("value", np.linspace(0, 1, len(stage.cone.data.vertices)).astype(np.float32))
    for thing, name, kind, output in (("ball", "tint", "OBJECT", "Color"), ("cube", "mood", "VIEW_LAYER", "Color"),
                                      ("cone", "weight", "GEOMETRY", "Fac")):
        material = painted(name, (1, 1, 1))
        node = node_for(material, "ShaderNodeAttribute", output=output)
        node.attribute_type, node.attribute_name = kind, name
        getattr(stage, thing).data.materials[0] = material


@ordinary()
def udim(stage):
    """UDIM tiles"""
    for tile, first in ((1001, (0.8, 0.2, 0.1)), (1002, (0.1, 0.6, 0.3))):
        bpy.data.images.remove(image("tile", checks(first=first), path=stage.folder / f"tiles.{tile}.png"))
    tiled = bpy.data.images.load(str(stage.folder / "tiles.1001.png"))
    tiled.source, tiled.filepath = "TILED", str(stage.folder / "tiles.<UDIM>.png")
    if not any(tile.number == 1002 for tile in tiled.tiles):
        tiled.tiles.new(1002)
    layer = stage.floor.data.uv_layers[0]
    for loop in layer.data:
        loop.uv.x *= 2
    _textured(stage, tiled)


@ordinary()
def image_sequence(stage):
    """An image sequence, at its third frame"""
    for frame, first in ((1, (0.8, 0.1, 0.1)), (2, (0.1, 0.8, 0.1)), (3, (0.8, 0.7, 0.1))):
        bpy.data.images.remove(image("frame", checks(first=first), path=stage.folder / f"frame_{frame:04d}.png"))
    sequence = bpy.data.images.load(str(stage.folder / "frame_0001.png"))
    sequence.source = "SEQUENCE"
    node = _textured(stage, sequence)
    node.image_user.frame_duration, node.image_user.use_auto_refresh = 3, True
    stage.scene.frame_set(3)


@ordinary()
def missing_image(stage):
    """An image whose file is missing, which Blender shows in magenta"""
    picture = image("gone.png", checks(), path=stage.folder / "gone.png")
    picture.filepath = str(stage.folder / "gone.png")
    _textured(stage, picture, "cube")
    (stage.folder / "gone.png").unlink()
    picture.reload()


@ordinary()
def image_extension(stage):
    """Closest filtering, a mirrored and a clipped image"""
    node = _textured(stage, image("mirror.png", checks()), interpolation="Closest", extension="MIRROR")
    mapping = _linked(node, "Vector", 0, "ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = 2.5, 1.5, 1
    _linked(mapping, "Vector", "UV")
    clipped = _textured(stage, image("clip.png", checks()), "cube", extension="CLIP")
    _linked(_linked(clipped, "Vector", 0, "ShaderNodeMapping"), "Vector", "Generated")


@ordinary()
def texture_and_tint(stage):
    """A texture multiplied by a colour, with a mask"""
    node = _textured(stage, image("base.png", checks()))
    tree = node.id_data
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
    mix.inputs[0].default_value, mix.inputs["B"].default_value = 0.7, (0.9, 0.7, 0.5, 1)
    tree.links.new(node.outputs[0], mix.inputs["A"])
    tree.links.new(mix.outputs["Result"], principled(stage.floor.data.materials[0]).inputs["Base Color"])
