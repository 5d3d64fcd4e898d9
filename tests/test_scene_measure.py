"""The measure of ordinary scenes lets noise pass, and nothing else."""

import numpy as np
import pytest

from scene_measure import Limits, compare
from seed import SEED

SHAPE = 40, 56
MARKS = {"Mark 1": (11.3, 14.6), "Mark 2": (27.8, 40.2)}
NOISE = 0.02


def light(shift_px=(0.0, 0.0)):
    """A gradient with a tint and two small lamps: array (4, row, column)."""
    row, column = np.indices(SHAPE, dtype=float)
    planes = np.stack([0.3 + row / 200, 0.4 + column / 300, 0.5 - row / 250, np.ones(SHAPE)])
    for place in MARKS.values():
        away = np.hypot(row - place[0] - shift_px[0], column - place[1] - shift_px[1])
        planes[:3] += 6 * np.exp(-away**2 / 3)
    return planes


def noisy(planes, number):
    noise = np.random.default_rng((SEED, number)).normal(0, NOISE, (3, *SHAPE))
    return np.concatenate([planes[:3] + noise, planes[3:]])


@pytest.fixture(scope="module")
def plain():
    return [noisy(light(), number) for number in (0, 1)]


def changed(change):
    planes = light()
    change(planes)
    return noisy(planes, 2)


def test_noise_is_no_fault(plain):
    assert compare(noisy(light(), 2), plain, MARKS).faults == ()


def _darker(planes):
    planes[:3] *= 0.97


def _tinted(planes):
    planes[2] *= 1.04


def _missing_thing(planes):
    planes[:3, 20:30, 4:14] *= 0.8


def _missing_mark(planes):
    planes[:3, 7:16, 10:19] = 0.4


def _alpha(planes):
    planes[3, :8] = 0.97


@pytest.mark.parametrize("change, words", [
    (_darker, "mean colour"), (_tinted, "mean colour"), (_missing_thing, "block"), (_missing_mark, "Mark 1 is missing"),
    (_alpha, "alpha")])
def test_changes_are_faults(plain, change, words):
    assert any(words in fault for fault in compare(changed(change), plain, MARKS).faults)


def test_marks_are_measured_in_pixels(plain):
    found = compare(noisy(light((0.25, -0.35)), 2), plain, MARKS, Limits(misplaced=1.0))
    for off_px in found.off_px.values():
        assert off_px == pytest.approx(np.hypot(0.25, 0.35), abs=0.05)
    assert any("Mark 2 off by 0.4" in fault for fault in found.faults)


def test_another_size_is_a_fault(plain):
    found = compare(light()[:, :, :48], plain, MARKS)
    assert found.faults == ("the picture has 48 x 40 px, the plain one 56 x 40 px",)


def test_predicted_colour_errors_are_allowed(plain):
    assert compare(changed(_tinted), plain, MARKS, Limits(colour_error=4.0)).faults == ()


def test_turned_and_mirrored_pictures_are_faults(plain):
    for picture in (light()[:, ::-1], light()[:, :, ::-1]):
        assert compare(noisy(picture, 2), plain, MARKS).faults


def test_marks_outside_the_picture_and_in_black_are_not_measured(plain):
    places = MARKS | {"Mark 3": (-40.0, 5.0), "Mark 4": (12.0, 90.0)}
    assert compare(noisy(light(), 2), plain, places).off_px.keys() == MARKS.keys()
    black = np.zeros((4, *SHAPE))
    assert compare(black, [black, black], places) == compare(black, [black, black], {})
