"""Light that arrives at a sensor: its sum and its places, by the lens image without blur."""

from dataclasses import replace

import numpy as np
import pytest

from afocal import AFOCAL
from lenses import make_grid_lens, make_lens, tinted
from lensfield.engine import simulate
from lensfield.engine.bake.bake import bake
from lensfield.engine.bake.quality import SKETCH
from lensfield.engine.depth.depth_range import blur_px
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE
from lensfield.engine.image.sources import Sources
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.library import prescription_of
from lensfield.engine.library.rays import sketched_rays
from lensfield.engine.rays.rings import Rings, turned
from lensfield.engine.stray.arrivals import arrivals

pytestmark = pytest.mark.one_blender
NM, FOCAL_MM = np.array([450.0, 600.0]), 10.0
GRID = PixelGrid((150, 210), 20.0, centre_px=(60.0, 120.0), overscan_px=(10, 12))
INFINITY = dict(efl_mm=FOCAL_MM, object_distance_mm=np.inf, magnification=0.0)


def distorted_lens():
    return tinted(make_lens(real_height_mm=lambda nm, h: h * (1 - 0.02 * h * h) * (1 + nm * 1e-5),
                            relative_illumination=lambda nm, h: 1 - 0.1 * h**2, **INFINITY))


def grid_lens():
    return tinted(make_grid_lens(source_mm=lambda nm, x, y: (1.02 * x + 0.01 * x * y, y + 0.005 * x * x),
                                 relative_illumination=lambda nm, x, y: 1 - 0.05 * x, **INFINITY))


def spot_picture(grid=GRID):
    """A blob of light in the frame, on no border of cells."""
    rows, columns = np.ogrid[:grid.shape_px[0], :grid.shape_px[1]]
    blob = np.exp(-((rows - 37.3) ** 2 + (columns - 141.8) ** 2) / 30)
    return SpectralImage(np.stack([blob, 3 * blob]), NM, grid)


@pytest.mark.parametrize("make", [distorted_lens, grid_lens])
@pytest.mark.parametrize("projection", [None, FISHEYE])
def test_light_and_places_are_those_of_the_lens_image(make, projection):
    lens, radiance = make(), spot_picture()
    if projection:
        radiance = SpectralImage(radiance.cube, NM, radiance.grid, projection=projection)
    light, image = arrivals(radiance, lens), simulate(radiance, lens)
    frame = image.cube.astype(float)
    np.testing.assert_allclose(light.light.sum(axis=1), frame.sum(axis=(1, 2)), rtol=2e-3)
    x_mm, y_mm = image.grid.axes_mm()
    for weights, places_mm, axis_mm in ((frame.sum(axis=1), light.x_mm, x_mm), (frame.sum(axis=2), light.y_mm, y_mm)):
        middle_mm = (light.light * places_mm).sum(axis=1) / light.light.sum(axis=1)
        expected_mm = (weights * axis_mm).sum(axis=1) / weights.sum(axis=1)
        np.testing.assert_allclose(middle_mm, expected_mm, atol=0.02 * GRID.pitch_um * 1e-3)


@pytest.mark.parametrize("make", [distorted_lens, grid_lens])
def test_a_source_arrives_like_a_pixel(make):
    lens, (row, column) = make(), (30, 150)
    plane = np.zeros(GRID.shape_px)
    plane[row, column] = 7
    x_mm, y_mm = GRID.position_mm(row, column)
    direction = np.array([x_mm, y_mm, FOCAL_MM]) / np.sqrt(x_mm**2 + y_mm**2 + FOCAL_MM**2)
    irradiance = 7 * (GRID.pitch_um * 1e-3 / FOCAL_MM) ** 2 * direction[2] ** 3
    source = Sources(direction[None], np.array([np.inf]), np.full((1, 2), irradiance), NM, np.array([0.01]), ("lamp",))
    pixel = arrivals(SpectralImage(np.stack([plane, plane]), NM, GRID), lens)
    light = arrivals(SpectralImage(np.zeros((2, *GRID.shape_px)), NM, GRID), lens, source)
    lit = pixel.light[0].argmax()
    for name in ("light", "x_mm", "y_mm"):
        np.testing.assert_allclose(getattr(light, name)[:, -1], getattr(pixel, name)[:, lit], rtol=1e-3)
    assert light.radius_px[-1] == pytest.approx(0.01 * FOCAL_MM / 0.02)
    assert pixel.radius_px[lit] == pytest.approx(np.sqrt(4 / 12))  # of a square pixel


def test_a_source_behind_the_camera_is_dark_and_one_beyond_the_field_as_dim_as_its_pupil():
    lens = make_lens(**INFINITY)
    directions = np.array([[0.6, 0, -0.8], [np.sin(1.2), 0, np.cos(1.2)], [0, 0, 1]])
    sources = Sources(directions, np.full(3, np.inf), np.ones((3, 2)), NM, np.zeros(3), ("behind", "sideways", "ahead"))
    light = arrivals(SpectralImage(np.zeros((2, *GRID.shape_px)), NM, GRID), lens, sources).light[:, -3:]
    pupil_px = np.pi / 4 * (FOCAL_MM / 2 / 0.02) ** 2
    np.testing.assert_allclose(light[:, 2], pupil_px, rtol=1e-6)
    np.testing.assert_allclose(light[:, 0], 0)
    edge = 1 + (2 / FOCAL_MM) ** 2  # the field ends at 2 mm, with a relative illumination of 1: no cos^4
    np.testing.assert_allclose(light[:, 1], pupil_px * np.cos(1.2) * edge**2, rtol=1e-6)


def in_layers(grid, nm, depth_mm, place, ground_mm=np.inf, ground=0.0, focal_mm=None):
    """A lamp of one pixel in front of a ground."""
    lamp, everywhere = np.zeros(grid.shape_px), np.ones(grid.shape_px)
    lamp[place] = 1
    return LayeredRadiance(tuple(Layer(np.stack([light * alpha] * len(nm)), alpha, mm * everywhere) for light, alpha, mm
                                 in ((1e3, lamp, depth_mm), (ground, everywhere, ground_mm))), nm, grid, focal_mm)


@pytest.mark.parametrize("make", [distorted_lens, grid_lens])
def test_light_out_of_focus_is_as_wide_as_its_blur(make):
    """A lamp in focus stays sharp in front of a ground that is not."""
    lens = make()
    for lamp_mm, ground_mm in ((300.0, np.inf), (np.inf, 300.0)):
        layers = in_layers(GRID, NM, lamp_mm, (30, 150), ground_mm, 1.0)
        light, flat = arrivals(layers.flat(), lens, layers=layers), arrivals(layers.flat(), lens)
        radii_px = np.abs(blur_px(lens, GRID.pitch_um, [lamp_mm, ground_mm])) / 2
        cell = flat.light[0].argmax()
        assert light.radius_px[cell] == pytest.approx(np.hypot(flat.radius_px[cell], radii_px[0]), abs=0.05)
        np.testing.assert_allclose(light.radius_px[0], np.hypot(flat.radius_px[0], radii_px[1]))
        for name in ("light", "x_mm", "y_mm"):
            np.testing.assert_array_equal(getattr(light, name), getattr(flat, name))


def test_a_lamp_beyond_the_picture_is_as_wide_as_its_blur():
    lens, direction = distorted_lens(), np.array([[0.6, 0, 0.8]])
    lamp = Sources(direction, np.array([400.0]), np.ones((1, 2)), NM, np.zeros(1), ("lamp",))
    light = arrivals(SpectralImage(np.zeros((2, *GRID.shape_px)), NM, GRID), lens, lamp)
    assert light.radius_px[-1] == pytest.approx(blur_px(lens, GRID.pitch_um, 320.0) / 2)


@pytest.mark.parametrize("across", [1, 4])
def test_a_lamp_through_an_anamorphic_lens_is_where_its_rays_put_it(across):
    """Nearer than the focus: the entrance pupils of its width and its height are 51 mm apart."""
    triplet = prescription_of("cooke-triplet-50mm")
    design = turned(replace(triplet, surfaces=AFOCAL + triplet.surfaces), Rings(2000.0, 4.0)).prescription
    lens = replace(bake(design, quality=SKETCH, wavelengths_nm=[550.0], samples=17, pitch_um=4.0), prescription=design)
    grid = PixelGrid((76, 104), lens.sensor_mm[0] / 96e-3, centre_px=(40.0, 47.0), overscan_px=(2, 4),
                     squeeze=lens.squeeze)
    layers = in_layers(grid.finer_across(across), [550.0], 350.0, (25, 70 * across + across // 2),
                       focal_mm=lens.capture_focal_length_mm)
    image = simulate(layers, lens, rays=sketched_rays).cube[0].astype(float)
    light = arrivals(layers.flat(), lens, layers=layers)
    found = grid.frame().index_of(*(np.average(at_mm[0], weights=light.light[0])
                                    for at_mm in (light.x_mm, light.y_mm)))
    centroid = [np.average(at, weights=image) for at in np.indices(image.shape)]
    np.testing.assert_allclose(found, centroid, atol=0.2)  # the place in focus is 2.9 px away
    moments = [np.average((at - middle)**2, weights=image) for at, middle in
               zip(np.indices(image.shape), centroid, strict=True)]
    assert light.radius_px.max() == pytest.approx(2 * np.sqrt(np.mean(moments)), rel=0.15)
