"""Pictures by any renderer: RGB files with their layers, colours, windows and cameras; and sequences of files."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from lenses import make_lens
from lensfield.commands import arguments
from lensfield.commands.sequence import find_shots, parse_frames
from lensfield.engine import ImageError, InputError, Options, SpectralImage, load_lens, simulate
from lensfield.engine.image.nonfinite import refuse_fireflies
from lensfield.engine.pictures.preview import auto_exposure, to_rec709
from lensfield.engine.pictures.rgb_picture import RgbPicture, light_basis, read_rgb_exr, upsample
from lensfield.engine.pictures.spectral_exr import is_spectral, read_exr, write_exr
from lensfield.engine.spectral.colour import encode_srgb
from lensfield.engine.spectral.spectra import emission_basis
from places import ROOT
from refusals import refused
from rgb_files import colours, failure, parts_exr, planes_exr, run, window

NINE_NM = np.linspace(400, 700, 9)
ACESCG = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)  # S-2014-004, with the white of ST 2065-1
# From ACEScg to linear Rec. 709 by Bradford, as in ACES's configurations for OpenColorIO, by hand: 1.70505 a - 0.62179
# b - 0.08326 c, -0.13026 a + 1.14080 b - 0.01055 c, -0.02400 a - 0.12897 b + 1.15297 c
ACESCG_COLOUR, IN_REC709 = (0.5, 0.2, 0.1), (0.719841, 0.161975, 0.077503)
QUICK = ("--lens", "edmund-54852", "--method", "paper", "--section-size", 8, "--wavelengths", "450,550,650")


def picture(rgb):
    return RgbPicture(np.asarray(rgb, dtype=np.float32).reshape(1, -1, 3), (0, 0), "")


def image_colours(rgb, wavelengths_nm=NINE_NM):
    """Colours after a lens without blur and absorption."""
    radiance, _ = upsample(picture(rgb), wavelengths_nm, pitch_um=5.0)
    return to_rec709(simulate(radiance, make_lens(), Options(method="exact")))[0]


@pytest.mark.parametrize("wavelengths_nm", [[550.0], [450.0, 650.0], NINE_NM], ids=len)
def test_white_stays_white_at_any_number_of_wavelengths(wavelengths_nm):
    np.testing.assert_allclose(image_colours([1, 1, 1], np.array(wavelengths_nm)), [[1, 1, 1]], atol=2e-5)


def test_nine_wavelengths_keep_colours():
    """The remaining error comes from light clipped at zero; without correction, it is 0.036 RMS for random colours."""
    random = np.random.default_rng(5).random((200, 3))
    assert np.sqrt(np.mean((image_colours(random) - random) ** 2)) < 0.006
    np.testing.assert_allclose(image_colours([[0.8, 0.2, 0.1], [0.1, 0.5, 0.2], [0.2, 0.3, 0.6]]),
                               [[0.8, 0.2, 0.1], [0.1, 0.5, 0.2], [0.2, 0.3, 0.6]], atol=1e-3)
    np.testing.assert_allclose(image_colours(np.eye(3)), np.eye(3), atol=0.09)


def test_sixteen_wavelengths_keep_the_primaries():
    np.testing.assert_allclose(image_colours(np.eye(3), np.linspace(400, 700, 16)), np.eye(3), atol=0.015)


def test_colours_are_not_corrected_where_wavelengths_cannot_resolve_them():
    near = np.array([640.0, 650.0, 660.0])
    np.testing.assert_array_equal(light_basis(near), emission_basis(near))


def test_white_has_the_spectrum_of_blenders_white():
    np.testing.assert_allclose(light_basis(NINE_NM).sum(axis=1), emission_basis(NINE_NM).sum(axis=1), rtol=2e-5)


def test_a_white_picture_is_white_on_the_axis_except_for_the_glass(tmp_path, capsys):
    """See "Watts and lumens" in the guide: 0.4 % of green and 2 % of violet, and 0.1 % of blur."""
    source = colours(tmp_path / "white.exr", (1, 1, 1), (48, 64))
    assert run("filter", source, "--lens", "edmund-54852", "--coating", "ideal", "--output", tmp_path / "out.exr") == 0
    middle = to_rec709(read_exr(tmp_path / "out.exr"))[20:28, 28:36].mean(axis=(0, 1))
    np.testing.assert_allclose(middle, [0.996, 0.996, 0.985], atol=0.006)
    assert "RGB, upsampled to 9 wavelengths" in capsys.readouterr().out


def test_blenders_multi_part_file_gives_its_combined_pass(tmp_path):
    """The file has the parts and names that Blender 5.0 writes."""
    path = parts_exr(tmp_path / "multi.exr", {
        "ViewLayer.Combined": {"R": 0.25, "G": 0.5, "B": 0.75, "A": 1}, "ViewLayer.Depth": {"Z": 9},
        "ViewLayer.Diffuse Color": {"R": 1, "G": 1, "B": 1},
        "ViewLayer.CryptoObject00": {"r": 3, "g": 3, "b": 3, "a": 3}})
    read = read_rgb_exr(path)
    assert read.layer == "ViewLayer.Combined" and read.rec709.dtype == np.float32
    np.testing.assert_array_equal(read.rec709, np.broadcast_to(np.float32([0.25, 0.5, 0.75]), (6, 8, 3)))


@pytest.mark.parametrize("prefix", ["ViewLayer.Combined.", "Combined.", "rgba.", "left.beauty.", "Ci."])
@pytest.mark.parametrize("kind", [np.float16, np.float32])
def test_a_layer_in_a_single_part_is_recognised(tmp_path, prefix, kind):
    read = read_rgb_exr(colours(tmp_path / "layer.exr", (0.25, 0.5, 0.75), prefix=prefix, kind=kind))
    assert read.layer == prefix[:-1]
    np.testing.assert_array_equal(read.rec709[0, 0], [0.25, 0.5, 0.75])


def test_an_unnamed_picture_takes_precedence_over_passes(tmp_path):
    plane = np.ones((6, 8), dtype=np.float32)
    channels = {name: plane * 0.5 for name in "RGB"} | {f"rgba.{name}": plane * 0.25 for name in "RGB"}
    assert np.all(read_rgb_exr(planes_exr(tmp_path / "both.exr", channels)).rec709 == 0.5)


def test_one_of_several_view_layers_must_be_named(tmp_path, capsys):
    path = parts_exr(tmp_path / "two.exr", {"Near.Combined": dict(R=1, G=1, B=1), "Far.Combined": dict(R=2, G=2, B=2)})
    line = failure(capsys, "filter", path, *QUICK, "--output", tmp_path / "out.exr")
    assert "two.exr: layers is Near.Combined, Far.Combined: name one of them" in line
    assert np.all(read_rgb_exr(path, "Far.Combined").rec709 == 2)
    with pytest.raises(ImageError, match="layers is .*no layer is named 'Fur'"):
        read_rgb_exr(path, "Fur")


@pytest.mark.parametrize("name", ["Y", "V"])
def test_a_grey_picture_is_grey(tmp_path, name):
    path = planes_exr(tmp_path / "grey.exr", {name: np.full((6, 8), 0.5, dtype=np.float16)})
    assert np.all(read_rgb_exr(path).rec709 == 0.5)


@pytest.mark.parametrize("names", ["Z", "XYZ", "UV", ("Y", "RY", "BY"), ("Normal.X", "Normal.Y", "Normal.Z")], ids=str)
def test_a_file_without_a_picture_is_an_error_that_names_the_channels(tmp_path, names):
    path = planes_exr(tmp_path / "data.exr", {name: np.zeros((6, 8), dtype=np.float32) for name in names})
    with pytest.raises(ImageError, match=f"data.exr: channels is {', '.join(sorted(names))}: expected R, G and B"):
        read_rgb_exr(path)


@pytest.mark.parametrize("header", [{"chromaticities": ACESCG}, {"colorInteropID": "lin_ap1_scene"},
                                    {"chromaticities": ACESCG, "colorInteropID": "lin_rec709_scene"}], ids=str)
def test_acescg_is_converted_as_calculated_by_hand(tmp_path, header):
    np.testing.assert_allclose(read_rgb_exr(colours(tmp_path / "a.exr", ACESCG_COLOUR, **header)).rec709[3, 4],
                               IN_REC709, atol=1e-5)
    np.testing.assert_allclose(read_rgb_exr(colours(tmp_path / "white.exr", (1, 1, 1), **header)).rec709[3, 4],
                               (1, 1, 1), atol=2e-6)


def test_rec2020_is_converted_by_the_itus_matrix(tmp_path):
    """ITU-R BT.2407: 1.6605 a - 0.5876 b - 0.0728 c; -0.1246 a + 1.1329 b - 0.0083 c; and
    -0.0182 a - 0.1006 b + 1.1187 c."""
    path = colours(tmp_path / "a.exr", (0.5, 0.2, 0.1), colorInteropID="lin_rec2020_scene")
    np.testing.assert_allclose(read_rgb_exr(path).rec709[0, 0], (0.70545, 0.16345, 0.08265), atol=1e-4)


@pytest.mark.parametrize("header", [{}, {"colorInteropID": "lin_rec709_scene"}, {"colorInteropID": "unknown"},
                                    {"chromaticities": (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)}], ids=str)
def test_rec709_is_unchanged(tmp_path, header):
    rgb = np.random.default_rng(1).random((6, 8, 3)).astype(np.float32)
    np.testing.assert_array_equal(read_rgb_exr(colours(tmp_path / "a.exr", rgb, **header)).rec709, rgb)


@pytest.mark.parametrize("header, field", [
    ({"colorInteropID": "srgb_rec709_display"}, "colorInteropID"),
    ({"chromaticities": (0.3, 0.3) * 4}, "chromaticities"), ({"chromaticities": (0.0,) * 8}, "chromaticities"),
    ({"chromaticities": (float("nan"),) * 8}, "chromaticities"), ({"pixelAspectRatio": 2.0}, "pixelAspectRatio"),
    ({"displayWindow": window(9000, 9000, 4, 3)}, "dataWindow")], ids=str)
def test_an_unsupported_header_is_an_error_that_names_the_file(tmp_path, capsys, header, field):
    path = colours(tmp_path / "odd.exr", (1, 1, 1), **header)
    assert f"odd.exr: {field} is " in failure(capsys, "filter", path, *QUICK, "--output", tmp_path / "out.exr")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("display, overscan, first", [
    ((0, 0, 8, 6), (0, 0), (0, 0)), ((2, 1, 4, 4), (1, 2), (0, 0)), ((-3, -2, 14, 10), (0, 0), (2, 3)),
    ((3, 0, 6, 6), (0, 3), (0, 0)), ((0, -1, 8, 6), (1, 0), (2, 0))], ids=str)
def test_the_frame_is_the_display_window(tmp_path, display, overscan, first):
    """Data of 8 x 6 px at (0, 0): overscan on all sides, black where data are missing, the axis in the middle."""
    rgb = np.random.default_rng(1).random((6, 8, 3)).astype(np.float32) + 1
    path = colours(tmp_path / "a.exr", rgb, dataWindow=window(0, 0, 8, 6), displayWindow=window(*display))
    read = read_rgb_exr(path)
    assert read.overscan_px == overscan and read.frame_px == (display[3], display[2])
    np.testing.assert_array_equal(read.rec709[first[0]:first[0] + 6, first[1]:first[1] + 8], rgb)
    assert np.count_nonzero(read.rec709) == rgb.size


def test_the_required_overscan_is_printed(tmp_path, capsys):
    """A lens with barrel distortion: the frame without overscan, and again with the overscan that it requires."""
    def filtered(margin):
        path = colours(tmp_path / "a.exr", (1, 1, 1), (36 + 2 * margin[1], 48 + 2 * margin[0]),
                       dataWindow=window(0, 0, 48 + 2 * margin[0], 36 + 2 * margin[1]),
                       displayWindow=window(*margin, 48, 36))
        assert run("filter", path, *QUICK, "--output", tmp_path / "out.exr") == 0
        return to_rec709(read_exr(tmp_path / "out.exr")), capsys.readouterr().out

    bare, printed = filtered((0, 0))
    words = printed.split("the lens needs ")[1].split()
    assert " ".join(words[3:]).startswith("px of overscan on each side, the picture has 0 x 0")
    overscanned, printed = filtered((int(words[0]), int(words[2])))
    assert "the lens needs" not in printed
    assert overscanned.shape == bare.shape == (36, 48, 3)
    assert bare[0, 0, 1] < 0.5 < 0.98 < overscanned[0, 0, 1]


@pytest.mark.parametrize("view, pitch_um", [
    ((), 4800 / 24), (("--pitch-um", 150), 150.0),
    (("--focal-mm", 50, "--sensor-width-mm", 36), None), (("--fov", 39.597752), None)], ids=str)
def test_the_camera_settings_give_the_pitch(tmp_path, view, pitch_um):
    """36 mm behind 50 mm is 39.597752 degrees, and 36 / 50 of the lens's focal length on its sensor."""
    lens = load_lens("edmund-54852")
    source = colours(tmp_path / "a.exr", (1, 1, 1))
    assert run("filter", source, *QUICK, *view, "--output", tmp_path / "out.exr") == 0
    wanted = pitch_um or 36 / 50 * lens.capture_focal_length_mm / 24 * 1e3
    assert read_exr(tmp_path / "out.exr").pitch_um == pytest.approx(wanted, rel=1e-7)


def test_a_shift_moves_the_axis_off_the_middle_of_the_frame(tmp_path):
    """By mm on the sensor, of a picture with overscan."""
    source = colours(tmp_path / "a.exr", (1, 1, 1), (20, 28), dataWindow=window(-2, -1, 28, 20),
                     displayWindow=window(0, 0, 24, 18))
    assert run("filter", source, *QUICK, "--shift=-0.6,1.2", "--output", tmp_path / "out.exr") == 0
    image = read_exr(tmp_path / "out.exr")
    assert image.pitch_um == pytest.approx(200) and image.centre_px == pytest.approx((8.5 + 6, 11.5 + 3))


@pytest.mark.parametrize("shape, shift, expected", [((18, 24), "-1,2", (-17, -10, 15, 14)),
                                                    ((24, 16), "0,0", (-12, -18, 12, 18))])
def test_a_lens_on_a_grid_is_loaded_for_the_frame(tmp_path, monkeypatch, shape, shift, expected):
    """On 36 x 24 mm; the overscan, of another part of the sensor, does not count."""
    loaded, (rows, columns) = [], shape

    def load(source, rings, quality, progress, wavelengths_nm, edges_mm):
        loaded.append(edges_mm)
        return load_lens("edmund-54852")

    monkeypatch.setattr(arguments, "load_lens", load)
    source = colours(tmp_path / "a.exr", (1, 1, 1), (rows + 2, columns + 4),
                     dataWindow=window(-2, -1, columns + 4, rows + 2), displayWindow=window(0, 0, columns, rows))
    for more in ((), ("--tilt", "2,0")):
        assert run("filter", source, *QUICK, "--lens", "cooke-triplet-50mm", f"--shift={shift}", *more, "--output",
                   tmp_path / "out.exr") == 0
    assert loaded == [None, pytest.approx(expected)]


def test_a_tall_picture_turns_the_sensor(tmp_path):
    source = colours(tmp_path / "a.exr", (1, 1, 1), (24, 18))
    assert run("filter", source, *QUICK, "--output", tmp_path / "out.exr") == 0
    assert read_exr(tmp_path / "out.exr").pitch_um == pytest.approx(4800 / 24)


@pytest.mark.parametrize("arguments, message", [
    (("--fov", 180), "--fov is 180.0"), (("--fov", "nan"), "--fov is nan"),
    (("--focal-mm", 50), "--sensor-width-mm is missing"), (("--sensor-width-mm", 36), "--focal-mm is missing"),
    (("--fov", 40, "--pitch-um", 5), "--fov is combined with --pitch-um"),
    (("--focal-mm", -1, "--sensor-width-mm", 36), "--focal-mm is -1.0"),
    (("--wavelengths", "500,300"), "wavelengths is"), (("--wavelengths", "300,500"), "wavelength is 300 nm"),
    (("--wavelengths", "390,500"), "the lens data spans 400 to"), (("--pitch-um", 0), "a.exr: pitch_um is 0.0"),
    (("--layer", "x"), "a.exr: layers is without a name: no layer is named 'x'"),
    (("--shift", "1"), "--shift is 1: expected two numbers"), (("--shift=inf,0",), "--shift is inf,0: "),
    (("--frames", "1-2"), "--frames is 1-2: ")], ids=str)
def test_bad_input_is_a_one_line_error_and_leaves_no_files(tmp_path, capsys, arguments, message):
    source = colours(tmp_path / "a.exr", (1, 1, 1))
    assert message in failure(capsys, "filter", source, *QUICK, *arguments, "--output", tmp_path / "out.exr")
    assert list(tmp_path.iterdir()) == [source]


@pytest.mark.parametrize("arguments", [("--wavelengths", "400:700:9"), ("--fov", "40"), ("--layer", "RGB"),
                                       ("--focal-mm", "50", "--sensor-width-mm", "36"), ("--shift", "1,2")], ids=str)
def test_rgb_options_are_refused_for_a_spectral_file(tmp_path, capsys, arguments):
    source = tmp_path / "spectral.exr"
    write_exr(SpectralImage(np.ones((1, 6, 8)), [550], pitch_um=200.0), source)
    assert is_spectral(source)
    line = failure(capsys, "filter", source, "--lens", "edmund-54852", *arguments, "--output", tmp_path / "out.exr")
    assert f"spectral.exr: {arguments[0]} is " in line and "this file is spectral" in line


def test_non_finite_rgb_pixels_are_treated_like_spectral_ones(tmp_path, capsys):
    rgb = np.ones((18, 24, 3))
    rgb[5, 7, 0] = 1e6  # beyond the range of half precision
    with np.errstate(over="ignore"):
        source = colours(tmp_path / "a.exr", rgb, kind=np.float16)
    assert "a.exr: pixel at row 5, column 7" in failure(capsys, "filter", source, *QUICK, "--output",
                                                        tmp_path / "out.exr")
    assert run("filter", source, *QUICK, "--fireflies", "clamp", "--output", tmp_path / "out.exr") == 0
    colours(tmp_path / "b.exr", (1, 1, 1))
    assert run("filter", tmp_path / "b.exr", *QUICK, "--output", tmp_path / "even.exr") == 0
    np.testing.assert_allclose(read_exr(tmp_path / "out.exr").cube, read_exr(tmp_path / "even.exr").cube, rtol=1e-5)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_non_finite_values_survive_upsampling(value):
    radiance, _ = upsample(picture([[value, 0.5, 0.5], [1, 1, 1]]), NINE_NM, 5.0)
    assert not np.isfinite(radiance.cube[:, 0, 0]).any() and np.isfinite(radiance.cube[:, 0, 1]).all()
    with refused(ImageError, field="pixel at row 0, column 0, 400 nm", where="image"):
        refuse_fireflies(radiance)


def test_negative_light_is_clipped_and_reported(tmp_path, capsys):
    """Green of ACEScg is outside Rec. 709: its red is -0.62."""
    radiance, negative = upsample(picture([-0.62, 1.14, -0.13]), NINE_NM, 5.0)
    assert radiance.cube.min() == 0 and negative > 0.1
    assert upsample(picture([0.2, 0.4, 0.3]), NINE_NM, 5.0)[1] == 0
    source = colours(tmp_path / "a.exr", (0, 1, 0), chromaticities=ACESCG)
    assert run("filter", source, *QUICK, "--output", tmp_path / "out.exr") == 0
    assert "% of the light would be negative" in capsys.readouterr().out


# Sequences

def sequence(tmp_path, frames, name="shot_{:04d}.exr", **header):
    for number in frames:
        rgb = np.random.default_rng(number).random((18, 24, 3)) * (1 + number)
        colours(tmp_path / name.format(number), rgb, **header)


def test_a_sequence_equals_its_single_frames_bit_for_bit(tmp_path):
    sequence(tmp_path, (3, 8, 12))
    colours(tmp_path / "shot_0009.exr", (1, 1, 1), (12, 20))  # a frame of another size in between
    lens = ("--lens", "edmund-54852", "--wavelengths", "450,650")
    assert run("filter", tmp_path / "shot_####.exr", *lens, "--output", tmp_path / "all" / "out_##.exr",
               "--preview", tmp_path / "all" / "p_%03d.png", "--report", tmp_path / "report.json") == 0
    assert sorted(path.name for path in (tmp_path / "all").iterdir()) == [
        f"{name}" for name in (".lensfield", "out_03.exr", "out_08.exr", "out_09.exr", "out_12.exr",
                               "p_003.png", "p_008.png", "p_009.png", "p_012.png")]
    for number in (3, 8, 9, 12):
        assert run("filter", tmp_path / f"shot_{number:04d}.exr", *lens, "--output", tmp_path / "one.exr") == 0
        together, alone = read_exr(tmp_path / "all" / f"out_{number:02d}.exr"), read_exr(tmp_path / "one.exr")
        np.testing.assert_array_equal(together.cube, alone.cube)
        assert together.pitch_um == alone.pitch_um
    frames = json.loads((tmp_path / "report.json").read_text())["frames"]
    assert [frame["frame"] for frame in frames] == [3, 8, 9, 12]
    assert all({"stages_s", "energy", "plan"} <= frame.keys() for frame in frames)
    assert frames[2]["frame_px"] == [12, 20]


def test_previews_of_a_sequence_share_the_exposure_of_the_first(tmp_path):
    for number, level in ((1, 0.2), (2, 0.1)):
        colours(tmp_path / f"a.{number}.exr", (level,) * 3)
    assert run("filter", tmp_path / "a.#.exr", *QUICK, "--output", tmp_path / "o.#.exr", "--preview",
               tmp_path / "p.#.png") == 0
    first, second = (to_rec709(read_exr(tmp_path / f"o.{number}.exr")) for number in (1, 2))
    shown = np.asarray(Image.open(tmp_path / "p.2.png"), dtype=int)
    np.testing.assert_allclose(shown, 255 * encode_srgb(second * auto_exposure(first)), atol=1)
    assert shown.max() < 190  # half the light of the first frame, which is just below white


def test_spectral_sequences_are_filtered_too(tmp_path):
    for number in (1, 2):
        write_exr(SpectralImage(np.full((1, 12, 16), number), [550], pitch_um=200.0), tmp_path / f"r{number}.exr")
    assert run("filter", tmp_path / "r%d.exr", "--lens", "edmund-54852", "--output", tmp_path / "i#.exr") == 0
    first, second = (read_exr(tmp_path / f"i{number}.exr").cube for number in (1, 2))
    np.testing.assert_allclose(second, 2 * first, rtol=1e-5)


@pytest.mark.parametrize("pattern", ["shot_####.exr", "shot_%04d.exr"])
def test_frames_are_matched_by_number(tmp_path, pattern):
    sequence(tmp_path, (10, 9, 12345))
    for other in ("shot_7.exr", "shot_00011.exr", "shot_0011.exr.bak", "shot_0011_a.exr", "shot_.exr"):
        (tmp_path / other).touch()
    shots = find_shots(tmp_path / pattern, tmp_path / "o_##.exr")
    assert [(shot.frame, shot.radiance.name, shot.output.name) for shot in shots] == [
        (9, "shot_0009.exr", "o_09.exr"), (10, "shot_0010.exr", "o_10.exr"), (12345, "shot_12345.exr", "o_12345.exr")]
    assert [shot.frame for shot in find_shots(tmp_path / pattern, tmp_path / "o_#.exr", frames="9-10")] == [9, 10]
    assert [shot.frame for shot in find_shots(tmp_path / pattern, tmp_path / "o_#.exr", frames="10")] == [10]


def test_frame_ranges_are_parsed():
    texts = {"7": [7], "1-4": [1, 2, 3, 4], "1-10:4": [1, 5, 9], "5, 1,3-4,4": [1, 3, 4, 5], "-2--1": [-2, -1],
             "-3-3:3": [-3, 0, 3]}
    assert {text: parse_frames(text) for text in texts} == texts
    for text in ("", "1-", "1:2", "2-1", "1-5:0", "1-5:-1", "1,,2", "scene", "1.5", "9" * 5000):
        with pytest.raises(InputError, match="--frames is .*: expected a range"):
            parse_frames(text)


def test_an_existing_file_with_a_pattern_name_is_not_a_sequence(tmp_path):
    path = colours(tmp_path / "take#3.exr", (1, 1, 1))
    shot, = find_shots(path, tmp_path / "out.exr")
    assert shot.frame is None and shot.radiance == path


@pytest.mark.parametrize("source, changes, message", [
    ("shot_####.exr", {"--output": "out.exr"}, "out.exr: name is out.exr: expected one run of #"),
    ("shot_####.exr", {"--preview": "p.png"}, "p.png: name is p.png: expected one run of #"),
    ("shot_####.exr", {"--output": "#_#.exr"}, "name is #_#.exr: expected one run of #"),
    ("shot_####.exr", {"--output": "shot_####.exr"}, "shot_0001.exr: file is one of the inputs"),
    ("shot_####.exr", {"--preview": "o_####.exr"}, "o_0001.exr: suffix is .exr: expected .png"),
    ("shot_####.exr", {"--frames": "1-4"}, "shot_####.exr: --frames is 1-4: missing 2 of 4 frames: 3, 4"),
    ("shot_####.exr", {"--frames": "1-40"}, "missing 38 of 40 frames: 3, 4, 5, 6, 7, ..."),
    ("shot_####.exr", {"--frames": "1-9:2,20"}, "missing 5 of 6 frames: 3, 5, 7, 9, 20"),
    ("shot_####.exr", {"--frames": f"0-{10 ** 30}"}, "000: expected a range"),
    ("shot_####.exr", {"--frames": f"0-{10 ** 12}"}, f"--frames is 0-{10 ** 12}: expected no more than 2097152 frames"),
    ("shut_####.exr", {"--frames": "1-4"}, "shut_####.exr: file is missing: no frame"),
    ("shot_####.exr", {"--frames": "2-1"}, "--frames is 2-1: expected a range"),
    ("shot_####.exr", {"--frames": "some"}, "--frames is some: expected a range"),
    ("shut_####.exr", {}, "shut_####.exr: file is missing: no frame"),
    ("none/shot_####.exr", {}, "shot_####.exr: file is missing: no frame")], ids=str)
def test_an_impossible_sequence_is_a_one_line_error_before_any_work(tmp_path, capsys, source, changes, message):
    sequence(tmp_path, (1, 2))
    arguments = {"--output": "o_####.exr"} | changes
    names = [str(tmp_path / value) if "." in value else value for value in arguments.values()]
    line = failure(capsys, "filter", tmp_path / source, *QUICK, *(word for pair in zip(arguments, names, strict=True)
                                                                  for word in pair))
    assert message in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["shot_0001.exr", "shot_0002.exr"]


def test_an_error_names_the_frame_and_leaves_earlier_ones(tmp_path, capsys):
    sequence(tmp_path, (1, 2))
    (tmp_path / "shot_0002.exr").write_bytes(b"half a file")
    line = failure(capsys, "filter", tmp_path / "shot_####.exr", *QUICK, "--output", tmp_path / "o_####.exr")
    assert "shot_0002.exr: file is not readable" in line
    assert read_exr(tmp_path / "o_0001.exr").cube.any() and not (tmp_path / "o_0002.exr").exists()


def test_wavelengths_out_of_range_are_an_input_error():
    with refused(InputError, field="wavelength", match="colours are defined from 380 to 780 nm"):
        upsample(picture([1, 1, 1]), [800.0], 5.0)


def test_supersampling_is_applied_and_reported(tmp_path, capsys):
    """The overscan that the lens needs is counted in pixels of the picture, not in subpixels."""
    lens, (source, out) = load_lens("edmund-54852"), (tmp_path / name for name in ("light.exr", "out.exr"))
    image = SpectralImage(np.random.default_rng(0).random((2, 40, 50)), [500, 600], pitch_um=50.0, overscan_px=(5, 5))
    write_exr(image, source)
    needed = []
    for times in (1, 3):
        assert run("filter", source, "--lens", "edmund-54852", "--supersampling", times, "--output", out,
                   "--report", tmp_path / "report.json") == 0
        facts = json.loads((tmp_path / "report.json").read_text())
        assert facts["plan"]["supersampling"] == times
        assert ("3 x 3 per pixel" in capsys.readouterr().out) == (times == 3)
        needed.append(max(facts["overscan_needed_px"]))
        np.testing.assert_array_equal(read_exr(out).cube, simulate(image, lens, Options(supersampling=times)).cube)
    assert abs(needed[1] - needed[0]) <= 1
    assert "supersampling is 17" in failure(capsys, "filter", source, "--lens", "edmund-54852", "--supersampling", 17,
                                            "--output", out)





def filter_sequence(folder, *more, output="out_####.exr", preview="p_####.png"):
    return run("filter", folder / "shot_####.exr", *QUICK, "--output", folder / output, "--preview",
               folder / preview, *more)


def rewritten_frames(folder, *more):
    """Frames that are written when the command runs again."""
    paths = sorted([*folder.glob("out_*"), *folder.glob("p_*")])
    stamps = {path: path.stat().st_mtime_ns for path in paths if path.is_file()}
    assert filter_sequence(folder, *more) == 0
    return sorted({int(path.stem[-4:]) for path in [*folder.glob("out_*"), *folder.glob("p_*")]
                   if stamps.get(path) != path.stat().st_mtime_ns})


def test_existing_frames_of_a_sequence_are_not_filtered_again(tmp_path, capsys):
    sequence(tmp_path, (1, 2, 3))
    assert rewritten_frames(tmp_path, "--frames", "1-2") == [1, 2]
    capsys.readouterr()
    assert rewritten_frames(tmp_path, "--report", tmp_path / "report.json") == [3]
    printed = capsys.readouterr().out
    assert printed.startswith("2 of 3 frames are finished: 1 to filter\n")
    assert "out_0003.exr" in printed and "out_0002.exr" not in printed
    frames = json.loads((tmp_path / "report.json").read_text())["frames"]
    assert [(frame["frame"], frame.get("earlier", False)) for frame in frames] == [(1, True), (2, True), (3, False)]
    assert rewritten_frames(tmp_path) == []
    assert rewritten_frames(tmp_path, "--overwrite") == [1, 2, 3]
    assert run("filter", tmp_path / "shot_####.exr", *QUICK, "--output", tmp_path / "all_####.exr", "--preview",
               tmp_path / "all_####.png") == 0
    for number in (1, 2, 3):
        for one, all_ in ((f"out_{number:04d}.exr", f"all_{number:04d}.exr"), (f"p_{number:04d}.png",
                                                                               f"all_{number:04d}.png")):
            assert (tmp_path / one).read_bytes() == (tmp_path / all_).read_bytes()


@pytest.mark.parametrize("damage, again", [
    (lambda folder: (folder / "out_0002.exr").unlink(), [2]), (lambda folder: (folder / "p_0002.png").unlink(), [2]),
    (lambda folder: os.truncate(folder / "out_0002.exr", 900), [2]),
    (lambda folder: (folder / "p_0002.png").write_bytes(bytes((folder / "p_0002.png").stat().st_size)), [2]),
    (lambda folder: (folder / "out_0002.exr").write_bytes(bytes((folder / "out_0002.exr").stat().st_size)), [2]),
    (lambda folder: (folder / ".lensfield" / "out_0002.exr.json").write_text("[}"), [2]),
    (lambda folder: sequence(folder, [2]), [2]), (lambda folder: os.utime(folder / "shot_0002.exr", ns=(5, 5)), [2]),
    (lambda folder: sequence(folder, [1]), [1, 2])])  # the first frame, whose exposure the previews use
def test_damaged_or_outdated_frames_are_filtered_again(tmp_path, damage, again):
    sequence(tmp_path, (1, 2))
    filter_sequence(tmp_path)
    damage(tmp_path)
    assert rewritten_frames(tmp_path) == again


@pytest.mark.parametrize("more", [("--section-size", 16), ("--lens", "tessar-50mm"), ("--wavelengths", "450,550"),
                                  ("--fov", 30), ("--out-of-field", "vignette")])
def test_changed_settings_filter_all_frames_again(tmp_path, more):
    sequence(tmp_path, (1, 2))
    filter_sequence(tmp_path)
    assert rewritten_frames(tmp_path, *more) == [1, 2] and rewritten_frames(tmp_path, *more) == []


def test_an_unfinished_frame_is_filtered_again(tmp_path, monkeypatch):
    sequence(tmp_path, (1, 2))
    filter_sequence(tmp_path)
    monkeypatch.setattr("lensfield.engine.pictures.preview.write_png", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        filter_sequence(tmp_path, "--overwrite")
    monkeypatch.undo()
    assert rewritten_frames(tmp_path) == [1]


def test_a_link_in_place_of_a_record_is_not_followed(tmp_path):
    sequence(tmp_path, (1,))
    (tmp_path / ".lensfield").mkdir()
    (tmp_path / "precious").write_text("precious")
    (tmp_path / ".lensfield" / "out_0001.exr.json").symlink_to(tmp_path / "precious")
    assert rewritten_frames(tmp_path) == [1] and rewritten_frames(tmp_path) == []
    assert (tmp_path / "precious").read_text() == "precious"


def test_processes_share_a_sequence(tmp_path):
    """One process filters each frame, and previews have the exposure of the first, whichever process wrote it."""
    sequence(tmp_path, range(1, 13))
    assert filter_sequence(tmp_path, output="alone_####.exr", preview="alone_####.png") == 0
    code = f"""
import sys
sys.path[:0] = {[str(ROOT / "tests" / "support"), str(ROOT / "tests" / "stand_ins")]!r}
from lensfield.cli import main
sys.exit(main(["filter", {str(tmp_path / "shot_####.exr")!r}, *{[*map(str, QUICK)]!r}, "--output",
               {str(tmp_path / "out_####.exr")!r}, "--preview", {str(tmp_path / "p_####.png")!r}]))
"""
    processes = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) for _ in range(4)]
    outputs = [process.communicate()[0] for process in processes]
    assert not any(process.returncode for process in processes)
    written = [line for text in outputs for line in text.splitlines() if line.endswith(".exr")]
    assert sorted(written) == [str(tmp_path / f"out_{number:04d}.exr") for number in range(1, 13)]
    for number in range(1, 13):
        for name, end in (("out", "exr"), ("p", "png")):
            assert (tmp_path / f"{name}_{number:04d}.{end}").read_bytes() == (
                tmp_path / f"alone_{number:04d}.{end}").read_bytes()
    assert not list(tmp_path.glob(".lensfield/*.lock"))
