"""Levels of layers on a graphics processor: against numpy, and the planes that stay there for later pictures."""

import gc
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from gpus import loops
from lensfield.engine.depth.levels import KINDS
from lensfield.engine.kernels import casting as casting_module
from lensfield.engine.kernels import gpu as gpu_module
from lensfield.engine.kernels import gpu_levels as gpu_levels_module
from lensfield.engine.kernels.cast_tiles import cast_tiles
from lensfield.engine.kernels.gpu_calls import Buffers, cached_buffers
from lensfield.engine.kernels.gpu_levels import SOURCE, Stack, level_place, make_levels
from lensfield.engine.kernels.levels import LayerPlanes, Nearer, numpy_levels
from lensfield.engine.kernels.sample_casting import sample_casting

AGREEMENT = 1e-6  # of the brightest pixel
CAPTURE_PX = 61, 70
ENDS = (False, False), (False, False)
ON = (True, True), (True, True)
CASES = {  # rows and columns, first row and column, and sides at which the last pixels continue
    "inside": ((40, 50), (3, 5), ENDS),
    "all of the capture": (CAPTURE_PX, (0, 0), ON),
    "its upper part": ((33, 70), (0, 0), ((True, False), (True, True))),
    "its right part": ((61, 21), (0, 49), ((True, True), (False, True))),
    "one row": ((1, 30), (0, 4), ((True, False), (False, False))),
    "one pixel": ((1, 1), (7, 9), ENDS)}


def layer_of(case, hidden=False, **changes):
    shape, origin_px, sides = CASES[case]
    random = np.random.default_rng(4)
    alpha = (random.random(shape) * (random.random(shape) < 0.8)).astype(np.float32)
    light = (100 * random.random((2, *shape)) ** 6 * alpha).astype(np.float32)
    cover = random.random(CAPTURE_PX) * (random.random(CAPTURE_PX) < 0.4)
    apart_px = (2 + 40 * random.random(CAPTURE_PX)).astype(np.float32)
    nearer = Nearer(cover.astype(np.float32), apart_px, float(apart_px.min()))  # sharp levels hide none
    layer = LayerPlanes(light, alpha, 1.0, True, origin_px, (20.3, 31.8), sides, KINDS[1:], nearer if hidden else None)
    return replace(layer, **changes)


def by_gpu(gpu, layer, left_out=()):
    """The levels as arrays (plane, row, column), by their numbers."""
    def work():
        with closing(Buffers(gpu)) as buffers:
            stacks = {}
            for n, kind in enumerate((None, *layer.coarser)):
                if n not in left_out:
                    first, shape = level_place(layer.place, kind) if kind else (
                        layer.origin_px, tuple(max(2, n) for n in layer.alpha.shape))
                    buffers.make(n, 4 * 3 * shape[0] * shape[1])
                    stacks[n] = Stack(buffers[n], 0, first, (3, *shape))
            make_levels(gpu, layer, stacks)
            return {n: buffers.read(n).reshape(stack.shape) for n, stack in stacks.items()}
    return gpu.call(work)


def check_like_numpy(gpu, layer):
    once, again, expected = by_gpu(gpu, layer), by_gpu(gpu, layer), numpy_levels(layer)
    assert len(once) == len(expected)
    for n, level in enumerate(expected):
        assert np.array_equal(once[n], again[n])
        np.testing.assert_allclose(once[n][:-1], level.light, rtol=0, atol=AGREEMENT * level.light.max())
        np.testing.assert_allclose(once[n][-1], level.alpha, rtol=0, atol=AGREEMENT)


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_levels_agree_with_numpy(gpu, case, hidden):
    check_like_numpy(gpu, layer_of(case, hidden))


def test_bright_light_is_dimmed_and_light_in_focus_is_not_sharpened(gpu):
    check_like_numpy(gpu, layer_of("inside", scale=2.0**-40, sharp=False))


def test_only_some_levels_are_made(gpu):
    layer = layer_of("inside", hidden=True)
    every, some = by_gpu(gpu, layer), by_gpu(gpu, layer, left_out=(0, 1, 3, 5, 11))
    assert some.keys() < every.keys() and all(np.array_equal(every[n], level) for n, level in some.items())


def test_levels_that_nearer_layers_cannot_hide_are_made_once(gpu, monkeypatch):
    layer, kinds = layer_of("inside", hidden=True), []
    monkeypatch.setattr(gpu_levels_module._Work, "leave_out_hidden", lambda *given: kinds.append(given[-2]))
    by_gpu(gpu, layer)
    assert kinds == [kind for kind in layer.coarser if kind.near_px >= layer.nearer.closest_px]
    assert 0 < len(kinds) < len(layer.coarser)


def test_parts_of_passes_do_not_change_the_bits(gpu, monkeypatch):
    layer, sizes, submit = layer_of("inside", hidden=True), [], gpu_levels_module.submit
    expected = by_gpu(gpu, layer)
    monkeypatch.setattr(gpu, "rate", 1.0)  # a row of workgroups in a call
    monkeypatch.setattr(gpu_levels_module, "submit", lambda gpu, passes: (
        sizes.append([groups[1] for *_, groups in passes]), submit(gpu, passes)))
    levels = by_gpu(gpu, layer)
    assert set(map(tuple, sizes)) == {(1,)} and all(np.array_equal(expected[n], levels[n]) for n in expected)


@pytest.fixture
def uploaded(monkeypatch):
    """The arrays of layers that are uploaded."""
    arrays, put = [], Buffers.put

    def recorded(buffers, binding, *given, **usage):
        if binding == SOURCE and given[0].ndim == 3:
            arrays.append(given)
        return put(buffers, binding, *given, **usage)

    monkeypatch.setattr(Buffers, "put", recorded)
    return arrays


def pictures(casting):
    planes = np.zeros((2, 2, 30, 45), np.float32)
    list(cast_tiles(casting, *planes))
    return planes


def test_layers_are_uploaded_once_while_they_exist_and_stay_the_same(gpu, uploaded):
    pictures(sample_casting(2, False))  # compiles
    uploaded.clear()
    casting = sample_casting(2, False)
    count = len(casting.layers)
    first = pictures(casting)
    assert len(uploaded) == count
    assert np.array_equal(pictures(casting), first) and len(uploaded) == count
    del casting
    uploaded.clear()
    gc.collect()
    gpu.call(cached_buffers(gpu)._close_unneeded, np.inf)
    assert not cached_buffers(gpu)._cached


def test_numpy_makes_no_levels_for_the_graphics_processor(gpu, monkeypatch):
    pictures(sample_casting(2, False))  # compiles, and compares with C
    monkeypatch.setattr(casting_module, "numpy_levels", lambda planes: pytest.fail("makes levels"))
    assert pictures(sample_casting(2, False)).any()


@pytest.mark.parametrize("change", [lambda light: 2 * light, lambda light: light[:, ::-1], lambda light: light[::-1],
                                    lambda light: light + (np.arange(light.size).reshape(light.shape) == 999)])
def test_layers_are_uploaded_again_after_a_change_in_place(gpu, uploaded, change):
    casting = sample_casting(2, False)
    before, light = pictures(casting), casting.layers[1].planes.light
    uploaded.clear()
    light[:] = change(light).copy()
    changed = pictures(casting)
    assert len(uploaded) == 1 and not np.array_equal(changed, before)
    with loops():
        np.testing.assert_allclose(changed, pictures(fresh(casting)), rtol=0, atol=1e-4 * changed.max())


def fresh(casting):
    """The casting without levels made before."""
    return replace(casting, layers=tuple(replace(layer) for layer in casting.layers))


def test_views_of_the_same_capture_share_its_planes(gpu, uploaded):
    casting = sample_casting(2, False)
    pictures(casting)
    count = len(uploaded)
    pictures(replace(casting, layers=tuple(
        replace(layer, planes=replace(layer.planes, light=layer.planes.light[:])) for layer in casting.layers)))
    assert len(uploaded) == count
    pictures(replace(casting, layers=tuple(
        replace(layer, planes=replace(layer.planes, light=layer.planes.light.copy())) for layer in casting.layers)))
    assert len(uploaded) == 2 * count


def test_c_casts_after_an_error_while_levels_are_made(gpu, monkeypatch):
    expected_by = fresh(sample_casting(2, True))
    with loops():
        expected = pictures(expected_by)
    pictures(sample_casting(2, True))  # compiles
    monkeypatch.setattr(gpu_module, "_problems", [])

    def fails(*given):
        raise RuntimeError("Device lost")

    monkeypatch.setattr(Buffers, "run", fails)
    with pytest.warns(RuntimeWarning, match="Device lost: C is used instead"):
        assert np.array_equal(pictures(sample_casting(2, True)), expected)
