"""Rings: the settings that a lens is turned to, their limits, and the parts that move."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from lensfield.engine import LensError
from lensfield.engine.library import bundled_names, prescription_of, prescription_path
from lensfield.engine.prescription.prescription import Pose, Prescription, Surface
from lensfield.engine.prescription.system import system_of
from lensfield.engine.prescription.tolerances import Copy
from lensfield.engine.rays.fields import view_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.rays import FullPupil, trace_pupil
from lensfield.engine.rays.rings import (
    Rings,
    capture_focal_length_mm,
    is_stopped_down,
    resized_rings,
    ring_ends,
    turned,
)
from varied_lenses import VARIED


@pytest.mark.parametrize("name", VARIED)
def test_at_rest_a_lens_matches_its_prescription(name):
    lens = prescription_of(name)
    given, result = system_of(lens), turned(lens)
    assert result.words == ()
    after = system_of(result.prescription)
    assert after.stop_semi_aperture_mm == pytest.approx(given.stop_semi_aperture_mm, rel=1e-9)
    assert after.last_height_mm == pytest.approx(given.last_height_mm, rel=1e-9)
    assert result.prescription.object_distance_mm == lens.object_distance_mm and result.prescription.focus == "as given"
    assert turned(result.prescription).prescription == result.prescription, "turned once, it stays"


@pytest.mark.sample(8)
@pytest.mark.parametrize("name", VARIED)
@pytest.mark.parametrize("focus_mm", [3000.0, 1234.5, np.inf])
def test_the_focus_distance_is_measured_from_the_entrance_pupil(name, focus_mm):
    focused = turned(prescription_of(name), Rings(focus_mm))
    system = system_of(focused.prescription)
    assert focused.words == () and focused.focus_mm == pytest.approx(focus_mm)
    assert system.prescription.object_distance_mm + system.entrance_pupil_mm == pytest.approx(focus_mm)
    behind_mm = focused.prescription.surfaces[-1].thickness_mm
    assert behind_mm == pytest.approx(system.image_distance_mm, abs=0.03 * system.efl_mm), "about the paraxial image"


def test_a_given_image_plane_stays_as_its_maker_chose():
    lens = prescription_of("edmund-54852")
    refocused = turned(lens, Rings(turned(lens).focus_mm)).prescription
    assert refocused.surfaces[-1].thickness_mm == pytest.approx(lens.surfaces[-1].thickness_mm, abs=1e-9)
    far = system_of(turned(lens, Rings(np.inf)).prescription)
    given = system_of(lens)
    assert (far.prescription.surfaces[-1].thickness_mm - far.image_distance_mm
            == pytest.approx(lens.surfaces[-1].thickness_mm - given.image_distance_mm))


def test_the_f_number_is_for_infinity_and_the_stop_stays():
    lens = prescription_of("nikkor-28mm")
    far, near = (system_of(turned(lens, Rings(focus_mm, 8.0)).prescription) for focus_mm in (np.inf, 500.0))
    assert far.f_number == pytest.approx(8.0)
    assert near.stop_semi_aperture_mm == pytest.approx(far.stop_semi_aperture_mm)
    assert abs(0.5 / near.marginal_slope) > 8.0 * 1.03, "what light sees is less, near by"


def test_rings_out_of_range_are_reported_and_clamped():
    lens = prescription_of("tessar-50mm")
    wide = turned(lens, Rings(f_number=2.0))
    assert wide.f_number == pytest.approx(5.5) and wide.prescription == turned(lens).prescription
    assert wide.words == ("f/2 is wider than this lens opens: set to f/5.5",)
    assert turned(lens, Rings(f_number=64.0)).f_number == 22.0
    near = turned(lens, Rings(100.0, 8.0))
    assert near.prescription.object_distance_mm == pytest.approx(499.766, abs=0.01), "ten focal lengths"
    assert near.words == ("focus at 0.1 m: this lens focuses no closer than 0.504 m: set to that",)
    closer = turned(replace(lens, closest_focus_mm=80.0), Rings(100.0))
    assert closer.words == () and closer.focus_mm == pytest.approx(100.0)
    assert turned(lens, Rings(f_number=5.4998)).words == (), "what is engraved is rounded"


@pytest.mark.parametrize("name", ["tessar-50mm", "nikkor-z-50mm-f1.8", "muller-fisheye-25mm"])
def test_a_lens_is_stopped_down_only_beyond_its_widest_stop(name):
    lens = prescription_of(name)
    widest, _ = ring_ends(lens)
    for f_number, shows in ((None, False), (widest.f_number / 2, False), (widest.f_number, False),
                            (1.1 * widest.f_number, lens.highest_f_number > widest.f_number)):
        assert is_stopped_down(lens, Rings(1500.0, f_number)) == shows


def test_a_lens_with_a_fixed_stop_says_so():
    lens = prescription_of("apple-phone-4mm")
    assert turned(lens, Rings(f_number=4.0)).words == ("f/4: this lens has only f/1.8",)


def test_an_enlarged_lens_focuses_at_the_requested_distance():
    lens = prescription_of("tessar-50mm")
    rings = resized_rings(lens, Rings(4000.0, 8.0), 100.0)
    assert rings.size * capture_focal_length_mm(lens, rings) == pytest.approx(100.0)
    assert rings.size * turned(lens, rings).focus_mm == pytest.approx(4000.0)
    near = resized_rings(lens, Rings(200.0), 100.0)
    assert turned(lens, near).words[0].startswith("focus at 0.2 m: this lens focuses no closer than 0.9")
    assert resized_rings(lens, Rings(f_number=8.0), 100.0) == Rings(f_number=8.0)


def test_the_range_of_the_rings():
    far, near = ring_ends(prescription_of("tessar-50mm"))
    assert (far.focus_mm, far.f_number, near.f_number) == (np.inf, pytest.approx(5.5), 22.0)
    assert near.focus_mm == pytest.approx(504.4, abs=0.1)
    edmund = prescription_of("edmund-54852")
    assert ring_ends(edmund)[0].focus_mm == np.inf, "though it is told for 250 mm"


def test_focusing_wide_open_keeps_the_image_plane_of_the_widest_stop():
    lens = prescription_of("angenieux-50mm")
    wide, closed = turned(lens), turned(lens, Rings(f_number=4.0))
    focused_wide = turned(lens, Rings(f_number=4.0, focused_wide_open=True))
    planes = [each.prescription.surfaces[-1].thickness_mm for each in (wide, closed, focused_wide)]
    assert planes[2] == planes[0] != planes[1]
    assert focused_wide.prescription.aperture == closed.prescription.aperture


@pytest.mark.parametrize("rings, message", [
    ({"focus_mm": 0.0}, "focus_mm is 0.0: expected a positive number"), ({"focus_mm": -1.0}, "focus_mm is -1.0"),
    ({"focus_mm": np.nan}, "focus_mm is nan"), ({"f_number": 0.0}, "f_number is 0.0: expected a positive number"),
    ({"f_number": np.nan}, "f_number is nan"), ({"f_number": np.inf}, "f_number is inf"),
    ({"size": 0.0}, "size is 0.0"),
    ({"size": -2.0}, "size is -2.0"), ({"size": np.nan}, "size is nan"), ({"size": np.inf}, "size is inf")])
def test_invalid_distances_f_numbers_and_sizes_are_errors(rings, message):
    with pytest.raises(LensError, match=message):
        Rings(**rings)


GLASS = "1.6/60"
PAIR = (Surface(48.0, 1e-6, GLASS), Surface(np.inf, 20.0), Surface(thickness_mm=5.0, stop=True),
        Surface(72.0, 1e-6, GLASS), Surface(np.inf, 40.0))
DISTANCES_MM = (np.inf, 1000.0, 400.0)  # from the second lens, except for 20 mm


def pair(gap_mm, distance_mm):
    """Two thin lenses of 80 and 120 mm, with the first this far in front of the second."""
    surfaces = (PAIR[0], replace(PAIR[1], thickness_mm=gap_mm), *PAIR[2:])
    return Prescription("pair", surfaces, ("stop", 3.0), ("image_height_mm", 10.0), distance_mm + 20 - gap_mm)


def moving_pair(distances_mm=DISTANCES_MM):
    """A lens whose first half moves so that the image plane stays fixed, and the position of that plane."""
    def image_mm(gap_mm, distance_mm):
        return system_of(pair(gap_mm, distance_mm)).image_distance_mm

    plane_mm = image_mm(20.0, distances_mm[0])
    gaps_mm = tuple(brentq(lambda gap_mm, at_mm: image_mm(gap_mm, at_mm) - plane_mm, 5.0, 60.0, distance_mm)
                    for distance_mm in distances_mm)
    first = pair(gaps_mm[0], distances_mm[0])
    return replace(first, focus="paraxial", focused_at_mm=tuple(
        distance_mm + 20 - gap_mm for distance_mm, gap_mm in zip(distances_mm, gaps_mm, strict=True)),
        surfaces=(PAIR[0], replace(first.surfaces[1], gaps_mm=gaps_mm), *PAIR[2:])), plane_mm


def focus_of(lens, number):
    """The focus distance from the entrance pupil at one of the lens's positions."""
    moved = tuple(replace(surface, thickness_mm=surface.gaps_mm[number]) if surface.gaps_mm else surface
                  for surface in lens.surfaces)
    distance_mm = lens.focused_at_mm[number]
    return distance_mm + system_of(replace(lens, surfaces=moved, object_distance_mm=distance_mm)).entrance_pupil_mm


def test_named_gaps_follow_the_magnification_and_hit_every_position():
    lens, plane_mm = moving_pair()
    for number, gap_mm in enumerate(lens.surfaces[1].gaps_mm):
        focused = turned(lens, Rings(focus_of(lens, number)))
        assert focused.words == () and focused.prescription.focused_at_mm == ()
        assert focused.prescription.surfaces[1].thickness_mm == pytest.approx(gap_mm, abs=1e-6)
        assert focused.prescription.surfaces[-1].thickness_mm == pytest.approx(plane_mm, abs=1e-5)
    between = turned(lens, Rings(600.0)).prescription
    _, far_mm, near_mm = lens.surfaces[1].gaps_mm
    assert far_mm < between.surfaces[1].thickness_mm < near_mm
    assert between.surfaces[-1].thickness_mm == pytest.approx(plane_mm, abs=0.3), "it is nearly held"
    given, after = system_of(lens), system_of(between)
    assert after.stop_semi_aperture_mm == given.stop_semi_aperture_mm


def test_an_internally_focusing_lens_ends_at_its_last_positions():
    lens, _ = moving_pair()
    near = turned(lens, Rings(50.0))
    assert near.prescription.object_distance_mm == pytest.approx(lens.focused_at_mm[-1], rel=1e-6)
    assert "focuses no closer than" in near.words[0]
    macro, _ = moving_pair((1000.0, 400.0))
    assert "focuses no farther than" in turned(macro, Rings(np.inf)).words[0]


def test_impossible_positions_are_an_error():
    lens, _ = moving_pair()
    turned_round = replace(lens, surfaces=tuple(replace(each, gaps_mm=(20.0, 80.0, 20.0) if each.gaps_mm else ())
                                                for each in lens.surfaces), focused_at_mm=(np.inf, 400.0, 390.0))
    with pytest.raises(LensError, match="focused_at_mm is .*: expected magnifications that rise in this order"):
        turned(turned_round, Rings(500.0))


SOFT = ("jacobsen-41mm-2x",  # its main lens is a Speed Panchro, soft at every distance
        "nikkor-reflex-500mm",  # two moving parts for 1:2.5: 22 um there
        "minolta-macro-100mm")  # at 1:1 and f/2.8, 39 um, and 28 um in the best focus
INSIDE = [name for name in bundled_names() if "focused_at_mm" in prescription_path(name).read_text(encoding="utf-8")
          and name not in SOFT]
PUPIL = FullPupil(17, 40)


def axial_rms_um(prescription):
    """RMS size of the spot on the axis at 587.6 nm."""
    system = build_system(prescription)
    rays = trace_pupil(system, [0.0], [587.6], PUPIL)
    light = PUPIL.radii[:, None] * ~rays.lost * np.all(system.limits(rays.square_height_mm2) <= 1, axis=0)
    return 1e3 * np.sqrt(np.sum(light * np.sum(rays.position_mm**2, axis=0)) / np.sum(light))


@pytest.mark.sample(5)
@pytest.mark.parametrize("name", INSIDE)
def test_modern_lenses_with_moving_gaps_are_sharp_at_close_range(name):
    """To 1/2500 of the diagonal, with 1/1500 as the usual circle of confusion; many are not sharp if moved as a unit.
    """
    lens = prescription_of(name)
    limit_um = 1e3 * np.hypot(*lens.sensor_mm) / 2500
    closest = turned(lens, Rings(1.0))
    assert axial_rms_um(closest.prescription) < limit_um
    assert axial_rms_um(turned(lens, Rings(2 * closest.focus_mm)).prescription) < limit_um


def test_a_lens_moved_as_a_unit_blurs_where_moving_gaps_do_not():
    """A 40 mm f/1.4 at its closest distance: 25 um if moved as a unit, 4 um with its own gaps."""
    lens = prescription_of("sigma-40mm-f1.4")
    rigid = replace(lens, focused_at_mm=(), closest_focus_mm=lens.focused_at_mm[-1],
                    surfaces=tuple(replace(surface, gaps_mm=()) for surface in lens.surfaces))
    with_gaps = turned(lens, Rings(1.0))
    assert axial_rms_um(with_gaps.prescription) == pytest.approx(4, abs=1)
    assert axial_rms_um(turned(rigid, Rings(with_gaps.focus_mm)).prescription) == pytest.approx(25, abs=2)


@pytest.mark.one_blender
def test_a_tilted_lens_stays_focused_in_the_middle_and_its_plane_of_focus_leans():
    """By the hinge rule, the plane in focus of a thin lens with the focal length f meets the plane of the lens at f /
    sin t from its middle: below a lens that is tilted down."""
    at_rest, tilted_deg = turned(prescription_of("tessar-50mm")).prescription, (4.0, -2.5)
    lens = turned(prescription_of("tessar-50mm"), Rings(tilt_deg=tilted_deg)).prescription
    assert replace(lens, image_pose=None) == at_rest and lens.image_pose.tilt_deg == (*tilted_deg, 0.0)
    view = view_of(system_of(lens))
    assert view.nearness == 0
    left_right, down_up = np.sin(np.radians(tilted_deg))[::-1]
    np.testing.assert_allclose(view.lean * system_of(lens).efl_mm,  # tangents along the light: upwards from below
                               (-left_right, down_up), rtol=0.05)


@pytest.mark.one_blender
def test_a_copy_differs_from_the_design_in_poses_only():
    design = turned(prescription_of("nikkor-28mm"), Rings(2000.0, 5.6))
    copy = turned(prescription_of("nikkor-28mm"), Rings(2000.0, 5.6, copy=Copy(3, "dropped")))
    assert not copy.prescription.radial and copy.focus_mm == design.focus_mm
    centred = tuple(replace(surface, pose=None) for surface in copy.prescription.surfaces)
    assert replace(copy.prescription, surfaces=centred) == design.prescription


@pytest.mark.parametrize("tilt_deg", [(46.0, 0.0), (0.0, float("nan")), (1.0,)])
def test_an_impossible_tilt_is_an_error(tilt_deg):
    with pytest.raises(LensError, match="rings: tilt_deg is .*expected two angles of at most 45 degrees"):
        Rings(tilt_deg=tilt_deg)


def test_a_sensor_that_is_tilted_already_is_not_tilted_again():
    lens = replace(prescription_of("tessar-50mm"), image_pose=Pose(tilt_deg=(1.0, 0.0, 0.0)))
    assert turned(lens).prescription.image_pose == lens.image_pose
    with pytest.raises(LensError, match="image_pose is .*the file tilts or displaces the sensor"):
        turned(lens, Rings(tilt_deg=(2.0, 0.0)))
