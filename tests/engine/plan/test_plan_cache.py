"""Cached plans equal new ones, and everything that a plan depends on is part of the key."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from forged import forge
from lenses import comatic_lens, gaussian_psf, make_lens
from lensfield.engine import ChannelCache, Options, SpectralImage, simulate
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.plan import choose, plan_cache
from lensfield.engine.plan.choose import make_plan
from lensfield.engine.plan.plan_cache import cached_plan

LENS = comatic_lens()
OPTIONS = {"accuracy": Options(), "fine": Options(accuracy=1e-3), "double": Options(accuracy=2e-5),
           "exact": Options(accuracy=1e-9), "sections": Options(accuracy=0.05, method="sections"),
           "knobs": Options(section_size=8, psf_energy=1), "paper": Options(method="paper")}


def picture():
    return SpectralImage(np.ones((2, 40, 50), np.float32), (450.0, 600.0), pitch_um=20.0)


def sampling(shape=(40, 50), wavelengths_nm=(450.0, 600.0), **facts):
    return Sampling(PixelGrid(shape, **{"pitch_um": 20.0} | facts), wavelengths_nm)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("LENSFIELD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(plan_cache, "_plans", {})
    return tmp_path / "cache"


@pytest.fixture
def computed_plans(monkeypatch):
    """The plans that are computed instead of read from the cache."""
    plans = []

    def counted(*arguments):
        plans.append(make_plan(*arguments))
        return plans[-1]

    monkeypatch.setattr(plan_cache, "make_plan", counted)
    return plans


def forget_process():
    plan_cache._plans.clear()


@pytest.mark.parametrize("name", OPTIONS)
@pytest.mark.parametrize("lens", [LENS, make_lens(gaussian_psf(4, 4, 1.0, 16), psf_pitch_um=10.0)])
def test_a_cached_plan_equals_the_computed_plan(name, lens, folder, computed_plans):
    first = cached_plan(OPTIONS[name], lens, sampling())
    again = cached_plan(OPTIONS[name], replace(lens), sampling())
    forget_process()
    from_disk = cached_plan(OPTIONS[name], lens, sampling())
    assert len(computed_plans) == 1 and first == again == from_disk == make_plan(OPTIONS[name], lens, sampling())
    assert from_disk.error_bound == first.error_bound and from_disk.memory_mb == first.memory_mb
    assert type(from_disk.method) is type(first.method) and from_disk.text and from_disk.seconds > 0


def test_every_input_of_a_plan_is_part_of_its_cache_key(folder, computed_plans):
    others = [(Options(), LENS, each) for each in (
        sampling(), sampling(shape=(41, 50)), sampling(shape=(40, 51)), sampling(pitch_um=19.0),
        sampling(centre_px=(19.0, 24.5)), sampling(overscan_px=(2, 0)), sampling(overscan_px=(0, 2)),
        sampling(wavelengths_nm=(450.0, 601.0)), sampling(wavelengths_nm=(450.0,)), sampling(projection=FISHEYE))]
    others += [(Options(accuracy=0.02), LENS, sampling()), (Options(out_of_field="vignette"), LENS, sampling()),
               (Options(), replace(LENS, f_number_effective=4.0), sampling()),
               (Options(), make_lens(gaussian_psf(6, 6, 2.5, 25), heights_mm=LENS.heights_mm), sampling())]
    assert len({lens.name for _, lens, _ in others}) == 1
    for arguments in others:
        cached_plan(*arguments)
    forget_process()
    for arguments in others:
        assert cached_plan(*arguments) == make_plan(*arguments)
    assert len(computed_plans) == len(others) == len(list((folder / "plans").iterdir()))


def test_plans_of_another_code_version_are_recomputed(folder, computed_plans, monkeypatch):
    cached_plan(Options(), LENS, sampling())
    forget_process()
    monkeypatch.setattr(plan_cache.cache, "build_identity", lambda: "another")
    cached_plan(Options(), LENS, sampling())
    assert len(computed_plans) == 2


@pytest.mark.parametrize("damage", [lambda plan: b"junk", lambda plan: b"[]", lambda plan: b"{}",
                                    lambda plan: plan.replace(b"psf_radius_px", b"psf_radius"),
                                    lambda plan: plan.replace(b'"float32"', b"32"),
                                    lambda plan: plan.replace(b'"section_size": ', b'"section_size": 0.'),
                                    lambda plan: plan.replace(b'"name"', b'"title"') + b"\xff"])
def test_junk_with_a_valid_seal_is_recomputed(folder, computed_plans, damage):
    first = cached_plan(Options(), LENS, sampling())
    content = plan_cache._as_text(first)
    assert damage(content) != content
    forge(folder, "plans", damage(content))
    for _ in range(2):
        forget_process()
        assert cached_plan(Options(), LENS, sampling()) == first
    assert len(computed_plans) == 2


def test_a_plan_in_a_damaged_file_is_recomputed(folder, computed_plans):
    first = cached_plan(Options(), LENS, sampling())
    path, = (folder / "plans").iterdir()
    path.write_bytes(path.read_bytes().replace(b"azimuths", b"azimutts"))
    forget_process()
    assert cached_plan(Options(), LENS, sampling()) == first and len(computed_plans) == 2
    forget_process()
    cached_plan(Options(), LENS, sampling())
    assert len(computed_plans) == 2


def test_the_file_is_readable_text(folder):
    plan = cached_plan(Options(), LENS, sampling())
    path, = (folder / "plans").iterdir()
    facts = json.loads(path.read_text().split("\n", 1)[1])
    assert facts["method"] == plan.method.name and facts["psf_radius_px"] == plan.psf_radius_px


def test_plans_are_cached_in_memory_without_a_folder(folder, computed_plans):
    folder.write_text("in the way")
    for _ in range(2):
        cached_plan(Options(), LENS, sampling())
    assert len(computed_plans) == 1


def test_the_memory_cache_is_limited(folder, computed_plans, monkeypatch):
    monkeypatch.setattr(plan_cache, "MOST_IN_PROCESS", 2)
    folder.write_text("in the way")
    for rows in (30, 31, 32, 32, 31, 30):
        cached_plan(Options(section_size=8), LENS, sampling(shape=(rows, 40)))
    assert len(computed_plans) == 4 and len(plan_cache._plans) == 2


def test_off_disables_the_memory_cache_too(computed_plans, monkeypatch):
    monkeypatch.setenv("LENSFIELD_CACHE", "off")
    for _ in range(2):
        cached_plan(Options(), LENS, sampling())
    assert len(computed_plans) == 2


def test_simulate_caches_plans_and_a_cold_run_does_not(folder, computed_plans, monkeypatch):
    calls = []
    monkeypatch.setattr(choose._Planner, "best", lambda self, best=choose._Planner.best: calls.append(1) or best(self))
    pictures = [simulate(picture(), LENS, cache=cache).cube
                for cache in (None, None, ChannelCache(), ChannelCache(limit_mb=0, cache_plans=False))]
    assert len(computed_plans) == 1 and len(calls) == 2
    for each in pictures[1:]:
        np.testing.assert_array_equal(each, pictures[0])


def test_seconds_of_a_cached_plan_reflect_the_current_speed(folder, monkeypatch):
    monkeypatch.setattr(choose.cost, "machine_factor", lambda: 1e3)
    slow = cached_plan(Options(), LENS, sampling())
    for forget in (lambda: None, forget_process):
        forget()
        monkeypatch.setattr(choose.cost, "machine_factor", lambda: 1.0)
        assert cached_plan(Options(), LENS, sampling()).seconds < slow.seconds / 100


def test_threads_can_share_the_cache(folder):
    shapes = [(rows, 40) for rows in range(30, 38)] * 4
    with ThreadPoolExecutor(8) as pool:
        plans = list(pool.map(lambda shape: cached_plan(Options(accuracy=0.1), LENS, sampling(shape)), shapes))
    assert plans == [make_plan(Options(accuracy=0.1), LENS, sampling(shape)) for shape in shapes[:8]] * 4
