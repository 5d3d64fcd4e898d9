"""Overlap-add with spreaders whose patches can be written down by hand."""

import threading

import numpy as np
import pytest

from lensfield.engine.blur.method import Spreader
from lensfield.engine.blur.overlap_add import overlap_add
from lensfield.engine.blur.section_needs import SectionNeeds

RADIUS = 2


def all_lit(shape, size, double=False):
    sections = tuple(-(-n // size) for n in shape)
    lit = np.ones(sections, dtype=bool)
    return SectionNeeds(lit, lit & double, ~lit)


class Stamps(Spreader):
    """Spreads every pixel by the same stamp, in plain loops, and records its calls."""

    def __init__(self, section_size, stamp, extra_px=0):
        self.section_size, self.radius_px = section_size, len(stamp) // 2
        self.space_px = section_size + 2 * self.radius_px + extra_px
        self._stamp, self._lock = stamp, threading.Lock()
        self.prepared, self.calls = [], []

    def prepare(self, rows, needs, pool):
        self.prepared.extend(int(i) for i in rows)

    def spread(self, i, columns, band):
        assert i in self.prepared
        size, reach = self.section_size, self.section_size + 2 * self.radius_px
        for j in columns:
            with self._lock:
                self.calls.append((int(i), int(j), band.dtype.type))
            light = band[:, :, j * size:(j + 1) * size]
            patch = np.zeros((len(band), reach, reach), band.dtype)
            for row, column in np.ndindex(self._stamp.shape):
                patch[:, row:row + size, column:column + size] += light * band.dtype.type(self._stamp[row, column])
            yield j * size, patch


def stamp(radius=RADIUS):
    weights = np.random.default_rng(1).random((2 * radius + 1, 2 * radius + 1))
    return weights / weights.sum()


POINT = np.ones((1, 1))


def spread_by_hand(planes, weights):
    rows, columns = planes.shape[1:]
    canvas = np.zeros((len(planes), rows + len(weights) - 1, columns + len(weights) - 1))
    for row, column in np.ndindex(weights.shape):
        canvas[:, row:row + rows, column:column + columns] += planes * weights[row, column]
    return canvas


def noise(shape):
    return np.random.default_rng(0).random(shape)


@pytest.mark.parametrize("shape", [(1, 1), (5, 5), (10, 15), (11, 14), (3, 40), (40, 3)])
@pytest.mark.parametrize("section_size", [1, 5, 7, 64])
def test_a_point_stamp_returns_the_planes_unchanged(section_size, shape):
    planes = noise((2, *shape))
    result = overlap_add(planes, Stamps(section_size, POINT), all_lit(shape, section_size, True))
    np.testing.assert_array_equal(result, planes)


@pytest.mark.parametrize("radius", [1, 4])
@pytest.mark.parametrize("shape", [(1, 1), (5, 5), (10, 15), (11, 14), (3, 20)])
@pytest.mark.parametrize("section_size", [1, 5, 7, 64])
def test_patches_are_summed_at_their_positions(section_size, shape, radius):
    planes, weights = noise((3, *shape)), stamp(radius)
    result = overlap_add(planes, Stamps(section_size, weights), all_lit(shape, section_size, True))
    np.testing.assert_allclose(result, spread_by_hand(planes, weights), atol=1e-14)


def test_patches_may_be_smaller_than_their_fft_space():
    planes, weights = noise((1, 12, 17)), stamp()
    spreader = Stamps(5, weights, extra_px=11)
    np.testing.assert_allclose(overlap_add(planes, spreader, all_lit((12, 17), 5, True)),
                               spread_by_hand(planes, weights), atol=1e-14)


def test_lit_sections_are_spread_once_and_black_ones_never():
    needs = all_lit((20, 30), 5, True)
    needs.lit[1, 2] = needs.lit[3, :] = needs.double[1, 2] = needs.double[3, :] = False
    planes = noise((1, 20, 30))
    spreader = Stamps(5, POINT)
    result = overlap_add(planes, spreader, needs)
    lit = {(int(i), int(j)) for i, j in np.argwhere(needs.lit)}
    assert sorted(place[:2] for place in spreader.calls) == sorted(lit)
    expected = planes.copy()
    expected[:, 5:10, 10:15], expected[:, 15:] = 0, 0
    np.testing.assert_array_equal(result, expected)


def test_rows_without_light_are_not_prepared():
    needs = all_lit((20, 30), 5, True)
    needs.lit[1], needs.double[1] = False, False
    spreader = Stamps(5, POINT)
    overlap_add(noise((1, 20, 30)), spreader, needs)
    assert spreader.prepared == [0, 2, 3]


def test_a_black_picture_stays_black_without_any_work():
    needs, spreader = all_lit((20, 30), 5), Stamps(5, stamp())
    needs.lit[:] = False
    assert not overlap_add(np.zeros((1, 20, 30)), spreader, needs).any()
    assert not spreader.prepared and not spreader.calls


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_sections_use_their_required_precision_and_sums_that_of_the_planes(kind):
    needs = all_lit((10, 15), 5)
    needs.double[0, 1] = needs.double[1, 2] = True
    spreader = Stamps(5, stamp())
    result = overlap_add(noise((1, 10, 15)).astype(kind), spreader, needs)
    precisions = {(i, j): precision for i, j, precision in spreader.calls}
    assert {place for place, precision in precisions.items() if precision == np.float64} == {(0, 1), (1, 2)}
    assert set(precisions.values()) == {np.float32, np.float64} and len(precisions) == 6
    assert result.dtype == kind


def test_double_precision_sections_are_as_exact_as_the_planes():
    planes, weights = noise((1, 10, 15)), stamp()
    truth = spread_by_hand(planes, weights)
    double, single = (np.abs(overlap_add(planes, Stamps(5, weights), all_lit((10, 15), 5, double)) - truth).max()
                      for double in (True, False))
    assert double < 1e-15 < 1e-9 < single < 1e-6


def test_the_input_planes_are_not_modified():
    planes = noise((2, 12, 13))
    before = planes.copy()
    overlap_add(planes, Stamps(5, stamp()), all_lit((12, 13), 5))
    np.testing.assert_array_equal(planes, before)


def test_the_sum_is_bit_identical_with_any_number_of_threads(monkeypatch):
    planes = noise((4, 33, 47)).astype(np.float32)
    results = []
    for threads in (1, 2, 3, 8):
        monkeypatch.setattr("lensfield.engine.runtime.threads.thread_count", lambda threads=threads: threads)
        results.append(overlap_add(planes, Stamps(5, stamp(4)), all_lit((33, 47), 5)))
    for result in results[1:]:
        np.testing.assert_array_equal(result, results[0])


def test_an_error_in_a_section_is_not_swallowed():
    class Broken(Stamps):
        def spread(self, i, columns, band):
            raise ArithmeticError("section")

    with pytest.raises(ArithmeticError, match="section"):
        overlap_add(noise((1, 10, 15)), Broken(5, POINT), all_lit((10, 15), 5))
