"""Pictures larger than the memory limit: stored in unnamed files, with the same bytes as results."""

import re

import numpy as np
import OpenEXR
import pytest

from full_disk import room_for
from lensfield.engine import ChannelCache, ImageError, InputError, Options, SpectralImage, load_lens, simulate
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.pictures.spectral_exr import read_with_layers, read_with_planes, write_exr
from lensfield.engine.plan import cost
from lensfield.engine.runtime import memory, scratch
from refusals import refused
from rgb_files import colours, run

LENS = load_lens("edmund-54852")
NM = [500.0, 550.0, 600.0]


def picture(rows, columns):
    """Light with overscan, off the axis."""
    cube = np.random.default_rng(3).random((3, rows, columns), np.float32)
    return SpectralImage(cube, NM, pitch_um=20.0, overscan_px=(2, 1) if rows > 4 else (0, 0), centre_px=(rows / 3, 1.0))


@pytest.fixture
def nothing_free(monkeypatch):
    """Every picture exceeds the memory limit."""
    monkeypatch.setattr(scratch, "available_bytes", lambda: 0)


@pytest.mark.parametrize("rows, columns", [(1, 1), (1, 90), (63, 7), (64, 7), (65, 7), (150, 40)])
def test_planes_read_by_blocks_equal_planes_read_at_once(tmp_path, nothing_free, rows, columns):
    depth = {"Z": np.random.default_rng(4).random((rows, columns), np.float32)}
    write_exr(picture(rows, columns), tmp_path / "picture.exr", depth)
    at_once, planes, _ = read_with_layers(tmp_path / "picture.exr")
    image, by_blocks, layers = read_with_layers(tmp_path / "picture.exr", scratch=tmp_path)
    assert scratch.in_file(image.cube) and not scratch.in_file(at_once.cube) and layers is None
    assert image.grid == at_once.grid and by_blocks.keys() == planes.keys()
    np.testing.assert_array_equal(image.cube, at_once.cube)
    for name, plane in planes.items():
        np.testing.assert_array_equal(by_blocks[name], plane)
        assert by_blocks[name].dtype == plane.dtype
    assert [file.name for file in tmp_path.iterdir()] == ["picture.exr"]


@pytest.mark.parametrize("compression", ["NO", "ZIPS", "ZIP", "PIZ", "DWAB"])
def test_foreign_files_are_read_by_blocks_too(tmp_path, nothing_free, compression):
    random = np.random.default_rng(5)
    kinds = {"S0.500,0nm": np.float32, "S0.600,0nm": np.float16, "Depth.Z": np.float16, "object.id": np.uint32}
    planes = {name: (random.random((300, 20)) * 99).astype(kind) for name, kind in kinds.items()}
    corners = np.array([-7, -300], np.int32), np.array([12, -1], np.int32)
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.scanlineimage,
              "dataWindow": corners, "displayWindow": corners}
    with OpenEXR.File(header, planes) as file:
        file.write(str(tmp_path / "picture.exr"))
    (one, first, _), (other, second, _) = (read_with_layers(tmp_path / "picture.exr", 20.0, folder)
                                           for folder in (None, tmp_path))
    assert scratch.in_file(other.cube) and one.grid == other.grid
    for name, plane in first.items():
        np.testing.assert_array_equal(second[name], plane)
        assert second[name].dtype == plane.dtype


def test_only_the_first_part_of_a_layered_picture_is_read(tmp_path, nothing_free):
    flat = picture(65, 40)
    layers = [Layer(flat.cube, np.ones(flat.cube.shape[1:]), np.full(flat.cube.shape[1:], 500.0))] * 2
    write_exr(flat, tmp_path / "picture.exr", layered=LayeredRadiance(layers, NM, flat.grid))
    image, planes = read_with_planes(tmp_path / "picture.exr", scratch=tmp_path)
    at_once, expected = read_with_planes(tmp_path / "picture.exr")
    assert scratch.in_file(image.cube) and not scratch.in_file(at_once.cube) and planes.keys() == expected.keys()
    np.testing.assert_array_equal(image.cube, at_once.cube)


@pytest.mark.parametrize("share", [0.3, 0.9, 0.999])
def test_a_truncated_file_is_an_error_and_leaves_nothing_behind(tmp_path, nothing_free, capfd, share):
    path = tmp_path / "picture.exr"
    write_exr(picture(150, 40), path)
    path.write_bytes(path.read_bytes()[:int(share * path.stat().st_size)])
    with refused(ImageError, field="file", value="not readable", where="picture.exr"):
        read_with_layers(path, scratch=tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["picture.exr"]


def test_pictures_that_fit_in_memory_are_in_memory(tmp_path):
    write_exr(picture(20, 30), tmp_path / "picture.exr")
    assert not scratch.in_file(read_with_layers(tmp_path / "picture.exr", scratch=tmp_path)[0].cube)


def test_a_picture_in_a_file_gives_the_same_result_in_a_file(tmp_path, nothing_free):
    write_exr(picture(70, 40), tmp_path / "picture.exr")
    images = [simulate(read_with_layers(tmp_path / "picture.exr", scratch=folder)[0], LENS)
              for folder in (None, tmp_path)]
    assert [scratch.in_file(image.cube) for image in images] == [False, True]
    np.testing.assert_array_equal(*(image.cube for image in images))


def test_layers_in_files_give_the_same_results_in_files(tmp_path, nothing_free):
    flat, images = picture(70, 40), []
    for folder in (None, tmp_path):
        layers = []
        for depth_mm in (300.0, 3000.0):
            cube = scratch.new_array(flat.cube.shape, folder)
            cube[:] = flat.cube / 2
            layers.append(Layer(cube, np.full(cube.shape[1:], 0.5), np.full(cube.shape[1:], depth_mm)))
        layered = LayeredRadiance(layers, NM, flat.grid, LENS.capture_focal_length_mm)
        images += [layered.flat(), layered.cropped((1, 1)).flat(), simulate(layered, LENS)]
    assert [scratch.in_file(image.cube) for image in images] == [False] * 3 + [True] * 3
    for one, other in zip(images[:3], images[3:], strict=True):
        np.testing.assert_array_equal(one.cube, other.cube)


def test_the_peak_counts_memory_only(tmp_path, nothing_free, monkeypatch):
    monkeypatch.setattr(cost, "taken_bytes", lambda: 10**8)
    write_exr(picture(70, 40), tmp_path / "picture.exr")
    image = read_with_layers(tmp_path / "picture.exr", scratch=tmp_path)[0]
    plan = ChannelCache().plan(Options(), LENS, image)
    assert plan.peak_mb == pytest.approx(100 + plan.memory_mb)


def test_a_released_array_retains_its_contents(tmp_path, nothing_free):
    before = memory.taken_bytes()
    if not before:
        pytest.skip("this system does not tell")
    array = scratch.new_array((2**24,), tmp_path)
    array[:] = 7
    assert memory.taken_bytes() - before > array.nbytes / 2
    scratch.release_memory(array)
    assert memory.taken_bytes() - before < array.nbytes / 2
    assert np.all(array == 7)


def test_a_full_disk_is_an_error_before_the_work(tmp_path, nothing_free):
    write_exr(picture(70, 40), tmp_path / "picture.exr")
    with room_for(4096), refused(InputError, field="scratch file"):
        read_with_layers(tmp_path / "picture.exr", scratch=tmp_path)
    with refused(InputError, field="scratch file", value=re.compile(r"1.84e\+10 GB").match):
        scratch.new_array((2**62,), tmp_path)
    with refused(InputError, field="scratch file", where="gone", match="No such file"):
        scratch.new_array((4,), tmp_path / "gone")


def test_disk_space_is_checked_before_the_folder_is_created(tmp_path):
    scratch.check_disk(tmp_path / "not" / "yet", "scratch", 1)
    with pytest.raises(InputError, match=r"not.yet: scratch is 1e\+15 GB: only [\d.]+ GB are free there"):
        scratch.check_disk(tmp_path / "not" / "yet", "scratch", 1e24)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", ["spectral", "rgb"])
def test_filter_writes_the_same_bytes_with_little_memory(tmp_path, monkeypatch, kind):
    path = tmp_path / "picture.exr"
    if kind == "rgb":
        colours(path, (0.5, 0.2, 0.1), (30, 70))
    else:
        write_exr(picture(70, 40), path)
    folders, written = [], []
    in_file = scratch._in_file
    monkeypatch.setattr(scratch, "_in_file", lambda shape, folder: folders.append(folder) or in_file(shape, folder))
    for free in (10**12, 0):
        monkeypatch.setattr(scratch, "available_bytes", lambda free=free: free)
        (tmp_path / str(free)).mkdir()
        run("filter", path, "--lens", "edmund-54852", "--output", tmp_path / str(free) / "o.exr",
            "--preview", tmp_path / str(free) / "o.png")
        written.append([(tmp_path / str(free) / name).read_bytes() for name in ("o.exr", "o.png")])
    assert folders == [tmp_path / "0"] * 2  # radiance and irradiance
    assert written[0] == written[1]
    assert sorted(file.name for file in (tmp_path / "0").iterdir()) == ["o.exr", "o.png"]
