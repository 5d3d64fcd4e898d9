"""View layers: which is rendered, overrides, collections, light groups, passes."""

import bpy

from .kit import collection, glowing, layer_collection, ordinary, painted


def _second(stage, name="Second"):
    """Another view layer, which is on as well."""
    return stage.scene.view_layers.new(name)


@ordinary(refused="choose one with View Layer")
def several_layers(stage):
    """Two view layers that are on, without a choice"""
    _second(stage)


@ordinary(request={"view_layer": "Second"}, plain={"view_layer": "Second"})
def chosen_layer(stage):
    """One of two view layers, which excludes a collection"""
    collection(stage, "Props", stage.cube)
    layer_collection(_second(stage), "Props").exclude = True


@ordinary()
def layer_that_is_off(stage):
    """A view layer that is on, and another that is off"""
    _second(stage).use = False


@ordinary()
def clay_override(stage):
    """A material override: clay"""
    stage.scene.view_layers[0].material_override = painted("Clay", (0.6, 0.5, 0.45))


@ordinary()
def world_override(stage):
    """A world override"""
    world = bpy.data.worlds.new("Dusk")
    world.use_nodes = True
    next(node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground"
         ).inputs["Color"].default_value = (0.3, 0.12, 0.08, 1)
    stage.scene.view_layers[0].world_override = world


@ordinary()
def layer_samples(stage):
    """Samples of the view layer"""
    stage.scene.view_layers[0].samples = stage.scene.cycles.samples // 2


@ordinary()
def holdout_collection(stage):
    """A collection that is held out, on a transparent film"""
    stage.scene.render.film_transparent = True
    collection(stage, "Props", stage.cube, stage.cone)
    layer_collection(stage.scene.view_layers[0], "Props").holdout = True


@ordinary()
def indirect_only(stage):
    """A collection with visible shadows and reflections alone (Indirect Only)"""
    collection(stage, "Props", stage.cube)
    layer_collection(stage.scene.view_layers[0], "Props").indirect_only = True


@ordinary()
def excluded_collection(stage):
    """A collection that the view layer excludes"""
    collection(stage, "Props", stage.ball)
    layer_collection(stage.scene.view_layers[0], "Props").exclude = True


@ordinary()
def without_sky(stage):
    """A view layer without the environment (Filter: Environment off)"""
    stage.scene.view_layers[0].use_sky = False


@ordinary()
def light_groups(stage):
    """The artist's own light groups"""
    layer = stage.scene.view_layers[0]
    for name in ("Key", "Sky", "Marks"):
        layer.lightgroups.add(name=name)
    stage.lamp.lightgroup, stage.world.lightgroup = "Key", "Sky"
    bpy.data.objects["Mark 1"].lightgroup = "Marks"


@ordinary()
def shader_aov(stage):
    """An AOV, passes of light, and Cryptomatte"""
    layer = stage.scene.view_layers[0]
    layer.aovs.add().name = "Mask"
    layer.use_pass_diffuse_color = layer.use_pass_normal = layer.use_pass_cryptomatte_object = True
    tree = stage.ball.data.materials[0].node_tree
    aov = tree.nodes.new("ShaderNodeOutputAOV")
    aov.aov_name = "Mask"
    aov.inputs[0].default_value = 1, 0.5, 0, 1


@ordinary()
def hidden_from_render(stage):
    """An object and a collection that renders hide"""
    stage.cone.hide_render = True
    collection(stage, "Props", stage.cube).hide_render = True


@ordinary()
def hidden_in_viewport(stage):
    """An object that only the viewport hides"""
    stage.cube.hide_set(True)
    stage.cone.hide_viewport = False


@ordinary()
def ray_visibility(stage):
    """Objects without shadow, without reflection, and hidden from the camera"""
    stage.cube.visible_shadow = False
    stage.cone.visible_glossy = False
    lamp = stage.link("Card", stage.cube.data.copy(), (0.5, 0.2, 0.4))
    lamp.data.materials[0] = glowing("Card", (1, 0.6, 0.4), 5)
    lamp.visible_camera = False
