"""Ghostlight's .lens: elements with their own positions and turns, and the file's glasses."""

import json
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from lens_texts import GHOSTLIGHT
from lensfield.engine import LensError
from lensfield.engine.prescription.glasses import find_glass
from lensfield.engine.prescription.prescription import Pose, Surface
from lensfield.engine.prescription.readers import ReadingOptions, read_prescription
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.rings import AT_REST, turned
from lensfield.engine.rays.transmission import transmittance
from lensfield.engine.runtime.unread import unread_note

FIELD = ("image_height_mm", 12.0)
LENS = (Surface(thickness_mm=2.0, semi_aperture_mm=2.5, stop=True), Surface(50.0, 4.0, "N-BK7", 8.0, coating="single"),
        Surface(-50.0, 1.5, "", 8.0, -0.5, (0.0, 1e-6, -2e-9)))
TILT = Pose((0.3, -0.2, 0.0), (2.0, 0.0, 0.0))


@pytest.fixture
def read(tmp_path):
    """Read the file after a function has changed its contents."""
    def read_changed(change=lambda contents: None, field=FIELD):
        contents = deepcopy(GHOSTLIGHT)
        change(contents)
        (tmp_path / "lens.lens").write_text(json.dumps(contents))
        return read_prescription(tmp_path / "lens.lens", ReadingOptions(field))

    return read_changed


def rear(contents):
    """The last element."""
    return contents["optical_system"][-1]


def test_a_lens(read):
    """Gaps between elements follow from their positions. The last element turns about the middle of its thickness."""
    lens = read()
    assert lens.surfaces[:2] == LENS[:2]
    front, back = lens.surfaces[3:]
    lean = np.radians(2.0)
    assert lens.surfaces[2] == replace(LENS[2], thickness_mm=pytest.approx(1.5 + 0.5 - 0.5 * np.cos(lean)))
    assert front.thickness_mm == pytest.approx(np.cos(lean))
    assert front.thickness_mm + back.thickness_mm == pytest.approx(49.0 - 0.5 + 0.5 * np.cos(lean))
    assert replace(front, thickness_mm=1.0, pose=None) == Surface(np.inf, 1.0, "1.6/60", 8.5, radius_x_mm=80.0)
    assert front.pose.offset_mm == pytest.approx((0.3, -0.2 + 0.5 * np.sin(lean), 0.0))
    assert back.pose.offset_mm == pytest.approx((0.3, -0.2 - 0.5 * np.sin(lean), 0.0))
    assert front.pose.tilt_deg == back.pose.tilt_deg == (2.0, 0.0, 0.0)
    assert (lens.aperture, lens.focus, lens.focal_length_mm) == (("f_number", 9.8), "best", 49.0)
    assert lens.notes == "" and "US1234567" in lens.source and lens.image_pose is None


def test_the_files_dispersion_is_used(read):
    glass, = read().glasses
    nm = [450.0, 550.0, 650.0]
    assert glass.index_at(nm) == pytest.approx(find_glass("SCHOTT N-BK7", "", "").index_at(nm), abs=1e-8)


@pytest.mark.parametrize("axis, changes", [("x", dict(radius_mm=80.0, radius_x_mm=np.inf)),
                                           ("y", dict(radius_mm=np.inf, radius_x_mm=80.0))])
def test_a_cylinder_is_straight_along_its_axis(read, axis, changes):
    def turn(contents):
        rear(contents)["surfaces"][0]["form"]["axis"] = axis
        rear(contents)["transform"] = {"position": {"z": -49.0}}
        contents["metadata"] = {}

    assert read(turn).surfaces[3] == replace(Surface(80.0, 1.0, "1.6/60", 8.5), **changes)


def test_a_quarter_turn_exchanges_the_sections(read):
    def turn(contents):
        rear(contents)["transform"] = {"position": {"z": -49.0}, "rotation": {"roll": 90.0}}
        contents["metadata"] = {}

    assert read(turn).surfaces[3] == Surface(80.0, 1.0, "1.6/60", 8.5, radius_x_mm=np.inf)


def test_other_apertures_and_unknown_names_are_reported(read):
    def add(contents):
        contents["optical_system"][0]["surfaces"][0] |= {
            "tilt": 3.0, "modifiers": [{"type": "aperture", "shape": "polygon", "blades": 9}]}

    assert read(add).notes == unread_note(["tilt", "polygon aperture"])


@pytest.mark.parametrize("modifier, coating, notes", [
    ({"model": "simple", "ar_layers": 0}, "none", ""), ({"model": "simple", "ar_layers": 5}, "multi", ""),
    ({"model": "measured", "file": "x"}, "", unread_note(["measured coating"]))])
def test_coatings_are_read_by_their_layers(read, modifier, coating, notes):
    lens = read(lambda contents: rear(contents)["surfaces"][0].update(modifiers=[{"type": "coating"} | modifier]))
    assert lens.surfaces[3].coating == coating and lens.notes == notes


@pytest.mark.parametrize("change, message", [
    (lambda contents: contents.update(format="other"), "format is other: expected ghostlight-optical"),
    (lambda contents: rear(contents)["surfaces"][0].update(form={"type": "toric", "radius": 3.0}),
     "surface 4 is toric: expected sphere, asphere, or cylindrical along x or y"),
    (lambda contents: rear(contents)["surfaces"][0]["form"].update(axis="z"), "surface 4 is cylindrical z: expected"),
    (lambda contents: rear(contents)["surfaces"][0].update(is_active=False), "surface 4 is not active: expected"),
    (lambda contents: rear(contents)["surfaces"][0].update(modifiers=[{"type": "coating",
                                                                       "model": "attenuator_gaussian"}]),
     "surface 4 is attenuator_gaussian: expected surfaces without filters"),
    (lambda contents: rear(contents)["materials"][0].update(glass="F2"), "surface 4, glass is F2: expected a glass of"),
    (lambda contents: contents["glass_catalogue"]["weak"]["dispersion"].update(model="cauchy"),
     "glass weak is cauchy: expected abbe or sellmeier"),
    (lambda contents: contents["pivots"].append({"name": "focus", "offset": {"position": {"z": 2.0}}}),
     "pivot focus is with an offset: expected an offset of 0"),
    (lambda contents: contents["optical_system"].pop(0), "stop is missing: expected a surface with is_stop, or --stop"),
    (lambda contents: rear(contents)["materials"].clear(), "prescription is damaged")])
def test_invalid_files_are_errors_with_their_location(read, change, message):
    with pytest.raises(LensError) as error:
        read(change)
    assert f"lens.lens: {message}" in str(error.value)


def test_the_end_of_the_field_must_be_given(read):
    with pytest.raises(LensError, match="field is missing: a .lens does not state .* give --field-angle"):
        read(field=None)


@pytest.mark.parametrize("element, axis", [(1, "x"), (1, "y"), (2, "x")])
def test_a_lens_that_no_light_passes_is_refused(read, element, axis):
    """An element is a metre off the axis; its transmittance was NaN."""
    lens = read(lambda contents: contents["optical_system"][element]["transform"]["position"].update({axis: -1000.0}))
    with pytest.raises(LensError, match="light in the middle of the picture is none: expected rays from the stop"):
        transmittance(system_of(turned(lens, AT_REST).prescription), [450.0, 650.0])
