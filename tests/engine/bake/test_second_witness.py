"""Rays and focal lengths by rayoptics, if installed by `make test-bake`: spheres, aspheres, near and far objects."""

import numpy as np
import pytest

pytest.importorskip("rayoptics", reason="the second witness of baking is rayoptics: make test-bake")

from rayoptics.elem.surface import DecenterData  # noqa: E402

from lens_texts import CODEV, changed  # noqa: E402
from lensfield.engine.library import BUNDLED  # noqa: E402
from lensfield.engine.prescription.readers import read_prescription  # noqa: E402
from lensfield.engine.rays.focus import build_system  # noqa: E402
from lensfield.engine.rays.rays import HalfPupil, trace_pupil  # noqa: E402
from rayoptics_witness import focal_length_mm, witness_ray  # noqa: E402

NAMES = ("angenieux-50mm", "apple-phone-4mm", "edmund-54852", "kodak-petzval-100mm", "nikkor-reflex-500mm",
         "nikkor-reflex-c-500mm")
PUPIL = HalfPupil(3, 5)
lenses = pytest.mark.parametrize("name", NAMES)


def system_of(name):
    return build_system(read_prescription(BUNDLED / "prescriptions" / f"{name}.toml"))


@lenses
def test_focal_lengths(name):
    system = system_of(name)
    assert focal_length_mm(system, system.prescription.reference_wavelength_nm) == pytest.approx(system.efl_mm,
                                                                                                 rel=1e-12)


@lenses
@pytest.mark.parametrize("share", [0.0, 0.5, 0.95])
@pytest.mark.parametrize("wavelength_nm", [420.0, 650.0])
def test_chief_rays_and_path_differences(name, share, wavelength_nm):
    """As precise as the aim, 1e-9 mm on the stop; the path error is of second order."""
    system = system_of(name)
    height_mm = share * system.last_height_mm
    ours = trace_pupil(system, [height_mm], [wavelength_nm], PUPIL)
    theirs = np.array([witness_ray(system, height_mm, wavelength_nm, x, y)
                       for x, y in system.stop_semi_aperture_mm * np.stack([PUPIL.x, PUPIL.y], axis=-1).reshape(-1, 2)])
    x, y, path_mm = theirs.T.reshape(3, *PUPIL.shape)
    np.testing.assert_allclose(ours.position_mm[:, 0, 0], [x, y], rtol=0, atol=1e-8)
    difference_mm = ours.path_mm[0, 0] - ours.path_mm[0, 0, 0, 0]
    np.testing.assert_allclose(difference_mm, path_mm - path_mm[0, 0], rtol=0, atol=1e-6 * wavelength_nm * 1e-6)


def test_angles_of_code_v(tmp_path):
    """rayoptics has the conventions of Code V: about turned axes, left-handed about x and y."""
    angles = 3.0, -5.0, 7.0
    lines = "  YTO; RDX -80.0; DAR; ADE {}; BDE {}; CDE {}\n".format(*angles)
    (tmp_path / "lens.seq").write_text(changed(CODEV, ("  CON\n", lines)))
    theirs = DecenterData("dec and return", 0.0, 0.0, *angles)
    theirs.update()
    pose = read_prescription(tmp_path / "lens.seq").surfaces[2].pose
    np.testing.assert_allclose(pose.rotation, theirs.rot_mat, atol=1e-11)
