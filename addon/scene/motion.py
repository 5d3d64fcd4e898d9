"""Stillness: whether frames of a scene differ only in their camera's focus and f-stop. In doubt, they differ more."""

import re

import bpy

from .active_camera import camera_data
from .fingerprint import action_curves, blocks_of

VIEW = {"lens", "sensor_width", "sensor_height", "shift_x", "shift_y"}
DEPTH_OF_FIELD = "dof."
RINGS = DEPTH_OF_FIELD, "lensfield.focused_wide_open", "lensfield.iris_"  # of camera settings for focus and f-stop
EXPOSURE = "lensfield.iso", "lensfield.shutter_s"
HANDLERS = "frame_change_pre", "frame_change_post", "render_pre"
SIMULATIONS = {"CLOTH", "DYNAMIC_PAINT", "EXPLODE", "FLUID", "PARTICLE_INSTANCE", "PARTICLE_SYSTEM", "SOFT_BODY"}
MOVING_MODIFIERS = SIMULATIONS | {"BUILD", "MESH_CACHE", "MESH_SEQUENCE_CACHE", "WAVE"}
MOVING_CONSTRAINTS = {"CAMERA_SOLVER", "FOLLOW_TRACK", "OBJECT_SOLVER", "TRANSFORM_CACHE"}
MOVING_NODES = {"GeometryNodeBake", "GeometryNodeCameraInfo", "GeometryNodeInputSceneTime",
                "GeometryNodeSimulationInput"}  # Camera Info outputs the focus distance
MOVING_IMAGES = {"MOVIE", "SEQUENCE"}
PACKAGE = __package__.removesuffix("addon.scene")
OF_NO_PICTURE = {"COLLECTION", "SCENE", "SCREEN", "WINDOWMANAGER", "WORKSPACE"}  # users that do not render an object


def moving(scene, frames):
    """A line about the first change between frames, other than of focus and f-stop; "" without one.

    Parameters
    ----------
    scene : bpy.types.Scene
    frames : ascending sequence of int
    """
    return next(_movements(scene, frames), "")


def rings_animated(scene):
    """Whether keyframes, drivers or a focus object change the focus or f-stop of a scene's camera."""
    camera = camera_data(scene)
    return camera is not None and camera.dof.use_dof and (
        camera.dof.focus_object is not None
        or any(path.startswith(RINGS) for path in _animated_paths(camera, None, frozenset())))


def exposure_animated(camera):
    """Whether keyframes or drivers set the ISO or the shutter of camera data."""
    return any(path in EXPOSURE for path in _animated_paths(camera, None, frozenset()))


def view_animated(camera):
    """Paths of animated settings of camera data, in Blender's names, that change its view: set."""
    return VIEW & {path for path in _animated_paths(camera, None, frozenset())}


def sees_camera(objects):
    """Names of objects whose geometry nodes read the settings of a camera: list."""
    return [obj.name for obj in objects for modifier in obj.modifiers
            if modifier.type == "NODES" and modifier.node_group and _reads_camera(modifier.node_group)]


def _reads_camera(tree):
    return any(node.bl_idname == "GeometryNodeCameraInfo" or (getattr(node, "node_tree", None) and _reads_camera(
        node.node_tree)) for node in tree.nodes)


def _movements(scene, frames):
    cameras = {camera_at(scene, frame) for frame in frames} - {None}
    if len(cameras) > 1:
        yield "markers change the camera"
    if scene.cycles.use_animated_seed:
        yield "the noise seed is animated"
    if _has_rigid_bodies(scene):
        yield "the scene has rigid bodies"
    for script in (str(handler.__module__) for name in HANDLERS for handler in getattr(bpy.app.handlers, name)):
        if not script.startswith(PACKAGE):
            yield f"the script {script} runs on each frame"
    blocks = blocks_of(scene)
    unseen = _unseen(blocks, cameras)
    checked, times = blocks - unseen, _times(scene, frames)
    for block in sorted(checked, key=lambda each: (each.id_type, each.name_full)) + [scene]:
        for part in filter(None, (block, getattr(block, "node_tree", None))):
            if why := _why_moving(part, times, checked):
                yield f"{block.rna_type.name.lower()} {block.name!r} {why}"


def _has_rigid_bodies(scene):
    world = scene.rigidbody_world
    return bool(world and world.enabled and world.collection and world.collection.objects)


def has_simulations(scene, blocks):
    """Whether a frame's picture may depend on the frames before it, which a session has played and cached.

    Parameters
    ----------
    scene : bpy.types.Scene
    blocks : iterable of bpy.types.ID
        The scene's data-blocks.
    """
    return _has_rigid_bodies(scene) or any(
        modifier.type in SIMULATIONS or getattr(modifier, "bakes", ())
        for block in blocks if block.id_type == "OBJECT" for modifier in block.modifiers)


def camera_at(scene, frame):
    """The camera that markers bind at a frame, or the scene's own."""
    bound = sorted((marker for marker in scene.timeline_markers if marker.camera), key=lambda marker: marker.frame)
    before = [marker for marker in bound if marker.frame <= frame]
    return (before[-1] if before else bound[0]).camera if bound else scene.camera


def _unseen(blocks, cameras):
    """Empties and unused cameras that no rendered data depend on; and the settings of unused cameras."""
    users = bpy.data.user_map()
    unseen = {block for block in blocks if block.id_type == "OBJECT" and (
        (block.type == "EMPTY" and block.instance_type == "NONE") or (block.type == "CAMERA" and block not in cameras))}

    def follows(user):
        if user.id_type == "COLLECTION":  # its users may read its objects
            return any(follows(other) for other in users.get(user, ()))
        return user not in unseen and user.id_type not in OF_NO_PICTURE | {"CAMERA"}

    while followed := {block for block in unseen if any(map(follows, users.get(block, ())))}:
        unseen -= followed
    others = {block for block in blocks if block.id_type == "CAMERA"} - {camera.data for camera in cameras}
    return unseen | others


def _times(scene, frames):
    """Times for evaluating animation: the frames, and while the shutter is open."""
    shutter = scene.render.motion_blur_shutter if scene.render.use_motion_blur else 0.0
    return sorted({frame + part * shutter for frame in frames for part in (-1, -0.5, 0, 0.5, 1)})


def _why_moving(block, times, checked):
    """Why a data-block may change, in words; None if it does not."""
    allowed = RINGS if block.id_type == "CAMERA" else ()
    if any(not path.startswith(allowed) for path in _animated_paths(block, times, checked)):
        return "is animated"
    if block.id_type == "OBJECT":
        bones = block.pose.bones if block.pose else ()
        constraints = [constraint for owner in (block, *bones) for constraint in owner.constraints]
        return _of_kind(block.modifiers, MOVING_MODIFIERS) or _of_kind(constraints, MOVING_CONSTRAINTS) or (
            "has particles" if block.particle_systems else None)
    if block.id_type == "NODETREE":
        return _with_time(block.nodes)
    if block.id_type == "IMAGE" and block.source in MOVING_IMAGES:
        return "is a movie or sequence"
    if block.id_type == "VOLUME" and block.is_sequence:
        return "is a sequence"
    return None


def _of_kind(parts, kinds):
    return next((f"has {part.name!r}" for part in parts if part.type in kinds), None)


def _with_time(nodes):
    for node in nodes:
        if node.bl_idname in MOVING_NODES or getattr(node, "attribute_type", "") == "VIEW_LAYER":
            return f"has {node.name!r}"
    return None


def _animated_paths(block, times, checked):
    """Paths that keyframes and drivers set, unless their values are the same at all times."""
    animation = getattr(block, "animation_data", None)
    if animation is None:
        return
    for driver in animation.drivers:
        if not _is_constant_driver(driver.driver, checked):
            yield driver.data_path
    for strip in (strip for track in animation.nla_tracks for strip in track.strips if not track.mute):
        yield from (curve.data_path for curve in action_curves(strip.action)) if strip.action else [strip.name]
    for curve in curves_of(animation):
        if times is None or len({curve.evaluate(time) for time in times}) > 1:
            yield curve.data_path


def curves_of(animation):
    """F-curves of a data-block's animation data in its action: since Blender has slots, other data-blocks may share
    the action."""
    return [curve for _, curve in owned_curves(animation)]


def owned_curves(animation):
    """As `curves_of`, each with its owner, whose `fcurves` it is one of: generator of pairs."""
    action, slot = animation.action, getattr(animation, "action_slot", None)
    if action is None or slot is None:
        yield from ((action, curve) for curve in (action_curves(action) if action else ()))
        return
    bags = (strip.channelbag(slot) for layer in action.layers for strip in layer.strips)
    yield from ((bag, curve) for bag in bags if bag for curve in bag.fcurves)


def _is_constant_driver(driver, checked):
    """Whether a driver depends only on values that do not change."""
    if driver.type == "SCRIPTED" and (not driver.is_simple_expression or re.search(r"\bframe\b", driver.expression)):
        return False
    return all(variable.type != "CONTEXT_PROP" and all(target.id in checked and DEPTH_OF_FIELD not in target.data_path
                                                       for target in variable.targets)
               for variable in driver.variables)
