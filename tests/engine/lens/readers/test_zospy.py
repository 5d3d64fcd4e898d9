"""ZOSPy's PSFs, as JSON and as DataFrames: where the chief ray is whatever the labels say."""

import json

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.lens.readers.psf_grid import psf_table
from lensfield.engine.lens.readers.zospy import psf_grid_of_file, psf_grid_of_frame, psfs_of_frames
from vendor_files import check_that_damage_is_harmless, frame, vendor_export, zospy_json, zospy_labels

MARKED = np.full((8, 8), 0.01)
MARKED[4, 4], MARKED[6, 5] = 0.5, 1.0  # the chief ray; two up and one to the right of it


def mark(grid):
    row, column = np.unravel_index(grid.values.argmax(), grid.values.shape)
    return row - grid.centre[0], column - grid.centre[1]


def written(path, **changes):
    path.write_text(zospy_json(MARKED, 0.5, **changes), encoding="utf-8")
    return path


def test_labels_are_half_a_sample_off(tmp_path):
    grid = psf_grid_of_file(written(tmp_path / "psf.json"))
    assert grid.centre == (4, 4) and mark(grid) == (2, 1) and grid.pitch_um == pytest.approx(0.5)


@pytest.mark.parametrize("side, v, u", [("+y", 2, 1), ("-y", -2, -1)])
def test_rows_ascend_with_y(tmp_path, side, v, u):
    psf, _ = psf_table([[psf_grid_of_file(written(tmp_path / "psf.json"))]], side)
    centre = psf.shape[-1] // 2
    assert np.unravel_index(psf[0, 0].argmax(), psf.shape[2:]) == (centre + v, centre + u)


def test_the_header_tells_an_fft_centre_and_the_image_point(tmp_path):
    header = ["Polychromatic FFT PSF", "0,5430 to 0,5430 µm at 10,00, 20,00 (deg).", "Data spacing is 0,500 µm.",
              "Reference Coordinates: 0,00000E+00, 7,28631E+00", "Image grid size: 256 by 256",
              "Center point is: row 129, column 128"]
    grid = psf_grid_of_file(written(tmp_path / "psf.json", header=header))
    assert grid.centre == (3, 3) and grid.image_mm == (0.0, pytest.approx(7.28631))


def test_labels_that_hold_0_are_taken_at_their_word():
    labels = np.arange(-4, 4) * 0.5
    assert psf_grid_of_frame(frame(MARKED, labels, labels)).centre == (4, 4)


@pytest.mark.parametrize("flipped", [(False, False), (True, False), (False, True), (True, True)])
def test_labels_that_descend_are_heeded(flipped):
    labels = zospy_labels(8, 0.5, 4)
    rows, columns = (slice(None, None, -1 if flip else 1) for flip in flipped)
    grid = psf_grid_of_frame(frame(MARKED[rows][:, columns], labels[rows], labels[columns]))
    assert mark(grid) == (2, 1) and grid.centre == (4, 4)


def test_a_table_of_psfs_is_made_of_frames():
    labels = zospy_labels(8, 0.5, 4)
    psf, pitch_um = psfs_of_frames([[frame(MARKED, labels, labels)] * 3] * 2, "+y")
    assert psf.shape == (2, 3, 7, 7) and pitch_um == pytest.approx(0.5)


def test_the_real_huygens_psf_is_symmetric_about_its_chief_ray():
    """Of a point on the axis of a rotationally symmetric lens: that shows which sample is the chief ray's."""
    grid = psf_grid_of_file(vendor_export("zospy") / "huygens_psf_24.2.2.json")
    assert grid.values.shape == (64, 64) and grid.centre == (32, 32)
    assert grid.pitch_um == pytest.approx(0.6827814)
    psf, _ = psf_table([[grid]], "+y")
    for mirrored in (psf[0, 0, ::-1], psf[0, 0, :, ::-1], psf[0, 0].T):
        np.testing.assert_allclose(psf[0, 0], mirrored, rtol=1e-5)


def test_the_real_fft_psf_is_centred_where_its_header_and_its_labels_say():
    """Off the axis in x as well: row 129 from the top and column 128 of 256, of which the middle 32 are there."""
    path = vendor_export("zospy") / "fft_psf_asymmetric_25.1.1.json"
    grid = psf_grid_of_file(path)
    assert grid.centre == (15, 15) and grid.pitch_um == pytest.approx(1.2134111)
    assert grid.image_mm == (pytest.approx(3.52988), pytest.approx(7.28631))
    table = json.loads(path.read_text(encoding="utf-8"))["data"]
    assert psf_grid_of_frame(frame(table["data"], table["index"], table["columns"])).centre == (15, 15)
    with pytest.raises(LensError, match="image point.*along y"):
        psf_table([[grid]], "+y")


@pytest.mark.parametrize("settings", [{"psf_type": "Log"}, {"rotation": 90}, {"use_centroid": True}], ids=str)
def test_psfs_on_other_scales_or_turned_are_refused(tmp_path, settings):
    with pytest.raises(LensError) as error:
        psf_grid_of_file(written(tmp_path / "psf.json", **settings))
    assert error.value.field in settings


@pytest.mark.parametrize("text", ["", "[1, 2]", "null", "{}", '{"data": 5}', '{"data": {"data": [[1]], "index": [0]}}',
                                  '{"data": {"data": [["x"]], "index": [0], "columns": [0]}}', "[" * 100_000,
                                  '{"data": {"data": [[1, 2], [3]], "index": [0, 1], "columns": [0, 1]}}',
                                  '{"data": {"data": 1, "index": [0, 1], "columns": [0, 1]}, "settings": 5}'])
def test_other_json_is_refused(tmp_path, text):
    (tmp_path / "psf.json").write_text(text)
    with pytest.raises(LensError, match="psf.json"):
        psf_grid_of_file(tmp_path / "psf.json")


@pytest.mark.parametrize("values, index, columns", [
    (MARKED, np.arange(7), np.arange(8)), (MARKED[0], np.arange(8), np.arange(8)), (MARKED, ["a"] * 8, np.arange(8)),
    (MARKED, np.arange(8) ** 2, np.arange(8)), (MARKED, np.arange(8), 2 * np.arange(8)),
    (MARKED, np.full(8, np.nan), np.arange(8)), (MARKED, np.zeros(8), np.zeros(8)),
    (np.full((8, 8), "x"), range(8), range(8)),
    (np.full((8, 8), np.nan), np.arange(8), np.arange(8))],
    ids=["count", "flat", "words", "uneven", "oblong", "nan", "zero", "texts", "nan samples"])
def test_frames_that_are_no_psf_are_refused(values, index, columns):
    with pytest.raises(LensError, match="DataFrame"):
        psf_grid_of_frame(frame(values, index, columns))


def test_damage_is_harmless_or_a_lens_error(tmp_path):
    path = written(tmp_path / "psf.json")
    check_that_damage_is_harmless(path, lambda: psf_grid_of_file(path))
