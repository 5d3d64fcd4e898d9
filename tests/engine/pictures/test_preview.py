"""From spectral images to pictures."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from lenses import make_lens
from lensfield.engine import SpectralImage, simulate
from lensfield.engine.pictures.preview import auto_exposure, to_rec709, write_png
from lensfield.engine.pictures.spectral_exr import read_exr, write_exr
from lensfield.engine.runtime.errors import ImageError
from lensfield.engine.spectral.colour import rec709_weights
from lensfield.engine.spectral.spectra import white_density
from refusals import refused

NM = np.array([450.0, 550.0, 650.0])


def test_every_pixel_has_the_colour_of_its_spectrum():
    cube = np.random.default_rng(0).random((3, 2, 4), dtype=np.float32)
    picture = to_rec709(SpectralImage(cube, NM, pitch_um=1.0))
    assert picture.shape == (2, 4, 3) and picture.dtype == np.float32
    np.testing.assert_allclose(picture[1, 2], cube[:, 1, 2] @ rec709_weights(NM), rtol=1e-5)


def test_a_lens_image_is_as_bright_on_the_axis_as_the_render():
    radiance = SpectralImage(np.tile(white_density(NM)[:, None, None], (1, 9, 9)), NM, pitch_um=5.0)
    np.testing.assert_allclose(to_rec709(simulate(radiance, make_lens(transmittance=0.5)))[4, 4], 0.5, rtol=1e-4)


def test_exposure_puts_an_even_picture_just_below_white():
    assert auto_exposure(np.full((10, 10, 3), 0.3)) == pytest.approx(3.0, rel=1e-3)


def test_exposure_lets_a_few_bright_points_clip():
    picture = np.full((100, 100, 3), 0.3)
    picture[:5, :5] = 1e6
    assert auto_exposure(picture) == pytest.approx(3.0, rel=1e-3)


def test_exposure_of_a_few_points_on_black_follows_the_points():
    picture = np.zeros((100, 100, 3))
    picture[3, 4] = 9.0
    assert auto_exposure(picture) == pytest.approx(0.1, rel=1e-3)


def test_exposure_of_a_black_picture_is_one():
    assert auto_exposure(np.zeros((4, 4, 3))) == 1.0


def test_a_png_holds_the_encoded_picture_upright(tmp_path):
    picture = np.zeros((3, 4, 3))
    picture[0, 1] = (1.0, 0.18, 0.0)
    write_png(picture, tmp_path / "picture.png", exposure=1.0)
    with Image.open(tmp_path / "picture.png") as image:
        assert image.size == (4, 3)
        assert image.getpixel((1, 0)) == (255, 118, 0)
        assert image.getpixel((0, 0)) == (0, 0, 0)


def test_exposure_scales_previews_and_is_stored_in_the_file(tmp_path):
    image = SpectralImage(np.ones((3, 4, 6)), (450, 550, 650), pitch_um=5.0)
    exposed = replace(image, exposure=2.5)
    assert np.allclose(to_rec709(exposed), 2.5 * to_rec709(image))
    write_exr(exposed, tmp_path / "exposed.exr")
    read = read_exr(tmp_path / "exposed.exr")
    assert read.exposure == 2.5 and np.array_equal(read.cube, image.cube)
    write_exr(image, tmp_path / "plain.exr")
    assert read_exr(tmp_path / "plain.exr").exposure == 1
    with refused(ImageError, field="exposure", value=-1, where="image"):
        replace(image, exposure=-1)
