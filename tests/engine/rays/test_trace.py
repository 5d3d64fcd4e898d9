"""Rays against closed forms: perfect singlets, first-order optics, and the required starting points of rays."""

import re
from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.kernels.library import NUMPY, available
from lensfield.engine.library import bundled_names, prescription_of
from lensfield.engine.prescription import glasses
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.prescription.surfaces import refracted
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.aiming import aim_at_image
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.rays import FullPupil, HalfPupil, trace_pupil
from lensfield.engine.rays.rings import Rings, turned
from loops import using
from refusals import refused

INDEX = 1.5
PUPIL, DENSE = HalfPupil(7, 9), HalfPupil(9, 11)


def hyperbola(focal_mm=20.0, f_number=1.5):
    """Flat in front, with a rear hyperboloid of conic -n^2: every axial ray meets at its focus."""
    surfaces = (Surface(thickness_mm=8.0, glass="1.5/1e9", stop=True),
                Surface(-(INDEX - 1) * focal_mm, focal_mm, conic=-INDEX**2))
    return Prescription("hyperbola", surfaces, ("f_number", f_number), ("angle_deg", 5.0))


@pytest.fixture(autouse=True)
def one_index(monkeypatch):
    """Glass without dispersion."""
    monkeypatch.setattr(glasses.ModelGlass, "at", lambda glass, nm: np.full(np.shape(nm), glass.index))
    monkeypatch.setattr(glasses, "MODEL_GLASS", re.compile(r"([\d.]+)/([\d.e]+)"))


def test_a_hyperboloid_focuses_all_axial_rays_over_equal_paths():
    rays = trace_pupil(build_system(hyperbola()), [0.0], [550.0], PUPIL)
    assert not rays.lost.any()
    np.testing.assert_allclose(rays.position_mm, 0, atol=1e-11)
    np.testing.assert_allclose(rays.path_mm, rays.path_mm[0, 0, 0, 0], rtol=0, atol=1e-11)


def test_first_order_figures_of_a_plano_convex_lens():
    system = system_of(hyperbola())
    assert system.efl_mm == pytest.approx(20.0, rel=1e-12) and system.image_distance_mm == pytest.approx(20.0)
    assert system.entrance_pupil_mm == 0 and system.front_focus_mm == pytest.approx(20.0 - 8.0 / INDEX)
    assert system.exit_pupil_mm == pytest.approx(1 / ((INDEX - 1) / 20.0 / (INDEX - 1) - INDEX / 8.0))
    assert system.stop_semi_aperture_mm == pytest.approx(20.0 / 1.5 / 2)
    np.testing.assert_allclose(system.marginal_heights_mm, system.stop_semi_aperture_mm)


@pytest.mark.parametrize("distance_mm", [60.0, 400.0])
def test_the_magnification_of_near_objects_follows_newton(distance_mm):
    system = build_system(replace(hyperbola(f_number=8.0), object_distance_mm=distance_mm, focus="paraxial",
                                  field=("image_height_mm", 2.0)))
    from_focus_mm = distance_mm - system.front_focus_mm
    assert system.magnification == pytest.approx(-20.0 / from_focus_mm, rel=1e-12)
    assert system.image_distance_mm - 20.0 == pytest.approx(20.0**2 / from_focus_mm, rel=1e-12)


@pytest.mark.parametrize("aperture, semi_mm", [
    (("entrance_pupil_diameter_mm", 6.0), 3.0), (("f_number", 4.0), 2.5), (("stop", 1.7), 1.7)])
def test_the_stop_has_the_size_that_the_aperture_requires(aperture, semi_mm):
    lens = replace(hyperbola(), aperture=aperture)
    assert system_of(lens).stop_semi_aperture_mm == pytest.approx(semi_mm, rel=1e-12)
    assert system_of(replace(lens, object_distance_mm=100.0)).stop_semi_aperture_mm == pytest.approx(semi_mm, rel=1e-12)


def test_apertures_of_near_objects():
    near = replace(hyperbola(), object_distance_mm=100.0)
    assert system_of(replace(near, aperture=("object_na", 0.03))).stop_semi_aperture_mm == pytest.approx(
        100 * np.tan(np.arcsin(0.03)), rel=1e-12)
    working = system_of(replace(near, aperture=("working_f_number", 4.0)))
    assert abs(working.marginal_slope) == pytest.approx(1 / 8, rel=1e-12)


def test_snells_law():
    angle = np.linspace(0, 0.7, 8)
    direction = np.stack([np.sin(angle), 0 * angle, np.cos(angle)])
    normal = np.broadcast_to(np.array([[0.0], [0.0], [1.0]]), direction.shape)
    inside = refracted(direction, normal, 1 / INDEX)
    np.testing.assert_allclose(INDEX * inside[0], np.sin(angle), atol=1e-15)
    np.testing.assert_allclose(np.sum(inside**2, axis=0), 1, atol=1e-15)
    np.testing.assert_allclose(refracted(inside, normal, INDEX), direction, atol=1e-15)
    with np.errstate(invalid="ignore"):
        assert np.isnan(refracted(direction, normal, 3.0)[:, -1]).all(), "total reflection"


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", bundled_names())
def test_paths_and_landing_points_agree_by_fermats_principle(name):
    """The slope of a wavefront is the ray: the path's derivative over the beam gives the landing point, to first order.
    """
    system = system_of(prescription_of(name))
    rays = trace_pupil(system, np.array([0.3, 0.8]) * system.last_height_mm, [550.0], FullPupil(2, 4))
    step = FullPupil(1, 1)
    step.x, step.y = np.array([[0.0, 1e-3]]), np.array([[0.0, 0.0]])
    neighbours = trace_pupil(system, np.array([0.3, 0.8]) * system.last_height_mm, [550.0], step)
    moved = neighbours.position_mm[..., 1] - neighbours.position_mm[..., 0]
    along = np.sum(moved * (neighbours.direction[:2, ..., 1] + neighbours.direction[:2, ..., 0]) / 2, axis=0)
    path_mm = neighbours.path_mm[..., 1] - neighbours.path_mm[..., 0]
    np.testing.assert_allclose(path_mm, along, rtol=1e-3, atol=2e-12)  # ten orders below the paths themselves
    assert not rays.lost[..., 0, :].any()


def test_a_field_that_no_ray_reaches_is_an_error_that_names_it():
    lens = replace(hyperbola(), field=("angle_deg", 89.0))
    with pytest.raises(LensError, match="hyperbola: field height is .* no ray gets through the middle of the stop"):
        system = system_of(lens)
        trace_pupil(system, [system.last_height_mm], [550.0], PUPIL)


def test_a_glass_undefined_at_a_wavelength_is_named():
    lens = replace(hyperbola(), surfaces=(replace(hyperbola().surfaces[0], glass="SCHOTT N-BK7"),
                                          hyperbola().surfaces[1]))
    with refused(LensError, field="surface 1, glass", value="SCHOTT N-BK7", where="hyperbola"):
        trace_pupil(system_of(lens), [0.0], [200.0], PUPIL)


def odd_lens(**changes):
    """A strong lens with terms of both parities, and with surfaces that some rays miss or that reflect them."""
    surfaces = (Surface(30.0, 4.0, "1.8/1e9", conic=-0.4, aspheric=(1e-4, 3e-6)), Surface(-60.0, 3.0), Surface(
        thickness_mm=2.0, stop=True), Surface(-9.0, 2.0, "1.6/1e9", conic=0.3, odd_aspheric=(1e-3, 2e-4)), Surface(
        -12.0, 30.0, aspheric=(0.0, -2e-5, 1e-8)))
    lens = Prescription("odd", surfaces, ("stop", 7.5), ("angle_deg", 24.0), focus="as given")
    return replace(lens, **changes)


def traced_by(loops, system, heights_mm, wavelengths_nm=(420.0, 550.0, 680.0), pupil=DENSE):
    with using(loops):
        return trace_pupil(system, heights_mm, wavelengths_nm, pupil)


def assert_same_rays(compiled, plain, size_mm):
    """Rays of `aim` are at their object points to 2e-12 rad: their other ends differ by some times as much."""
    np.testing.assert_array_equal(compiled.lost, plain.lost)
    kept = ~plain.lost
    for quantity in ("position_mm", "direction", "path_mm", "source", "square_height_mm2"):
        one, other = (np.broadcast_to(getattr(rays, quantity), (*getattr(rays, quantity).shape[:-4], *kept.shape))
                      for rays in (compiled, plain))
        np.testing.assert_allclose(one[..., kept], other[..., kept], rtol=1e-11, atol=1e-11 * size_mm)


compiled_only = pytest.mark.skipif(len(available()) < 2, reason="no library of the loops: no compiler")


@compiled_only
@pytest.mark.sample(8)
@pytest.mark.parametrize("name", bundled_names())
@pytest.mark.parametrize("rings", [Rings(), Rings(2500.0, 5.6), Rings(900.0, 2.8)], ids=["at rest", "near", "close"])
def test_compiled_rays_of_the_library_match_numpy(name, rings):
    system = build_system(turned(prescription_of(name), rings).prescription)
    heights_mm = np.array([0.0, 0.3, 0.8, 1.0]) * system.last_height_mm
    plain, compiled = (traced_by(loops, system, heights_mm, pupil=FullPupil(7, 12)) for loops in
                       (NUMPY, available()[-1]))
    assert_same_rays(compiled, plain, system.last_height_mm)


@compiled_only
@pytest.mark.parametrize("distance_mm", [np.inf, 300.0, 75.0])
def test_compiled_rays_through_odd_terms_and_past_rims_match_numpy(distance_mm):
    system = system_of(odd_lens(object_distance_mm=distance_mm))
    heights_mm = np.array([0.0, 0.5, 1.0]) * system.last_height_mm
    plain, compiled = (traced_by(loops, system, heights_mm) for loops in (NUMPY, available()[-1]))
    assert_same_rays(compiled, plain, system.last_height_mm)
    assert plain.lost.any() and not plain.lost.all(axis=(-2, -1)).any()


@compiled_only
def test_compiled_rays_to_image_points_match_numpy():
    system, (x_mm, y_mm) = system_of(odd_lens()), np.random.default_rng(4).uniform(-7, 7, (2, 61))
    heights_mm, indices = np.array([0.0, 2.5, 6.0]), system.indices_at([420.0, 680.0])
    found = {}
    for loops in (NUMPY, available()[-1]):
        with using(loops):
            *slopes, aimed = aim_at_image(system, indices, heights_mm, x_mm, y_mm)
            found[loops] = np.where(aimed, slopes, np.nan)
    plain, compiled = found.values()
    np.testing.assert_allclose(compiled, plain, rtol=0, atol=1e-11)
    assert np.isfinite(plain).any() and np.isnan(plain).any()
