"""Casting and filtering on graphics adapters, compared with C."""

import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from unittest import mock

import numpy as np
from cases import HD
from depth import CAST_LENS, FILM_MM, FOCUS, OVERSCAN_PX, cast_all, scene

from lensfield.engine import Lens, Options, SpectralImage, load_lens, simulate
from lensfield.engine.depth import cast as cast_module
from lensfield.engine.field import psf_table
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.kernels.cast_tiles import cast_tiles
from lensfield.engine.kernels.gpu import VARIABLE, Gpu, adapters
from lensfield.engine.kernels.gpu_calls import Buffers
from lensfield.engine.kernels.gpu_cast import gpu_cast
from lensfield.engine.kernels.gpu_spread import gpu_spread
from lensfield.engine.kernels.library import running
from lensfield.engine.kernels.spreading import spread
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.plan.options import TIER_ACCURACY
from lensfield.engine.runtime.threads import thread_pool

NM = 550.0
BANDS = 64  # of rows, filtered by threads of C


def gpu(height: int = HD[0]) -> Iterator[str]:
    """Seconds of casting and filtering by C and on each graphics adapter, and how much these differ from C.

    Casting: of the scene of `casting`, a group of 6 wavelengths, in the middle of the picture at this number of rows
    and 16:9. Filtering: of noise with lamps, one wavelength, by each accuracy of the tiers, without halos. For all
    threads of C, seconds; for an adapter the seconds of a first and a second time, and of the second one's uploads
    with their megabytes, calls, and read back; and the differences from C, relative to the brightest: mean and largest.
    """
    lens = load_lens(CAST_LENS, FOCUS, quality="preview")
    grid = PixelGrid.around_frame((height, height * 16 // 9), 1e3 * FILM_MM / HD[1], OVERSCAN_PX)
    cards = [Gpu(adapter) for adapter in adapters()]
    yield from _lines("casting", *_casting(lens, grid), cards)
    for tier, accuracy in TIER_ACCURACY.items():
        yield from _lines(f"filtering, {tier}", *_filtering(lens, grid, accuracy), cards)


def _casting(lens, grid):
    """Functions that return the pictures by C, and by an adapter."""
    castings, options = [], Options(accuracy=TIER_ACCURACY["standard"])
    with mock.patch.object(cast_module, "cast_tiles", lambda *given: castings.append(given) or iter(())):
        cast_all(scene(lens, grid), lens, grid, options, lens_rays(lens))
    casting, *planes = castings[0]
    lit = np.kron(casting.eights > 0, np.ones([casting.tile_px] * 2, bool))[:planes[0].shape[1], :planes[0].shape[2]]

    def cast(tiles):
        pictures = np.zeros_like(planes)
        for _ in tiles(casting, *pictures):
            pass
        return np.where(lit, pictures, 0)

    return partial(cast, cast_tiles), lambda card: cast(partial(gpu_cast, card))


def _filtering(lens: Lens, grid: PixelGrid, accuracy: float) -> tuple[Callable, Callable]:
    """As `_casting`."""
    light = np.random.default_rng(1).random((1, *grid.shape_px), np.float32)
    light[:, ::97, ::89] = 30  # too dim for halos
    spreadings: list[tuple] = []
    with mock.patch.object(psf_table, "spread_picture", lambda *given: spreadings.append(given)):
        simulate(SpectralImage(light, [NM], grid=grid), lens, Options(method="pixels", accuracy=accuracy))
    table, places, planes, lit, size = spreadings[0]

    rows, beyond = planes.shape[1], table.side_px - 1
    firsts = range(0, rows, -(-rows // BANDS))

    def of_band(first):
        return spread(table, places, planes, lit, size, slice(first, first + firsts.step))

    def by_c():
        picture = np.pad(np.zeros_like(planes), [(0, 0), (0, beyond), (0, beyond)])
        with thread_pool() as pool:
            for first, band in zip(firsts, pool.map(of_band, firsts), strict=True):
                picture[:, first:first + band.shape[1]] += band
        return picture

    return by_c, lambda card: gpu_spread(card, *spreadings[0])


def _lines(what, by_c, by_card, cards):
    with mock.patch.dict(os.environ, {VARIABLE: running()}):
        started = time.perf_counter()
        expected = by_c()
        yield f"{what} by C ({running()}): {time.perf_counter() - started:.3f} s"
    for card in cards:
        yield f"{what} by {card.name}: " + _on_card(partial(by_card, card), expected)


def _on_card(by_card, expected):
    seconds, spent = [], Counter()
    with ExitStack() as stack:
        for name, kind in (("put", "upload"), ("run", "calls"), ("read", "read back")):
            stack.enter_context(mock.patch.object(Buffers, name, _timed(getattr(Buffers, name), spent, kind)))
        for _ in range(2):
            spent.clear()
            started = time.perf_counter()
            pictures = by_card()
            seconds.append(time.perf_counter() - started)
    megabytes = spent.pop("MB")
    parts = ", ".join(f"{kind} {value:.3f}" for kind, value in spent.items())
    differences = np.abs(pictures - expected) / expected.max(axis=tuple(range(1, expected.ndim)), keepdims=True)
    return (f"{seconds[0]:.3f}, then {seconds[1]:.3f} s ({parts}; {megabytes:.1f} MB uploaded); "
            f"off by {differences.mean():.1e}, at most {differences.max():.1e}")


def _timed(function, spent, kind):
    """A function that adds the seconds of its calls to a sum, and the megabytes of its arrays."""
    def timed(*given, **named):
        started = time.perf_counter()
        result = function(*given, **named)
        spent[kind] += time.perf_counter() - started
        spent["MB"] += sum(each.nbytes for each in given if isinstance(each, np.ndarray)) / 1e6
        return result
    return timed
