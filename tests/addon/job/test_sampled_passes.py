"""Passes with few samples, for which another pass is the control variate."""

from types import SimpleNamespace

import bmesh
import bpy
import numpy as np
import pytest

from lensfield.addon.capture import radiance, sampled_passes
from lensfield.addon.capture.light import GatheredLight
from lensfield.addon.render.refilter import apply_lens
from lensfield.addon.render.render import render_through_lens
from lensfield.engine import Options
from lensfield.engine.image.supersampling import split_pixels
from lensfield.engine.pictures.spectral_exr import read_exr, read_with_layers, read_with_planes
from lensfield.engine.spectral.control_variate import JUDGED_PERCENT, block_means
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions
from seed import FIRST_CYCLES_SEED, SEED
from small_scenes import light, material, set_world, wall

SAMPLES, FEW = 64, 4  # of which the first trial takes 4
REST = 8  # in each quarter of a pixel, instead of half of the samples
MEASURED_GROWTH = 1.3  # of noise, by a few seeds; passes estimate at most 1.2
INVISIBLE = 0.007  # noise relative to light; quasi-random samples may leave less than predicted
EVEN, DETAILED = Options(detail="off"), Options(detail="on")
OPTIONS = {"lens": "tessar-50mm", "lens_quality": "preview", "wavelengths_nm": np.linspace(430, 670, 9),
           "options": EVEN}


@pytest.fixture
def corner(scene):
    """Two coloured walls in a bluish world, one of them lit by a small, warm lamp; the picture is not square."""
    set_world(scene, (0.3, 0.5, 0.9), 0.4)
    lamp = light(scene, "POINT", 30.0, color=(1, 0.6, 0.3))
    lamp.location, lamp.data.shadow_soft_size = (0.5, 0.3, -0.5), 0.3
    wall(scene, material("Far", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0], 4.0)
    near = wall(scene, material("Near", "ShaderNodeBsdfDiffuse", (0.1, 0.6, 0.3))[0], 0.5, 0.1)
    near.location.x, near.location.y = -0.04, 0.02
    scene.cycles.samples, scene.render.resolution_x, scene.render.resolution_y = SAMPLES, 64, 48
    return scene


def rendered(scene, folder, seed, **options):
    """The radiance, and the report's facts about the scene."""
    scene.cycles.seed = FIRST_CYCLES_SEED + seed
    result = render_through_lens(scene, output_folder=folder, **OPTIONS | options)
    return read_exr(result.radiance).cube, result.report.scene


@pytest.fixture
def whole(monkeypatch):
    """A function that turns control variates off."""
    return lambda: monkeypatch.setattr(radiance, "shares_noise", lambda *_: False)


@pytest.fixture
def sample_counts(monkeypatch):
    """(first sample, number) of each render by Cycles."""
    counts, show = [], sampled_passes.show_samples

    def shown(scene, first, last, *others):
        counts.append((first, last - first))
        show(scene, first, last, *others)

    monkeypatch.setattr(sampled_passes, "show_samples", shown)
    return counts


@pytest.mark.sample(2)
@pytest.mark.parametrize("depth, detail", [("off", "off"), ("auto", "off"), ("off", "on"), ("auto", "on")])
def test_few_samples_have_nearly_the_noise_of_all(corner, tmp_path, whole, sample_counts, depth, detail):
    seeds = range(1, 5)
    shared = [rendered(corner, tmp_path, seed, depth=depth, options=Options(detail=detail)) for seed in seeds]
    facts = shared[0][1]
    assert facts.passes == 2 and f"of {SAMPLES} samples in 1 of 2 passes" in facts.samples
    rest = (0, REST if detail == "on" else SAMPLES // 2)
    slabs = sample_counts.count(rest) // len(seeds)
    assert slabs == 1 if depth == "off" else slabs > 1
    renders = len(seeds) * slabs
    assert sum(first == 0 for first, _ in sample_counts) == renders  # the biased one, at the centres of pixels
    assert sum(count for _, count in sample_counts) <= renders * (rest[1] + SAMPLES)
    whole()
    every = [rendered(corner, tmp_path, seed, depth=depth) for seed in seeds]
    assert not every[0][1].samples
    noise, of_all = (block_means(2 * np.var([cube for cube, _ in pictures], axis=0, ddof=1).mean(axis=0))
                     for pictures in (shared, every))  # of differences between two
    least = (INVISIBLE * block_means(every[0][0].mean(axis=0)))**2
    assert np.percentile(np.sqrt(noise / np.maximum(of_all, least)), JUDGED_PERCENT) < MEASURED_GROWTH
    means = [np.mean([cube for cube, _ in pictures], axis=(0, 2, 3)) for pictures in (shared, every)]
    np.testing.assert_allclose(*means, rtol=5 * np.sqrt(of_all.mean() / of_all.size / 64) / means[1].min())


def test_pass_takes_all_samples_if_few_leave_too_much_noise(corner, tmp_path, whole, sample_counts, monkeypatch):
    monkeypatch.setattr(sampled_passes, "MOST_GROWTH", 0.0)
    cube, facts = rendered(corner, tmp_path, 1, depth="off")
    assert f"{SAMPLES} of {SAMPLES}" in facts.samples
    assert sum(count for _, count in sample_counts) == facts.passes * SAMPLES
    whole()
    np.testing.assert_allclose(cube, rendered(corner, tmp_path, 1, depth="off")[0], rtol=1e-4, atol=1e-6 * cube.max())


def test_passes_share_the_choice_of_lamps(corner, tmp_path):
    """The light tree of Cycles chooses among the triangles of lamps by the power that it estimates for each."""
    corner.cycles.use_light_tree = True
    set_world(corner, (0, 0, 0))
    for place, colour in (((-0.3, 0.2, -0.8), (1, 0.9, 0.8)), ((0.3, -0.2, -0.8), (0.8, 0.9, 1))):
        mesh = bpy.data.meshes.new("Lamp")
        balls = bmesh.new()
        bmesh.ops.create_icosphere(balls, subdivisions=3, radius=0.03)
        balls.to_mesh(mesh)
        balls.free()
        mesh.materials.append(material("Glow", "ShaderNodeEmission", colour)[0])
        mesh.materials[0].node_tree.nodes["Emission"].inputs["Strength"].default_value = 50
        lamp = bpy.data.objects.new("Lamp", mesh)
        lamp.location = place
        corner.collection.objects.link(lamp)
    facts = rendered(corner, tmp_path, 1, depth="off")[1]
    assert facts.samples.startswith(f"{FEW} of")


@pytest.mark.parametrize("most_growth, first, later", [
    (0.0, [2, 2, 4, 8, 16, 32], [16, 16, 32]), (10.0, [2, 2], [2, 2])])
def test_a_pass_begins_with_as_many_samples_as_the_last_took(corner, tmp_path, sample_counts, monkeypatch, most_growth,
                                                             first, later):
    monkeypatch.setattr(sampled_passes, "MOST_GROWTH", most_growth)
    facts = rendered(corner, tmp_path, 1, depth="off", spectral=SpectralOptions(colour_error=0.05))[1]
    assert facts.passes >= 3
    assert [count for _, count in sample_counts] == [2, 2, 4, 8, 16, 32, *first, *later * (facts.passes - 2)]


def test_adaptive_sampling_counts_the_samples_of_each_pixel(corner, tmp_path, whole):
    """The control variate consists of fixed samples and of as many others as adaptive sampling takes."""
    corner.cycles.samples, corner.cycles.use_adaptive_sampling, corner.cycles.adaptive_threshold = 512, True, 0.05
    cube, facts = rendered(corner, tmp_path, 1, depth="off")
    assert "of 512 samples" in facts.samples
    corner.cycles.use_adaptive_sampling = False
    whole()
    expected = rendered(corner, tmp_path, 2, depth="off")[0]
    blocks, of_all = (np.array([block_means(plane) for plane in planes]) for planes in (cube, expected))
    np.testing.assert_allclose(blocks, of_all, rtol=0.1, atol=0.02 * of_all.max())
    np.testing.assert_allclose(cube.mean(axis=(1, 2)), expected.mean(axis=(1, 2)), rtol=0.01)


@pytest.mark.every_blender
def test_depth_is_that_of_whole_passes(corner, tmp_path, whole):
    """It is in the first sample, which passes with few samples lack."""
    corner.cycles.seed, corner.cycles.samples = FIRST_CYCLES_SEED, 2 * FEW

    def depth_m():
        return read_with_planes(render_through_lens(corner, output_folder=tmp_path, depth="off", **OPTIONS).radiance
                                )[1]["Z"]

    shared = depth_m()
    whole()
    assert shared.min() < 1 < shared.max() and np.array_equal(shared, depth_m())


def test_rounding_of_the_lamps_sum_is_no_light():
    """Its colour would be arbitrary, and the gains of a control variate follow colours."""
    rng = np.random.default_rng(SEED)
    slab = SimpleNamespace(region=(slice(0, 6), slice(0, 8)))
    gathered = GatheredLight(None, "Layer", ["One", "Two"], slab, None, 1.0)
    planes = {name: rng.gamma(1, 1, (6, 8)).astype(np.float32) for name in gathered.planes}
    for channel in "RGB":
        lamps = [planes[f"Layer.Combined_{name}.{channel}"] for name in ("One", "Two")]
        planes[f"Layer.Combined.{channel}"] = np.float32(sum(lamps) * (1 + 1e-6 * rng.standard_normal((6, 8))))
        planes[f"Layer.Combined.{channel}"][2, 3] += 0.5
    cube = gathered.light_of(planes).cube
    np.testing.assert_allclose(cube[0, :, 2, 3], 0.5, rtol=1e-4)
    assert np.count_nonzero(cube[0]) == 3


@pytest.mark.parametrize("why", ["reference", "preview", "time limit", "range", "few", "catcher"])
def test_passes_take_all_samples(corner, tmp_path, sample_counts, why):
    """In Reference, with a single pass, and if the scene limits its samples in another way."""
    tier = why if why in ("reference", "preview") else "standard"
    corner.cycles.time_limit = 1000.0 if why == "time limit" else 0.0
    corner.cycles.use_sample_subset, corner.cycles.sample_subset_length = why == "range", SAMPLES
    corner.cycles.samples = 2 * FEW - 1 if why == "few" else 2 * FEW
    bpy.data.objects["Wall"].is_shadow_catcher = why == "catcher"
    _, facts = rendered(corner, tmp_path, 1, depth="off", spectral=SpectralOptions(tier))
    assert not facts.samples and not sample_counts


def test_settings_of_the_scene_are_restored(corner, tmp_path):
    layer = bpy.context.view_layer
    layer.samples, corner.cycles.samples, corner.cycles.use_layer_samples = 32, 16, "USE"
    before = {name: getattr(corner.cycles, name) for name in ("samples", "use_sample_subset", "sample_offset",
                                                               "sample_subset_length", "use_adaptive_sampling")}
    _, facts = rendered(corner, tmp_path, 1, depth="off")
    assert "of 32 samples" in facts.samples
    assert layer.samples == 32 and before == {name: getattr(corner.cycles, name) for name in before}
    assert not layer.cycles.pass_debug_sample_count


def test_denoising_treats_the_control_variate_and_the_estimates(corner, tmp_path, whole):
    """Not the few samples: their estimates are nearly as clean as passes that Cycles denoises itself."""
    lamp = bpy.data.objects["Light"]  # large and close to the wall: a noisy one
    lamp.location, lamp.data.shadow_soft_size = (2.0, 0.5, -3.0), 1.2
    corner.cycles.samples = 16
    options = {"depth": "off", "denoise": "on"}
    shared, facts = rendered(corner, tmp_path, 1, **options)
    assert "control variate" in facts.samples and not bpy.context.view_layer.cycles.denoising_store_passes
    noisy = rendered(corner, tmp_path, 1, **options | {"denoise": "off"})[0]
    whole()
    denoised = rendered(corner, tmp_path, 1, **options)[0]
    assert np.abs(np.diff(shared)).mean() < np.abs(np.diff(noisy)).mean()
    assert np.sqrt(np.mean((shared - denoised)**2)) < np.sqrt(np.mean((noisy - denoised)**2))


def test_detail_is_the_light_of_a_render_in_finer_pixels(corner, tmp_path):
    """And the stored radiance gives the same picture again."""
    options = OPTIONS | {"lens": "edmund-54852", "depth": "off"}
    corner.cycles.samples = 256
    result = render_through_lens(corner, output_folder=tmp_path / "on", **options | {"options": DETAILED})
    even = render_through_lens(corner, output_folder=tmp_path / "off", **options)
    radiance, without = read_exr(result.radiance), read_exr(even.radiance)
    assert radiance.detail.times == 2 and without.detail is None and radiance.grid == without.grid
    noise = 0.01 * without.cube.mean()
    assert np.abs(radiance.cube.mean(axis=(1, 2)) - without.cube.mean(axis=(1, 2))).max() < noise
    softening_px = [each.report.lens_image.softening_px for each in (result, even)]
    assert 0 < softening_px[0] < softening_px[1] / 4
    applied = apply_lens(result.radiance, lens="edmund-54852", output_folder=tmp_path / "again",
                         lens_quality="preview", options=DETAILED, stray=StrayOptions("off"))
    pictures = [read_exr(each.irradiance).cube for each in (applied, result)]
    np.testing.assert_allclose(*pictures, rtol=1e-6, atol=1e-6 * pictures[1].max())
    corner.render.resolution_x, corner.render.resolution_y = 128, 96
    fine = read_exr(render_through_lens(corner, output_folder=tmp_path / "fine", **options).radiance).frame()
    frame = radiance.frame()
    errors = np.array([[np.abs(parts - expected).sum() for parts in (frame.detail.split(plane, nm),
                                                                     split_pixels(plane, 2))]
                       for nm, plane, expected in zip(frame.wavelengths_nm, frame.cube, fine.cube, strict=True)])
    assert np.all(errors[:, 0] < errors[:, 1])  # noise, and contrasts at other wavelengths, remain: most in red
    assert errors[:, 0].sum() < 0.7 * errors[:, 1].sum()


def test_detail_of_a_render_region_and_of_layers(corner, tmp_path):
    render = corner.render
    render.use_border, render.border_min_x, render.border_max_x = True, 0.25, 0.8
    render.border_min_y, render.border_max_y = 0.1, 0.7
    region = render_through_lens(corner, output_folder=tmp_path / "region", depth="off",
                                 **OPTIONS | {"options": DETAILED})
    shares = read_exr(region.radiance).detail.shares
    assert np.all(shares[:, 0] == 1) and np.ptp(shares.astype(float)) > 0
    render.use_border = False
    deep = render_through_lens(corner, output_folder=tmp_path / "deep", depth="auto",
                               **OPTIONS | {"options": DETAILED})
    _, _, layered = read_with_layers(deep.radiance)
    assert layered.detail_times == 2 and deep.report.lens_image.plan.supersampling == 2


@pytest.mark.parametrize("options, tier, wavelengths_nm, samples", [
    (Options(), "standard", (450.0, 550.0, 650.0), SAMPLES), (Options(), "reference", (460.0, 640.0), SAMPLES),
    (Options(), "standard", (450.0, 550.0, 650.0), 16), (Options(), "preview", (450.0, 550.0, 650.0), SAMPLES),
    (EVEN, "standard", (450.0, 550.0, 650.0), SAMPLES)])
def test_a_single_pass_has_detail_by_default_too(corner, tmp_path, options, tier, wavelengths_nm, samples):
    """Except in Preview, and with few samples: each part of a pixel takes a quarter of them."""
    corner.cycles.samples = samples
    given = OPTIONS | {"depth": "off", "spectral": SpectralOptions(tier), "wavelengths_nm": wavelengths_nm}
    even, result = (render_through_lens(corner, output_folder=tmp_path / str(number), **given | {"options": each})
                    for number, each in enumerate((EVEN, options)))
    expected = 2 if options == Options() and tier != "preview" and samples == SAMPLES else 1
    facts, (radiance, without) = result.report.scene, (read_exr(each.radiance) for each in (result, even))
    assert facts.passes == 1 and radiance.detail_times == expected == result.report.lens_image.plan.known
    assert ("detail of 2 x 2 parts" in facts.samples) == (expected == 2)
    noise = 0.01 * without.cube.mean()
    assert np.abs(radiance.cube.mean(axis=(1, 2)) - without.cube.mean(axis=(1, 2))).max() < noise
    assert corner.cycles.samples == samples
