"""Layers of depth against rays through the real lens, small; `make validate` has the figures.

The limits are those in `validation/depth_truth.py`, plus 5 sigma of the noise between seeds.
"""

from dataclasses import replace

import numpy as np
import pytest

import depth_truth
from depth_measure import errors, means_of_blocks, variance_of_mean
from depth_room import build_room
from depth_scenes import body_scene, floor_scene, lamp_scene
from lensfield.engine import load_lens
from lensfield.engine.depth.depth_range import blur_px
from noise import SIGMAS
from seed import FIRST_CYCLES_SEED

FRAME_PX, SEEDS = (72, 96), 4
LIMIT = 0.025


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(depth_truth, "FRAME_PX", FRAME_PX)
        patch.setattr(depth_truth, "load_lens", lambda name, rings: load_lens(name, rings, quality="preview"))
        yield depth_truth.Bench("kodak-petzval-100mm", tmp_path_factory.mktemp("truth"), FIRST_CYCLES_SEED)


def both(bench, scene, samples=(16, 64)):
    """By layers and by rays: arrays (seed, row, column)."""
    ours, _ = bench.pictures(scene, samples[0], SEEDS)
    return ours[0], bench.truth("small", scene, seeds=SEEDS, samples=samples[1])[0]


def assert_alike(ours, truth, block_px, limit, least=0.2):
    """Compares the means of all blocks that are not dark."""
    ours, truth = (means_of_blocks(each, block_px) for each in (ours, truth))
    apart = ours.mean(axis=0) - truth.mean(axis=0)
    noise = SIGMAS * np.sqrt(variance_of_mean(ours) + variance_of_mean(truth))
    scale = truth.mean(axis=0)
    lit = scale > least * scale.mean()
    assert lit.sum() > 8 and np.median(noise[lit] / scale[lit]) < 0.2  # too noisy to detect anything otherwise
    assert np.mean(np.abs(apart[lit]) > noise[lit] + limit * scale[lit]) < 0.02
    assert abs(apart[lit].sum()) < limit * scale[lit].sum()


@pytest.fixture(autouse=True)
def empty_cache(bench, tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "folder", tmp_path)


def test_the_room_agrees_with_rays(bench):
    scene = build_room()
    ours, truth = both(bench, scene)
    assert_alike(ours, truth, block_px=6, limit=2 * LIMIT)
    sharp, _ = bench.pictures(scene, 16, 2, depth="off")
    assert errors(sharp[0], truth).l2_bias > 5 * errors(ours, truth).l2_bias


def test_a_slanted_floor_has_no_seam(bench):
    ours, truth = both(bench, floor_scene(bench.lens))
    rows = (each.mean(axis=-1, keepdims=True) for each in (ours, truth))
    assert_alike(*rows, block_px=1, limit=0.02)


def test_a_cut_body_does_not_show_its_dark_inside(bench):
    assert_alike(*both(bench, body_scene(bench.lens)), block_px=4, limit=0.05)


@pytest.mark.sample(1)
@pytest.mark.parametrize("distance_m", [depth_truth.LAMPS_M[0], depth_truth.LAMPS_M[-1]])
def test_lamps_agree_with_rays_in_position_and_width(bench, distance_m):
    scene, ideal_mm = lamp_scene(bench.lens, bench.frame.pitch_um * 1e-3, distance_m)
    pictures = both(bench, scene, samples=(64, 512))
    width_px = abs(float(blur_px(bench.lens, bench.frame.pitch_um, 1e3 * distance_m)))
    for place in ideal_mm:
        ours, true = (np.array([depth_truth.spot_px(each, bench.frame, place, width_px) for each in side])
                      for side in pictures)
        noise = SIGMAS * np.sqrt((ours.var(axis=0, ddof=1) + true.var(axis=0, ddof=1)) / SEEDS)
        apart = np.abs(ours.mean(axis=0) - true.mean(axis=0))
        assert np.all(apart < noise + 0.02 * width_px)


def test_errors_are_recovered_from_noisy_pictures():
    rng = np.random.default_rng(3)
    truth = rng.uniform(0.5, 1.5, (200, 300))
    bias = 0.03 * rng.standard_normal(truth.shape)
    pictures = truth + bias + 0.05 * rng.standard_normal((4, *truth.shape))
    measured = errors(pictures, truth + 0.1 * rng.standard_normal((4, *truth.shape)))
    size = np.sqrt(np.mean(truth**2))
    assert measured.l2_bias == pytest.approx(0.03 / size, rel=0.05)
    assert measured.l1_bias == pytest.approx(np.sqrt(2 / np.pi) * 0.03, rel=0.05)
    assert measured.l2 == pytest.approx(np.hypot(0.03, 0.05) / size, rel=0.03)
    assert measured.l1 == pytest.approx(np.sqrt(2 / np.pi) * np.hypot(0.03, 0.05), rel=0.03)


def counted_truth(bench, computed, what="counted", **changes):
    """A picture from the folder's cache, or a new one whose value is the number of pictures computed so far."""
    key = {"nm": 550.0, "samples": 4, "seed": 1} | changes
    return bench._cached(what, *key.values(), lambda: computed.append(key) or np.full((2, 3), len(computed)))[0, 0]


def test_a_truth_is_computed_again_after_any_of_its_inputs_changes(bench, monkeypatch):
    computed = []
    assert counted_truth(bench, computed) == counted_truth(bench, computed) == 1
    for number, change in enumerate(({"nm": 551.0}, {"samples": 5}, {"seed": 2}, {"what": "another"}), 2):
        assert counted_truth(bench, computed, **change) == counted_truth(bench, computed, **change) == number
    first, *others = bench.lens.prescription.surfaces
    nudged = replace(bench.lens.prescription, surfaces=(replace(first, radius_mm=1.0001 * first.radius_mm), *others))
    for changed in ((bench, "lens", replace(bench.lens, prescription=nudged)), (depth_truth, "FRAME_PX", (72, 97)),
                    (depth_truth, "FOCUS_M", 2.1), (depth_truth, "sources_digest", lambda: "other sources"),
                    (depth_truth, "build_identity", lambda: "another build")):
        with monkeypatch.context() as patch:
            patch.setattr(*changed)
            assert counted_truth(bench, computed) == counted_truth(bench, computed) == len(computed)
    assert len(computed) == 10 and counted_truth(bench, computed) == 1


def test_the_digest_covers_every_source_of_the_validation(tmp_path):
    path, digests = tmp_path / "depth_room.py", []
    for text in ("a = 1", "a = 2"):
        path.write_text(text)
        depth_truth.sources_digest.cache_clear()
        digests.append(depth_truth.sources_digest(tmp_path))
    path.rename(path.with_name(f"other{path.suffix}"))
    depth_truth.sources_digest.cache_clear()
    assert len({*digests, depth_truth.sources_digest(tmp_path)}) == 3
    depth_truth.sources_digest.cache_clear()
