"""A transparent film: alpha passes through the lens like light; depth is placed the same way, without mixing."""

import json

import bpy
import numpy as np
import pytest

from lensfield.engine.pictures.spectral_exr import read_exr, read_parts
from lensfield.engine.spectral.colour import REC709_LUMINANCE
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions
from small_scenes import material, render, set_world, wall

GREY = 0.5
COLOUR = (0.9, 0.5, 0.1)


@pytest.fixture
def glowing(scene):
    """A scene with a small glowing square in front of a grey world, off the axis."""
    set_world(scene, strength=GREY)
    lit, shader = material("Glow", "ShaderNodeEmission")
    shader.inputs["Strength"].default_value = 2.0
    square = wall(scene, lit, side_m=0.3)
    square.location.x, square.location.y = 0.1, 0.05
    return scene


def planes(path):
    return read_parts(path)[0][1]


def luminance(path):
    return sum(weight * planes(path)[name] for weight, name in zip(REC709_LUMINANCE, "RGB", strict=True))


def film_over_grey(scene, folder, wavelengths_nm):
    """Luminances of the film over the world's grey, with the lens's vignetting, and of the opaque render."""
    opaque = render(scene, folder / "opaque", wavelengths_nm, stray=StrayOptions("off"))
    scene.render.film_transparent = True
    film = render(scene, folder / "film", wavelengths_nm, stray=StrayOptions("off"))
    alpha, shade = planes(film.lens_image)["A"], planes(film.relative_illumination)["Y"]
    backdrop = luminance(opaque.lens_image)[4, 4] / shade[4, 4]  # Blender's grey, at these wavelengths
    return luminance(film.lens_image) + (1 - alpha) * backdrop * shade, luminance(opaque.lens_image), alpha


@pytest.mark.every_blender
def test_the_film_over_grey_equals_the_opaque_render(glowing, tmp_path):
    """Exactly at one wavelength, edges included, except for the blur's share of the relative illumination, which is the
    largest in the corners, by coma."""
    composite, expected, alpha = film_over_grey(glowing, tmp_path, [550.0])
    assert alpha.min() == 0 and alpha.max() > 0.99 and np.any((alpha > 0.2) & (alpha < 0.8))
    np.testing.assert_allclose(composite, expected, rtol=0.015)


def test_the_film_over_grey_equals_the_opaque_render_in_colour(glowing, tmp_path):
    """All colours have the same alpha: at an edge its error is the lens's colour fringe."""
    composite, expected, _ = film_over_grey(glowing, tmp_path, np.linspace(420, 680, 9))
    assert np.abs(composite - expected).max() < 0.1 * GREY
    assert np.abs((composite - expected).mean()) < 0.003 * GREY


def test_full_coverage_has_an_alpha_of_one_up_to_the_corners(scene, tmp_path):
    wall(scene, material("Glow", "ShaderNodeEmission")[0])
    scene.render.film_transparent = True
    np.testing.assert_allclose(planes(render(scene, tmp_path).lens_image)["A"], 1, atol=1e-4)


def test_an_opaque_film_has_an_opaque_lens_image(glowing, tmp_path):
    result = render(glowing, tmp_path)
    assert np.all(planes(result.lens_image)["A"] == 1)
    assert "A" not in planes(result.radiance)


def test_a_holdout_opens_an_opaque_film(glowing, tmp_path):
    """As in Blender: the hole is in the alpha, at its place through the lens."""
    hole = bpy.data.materials.new("Hole")
    hole.use_nodes = True
    nodes = hole.node_tree.nodes
    hole.node_tree.links.new(nodes.new("ShaderNodeHoldout").outputs[0], nodes["Material Output"].inputs["Surface"])
    square = bpy.data.objects["Wall"]
    square.data.materials[0] = hole
    result = render(glowing, tmp_path / "held")
    square.data.materials[0] = bpy.data.materials["Glow"]
    glowing.render.film_transparent = True
    covered = planes(render(glowing, tmp_path / "film").lens_image)["A"]
    assert covered.max() > 0.99
    np.testing.assert_allclose(planes(result.lens_image)["A"], 1 - covered, atol=0.02)


def test_the_world_behind_a_transparent_film_is_not_in_the_picture(scene, tmp_path):
    set_world(scene)
    scene.render.film_transparent = True
    result = render(scene, tmp_path)
    assert not read_exr(result.radiance).cube.any() and not planes(result.lens_image)["A"].any()


def test_radiance_keeps_alpha_and_depth(glowing, tmp_path):
    glowing.render.film_transparent = True
    channels = planes(render(glowing, tmp_path).radiance)
    assert set(np.unique(channels["Z"].round(3))) == {1.0, np.float32(1e10)}
    assert np.all(channels["A"][channels["Z"] > 1e9] < 1) and channels["A"].max() == 1


@pytest.mark.every_blender
def test_depth_is_planar_and_unmixed(glowing, tmp_path):
    depth = planes(render(glowing, tmp_path).depth)["Y"]
    near = depth < 1e9
    assert near.any() and np.all(depth[~near] == np.float32(1e10))
    np.testing.assert_allclose(depth[near], 1.0, rtol=1e-5)


def test_depth_is_aligned_with_the_picture(scene, tmp_path):
    """A wall in the upper left, off the centre: pixels that glow are near."""
    glow = wall(scene, material("Glow", "ShaderNodeEmission")[0], side_m=0.1)
    glow.location.x, glow.location.y = -0.12, 0.07
    result = render(scene, tmp_path)
    near, light = planes(result.depth)["Y"] < 1e9, planes(result.lens_image)["G"]
    lit = light > 0.5 * light.max()
    rows, columns = (np.flatnonzero(near.any(axis=axis)) for axis in (1, 0))
    assert near.shape == (36, 48) and rows.max() < 18 and columns.max() < 24 and rows.size != columns.size - 3
    rim = 2 * (rows.size + columns.size)
    assert np.count_nonzero(near != lit) < rim < near.sum()


def test_the_report_names_the_files(glowing, tmp_path):
    result = render(glowing, tmp_path)
    result.report.write(tmp_path / "report.json")
    named = json.loads((tmp_path / "report.json").read_text())["files"]
    assert set(named.values()) == {str(path) for path in result.files} and all(path.is_file() for path in result.files)
    assert named["stmap_distort"] == str(tmp_path / "unsaved_Scene_stmap_distort.exr")
    assert bpy.path.basename(named["depth"]) == "unsaved_Scene_0001_depth.exr"


def test_the_alpha_of_coloured_glass_is_that_of_all_passes(scene, tmp_path):
    """Cycles' alpha is the mean of red, green and blue; the passes have others, here 0.46 and 0.54."""
    glass, shader = material("Glass", "ShaderNodeBsdfTransparent", COLOUR)
    wall(scene, glass)
    scene.render.film_transparent = True
    result = render(scene, tmp_path, np.linspace(420, 680, 14), spectral=SpectralOptions("standard"))
    assert result.report.scene.passes > 1
    np.testing.assert_allclose(planes(result.lens_image)["A"], 1 - np.mean(COLOUR), atol=0.015)
