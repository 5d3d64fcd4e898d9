"""What a lens image needs for any light, computed before the light is known."""

import numpy as np
import pytest

from lensfield.engine import ChannelCache, LensError, Options, SpectralImage, StrayOptions
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.sources import Sources
from lensfield.engine.library import rays
from lensfield.engine.simulation import channel_cache
from lensfield.engine.simulation.lens_image import lens_image
from lensfield.engine.simulation.prepare import Expected, preparation
from lensfield.engine.stray import arrivals, cells, ghost_nodes
from varied_lenses import varied_lens

NM = (450.0, 550.0, 650.0)
OPTIONS, ALL = Options(accuracy=0.05), StrayOptions("ghosts,veil,star")
LAMP = Sources(np.array([[0.0, -np.sin(0.7), np.cos(0.7)]]), np.array([900.0]), np.full((1, 3), 5.0), np.array(NM),
               np.array([0.01]), ("lamp",))
MEMOS = cells.transformed, arrivals.fields_in_cells, rays.lens_rays, ghost_nodes.ghost_nodes


@pytest.fixture
def lens():
    return varied_lens("tessar-50mm")


@pytest.fixture(autouse=True)
def empty_memos():
    for memo in MEMOS:
        memo.cache_clear()


def layers(lens):
    """A near square, out of focus, in front of a wall; the frame is neither square nor centred."""
    rng = np.random.default_rng(5)
    wall = Layer(rng.random((3, 40, 66)), np.ones((40, 66)), np.full((40, 66), 4e3))
    square = Layer(rng.random((3, 12, 10)), np.ones((12, 10)), np.full((12, 10), 700.0), (5, 30))
    grid = SpectralImage(wall.cube, NM, pitch_um=90.0, overscan_px=(2, 3), centre_px=(15.0, 37.0)).grid
    return LayeredRadiance((square, wall), NM, grid, lens.capture_focal_length_mm)


def expected(layered, needed_bytes=0.0):
    return Expected(layered.sampling, layered.flat().grid, 1, 1, True, LAMP, needed_bytes)


def through(lens, layered, cache):
    image, stray = lens_image(layered.flat(), lens, OPTIONS, ALL, layers=layered, outside=LAMP, cache=cache)
    return image.cube, stray.cube


def test_a_prepared_lens_image_is_the_same_and_nothing_is_computed_twice(lens, monkeypatch):
    layered, cache = layers(lens), ChannelCache()
    for _ in preparation(expected(layered), lens, OPTIONS, ALL, cache):
        pass
    misses = [memo.cache_info().misses for memo in MEMOS]
    assert all(misses)
    with monkeypatch.context() as patch:
        patch.setattr(channel_cache, "Channel", None)
        patch.setattr(ghost_nodes, "trace_everywhere", None)
        prepared = through(lens, layered, cache)
    assert [memo.cache_info().misses for memo in MEMOS] == misses
    for memo in MEMOS:
        memo.cache_clear()
    np.testing.assert_array_equal(prepared, through(lens, layered, ChannelCache()))


@pytest.mark.parametrize("steps", [1, 4, 20])
def test_preparation_may_end_at_any_step(lens, steps):
    layered, cache = layers(lens), ChannelCache()
    for _ in zip(range(steps), preparation(expected(layered), lens, OPTIONS, ALL, cache), strict=False):
        pass
    np.testing.assert_array_equal(through(lens, layered, cache), through(lens, layered, ChannelCache()))


@pytest.mark.parametrize("needed_bytes, limit_mb, channels", [(0.0, 1024, 3), (1e18, 1024, 0), (0.0, 1e12, 0),
                                                              (0.0, 0, 1)])
def test_channels_take_only_memory_that_the_render_leaves(lens, monkeypatch, needed_bytes, limit_mb, channels):
    """A cache without memory is not filled: one channel shows that it is."""
    new, cache, make = [], ChannelCache(limit_mb=limit_mb), channel_cache.Channel
    monkeypatch.setattr(channel_cache, "Channel", lambda *parts: new.append(1) or make(*parts))
    for _ in preparation(expected(layers(lens), needed_bytes), lens, OPTIONS, ALL, cache):
        pass
    assert len(new) == channels


def test_stray_light_that_is_predicted_to_be_faint_is_not_prepared(lens):
    """Of a picture without sources outside."""
    layered = layers(lens)
    of_picture = Expected(layered.sampling, layered.flat().grid, 1, 1, False, None, 0.0)
    for _ in preparation(of_picture, lens, Options(accuracy=0.09), StrayOptions(), ChannelCache()):
        pass
    assert not any(memo.cache_info().misses for memo in MEMOS)


def test_errors_are_those_of_the_lens_image(lens):
    beyond = Expected(SpectralImage(np.ones((1, 20, 30)), [2000.0], pitch_um=50.0).sampling, layers(lens).grid, 1, 1,
                      False, None, 0.0)
    with pytest.raises(LensError, match="2000"):
        list(preparation(beyond, lens, OPTIONS, StrayOptions("off"), ChannelCache()))
