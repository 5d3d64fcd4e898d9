"""Focus of lenses whose two sections differ, by hand; and what needs rotational symmetry and refuses them."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.prescription.prescription import Pose, Prescription, Surface
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.fields import find_fields, trace_fields, view_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.ray_table import ray_table
from lensfield.engine.rays.rays import FullPupil
from lensfield.engine.rays.rings import Rings, turned
from lensfield.engine.spectral.spectra import colour_matching
from refusals import refused

pytestmark = pytest.mark.one_blender
ALONG_MM, ACROSS_MM = 50.0, 48.0
TORIC = Prescription("toric", (
    Surface(0.5 * ALONG_MM, 1e-3, "1.5/1000", radius_x_mm=0.5 * ACROSS_MM, profile="y", stop=True),
    Surface(thickness_mm=48.5)), ("f_number", 40.0), ("image_height_mm", 2.0), sensor_mm=(3.0, 2.0),
    highest_f_number=64.0)


def image_plane_mm(lens):
    return lens.surfaces[-1].thickness_mm


@pytest.mark.parametrize("distance_mm", [np.inf, 1000.0])
def test_paraxial_focus_is_the_mean_of_both_sections(distance_mm):
    lens = replace(TORIC, focus="paraxial", object_distance_mm=distance_mm)
    images_mm = [1 / (1 / focal_mm - 1 / distance_mm) for focal_mm in (ALONG_MM, ACROSS_MM)]
    assert image_plane_mm(build_system(lens).prescription) == pytest.approx(np.mean(images_mm), abs=1e-3)


def test_the_least_spot_is_where_slopes_balance():
    """The mean square of slope_y (z - f_y) and slope_x (z - f_x), where slopes go with 1 / f. Spherical aberration,
    about h^2 / f, and dispersion move it by 0.01 mm."""
    place_mm = image_plane_mm(build_system(replace(TORIC, focus="best")).prescription)
    expected_mm = np.average([ALONG_MM, ACROSS_MM], weights=1 / np.square([ALONG_MM, ACROSS_MM]))
    assert place_mm == pytest.approx(expected_mm, abs=0.02)


@pytest.mark.parametrize("focus, nm, heights_mm", [("best", range(450, 651, 25), [0.0]),
                                                   ("field", [486.1, 546.1, 656.3], [0.0, 0.7, 1.0, 1.4])])
def test_no_plane_next_to_it_has_a_smaller_spot(focus, nm, heights_mm):
    """For a displaced lens with a tilted sensor, by its traced spots at three positions of the plane."""
    lens = replace(TORIC, focus=focus, image_pose=Pose((0.1, 0.0, 0.0), (6.0, -8.0, 30.0)), surfaces=(
        replace(TORIC.surfaces[0], pose=Pose((0.2, -0.1, 0.0), (0.5, 0.0, 2.0))), TORIC.surfaces[1]))
    best = build_system(lens).prescription
    sides = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
    places_mm = np.unique(np.concatenate([height_mm * sides for height_mm in heights_mm]), axis=0).T
    weights = (colour_matching(nm)[:, 1] if focus == "best" else np.ones(3))[:, None]
    pupil, step_mm, points, spots_mm2 = FullPupil(13, 32), 0.05, None, []
    for shift_mm in (-step_mm, 0.0, step_mm):
        moved = replace(best.surfaces[-1], thickness_mm=image_plane_mm(best) + shift_mm)
        system = system_of(replace(best, surfaces=(best.surfaces[0], moved)))
        view = view_of(system)
        points = points or find_fields(system, view, places_mm, nm)
        place = trace_fields(system, view, points, pupil).position_mm
        light = np.broadcast_to(pupil.radii[:, None], place.shape)
        spread = place - np.average(place, axis=(-2, -1), weights=light, keepdims=True)
        spots_mm2.append(np.sum(weights * np.sum(light * spread**2, axis=(0, -2, -1))))
    first, middle, last = spots_mm2
    lowest_mm = step_mm * (first - last) / (2 * (first - 2 * middle + last))
    assert abs(lowest_mm) < 2e-3


@pytest.mark.parametrize("focus", ["as given", "best"])
def test_the_rings_focus_both_sections(focus):
    """As a unit: the plane stays where it was between their images."""
    lens = replace(TORIC, focus=focus)
    far, near = (turned(lens, Rings(distance_mm, 44.0)) for distance_mm in (np.inf, 1000.0))
    assert (near.focus_mm, near.f_number, near.words) == (pytest.approx(1000.0), pytest.approx(44.0), ())
    behind_mm = [image_plane_mm(each.prescription) - system_of(each.prescription).paraxial_focus_mm
                 for each in (far, near)]
    assert behind_mm[0] == pytest.approx(behind_mm[1], abs=2e-2 if focus == "best" else 1e-9)


def test_an_aperture_too_small_for_one_section_is_refused():
    """The beam along x narrows to two thirds between the first surface and the stop."""
    surfaces = (Surface(radius_x_mm=30.0, thickness_mm=1e-3, glass="1.5/1000", semi_aperture_mm=0.375),
                Surface(thickness_mm=20.0), Surface(thickness_mm=1e-3, stop=True),
                Surface(25.0, 1e-3, "1.5/1000", radius_x_mm=np.inf), Surface(thickness_mm=20.0))
    with refused(LensError, field="aperture, f_number", value=40.0, where="toric", match="100 at most"):
        build_system(replace(TORIC, surfaces=surfaces, focus="paraxial"))


def test_tasks_that_need_rotational_symmetry_name_the_surface():
    with pytest.raises(LensError, match="toric: surface 1 is not rotationally symmetric: a field of heights needs"):
        ray_table(TORIC, [550.0])
    tilted = replace(TORIC, surfaces=(Surface(25.0, 1.0, "1.5/1000", stop=True), TORIC.surfaces[1]),
                     image_pose=Pose(tilt_deg=(5.0, 0.0, 0.0)))
    with refused(LensError, field="image_pose", value="not rotationally symmetric", where="toric"):
        ray_table(tilted, [550.0])
