"""The compositor step: a node group that shows the frame's lens image if it is current, else the plain render.

The group takes the picture of Render Layers and outputs the frame's lens image, by keyframed switches: it works the
same without the add-on, in another Blender, on a farm, or appended to another file.
"""

import json
import os
import re
import uuid
from pathlib import Path

import bpy

from .compositor_group import DEPTH_IN_UNITS, PLAIN, STILLS, SWITCHED, build, is_intact, switch_of
from .errors import SceneError
from .fingerprint import action_curves, comparable, forget_all, scene_fingerprint
from .trust import is_near_blend, is_trusted, trust
from .truth_outputs import (
    GROUND_TRUTH,
    OF_PRODUCT,
    add_file,
    add_outputs,
    is_read,
    passes_in,
    remove_output,
    set_unit,
    truth_outputs,
)
from .units import metres_per_unit
from .working_space import REC709

NAME = "Lensfield"
MARK = "lensfield"  # custom property of our node groups; users may rename them
QUICK_LOOK = "lensfield_quick_look"  # the same of Quick Look's groups; its value identifies the lens
STATE = "lensfield_frames"  # their custom property with JSON, see `_state`
LABEL_LENGTH = 63  # Blender's limit
WIDTH = 240  # of the node, like Render Layers, so that its label is readable
LENS_IMAGE = re.compile(r"(.*?)(-?\d+)_lens_image\.exr")
PICTURES = "Image", "Stray Light"  # in colour
TAKEN_OVER = "Image", "Alpha", "Depth"
TRUTH_END = "truth"  # of the names of files with ground truth


def lay_into_compositor(scene, *image_paths, fingerprint=None):
    """Show these lens images, each of one frame, and the files next to them in the scene's compositor.

    The scene's compositing tree gets one Lensfield node. It takes over the links from a Render Layers node's picture,
    alpha and depth, with that picture as its input; in a new tree it feeds the output. Another call only refreshes the
    images, or adds other frames. If files with ground truth are next to the images, the node also has outputs for their
    passes, which take over the links of these passes.

    Parameters
    ----------
    scene : bpy.types.Scene
    image_paths : Path
        NAME_FRAME_lens_image.exr in one folder, as a job names them: plain linear EXRs, in the scale of Blender's own
        renders.
    fingerprint : str, optional
        Of the scene when the render began; by default of its current state.

    Returns
    -------
    the group node
    """
    new = {_stem_and_frame(path)[1]: path for path in image_paths}
    trust(Path(image_paths[0]).parent)
    tree, node = lay_group(scene, MARK, NAME, _new_group)
    if not is_intact(node.node_tree) or DEPTH_IN_UNITS not in node.node_tree.nodes:
        build(node.node_tree)
        _feed(scene, tree, node)
    group, state = node.node_tree, _state(node.node_tree)
    path = _for_blend(scene, image_paths[0])
    same = _image_path(group, next(iter(new))) == path
    frames, truth = (state[name] if same else {} for name in ("frames", "truth"))
    of = fingerprint or fingerprint_anew(scene)
    passes = {frame: passes_in(_next_to(path, TRUTH_END)) for frame, path in new.items()}
    _put(group, frames=frames | {str(frame): of for frame in new}, scene=key_of(scene),
         truth=truth | {str(frame): names for frame, names in passes.items()})
    _load(group, path, scene.name)
    _lay_truth(scene, tree, node, next((_for_blend(scene, new[frame]) for frame in new if passes[frame]), None))
    group.nodes[DEPTH_IN_UNITS].inputs[1].default_value = 1 / metres_per_unit(scene)
    set_unit(group, metres_per_unit(scene))
    refresh(scene)
    return node


def key_of(scene):
    """The scene's key, created if necessary, which renaming the scene or its file preserves."""
    scene.lensfield.compositor_key = scene.lensfield.compositor_key or uuid.uuid4().hex
    return scene.lensfield.compositor_key


def lay_group(scene, mark, name, new_group):
    """Put a node group between the scene's plain render and the nodes that use it; a second call changes nothing.

    Parameters
    ----------
    scene : bpy.types.Scene
    mark : str
        Custom property of its groups.
    name : str
        Of its node.
    new_group : callable
        Returns a new group, with inputs and outputs by the names in TAKEN_OVER.

    Returns
    -------
    the scene's compositing tree, the node
    """
    tree, created_tree = _scene_tree(scene)
    node = marked_node(tree, mark)
    if node is None:
        node = tree.nodes.new("CompositorNodeGroup")
        node.node_tree = new_group()
        node.name, node.width = name, WIDTH
        created_layers = _take_over_links(scene, tree, node)
        _put(node.node_tree, created_tree=created_tree, created_layers=created_layers)
    elif any(other.node_tree == node.node_tree
             for other in (marked_node(its, mark) for its in _trees_of_others(scene)) if other):
        state = _state(node.node_tree)
        _give_back(tree, node, truth_outputs(node.node_tree))
        node.node_tree = new_group()  # this scene is a copy, which must not change the picture of the other
        _put(node.node_tree, created_tree=state["created_tree"], created_layers=state["created_layers"])
    return tree, node


def remove_from_compositor(scene, mark=MARK):
    """Restore the scene's compositing tree, wherever its nodes are now; returns whether it had a node of ours."""
    tree = _tree(scene)
    node = tree and marked_node(tree, mark)
    if not node:
        return False
    group, state = node.node_tree, _state(node.node_tree)
    _give_back(tree, node, (*TAKEN_OVER, *truth_outputs(group)))
    tree.nodes.remove(node)
    layers, others = tree.nodes.get(state["created_layers"]), [marked_node(tree, each) for each in (MARK, QUICK_LOOK)]
    if layers and not any(others):
        tree.nodes.remove(layers)
    if state["created_tree"] and all(node.bl_idname == "NodeGroupOutput" for node in tree.nodes):
        bpy.data.node_groups.remove(tree)
    elif state["created_tree"] and not hasattr(scene, "compositing_node_group"):
        scene.use_nodes = any(others)
    if not group.users:
        _remove_group(group)
    return True


def _give_back(tree, node, names):
    """Link the users of these outputs to the nodes that feed a node of ours."""
    fed_by = {link.to_socket.name: link.from_socket for link in tree.links if link.to_node == node}
    for link in [link for link in tree.links if link.from_node == node and link.from_socket.name in names]:
        name, target = link.from_socket.name, link.to_socket
        source = fed_by.get(name) or "Image" in fed_by and fed_by["Image"].node.outputs.get(name)
        if source:
            tree.links.new(source, target)


def refresh(scene):
    """Switch to the lens image at the frames that have a current one, and label the node to match."""
    node = _scene_node(scene)
    if node:
        _switch(node.node_tree, _switch_keys(node))
        _label(scene, node)


def rewrite_switches(scene):
    """Do the work of `refresh` on a render thread: overwrite the values of the existing keyframes, without freeing or
    allocating memory. The next `refresh` notifies Blender."""
    node = _scene_node(scene)
    by_switch = node and _switch_keys(node)
    if not by_switch or by_switch == _keys(node.node_tree):
        return
    for name, curve in _curves(node.node_tree).items():
        keys = by_switch[name]
        if [int(key.co[0]) for key in curve.keyframe_points] == sorted(keys):
            curve.keyframe_points.foreach_set("co", [n for frame in sorted(keys) for n in (frame, keys[frame])])
    _rewritten.add(node.node_tree.session_uid)


def relabel(scene):
    """Update the node's label, unless that requires a new fingerprint of the scene."""
    node = _scene_node(scene)
    if node and scene.session_uid in _taken:
        _label(scene, node)


def _label(scene, node):
    label = f"{NAME}: {compositor_state(scene)[0]}"[:LABEL_LENGTH]
    if node.label != label:
        node.label = label


def _scene_node(scene):
    """The scene's Lensfield node if it may be changed here and shows the scene's own lens images, else None."""
    node = _node(scene)
    if node is None or not is_intact(node.node_tree) or _owner(node.node_tree) != scene:
        return None
    if node.id_data.library or node.node_tree.library or not _may_look(node.node_tree):
        return None
    return node


def compositor_state(scene):
    """What the scene's Lensfield node shows at this frame, and why: a short text and an icon; ("", "NONE") for none."""
    node = _node(scene)
    if node is None:
        return "", "NONE"
    shown, why, icon = _verdict(node, str(scene.frame_current), _state(node.node_tree))
    return f"{'lens image' if shown else 'plain render'}{why and ', '}{why}", icon


def has_lens_images(scene):
    """Whether the scene has a Lensfield node to update."""
    return _node(scene) is not None


def is_true(scene):
    """Whether the scene's last fingerprint matches one of its lens images; None if no fingerprint is known."""
    if scene.session_uid not in _taken:
        return None
    return _taken[scene.session_uid] in _state(_node(scene).node_tree)["frames"].values()


def fingerprint_now(scene):
    """The scene's last fingerprint, or a new one."""
    if scene.session_uid not in _taken:
        _taken[scene.session_uid] = scene_fingerprint(scene)
    return _taken[scene.session_uid]


_taken = {}
"""By session_uid: the scenes' fingerprints."""

_rewritten = set()
"""session_uid of groups whose keyframes were overwritten without Blender's knowledge."""


def fingerprint_anew(scene):
    """A new fingerprint of the complete scene: scripts change it before Blender notifies handlers."""
    forget_all()
    forget_fingerprints()
    return fingerprint_now(scene)


def laid_fingerprint(scene):
    """The scene's fingerprint from the render of this frame's lens image; None without one."""
    node = _node(scene)
    return _state(node.node_tree)["frames"].get(str(scene.frame_current)) if node else None


def forget_fingerprints():
    """Compute all fingerprints again at the next use."""
    _taken.clear()


def _verdict(node, frame, state):
    """(whether the lens image of a frame is shown, why in words, icon); `state` is the `_state` of the node's group."""
    scene = _owner(node.node_tree)
    shows = scene.lensfield.compositor_shows
    if shows == "NEVER":
        return False, "set in Compositor Shows", "INFO"
    if frame not in state["frames"]:
        return False, f"frame {frame} has no lens image", "INFO"
    if int(frame) < 0:
        return False, "frames below 0 cannot be shown", "ERROR"
    path = bpy.path.abspath(_image_path(node.node_tree, int(frame)))
    if not _may_look(node.node_tree):
        return False, f"{os.path.dirname(path)} is not trusted", "ERROR"
    if not os.path.isfile(path):
        return False, f"the file of frame {frame} is missing", "ERROR"
    rendered = state["frames"][frame]
    ours = state["scene"] == scene.lensfield.compositor_key  # else the node is from another file, of unknown state
    if ours and comparable(rendered) and rendered != fingerprint_now(scene):
        return shows == "ALWAYS", "the scene has changed since", "ERROR"
    return True, "", "CHECKMARK"


def picture_folder(scene):
    """The folder of the files that the scene's Lensfield node shows; "" without a node."""
    node = _node(scene)
    intact = node and is_intact(node.node_tree)
    return os.path.dirname(bpy.path.abspath(_image_path(node.node_tree, 1))) if intact else ""


def shown_folder(scene):
    """The `picture_folder` of a scene; "" if its files may not be accessed."""
    node, folder = _node(scene), picture_folder(scene)
    return folder if folder and _may_look(node.node_tree) else ""


def _may_look(group):
    """Whether the files of a group may be accessed: those in a trusted folder, or in the .blend's own."""
    folder = os.path.dirname(bpy.path.abspath(_image_path(group, 1)))
    return not folder or is_near_blend(folder) or is_trusted(folder)


def lens_image(scene):
    """The image data-block that the scene's Lensfield node shows, or None."""
    node = _node(scene)
    source = node and node.node_tree.nodes.get("Image")
    return source.image if source else None


def follow_frames(scene, image_user):
    """Let an image user of the scene's lens image (in a node, in an image editor) follow the frames."""
    _follow(image_user, _state(_node(scene).node_tree)["frames"])


def compositing_tree(scene):
    """The scene's compositing tree, created if necessary."""
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


def unreplaced_passes(scene, products):
    """Names of passes that the scene's compositing tree takes from its Render Layers and lens images lack: they show
    the camera's view, not the view of the lens. `products` are the requested kinds of ground truth."""
    replaced = {*TAKEN_OVER, *(name for product in products for name in OF_PRODUCT.get(product, ()))}
    tree = _tree(scene) if getattr(scene, "use_nodes", True) else None
    return sorted({link.from_socket.name for link in (tree.links if tree else ())
                   if link.from_node.bl_idname == "CompositorNodeRLayers" and link.from_node.scene == scene
                   and link.from_socket.name not in replaced})


def _stem_and_frame(path):
    match = LENS_IMAGE.fullmatch(Path(path).name)
    if match is None:
        raise SceneError(path, "lens image", "without a frame number",
                         "expected a name such as shot_Scene_0001_lens_image.exr")
    return match[1], int(match[2])


def _for_blend(scene, path):
    """A path for the .blend to store: relative if the output folder is."""
    relative = scene.lensfield.output_folder.startswith("//") and bpy.data.filepath
    return bpy.path.relpath(str(path)) if relative else str(path)


def _image_path(group, frame):
    """Path of a frame's lens image, as Blender stores it; "" if no frame has one."""
    image = group.nodes["Image"].image
    match = image and LENS_IMAGE.fullmatch(os.path.basename(image.filepath))
    return image.filepath[:-len(match[0])] + f"{match[1]}{frame:04d}_lens_image.exr" if match else ""


def _state(group):
    """The state that a Lensfield group stores: the scene's fingerprint at each frame's render, the passes of its ground
    truth, the scene's key, whether the tree was created for it, and the name of a Render Layers node that was."""
    empty = {"frames": {}, "truth": {}, "scene": "", "created_tree": False, "created_layers": ""}
    try:
        stored = json.loads(group.get(STATE, "{}"))
    except (TypeError, ValueError, RecursionError):  # the file may be untrusted
        return empty
    stored = stored if isinstance(stored, dict) else {}
    held = {name: stored[name] for name, value in empty.items() if isinstance(stored.get(name), type(value))}
    frames = {frame: of for frame, of in held.get("frames", {}).items() if _is_frame(frame) and isinstance(of, str)}
    truth = {frame: [name for name in passes if isinstance(name, str)]
             for frame, passes in held.get("truth", {}).items() if _is_frame(frame) and isinstance(passes, list)}
    return empty | held | {"frames": frames, "truth": truth}


def _is_frame(text):
    return text.removeprefix("-").isdecimal() and len(text) < 12


def _put(group, **facts):
    group[STATE] = json.dumps(_state(group) | facts)


def _scene_tree(scene):
    """The scene's compositing tree, copied if other scenes share it, as each has its own picture; and whether it is new
    or was not in use."""
    created = not _tree(scene) or not getattr(scene, "use_nodes", True)
    tree = compositing_tree(scene)
    sharing = [other for other in bpy.data.scenes if other != scene and _tree(other) == tree]
    if sharing:
        tree = scene.compositing_node_group = tree.copy()
        for node in tree.nodes:
            if node.bl_idname == "CompositorNodeRLayers" and node.scene in sharing:
                node.scene = scene
    return tree, created


def _trees_of_others(scene):
    return [tree for other in bpy.data.scenes if other != scene and (tree := _tree(other))]


def _tree(scene):
    """The scene's compositing tree or None. Blender 5.0 moved it."""
    return scene.compositing_node_group if hasattr(scene, "compositing_node_group") else scene.node_tree


def _node(scene):
    return scene_node(scene, MARK)


def scene_node(scene, mark):
    """The node of ours with this mark in the scene's compositing tree, or None."""
    tree = _tree(scene)
    return marked_node(tree, mark) if tree else None


def marked_node(tree, mark):
    """The node of a tree whose group has this mark, or None."""
    return next((node for node in tree.nodes
                 if node.bl_idname == "CompositorNodeGroup" and node.node_tree and mark in node.node_tree), None)


def _owner(group):
    """The scene whose lens images a group shows; a copy of it may show them too."""
    return next(scene for scene in bpy.data.scenes if (node := _node(scene)) and node.node_tree == group)


def _render_sources(scene, tree, node, name):
    """The nodes that output a pass of the plain render, before this node of ours: Quick Look, or Render Layers."""
    quick_look = marked_node(tree, QUICK_LOOK)
    if quick_look and quick_look != node and name in quick_look.outputs:
        return [quick_look]
    return [n for n in tree.nodes if n.bl_idname == "CompositorNodeRLayers" and n.scene == scene and not n.mute
            and name in n.outputs]


def _new_group():
    group = bpy.data.node_groups.new(NAME, "CompositorNodeTree")
    group[MARK] = True
    build(group)
    return group


def _switch_keys(node):
    """Frames and values of the keyframes of each switch: dict of str: dict of int: bool. Their number does not depend
    on the values."""
    group, state = node.node_tree, _state(node.node_tree)
    shown = {frame: _verdict(node, frame, state)[0] for frame in state["frames"]}
    passes = {frame: _passes(group, frame, state) if on else () for frame, on in shown.items()}
    by_switch = dict.fromkeys(SWITCHED, shown) | {
        name: {frame: is_read(group, name) and name in of_frame for frame, of_frame in passes.items()}
        for name in truth_outputs(group)}
    return {name: _keys_of({int(frame): on for frame, on in frames.items()}) for name, frames in by_switch.items()}


def _passes(group, frame, state):
    """The passes in the file of a frame's ground truth; none if it is missing."""
    passes = state["truth"].get(frame, ())
    path = bpy.path.abspath(_image_path(group, int(frame)))
    return passes if passes and os.path.isfile(_next_to(path, TRUTH_END)) else ()


def _keys_of(shown_by_frame):
    keys = {frame + 1: False for frame in shown_by_frame} | shown_by_frame
    return keys | {min(keys, default=0) - 1: False}


def _switch(group, by_switch):
    """Keyframe the switches to be on only at frames that show their file."""
    if by_switch == _keys(group):
        if group.session_uid in _rewritten:
            _rewritten.discard(group.session_uid)
            for curve in _curves(group).values():
                curve.update()
        return
    for curve in _curves(group).values():
        curve.keyframe_points.clear()
    for name, keys in by_switch.items():
        first, socket = min(keys), _toggle(group, name)
        socket.default_value = keys[first]
        socket.keyframe_insert("default_value", frame=first)
    for name, curve in _curves(group).items():
        for frame in sorted(by_switch[name])[1:]:
            curve.keyframe_points.insert(frame, by_switch[name][frame], options={"FAST"})
        for key in curve.keyframe_points:
            key.interpolation = "CONSTANT"
        curve.update()


def _toggle(group, name):
    """The socket of an output's switch that its keyframes turn on."""
    return switch_of(group, name).inputs["Switch"]


def _curves(group):
    """The F-curves of a group's switches, by the names of their outputs."""
    action = group.animation_data and group.animation_data.action
    names = {_toggle(group, name).path_from_id("default_value"): name for name in (*SWITCHED, *truth_outputs(group))}
    return {names[curve.data_path]: curve for curve in (action_curves(action) if action else ())
            if curve.data_path in names}


def _keys(group):
    return {name: {int(key.co[0]): bool(key.co[1]) for key in curve.keyframe_points}
            for name, curve in _curves(group).items()}


def _load(group, path, scene_name):
    """Show a lens image and the files next to it, in the group's existing image data-blocks if it has any."""
    for name, ending in (SWITCHED | STILLS).items():
        sibling = _next_to(path, ending) if name in SWITCHED else _of_all_frames(path, ending)
        if os.path.isfile(bpy.path.abspath(sibling)):
            _show(group.nodes[name], sibling, f"{NAME} {scene_name}{'' if name == 'Image' else f' {name}'}", name)
        if name in SWITCHED:
            _follow(group.nodes[name], _state(group)["frames"])


def _next_to(path, ending):
    """Path of another file of a lens image's frame."""
    stem, frame = _stem_and_frame(path)
    return os.path.join(os.path.dirname(path), f"{stem}{frame:04d}_{ending}.exr")


def _of_all_frames(path, ending):
    """Path of a file next to a lens image that all frames share."""
    return os.path.join(os.path.dirname(path), f"{_stem_and_frame(path)[0]}{ending}.exr")


def _lay_truth(scene, tree, node, path):
    """Show the ground truth next to a lens image, if a path is given, with an output for each of its passes. Outputs of
    other passes remain as long as a frame has them, or they are linked."""
    group, truth = node.node_tree, _state(node.node_tree)["truth"]
    if path:
        source = add_file(group)
        _show(source, _next_to(path, TRUTH_END), f"{NAME} {scene.name} {GROUND_TRUTH}", GROUND_TRUTH)
        for name in add_outputs(group):
            _take_over(scene, tree, node, name)
            _feed_pass(scene, tree, node, name)
    in_files = {name for passes in truth.values() for name in passes}
    for name in truth_outputs(group):
        if name not in in_files and not node.outputs[name].is_linked:
            for frame in _keys(group).get(name, ()):
                _toggle(group, name).keyframe_delete("default_value", frame=frame)
            remove_output(group, name)
    source = group.nodes.get(GROUND_TRUTH)
    if source and (in_files or truth_outputs(group)):
        _follow(source, _state(group)["frames"])
    elif source:
        group.nodes.remove(source)


def _show(node, path, image_name, name):
    node.image = show_file(node.image, path, image_name, REC709 if name in PICTURES else "Non-Color",
                           "FILE" if name in STILLS else "SEQUENCE")


def show_file(image, path, name, colours=REC709, source="FILE"):
    """Let an image data-block show a file; if `image` is None, a new one of this name. Returns it."""
    if image is None:
        image = bpy.data.images.load(bpy.path.abspath(path))
        image.name = name
        space = image.colorspace_settings
        if colours in space.bl_rna.properties["name"].enum_items:  # a custom OCIO configuration may have other names
            space.name = colours
    image.source, image.filepath, image.use_view_as_render = source, path, True
    image.reload()
    image.update_tag()  # without it, an open viewer stays stale
    return image


def _follow(image_user, frames):
    """Let each frame show the file with its number."""
    first, last = (choose(map(int, frames)) for choose in (min, max))
    image_user.frame_start, image_user.frame_offset = first, first - 1
    image_user.frame_duration = last - first + 1
    if hasattr(image_user, "use_auto_refresh"):
        image_user.use_auto_refresh = True


def _remove_group(group):
    images = [node.image for node in group.nodes if node.bl_idname == "CompositorNodeImage" and node.image]
    action = group.animation_data and group.animation_data.action
    bpy.data.node_groups.remove(group)
    unused = [block for block in (action, *images) if block and not block.users]
    bpy.data.batch_remove(unused)


def _take_over_links(scene, tree, node):
    """Take over the links of the scene's own Render Layers nodes, else feed the tree's output; returns the name of a
    Render Layers node, if one had to be created."""
    for name in TAKEN_OVER:
        _take_over(scene, tree, node, name)
    output = next((n for n in tree.nodes if n.bl_idname in ("NodeGroupOutput", "CompositorNodeComposite")
                   and not n.inputs[0].is_linked), None)
    if output and not any(out.is_linked for out in node.outputs):
        tree.links.new(node.outputs["Image"], output.inputs[0])
        node.location = output.location.x - 300, output.location.y
    layers = _render_sources(scene, tree, node, "Image")
    created = _feed(scene, tree, node)
    if layers:
        node.location = layers[0].location.x + 300, layers[0].location.y - 100
    return created


def _take_over(scene, tree, node, name):
    """Take over the links of a pass."""
    for target in [link.to_socket for n in _render_sources(scene, tree, node, name) for link in n.outputs[name].links]:
        tree.links.new(node.outputs[name], target)


def _feed(scene, tree, node):
    """Feed the plain render to the node; returns the name of the Render Layers node, if it had to be created."""
    created = ""
    if not _render_sources(scene, tree, node, "Image"):
        layers = tree.nodes.new("CompositorNodeRLayers")
        layers.scene, created = scene, layers.name
        layers.location = node.location.x - 300, node.location.y
    for name in (*PLAIN, *truth_outputs(node.node_tree)):
        _feed_pass(scene, tree, node, name)
    return created


def _feed_pass(scene, tree, node, name):
    """Feed a pass of the plain render to the node, if it exists."""
    source = next(iter(_render_sources(scene, tree, node, name)), None)
    if source and source.outputs[name].enabled:
        tree.links.new(source.outputs[name], node.inputs[name])
