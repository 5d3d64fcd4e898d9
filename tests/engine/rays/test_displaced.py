"""Rays through lenses without rotational symmetry, against a second tracer, and in the compiled loops."""

from dataclasses import replace

import numpy as np
import pytest

from implicit_surfaces import traced
from lensfield.engine.kernels.library import NUMPY, available
from lensfield.engine.prescription.prescription import Pose, Prescription, Surface
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.trace import trace_both_ways, trace_from_image
from loops import using

NM = 550.0
EVERY = pytest.mark.parametrize("loops", available())


def crooked(**changes):
    """An anamorphic lens of every kind of surface, each displaced, with a displaced stop and a tilted sensor."""
    surfaces = (
        Surface(-40.0, 3.0, "1.6/40", radius_x_mm=-25.0, conic=-0.5, aspheric=(0.0, 1e-5), skews=(0.0, 0.4),
                pose=Pose((0.2, -0.1, 0.05), (1.0, -2.0, 3.0))),
        Surface(60.0, 8.0, radius_x_mm=35.0, profile="y", aspheric=(0.0, -2e-5), pose=Pose(tilt_deg=(0.0, 1.5, -20.0))),
        Surface(thickness_mm=1.0, stop=True, pose=Pose((0.3, 0.2, -0.1), (4.0, -3.0, 0.0))),
        Surface(np.inf, 4.0, "1.5/60", radius_x_mm=80.0, profile="x", conic_x=-1.0),
        Surface(-18.0, 40.0, conic=-0.3, semi_aperture_mm=6.0, pose=Pose((-0.4, 0.3, 0.0), (-2.0, 0.0, 10.0))))
    lens = Prescription("crooked", surfaces, ("stop", 4.0), ("angle_deg", 10.0),
                        image_pose=Pose((0.5, -0.3, 0.2), (8.0, -5.0, 30.0)))
    return replace(lens, **changes)


def rays_of(lens, count=40):
    """Stop points and slopes, and the rays traced both ways from there: arrays (wavelength 1, ray)."""
    x, y, slope_x, slope_y = np.random.default_rng(6).uniform(-1, 1, (4, 1, count)) * np.reshape([4, 4, 0.1, 0.1], (4, 1, 1))
    indices = system_of(lens).indices_at([NM])
    return indices, trace_both_ways(lens, indices[:, :, None], x, y, slope_x, slope_y), (x, y)


@EVERY
def test_rays_match_a_search_for_roots(loops):
    """Among these, rays to the stop land at its points, in its own frame, and heights count from displaced axes."""
    lens = crooked()
    with using(loops):
        indices, rays, (x, y) = rays_of(lens)
    for ray in range(x.size):
        entry, before = rays.entry[:, 0, ray], rays.before[:, 0, ray]
        place, along, path_mm, squares = traced(lens, indices[:, 0], entry - before, before)
        np.testing.assert_allclose(rays.position[:, 0, ray], place, rtol=0, atol=1e-8)
        np.testing.assert_allclose(rays.direction[:, 0, ray], along, rtol=0, atol=1e-9)
        np.testing.assert_allclose(rays.path_mm[0, ray], path_mm - 1, rtol=0, atol=1e-8)
        np.testing.assert_allclose(rays.square_mm2[:, 0, ray], squares, rtol=0, atol=1e-7)
    np.testing.assert_allclose(rays.square_mm2[2], x**2 + y**2, atol=1e-12)


@pytest.mark.skipif(len(available()) < 2, reason="no library of the loops: no compiler")
@pytest.mark.parametrize("stop", range(5))
def test_compiled_rays_match_numpy(stop):
    """With every kind of surface as the stop."""
    lens = crooked()
    lens = replace(lens, surfaces=tuple(replace(surface, stop=number == stop) for number, surface in
                                        enumerate(lens.surfaces)))
    results = []
    for loops in available():
        with using(loops):
            results.append(np.concatenate(rays_of(lens)[1][:4] + tuple(np.atleast_3d(each).reshape(-1, 1, 40) for each in
                                                                   rays_of(lens)[1][4:])))
    for compiled in results[1:]:
        np.testing.assert_array_equal(compiled, results[1])
        np.testing.assert_allclose(compiled, results[0], rtol=0, atol=1e-11)
    assert np.isfinite(results[0]).all()


def test_rays_return_from_the_image_plane():
    lens = crooked()
    indices, rays, _ = rays_of(lens)
    entry, before, path_mm, squares = trace_from_image(lens, indices[:, :, None], rays.position, rays.direction)
    np.testing.assert_allclose(entry, rays.entry, atol=1e-11)
    np.testing.assert_allclose(before, rays.before, atol=1e-12)
    np.testing.assert_allclose(np.stack(squares), rays.square_mm2, atol=1e-10)


@EVERY
@pytest.mark.parametrize("profile", ["", "x", "y"])
def test_equal_sections_trace_as_surfaces_of_revolution(loops, profile):
    """Of a lens of spheres, to 1e-12."""
    spheres = (Surface(30.0, 3.0, "1.6/40"), Surface(-50.0, 3.0), Surface(thickness_mm=2.0, stop=True),
               Surface(-25.0, 2.0, "1.7/30"), Surface(-40.0, 35.0))
    radial = crooked(surfaces=spheres, image_pose=None)
    sections = crooked(surfaces=tuple(replace(each, radius_x_mm=each.radius_mm, profile=profile) for each in spheres),
                       image_pose=Pose())
    with using(loops):
        for one, other in zip(rays_of(radial)[1], rays_of(sections)[1], strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


@EVERY
def test_a_displaced_sphere_is_one_with_another_centre(loops):
    """Turned about its vertex by a and moved by radius * sin(a), a sphere stays on its centre, except along the axis."""
    tilt, radius = np.radians(7.0), 22.0
    pose = Pose((0.0, radius * np.sin(tilt), radius * (np.cos(tilt) - 1) * -1), (7.0, 0.0, 0.0))
    centred = (Surface(radius, 4.0, "1.6/40"), Surface(thickness_mm=30.0, stop=True))
    centred = (*centred[:1], Surface(-60.0, 2.0), replace(centred[1]))
    lenses = [crooked(surfaces=(replace(centred[0], pose=each), *centred[1:]), image_pose=None) for each in (None, pose)]
    with using(loops):
        plain, turned = (rays_of(lens)[1] for lens in lenses)
    np.testing.assert_allclose(turned.before, plain.before, atol=1e-12)
    np.testing.assert_allclose(turned.entry, plain.entry, atol=1e-11)
