"""Depth in the files of other renderers: its channel names, and invalid values."""

import numpy as np
import pytest

from lensfield.engine.pictures.depth_channel import depth_channel, depth_in_mm, numbers_of_depth, without_mixtures
from lensfield.engine.runtime.errors import ImageError
from refusals import refused

PLANE = np.full((3, 4), 2.0, np.float32)


def parts_of(*names, part=""):
    return [({"name": part}, {name: PLANE for name in names})]


def several(**parts):
    return [({"name": name}, {channel: PLANE for channel in channels}) for name, channels in parts.items()]


RGBA = "R", "G", "B", "A"


@pytest.mark.parametrize("names, wanted", [
    ((*RGBA, "Z"), "Z"), ((*RGBA, "depth.Z"), "depth.Z"), ((*RGBA, "Depth.V"), "Depth.V"), ((*RGBA, "depth"), "depth"),
    ((*RGBA, "depth.R", "depth.G", "depth.B"), "depth.R"), ((*RGBA, "VRayZDepth.R", "VRayZDepth.G"), "VRayZDepth.R"),
    ((*RGBA, "ViewLayer.Depth.Z", "ViewLayer.Denoising Depth.Z"), "ViewLayer.Depth.Z"),
    ((*RGBA, "ViewLayer.Depth.Z", "ViewLayer.Normal.X", "ViewLayer.Normal.Y", "ViewLayer.Normal.Z"),
     "ViewLayer.Depth.Z"),
    ((*RGBA, "Z", "left.Z"), "Z"), (("Y", "Z"), "Z"), ((*RGBA, "camera.zdepth"), "camera.zdepth")], ids=str)
def test_the_depth_channel_is_recognised_by_its_name(names, wanted):
    name, _, plane = depth_channel(parts_of(*names))
    assert name.lower() == wanted.lower()
    assert plane is PLANE


@pytest.mark.parametrize("names", [RGBA, (*RGBA, "N.X", "N.Y", "N.Z"), (*RGBA, "X", "Y", "Z"), (*RGBA, "Mist.V")],
                         ids=str)
def test_vectors_and_other_passes_are_not_depth(names):
    assert depth_channel(parts_of(*names)) is None


def test_integers_are_not_depth():
    assert depth_channel([({}, {"Z": np.ones((3, 4), np.uint32)})]) is None


def test_the_depth_of_the_selected_view_is_used():
    parts = several(rgba_left=RGBA, depth_left=("Z",), rgba_right=RGBA, depth_right=("Z",))
    assert depth_channel(parts, "rgba_right")[:2] == ("depth_right.Z", parts[3][0])
    assert depth_channel(parts, "rgba_left")[1] is parts[1][0]
    layers = parts_of("Near.Combined.R", "Near.Depth.Z", "Far.Combined.R", "Far.Depth.Z")
    assert depth_channel(layers, "Far.Combined")[0] == "Far.Depth.Z"


def test_an_ambiguous_depth_channel_must_be_named():
    parts = parts_of("A.Depth.Z", "B.Depth.Z")
    with refused(ImageError, field="depth", value="A.Depth.Z, B.Depth.Z", where="image"):
        depth_channel(parts)
    assert depth_channel(parts, wanted="b.depth.z")[0] == "B.Depth.Z"
    with refused(ImageError, field="depth", value="A.Depth.Z, B.Depth.Z", where="image",
                 match="expected one channel named C.Z"):
        depth_channel(parts, wanted="C.Z")
    with refused(ImageError, field="depth", value="missing", where="image"):
        depth_channel(parts_of(*RGBA), wanted="Z")


def test_invalid_depths_are_infinitely_far():
    numbers, unknown = numbers_of_depth(np.array([[3.0, 0.0, -2.0, np.nan, np.inf, 1e10, 5.0, 5.0]]))
    np.testing.assert_array_equal(depth_in_mm(numbers, 1000.0), [[3e3, *[np.inf] * 5, 5e3, 5e3]])
    assert unknown == 3 / 8


def test_the_largest_half_is_infinitely_far():
    numbers, unknown = numbers_of_depth(np.array([[3.0, 65504.0]], np.float16))
    assert numbers.dtype == np.float32 and numbers.tolist() == [[3.0, np.inf]] and unknown == 0
    assert numbers_of_depth(np.array([[65504.0]], np.float32))[0] == 65504


def test_depths_along_a_negative_axis_become_positive():
    numbers, unknown = numbers_of_depth(np.array([[-3.0, -4.0, 1e10, -5.0]]))
    assert numbers.tolist() == [[3.0, 4.0, np.inf, 5.0]] and unknown == 1 / 4


@pytest.mark.parametrize("unit_mm", [1.0, 10.0, 1000.0])
def test_depth_is_converted_from_other_units(unit_mm):
    np.testing.assert_allclose(depth_in_mm(np.float32([2.5, 1e10]), unit_mm), [2.5 * unit_mm, np.inf])


BLUR = 1000.0  # px at 1, so 333 px between 1 and 1.5


def edge(columns, slope=0.0):
    """Rows of depth that rise to the right in front of a farther object, with transitions between them."""
    rows = np.repeat(np.float32([columns]), 5, axis=0)
    return rows * (1 + slope * np.arange(5, dtype=np.float32)[:, None])


@pytest.mark.parametrize("far", [3.0, 20.0])
@pytest.mark.parametrize("coverage", [0.1, 0.4, 0.6, 0.9])
def test_a_mixed_edge_pixel_takes_the_closer_of_both_depths(far, coverage):
    mixed = np.float32(coverage * 1 + (1 - coverage) * far)
    columns = [1, 1, 1, mixed, far, far, far]
    mended = without_mixtures(edge(columns), BLUR)
    np.testing.assert_array_equal(mended, edge([1, 1, 1, 1 if coverage > 0.5 else far, far, far, far]))
    np.testing.assert_array_equal(without_mixtures(edge(columns).T, BLUR), mended.T)


def test_a_pixel_mixed_with_an_empty_one_is_empty():
    mixed = np.float32([1, 1, 0.4 * 1e10, 1e10, 1e10])
    np.testing.assert_array_equal(depth_in_mm(without_mixtures(mixed[None], BLUR), 1.0), [[1, 1, *[np.inf] * 3]])


def test_two_mixed_pixels_in_a_row_are_separated():
    mended = without_mixtures(edge([1, 1, 1, 1.5, 2.6, 3, 3, 3]), BLUR)
    np.testing.assert_array_equal(mended, edge([1, 1, 1, 1, 3, 3, 3, 3]))


def test_unmixed_depths_are_unchanged():
    random = np.random.default_rng(2)
    x, y = np.meshgrid(np.arange(40), np.arange(30))
    floor = 1 / (0.01 + 0.02 * y + 0.003 * x)  # 20 px of blur per row
    cards = np.where((x // 8 + y // 6) % 2, 1.0, 3.0)
    steps = np.where(x < 13, 1.0, np.where(x < 26, 2.0, 3.0))
    for depth in (floor, cards, steps, random.uniform(1, 1.0005, (30, 40)), np.full((30, 40), np.inf)):
        np.testing.assert_array_equal(without_mixtures(depth.astype(np.float32), BLUR), depth.astype(np.float32))


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (2, 2)])
def test_small_pictures_are_unchanged(shape):
    depth = np.linspace(1, 2, shape[0] * shape[1], dtype=np.float32).reshape(shape)
    np.testing.assert_array_equal(without_mixtures(depth, BLUR), depth)
