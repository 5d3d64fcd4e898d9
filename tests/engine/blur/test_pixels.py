"""Per-pixel PSFs from a table of azimuths, against the operator that rotates each PSF."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import (
    comatic_lens,
    distance_of_light,
    gaussian_psf,
    lit_pixels,
    lopsided_lens,
    make_lens,
    marked_psf,
    points_image,
)
from lensfield.engine import Options, Report, SpectralImage, load_lens, simulate

LENSES = {"comatic": comatic_lens(), "lopsided": lopsided_lens(), "edmund": load_lens("edmund-54852")}
SHAPES = [(1, 1), (1, 9), (8, 10), (7, 10), (7, 9)]
EXACT = Options(method="exact")


def noise(shape, pitch_um=8.0, centre_px=None, wavelengths_nm=(550.0,)):
    cube = np.random.default_rng(3).random((len(wavelengths_nm), *shape))
    return SpectralImage(cube, wavelengths_nm, pitch_um=pitch_um, centre_px=centre_px)


def undistorted(lens):
    return replace(lens, real_height_mm=np.broadcast_to(lens.heights_mm, lens.real_height_mm.shape))


def pixels(azimuths, precision="float64"):
    """Complete PSFs, as the exact operator uses them."""
    return Options(method="pixels", azimuths=azimuths, psf_energy=1.0, precision=precision)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("centre_px", [None, (4.5, 3.0)])
def test_64_azimuths_misplace_less_than_a_ten_thousandth_of_the_light(lens, shape, centre_px):
    image = noise(shape, centre_px=centre_px)
    exact = simulate(image, LENSES[lens], EXACT).cube
    assert distance_of_light(simulate(image, LENSES[lens], pixels(64)).cube, exact) < 1e-4


def test_the_error_falls_with_more_azimuths():
    image, lens = noise((31, 40)), LENSES["lopsided"]
    exact = simulate(image, lens, EXACT).cube
    errors = [distance_of_light(simulate(image, lens, pixels(azimuths)).cube, exact) for azimuths in (4, 16, 64)]
    # With smooth PSFs the factor would be 16, because the error of a chord falls with its square; pixels have edges.
    assert errors[0] > 5 * errors[1] > 25 * errors[2]
    assert errors[0] > 1e-3  # four azimuths are not enough


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("shape", [(1, 21), (20, 1), (15, 15), (14, 14)])
def test_pixels_on_table_azimuths_are_exact_for_any_number_of_azimuths(lens, shape):
    image, straight = noise(shape), undistorted(LENSES[lens])  # distortion would smear light off the diagonals
    row, column = (np.abs(2 * index - n + 1) for index, n in zip(np.indices(shape), shape, strict=True))
    image.cube[0, (row != column) & (row != 0) & (column != 0)] = 0  # black, except on the axes and the diagonals
    exact = simulate(image, straight, EXACT).cube
    np.testing.assert_allclose(simulate(image, straight, pixels(1)).cube, exact, atol=2e-7 * exact.max())


@pytest.mark.parametrize("nm", [400.0, 475.0, 700.0])
def test_interpolated_wavelengths_are_as_exact(nm):
    table = np.stack([np.tile(gaussian_psf(s, s, 2.5, 17), (11, 1, 1)) for s in (4, 8)])
    image, lens = noise((1, 31), wavelengths_nm=(nm,)), make_lens(table)
    exact = simulate(image, lens, EXACT).cube
    np.testing.assert_allclose(simulate(image, lens, pixels(1)).cube, exact, atol=2e-7 * exact.max())


def test_many_wavelengths_mixed_from_few_tables_are_as_exact():
    nm = tuple(np.linspace(400, 700, 7))
    table = np.stack([np.tile(gaussian_psf(s, s, 2.5, 17), (11, 1, 1)) for s in (4, 8)])
    image, lens = noise((1, 31), wavelengths_nm=nm), make_lens(table)
    exact = simulate(image, lens, EXACT).cube
    np.testing.assert_allclose(simulate(image, lens, pixels(1)).cube, exact, atol=2e-7 * exact.max())


@pytest.mark.parametrize("centre_px", [None, (28.0, 33.0)])
@pytest.mark.parametrize("source, image", [((8, 0), (13, -4)), ((0, 8), (4, 13)), ((-8, 0), (-13, 4)),
                                           ((0, -8), (-4, -13))])
def test_a_mark_falls_where_the_convention_says(source, image, centre_px):
    lens = make_lens(marked_psf(10, 8))  # v: 5 px outwards; u: 4 px along (sin, -cos)
    result = simulate(points_image([source], centre_px=centre_px), lens, pixels(1))
    assert lit_pixels(result) == {image: pytest.approx(1.0)}


@pytest.mark.parametrize("shape", SHAPES[::3])
@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_energy_is_conserved(lens, shape, precision):
    report = Report()
    simulate(noise(shape, centre_px=(3.0, 5.0)), LENSES[lens], pixels(8, precision), report=report)
    energy = report.lens_image.energy
    tolerance = 1e-12 if precision == "float64" else 1e-6
    assert energy.out_w_per_nm == pytest.approx(energy.in_w_per_nm, rel=tolerance, abs=0)


@pytest.mark.parametrize("lens", LENSES)
def test_light_is_never_negative(lens):
    plane = np.random.default_rng(1).random((40, 50))
    plane[plane < 0.9] = 0
    plane[20, 25], plane[3, 40] = 1e6, 1e12
    result = simulate(SpectralImage(plane[None], 550.0, pitch_um=8.0), LENSES[lens], Options(azimuths=8)).cube
    assert result.min() >= 0


@pytest.mark.parametrize("lens", LENSES)
def test_dim_pixels_keep_single_precision_next_to_a_highlight(lens):
    """Without an FFT, rounding of bright light does not spread to dim pixels: each is accurate to its own last digits.
    """
    plane = np.full((50, 60), 1e-3)
    plane[20, 25] = 1e6
    image = SpectralImage(plane[None], 550.0, pitch_um=8.0)
    single, double = (simulate(image, LENSES[lens], pixels(8, precision)).cube for precision in ("float32", "float64"))
    np.testing.assert_allclose(single, double, rtol=1e-5)


def test_black_stays_black():
    image = SpectralImage(np.zeros((1, 70, 80)), 550.0, pitch_um=8.0)
    assert not simulate(image, LENSES["comatic"], pixels(4)).cube.any()
