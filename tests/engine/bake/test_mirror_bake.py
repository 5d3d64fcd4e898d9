"""Lens data of mirror lenses: PSFs of a pupil with a hole by closed forms, and light by rays in plain vectors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import j1

from lensfield.engine.bake.bake import bake
from lensfield.engine.inspection.info import lens_info, lens_text
from lensfield.engine.lens.entrance_pupil import entrance_pupil_area_mm2
from lensfield.engine.lens.iris import Iris, opening
from lensfield.engine.lens_files.package import package_bytes, read_package
from lensfield.engine.prescription.prescription import Pose
from lensfield.engine.rays.axial_image import trace_axial_bundles
from lensfield.engine.rays.focus import build_system
from lensfield.engine.runtime.errors import LensError
from lensfield.engine.stray.ghost_table import ghost_table
from lensfield.engine.stray.star import star_share
from mirror_lens import MIRROR_LENS, SURFACES, two_mirrors
from physical_rays import trace
from refusals import refused

NM, PITCH_UM, SAMPLES, HOLE = 550.0, 0.9, 129, 0.45
PARTS = 9  # of a sample along each side
GRID = 401


def telescope():
    """A perfect pupil with a hole, f/7.5."""
    first, second = two_mirrors().surfaces
    return replace(two_mirrors(), surfaces=(replace(first, semi_obstruction_mm=HOLE * 20.0), second))


def annular_pattern(v, hole):
    """Intensity of the diffraction pattern of an annulus relative to its middle (Born and Wolf, 8.6.2)."""
    v = np.maximum(v, 1e-9)
    return ((2 * j1(v) / v - hole * 2 * j1(hole * v) / v) / (1 - hole**2)) ** 2


@pytest.fixture(scope="module")
def baked():
    return bake(telescope(), quality="preview", wavelengths_nm=[NM], heights=3, samples=SAMPLES, pitch_um=PITCH_UM)


def test_the_psf_of_an_annulus(baked):
    places = (np.arange(SAMPLES * PARTS) - SAMPLES * PARTS // 2) * PITCH_UM / PARTS
    v = np.pi * np.hypot(*np.meshgrid(places, places)) / (NM * 1e-3 * 7.5)
    true = annular_pattern(v, HOLE).reshape(SAMPLES, PARTS, SAMPLES, PARTS).mean(axis=(1, 3))
    np.testing.assert_allclose(baked.psf[0, 0], true / true.sum(), atol=0.003 * true.max() / true.sum())
    assert np.abs(baked.psf[0, 0] - true / true.sum()).sum() < 0.01


def test_the_f_number_is_that_of_a_pupil_as_large_as_the_annulus(baked):
    assert baked.central_obstruction == pytest.approx(HOLE)
    assert baked.rim_f_number == pytest.approx(7.5, rel=0.003)
    assert baked.f_number_effective == pytest.approx(7.5 / np.sqrt(1 - HOLE**2), rel=0.003)
    assert entrance_pupil_area_mm2(baked) == pytest.approx(np.pi * 20.0**2 * (1 - HOLE**2), rel=0.006)
    assert f"f/{baked.rim_f_number:.3g} with a central obstruction of 45%" in lens_text(lens_info(baked))


def test_packages_keep_the_hole(baked, tmp_path):
    path = tmp_path / "lens.npz"
    path.write_bytes(package_bytes(baked))
    assert read_package(path).central_obstruction == baked.central_obstruction
    with pytest.raises(LensError, match="central_obstruction is 1: expected 0, or less than 1"):
        replace(baked, central_obstruction=1)


def test_contrast_with_a_hole():
    """The MTF of an annulus, at a frequency at which its hole counts: by the areas of overlapping discs."""
    bundle, = trace_axial_bundles(build_system(telescope()), [NM])
    shift = 0.2  # of the pupil's diameter

    def overlap(one, other, apart):
        """Area of two discs of these radii."""
        x, y = np.meshgrid(np.linspace(-1.3, 1.3, 2001), np.linspace(-1.1, 1.1, 2001))
        return np.mean((np.hypot(x - apart / 2, y) < one) & (np.hypot(x + apart / 2, y) < other)) * 2.6 * 2.2

    both = overlap(1, 1, 2 * shift) - 2 * overlap(1, HOLE, 2 * shift) + overlap(HOLE, HOLE, 2 * shift)
    contrast = bundle.contrast(shift * bundle.cutoff_lp_mm, [0.0])[0]
    assert contrast == pytest.approx(both / (np.pi * (1 - HOLE**2)), abs=0.02)
    assert bundle.obstruction == pytest.approx(HOLE * bundle.aperture, rel=0.01)


def test_the_star_has_the_light_of_both_edges(baked):
    """Light far from the middle of an annulus's pattern: its tail times the wider of two rings' areas."""
    share = star_share(baked, opening(Iris(0), baked), np.array([NM]))[0]
    v = np.linspace(200.0, 2000.0, 400001)
    tail = np.mean(annular_pattern(v, HOLE) * v**3) * (1 - HOLE**2) / 2  # of the light outside v, times v
    unobstructed = np.mean(annular_pattern(v, 0.0) * v**3) / 2
    round_one = star_share(replace(baked, central_obstruction=0.0, f_number_effective=baked.rim_f_number),
                           opening(Iris(0), baked), np.array([NM]))[0]
    assert share / round_one == pytest.approx(tail / unobstructed, rel=0.01)


def beam_area(system, field):
    """Area in direction cosines of a field's passing bundle at the image, by rays in plain vectors."""
    side_mm = 1.4 * abs(system.marginal_heights_mm[0])
    step = np.linspace(-side_mm, side_mm, GRID)
    across, up = (each.ravel() for each in np.meshgrid(step, step))
    start = np.stack([across, up * np.cos(field), -up * np.sin(field)])
    towards = np.array([0.0, np.sin(field), np.cos(field)])
    start = start + np.outer(towards, system.entrance_pupil_mm / towards[2] * np.ones_like(across))
    start[1] -= np.tan(field) * system.entrance_pupil_mm
    indices = np.abs(system.indices_at([NM])[:, 0])
    _, direction, _, is_open, stop_mm = trace(system.prescription, indices, start,
                                              towards[:, None] * np.ones_like(across))
    is_open &= np.hypot(*stop_mm) <= system.stop_semi_aperture_mm
    (by_up, by_across), (m_up, m_across) = (np.gradient(each.reshape(GRID, GRID), step, step)
                                            for each in direction[:2])
    area = np.abs(by_up * m_across - by_across * m_up) * (step[1] - step[0]) ** 2
    return np.sum(area * is_open.reshape(GRID, GRID))


def test_light_over_the_field():
    """Vignetting by rims and by a hole that moves over the pupil. The grid of rays resolves edges to 0.2 %."""
    lens = bake(MIRROR_LENS, quality="preview", wavelengths_nm=[NM], heights=4)
    system = build_system(MIRROR_LENS)
    areas = np.array([beam_area(system, field) for field in system.fields_of(lens.heights_mm)])
    assert np.pi / (4 * lens.f_number_effective**2) == pytest.approx(areas[0], rel=0.01)
    np.testing.assert_allclose(lens.relative_illumination[0], areas / areas[0], rtol=0.01)
    assert areas[-1] < 0.97 * areas[0]


def test_a_displaced_mirror_is_baked_over_the_picture():
    surfaces = [replace(surface, pose=Pose((0.0, 0.05, 0.0), (0.1, 0.0, 0.0))) if at == 6 else surface
                for at, surface in enumerate(SURFACES)]
    lens = bake(replace(MIRROR_LENS, surfaces=tuple(surfaces), focus="paraxial"), quality="preview",
                wavelengths_nm=[NM], samples=33)
    assert lens.central_obstruction > 0.5 and lens.mirrored == (False, True)


def test_ghosts_are_refused():
    lens = replace(bake(telescope(), quality="preview", wavelengths_nm=[NM], heights=2, samples=33, pitch_um=4.0),
                   prescription=telescope())
    with refused(LensError, field="ghosts", value="none", where="two mirrors",
                 match="ghosts of mirror lenses are not computed"):
        ghost_table(lens, 1.0)
