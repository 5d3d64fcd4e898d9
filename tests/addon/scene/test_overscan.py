"""Captures have overscan for the light that the plan spreads, and no more."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import gaussian_psf, make_lens, tinted
from lensfield.addon.scene import camera
from lensfield.addon.scene.camera import frame_capture, pitch_um
from lensfield.engine import Options, Report, SpectralImage, load_lens, simulate
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.psf_samples import psf_radius_px
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.plan.choose import make_plan

LENSES = {"panorama": tinted(load_lens("edmund-54852")),
          "plane": tinted(make_lens(gaussian_psf(9, 14, 2.5, 41), efl_mm=9.0))}
SHAPE_PX, NM = (288, 362), (550.0, 600.0)
ACCURACIES = 0.1, 0.01, 0.001


def frame_for(lens):
    return PixelGrid(SHAPE_PX, pitch_um(lens, SHAPE_PX))


def wider(capture, more_px):
    """The capture with this many more pixels on each side."""
    return capture.with_overscan([margin + more_px for margin in capture.overscan_px])


def white(grid):
    return SpectralImage(np.full((len(NM), *grid.shape_px), 3, np.float32), NM, grid)


@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize("name", LENSES)
def test_the_overscan_is_the_reach_of_the_plan(name, accuracy):
    lens, options = LENSES[name], Options(accuracy=accuracy)
    capture = frame_capture(lens, frame_for(lens), NM, options)
    plan = make_plan(options, lens, Sampling(capture, NM))
    assert capture.projection.is_plane == (name == "plane")
    needed = field_map(lens).overscan_px(capture, NM, plan.psf_radius_px)
    assert all(least <= available <= least + 2 for least, available in zip(needed, capture.overscan_px, strict=True))
    assert plan.psf_radius_px < psf_radius_px(lens, capture.pitch_um)


def test_supersampling_is_planned_in_finer_pixels():
    lens = LENSES["plane"]
    fine, coarse = (frame_capture(lens, frame_for(lens), NM, Options(accuracy=0.01, supersampling=times)).overscan_px
                    for times in (3, 1))
    assert np.abs(np.subtract(fine, coarse)).max() <= 1


def test_the_exact_method_needs_the_complete_psfs():
    lens = LENSES["plane"]
    capture = frame_capture(lens, frame_for(lens), NM, Options(method="exact"))
    assert min(capture.overscan_px) > psf_radius_px(lens, capture.pitch_um)


def test_lenses_that_share_a_capture_all_have_room():
    lens = LENSES["plane"]
    wide = replace(lens, psf_pitch_um=2 * lens.psf_pitch_um)
    alone, wide_alone, both = (frame_capture(each, frame_for(each), NM, others=others).overscan_px
                               for each, others in ((lens, ()), (wide, ()), (lens, (wide,))))
    assert both == wide_alone and min(both) > max(alone)


@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize("name", LENSES)
def test_a_white_wall_is_even_to_the_corner(name, accuracy):
    """As with more overscan than the complete PSFs need; with less than planned, the border is dark."""
    lens, options = LENSES[name], Options(accuracy=accuracy)
    capture = frame_capture(lens, frame_for(lens), NM, options)
    expected, enough, less = (
        simulate(white(wider(capture, more_px)), lens, options).cube
        for more_px in (psf_radius_px(lens, capture.pitch_um), 0, 1 - min(capture.overscan_px)))
    np.testing.assert_allclose(enough, expected, rtol=accuracy / 8)  # twice the share of uniform light
    assert (less / expected).min() < 1 - accuracy / 8


@pytest.mark.parametrize("accuracy", ACCURACIES[:2])
@pytest.mark.parametrize("name", LENSES)
def test_points_beyond_the_capture_send_less_light_into_the_frame_than_is_trimmed(name, accuracy):
    """By the exact operator with complete PSFs, off-centre along each side. Some light is always missing."""
    lens, options = LENSES[name], Options(accuracy=accuracy)
    capture = frame_capture(lens, frame_for(lens), NM, options)
    plan = make_plan(options, lens, Sampling(capture, NM))
    more_px = psf_radius_px(lens, capture.pitch_um)
    grid, shares = wider(capture, more_px), []
    (rows, columns), (last_row, last_column) = grid.shape_px, (n - more_px for n in grid.shape_px)
    for place in ((more_px - 1, columns // 3), (last_row, columns // 2), (rows // 3, more_px - 1),
                  (rows // 2, last_column), (more_px - 1, more_px - 1), (last_row, more_px + 1)):
        image = SpectralImage(np.zeros((1, *grid.shape_px), np.float32), NM[:1], grid)
        image.cube[0][place] = 1e4
        report = Report()
        simulate(image, lens, Options(method="exact"), report=report)
        energy = report.lens_image.energy
        shares.append(energy.in_frame_w_per_nm / energy.in_w_per_nm)
    assert 0 < max(shares) < 1 - plan.psf_energy < plan.error_bound / 2


def test_pixels_too_small_to_plan_are_captured_for_complete_psfs(monkeypatch):
    lens = LENSES["plane"]
    monkeypatch.setattr(camera, "MOST_PLANNED_PX", 3)
    monkeypatch.setattr(camera, "cached_plan", lambda *_: pytest.fail("planned"))
    capture = frame_capture(lens, frame_for(lens), NM, Options(accuracy=0.1))
    assert min(capture.overscan_px) > psf_radius_px(lens, capture.pitch_um)
