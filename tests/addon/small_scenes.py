"""Small scenes, built by hand, with radiances known in closed form."""

import bpy
import numpy as np

from lensfield import addon
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

WAVELENGTHS_NM = (450.0, 550.0, 650.0)


def adjust(scene, **values):
    """Set Lensfield's settings of a scene and of its camera, each by its name."""
    of_camera = scene.camera.data.lensfield
    for name, value in values.items():
        setattr(of_camera if name in of_camera.bl_rna.properties else scene.lensfield, name, value)


def background(scene):
    return next(node for node in scene.world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")


def set_world(scene, colour=(1, 1, 1), strength=1.0):
    background(scene).inputs["Color"].default_value = (*colour, 1)
    background(scene).inputs["Strength"].default_value = strength


def keyframe_world(scene, *frames):
    """A white world whose strength at each of these frames is the frame's number."""
    set_world(scene)
    for frame in frames:
        background(scene).inputs["Strength"].default_value = frame
        background(scene).inputs["Strength"].keyframe_insert("default_value", frame=frame)


def material(name, node_type, colour=(0.8, 0.8, 0.8)):
    """A material of one shader node; returns it and the node."""
    new = bpy.data.materials.new(name)
    new.use_nodes = True
    new.node_tree.nodes.clear()
    shader = new.node_tree.nodes.new(node_type)
    shader.inputs["Color"].default_value = (*colour, 1)
    output = new.node_tree.nodes.new("ShaderNodeOutputMaterial")
    new.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return new, shader


def paint_by_nodes(name, colour, socket_colour=(0, 0, 0)):
    """A diffuse material with a colour from a node; returns it and the link."""
    painted, shader = material(name, "ShaderNodeBsdfDiffuse", socket_colour)
    source = painted.node_tree.nodes.new("ShaderNodeRGB")
    source.outputs[0].default_value = (*colour, 1)
    return painted, painted.node_tree.links.new(source.outputs[0], shader.inputs["Color"])


def wall(scene, of_material, distance_m=1.0, side_m=10.0):
    """A square that faces the camera and fills its view."""
    half = side_m / 2
    mesh = bpy.data.meshes.new("Wall")
    mesh.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(of_material)
    wall_object = bpy.data.objects.new("Wall", mesh)
    wall_object.location.z = -distance_m
    scene.collection.objects.link(wall_object)
    return wall_object


def set_region(scene, left, right, bottom, top):
    """Render a part of the frame: fractions of its width from the left, and of its height from below."""
    render = scene.render
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = left, right, bottom, top


def view_factor(side_m, distance_m):
    """The view factor of a square that faces a wall: its cosine-weighted share of the wall's hemisphere."""
    ratio = side_m / 2 / distance_m
    sine = ratio / np.hypot(1, ratio)
    return 4 / np.pi * sine * np.arctan(sine)


def light(scene, kind, watts, **properties):
    """A light at the camera."""
    new = bpy.data.lights.new("Light", kind)
    new.energy = watts
    for name, value in properties.items():
        setattr(new, name, value)
    light_object = bpy.data.objects.new("Light", new)
    scene.collection.objects.link(light_object)
    return light_object


def give(modifier, identifier, value):
    """Set an input of a modifier's geometry nodes; returns the owner and the property path."""
    if hasattr(modifier, "properties"):  # since 5.2
        given = getattr(modifier.properties.inputs, identifier)
        given.value = value
        return given, "value"
    modifier[identifier] = value
    return modifier, f'["{identifier}"]'


def render(scene, folder, wavelengths_nm=WAVELENGTHS_NM, **options):
    return addon.render_through_lens(scene, lens="edmund-54852", wavelengths_nm=wavelengths_nm, output_folder=folder,
                                     **options)


def radiance_on_axis(scene, folder, wavelengths_nm=WAVELENGTHS_NM):
    """Spectral radiance of the four central pixels, one value for each wavelength, each rendered."""
    result = render(scene, folder, wavelengths_nm, spectral=SpectralOptions("reference"), depth="off")
    cube = read_exr(result.radiance).cube
    rows, columns = cube.shape[1:]
    return cube[:, rows // 2 - 1:rows // 2 + 1, columns // 2 - 1:columns // 2 + 1].mean(axis=(1, 2), dtype=np.float64)
