"""Lens data over a grid: of a radial lens, of an anamorphic one, of one with a displaced element, and with a tilted
sensor."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from afocal import AFOCAL, SQUEEZE
from lensfield.engine import LensError
from lensfield.engine.bake import grid_bake, grid_ends
from lensfield.engine.bake.bake import bake
from lensfield.engine.bake.diffraction import point_spread
from lensfield.engine.bake.grid_bake import bake_grid
from lensfield.engine.bake.grid_ends import grid_ends_mm
from lensfield.engine.bake.quality import QUALITIES
from lensfield.engine.bake.wavefront import trace_wavefronts
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.mirrors import mirrored
from lensfield.engine.prescription.prescription import Pose, Surface
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.field_heights import image_radius_mm
from lensfield.engine.rays.fields import find_fields, trace_fields, view_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.trace import trace_both_ways
from lensfield.engine.rays.view import tilted
from refusals import refused

pytestmark = pytest.mark.one_blender
TWO_NM = np.array([450.0, 650.0])
COARSE = replace(QUALITIES["preview"], between=np.inf, edges=(24, 32))


@pytest.fixture(scope="module")
def triplet():
    return build_system(prescription_of("cooke-triplet-50mm"))


def displaced(system, number, **pose):
    """The lens with a surface's pose."""
    surfaces = list(system.prescription.surfaces)
    surfaces[number] = replace(surfaces[number], pose=Pose(**pose))
    return replace(system.prescription, surfaces=tuple(surfaces))


def on_grid(system, wavelengths_nm=TWO_NM, pitch_um=12.0, samples=65, edges_mm=None):
    ends_mm = grid_ends_mm(system, edges_mm)
    return bake_grid(system, COARSE, np.asarray(wavelengths_nm), ends_mm, pitch_um, samples, None, lambda *_: None)


def centroid(psf):
    """(right, up) of the light, in samples from the chief ray."""
    offset = np.arange(len(psf)) - len(psf) // 2
    return np.array([psf.sum(axis=0) @ offset, psf.sum(axis=1) @ offset])


@pytest.fixture(scope="module")
def radial_on_grid(triplet):
    return on_grid(triplet)


def test_a_radial_lens_has_the_same_light_on_a_grid(triplet, radial_on_grid):
    """Chief rays, illumination and flux, at heights whose chief rays land at the nodes."""
    radial = bake(triplet.prescription, quality=replace(COARSE, most_heights=25), wavelengths_nm=TWO_NM, samples=33)
    assert radial_on_grid.mirrored == (True, True) and radial_on_grid.within[0, 0] == 0
    distance_mm = np.hypot(radial_on_grid.y_mm[:, None], radial_on_grid.x_mm)
    for wavelength in range(2):
        source_mm = radial_on_grid.source_mm[wavelength]
        height_mm = np.hypot(*np.moveaxis(source_mm, -1, 0))
        covered = radial_on_grid.within <= 1
        np.testing.assert_allclose(source_mm[..., 0] * radial_on_grid.y_mm[:, None],
                                   source_mm[..., 1] * radial_on_grid.x_mm, atol=1e-6)
        for table, expected, error in ((distance_mm, radial.real_height_mm, 1e-4),
                                       (radial_on_grid.relative_illumination[wavelength],
                                        radial.relative_illumination, 2e-3),
                                       (radial_on_grid.point_flux[wavelength], radial.point_flux, 2e-3)):
            between = np.interp(height_mm, radial.heights_mm, expected[wavelength])
            np.testing.assert_allclose(table[covered], between[covered], atol=max(error, 3e-3))
    assert radial_on_grid.f_number_effective == pytest.approx(radial.f_number_effective, rel=1e-6)


@pytest.mark.parametrize("row, column, turns", [(0, 0, 0), (-1, 0, 0), (0, 2, -1)])
def test_its_psfs_are_those_of_heights_turned(triplet, radial_on_grid, row, column, turns):
    """Upwards as they are; to the right a quarter turn clockwise, with rows upwards."""
    height_mm = np.hypot(*radial_on_grid.source_mm[0, row, column])
    wavefront = trace_wavefronts(triplet, [height_mm], TWO_NM[:1], COARSE.pupil).one(0, 0)
    psf = point_spread(wavefront, 12.0, 65, COARSE.sums)
    expected = np.rot90(psf / psf.sum(), -turns)  # rows ascend with y, so a turn looks reversed
    assert np.abs(radial_on_grid.psf[0, row, column] - expected).sum() < 2e-3
    assert abs(centroid(expected)).max() > 0.1 or (row, column) == (0, 0)


def test_its_coma_points_outwards_everywhere(radial_on_grid, triplet):
    """Off the axes, along the diagonal from the axis, as on them."""
    x, y = centroid(radial_on_grid.psf[0, 1, 1])
    right_mm, up_mm = radial_on_grid.x_mm[1], radial_on_grid.y_mm[1]
    along, across = np.array([[right_mm, up_mm], [-up_mm, right_mm]]) @ (x, y) / np.hypot(right_mm, up_mm)
    height_mm = np.hypot(*radial_on_grid.source_mm[0, 1, 1])
    psf = point_spread(trace_wavefronts(triplet, [height_mm], TWO_NM[:1], COARSE.pupil).one(0, 0), 12.0, 65,
                       COARSE.sums)
    assert along == pytest.approx(centroid(psf / psf.sum())[1], abs=0.01) and abs(across) < 0.01
    assert abs(along) > 0.05


@pytest.fixture(scope="module")
def anamorphic(triplet):
    lens = triplet.prescription
    return build_system(replace(lens, name="anamorphic", surfaces=AFOCAL + lens.surfaces, sensor_mm=(12.0, 9.0),
                                reference_wavelength_nm=587.5618))


@pytest.fixture(scope="module")
def squeezed(anamorphic):
    return on_grid(anamorphic, [587.5618])


def test_an_afocal_pair_of_cylinders_squeezes_the_width(anamorphic, squeezed, triplet):
    assert squeezed.squeeze == pytest.approx(SQUEEZE, rel=1e-6) and squeezed.mirrored == (True, True)
    assert squeezed.efl_mm == pytest.approx(triplet.efl_mm, rel=1e-9), "along y"
    area = trace_wavefronts(triplet, [0.0], [587.5618], COARSE.pupil).areas(24, 32)[0][0, 0]
    assert squeezed.f_number_effective == pytest.approx(0.5 / np.sqrt(area / np.pi), rel=1e-3)
    np.testing.assert_allclose(squeezed.source_mm[0, 0, 1], (squeezed.x_mm[1], 0), rtol=0.03, atol=1e-9)
    np.testing.assert_allclose(squeezed.source_mm[0, 1, 0], (0, squeezed.y_mm[1]), rtol=0.03, atol=1e-9)
    assert squeezed.point_flux[0, 0, 0] == pytest.approx(1, abs=0.03)
    assert (squeezed.enclosed_energy > 0.95).all()


def test_chief_rays_from_its_sources_land_at_its_nodes(anamorphic, squeezed):
    """Searched for from the object's side."""
    indices = anamorphic.indices_at([587.5618])[:, :, None]
    for row, column in ((1, 2), (-1, -1)):
        x_mm, y_mm = squeezed.source_mm[0, row, column]
        towards = -np.array([x_mm * squeezed.squeeze, y_mm]) / squeezed.capture_focal_length_mm

        found = scipy.optimize.root(_off, towards / (SQUEEZE, 1.0), (anamorphic, indices, towards), tol=1e-13)
        landed_mm = _chief_ray(anamorphic, indices, found.x).position[:2, 0, 0]
        np.testing.assert_allclose(-landed_mm, (squeezed.x_mm[column], squeezed.y_mm[row]), atol=1e-7)


def _chief_ray(system, indices, slopes):
    return trace_both_ways(system.prescription, indices, *np.zeros((2, 1, 1)), *np.reshape(slopes, (2, 1, 1)))


def _off(slopes, system, indices, towards):
    """Tangents of a chief ray in front of the lens, relative to those of an object point at infinity."""
    before = _chief_ray(system, indices, slopes).before[:, 0, 0]
    return before[:2] / before[2] - towards


def test_a_mirrored_quadrant_is_that_of_the_complete_grid(anamorphic, squeezed, monkeypatch):
    for module in (grid_bake, grid_ends):
        monkeypatch.setattr(module, "mirrored", lambda prescription: (False, False))
    complete = on_grid(anamorphic, [587.5618])
    rows, columns = squeezed.y_mm.size, squeezed.x_mm.size
    assert complete.psf.shape[1:3] == (2 * rows - 1, 2 * columns - 1)
    for name in ("psf", "relative_illumination", "point_flux", "source_mm", "within"):
        table, quadrant = getattr(complete, name), getattr(squeezed, name)
        ahead = (0,) if name == "within" else (0, 1)
        corner = table[(0,) * (len(ahead) - 1)][rows - 1:, columns - 1:]
        opposite = table[(0,) * (len(ahead) - 1)][rows - 1::-1, columns - 1::-1]
        opposite = {"psf": opposite[..., ::-1, ::-1], "source_mm": -opposite}.get(name, opposite)
        expected = quadrant if name == "within" else quadrant[0]
        np.testing.assert_allclose(corner, expected, atol=1e-6)
        np.testing.assert_allclose(opposite, expected, atol=1e-5)


def test_a_displaced_element_has_coma_on_the_axis_in_its_direction(triplet):
    """The mean of the rays, whose image is upside down."""
    crooked = build_system(displaced(triplet, 2, offset_mm=(0.3, 0.15, 0.0)))
    lens = on_grid(crooked, [550.0], pitch_um=6.0)
    assert lens.mirrored == (False, False)
    middle = lens.middle
    assert (lens.y_mm[middle[0]], lens.x_mm[middle[1]]) == (0, 0)
    view = view_of(crooked)
    rays = trace_fields(crooked, view, find_fields(crooked, view, np.zeros((2, 1)), [550.0]), COARSE.full_pupil)
    inside = np.all(rays.square_height_mm2 <= crooked.semi_apertures_mm.reshape(-1, 1, 1, 1, 1)**2, axis=0)
    light = COARSE.full_pupil.radii[:, None] * inside
    mean_mm = np.sum(light * rays.position_mm, axis=(-2, -1))[:, 0, 0] / light.sum()
    across, up = centroid(lens.psf[0, *middle]) * lens.psf_pitch_um * 1e-3
    np.testing.assert_allclose((across, up), -mean_mm, atol=0.1 * np.hypot(*mean_mm))
    assert np.hypot(across, up) > 2e-3 and across / up == pytest.approx(2, rel=0.1)


@pytest.mark.parametrize("tilt_deg", [(5.0, 0.0), (-3.0, 4.0)])
def test_the_plane_of_focus_of_a_tilted_sensor_leans_by_scheimpflug(triplet, tilt_deg):
    """Focused at infinity, it is parallel to the camera's axis at the distance f / sin(tilt) from the lens."""
    far = build_system(replace(triplet.prescription, focus="paraxial"))
    lens = on_grid(build_system(tilted(far, tilt_deg)), [587.5618], pitch_um=8.0)
    normal = Pose(tilt_deg=(*tilt_deg, 0.0)).rotation[:, 2]
    np.testing.assert_allclose(lens.focus_slope, normal[:2] / far.efl_mm**2, rtol=0.01, atol=1e-12)
    assert lens.mirrored == (False, tilt_deg[1] == 0)
    np.testing.assert_allclose(lens.source_mm[0, *lens.middle], 0, atol=5e-3)
    level = on_grid(far, [587.5618], pitch_um=8.0)
    assert lens.psf[0, lens.middle[0] + 1, lens.middle[1]].max() > 0.5 * level.psf[0, 1, 0].max()
    assert lens.psf[0, lens.middle[0] - 1, lens.middle[1]].max() > 0.5 * level.psf[0, 1, 0].max()


def test_tilting_keeps_the_image_in_focus(triplet):
    """An object point of the plane in focus, imaged by the lens's principal planes, is on the sensor."""
    near = build_system(replace(triplet.prescription, object_distance_mm=800.0, focus="paraxial"))
    system = system_of(tilted(near, (5.0, -3.0)))
    view, efl_mm = view_of(system), near.efl_mm
    front_mm = efl_mm - near.front_focus_mm  # principal planes, from the first and the last vertex
    rear_mm = near.image_distance_mm - 1 / (1 / efl_mm - 1 / (800 + front_mm))
    for tangent in np.array([[0.0, 0.0], [0.1, 0.0], [-0.05, 0.15]]):
        nearness = view.nearness + view.lean @ tangent
        point_mm = view.viewpoint_mm - view.axes.T @ [*tangent, 1] / nearness
        depth_mm = front_mm - point_mm[2]
        behind_mm = 1 / (1 / efl_mm - 1 / depth_mm)
        image_mm = np.array([*(-point_mm[:2] * behind_mm / depth_mm), rear_mm + behind_mm])
        pose, last = system.prescription.image_pose, system.prescription.surfaces[-1]
        assert view.axes[2] @ (image_mm - [0, 0, last.thickness_mm] - pose.offset_mm) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("surface, expected", [
    (Surface(50.0, pose=Pose((0.0, 0.1, 0.0))), (False, True)),
    (Surface(50.0, pose=Pose((0.1, 0.0, 0.3))), (True, False)),
    (Surface(50.0, pose=Pose(tilt_deg=(1.0, 0.0, 0.0))), (False, True)),
    (Surface(50.0, pose=Pose(tilt_deg=(1.0, 0.0, 90.0))), (True, False)),
    (Surface(50.0, pose=Pose(tilt_deg=(0.0, 0.0, 33.0))), (True, True)),
    (Surface(50.0, radius_x_mm=np.inf), (True, True)),
    (Surface(50.0, radius_x_mm=np.inf, pose=Pose(tilt_deg=(0.0, 0.0, 90.0))), (True, True)),
    (Surface(50.0, radius_x_mm=np.inf, pose=Pose(tilt_deg=(0.0, 0.0, 30.0))), (False, False)),
    (Surface(50.0, radius_x_mm=np.inf, pose=Pose(tilt_deg=(0.0, 2.0, 90.0))), (False, True))])
def test_mirrors_follow_from_the_poses_of_surfaces(triplet, surface, expected):
    lens = replace(triplet.prescription, surfaces=(surface, *triplet.prescription.surfaces))
    assert mirrored(lens) == expected


def test_nodes_beyond_the_field_hold_the_light_of_its_end(triplet):
    """A sensor larger than the image circle: tables continue, and the source linearly."""
    small = build_system(replace(triplet.prescription, field=("image_height_mm", 9.0),
                                 surfaces=(*triplet.prescription.surfaces[:-1],
                                           replace(triplet.prescription.surfaces[-1], pose=Pose((0.0, 1e-6, 0.0))))))
    lens = on_grid(small, [587.5618])
    beyond = lens.within > 1
    assert 0 < beyond.sum() < beyond.size
    assert (lens.relative_illumination[0][beyond] > 0).all() and np.isfinite(lens.source_mm).all()
    np.testing.assert_allclose(lens.psf.sum(axis=(-2, -1)), 1, atol=1e-4)


LANDSCAPE, PORTRAIT = (-18.0, -12.0, 18.0, 12.0), (-12.0, -18.0, 12.0, 18.0)
DISPLACED = {"offset_mm": (0.1, 0.05, 0.0)}


@pytest.mark.parametrize("pose, edges_mm, expected", [
    ({}, None, ((0, 12.48), (0, 18.72))), ({}, LANDSCAPE, ((0, 12.48), (0, 18.72))),
    ({}, (-9, -6, 9, 6), ((0, 12.48), (0, 18.72))), ({}, PORTRAIT, ((0, 18.72), (0, 12.48))),
    ({}, (-18, -15.5, 18, 8.5), ((0, 18.48), (0, 18.72))),
    ({}, (-18, -14.5, 18, 9.5), ((0, 15.48), (0, 18.72))),
    (DISPLACED, PORTRAIT, ((-18.72, 18.72), (-12.48, 12.48))),
    (DISPLACED, (-16, -17, 8, 19), ((-18.72, 21.72), (-18.48, 12.48)))])
def test_the_grid_reaches_as_far_as_the_frame(triplet, pose, edges_mm, expected):
    """A sensor of 36 x 24 mm plus 4 %, turned with the frame, in steps of 3 mm; a circle of 21.7 mm."""
    system = build_system(displaced(triplet, 2, **pose)) if pose else triplet
    expected = np.clip(expected, -21.7027, 21.7027)
    np.testing.assert_allclose(grid_ends_mm(system, edges_mm), expected, atol=1e-4)


def test_the_grid_ends_at_the_image_circle(triplet):
    lower, upper = grid_ends_mm(build_system(displaced(triplet, 2, **DISPLACED)), (-90.0, 20.0, 90.0, 44.0))[0]
    assert (lower, upper) == (-12.48, pytest.approx(image_radius_mm(triplet)))


def test_the_sensor_of_an_anamorphic_lens_is_not_turned(anamorphic):
    """Its cylinders stay upright: a portrait frame is a crop of its width."""
    assert grid_ends_mm(anamorphic, (-3.0, -4.5, 3.0, 4.5)) == grid_ends_mm(anamorphic) == ((0, 4.68), (0, 6.24))


def test_the_nodes_of_a_shifted_frame_have_the_psfs_of_their_places(triplet, radial_on_grid):
    """Of a radial lens above the sensor: those of the same distance from the axis on the right, turned."""
    shifted = on_grid(triplet, edges_mm=(-18.0, -9.0, 18.0, 15.0))
    assert shifted.mirrored == (True, True) and shifted.x_mm[-1] == radial_on_grid.x_mm[-1]
    assert shifted.y_mm[-1] == pytest.approx(15.48) and shifted.sensor_mm == radial_on_grid.sensor_mm
    height_mm = np.hypot(*shifted.source_mm[0, -1, 0])
    psf = point_spread(trace_wavefronts(triplet, [height_mm], TWO_NM[:1], COARSE.pupil).one(0, 0), 12.0, 65,
                       COARSE.sums)
    assert np.abs(shifted.psf[0, -1, 0] - psf / psf.sum()).sum() < 2e-3


def test_a_number_of_heights_is_refused(triplet):
    with refused(LensError, field="heights", value=5, where="cooke-triplet-50mm", match="rotational symmetry"):
        bake(displaced(triplet, 2, offset_mm=(0.0, 0.1, 0.0)), heights=5)
