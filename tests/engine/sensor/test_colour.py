"""Colours of cameras: of one that sees as the standard observer does, and of the library's."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine.library.bodies import CAMERAS, load_camera
from lensfield.engine.runtime.errors import CameraError
from lensfield.engine.sensor.colour import camera_colour, channel_weights
from lensfield.engine.sensor.electrons import response
from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz
from lensfield.engine.spectral.spectra import colour_matching, load_spectrum
from raw_pictures import CHART, FINE_NM, chart_xyz
from refusals import refused

MIXED = np.array([[0.8, 0.3, 0.05], [0.1, 1.2, 0.2], [0.05, 0.1, 0.6], [0.3, 0.9, 0.4]])


@pytest.mark.parametrize("channels, filters", [("RGB", ("RG", "GB")), ("RGBW", ("WR", "BG"))])
def test_a_camera_that_mixes_the_observers_curves_has_its_mixture(channels, filters):
    mixed = MIXED[:len(channels)]
    efficiency = mixed @ colour_matching(FINE_NM).T / FINE_NM  # electrons are counted, the observer weighs power
    camera = replace(load_camera("sony-a7-iv"), channels=channels, filters=filters, wavelengths_nm=FINE_NM,
                     quantum_efficiency=efficiency / efficiency.max())
    colour = camera_colour(camera)
    white = chart_xyz()[1]
    np.testing.assert_allclose(colour.xyz_to_camera, mixed / (mixed @ white).max(), atol=1e-4)
    np.testing.assert_allclose(colour.neutral, mixed @ white / (mixed @ white).max(), rtol=1e-4)
    np.testing.assert_allclose(colour.balanced_to_xyz @ np.ones(len(channels)), white, rtol=1e-6)


@pytest.mark.sample(8)
@pytest.mark.parametrize("name", [path.stem for path in sorted(CAMERAS.glob("*.toml"))])
def test_a_camera_of_the_library_sees_the_chart_as_it_is(name):
    true, white = chart_xyz()
    camera = load_camera(name)
    electrons = response(camera, FINE_NM) * load_spectrum("illuminant-d65").at(FINE_NM)
    balanced = np.stack([load_spectrum(patch).at(FINE_NM) for patch in CHART]) @ electrons.T / electrons.sum(axis=1)
    seen = balanced @ camera_colour(camera).balanced_to_xyz.T
    errors = ciede2000(lab_from_xyz(seen, white), lab_from_xyz(true, white))
    assert np.median(errors) < 1.5 and errors.max() < 7


def test_the_wavelengths_of_a_channel_are_those_of_its_electrons():
    nm = np.arange(380.0, 781, 5)
    weights = channel_weights(load_camera("sony-a7-iv"), nm)
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    red, green, blue = weights @ nm
    np.testing.assert_allclose(channel_weights(load_camera("sony-a7-iv"), np.array([800.0, 900.0])), 0.5)
    assert 440 < blue < 490 < 520 < green < 560 < 580 < red < 630


def test_a_camera_with_fewer_than_three_channels_has_no_colours():
    with pytest.raises(CameraError, match="channels is G: expected at least three"):
        camera_colour(replace(load_camera("sony-a7-iv"), filters=("G",)))


def test_a_camera_with_an_infrared_channel_has_no_colours():
    camera = load_camera("sony-a7-iv")
    nm, rows = np.append(camera.wavelengths_nm, [850, 900, 950]), np.pad(camera.quantum_efficiency, ((0, 1), (0, 3)))
    rows[3, -2] = 0.3
    with refused(CameraError, field="quantum_efficiency", value="0 for visible light in I", where="camera sony-a7-iv",
                 match="is 0 for visible light in I: expected a response"):
        camera_colour(replace(camera, filters=("RG", "IB"), channels="RGBI", wavelengths_nm=nm,
                              quantum_efficiency=rows))
