"""Lens files of physical-camera: the fields read, and refused content."""

from dataclasses import replace

import numpy as np
import pytest

from lens_texts import PHYSICAL_CAMERA, TOML, changed, reader_of
from lensfield.engine import LensError
from lensfield.engine.prescription.prescription import Surface
from lensfield.engine.prescription.readers import ReadingOptions, read_file
from lensfield.engine.runtime.unread import unread_note
from refusals import refused

FIELD = ("image_height_mm", 12.0)
SURFACES = (Surface(thickness_mm=2.0, semi_aperture_mm=2.5, stop=True), Surface(50.0, 4.0, "1.5168/64.2", 8.0),
            Surface(-50.0, 1.5, "", 8.0, -0.5, (0.0, 1e-6, -2e-9, 0.0), gaps_mm=(1.5, 3.5)),
            Surface(np.inf, 1.0, "1.6", 8.5, radius_x_mm=80.0), Surface(semi_aperture_mm=8.5))
CYLINDER = 'type = "cylindrical_x"\nradius = 80.0'


@pytest.fixture
def read(tmp_path):
    """Read the file with parts of it changed."""
    return reader_of(tmp_path / "lens.toml", PHYSICAL_CAMERA)


def test_a_lens(read):
    lens = read(field=FIELD)
    assert lens.surfaces == SURFACES
    assert (lens.name, lens.aperture, lens.field, lens.focus) == ("singlet", ("f_number", 9.8), FIELD, "best")
    assert lens.focused_at_mm == (np.inf, 500.0) and lens.focal_length_mm == 49.0 and lens.coating == "single"
    assert "US 1,234,567" in lens.source and lens.notes == ""


@pytest.mark.parametrize("kind, changes", [
    ("cylindrical_x", dict(radius_mm=np.inf, radius_x_mm=80.0)), ("cylindrical_y", dict(radius_x_mm=np.inf)),
    ("flat", dict(radius_mm=np.inf)), ("spherical", {})])
def test_kinds_of_surfaces(tmp_path, kind, changes):
    """A cylinder is named after the axis along which it is curved."""
    path = tmp_path / "lens.toml"
    path.write_text(changed(PHYSICAL_CAMERA, (CYLINDER, CYLINDER.replace("cylindrical_x", kind))))
    surfaces = read_file(path, ReadingOptions(FIELD)).prescription.surfaces
    assert surfaces == (*SURFACES[:3], replace(Surface(80.0, 1.0, "1.6", 8.5), **changes), SURFACES[4])


def test_a_lens_without_close_focus_moves_as_a_unit(read):
    lens = read((PHYSICAL_CAMERA[PHYSICAL_CAMERA.index("[focus]"):], ""), field=FIELD)
    assert lens.focused_at_mm == ()
    assert lens.surfaces == (*SURFACES[:2], replace(SURFACES[2], gaps_mm=()), *SURFACES[3:])


@pytest.mark.parametrize("old, new, message", [
    (CYLINDER, 'type = "biconic"\nradius = 80.0', "surface 4, type is biconic: expected spherical or flat or stop"),
    (CYLINDER, f"{CYLINDER}\nconic = 0.5", "surface 4, conic is 0.5: expected it only for type aspheric"),
    ("aspheric_coeffs = [1e-6, -2e-9, 0.0]\n", "", "surface 3, aspheric_coeffs is missing: expected a list of numbers"),
    ("surface = 2", "surface = 7", "focus, variable 1, surface is 7: expected the number of a surface, 0 to 4"),
    ("thickness_close = 3.5", "", "focus, variable 1, thickness_close is missing: expected a number"),
    ("close_distance = 500.0", "", "focus, close_distance is missing: expected a number"),
    ("ior = 1.6", 'ior = "BK7"', "surface 4, ior is BK7: expected a number"),
    ('type = "stop"\n', "", "stop is at 0 surfaces"),
    ("max_fstop = 9.8", "", "lens, max_fstop is missing: expected a number")])
def test_invalid_files_are_errors_with_their_location(read, old, new, message):
    with pytest.raises(LensError) as error:
        read((old, new), field=FIELD)
    assert f"lens.toml: {message}" in str(error.value)


def test_the_end_of_the_field_must_be_given(read):
    with pytest.raises(LensError, match="field is missing: physical-camera does not state .* give --field-angle"):
        read()


def test_the_stated_focal_length_is_along_y(read):
    with refused(LensError, field="focal length", match="60 mm, .* 49.04 mm along y", where="lens.toml"):
        read(("focal_length = 49.0", "focal_length = 60.0"), field=FIELD)


def test_unknown_names_are_reported(read):
    assert read((CYLINDER, f"{CYLINDER}\ntilt = 3.0"), field=FIELD).notes == unread_note(["tilt"])


def test_other_toml_files_are_prescriptions_of_lensfield(tmp_path):
    read = reader_of(tmp_path / "lens.toml", TOML)
    with pytest.raises(LensError, match="format is missing: expected lensfield-prescription"):
        read(('format = "lensfield-prescription"', "[lens]"))
