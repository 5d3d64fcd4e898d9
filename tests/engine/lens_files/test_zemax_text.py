"""Zemax's text listings: in every encoding and locale, with the chief ray at OpticStudio's position."""

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.lens_files.psf_grid import psf_table
from lensfield.engine.lens_files.zemax_text import distortion, psf_grid, relative_illumination
from lensfield.engine.runtime.text import decoded, number_table, numbers, read_text
from refusals import refused
from vendor_files import ENCODINGS, damages, fft_listing, huygens_listing, vendor_export

MARKED = np.full((8, 8), 0.01)
MARKED[4, 4], MARKED[6, 5] = 0.5, 1.0  # the chief ray; two up and one to the right of it


def mark(grid):
    """(y, x) of the brightest sample, relative to the chief ray."""
    row, column = np.unravel_index(grid.values.argmax(), grid.values.shape)
    return row - grid.centre[0], column - grid.centre[1]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_listings_are_read_in_any_encoding(tmp_path, encoding):
    path = tmp_path / "Größe_PSF_1_1.dat"
    path.write_bytes(huygens_listing(MARKED, 0.25, 550, -0.959).encode(encoding))
    grid = psf_grid(read_text(path), path)
    assert mark(grid) == (2, 1) and grid.centre == (4, 4)
    assert (grid.pitch_um, grid.wavelength_nm, grid.image_mm) == (0.25, pytest.approx(550), (0.0, -0.959))


@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize("listing", [huygens_listing, fft_listing])
def test_decimal_commas_are_read(listing, comma):
    values = np.roll(MARKED, -1 if listing is fft_listing else 0, axis=(0, 1))
    grid = psf_grid(listing(values, 0.288, 500, 1.25, comma=comma), "a.txt")
    assert mark(grid) == (2, 1)
    assert grid.pitch_um == pytest.approx(0.288) and grid.image_mm == (0.0, 1.25)
    np.testing.assert_allclose(grid.values, values, rtol=1e-6)


def test_an_fft_listing_of_the_middle_of_a_larger_grid_keeps_its_centre():
    grid = psf_grid(fft_listing(np.roll(MARKED, -1, axis=(0, 1)), 1.213, 543, 7.28631, full=256), "a.txt")
    assert mark(grid) == (2, 1) and grid.centre == (3, 3)


@pytest.mark.parametrize("start", ["Center coordinates", "Center point", "Image grid", "Data area", "Strehl", "File",
                                   "HUYGENS PSF", "0.5500", "Values are"])
def test_optional_lines_may_be_missing(start):
    grid = psf_grid(huygens_listing(MARKED, 0.25, 550, -0.959, leave_out=[start]), "a.txt")
    assert mark(grid) == (2, 1) and grid.pitch_um == 0.25


def test_the_area_width_gives_a_more_precise_pitch():
    text = fft_listing(MARKED, 0.288359, 500, 1.25).replace("area is 2.307", "area is 2.30687")
    assert "spacing is 0.288 " in text
    assert psf_grid(text, "a.txt").pitch_um == pytest.approx(0.288359, abs=1e-6)


def test_units_after_the_centre_coordinates_are_applied():
    grid = psf_grid(huygens_listing(MARKED, 0.25, 550, 0.1, units=" Inches"), "a.txt")
    assert grid.image_mm == (0, pytest.approx(2.54))
    with refused(LensError, field="Center coordinates", where="a.txt"):
        psf_grid(huygens_listing(MARKED, 0.25, 550, 0.1, units=" Cubits"), "a.txt")


@pytest.mark.parametrize("change, field", [
    (("Data spacing is", "Spacing"), "Data spacing"), (("0.250 µm.", "0.250 mr."), "Data spacing"),
    (("0.5500 µm", "0.4861 to 0.6563 µm"), "wavelengths"), (("is: 5, 5", "is: 50, 5"), "PSF centre"),
    (("5.000000E-001", ""), "PSF samples"), (("5.000000E-001", "nan"), "PSF samples"),
    (("1.000000E+000", "-1.000000E+000"), "PSF")], ids=str)
def test_an_invalid_listing_is_refused(change, field):
    text = huygens_listing(MARKED, 0.25, 550, -0.959)
    assert change[0] in text
    with refused(LensError, field=field, where="a.txt"):
        psf_grid(text.replace(*change), "a.txt")


def test_the_real_listing_agrees_with_its_bundle():
    """The real listing: of field 21 at 550 nm, 27.38 degrees below the axis, 128 x 128 samples.

    It is mirror-symmetric about its column 65, which is the meridional plane's. Its largest y comes first, as in all
    listings with a centroid from OpticStudio; the image point is at -y, so outwards is the last row. In this
    orientation its tail (some 11 um long, in the rows before the chief ray's) leans towards the axis. It also follows
    that its chief ray is in row 65 from the bottom.
    """
    path = vendor_export("iset_bundle_asphere") / "AsphereF=2mm_PSF_21_3.dat"
    grid = psf_grid(read_text(path), path)
    assert grid.values.shape == (128, 128) and grid.centre == (64, 64)
    assert (grid.pitch_um, grid.wavelength_nm) == (0.25, pytest.approx(550))
    table = path.with_name("AsphereF=2mm_DI_.dat")
    real = number_table(read_text(table), table, "table", (5, 21))
    assert abs(grid.image_mm[1]) == pytest.approx(real[2, 20], abs=1e-6) and grid.image_mm[1] < 0
    psf, _ = psf_table([[grid]], "-y")
    np.testing.assert_array_equal(psf[0, 0], psf[0, 0, :, ::-1])
    v = np.arange(-63, 64)
    assert psf.shape == (1, 1, 127, 127) and psf[0, 0].sum(axis=1) @ v * 0.25 == pytest.approx(-2.1, abs=0.2)


RELATIVE_ILLUMINATION = """Listing of Relative Illumination Data

File : C:\\LENSES\\TRIPLET.ZMX
Title: a triplet

Wavelength: 0.550000 µm
Field values are in {unit}.

     {title}      Rel. Ill.   Eff. F/#
    0.000000       1.000000     5.0000
    1.500000       0.950000     5.1000
    3.000000       0.812345     5.3000
"""
DISTORTION = """Listing of Field Curvature/Distortion Data

File : C:\\LENSES\\TRIPLET.ZMX

Distortion Type: F-Tan(Theta).
Shift units are Millimeters.
Height units are Millimeters.
Maximum Field is 20.000 Degrees.
Maximum distortion = 1.8000%

Data for wavelength : 0.486100 µm.

Distortion focal length = 50.0000

 Y Angle (deg)      Tan Shift      Sag Shift    Real Height    Ref. Height  Distortion (%)
    0.00000000     0.00000000     0.00000000     0.00000000     0.00000000      0.00000000 %
   10.00000000    -0.10000000    -0.12000000     8.78000000     8.81634900     -0.41200000 %
   20.00000000    -0.40000000    -0.50000000    17.87000000    18.19851200     -1.80500000 %

Data for wavelength : 0.587600 µm.

Distortion focal length = 50.0100

 Y Angle (deg)      Tan Shift      Sag Shift    Real Height    Ref. Height  Distortion (%)
    0.00000000     0.00000000     0.00000000     0.00000000     0.00000000      0.00000000 %
   10.00000000    -0.10000000    -0.12000000    -8.79000000    -8.81811200     -0.31900000 %
   20.00000000    -0.40000000    -0.50000000   -17.90000000   -18.20215200     -1.66000000 %
"""


@pytest.mark.parametrize("comma", [False, True])
def test_relative_illumination_is_read(comma):
    text = RELATIVE_ILLUMINATION.format(unit="Degrees", title="Y Field")
    listing = relative_illumination(text.replace(".", ",") if comma else text, "ri.txt")
    assert listing.field.tolist() == [0, 1.5, 3] and listing.values.tolist() == [1, 0.95, 0.812345]
    assert listing.unit == "degrees" and listing.wavelength_nm == pytest.approx(550)


def test_distortion_is_read_for_every_wavelength_and_with_positive_heights():
    blue, yellow = distortion(DISTORTION, "fcd.txt")
    assert (blue.wavelength_nm, yellow.wavelength_nm) == (pytest.approx(486.1), pytest.approx(587.6))
    assert blue.field.tolist() == [0, 8.816349, 18.198512] and blue.values.tolist() == [0, 8.78, 17.87]
    assert yellow.values.tolist() == [0, 8.79, 17.9]


@pytest.mark.parametrize("change, field", [(("F-Tan(Theta)", "F-Theta"), "Distortion Type"),
                                           (("Ref. Height", "Height"), "columns"), (("0000", "x"), "distortion")])
def test_distortion_of_another_kind_is_refused(change, field):
    with refused(LensError, field=field):
        distortion(DISTORTION.replace(*change), "fcd.txt")


def test_another_listing_is_not_read_as_relative_illumination():
    with refused(LensError, field="relative illumination", value="missing", where="fcd.txt"):
        relative_illumination(DISTORTION, "fcd.txt")


@pytest.mark.parametrize("text, expected", [("1.5 2,5", [1.5, 2, 5]), ("1,5\t2,5E-003", [1.5, 0.0025]),
                                            ("1.0, 2.0,\n3.0", [1, 2, 3])])
def test_commas_are_decimal_in_text_without_points(text, expected):
    assert numbers(text, "a", "b").tolist() == expected


@pytest.mark.parametrize("read, text", [
    (psf_grid, huygens_listing(MARKED, 0.25, 550, -0.959)),
    (psf_grid, fft_listing(MARKED, 0.25, 550, 0.959, comma=True)),
    (relative_illumination, RELATIVE_ILLUMINATION), (distortion, DISTORTION)],
    ids=["huygens", "fft", "relative illumination", "distortion"])
@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_damage_is_harmless_or_a_lens_error(read, text, encoding):
    for damaged in damages(text.encode(encoding), 200):
        try:
            read(decoded(damaged), "a.txt")
        except LensError as error:
            assert "\n" not in str(error)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"\xff\xfe\x00", bytes(range(256)) * 40, b"\0" * 999,
                                     b"1 " * 9999, b"\n" * 300_000, b"Data for wavelength " * 20_000])
@pytest.mark.parametrize("read", [psf_grid, relative_illumination, distortion])
def test_anything_but_a_listing_is_a_lens_error(content, read):
    with pytest.raises(LensError):
        read(decoded(content), "a.txt")


def test_missing_files_folders_and_large_files_are_named(tmp_path, monkeypatch):
    for path in (tmp_path, tmp_path / "absent"):
        with refused(LensError, field="file", where=path.name):
            read_text(path)
    monkeypatch.setattr("lensfield.engine.runtime.text.MOST_TEXT_BYTES", 10)
    (tmp_path / "large").write_text("x" * 11)
    with refused(LensError, field="file", value="0 MB", where="large"):
        read_text(tmp_path / "large")
