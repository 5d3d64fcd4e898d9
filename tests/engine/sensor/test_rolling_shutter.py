"""A rolling shutter, from pictures of the parts of a frame's time."""

import numpy as np
import pytest

from lensfield.engine import ImageError, InputError, SpectralImage
from lensfield.engine.sensor.rolling_shutter import rolling_irradiance
from refusals import refused

NM = [450.0, 600.0]


def images(cube, **changes):
    return [SpectralImage(each, NM, **{"pitch_um": 4.0, "quantity": "irradiance"} | changes) for each in cube]


@pytest.mark.parametrize("shutter_s, readout_s, count", [(0.01, 0.02, 7), (0.02, 0.005, 3), (0.004, 0.0, 5)])
def test_each_row_integrates_its_own_time(shutter_s, readout_s, count):
    """By hand: light that rises evenly, in steps, has in each row the mean of the steps between opening and closing."""
    cube = np.arange(1, count + 1)[:, None, None, None] * np.ones((1, 2, 12, 5)) * np.array([1, 3])[:, None, None]
    cube = cube * (1 + np.arange(5))
    rolled = rolling_irradiance(images(cube), shutter_s, readout_s)
    time_s = (np.arange(200000) + 0.5) / 200000 * (shutter_s + readout_s)
    level = 1 + np.floor(time_s / (shutter_s + readout_s) * count)
    for row in range(12):
        opening_s = readout_s * row / 12
        expected = level[(time_s >= opening_s) & (time_s < opening_s + shutter_s)].mean()
        np.testing.assert_allclose(rolled.cube[0, row], expected * (1 + np.arange(5)), rtol=1e-3)
        np.testing.assert_allclose(rolled.cube[1, row], 3 * expected * (1 + np.arange(5)), rtol=1e-3)


def test_a_vertical_edge_that_moves_to_the_right_leans_to_the_right_from_top_to_bottom():
    cube = np.zeros((8, 2, 80, 16), np.float32)
    for index, picture in enumerate(cube):
        picture[..., 2 * index] = 1  # a line, two pixels further each time
    rolled = rolling_irradiance(images(cube), 1e-9, 0.08)
    assert [int(row.argmax()) for row in rolled.cube[0, 5::10]] == [0, 2, 4, 6, 8, 10, 12, 14]


def test_a_scene_at_rest_keeps_its_light():
    cube = np.random.default_rng(3).random((2, 33, 21), np.float32)
    same = images(np.stack([cube] * 6), overscan_px=(2, 3))
    rolled = rolling_irradiance(same, 0.007, 0.013)
    np.testing.assert_allclose(rolled.cube, cube[:, 2:-2, 3:-3], rtol=1e-6)
    assert rolled.quantity == "irradiance" and rolled.frame_px == (29, 15)


def test_images_that_do_not_match_are_refused():
    cube = np.ones((1, 2, 4, 4))
    with refused(InputError, field="irradiances", value="empty", where="rolling shutter"):
        rolling_irradiance([], 0.01, 0.01)
    for changes in ({"pitch_um": 3.0}, {"quantity": "radiance"}):
        with refused(ImageError, field="sampling", value="different", where="image",
                     match="expected pixels, wavelengths and units as in the first"):
            rolling_irradiance(images(cube) + images(cube, **changes), 0.01, 0.01)
    with refused(InputError, field="shutter_s, readout_s", where="rolling shutter",
                 match="expected a positive number, and 0 or more"):
        rolling_irradiance(images(cube), 0.0, 0.01)
