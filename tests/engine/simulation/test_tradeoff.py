"""The trade-off between error and time, measured on tiny pictures."""

import csv

import numpy as np
import pytest
from PIL import Image

from lenses import comatic_lens, fine_grid_lens, gaussian_psf, make_lens
from lensfield import cli
from lensfield.engine import Options, SpectralImage
from lensfield.engine.field.psf_samples import psf_radius_px
from lensfield.engine.inspection import tradeoff, tradeoff_plot
from lensfield.engine.inspection.axes import Panel
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.pictures.spectral_exr import write_exr
from written import check_legible, written

COLUMNS = ("image curve method section_size azimuths precision psf_energy accuracy wavelengths seconds "
           "seconds_over_paper peak_mb relative_l2 maximum_error l1 predicted_bound against").split()
CURVES = {"exact", tradeoff.AS_WRITTEN, "paper", "pixels", "sections", "accuracy", "precision", "PSF support"}
SHAPE_PX = 36, 48
LENS = comatic_lens(psf_pitch_um=50.0)  # PSFs of some pixels, with 48 pixels on the sensor


@pytest.fixture(scope="module")
def rows():
    pictures, spectral = tradeoff.standard_pictures(LENS, SHAPE_PX)
    few = {name: {1: thinned[1], 3: thinned[3], 5: thinned[5]} for name, thinned in spectral.items()}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tradeoff, "ACCURACIES", (0.1, 0.03))
        return tradeoff.measure(LENS, pictures, few, quick=True)


@pytest.fixture(scope="module")
def lens_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("lens") / "small.npz"
    write_package(LENS, path)
    return path


@pytest.fixture
def few_settings(monkeypatch):
    chosen = [(tradeoff.AS_WRITTEN, Options(method="paper")), ("sections", Options(section_size=16)),
              ("pixels", Options(method="pixels", azimuths=8))]
    monkeypatch.setattr(tradeoff, "settings", lambda *_: chosen)
    monkeypatch.setattr(tradeoff, "WAVELENGTHS", (1, 3))


def of(rows, **facts):
    return [row for row in rows if all(getattr(row, name) == value for name, value in facts.items())]


def run(*arguments):
    return cli.main(["tradeoff", *map(str, arguments)])


def table(folder):
    with open(folder / "tradeoff.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def is_png(path):
    with Image.open(path) as picture:
        return picture.format == "PNG" and min(picture.size) > 500


def test_every_curve_is_measured_on_both_pictures(rows):
    assert {row.curve for row in of(rows, image="points")} == CURVES
    assert {row.curve for row in of(rows, image="checkerboard")} == CURVES


def test_the_exact_operator_has_no_error_and_all_others_have_some(rows):
    for row in rows:
        measured = (row.relative_l2, row.maximum_error, row.l1)
        assert np.all(np.isfinite(measured)) and min(row.seconds, row.seconds_over_paper, row.peak_mb) > 0
        assert (max(measured) == 0) == (row.curve == "exact" or (row.curve, row.wavelengths) == ("wavelengths", 5))


@pytest.mark.parametrize("image", ["points", "checkerboard"])
@pytest.mark.parametrize("curve, knob", [("paper", "section_size"), ("sections", "azimuths"), ("pixels", "azimuths")])
def test_errors_fall_with_smaller_sections_and_more_azimuths(rows, image, curve, knob):
    measured = sorted(of(rows, image=image, curve=curve), key=lambda row: getattr(row, knob))
    measured = measured[::-1] if knob == "azimuths" else measured
    errors = [row.relative_l2 for row in measured]
    assert len(errors) >= 2 and np.all(np.diff(errors) > 0)


def test_the_papers_time_is_the_unit_of_time(rows):
    written = of(rows, curve=tradeoff.AS_WRITTEN)
    assert [row.seconds_over_paper for row in written] == [1, 1, 1]
    assert all((row.method, row.section_size, row.precision) == ("paper", 16, "float64") for row in written)


def test_errors_stay_within_the_requested_and_the_predicted_bound(rows):
    measured = of(rows, curve="accuracy")
    assert [row.accuracy for row in measured] == [0.03, 0.03]
    assert all(row.l1 <= row.predicted_bound <= row.accuracy for row in measured)


def test_colours_are_compared_with_those_of_the_most_wavelengths(rows):
    measured = of(rows, curve="wavelengths")
    assert [row.wavelengths for row in measured] == [5, 1]
    assert measured[0].relative_l2 == 0 < measured[1].relative_l2
    assert {row.against for row in measured} == {"5 wavelengths in Rec. 709"}


def test_errors_by_hand():
    assert tradeoff.errors([3.0, 1.0, 0.0], np.array([3.0, 0.0, 4.0])) == pytest.approx(
        {"relative_l2": np.sqrt(17) / 5, "maximum_error": 1.0, "l1": 5 / 7})


def test_memory_counts_only_what_the_work_allocates():
    existing = np.ones(1 << 20)
    _, peak_mb = tradeoff._traced(lambda: (existing + 1).sum())
    assert peak_mb == pytest.approx(existing.nbytes / 1e6, rel=0.01)


def test_the_frontier_omits_rows_that_are_beaten_in_both(rows):
    best = tradeoff_plot.frontier(of(rows, image="points"))
    assert np.all(np.diff([row.seconds for row in best]) > 0)
    assert np.all(np.diff([row.relative_l2 for row in best]) < 0)
    assert all(any(row.seconds >= one.seconds and row.relative_l2 >= one.relative_l2 for one in best) for row in rows
               if row.image == "points")


def test_points_of_the_plot_are_where_they_were_measured(rows, tmp_path, monkeypatch):
    """Checks a curve in the first panel, by the panel's limits; and that all texts are legible."""
    panels, curve = [], Panel.curve
    monkeypatch.setattr(Panel, "curve", lambda panel, *drawn: panels.append(panel) or curve(panel, *drawn))
    with written() as texts:
        tradeoff_plot.write_plot(rows, tmp_path / "plot.png", "a title " * 40)
    check_legible(texts)
    with Image.open(tmp_path / "plot.png") as picture:
        pixels = np.asarray(picture)
    assert pixels.shape == (900, 2040, 3)
    panel = panels[0]
    for row in of(rows, image="points", curve="sections"):
        share = [np.log(value / axis.low) / np.log(axis.high / axis.low) for value, axis in
                 ((row.seconds, panel.x), (row.relative_l2, panel.y))]
        place = [150 * (panel.box.left + share[0] * panel.box.width),
                 900 - 150 * (panel.box.bottom + share[1] * panel.box.height)]
        across, down = (slice(int(each) - 2, int(each) + 3) for each in place)
        assert (np.abs(pixels[down, across] - np.array([0, 158, 115])).max(axis=-1) < 40).any()  # its marker's green


def test_a_lens_that_does_not_blur_has_a_plot_too(few_settings, tmp_path):
    lens = make_lens()
    pictures, _ = tradeoff.standard_pictures(lens, (8, 8))
    rows = tradeoff.measure(lens, {"points": pictures["points"]}, {}, quick=True)
    tradeoff_plot.write_plot(rows, tmp_path / "plot.png", tradeoff.description(lens, pictures))
    assert is_png(tmp_path / "plot.png")


def test_a_lens_without_rotational_symmetry_is_measured_without_the_papers_method(monkeypatch, tmp_path):
    monkeypatch.setattr(tradeoff, "ACCURACIES", (0.1, 0.03))
    lens = fine_grid_lens(gaussian_psf(150, 100, 50.0, 9), psf_pitch_um=50.0)
    pictures, spectral = tradeoff.standard_pictures(lens, (12, 16))
    few = {name: {1: thinned[1], 3: thinned[3]} for name, thinned in spectral.items()}
    rows = tradeoff.measure(lens, {"points": pictures["points"]}, few, quick=True)
    assert {row.curve for row in rows} == {*CURVES, "wavelengths"} - {tradeoff.AS_WRITTEN, "paper"}
    assert all(row.seconds > 0 and row.seconds_over_paper is None for row in rows)
    tradeoff.write_table(rows, tmp_path / "tradeoff.csv")
    assert {line["seconds_over_paper"] for line in table(tmp_path)} == {""}
    tradeoff_plot.write_plot(rows, tmp_path / "plot.png", tradeoff.description(lens, pictures))
    assert is_png(tmp_path / "plot.png")


def test_the_command_writes_a_table_and_a_plot_into_a_new_folder(lens_file, few_settings, tmp_path, capsys):
    folder = tmp_path / "new" / "folder"
    assert run("--lens", lens_file, "--size", "48x36", "--quick", "--output", folder) == 0
    assert capsys.readouterr().out.split() == [str(folder / "tradeoff.csv"), str(folder / "tradeoff.png")]
    lines = table(folder)
    assert list(lines[0]) == COLUMNS
    assert {line["image"] for line in lines} == {"points", "checkerboard", "colour chart"}
    assert lines[0] | {"method": "exact", "section_size": "", "relative_l2": "0"} == lines[0]
    assert is_png(folder / "tradeoff.png")
    assert {path.name for path in folder.iterdir()} == {"tradeoff.csv", "tradeoff.png"}


def test_the_command_measures_on_the_middle_of_a_picture(lens_file, few_settings, tmp_path):
    cube = np.random.default_rng(0).random((2, 60, 70))
    write_exr(SpectralImage(cube, [500, 600], pitch_um=100.0, overscan_px=(6, 6)), tmp_path / "scene.exr")
    assert run("--lens", lens_file, "--image", tmp_path / "scene.exr", "--size", "24x20", "--quick",
               "--output", tmp_path) == 0
    lines = table(tmp_path)
    assert {line["image"] for line in lines} == {"scene"}
    assert {line["wavelengths"] for line in lines if line["against"] == tradeoff.EXACT} == {"2"}
    assert is_png(tmp_path / "tradeoff.png")


def test_a_crop_keeps_the_light_that_comes_in_from_around_it():
    radiance = SpectralImage(np.random.default_rng(0).random((1, 120, 140)), [550], pitch_um=100.0)
    cropped = tradeoff.cropped_frame(radiance, LENS, (20, 24))
    assert cropped.frame_px == (20, 24) and min(cropped.overscan_px) > psf_radius_px(LENS, 100.0)
    assert cropped.cube.shape[1] < 120 and cropped.grid.centred


@pytest.mark.parametrize("changes, message", [
    ({"--lens": "no-such-lens"}, "no-such-lens: lens is missing"),
    ({"--size": "48"}, "options: --size is 48: expected WIDTHxHEIGHT"),
    ({"--size": "0x36"}, "options: --size is 0x36"),
    ({"--pitch-um": "-1"}, "pitch_um is -1.0"),
    ({"--image": "missing.exr"}, "missing.exr: file is missing"),
    ({"--output": "a-file"}, "a-file: folder is impossible to create")])
def test_bad_input_gives_one_line(lens_file, tmp_path, capsys, monkeypatch, changes, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a-file").touch()
    arguments = {"--lens": lens_file, "--output": "folder"} | changes
    assert run(*(word for pair in arguments.items() for word in pair)) == 1
    printed = capsys.readouterr().err
    assert message in printed and printed.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a-file"]


def test_a_black_picture_is_named(lens_file, tmp_path, capsys):
    write_exr(SpectralImage(np.zeros((1, 8, 8)), [550], pitch_um=100.0), tmp_path / "night.exr")
    assert run("--lens", lens_file, "--image", tmp_path / "night.exr", "--output", tmp_path / "folder") == 1
    assert "night.exr: radiance is black" in capsys.readouterr().err
