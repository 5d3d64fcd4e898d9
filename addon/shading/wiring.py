"""Wiring: the nodes that substitution adds to the trees of stand-ins."""

import bpy


def single_shader(data_block, shader_type, output_type, colour):
    """Give a data-block without nodes the node tree that its colour is equivalent to."""
    if hasattr(data_block, "use_nodes"):  # Blender 6.0 removes it, because every tree is in use
        data_block.use_nodes = True
    tree = data_block.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(shader_type)
    shader.inputs["Color"].default_value = colour
    tree.links.new(shader.outputs[0], tree.nodes.new(output_type).inputs[0])


def emission_between(tree, colour, socket):
    """Insert an Emission node between a colour and a shader input, as Cycles does implicitly."""
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(colour, emission.inputs["Color"])
    tree.links.new(emission.outputs[0], socket)


def attribute_node(tree, property_name):
    """Add a node that reads a property of the scene."""
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_type = "VIEW_LAYER"
    node.attribute_name = property_name
    return node


def unfolded(tree, node):
    """The colour of a node from `attribute_node`, through nodes that leave it as it is, but keep Cycles from replacing
    it by a constant before it renders. The output's node is labelled with the property."""
    zero = tree.nodes.new("ShaderNodeMath")
    zero.operation, zero.inputs[1].default_value = "MINIMUM", 0.0
    tree.links.new(tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"], zero.inputs[0])
    total = tree.nodes.new("ShaderNodeVectorMath")
    total.operation, total.label = "ADD", node.attribute_name
    tree.links.new(node.outputs["Color"], total.inputs[0])
    tree.links.new(zero.outputs[0], total.inputs[1])
    return total.outputs[0]


def constant_instead(tree, node):
    """Replace a node from `attribute_node` by one with constants, labelled with the property; returns it."""
    constant = tree.nodes.new("ShaderNodeCombineXYZ")
    constant.label = node.attribute_name
    for link in [link for output in node.outputs for link in output.links]:
        tree.links.new(constant.outputs[0], link.to_socket)
    tree.nodes.remove(node)
    return constant


def property_of(node):
    """The name of the property whose value a node from `attribute_node`, `unfolded` or `constant_instead` has."""
    return node.attribute_name if node.bl_idname == "ShaderNodeAttribute" else node.label


def multiplied(tree, first, second):
    """The output of a new node that multiplies two others, each wavelength separately."""
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "MULTIPLY"
    tree.links.new(first, node.inputs[0])
    tree.links.new(second, node.inputs[1])
    return node.outputs[0]


def upsampler(name, row_properties):
    """Create a node group: colour -> its values at the pass's three wavelengths, clamped at 0.

    `row_properties` names one scene property per wavelength, each with the basis for red, green and blue there.
    """
    group = bpy.data.node_groups.new(name, "ShaderNodeTree")
    group.interface.new_socket(name="Color", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket(name="Spectral", in_out="OUTPUT", socket_type="NodeSocketColor")
    colour = group.nodes.new("NodeGroupInput").outputs[0]
    combine = group.nodes.new("ShaderNodeCombineColor")
    for channel, row in enumerate(row_properties):
        product = group.nodes.new("ShaderNodeVectorMath")
        product.operation = "DOT_PRODUCT"
        group.links.new(colour, product.inputs[0])
        group.links.new(attribute_node(group, row).outputs["Vector"], product.inputs[1])
        group.links.new(product.outputs["Value"], combine.inputs[channel])
    cut = group.nodes.new("ShaderNodeVectorMath")
    cut.operation = "MAXIMUM"
    group.links.new(combine.outputs[0], cut.inputs[0])
    group.links.new(cut.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    return group
