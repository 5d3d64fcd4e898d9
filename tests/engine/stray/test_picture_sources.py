"""Sources in a picture: their light, directions and distances by closed forms, and how they move with the picture."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine.image.directions import directions, holds, places_of, solid_angles_sr
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE, Projection
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.stray.picture_sources import GROUND_NODES, MOST_LAMPS, picture_sources

NM, FOCAL_MM = (450.0, 550.0, 650.0), 20.0
GRID = PixelGrid((60, 90), 200.0, centre_px=(20.0, 50.0), overscan_px=(6, 5), focal_mm=FOCAL_MM)


def picture(plane, grid=GRID, spectrum=(1.0, 2.0, 3.0)):
    return SpectralImage(np.multiply.outer(spectrum, plane), NM, grid)


def rectangle_sr(left, lower, right, upper):
    """Solid angle of a rectangle on the plane at distance 1."""
    def corner(x, y):
        return np.arctan2(x * y, np.sqrt(1 + x**2 + y**2))

    return corner(right, upper) - corner(left, upper) - corner(right, lower) + corner(left, lower)


@pytest.mark.parametrize("squeeze", [1.0, 1.5])
def test_an_even_picture_gives_its_radiance_times_its_solid_angle(squeeze):
    grid = replace(GRID, squeeze=squeeze)
    sources = picture_sources(picture(np.ones(GRID.shape_px), grid), FOCAL_MM)
    sr = rectangle_sr(*np.divide(GRID.edges_mm, FOCAL_MM) * (squeeze, 1, squeeze, 1))
    np.testing.assert_allclose(sources.irradiance.sum(axis=0), sr * np.array([1, 2, 3]), rtol=1e-4)
    assert len(sources) == np.prod(GROUND_NODES)
    np.testing.assert_allclose(np.linalg.norm(sources.directions, axis=1), 1)


@pytest.mark.parametrize("projection", [FISHEYE, Projection((1.1, 0.02, -0.05))])
def test_the_pixels_of_a_panorama_fill_a_cap(projection):
    grid = PixelGrid((401, 501), 100.0, projection=projection, focal_mm=FOCAL_MM)
    pixels = np.indices(grid.shape_px)
    angle_rad = np.arccos(directions(grid, *pixels)[..., 2])
    cap = solid_angles_sr(grid, *pixels)[angle_rad < 0.8].sum()
    np.testing.assert_allclose(cap, 2 * np.pi * (1 - np.cos(0.8)), rtol=2e-3)


@pytest.mark.parametrize("grid", [GRID, replace(GRID, squeeze=1.8), replace(GRID, projection=FISHEYE)], ids=str)
def test_places_are_the_inverse_of_directions(grid):
    pixels = np.indices(grid.shape_px)
    towards = directions(grid, *pixels)
    np.testing.assert_allclose(places_of(grid, towards), pixels, atol=2e-4)
    assert holds(grid, towards).all() and not holds(grid, -towards).any()
    assert not holds(grid, directions(grid, *(pixels + 90))).any()


def test_a_lamp_is_where_its_pixel_is():
    plane = np.zeros(GRID.shape_px)
    plane[8, 71] = 5.0
    sources = picture_sources(picture(plane), FOCAL_MM)
    tangents = 21 * 0.2 / FOCAL_MM, 12 * 0.2 / FOCAL_MM  # to the right, and up
    cosine = 1 / np.sqrt(1 + tangents[0]**2 + tangents[1]**2)
    np.testing.assert_allclose(sources.directions, [[tangents[0] * cosine, tangents[1] * cosine, cosine]], rtol=1e-6)
    sr = (0.2 / FOCAL_MM)**2 * cosine**3
    np.testing.assert_allclose(sources.irradiance, 5 * sr * np.array([[1, 2, 3]]), rtol=1e-6)
    np.testing.assert_allclose(np.pi * sources.radius_rad**2, (0.2 / FOCAL_MM)**2, rtol=1e-6)
    assert sources.names == ("picture at 2, 66 px",) and np.isinf(sources.distance_mm).all()


def between(place):
    """A lamp between two columns, in both of them."""
    plane = np.zeros(GRID.shape_px)
    column = int(place)
    plane[33, column:column + 2] = 1e5 * np.array([column + 1 - place, place - column])
    return plane


@pytest.mark.parametrize("share", [0.03, 0.3, 0.97])
def test_a_moving_lamp_moves_its_source_without_flicker(share):
    """Over a sky, with this share of its light, past the nodes of the ground and of large lamps."""
    sky = np.linspace(0.5, 1.5, GRID.shape_px[0])[:, None] * np.ones(GRID.shape_px)
    lamp = between(45.0).sum() * sky.sum() * share / (1 - share) / between(45.0).sum()
    distances = []
    for place in np.arange(20.0, 65.0, 0.375):
        moving = lamp / between(45.0).sum() * between(place)
        sources = picture_sources(picture(sky + moving), FOCAL_MM)
        right = np.array(places_of(GRID, sources.directions))
        near = np.hypot(right[0] - 33, right[1] - place) < 1.2
        light = sources.irradiance[near, 0]
        seen = moving * solid_angles_sr(GRID, *np.indices(GRID.shape_px))
        assert light.sum() == pytest.approx(seen.sum(), rel=0.02)
        distances.append(np.average(right[1, near], weights=light) - place)
    assert np.abs(distances).max() < 0.02


def test_a_bright_lamp_leaves_a_few_large_parts_for_the_rest():
    sources = picture_sources(picture(1 + between(45.0)), FOCAL_MM)
    assert len(sources) == 1 + np.prod(GROUND_NODES)
    assert sources.irradiance[0, 0] > 50 * sources.irradiance[1, 0]
    assert sources.radius_rad[0] < 0.02 < sources.radius_rad[1:].min()


def test_a_window_is_shared_out_over_its_area():
    window = np.zeros(GRID.shape_px)
    window[10:30, 20:45] = 50.0
    sources = picture_sources(picture(0.01 + window), FOCAL_MM)
    row, column = places_of(GRID, sources.directions)
    bright = sources.irradiance[:, 0] > 0.001 * sources.irradiance[:, 0].sum()
    assert 4 <= bright.sum() <= MOST_LAMPS and np.ptp(column[bright]) > 12 and np.ptp(row[bright]) > 8
    seen = (window * solid_angles_sr(GRID, *np.indices(GRID.shape_px))).sum()
    assert sources.irradiance[bright, 0].sum() == pytest.approx(seen, rel=0.02)


def test_faint_lamps_beyond_the_most_belong_to_the_ground():
    plane = np.zeros(GRID.shape_px)
    plane[3::8, 4::9] = np.arange(80.0).reshape(8, 10) + 20
    sources = picture_sources(picture(plane), FOCAL_MM)
    assert len(sources) <= MOST_LAMPS + np.prod(GROUND_NODES)
    seen = (plane * solid_angles_sr(GRID, *np.indices(GRID.shape_px))).sum()
    assert sources.irradiance[:, 0].sum() == pytest.approx(seen, rel=1e-5)


def test_layers_have_distances_and_hide_what_is_behind_them():
    half = np.full(GRID.shape_px, 0.5)
    front = Layer(np.multiply.outer([1, 2, 3], between(80.0)), half, np.full(GRID.shape_px, 500.0))
    behind = Layer(np.multiply.outer([3, 2, 1], between(10.0)), np.ones(GRID.shape_px), np.full(GRID.shape_px, np.inf))
    layers = LayeredRadiance([front, behind], NM, GRID)
    sources = picture_sources(layers.flat(), FOCAL_MM, layers)
    right, left = sorted(range(2), key=lambda index: -sources.directions[index, 0])
    assert len(sources) == 2 and np.isinf(sources.distance_mm[left])
    assert sources.distance_mm[right] == pytest.approx(500 / sources.directions[right, 2], rel=1e-6)
    sr = solid_angles_sr(GRID, 33, 10)
    np.testing.assert_allclose(sources.irradiance[left], 0.5e5 * sr * np.array([3, 2, 1]), rtol=1e-5)


def test_larger_pictures_are_divided_into_cells():
    grid = PixelGrid((1500, 2100), 10.0, focal_mm=FOCAL_MM)
    plane = np.zeros(grid.shape_px, np.float32)
    plane[1201, 77:80], plane[3, 2001] = 1.0, 7.0
    sources = picture_sources(SpectralImage(plane[None], [550.0], grid), FOCAL_MM)
    row, column = places_of(grid, sources.directions)
    np.testing.assert_allclose([row, column], [[3, 1201], [2001, 78]], atol=1e-2)


def test_dark_and_damaged_pictures():
    assert len(picture_sources(picture(np.zeros(GRID.shape_px)), FOCAL_MM)) == 0
    plane = between(45.0)
    plane[5, 5], plane[6, 50] = np.nan, -1.0
    sources = picture_sources(picture(plane), FOCAL_MM)
    assert len(sources) == 1 and np.isfinite(sources.irradiance).all()
