"""Coverage by surfaces: what each pixel's light is made of."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from lenses import tinted
from lensfield.engine import Options, SpectralImage, load_lens, simulate
from lensfield.engine.image.detail import Detail, merged
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.rays.rings import Rings
from lensfield.engine.simulation import surface_coverage as module
from lensfield.engine.simulation.surface_coverage import surface_coverage

NM = 550.0
GRID = PixelGrid((58, 70), 60.0, (20.0, 41.0), overscan_px=(5, 6))
OPTIONS = Options(accuracy=0.01)
EMISSIONS = np.array([3.0, 0.5, 1.2, 0.7])  # of three surfaces and the background


@pytest.fixture(scope="module")
def lens():
    return tinted(load_lens("nikkor-28mm", Rings(focus_mm=1500.0), "preview", wavelengths_nm=[NM]))


def sparse(*masks):
    """The shares of these masks, and of the background."""
    masks = np.array([*masks, 1 - np.sum(masks, axis=0)], np.float32)
    return scipy.sparse.csr_array(masks.reshape(len(masks), -1))


def box(top, bottom, left, right):
    mask = np.zeros(GRID.shape_px, np.float32)
    mask[top:bottom, left:right] = 1
    return mask


NOTHING, EVERYWHERE, NEAR, HALF = box(0, 0, 0, 0), box(0, 58, 0, 70), box(20, 30, 25, 45), box(0, 58, 0, 33)
SHARES = [sparse(NEAR, NOTHING, NOTHING), sparse(NOTHING, 0.75 * HALF, box(40, 50, 33, 70))]
"""A near box, and a layer of two surfaces and the background."""


def layers_of(cubes, alphas):
    layers = [Layer(cube[None], alpha, np.full(alpha.shape, mm))
              for cube, alpha, mm in zip(cubes, alphas, (400.0, 1500.0), strict=True)]
    return LayeredRadiance(layers, [NM], GRID, None)


def shining(shares, emissions):
    """The light of a layer that is opaque."""
    return np.tensordot(emissions, shares.toarray().reshape(-1, *GRID.shape_px), 1)


def of_layers(lens, layers, **given):
    return surface_coverage(SHARES, layers.flat(), lens, OPTIONS, NM, layers=layers, **given)


def test_flat_light_is_the_sum_of_its_surfaces(lens):
    share = sparse(NEAR, 0.75 * HALF * (1 - NEAR), box(40, 50, 33, 70))
    light, white = (SpectralImage(shining(share, emissions)[None], [NM], GRID) for emissions in (EMISSIONS, np.ones(4)))
    coverage = surface_coverage([share], light, lens, OPTIONS, NM)
    assert coverage.shape == (4, *GRID.frame_px) and coverage.min() >= 0
    np.testing.assert_allclose(coverage.sum(axis=0), 1, atol=1e-6)
    through, of_white = (simulate(each, lens, OPTIONS).cube[0] for each in (light, white))
    np.testing.assert_allclose(np.tensordot(EMISSIONS, coverage, 1), through / of_white, atol=2 * OPTIONS.accuracy)
    assert np.ptp(coverage, axis=(1, 2)).min() > 0.5


def test_light_in_parts_of_pixels_is_the_sum_of_its_surfaces(lens):
    """A stripe at the right of its pixels, which are divided into 2 x 2 parts."""
    stripe = np.zeros([2 * side for side in GRID.shape_px])
    stripe[10:90, 1::8] = 1
    share = sparse(stripe, 0 * stripe, 0 * stripe)
    light, white = (np.tensordot(emissions, share.toarray().reshape(-1, *stripe.shape), 1).astype(np.float32)[None]
                    for emissions in (EMISSIONS, np.ones(4)))
    through, of_white = (simulate(SpectralImage(merged(parts, 2), [NM], GRID, detail=Detail.of(parts, [NM], 2)), lens,
                                  OPTIONS).cube[0] for parts in (light, white))
    flat = SpectralImage(merged(light, 2), [NM], GRID)
    coverage = surface_coverage([share], flat, lens, OPTIONS, NM)
    np.testing.assert_allclose(np.tensordot(EMISSIONS, coverage, 1), through / of_white, atol=2 * OPTIONS.accuracy)


def test_light_of_layers_is_the_sum_of_its_surfaces(lens):
    layers, white = (layers_of([emissions[0] * NEAR, shining(SHARES[1], emissions)], (NEAR, EVERYWHERE))
                     for emissions in (EMISSIONS, np.ones(4)))
    coverage = of_layers(lens, layers)
    np.testing.assert_allclose(coverage.sum(axis=0), 1, atol=1e-6)
    through, of_white = (simulate(each, lens, OPTIONS).cube[0] for each in (layers, white))
    made = np.tensordot(EMISSIONS, coverage, 1)
    np.testing.assert_allclose(made, through / of_white, atol=0.02 * EMISSIONS.max())  # the number of rays varies
    assert np.mean(np.abs(made - through / of_white)) < 0.003
    assert np.count_nonzero((coverage[0] > 0.02) & (coverage[0] < 0.98)) > 100, "the near box is out of focus"


def test_a_background_is_behind_layers_that_do_not_cover_the_capture(lens):
    """A film that is transparent has no layer of the world."""
    far = box(0, 58, 10, 70)
    layers = layers_of([NEAR, far], (NEAR, far))
    coverage = of_layers(lens, layers)
    np.testing.assert_allclose(coverage.sum(axis=0), 1, atol=1e-6)
    assert coverage[-1, :, :2].min() > 0.9 and coverage[-1, 20, 15] == pytest.approx(0.25, abs=0.02)


def test_surfaces_in_portions_have_the_same_coverage(lens, monkeypatch):
    layers = layers_of([NEAR, EVERYWHERE], (NEAR, EVERYWHERE))
    together, fractions = of_layers(lens, layers), []
    monkeypatch.setattr(module, "TOGETHER_BYTES", 0)
    np.testing.assert_allclose(of_layers(lens, layers, progress=fractions.append), together, atol=0.02)
    assert fractions == [0.25, 0.5, 0.75, 1.0]


def test_pixels_without_light_have_no_coverage(lens):
    share = sparse(NEAR, NOTHING, NOTHING)
    grid = replace(GRID, pitch_um=12 * GRID.pitch_um)  # beyond the image circle
    flat = SpectralImage(np.ones((1, *GRID.shape_px)), [NM], grid)
    total = surface_coverage([share], flat, lens, replace(OPTIONS, out_of_field="vignette"), NM).sum(axis=0)
    assert set(np.round(total, 5).ravel()) == {0, 1} and total[15, 35] == pytest.approx(1)
