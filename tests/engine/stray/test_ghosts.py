"""Ghosts against hand calculation, and against plain tracing of many rays with Fresnel's equations."""

from dataclasses import replace
from itertools import pairwise
from unittest import mock

import numpy as np
import pytest

from fresnel import fresnel
from lensfield.engine.bake.bake import bake
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sources import Sources
from lensfield.engine.kernels.ghost_meshes import LIGHT
from lensfield.engine.kernels.ghosts import MOST_WAVES
from lensfield.engine.kernels.library import NUMPY, available
from lensfield.engine.lens.iris import Iris, opening_within
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.prescription import Pose, Prescription, Surface
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.rings import Rings, turned
from lensfield.engine.rays.transmission import coating_transmittance
from lensfield.engine.runtime import threads
from lensfield.engine.stray import ghost_bands
from lensfield.engine.stray.ghost_bands import bands_of, halves_of
from lensfield.engine.stray.ghost_beams import beam_of, coatings_of, entrance_mm, ghost_lens
from lensfield.engine.stray.ghost_rays import trace_ghosts
from lensfield.engine.stray.ghost_table import ghost_table
from lensfield.engine.stray.ghosts import direct_light, ghosts
from loops import using

NM = 550.0
PLATE_MM, PLATE_INDEX = 3.0, 1.5
ROUND = opening_within(Iris(0), np.inf)
OFF_CENTRE = PixelGrid((210, 330), 20.0, centre_px=(140.25, 75.5))
LIMITLESS = PixelGrid((1500, 1500), 200.0)
AXIS = np.array([[0.0], [0.0], [1.0]])


def bare(name, f_number=None, numbers=None):
    """A lens of the library without coatings; if surfaces are given by their numbers, others reflect nothing."""
    lens = prescription_of(name)
    surfaces = tuple(replace(surface, coating="" if numbers is None or number in numbers else "ideal")
                     for number, surface in enumerate(lens.surfaces, 1))
    return turned(replace(lens, coating="none", surfaces=surfaces), Rings(f_number=f_number)).prescription


def with_plate(in_front):
    """A plano-convex singlet that reflects nothing, of focal length 50 mm at f/10, focused at infinity; with a bare
    plane-parallel plate."""
    plate = (Surface(thickness_mm=PLATE_MM, glass=f"{PLATE_INDEX}/1000000", coating="none", semi_aperture_mm=20.0),
             Surface(thickness_mm=10.0, coating="none", semi_aperture_mm=20.0))
    lens = (Surface(25.9, 2.0, "1.518/1000000", 10.0, coating="ideal"),
            Surface(np.inf, 1.0, coating="ideal", semi_aperture_mm=10.0), Surface(np.inf, 30.0, stop=True))
    surfaces = (*plate, *lens) if in_front else (*lens, *plate)
    return turned(Prescription("singlet", surfaces, ("f_number", 10.0), ("angle_deg", 20.0), focus="paraxial",
                               reference_wavelength_nm=NM)).prescription


def source(right_deg, up_deg, *, radius_rad=0.0, irradiance=2.0, nm=(NM,)):
    direction = np.array([np.tan(np.radians(right_deg)), np.tan(np.radians(up_deg)), 1.0])
    return Sources(direction[None] / np.linalg.norm(direction), np.array([np.inf]), np.full((1, len(nm)), irradiance),
                   np.array(nm), np.array([radius_rad]), ("lamp",))


def moments(picture, grid):
    """Centre x, y in mm of a picture's light, and its variance along x."""
    x, y = grid.axes_mm()
    weight = picture / picture.sum(dtype=float)
    centre = float((weight * x).sum()), float((weight * y[:, None]).sum())
    return *centre, float((weight * (x - centre[0])**2).sum())


def test_ghost_of_a_plate_in_front_falls_on_the_image():
    lens = with_plate(True)
    found = ghosts(lens, source(4.0, 2.0), OFF_CENTRE, ROUND)
    direction = source(4.0, 2.0).directions[0]
    share = fresnel(1.0, PLATE_INDEX, direction[2])
    image_light = direct_light(lens, source(4.0, 2.0), ROUND)
    np.testing.assert_allclose(found.light[0, 0, 0] / image_light[0, 0], share**2, rtol=0.01)
    focal_mm = system_of(lens).efl_mm
    x, y, _ = moments(found.irradiance[0], OFF_CENTRE)
    np.testing.assert_allclose([x, y], focal_mm * direction[:2] / direction[2], atol=0.15)


def test_ghosts_are_in_their_places_on_a_tilted_sensor():
    lens = turned(with_plate(True), Rings(tilt_deg=(2.0, -1.0))).prescription
    found = ghosts(lens, source(0.0, 0.0), OFF_CENTRE, ROUND)
    np.testing.assert_allclose(moments(found.irradiance[0], OFF_CENTRE)[:2], 0, atol=0.02)


def test_ghost_of_a_plate_behind_is_as_wide_as_its_detour():
    lens = with_plate(False)
    system = system_of(lens)
    grid = PixelGrid((200, 300), 10.0, centre_px=(80.0, 130.0))
    found = ghosts(lens, source(0.0, 0.0), grid, ROUND)
    share = fresnel(1.0, PLATE_INDEX, 1.0)
    image_light = direct_light(lens, source(0.0, 0.0), ROUND)
    np.testing.assert_allclose(found.light[0, 0, 0] / image_light[0, 0], share**2, rtol=0.01)
    stop_mm, to_image_mm = system.stop_semi_aperture_mm, system.exit_pupil_distance_mm
    radius_mm = 2 * PLATE_MM / PLATE_INDEX * stop_mm / abs(to_image_mm)
    x, y, variance = moments(found.irradiance[0], grid)
    np.testing.assert_allclose([x, y], 0, atol=2e-3)
    np.testing.assert_allclose(np.sqrt(4 * variance), radius_mm, rtol=0.03)


def test_a_wide_source_widens_its_ghost():
    lens, radius_rad = with_plate(True), 0.02
    grid = PixelGrid((400, 400), 20.0)
    found = ghosts(lens, source(0.0, 0.0, radius_rad=radius_rad), grid, ROUND)
    _, _, variance = moments(found.irradiance[0], grid)
    np.testing.assert_allclose(np.sqrt(4 * variance), system_of(lens).efl_mm * radius_rad, rtol=0.1)


def dense_rays(lens, pair, direction, half_mm, count=401):
    """Light over irradiance, in mm^2, and places of rays from a square that a pair of spheres, cylinders or planes
    reflects; in plain numpy, with hard limits."""
    system, (near, far) = system_of(lens), pair
    media, semi_mm = system.indices_at([NM])[:, 0], system.semi_apertures_mm
    semi_mm[lens.stop_index] = system.stop_semi_aperture_mm
    vertices_mm = np.cumsum([0, *(surface.thickness_mm for surface in lens.surfaces)])
    of_glass = np.exp(-system.optical_depths([NM])[:, 0])
    across, step_mm = np.linspace(-half_mm, half_mm, count, retstep=True)
    at = np.stack([each.ravel() for each in np.meshgrid(across, across, 0.0)])
    along = np.repeat(direction[:, None], at.shape[1], axis=1)
    light, heading = np.full(at.shape[1], step_mm**2 * direction[2]), 1
    path = *range(far + 1), *range(far - 1, near - 1, -1), *range(near + 1, len(lens.surfaces))
    for here, ahead in pairwise((*path, len(lens.surfaces))):
        at, normal = met(lens.surfaces[here], at - vertices_mm[here] * AXIS, along)
        passing = np.hypot(at[0], at[1]) <= semi_mm[here]
        at, normal, along, light = (each[..., passing] for each in (at, normal, along, light))
        before, behind = media[[here, here + 1][::heading]]
        cosine = heading * np.sum(along * normal, axis=0)
        share = fresnel(before, behind, cosine) * (lens.surface_coatings[here] != "ideal")
        if ahead - here == heading:
            ratio = before / behind
            root = np.sqrt(1 - ratio**2 * (1 - cosine**2))
            along, light = ratio * along + heading * (root - ratio * cosine) * normal, light * (1 - share)
        else:
            along, light, heading = along - 2 * heading * cosine * normal, light * share, -heading
        at, light = at + vertices_mm[here] * AXIS, light * of_glass[min(here, ahead)]
    return light, (at + (vertices_mm[-1] - at[2]) / along[2] * along)[:2]


def met(surface, at, along):
    """Where rays meet a surface, and its unit normals there, relative to its vertex."""
    radii_mm = surface.radius_x_mm or surface.radius_mm, surface.radius_mm
    bends = 1 / np.array(radii_mm)
    form = np.append(bends, bends[np.argmax(np.abs(bends))])[:, None]  # form * (x, y, z)^2 - 2 z = 0
    square, mixed, rest = (np.sum(form * each, axis=0) for each in (along**2, at * along, at**2))
    mixed, rest = mixed - along[2], rest - 2 * at[2]
    at = at + rest / (np.sign(along[2]) * np.sqrt(mixed**2 - square * rest) - mixed) * along
    normal = AXIS - form * at
    return at, normal / np.linalg.norm(normal, axis=0)


@pytest.mark.parametrize(("lens", "lamp", "half_mm"), [
    (lambda: bare("cooke-triplet-50mm", 5.6), (3.0, 8.0), 14.0),
    (lambda: bare("cooke-42mm-2x", 4.0, numbers=(9, 10, 12, 13, 14)), (-9.0, 5.0), 30.0)], ids=["triplet", "cylinders"])
def test_light_of_all_ghosts_is_what_fresnel_leaves(lens, lamp, half_mm):
    lens, lamp = lens(), source(*lamp)
    found = ghosts(lens, lamp, LIMITLESS, ROUND, share=0.0)
    _, _, right_mm, _ = LIMITLESS.edges_mm
    light, moment = np.zeros(len(found.pairs)), np.zeros((len(found.pairs), 2))
    with np.errstate(all="ignore"):
        for number, pair in enumerate(found.pairs - 1):
            rays, place = dense_rays(lens, pair, lamp.directions[0], half_mm)
            rays = np.where((np.abs(place) < right_mm).all(axis=0), rays, 0)
            light[number], moment[number] = rays.sum(), np.nan_to_num(place) @ rays
    np.testing.assert_allclose(np.nansum(found.light), 2e-6 * light.sum(), rtol=0.01)
    np.testing.assert_allclose(found.irradiance.sum(dtype=float) * 0.04e-6, np.nansum(found.light), rtol=1e-4)
    bright = light > 0.02 * light.sum()
    np.testing.assert_allclose(found.light[0, bright, 0], 2e-6 * light[bright], rtol=0.04)
    np.testing.assert_allclose(moments(found.irradiance[0], LIMITLESS)[:2], moment.sum(axis=0) / light.sum(), rtol=0.03,
                               atol=0.01)


@pytest.mark.parametrize(("width_px", "lamp"), [(1080, (0.0, 5.0)), (360, (6.0, 8.0))])
def test_the_brightest_ghosts_are_as_bright_as_counted_rays(width_px, lamp):
    """On a frame that is smaller than some ghosts; the coarsest pictures of these have pixels beyond its edges."""
    lens, lamp = bare("zeiss-biotar-50mm"), source(*lamp)
    grid = PixelGrid((round(width_px * 18.7 / 24.9), width_px), 24.9e3 / width_px)
    found = ghosts(lens, lamp, grid, ROUND)
    left_mm, lower_mm, right_mm, upper_mm = grid.edges_mm
    for number in np.argsort(-np.nan_to_num(found.light[0, :, 0]))[:3]:
        with np.errstate(all="ignore"):
            rays, (x, y) = dense_rays(lens, found.pairs[number] - 1, lamp.directions[0], 19.0, count=701)
        inside = (x > left_mm) & (x < right_mm) & (y > lower_mm) & (y < upper_mm)
        assert found.light[0, number, 0] == pytest.approx(2e-6 * rays[inside].sum(), rel=0.025)
    light = found.irradiance.sum(dtype=float) * (grid.pitch_um * 1e-6) ** 2
    assert light == pytest.approx(np.nansum(found.light), rel=1e-3)


def singlet(semi_mm):
    """A bare singlet behind its stop, with spherical aberration."""
    surfaces = (Surface(np.inf, 0.5, stop=True, semi_aperture_mm=semi_mm),
                Surface(26.0, 6.0, "1.518/1000000", semi_mm + 3, coating="none"),
                Surface(np.inf, 0.0, coating="none", semi_aperture_mm=semi_mm + 3))
    return turned(Prescription("singlet", surfaces, ("stop", semi_mm), ("angle_deg", 10.0), focus="best",
                               sensor_mm=(16.0, 12.0), reference_wavelength_nm=NM)).prescription


def test_the_table_compares_ghosts_with_the_light_through_the_stop():
    """The stop is in front, so its area is the cross section of the image's light; ghosts by counted rays."""
    lens, semi_mm = singlet(10.0), 10.0
    data = replace(bake(lens, quality="preview", wavelengths_nm=[NM], heights=5), prescription=lens)
    table = ghost_table(data, 0.0)
    with np.errstate(all="ignore"):
        rays, (x, y) = dense_rays(lens, np.array([1, 2]), AXIS[:, 0], semi_mm + 0.1, count=1001)
    on_sensor = (np.abs(x) < 8) & (np.abs(y) < 6)
    axial = direct_light(lens, source(0.0, 0.0, irradiance=1.0), ROUND)[0, 0] * 1e6
    assert axial == pytest.approx(np.pi * semi_mm**2 * coating_transmittance(system_of(lens), [NM])[0], rel=3e-3)
    assert table.total == pytest.approx(rays[on_sensor].sum() / axial, rel=0.02)


def test_rotational_symmetry_changes_nothing():
    lens = bare("cooke-triplet-50mm", 8.0)
    posed = replace(lens, surfaces=(replace(lens.surfaces[0], pose=Pose()), *lens.surfaces[1:]))
    opening, grid = opening_within(Iris(7, 10.0), lens.stop_rim), PixelGrid((90, 130), 250.0, centre_px=(50.0, 44.0))
    turned_rays, all_rays = (ghosts(each, source(9.0, 4.0), grid, opening) for each in (lens, posed))
    np.testing.assert_allclose(all_rays.light.sum(), turned_rays.light.sum(), rtol=0.01)
    difference = np.abs(all_rays.irradiance - turned_rays.irradiance).sum() / turned_rays.irradiance.sum()
    assert difference < 0.03


def test_a_moving_lamp_does_not_flicker():
    lens = bare("zeiss-distagon-25mm", 5.6)
    opening, grid = opening_within(Iris(6), lens.stop_rim), PixelGrid((180, 270), 133.0)
    pictures = [ghosts(lens, source(8.0 + 0.05 * step, 5.0), grid, opening).irradiance for step in range(12)]
    steps = list(pairwise(pictures))
    changes = [np.abs(after - before).sum() / before.sum() for before, after in steps]
    jumps = [abs(after.sum() / before.sum() - 1) for before, after in steps]
    assert max(changes) < 2 * np.median(changes)
    assert max(jumps) < 0.01


def test_neglected_light_is_within_its_share_and_reported():
    lens, grid = bare("zeiss-distagon-25mm", 5.6), PixelGrid((180, 270), 133.0)
    everything, most = (ghosts(lens, source(8.0, 5.0), grid, ROUND, share) for share in (0.0, 0.1))
    drawn = np.nansum(most.light)
    assert np.isnan(most.light).sum() > np.isnan(everything.light).sum()
    assert 0.02 < most.neglected.sum() / (drawn + most.neglected.sum()) < 0.11
    np.testing.assert_allclose(drawn + most.neglected.sum(), np.nansum(everything.light), rtol=0.03)


@pytest.mark.skipif(len(available()) < 2, reason="no library of the loops: no compiler")
def test_all_loops_and_any_threads_draw_the_same_ghosts():
    """By numpy, a single ghost in one band, which takes it seconds."""
    opening = opening_within(Iris(7, 11.0, 0.3), bare("cooke-triplet-50mm", 8.0).stop_rim)
    grid = PixelGrid((27, 41), 888.0, centre_px=(10.0, 17.0))

    def drawn(numbers=None, nm=(450.0, 600.0)):
        return ghosts(bare("cooke-triplet-50mm", 8.0, numbers), source(9.0, 4.0, nm=nm), grid, opening).irradiance

    compiled = []
    for name in available()[1:]:
        with using(name):
            compiled.append(drawn())
    with mock.patch.object(threads, "thread_count", lambda: 1):
        compiled.append(drawn())
    for other in compiled[1:]:
        np.testing.assert_array_equal(other, compiled[0])
    with mock.patch.object(ghost_bands, "PATHS", 1):
        expected = drawn((1, 2))
        with using(NUMPY):
            by_numpy = drawn((1, 2))
    assert np.mean(expected > 0) > 0.5
    np.testing.assert_allclose(by_numpy, expected, rtol=1e-4, atol=1e-5 * expected.max())


@pytest.mark.parametrize("count", [1, 2, 5, 12, 40])
def test_bands_share_all_light_of_every_wavelength(count):
    bands, total = bands_of(np.linspace(400, 700, count)), np.zeros(count)
    for band in bands:
        assert 0 < band.waves.size <= MOST_WAVES and 0 <= band.traced < count
        total[band.waves] += band.weights
    np.testing.assert_allclose(total, 1)
    assert sorted({number for band in halves_of(np.arange(count)) for number in band.waves}) == list(range(count))


def test_light_of_all_wavelengths_along_the_paths_of_four():
    """Of a lens whose coatings change with the wavelength: as along the paths of each."""
    lens, nm = turned(prescription_of("nikkor-28mm"), Rings(f_number=4.0)).prescription, tuple(np.linspace(400, 700, 8))
    grid = PixelGrid((120, 180), 200.0)
    blended = ghosts(lens, source(9.0, 4.0, nm=nm), grid, ROUND).irradiance
    with mock.patch.object(ghost_bands, "PATHS", len(nm)):
        traced = ghosts(lens, source(9.0, 4.0, nm=nm), grid, ROUND).irradiance
    np.testing.assert_allclose(blended.sum(axis=(1, 2)), traced.sum(axis=(1, 2)), rtol=0.005)
    assert np.all(np.abs(blended - traced).sum(axis=(1, 2)) < 0.05 * traced.sum(axis=(1, 2)))


def test_a_lens_without_coatings_has_no_ghosts():
    lens = replace(bare("cooke-triplet-50mm"), coating="ideal")
    found = ghosts(lens, source(9.0, 4.0), OFF_CENTRE, ROUND)
    assert not found.irradiance.any() and not len(found.pairs)


def test_light_from_behind_makes_no_ghosts():
    lens = bare("cooke-triplet-50mm")
    behind = replace(source(9.0, 4.0), directions=-source(9.0, 4.0).directions)
    assert not ghosts(lens, behind, OFF_CENTRE, ROUND).irradiance.any()


def test_a_near_lamp_lights_as_its_distance_says():
    lens = bare("cooke-triplet-50mm", 8.0)
    grid = PixelGrid((90, 130), 250.0)
    far, near = (ghosts(lens, replace(source(3.0, 2.0), distance_mm=np.array([distance_mm])), grid, ROUND)
                 for distance_mm in (np.inf, 1e7))
    np.testing.assert_allclose(near.irradiance, far.irradiance, atol=0.01 * far.irradiance.max())


@pytest.mark.parametrize("variant", [each for each in available() if each != NUMPY])
@pytest.mark.parametrize("name", ["cooke-triplet-50mm", "cooke-42mm-2x"])
def test_pairs_that_share_parts_of_their_paths_have_the_same_rays(name, variant):
    """In any order, with light that is not reflected among them, and with other boxes in between."""
    lens = ghost_lens(system_of(bare(name, 4.0)), ROUND, np.array([NM]))
    beam, _ = beam_of(lens, source(7.0, 4.0).directions[0], 800.0)
    coated = coatings_of(lens.system, (NM,)).of(bands_of(np.array([NM]))[0])
    limits_mm = np.tile(entrance_mm(lens, beam), (len(lens.pairs) + 1, 1))
    limits_mm[5:8, 1] *= 0.7
    with using(variant):
        for order in (lambda pairs: pairs, np.flipud, np.random.default_rng(3).permutation):
            pairs = order(np.vstack([lens.pairs, [[-1, -1]]]))
            together = trace_ghosts(lens, coated, beam, pairs, limits_mm, 13, 9.0)
            alone = np.concatenate([trace_ghosts(lens, coated, beam, pairs[n:n + 1], limits_mm[n:n + 1], 13, 9.0)
                                    for n in range(len(pairs))])
            arriving = np.isfinite(alone[:, LIGHT:LIGHT + 1])
            assert arriving.sum() > 100
            np.testing.assert_array_equal(np.where(arriving, together, 0), np.where(arriving, alone, 0))
            np.testing.assert_array_equal(np.isfinite(together[:, LIGHT:]), np.isfinite(alone[:, LIGHT:]))
