"""Caching between frames saves time, and never changes a picture."""

import gc
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from lenses import comatic_lens, gaussian_psf, lopsided_lens, make_lens
from lensfield.engine import ChannelCache, Options, SpectralImage, blur, load_lens, simulate
from lensfield.engine.field.radial.distortion import FieldGeometry
from lensfield.engine.field.radial.psf_bank import PsfBank
from lensfield.engine.image.projection import FISHEYE
from lensfield.engine.runtime.memory import MemoryBudget

METHODS = {name: Options(method=name) for name in blur.METHODS} | {
    "sections": Options(section_size=8, azimuths=6), "double": Options(section_size=8, precision="float64"),
    "flat": Options(section_size=8, flat_tolerance=1e-3), "pixels": Options(method="pixels", azimuths=6),
    "accuracy": Options(accuracy=0.05)}
LENS, LOPSIDED = comatic_lens(), lopsided_lens()
NM = (450.0, 600.0)


def frame(seed=0, shape=(14, 19), wavelengths_nm=NM, pitch_um=20.0, **facts):
    cube = np.random.default_rng(seed).random((len(wavelengths_nm), *shape))
    return SpectralImage(cube, wavelengths_nm, pitch_um=pitch_um, **facts)


def check(radiance, lens, options, cache):
    """Checks that a picture is bit for bit the same as without the cache."""
    np.testing.assert_array_equal(simulate(radiance, lens, options, cache=cache).cube,
                                  simulate(radiance, lens, options).cube)


@pytest.mark.parametrize("method, lens", [*((method, LENS) for method in METHODS), ("sections", LOPSIDED),
                                          ("pixels", LOPSIDED), ("paper", LOPSIDED)])
def test_every_frame_equals_the_frame_without_a_cache(method, lens):
    cache = ChannelCache()
    for seed in (0, 1, 0):
        check(frame(seed), lens, METHODS[method], cache)


@pytest.mark.parametrize("method", METHODS)
def test_frames_lit_in_different_places_equal_frames_without_a_cache(method):
    cache = ChannelCache()
    for place in (slice(0, 5), slice(8, 14), slice(0, 14), slice(5, 6)):
        radiance = frame()
        radiance.cube[:, place] = 0
        radiance.cube[1] *= 1e5 if place.start else 1  # changes which sections need double precision
        radiance.cube[1, 7, 13] = 1e9
        check(radiance, LENS, METHODS[method], cache)


@pytest.mark.parametrize("limit_mb", [0, 1e-6, 0.05])
@pytest.mark.parametrize("method", ["sections", "pixels"])
def test_little_or_no_memory_gives_the_same_pictures(method, limit_mb):
    cache = ChannelCache(limit_mb=limit_mb)
    for seed in (0, 1, 2):
        check(frame(seed), LENS, METHODS[method], cache)


@pytest.mark.parametrize("method", ["sections", "pixels"])
def test_any_change_of_the_radiance_is_detected(method):
    cache, options = ChannelCache(), METHODS[method]
    for radiance in (frame(), frame(shape=(15, 19)), frame(shape=(14, 18)), frame(pitch_um=25.0),
                     frame(centre_px=(10.0, 20.0)), frame(centre_px=(10.0, 21.0)), frame(overscan_px=(3, 4)),
                     frame(overscan_px=(4, 3)), frame(projection=FISHEYE), frame(wavelengths_nm=(450.0,)),
                     frame(wavelengths_nm=(430.0, 600.0)), frame()):
        check(radiance, LENS, options, cache)


@pytest.mark.parametrize("method", ["sections", "pixels"])
def test_another_lens_of_the_same_name_is_not_mistaken_for_the_first(method):
    cache, options = ChannelCache(), METHODS[method]
    other = replace(LENS, f_number_effective=4.0)
    blurred = make_lens(gaussian_psf(6, 6, 2.5, 25), heights_mm=LENS.heights_mm)
    for lens in (LENS, other, blurred, LOPSIDED, LENS):
        check(frame(), lens, options, cache)


def test_another_plan_is_not_mistaken_for_the_first():
    cache = ChannelCache()
    changes = ({}, {"out_of_field": "vignette"}, {"section_size": 9}, {"azimuths": 7}, {"precision": "float64"},
               {"psf_energy": 0.9}, {"method": "paper"}, {"method": "paper", "section_size": 9})
    for options in (*METHODS.values(), *(Options(**{"section_size": 8} | change) for change in changes)):
        check(frame(pitch_um=100.0), LENS, options, cache)


def test_fireflies_do_not_carry_over_to_the_next_frame():
    cache, options = ChannelCache(), Options(section_size=8, fireflies="clamp")
    for seed in (0, 1):
        radiance = frame(seed)
        radiance.cube[seed, 4, 5] = np.nan
        check(radiance, LENS, options, cache)


@pytest.fixture
def computations(monkeypatch):
    """Counts computations from the lens data: PSFs, and fits of the field."""
    counts = {"psfs": 0, "fields": 0}

    def counted(kind, name, what):
        original = getattr(kind, name)

        def call(*args, **how):
            counts[what] += 1
            return original(*args, **how)

        monkeypatch.setattr(kind, name, call)

    counted(PsfBank, "psfs", "psfs")
    counted(PsfBank, "at_table_heights", "psfs")
    counted(FieldGeometry, "__init__", "fields")
    return counts


@pytest.mark.parametrize("method", ["sections", "double", "pixels", "paper"])
def test_the_second_frame_computes_no_psfs_and_no_fits(method, computations):
    cache = ChannelCache()
    simulate(frame(0), LENS, METHODS[method], cache=cache)
    assert computations["psfs"] > 0 and computations["fields"] > 0
    computations.update(psfs=0, fields=0)
    simulate(frame(1), LENS, METHODS[method], cache=cache)
    assert computations == {"psfs": 0, "fields": 0}


def test_a_reloaded_lens_matches_the_cached_one(computations):
    cache = ChannelCache()
    simulate(frame(0), LENS, METHODS["sections"], cache=cache)
    computations.update(psfs=0, fields=0)
    simulate(frame(1), replace(LENS), METHODS["sections"], cache=cache)
    assert computations == {"psfs": 0, "fields": 0}


@pytest.mark.parametrize("method", ["sections", "pixels"])
def test_without_memory_everything_is_recomputed(method, computations):
    cache = ChannelCache(limit_mb=0)
    simulate(frame(0), LENS, METHODS[method], cache=cache)
    first = dict(computations)
    computations.update(psfs=0, fields=0)
    simulate(frame(1), LENS, METHODS[method], cache=cache)
    assert computations["fields"] >= len(NM) and first["fields"] >= computations["fields"]


@pytest.fixture
def taken(monkeypatch):
    """The blocks of memory that the cache retains."""
    pieces = []
    take = MemoryBudget.take

    def counted(self, size_bytes):
        given = take(self, size_bytes)
        pieces.append(size_bytes if given else 0)
        return given

    monkeypatch.setattr(MemoryBudget, "take", counted)
    return pieces


def test_with_little_memory_part_is_cached_and_part_recomputed(computations, taken):
    unlimited = ChannelCache()
    simulate(frame(0), LENS, METHODS["sections"], cache=unlimited)
    limited = ChannelCache(limit_mb=sum(taken) * 0.5e-6)
    for each in (unlimited, limited):
        simulate(frame(0), LENS, METHODS["sections"], cache=each)
    computations.update(psfs=0, fields=0)
    simulate(frame(1), LENS, METHODS["sections"], cache=limited)
    assert computations["fields"] + computations["psfs"] > 0
    computations.update(psfs=0, fields=0)
    simulate(frame(1), LENS, METHODS["sections"], cache=unlimited)
    assert computations["fields"] + computations["psfs"] == 0


@pytest.mark.parametrize("size, taken", [(6, [True, False, True, False]), (10, [True, True, True, False]),
                                         (3, [False, False, True, False]), (0, [False] * 4)])
def test_memory_is_granted_until_it_runs_out(size, taken):
    memory = MemoryBudget(size)
    assert [memory.take(piece) for piece in (5, 4, 1, 3)] == taken


@pytest.mark.parametrize("method", ["sections", "double", "pixels", "paper"])
@pytest.mark.parametrize("limit_mb", [0, 0.2, 1])
def test_the_cache_stays_within_its_limit_over_many_frames(method, limit_mb, taken):
    """Light that moves over the picture lights different sections in each frame."""
    cache = ChannelCache(limit_mb=limit_mb)
    options = Options(method="pixels", azimuths=2) if method == "pixels" else METHODS[method]
    for start in range(0, 60, 15):
        radiance = frame(shape=(14, 60), wavelengths_nm=(500.0, 600.0))
        radiance.cube[:, :, :start] = 0
        radiance.cube[:, :, start + 20:] = 0
        simulate(radiance, LENS, options, cache=cache)
    assert sum(taken) <= limit_mb * 1e6
    assert limit_mb == 0 or sum(taken) > 0


def test_a_cache_without_memory_holds_next_to_nothing():
    """Including tables of PSFs, which channels do not count."""
    lens = load_lens("edmund-54852")
    radiance = frame(shape=(60, 80), wavelengths_nm=(450.0, 500.0, 550.0, 600.0), pitch_um=6.25)
    cache = ChannelCache(limit_mb=0)
    simulate(radiance, lens, Options(method="pixels", azimuths=32), cache=cache)  # loads modules and fills caches
    tracemalloc.start()
    try:
        simulate(radiance, lens, Options(method="pixels", azimuths=33), cache=cache)
        gc.collect()
        held, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 1e6 < peak


def test_the_memory_of_channels_is_counted(taken):
    """Footprints, PSFs and tables; all other data are as small as a few curves."""
    cache, radiance = ChannelCache(), frame(shape=(240, 320), wavelengths_nm=(450.0,), pitch_um=10.0)
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        simulate(radiance, LENS, METHODS["pixels"], cache=cache)
        gc.collect()
        held = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert 0.8 * held < sum(taken) < 1.2 * held
