"""Spreading on a graphics processor: compared with C, replaced by C, and its cached tables."""

import gc

import numpy as np
import pytest

from gpus import loops, warns
from lenses import comatic_lens, make_grid_lens
from lensfield.engine import ChannelCache, Options, Report, SpectralImage, simulate
from lensfield.engine.kernels import gpu as gpu_module
from lensfield.engine.kernels import gpu_calls as gpu_calls_module
from lensfield.engine.kernels import gpu_spread as gpu_spread_module
from lensfield.engine.kernels import spread_picture as spread_picture_module
from lensfield.engine.kernels.gpu_calls import Buffers, CachedBuffers, cached_buffers
from lensfield.engine.kernels.library import caster
from lensfield.engine.kernels.sample_spreading import sample_spreading
from lensfield.engine.kernels.spread_picture import spread_picture
from lensfield.engine.kernels.spreading import spread
from lensfield.engine.simulation.report import together

AGREEMENT = 2e-6
"""Of the brightest pixel, and of all light; a tenth of the finest accuracy, 0.1 %, is fifty times as much."""
KINDS = [(planes, cells) for planes in (1, 4) for cells in (False, True)]


def by_gpu(sample):
    picture, name = spread_picture(*sample)
    assert name == caster()
    return picture


def by_c(sample):
    return spread(*sample, slice(None))


@pytest.mark.parametrize("planes, cells", KINDS)
def test_samples_agree_with_c_and_have_the_same_bits_twice(gpu, planes, cells):
    sample = sample_spreading(planes, cells)
    once, again, expected = by_gpu(sample), by_gpu(sample), by_c(sample)
    assert np.array_equal(once, again) and not np.array_equal(once, expected)
    np.testing.assert_allclose(once, expected, rtol=0, atol=AGREEMENT * expected.max())
    assert np.abs(once - expected).sum() <= AGREEMENT * expected.sum()


def marked_grid_lens():
    def psf(x, y):
        square = np.zeros((21, 21))
        square[10, 10], square[10 - round(3 * y), 10 + round(4 * x)], square[4, 13] = 5, 3, 1
        return square / square.sum()

    return make_grid_lens(psf, psf_pitch_um=20.0, mirrored=(True, False))


@pytest.mark.parametrize("accuracy", [0.1, 0.01, 0.001])
@pytest.mark.parametrize("lens", [comatic_lens(), marked_grid_lens()], ids=["heights", "cells"])
@pytest.mark.parametrize("centre_px", [None, (13.3, 30.9)])
def test_pictures_with_lamps_agree_with_c(gpu, lens, accuracy, centre_px):
    """Also with halos, which lamps have at a low accuracy."""
    light = np.random.default_rng(2).random((2, 45, 62))
    light[:, 9, 7] = light[:, 30, 50] = 1e4
    radiance = SpectralImage(light, [450.0, 610.0], pitch_um=20.0, centre_px=centre_px)
    options, report = Options(method="pixels", accuracy=accuracy), Report()
    picture = simulate(radiance, lens, options, report=report).cube
    with loops():
        expected = simulate(radiance, lens, options).cube
    assert report.lens_image.spreading == gpu.name and not np.array_equal(picture, expected)
    for one, other in zip(picture, expected, strict=True):
        assert np.abs(one - other).sum() <= AGREEMENT * other.sum()
        np.testing.assert_allclose(one, other, rtol=0, atol=AGREEMENT * other.max())


def test_neither_calls_nor_their_rows_of_psfs_change_the_bits(gpu, monkeypatch):
    sample, runs, run = sample_spreading(4, False), [], Buffers.run
    expected = by_gpu(sample)
    monkeypatch.setattr(gpu, "rate", 1.0)  # a row of workgroups in a call
    monkeypatch.setattr(gpu_module, "FASTER", 1.0)
    monkeypatch.setattr(gpu_spread_module, "MOST_LOOPS", 1)  # a row of the PSFs' square
    monkeypatch.setattr(gpu_calls_module, "PIECE_BYTES", 1000)
    monkeypatch.setattr(Buffers, "run", lambda *given: runs.append(given) or run(*given))
    assert np.array_equal(by_gpu(sample), expected)
    assert len(runs) == 1 + sample[0].side_px * -(-expected.shape[1] // gpu_spread_module.TALL)


def test_light_that_needs_little_work_is_left_to_c(gpu, monkeypatch):
    table, places, light, lit, size = sample_spreading(1, False)
    taps = table.taps_by_interval.mean() * np.count_nonzero(lit) * size**2
    limits = {"LEAST_TAPS": taps, "TAPS_PER_BYTE": taps / (2 * light.nbytes + table.nbytes)}
    for name, limit in limits.items():
        monkeypatch.setattr(spread_picture_module, name, 0.9999 * limit)
    assert spread_picture(table, places, light, lit, size)
    monkeypatch.setattr(spread_picture_module, "usable_gpu", lambda: pytest.fail("opens it"))
    for name, limit in limits.items():
        with monkeypatch.context() as changed:
            changed.setattr(spread_picture_module, name, 1.0001 * limit)
            assert spread_picture(table, places, light, lit, size) is None


def test_a_shader_that_disagrees_with_c_is_not_used(gpu, monkeypatch):
    monkeypatch.setattr(gpu, "pipelines", {})
    monkeypatch.setattr(gpu_calls_module, "AGREEMENT", 0.0)
    with warns(gpu, "differently from C"):
        assert spread_picture(*sample_spreading(1, False)) is None
    assert spread_picture(*sample_spreading(4, True)) is None and caster() == "C"


def test_a_driver_that_fails_during_a_picture_loses_nothing(gpu, monkeypatch):
    radiance, lens = SpectralImage(np.random.default_rng(3).random((2, 30, 40)), [450.0, 610.0], pitch_um=20.0), \
        comatic_lens()
    options, run, calls, report = Options(method="pixels", accuracy=0.01), Buffers.run, [], Report()
    with loops():
        expected = simulate(radiance, lens, options).cube
    simulate(radiance, lens, options)  # compiles

    def failing(*given):
        calls.append(given)
        if len(calls) > 1:
            raise RuntimeError("Device lost")
        return run(*given)

    monkeypatch.setattr(Buffers, "run", failing)
    with warns(gpu, "Device lost"):
        assert np.array_equal(simulate(radiance, lens, options, report=report).cube, expected)
    assert report.lens_image.spreading == "C"
    assert report.lens_image.gpu_problems == (f"{gpu.name}: Device lost: C is used instead",)
    assert len(calls) == 2  # the second wavelength did not try again


def test_light_above_the_limits_is_spread_by_c(gpu, monkeypatch):
    sample = sample_spreading(1, True)
    expected = by_gpu(sample)
    monkeypatch.setattr(gpu, "limit_bytes", 2_000)
    with warns(gpu, "MB"):
        assert spread_picture(*sample) is None
    monkeypatch.undo()
    monkeypatch.setenv(gpu_module.VARIABLE, gpu_module.GPU)
    monkeypatch.setattr(spread_picture_module, "LEAST_TAPS", 0)
    monkeypatch.setattr(spread_picture_module, "TAPS_PER_BYTE", 0)
    assert np.array_equal(by_gpu(sample), expected)


@pytest.fixture
def uploaded(monkeypatch):
    """Sizes of the arrays that are uploaded."""
    sizes, put = [], Buffers.put

    def recorded(buffers, binding, *arrays, **usage):
        sizes.extend(array.nbytes for array in arrays)
        return put(buffers, binding, *arrays, **usage)

    monkeypatch.setattr(Buffers, "put", recorded)
    return sizes


def test_the_next_frame_uploads_its_light_alone(gpu, uploaded):
    lens, cache, sizes = comatic_lens(), ChannelCache(), []
    for seed in (0, 1):
        light = np.random.default_rng(seed).random((1, 40, 50))
        radiance = SpectralImage(light, [550.0], pitch_um=10.0, centre_px=(11.2, 33.0))
        uploaded.clear()
        simulate(radiance, lens, Options(method="pixels", accuracy=0.001), cache=cache)
        sizes.append(sorted(uploaded))
    first, second = sizes
    assert len(first) == len(second) + 3 and sum(first) > 5 * sum(second)  # without taps, intervals and spans


def test_tables_of_psfs_leave_the_memory_with_their_lens(gpu):
    cached = cached_buffers(gpu)
    gpu.call(cached.close)
    sample = sample_spreading(1, False)
    by_gpu(sample)
    held = len(cached._cached)
    del sample
    gc.collect()
    by_gpu(sample_spreading(1, True))
    assert held == len(cached._cached) == 1


class Stub:
    nbytes = 40

    def __init__(self):
        self.closed = False

    def close(self):
        self.closed = True


class Owner:
    pass


def test_cached_buffers_are_the_last_used_ones_up_to_a_limit():
    cached, owners, stubs = CachedBuffers(100), [Owner() for _ in range(4)], [Stub() for _ in range(4)]

    def used(n):
        return cached.of(owners[n], "kind", lambda: stubs[n])

    for n in (0, 1, 0):
        with used(n) as buffers:
            assert buffers is stubs[n]
    with used(2):
        assert [stub.closed for stub in stubs] == [False, True, False, False]
        with used(0), used(3):  # all are in use, beyond the limit
            assert not any(stubs[n].closed for n in (0, 2, 3))
    cached.close()
    assert all(stub.closed for stub in stubs)


def test_buffers_of_another_kind_or_object_are_others():
    cached, owner = CachedBuffers(1000), Owner()
    made = []
    for each, kind in ((owner, 1), (owner, 2), (Owner(), 1), (owner, 1)):
        with cached.of(each, kind, lambda: made.append(Stub()) or made[-1]):
            pass
    assert len(made) == 3


def test_sequences_report_frames_of_different_devices(gpu):
    lens, options = comatic_lens(), Options(method="pixels", accuracy=0.01)
    radiance, first, second = SpectralImage(np.ones((1, 20, 20)), [550.0], pitch_um=20.0), Report(), Report()
    simulate(radiance, lens, options, report=first)
    with loops():
        simulate(radiance, lens, options, report=second)
    line = f"frames were filtered by {gpu.name} (2), C (1): they differ by rounding"
    assert line in together({1: first, 2: second}, {3: first.as_dict()}).remarks()
    assert line not in together({1: first}, {3: first.as_dict()}).remarks()
