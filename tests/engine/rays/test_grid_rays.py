"""Tables of rays over x and y: rays through the stop are traced both ways, and the table returns the same rays."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from afocal import AFOCAL
from lensfield.engine import LensError
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.prescription import Pose
from lensfield.engine.rays.fields import view_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.grid_rays import grid_ray_table
from lensfield.engine.rays.ray_table import ray_table
from lensfield.engine.rays.trace import trace_both_ways
from lensfield.engine.rays.view import tilted
from refusals import refused

pytestmark = pytest.mark.one_blender
NM = (500.0, 600.0)


@cache
def triplet():
    return build_system(prescription_of("cooke-triplet-50mm"))


def decentred():
    surfaces = list(triplet().prescription.surfaces)
    surfaces[2] = replace(surfaces[2], pose=Pose((0.2, -0.1, 0.0), (0.3, 0.2, 0.0)))
    return replace(triplet().prescription, surfaces=tuple(surfaces))


def anamorphic():
    prescription = triplet().prescription
    return replace(prescription, surfaces=AFOCAL + prescription.surfaces)


LENSES = {
    "anamorphic": (anamorphic, (0.0, 7.0), (0.0, 9.0), (True, True)),
    "tilted": (lambda: tilted(triplet(), (5.0, 0.0)), (-7.0, 8.0), (0.0, 10.0), (False, True)),
    "decentred": (decentred, (-7.0, 8.0), (-9.0, 10.0), (False, False)),
}


@pytest.mark.parametrize("name", LENSES)
def test_it_contains_the_rays_that_are_traced_from_the_stop(name):
    """From places in all quadrants, to 0.3 um on the sensor; rims to 1 % of the semi-aperture."""
    prescription, y_mm, x_mm, mirrored = LENSES[name]
    system = build_system(prescription())
    table, view = grid_ray_table(system.prescription, y_mm, x_mm, mirrored, NM), view_of(system)
    rng = np.random.default_rng(1)
    radius, azimuth = np.sqrt(rng.uniform(0, 1, 200)), rng.uniform(0, 2 * np.pi, 200)
    stop, slope = radius * np.stack([np.sin(azimuth), np.cos(azimuth)]), rng.uniform(-0.25, 0.25, (2, 200))
    true = trace_both_ways(system.prescription, system.indices_at(NM[:1])[:, :, None],
                           *(system.stop_semi_aperture_mm * stop)[:, None], *slope[:, None])
    place_mm, entry = view.places_mm(true.position)[:, 0], view.turned(true.entry)[:, 0]
    before = view.turned(true.before)[:, 0]
    first_mm = [-last if of_axis else first for (first, last), of_axis in
                zip((x_mm, y_mm), mirrored[::-1], strict=True)]
    covered = np.all((place_mm > np.reshape(first_mm, (2, 1))) & (place_mm < [[x_mm[1]], [y_mm[1]]]), axis=0)
    assert covered.sum() > 40 and all((place_mm[axis, covered] < 0).any() for axis in (0, 1))
    margin = 1 - np.max(true.square_mm2[:, 0] / system.semi_apertures_mm[:, None]**2, axis=0)
    entry -= view.turned(view.viewpoint_mm)[:, None]
    for ray in np.flatnonzero(covered & (margin > -0.2)):
        rays = table.bundles(place_mm[:1, ray], place_mm[1:, ray], stop[:, ray:ray + 1])
        tangent = before[:2, ray] / before[2, ray]
        expected_mm = entry[:2, ray] - entry[2, ray] * tangent
        direction = rays.direction[:, 0, 0, 0, 0]
        assert system.efl_mm * (direction[:2] / direction[2] - tangent) == pytest.approx(0, abs=3e-4)
        assert rays.entrance_mm[:, 0, 0, 0, 0] == pytest.approx(expected_mm, abs=2e-3)
        assert rays.surface_margin[0, 0, 0, 0] == pytest.approx(margin[ray], abs=0.01)
        single = table.rays(0, place_mm[:, ray], stop[:, ray])
        for name in ("entrance_mm", "direction", "surface_margin", "path_mm", "weight"):
            assert getattr(single, name) == pytest.approx(np.squeeze(getattr(rays, name))[..., 0], abs=1e-9)


def test_a_rotationally_symmetric_lens_has_the_rays_of_its_heights():
    rays = ray_table(triplet().prescription, NM)
    table = grid_ray_table(triplet().prescription, (-9.0, 10.0), (0.0, 15.0), (False, True), NM)
    x_mm, y_mm = np.array([-14.0, -3.0, 0.0, 8.0]), np.array([-8.5, 0.5, 7.0])
    stop = np.random.default_rng(2).uniform(-0.7, 0.7, (2, 50))
    mesh = table.bundles(x_mm, y_mm, stop)
    expected = rays.rays(np.arange(2)[:, None, None, None], np.stack(np.meshgrid(x_mm, y_mm))[..., None],
                         stop[:, None, None])
    for name, most in {"entrance_mm": 2e-4, "direction": 5e-6, "surface_margin": 0.01, "path_mm": 2e-4}.items():
        np.testing.assert_allclose(getattr(mesh, name), getattr(expected, name), atol=most)
    np.testing.assert_allclose(mesh.weight, expected.weight, rtol=2e-4)
    np.testing.assert_allclose(table.irradiance_per_radiance(x_mm, y_mm),
                               rays.irradiance_per_radiance(np.hypot(x_mm, y_mm[:, None]).ravel()).reshape(2, 3, 4),
                               rtol=1e-4)


def test_it_continues_beyond_the_places_that_rays_reach():
    """Corners of a rectangle around a round field: dark or not, its rays are finite and continue smoothly."""
    last_mm = float(ray_table(triplet().prescription, NM).last_height_mm)
    table = grid_ray_table(triplet().prescription, (0.0, 2 * last_mm), (0.0, 2.5 * last_mm), (True, True), NM,
                           sketch=True)
    rays = table.bundles(np.linspace(0, 2.5 * last_mm, 9), np.linspace(0, 2 * last_mm, 9), np.zeros((2, 1)))
    assert np.isfinite(rays.direction).all() and np.isfinite(rays.entrance_mm).all()


def test_a_sensor_that_no_light_reaches_is_refused_in_one_line():
    steep = replace(triplet().prescription, image_pose=Pose(tilt_deg=(80.0, 0.0, 0.0)))
    with refused(LensError, field="image_pose", where="cooke-triplet-50mm",
                 match="no light reaches the sensor: tilt it less"):
        grid_ray_table(steep, (-1.0, 1.0), (0.0, 1.0), (False, True), NM)
