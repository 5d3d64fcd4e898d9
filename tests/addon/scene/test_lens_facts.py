"""Facts about lenses without rotational symmetry; the panel's tests cover the others."""

import numpy as np
import pytest

from lenses import fine_grid_lens
from lensfield.addon.scene.lens_facts import lens_facts
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.rays.rings import Rings

pytestmark = pytest.mark.one_blender


def test_a_package_has_its_angles_across_and_up(tmp_path):
    """Focal lengths of 10.5 mm along the height and 5.25 mm along the width; a shifted picture loses its symmetry."""
    write_package(fine_grid_lens(squeeze=2.0), tmp_path / "lens.npz")
    facts = lens_facts(str(tmp_path / "lens.npz"))
    assert not facts.radial and facts.squeeze == 2
    across_deg, up_deg, covered = facts.field_on((-2.4, -1.8, 2.4, 1.8))
    assert across_deg == pytest.approx(2 * np.degrees(np.arctan(2.4 / 5.25)), abs=0.01)
    assert up_deg == pytest.approx(2 * np.degrees(np.arctan(1.8 / 10.5)), abs=0.01)
    assert covered == 1
    _, up_deg, covered = facts.field_on((-2.4, -0.8, 2.4, 2.8))
    assert up_deg == pytest.approx(np.degrees(np.arctan(0.8 / 10.5) + np.arctan(1.8 / 10.5)), abs=0.01)
    assert covered == pytest.approx(3 / np.hypot(2.4, 2.8))


def test_a_tilted_lens_is_not_radial_and_keeps_its_view():
    design, tilted = (lens_facts("tessar-50mm", each) for each in (Rings(), Rings(tilt_deg=(4.0, 0.0))))
    assert design.radial and not tilted.radial
    assert tilted.field_on((-18, -12, 18, 12))[:2] == pytest.approx(design.field_on((-18, -12, 18, 12))[:2], rel=0.02)
