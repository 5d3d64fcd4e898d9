"""The compositor step: a node group that holds the lens image, for downstream nodes to go on from."""

import bpy

NAME = "Lensfield"
MARK = "lensfield_scene"  # custom property of our node groups: the scene whose picture they hold


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
    tree = compositing_tree(scene)
    node = _lensfield_node(tree)
    if node and node.node_tree[MARK] != scene.name and node.node_tree[MARK] in bpy.data.scenes:
        tree, node = _parted(scene, tree)  # this scene is a copy, which must not change the picture of the other
    if node is None:
        node = tree.nodes.new("CompositorNodeGroup")
        node.node_tree = _lens_image_group()
        node.name = node.label = NAME
        _take_over_links(scene, tree, node)
    node.node_tree[MARK] = scene.name
    _show(node.node_tree, image_path, f"{NAME} {scene.name}")
    return node


def _parted(scene, tree):
    """A tree and a Lensfield node of the scene's own, in place of those it shares with the scene it is a copy of."""
    if tree.users > 1 and hasattr(scene, "compositing_node_group"):
        tree = scene.compositing_node_group = tree.copy()
    node = _lensfield_node(tree)
    node.node_tree = _lens_image_group()
    return tree, node


def lens_image(scene):
    """The image data-block that the scene's Lensfield node shows, or None."""
    tree = scene.compositing_node_group if hasattr(scene, "compositing_node_group") else scene.node_tree
    node = tree and _lensfield_node(tree)
    return _image_node(node.node_tree).image if node else None


def compositing_tree(scene):
    """The scene's compositing tree, made where there is none. Blender keeps it elsewhere since 5.0."""
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
    return next(node for node in group.nodes if node.bl_idname == "CompositorNodeImage")


def _lens_image_group():
    """A new node group with the lens image for its output."""
    group = bpy.data.node_groups.new(NAME, "CompositorNodeTree")
    group[MARK] = ""
    group.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    source = group.nodes.new("CompositorNodeImage")
    output = group.nodes.new("NodeGroupOutput")
    output.location.x = 300
    group.links.new(source.outputs["Image"], output.inputs["Image"])
    return group


def _show(group, path, name):
    """Show the image of this file in a group, in the image data-block that it has, if it has one."""
    source = _image_node(group)
    if source.image is None:
        source.image = bpy.data.images.load(str(path))
        source.image.name = name
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
