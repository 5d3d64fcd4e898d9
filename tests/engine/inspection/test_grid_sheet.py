"""The sheet and the figures of lenses without rotational symmetry."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from lenses import fine_grid_lens, gaussian_psf, marked_psf
from lensfield import cli
from lensfield.engine.bake import through_focus
from lensfield.engine.inspection.grid_sheet import _end_mm, upright
from lensfield.engine.inspection.info import lens_info, lens_text, table_summary
from lensfield.engine.inspection.psf_map import tile
from lensfield.engine.inspection.sheet import write_lens_plot
from lensfield.engine.lens_files.package import write_package

NM = 400.0, 550.0, 700.0


def coloured(nm, x, y):
    """Barrel distortion along x, and lateral colour along y."""
    return x * (1 + 0.02 * x**2), y * (1 + 2e-5 * (nm - 550))


def anamorphic(**changes):
    """A squeezed lens with one mirror."""
    facts = {"mirrored": (False, True), "squeeze": 2.0, "wavelengths_nm": NM} | changes
    return fine_grid_lens(gaussian_psf(4, 6, 2.5, 17), coloured, lambda nm, x, y: 1 - 0.02 * x**2 - 0.01 * y, **facts)


@pytest.fixture(scope="module")
def sheet(tmp_path_factory):
    path = tmp_path_factory.mktemp("sheet") / "sheet.png"
    write_lens_plot(anamorphic(), path, [10.0, 20.0])
    return np.asarray(Image.open(path).convert("RGB"))


def part(sheet, left, bottom, width, height):
    """A part of a sheet, in inches from its lower left corner."""
    rows, columns = (slice(*(round(len(sheet) / 12 * end) for end in ends))
                     for ends in ((12 - bottom - height, 12 - bottom), (left, left + width)))
    return sheet[rows, columns]


def test_all_panels_are_drawn(sheet):
    assert sheet.shape == (1680, 1680, 3)
    for place in ((1.05, 6.6, 4.9, 2.9), (1.05, 3.4, 4.9, 2.9), (6.85, 7.15, 4.4, 2.9), (6.85, 3.9, 4.4, 2.4),
                  (1.05, 0.95, 4.4, 1.8), (6.85, 0.95, 4.4, 1.8)):
        assert part(sheet, *place).std() > 10


def test_a_tile_shows_a_psf_as_the_picture_does():
    """Light 15 um above and 7.5 um to the right of the chief ray; rows of pictures count downwards."""
    for window in (24, 25):
        placed = tile(upright(marked_psf(6, 3, window)[None])[0], 2.5, 40.0, 128)
        row, column = (np.average(np.arange(128) + 0.5, weights=placed.sum(axis=axis)) for axis in (1, 0))
        assert ((64 - row) * 80 / 128, (column - 64) * 80 / 128) == pytest.approx((15.0, 7.5), abs=0.1)


def test_tiles_are_where_their_psfs_are_in_the_picture(tmp_path):
    """Only the upper right corner of the field has colour."""
    lens = fine_grid_lens(gaussian_psf(4, 4, 2.5, 17), wavelengths_nm=NM)
    psf = lens.psf.copy()
    psf[0, -3:, -3:] = np.roll(psf[0, -3:, -3:], 4, axis=-1)
    write_lens_plot(replace(lens, psf=psf), tmp_path / "sheet.png", [10.0])
    white = part(np.asarray(Image.open(tmp_path / "sheet.png").convert("RGB")), 1.05, 3.4, 4.9, 2.85).astype(int)
    coloured_px = np.argwhere(np.ptp(white, axis=-1) > 60)
    assert len(coloured_px) > 200
    assert coloured_px[:, 0].max() < white.shape[0] / 2 and coloured_px[:, 1].min() > white.shape[1] / 2


def test_the_end_of_the_lens_data_is_outlined():
    """A rectangle: the places on its edge are as far right or up as the last nodes."""
    end_mm = _end_mm(fine_grid_lens(sensor_mm=(8.0, 8.0), mirrored=(True, True)))
    assert np.abs(end_mm).max(axis=0) == pytest.approx((2.5, 2.0), abs=1e-3)
    assert np.max(np.abs(end_mm) / (2.5, 2.0), axis=1) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("lens", [
    fine_grid_lens(wavelengths_nm=(900.0,), rows=2, columns=2, sensor_mm=(1.0, 3.0), name="$x^{ no maths"),
    fine_grid_lens(gaussian_psf(3, 3, 2.5, 8), wavelengths_nm=np.linspace(400, 700, 31), mirrored=(True, True),
                   sensor_mm=(8.0, 8.0), object_distance_mm=np.inf)], ids=["portrait", "sensor too large"])
def test_unusual_lenses_have_sheets(lens, tmp_path):
    write_lens_plot(lens, tmp_path / "sheet.png", [10.0])
    assert np.asarray(Image.open(tmp_path / "sheet.png")).std() > 10


def test_figures_of_places():
    info = lens_info(anamorphic())
    assert json.loads(json.dumps(info)) == info
    places = {(place["x_mm"], place["y_mm"]): place for place in info["places"]}
    assert set(places) == {(0, 0), (1.2, 0), (2.4, 0), (0, 0.9), (0, 1.8), (0, -0.9), (0, -1.8), (1.2, 0.9), (2.4, 1.8),
                           (1.2, -0.9), (2.4, -1.8)}
    corner = places[2.4, -1.8]
    assert (corner["ideal_x_mm"], corner["ideal_y_mm"]) == pytest.approx((2.4 * (1 + 0.02 * 2.4**2), -1.8), abs=1e-6)
    assert corner["distortion_percent"] == pytest.approx(100 * (3 / np.hypot(2.4 * 1.1152, 1.8) - 1), abs=1e-4)
    assert corner["relative_illumination"] == pytest.approx(1 - 0.02 * 2.4**2 + 0.018, abs=0.01)
    expected_um = 1e3 * -1.8 * (1 / (1 + 2e-5 * (486.1 - 550)) - 1 / (1 + 2e-5 * (656.3 - 550)))
    assert (corner["lateral_colour_x_um"], corner["lateral_colour_y_um"]) == pytest.approx((0, expected_um), abs=0.01)
    assert corner["covered"] and places[0, 0]["distortion_percent"] == 0
    assert info["capture_focal_length_x_mm"] == info["capture_focal_length_mm"] / 2 == 5.25


def test_places_beyond_the_lens_data_are_marked():
    lines = lens_text(lens_info(anamorphic(sensor_mm=(4.8, 4.4)))).splitlines()
    assert [line.split()[1] for line in lines if "beyond the lens data" in line] == 2 * ["2.200", "-2.200"]


def test_the_text_states_the_camera_and_every_place():
    text = lens_text(lens_info(anamorphic()))
    assert "camera's focal length    10.50000 mm along the height, 5.25000 mm along the width" in text
    assert "squeeze                  2.0000" in text and "plane of focus" not in text
    assert "   2.400    1.800 mm     2.6765     1.8000 mm    -6.99 %" in text and "-0.00 " not in text


def test_the_plane_of_focus_leans_by_its_slope():
    """Along y the inverse depth rises by 0.001 per mm, and the tangent of the angle by 1 per 10.5 mm: a lean of
    atan(0.0105 * 105)."""
    info = lens_info(fine_grid_lens(focus_slope=(0.0, 1e-3)))
    assert info["focus_lean_deg"] == pytest.approx([0, np.degrees(np.arctan(0.0105 * 105))])
    assert "plane of focus leans     47.8 degrees towards the lens at the top" in lens_text(info)
    text = lens_text(lens_info(fine_grid_lens(focus_slope=(-1e-3, 1e-3), squeeze=2.0)))
    assert "leans     28.9 degrees towards the lens on the left, 47.8 degrees towards the lens at the top" in text


def test_the_summary_of_a_bake_names_its_nodes():
    lens = anamorphic()
    energy = lens.enclosed_energy.copy()
    energy[1, 2, 3] = 0.75
    assert table_summary(replace(lens, enclosed_energy=energy)) == (
        "f = 10 mm, f/2, 9 x 6 nodes to y = 2 mm, x = 2.5 mm x 3 wavelengths; PSFs of 17 x 17 samples of 2.5 um "
        "contain at least 75.00% of the light (minimum at x = 1.5 mm, y = -1 mm, 550 nm)")


def test_the_commands_accept_a_package(tmp_path, capsys, monkeypatch):
    path = tmp_path / "own lens.npz"
    write_package(anamorphic(), path)
    assert cli.main(["lens", "info", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["squeeze"] == 2
    assert cli.main(["lens", "check", str(path)]) == 0 and "transmittance" in capsys.readouterr().out
    assert cli.main(["lens", "plot", str(path), "--frequencies", "10,20"]) == 0
    assert path.with_suffix(".png").is_file() and capsys.readouterr().out == f"{path.with_suffix('.png')}\n"
    monkeypatch.setattr(through_focus, "MOST_LINES", 2)
    monkeypatch.setattr(through_focus, "MOST_WAVELENGTHS", 1)
    assert cli.main(["lens", "plot", str(path), "--depth", "2m", "-o", str(tmp_path / "far.png")]) == 0
    assert (tmp_path / "far.png").is_file()
