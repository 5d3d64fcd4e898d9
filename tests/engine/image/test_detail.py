"""Detail: the distribution of light inside pixels, and its channels in files."""

import numpy as np
import pytest

from lensfield.engine import ImageError, SpectralImage
from lensfield.engine.image.detail import Detail
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts, read_with_layers, write_exr
from refusals import refused

HALF = 2.0**-11  # relative rounding of half precision
SHAPE, TIMES, NM = (5, 7), 3, (450.0, 560.0, 650.0)


@pytest.fixture
def fine():
    """Light in finer pixels, with a dark pixel and a dark part."""
    cube = np.random.default_rng(4).gamma(1, 1, (len(NM), *(TIMES * n for n in SHAPE))).astype(np.float32)
    cube[:, :TIMES, :TIMES] = 0
    cube[1, 4, 8] = 0
    return cube


def means(cube):
    rows, columns = SHAPE
    return cube.reshape(-1, rows, TIMES, columns, TIMES).mean(axis=(2, 4))


def test_it_splits_the_means_of_its_light_into_that_light(fine):
    detail = Detail.of(fine, NM, TIMES)
    assert detail.shape_px == SHAPE and detail.times == TIMES
    for nm, plane, mean in zip(NM, fine, means(fine), strict=True):
        np.testing.assert_allclose(detail.split(mean, nm), plane, rtol=HALF * 1.01)


def test_light_between_its_wavelengths_is_distributed_as_between_them(fine):
    detail = Detail.of(fine, NM, TIMES)
    ends = [detail.split(np.ones(SHAPE), nm) for nm in NM]
    np.testing.assert_allclose(detail.split(np.ones(SHAPE), 483.0), 0.7 * ends[0] + 0.3 * ends[1], rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(detail.split(np.ones(SHAPE), 300.0), ends[0])
    np.testing.assert_array_equal(detail.split(np.ones(SHAPE), 900.0), ends[2])


def test_dark_pixels_and_negative_light_are_even(fine):
    fine[:, :TIMES, :TIMES] = -1
    detail = Detail.of(fine, NM, TIMES)
    np.testing.assert_array_equal(detail.shares[:, :TIMES, :TIMES], 1)
    assert detail.shares.min() == 0


def test_a_part_of_it_has_the_same_pixels(fine):
    detail, region = Detail.of(fine, NM, TIMES), (slice(1, 4), slice(2, 7))
    part = detail.within(*region)
    picture = np.random.default_rng(5).random(SHAPE)
    parts = tuple(slice(TIMES * side.start, TIMES * side.stop) for side in region)
    np.testing.assert_array_equal(part.split(picture[region], 500.0), detail.split(picture, 500.0)[parts])
    larger = part.placed(slice(3, 6), slice(1, 6), (9, 8))
    assert larger.shape_px == (9, 8)
    np.testing.assert_array_equal(larger.within(slice(3, 6), slice(1, 6)).shares, part.shares)
    assert larger.shares.sum(dtype=float) == pytest.approx(larger.shares.size, rel=HALF)


def test_an_image_is_merged_and_cropped_with_its_detail(fine):
    cube = np.pad(fine, ((0, 0), (6, 6), (3, 3)), mode="edge")
    image = SpectralImage(cube, NM, pitch_um=2.0, centre_px=(10.0, 3.5), overscan_px=(6, 3), focal_mm=30.0)
    merged = image.coarser(TIMES)
    assert merged.grid.finer(TIMES) == image.grid and merged.frame_px == SHAPE and merged.focal_mm == 30.0
    np.testing.assert_allclose(merged.frame().cube, means(fine), rtol=1e-6)
    np.testing.assert_allclose(merged.frame().detail.split(merged.frame().cube[1], NM[1]), fine[1], rtol=HALF * 1.01)
    with refused(ImageError, field="shape_px", where="image", match="multiples of 2 px"):
        image.coarser(2)


@pytest.mark.parametrize("change, message", [
    (lambda shares: -shares, "invalid"), (lambda shares: shares * np.nan, "invalid"),
    (lambda shares: 1.1 * shares, "invalid"), (lambda shares: shares[:, 1:], "of shape"),
    (lambda shares: shares[:2], "of shape"), (lambda shares: shares[0], "of shape")], ids=str)
def test_invalid_shares_are_refused(fine, change, message):
    shares = Detail.of(fine, NM, TIMES).shares
    with refused(ImageError, field="shares", where="detail", value=lambda value: value.startswith(message)):
        Detail(NM, change(shares), TIMES)


def test_an_image_refuses_the_detail_of_other_pixels(fine):
    with refused(ImageError, field="detail", where="image"):
        SpectralImage(np.ones((3, 5, 6)), NM, pitch_um=1.0, detail=Detail.of(fine, NM, TIMES))


def test_files_hold_it(fine, tmp_path):
    image = SpectralImage(fine, NM, pitch_um=2.0).coarser(TIMES)
    grid = PixelGrid((9, 8), 6.0, overscan_px=(2, 0))
    layer = Layer(image.cube, np.ones(SHAPE), np.full(SHAPE, 900.0), (3, 1), image.detail)
    flat = SpectralImage(np.zeros((3, 9, 8)), NM, grid)
    write_exr(flat, tmp_path / "layers.exr", layered=LayeredRadiance([layer], NM, grid))
    _, _, layered = read_with_layers(tmp_path / "layers.exr")
    np.testing.assert_array_equal(layered.layers[0].detail.shares, image.detail.shares)
    write_exr(image, tmp_path / "flat.exr")
    again = read_exr(tmp_path / "flat.exr")
    np.testing.assert_array_equal(again.detail.shares, image.detail.shares)
    assert again.detail.wavelengths_nm.tolist() == list(NM) and again.detail.times == TIMES
    assert read_exr(tmp_path / "layers.exr").detail is None


def test_a_file_with_a_missing_part_is_refused(fine, tmp_path):
    image = SpectralImage(fine, NM, pitch_um=2.0).coarser(TIMES)
    write_exr(image, tmp_path / "all.exr")
    planes = read_parts(tmp_path / "all.exr")[0][1]
    others = {name: plane for name, plane in planes.items() if name.startswith("detail.") and "560" not in name}
    others |= {name: plane for name, plane in planes.items() if name.startswith("detail.560") and name[-1] != "3"}
    write_exr(SpectralImage(image.cube, NM, image.grid), tmp_path / "some.exr", others)
    with pytest.raises(ImageError, match=r"detail is 24 channels: expected all parts"):
        read_exr(tmp_path / "some.exr")
