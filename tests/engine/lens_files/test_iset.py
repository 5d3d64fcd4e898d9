"""ISET bundles: every dialect of the macros, and missing or damaged parts."""

import shutil

import numpy as np
import pytest

from lensfield.engine import LensError, load_lens
from lensfield.engine.lens_files.assembly import PUPIL_UNKNOWN, entrance_pupil
from lensfield.engine.lens_files.iset import find_parameter_file, read_iset
from lensfield.engine.runtime.text import number_table, read_text
from lensfield.engine.runtime.unread import unread_note
from notes import unread
from refusals import refused
from vendor_files import (
    ENCODINGS,
    check_same_lens,
    check_that_damage_is_harmless,
    code_v_bundle,
    exported_lens,
    huygens_listing,
    iset_bundle,
    upright,
    vendor_export,
)


@pytest.fixture
def lens():
    return exported_lens()


def parameters(path, *changes):
    """The parameter file with some texts replaced."""
    text = path.read_text(encoding="latin-1")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="latin-1")
    return path


def error_of(path):
    with pytest.raises(LensError) as error:
        read_iset(path)
    assert "\n" not in str(error.value)
    return error.value


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("columns", [True, False], ids=["rows x columns", "one value a line"])
@pytest.mark.parametrize("two_d", [False, True], ids=["PSF_h_w", "2D_PSF_Fldh_Wavew"])
def test_every_dialect_is_read(tmp_path, lens, encoding, columns, two_d):
    read = read_iset(iset_bundle(tmp_path, lens, encoding=encoding, columns=columns, two_d=two_d))
    check_same_lens(read, lens)


# The macros for Zemax trace PSFs at -y, where outwards is down: towards the listing's last row, because its largest y
# comes first. A bundle with fields at +y is recognised by the image points in its listings.
@pytest.mark.parametrize("side", ["-y", "+y"])
def test_psfs_are_turned_outwards(tmp_path, lens, side):
    read = read_iset(iset_bundle(tmp_path, lens, image_side=side))
    brightest = np.unravel_index(read.psf[0, 2].argmax(), read.psf.shape[2:])
    assert np.subtract(brightest, read.psf.shape[-1] // 2).tolist() == [3, 2]  # 3 outwards, 2 to the right of that


def test_psfs_without_image_points_are_assumed_below_the_axis(tmp_path, lens):
    path = iset_bundle(tmp_path, lens)
    for file in tmp_path.glob("*_PSF_*"):
        rest = [line for line in file.read_text(encoding="latin-1").splitlines() if not line.startswith("Center coord")]
        file.write_text("\n".join(rest), encoding="latin-1")
    check_same_lens(read_iset(path), lens)


def test_first_order_data_are_read(tmp_path, lens):
    read = read_iset(iset_bundle(tmp_path, lens, base="EO54852"))
    assert read.name == "EO54852" and read.sensor_mm == pytest.approx((4.8, 3.6))
    for field in ("efl_mm", "magnification", "f_number_effective", "object_distance_mm", "reference_wavelength_nm"):
        assert getattr(read, field) == pytest.approx(getattr(lens, field)), field
    assert read.entrance_pupil_mm == pytest.approx(4.0, abs=1e-3) and "field angle" in read.notes
    assert "ISET's is the paraxial working f-number" in read.notes
    assert np.isnan(read.enclosed_energy).all() and (read.transmittance == 1).all()


@pytest.mark.parametrize("distance", ["10000000000.000", "1.0E+010", "Inf", "-1e10"])
def test_distant_objects_are_at_infinity(tmp_path, lens, distance):
    read = read_iset(parameters(iset_bundle(tmp_path, lens), ("objDist=100.000", f"objDist={distance}")))
    assert np.isinf(read.object_distance_mm) and read.entrance_pupil_mm == 0 and "not stated" in read.notes
    assert read.capture_focal_length_mm == lens.efl_mm


def test_a_height_derived_from_the_focal_length_gives_no_pupil(tmp_path, lens):
    fov = np.degrees(np.arctan(lens.heights_mm[-1] / lens.efl_mm))
    path = iset_bundle(tmp_path, lens)
    fov_line = next(line for line in path.read_text(encoding="latin-1").splitlines() if line.startswith("fov"))
    assert read_iset(parameters(path, (fov_line, f"fov={fov:.7f};"))).entrance_pupil_mm == 0


def test_the_real_parameters_put_the_entrance_pupil_near_the_traced_one(tmp_path, lens):
    """0.46 mm from the paraxial pupil at 250 mm: the chief ray from the edge of the field crosses the axis elsewhere.
    """
    source = vendor_export("iset_bundle_eo54852") / "ISETPARMS.TXT"
    wide = exported_lens(waves=7, heights=13)
    iset_bundle(tmp_path, wide, base="EO54852")
    for file in tmp_path.glob("*_PSF_*"):  # 400, 450 ... 700 nm in this bundle
        w = int(file.stem.split("_")[-1])
        file.write_text(huygens_listing(upright(wide.psf[w - 1, 0], "-y"), 0.25, 350 + 50 * w, 0,
                                        leave_out=["Center coord"]), encoding="latin-1")
    shutil.copyfile(source, tmp_path / "ISETPARMS.TXT")
    read, traced = read_iset(tmp_path / "ISETPARMS.TXT"), load_lens("edmund-54852")
    assert read.name == "EO54852" and read.object_distance_mm == 250
    assert read.wavelengths_nm.tolist() == [400, 450, 500, 550, 600, 650, 700]
    np.testing.assert_allclose(read.heights_mm, np.linspace(0, 3, 13))
    assert read.entrance_pupil_mm == pytest.approx(traced.entrance_pupil_mm, abs=0.5)
    assert read.capture_focal_length_mm == pytest.approx(traced.capture_focal_length_mm, rel=2e-3)
    assert read.efl_mm == pytest.approx(traced.efl_mm, rel=2e-5)


def test_the_real_tables_are_height_major():
    folder = vendor_export("iset_bundle_asphere")
    real, light = (number_table(read_text(folder / f"AsphereF=2mm_{kind}_.dat"), kind, "table", (5, 21))
                   for kind in ("DI", "RI"))
    assert np.all(real[:, 0] == 0) and np.all(np.diff(real, axis=1) > 0)
    assert np.all(light[:, 0] == 1) and np.all(np.diff(light, axis=1) < 0)
    assert np.all(np.diff(real[:, 1:], axis=0) > 0)  # the focal length of a singlet grows with the wavelength


def test_the_real_bundle_lacks_its_parameter_file():
    assert find_parameter_file(vendor_export("iset_bundle_asphere")) is None


@pytest.mark.parametrize("old, new", [
    ("450:200:650", "450:199.6:650"), ("450:200:650", "[450, 650]"), ("450:200:650;", " 450: 200: 650 ;"),
    ("%Lens file name", "% wave=1:2"), ("lensFile='LENS.ZMX';", "lensFile='LENS.ZMX'  "), (";", ""),
    ("lensFile='LENS.ZMX';", "lensFile='LENS.ZMX")])
def test_matlab_syntax_of_the_macros_is_read(tmp_path, lens, old, new):
    check_same_lens(read_iset(parameters(iset_bundle(tmp_path, lens), (old, new))), lens)


def test_unused_parameters_are_reported(tmp_path, lens):
    path = iset_bundle(tmp_path, lens)
    assert not unread(read_iset(path).notes)
    path.write_text(path.read_text() + "\nwarp=3;\n")
    assert read_iset(path).notes.endswith(unread_note(["warp"]))


def test_parameters_are_never_evaluated(tmp_path, lens):
    path = parameters(iset_bundle(tmp_path, lens), ("efl=10.000000", "efl=__import__('os').abort()"))
    assert error_of(path).field == "efl"


@pytest.mark.parametrize("junk", ["\n" * 300_000, "a" * 300_000, "a=" * 150_000, "'" * 300_000],
                         ids=["lines", "letters", "assignments", "quotes"])
def test_long_junk_is_skipped_quickly(tmp_path, lens, junk):
    path = iset_bundle(tmp_path, lens)
    sound = path.read_text(encoding="latin-1")
    path.write_text(sound + "\n" + junk, encoding="latin-1")
    check_same_lens(read_iset(path), lens)


def test_code_v_bundles_are_read(tmp_path, lens):
    """Matrices without headers, for image points above the axis; heights are a range with a rounded step."""
    lens = exported_lens(waves=3, heights=8)
    read = read_iset(code_v_bundle(tmp_path, lens))
    check_same_lens(read, lens, digits=5)
    assert read.entrance_pupil_mm == pytest.approx(4.0, abs=1e-6)


def test_a_renamed_folder_and_base_are_read(tmp_path, lens):
    folder = tmp_path / "Objektiv für Größen"
    path = parameters(iset_bundle(folder, lens), ("ISET\\LENS\\LENS'", "ISET\\old\\name'"))
    (folder / "LENS_DI_.dat").rename(folder / "lens_di_.DAT")
    check_same_lens(read_iset(path), lens)


def test_the_stated_one_of_two_bases_is_read(tmp_path, lens):
    iset_bundle(tmp_path, exported_lens(waves=3), base="OTHER")
    path = iset_bundle(tmp_path, lens)
    check_same_lens(read_iset(path), lens)
    assert error_of(parameters(path, ("\\LENS'", "\\THIRD'"))).field == "baseLensFileName"


@pytest.mark.parametrize("name", ["LENS_PSF_2_1.dat", "LENS_PSF_3_2.dat"])
def test_missing_psfs_are_counted_and_the_first_named(tmp_path, lens, name):
    path = iset_bundle(tmp_path, lens)
    (tmp_path / name).unlink()
    error = error_of(path)
    assert error.field == "PSF files" and error.value == "1 of 6 missing" and name in str(error)
    for file in tmp_path.glob("*_PSF_*"):
        file.unlink()
    assert "6 of 6 missing: expected LENS_PSF_1_1.dat" in str(error_of(path))


@pytest.mark.parametrize("kind, field", [("DI", "real heights"), ("RI", "relative illumination")])
def test_a_missing_table_is_named(tmp_path, lens, kind, field):
    path = iset_bundle(tmp_path, lens)
    (tmp_path / f"LENS_{kind}_.dat").unlink()
    error = error_of(path)
    assert error.field == field and f"LENS_{kind}_.dat" in str(error)


@pytest.mark.parametrize("old, new, field", [
    ("efl=", "nothing=", "efl"), ("efl=10.000000", "efl=ten", "efl"), ("efl=10.000000", "efl=nan", "efl_mm"),
    ("efl=10.000000", "efl=0", "efl_mm"), ("wave=", "waves=", "wave"), ("450:200:650", "450:0:650", "wave"),
    ("450:200:650", "450:1e-9:650", "wave"), ("450:200:650", "650:200:450", "wave"), ("450:200:650", "1:2:3:4", "wave"),
    ("450:200:650", "450:nan:650", "wave"), ("450:200:650", "[]", "wave"), ("450:200:650", "450:100:650", "table"),
    ("HeightNum=3", "HeightNum=1000000000", "image heights"), ("HeightNum=3", "HeightNum=1", "image heights"),
    ("HeightNum=3", "HeightNum=2.5", "image heights"), ("HeightNum=3", "HeightNum=30", "table"),
    ("imgHeightMax=3", "imgHeightMax=-3", "image heights"), ("Max=3.0000000", "Max=1e999", "image heights"),
    ("mag=-0.100000", "mag=0", "magnification"), ("objDist=100", "objDist=-100", "object_distance_mm"),
    ("fnumber_eff=2", "fnumber_eff=-2", "f_number_effective")], ids=str)
def test_invalid_parameters_are_named(tmp_path, lens, old, new, field):
    error = error_of(parameters(iset_bundle(tmp_path, lens), (old, new)))
    assert error.field == field and str(tmp_path) in str(error)


@pytest.mark.parametrize("file, old, new, field", [
    ("LENS_DI_.dat", "E+000", "F+000", "table"), ("LENS_RI_.dat", "1.000000E+000", "nan", "table"),
    ("LENS_RI_.dat", "1.000000E+000", "-1.0", "relative_illumination"),
    ("LENS_PSF_2_1.dat", "0.4500 ", "0.6500 ", "wavelength"), ("LENS_PSF_3_1.dat", "-2.8", "-1.8", "image point"),
    ("LENS_PSF_3_1.dat", "0.00000000E+000, -", "1.0, -", "image point")], ids=str)
def test_contradictory_files_are_named(tmp_path, lens, file, old, new, field):
    path = iset_bundle(tmp_path, lens)
    text = (tmp_path / file).read_text(encoding="latin-1")
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new), encoding="latin-1")
    assert error_of(path).field == field


def test_two_parameter_files_are_an_error(tmp_path, lens):
    iset_bundle(tmp_path, lens)
    code_v_bundle(tmp_path, lens)
    with refused(LensError, field="parameter file", value="ISETPARMS.TXT or rtLENS_ISETPARMS.TXT",
                 match="give the file itself"):
        find_parameter_file(tmp_path)


@pytest.mark.parametrize("file", ["ISETPARMS.TXT", "LENS_DI_.dat", "LENS_PSF_2_2.dat"])
def test_damage_is_harmless_or_a_lens_error(tmp_path, lens, file):
    path = iset_bundle(tmp_path, lens)
    check_that_damage_is_harmless(tmp_path / file, lambda: read_iset(path), count=70)


@pytest.mark.parametrize("magnification", [-1e-308, 1e-320])
def test_an_impossible_magnification_leaves_the_pupil_unknown(magnification, recwarn):
    assert entrance_pupil(30.0, np.float64(3e9), magnification, 100.0, 6.0) == (0.0, PUPIL_UNKNOWN)
    assert not recwarn.list
