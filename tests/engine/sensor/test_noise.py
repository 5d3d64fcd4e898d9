"""The distributions of a sensor's noise, and their independence of each other and of how the picture is divided."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import scipy

from lensfield.engine import ImageError, SpectralImage
from lensfield.engine.runtime import memory
from lensfield.engine.sensor import collecting, exposure
from lensfield.engine.sensor.camera import Camera
from lensfield.engine.sensor.electrons import response
from lensfield.engine.sensor.exposure import Exposure, expose
from refusals import refused
from seed import SEED

QUIET = Camera("test", (1000, 1200), 4.0, ("G",), "G", np.array([400.0, 600.0]), np.array([[0.5, 0.5]]),
               gain_dn_per_e=1.0, base_iso=100.0, saturation_e=6e4, bits=16)
COARSE = 5000.0  # numbers per standard deviation of the noise of readings
NOISY = replace(QUIET, dark_noise_e=COARSE, black_dn=32768.0)


def lit(count_e, camera=QUIET, shape=None):
    """Even light that frees a mean number of electrons in each pixel in one second."""
    level = count_e / response(camera, np.array([500.0]))[0, 0]
    return SpectralImage(np.full((1, *(shape or camera.shape_px)), level), [500.0], pitch_um=4.0, quantity="irradiance")


def readings(**settings):
    """The noise of readings, in standard deviations."""
    return (expose(lit(0), NOISY, Exposure(1.0, 100.0, **{"seed": SEED} | settings)).numbers - NOISY.black_dn) / COARSE


@pytest.mark.parametrize("count_e", [0.03, 4.0, 31.5, 32.5, 80.0])
def test_counts_have_poissons_distribution(count_e):
    """On both sides of the number of electrons at which the way of counting changes."""
    numbers = expose(lit(count_e), QUIET, Exposure(1.0, 100.0, SEED)).numbers
    expected = numbers.size * scipy.stats.poisson.pmf(np.arange(numbers.max() + 2), count_e)
    expected[-1] += numbers.size - expected.sum()
    counted = np.bincount(numbers.ravel(), minlength=expected.size)
    many = expected > 20
    difference = np.append(counted[many] - expected[many], (counted - expected)[~many].sum())
    chi_squared = (difference**2 / np.append(expected[many], max(expected[~many].sum(), 1))).sum()
    degrees = many.sum()
    assert chi_squared < degrees + 5 * np.sqrt(2 * degrees) + 15


def test_readings_are_normal_up_to_their_tails():
    noise = readings()
    assert abs(noise.mean()) < 5 / np.sqrt(noise.size)
    for power, moment, variance in ((2, 1, 2), (3, 0, 15), (4, 3, 96), (6, 15, 10170)):
        assert abs((noise**power).mean() - moment) < 5 * np.sqrt(variance / noise.size)
    for sigmas in (0.01, 0.5, 1.0, 2.0, 3.0, 4.0):
        share = scipy.stats.norm.sf(sigmas)
        for tail in (noise > sigmas, noise < -sigmas):
            assert abs(tail.mean() - share) < 5 * np.sqrt(share / noise.size) + 0.5 / COARSE


def test_noise_is_white():
    """Neighbours, rows and columns are independent: no frequency stands out, and no row or column has a mean."""
    noise = readings()
    power = np.abs(scipy.fft.rfft2(noise)[1:, 1:-1])**2 / noise.size  # exponential, with a mean of 1
    assert power.max() < np.log(power.size) + 16
    assert abs(power.mean() - 1) < 5 / np.sqrt(power.size)
    for axis in (0, 1):
        means = noise.mean(axis=axis) * np.sqrt(noise.shape[axis])
        assert np.abs(means).max() < 6 and abs((means**2).mean() - 1) < 5 * np.sqrt(2 / means.size)


def test_noise_of_exposures_is_independent():
    one, *others = (readings(**settings) for settings in (
        {}, {"frame": 1}, {"seed": SEED + 1}, {"seed": SEED + 1, "frame": 1}, {"serial": 1}, {"seed": SEED + 2**32}))
    for other in others:
        for shifted in (other, np.roll(other, 1, axis=0), np.roll(other, 1, axis=1)):
            assert abs((one * shifted).mean()) < 5 / np.sqrt(one.size)
    counts = expose(lit(20.0), QUIET, Exposure(1.0, 100.0, SEED)).numbers - 20.0
    assert abs((one * counts).mean()) < 5 * np.sqrt(20 / one.size)


def test_the_same_pixel_has_the_same_noise_in_any_picture(monkeypatch):
    """Of any size, odd or even, and divided among threads in any way."""
    camera = replace(QUIET, shape_px=(301, 400), dark_noise_e=3.0, dsnu_e=2.0, prnu=0.01, filters=(), channels="GH",
                     quantum_efficiency=np.array([[0.5, 0.5], [0.1, 0.1]]))
    settings = Exposure(1.0, 100.0, SEED)
    complete = expose(lit(60.0, camera), camera, settings).numbers
    part = expose(lit(60.0, camera, (80, 133)), camera, settings).numbers
    np.testing.assert_array_equal(part, complete[:, 110:190, 133:266])
    for module in (collecting, exposure):
        monkeypatch.setattr(module, "BAND_PIXELS", 1)
    np.testing.assert_array_equal(expose(lit(60.0, camera), camera, settings).numbers, complete)
    assert np.unique(complete[0], axis=0).shape == complete[0].shape, "no two rows are equal"


def test_rows_in_any_order_in_memory():
    camera, light = replace(QUIET, shape_px=(50, 70)), np.random.default_rng(SEED).random((3, 50, 70), np.float32)
    noiseless = Exposure(1e12, 100.0, noise=False)

    def numbers(cube):
        picture = SpectralImage(cube, [420, 500, 580], pitch_um=4.0, quantity="irradiance")
        return expose(picture, camera, noiseless).numbers

    expected = numbers(light)
    for other in (np.asfortranarray(light), light[:, ::-1].copy()[:, ::-1], light.repeat(2, axis=2)[..., ::2]):
        np.testing.assert_array_equal(numbers(other), expected)


@pytest.mark.parametrize("filters, pitch_um", [(("GH", "HH"), 4.0), ((), 4.0), (("GH", "HH"), 9.0), ((), 9.0)])
def test_memory_is_priced_before_the_picture_is_taken(filters, pitch_um, monkeypatch):
    camera = replace(QUIET, filters=filters, channels="GH", quantum_efficiency=np.array([[0.5, 0.5], [0.1, 0.1]]))
    shape = tuple(round(n * 4.0 / pitch_um) for n in camera.shape_px)
    picture = SpectralImage(np.ones((1, *shape)), [500.0], pitch_um=pitch_um, quantity="irradiance")
    requested = []
    monkeypatch.setattr(collecting, "check_room", lambda where, needed, remedy: requested.append(needed))
    tracemalloc.start()
    expose(picture, camera, Exposure(1.0, 100.0))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.8 * requested[0] < peak < 1.05 * requested[0]
    monkeypatch.undo()
    monkeypatch.setattr(memory, "available_bytes", lambda: 1e6)
    with refused(ImageError, field="size", where="raw picture", match="0.001 GB .* give a smaller"):
        expose(picture, camera, Exposure(1.0, 100.0))
