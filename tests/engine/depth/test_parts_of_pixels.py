"""In narrow blur, rays look up the parts of pixels whose light is known."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from lenses import make_lens
from lensfield.engine.depth.cast import cast, casting_bytes
from lensfield.engine.depth.depth_range import blur_px
from lensfield.engine.field.radial.first_order import first_order_rays
from lensfield.engine.image.detail import Detail, merged
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.kernels.library import available
from lensfield.engine.lens.entrance_pupil import focus_nearness
from loops import using

PITCH_UM, TIMES, NM = 4.0, 2, (500.0, 600.0)
SHAPE, AXIS, MARGIN = (96, 132), (61.3, 40.8), (16, 20)
LAMP_AT, LAMP_SIDE = (71, 119), 5  # in parts: the lamp ends within pixels


@pytest.fixture(scope="module")
def lens():
    return make_lens(np.full((5, 5), 1 / 25), psf_pitch_um=0.5)


def depth_of_blur(lens, wanted_px):
    return 1 / (focus_nearness(lens) + wanted_px / blur_px(lens, PITCH_UM, 1.0, 0.0))


def scene(lens, blur, around=0.0, light=(1.0, 3.0)):
    """A lamp in front of even light, in the parts of pixels: LayeredRadiance."""
    grid = PixelGrid(SHAPE, PITCH_UM, AXIS, MARGIN).finer(TIMES)
    lamp = np.full(grid.shape_px, around, np.float32)
    lamp[tuple(slice(at, at + LAMP_SIDE) for at in LAMP_AT)] = 1
    cube = np.reshape(light, (2, 1, 1)) * lamp
    whole = Layer(cube, np.ones(grid.shape_px), np.full(grid.shape_px, depth_of_blur(lens, blur)))
    return LayeredRadiance((whole,), NM, grid, lens.capture_focal_length_mm)


def in_pixels(fine, detailed=True):
    """The same scene in whole pixels, with or without detail."""
    layer, = fine.layers
    detail = Detail.of(layer.cube, fine.wavelengths_nm, TIMES) if detailed else None
    whole = Layer(merged(layer.cube, TIMES), layer.alpha[::TIMES, ::TIMES], layer.depth_mm[::TIMES, ::TIMES],
                  detail=detail)
    return replace(fine, layers=(whole,), grid=fine.grid.coarser(TIMES))


def cast_all(layered, lens, most_of_lamps=1024):
    rays = first_order_rays(lens)
    return np.array([plane.blurred for plane in cast(layered, lens, lambda: rays, most_of_lamps=most_of_lamps)])


@pytest.mark.parametrize("variant", available())
@pytest.mark.parametrize("blur", [4.0, -7.0])
def test_a_lamp_in_narrow_blur_is_as_sharp_as_in_finer_pixels(lens, blur, variant):
    fine = scene(lens, blur)
    with using(variant):
        true = merged(cast_all(fine, lens), TIMES)
        detailed, even = (cast_all(in_pixels(fine, each), lens) for each in (True, False))
    off = [np.abs(picture - true).sum() / true.sum() for picture in (detailed, even)]
    assert off[0] < 0.012 and off[1] > 2 * off[0]
    np.testing.assert_allclose(detailed.sum(axis=(1, 2)), true.sum(axis=(1, 2)), rtol=2e-3)


def test_rays_look_up_whole_pixels_of_wide_discs(lens):
    fine = scene(lens, 40.0)
    np.testing.assert_array_equal(cast_all(in_pixels(fine), lens), cast_all(in_pixels(fine, False), lens))


@pytest.mark.parametrize("variant", available())
@pytest.mark.parametrize("blur", [3.0, -3.0])
def test_light_in_focus_stays_out_of_narrow_blur_beside_it(lens, blur, variant):
    """A bright wall in focus, next to dim stripes in front of it or behind it."""
    fine = scene(lens, 0.0)
    layer, (_, columns) = fine.layers[0], fine.grid.shape_px
    edge = columns // 2 + 1  # within a pixel
    light, depth_mm = np.full(fine.grid.shape_px, 9.0, np.float32), layer.depth_mm.copy()
    light[:, edge:] = 1 + np.arange(columns - edge) // 5 % 2
    depth_mm[:, edge - 1:] = depth_of_blur(lens, blur)
    fine = replace(fine, layers=(replace(layer, cube=np.stack([light, 3 * light]), depth_mm=depth_mm),))
    with using(variant):
        true, detailed = merged(cast_all(fine, lens), TIMES), cast_all(in_pixels(fine), lens)
    assert true.max() > 5
    beside = slice((edge - 8) // TIMES - MARGIN[1], (edge + 20) // TIMES - MARGIN[1])
    of_columns = [picture[..., beside].mean(axis=1) / [[1], [3]] for picture in (detailed, true)]
    np.testing.assert_allclose(*of_columns, atol=0.15)


def test_areas_of_tiles_whose_rays_look_up_parts_join_without_seams(lens, monkeypatch):
    """The same picture, whatever the number of tiles that are cast together."""
    layered = in_pixels(scene(lens, 11.0))
    pictures = []
    for rows in (1, 100):
        monkeypatch.setattr("lensfield.engine.depth.meetings.AREA_ROWS", rows)
        pictures.append(cast_all(layered, lens))
    np.testing.assert_allclose(*pictures, rtol=1e-4, atol=1e-6 * pictures[0].max())


def test_looking_up_parts_uses_at_most_the_estimated_memory(lens):
    fine = scene(lens, 6.0)
    grid = PixelGrid((480, 640), PITCH_UM, AXIS, MARGIN).finer(TIMES)
    cube = np.zeros((2, *grid.shape_px), np.float32)
    cube[:, 60:900:97, 60:1200:101] = 1
    layer = Layer(cube, np.ones(grid.shape_px), np.full(grid.shape_px, fine.layers[0].depth_mm[0, 0]))
    layered = in_pixels(replace(fine, layers=(layer,), grid=grid))
    rays = first_order_rays(lens)
    tracemalloc.start()
    for view in cast(layered, lens, lambda: rays, most_of_lamps=256):
        del view
    used = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert used < 1.3 * casting_bytes(layered, lens, 256)
