"""Control variates: light at further wavelengths from few samples."""

import numpy as np
import pytest

from lensfield.engine.spectral.control_variate import (
    JUDGED_PERCENT,
    balance,
    block_means,
    estimate,
    noise_growth,
    remaining_shares,
)
from seed import SEED

SHAPE_PX = 40, 56
FEW, SAMPLES = 8, 64
COLOURS_A = np.array([[1.0, 0.8, 0.6], [0.2, 0.9, 0.4], [0.7, 0.1, 1.0]], np.float32)  # (kind of path, channel)
COLOURS_B = np.array([[0.9, 0.7, 0.7], [0.5, 0.8, 0.3], [0.6, 0.2, 1.2]], np.float32)


def samples_of(rng, count):
    """Mean light of A and of B over samples whose paths have three colours, the last kind bright and rare."""
    weight = rng.gamma(2.0, 0.5, (3, count, *SHAPE_PX)).astype(np.float32)
    weight[2] *= 20 * (rng.random((count, *SHAPE_PX)) < 0.01)
    weight[:2] *= np.linspace(0.02, 1, SHAPE_PX[1], dtype=np.float32)  # a dark side and a bright one
    return (np.einsum("knyx,kc->cyx", weight, colours) / count for colours in (COLOURS_A, COLOURS_B))


def estimated(rng):
    """B estimated from few samples; B after all of them; and the difference between the halves, helped and not."""
    control_halves, halves = zip(*(samples_of(rng, FEW // 2) for _ in range(2)), strict=True)
    control_rest, rest = samples_of(rng, SAMPLES - FEW)
    picture, helped = estimate(halves, control_halves, control_rest, (SAMPLES - FEW) / SAMPLES)
    whole = (FEW * (halves[0] + halves[1]) / 2 + (SAMPLES - FEW) * rest) / SAMPLES
    return picture, whole, helped, halves[0] - halves[1]


def test_estimate_is_unbiased_and_has_little_more_noise_than_all_samples():
    rng, repeats = np.random.default_rng(SEED), 40
    truth = np.einsum("k,kc->c", [1.0, 1.0, 0.2], COLOURS_B)  # where it is brightest
    columns = slice(SHAPE_PX[1] - 8, None)
    results = [[picture[..., columns] for picture in estimated(rng)[:2]] for _ in range(repeats)]
    few, whole = (np.array([result[index] for result in results]) for index in range(2))
    assert few.shape[1:] == (3, SHAPE_PX[0], 8)
    lit = np.linspace(0.02, 1, SHAPE_PX[1])[columns].mean()
    expected = truth - np.einsum("k,kc->c", [1.0, 1.0], COLOURS_B[:2]) * (1 - lit)
    means = few.mean(axis=(2, 3))
    assert np.all(np.abs(means.mean(axis=0) - expected) < 5 * means.std(axis=0) / np.sqrt(repeats))
    assert np.all(few.std(axis=0).mean(axis=(1, 2)) < 1.3 * whole.std(axis=0).mean(axis=(1, 2)))


def test_predicted_growth_of_noise_is_the_measured_one():
    rng, repeats = np.random.default_rng(SEED), 30
    results = [estimated(rng) for _ in range(repeats)]
    predicted = np.mean([noise_growth(remaining_shares(helped, unhelped), FEW, SAMPLES)
                         for *_, helped, unhelped in results])
    few, whole = (np.array([result[index] for result in results]).var(axis=0).sum(axis=0) for index in range(2))
    measured = np.percentile(np.sqrt(block_means(few) / block_means(whole)), JUDGED_PERCENT)
    assert predicted == pytest.approx(measured, rel=0.1)


def test_independent_noise_is_found_out():
    rng = np.random.default_rng(SEED)
    pictures = [rng.gamma(1, 1, (3, *SHAPE_PX)).astype(np.float32) for _ in range(5)]
    _, helped = estimate(pictures[:2], pictures[2:4], pictures[4], 0.9)
    shares = remaining_shares(helped, pictures[0] - pictures[1])
    assert shares.mean() > 0.9 and noise_growth(shares, FEW, SAMPLES) > 2


def test_pictures_without_noise_or_light_stay_as_they_are():
    even = np.broadcast_to(np.array([3.0, 2.0, 1.0], np.float32)[:, None, None], (3, *SHAPE_PX))
    for picture in (even, 0 * even):
        for control in (2 * even, 0 * even):
            result, difference = estimate([picture] * 2, [control] * 2, control, 0.9)
            assert np.array_equal(result, picture) and not difference.any()
    assert noise_growth(remaining_shares(0 * even, 0 * even), FEW, SAMPLES) == 1
    assert noise_growth(remaining_shares(0 * even, even), FEW, SAMPLES) == 1
    assert noise_growth(remaining_shares(even, even), FEW, SAMPLES) == pytest.approx(np.sqrt(SAMPLES / FEW))


def test_a_bright_sample_in_the_dark_takes_the_usual_colour():
    """The gains of dark pixels are determined by little light, and must not multiply a bright sample."""
    rng = np.random.default_rng(SEED)
    halves = [np.zeros((3, *SHAPE_PX), np.float32) for _ in range(2)]
    for half in halves:
        half[:, :, :20] = rng.gamma(1, 1, (20,))
        half[:, :, 30:] = 1e-6 * rng.random((3, SHAPE_PX[0], 26))
    others = [half + 1e-6 * rng.random(half.shape).astype(np.float32) for half in halves]
    for picture in (halves[0], others[0]):
        picture[:, 17, 45] = 30.0
    result, _ = estimate(others, halves, halves[0] / 10 + halves[1] / 10, 0.9)
    np.testing.assert_allclose(result[:, 17, 45], 30 / 10 * 0.9 + 30 / 2 * 0.1, rtol=0.01)


def test_light_that_the_few_samples_missed_takes_the_usual_colour():
    """A bright pixel of A must not become a black or coloured one in B."""
    rng = np.random.default_rng(SEED)
    halves = [np.zeros((3, *SHAPE_PX), np.float32) for _ in range(2)]
    for half in halves:
        half[:, :, :20] = rng.gamma(1, 1, (20,))
    rest = halves[0] / 2 + halves[1] / 2
    rest[:, 17, 45] = 100.0
    result, _ = estimate([0.5 * half for half in halves], halves, rest, 1.0)
    np.testing.assert_allclose(result[:, 17, 45], 50.0, rtol=1e-4)


def test_gains_of_a_pixel_do_not_depend_on_its_samples():
    """Otherwise they would depend on the error that they correct, and bias the estimate."""
    rng = np.random.default_rng(SEED)
    (one, other), (control_one, control_other) = (
        rng.gamma(1, 1, (2, 3, *SHAPE_PX)).astype(np.float32) for _ in range(2))
    rest = rng.gamma(1, 1, (3, *SHAPE_PX)).astype(np.float32)

    def added(extra, row, column):
        """What a pixel's estimate gains if its few samples, of both pictures, become brighter by this."""
        halves, controls = ([each.copy() for each in pair] for pair in ((one, other), (control_one, control_other)))
        before = estimate(halves, controls, rest, 0.9)[0]
        for each in (*halves, *controls):
            each[:, row, column] += extra
        return (estimate(halves, controls, rest, 0.9)[0] - before)[:, row, column].astype(float)

    for row in (5, 21, 30):
        for column in (8, 33):  # same gains: linear; the mean of all pixels changes them a little
            np.testing.assert_allclose(added(10.0, row, column), 10 * added(1.0, row, column), rtol=0, atol=5e-3)


def test_negative_light_is_taken_from_the_light_around_it():
    rng = np.random.default_rng(SEED)
    plane = rng.gamma(1, 1, SHAPE_PX).astype(np.float32)
    plane[:, :7] *= -0.01  # alone: nothing positive balances the corners
    dim = plane.copy()
    for row, column in ((3, 30), (20, 31), (39, 55)):
        plane[row, column] = -20.0
    before = plane.copy()
    balance(plane)
    assert plane.min() == 0 and np.all(plane <= np.maximum(before, 0))
    assert plane.sum(dtype=float) == pytest.approx(before.sum(dtype=float), rel=1e-3)
    assert np.array_equal(plane[8:12, 40:], dim[8:12, 40:])  # far from all of them
    positive = np.abs(before)
    same = positive.copy()
    balance(same)
    assert np.array_equal(same, positive)
