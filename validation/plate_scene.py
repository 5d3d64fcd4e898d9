"""The scene of a measured plate in front of a calibrated camera, and Lensfield's picture of it."""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

import truth_scenes
from calibration import WAVELENGTH_NM, calibrated_lens
from lensfield import addon
from lensfield.commands.terminal import quiet
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.runtime.files import temporary_folder
from lensfield.engine.stray.options import OFF, StrayOptions

STRAIGHT_RAD = 0.01  # angles of the plates' circles differ by more from a straight one


@dataclass(frozen=True, eq=False)
class Plate:
    """The printed side of a plate: corners of its squares, and all its vertices, arrays (number, 3) in metres."""

    corners: np.ndarray
    vertices: np.ndarray


def render(calibration, model, samples=64):
    """Lensfield's picture of a plate through the lens of a calibration: uint8 array (row, column)."""
    scene = truth_scenes.empty_scene()
    load_plate(model)
    place_camera(scene, calibration)
    scene.render.resolution_x, scene.render.resolution_y = calibration.size_px
    scene.cycles.samples = samples
    with temporary_folder() as folder, quiet(1):  # suppresses Blender's messages about saved passes
        result = addon.render_through_lens(
            scene, lens=calibrated_lens(calibration), wavelengths_nm=[WAVELENGTH_NM], output_folder=folder, depth="off",
            stray=StrayOptions(OFF))
        light = read_exr(result.irradiance).cube[0]
    return np.uint8(np.rint(np.clip(255 * light / np.percentile(light, 99), 0, 255)))


def place_camera(scene, calibration):
    """Place a scene's camera as calibrated, with a sun that shines in its direction."""
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    scene.collection.objects.link(sun)
    to_world = np.eye(4)
    to_world[:3, :3] = calibration.rotation * (1, -1, -1)  # Blender's cameras look along -z, with y upwards
    to_world[:3, 3] = calibration.place
    for each in (scene.camera, sun):
        each.matrix_world = Matrix(to_world)


def load_plate(model):
    """The mesh of the .obj of a plate, in the current scene, with the axes of the file."""
    with quiet(1):
        bpy.ops.wm.obj_import(filepath=str(model), forward_axis="Y", up_axis="Z")
    return bpy.context.object.data


def read_plate(model):
    """The Plate of an .obj whose printed side is at z = 0.

    Where four squares meet, each of the two materials fills half a turn around a vertex.
    """
    truth_scenes.empty_scene()
    mesh = load_plate(model)
    mesh.calc_loop_triangles()
    vertices, count = np.empty((len(mesh.vertices), 3), np.float32), len(mesh.loop_triangles)
    triangles, materials = np.empty((count, 3), np.int32), np.empty(count, np.int32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    mesh.loop_triangles.foreach_get("vertices", triangles.ravel())
    mesh.loop_triangles.foreach_get("material_index", materials)
    printed = np.all(vertices[triangles, 2] == 0, axis=1)
    triangles, materials = triangles[printed], materials[printed]
    turns_rad = np.zeros((len(vertices), 2))
    for turned in (np.roll(triangles, shift, axis=1) for shift in range(3)):
        sides = vertices[turned[:, 1:]] - vertices[turned[:, :1]]
        cosine = np.prod(sides / np.linalg.norm(sides, axis=2, keepdims=True), axis=1).sum(axis=1)
        np.add.at(turns_rad, (turned[:, 0], materials), np.arccos(cosine))
    corners = np.all(np.abs(turns_rad - np.pi) < STRAIGHT_RAD, axis=1)
    return Plate(vertices[corners].astype(float), vertices[np.unique(triangles)].astype(float))
