"""SpectralImage: axes, the position of the optical axis, overscan, and invalid values."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import ImageError, SpectralImage
from lensfield.engine.image.pixel_grid import PixelGrid
from refusals import refused


def image(**changes):
    return SpectralImage(**dict(cube=np.zeros((2, 4, 6)), wavelengths_nm=[500, 600], pitch_um=10.0) | changes)


def test_axis_falls_on_the_middle_of_the_frame_by_default():
    assert image().centre_px == (1.5, 2.5)
    assert image(cube=np.zeros((2, 5, 7))).centre_px == (2.0, 3.0)


def test_one_plane_may_come_without_a_wavelength_axis():
    assert SpectralImage(np.zeros((4, 6)), 550.0, pitch_um=1.0).cube.shape == (1, 4, 6)


def test_cube_is_float32():
    assert image().cube.dtype == np.float32


def test_frame_is_the_cube_without_its_overscan():
    cube = np.arange(48.0).reshape(1, 6, 8)
    frame = image(cube=cube, wavelengths_nm=[500], overscan_px=(1, 2)).frame()
    np.testing.assert_array_equal(frame.cube, cube[:, 1:5, 2:6])
    assert frame.overscan_px == (0, 0)
    assert frame.centre_px == (1.5, 1.5)


def test_cropping_keeps_every_pixel_in_place_on_the_sensor():
    full = image(cube=np.zeros((2, 10, 12)), overscan_px=(3, 4), centre_px=(2.0, 7.5))
    part = full.cropped((1, 2))
    assert part.overscan_px == (2, 2)
    assert part.frame_px == full.frame_px == (4, 4)
    assert part.grid.position_mm(0, 0) == full.grid.position_mm(1, 2)


def test_centre_may_be_an_array():
    assert image(centre_px=np.array([1.0, 2.0])).centre_px == (1.0, 2.0)


@pytest.mark.parametrize("field, value", [
    ("cube", np.zeros(3)), ("cube", np.zeros((2, 0, 6))), ("cube", np.zeros((1, 2, 4, 6))),
    ("wavelengths_nm", [500]), ("wavelengths_nm", [600, 500]), ("wavelengths_nm", [500, 500]),
    ("wavelengths_nm", [0, 500]), ("wavelengths_nm", [500, np.nan]),
    ("pitch_um", 0.0), ("pitch_um", -5.0), ("pitch_um", np.nan), ("pitch_um", np.inf),
    ("quantity", "luminance"), ("overscan_px", (-1, 0)), ("overscan_px", (2, 0)), ("overscan_px", (0, 3)),
    ("centre_px", (np.nan, 1.0)), ("centre_px", (1.0, 2.0, 3.0)), ("centre_px", (np.inf, 1.0)),
])
def test_a_wrong_field_is_named(field, value):
    with refused(ImageError, field=field):
        image(**{field: value})


def test_a_complete_grid_may_be_given_and_must_fit():
    grid = PixelGrid((4, 6), 10.0, overscan_px=(1, 1))
    picture = SpectralImage(np.zeros((1, 4, 6)), [500], grid)
    assert picture.grid == grid
    changed = replace(picture, pitch_um=4.0, overscan_px=(0, 0))
    assert changed.grid == replace(grid, pitch_um=4.0, overscan_px=(0, 0))
    with pytest.raises(ImageError, match="grid is 5.0: expected a PixelGrid"):
        SpectralImage(np.zeros((1, 4, 6)), [500], 5.0)
    with refused(ImageError, field="cube", where="image",
                 match=r"cube is 'of \(3, 6\) px': expected \(4, 6\)|, as in its grid"):
        SpectralImage(np.zeros((1, 3, 6)), [500], grid)
