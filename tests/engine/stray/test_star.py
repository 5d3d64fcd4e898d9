"""Stars: the diffraction of an iris far from a lamp, against direct Fraunhofer integrals and the Airy pattern."""

import numpy as np
import pytest
import scipy

from lenses import make_lens, tinted
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.lens.iris import Iris, opening_within
from lensfield.engine.stray.arrivals import arrivals
from lensfield.engine.stray.options import StrayOptions
from lensfield.engine.stray.star import add_stars, edges_of, star_share
from lensfield.engine.stray.stray_light import stray_light

NM, N, PITCH_UM, WINDOW = np.array([450.0, 520.0, 650.0]), 8.0, 20.0, 41
FRAME = PixelGrid((280, 360), PITCH_UM, centre_px=(120.0, 190.0))
LAMP_PX = 96, 217
HEXAGON = Iris(6, 10.0)


def lens_at(f_number=N):
    return tinted(make_lens(np.ones((WINDOW, WINDOW)) / WINDOW**2, psf_pitch_um=5.0, f_number_effective=f_number,
                            efl_mm=50.0, object_distance_mm=np.inf, magnification=0.0))


def star(iris, radiance, rim=np.inf, grid=FRAME):
    """The star of a picture over its light, per wavelength, and the share that it should have."""
    lens, opening = lens_at(), opening_within(iris, rim)
    light = arrivals(SpectralImage(np.stack([radiance] * NM.size), NM, grid), lens)
    cube = np.zeros((NM.size, *grid.frame_px), np.float32)
    share = add_stars(cube, lens, opening, grid.frame(), light)
    return cube / light.light.sum(axis=1)[:, None, None], share


def lamp(place=LAMP_PX, grid=FRAME, size=1):
    plane = np.zeros(grid.shape_px)
    plane[place[0]:place[0] + size, place[1]:place[1] + size] = 1e3
    return plane


def k_per_px(nm):
    return np.pi * PITCH_UM * 1e-3 / (nm * 1e-6 * N)


def fraunhofer(opening, k_right, k_up):
    """|transform of a polygon|^2 over 4 pi^2 times its area: a sum over its edges."""
    azimuth = np.radians(opening.iris.rotation_deg) + np.pi / opening.iris.blades * (
        1 + 2 * np.arange(opening.iris.blades))
    corners = opening.corner * np.stack([np.cos(azimuth), np.sin(azimuth)])
    middles, sides = (np.roll(corners, -1, axis=1) + corners) / 2, np.roll(corners, -1, axis=1) - corners
    total = 0
    for (x, y), (right, up) in zip(middles.T, sides.T, strict=True):
        along = np.sinc((k_right * right + k_up * up) / (2 * np.pi))
        total = total + (k_right * up - k_up * right) * along * np.exp(-1j * (k_right * x + k_up * y))
    return np.abs(total) ** 2 / (k_right**2 + k_up**2) ** 2 / (4 * np.pi**3)


def airy(k_right, k_up):
    k = np.hypot(k_right, k_up)
    return (2 * np.pi * scipy.special.j1(k) / k) ** 2 / (4 * np.pi**3)


def block(density, right, up, nm, size=3, samples=48):
    """The share of the light on a block of pixels, by the integral over each: fringes are finer than pixels."""
    k = k_per_px(nm)
    inner = (np.arange(samples * size) + 0.5) / samples - size / 2
    return density(k * (right + inner), k * (up - inner)[:, None]).mean() * (k * size) ** 2


@pytest.mark.one_blender
@pytest.mark.parametrize(("azimuth_deg", "distance_px"), [(10, 40), (10, 110), (190, 80), (-50, 60),  # spikes
                                                          (20, 60), (30, 60), (40, 90), (130, 30)])  # between them
def test_a_star_is_the_transform_of_the_blades(azimuth_deg, distance_px):
    cube, _ = star(HEXAGON, lamp())
    right, up = (round(distance_px * each(np.radians(azimuth_deg))) for each in (np.cos, np.sin))
    row, column, opening = LAMP_PX[0] - up, LAMP_PX[1] + right, opening_within(HEXAGON, np.inf)
    measured = cube[:, row - 3:row + 4, column - 3:column + 4].sum(axis=(1, 2))
    expected = [block(lambda *k: fraunhofer(opening, *k), right, up, nm, size=7, samples=32) for nm in NM]
    np.testing.assert_allclose(measured, expected, rtol=0.03)


@pytest.mark.one_blender
@pytest.mark.parametrize("iris", [Iris(0), Iris(7, 20.0, 1.0), Iris(5, 20.0)])
def test_a_round_stop_has_an_airy_pattern(iris):
    """The blades of the last one are behind the rim of the widest stop."""
    cube, _ = star(iris, lamp(), rim=1.0)
    for right, up in ((40, 5), (-20, -70), (11, 60)):
        row, column = LAMP_PX[0] - up, LAMP_PX[1] + right
        measured = cube[:, row - 1:row + 2, column - 1:column + 2].sum(axis=(1, 2))
        np.testing.assert_allclose(measured, [block(airy, right, up, nm) for nm in NM], rtol=0.02)
        asymptote = k_per_px(NM) ** 2 / np.pi**2 / (k_per_px(NM) * np.hypot(right, up)) ** 3
        np.testing.assert_allclose(measured, 9 * asymptote, rtol=0.02)


@pytest.mark.one_blender
@pytest.mark.parametrize(("iris", "spikes"), [(Iris(6, 10.0), 6), (Iris(5, 10.0), 10), (Iris(8, 33.0, 0.1), 8),
                                              (Iris(9, -5.0), 18)])
def test_blades_have_spikes_along_their_normals(iris, spikes):
    cube, _ = star(iris, lamp())
    azimuth = 2 * np.pi * np.arange(720) / 720
    ring = scipy.ndimage.map_coordinates(cube[1], [LAMP_PX[0] - 60 * np.sin(azimuth),
                                                   LAMP_PX[1] + 60 * np.cos(azimuth)], order=1)
    bright = ring > 0.1 * ring.max()
    starts = np.flatnonzero(bright & ~np.roll(bright, 1))
    assert starts.size == spikes
    normals = np.radians(iris.rotation_deg) + np.pi * np.arange(spikes) / (spikes / 2)
    away = (azimuth[bright][:, None] - normals + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(away).min(axis=1).max() < np.radians(4) + np.arcsin(iris.roundness * np.sin(np.pi / 8))


@pytest.mark.one_blender
@pytest.mark.sample(3)
@pytest.mark.parametrize("iris", [Iris(0), HEXAGON, Iris(5, 20.0, 0.3), Iris(7, 1.0, 1.0)])
@pytest.mark.parametrize("even", [False, True])
def test_a_star_has_the_light_that_the_image_loses(iris, even):
    """A lamp's, and an even picture's, whose stars are coarse. The rest falls beyond the frame, at a distance of more
    than 90 pixels, and less than the diagonal."""
    plane = np.zeros(FRAME.shape_px)
    plane[110:160, 150:200] = 1
    cube, share = star(iris, plane if even else lamp((130, 180)))
    perimeter = sum(edge.count * edge.length for edge in edges_of(opening_within(iris, np.inf)))
    beyond = perimeter / np.pi**2 / k_per_px(NM)
    measured = cube.sum(axis=(1, 2))
    assert np.all(share - beyond / 90 < measured * 1.03) and np.all(measured < 1.03 * share)


@pytest.mark.one_blender
@pytest.mark.parametrize("iris", [Iris(0), HEXAGON])
def test_the_coarse_star_of_the_middle_wavelength_is_that_of_its_light_alone(iris):
    """Where the width of stars depends on the wavelength: far stopped down, the image of a point is wider than the
    window of its PSF."""
    rows, columns = np.ogrid[:FRAME.shape_px[0], :FRAME.shape_px[1]]
    plane, lens = 1.0 + np.hypot(rows, 2 * columns) / 200, lens_at(64.0)  # without lamps, whose stars are fine

    def coarse_star(nm):
        light = arrivals(SpectralImage(np.stack([plane] * len(nm)), nm, FRAME), lens)
        cube = np.zeros((len(nm), *FRAME.frame_px), np.float32)
        add_stars(cube, lens, opening_within(iris, np.inf), FRAME, light)
        return cube[len(nm) // 2]

    alone = coarse_star(NM[1:2])
    np.testing.assert_allclose(coarse_star(NM), alone, rtol=1e-4, atol=1e-5 * alone.max())


@pytest.mark.one_blender
@pytest.mark.parametrize("iris", [Iris(0), HEXAGON, Iris(5, 20.0), Iris(6, 0.0, 0.4), Iris(8, 3.0, 1.0)])
@pytest.mark.parametrize("rim", [1.0, 1.01, 1.04, np.inf])
def test_edges_are_as_long_as_the_outline(iris, rim):
    opening = opening_within(iris, rim)
    azimuth = 2 * np.pi * np.arange(36000) / 36000
    radius = np.full(azimuth.size, opening.reach)
    (margin, bend, slope), directions = opening.shape, iris.directions
    for across, up in directions:
        along = slope * (across * np.cos(azimuth) + up * np.sin(azimuth))
        with np.errstate(divide="ignore"):
            reach = 2 * margin / (along + np.sqrt(along**2 + 4 * bend * margin))
        radius = np.minimum(radius, np.where((along > 0) | (bend > 0), reach, np.inf))
    outline = radius * np.exp(1j * azimuth)
    edges = edges_of(opening)
    assert sum(edge.count * edge.length for edge in edges) == pytest.approx(
        np.abs(np.diff(outline, append=outline[0])).sum(), rel=1e-4)


@pytest.mark.one_blender
def test_the_share_is_that_outside_the_window():
    """By the Airy pattern's encircled energy: 1 - J0^2 - J1^2."""
    radius_mm = np.sqrt(2) / 4 * np.pi * WINDOW * 5e-3 / 2
    k = np.pi * radius_mm / (NM * 1e-6 * N)
    beyond = scipy.special.j0(k) ** 2 + scipy.special.j1(k) ** 2
    share = star_share(lens_at(), opening_within(Iris(0), np.inf), NM)
    np.testing.assert_allclose(share, beyond, rtol=0.01)
    np.testing.assert_allclose(star_share(lens_at(2.0), opening_within(Iris(0), np.inf), NM), share / 4)


def star_at(depth_mm, radiance, beyond=0.0):
    """The star of light at a depth, in front of light at infinity, which is in focus."""
    def layer(plane, alpha, depth_mm):
        return Layer(np.stack([plane] * NM.size), alpha, np.full(FRAME.shape_px, depth_mm))

    everywhere = np.ones(FRAME.shape_px)
    layers = LayeredRadiance((layer(radiance, radiance > 0, depth_mm), layer(beyond * everywhere, everywhere, np.inf)),
                             NM, FRAME)
    return stray_light(layers.flat(), lens_at(), StrayOptions("star"), 0.01, layers=layers, iris=HEXAGON).cube


def disc(diameter_px):
    """Shares of the pixels that an even disc covers."""
    side = 2 * (int(diameter_px / 2) + 1) + 1
    inner = (np.arange(16 * side) + 0.5) / 16 - side / 2
    covered = np.hypot(inner, inner[:, None]).reshape(-1, 1, 16 * side) < diameter_px / 2
    shares = covered.reshape(side, 16, side, 16).mean(axis=(1, 3))
    return shares / shares.sum()


@pytest.mark.one_blender
@pytest.mark.parametrize(("blur_px", "misplaced"), [(9.0, 0.05), (28.0, 0.05), (70.0, 0.15)])
def test_a_star_out_of_focus_is_one_in_focus_spread_over_the_blur(blur_px, misplaced):
    """In blocks of 7 x 7 px, far enough from the frame's edges: the star in focus ends there."""
    depth_mm = 50.0**2 / N / (PITCH_UM * 1e-3) / blur_px
    focused, blurred = star_at(np.inf, lamp()), star_at(depth_mm, lamp())
    np.testing.assert_allclose(blurred.sum(axis=(1, 2)), focused.sum(axis=(1, 2)), rtol=0.01)
    for plane, sharp in zip(blurred, focused, strict=True):
        spread = scipy.signal.fftconvolve(sharp, disc(blur_px), mode="same")
        found, expected = (each[35:245, 35:322].reshape(30, 7, 41, 7).sum(axis=(1, 3)) for each in (plane, spread))
        assert np.abs(found - expected).sum() < misplaced * expected.sum()
        assert plane.max() == pytest.approx(spread.max(), rel=0.25) and sharp.max() > 5 * plane.max()


@pytest.mark.one_blender
@pytest.mark.parametrize("depth_mm", [np.inf, 1200.0, 500.0])
def test_a_star_moves_with_its_lamp(depth_mm):
    """By a pixel, and so does nearly all of its light, also across the border of a cell; out of focus, too."""
    rng = np.random.default_rng(0)
    scene = rng.random(FRAME.shape_px)
    pictures = [star_at(depth_mm, 100 * lamp((96, column), size=2), scene)[1] for column in range(204, 210)]
    sums = [picture.sum() for picture in pictures]
    np.testing.assert_allclose(sums, np.mean(sums), rtol=0.02)
    for first, second in zip(pictures, pictures[1:], strict=False):
        away = np.abs(np.roll(first, 1, axis=1) - second)[:, 1:]
        assert away.sum() < 0.03 * sums[0]
