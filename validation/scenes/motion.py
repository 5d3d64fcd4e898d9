"""Motion blur: of objects, deformation, hair, particles, by all shutter positions, and animated values."""

from math import radians

import bpy

from .kit import keyed, ordinary, painted, principled


def _blurred(stage, frame=3, shutter=0.5):
    render = stage.scene.render
    render.use_motion_blur, render.motion_blur_shutter = True, shutter
    stage.scene.frame_set(frame)


@ordinary()
def moving_object(stage):
    """An object and a mark that move"""
    keyed(stage.cube, "location", {1: 0.0, 5: 0.4}, 0)
    keyed(bpy.data.objects["Mark 2"], "location", {1: 0.25, 5: 0.45}, 0)
    _blurred(stage)


@ordinary()
def spinning_object(stage):
    """An object that turns, with three steps of motion"""
    keyed(stage.cube, "rotation_euler", {1: 0.0, 5: radians(160)}, 2)
    stage.cube.cycles.motion_steps = 3
    _blurred(stage, shutter=1.0)


@ordinary()
def shutter_at_start(stage):
    """A shutter that opens at the frame"""
    stage.scene.render.motion_blur_position = "START"
    moving_object(stage)


@ordinary()
def shutter_curve(stage):
    """A shutter that closes slowly"""
    curve = stage.scene.render.motion_blur_shutter_curve
    curve.curves[0].points.new(0.4, 0.3)
    curve.update()
    moving_object(stage)


@ordinary()
def rolling_shutter(stage):
    """A rolling shutter"""
    stage.scene.cycles.rolling_shutter_type, stage.scene.cycles.rolling_shutter_duration = "TOP", 0.1
    moving_object(stage)


@ordinary()
def deforming_mesh(stage):
    """A shape key that changes during the exposure"""
    stage.ball.shape_key_add(name="Basis")
    key = stage.ball.shape_key_add(name="Wide")
    for point in key.data:
        point.co.x *= 1.8
    keyed(key, "value", {1: 0.0, 5: 1.0})
    _blurred(stage)


@ordinary()
def moving_lamp(stage):
    """A lamp that moves, and one object without motion blur"""
    keyed(stage.lamp, "location", {1: -0.9, 5: 0.5}, 0)
    keyed(stage.cone, "location", {1: 0.0, 5: 0.3}, 0)
    stage.cone.cycles.use_motion_blur = False
    _blurred(stage)


@ordinary()
def moving_instances(stage):
    """Instances that move with their collection's empty"""
    source = bpy.data.collections.new("Pieces")
    source.objects.link(stage.cube)
    stage.scene.collection.objects.unlink(stage.cube)
    empty = stage.link("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", source
    keyed(empty, "location", {1: -0.2, 5: 0.2}, 0)
    _blurred(stage)


@ordinary()
def animated_materials(stage):
    """A colour, a strength and a visibility that are keyframed, at a later frame"""
    orange = stage.ball.data.materials[0]
    keyed(principled(orange).inputs["Base Color"], "default_value", {1: 0.1, 11: 0.9}, 1)
    keyed(stage.lamp.data, "energy", {1: 4, 11: 24})
    keyed(stage.cone, "hide_render", {1: False, 6: True})
    stage.scene.frame_set(8)


@ordinary()
def drivers(stage):
    """Drivers of a location, a colour and a lamp"""
    stage.scene["slider"] = 0.3
    for owner, path, index, text in ((stage.cube, "location", 2, "0.05 + x"), (stage.lamp.data, "energy", -1, "40 * x"),
                                     (principled(stage.ball.data.materials[0]).inputs["Base Color"], "default_value", 2,
                                      "x")):
        curve = owner.driver_add(path, index) if index >= 0 else owner.driver_add(path)
        variable = curve.driver.variables.new()
        variable.name, variable.type = "x", "SINGLE_PROP"
        variable.targets[0].id_type, variable.targets[0].id = "SCENE", stage.scene
        variable.targets[0].data_path = '["slider"]'
        curve.driver.expression = text


@ordinary()
def particles(stage):
    """Particles that fall, as instances, with motion blur"""
    stage.floor.modifiers.new("Dust", "PARTICLE_SYSTEM")
    settings = stage.floor.particle_systems[0].settings
    settings.count, settings.frame_start, settings.frame_end, settings.lifetime = 60, 1, 3, 50
    settings.normal_factor, settings.render_type = 0.6, "OBJECT"
    from .kit import sphere
    pea = stage.link("Pea", sphere(0.2, painted("Pea", (0.3, 0.6, 0.1)), rings=8), (0, 0, -5))
    settings.instance_object, settings.particle_size = pea, 0.1
    _blurred(stage, 8)
    bpy.ops.ptcache.bake_all(bake=True)  # otherwise the particles depend on which frames were evaluated before
