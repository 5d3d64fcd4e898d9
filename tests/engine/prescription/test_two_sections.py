"""Biconic and toroidal surfaces, and displaced ones, by their implicit equations and by scipy's search for roots."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from crooked_lens import CROOKED
from implicit_surfaces import biconic, gradient, root_mm, toroid
from lensfield.engine import LensError
from lensfield.engine.prescription.prescription import Pose, Prescription, Surface
from lensfield.engine.prescription.readers import ReadingOptions, read_prescription
from lensfield.engine.prescription.readers.toml import write_prescription
from lensfield.engine.prescription.surfaces import (
    distance_to,
    from_surface_frame,
    sag_and_gradient,
    to_surface_frame,
    unit_normal,
    vertex_curvature,
)
from lensfield.engine.prescription.system import system_of
from refusals import refused

pytestmark = pytest.mark.one_blender
SURFACES = {
    "biconic": (biconic, Surface(9.0, radius_x_mm=-14.0, conic=-0.6, conic_x=1.5)),
    "anamorphic asphere": (biconic, Surface(-11.0, radius_x_mm=30.0, conic_x=-2.0, aspheric=(0.0, 4e-4, -3e-6),
                                            skews=(0.0, 0.6, -1.4))),
    "terms without curvature": (biconic, Surface(radius_x_mm=np.inf, aspheric=(0.02, 1e-4), skews=(0.3,))),
    "toroid": (toroid, Surface(12.0, radius_x_mm=7.0, profile="y", conic=-0.5, aspheric=(0.0, 2e-4, 1e-6))),
    "toroid along x": (toroid, Surface(8.0, radius_x_mm=-10.0, profile="x", conic_x=0.4, aspheric=(1e-3, -2e-4))),
    "saddle": (toroid, Surface(-15.0, radius_x_mm=9.0, profile="y", aspheric=(0.0, 1e-4))),
    "cylinder": (toroid, Surface(10.0, radius_x_mm=np.inf, profile="y", conic=-1.3)),
    "cylinder across its profile": (toroid, Surface(-8.0, radius_x_mm=np.inf, profile="x"))}
surfaces = pytest.mark.parametrize("implicit, surface", [(of(surface), surface) for of, surface in SURFACES.values()],
                                   ids=SURFACES)


@surfaces
def test_its_points_fulfil_the_equation(implicit, surface):
    x, y = np.random.default_rng(1).uniform(-3, 3, (2, 50))
    np.testing.assert_allclose(implicit(x, y, sag_and_gradient(surface, x, y)[0]), 0, atol=1e-14)


@surfaces
def test_its_normal_is_the_gradient_of_the_equation(implicit, surface):
    x, y = np.random.default_rng(2).uniform(-3, 3, (2, 50))
    place = np.stack([x, y, sag_and_gradient(surface, x, y)[0]])
    np.testing.assert_allclose(unit_normal(surface, place), gradient(implicit, place), atol=2e-9)


@surfaces
@pytest.mark.parametrize("side", [1, -1])
def test_rays_end_where_the_equation_has_its_root(implicit, surface, side):
    rng = np.random.default_rng(3)
    x, y, slope_x, slope_y = rng.uniform(-2.5, 2.5, (4, 30)) * np.array([[1], [1], [0.2], [0.2]])
    direction = side * np.stack([slope_x, slope_y, np.ones(30)]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    start = np.stack([x, y, np.zeros(30)]) - 2 * direction
    roots = [root_mm(implicit, *ray, 0.5, 3.5) for ray in zip(start.T, direction.T, strict=True)]
    np.testing.assert_allclose(distance_to(surface, start, direction), roots, rtol=0, atol=1e-12)


def test_a_search_from_beyond_the_end_comes_back():
    """A slanting ray crosses the vertex plane beyond the end of the surface."""
    start, direction = np.array([[14.0], [1.0], [0.0]]), np.array([[-0.8], [0.0], [0.6]])
    on_sphere = distance_to(Surface(10.0), start, direction)
    assert np.isfinite(on_sphere)
    for profile in ("", "x", "y"):
        surface = Surface(10.0, radius_x_mm=10.0, profile=profile)
        np.testing.assert_allclose(distance_to(surface, start, direction), on_sphere, rtol=0, atol=1e-12)


@pytest.mark.parametrize("profile", ["", "x", "y"])
def test_equal_sections_are_a_sphere(profile):
    x, y = np.random.default_rng(4).uniform(-4, 4, (2, 50))
    place = np.stack([x, y, sag_and_gradient(Surface(-9.0), x, y)[0]])
    surface = Surface(-9.0, radius_x_mm=-9.0, profile=profile)
    np.testing.assert_allclose(sag_and_gradient(surface, x, y)[0], place[2], rtol=0, atol=1e-14)
    np.testing.assert_allclose(unit_normal(surface, place), unit_normal(Surface(-9.0), place), rtol=0, atol=1e-14)


@surfaces
@pytest.mark.parametrize("section", ["x", "y"])
def test_the_curvature_of_a_section_is_its_second_derivative(implicit, surface, section):
    step = np.array([0.0, 1e-3])
    sags = sag_and_gradient(surface, *((step, 0 * step) if section == "x" else (0 * step, step)))[0]
    assert vertex_curvature(surface, section) == pytest.approx(2e6 * (sags[1] - sags[0]), abs=1e-8)


def test_a_pose_turns_about_x_then_y_then_z_and_moves_afterwards():
    pose = Pose((1.0, -2.0, 0.5), (20.0, -30.0, 40.0))
    turned = scipy.spatial.transform.Rotation.from_euler("xyz", pose.tilt_deg, degrees=True)
    np.testing.assert_allclose(pose.rotation, turned.as_matrix(), atol=1e-15)
    np.testing.assert_allclose((Pose(tilt_deg=(10.0, 0.0, 0.0)).rotation @ (0.0, 1.0, 0.0))[2], np.sin(np.radians(10)))
    ray = np.random.default_rng(5).normal(size=(2, 3, 4, 5))
    position, direction = from_surface_frame(pose, *ray)
    np.testing.assert_allclose(position[:, 2, 3], turned.apply(ray[0][:, 2, 3]) + pose.offset_mm, atol=1e-14)
    np.testing.assert_allclose(to_surface_frame(pose, position, direction), ray, atol=1e-14)


@pytest.mark.parametrize("surface, words", [
    (Surface(conic_x=1.0), "conic_x is 1.0: expected radius_x_mm, too"),
    (Surface(profile="y"), "profile is y: expected radius_x_mm, too"),
    (Surface(radius_x_mm=0.0), "radius_x_mm is 0.0: expected a radius, or inf"),
    (Surface(radius_x_mm=9.0, conic_x=np.nan), "conic_x is nan: expected a number"),
    (Surface(radius_x_mm=9.0, profile="z"), "profile is z: expected x or y"),
    (Surface(radius_x_mm=9.0, odd_aspheric=(1e-3,)), "odd_aspheric is .*: expected even powers only"),
    (Surface(radius_x_mm=9.0, skews=(0.5,)), "skews is .*: expected a number for each of aspheric"),
    (Surface(radius_x_mm=9.0, profile="x", aspheric=(1e-3,), skews=(0.5,)), "skews is .*: a toroid is not skewed"),
    (Surface(radius_x_mm=9.0, profile="x", conic=-1.0), "conic is -1.0: a toroid's section across its profile"),
    (Surface(radius_x_mm=9.0, profile="y", conic_x=-1.0), "conic_x is -1.0: a toroid's section across its profile"),
    (Surface(pose=Pose((0.0, np.nan, 0.0))), "pose, offset_mm is .*: expected three numbers"),
    (Surface(pose=Pose(tilt_deg=(90.0, 0.0, 0.0))), "pose, tilt_deg is .*: expected three angles"),
])
def test_shapes_without_a_meaning_are_refused_in_a_line(surface, words):
    with pytest.raises(LensError, match=f"odd: surface 1, {words}"):
        Prescription("odd", (replace(surface, stop=True, thickness_mm=50.0),), ("stop", 1.0), ("angle_deg", 5.0))


def crossed_cylinders(**changes):
    """Two plano-cylinders of 2 and 3 mm of an index of 1.5, 10 mm apart, with the stop halfway: 20 mm along x, 30 mm
    along y."""
    surfaces = (Surface(radius_x_mm=10.0, thickness_mm=2.0, glass="1.5/1000"), Surface(thickness_mm=5.0),
                Surface(thickness_mm=5.0, stop=True), Surface(15.0, 3.0, "1.5/1000", radius_x_mm=np.inf, profile="y"),
                Surface(thickness_mm=9.0))
    return Prescription("crossed", surfaces, ("f_number", 4.0), ("angle_deg", 10.0), **changes)


def test_the_first_order_of_crossed_cylinders():
    """By hand: glass of thickness t is t / n of air, and 1 / s' = 1 / s + 1 / f; pupils are images of the stop."""
    system = system_of(crossed_cylinders())
    along, across = system, system.across
    assert (along.efl_mm, across.efl_mm, system.squeeze) == pytest.approx((30.0, 20.0, 1.5), rel=1e-12)
    assert along.image_distance_mm == pytest.approx(30 - 3 / 1.5)
    assert across.image_distance_mm == pytest.approx(20 - 2 / 1.5 - 10 - 3 / 1.5)
    assert system.paraxial_focus_mm == pytest.approx((28 + 20 / 3) / 2)
    assert along.entrance_pupil_mm == pytest.approx(2 / 1.5 + 5)
    assert across.entrance_pupil_mm == pytest.approx(1 / (1 / (2 / 1.5 + 5) - 1 / 20))
    assert along.exit_pupil_mm == pytest.approx(-(1 / (1 / 5 - 1 / 30) + 3 / 1.5))
    assert across.exit_pupil_mm == pytest.approx(-(5 + 3 / 1.5))
    assert along.stop_semi_aperture_mm == across.stop_semi_aperture_mm == pytest.approx(30 / 4 / 2)
    assert across.marginal_heights_mm[0] == pytest.approx(30 / 4 / 2 / (1 - (2 / 1.5 + 5) / 20))


def test_the_squeeze_of_near_objects():
    """The same object is imaged by two magnifications, from one viewpoint."""
    near = system_of(crossed_cylinders(object_distance_mm=200.0))
    from_lens_mm = 200 + 2 / 1.5 + 10  # of air, to the second cylinder
    assert near.magnification == pytest.approx(-30 / (from_lens_mm - 30))
    assert near.across.magnification == pytest.approx(-20 / (200 - 20))
    assert near.squeeze == pytest.approx((30 / (from_lens_mm - 30)) / (20 / 180))


def test_a_section_without_power_is_named():
    cylinder = replace(crossed_cylinders(), surfaces=crossed_cylinders().surfaces[1:])
    with refused(LensError, field="focal length along x", value="infinite", where="crossed"):
        system_of(cylinder)


def read(text, path):
    path.write_text(text, encoding="utf-8")
    return read_prescription(path, ReadingOptions())


def test_files_are_read_as_written(tmp_path):
    lens = replace(CROOKED, surfaces=(*CROOKED.surfaces[:-1], replace(CROOKED.surfaces[-1], radius_x_mm=np.inf)))
    assert read(write_prescription(lens), tmp_path / "lens.toml") == lens
    assert read(write_prescription(lens.scaled(2.5)), tmp_path / "lens.toml").surfaces == lens.scaled(2.5).surfaces


@pytest.mark.parametrize("old, new, words", [
    ('profile = "y"', 'profile = 2', "surface 2, profile is 2: expected a string"),
    ("skews = { 4 = 0.4 }", "skews = { 3 = 0.4 }", "surface 1, skews is .*: expected even powers"),
    ("skews = { 4 = 0.4 }", "skews = [0.4]", "surface 1, skews is .*: expected a table of powers"),
    (", pose = { offset_mm", ", pose = { shift_mm", "surface 1, pose, shift_mm is unknown: expected offset_mm"),
    ("[0.2, -0.1, 0.05]", "[0.2, -0.1]", "surface 1, pose, offset_mm is .*: expected 3 numbers"),
    ("image_pose = {", "image_pose = 3 #", "image_pose is 3: expected a table such as"),
])
def test_mistakes_in_files_have_a_place(tmp_path, old, new, words):
    text = write_prescription(CROOKED)
    assert old in text
    with pytest.raises(LensError, match=words):
        read(text.replace(old, new, 1), tmp_path / "lens.toml")
