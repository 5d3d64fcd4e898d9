"""The compositor step: a node group that holds the lens image, for downstream nodes to go on from."""

import bpy

from .working_space import REC709

NAME = "Lensfield"
MARK = "lensfield"  # custom property of our node groups; users may rename them


def lay_into_compositor(scene, image_path):
    """Show the lens image of this file in the scene's compositor.

    The scene's compositing tree gets one Lensfield node. Where it took its picture from a Render Layers node, the
    Lensfield node takes over those links; where it is new, the node feeds the output. Run again, it only refreshes
    the image.

    Parameters
    ----------
    scene : bpy.types.Scene
    image_path : Path
        A plain linear EXR, in the scale of Blender's own renders.

    Returns
    -------
    the group node
    """
    tree = _own_tree(scene)
    node = _lensfield_node(tree)
    if node is None:
        node = tree.nodes.new("CompositorNodeGroup")
        node.node_tree = _lens_image_group()
        node.name = node.label = NAME
        _take_over_links(scene, tree, node)
    elif any(_lensfield_node(other) and _lensfield_node(other).node_tree == node.node_tree
             for other in _trees_of_others(scene)):
        node.node_tree = _lens_image_group()  # this scene is a copy, which must not change the picture of the other
    _show(node.node_tree, image_path, f"{NAME} {scene.name}")
    return node


def _own_tree(scene):
    """The scene's compositing tree, parted from the scenes that share it: each has its own picture."""
    tree = compositing_tree(scene)
    sharing = [other for other in bpy.data.scenes if other != scene and _tree(other) == tree]
    if sharing:
        tree = scene.compositing_node_group = tree.copy()
        for node in tree.nodes:
            if node.bl_idname == "CompositorNodeRLayers" and node.scene in sharing:
                node.scene = scene
    return tree


def _trees_of_others(scene):
    return [tree for other in bpy.data.scenes if other != scene and (tree := _tree(other))]


def _tree(scene):
    """The scene's compositing tree or None. Blender keeps it elsewhere since 5.0."""
    return scene.compositing_node_group if hasattr(scene, "compositing_node_group") else scene.node_tree


def lens_image(scene):
    """The image data-block that the scene's Lensfield node shows, or None."""
    node = _tree(scene) and _lensfield_node(_tree(scene))
    source = node and _node_of_type(node.node_tree, "CompositorNodeImage")
    return source.image if source else None


def compositing_tree(scene):
    """The scene's compositing tree, made where there is none."""
    if not hasattr(scene, "compositing_node_group"):
        scene.use_nodes = True
        return scene.node_tree
    if scene.compositing_node_group is None:
        tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        tree.nodes.new("NodeGroupOutput")
        scene.compositing_node_group = tree
    tree = scene.compositing_node_group
    if not any(item.item_type == "SOCKET" and item.in_out == "OUTPUT" for item in tree.interface.items_tree):
        tree.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    return tree


def _lensfield_node(tree):
    return next((node for node in tree.nodes
                 if node.bl_idname == "CompositorNodeGroup" and node.node_tree and MARK in node.node_tree), None)


def _image_node(group):
    """The Image node of a group of ours, made and linked where there is none."""
    source = _node_of_type(group, "CompositorNodeImage")
    if source is None:
        source = group.nodes.new("CompositorNodeImage")
        output = _node_of_type(group, "NodeGroupOutput") or group.nodes.new("NodeGroupOutput")
        group.links.new(source.outputs["Image"], output.inputs["Image"])
    return source


def _node_of_type(tree, type_name):
    return next((node for node in tree.nodes if node.bl_idname == type_name), None)


def _lens_image_group():
    """A new node group with the lens image for its output."""
    group = bpy.data.node_groups.new(NAME, "CompositorNodeTree")
    group[MARK] = True
    group.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    group.nodes.new("NodeGroupOutput").location.x = 300
    return group


def _show(group, path, name):
    """Show the image of this file in a group, in the image data-block that it has, if it has one."""
    source = _image_node(group)
    if source.image is None:
        source.image = bpy.data.images.load(str(path))
        source.image.name = name
        space = source.image.colorspace_settings
        if REC709 in space.bl_rna.properties["name"].enum_items:  # a user's own configuration may know other names
            space.name = REC709
    source.image.filepath = str(path)
    source.image.reload()
    source.image.update_tag()  # or an open viewer stays stale


def _take_over_links(scene, tree, node):
    """Feed what the scene's own Render Layers nodes fed; else the tree's output."""
    layers = [n for n in tree.nodes if n.bl_idname == "CompositorNodeRLayers" and n.scene == scene and not n.mute]
    targets = [link.to_socket for n in layers for link in n.outputs["Image"].links]
    if not targets:
        targets = [n.inputs[0] for n in tree.nodes
                   if n.bl_idname in ("NodeGroupOutput", "CompositorNodeComposite") and not n.inputs[0].is_linked]
    for target in targets:
        tree.links.new(node.outputs["Image"], target)
    for n in layers:
        if not any(output.is_linked for output in n.outputs):
            n.mute = True  # an idle Render Layers node would have the scene rendered again
    if layers:
        node.location = layers[0].location.x, layers[0].location.y - 300
    elif targets:
        node.location = targets[0].node.location.x - 300, targets[0].node.location.y
