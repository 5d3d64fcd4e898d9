"""STMaps: warping with them equals the lens's distortion, in both directions, and the meaning of their values."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from lenses import make_lens
from lensfield.cli import main
from lensfield.engine import LensError, SpectralImage, simulate
from lensfield.engine.field.stmap import distort_map, map_overscan_px, pinhole_px, undistort_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.pictures.spectral_exr import read_parts
from refusals import refused
from varied_lenses import VARIED, varied_lens


def places_px(stmap):
    """Row and column in the source, by the convention of OpenCV's remap."""
    rows, columns = stmap.shape[:2]
    return (1 - stmap[..., 1].astype(float)) * rows - 0.5, stmap[..., 0].astype(float) * columns - 0.5


def warped(picture, stmap):
    return map_coordinates(picture, places_px(stmap), order=1, mode="nearest")


def frame_of(lens, rows=180, columns=240):
    return PixelGrid((rows, columns), 1e3 * lens.sensor_mm[0] / columns)


def test_without_distortion_the_map_is_the_identity():
    stmap = distort_map(make_lens(), PixelGrid((3, 4), 10.0), 550.0)
    np.testing.assert_allclose(stmap[0, 0], [0.5 / 4, 1 - 0.5 / 3, 1], atol=1e-6)
    np.testing.assert_allclose(stmap[2, 3], [3.5 / 4, 0.5 / 3, 1], atol=1e-6)
    np.testing.assert_array_equal(undistort_map(make_lens(), PixelGrid((3, 4), 10.0), 550.0), stmap)


def test_barrel_takes_its_corners_from_beyond_the_frame():
    lens = make_lens(real_height_mm=lambda nm, p: 0.8 * p)
    upper_left = distort_map(lens, PixelGrid((100, 100), 10.0), 550.0)[0, 0]
    # 49.5 px left of the axis and above it is the light that a pinhole has at 49.5 / 0.8.
    np.testing.assert_allclose(upper_left, [0.5 - 0.495 / 0.8, 0.5 + 0.495 / 0.8, 0], atol=1e-6)


def test_distortion_is_centred_on_the_axis():
    """A pixel 13 px right of the axis and 9 above it shows the light that a pinhole has at 1 / 0.8 of that."""
    lens = make_lens(real_height_mm=lambda nm, p: 0.8 * p)
    stmap = distort_map(lens, PixelGrid((90, 70), 10.0, centre_px=(61.0, 22.0)), 550.0)
    for right, up in ((0, 0), (13, 9)):
        place = [(22.5 + right / 0.8) / 70, 1 - (61.5 - up / 0.8) / 90, 1]
        np.testing.assert_allclose(stmap[61 - up, 22 + right], place, atol=1e-6)


def test_places_in_pixels_are_those_of_the_map():
    lens = make_lens(real_height_mm=lambda nm, p: 0.8 * p)
    frame = PixelGrid((90, 70), 10.0, centre_px=(61.0, 22.0))
    row, column = pinhole_px(lens, frame, 550.0)
    assert (row[61 - 9, 22 + 13], column[61 - 9, 22 + 13]) == pytest.approx((61 - 9 / 0.8, 22 + 13 / 0.8))
    np.testing.assert_allclose([row, column], places_px(distort_map(lens, frame, 550.0)), atol=1e-4)


def test_overscan_reaches_to_the_light_of_the_edges():
    """Off the middle, in a lens that shows 1 / 0.8 of a pinhole's view: the left edge is 22.5 px from the axis."""
    lens = make_lens(real_height_mm=lambda nm, p: 0.8 * p)
    stmap = distort_map(lens, PixelGrid((90, 70), 10.0, centre_px=(61.0, 22.0)), 550.0)
    sides_px = np.array([22.5, 61.5, 47.5, 28.5])  # left, up, right, down
    np.testing.assert_allclose(map_overscan_px(stmap), sides_px / 0.8 - sides_px, atol=0.2)  # a quarter of half a pixel


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", VARIED)
def test_the_two_maps_are_inverse_to_a_twentieth_of_a_pixel(name):
    lens = varied_lens(name)
    frame = frame_of(lens)
    nm = float(lens.nearest_nm(lens.reference_wavelength_nm))
    distort, undistort = (make(lens, frame, nm) for make in (distort_map, undistort_map))
    for first, second in ((distort, undistort), (undistort, distort)):
        row, column = places_px(first)
        inside = first[..., 2] > 0
        again = [map_coordinates(axis, (row, column), order=3, mode="nearest") for axis in places_px(second)]
        reach = inside & (row > 1) & (row < 178) & (column > 1) & (column < 238)  # where the spline has neighbours
        for position, index in zip(again, np.indices(row.shape), strict=True):
            assert np.abs(position - index)[reach].max() < 0.05
        assert reach.sum() > 0.3 * reach.size


def test_a_warped_picture_matches_simulate():
    lens = make_lens(real_height_mm=lambda nm, p: p - 0.02 * p**3)
    row, column = np.indices((120, 160))
    picture = 1 + 0.5 * np.sin(row / 9) * np.cos(column / 11)
    frame = PixelGrid((120, 160), 15.0)
    expected = simulate(SpectralImage(picture, [550.0], frame), lens).cube[0] / (np.pi / 16)
    stmap = distort_map(lens, frame, 550.0)
    from_row, from_column = places_px(stmap)
    inside = (from_row > 1) & (from_row < 118) & (from_column > 1) & (from_column < 158)  # beyond it is black
    assert inside.mean() > 0.8
    np.testing.assert_allclose(warped(picture, stmap)[inside], expected[inside], atol=0.003)  # boxes against bilinear


def test_the_command_writes_both_maps(tmp_path, capsys):
    assert main(["lens", "stmap", "edmund-54852", "--resolution", "64x48", "--output", str(tmp_path / "maps")]) == 0
    for name in ("distort", "undistort"):
        path = tmp_path / "maps" / f"edmund-54852_{name}.exr"
        assert str(path) in capsys.readouterr().out or name == "undistort"
        channels = dict(read_parts(path)[0][1])
        assert set(channels) == {"R", "G", "B"} and channels["R"].shape == (48, 64)
        assert channels["R"][:, 0].max() < channels["R"][:, -1].min()
        assert channels["G"][0].min() > channels["G"][-1].max()


def test_a_wavelength_outside_the_lens_data_is_named():
    with refused(LensError, field="wavelength", value="900 nm", where="hand-made"):
        distort_map(make_lens(), PixelGrid((3, 4), 10.0), 900.0)
