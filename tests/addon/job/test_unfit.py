"""Shaders that Cycles always renders in red, green and blue have their own colours in every tier."""

import bpy
import numpy as np
import pytest

from cycles_pictures import picture
from lenses import make_lens
from lensfield import addon
from lensfield.addon.scene.camera import capture_grid, set_up_capture
from lensfield.addon.scene.undo import Journal
from lensfield.engine.pictures.preview import to_rec709
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.colour import XYZ_TO_REC709
from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from small_scenes import material, set_world, wall

LENS = make_lens(wavelengths_nm=(380.0, 780.0), sensor_mm=(3.6, 3.6))
NM = np.linspace(400, 700, 21)
WHITE = np.linalg.inv(XYZ_TO_REC709) @ np.ones(3)
TIERS = {"preview": 4.0, "standard": 1.0, "reference": 1.0}
"""CIEDE2000: the primaries have an error of 0.8 upsampled, and of 3.7 with three wavelengths as they are."""
ROUNDING = 1e-5


@pytest.fixture
def bubble(scene):
    """A wall with a thin film on it, under a white sky."""
    set_world(scene)
    film = bpy.data.materials.new("Film")
    film.use_nodes = True
    shader = film.node_tree.nodes["Principled BSDF"]
    for name, value in {"Base Color": (0, 0, 0, 1), "Roughness": 0.0, "IOR": 3.0, "Thin Film IOR": 1.8}.items():
        shader.inputs[name].default_value = value
    wall(scene, film)
    scene.render.resolution_x, scene.render.resolution_y = 12, 12
    frame = capture_grid(scene, LENS, NM).frame()  # colours depend on the angle
    set_up_capture(scene.camera.data, LENS, frame, Journal())
    return scene, shader.inputs


def lensfield_colour(scene, folder, tier):
    result = addon.render_through_lens(scene, lens=LENS, wavelengths_nm=NM, output_folder=folder, unfit="render",
                                       spectral=SpectralOptions(tier), depth="off")
    return to_rec709(read_exr(result.radiance).frame()).mean(axis=(0, 1), dtype=float), result.report.as_dict()


def difference(colour, other):
    """CIEDE2000 relative to a white twice as bright as the brightest channel of the other picture."""
    scale = 0.5 / max(other)
    xyz = (np.maximum(np.linalg.inv(XYZ_TO_REC709) @ (value * scale), 0)[None] for value in (colour, other))
    return float(ciede2000(*(lab_from_xyz(value, WHITE) for value in xyz))[0])


@pytest.mark.sample(4)
@pytest.mark.parametrize("tier", TIERS)
@pytest.mark.parametrize("thickness_nm", [100.0, 200.0, 330.0, 450.0])
def test_thin_film_has_the_colours_of_cycles(bubble, tmp_path, tier, thickness_nm):
    scene, inputs = bubble
    inputs["Thin Film Thickness"].default_value = thickness_nm
    colour, facts = lensfield_colour(scene, tmp_path, tier)
    expected = picture(scene, tmp_path).mean(axis=(1, 2), dtype=float)
    assert np.ptp(expected) > 0.7 * max(expected)  # blue, orange, yellow, green; otherwise the test would prove nothing
    assert difference(colour, expected) < TIERS[tier]
    assert facts["wavelengths_per_pass"] == (3 if tier == "preview" else 1)


@pytest.mark.parametrize("tier", TIERS)
def test_grey_stays_grey_in_a_scene_with_unfit_shaders(bubble, tmp_path, tier):
    scene, inputs = bubble
    inputs["Thin Film Thickness"].default_value = 400.0
    wall(scene, material("Grey", "ShaderNodeBsdfDiffuse", (0.4, 0.4, 0.4))[0], 0.5)
    colour, _ = lensfield_colour(scene, tmp_path, tier)
    np.testing.assert_allclose(colour, colour.mean(), rtol=ROUNDING)
    np.testing.assert_allclose(colour, 0.4, rtol=2e-3)


@pytest.mark.every_blender
def test_other_materials_keep_their_spectra_in_a_scene_with_unfit_shaders(bubble, tmp_path):
    """Substituted materials have the same value in all three channels, so mixing the channels changes nothing."""
    scene, inputs = bubble
    painted, _ = material("Paint", "ShaderNodeBsdfDiffuse")
    painted.lensfield.reflectance = "chart-15-red"
    wall(scene, painted, 0.5)
    alone = cube(scene, tmp_path)
    inputs["Thin Film Thickness"].default_value = 400.0
    np.testing.assert_allclose(cube(scene, tmp_path), alone, rtol=ROUNDING)


def cube(scene, folder):
    result = addon.render_through_lens(scene, lens=LENS, wavelengths_nm=NM[::4], output_folder=folder, unfit="render",
                                       spectral=SpectralOptions("reference"), depth="off")
    return read_exr(result.radiance).cube
