"""The steep aspheres of phone lenses: vertex, shape and ray intersections."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine.library import BUNDLED
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.prescription.readers import read_prescription
from lensfield.engine.prescription.surfaces import distance_to, sag_and_slope, unit_normal
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.rays import HalfPupil, trace_pupil

SURFACES = {"conic and powers": Surface(3.0, conic=-0.7, aspheric=(0.0, 2e-3, -1e-4, 3e-6)),
            "a term in r^2": Surface(-8.0, conic=2.0, aspheric=(0.03, -1e-3)),
            "no conic": Surface(aspheric=(0.05, 1e-3)),
            "odd powers": Surface(6.0, conic=-1.0, aspheric=(0.0, 1e-3), odd_aspheric=(0.0, 2e-3, -4e-4))}
surfaces = pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES)


def sag_mm(surface, radius_mm):
    """The textbook formula for the sag of a conic with even powers."""
    curvature, square = 1 / surface.radius_mm, radius_mm**2
    conic = curvature * square / (1 + np.sqrt(1 - (1 + surface.conic) * curvature**2 * square))
    return (conic + sum(term * square**power for power, term in enumerate(surface.aspheric, 1))
            + sum(term * radius_mm**(2 * power + 1) for power, term in enumerate(surface.odd_aspheric)))


def place_on(surface, x, y):
    return np.stack([x, y, sag_and_slope(surface, x**2 + y**2)[0]])


@surfaces
def test_the_sag_is_the_conic_plus_powers(surface):
    x, y = np.random.default_rng(1).uniform(-1, 1, (2, 50))
    np.testing.assert_allclose(place_on(surface, x, y)[2], sag_mm(surface, np.hypot(x, y)), rtol=0, atol=1e-14)


@surfaces
def test_the_normal_is_perpendicular_to_the_surface(surface):
    step = 1e-6
    x, y = np.random.default_rng(2).uniform(-1, 1, (2, 50))
    nx, ny, nz = unit_normal(surface, place_on(surface, x, y))
    along_x = (place_on(surface, x + step, y) - place_on(surface, x - step, y))[2] / (2 * step)
    along_y = (place_on(surface, x, y + step) - place_on(surface, x, y - step))[2] / (2 * step)
    np.testing.assert_allclose([nx + nz * along_x, ny + nz * along_y], 0, atol=1e-8)
    np.testing.assert_allclose(nx**2 + ny**2 + nz**2, 1, atol=1e-14)


@surfaces
@pytest.mark.parametrize("side", [1, -1])
def test_rays_end_on_the_surface(surface, side):
    """From either side, because rays are also traced backwards from the stop to the object."""
    rng = np.random.default_rng(3)
    x, y, slope_x, slope_y = rng.uniform(-0.6, 0.6, (4, 50))
    direction = side * np.stack([slope_x, slope_y, np.ones(50)]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    start = np.stack([x, y, np.full(50, -float(side))])
    end = start + distance_to(surface, start, direction) * direction
    np.testing.assert_allclose(end[2], sag_mm(surface, np.hypot(*end[:2])), rtol=0, atol=1e-12)


def singlet(surface):
    return Prescription("singlet", (replace(surface, thickness_mm=1.0, glass="1.5/60", stop=True),
                                    Surface(thickness_mm=20.0)), ("entrance_pupil_diameter_mm", 1.0),
                        ("angle_deg", 5.0), focus="paraxial")


def test_a_term_in_r2_bends_paraxial_rays():
    """A parabola is a conic of -1, or a plane with a term in r^2."""
    as_conic, as_power = (build_system(singlet(surface)) for surface in
                          (Surface(10.0, conic=-1.0), Surface(aspheric=(0.05,))))
    assert as_power.efl_mm == pytest.approx(as_conic.efl_mm, rel=1e-12)
    heights = [trace_pupil(system, [1.0], [550.0], HalfPupil(9, 9)).position_mm for system in (as_conic, as_power)]
    np.testing.assert_allclose(heights[0], heights[1], atol=1e-9)


def test_a_phone_lens_loses_no_ray_of_its_field():
    """Rays to its corner miss the conic of a surface and hit the asphere."""
    phone = build_system(read_prescription(BUNDLED / "prescriptions" / "apple-phone-4mm.toml"))
    heights_mm = np.array([0.0, 0.7, 1.0]) * phone.last_height_mm
    rays = trace_pupil(phone, heights_mm, [550.0], HalfPupil(9, 13))
    inside = np.all(rays.square_height_mm2 <= phone.semi_apertures_mm[:, None, None, None, None]**2, axis=0)
    assert not rays.lost[..., 0, :].any() and np.all(np.mean(rays.lost | ~inside, axis=(2, 3)) < 0.5)
    np.testing.assert_allclose(rays.chief_height_mm[0], heights_mm, rtol=0.005)
