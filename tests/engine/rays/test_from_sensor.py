"""Rays through a lens traced from the sensor, against rays through the same lens traced from its stop."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.prescription.surfaces import sag_and_slope
from lensfield.engine.prescription.tolerances import Copy
from lensfield.engine.rays.aiming import aim_at_image
from lensfield.engine.rays.fields import aim_at_places, find_fields, view_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.from_sensor import lens_from_sensor
from lensfield.engine.rays.rings import Rings, turned
from lensfield.engine.rays.trace import trace_both_ways

NM = 550.0
RAYS, HEIGHTS = 4000, 9
PLACES, STOP_POINTS = 40, 150
LOST = 3e-3  # rays that return to another sheet of a phone lens's aspheres, at its last height
lenses = pytest.mark.parametrize("name, f_number", [
    ("kodak-petzval-100mm", None), ("kodak-petzval-100mm", 16.0), ("nikkor-58mm-f1.4", None),
    ("nikkor-58mm-f1.4", 11.0), ("apple-phone-4mm", None), ("zeiss-distagon-25mm", None), ("edmund-54852", None)])


@cache
def lens(name, f_number):
    prescription = turned(prescription_of(name), Rings(None, f_number)).prescription
    right_mm, upper_mm = np.array([0.72, 0.54]) * build_system(prescription).last_height_mm
    return prescription, lens_from_sensor(prescription, NM, (-0.5 * right_mm, -upper_mm, right_mm, 0.0))


def rays_from_the_stop(prescription, farthest_mm):
    """Rays through random points of the stop that pass the lens.

    Returns their landing points (2, ray), and their crossings of the plane of the rear vertex (2, ray).
    """
    system, rng = build_system(prescription), np.random.default_rng(1)
    radius, azimuth = np.sqrt(rng.uniform(0, 1, RAYS)), rng.uniform(0, np.pi, RAYS)
    x_mm, y_mm = (system.stop_semi_aperture_mm * radius * turn(azimuth) for turn in (np.sin, np.cos))
    indices = system.indices_at([NM])
    slope_x, slope_y, aimed = aim_at_image(system, indices, np.linspace(0, farthest_mm, HEIGHTS), x_mm, y_mm)
    with np.errstate(invalid="ignore"):
        traced = trace_both_ways(system.prescription, indices[:, :, None, None], x_mm, y_mm, slope_x, slope_y)
        through = aimed & np.isfinite(traced.path_mm)
        for square, semi_mm in zip(traced.square_mm2, system.semi_apertures_mm, strict=True):
            through &= square <= semi_mm**2
    landed, direction = traced.position[:2, through], traced.direction[:, through]
    return landed, landed - direction[:2] / direction[2] * system.prescription.surfaces[-1].thickness_mm


@lenses
def test_every_ray_that_gets_through_is_within_the_aim(name, f_number):
    prescription, optics = lens(name, f_number)
    aim = optics.aim
    landed, rear = rays_from_the_stop(prescription, aim.bin_mm * aim.low_mm.size)
    height = np.hypot(*landed)
    out = np.where(height > 0, landed / np.maximum(height, 1e-12), [[0.0], [1.0]])
    along, across = np.sum(rear * out, axis=0), rear[0] * out[1] - rear[1] * out[0]
    bins = np.minimum((height / aim.bin_mm).astype(int), aim.low_mm.size - 1)
    along -= aim.to_pupil * height
    assert height.size > RAYS
    aimed = (aim.low_mm[bins] <= along) & (along <= aim.high_mm[bins]) & (np.abs(across) <= aim.half_mm[bins])
    assert np.mean(~aimed) < LOST
    middle = bins == bins[np.argmin(np.abs(height - height.max() / 2))]  # where the rays rarely aim elsewhere
    assert np.ptp(along[middle]) > 0.7 * np.ptp([aim.low_mm[bins][middle], aim.high_mm[bins][middle]])


def copy_of(name, **rings):
    return turned(prescription_of(name), Rings(copy=Copy(7, "dropped"), **rings)).prescription


@pytest.mark.parametrize("prescription, edges_mm", [
    (lambda: prescription_of("cooke-42mm-2x"), (-4.0, -8.9, 10.6, 5.0)),
    (lambda: copy_of("cooke-triplet-50mm", tilt_deg=(4.0, -3.0)), (-14.0, -4.0, 6.0, 9.0))],
    ids=["anamorphic", "tilted copy"])
def test_every_ray_to_any_place_of_a_film_is_within_the_aim(prescription, edges_mm):
    """Rays through random points of the stop to places on a film that is off the axis and not square."""
    system, rng = build_system(prescription()), np.random.default_rng(2)
    view = view_of(system)
    places_mm = -rng.uniform(edges_mm[:2], edges_mm[2:], (PLACES, 2)).T  # the image is upside down
    aim = lens_from_sensor(prescription(), NM, edges_mm).aim
    radius, azimuth = np.sqrt(rng.uniform(0, 1, STOP_POINTS)), rng.uniform(0, 2 * np.pi, STOP_POINTS)
    stop_mm = system.stop_semi_aperture_mm * radius * np.stack([np.sin(azimuth), np.cos(azimuth)])
    slope, aimed = aim_at_places(system, view, find_fields(system, view, places_mm, [NM]), places_mm, *stop_mm)
    traced = trace_both_ways(system.prescription, system.indices_at([NM])[:, :, None, None], *stop_mm, *slope)
    passing = aimed[0] & np.all(traced.square_mm2[:, 0] <= system.semi_apertures_mm[:, None, None]**2, axis=0)
    landed, direction = traced.position[:2, 0, passing], traced.direction[:, 0, passing]
    beyond = landed * (1 - aim.to_pupil[:, None]) - aim.away_mm * direction[:2] / direction[2]
    column, row = ((landed - aim.first_mm[:, None]) / aim.cell_mm[:, None]).astype(int)
    low, high = aim.low_mm[:, row, column], aim.high_mm[:, row, column]
    assert passing.sum() > 0.5 * passing.size and np.all((low <= beyond) & (beyond <= high))
    assert np.all(np.ptp(beyond, axis=1) > 0.7 * (high.max(axis=1) - low.min(axis=1)))  # rays rarely aim elsewhere


def test_surfaces_are_reversed_in_the_order_of_the_rays():
    prescription, optics = lens("apple-phone-4mm", None)
    last = prescription.surfaces[-1]
    assert optics.gap_mm[0] == last.thickness_mm and optics.conic[-1] == prescription.surfaces[0].conic
    assert optics.semi_aperture_mm.min() == pytest.approx(build_system(prescription).stop_semi_aperture_mm, rel=0.5)
    np.testing.assert_allclose(np.prod(optics.index_ratio), 1)  # from air to air


@pytest.mark.parametrize("odd", [(), (2e-4, 0.0, -3e-6)])
def test_terms_reproduce_the_surface(odd):
    bent = Surface(30.0, 4.0, "1.6/50", 8.0, conic=-0.5, aspheric=(1e-4, -2e-6), odd_aspheric=odd, stop=True)
    lens = Prescription("bent", (bent, Surface(-40.0, 30.0)), ("stop", 5.0), ("image_height_mm", 5.0), focus="paraxial")
    optics = lens_from_sensor(lens, 587.5618, (-4.0, -3.0, 4.0, 3.0))
    r = np.linspace(0.1, 7, 20)
    powers = optics.first_power + optics.power_step * np.arange(optics.terms.shape[1])
    conic = optics.curvature_per_mm[-1] * r**2 / (
        1 + np.sqrt(1 - (1 + optics.conic[-1]) * optics.curvature_per_mm[-1]**2 * r**2))
    sag = conic + (r[:, None] ** powers) @ optics.terms[-1]
    np.testing.assert_allclose(sag, -sag_and_slope(bent, r**2)[0], rtol=1e-12)
    assert not optics.terms[0].any()


def test_no_rays_are_aimed_beyond_the_image_circle():
    prescription, _ = lens("olympus-fisheye-8mm", None)
    aim = lens_from_sensor(prescription, NM, (-24.0, -18.0, 24.0, 18.0)).aim
    assert aim.half_mm[0] > 0 and aim.half_mm[-1] == aim.low_mm[-1] == aim.high_mm[-1] == 0


def test_a_lens_with_only_a_stop_is_searched_to_its_full_width():
    prescription, known = lens("zeiss-distagon-25mm", None)
    bare = replace(prescription, surfaces=tuple(replace(surface, semi_aperture_mm=np.inf)
                                                for surface in prescription.surfaces))
    optics = lens_from_sensor(bare, NM, (-4.0, -3.0, 4.0, 3.0))
    np.testing.assert_allclose(optics.aim.half_mm[0], known.aim.half_mm[0], rtol=0.1)
