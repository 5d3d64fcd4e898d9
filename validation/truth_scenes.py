"""Scenes of known grey light for the traced lens and for Lensfield: beads, a chequered plane, even light.

All spectra are constant from 380 to 780 nm, so a strength of 1 is 1/400 W m^-2 sr^-1 nm^-1 at every wavelength.
"""

import bpy
import numpy as np

GREY = "380:1, 780:1"
FAR_MM = 1e7  # represents infinity: at 10 km a lens of 100 mm f/2 is out of focus by half a micrometre


def empty_scene():
    """A black scene with a camera at the origin that looks along -z."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.sample_clamp_indirect = 0
    scene.render.resolution_percentage = 100
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.clip_start, camera.data.clip_end = 1e-3, 1e-2 * FAR_MM
    scene.collection.objects.link(camera)
    scene.camera, scene.world = camera, bpy.data.worlds.new("World")
    scene.world.use_nodes = True  # always true since 5.0
    set_even_light(scene, 0.0)
    return scene


def set_even_light(scene, strength):
    """Light of the same radiance from everywhere."""
    nodes = scene.world.node_tree.nodes
    background = next(node for node in nodes if node.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    background.inputs["Strength"].default_value = strength
    scene.world.lensfield.emission = GREY


def object_plane_mm(lens):
    """Distance of the object plane from the entrance pupil."""
    return min(lens.object_distance_mm + lens.entrance_pupil_mm, FAR_MM)


def place_in_scene(lens, paraxial_mm, distance_mm):
    """Points in Blender, in metres, from their ideal images in mm: array (…, 3) from (…, 2)."""
    scale = distance_mm / lens.capture_focal_length_mm
    depth = np.full((*np.shape(paraxial_mm)[:-1], 1), -distance_mm)
    return np.concatenate([scale * np.asarray(paraxial_mm), depth], axis=-1) * 1e-3


def add_beads(scene, lens, paraxial_mm, radius_um, distance_mm=None, corners=32):
    """Flat round lights of strength 1 with ideal images at (bead, 2) mm; in the object plane by default.

    Their area equals the area of a circle with this radius in the ideal image.
    """
    distance_mm = distance_mm or object_plane_mm(lens)
    angles = 2 * np.pi * np.arange(corners) / corners
    radius_mm = radius_um * 1e-3 * np.sqrt(2 * np.pi / corners / np.sin(2 * np.pi / corners))
    rim_mm = radius_mm * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = place_in_scene(lens, np.asarray(paraxial_mm)[:, None] + rim_mm, distance_mm).reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, corners)
    add_mesh(scene, "Beads", vertices, faces, glow("Bead"))


def add_chequer(scene, lens, half_width_mm, square_mm):
    """A plane of light and dark squares that fills an ideal image of this half width."""
    count = int(np.ceil(half_width_mm / square_mm))
    distance_mm = object_plane_mm(lens)
    corner = place_in_scene(lens, np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * square_mm / 2, distance_mm)
    centres = np.arange(-count, count + 1)
    chequer = [(i, j) for i in centres for j in centres if (i + j) % 2 == 0]
    offset = place_in_scene(lens, np.array(chequer) * square_mm, distance_mm) * (1, 1, 0)
    vertices = (offset[:, None] + corner).reshape(-1, 3)
    add_mesh(scene, "Squares", vertices, np.arange(len(vertices)).reshape(-1, 4), glow("Square"))


def add_mesh(scene, name, vertices, faces, material):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def glow(name):
    """A grey light of strength 1, visible but not sampled."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material.node_tree.nodes.clear()
    shader = material.node_tree.nodes.new("ShaderNodeEmission")
    shader.inputs["Color"].default_value = (1, 1, 1, 1)
    output = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    material.lensfield.emission = GREY
    material.cycles.emission_sampling = "NONE"
    return material
