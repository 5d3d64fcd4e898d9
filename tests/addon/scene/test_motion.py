"""Scenes whose frames differ only in the camera's focus and f-stop; doubtful scenes do not count."""

import bpy
import pytest

from lensfield.addon.scene.motion import moving, rings_animated
from small_scenes import keyframe_world, light, material, wall

FRAMES = 1, 2, 5


@pytest.fixture
def rack(scene):
    """A wall and a lamp; the focus moves from 1 m to 3 m, and the lens is stopped down."""
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0])
    light(scene, "POINT", 1.0)
    scene.camera.data.dof.use_dof = True
    keyframe(scene.camera.data, "dof.focus_distance", 1.0, 3.0)
    keyframe(scene.camera.data, "dof.aperture_fstop", 2.0, 8.0)
    return scene


def keyframe(owner, path, *values):
    """Keyframes at frame 1 and every 4 frames after it."""
    *inner, name = path.split(".")
    for number, value in enumerate(values):
        setattr(owner.path_resolve(".".join(inner)) if inner else owner, name, value)
        owner.keyframe_insert(path, frame=1 + 4 * number)


def focus_object(scene):
    empty = bpy.data.objects.new("Focus", None)
    scene.collection.objects.link(empty)
    scene.camera.data.dof.focus_object = empty
    keyframe(empty, "location", (0, 0, -1), (0, 0, -3))
    return empty


def shared_action(scene):
    """Object and camera in one action, as Blender creates them, each with a slot."""
    camera = scene.camera
    keyframe(camera, "location", (0, 0, 0), (0, 0, 0))
    animation = camera.animation_data
    if hasattr(animation, "action_slot"):
        action = camera.data.animation_data.action
        slot = action.slots.new("OBJECT", "Camera")
        animation.action, animation.action_slot = action, slot
        keyframe(camera, "location", (0, 0, 0), (0, 0, 0))


def driven(scene, expression="1 + 1"):
    driver = scene.objects["Wall"].driver_add("location", 0).driver
    driver.expression = expression
    return driver


def driven_by(scene, owner, path):
    driver = driven(scene, "var")
    variable = driver.variables.new()
    variable.targets[0].id_type, variable.targets[0].id = owner.id_type, owner
    variable.targets[0].data_path = path


def focus_driven(scene):
    scene.camera.data.animation_data_clear()
    scene.camera.data.driver_add("dof.focus_distance").driver.expression = "frame"


def focus_by_strips(scene):
    animation = scene.camera.data.animation_data
    action, animation.action = animation.action, None
    animation.nla_tracks.new().strips.new("Focus", 1, action)


def other_camera(scene):
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    scene.collection.objects.link(other)
    keyframe(other, "location", (0, 0, 0), (1, 0, 0))
    keyframe(other.data, "lens", 50.0, 100.0)
    return other


def markers(scene, other):
    for frame, camera in ((1, scene.camera), (3, other)):
        scene.timeline_markers.new("Cut", frame=frame).camera = camera


@pytest.mark.parametrize("change", [
    lambda scene: None, focus_object, shared_action, driven, focus_driven, focus_by_strips, other_camera,
    lambda scene: focus_object(scene).keyframe_insert("scale", frame=3),
    lambda scene: keyframe(scene.objects["Wall"], "location", (0, 0, -1), (0, 0, -1)),
    lambda scene: driven_by(scene, scene.objects["Light"].data, "energy"),
    lambda scene: keyframe(scene.camera.data, "dof.aperture_rotation", 0.0, 1.0),
    lambda scene: keyframe(scene.camera.data, "lensfield.iris_roundness", 0.0, 1.0),
    lambda scene: keyframe(scene.camera.data, "lensfield.focused_wide_open", False, True),
    lambda scene: markers(scene, scene.camera),
    lambda scene: setattr(scene.render, "use_motion_blur", True)])
def test_focus_and_f_stop_animation_is_not_movement(rack, change):
    change(rack)
    assert not moving(rack, FRAMES) and rings_animated(rack)


def simulation_node(scene, kind="GeometryNodeInputSceneTime"):
    tree = bpy.data.node_groups.new("Inner", "GeometryNodeTree")
    tree.nodes.new(kind)
    outer = bpy.data.node_groups.new("Outer", "GeometryNodeTree")
    outer.nodes.new("GeometryNodeGroup").node_tree = tree
    scene.objects["Wall"].modifiers.new("Nodes", "NODES").node_group = outer


def film(scene):
    image = bpy.data.images.new("Film", 4, 4)
    image.source = "SEQUENCE"
    paint(scene).nodes.new("ShaderNodeTexImage").image = image


def paint(scene):
    return scene.objects["Wall"].data.materials[0].node_tree


def attribute(scene):
    node = paint(scene).nodes.new("ShaderNodeAttribute")
    node.attribute_type, node.attribute_name = "VIEW_LAYER", "frame_current"


def moving_parent(scene, of):
    of.parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(of.parent)
    keyframe(of.parent, "location", (0, 0, 0), (1, 0, 0))


def follows_focus(scene):
    """The wall copies the rotation of the focus object."""
    scene.objects["Wall"].constraints.new("COPY_ROTATION").target = focus_object(scene)


def textured_by_focus(scene):
    paint(scene).nodes.new("ShaderNodeTexCoord").object = focus_object(scene)


def scattered_by_focus(scene):
    """Geometry nodes read the collection that contains the focus object."""
    focus = focus_object(scene)
    collection = bpy.data.collections.new("Own")
    scene.collection.children.link(collection)
    collection.objects.link(focus)
    simulation_node(scene, "GeometryNodeCollectionInfo")
    bpy.data.node_groups["Inner"].nodes[0].inputs["Collection"].default_value = collection


def shape_keys(scene):
    wall = scene.objects["Wall"]
    wall.shape_key_add(name="Basis")
    key = wall.shape_key_add(name="Bulge")
    keyframe(wall.data.shape_keys, f'key_blocks["{key.name}"].value', 0.0, 1.0)


def strips(scene):
    keyframe(scene.objects["Wall"], "location", (0, 0, -1), (0, 0, -2))
    animation = scene.objects["Wall"].animation_data
    action, animation.action = animation.action, None
    animation.nla_tracks.new().strips.new("Walk", 1, action)


def instanced(scene):
    """A moving object in a collection that an empty instances."""
    collection = bpy.data.collections.new("Own")
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    scene.collection.objects.link(empty)
    collection.objects.link(thing := bpy.data.objects.new("Thing", scene.objects["Wall"].data))
    keyframe(thing, "location", (0, 0, -1), (0, 0, -2))


def within_the_shutter(scene):
    """It has the same position at every frame, but moves while the shutter is open."""
    keyframe(scene.objects["Wall"], "location", *[(0, 0, -1)] * 2)
    curve = scene.objects["Wall"].animation_data.action
    curve = (curve.fcurves if hasattr(curve, "fcurves") else curve.layers[0].strips[0].channelbags[0].fcurves)[0]
    curve.keyframe_points.insert(1.25, 1.0)
    curve.keyframe_points.insert(1.5, 0.0)
    scene.render.use_motion_blur = True


def rigid_bodies(scene):
    bpy.context.view_layer.objects.active = scene.objects["Wall"]
    bpy.ops.rigidbody.object_add()


def particles(scene):
    scene.objects["Wall"].modifiers.new("Dust", "PARTICLE_SYSTEM")


@pytest.mark.parametrize("change, reason", [
    (lambda scene: keyframe(scene.objects["Wall"], "location", (0, 0, -1), (0, 0, -2)), "object 'Wall' is animated"),
    (lambda scene: keyframe(scene.camera, "location", (0, 0, 0), (0, 0, 1)), "object 'Camera' is animated"),
    (lambda scene: keyframe(scene.camera.data, "lens", 50.0, 60.0), "camera 'Camera' is animated"),
    (lambda scene: keyframe(scene.objects["Light"].data, "energy", 1.0, 2.0), "light 'Light' is animated"),
    (lambda scene: keyframe(paint(scene).nodes["Diffuse BSDF"].inputs["Roughness"], "default_value", 0.0, 1.0),
     "material 'Paint' is animated"),
    (lambda scene: keyframe_world(scene, 1, 5), "world 'World' is animated"),
    (lambda scene: keyframe(scene, "cycles.samples", 16, 32), "scene 'Scene' is animated"),
    (lambda scene: keyframe(scene, "lensfield.accuracy", 0.1, 0.2), "scene 'Scene' is animated"),
    (lambda scene: setattr(scene.cycles, "use_animated_seed", True), "the noise seed is animated"),
    (lambda scene: driven(scene, "frame"), "object 'Wall' is animated"),
    (lambda scene: driven(scene, "bpy.context.scene.frame_current"), "object 'Wall' is animated"),
    (lambda scene: driven_by(scene, scene.camera.data, "dof.focus_distance"), "object 'Wall' is animated"),
    (lambda scene: driven_by(scene, scene.camera, "data.dof.focus_distance"), "object 'Wall' is animated"),
    (lambda scene: driven_by(scene, scene, "frame_current"), "object 'Wall' is animated"),
    (lambda scene: driven_by(scene, focus_object(scene), "location.x"), "object 'Focus' is animated"),
    (lambda scene: scene.objects["Wall"].modifiers.new("Wave", "WAVE"), "object 'Wall' has 'Wave'"),
    (lambda scene: scene.objects["Wall"].modifiers.new("Cloth", "CLOTH"), "object 'Wall' has 'Cloth'"),
    (particles, "object 'Wall' has 'Dust'"),
    (rigid_bodies, "the scene has rigid bodies"),
    (simulation_node, "has 'Scene Time'"),
    (lambda scene: simulation_node(scene, "GeometryNodeSimulationInput"), "has 'Simulation Input'"),
    (attribute, "material 'Paint' has 'Attribute'"),
    (film, "image 'Film' is a movie or sequence"),
    (lambda scene: moving_parent(scene, scene.objects["Wall"]), "object 'Parent' is animated"),
    (lambda scene: moving_parent(scene, scene.camera), "object 'Parent' is animated"),
    (follows_focus, "object 'Focus' is animated"), (textured_by_focus, "object 'Focus' is animated"),
    (scattered_by_focus, "object 'Focus' is animated"),
    (shape_keys, "key 'Key' is animated"), (strips, "object 'Wall' is animated"),
    (instanced, "object 'Thing' is animated"), (within_the_shutter, "object 'Wall' is animated"),
    (lambda scene: markers(scene, other_camera(scene)), "markers change the camera")])
def test_other_movement_is_reported(rack, change, reason):
    change(rack)
    assert reason in moving(rack, FRAMES)


def test_frame_change_scripts_count_as_movement(rack):
    def script(*_):
        pass

    bpy.app.handlers.frame_change_pre.append(script)
    try:
        assert "test_motion runs on each frame" in moving(rack, FRAMES)
    finally:
        bpy.app.handlers.frame_change_pre.remove(script)


def test_movement_outside_the_frame_range_does_not_count(rack):
    keyframe(rack.objects["Wall"], "location", (0, 0, -1), (0, 0, -1), (0, 0, -2))
    assert not moving(rack, FRAMES) and moving(rack, (*FRAMES, 9))
    markers(rack, rack.camera)
    rack.timeline_markers.new("Late", frame=8).camera = other_camera(rack)
    assert not moving(rack, FRAMES)
