"""Merged exposures: the electrons per second that went in, over a range that no exposure has."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import InputError, SpectralImage
from lensfield.engine.sensor.bracketing import merged_e_per_s
from lensfield.engine.sensor.camera import Camera
from lensfield.engine.sensor.electrons import response
from lensfield.engine.sensor.exposure import Exposure, expose
from refusals import refused
from seed import SEED

CAMERA = Camera("test", (64, 90), 4.0, ("G",), "G", np.array([400.0, 700.0]), np.array([[0.5, 0.4]]),
                gain_dn_per_e=0.25, base_iso=100.0, saturation_e=12000.0, bits=12, black_dn=64.0, dark_noise_e=3.0,
                readout_noise_dn=0.5, dark_current_e_per_s=30.0, dsnu_e=1.0)
LEVELS = 10.0**np.linspace(-5, 1, 9)  # W m^-2, over six decades


def steps(levels):
    light = np.repeat(levels, 10)[None, None].repeat(64, axis=1)
    return SpectralImage(light, [550.0], pitch_um=4.0, quantity="irradiance")


@pytest.mark.parametrize("brackets", [[(0.3, 100.0), (0.01, 100.0), (2e-5, 100.0)], [(0.3, 800.0), (2e-5, 100.0)],
                                      [(2e-5, 100.0), (1e-4, 12.5), (0.3, 100.0)]])
def test_the_merged_exposures_return_the_light(brackets):
    rate = LEVELS * response(CAMERA, np.array([550.0]))[0, 0]
    pictures = [expose(steps(LEVELS), CAMERA, Exposure(shutter_s, iso, SEED, frame))
                for frame, (shutter_s, iso) in enumerate(brackets)]
    merged = merged_e_per_s(pictures).reshape(64, 9, 10)
    assert len({picture.saturated for picture in pictures}) > 1
    longest_s = [max(shutter_s for shutter_s, iso in brackets
                     if (each + 30) * shutter_s < 0.9 * min(12000, 4031 / (0.25 * iso / 100))) for each in rate]
    for mean, each, shutter_s in zip(merged.mean(axis=(0, 2)), rate, longest_s, strict=True):
        electrons = (each + 30) * shutter_s
        # photons, reading at ISO 100, DSNU, and steps of 32 electrons at ISO 12.5
        noise_e = np.sqrt((electrons + 3**2 + 2**2 + 1 + 32**2 / 12) / 640)
        assert mean == pytest.approx(each, abs=5 * noise_e / shutter_s + 1e-3 * each)


def test_light_that_saturates_all_exposures_has_the_highest_rate():
    pictures = [expose(steps([1e4]), CAMERA, Exposure(shutter_s, 100.0, noise=False)) for shutter_s in (0.1, 0.01)]
    assert merged_e_per_s(pictures) == pytest.approx(12000 / 0.01 - 30, rel=1e-3)


def test_pictures_of_different_cameras_are_refused():
    pictures = [expose(steps([1.0]), camera, Exposure(0.01, 100.0)) for camera in (CAMERA, replace(CAMERA, prnu=0.1))]
    with refused(InputError, field="pictures", value="different", where="bracketing", match="expected the same camera"):
        merged_e_per_s(pictures)
    with refused(InputError, field="pictures", value="empty", where="bracketing", match="expected at least one"):
        merged_e_per_s([])
