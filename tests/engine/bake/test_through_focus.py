"""PSFs of points at any depth: against bakes with the object there, Airy's pattern, and geometry far from focus."""

from dataclasses import replace
from functools import cache, partial
from itertools import product

import numpy as np
import pytest
from scipy.special import j1

from afocal import AFOCAL
from lenses import fine_grid_lens, make_lens
from lensfield.engine import InputError, LensError
from lensfield.engine.bake import through_focus
from lensfield.engine.bake.diffraction import point_spread
from lensfield.engine.bake.quality import QUALITIES
from lensfield.engine.bake.through_focus import landings_mm, lens_at_depth, psf_at_depth, psf_at_place
from lensfield.engine.bake.wavefront import trace_wavefronts, wavefronts_of
from lensfield.engine.field.grid.first_order import first_order_rays as first_order_grid_rays
from lensfield.engine.field.radial.first_order import first_order_rays
from lensfield.engine.library import BUNDLED
from lensfield.engine.prescription.readers import read_prescription
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.fields import find_fields, trace_fields, view_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.grid_rays import grid_ray_table
from lensfield.engine.rays.ray_table import ray_table
from lensfield.engine.rays.rays import HalfPupil, trace_pupil
from lensfield.engine.rays.view import tilted
from refusals import refused

NM, F_NUMBER = 550.0, 2.0


@cache
def focused(name):
    return build_system(read_prescription(BUNDLED / "prescriptions" / f"{name}.toml"))


@cache
def table_of(name):
    return ray_table(focused(name).prescription)


def baked(name, height_mm, depth_mm, pitch_um, samples):
    """The PSF from a bake with the object at that depth, with rays traced from there."""
    lens, taken = focused(name), QUALITIES["standard"]
    system = system_of(replace(lens.prescription, object_distance_mm=depth_mm - lens.entrance_pupil_mm))
    paraxial_mm = height_mm
    for _ in range(8 if height_mm else 0):
        chief_mm = trace_pupil(system, [paraxial_mm], [NM], HalfPupil(1, 1)).chief_height_mm[0, 0]
        paraxial_mm *= height_mm / chief_mm
    wavefront = trace_wavefronts(system, [paraxial_mm], [NM], taken.pupil).one(0, 0)
    psf = point_spread(wavefront, pitch_um, samples, replace(taken.sums, repeat=2.0))
    return psf / psf.sum()


@pytest.mark.sample(13)
@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("name, waves", [
    ("edmund-54852", -8), *product(("edmund-54852", "kodak-petzval-100mm", "nikkor-z-50mm-f1.8"), (0, 0.5, 2, 32))])
def test_it_matches_a_bake_of_an_object_at_that_depth(name, waves, share):
    """To 3 % of the light, as the edges of apertures are fitted separately; to 5 % in the fringes of a 100-sample disc.
    """
    lens, table = focused(name), table_of(name)
    pupil_mm = 2 * abs(lens.marginal_heights_mm[0])
    nearness = 1 / (lens.prescription.object_distance_mm + lens.entrance_pupil_mm) + 8e-6 * waves * NM / pupil_mm**2
    depth_mm, height_mm = 1 / nearness if nearness else np.inf, share * table.last_height_mm
    pitch_um = max(0.12 * abs(waves), 3.0 if share else 0.5) * NM * 1e-3 * lens.f_number
    psf = psf_at_depth(table, NM, height_mm, depth_mm, pitch_um, 101)
    assert psf.shape == (101, 101) and psf.sum() == pytest.approx(1, abs=1e-12) and np.array_equal(psf, psf[:, ::-1])
    truth = baked(name, height_mm, depth_mm, pitch_um, 101)
    assert np.abs(psf - truth).sum() < (0.05 if waves > 8 else 0.03)
    assert not share or np.abs(psf[::-1] - truth).sum() > 0.05


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["nikkor-58mm-f1.4", "sony-zeiss-55mm-f1.8"])
def test_it_holds_where_two_rays_meet_near_the_passing_ones(name):
    """Newton's method with one derivative for all rays lost a tenth of the light here."""
    height_mm, depth_mm = 0.7 * table_of(name).last_height_mm, 2e4
    psf, truth = (of(height_mm, depth_mm, 10.0, 101) for of in (partial(psf_at_depth, table_of(name), NM),
                                                              partial(baked, name)))
    assert np.abs(psf - truth).sum() < 0.05


@cache
def perfect(object_distance_mm=np.inf):
    lens = make_lens(object_distance_mm=object_distance_mm, f_number_effective=F_NUMBER,
                     magnification=0.0 if np.isinf(object_distance_mm) else -0.1)
    return lens, first_order_rays(lens)


@pytest.mark.parametrize("distance_mm", [np.inf, 95.0])
def test_a_perfect_lens_in_focus_has_airys_pattern(distance_mm):
    lens, table = perfect(distance_mm)
    pitch_um, samples, parts = 0.25, 61, 5
    psf = psf_at_depth(table, NM, 0.0, distance_mm + lens.entrance_pupil_mm, pitch_um, samples)
    fine_um = (np.arange(samples * parts) - (samples * parts - 1) / 2) * pitch_um / parts
    radius = np.maximum(np.pi * np.hypot(fine_um[:, None], fine_um) / (NM * 1e-3 * F_NUMBER), 1e-9)
    airy = ((2 * j1(radius) / radius)**2).reshape(samples, parts, samples, parts).sum(axis=(1, 3))
    assert np.abs(psf - airy / airy.sum()).sum() < 0.01


@pytest.mark.parametrize("height_mm", [0.0, 1.5])
def test_far_from_focus_it_is_the_disc_of_the_rays(height_mm):
    """The disc has diameter D f q. The fringes at its edge contain some of the light; more than half is uniform."""
    lens, table = perfect()
    waves, samples = 40, 129
    disc_um = 8 * waves * NM * 1e-3 * F_NUMBER  # N lambda per mm of path at the rim is 8 lambda N across
    depth_mm = 1 / (8e-6 * waves * NM / (lens.efl_mm / F_NUMBER)**2)
    pitch_um = 1.5 * disc_um / samples
    psf = psf_at_depth(table, NM, height_mm, depth_mm, pitch_um, samples)
    offset_um = (np.arange(samples) - samples // 2) * pitch_um
    centre_um = np.sum(psf.sum(axis=1) * offset_um)
    radius = np.hypot(offset_um[:, None] - centre_um, offset_um) / (disc_um / 2)
    for within in (0.4, 0.7, 0.9):
        assert psf[radius < within].sum() == pytest.approx(within**2, rel=0.03)
    assert psf[radius < 1.08].sum() > 0.98


@pytest.mark.parametrize("depth_mm, share", [(250.0, 0.0), (120.0, 0.7), (np.inf, 0.4)])
def test_landing_points_match_traced_rays(depth_mm, share):
    """For a point traced through the lens; the apertures stop the same rays."""
    lens, table = focused("edmund-54852"), table_of("edmund-54852")
    system = system_of(replace(lens.prescription, object_distance_mm=depth_mm - lens.entrance_pupil_mm))
    rng, stop = np.random.default_rng(4), HalfPupil(1, 60)
    radius, azimuth = np.sqrt(rng.random(60)), np.pi * rng.random(60)
    radius[0] = 0
    stop.x, stop.y = (radius * each[None] for each in (np.sin(azimuth), np.cos(azimuth)))
    true = trace_pupil(system, [share * system.last_height_mm], [NM], stop)
    height_mm = true.chief_height_mm[0, 0]
    landed_mm, passing = landings_mm(table, NM, height_mm, depth_mm, np.stack([stop.x[0], stop.y[0]]))
    expected_mm = true.position_mm[:, 0, 0, 0] - [[0.0], [height_mm]]
    assert np.ptp(expected_mm) > 0.005
    inside = np.all(true.square_height_mm2[:, 0, 0, 0] < system.semi_apertures_mm[:, None]**2, axis=0)
    assert np.array_equal(passing, inside)
    np.testing.assert_allclose(landed_mm[:, inside], expected_mm[:, inside], atol=2e-5)


def test_infinity_matches_a_very_distant_point():
    _, table = perfect()
    far, farther = (psf_at_depth(table, NM, 1.0, depth_mm, 0.5, 41) for depth_mm in (1e8, np.inf))
    assert np.abs(far - farther).sum() < 1e-3


def test_a_lens_at_a_depth_has_the_psfs_of_that_depth():
    lens, table = perfect()
    nearer = lens_at_depth(lens, table, 500.0)
    assert nearer.name == "hand-made, points at 0.5 m" and nearer.enclosed_energy.min() > 0.98
    assert np.allclose(nearer.psf[0, 3], psf_at_depth(table, lens.wavelengths_nm[0], lens.real_height_mm[0, 3], 500.0,
                                                      nearer.psf_pitch_um, nearer.psf.shape[-1]), atol=1e-6)
    many = make_lens(heights_mm=np.linspace(0, 2, 50), wavelengths_nm=np.linspace(400, 700, 16))
    few = lens_at_depth(many, first_order_rays(many), np.inf)
    assert few.heights_mm.size == 17 and few.heights_mm[-1] == 2
    assert few.wavelengths_nm.tolist() == [400, 440, 500, 560, 600, 640, 700]


AFOCAL_TRIPLET = replace(focused("cooke-triplet-50mm").prescription,
                         surfaces=AFOCAL + focused("cooke-triplet-50mm").prescription.surfaces)


@pytest.mark.parametrize("prescription, y_mm, mirrored", [
    (AFOCAL_TRIPLET, (0.0, 7.0), (True, True)),
    (tilted(focused("cooke-triplet-50mm"), (5.0, 0.0)), (-7.0, 8.0), (False, True))])
def test_psfs_at_places_match_rays_from_points_at_that_depth(prescription, y_mm, mirrored):
    """Through an anamorphic lens and onto a tilted sensor, traced from a point on the chief ray."""
    system, taken, place_mm, depth_mm = build_system(prescription), QUALITIES["standard"], (-6.0, -5.0), 3e3
    table = grid_ray_table(system.prescription, y_mm, (0.0, 9.0), mirrored)
    psf = psf_at_place(table, NM, place_mm, depth_mm, 10.0, 101)
    view = replace(view_of(system), nearness=1 / depth_mm, lean=np.zeros(2))
    points = find_fields(system, view, -np.reshape(place_mm, (2, 1)), [NM])
    wavefront = wavefronts_of(system, trace_fields(system, view, points, taken.full_pupil)).one(0, 0)
    truth = point_spread(wavefront, 10.0, 101, replace(taken.sums, repeat=2.0))[::-1, ::-1]
    assert np.abs(psf - truth / truth.sum()).sum() < 0.03
    assert all(np.abs(turned - psf).sum() > 0.1 for turned in (psf[::-1], psf[:, ::-1], psf.T))


def test_a_lens_on_a_grid_has_the_psfs_of_a_depth(monkeypatch):
    monkeypatch.setattr(through_focus, "MOST_LINES", 3)
    lens = fine_grid_lens(mirrored=(False, True), squeeze=2.0, wavelengths_nm=(600.0,), focus_slope=(0.0, 1e-3))
    table = first_order_grid_rays(lens)
    nearer = lens_at_depth(lens, table, 500.0)
    assert nearer.name == "hand-made grid, points at 0.5 m" and nearer.enclosed_energy.min() > 0.95
    assert nearer.psf.shape[:3] == (1, 3, 3) and nearer.y_mm.tolist() == [-2, 0, 2]
    expected = psf_at_place(table, 600.0, (nearer.x_mm[1], nearer.y_mm[0]), 500.0, nearer.psf_pitch_um,
                            nearer.psf.shape[-1])
    np.testing.assert_allclose(nearer.psf[0, 0, 1], expected, atol=1e-6)


@pytest.mark.parametrize("depth_mm", [0.0, -5.0, np.nan])
def test_a_depth_must_be_a_distance(depth_mm):
    lens, table = perfect()
    with pytest.raises(InputError, match="depth is .*: expected a distance"):
        psf_at_depth(table, NM, 0.0, depth_mm, 1.0, 11)
    with refused(InputError, field="depth"):
        lens_at_depth(lens, table, depth_mm)


def test_rays_from_the_side_have_no_depth():
    table = first_order_rays(make_lens(efl_mm=0.1, magnification=0.0, object_distance_mm=np.inf))
    with pytest.raises(InputError, match="height is 2 mm: its rays arrive from the side"):
        psf_at_depth(table, NM, 2.0, 1e3, 2.0, 65)
    assert psf_at_depth(table, NM, 0.1, 1e3, 2.0, 65).sum() == pytest.approx(1)


def test_beyond_its_field_or_wavelengths_a_lens_has_no_psf():
    lens, table = perfect()
    with refused(LensError, field="sensor position", value="2.1 mm from the axis", match="2 mm$"):
        psf_at_depth(table, NM, 2.1, 1e3, 1.0, 11)
    with refused(LensError, field="wavelengths", value=[800.0], where="hand-made"):
        psf_at_depth(table, 800.0, 0.0, 1e3, 1.0, 11)
