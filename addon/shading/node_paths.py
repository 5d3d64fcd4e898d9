"""Tracing inputs backwards through a node tree as Cycles does: past reroutes and muted nodes, in and out of groups."""

from ..scene.instances import nodes_within, uses_nodes

CONSTANT_NODES = {"ShaderNodeRGB", "ShaderNodeValue"}
GLOWING_TYPES = {"RGBA", "VECTOR", "VALUE", "INT", "BOOLEAN"}


def feeding(socket):
    """The output that feeds an input, past reroutes and muted nodes, or None if the input's value applies.

    The value also applies after a muted link, an unlinked reroute, or a muted node without an internal link.
    """
    while socket is not None and socket.is_linked and not socket.links[0].is_muted:
        output = socket.links[0].from_socket
        if output.node.mute:
            socket = next((link.from_socket for link in output.node.internal_links if link.to_socket == output), None)
        elif output.node.bl_idname == "NodeReroute":
            socket = output.node.inputs[0]
        else:
            return output
    return None


def glowing_colour(socket):
    """The colour or number linked to a shader input, which Cycles turns into emission, or None."""
    output = feeding(socket) if socket.type == "SHADER" else None
    return output if output is not None and output.type in GLOWING_TYPES else None


def source_of(socket, groups=()):
    """The source of an input, through groups.

    Parameters
    ----------
    socket : bpy.types.NodeSocket
    groups : tuple of bpy.types.ShaderNodeGroup
        The group nodes around its node, outermost first.

    Returns
    -------
    the output, or None if an input's value applies; the groups around it; the last input on the way, which has the
    value
    """
    while (output := feeding(socket)) is not None:
        node = output.node
        if node.bl_idname == "NodeGroupInput" and groups:
            socket, groups = _same(groups[-1].inputs, output), groups[:-1]
        elif node.bl_idname == "ShaderNodeGroup" and (inside := _inside(node, output)):
            socket, groups = inside, (*groups, node)
        else:
            return output, groups, socket
    return None, groups, socket


def constant_of(socket, groups=()):
    """The constant value of an input, a number or a tuple as its type requires; None if nodes compute it."""
    source, _, holder = source_of(socket, groups)
    if source is not None:
        if source.node.bl_idname not in CONSTANT_NODES:
            return None
        holder = source
    value = holder.default_value
    values = tuple(value) if hasattr(value, "__len__") else (value,) * 3
    return values if socket.type in ("RGBA", "VECTOR") else sum(values[:3]) / len(values[:3])


def window_outputs(nodes):
    """Generator of the linked outputs of these nodes that give Window coordinates."""
    for node in nodes:
        if node.bl_idname == "ShaderNodeTexCoord" and not node.mute and node.outputs["Window"].is_linked:
            yield node.outputs["Window"]


def uses_window(block):
    """Whether a material, light or world uses Window coordinates."""
    return uses_nodes(block) and any(window_outputs(nodes_within(block.node_tree)))


def _inside(group, output):
    """The input of the Group Output node inside a group that corresponds to the group's output, or None."""
    nodes = group.node_tree.nodes if group.node_tree else ()
    active = next((node for node in nodes if node.bl_idname == "NodeGroupOutput" and node.is_active_output), None)
    return active and _same(active.inputs, output)


def _same(sockets, socket):
    return next((other for other in sockets if other.identifier == socket.identifier), None)
