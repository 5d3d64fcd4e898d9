"""Settings of the scene that hold in a lens render as in Blender's own: clamps, exposure, motion blur, view layers."""

import bpy
import numpy as np
import pytest

from lensfield import addon
from lensfield.addon.job.job import job_from_settings
from lensfield.addon.scene.errors import SceneError
from lensfield.engine import ImageError, Options
from lensfield.engine.image.spectral_exr import read_exr, read_parts
from lensfield.engine.spectral.spectra import white_density
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from noise import assert_means
from small_scenes import WAVELENGTHS_NM, light, material, render, set_world, wall

TINT = 0.9, 0.5, 0.3
EDGES = 2e-3  # of the light is lost between the triangles of panes


def radiance(scene, folder, tier="standard", samples=16, **asked):
    scene.cycles.samples = samples
    result = render(scene, folder, spectral=SpectralOptions(tier), **asked)
    return read_exr(result.radiance).frame().cube.astype(np.float64)


def lens_image(result):
    planes = read_parts(result.lens_image)[0][1]
    return np.stack([planes[channel] for channel in "RGB"]).astype(np.float64)


def glowing_wall(scene, strength=8.0, colour=(1.0, 1.0, 1.0)):
    glow, emission = material("Glow", "ShaderNodeEmission", colour)
    emission.inputs["Strength"].default_value = strength
    return wall(scene, glow)


@pytest.mark.parametrize("tier", ["preview", "standard"])
@pytest.mark.parametrize("name, panes", [("sample_clamp_direct", 0), ("sample_clamp_indirect", 2)])
def test_a_grey_sample_is_clamped_as_in_cycles(scene, tmp_path, name, panes, tier):
    """A glowing wall of 8, seen at once or after two bounces, through panes that bend nothing."""
    scene.cycles.max_bounces = scene.cycles.transmission_bounces = 4
    glowing_wall(scene)
    for index in range(panes):
        glass, shader = material("Pane", "ShaderNodeBsdfRefraction", (1, 1, 1))
        shader.inputs["IOR"].default_value, shader.inputs["Roughness"].default_value = 1.0, 0.0
        wall(scene, glass, 0.3 + 0.2 * index)
    white = white_density(np.array(WAVELENGTHS_NM))
    assert_means(radiance(scene, tmp_path / "free", tier), 8.0 * white, EDGES)
    setattr(scene.cycles, name, 2.0)
    assert_means(radiance(scene, tmp_path / "clamped", tier), 2.0 * white, EDGES)


@pytest.mark.parametrize("tint", [(1.0, 0.5, 0.1), (0.1, 0.4, 1.0), (0.2, 0.9, 0.3)])
@pytest.mark.parametrize("tier", ["preview", "standard"])
def test_a_clamped_light_keeps_its_colour(scene, tmp_path, tint, tier):
    """Cycles cuts all of a sample by its mean of red, green and blue; so is each pass cut, of its three wavelengths."""
    set_world(scene, tint, 20.0)
    scene.cycles.sample_clamp_direct = 5.0
    result = render(scene, tmp_path, np.linspace(400, 700, 21), spectral=SpectralOptions(tier))
    seen = lens_image(result)[:, 18, 24]
    np.testing.assert_allclose(seen / seen.sum(), np.array(tint) / np.sum(tint), atol=0.03)
    assert seen.mean() == pytest.approx(5.0, rel=0.25)  # the means of three wavelengths and of three colours differ


@pytest.mark.parametrize("strength, free", [(6.0, True), (60.0, False)])
def test_a_line_that_shares_a_group_is_clamped_by_its_whole_light(scene, tmp_path, strength, free):
    """As denoising has it share: at its wavelength it is many times as bright as white of the same strength."""
    set_world(scene, strength=1e-3)
    glowing_wall(scene, strength)
    bpy.data.materials["Glow"].lensfield.emission = "sodium-lp"
    nm = np.linspace(400, 700, 21)
    whole = render(scene, tmp_path / "whole", nm, denoise=True)
    assert whole.report.scene.lamps == ["several spectra"]
    scene.cycles.sample_clamp_direct = 10.0
    clamped = render(scene, tmp_path / "clamped", nm, denoise=True)
    share = read_exr(clamped.radiance).cube.sum() / read_exr(whole.radiance).cube.sum()
    assert share == pytest.approx(1.0 if free else 10 / strength, rel=0.01 if free else 0.5)


def test_reference_goes_without_clamps_and_says_so(scene, tmp_path):
    glowing_wall(scene)
    scene.cycles.sample_clamp_direct = 2.0
    result = render(scene, tmp_path, spectral=SpectralOptions("reference"))
    assert_means(read_exr(result.radiance).cube, 8.0 * white_density(np.array(WAVELENGTHS_NM)))
    assert "Clamp Direct 2: left out in Reference" in result.report.remarks()


@pytest.mark.parametrize("tier", ["standard", "reference"])
def test_film_exposure_is_of_the_lens_image_alone(scene, tmp_path, tier):
    """As bright as Blender's own render; the spectra stay in their units."""
    glowing_wall(scene, 1.0, TINT)
    plain = render(scene, tmp_path / "plain", spectral=SpectralOptions(tier))
    scene.cycles.film_exposure = 2.5
    exposed = render(scene, tmp_path / "exposed", spectral=SpectralOptions(tier))
    np.testing.assert_allclose(lens_image(exposed), 2.5 * lens_image(plain), rtol=1e-6)
    for name in ("radiance", "irradiance"):
        assert np.array_equal(read_exr(getattr(exposed, name)).cube, read_exr(getattr(plain, name)).cube)


@pytest.mark.parametrize("denoise, scenes_own, tier, expected", [
    ("SCENE", True, "standard", True), ("SCENE", False, "standard", False), ("SCENE", True, "preview", True),
    ("SCENE", True, "reference", False), ("ON", False, "reference", True), ("OFF", True, "standard", False)])
def test_denoising_is_as_the_scene_says_but_in_reference(scene, denoise, scenes_own, tier, expected):
    scene.cycles.use_denoising, scene.lensfield.denoise = scenes_own, denoise
    assert job_from_settings(scene, spectral=SpectralOptions(tier)).denoise is expected


def test_the_scenes_denoising_takes_the_noise_away(scene, tmp_path):
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    light(scene, "AREA", 20.0, size=1.0).location.x = 2.0
    true = radiance(scene, tmp_path / "true", samples=1024)
    noisy = radiance(scene, tmp_path / "noisy", samples=2)
    scene.cycles.use_denoising = True
    smooth = radiance(scene, tmp_path / "smooth", samples=2)
    assert (smooth - true).std() < (noisy - true).std() / 2


@pytest.mark.parametrize("tier", ["standard", "reference"])
def test_what_moves_is_blurred_along_its_way(scene, tmp_path, tier):
    """A bar that moves by its own width while the shutter is open; in every pass."""
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 1.0
    scene.render.motion_blur_position = "CENTER"
    scene.cycles.max_bounces = 0
    bar = glowing_wall(scene, 1.0, TINT)
    bar.scale.x = 0.01
    for frame, x in ((0, -0.1), (2, 0.1)):
        bar.location.x = x
        bar.keyframe_insert("location", frame=frame)
    moving = radiance(scene, tmp_path / "moving", tier, 256, frame=1)
    scene.render.use_motion_blur = False
    still = radiance(scene, tmp_path / "still", tier, frame=1)
    across = still.shape[2]
    assert_means(moving.sum(axis=2, keepdims=True), still.sum(axis=2, keepdims=True).mean(axis=(1, 2)), noise=0.02,
                 rtol=0.01)
    for blurred, sharp in zip(moving, still, strict=True):
        lit = (sharp[across // 4] > 0).sum()
        assert (blurred[across // 4] > 0).sum() > 1.5 * lit and blurred.max() <= 1.01 * sharp.max()


def set_region(scene, left, right, bottom, top):
    render = scene.render
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = left, right, bottom, top


REGION = slice(9, 27), slice(24, 48)  # of 36 rows and 48 columns: the right half of the middle


@pytest.mark.parametrize("lens", ["edmund-54852", "muller-fisheye-25mm", "nikkor-28mm"])
def test_the_render_region_is_as_in_the_whole_picture_and_the_rest_black(scene, tmp_path, lens):
    """Even at its rim, to where distortion and blur bring light from outside; and no more is captured than that."""
    glowing_wall(scene, 1.0, TINT).location.z = -0.5
    asked = dict(lens=lens, wavelengths_nm=WAVELENGTHS_NM, options=Options(accuracy=0.001))
    whole = addon.render_through_lens(scene, output_folder=tmp_path / "whole", **asked)
    set_region(scene, 0.5, 1.0, 0.25, 0.75)
    part = addon.render_through_lens(scene, output_folder=tmp_path / "part", **asked)
    again = addon.apply_lens(part.radiance, lens, tmp_path / "again", options=asked["options"])
    expected = lens_image(whole)
    for result in (part, again):
        picture = lens_image(result)
        np.testing.assert_allclose(picture[:, *REGION], expected[:, *REGION], rtol=2e-3)
        alpha = read_parts(result.lens_image)[0][1]["A"]
        assert np.all(alpha[REGION] == 1) and alpha.sum() == alpha[REGION].size
        picture[:, *REGION] = 0
        assert not picture.any()
    assert read_exr(part.radiance).cube.any(axis=0).mean() < 0.9 * read_exr(whole.radiance).cube.any(axis=0).mean()


def test_a_lens_that_reaches_beyond_what_was_captured_of_a_region_is_refused(scene, tmp_path):
    glowing_wall(scene)
    set_region(scene, 0.4, 0.6, 0.4, 0.6)
    part = addon.render_through_lens(scene, "tessar-50mm", WAVELENGTHS_NM, tmp_path, room=0.4)
    addon.apply_lens(part.radiance, "muller-fisheye-25mm", tmp_path / "roomy", view="camera")
    part = addon.render_through_lens(scene, "tessar-50mm", WAVELENGTHS_NM, tmp_path)
    with pytest.raises(ImageError, match="render region is .* draws in more from around it"):
        addon.apply_lens(part.radiance, "muller-fisheye-25mm", tmp_path / "again", view="camera")


def test_an_empty_render_region_is_refused(scene, tmp_path):
    set_region(scene, 0.5, 0.5, 0.0, 1.0)
    with pytest.raises(SceneError, match="render region is empty: draw one"):
        radiance(scene, tmp_path)


@pytest.fixture
def two_layers(scene):
    """One that sees a wall, and one that does not."""
    scene.collection.children.link(bpy.data.collections.new("Walls"))
    glowing_wall(scene, 1.0)
    obj = scene.objects["Wall"]
    scene.collection.objects.unlink(obj)
    bpy.data.collections["Walls"].objects.link(obj)
    scene.view_layers[0].name = "Whole"
    scene.view_layers.new("Empty").layer_collection.children["Walls"].exclude = True
    return scene


@pytest.mark.parametrize("name, lit", [("Whole", True), ("Empty", False)])
def test_the_view_layer_asked_for_is_rendered(two_layers, tmp_path, name, lit):
    two_layers.view_layers["Empty"].use = False
    assert bool(radiance(two_layers, tmp_path, view_layer=name).any()) is lit
    two_layers.lensfield.view_layer = name
    assert bool(radiance(two_layers, tmp_path).any()) is lit
    assert [layer.use for layer in two_layers.view_layers] == [True, False]


def test_of_several_view_layers_one_is_to_be_chosen(two_layers, tmp_path):
    with pytest.raises(SceneError, match="view layers for rendering is Whole, Empty: choose one"):
        radiance(two_layers, tmp_path)
    with pytest.raises(SceneError, match="view layer is Third: expected Whole or Empty"):
        radiance(two_layers, tmp_path, view_layer="Third")
