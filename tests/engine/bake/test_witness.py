"""Rays, first-order figures and glasses of bundled prescriptions, by Optiland, if installed by `make test-bake`."""

import numpy as np
import pytest

pytest.importorskip("optiland", reason="the witness of baking is Optiland: make test-bake")

from optiland.fileio import save_optiland_file  # noqa: E402
from optiland.materials import AbbeMaterial, MaterialFile  # noqa: E402
from optiland.optic import Optic  # noqa: E402

from lensfield.engine.library import PRESCRIPTIONS  # noqa: E402
from lensfield.engine.prescription.glasses import find_glass  # noqa: E402
from lensfield.engine.prescription.readers import read_prescription  # noqa: E402
from lensfield.engine.prescription.surfaces import sag_and_gradient  # noqa: E402
from lensfield.engine.rays.focus import build_system  # noqa: E402
from lensfield.engine.rays.rays import HalfPupil, trace_pupil  # noqa: E402
from optiland_witness import optic_of, witness_rays  # noqa: E402
from varied_lenses import VARIED  # noqa: E402

PUPIL = HalfPupil(5, 7)
WAVELENGTHS_NM = (400.0, 550.0, 700.0)
NAMES = (*VARIED, "cooke-speed-panchro-35mm", "nikkor-z-58mm-noct", "pentax-fisheye-17mm", "sigma-40mm-f1.4",
         "nikkor-reflex-500mm", "nikkor-reflex-c-500mm")
PATHS = [PRESCRIPTIONS / f"{name}.toml" for name in NAMES]
lenses = pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)


def number(value):
    return float(np.ravel(value)[0])


@lenses
def test_first_order_figures(path):
    system = build_system(read_prescription(path))
    paraxial = optic_of(system, system.prescription.reference_wavelength_nm).paraxial
    assert number(paraxial.f2()) == pytest.approx(system.efl_mm, rel=1e-12)
    assert number(paraxial.EPL()) == pytest.approx(system.entrance_pupil_mm, rel=1e-9, abs=1e-9)
    assert number(paraxial.XPL()) == pytest.approx(system.exit_pupil_distance_mm, rel=1e-9)
    if not system.object_at_infinity:
        assert number(paraxial.magnification()) == pytest.approx(system.magnification, rel=1e-12)


@lenses
def test_rays(path):
    """Rays that pass: as precise as Optiland's aim, 1e-10 mm on the stop; the path error is of second order."""
    system = build_system(read_prescription(path))
    heights_mm = np.array([0.0, 0.5, 0.95]) * system.last_height_mm
    ours = trace_pupil(system, heights_mm, WAVELENGTHS_NM, PUPIL)
    for wavelength, nm in enumerate(WAVELENGTHS_NM):
        optic = optic_of(system, nm)
        for height, height_mm in enumerate(heights_mm):
            position, direction, path_mm, square = witness_rays(optic, system, height_mm, nm, PUPIL)
            passing = np.all(square <= system.semi_apertures_mm[:, None, None]**2, axis=0)
            place = (..., wavelength, height, slice(None), slice(None))
            assert passing[0].all() and not ours.lost[place][passing].any()
            np.testing.assert_allclose(ours.position_mm[place][:, passing], position[:, passing], rtol=0, atol=1e-8)
            np.testing.assert_allclose(ours.direction[place][:, passing], direction[:, passing], rtol=0, atol=1e-9)
            theirs = path_mm - path_mm[0, 0]
            opd_mm = ours.path_mm[place] - ours.path_mm[place][0, 0]
            np.testing.assert_allclose(opd_mm[passing], theirs[passing], rtol=0, atol=1e-6 * nm * 1e-6)
            np.testing.assert_allclose(ours.square_height_mm2[place][:, passing], square[:, passing], atol=1e-7)


@pytest.mark.parametrize("name", ["SCHOTT N-BK7", "SCHOTT F2", "OHARA S-LAL8", "CDGM H-LAK1", "HIKARI SF10",
                                  "HOYA LAC8", "SUMITA K-BOC20", "LZOS BK10"])
def test_catalogue_glasses(name):
    from importlib import resources

    maker, glass = name.split()
    folder = resources.files("optiland.database") / "data-nk" / "glass" / maker.lower()
    file, = folder.rglob(f"{glass}.yml")
    theirs, ours = MaterialFile(str(file)), find_glass(name, "lens", "glass")
    for nm in (450.0, 550.0, 650.0):
        assert float(ours.index_at(nm)) == pytest.approx(number(theirs.n(nm * 1e-3)), abs=1e-14)
        assert float(ours.extinction_at(nm)) == pytest.approx(number(theirs.k(nm * 1e-3)), rel=0.006)


@pytest.mark.parametrize("index, abbe", [(1.5168, 64.17), (1.62, 36.4), (1.85, 23.8)])
def test_glasses_of_index_and_abbe_number(index, abbe):
    theirs, ours = AbbeMaterial(index, abbe, model="buchdahl"), find_glass(f"{index}/{abbe}", "lens", "glass")
    for nm in (400.0, 550.0, 700.0):
        assert float(ours.index_at(nm)) == pytest.approx(number(theirs.n(nm * 1e-3)), abs=1e-14)


def test_toroids_and_poses_in_files_of_optiland(tmp_path):
    """Sags, off both axes, and rotations, by Optiland's own geometries."""
    optic = Optic(name="anamorphic")
    optic.surfaces.add(index=0, thickness=np.inf)
    optic.surfaces.add(index=1, z=0.0, is_stop=True)
    optic.surfaces.add(index=2, z=2.0, surface_type="toroidal", radius_x=-80.0, radius_y=50.0, conic=-0.5,
                       toroidal_coeffs_poly_y=[1e-4, 2e-6], material=AbbeMaterial(1.62, 60.3, model="buchdahl"),
                       x=0.3, y=-0.2, rx=0.05, ry=-0.1, rz=0.2)
    optic.surfaces.add(index=3, z=6.0, surface_type="biconic", radius_x=-80.0, radius_y=np.inf, conic_x=0.7)
    optic.surfaces.add(index=4, z=50.0, rx=0.03)
    optic.set_aperture("EPD", 5.0)
    optic.fields.set_type("angle")
    optic.fields.add(y=14)
    optic.wavelengths.add(0.55, is_primary=True)
    save_optiland_file(optic, str(tmp_path / "lens.json"))
    lens = read_prescription(tmp_path / "lens.json")
    x_mm, y_mm = np.array([1.0, -3.0, 4.0]), np.array([-2.0, 2.5, 5.0])
    *_, toroid, cylinder, image = optic.surfaces.surfaces
    for surface, theirs in zip(lens.surfaces[1:], (toroid, cylinder), strict=True):
        sag_mm, *_ = sag_and_gradient(surface, x_mm, y_mm)
        np.testing.assert_allclose(sag_mm, theirs.geometry.sag(x_mm, y_mm), atol=1e-12)
    for pose, theirs in ((lens.surfaces[1].pose, toroid), (lens.image_pose, image)):
        np.testing.assert_allclose(pose.rotation, theirs.geometry.cs.get_rotation_matrix(), atol=1e-11)
    assert lens.surfaces[1].pose.offset_mm == (0.3, -0.2, 0.0)
