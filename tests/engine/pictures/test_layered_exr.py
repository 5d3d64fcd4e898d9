"""Layers of radiance in an EXR file: the round trip, and compatibility with readers that do not support layers."""

import numpy as np
import OpenEXR
import pytest

from lensfield.engine import ImageError
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts, read_with_layers, write_exr
from refusals import refused

WAVELENGTHS_NM = (433.0 + 1 / 3, 550.0, 651.25)
FRAME_PX, OVERSCAN_PX = (7, 10), (4, 3)


def layer(shape_px, origin_px, depth_mm, seed):
    rng = np.random.default_rng(seed)
    alpha = rng.random(shape_px, dtype=np.float32)
    cube = alpha * rng.random((len(WAVELENGTHS_NM), *shape_px), dtype=np.float32)
    return Layer(cube, alpha, depth_mm * (1 + rng.random(shape_px, dtype=np.float32)), origin_px)


@pytest.fixture
def layered():
    """A near layer in one corner of the capture, one of a single pixel, and the world."""
    grid = PixelGrid.around_frame(FRAME_PX, 5.5, OVERSCAN_PX)
    far = layer(grid.shape_px, (0, 0), np.float32(np.inf), 3)
    return LayeredRadiance((layer((5, 6), (0, 0), 812.5, 1), layer((1, 1), (14, 15), 3.1e4, 2), far), WAVELENGTHS_NM,
                           grid, 49.5, 1.5)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "radiance.exr"


def pinhole(layered, margin_px=(0, 0)):
    return layered.flat().cropped(margin_px)


def written(layered, path, margin_px=(0, 0)):
    write_exr(pinhole(layered, margin_px), path, {"Z": pinhole(layered, margin_px).cube[0]}, layered)
    return path


def assert_same(read, layered):
    assert read.grid == layered.grid and read.focal_mm == layered.focal_mm and read.exposure == layered.exposure
    np.testing.assert_allclose(read.wavelengths_nm, layered.wavelengths_nm, rtol=1e-9)
    assert len(read.layers) == len(layered.layers)
    for one, other in zip(read.layers, layered.layers, strict=True):
        assert one.origin_px == other.origin_px
        np.testing.assert_array_equal(one.cube, other.cube)
        np.testing.assert_array_equal(one.alpha, other.alpha)
        np.testing.assert_allclose(one.depth_mm, other.depth_mm, rtol=3e-7)  # stored in metres


def test_layers_round_trip(layered, path):
    assert_same(read_with_layers(written(layered, path))[2], layered)


def test_layers_may_extend_beyond_the_picture(layered, path):
    """Near objects contribute light from beyond the pinhole's view."""
    image, planes, layers = read_with_layers(written(layered, path, (2, 1)))
    assert image.overscan_px == (2, 2) and planes["Z"].shape == image.grid.shape_px
    assert_same(layers, layered)


@pytest.mark.parametrize("changes", [{"centre_px": (3.25, 20.5)}, {"projection": FISHEYE},
                                     {"squeeze": 1.5}])
def test_the_grid_of_layers_round_trips(layered, path, changes):
    grid = PixelGrid(**vars(layered.grid) | changes)
    layered = LayeredRadiance(layered.layers, WAVELENGTHS_NM, grid, 49.5, 1.5)
    read = read_with_layers(written(layered, path, (1, 1)))[2]
    assert read.grid.centre_px == pytest.approx(grid.centre_px) and read.grid.projection == grid.projection
    assert read.grid.squeeze == grid.squeeze


@pytest.mark.parametrize("margin_px", [(0, 0), (2, 1)])
def test_layers_in_finer_columns_round_trip(path, margin_px):
    grid = PixelGrid((15, 16), 5.5, (3.25, 9.5), OVERSCAN_PX, squeeze=2.0).finer_across(4)
    layers = layer((5, 23), (0, 0), 812.5, 1), layer((1, 1), (14, 63), 3.1e4, 2), layer(grid.shape_px, (0, 0), 9e3, 3)
    layered = LayeredRadiance(layers, WAVELENGTHS_NM, grid, 49.5, 1.5)
    image, _, read = read_with_layers(written(layered, path, margin_px))
    assert_same(read, layered)
    assert image.squeeze == 2 and image.frame_px == (7, 10)
    np.testing.assert_allclose(image.cube, pinhole(read, margin_px).cube, rtol=1e-6)


@pytest.mark.parametrize("numbers", [(4, 2, 4), (0, 0, 0), (2.5, 2.5, 2.5), (10**6,) * 3, ("4", "4", "4")])
def test_numbers_of_columns_that_make_no_sense_are_refused(layered, path, numbers):
    with OpenEXR.File(str(written(layered, path)), separate_channels=True) as file:
        for part, number in zip(file.parts[1:], numbers, strict=True):
            part.header["lensfield:across"] = number
        file.write(str(path.with_name("damaged.exr")))
    with pytest.raises(ImageError, match="damaged.exr: lensfield:across is .*expected the same whole number"):
        read_with_layers(path.with_name("damaged.exr"))


def test_the_first_part_is_the_pinhole_picture(layered, path):
    """Bit for bit the file without layers, except for its name."""
    with_layers, without = written(layered, path), path.with_name("plain.exr")
    write_exr(pinhole(layered), without)
    read = read_exr(with_layers)
    np.testing.assert_array_equal(read.cube, read_exr(without).cube)
    assert read.grid == read_exr(without).grid
    (header, channels), reference = read_parts(with_layers)[0], read_parts(without)[0]
    assert header["name"] == "radiance" and channels.keys() - {"Z"} == reference[1].keys()
    reader = OpenEXR.InputFile(str(with_layers))  # which supports only single-part files
    np.testing.assert_array_equal(np.frombuffer(reader.channel("R"), np.float32), reference[1]["R"].ravel())


def test_a_file_without_layers_has_none(layered, path):
    write_exr(pinhole(layered), path)
    assert read_with_layers(path)[2] is None and len(read_parts(path)) == 1


@pytest.mark.parametrize("channel", ["A", "Z", "S0.550,000000nm"])
def test_layers_with_a_missing_channel_are_refused(layered, path, channel):
    with OpenEXR.File(str(written(layered, path)), separate_channels=True) as file:
        del file.parts[2].channels[channel]
        file.write(str(path.with_name("damaged.exr")))
    with pytest.raises(ImageError, match=f"damaged.exr: layer.2 is damaged: expected a channel {channel}"):
        read_with_layers(path.with_name("damaged.exr"))


def test_a_truncated_file_is_refused(layered, path):
    contents = written(layered, path).read_bytes()
    for length in (len(contents) // 2, len(contents) - 8):
        path.write_bytes(contents[:length])
        with refused(ImageError, field="file", value="not readable", where="radiance.exr"):
            read_with_layers(path)
