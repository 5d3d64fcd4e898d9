"""Mirrors and central obstructions, by closed forms and by rays in plain vectors."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.kernels.library import NUMPY, available
from lensfield.engine.prescription.prescription import ALUMINIUM, Pose, Surface
from lensfield.engine.prescription.readers import read_prescription
from lensfield.engine.prescription.readers.toml import write_prescription
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.aiming import aim_at_image
from lensfield.engine.rays.fields import find_fields, trace_fields, view_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.rays import FullPupil, HalfPupil, trace_pupil
from lensfield.engine.rays.rings import Rings, turned
from lensfield.engine.rays.transmission import transmittance
from loops import using
from mirror_lens import MIRROR_LENS, SURFACES, two_mirrors
from physical_rays import trace
from refusals import refused

PUPIL, FULL = HalfPupil(7, 9), FullPupil(5, 12)
NM = [486.1, 656.3]


def changed(number, **changes):
    """The mirror lens with changes of a surface, counted from 1."""
    surfaces = [replace(surface, **changes) if at == number else surface for at, surface in enumerate(SURFACES, 1)]
    return replace(MIRROR_LENS, surfaces=tuple(surfaces))


@pytest.mark.parametrize("stop", [0, 1])
def test_a_cassegrain_telescope_focuses_all_axial_rays_over_equal_paths(stop):
    system = build_system(two_mirrors(stop))
    assert system.efl_mm == pytest.approx(300.0, rel=1e-12) and system.image_distance_mm == pytest.approx(90.0)
    rays = trace_pupil(system, [0.0, 3.0], [550.0], PUPIL)
    assert not rays.lost.any()
    np.testing.assert_allclose(rays.position_mm[:, :, 0], 0, atol=1e-9)
    np.testing.assert_allclose(rays.path_mm[:, 0], 70.0 + 90.0, rtol=0, atol=1e-11)
    np.testing.assert_allclose(rays.chief_height_mm[0, 1], 3.0, rtol=1e-2)


def test_two_mirrors_have_the_power_of_two_thin_lenses():
    """1/f = a + b - d a b, of the powers a and b at the distance d."""
    lens = replace(two_mirrors(), surfaces=(Surface(-400.0, -130.0, mirror=True, stop=True),
                                            Surface(-250.0, 170.0, mirror=True)))
    powers = 2 / 400, -2 / 250
    system = system_of(lens)
    assert 1 / system.efl_mm == pytest.approx(sum(powers) - 130 * np.prod(powers), rel=1e-12)
    assert system.efl_mm == pytest.approx(454.5, abs=0.05) and system.entrance_pupil_mm == 0


def physical(system, rays, wavelength, height):
    """The same rays in plain vectors, from the plane wave of a field."""
    field, = system.fields_of([[0.0, 2.2, 4.3][height]])
    indices = np.abs(system.indices_at([rays.wavelengths_nm[wavelength]])[:, 0])
    across, up = rays.source[:, wavelength, height].reshape(2, -1)
    start = np.stack([across, up * np.cos(field), -up * np.sin(field)])
    towards = np.array([0.0, np.sin(field), np.cos(field)])[:, None] * np.ones_like(across)
    return trace(system.prescription, indices, start, towards)


@pytest.mark.parametrize("loops", dict.fromkeys([NUMPY, available()[-1]]))
def test_rays_agree_with_plain_vectors(loops):
    """Off the axis, through a Mangin mirror that is the stop: landing points, paths, and what is blocked."""
    system = build_system(MIRROR_LENS)
    with using(loops):
        rays = trace_pupil(system, [0.0, 2.2, 4.3], NM, PUPIL)
    passing = np.all(system.limits(rays.square_height_mm2) <= 1, axis=0)
    for at in np.ndindex(passing.shape[:2]):
        position, direction, path_mm, is_open, stop_mm = physical(system, rays, *at)
        x, y = system.stop_semi_aperture_mm * np.stack([PUPIL.x, PUPIL.y]).reshape(2, -1)
        np.testing.assert_allclose(stop_mm, [x, y], atol=1e-8)
        np.testing.assert_allclose(rays.position_mm[:, *at].reshape(2, -1), position[:2], atol=1e-8)
        np.testing.assert_allclose(rays.direction[:, *at].reshape(3, -1), direction, atol=1e-9)
        np.testing.assert_allclose(rays.path_mm[*at].ravel(), path_mm, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(passing[at].ravel(), is_open)
        assert 0.3 < is_open.mean() < 0.8


@pytest.mark.skipif(len(available()) < 2, reason="no library of the loops: no compiler")
@pytest.mark.parametrize("lens", [MIRROR_LENS, changed(7, pose=Pose((0.2, -0.1, 0.05), (0.4, -0.3, 0.0)))],
                         ids=["centred", "tilted"])
def test_compiled_rays_match_numpy(lens):
    system, found = build_system(lens), {}
    view, places_mm = view_of(system), np.array([[0.0, -2.0, 1.0], [0.0, 0.5, 1.3]])
    for loops in (NUMPY, available()[-1]):
        with using(loops):
            rays = trace_fields(system, view, find_fields(system, view, places_mm, NM), FULL)
            found[loops] = (rays.position_mm, rays.path_mm, rays.square_height_mm2)
            assert not rays.lost.any()
    for plain, compiled in zip(*found.values(), strict=True):
        np.testing.assert_allclose(compiled, plain, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("stop", [0, 1])
def test_rays_to_image_points_reach_them(stop):
    system = build_system(two_mirrors(stop))
    indices, x_mm = system.indices_at([550.0]), system.stop_semi_aperture_mm * np.array([0.0, 0.4, 0.7])
    *slopes, aimed = aim_at_image(system, indices, np.array([0.0, 2.0, 4.0]), x_mm, -x_mm)
    assert aimed.all() and np.all(np.sign(slopes[1][0, 1:, 0]) == (1 if stop == 0 else -1))


def test_light_is_dimmed_by_each_mirror_and_by_bare_glass():
    """At normal incidence, next to the axis: six passes through bare surfaces, of the index 1.6, and two mirrors."""
    narrow = replace(changed(5, semi_obstruction_mm=0.0), aperture=("f_number", 400.0), coating="none")
    narrow = replace(narrow, surfaces=tuple(replace(surface, semi_obstruction_mm=0.0) for surface in narrow.surfaces))
    index = system_of(narrow).indices_at([500.0])[1, 0]
    passes = 1 - ((index - 1) / (index + 1)) ** 2
    np.testing.assert_allclose(transmittance(build_system(narrow), [500.0]), 0.8 * 0.7 * passes**6, rtol=1e-5)
    np.testing.assert_allclose(transmittance(build_system(MIRROR_LENS), NM), 0.8 * 0.7, rtol=1e-12)
    assert system_of(two_mirrors()).mirror_reflectance == pytest.approx(ALUMINIUM**2)


def test_the_size_of_the_hole_in_the_pupil():
    system = system_of(MIRROR_LENS)
    assert system.central_obstruction == pytest.approx(max(3.6 / abs(system.marginal_heights_mm[2]),
                                                           3.2 / system.stop_semi_aperture_mm))
    assert system_of(two_mirrors()).central_obstruction == 0


def test_a_lens_with_a_hole_has_a_fixed_f_number():
    widest = turned(MIRROR_LENS, Rings())
    stopped = turned(MIRROR_LENS, Rings(f_number=16.0))
    assert stopped.words == ("f/16: this lens has only f/7",) and stopped.prescription == widest.prescription
    assert turned(two_mirrors(), Rings(f_number=16.0)).f_number == 16.0


def test_files_keep_mirrors_and_obstructions(tmp_path):
    path = tmp_path / "lens.toml"
    for lens in (MIRROR_LENS, two_mirrors(), MIRROR_LENS.scaled(2.5)):
        path.write_text(write_prescription(lens))
        assert read_prescription(path) == lens
    assert "reflectance = 0.8" in write_prescription(MIRROR_LENS)
    assert MIRROR_LENS.scaled(2.5).surfaces[2].semi_obstruction_mm == 9.0


@pytest.mark.parametrize("number, changes, words", [
    (5, {"glass": ""}, "surface 5, glass is air: expected 1.6/40, the medium in front"),
    (7, {"mirror": False}, "mirrors is 1: expected an even number"),
    (7, {"coating": "multi"}, "surface 7, coating is multi: expected the mirror's reflectance instead"),
    (7, {"reflectance": 1.2}, "surface 7, reflectance is 1.2: expected more than 0, and at most 1"),
    (9, {"semi_obstruction_mm": 3.2}, "surface 9, semi_obstruction_mm is 3.2: expected 0, or less than the"),
    (9, {"semi_obstruction_mm": np.nan}, "surface 9, semi_obstruction_mm is nan: expected 0"),
    (9, {"thickness_mm": -20.0}, "surface 9, thickness_mm is -20")])
def test_impossible_mirrors_are_refused(number, changes, words):
    with pytest.raises(LensError, match=words):
        replace(changed(number, **changes), focus="as given")


def test_a_beam_as_narrow_as_its_obstruction_is_refused():
    with refused(LensError, field="aperture, f_number", value=13.0, where="mirror lens",
                 match="as wide as a central obstruction: open the aperture"):
        build_system(replace(MIRROR_LENS, aperture=("f_number", 13.0)))


def test_a_reflectance_without_a_mirror_is_refused(tmp_path):
    path = tmp_path / "lens.toml"
    path.write_text(write_prescription(MIRROR_LENS).replace("mirror = true, reflectance = 0.7", "reflectance = 0.7"))
    with pytest.raises(LensError, match="surface 7, reflectance is 0.7: expected mirror = true, too"):
        read_prescription(path)
