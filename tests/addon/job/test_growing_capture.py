"""A capture that grows for the preview: its samples, its colours, and its pixels."""

import bpy
import numpy as np
import pytest

from lensfield.addon.capture import growing_capture as growing
from lensfield.addon.capture.growing_capture import FINER, Grown, growing_capture, sample_ends
from lensfield.addon.capture.slabs import Cut, Slab
from lensfield.addon.job.steps import RenderPass, Work
from lensfield.addon.render.render import job_of_frame, render_through_lens
from lensfield.addon.render.scene_preview import COARSE_NM, metameric
from lensfield.engine import Options
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.pictures.preview import to_rec709
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from small_scenes import light, material, wall
from snapshot import differences, snapshot


@pytest.fixture
def request_fields(scene, tmp_path):
    """A coloured corner of the picture, lit by a large lamp, whose light is noisy."""
    light(scene, "POINT", 20.0, color=(1, 0.5, 0.2), shadow_soft_size=2.0)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0]).location.x = 5.1
    scene.cycles.samples = 16
    return {"lens": "tessar-50mm", "spectral": SpectralOptions("preview"), "options": Options(accuracy=0.1),
            "wavelengths_nm": tuple(np.linspace(400, 700, 7)), "denoise": "off", "depth": "off",
            "room": 0.125,  # the same margin for both sizes
            "output_folder": tmp_path}


def stages(scene, given, most=None):
    """The stages of a growing capture; `most` of them, if given, after which it is closed."""
    capture = growing_capture(scene, job_of_frame(scene, scene.frame_current, **given))
    answer, grown = None, []
    while len(grown) != most and (step := capture.send(answer)):
        answer = None
        if isinstance(step, RenderPass):
            bpy.ops.render.render(write_still=True, scene=step.scene.name)
        elif isinstance(step, Work):
            answer = step.call(lambda fraction: None)
        else:
            assert isinstance(step, Grown)
            grown.append(step)
    capture.close()
    return grown


@pytest.mark.every_blender
def test_samples_are_added_and_not_begun_anew(scene, request_fields, monkeypatch):
    """After all stages, the fine pixels equal a render of this size with all samples, including its noise, although
    they are rendered in bands."""
    monkeypatch.setattr(growing, "_bands", lambda slab, number, bands=growing._bands: bands(slab, 3))
    coarse, first, last = stages(scene, request_fields)
    assert [(each.times, each.samples) for each in (coarse, first, last)] == [(1, 2), (FINER, 4), (FINER, 16)]
    rows, columns = coarse.captured.radiance.frame_px
    assert first.captured.radiance.frame_px == (FINER * rows, FINER * columns)
    scene.render.resolution_x, scene.render.resolution_y = FINER * columns, FINER * rows
    expected = read_exr(render_through_lens(scene, **request_fields).radiance)
    few, grown = first.captured.radiance, last.captured.radiance
    assert grown.overscan_px == expected.overscan_px and expected.cube.mean() > 0
    limit = 1e-5 * expected.cube.max()
    assert np.abs(grown.cube - expected.cube).max() < limit < np.abs(few.cube - expected.cube).max() / 100


def test_slabs_film_and_render_region_have_fine_pixels_too(scene, request_fields):
    """A near and a far wall, and a region in the right half: the layers of both sizes have the same means."""
    wall(scene, bpy.data.materials["Paint"], 0.6, 0.1).location.x = 0.1
    scene.render.film_transparent = scene.render.use_border = True
    scene.render.border_min_x = 0.5
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 2.0, 2.8
    coarse, fine, _ = (each.captured for each in stages(scene, request_fields | {"depth": "auto"}))
    assert len(coarse.layers.layers) == len(fine.layers.layers) >= 2
    for few, many in ((coarse.region == 1, fine.region == 1), (coarse.alpha, fine.alpha)):
        assert many.shape == tuple(FINER * n for n in few.shape)
        assert many.mean() == pytest.approx(few.mean(), rel=0.05) and 0 < few.mean() < 1
    near_mm, far_mm = (np.median(layer.depth_mm[layer.alpha > 0]) for layer in fine.layers.layers[:2])
    assert near_mm == pytest.approx(600, rel=0.05) and far_mm == pytest.approx(1000, rel=0.05)


def test_a_capture_that_is_closed_restores_the_scene(scene, request_fields):
    stages(scene, request_fields, most=1)  # the first one also chooses a colour space, in a factory-new scene
    before = snapshot()
    assert len(stages(scene, request_fields, most=2)) == 2
    assert not differences(before, snapshot())


def test_three_wavelengths_have_the_colours_of_all(scene, request_fields):
    coarse, = stages(scene, request_fields, most=1)
    few = metameric(coarse.captured).radiance
    assert tuple(few.wavelengths_nm) == COARSE_NM
    colours, expected = to_rec709(few), to_rec709(coarse.captured.radiance)
    assert np.allclose(colours, expected, atol=1e-4 * expected.max()) and np.ptp(expected.mean(axis=(0, 1))) > 0


@pytest.mark.parametrize("samples, ends", [(1, [1]), (4, [4]), (5, [4, 5]), (64, [4, 16, 64]), (100, [4, 16, 64, 100])])
def test_each_stage_has_four_times_the_samples(samples, ends):
    assert sample_ends(samples) == ends


@pytest.mark.parametrize("timed, again, expected_s", [
    ([(30, 4.0)], False, 2.0), ([(10, 4.0), (20, 0.2)], False, 0.15), ([(10, 0.2), (20, 0.4)], True, 0.3)])
def test_a_change_of_wavelengths_is_not_counted_as_samples(timed, again, expected_s):
    """Renders of 30 rows in all, of 2 samples each; without a better estimate, all of the time counts."""
    passes = object.__new__(growing._GrowingPasses)
    passes._sample_s = 0.0
    passes._learn(timed, 2, again)
    assert passes._sample_s == pytest.approx(expected_s)
    passes._learn([(30, 99.0)], 2, False)
    assert passes._sample_s == pytest.approx(expected_s)


def test_bands_cover_all_rows_of_a_slab_once():
    slab = Slab(0.1, 1.0, (slice(3, 10), slice(2, 5)), True, False)
    rows = [band.region[0] for band in growing._bands(slab, 3)]
    assert rows == [slice(3, 5), slice(5, 8), slice(8, 10)]
    assert growing._bands(slab, 0) == [slab] and len(growing._bands(slab, 99)) == 7


def test_a_coarser_cut_covers_the_same_area():
    """A frame of 9 x 12 px with a margin of 4 and 2 px: 3 x 4 px with margins of 2 and 1 px, the outer ones in part."""
    fine = PixelGrid.around_frame((9, 12), 1.0, (4, 2))
    slabs = (Slab(0.1, 1.0, (slice(0, 17), slice(0, 16)), True, True),
             Slab(1.0, 9.0, (slice(5, 8), slice(3, 14)), False, True))
    coarse = Cut(None, fine, slabs).coarser(3)
    assert coarse.capture == PixelGrid.around_frame((3, 4), 3.0, (2, 1))
    assert coarse.slabs[0].region == (slice(0, 7), slice(0, 6)) and coarse.slabs[0].transparent
    assert coarse.slabs[1].region == (slice(2, 4), slice(1, 5)) and coarse.slabs[1].near_m == 1.0
