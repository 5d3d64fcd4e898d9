"""The nodes of the compositor's Lensfield group: files, and switches between them and the plain render."""

import bpy

BACKGROUND_M = 1e10
BLACK = 0.0, 0.0, 0.0, 1.0
SWITCHED = {"Image": "lens_image", "Depth": "depth", "Stray Light": "stray_light"}
"""Outputs that show a frame's files, or else the plain render, without stray light."""
PLAIN = "Image", "Depth"  # inputs: the plain render
STILLS = {"Relative Illumination": "relative_illumination", "STMap Distort": "stmap_distort",
          "STMap Undistort": "stmap_undistort"}
OUTPUTS = {"Image": "Color", "Alpha": "Float", "Depth": "Float", "Stray Light": "Color",
           "Relative Illumination": "Float", "STMap Distort": "Color", "STMap Undistort": "Color"}
DEPTH_IN_UNITS = "Depth in Blender Units"  # name of the node that converts a file's metres


def is_intact(group):
    """Whether a group has its nodes."""
    return all(name in group.nodes for name in (*SWITCHED, *STILLS, *(f"{name} Switch" for name in SWITCHED)))


def build(group):
    """Create the sockets and nodes of a group."""
    group.nodes.clear()
    group.interface.clear()
    for name in PLAIN:
        socket = group.interface.new_socket(name=name, in_out="INPUT", socket_type=f"NodeSocket{OUTPUTS[name]}")
        if name == "Depth":
            socket.default_value, socket.hide_value = BACKGROUND_M, True
    for name, kind in OUTPUTS.items():
        group.interface.new_socket(name=name, in_out="OUTPUT", socket_type=f"NodeSocket{kind}")
    group_input, group_output = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    group_input.location.x, group_output.location.x = -300, 600
    for row, name in enumerate((*SWITCHED, *STILLS)):
        source = group.nodes.new("CompositorNodeImage")
        source.name = source.label = name
        source.location.y = -350 * row
        picture = add_scale(group, name, source.outputs["Image"], smooth=name != "Depth")  # depths must not mix
        if name == "Depth":
            picture = _add_units(group, picture)
        if name in SWITCHED:
            picture = add_switch(group, name, group_input.outputs.get(name), picture)
        link_to(group, picture, group_output.inputs[name])
        if name == "Image":
            link_to(group, picture, group_output.inputs["Alpha"], "Alpha")


def add_scale(group, name, picture, smooth):
    """Scale a file to the frame: the viewport's compositor has a different resolution from a render."""
    scale = group.nodes.new("CompositorNodeScale")
    scale.name = f"{name} Scale"
    scale.location = picture.node.location.x + 200, picture.node.location.y
    group.links.new(picture, scale.inputs["Image"])
    if "Type" in scale.inputs:
        scale.inputs["Type"].default_value = "Render Size"
        scale.inputs["Interpolation"].default_value = "Bilinear" if smooth else "Nearest"
    else:
        scale.space, scale.interpolation = "RENDER_SIZE", "BILINEAR" if smooth else "NEAREST"
    return scale.outputs["Image"]


def _add_units(group, depth_m):
    """Convert depth in metres to Blender units, as in the plain render."""
    parts = group.nodes.new("CompositorNodeSeparateColor")
    divided = group.nodes.new("ShaderNodeMath" if bpy.app.version >= (5, 0, 0) else "CompositorNodeMath")
    divided.name, divided.operation = DEPTH_IN_UNITS, "MULTIPLY"
    x, y = depth_m.node.location
    parts.location, divided.location = (x, y - 150), (x, y - 300)
    group.links.new(depth_m, parts.inputs[0])
    group.links.new(parts.outputs["Red"], divided.inputs[0])
    return divided.outputs[0]


def switch_of(group, name):
    """The switch of an output, or None."""
    return group.nodes.get(f"{name} Switch")


def add_switch(group, name, off, on):
    """Switch between two sockets; without the first, between black and the second."""
    switch = group.nodes.new("CompositorNodeSwitch")
    switch.name = switch.label = f"{name} Switch"
    switch.location = on.node.location.x + 200, on.node.location.y
    if off:
        group.links.new(off, switch.inputs["Off"])
    else:
        switch.inputs["Off"].default_value = BLACK
    group.links.new(on, switch.inputs["On"])
    return switch.outputs[0]


def link_to(group, picture, target, channel="Red"):
    """Link a picture to an output, or one of its channels to a float output."""
    if target.type == "VALUE":
        parts = group.nodes.new("CompositorNodeSeparateColor")
        parts.name = f"{target.name} Part"
        parts.location = 400, target.node.inputs.find(target.name) * -100
        group.links.new(picture, parts.inputs[0])
        picture = parts.outputs[channel]
    group.links.new(picture, target)
