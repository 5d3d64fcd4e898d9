"""Folding onto a quadrant: unfolding restores the picture, and the blur equals that of the full plane."""

import numpy as np
import pytest

from lenses import comatic_lens, distance_of_light, gaussian_psf, lopsided_lens, make_lens, marked_psf
from lensfield.engine import Options, Report, SpectralImage, simulate
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.symmetry import mirror_symmetric

SHAPES = [(1, 1), (4, 6), (5, 6), (4, 7), (5, 7), (1, 4)]


def quadrants(plane, rim_px=0):
    return Planes(PixelGrid(plane.shape, 1.0), True).split(plane, rim_px)


def fold(plane):
    return Planes(PixelGrid(plane.shape, 1.0), True).without_doubles(quadrants(plane))


def test_quadrants_have_the_axis_at_their_upper_left():
    plane = np.arange(16.0).reshape(4, 4)
    lower_right, upper_right, lower_left, upper_left = fold(plane)
    assert lower_right.tolist() == [[10, 11], [14, 15]]
    assert upper_right.tolist() == [[6, 7], [2, 3]]
    assert lower_left.tolist() == [[9, 8], [13, 12]]
    assert upper_left.tolist() == [[5, 4], [1, 0]]


def test_a_middle_line_is_folded_once():
    assert fold(np.ones((3, 3))).sum() == 9


def test_a_middle_line_is_in_both_quadrants_until_doubles_are_removed():
    plane = np.arange(9.0).reshape(3, 3)
    assert [part.tolist() for part in quadrants(plane)] == [
        [[4, 5], [7, 8]], [[4, 5], [1, 2]], [[4, 3], [7, 6]], [[4, 3], [1, 0]]]
    assert [part.tolist() for part in fold(plane)] == [
        [[4, 5], [7, 8]], [[0, 0], [1, 2]], [[0, 3], [0, 6]], [[0, 0], [0, 0]]]


@pytest.mark.parametrize("shape", [(6, 8), (7, 8), (6, 9), (7, 9)])
def test_a_rim_continues_across_the_axis_and_is_black_outside_the_picture(shape):
    plane = np.random.default_rng(1).random(shape)
    narrow, wide = quadrants(plane), quadrants(plane, 2)
    np.testing.assert_array_equal(wide[:, 2:-2, 2:-2], narrow)
    assert not wide[:, -2:].any() and not wide[:, :, -2:].any()
    wide = wide[:, :-2, :-2]
    # Beyond the upper edge of the lower right quadrant is the upper right one, upside down; middle lines occur once.
    rows, columns = (n % 2 for n in shape)
    np.testing.assert_array_equal(wide[0, 1::-1, 2:], narrow[1, rows:2 + rows])
    np.testing.assert_array_equal(wide[0, 2:, 1::-1], narrow[2, :, columns:2 + columns])
    np.testing.assert_array_equal(wide[0, 1::-1, 1::-1], narrow[3, rows:2 + rows, columns:2 + columns])


@pytest.mark.parametrize("shape", [(6, 8), (7, 8), (6, 9), (7, 9)])
@pytest.mark.parametrize("rim_px", [2, 20])
def test_samples_of_all_planes_are_together_and_reach_across_the_axis(shape, rim_px):
    picture = np.random.default_rng(2).random(shape)
    planes, axis = Planes(PixelGrid(shape, 1.0), True).together(picture, rim_px)
    first = [max(n // 2 - rim_px, 0) for n in shape]
    assert axis == tuple((n - 1) / 2 - start for n, start in zip(shape, first, strict=True))
    turned = [picture, picture[::-1], picture[:, ::-1], picture[::-1, ::-1]]
    np.testing.assert_array_equal(planes, np.stack([each[first[0]:, first[1]:] for each in turned], axis=2))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("radius", [0, 2])
def test_unfolding_restores_the_plane(shape, radius):
    plane = np.random.default_rng(2).random(shape)
    canvases = np.pad(fold(plane), ((0, 0), (radius, radius), (radius, radius)))
    joined = Planes(PixelGrid(shape, 1.0), True).join(canvases, radius)
    np.testing.assert_array_equal(joined, np.pad(plane, radius))


def test_an_unfolded_picture_is_a_single_plane():
    plane = np.random.default_rng(2).random((5, 4))
    planes = Planes(PixelGrid(plane.shape, 1.0), False)
    assert planes.count == 1 and planes.grid == planes.picture
    np.testing.assert_array_equal(planes.split(plane, 2), np.pad(plane, 2)[None])
    np.testing.assert_array_equal(planes.join(planes.without_doubles(plane[None])), plane)
    assert planes.light(plane[None]) == plane.sum()


@pytest.mark.parametrize("shape", SHAPES)
def test_quadrant_pixels_have_the_positions_of_the_picture(shape):
    picture = PixelGrid(shape, 10.0)
    x_mm, y_mm = Planes(picture, True).grid.axes_mm()
    np.testing.assert_allclose(x_mm, picture.axes_mm()[0][shape[1] // 2:], atol=1e-15)
    np.testing.assert_allclose(y_mm, picture.axes_mm()[1][shape[0] // 2:], atol=1e-15)


@pytest.mark.parametrize("window", [8, 9])
def test_a_lopsided_psf_is_unchanged(window):
    table = marked_psf(1, 2, window)[None]
    same, symmetric = mirror_symmetric(table)
    assert not symmetric and same is table


def test_noise_is_averaged_away():
    table = gaussian_psf(3, 2, 1.0, 16)[None]
    noisy = table + 1e-6 * np.random.default_rng(0).random(table.shape)
    mended, symmetric = mirror_symmetric(noisy)
    assert symmetric and mended.shape == (1, 17, 17)
    np.testing.assert_array_equal(mended, mended[..., ::-1])
    assert mended.sum() == pytest.approx(noisy.sum(), rel=1e-12)


OFF_BY_NOTHING_PX = 1e-7  # of the axis: too little to change a picture, but enough to prevent folding


@pytest.mark.parametrize("options", [dict(method="pixels", azimuths=5), dict(section_size=8, azimuths=5),
                                     dict(section_size=16, azimuths=2, flat_tolerance=1e-3)], ids=str)
@pytest.mark.parametrize("shape", [(40, 60), (41, 60), (40, 61), (41, 61)])
def test_a_folded_picture_equals_the_unfolded_picture(shape, options):
    """Coma and distortion grow with the field, which exposes a quadrant flipped the wrong way."""
    lens, options = comatic_lens(), Options(**options, precision="float64")
    cube = np.random.default_rng(5).random((1, *shape))
    folded, unfolded = Report(), Report()
    centre = (shape[0] - 1) / 2, (shape[1] - 1) / 2 + OFF_BY_NOTHING_PX
    result = simulate(SpectralImage(cube, [550], pitch_um=30.0), lens, options, report=folded).cube
    off_centre = SpectralImage(cube, [550], pitch_um=30.0, centre_px=centre)
    expected = simulate(off_centre, lens, options, report=unfolded).cube
    # On the axis, rounding decides which direction is radial, and scales there differ by up to 1e-5.
    np.testing.assert_allclose(result, expected, atol=1e-5 * expected.max())
    assert folded.lens_image.plan.folded and not unfolded.lens_image.plan.folded


def test_a_folded_picture_matches_the_exact_operator():
    lens = comatic_lens()
    radiance = SpectralImage(np.random.default_rng(5).random((1, 41, 60)), [550], pitch_um=30.0)
    exact = simulate(radiance, lens, Options(method="exact")).cube
    assert distance_of_light(simulate(radiance, lens, Options(method="pixels", azimuths=64)).cube, exact) < 1e-4


def test_pictures_of_a_lopsided_lens_are_not_folded():
    lens, report = lopsided_lens(), Report()
    radiance = SpectralImage(np.random.default_rng(5).random((1, 30, 41)), [550], pitch_um=30.0)
    exact = simulate(radiance, lens, Options(method="exact")).cube
    result = simulate(radiance, lens, Options(method="pixels", azimuths=64), report=report).cube
    assert distance_of_light(result, exact) < 1e-4
    assert not report.lens_image.plan.folded


@pytest.mark.parametrize("shape", [(40, 60), (41, 60), (40, 61), (41, 61), (1, 1), (1, 8)])
def test_light_on_shared_middle_lines_is_counted_once(shape):
    report = Report()
    cube = np.random.default_rng(5).random((1, *shape)).astype(np.float32)
    simulate(SpectralImage(cube, [550], pitch_um=30.0), make_lens(), Options(section_size=8, precision="float64"),
             report=report)
    light = np.pi / 16 * cube.sum(dtype=float) * (30e-6)**2
    assert report.lens_image.plan.folded
    assert report.lens_image.energy.in_w_per_nm == pytest.approx(light, rel=1e-7, abs=0)
    assert report.lens_image.energy.out_w_per_nm == pytest.approx(light, rel=1e-7, abs=0)
