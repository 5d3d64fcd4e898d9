"""Export folders: the output of the project's own macros, for each program, and every kind of error in it."""

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.lens_files.export import read_export
from lensfield.engine.runtime.unread import unread_note
from notes import unread
from vendor_files import (
    check_same_lens,
    check_that_damage_is_harmless,
    export_folder,
    exported_lens,
    write_description,
)


@pytest.fixture
def lens():
    return exported_lens()


def error_of(path):
    with pytest.raises(LensError) as error:
        read_export(path)
    assert "\n" not in str(error.value)
    return error.value


@pytest.mark.parametrize("side", ["+y", "-y"])
@pytest.mark.parametrize("program", ["zemax", "codev", "zospy"])
def test_every_program_and_side_is_read(tmp_path, lens, program, side):
    """PSFs differ up from down and left from right: they agree only if all are turned outwards."""
    read = read_export(export_folder(tmp_path, lens, program, side))
    check_same_lens(read, lens)
    for field in ("efl_mm", "magnification", "f_number_effective", "entrance_pupil_mm", "object_distance_mm",
                  "reference_wavelength_nm", "sensor_mm"):
        assert getattr(read, field) == pytest.approx(getattr(lens, field)), field
    assert (read.name, read.source, read.maker) == ("Tessar ½", "a patent", "")
    assert np.isnan(read.enclosed_energy).all() and (read.transmittance == 1).all()


def test_optional_fields_are_read(tmp_path, lens):
    read = read_export(export_folder(
        tmp_path, lens, maker="Zeiss", story="The eagle eye.", notes="stopped down", sensor_mm=[2.0, 1.0],
        transmittance=[0.5, 0.75]))
    assert (read.maker, read.story, read.notes) == ("Zeiss", "The eagle eye.", "stopped down")
    assert read.sensor_mm == (2.0, 1.0) and read.transmittance.tolist() == [0.5, 0.75]


def test_unused_fields_are_reported(tmp_path, lens):
    path = export_folder(tmp_path, lens)
    assert not unread(read_export(path).notes)
    path.write_text(f"warp = 3\n{path.read_text()}")
    assert read_export(path).notes.endswith(unread_note(["warp"]))


def test_an_infinite_distance_is_read_from_toml(tmp_path, lens):
    path = export_folder(tmp_path, lens)
    path.write_text(path.read_text(encoding="utf-8").replace("object_distance_mm = 100.0", "object_distance_mm = inf"),
                    encoding="utf-16")
    assert np.isinf(read_export(path).object_distance_mm)


def relative_illumination_listing(nm, field, values, unit):
    rows = "\n".join(f"{f:12.6f} {v:14.9f} {5:10.4f}" for f, v in zip(field, values, strict=True))
    return (f"Listing of Relative Illumination Data\n\nWavelength: {nm / 1e3:.6f} µm\nField values are in {unit}.\n\n"
            f"     Y Field      Rel. Ill.   Eff. F/#\n{rows}\n")


def distortion_listing(blocks):
    text = "Listing of Field Curvature/Distortion Data\n\nDistortion Type: F-Tan(Theta).\n"
    for nm, reference, real in blocks:
        rows = "\n".join(f"{0:12.6f} {0:12.6f} {0:12.6f} {y:14.9f} {r:14.9f} {0:12.6f} %"
                         for r, y in zip(reference, real, strict=True))
        text += (f"\nData for wavelength : {nm / 1e3:.6f} µm.\n\n Y Angle (deg)  Tan Shift  Sag Shift  Real Height  "
                 f"Ref. Height  Distortion (%)\n{rows}\n")
    return text


@pytest.mark.parametrize("one_file", [True, False], ids=["all in one", "one each"])
def test_zemax_listings_can_replace_tables(tmp_path, lens, one_file):
    """Sampled finer than the lens, with interpolation between heights; light is relative to the axis, not the maximum.
    """
    fine = np.linspace(0, 3, 31)
    blocks = [(nm, fine, -fine * (1 - 0.01 * fine - nm / 1e5)) for nm in lens.wavelengths_nm]
    if one_file:
        (tmp_path / "fcd.txt").write_text(distortion_listing(blocks), encoding="utf-16")
    for w, nm in enumerate(lens.wavelengths_nm):
        (tmp_path / f"fcd{w + 1}.txt").write_text(distortion_listing(blocks[w:w + 1]), encoding="latin-1")
        light = 0.9 * (1 - 0.02 * fine**2 - nm * fine / 1e5)
        (tmp_path / f"ri{w + 1}.txt").write_text(relative_illumination_listing(nm, fine, light, "Millimeters"),
                                                 encoding="latin-1")
    read = read_export(export_folder(tmp_path, lens, real_height="fcd.txt" if one_file else "fcd{wavelength}.txt",
                                     relative_illumination="ri{wavelength}.txt"))
    check_same_lens(read, lens)


@pytest.mark.parametrize("unit, of_height", [
    ("Degrees", lambda lens, h: np.degrees(np.arctan(h / lens.capture_focal_length_mm))),
    ("Millimeters", lambda lens, h: h / abs(lens.magnification)), ("Millimeters", lambda lens, h: h)],
    ids=["angles", "object heights", "image heights"])
def test_fields_of_any_kind_are_converted_to_paraxial_heights(tmp_path, lens, unit, of_height):
    fine = np.linspace(0, 3, 31)
    for w, nm in enumerate(lens.wavelengths_nm):
        text = relative_illumination_listing(nm, of_height(lens, fine), 1 - 0.02 * fine**2 - nm * fine / 1e5, unit)
        (tmp_path / f"ri{w + 1}.txt").write_text(text, encoding="utf-8")
    read = read_export(export_folder(tmp_path, lens, relative_illumination="ri{wavelength}.txt"))
    np.testing.assert_allclose(read.relative_illumination, lens.relative_illumination, atol=2e-6)


@pytest.mark.parametrize("reach, unit", [(2.5, "Millimeters"), (8.0, "Degrees"), (95.0, "Degrees")])
def test_a_listing_with_another_last_field_is_refused(tmp_path, lens, reach, unit):
    field = np.linspace(0, reach, 11)
    (tmp_path / "light.txt").write_text(relative_illumination_listing(450, field, np.ones(11), unit), encoding="utf-8")
    assert error_of(export_folder(tmp_path, lens, relative_illumination="light.txt")).field == "field"


def test_a_listing_of_another_wavelength_is_refused(tmp_path, lens):
    (tmp_path / "fcd.txt").write_text(distortion_listing([(450, lens.heights_mm, lens.heights_mm)]), encoding="utf-8")
    error = error_of(export_folder(tmp_path, lens, real_height="fcd.txt"))
    assert error.field == "wavelength" and "650 nm" in str(error)


REQUIRED = ("format", "version", "program", "name", "efl_mm", "magnification", "f_number_effective",
            "entrance_pupil_mm", "reference_wavelength_nm", "object_distance_mm", "wavelengths_nm", "heights_mm",
            "image_side", "real_height", "relative_illumination", "psf")


@pytest.mark.parametrize("field", REQUIRED)
def test_a_missing_field_is_named(tmp_path, lens, field):
    error = error_of(export_folder(tmp_path, lens, overrides={field: None}))
    assert error.field == field and "missing" in str(error) and "lens.toml" in str(error)


def test_the_pitch_is_required_only_where_files_lack_it(tmp_path, lens):
    check_same_lens(read_export(export_folder(tmp_path, lens, "zemax", psf_pitch_um=None)), lens)
    assert error_of(export_folder(tmp_path, lens, "codev", psf_pitch_um=None)).field == "psf_pitch_um"


@pytest.mark.parametrize("changes", [
    {"format": "something"}, {"version": 2}, {"version": "one"}, {"program": "oslo"}, {"image_side": "up"},
    {"name": 5}, {"name": " "}, {"maker": 5}, {"efl_mm": "six"}, {"efl_mm": True}, {"efl_mm": "[6]"},
    {"efl_mm": 10**400}, {"efl_mm": -6.0}, {"efl_mm": float("nan")},
    {"f_number_effective": 0}, {"heights_mm": [0, 1, 1]}, {"heights_mm": [1, 2]}, {"heights_mm": []},
    {"heights_mm": [0, "a"]}, {"heights_mm": 3}, {"wavelengths_nm": []}, {"wavelengths_nm": [650, 450]},
    {"sensor_mm": [1]}, {"sensor_mm": [1, -1]}, {"transmittance": [1]}, {"transmittance": [1, 2]},
    {"psf": "psf_{height}.txt"}, {"psf": 5}, {"magnification": 0}], ids=str)
def test_an_invalid_field_is_named(tmp_path, lens, changes):
    assert error_of(export_folder(tmp_path, lens, overrides=changes)).field in changes


@pytest.mark.parametrize("field", ["real_height", "relative_illumination", "psf"])
@pytest.mark.parametrize("name", ["../ri.txt", "/etc/passwd", "a/../../ri.txt", "C:\\ri.txt", "\\ri.txt", "..\\ri.txt",
                                  "a\0b", "a\nb", "x" * 300])
def test_files_outside_the_folder_are_refused(tmp_path, lens, field, name):
    (tmp_path / "ri.txt").write_text("1 1 1 1 1 1")
    path = export_folder(tmp_path / "folder", lens)
    text = path.read_text(encoding="utf-8").splitlines()
    name += "{height}{wavelength}" if field == "psf" else ""
    rest = [line for line in text if not line.startswith(f"{field} =")]
    escaped = name.replace("\\", "\\\\").replace("\0", "\\u0000").replace("\n", "\\n")
    path.write_text("\n".join([*rest, f'{field} = "{escaped}"']), encoding="utf-8")
    error = error_of(path)
    assert error.field == field and "inside the folder" in str(error)


def test_a_link_out_of_the_folder_is_refused(tmp_path, lens):
    path = export_folder(tmp_path / "folder", lens)
    (tmp_path / "ri.txt").write_text((tmp_path / "folder" / "ri.txt").read_text())
    (tmp_path / "folder" / "ri.txt").unlink()
    (tmp_path / "folder" / "ri.txt").symlink_to(tmp_path / "ri.txt")
    assert "link" in str(error_of(path))


def test_a_subfolder_is_allowed(tmp_path, lens):
    path = export_folder(tmp_path, lens, real_height="tables/real.txt")
    (tmp_path / "tables").mkdir()
    (tmp_path / "real_height.txt").rename(tmp_path / "tables" / "real.txt")
    check_same_lens(read_export(path), lens)


def test_missing_psfs_are_counted_and_the_first_named(tmp_path, lens):
    path = export_folder(tmp_path, lens)
    (tmp_path / "psf_2_1.txt").unlink()
    (tmp_path / "psf_3_2.txt").unlink()
    assert "PSF files is 2 of 6 missing: expected psf_2_1.txt" in str(error_of(path))


@pytest.mark.parametrize("field", ["real_height", "relative_illumination"])
def test_a_missing_table_or_one_of_the_wrong_size_is_named(tmp_path, lens, field):
    path = export_folder(tmp_path, lens)
    table = tmp_path / {"real_height": "real_height.txt", "relative_illumination": "ri.txt"}[field]
    table.write_text("0 0 1 1")
    error = error_of(path)
    assert error.field == field and error.value == "4 numbers" and "3 heights x 2 wavelengths" in str(error)
    table.unlink()
    assert table.name in str(error_of(path))


def test_listings_of_the_wrong_image_side_are_refused(tmp_path, lens):
    error = error_of(export_folder(tmp_path, lens, image_side="-y", overrides={"image_side": "+y"}))
    assert error.field == "image_side" and "psf_2_1.txt" in str(error)


def test_an_excessive_number_of_psfs_is_refused_at_once(tmp_path, lens):
    many = list(range(1000))
    error = error_of(export_folder(tmp_path, lens, overrides={"heights_mm": many, "wavelengths_nm": many}))
    assert error.field == "PSFs" and error.value == "1000 x 1000"
    (tmp_path / "lens.toml").write_text("# long\n" * 200_000)
    assert error_of(tmp_path / "lens.toml").field == "TOML"


@pytest.mark.parametrize("text", ["", "unfinished = true", "format = ", "= 5", "[" * 5000, "a = " + "[" * 5000, "\0",
                                  "format = 'lensfield-export'\nversion = " + "9" * 5000, "a = 1\na = 2"])
def test_an_invalid_description_is_refused(tmp_path, text):
    (tmp_path / "lens.toml").write_text(text)
    error_of(tmp_path / "lens.toml")


@pytest.mark.parametrize("file", ["lens.toml", "real_height.txt", "psf_2_2.txt"])
def test_damage_is_harmless_or_a_lens_error(tmp_path, lens, file):
    path = export_folder(tmp_path, lens)
    check_that_damage_is_harmless(tmp_path / file, lambda: read_export(path), count=70)


def test_the_documented_description_is_complete(tmp_path, lens):
    """Every field in the module's docstring is read, and no other is required."""
    from lensfield.engine.lens_files import export

    for field in (*REQUIRED, "sensor_mm", "psf_pitch_um", "transmittance", "maker", "story", "source", "notes"):
        assert field in export.__doc__, field
    write_description(tmp_path / "x.toml", {"format": "lensfield-export"})
    assert error_of(tmp_path / "x.toml").field == "version"
