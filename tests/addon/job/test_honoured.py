"""Scene settings that affect a lens render like Blender's own: clamps, exposure, motion blur, view layers."""

import bpy
import numpy as np
import pytest

from cycles_pictures import picture
from lenses import make_lens
from lensfield import addon
from lensfield.addon.job.job import job_of
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.fingerprint import action_curves
from lensfield.engine import ImageError, Options
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts
from lensfield.engine.spectral.spectra import white_density
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions
from noise import assert_means, surely_apart
from refusals import refused
from small_scenes import WAVELENGTHS_NM, keyframe_world, light, material, render, set_region, set_world, wall

TINT = 0.9, 0.5, 0.3
HALF_STEP = 2.0**-10  # relative difference of two numbers that were rounded to half precision
EDGES = 2e-3  # share of light lost between the triangles of panes
CAUSTIC_NOISE = 0.1  # of its mean, at 256 samples; Filter Glossy removes 27 % of it


def radiance(scene, folder, tier="standard", samples=16, **options):
    scene.cycles.samples = samples
    result = render(scene, folder, spectral=SpectralOptions(tier), depth="off", **options)
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
    """A glowing wall of strength 8, visible directly or after two bounces, through panes that do not refract."""
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


@pytest.mark.sample(2)
@pytest.mark.parametrize("tint", [(1.0, 0.5, 0.1), (0.1, 0.4, 1.0), (0.2, 0.9, 0.3)])
@pytest.mark.parametrize("tier", ["preview", "standard"])
def test_a_clamped_light_keeps_its_colour(scene, tmp_path, tint, tier):
    """Cycles clamps a sample by its mean of red, green and blue, and in each pass by the mean of its three wavelengths.
    """
    set_world(scene, tint, 20.0)
    scene.cycles.sample_clamp_direct = 5.0
    result = render(scene, tmp_path, np.linspace(400, 700, 21), spectral=SpectralOptions(tier), coating="ideal",
                    stray=StrayOptions("off"))
    pixel = lens_image(result)[:, 18, 24]
    np.testing.assert_allclose(pixel / pixel.sum(), np.array(tint) / np.sum(tint), atol=0.03)
    assert pixel.mean() == pytest.approx(5.0, rel=0.25)  # the means of three wavelengths and of three colours differ


@pytest.mark.parametrize("strength, free", [(6.0, True), (60.0, False)])
def test_a_spectral_line_in_a_shared_group_is_clamped_by_its_total_light(scene, tmp_path, strength, free):
    """With denoising, it shares a group: at its wavelength it is many times as bright as white of the same strength."""
    set_world(scene, strength=1e-3)
    glowing_wall(scene, strength)
    bpy.data.materials["Glow"].lensfield.emission = "sodium-lp"
    nm = np.linspace(400, 700, 21)
    unclamped = render(scene, tmp_path / "whole", nm, denoise="on")
    assert unclamped.report.scene.lamps == ["several spectra"]
    scene.cycles.sample_clamp_direct = 10.0
    clamped = render(scene, tmp_path / "clamped", nm, denoise="on")
    share = read_exr(clamped.radiance).cube.sum() / read_exr(unclamped.radiance).cube.sum()
    assert share == pytest.approx(1.0 if free else 10 / strength, rel=0.01 if free else 0.5)


def mirrored_lamp(scene):
    """A grey wall with light from a small lamp reflected by a polished floor: a caustic."""
    scene.cycles.max_bounces = 4
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.7, 0.7))[0], distance_m=1.2)
    polished, shader = material("Polished", "ShaderNodeBsdfAnisotropic", (0.9, 0.9, 0.9))
    shader.inputs["Roughness"].default_value = 0.3
    floor = wall(scene, polished)
    floor.location, floor.rotation_euler.x = (0.1, -0.25, -1.0), -np.pi / 2
    lamp = light(scene, "SPOT", 20.0, shadow_soft_size=0.1, spot_size=0.5)
    lamp.location, lamp.rotation_euler = (-0.1, 0.3, -0.5), (-0.7, 0.1, 0.0)


def test_filter_glossy_works_as_in_cycles(scene, tmp_path):
    """In a grey scene, through a lens without distortion: as bright as Cycles' own render, filtered or not."""
    pictures = {}
    for glossy in (0.0, 10.0):
        for left_over in [each for each in scene.collection.objects if each.type != "CAMERA"]:
            bpy.data.objects.remove(left_over)
        mirrored_lamp(scene)
        scene.cycles.samples = 256
        scene.cycles.blur_glossy = glossy
        scene.render.resolution_x, scene.render.resolution_y = 32, 24
        result = addon.render_through_lens(scene, lens=make_lens(), wavelengths_nm=[550.0], output_folder=tmp_path,
                                           view="camera", spectral=SpectralOptions("reference"))
        pictures[glossy] = read_exr(result.radiance).frame().cube[0] / white_density(550.0)
        reference = picture(scene, tmp_path, scene.cycles.samples, 32, 24)
        assert_means(pictures[glossy], reference.mean(axis=0), noise=CAUSTIC_NOISE)
    assert surely_apart(pictures[0.0], pictures[10.0]) > CAUSTIC_NOISE * pictures[10.0].mean()


def test_reference_ignores_clamps_and_says_so(scene, tmp_path):
    glowing_wall(scene)
    scene.cycles.sample_clamp_direct = 2.0
    result = render(scene, tmp_path, spectral=SpectralOptions("reference"))
    assert_means(read_exr(result.radiance).cube, 8.0 * white_density(np.array(WAVELENGTHS_NM)))
    assert "Clamp Direct 2: ignored in Reference" in result.report.remarks()


@pytest.mark.parametrize("tier", ["standard", "reference"])
def test_film_exposure_affects_only_the_lens_image(scene, tmp_path, tier):
    """As bright as Blender's own render; the spectra stay in their units."""
    glowing_wall(scene, 1.0, TINT)
    default = render(scene, tmp_path / "plain", spectral=SpectralOptions(tier))
    scene.cycles.film_exposure = 2.5
    exposed = render(scene, tmp_path / "exposed", spectral=SpectralOptions(tier))
    np.testing.assert_allclose(lens_image(exposed), 2.5 * lens_image(default), rtol=HALF_STEP)
    for name in ("radiance", "irradiance"):
        assert np.array_equal(read_exr(getattr(exposed, name)).cube, read_exr(getattr(default, name)).cube)


@pytest.mark.parametrize("denoise, use_denoising, tier, expected", [
    ("SCENE", True, "standard", True), ("SCENE", False, "standard", False), ("SCENE", True, "preview", True),
    ("SCENE", True, "reference", False), ("ON", False, "reference", True), ("OFF", True, "standard", False)])
def test_denoising_follows_the_scene_except_in_reference(scene, denoise, use_denoising, tier, expected):
    scene.cycles.use_denoising, scene.lensfield.denoise = use_denoising, denoise
    assert job_of(scene, spectral=SpectralOptions(tier), lens_quality="preview").denoises is expected


def test_denoising_of_the_scene_removes_noise(scene, tmp_path):
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    light(scene, "AREA", 20.0, size=1.0).location.x = 2.0
    true = radiance(scene, tmp_path / "true", samples=1024)
    noisy = radiance(scene, tmp_path / "noisy", samples=2)
    scene.cycles.use_denoising = True
    smooth = radiance(scene, tmp_path / "smooth", samples=2)
    assert (smooth - true).std() < (noisy - true).std() / 2


@pytest.mark.every_blender
@pytest.mark.parametrize("tier", ["standard", "reference"])
def test_moving_objects_are_blurred_along_their_path(scene, tmp_path, tier):
    """A bar that moves by its own width while the shutter is open, in every pass."""
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
    static = radiance(scene, tmp_path / "still", tier, frame=1)
    across = static.shape[2]
    assert_means(moving.sum(axis=2, keepdims=True), static.sum(axis=2, keepdims=True).mean(axis=(1, 2)), noise=0.02,
                 rtol=0.01)
    for blurred, sharp in zip(moving, static, strict=True):
        lit = (sharp[across // 4] > 0).sum()
        assert (blurred[across // 4] > 0).sum() > 1.5 * lit and blurred.max() <= 1.01 * sharp.max()


def test_a_frame_between_two_is_rendered_as_in_blender(scene, tmp_path):
    """The scene's own place in time; a given frame is a whole one."""
    keyframe_world(scene, 3, 4)
    for curve in action_curves(scene.world.node_tree.animation_data.action):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    scene.frame_set(3, subframe=0.5)
    between, whole = (radiance(scene, tmp_path / str(index), **given).mean() for index, given in enumerate(
            ({}, {"frame": 3})))
    assert between / whole == pytest.approx(3.5 / 3, rel=1e-3)
    assert (scene.frame_current, scene.frame_subframe) == (3, 0.5)


def test_what_the_stand_in_camera_hides_is_reported(scene, tmp_path):
    """A zoom while the shutter is open, and the camera that geometry nodes read."""
    set_world(scene)
    tree = bpy.data.node_groups.new("Reader", "GeometryNodeTree")
    tree.nodes.new("GeometryNodeCameraInfo")
    reader = glowing_wall(scene, 1.0, TINT)
    reader.modifiers.new("Reader", "NODES").node_group = tree
    for frame, focal_mm in ((1, 30.0), (2, 60.0)):
        scene.camera.data.lens = focal_mm
        scene.camera.data.keyframe_insert("lens", frame=frame)

    def remarks(name):
        return [line for line in render(scene, tmp_path / name, frame=1).report.scene.scene_remarks
                if line.startswith(("Motion Blur", "Camera Info"))]

    line, = remarks("unblurred")
    assert line.startswith(f"Camera Info: the geometry nodes of {reader.name}")
    scene.render.use_motion_blur = True
    assert [line.split(":")[0] for line in remarks("moving")] == ["Motion Blur", "Camera Info"]


REGION = slice(6, 24), slice(8, 36)  # of 36 rows and 48 columns: not centred in either direction
BORDER = dict(left=8.5 / 48, right=36.5 / 48, bottom=12.5 / 36, top=30.5 / 36)  # Blender rounds the halves down


@pytest.mark.sample(1)
@pytest.mark.parametrize("lens", ["edmund-54852", "muller-fisheye-25mm", "nikkor-28mm"])
def test_the_render_region_equals_the_full_picture_and_the_rest_is_black(scene, tmp_path, lens):
    """Including its rim, where distortion and blur add light from outside; and no larger area is captured."""
    glowing_wall(scene, 1.0, TINT).location.z = -0.5
    arguments = dict(lens=lens, wavelengths_nm=WAVELENGTHS_NM, options=Options(accuracy=0.001), lens_quality="preview",
                     stray=StrayOptions("off"))
    full = addon.render_through_lens(scene, output_folder=tmp_path / "whole", **arguments)
    set_region(scene, **BORDER)
    part = addon.render_through_lens(scene, output_folder=tmp_path / "part", **arguments)
    again = addon.apply_lens(part.radiance, lens=lens, output_folder=tmp_path / "again", options=arguments["options"],
                             lens_quality="preview", stray=arguments["stray"])
    expected = lens_image(full)
    for result in (part, again):
        picture = lens_image(result)
        np.testing.assert_allclose(picture[:, *REGION], expected[:, *REGION], rtol=2e-3)
        alpha = read_parts(result.lens_image)[0][1]["A"]
        assert np.all(alpha[REGION] == 1) and alpha.sum() == alpha[REGION].size
        picture[:, *REGION] = 0
        assert not picture.any()
    assert read_exr(part.radiance).cube.any(axis=0).mean() < 0.9 * read_exr(full.radiance).cube.any(axis=0).mean()


def slanting_light(scene):
    """A wall whose light grows to the right, and half as much upwards: by a third over a tenth of a radian."""
    glowing = glowing_wall(scene)
    glowing.location.z = -0.5
    nodes, links = (getattr(glowing.data.materials[0].node_tree, name) for name in ("nodes", "links"))
    place, along, grade = (nodes.new(f"ShaderNode{kind}") for kind in ("NewGeometry", "VectorMath", "MapRange"))
    along.operation, along.inputs[1].default_value = "DOT_PRODUCT", (1.0, 0.5, 0.0)
    for name, value in zip(("From Min", "From Max", "To Min", "To Max"), (-0.3, 0.3, 1.0, 3.0), strict=True):
        grade.inputs[name].default_value = value
    emission = next(node for node in nodes if node.bl_idname == "ShaderNodeEmission")
    for source, target in ((place.outputs["Position"], along.inputs[0]), (along.outputs["Value"], grade.inputs[0]),
                           (grade.outputs[0], emission.inputs["Strength"])):
        links.new(source, target)


@pytest.mark.every_blender
@pytest.mark.parametrize("lens", ["edmund-54852", pytest.param("nikkor-28mm", marks=pytest.mark.one_blender)])
def test_the_render_region_shows_the_right_part_of_the_scene(scene, tmp_path, lens):
    """The region is neither mirrored nor moved, in an asymmetric scene, and only its surroundings are captured.

    The tolerance is 5 sigma of the positions of 16 samples in a pixel, in both pictures, where light changes by 1/20
    from pixel to pixel: 5 sqrt(2) 0.29 / sqrt(16) / 20 = 2.6 %.
    """
    slanting_light(scene)
    arguments = dict(lens=lens, wavelengths_nm=[550.0], options=Options(accuracy=0.001), lens_quality="preview",
                     stray=StrayOptions("off"))
    full = addon.render_through_lens(scene, output_folder=tmp_path / "whole", **arguments)
    set_region(scene, **BORDER)
    part = addon.render_through_lens(scene, output_folder=tmp_path / "part", **arguments)
    expected, cropped = (lens_image(result)[:, *REGION] for result in (full, part))
    assert all(np.abs(np.flip(expected, axis) / expected - 1).max() > 0.1 for axis in (1, 2))
    np.testing.assert_allclose(cropped, expected, rtol=0.026)
    radiance = read_exr(part.radiance)
    lit = radiance.cube.any(axis=0)
    margins = set()
    for axis, side, overscan in zip((1, 0), REGION, radiance.overscan_px, strict=True):
        captured = np.flatnonzero(lit.any(axis=axis))
        margins |= {side.start + overscan - captured[0], captured[-1] + 1 - side.stop - overscan}
    assert len(margins) == 1 and margins.pop() > 0


def test_a_lens_that_needs_more_than_the_captured_region_is_refused(scene, tmp_path):
    glowing_wall(scene)
    set_region(scene, 0.4, 0.6, 0.4, 0.6)
    rest = {"wavelengths_nm": WAVELENGTHS_NM, "output_folder": tmp_path, "lens_quality": "preview"}
    fisheye = {"lens": "muller-fisheye-25mm", "view": "camera", "lens_quality": "preview"}
    part = addon.render_through_lens(scene, lens="tessar-50mm", room=0.4, **rest)
    addon.apply_lens(part.radiance, output_folder=tmp_path / "roomy", **fisheye)
    part = addon.render_through_lens(scene, lens="tessar-50mm", **rest)
    with pytest.raises(ImageError, match="render region is .* needs more light from around it"):
        addon.apply_lens(part.radiance, output_folder=tmp_path / "again", **fisheye)


def test_an_empty_render_region_is_refused(scene, tmp_path):
    set_region(scene, 0.5, 0.5, 0.0, 1.0)
    with pytest.raises(SceneError, match="render region is empty: draw one"):
        radiance(scene, tmp_path)


@pytest.fixture
def two_layers(scene):
    """A view layer with a wall, and one without it."""
    scene.collection.children.link(bpy.data.collections.new("Walls"))
    glowing_wall(scene, 1.0)
    obj = scene.objects["Wall"]
    scene.collection.objects.unlink(obj)
    bpy.data.collections["Walls"].objects.link(obj)
    scene.view_layers[0].name = "Whole"
    scene.view_layers.new("Empty").layer_collection.children["Walls"].exclude = True
    return scene


@pytest.mark.every_blender
@pytest.mark.parametrize("name, lit", [("Whole", True), ("Empty", False)])
def test_the_selected_view_layer_is_rendered(two_layers, tmp_path, name, lit):
    two_layers.view_layers["Empty"].use = False
    assert bool(radiance(two_layers, tmp_path, view_layer=name).any()) is lit
    two_layers.lensfield.view_layer = name
    assert bool(radiance(two_layers, tmp_path).any()) is lit
    assert [layer.use for layer in two_layers.view_layers] == [True, False]


def test_several_view_layers_require_a_choice(two_layers, tmp_path):
    with refused(SceneError, field="view layers for rendering", value="Whole, Empty", where="scene 'Scene'"):
        radiance(two_layers, tmp_path)
    with pytest.raises(SceneError, match="view layer is Third: expected Whole or Empty"):
        radiance(two_layers, tmp_path, view_layer="Third")
