"""Sections with the nodes of the PSF table: each pixel has the same PSF as in the pixels method."""

import numpy as np
import pytest

from lenses import comatic_lens, distance_of_light, lopsided_lens
from lensfield.engine import Options, Report, SpectralImage, load_lens, simulate

LENSES = {"comatic": comatic_lens(), "lopsided": lopsided_lens(), "edmund": load_lens("edmund-54852")}
EVERY_LENS = pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES.keys())
SHAPES = [(1, 1), (9, 13), (20, 13)]


def noise(shape, centre_px=None, pitch_um=8.0):
    cube = np.random.default_rng(3).random((1, *shape))
    return SpectralImage(cube, 550.0, pitch_um=pitch_um, centre_px=centre_px)


def in_sections(section_size, azimuths, **knobs):
    return Options(section_size=section_size, azimuths=azimuths, **knobs)


@EVERY_LENS
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("section_size, centre_px", [(1, None), (7, (-20.0, 60.0)), (500, (4.5, 3.0))])
def test_sections_match_pixels(lens, shape, section_size, centre_px):
    image = noise(shape, centre_px)
    sections, pixels = (simulate(image, lens, options).cube for options in (
        in_sections(section_size, 3, precision="float64"), Options(method="pixels", azimuths=3, precision="float64")))
    np.testing.assert_allclose(sections, pixels, atol=2e-7 * pixels.max())


@EVERY_LENS
@pytest.mark.parametrize("centre_px", [None, (-20.0, 60.0)])
def test_64_azimuths_misplace_less_than_a_ten_thousandth_of_the_light(lens, centre_px):
    image = noise((12, 15), centre_px)
    exact = simulate(image, lens, Options(method="exact")).cube
    assert distance_of_light(simulate(image, lens, in_sections(8, 64, psf_energy=1.0)).cube, exact) < 1e-4


@EVERY_LENS
@pytest.mark.parametrize("section_size", [1, 7])
def test_energy_is_conserved(lens, section_size):
    report = Report()
    simulate(noise((14, 17), (3.0, 5.0)), lens, in_sections(section_size, 4, precision="float64"), report=report)
    energy = report.lens_image.energy
    assert energy.out_w_per_nm == pytest.approx(energy.in_w_per_nm, rel=1e-12, abs=0)


@EVERY_LENS
def test_single_precision_suffices_for_low_contrast_pictures(lens):
    image = noise((40, 50))
    single, double = (simulate(image, lens, in_sections(16, 4, precision=precision)).cube
                      for precision in ("auto", "float64"))
    np.testing.assert_allclose(single, double, atol=1e-6 * double.max())
