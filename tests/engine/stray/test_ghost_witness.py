"""Ghosts by batoid, which splits rays at every surface, if installed by `make test-bake`."""

import pytest

pytest.importorskip("batoid", reason="the witness of ghosts is batoid: make test-bake")

from ghost_witness import CASES, compared_rays, compared_sums  # noqa: E402

cases = pytest.mark.parametrize("case", CASES.values(), ids=CASES)


@cases
def test_rays_of_all_pairs(case):
    """Bare glass to the precision of the engine's table of reflectances, which is least near total reflection."""
    found = compared_rays(case)
    assert found.rays > 200 and not found.disputed
    assert found.nearly_total <= 2
    assert found.place_mm < 1e-9
    assert found.flux < 1e-12
    assert found.bare_flux < 0.03


@cases
def test_light_of_all_ghosts(case):
    found = compared_sums(case)
    assert found.total < 0.01
    assert found.bright < 0.1
    assert found.centre < 0.005
