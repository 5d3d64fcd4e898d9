"""The Cornell box by Lensfield: a Blender scene of it, and its spectral radiance through the add-on's public call."""

import bpy
import numpy as np
from scipy.integrate import trapezoid

import cornell_box as box
from lensfield import addon
from lensfield.commands.terminal import quiet
from lensfield.engine.lens import RadialLens
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.spectra import BAND_NM
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

MOST_BOUNCES = 1024  # Cycles's maximum; in effect, paths end only by Russian roulette
METRE_PER_MM = 1e-3


def build(side_px, samples):
    """A new scene with the box, lit by a mesh lamp; the measured spectra are assigned to its materials.

    Returns
    -------
    bpy.types.Scene
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = side_px
    scene.cycles.samples = samples
    scene.cycles.use_adaptive_sampling = False
    for paths in ("max", "diffuse"):
        setattr(scene.cycles, f"{paths}_bounces", MOST_BOUNCES)
    _add_camera(scene)
    for name, triangles_mm in box.triangles_mm().items():
        _add_mesh(scene, name, triangles_mm * METRE_PER_MM)
    return scene


def render(scene, wavelengths_nm, folder, seed=0):
    """Spectral radiance of the frame: float32 array (wavelength, row, column), W m^-2 sr^-1 nm^-1."""
    scene.cycles.seed = seed
    every_wavelength = SpectralOptions(tier="reference")
    with quiet(1):  # suppresses Blender's messages about saved passes
        result = addon.render_through_lens(scene, lens=pinhole(), wavelengths_nm=wavelengths_nm, output_folder=folder,
                                           spectral=every_wavelength, depth="off")
    return read_exr(result.radiance).frame().cube


def pinhole():
    """A lens with the view of the box's camera, without blur and distortion."""
    wavelengths_nm, heights_mm = BAND_NM, (0.0, box.SENSOR_MM / 2, box.SENSOR_MM)
    table = np.ones((len(wavelengths_nm), len(heights_mm)))
    return RadialLens(name="Cornell box camera", efl_mm=box.FOCAL_LENGTH_MM, magnification=0, f_number_effective=8,
                      object_distance_mm=np.inf, entrance_pupil_mm=0, sensor_mm=(box.SENSOR_MM, box.SENSOR_MM),
                      reference_wavelength_nm=550, wavelengths_nm=wavelengths_nm, heights_mm=heights_mm,
                      real_height_mm=table * heights_mm, relative_illumination=table, psf=table[..., None, None],
                      psf_pitch_um=1, enclosed_energy=table, transmittance=table[:, 0])


def _add_camera(scene):
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.clip_start = METRE_PER_MM
    camera.location = np.multiply(box.CAMERA_MM, METRE_PER_MM)
    camera.rotation_euler = 0, np.pi, 0  # from Blender's -z to the box's +z, with +y still up
    scene.collection.objects.link(camera)
    scene.camera = camera


def _add_mesh(scene, name, triangles_m):
    mesh = bpy.data.meshes.new(name)
    corners = np.arange(3 * len(triangles_m)).reshape(-1, 3)
    mesh.from_pydata(triangles_m.reshape(-1, 3).tolist(), [], corners.tolist())
    mesh.materials.append(_material(name))
    scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def _material(name):
    """A diffuse material; the lamp's also emits, with the radiance summed over all wavelengths as strength."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    surface = tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0]
    material.lensfield.reflectance = _pairs(box.REFLECTANCE_NM, box.REFLECTANCE[name])
    if name == "lamp":
        emission, both = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeAddShader")
        emission.inputs["Strength"].default_value = trapezoid(box.LAMP_RADIANCE, box.LAMP_NM)
        tree.links.new(surface, both.inputs[0])
        tree.links.new(emission.outputs[0], both.inputs[1])
        surface = both.outputs[0]
        material.lensfield.emission = _pairs(box.LAMP_NM, box.LAMP_RADIANCE)
    tree.links.new(surface, tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def _pairs(wavelengths_nm, values):
    return ", ".join(f"{nm:g}:{value:g}" for nm, value in zip(wavelengths_nm, values, strict=True))
