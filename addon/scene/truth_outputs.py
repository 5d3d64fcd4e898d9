"""Outputs of the compositor's Lensfield node for ground truth, with the names and types that Render Layers gives them.

One Image node reads the layers of a frame's file. A file has the passes that were requested for its frame, so each
output has a switch of its own; elsewhere it passes on the plain render's pass.
"""

import os

import bpy

from lensfield.engine.pictures.spectral_exr import read_parts

from .compositor_group import BACKGROUND_M, add_scale, add_switch, link_to, switch_of

INDICES = ("Object Index", "Material Index") if bpy.app.version >= (5, 0) else ("IndexOB", "IndexMA")
"""Blender's names of the passes with pass indices."""
GROUND_TRUTH = "Ground Truth"  # name of the Image node
OF_PRODUCT = {"depth": ("Distance",), "position": ("Position",), "normal": ("Normal",), "uv": ("UV",),
              "flow": ("Vector",), "index": INDICES}
"""Outputs by kind of ground truth. Depth is always an output of the node; Cryptomatte requires Blender's node for it,
which reads the file itself."""
OUTPUTS = tuple(name for names in OF_PRODUCT.values() for name in names)
IN_METRES = "Distance", "Position"
NUMBERS = "Distance", *INDICES  # the others are vectors
FOUR_NUMBERS = "Vector"
LOWEST = -2450  # location of the nodes, below the others


def passes_in(path):
    """Names of the passes in a file with ground truth: list of str; none without a file."""
    if not os.path.isfile(path):
        return []
    channels = [channel for header, _ in read_parts(path, header_only=True) for channel in header["channel names"]]
    return sorted({channel.rpartition(".")[0].rpartition(".")[2] for channel in channels})


def truth_outputs(group):
    """Names of the outputs for ground truth that a group has."""
    return [name for name in OUTPUTS if switch_of(group, name) and _scale_of(group, name)]


def is_read(group, name):
    """Whether the group's file has the pass of an output."""
    return _scale_of(group, name).inputs["Image"].is_linked


def add_file(group):
    """The Image node for files with ground truth, created if necessary."""
    source = group.nodes.get(GROUND_TRUTH)
    if source is None:
        source = group.nodes.new("CompositorNodeImage")
        source.name = source.label = GROUND_TRUTH
        source.location.y = LOWEST
    return source


def add_outputs(group):
    """Give a group outputs for the passes of its file; returns the names of the new ones."""
    passes = {socket.name: socket for socket in group.nodes[GROUND_TRUTH].outputs}
    new = [name for name in OUTPUTS if name in passes and name not in truth_outputs(group)]
    for name in new:
        remove_output(group, name)  # the rest of an output that was edited
        _add_output(group, name, passes[name])
    for name in truth_outputs(group):
        if name in passes:  # the file before may not have had it
            group.links.new(passes[name], _scale_of(group, name).inputs["Image"])
    return new


def _add_output(group, name, picture):
    for in_out in ("INPUT", "OUTPUT"):
        kind = "Float" if name in NUMBERS else "Vector"
        socket = group.interface.new_socket(name=name, in_out=in_out, socket_type=f"NodeSocket{kind}")
        if name == FOUR_NUMBERS:
            socket.dimensions = 4
        if in_out == "INPUT":
            socket.hide_value = True
            if name == "Distance":
                socket.default_value = BACKGROUND_M
    ends = {node.bl_idname: node for node in group.nodes}
    picture = add_scale(group, name, picture, smooth=False)
    picture.node.location.y -= 200 * len(truth_outputs(group))
    if name in IN_METRES:
        picture = _add_units(group, name, picture)
    picture = add_switch(group, name, ends["NodeGroupInput"].outputs[name], picture)
    link_to(group, picture, ends["NodeGroupOutput"].inputs[name])


def _add_units(group, name, metres):
    """Convert lengths in metres to Blender units, in each channel."""
    scaled = group.nodes.new("ShaderNodeVectorMath")
    scaled.name, scaled.operation = f"{name} Units", "SCALE"
    scaled.location = metres.node.location.x, metres.node.location.y - 150
    group.links.new(metres, scaled.inputs["Vector"])
    return scaled.outputs["Vector"]


def set_unit(group, unit_m):
    """Set the length of a Blender unit in the outputs for ground truth."""
    for node in (group.nodes.get(f"{name} Units") for name in IN_METRES):
        if node:
            node.inputs["Scale"].default_value = 1 / unit_m


def remove_output(group, name):
    """Remove an output for ground truth."""
    for node in [node for node in group.nodes if node.name.startswith(f"{name} ")]:
        group.nodes.remove(node)
    for item in [item for item in group.interface.items_tree if item.name == name]:
        group.interface.remove(item)


def _scale_of(group, name):
    return group.nodes.get(f"{name} Scale")
