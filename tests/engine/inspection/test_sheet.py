"""The lens sheet: its drawings, and its command."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lenses import comatic_lens, fine_grid_lens, gaussian_psf, make_lens, marked_psf
from lensfield import cli
from lensfield.engine import InputError, LensError, load_lens
from lensfield.engine.inspection import radial_sheet
from lensfield.engine.inspection import sheet as sheet_module
from lensfield.engine.inspection.canvas import Box, Page
from lensfield.engine.inspection.colour_map import INFERNO
from lensfield.engine.inspection.psf_map import draw_single, hidden_share, tile
from lensfield.engine.inspection.sheet import write_lens_plot
from lensfield.engine.inspection.style import degree_labels
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.photographs import Agreement, Vignetting
from lensfield.engine.prescription.readers.toml import write_prescription
from refusals import refused
from written import check_legible, written

SIDE_PX = 1680
HEAVIEST_BYTES = 170_000


def pixels(path):
    with Image.open(path) as picture:
        assert picture.format == "PNG"
        return np.asarray(picture.convert("RGB"))


def part(sheet, left, bottom, width, height):
    """Pixels of a region given in inches of a sheet of 12 x 12, as `lens_plot` gives them."""
    rows, columns = (slice(*(int(SIDE_PX / 12 * end) for end in ends))
                     for ends in ((12 - bottom - height, 12 - bottom), (left, left + width)))
    return sheet[rows, columns]


def run(*arguments):
    return cli.main(["lens", "plot", *map(str, arguments)])


@pytest.fixture(scope="module")
def sheet(tmp_path_factory):
    path = tmp_path_factory.mktemp("sheet") / "sheet.png"
    write_lens_plot(comatic_lens(), path)
    return pixels(path)


@pytest.fixture
def lens_file(tmp_path):
    path = tmp_path / "own lens.npz"
    write_package(make_lens(gaussian_psf(4, 6, 2.5, 17)), path)
    return path


def test_a_sheet_is_white_paper_with_something_in_every_panel(sheet):
    assert sheet.shape == (SIDE_PX, SIDE_PX, 3)
    assert np.all(sheet[0] == 255) and np.all(sheet[:, -1] == 255) and 0.5 < np.mean(sheet == 255) < 0.95
    for place in ((6.85, 7.15, 4.4, 2.9), (6.85, 3.9, 4.4, 2.4), (1.05, 0.95, 4.9, 1.8), (6.85, 0.95, 4.4, 1.8)):
        assert 0.01 < np.mean(part(sheet, *place).min(axis=-1) < 128) < 0.5
    assert np.mean(part(sheet, 1.05, 7.0, 4.5, 2.5).max(axis=-1) < 32) > 0.2  # the dark background of the tiles


def test_photographs_are_points_next_to_the_light_of_the_lens(sheet, tmp_path):
    heights_mm, relative = np.array([0.5, 1.1, 1.6]), 0.7
    light = Vignetting(5.6, np.inf, heights_mm, np.full(3, relative))
    write_lens_plot(comatic_lens(), tmp_path / "own.png", photographs=Agreement("mine", "", 0.02, light=(light,)))
    differs = np.any(np.abs(pixels(tmp_path / "own.png").astype(int) - sheet) > 60, axis=-1)  # more than the palettes
    end_mm = comatic_lens().real_height_mm[-1, -1]
    for height_mm in heights_mm:
        left, bottom = 1.05 + 4.9 * height_mm / end_mm, 0.95 + 1.8 * relative / 1.03
        assert part(differs, left - 0.04, bottom - 0.04, 0.08, 0.08).mean() > 0.3
        assert not part(differs, left - 0.04, bottom + 0.06, 0.08, 0.08).any()
    assert part(differs, 0.3, 0.0, 9.0, 0.4).any() and not part(differs, 0.3, 3.5, 11.0, 8.0).any()


def test_the_end_of_the_lens_data_is_a_circle_in_the_picture(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(radial_sheet, "draw_distortion", lambda *arguments: drawn.append(arguments[-1]))
    for sensor_mm in ((4.8, 3.6), (1.2, 0.9)):
        write_lens_plot(make_lens(heights_mm=(0.0, 2.0), sensor_mm=sensor_mm), tmp_path / "sheet.png", [10.0])
    assert np.hypot(*drawn[0].T) == pytest.approx(2.0) and drawn[1] is None


@pytest.mark.parametrize("options, message", [
    (["--ghosts", "10", "--depth", "2m"], "--depth is 2m: leave it out: --ghosts plots the ghosts alone"),
    (["--ghosts", "10", "--frequencies", "20"], "--frequencies is 20: leave it out"),
    (["--iris-blades", "5"], "--iris-blades is 5: also give --ghosts")])
def test_options_that_a_plot_does_not_show_are_refused(capsys, tmp_path, options, message):
    assert run("tessar-50mm", "-o", tmp_path / "sheet.png", *options) == 1
    assert message in capsys.readouterr().err and not any(tmp_path.iterdir())


def test_tiles_have_a_logarithmic_scale():
    """A PSF with its peak on the outer side, a median level on the inner one, and no light along its upper edge."""
    psf = np.ones((1, 1, 9, 9))
    psf[..., :4, :] = 10**-1.5  # along v, which is outwards: to the right
    psf[..., :2] = 1e-5  # along u, which is downwards
    page = Page(1, 1, 96)
    draw_single(page, Box(0, 0, 1, 1), psf, 1.0, 96)
    left, right, top = (page.pixels()[row, column] for row, column in ((60, 25), (60, 65), (10, 65)))
    assert np.array_equal(right, INFERNO[-1]) and np.array_equal(top, INFERNO[0])
    assert any(np.array_equal(left, colour) for colour in INFERNO[11:13])


def test_the_row_in_white_light_shows_lateral_colour(sheet, tmp_path):
    def coloured_px(sheet):
        return (np.ptp(part(sheet, 1.05, 6.0, 4.5, 1.6).astype(int), axis=-1) > 100).sum()

    lens = make_lens(gaussian_psf(4, 4, 2.5, 17), lambda nm, p: p * (1 + 2e-5 * (nm - 550)))
    write_lens_plot(lens, tmp_path / "coloured.png")
    assert coloured_px(pixels(tmp_path / "coloured.png")) > 10 * coloured_px(sheet) + 1000


def test_a_tile_has_outwards_to_the_right_and_keeps_shape_and_light():
    placed = tile(marked_psf(6, 3), 2.5, 40.0, 128)
    row, column = (np.average(np.arange(128) + 0.5, weights=placed.sum(axis=axis)) for axis in (1, 0))
    um_per_px = 80 / 128
    assert (column - 64) * um_per_px == pytest.approx(15.0, abs=0.1)
    assert (row - 64) * um_per_px == pytest.approx(7.5, abs=0.1)
    coarse, fine = (tile(gaussian_psf(3, 6, 1.0, 101), 1.0, 40.0, n) for n in (32, 256))
    assert coarse.sum() * (80 / 32)**2 == pytest.approx(1, abs=1e-3) == fine.sum() * (80 / 256)**2
    row, column = (np.sqrt(np.average(((np.arange(256) + 0.5) / 3.2 - 40)**2, weights=fine.sum(axis=axis)))
                   for axis in (1, 0))
    assert (row, column) == (pytest.approx(6, rel=0.02), pytest.approx(3, rel=0.03))


@pytest.mark.parametrize("lens", [
    make_lens(wavelengths_nm=(900.0,), heights_mm=(0.0, 2.0), name="$x^{ no formula", maker="m" * 300),
    make_lens(gaussian_psf(3, 3, 2.5, 8), lambda nm, p: 2 * np.arctan(p / 2), object_distance_mm=np.inf,
              heights_mm=2 * np.tan(np.radians(np.linspace(0, 75, 60))), name="a_name_without_a_space" * 10,
              story="A fisheye that sees nearly all. " * 20, wavelengths_nm=np.linspace(400, 700, 31))],
    ids=["one wavelength", "fisheye of 150 degrees"])
def test_unusual_lenses_have_sheets(lens, tmp_path):
    write_lens_plot(lens, tmp_path / "sheet.png", [10.0])
    assert pixels(tmp_path / "sheet.png").std() > 10


NAMES = "W" * 50, "Å", "a_name_without_a_space" * 10, "Angénieux  Optimo\n24-290 mm"


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("make", [make_lens, fine_grid_lens])
def test_texts_are_legible_with_any_name(name, make, tmp_path):
    """Also with many digits in the header, two lines of story and source, and wavelengths of four digits."""
    lens = make(name=name, maker="Mg" * 150, story="WIDE WORDS " * 40, source="a source " * 60,
                sensor_mm=(4.7654, 3.5741), object_distance_mm=123456.7, reference_wavelength_nm=546.0739,
                wavelengths_nm=(404.66, 435.83, 546.07, 587.56, 1013.98))
    with written() as texts:
        write_lens_plot(lens, tmp_path / "sheet.png", [0.125, 12.5, 25.0])
    check_legible(texts)
    assert part(pixels(tmp_path / "sheet.png"), 12 - 0.28, 10.8, 0.28, 1.2).min() == 255


@pytest.mark.parametrize("sensor_mm", [(1.0, 3.0), (8.0, 8.0), (4.8, 1.2)])
@pytest.mark.parametrize("mirrored", [(False, False), (True, True)])
def test_texts_are_legible_on_any_sensor(sensor_mm, mirrored, tmp_path):
    with written() as texts:
        write_lens_plot(fine_grid_lens(sensor_mm=sensor_mm, mirrored=mirrored), tmp_path / "sheet.png", [10.0])
    check_legible(texts)


@pytest.mark.parametrize("degrees, labels", [
    ([0, 0.6, 1.2, 1.8], ["0.0°", "0.6°", "1.2°", "1.8°"]), ([0, 13.7, 28.1], ["0°", "14°", "28°"]),
    ([0, 0.04, 0.09], ["0.00°", "0.04°", "0.09°"]), ([7.3], ["7°"])])
def test_angles_have_enough_decimals_to_differ(degrees, labels):
    assert degree_labels(np.array(degrees, dtype=float)) == labels


def test_light_that_the_tiles_do_not_show_is_counted():
    """A hundredth of the light in a faint haze, a fiftieth in one sample beyond the tile that frames most PSFs."""
    psfs = np.zeros((1, 20, 41, 41))
    psfs[..., 20, 20] = 1.0
    assert hidden_share(psfs, 1.0) == 0.0
    psfs[0, 0] = 0.01 / (41 * 41 - 1)
    psfs[0, 0, 20, 20] = 0.99
    assert hidden_share(psfs, 1.0) == pytest.approx(0.01)
    psfs[0, 1, 20, 20], psfs[0, 1, 20, 39] = 0.98, 0.02
    assert hidden_share(psfs, 1.0) == pytest.approx(0.02)


@pytest.mark.parametrize("frequencies", [[], [1.0] * 6])
def test_one_to_five_frequencies(frequencies, tmp_path):
    with pytest.raises(InputError, match="frequencies is . of them: expected 1 to 5"):
        write_lens_plot(make_lens(), tmp_path / "sheet.png", frequencies)


def test_a_lens_that_folds_the_picture_has_no_sheet(tmp_path):
    with refused(LensError, field="real_height_mm", where="hand-made"):
        write_lens_plot(make_lens(real_height_mm=lambda nm, p: p * (1 - 0.2 * p**2)), tmp_path / "sheet.png")
    assert not list(tmp_path.iterdir())


def test_the_command_puts_the_sheet_next_to_the_file(lens_file, capsys):
    assert run(lens_file) == 0
    path = lens_file.with_suffix(".png")
    assert capsys.readouterr().out == f"{path}\n" and pixels(path).std() > 10
    assert {item.name for item in lens_file.parent.iterdir()} == {lens_file.name, path.name}


def test_the_command_draws_a_bundled_lens_in_the_current_folder(tmp_path, monkeypatch, capsys):
    drawn = []
    monkeypatch.setattr(sheet_module, "write_lens_plot", lambda *arguments: drawn.append(arguments))
    monkeypatch.chdir(tmp_path)
    assert run("edmund-54852", "--frequencies", "40, 80") == 0
    assert capsys.readouterr().out == "edmund-54852.png\n"
    assert drawn == [(load_lens("edmund-54852"), Path("edmund-54852.png"), [40.0, 80.0], None)]


def test_the_command_draws_photographs_at_the_lens_s_f_stop_and_focus(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(sheet_module, "write_lens_plot", lambda *arguments: drawn.append(arguments[-1]))
    curves = [Vignetting(f_number, focus_mm, np.array([5.0, 20.0]), np.array([0.9, 0.6]))
              for f_number in (5.5, 11.0) for focus_mm in (np.inf, 1500.0)]
    lens = replace(prescription_of("tessar-50mm"), photographs=Agreement("mine", "", 0.01, light=tuple(curves)))
    (tmp_path / "own.toml").write_text(write_prescription(lens))
    for settings in ((), ("--f-number", "11", "--focus", "2m"), ("--f-number", "8")):
        assert run(tmp_path / "own.toml", *settings, "--lens-quality", "preview") == 0
    assert [each.light for each in drawn] == [(curves[0],), (curves[3],), ()]


def test_the_command_draws_points_out_of_focus(lens_file, monkeypatch):
    drawn = []
    monkeypatch.setattr(sheet_module, "write_lens_plot", lambda *arguments: drawn.append(arguments))
    assert run(lens_file, "--depth", "40cm") == 0
    (lens, *_), here = drawn[0], load_lens(lens_file)
    assert lens.name == "hand-made, points at 0.4 m" and np.array_equal(lens.heights_mm, here.heights_mm)
    assert lens.psf_pitch_um * lens.psf.shape[-1] > 3 * here.psf_pitch_um * here.psf.shape[-1]


@pytest.mark.parametrize("arguments, message", [
    (("edmund-54852", "--depth", "40"), "options: --depth is 40: expected a distance with its unit, such as 1.2m"),
    (("no-such-lens",), "no-such-lens: lens is missing"),
    (("edmund-54852", "--frequencies", "20;50"), "options: --frequencies is 20;50: expected cycles per mm such as"),
    (("edmund-54852", "--frequencies", "20,2000"), "edmund-54852: frequency is 2000 cycles/mm: expected more than 0"),
    (("edmund-54852", "-o", "sheet.jpg"), "sheet.jpg: suffix is .jpg: expected .png"),
    (("edmund-54852", "-o", "a-file/sheet.png"), "a-file: folder is impossible to create"),
    ((".",), ".: lens is a folder")])
def test_bad_input_gives_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a-file").touch()
    assert run(*arguments) == 1
    printed = capsys.readouterr().err
    assert message in printed and printed.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a-file"]
