"""The measure of ordinary scenes lets noise pass, and nothing else."""

import numpy as np
import pytest

from scene_measure import MOST_OFF_PX, Limits, Marks, compare
from seed import SEED

SHAPE = 40, 56
MARKS = {"Mark 1": (11.3, 14.6), "Mark 2": (27.8, 40.2)}
NOISE, SAMPLES = 0.02, 256


def light(shift_px=(0.0, 0.0), places=MARKS):
    """A gradient with a tint and small lamps: array (4, row, column)."""
    row, column = np.indices(SHAPE, dtype=float)
    planes = np.stack([0.3 + row / 200, 0.4 + column / 300, 0.5 - row / 250, np.ones(SHAPE)])
    for place in places.values():
        away = np.hypot(row - place[0] - shift_px[0], column - place[1] - shift_px[1])
        planes[:3] += 6 * np.exp(-away**2 / 3)
    return planes


def marks(places=MARKS, without=None):
    return Marks(places, light(places={}) if without is None else without, SAMPLES)


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
    assert compare(noisy(light(), 2), plain, marks()).faults == ()


def _darker(planes):
    planes[:3] *= 0.95


def _tinted(planes):
    planes[2] *= 1.04


def _missing_thing(planes):
    planes[:3, 20:30, 4:14] *= 0.8


def _missing_mark(planes):
    planes[:3, 7:16, 10:19] = 0.4


def _alpha(planes):
    planes[3, :8] = 0.97


def test_almost_black_pixels_of_a_mostly_black_picture_show_nothing():
    """Colours are relative to the lit pixels, however few."""
    spot = np.zeros((4, *SHAPE))
    spot[:3, 16:20, 24:28] = np.array([0.5, 0.4, 0.3])[:, None, None]
    picture = spot.copy()
    picture[:3, 0, 0] = 1e-5
    assert compare(picture, [spot, spot], Marks({}, spot, SAMPLES)).faults == ()
    picture[2] *= 1.1
    assert any("block 2, 3" in fault for fault in compare(picture, [spot, spot], Marks({}, spot, SAMPLES)).faults)


@pytest.mark.parametrize("change, words", [
    (_darker, "mean colour"), (_tinted, "mean colour"), (_missing_thing, "block"), (_missing_mark, "Mark 1 is missing"),
    (_alpha, "alpha")])
def test_changes_are_faults(plain, change, words):
    assert any(words in fault for fault in compare(changed(change), plain, marks()).faults)


def test_marks_are_measured_in_pixels(plain):
    found = compare(noisy(light((0.25, -0.35)), 2), plain, marks(), Limits(misplaced=1.0))
    for off_px in found.off_px.values():
        assert off_px == pytest.approx(np.hypot(0.25, 0.35), abs=0.05)
    assert any("Mark 2 off by 0.4" in fault for fault in found.faults)


def test_another_size_is_a_fault(plain):
    found = compare(light()[:, :, :48], plain, marks())
    assert found.faults == ("the picture has 48 x 40 px, the plain one 56 x 40 px",)


def test_predicted_colour_errors_are_allowed(plain):
    assert compare(changed(_tinted), plain, marks(), Limits(colour_error=4.0)).faults == ()


def test_turned_and_mirrored_pictures_are_faults(plain):
    for picture in (light()[:, ::-1], light()[:, :, ::-1]):
        assert compare(noisy(picture, 2), plain, marks()).faults


def test_marks_outside_the_picture_and_in_black_are_not_measured(plain):
    places = MARKS | {"Mark 3": (-40.0, 5.0), "Mark 4": (12.0, 90.0)}
    assert compare(noisy(light(), 2), plain, marks(places)).off_px.keys() == MARKS.keys()
    black = np.zeros((4, *SHAPE))
    assert compare(black, [black, black], marks(places, black)) == compare(black, [black, black], marks({}, black))


LAMP, WHOLE, LAMP_PX = (18.3, 27.4), (10.6, 12.2), 1.6  # places and radius


def edge():
    """Grey next to something bright, three pixels from the lamp: array (4, row, column)."""
    return np.where(np.arange(SHAPE[1]) > 30, 1.2, 0.3) * np.ones((4, *SHAPE))


def counted(number, shift_px=(0.0, 0.0), visible=1.0, samples=SAMPLES):
    """A whole lamp, and the `visible` share of one at the edge, by counting the samples of each pixel that meet them:
    array (4, row, column).
    """
    rng, planes = np.random.default_rng((SEED, number)), edge()
    at = np.indices(SHAPE)[:, None] + rng.uniform(-0.5, 0.5, (2, samples, *SHAPE))
    (row, column), whole = (at - np.reshape(place, (2, 1, 1, 1)) for place in (np.add(LAMP, shift_px), WHOLE))
    met = (np.hypot(row, column) < LAMP_PX) & (column > LAMP_PX * (1 - 2 * visible))
    met |= np.hypot(*whole) < LAMP_PX
    planes[:3] += met.mean(axis=0) * (7 - planes[:3])
    return noisy(planes, 100 + number)


def lamp_faults(picture, samples=SAMPLES, **plain):
    """The faults of the lamp in a picture, against two plain ones."""
    first, second = (counted(number, samples=samples, **plain) for number in (0, 1))
    lamps = Marks({"Lamp": LAMP, "Whole": WHOLE}, noisy(edge(), 99), samples)
    found = compare(picture, [first, second], lamps, Limits(misplaced=1.0))
    return [fault for fault in found.faults if "Lamp" in fault]


def test_marks_next_to_an_edge_are_measured():
    assert lamp_faults(counted(2)) == []
    assert "Lamp off by 0.4" in lamp_faults(counted(2, (-0.27, 0.36)))[0]
    missing = counted(2, visible=0.0)
    assert lamp_faults(missing) == ["Lamp is missing"] == lamp_faults(missing, visible=0.5)
    assert lamp_faults(counted(2), visible=0.0) == ["Lamp is missing"]


def test_a_shift_at_the_limit_is_a_fault_by_the_marks_that_are_precise():
    off = 1.5 * MOST_OFF_PX  # the noise of this lamp is below half the limit
    assert all(lamp_faults(counted(2, shift)) for shift in ((off, 0), (-off, 0), (0, off), (0, -off)))


@pytest.mark.parametrize("visible", [0.0, 0.03, 0.1, 0.4])
def test_few_samples_of_a_mark_are_no_fault(visible):
    """Most of it is hidden, and the rest met by few samples, if by any: of these the renders differ by chance."""
    assert not any(lamp_faults(counted(number, visible=visible, samples=16), samples=16, visible=visible)
                   for number in range(2, 8))
