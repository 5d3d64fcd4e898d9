"""Rays through lenses without rotational symmetry, against a second tracer, and in the compiled loops."""

from dataclasses import replace

import numpy as np
import pytest

from crooked_lens import CROOKED
from implicit_surfaces import traced
from lensfield.engine.kernels.library import available
from lensfield.engine.prescription.prescription import Pose, Surface
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.trace import trace_both_ways, trace_from_image
from loops import using

pytestmark = pytest.mark.one_blender
NM = 550.0
every_loop = pytest.mark.parametrize("loops", available())


def rays_of(lens, count=40):
    """Refractive indices; rays through points of the stop, traced both ways; and these points: arrays (1, ray)."""
    most = np.reshape([4.0, 4.0, 0.1, 0.1], (4, 1, 1))
    x, y, slope_x, slope_y = most * np.random.default_rng(6).uniform(-1, 1, (4, 1, count))
    indices = system_of(lens).indices_at([NM])
    return indices, trace_both_ways(lens, indices[:, :, None], x, y, slope_x, slope_y), (x, y)


@every_loop
def test_rays_match_a_search_for_roots(loops):
    """Among these, rays through points of the displaced stop, in its own frame."""
    with using(loops):
        indices, rays, (x, y) = rays_of(CROOKED)
    for ray in range(x.size):
        entry, before = rays.entry[:, 0, ray], rays.before[:, 0, ray]
        position, direction, path_mm, square_mm2 = traced(CROOKED, indices[:, 0], entry - before, before)
        np.testing.assert_allclose(rays.position[:, 0, ray], position, rtol=0, atol=1e-8)
        np.testing.assert_allclose(rays.direction[:, 0, ray], direction, rtol=0, atol=1e-9)
        np.testing.assert_allclose(rays.path_mm[0, ray] + 1, path_mm, rtol=0, atol=1e-8)
        np.testing.assert_allclose(rays.square_mm2[:, 0, ray], square_mm2, rtol=0, atol=1e-7)
    np.testing.assert_allclose(rays.square_mm2[CROOKED.stop_index], x**2 + y**2, atol=1e-12)


@pytest.mark.skipif(len(available()) < 2, reason="no library of the loops: no compiler")
@pytest.mark.parametrize("stop", range(5))
def test_compiled_rays_match_numpy(stop):
    """With every kind of surface as the stop."""
    surfaces = (replace(surface, stop=number == stop) for number, surface in enumerate(CROOKED.surfaces))
    lens, results = replace(CROOKED, surfaces=tuple(surfaces)), []
    for loops in available():
        with using(loops):
            results.append(np.concatenate([each.reshape(-1, 40) for each in rays_of(lens)[1]]))
    for compiled in results[1:]:
        np.testing.assert_array_equal(compiled, results[1])
        np.testing.assert_allclose(compiled, results[0], rtol=0, atol=1e-11)
    assert np.isfinite(results[0]).all()


def test_rays_return_from_the_image_plane():
    indices, rays, _ = rays_of(CROOKED)
    entry, before, _, squares_mm2 = trace_from_image(CROOKED, indices[:, :, None], rays.position, rays.direction)
    np.testing.assert_allclose(entry, rays.entry, atol=1e-11)
    np.testing.assert_allclose(before, rays.before, atol=1e-12)
    np.testing.assert_allclose(np.sum(squares_mm2, axis=1), rays.square_mm2, atol=1e-10)


@every_loop
@pytest.mark.parametrize("profile", ["", "x", "y"])
def test_equal_sections_trace_as_surfaces_of_revolution(loops, profile):
    spheres = (Surface(30.0, 3.0, "1.6/40"), Surface(-50.0, 3.0), Surface(thickness_mm=2.0, stop=True),
               Surface(-25.0, 2.0, "1.7/30"), Surface(-40.0, 35.0))
    sections = tuple(replace(each, radius_x_mm=each.radius_mm, profile=profile) for each in spheres)
    lenses = (replace(CROOKED, surfaces=surfaces, image_pose=pose) for surfaces, pose in
              ((spheres, None), (sections, Pose())))
    with using(loops):
        for radial, other in zip(*(rays_of(lens)[1] for lens in lenses), strict=True):
            np.testing.assert_allclose(other, radial, rtol=1e-12, atol=1e-12)


@every_loop
def test_a_sphere_that_turns_about_its_centre_stays(loops):
    turn, radius = np.radians(7.0), 22.0
    about_centre = Pose((0.0, radius * np.sin(turn), radius * (1 - np.cos(turn))), (7.0, 0.0, 0.0))
    behind = Surface(-60.0, 2.0), Surface(thickness_mm=30.0, stop=True)
    lenses = (replace(CROOKED, surfaces=(Surface(radius, 4.0, "1.6/40", pose=pose), *behind)) for pose in
              (None, about_centre))
    with using(loops):
        centred, turned = (rays_of(lens)[1] for lens in lenses)
    for quantity in ("before", "entry", "path_mm"):
        np.testing.assert_allclose(getattr(turned, quantity), getattr(centred, quantity), atol=1e-11)
