"""Complete pictures by numpy and by every variant of the compiled loops: variants agree bit for bit, numpy closely."""

import numpy as np
import pytest

from gpus import loops
from lenses import comatic_lens, lopsided_lens
from lensfield.engine import ChannelCache, Options, Report, SpectralImage, simulate
from lensfield.engine.image.projection import FISHEYE
from lensfield.engine.kernels.library import NUMPY, available
from loops import using
from varied_lenses import VARIED, varied_lens

AGREEMENT = 3e-6  # of the brightest pixel: several roundings to single precision, of the light and of its position
PIXELS = Options(method="pixels", azimuths=6, psf_energy=0.99)
COMATIC, LOPSIDED = comatic_lens(), lopsided_lens()


def noise(shape=(31, 44), pitch_um=40.0, seed=0, wavelengths_nm=(550.0,), brightness=1.0, **facts):
    cube = np.random.default_rng(seed).random((len(wavelengths_nm), *shape)) ** brightness
    return SpectralImage(cube, wavelengths_nm, pitch_um=pitch_um, **facts)


def with_fireflies():
    radiance = noise(pitch_um=60.0)
    radiance.cube[0, ::7, ::5] = 1e6
    return radiance


def black_but_for(*places):
    radiance = noise()
    light = radiance.cube.copy()
    radiance.cube[:] = 0
    for place in places:
        radiance.cube[0][place] = light[0][place]
    return radiance


CASES = {
    "folded": (noise(), COMATIC, PIXELS),
    "odd rows": (noise((31, 45)), COMATIC, PIXELS),
    "odd columns": (noise((30, 45)), COMATIC, PIXELS),
    "not symmetric": (noise(), LOPSIDED, PIXELS),
    "axis off the middle": (noise(centre_px=(3.3, 40.9)), COMATIC, PIXELS),
    "axis outside": (noise(centre_px=(-20.0, 70.5)), COMATIC, PIXELS),
    "one pixel": (noise((1, 1)), COMATIC, PIXELS),
    "one pixel off the axis": (noise((1, 1), centre_px=(0.3, -9.0)), COMATIC, PIXELS),
    "one row": (noise((1, 77)), COMATIC, PIXELS),
    "one column": (noise((77, 1)), LOPSIDED, PIXELS),
    "overscan": (noise((40, 50), overscan_px=(5, 6)), COMATIC, PIXELS),
    "beyond the lens data": (noise((90, 130), pitch_um=60.0), COMATIC, PIXELS),
    "vignette": (noise((90, 130), pitch_um=60.0), COMATIC,
                 Options(method="pixels", azimuths=6, out_of_field="vignette")),
    "pixels on the edge of the lens data": (noise((101, 101), pitch_um=50.0), COMATIC,
                                            Options(method="pixels", azimuths=6, out_of_field="vignette")),
    "fireflies": (with_fireflies(), COMATIC, PIXELS),
    "a range of 1e8": (noise(brightness=8.0), COMATIC, PIXELS),
    "black": (black_but_for(), COMATIC, PIXELS),
    "lit here and there": (black_but_for((slice(3), slice(5, 9)), (30, 43)), COMATIC, PIXELS),
    "even light": (SpectralImage(np.full((1, 200, 260), 3.0), [550.0], pitch_um=15.0), COMATIC,
                   Options(method="pixels", azimuths=6, flat_tolerance=0.05)),
    "wavelengths": (noise(wavelengths_nm=np.linspace(420, 680, 5)), COMATIC, PIXELS),
    "double precision": (noise(), COMATIC, Options(method="pixels", azimuths=6, precision="float64")),
    "by sections": (noise(), COMATIC, Options(method="sections", azimuths=6)),
}


def assert_all_agree(radiance, lens, options):
    pictures = []
    for name in available():
        with using(name):
            pictures.append(simulate(radiance, lens, options).cube)
    by_numpy, *compiled = pictures
    for picture in compiled:
        np.testing.assert_array_equal(picture, compiled[0])
        np.testing.assert_allclose(picture, by_numpy, rtol=0, atol=AGREEMENT * by_numpy.max())


@pytest.mark.parametrize("case", CASES)
def test_pictures_agree(case):
    assert_all_agree(*CASES[case])


@pytest.mark.parametrize("case", sorted(CASES.keys() - {"black", "double precision", "by sections", "even light"}))
def test_a_graphics_processor_agrees(gpu, case):
    radiance, lens, options = CASES[case]
    report = Report()
    picture = simulate(radiance, lens, options, report=report).cube
    with loops():
        expected = simulate(radiance, lens, options).cube
    assert report.lens_image.spreading == gpu.name
    np.testing.assert_allclose(picture, expected, rtol=0, atol=AGREEMENT * expected.max())


def test_pictures_of_a_fisheye_agree():
    radiance = noise((90, 130), pitch_um=350.0, projection=FISHEYE)
    assert_all_agree(radiance, varied_lens("muller-fisheye-25mm"), PIXELS)


@pytest.mark.parametrize("name", VARIED)
@pytest.mark.parametrize("accuracy", [0.1, 0.02])
def test_pictures_by_every_bundled_lens_agree(name, accuracy):
    lens = varied_lens(name)
    radiance = noise((70, 96), pitch_um=lens.sensor_mm[0] * 1e3 / 96, wavelengths_nm=(450.0, 610.0))
    assert_all_agree(radiance, lens, Options(method="pixels", accuracy=accuracy))


@pytest.mark.parametrize("limit_mb", [0, 0.3, 100])
def test_cached_frames_equal_recomputed_frames(limit_mb):
    for name in available():
        with using(name):
            cache = ChannelCache(limit_mb=limit_mb)
            for seed in (0, 1, 0):
                radiance = noise(seed=seed, wavelengths_nm=(450.0, 600.0))
                np.testing.assert_array_equal(simulate(radiance, COMATIC, PIXELS, cache=cache).cube,
                                              simulate(radiance, COMATIC, PIXELS).cube)


def test_variants_may_change_between_frames():
    cache, radiance = ChannelCache(), noise()
    for name in (*available(), *reversed(available())):
        with using(name):
            np.testing.assert_array_equal(simulate(radiance, COMATIC, PIXELS, cache=cache).cube,
                                          simulate(radiance, COMATIC, PIXELS).cube)


def test_the_report_names_the_loop_variant():
    for name in available():
        report = Report()
        with using(name):
            simulate(noise((3, 4)), COMATIC, PIXELS, report=report)
        assert report.as_dict()["loops"] == name
    assert available()[0] == NUMPY
