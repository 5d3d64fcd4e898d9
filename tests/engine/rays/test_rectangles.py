"""Rectangular apertures: rays beyond them end, in tracing, in bakes, in tables of rays, in depth, and in ghosts."""

from dataclasses import replace

import numpy as np
import pytest

from crooked_lens import CROOKED
from lensfield.engine import LensError
from lensfield.engine.bake.bake import bake
from lensfield.engine.depth.cast import cast
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.inspection.screen import check_prescription
from lensfield.engine.kernels.ghost_meshes import LIMIT
from lensfield.engine.kernels.library import available
from lensfield.engine.lens.iris import opening
from lensfield.engine.prescription.mirrors import mirrored
from lensfield.engine.prescription.prescription import Pose, Prescription, Surface
from lensfield.engine.prescription.readers import read_prescription
from lensfield.engine.prescription.readers.toml import write_prescription
from lensfield.engine.rays.fields import view_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.from_sensor import lens_from_sensor
from lensfield.engine.rays.grid_rays import grid_ray_table
from lensfield.engine.rays.trace import trace_both_ways
from lensfield.engine.stray.ghost_bands import sample_of
from lensfield.engine.stray.ghost_beams import beam_of, coatings_of, ghost_lens
from lensfield.engine.stray.ghost_rays import trace_ghosts
from loops import using

pytestmark = pytest.mark.one_blender
every_loop = pytest.mark.parametrize("loops", available())
NM = 600.0
HALVES_MM = (0.9, 1.4)
LENS = (Surface(50.0, 2.0, "1.5/60"), Surface(-80.0, 60.0))
SLIT = Prescription("slit", (Surface(stop=True, half_widths_mm=HALVES_MM), *LENS), ("stop", 2.0), ("angle_deg", 2.0),
                    focus="paraxial", reference_wavelength_nm=NM)
IN_FRONT_MM = 12.0
WINDOW = replace(SLIT, aperture=("stop", 1.1), surfaces=(
    Surface(thickness_mm=IN_FRONT_MM, half_widths_mm=HALVES_MM), Surface(stop=True), *LENS))


@every_loop
def test_places_on_a_tilted_rectangle_are_traced(loops):
    """In its own frame: a plane window in front of the stop, which is turned and decentred."""
    pose = Pose((0.4, -0.2, 0.0), (20.0, -10.0, 30.0))
    surfaces = (replace(WINDOW.surfaces[0], pose=pose), *WINDOW.surfaces[1:])
    system = build_system(replace(WINDOW, surfaces=surfaces))
    rng = np.random.default_rng(1)
    (x, y), slope = rng.uniform(-1, 1, (2, 1, 20)), rng.uniform(-0.1, 0.1, (2, 1, 20))
    with using(loops):
        traced = trace_both_ways(system.prescription, system.indices_at([NM])[:, :, None], x, y, *slope)
    normal, vertex = pose.rotation[:, 2], np.array([0.4, -0.2, -IN_FRONT_MM])
    start, along = np.stack([x[0], y[0], np.zeros(20)]), np.stack([*slope[:, 0], np.ones(20)])
    hit = start + (normal @ (vertex[:, None] - start)) / (normal @ along) * along
    own = pose.rotation.T @ (hit - vertex[:, None])
    np.testing.assert_allclose(traced.square_mm2[0, 0], own[0]**2 + own[1]**2, rtol=1e-10)
    np.testing.assert_allclose(traced.square_mm2[-2:, 0], own[:2]**2, rtol=0, atol=1e-10)
    rims = system.rims(traced.square_mm2)[:, 0]
    np.testing.assert_allclose(rims[-2:], (own[:2] / np.reshape(HALVES_MM, (2, 1)))**2, rtol=0, atol=1e-10)
    assert not rims[:-2].any() and system.rim_surfaces.tolist() == [0, 1, 2, 3, 0, 0]


def test_compiled_places_match_numpy():
    """With two rectangles among surfaces of every kind, one of them at the stop."""
    surfaces = list(CROOKED.surfaces)
    for number, halves_mm in ((1, (3.0, 5.0)), (2, (2.0, 1.0))):
        surfaces[number] = replace(surfaces[number], half_widths_mm=halves_mm)
    system = build_system(replace(CROOKED, surfaces=tuple(surfaces), focus="paraxial"))
    rng, results = np.random.default_rng(2), []
    rays = [*rng.uniform(-2, 2, (2, 1, 30)), *rng.uniform(-0.1, 0.1, (2, 1, 30))]
    for loops in available():
        with using(loops):
            results.append(trace_both_ways(system.prescription, system.indices_at([NM])[:, :, None], *rays).square_mm2)
    assert all(result.shape == (5 + 4, 1, 30) for result in results)
    np.testing.assert_allclose(results[0][7, 0], rays[0][0]**2, rtol=1e-12)
    for result in results[1:]:
        np.testing.assert_allclose(result, results[0], rtol=1e-9)


def test_a_rectangular_stop_diffracts_as_a_rectangle():
    """Two sinc^2, the wider one across its narrower side; and the f-number is that of its area."""
    lens, system = bake(SLIT, quality="preview", wavelengths_nm=[NM], samples=65, pitch_um=4.0), build_system(SLIT)
    places_um = 4.0 * (np.arange(65)[:, None] - 32 + np.linspace(-0.5, 0.5, 41))
    across, up = (np.mean(np.sinc(2 * half * places_um / (1e-3 * NM * system.efl_mm))**2, axis=1) for half in HALVES_MM)
    expected = np.outer(up, across)
    middle = np.argmin(np.abs(lens.y_mm)), np.argmin(np.abs(lens.x_mm))
    assert np.abs(lens.psf[0][middle] - expected / expected.sum()).sum() < 0.01
    area = 4 * np.prod(HALVES_MM) / system.efl_mm**2
    assert lens.f_number_effective == pytest.approx(0.5 / np.sqrt(area / np.pi), rel=2e-3)
    assert lens.mirrored == (True, True)


def test_light_of_a_window_in_front_falls_at_its_sides():
    """The overlap of the beam with the rectangle, times cos^4."""
    lens, system = bake(WINDOW, quality="preview", wavelengths_nm=[NM], samples=33), build_system(WINDOW)
    x, y = np.meshgrid(*[np.linspace(-1.1, 1.1, 801)] * 2)
    inside = np.hypot(x, y) < 1.1

    def share(place_mm):
        shift = IN_FRONT_MM * np.array(place_mm) / system.efl_mm
        return np.mean((np.abs(x + shift[0]) < HALVES_MM[0])[inside] & (np.abs(y + shift[1]) < HALVES_MM[1])[inside])

    shares = np.array([[share((x_mm, y_mm)) for x_mm in lens.x_mm] for y_mm in lens.y_mm])
    middle = shares[np.argmin(np.abs(lens.y_mm)), np.argmin(np.abs(lens.x_mm))]
    assert middle < 0.92 and shares.min() < 0.9 * middle
    fall = (1 + (lens.x_mm**2 + lens.y_mm[:, None]**2) / system.efl_mm**2)**-2
    lit = lens.within < 0.98  # nodes at the end of the field have the light of places in front of it
    np.testing.assert_allclose(lens.relative_illumination[0][lit], (shares / middle * fall)[lit], rtol=0.005)


def test_tables_of_rays_end_at_a_rectangle():
    """The window is a plane in front of the lens, where rays are straight. To 0.03, and 0.005 on average: splines
    round off the margin at the rectangle's diagonals."""
    system = build_system(WINDOW)
    table = grid_ray_table(system.prescription, (0.0, 2.0), (0.0, 2.0), (True, True), (550.0, NM))
    view = view_of(system)
    stop = np.random.default_rng(3).uniform(-0.7, 0.7, (2, 60))
    rays = table.bundles(np.array([-1.7, 0.4, 1.2]), np.array([-0.8, 1.6]), stop)
    window_mm = view.turned(-view.viewpoint_mm)[2]
    place_mm = rays.entrance_mm + window_mm * rays.direction[:2] / rays.direction[2]
    expected = 1 - np.max([(place_mm[axis] / HALVES_MM[axis])**2 for axis in (0, 1)], axis=0)
    np.testing.assert_allclose(rays.surface_margin, expected, atol=0.03)
    assert np.abs(rays.surface_margin - expected).mean() < 0.005
    assert (expected > 0).any() and (expected < 0).any()


@every_loop
def test_ghosts_end_at_rectangles(loops):
    """The limit of unreflected light is known where it enters, and reflected light is blocked there, too."""
    for lens, place in ((WINDOW, 0), (SLIT, 0)):
        system = build_system(replace(lens, coating="none"))
        ghosts = ghost_lens(system, opening(None, bake(lens, quality="preview", wavelengths_nm=[NM], samples=9)),
                            np.array([NM]))
        beam, _ = beam_of(ghosts, np.array([0.02, -0.03, 1.0]) / np.sqrt(1.0013), np.inf)
        limits_mm = np.array([[-1.0, 1.0, -1.2, 1.2]] * 2)
        coated = coatings_of(system, (NM,)).of(sample_of(np.array([NM])))
        with using(loops):
            direct, reflected = trace_ghosts(ghosts, coated, beam, np.array([[-1, -1], ghosts.pairs[0]]), limits_mm, 7)
        up, across = np.meshgrid(np.linspace(-1.2, 1.2, 7), np.linspace(-1.0, 1.0, 7), indexing="ij")
        start = np.tensordot(beam.axes[:2].T, np.stack([across, up]), 1)
        hit = start[:2] - start[2] / beam.axes[2, 2] * beam.axes[2, :2].reshape(2, 1, 1)
        limit = np.max((hit / np.reshape(HALVES_MM, (2, 1, 1)))**2, axis=0)
        np.testing.assert_allclose(direct[LIMIT], limit, rtol=1e-9)
        assert np.all(reflected[LIMIT] >= direct[LIMIT] * (1 - 1e-9)) and place in lens.rectangles


def test_rays_from_the_sensor_aim_at_a_rectangle():
    """The widest rectangle of aim is as wide as the aperture, not as the round stop around it."""
    aims = [lens_from_sensor(lens, NM, (-1.0, -1.0, 1.0, 1.0)) for lens in
            (SLIT, replace(SLIT, surfaces=(Surface(stop=True), *LENS), image_pose=Pose()))]
    widths = [np.ptp([each.aim.low_mm, each.aim.high_mm], axis=0).max(axis=(1, 2)) for each in aims]
    assert widths[0] / widths[1] == pytest.approx(np.array(HALVES_MM) / 2.0, rel=0.15)
    assert aims[0].half_widths_mm[-1] == pytest.approx(HALVES_MM) and np.isinf(aims[0].half_widths_mm[:-1]).all()
    assert aims[1].half_widths_mm is None


@pytest.mark.parametrize("pose, expected", [
    (None, (True, True)), (Pose(tilt_deg=(0, 0, 90)), (True, True)), (Pose(tilt_deg=(0, 0, 30)), (False, False)),
    (Pose((0.1, 0, 0)), (True, False)), (Pose(tilt_deg=(5, 0, 0)), (False, True))])
def test_mirror_symmetry(pose, expected):
    surfaces = (replace(SLIT.surfaces[0], pose=pose), *SLIT.surfaces[1:])
    assert mirrored(replace(SLIT, surfaces=surfaces)) == expected and not SLIT.radial


def test_it_is_written_read_and_scaled(tmp_path):
    lens = SLIT.scaled(2.5)
    assert lens.surfaces[0].half_widths_mm == pytest.approx((2.25, 3.5))
    (tmp_path / "slit.toml").write_text(write_prescription(lens))
    assert read_prescription(tmp_path / "slit.toml").surfaces == lens.surfaces


@pytest.mark.parametrize("halves_mm", [(1.0,), (1.0, 0.0), (1.0, -2.0), (1.0, np.inf), (np.nan, 1.0), (1.0, 2.0, 3.0)])
def test_an_invalid_rectangle_is_an_error(halves_mm):
    with pytest.raises(LensError, match="surface 1, half_widths_mm is .*: expected two positive numbers"):
        replace(SLIT, surfaces=(replace(SLIT.surfaces[0], half_widths_mm=halves_mm), *LENS))


def test_a_rectangle_that_blocks_chief_rays_is_named():
    lens = replace(WINDOW, field=("angle_deg", 6.0), focal_length_mm=None)
    assert any(finding.field == "surface 1, half_widths_mm" for finding in check_prescription(lens))


def test_out_of_focus_light_is_a_rectangle():
    """A pixel 1.5 m away, cast through a lens that is focused at infinity: an even rectangle, by similar
    triangles."""
    lens = replace(bake(SLIT, quality="preview", wavelengths_nm=[NM], samples=17), prescription=SLIT)
    grid, depth_mm = PixelGrid((80, 60), 4.0, (52.0, 24.0), (12, 9)), 1500.0
    alpha = np.zeros(grid.shape_px, np.float32)
    alpha[43, 34] = 1
    black = Layer(np.zeros((1, *grid.shape_px), np.float32), np.ones_like(alpha), np.full_like(alpha, 1e9), (0, 0))
    lit = Layer(alpha[None], alpha, np.full_like(alpha, depth_mm), (0, 0))
    scene = LayeredRadiance((lit, black), lens.wavelengths_nm, grid, lens.capture_focal_length_mm)
    plane, = cast(scene, lens, lambda: grid_ray_table(SLIT, *lens.inverted_ends_mm, lens.mirrored), most_rays=1024)
    light, sides_um = plane.blurred, 2e3 * np.array(HALVES_MM) * lens.efl_mm / depth_mm
    for axis, side_um in ((0, sides_um[0]), (1, sides_um[1])):
        profile = light.sum(axis=axis) / light.sum()
        place_px = np.arange(profile.size)
        spread_px = np.sqrt(profile @ place_px**2 - (profile @ place_px)**2)
        assert np.sqrt(12) * spread_px * grid.pitch_um == pytest.approx(side_um, rel=0.03)
    inside = light > 0.5 * np.median(light[light > 0])
    assert inside.sum() * grid.pitch_um**2 == pytest.approx(np.prod(sides_um), rel=0.05)
