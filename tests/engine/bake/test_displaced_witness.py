"""Rays of toroids, cylinders and displaced lenses, by Optiland and rayoptics, if installed by `make test-bake`."""

import numpy as np
import pytest

pytest.importorskip("optiland", reason="the witness of tracing is Optiland: make test-bake")
pytest.importorskip("rayoptics", reason="the witness of displacements is rayoptics: make test-bake")

from optiland.rays import RealRays  # noqa: E402

from displaced_witness import CASES, MOST_MM, MOST_WAVES, Displaced  # noqa: E402
from lensfield.engine.prescription.prescription import Pose, Prescription, Surface  # noqa: E402
from lensfield.engine.prescription.surfaces import from_surface_frame  # noqa: E402
from lensfield.engine.prescription.system import system_of  # noqa: E402
from lensfield.engine.rays.trace import trace_both_ways  # noqa: E402
from optiland_witness import displaced_optic  # noqa: E402

NM = 550.0
LENS = Prescription("displaced", (
    Surface(-40.0, 3.0, "1.6/40", radius_x_mm=-25.0, profile="y", conic=-0.5, aspheric=(1e-4, 2e-5)),
    Surface(60.0, 8.0, radius_x_mm=35.0, profile="y", aspheric=(0.0, -2e-5),
            pose=Pose((0.3, -0.2, 0.1), (3.0, 1.5, -20.0))),
    Surface(thickness_mm=3.0, stop=True, pose=Pose((0.3, 0.2, -0.1), (4.0, -3.0, 0.0))),
    Surface(thickness_mm=4.0, glass="1.5/60", radius_x_mm=30.0, conic_x=-1.0, pose=Pose(tilt_deg=(0.0, 0.0, 10.0))),
    Surface(-18.0, 40.0, conic=-0.3, pose=Pose((-0.4, 0.3, 0.0), (-2.0, 5.0, 10.0)))),
    ("stop", 4.0), ("angle_deg", 10.0), image_pose=Pose((0.5, -0.3, 0.2), (8.0, -5.0, 30.0)))


def test_rays_of_displaced_surfaces():
    indices = system_of(LENS).indices_at([NM])
    most = np.reshape([4.0, 4.0, 0.1, 0.1], (4, 1, 1))
    x, y, slope_x, slope_y = most * np.random.default_rng(7).uniform(-1, 1, (4, 1, 60))
    ours = trace_both_ways(LENS, indices[:, :, None], x, y, slope_x, slope_y)
    start, before = (ours.entry - 2 * ours.before)[:, 0], ours.before[:, 0]
    optic, image_mm = displaced_optic(LENS, indices[:, 0])
    theirs = RealRays(*start, *before, np.ones(60), np.full(60, NM * 1e-3))
    optic.surfaces.trace(theirs)
    position, direction = from_surface_frame(LENS.image_pose, ours.position[:, 0], ours.direction[:, 0])
    np.testing.assert_allclose(np.stack([theirs.x, theirs.y, theirs.z - image_mm]), position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.stack([theirs.L, theirs.M, theirs.N]), direction, rtol=0, atol=1e-10)
    np.testing.assert_allclose(theirs.opd - 2, ours.path_mm[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_copies_of_lenses(name):
    """Rays agree, and the displacements of the elements move them visibly."""
    lens = Displaced(name)
    difference, effect = lens.from_program(CASES[name]), lens.from_design()
    assert difference.chief_mm < MOST_MM and difference.waves < MOST_WAVES
    assert effect.chief_mm > 0.02 and effect.waves > 1
