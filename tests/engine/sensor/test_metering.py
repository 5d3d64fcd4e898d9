"""A lens image in colours and its spectra have the same exposure."""

import numpy as np
import pytest

from lensfield.engine import SpectralImage, load_camera
from lensfield.engine.image.irradiance import irradiance_per_radiance
from lensfield.engine.photo.photograph import photograph
from lensfield.engine.pictures.develop import developed_in
from lensfield.engine.pictures.preview import to_rec709
from lensfield.engine.sensor.metering import developed_white, metered, metered_rec709
from lensfield.engine.spectral.colour import light_basis
from seed import SEED

NM, F_NUMBER, EXPOSURE = np.linspace(380, 780, 41), 3.1, 1.7
CAMERA = load_camera("sony-a7-iv")
GREY, WARM = (0.18, 0.18, 0.18), (0.5, 0.2, 0.02)


def lens_image(colours):
    """Irradiance of a picture (row, column, 3) behind a lens."""
    cube = irradiance_per_radiance(1.0, F_NUMBER) * np.moveaxis(np.asarray(colours) @ light_basis(NM).T, -1, 0)
    return SpectralImage(cube, NM, pitch_um=300.0, quantity="irradiance", f_number_effective=F_NUMBER,
                         exposure=EXPOSURE)


def uneven(colour):
    """A picture with a lamp, and black below."""
    shares = np.random.default_rng(SEED).uniform(0.2, 3, (40, 60, 1))
    shares[4:6, 7:11], shares[30:] = 400.0, 0.0
    return shares * colour


@pytest.mark.parametrize("colour", [GREY, WARM])
@pytest.mark.parametrize("iso, shutter_s", [(None, None), (800.0, None), (None, 1 / 8000), (800.0, 1 / 8000)])
def test_colours_are_metered_as_spectra(colour, iso, shutter_s):
    picture = uneven(colour)
    known, expected = (metered_rec709(picture, CAMERA, F_NUMBER, iso, shutter_s),
                       metered(lens_image(picture), CAMERA, iso, shutter_s))
    assert known.shutter_s == pytest.approx(expected.shutter_s, rel=0.01)
    assert known.iso == pytest.approx(expected.iso, rel=0.01)


def test_a_developed_white_is_that_of_the_raw_picture():
    light = lens_image(np.full((40, 60, 3), 0.18))
    raw = photograph(light, CAMERA, 400.0, 1 / 200, noise=False)
    expected = developed_in(raw, light.frame_px, light.pitch_um)[10:30, 10:50].mean()
    shown = developed_white(CAMERA, raw.exposure, F_NUMBER) * to_rec709(light) / EXPOSURE
    assert expected > 0.01 and shown.mean() == pytest.approx(expected, rel=0.01)
