"""ZOSPy's PSFs, as its JSON: the position of the chief ray, whatever the labels say."""

import json

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.lens_files.psf_grid import psf_table
from lensfield.engine.lens_files.zospy import psf_grid
from lensfield.engine.runtime.text import decoded
from refusals import refused
from vendor_files import damages, vendor_export, zospy_json, zospy_labels

MARKED = np.full((8, 8), 0.01)
MARKED[4, 4], MARKED[6, 5] = 0.5, 1.0  # the chief ray; two up and one to the right of it


def mark(grid):
    row, column = np.unravel_index(grid.values.argmax(), grid.values.shape)
    return row - grid.centre[0], column - grid.centre[1]


def read(values=MARKED, **changes):
    return psf_grid(zospy_json(values, 0.5, **changes), "psf.json")


def test_labels_are_offset_by_half_a_sample():
    grid = read()
    assert grid.centre == (4, 4) and mark(grid) == (2, 1) and grid.pitch_um == pytest.approx(0.5)


def test_a_result_with_a_strehl_ratio_is_read():
    """HuygensPSFAndStrehlRatio, whose frame is a part of its data."""
    result = json.loads(zospy_json(MARKED, 0.5))
    grid = psf_grid(json.dumps(result | {"data": {"psf": result["data"], "strehl_ratio": 0.998}}), "psf.json")
    assert grid.centre == (4, 4) and mark(grid) == (2, 1) and grid.pitch_um == pytest.approx(0.5)


@pytest.mark.parametrize("side, v, u", [("+y", 2, 1), ("-y", -2, -1)])
def test_rows_ascend_with_y(side, v, u):
    psf, _ = psf_table([[read()]], side)
    centre = psf.shape[-1] // 2
    assert np.unravel_index(psf[0, 0].argmax(), psf.shape[2:]) == (centre + v, centre + u)


def test_the_header_states_the_fft_centre_and_the_image_point():
    header = ["Polychromatic FFT PSF", "0,5430 to 0,5430 µm at 10,00, 20,00 (deg).", "Data spacing is 0,500 µm.",
              "Reference Coordinates: 0,00000E+00, 7,28631E+00", "Image grid size: 256 by 256",
              "Center point is: row 129, column 128"]
    grid = read(header=header)
    assert grid.centre == (3, 3) and grid.image_mm == (0.0, pytest.approx(7.28631))


def test_labels_that_contain_0_are_used_unchanged():
    labels = np.arange(-4, 4) * 0.5
    assert read(index=labels, columns=labels).centre == (4, 4)


@pytest.mark.parametrize("flipped", [(False, False), (True, False), (False, True), (True, True)])
def test_descending_labels_are_supported(flipped):
    labels = zospy_labels(8, 0.5, 4)
    rows, columns = (slice(None, None, -1 if flip else 1) for flip in flipped)
    grid = read(MARKED[rows][:, columns], index=labels[rows], columns=labels[columns])
    assert mark(grid) == (2, 1) and grid.centre == (4, 4)


def test_the_real_huygens_psf_is_symmetric_about_its_chief_ray():
    """For a point on the axis of a rotationally symmetric lens, which shows the chief ray's sample."""
    path = vendor_export("zospy") / "huygens_psf_24.2.2.json"
    grid = psf_grid(path.read_text(encoding="utf-8"), path)
    assert grid.values.shape == (64, 64) and grid.centre == (32, 32)
    assert grid.pitch_um == pytest.approx(0.6827814)
    psf, _ = psf_table([[grid]], "+y")
    for mirrored in (psf[0, 0, ::-1], psf[0, 0, :, ::-1], psf[0, 0].T):
        np.testing.assert_allclose(psf[0, 0], mirrored, rtol=1e-5)


def test_the_real_fft_psf_is_centred_by_its_header_and_labels():
    """Off the axis in x as well: row 129 from the top and column 128 of 256, where the file has the middle 32."""
    path = vendor_export("zospy") / "fft_psf_asymmetric_25.1.1.json"
    text = path.read_text(encoding="utf-8")
    grid = psf_grid(text, path)
    assert grid.centre == (15, 15) and grid.pitch_um == pytest.approx(1.2134111)
    assert grid.image_mm == (pytest.approx(3.52988), pytest.approx(7.28631))
    assert psf_grid(json.dumps(json.loads(text) | {"header": []}), path).centre == (15, 15)
    with pytest.raises(LensError, match="image point.*along y"):
        psf_table([[grid]], "+y")


@pytest.mark.parametrize("settings", [{"psf_type": "Log"}, {"rotation": 90}, {"use_centroid": True}], ids=str)
def test_logarithmic_rotated_or_centroid_psfs_are_refused(settings):
    with refused(LensError, field=next(iter(settings))):
        read(**settings)


@pytest.mark.parametrize("text", ["", "[1, 2]", "null", "{}", '{"data": 5}', '{"data": {"data": [[1]], "index": [0]}}',
                                  '{"data": {"data": [["x"]], "index": [0], "columns": [0]}}', "[" * 100_000,
                                  '{"data": {"data": [[1, 2], [3]], "index": [0, 1], "columns": [0, 1]}}',
                                  '{"data": {"data": 1, "index": [0, 1], "columns": [0, 1]}, "settings": 5}'])
def test_other_json_is_refused(text):
    field = "settings" if '"settings"' in text else "ZOSPy result"
    with refused(LensError, field=field, where="psf.json"):
        psf_grid(text, "psf.json")


@pytest.mark.parametrize("values, index, columns, field", [
    (MARKED, np.arange(7), np.arange(8), "PSF"), (MARKED[0], np.arange(8), np.arange(8), "PSF"),
    (MARKED, ["a"] * 8, np.arange(8), "ZOSPy result"), (MARKED, np.arange(8) ** 2, np.arange(8), "labels"),
    (MARKED, np.arange(8), 2 * np.arange(8), "labels"), (MARKED, np.full(8, np.nan), np.arange(8), "labels"),
    (MARKED, np.full(8, np.inf), np.arange(8), "labels"), (MARKED, np.zeros(8), np.zeros(8), "PSF spacing"),
    (np.full((8, 8), "x"), range(8), range(8), "ZOSPy result"),
    (np.full((8, 8), np.nan), np.arange(8), np.arange(8), "PSF")],
    ids=["count", "flat", "words", "uneven", "oblong", "nan", "infinite", "zero", "texts", "nan samples"])
def test_invalid_tables_are_refused(values, index, columns, field, recwarn):
    with refused(LensError, field=field, where="psf.json"):
        read(values, index=index, columns=columns)
    assert not recwarn.list


def test_damage_is_harmless_or_a_lens_error():
    for damaged in damages(zospy_json(MARKED, 0.5).encode(), 200):
        try:
            psf_grid(decoded(damaged), "psf.json")
        except LensError as error:
            assert "\n" not in str(error)
