"""Materials: closures, mixes, textures of nodes, and the nodes that Lensfield refuses."""

import bpy
import numpy as np

from .kit import box, checks, image, node_for, ordinary, painted, principled, shaded, sphere


def _on(stage, material, thing="ball"):
    getattr(stage, thing).data.materials[0] = material
    return material


@ordinary()
def metals(stage):
    """Metals of several roughnesses"""
    _on(stage, painted("Gold", (1.0, 0.75, 0.35), 0.15, Metallic=1.0))
    _on(stage, painted("Copper", (0.95, 0.6, 0.5), 0.4, Metallic=1.0), "cube")
    _on(stage, painted("Steel", (0.6, 0.6, 0.6), 0.25, Metallic=1.0, Anisotropic=0.6), "cone")


@ordinary()
def principled_layers(stage):
    """Coat, sheen, and specular levels, all of them grey"""
    _on(stage, painted("Lacquer", (0.5, 0.05, 0.05), 0.5, Coat_Weight=0.8, Coat_Roughness=0.1))
    _on(stage, painted("Cloth", (0.1, 0.2, 0.4), 0.8, Sheen_Weight=0.6), "cube")
    _on(stage, painted("Chalk", (0.7, 0.7, 0.65), 0.9, Specular_IOR_Level=0.1), "cone")


@ordinary()
def coloured_specular_tint(stage):
    """A coloured Specular Tint, which mixes wavelengths in Cycles"""
    _on(stage, painted("Tinted", (0.3, 0.3, 0.35), 0.3, Specular_Tint=(1.0, 0.5, 0.3, 1)))


@ordinary()
def glass(stage):
    """Clear glass in front of things"""
    stage.scene.cycles.samples *= 4  # for the caustics of small lamps
    _on(stage, painted("Glass", (1, 1, 1), 0.0, Transmission_Weight=1.0))
    stage.ball.location = 0.05, -0.35, 0.15


@ordinary()
def tinted_frosted_glass(stage):
    """Frosted glass of a pale colour"""
    _on(stage, painted("Frosted", (0.75, 0.9, 0.8), 0.3, Transmission_Weight=1.0))


@ordinary()
def dispersive_glass(stage):
    """A prism of N-SF11, for Cycles alone with an index for each channel"""
    stage.cube.data.materials[0] = prism = painted("Prism", (1, 1, 1), 0.0, Transmission_Weight=1.0)
    prism.lensfield.refraction = "n-sf11"


@ordinary()
def subsurface(stage):
    """Skin: subsurface scattering"""
    _on(stage, painted("Skin", (0.8, 0.5, 0.4), 0.4, Subsurface_Weight=1.0, Subsurface_Scale=0.03))


@ordinary()
def wax(stage):
    """The Subsurface Scattering node alone, random walk"""
    _on(stage, shaded("Wax", "ShaderNodeSubsurfaceScattering", Color=(0.7, 0.6, 0.3, 1), Scale=0.02)[0])


@ordinary()
def transparent_panes(stage):
    """Coloured transparent panes behind one another"""
    pane = shaded("Pane", "ShaderNodeBsdfTransparent", Color=(0.9, 0.6, 0.5, 1))[0]
    for number in range(3):
        stage.link(f"Pane {number}", box((0.4, 0.005, 0.4), pane), (-0.15 + 0.1 * number, -0.4 + 0.08 * number, 0.2))


@ordinary()
def alpha_image(stage):
    """A leaf cut out by the alpha of an image"""
    rows, columns = np.indices((64, 64)) / 63 - 0.5
    alpha = (np.hypot(rows, 2 * columns * (1 + rows)) < 0.4).astype(float)
    pixels = np.stack([0.2 + 0 * rows, 0.45 + 0.3 * rows, 0.08 + 0 * rows, alpha], axis=-1)
    material = painted("Cut", (1, 1, 1))
    node = node_for(material, "ShaderNodeTexImage")
    node.image = image("leaf.png", pixels)
    material.node_tree.links.new(node.outputs["Alpha"], principled(material).inputs["Alpha"])
    from .kit import plane
    leaf = stage.link("Leaf", plane(0.25, material), (0.05, -0.3, 0.26))
    leaf.rotation_euler = 1.2, 0.2, 0.3


@ordinary()
def old_closures(stage):
    """Diffuse, glossy and translucent shaders, added and mixed"""
    material, diffuse = shaded("Mix", "ShaderNodeBsdfDiffuse", Color=(0.6, 0.2, 0.1, 1))
    tree = material.node_tree
    glossy, mix, weight = (tree.nodes.new(f"ShaderNode{kind}") for kind in (
        "BsdfAnisotropic", "MixShader", "LayerWeight"))
    output = next(each for each in tree.nodes if each.bl_idname == "ShaderNodeOutputMaterial")
    for source, sink in ((weight.outputs["Fresnel"], mix.inputs[0]), (diffuse.outputs[0], mix.inputs[1]),
                         (glossy.outputs[0], mix.inputs[2]), (mix.outputs[0], output.inputs["Surface"])):
        tree.links.new(source, sink)
    _on(stage, material)
    _on(stage, shaded("Paper", "ShaderNodeBsdfTranslucent", Color=(0.8, 0.75, 0.6, 1))[0], "cone")
    _on(stage, shaded("Velvet", "ShaderNodeBsdfSheen", Color=(0.4, 0.1, 0.3, 1))[0], "cube")


@ordinary()
def toon(stage):
    """Toon shaders"""
    _on(stage, shaded("Toon", "ShaderNodeBsdfToon", Color=(0.7, 0.3, 0.2, 1))[0])


@ordinary()
def procedural_textures(stage):
    """Noise, Voronoi, waves, bricks, checks and gradients through ramps"""
    for thing, kind, socket in (("ball", "ShaderNodeTexVoronoi", "Color"), ("cube", "ShaderNodeTexBrick", "Color"),
                                ("cone", "ShaderNodeTexWave", "Color"), ("floor", "ShaderNodeTexChecker", "Color")):
        material = painted(kind, (1, 1, 1))
        node = node_for(material, kind, output=socket)
        node.inputs["Scale"].default_value = 4
        _on(stage, material, thing)


@ordinary()
def colour_arithmetic(stage):
    """Mix, RGB Curves, Hue/Saturation, Gamma and a ramp in a chain"""
    material = painted("Chain", (1, 1, 1))
    tree, chain = material.node_tree, None
    for kind in ("ShaderNodeTexNoise", "ShaderNodeValToRGB", "ShaderNodeHueSaturation", "ShaderNodeGamma",
                 "ShaderNodeBrightContrast", "ShaderNodeInvert"):
        node = tree.nodes.new(kind)
        if chain:
            sink = node.inputs["Fac"] if kind == "ShaderNodeValToRGB" else node.inputs["Color"]
            tree.links.new(chain.outputs[0], sink)
        chain = node
    chain.inputs["Fac"].default_value = 0.3
    tree.links.new(chain.outputs[0], principled(material).inputs["Base Color"])
    _on(stage, material, "cube")


@ordinary()
def bump_and_normal_maps(stage):
    """A bump and a normal map"""
    bumpy = painted("Bumpy", (0.5, 0.5, 0.55), 0.4)
    noise, bump = (bumpy.node_tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexNoise", "Bump"))
    noise.inputs["Scale"].default_value = 30
    bumpy.node_tree.links.new(noise.outputs[0], bump.inputs["Height"])
    bumpy.node_tree.links.new(bump.outputs[0], principled(bumpy).inputs["Normal"])
    _on(stage, bumpy)
    mapped = painted("Mapped", (0.5, 0.45, 0.4), 0.5)
    rows, columns = np.indices((32, 32))
    pixels = np.stack([0.5 + 0.3 * np.sin(columns / 2), 0.5 + 0.3 * np.cos(rows / 2), np.full((32, 32), 0.9)], axis=-1)
    picture, normal = (mapped.node_tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "NormalMap"))
    picture.image = image("normal.png", pixels, "Non-Color")
    mapped.node_tree.links.new(picture.outputs[0], normal.inputs["Color"])
    mapped.node_tree.links.new(normal.outputs[0], principled(mapped).inputs["Normal"])
    _on(stage, mapped, "floor")


@ordinary()
def geometry_effects(stage):
    """Ambient Occlusion, Bevel, Wireframe and Pointiness nodes"""
    stage.scene.cycles.samples *= 4  # each traces one short ray for occlusion and bevel
    occluded = painted("Occluded", (1, 1, 1))
    occlusion = node_for(occluded, "ShaderNodeAmbientOcclusion")
    occlusion.inputs["Distance"].default_value = 0.2
    _on(stage, occluded, "floor")
    rounded = painted("Rounded", (0.4, 0.4, 0.7))
    bevel = node_for(rounded, "ShaderNodeBevel", "Normal")
    bevel.inputs["Radius"].default_value = 0.03
    _on(stage, rounded, "cube")
    wired = painted("Wired", (0.5, 0.1, 0.1))
    wire = node_for(wired, "ShaderNodeWireframe", "Roughness")
    wire.inputs["Size"].default_value = 0.01
    _on(stage, wired)


@ordinary()
def object_info(stage):
    """Colours by Object Info, Random Per Island, and the object's colour"""
    material = painted("Own", (1, 1, 1))
    node_for(material, "ShaderNodeObjectInfo", output="Color")
    for thing, colour in ((stage.ball, (0.8, 0.2, 0.2, 1)), (stage.cube, (0.2, 0.7, 0.3, 1))):
        thing.data.materials[0], thing.color = material, colour


@ordinary()
def light_path_trick(stage):
    """A floor that is darker in reflections and for bounces (Light Path)"""
    material = painted("Trick", (0.6, 0.55, 0.5))
    tree = material.node_tree
    path, mix = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    mix.inputs["A"].default_value, mix.inputs["B"].default_value = (0.1, 0.1, 0.1, 1), (0.6, 0.55, 0.5, 1)
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    tree.links.new(mix.outputs["Result"], principled(material).inputs["Base Color"])
    _on(stage, material, "floor")


@ordinary()
def absorbing_glass(stage):
    """A vessel of clear glass with absorbing volume"""
    material = painted("Drink", (1, 1, 1), 0.0, Transmission_Weight=1.0)
    tree = material.node_tree
    volume = tree.nodes.new("ShaderNodeVolumeAbsorption")
    volume.inputs["Color"].default_value, volume.inputs["Density"].default_value = (0.8, 0.4, 0.2, 1), 4
    output = next(each for each in tree.nodes if each.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(volume.outputs[0], output.inputs["Volume"])
    _on(stage, material)


@ordinary(refused="rejected")
def thin_film(stage):
    """A soap film, which Cycles renders in red, green and blue only"""
    _on(stage, painted("Film", (0.5, 0.5, 0.5), 0.1, Thin_Film_Thickness=400.0))


@ordinary(request={"unfit": "render"})
def thin_film_anyway(stage):
    """A soap film, rendered anyway"""
    thin_film(stage)


@ordinary(request={"unfit": "render"})
def melanin_hair(stage):
    """Principled Hair by melanin, rendered anyway"""
    material, shader = shaded("Hair", "ShaderNodeBsdfHairPrincipled")
    shader.parametrization = "MELANIN"
    _on(stage, material)


@ordinary()
def bare_object(stage):
    """Objects without a material, and one with an empty slot"""
    stage.link("Bare", sphere(0.08, None), (0.0, -0.35, 0.08))
    stage.cube.data.materials[0] = None


@ordinary()
def node_groups(stage):
    """A shared node group with inputs, nested"""
    tree = bpy.data.node_groups.new("Paint", "ShaderNodeTree")
    tree.interface.new_socket("Colour", in_out="INPUT", socket_type="NodeSocketColor")
    tree.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    inside, out, shader = (tree.nodes.new(kind) for kind in ("NodeGroupInput", "NodeGroupOutput",
                                                             "ShaderNodeBsdfPrincipled"))
    tree.links.new(inside.outputs[0], shader.inputs["Base Color"])
    tree.links.new(shader.outputs[0], out.inputs[0])
    for thing, colour in (("ball", (0.7, 0.2, 0.1, 1)), ("cube", (0.1, 0.3, 0.7, 1))):
        material = bpy.data.materials.new(thing)
        material.use_nodes = True
        nodes = material.node_tree.nodes
        nodes.clear()
        group, output = nodes.new("ShaderNodeGroup"), nodes.new("ShaderNodeOutputMaterial")
        group.node_tree = tree
        group.inputs[0].default_value = colour
        material.node_tree.links.new(group.outputs[0], output.inputs[0])
        _on(stage, material, thing)


@ordinary()
def emission_in_principled(stage):
    """Emission in a Principled shader, with a coloured texture"""
    material = painted("Lantern", (0.3, 0.3, 0.3), Emission_Strength=2.0)
    node_for(material, "ShaderNodeTexImage", "Emission Color").image = image("lantern.png", checks())
    _on(stage, material)
