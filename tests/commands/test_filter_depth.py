"""Depth in pictures by any renderer: the command filters files that are written as renderers write them."""

import json

import numpy as np
import OpenEXR
import pytest

from lensfield.engine import Rings, SpectralImage, load_lens, simulate
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.pictures.spectral_exr import read_exr, write_exr
from rgb_files import colours, failure, parts_exr, planes_exr, run

LENS = "--lens", "kodak-petzval-100mm", "--lens-quality", "preview", "--focus", "2m"
QUICK = *LENS, "--wavelengths", "450,550,650"
ROWS, COLUMNS = 36, 54


def scene_m():
    """A wall at 6 m, a card at 0.9 m in front of it, and nothing above."""
    depth_m = np.full((ROWS, COLUMNS), 6.0, np.float32)
    depth_m[:9] = 1e10
    depth_m[15:28, 20:34] = 0.9
    return depth_m


def picture():
    random = np.random.default_rng(3)
    rgb = np.repeat(random.uniform(0.2, 1, (ROWS, COLUMNS, 1)), 3, axis=-1).astype(np.float32)
    rgb[15:28, 20:34] = (1, 0.1, 0.1)
    return rgb


def planes(rgb, names="RGB"):
    return {name: np.ascontiguousarray(plane) for name, plane in zip(names, np.moveaxis(rgb, -1, 0), strict=True)}


def flat_exr(path, depth=None, channel="Z", kind=np.float32, **header):
    """A file with a single part."""
    depth = scene_m() if depth is None else depth
    with np.errstate(over="ignore"):
        return planes_exr(path, planes(picture()) | {channel: depth.astype(kind)}, **header)


def blenders_exr(path, depth=None):
    """A file with a part for each pass, as Blender 5.0 writes them."""
    rgb = picture()
    passes = {"Combined": planes(rgb) | {"A": np.ones((ROWS, COLUMNS))},
              "Depth": {"Z": scene_m() if depth is None else depth}, "Normal": planes(rgb, "XYZ"),
              "CryptoObject00": planes(rgb, "rgb") | {"a": rgb[..., 0]}}
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage},
                          {f"ViewLayer.{name}.{channel}": np.ascontiguousarray(plane, np.float32)
                           for channel, plane in channels.items()}, f"ViewLayer.{name}")
             for name, channels in passes.items()]
    with OpenEXR.File(parts) as file:
        file.write(str(path))
    return path


def filtered(capsys, source, *options):
    """Irradiance, printed text, and the report."""
    output, report = source.with_name("out.exr"), source.with_name("report.json")
    assert run("filter", source, *QUICK, *options, "--output", output, "--report", report) == 0
    return read_exr(output).cube, capsys.readouterr().out, json.loads(report.read_text())


@pytest.fixture(scope="module")
def wanted(tmp_path_factory):
    """Irradiance of the scene with the depth in its file."""
    output = tmp_path_factory.mktemp("wanted") / "out.exr"
    assert run("filter", flat_exr(output.with_name("a.exr")), *QUICK, "--output", output) == 0
    return read_exr(output).cube


def sharpness(cube):
    """Mean difference of neighbouring pixels, over the card's edges."""
    rows = cube[1, 12:31, 16:38]
    return np.abs(np.diff(rows, axis=0)).mean() + np.abs(np.diff(rows, axis=1)).mean()


def test_depth_blurs_a_picture_and_guesses_are_reported(tmp_path, capsys):
    source = flat_exr(tmp_path / "a.exr")
    deep, printed, report = filtered(capsys, source)
    flat, silent, without = filtered(capsys, source, "--depth", "off")
    assert sharpness(deep) < 0.7 * sharpness(flat)
    assert "depth: Z: " in printed and "3 slabs, cut at" in printed and "guessed from their surroundings" in printed
    assert "depth:" not in silent and "guessed" not in silent
    assert report["layers"].startswith("depth from channel Z; ") and report["depth"]["nearest_mm"] == pytest.approx(900)
    assert not without["layers"] and without["depth"] is None


def test_a_picture_without_depth_is_filtered_as_flat(tmp_path, capsys):
    bare = colours(tmp_path / "bare.exr", picture())
    with_depth = flat_exr(tmp_path / "a.exr")
    flat, printed, report = filtered(capsys, bare)
    np.testing.assert_array_equal(flat, filtered(capsys, with_depth, "--depth", "off")[0])
    assert "depth:" not in printed and report["depth"] is None


def test_a_scene_in_focus_is_filtered_as_without_depth(tmp_path, capsys):
    source = flat_exr(tmp_path / "a.exr", np.full((ROWS, COLUMNS), 2.0))
    through, printed, report = filtered(capsys, source)
    np.testing.assert_array_equal(through, filtered(capsys, source, "--depth", "off")[0])
    assert "depth: Z: the lens data apply to all depths of the scene" in printed and not report["layers"]


@pytest.mark.parametrize("write, options", [
    (blenders_exr, ()), (lambda path: flat_exr(path, channel="depth.Z"), ()),
    (lambda path: flat_exr(path, channel="Depth.V"), ()), (lambda path: flat_exr(path, -scene_m()), ()),
    (lambda path: flat_exr(path, np.where(scene_m() > 1e9, 0, scene_m())), ()),
    (lambda path: flat_exr(path, np.where(scene_m() > 1e9, np.nan, scene_m())), ()),
    (lambda path: flat_exr(path, scene_m() * 100), ("--depth-unit", "cm"))], ids=range(7))
def test_equivalent_depth_channels_give_the_same_result(tmp_path, capsys, wanted, write, options):
    through, _, report = filtered(capsys, write(tmp_path / "a.exr"), *options)
    np.testing.assert_allclose(through, wanted, rtol=1e-4)
    assert report["layers"]


def test_half_precision_depth_may_have_empty_pixels(tmp_path, capsys, wanted):
    """65504 is an empty pixel, and so is infinity.

    In half precision 0.9 m has an error of 0.02 %, so a few rays meet another pixel.
    """
    for nothing in (65504.0, np.inf):
        source = flat_exr(tmp_path / "a.exr", np.where(scene_m() > 1e9, nothing, scene_m()), kind=np.float16)
        through, _, _ = filtered(capsys, source)
        assert np.abs(through - wanted).sum() < 0.005 * wanted.sum()


def test_pixels_without_depth_are_reported(tmp_path, capsys):
    _, printed, _ = filtered(capsys, flat_exr(tmp_path / "a.exr", np.where(scene_m() > 1e9, 0, scene_m())))
    assert "25.0% of the pixels have no depth and count as infinitely far" in printed


def test_depth_in_another_data_window_is_placed_correctly(tmp_path, capsys):
    """Like Beachball in OpenEXR's example images: parts have different data windows, in one display window."""
    window = (np.array([20, 15], np.int32), np.array([33, 27], np.int32))
    frame = (np.array([0, 0], np.int32), np.array([COLUMNS - 1, ROWS - 1], np.int32))
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage, "displayWindow": frame, "dataWindow": window}, channels, name)
             for name, window, channels in (("rgba_left", frame, planes(picture())),
                                            ("depth_left", window, {"Z": np.full((13, 14), 0.9, np.float32)}))]
    with OpenEXR.File(parts) as file:
        file.write(str(tmp_path / "a.exr"))
    through, printed, _ = filtered(capsys, tmp_path / "a.exr")
    depth = np.full((ROWS, COLUMNS), np.inf)
    depth[15:28, 20:34] = 0.9
    wanted, _, _ = filtered(capsys, flat_exr(tmp_path / "wanted.exr", depth))
    np.testing.assert_allclose(through, wanted, rtol=1e-5)
    assert "depth: depth_left.Z: " in printed


def test_an_ambiguous_depth_must_be_named(tmp_path, capsys):
    source = parts_exr(tmp_path / "two.exr", {"Combined": dict(R=1, G=1, B=1), "A.Depth": dict(Z=1),
                                              "B.Depth": dict(Z=2)})
    line = failure(capsys, "filter", source, *QUICK, "--output", tmp_path / "out.exr")
    assert "two.exr: depth is A.Depth.Z, B.Depth.Z: name one of them" in line
    assert run("filter", source, *QUICK, "--depth-channel", "B.Depth.Z", "--output", tmp_path / "out.exr") == 0


def test_a_package_reports_that_it_has_no_rays(tmp_path, capsys):
    source = flat_exr(tmp_path / "a.exr")
    package = tmp_path / "lens.npz"
    write_package(load_lens(LENS[1], Rings(focus_mm=2000), quality="preview"), package)
    assert run("filter", source, "--lens", package, "--wavelengths", "550", "--output", tmp_path / "out.exr") == 0
    assert "blurred by first-order circles" in capsys.readouterr().out


def test_a_sequence_prints_messages_that_differ_only_in_figures_once(tmp_path, capsys):
    for frame, near in ((1, 0.9), (2, 0.8)):
        flat_exr(tmp_path / f"shot_{frame:02d}.exr", np.where(scene_m() < 1, near, scene_m()))
    assert run("filter", tmp_path / "shot_##.exr", *QUICK, "--output", tmp_path / "out_##.exr") == 0
    printed = capsys.readouterr().out
    assert printed.count("depth: Z: ") == 1 and printed.count("guessed from") == 1


def deep_exr(path):
    """A red card in front of a complete wall, as merging deep pictures creates them."""
    channels, rgb = {}, picture()
    wall = picture()[5:6, :, :1].repeat(ROWS, axis=0)
    for number, name in enumerate("RGBAZ"):
        channels[name] = np.empty((ROWS, COLUMNS), object)
        for row, column in np.ndindex(ROWS, COLUMNS):
            samples = [(*wall[row, column].repeat(3), 1, 6.0)]
            if scene_m()[row, column] < 1:
                samples.append((*rgb[row, column], 1, 0.9))
            channels[name][row, column] = np.array([sample[number] for sample in samples], np.float32)
    with OpenEXR.File({"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}, channels) as file:
        file.write(str(path))
    return path


def test_a_deep_picture_contains_hidden_surfaces(tmp_path, capsys):
    source = deep_exr(tmp_path / "deep.exr")
    deep, printed, report = filtered(capsys, source)
    flat, _, _ = filtered(capsys, source, "--depth", "off")
    assert deep.shape == flat.shape == (3, ROWS, COLUMNS)
    assert sharpness(deep) < 0.7 * sharpness(flat)
    assert "2 slabs" in printed and report["layers"]


def test_fireflies_next_to_an_occluder_are_clamped_or_named(tmp_path, capsys):
    rgb = picture()
    rgb[20, 36] = np.nan
    source = planes_exr(tmp_path / "a.exr", planes(rgb) | {"Z": scene_m()})
    assert "pixel at row 20, column 36" in failure(capsys, "filter", source, *QUICK, "--output", tmp_path / "out.exr")
    clamped, _, report = filtered(capsys, source, "--fireflies", "clamp")
    assert np.all(np.isfinite(clamped)) and report["fireflies_clamped"] == 3


def test_layers_in_a_file_are_used_unchanged(tmp_path, capsys):
    """Layers that a render stored: nothing is estimated."""
    grid = PixelGrid((ROWS, COLUMNS), 36e3 / COLUMNS)
    depth_mm = np.where(scene_m() > 1e9, np.inf, 1e3 * scene_m())
    near = depth_mm < 1000
    radiance = SpectralImage(np.moveaxis(picture(), -1, 0), [450, 550, 650], grid)
    behind = Layer(np.where(near, 5.0, radiance.cube), np.ones_like(depth_mm), np.where(near, 6000, depth_mm))
    layered = LayeredRadiance((Layer(radiance.cube * near, near, depth_mm).cropped(), behind), [450, 550, 650], grid)
    write_exr(radiance, tmp_path / "a.exr", {"Z": scene_m()}, layered)
    output = tmp_path / "out.exr"
    assert run("filter", tmp_path / "a.exr", *LENS, "--output", output) == 0
    printed = capsys.readouterr().out
    assert "in the layers of the file" in printed and "guessed" not in printed
    lens = load_lens(LENS[1], Rings(focus_mm=2000), quality="preview")
    np.testing.assert_array_equal(read_exr(output).cube, simulate(layered, lens).cube)


def test_blades_shape_the_blur_of_a_stopped_down_lens(tmp_path, capsys):
    source, blades = flat_exr(tmp_path / "a.exr"), ("--iris-blades", "3")
    for f_number, shows in (("2", False), ("2.5", True)):
        cube, bladed = (filtered(capsys, source, "--f-number", f_number, *words)[0] for words in ((), blades))
        assert np.array_equal(cube, bladed) != shows
    assert "iris: blades is 2" in failure(capsys, "filter", source, *LENS, "--iris-blades", "2", "--output",
                                          tmp_path / "b.exr")
