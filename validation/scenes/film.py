"""Film and sampling: exposure, filter, transparency, holdouts, shadow catchers, clamps, bounces, adaptive sampling."""

from .kit import background, box, glowing, node_for, ordinary, painted, principled, shaded, sphere


@ordinary()
def film_exposure(stage):
    """A film exposure of 2.5"""
    stage.scene.cycles.film_exposure = 2.5


@ordinary(remark="Pixel Filter")
def wide_pixel_filter(stage):
    """A Gaussian pixel filter, which is ignored and remarked on"""
    stage.scene.cycles.pixel_filter_type, stage.scene.cycles.filter_width = "GAUSSIAN", 2.0


@ordinary()
def transparent_film(stage):
    """A transparent film"""
    stage.scene.render.film_transparent = True


@ordinary()
def transparent_film_and_glass(stage):
    """A transparent film, with transparent glass"""
    stage.scene.render.film_transparent = stage.scene.cycles.film_transparent_glass = True
    glass = painted("Glass", (1, 1, 1), 0.0, Transmission_Weight=1.0)
    stage.ball.data.materials[0] = glass


@ordinary()
def holdout_object(stage):
    """A held-out object on a transparent film"""
    stage.scene.render.film_transparent = True
    stage.cube.is_holdout = True


@ordinary()
def holdout_object_on_opaque_film(stage):
    """A held-out object on an opaque film"""
    stage.cube.is_holdout = True


@ordinary()
def holdout_shader(stage):
    """A Holdout shader in a mix"""
    stage.scene.render.film_transparent = True
    material = painted("Half", (0.8, 0.5, 0.2))
    tree = material.node_tree
    hold, mix = tree.nodes.new("ShaderNodeHoldout"), tree.nodes.new("ShaderNodeMixShader")
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    mix.inputs[0].default_value = 0.4
    for source, sink in ((principled(material).outputs[0], mix.inputs[1]), (hold.outputs[0], mix.inputs[2]),
                         (mix.outputs[0], output.inputs["Surface"])):
        tree.links.new(source, sink)
    stage.cube.data.materials[0] = material


@ordinary()
def shadow_catcher(stage):
    """A table that catches shadows, on a transparent film"""
    stage.scene.render.film_transparent = True
    stage.floor.is_shadow_catcher = True


@ordinary()
def clamped(stage):
    """Clamp Direct and Clamp Indirect, with a mirror and a bright lamp"""
    stage.scene.cycles.sample_clamp_direct, stage.scene.cycles.sample_clamp_indirect = 3.0, 1.0
    stage.ball.data.materials[0] = painted("Chrome", (0.9, 0.9, 0.9), 0.1, Metallic=1.0)
    stage.link("Bulb", sphere(0.03, glowing("Bulb", (1, 1, 1), 60)), (-0.05, -0.25, 0.28))


@ordinary()
def few_bounces(stage):
    """No diffuse bounces, and one of the others"""
    cycles = stage.scene.cycles
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 1, 0, 1


@ordinary()
def many_bounces(stage):
    """A closed white room of 32 bounces"""
    cycles = stage.scene.cycles
    cycles.max_bounces = cycles.diffuse_bounces = 32
    stage.lamp.location = (-0.4, -0.4, 0.8)
    room = stage.link("Room", box((3, 3, 2), painted("White", (0.85, 0.85, 0.85)), "Room"), (0, 0, 0.9))
    room.visible_camera = False


@ordinary()
def simplified(stage):
    """Simplify: fewer subdivisions and smaller textures"""
    render = stage.scene.render
    render.use_simplify, render.simplify_subdivision_render = True, 1
    stage.cube.modifiers.new("Smooth", "SUBSURF").render_levels = 4
    stage.scene.cycles.texture_limit_render = "128"


@ordinary()
def adaptive_sampling(stage):
    """Adaptive sampling"""
    cycles = stage.scene.cycles
    cycles.use_adaptive_sampling, cycles.adaptive_threshold, cycles.samples = True, 0.02, 2 * cycles.samples


@ordinary()
def denoised(stage):
    """Denoised by OpenImageDenoise"""
    stage.scene.cycles.use_denoising, stage.scene.cycles.denoiser = True, "OPENIMAGEDENOISE"
    stage.scene.cycles.samples *= 4  # the denoiser keeps the light of noisy marks to a few per cent


@ordinary()
def blue_noise(stage):
    """Blender's own sampling pattern, which shares noise between neighbours"""
    stage.scene.cycles.sampling_pattern = "AUTOMATIC"


@ordinary()
def filter_glossy(stage):
    """Filter Glossy, without caustics"""
    cycles = stage.scene.cycles
    cycles.blur_glossy, cycles.caustics_reflective, cycles.caustics_refractive = 1.0, False, False
    stage.ball.data.materials[0] = painted("Chrome", (0.9, 0.8, 0.7), 0.05, Metallic=1.0)


@ordinary()
def path_guiding(stage):
    """Path guiding"""
    stage.scene.cycles.use_guiding = True


@ordinary()
def animated_seed(stage):
    """A seed that follows the frame, by a driver and by its clock"""
    stage.scene.driver_add("cycles.seed").driver.expression = "frame"
    stage.scene.cycles.use_animated_seed = True
    stage.scene.frame_set(17)


@ordinary()
def mist_of_camera_data(stage):
    """Mist by Camera Data, as in node tutorials"""
    material = stage.floor.data.materials[0]
    depth = node_for(material, "ShaderNodeCameraData", "Roughness", 2)
    tree = material.node_tree
    mix, map_range = tree.nodes.new("ShaderNodeMix"), tree.nodes.new("ShaderNodeMapRange")
    mix.data_type = "RGBA"
    mix.inputs["A"].default_value, mix.inputs["B"].default_value = (0.5, 0.3, 0.2, 1), (0.7, 0.75, 0.8, 1)
    map_range.inputs["From Min"].default_value, map_range.inputs["From Max"].default_value = 0.9, 2.2
    tree.links.new(depth.outputs["View Z Depth"], map_range.inputs[0])
    tree.links.new(map_range.outputs[0], mix.inputs[0])
    tree.links.new(mix.outputs["Result"], principled(material).inputs["Base Color"])


@ordinary(remark="Empty Frame", layers=False)
def nothing_to_see(stage):
    """An empty, black picture is reported"""
    stage.remove(*[thing for thing in stage.scene.objects if thing.type != "CAMERA"])
    background(stage.world).inputs["Strength"].default_value = 0


@ordinary()
def emissive_only(stage):
    """Shadeless materials alone"""
    for thing, colour in ((stage.ball, (0.9, 0.3, 0.1)), (stage.cube, (0.1, 0.3, 0.8)), (stage.floor, (0.2, 0.2, 0.2))):
        thing.data.materials[0] = shaded(thing.name, "ShaderNodeEmission", Color=(*colour, 1))[0]
