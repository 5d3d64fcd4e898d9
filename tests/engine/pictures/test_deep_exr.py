"""Deep EXRs: compositing of samples by hand, and files as renderers write them."""

import numpy as np
import OpenEXR
import pytest

from lensfield.engine.pictures.deep_exr import read_deep_exr
from lensfield.engine.runtime.errors import ImageError
from refusals import refused

CHANNELS = "R", "G", "B", "A", "Z"


def deep_exr(path, pixels, name="rgba.left", channels=CHANNELS, **header):
    """A file whose pixels (row, column) are lists of samples (r, g, b, a, z)."""
    shape = len(pixels), len(pixels[0])
    planes = {}
    for number, channel in enumerate(channels):
        plane = np.empty(shape, dtype=object)
        for place in np.ndindex(shape):
            samples = pixels[place[0]][place[1]]
            plane[place] = np.array([sample[number] for sample in samples], np.float32 if channel == "Z" else np.float16
                                    ) if samples else None
        planes[channel] = plane
    part = OpenEXR.Part({"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION} | header, planes, name)
    with OpenEXR.File([part]) as file:
        file.write(str(path))
    return path


WALL, LEAF, GLASS = (0.5, 0.25, 0.125, 1, 8.0), (0, 0.75, 0, 1, 2.0), (0.125, 0.125, 0.25, 0.5, 3.0)
PIXELS = [[[WALL], [LEAF], []], [[WALL, GLASS], [GLASS, WALL, LEAF], [GLASS]]]


def slabs_of(picture, *borders):
    return picture.slabs(np.searchsorted(borders, picture.depth), len(borders) + 1)


def test_samples_are_composited_in_any_order(tmp_path):
    picture = read_deep_exr(deep_exr(tmp_path / "deep.exr", PIXELS))
    (flat, alpha, depth), = slabs_of(picture)
    np.testing.assert_allclose(flat.rec709[1, 0], np.array(GLASS[:3]) + 0.5 * np.array(WALL[:3]), rtol=1e-6)
    np.testing.assert_allclose(flat.rec709[1, 1], LEAF[:3], atol=1e-6)
    np.testing.assert_array_equal(alpha, [[1, 1, 0], [1, 1, 0.5]])
    np.testing.assert_array_equal(depth, [[8, 2, np.inf], [3, 2, 3]])
    assert flat.layer == "rgba.left"


def test_first_depth_is_where_half_of_the_pixel_is_covered(tmp_path):
    picture = read_deep_exr(deep_exr(tmp_path / "deep.exr", PIXELS))
    np.testing.assert_array_equal(picture.first_depth(), [[8, 2, np.inf], [3, 2, 3]])
    faint = [[[(0, 0, 0, 0.25, 1.0), (0, 0, 0, 0.25, 2.0), (0, 0, 0, 0.25, 3.0)]]]
    assert read_deep_exr(deep_exr(tmp_path / "faint.exr", faint)).first_depth() == 3  # 0.25, 0.4375, 0.578


def test_slabs_contain_hidden_samples(tmp_path):
    picture = read_deep_exr(deep_exr(tmp_path / "deep.exr", PIXELS))
    near, middle, far = slabs_of(picture, 2.5, 5.0)
    np.testing.assert_array_equal(near[1], [[0, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(middle[1], [[0, 0, 0], [0.5, 0.5, 0.5]])
    np.testing.assert_array_equal(far[1], [[1, 0, 0], [1, 1, 0]])
    np.testing.assert_allclose(far[0].rec709[1, 1], WALL[:3], rtol=1e-6)
    assert far[2][1, 1] == 8 and far[2][0, 1] == np.inf


@pytest.mark.parametrize("borders", [(), (1.0,), (0.5, 1.0, 1.5)], ids=len)
def test_composited_slabs_equal_the_flat_picture(tmp_path, borders):
    random = np.random.default_rng(4)
    pixels = [[[(*random.uniform(0, 1, 3), random.uniform(0, 1), random.uniform(0, 2))
                for _ in range(random.integers(0, 7))] for _ in range(9)] for _ in range(5)]
    picture = read_deep_exr(deep_exr(tmp_path / "deep.exr", pixels))
    (flat, alpha, _), = slabs_of(picture)
    composite, clear = np.zeros_like(flat.rec709), np.ones_like(alpha)
    for part, covered, _ in slabs_of(picture, *borders):
        composite += clear[..., None] * part.rec709
        clear *= 1 - covered
    np.testing.assert_allclose(composite, flat.rec709, atol=2e-6)
    np.testing.assert_allclose(1 - clear, alpha, atol=2e-6)


def test_a_data_window_is_placed_in_its_display_window(tmp_path):
    window = (np.array([1, 2], np.int32), np.array([3, 3], np.int32))
    display = (np.array([0, 0], np.int32), np.array([4, 5], np.int32))
    path = deep_exr(tmp_path / "deep.exr", PIXELS, dataWindow=window, displayWindow=display)
    (flat, alpha, _), = slabs_of(read_deep_exr(path))
    assert flat.rec709.shape == (6, 5, 3)
    np.testing.assert_array_equal(alpha[2:4, 1:4], [[1, 1, 0], [1, 1, 0.5]])
    assert alpha.sum() == alpha[2:4, 1:4].sum()


def test_overscan_surrounds_the_frame(tmp_path):
    display = (np.array([1, 0], np.int32), np.array([1, 1], np.int32))
    picture = read_deep_exr(deep_exr(tmp_path / "deep.exr", PIXELS, displayWindow=display))
    assert picture.overscan_px == (0, 1) and slabs_of(picture)[0][0].frame_px == (2, 1)


def test_an_empty_picture_is_black_and_infinitely_far(tmp_path):
    picture = read_deep_exr(deep_exr(tmp_path / "deep.exr", [[[(0, 0, 0, 0, 1.0)], []]]))
    (flat, alpha, depth), = slabs_of(picture)
    assert not flat.rec709.any() and not alpha.any() and np.all(np.isinf(depth))
    assert np.all(np.isinf(picture.first_depth()))


def test_colours_of_other_primaries_are_converted(tmp_path):
    path = deep_exr(tmp_path / "deep.exr", [[[(0.5, 0.2, 0.1, 1, 2)]]], colorInteropID="lin_ap1_scene")
    (flat, _, _), = slabs_of(read_deep_exr(path))
    np.testing.assert_allclose(flat.rec709[0, 0], (0.719841, 0.161975, 0.077503), atol=2e-4)  # half precision


def test_flat_files_are_not_read_as_deep(tmp_path):
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Z": np.ones((2, 2), np.float32)}) as file:
        file.write(str(tmp_path / "flat.exr"))
    assert read_deep_exr(tmp_path / "flat.exr") is None


def test_a_missing_channel_or_layer_is_named(tmp_path):
    path = deep_exr(tmp_path / "deep.exr", [[[(1, 1, 1, 1)]]], channels=("R", "G", "B", "Z"))
    with pytest.raises(ImageError, match="deep.exr: channels is B, G, R, Z: expected A in deep pixels"):
        read_deep_exr(path)
    path = deep_exr(tmp_path / "other.exr", PIXELS)
    with pytest.raises(ImageError, match="layers is rgba.left: no layer is named 'right'"):
        read_deep_exr(path, "right")


@pytest.mark.parametrize("fraction", [0.3, 0.6, 0.9])
def test_a_truncated_file_is_an_error(tmp_path, fraction):
    path = deep_exr(tmp_path / "deep.exr", [[[WALL, GLASS]] * 40] * 40)
    contents = path.read_bytes()
    path.write_bytes(contents[:int(fraction * len(contents))])
    with refused(ImageError, field="file", value="not readable", where="deep.exr"):
        read_deep_exr(path)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 6e4])
def test_non_finite_or_huge_samples_cause_no_warning(tmp_path, value, recwarn):
    picture = read_deep_exr(deep_exr(tmp_path / "deep.exr", [[[(value, 0, 0, 0.5, 1.0), (value, 1, 1, 0.25, 2.0)]]]))
    slabs_of(picture)
    assert not recwarn.list


@pytest.mark.parametrize("alpha", [np.nan, np.inf, -np.inf, 6e4, -0.5])
def test_an_invalid_alpha_is_an_error_that_names_the_file(tmp_path, alpha, recwarn):
    path = deep_exr(tmp_path / "deep.exr", [[[(1, 0, 0, 0.5, 1.0), (1, 1, 1, alpha, 2.0)]]])
    with refused(ImageError, field="alpha at 1", where="deep.exr"):
        read_deep_exr(path)
    assert not recwarn.list
