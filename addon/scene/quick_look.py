"""Quick Look: a node group that shows an ordinary render through a lens, in any compositor and without the add-on.

Tables in packed images hold the lens: from its axis to the corners of its sensor, or over x and y if it is not
rotationally symmetric. The group works for every resolution and for every shape of the frame, which it fits into the
sensor.
"""

import bpy
import numpy as np

from lensfield.engine.look.lens_curves import POINTS, LensCurves
from lensfield.engine.look.lens_maps import LensMaps
from lensfield.engine.look.lens_tables import NODES

from .compositor import QUICK_LOOK

NAME = "Quick Look"
CURVES, BOKEH = "Lens", "Bokeh"  # names of nodes
MAP_X, MAP_Y = "Lens X", "Lens Y"  # instead of CURVES, for a lens without rotational symmetry
SENSOR_WIDTH, SENSOR_HEIGHT, BLUR = "Sensor Width", "Sensor Height", "Blur"
SHIFT_X, SHIFT_Y = "Shift X", "Shift Y"
COLOURS = "Red", "Green", "Blue"
MOST_BLUR = 0.01  # radius in longer sides of the picture: the time of Bokeh Blur rises with its square


def new_quick_look():
    """A Quick Look group without a lens."""
    group = bpy.data.node_groups.new(NAME, "CompositorNodeTree")
    group[QUICK_LOOK] = ""
    for name, kind in (("Image", "Color"), ("Depth", "Float"), ("Focus Distance", "Float"), ("F-Stop", "Float")):
        socket = group.interface.new_socket(name=name, in_out="INPUT", socket_type=f"NodeSocket{kind}")
        socket.hide_value = name == "Depth"
        if name == "Focus Distance":
            socket.subtype, socket.description = "DISTANCE", "Distance of sharp things from the camera; 0: infinity"
        if name != "Image":
            socket.min_value = 0.0
    for name, kind in (("Image", "Color"), ("Alpha", "Float"), ("Depth", "Float")):
        group.interface.new_socket(name=name, in_out="OUTPUT", socket_type=f"NodeSocket{kind}")
    _build(group, _look_up_curves)
    return group


def set_lens(group, lens: LensCurves | LensMaps, scale=1.0, unit_mm=1000.0, blurs=True):
    """Show a lens in a Quick Look group.

    Parameters
    ----------
    group : bpy.types.NodeTree
    lens : LensCurves or LensMaps
    scale : float
        Pixels per tangent of an angle in the camera's picture, relative to the lens's on the axis.
    unit_mm : float
        Length of a Blender unit.
    blurs : bool
        Whether the group blurs by depth.
    """
    tables, look_up = _tables(lens, scale, unit_mm)
    if not tables.keys() <= set(group.nodes.keys()):
        _clear(group)
        _build(group, look_up)
    for name, table in tables.items():
        _set_pixels(group.nodes[name], f"{group.name} {name}", table)
    bokeh = np.repeat(lens.bokeh[::-1, ::-1, None], 4, axis=2)  # turned, as of a distant point
    bokeh[:, :, 3] = 1
    _set_pixels(group.nodes[BOKEH], f"{group.name} Bokeh", bokeh)
    radius = lens.bokeh_mm / unit_mm / 4 if blurs else 0.0  # half of the side, in units of two
    for name, value in zip((SENSOR_WIDTH, SENSOR_HEIGHT, SHIFT_X, SHIFT_Y, BLUR),
                           (*lens.sensor, *lens.shift, radius), strict=True):
        if name in group.nodes:  # maps are not shifted
            group.nodes[name].outputs[0].default_value = value


def _tables(lens, scale, unit_mm):
    """Pixels for the image nodes of a lens, by name, and the function that builds the nodes which look them up."""
    if isinstance(lens, LensCurves):
        return {CURVES: np.column_stack([lens.sources * scale - 1, lens.illumination])[None]}, _look_up_curves
    x, y = np.moveaxis(lens.sources * scale - lens.places[:, :, None], -1, 0)
    return {MAP_X: np.dstack([x, lens.illumination]), MAP_Y: np.dstack([y, lens.lean * unit_mm])}, _look_up_maps


def _clear(group):
    """Remove the nodes of a group, and their images."""
    images = [node.image for node in group.nodes if node.bl_idname == "CompositorNodeImage"]
    group.nodes.clear()
    bpy.data.batch_remove([image for image in images if image])


def _set_pixels(node, name, pixels):
    """Show pixels, from the lower left, in an image node; the .blend contains them."""
    rows, columns, _ = pixels.shape
    if node.image is None:
        node.image = bpy.data.images.new(name, columns, rows, alpha=True, float_buffer=True, is_data=True)
        node.image.alpha_mode = "CHANNEL_PACKED"
    node.image.pixels.foreach_set(np.ascontiguousarray(pixels, dtype=np.float32).ravel())
    node.image.update()
    node.image.pack()
    node.image.update_tag()


def _build(group, look_up):
    """Create the nodes of a group; `look_up` creates the nodes for the tables."""
    given, results = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    picture, depth, focus, f_stop, *_ = given.outputs
    longer_px, per_sensor = _size(group, picture)
    back_px = _math(group, "MULTIPLY", longer_px, -0.5)  # Displace looks up against its displacement
    moves, illumination, lean = look_up(group, picture, per_sensor, back_px)
    moved = {colour: _parts(group, _displaced(group, picture, moves[colour])) for colour in COLOURS}
    light = [_math(group, "MULTIPLY", moved[colour][colour], illumination) for colour in COLOURS]
    depth = _parts(group, _displaced(group, depth, moves["Green"], "Nearest"))["Red"]
    sharp = _node(group, "CompositorNodeCombineColor", *light, moved["Green"]["Alpha"]).outputs[0]
    blur = _blur(group, depth, focus, f_stop, per_sensor, lean)
    picture = _blurred(group, sharp, blur, longer_px)
    for source, target in zip((picture, _parts(group, picture)["Alpha"], depth), results.inputs, strict=False):
        group.links.new(source, target)
    _arrange(group)


def _place(group, picture, per_sensor):
    """The place of a pixel, from the axis, in halves of the longer side."""
    from_middle = _node(group, "CompositorNodeImageCoordinates", picture).outputs["Uniform"]
    shift = (_math(group, "DIVIDE", _value(group, name), per_sensor) for name in (SHIFT_X, SHIFT_Y))
    return _node(group, "ShaderNodeVectorMath", from_middle, _node(group, "ShaderNodeCombineXYZ", *shift).outputs[0]
                 ).outputs[0]


def _size(group, picture):
    """The longer side in pixels, and half of it in the unit of LensCurves."""
    size = _node(group, "CompositorNodeImageInfo", picture).outputs["Dimensions"]
    across, up, _ = _node(group, "ShaderNodeSeparateXYZ", size).outputs
    longer_px = _math(group, "MAXIMUM", across, up)
    per_px = _math(group, "MINIMUM", *(_math(group, "DIVIDE", _value(group, name), side)
                                       for name, side in ((SENSOR_WIDTH, across), (SENSOR_HEIGHT, up))))
    return longer_px, _math(group, "MULTIPLY", _math(group, "MULTIPLY", longer_px, per_px), 0.5)


def _look_up_curves(group, picture, per_sensor, back_px):
    """Displacements of the colours in pixels, illumination and lean of a lens with LensCurves."""
    place = _place(group, picture, per_sensor)
    radius = group.nodes.new("ShaderNodeVectorMath")
    radius.operation = "LENGTH"
    group.links.new(place, radius.inputs[0])
    along = _math(group, "MULTIPLY", radius.outputs["Value"], per_sensor)
    column = _math(group, "MULTIPLY_ADD", along, (POINTS - 1) / POINTS, 0.5 / POINTS)  # the middles of pixels
    curves = _looked_up(group, CURVES, column, 0.5)
    moves = {colour: _vector(group, "SCALE", place, scale=_math(group, "MULTIPLY", curves[colour], back_px))
             for colour in COLOURS}
    return moves, curves["Alpha"], None


def _look_up_maps(group, picture, per_sensor, back_px):
    """The same of a lens with LensMaps."""
    from_middle = _node(group, "CompositorNodeImageCoordinates", picture).outputs["Uniform"]
    places = _node(group, "ShaderNodeSeparateXYZ", from_middle).outputs
    at = [_math(group, "MULTIPLY_ADD", _math(group, "DIVIDE", _math(group, "MULTIPLY", place, per_sensor),
                                             _value(group, name)), (NODES - 1) / NODES, 0.5)
          for place, name in zip(places, (SENSOR_WIDTH, SENSOR_HEIGHT), strict=False)]
    x, y = (_looked_up(group, name, *at) for name in (MAP_X, MAP_Y))
    per_unit_px = _math(group, "DIVIDE", back_px, per_sensor)
    moves = {colour: _vector(group, "SCALE", _node(group, "ShaderNodeCombineXYZ", x[colour], y[colour]).outputs[0],
                             scale=per_unit_px) for colour in COLOURS}
    return moves, x["Alpha"], y["Alpha"]


def _looked_up(group, name, column, row):
    """The values of a table at a column and a row, from 0 to 1: sockets by colour, and Alpha."""
    at = _node(group, "ShaderNodeCombineXYZ", column, row, 1.0).outputs[0]
    table = _node(group, "CompositorNodeImage", name=name)
    lookup = _node(group, "CompositorNodeMapUV", table.outputs["Image"], at)
    if hasattr(lookup, "filter_type"):  # before 5.0
        lookup.filter_type = "ANISOTROPIC"
    return _parts(group, lookup.outputs[0])


def _displaced(group, picture, move, interpolation="Bilinear"):
    displace = _node(group, "CompositorNodeDisplace", picture, move)
    if "X Scale" in displace.inputs:  # before 5.0
        displace.inputs["X Scale"].default_value = displace.inputs["Y Scale"].default_value = 1
    else:
        displace.inputs["Interpolation"].default_value = interpolation
    return displace.outputs[0]


def _blur(group, depth, focus, f_stop, per_sensor, lean):
    """Radius of the blur in longer sides; 0 without a depth. In these nodes, a division by 0 gives 0."""
    nearness = _math(group, "SUBTRACT", _math(group, "DIVIDE", 1.0, depth), _math(group, "DIVIDE", 1.0, focus))
    nearness = _math(group, "SUBTRACT", nearness, lean) if lean else nearness
    per_nearness = _math(group, "DIVIDE", _math(group, "DIVIDE", _value(group, BLUR), f_stop), per_sensor)
    blur = _math(group, "MULTIPLY", _math(group, "ABSOLUTE", nearness), per_nearness)
    known = _math(group, "GREATER_THAN", depth, 0.0)
    return _math(group, "MINIMUM", _math(group, "MULTIPLY", blur, known), MOST_BLUR)


def _blurred(group, picture, radius, longer_px):
    bokeh = _node(group, "CompositorNodeImage", name=BOKEH).outputs["Image"]
    blur = _node(group, "CompositorNodeBokehBlur", picture, bokeh)
    in_percent = hasattr(blur, "use_variable_size")  # before 5.0; since then, in pixels
    group.links.new(_math(group, "MULTIPLY", radius, 100.0 if in_percent else longer_px), blur.inputs["Size"])
    if in_percent:
        blur.use_variable_size, blur.blur_max = True, 100 * MOST_BLUR
    return blur.outputs[0]


def _math(group, operation, *values):
    return _node(group, "ShaderNodeMath", *values, operation=operation).outputs[0]


def _vector(group, operation, vector, scale):
    node = _node(group, "ShaderNodeVectorMath", vector, operation=operation)
    group.links.new(scale, node.inputs["Scale"])
    return node.outputs[0]


def _value(group, name):
    return (group.nodes.get(name) or _node(group, "ShaderNodeValue", name=name)).outputs[0]


def _parts(group, colour):
    return _node(group, "CompositorNodeSeparateColor", colour).outputs


def _node(group, kind, *values, **settings):
    """A new node: its first inputs are linked to sockets, or hold numbers."""
    node = group.nodes.new(kind)
    for name, setting in settings.items():
        setattr(node, name, setting)
    for socket, value in zip(node.inputs, values, strict=False):
        if isinstance(value, bpy.types.NodeSocket):
            group.links.new(value, socket)
        else:
            socket.default_value = value
    return node


def _arrange(group):
    """Place the nodes in columns, by the number of steps before each."""
    column = {}
    for node in group.nodes:
        _column_of(node, column)
    rows = dict.fromkeys(column.values(), 0)
    for node, at in column.items():
        node.location = 180 * at, -160 * rows[at]
        rows[at] += 1


def _column_of(node, column):
    if node not in column:
        sources = [link.from_node for socket in node.inputs for link in socket.links]
        column[node] = 1 + max((_column_of(source, column) for source in sources), default=-1)
    return column[node]
