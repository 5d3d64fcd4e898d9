"""The ray table against the lens: points in space are traced through the lens, and the table returns the same rays."""

import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import trapezoid

from lensfield.engine import LensError
from lensfield.engine.bake.wavefront import trace_wavefronts
from lensfield.engine.library import BUNDLED
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.prescription.readers import read_prescription
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.aiming import aim_at_image
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.light_end import light_end
from lensfield.engine.rays.pupil import PupilQuadrature
from lensfield.engine.rays.ray_table import FINER_PUPIL, ray_table
from lensfield.engine.rays.rays import HalfPupil, trace_pupil

NEAR = "tessar-50mm at 0.5 m"
lenses = pytest.mark.parametrize("name", ["angenieux-50mm", "apple-phone-4mm", "cooke-triplet-50mm", "edmund-54852",
                                          "kodak-petzval-100mm", "muller-fisheye-25mm", "nikkor-28mm",
                                          "pentax-fisheye-17mm", "tessar-50mm", NEAR])
WAVELENGTHS_NM = (450.0, 550.0, 650.0)


@cache
def focused(name):
    """The focused prescription: by its own focusing, or a Tessar moved towards the scene."""
    if name == NEAR:
        name, near = "tessar-50mm", {"object_distance_mm": 500.0, "field": ("image_height_mm", 20.0)}
    else:
        near = {}
    return build_system(replace(read_prescription(BUNDLED / "prescriptions" / f"{name}.toml"), **near)).prescription


@cache
def table_of(name):
    return ray_table(focused(name))


def random_stop(count, seed=1):
    """Points spread evenly over one half of the stop, the first at its centre."""
    rng, stop = np.random.default_rng(seed), HalfPupil(1, count)
    radius, azimuth = np.sqrt(rng.uniform(0, 1, count)), rng.uniform(0, np.pi, count)
    radius[0] = 0
    stop.x, stop.y = radius * np.sin(azimuth)[None], radius * np.cos(azimuth)[None]
    return stop


def visible_points(name, distance_mm):
    """A system with objects this far from the first surface, and paraxial image heights within the table's field."""
    system, table = system_of(replace(focused(name), object_distance_mm=distance_mm)), table_of(name)
    edge = table.rays(0, np.array([0.0, table.last_height_mm]), np.zeros(2)).direction
    return system, np.linspace(0.05, 0.95, 8) * system.heights_of(-distance_mm * edge[1] / edge[2])


def scales(system, heights_mm):
    """Scales of the picture, in mm on the sensor per mm of the object, across the field and along it."""
    before, here, after = (trace_pupil(system, heights_mm * share, WAVELENGTHS_NM, HalfPupil(1, 1)).chief_height_mm
                           for share in (0.999, 1, 1.001))
    points_mm = system.fields_of(heights_mm)
    return (here / points_mm)[..., None, None], ((after - before) / (0.002 * points_mm))[..., None, None]


def points_and_table(name, distance_mm):
    """A system with objects at a distance, some points, their rays, those that the table covers, and the table's rays.
    """
    (system, heights_mm), stop, table = visible_points(name, distance_mm), random_stop(400), table_of(name)
    true = trace_pupil(system, heights_mm, WAVELENGTHS_NM, stop)
    reached = ~true.lost & (np.hypot(*true.position_mm) <= table.last_height_mm)
    rays = table.at(WAVELENGTHS_NM).rays(np.arange(3)[:, None, None, None], np.where(reached, true.position_mm, 0.0),
                                         np.stack([stop.x, stop.y]))
    return system, system.fields_of(heights_mm)[:, None, None], true, reached, rays


def through(system, rays):
    return np.all(rays.square_height_mm2 <= system.semi_apertures_mm.reshape(-1, 1, 1, 1, 1)**2, axis=0)


def missed_um(system, points_mm, rays):
    """The distance by which rays miss the points, measured on the sensor."""
    depth_mm = system.prescription.object_distance_mm + system.entrance_pupil_mm
    x, y = rays.entrance_mm - depth_mm * rays.direction[:2] / rays.direction[2]
    across, along = scales(system, system.heights_of(points_mm[:, 0, 0]))
    return 1e3 * np.hypot(across * x, along * (y - points_mm))


@lenses
@pytest.mark.sample(7)
@pytest.mark.parametrize("focal_lengths", [10, 200])
def test_it_contains_the_rays_of_points_in_space_through_the_lens(name, focal_lengths):
    """To 0.04 um on the sensor and 0.05 waves; at their rims, steep aspheres leave 1 um, less than a phone's pixel."""
    distance_mm = focal_lengths * system_of(focused(name)).efl_mm
    system, points_mm, true, reached, rays = points_and_table(name, distance_mm)
    passing = reached & through(system, true)
    assert 0.1 < passing.mean() and np.mean(((rays.margin > 0) != passing)[reached]) < 0.003

    off_um = missed_um(system, points_mm, rays)[passing]
    assert np.quantile(off_um, 0.99) < 0.04 and off_um.max() < (1.0 if "phone" in name else 0.1)

    depth_mm = distance_mm + system.entrance_pupil_mm
    to_entrance_mm = np.sqrt(rays.entrance_mm[0]**2 + (rays.entrance_mm[1] - points_mm)**2 + depth_mm**2)
    path_mm = to_entrance_mm + rays.path_mm - true.path_mm
    waves = np.abs(path_mm - path_mm[..., :1]) * 1e6 / np.reshape(WAVELENGTHS_NM, (3, 1, 1, 1))
    assert waves[passing].max() < 0.05


@pytest.mark.parametrize("name", ["nikkor-58mm-f1.4"])
def test_it_is_traced_more_finely_where_two_rays_meet_near_the_passing_ones(name):
    """Of two rays through the same points, the lens passes one, and the table contains that one."""
    system, points_mm, true, reached, rays = points_and_table(name, 200 * system_of(focused(name)).efl_mm)
    passing, off_um = reached & through(system, true), missed_um(system, points_mm, rays)
    assert table_of(name).coefficients.shape[2] == FINER_PUPIL.radii.size + 2 > table_of(NEAR).coefficients.shape[2]
    assert np.quantile(off_um[passing], 0.99) < 1.0 and np.mean(off_um[passing] > 2.0) < 0.01
    other = reached & ~passing & (off_um > 300)
    assert other.any() and not np.any((rays.margin <= 0) & passing & (off_um > 300))


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["nikkor-58mm-f1.4", "sony-zeiss-55mm-f1.8", "voigtlander-nokton-50mm-f1"])
def test_splines_do_not_oscillate_beyond_the_rims(name):
    """Splines between values far beyond the rims do not oscillate: uniform light falls off steadily at all wavelengths.
    """
    table = table_of(name)
    light = table.near(np.arange(405, 700, 7.0)).irradiance_per_radiance(np.linspace(0, table.last_height_mm, 129))
    steps = np.diff(light, axis=1) / light[:, :1]
    assert steps.max() < 0.002 and np.diff(steps, axis=1).max() < 0.005


@lenses
def test_its_weights_preserve_the_light(name):
    """A small stop accepts as much light from a part of the scene as reaches its sensor position, by chief rays."""
    lens = focused(name)
    system = build_system(replace(lens, aperture=("stop", 0.005 / abs(build_system(lens).marginal_slope)
                                                  * lens.aperture[1])))
    fields = np.linspace(0.05, 0.95, 7) * system.fields_of([system.last_height_mm])
    taken_in, here_mm = light_taken_in(system, fields)
    before_mm, after_mm = (light_taken_in(system, fields * share)[1] for share in (0.999, 1.001))
    part = np.sin(fields) if system.object_at_infinity else fields
    irradiance = taken_in * part / here_mm * 0.002 * fields / (after_mm - before_mm)
    table, stop = ray_table(system.prescription, [550.0]), HalfPupil(17, 33)
    rays = table.rays(0, np.stack([0 * here_mm, here_mm])[..., None, None], np.stack([stop.x, stop.y]))
    summed = [trapezoid(trapezoid(stop.radii[:, None] * each, stop.azimuths), stop.radii) for each in rays.weight]
    np.testing.assert_allclose(np.array(summed) * 2, np.abs(irradiance), rtol=1e-3)


@pytest.mark.parametrize("name", ["angenieux-50mm", "apple-phone-4mm", "kodak-petzval-100mm", NEAR])
def test_uniform_light_from_the_scene_is_as_bright_as_its_rays(name):
    """Rings of a bright scene send light through the full aperture: it lands on rings of the sensor, wherever
    aberrations take it, with the irradiance of the table's rays. Surfaces that rays cross backwards from the sensor can
    have several sheets: that loses 3 % of a phone's rays at 0.9 of the field, which do reach the sensor."""
    table = table_of(name)
    edges_mm = table.last_height_mm * np.linspace(0.05, 0.95, 10)
    landed = light_on_rings(build_system(focused(name)), 555.9, edges_mm)
    within_mm = np.sqrt(np.linspace(edges_mm[:-1]**2, edges_mm[1:]**2, 17))  # equal areas of each ring
    rays = table.irradiance_per_radiance(within_mm.ravel())[3].reshape(within_mm.shape)
    np.testing.assert_allclose(landed, trapezoid(rays, axis=0) / 16, rtol=3e-3)  # one of the scene's rings in 330


def light_on_rings(system, wavelength_nm, edges_mm, rings=3200):
    """Irradiance over radiance on rings of the sensor, by rays from rings of the scene."""
    last, = system.fields_of([light_end(system, (wavelength_nm,)).height_mm])
    fields, pupil = (np.arange(rings) + 0.5) / rings * last, HalfPupil(17, 21)
    wavefronts = trace_wavefronts(system, system.heights_of(fields), [wavelength_nm], pupil)
    extent = np.sin(np.abs(fields)) if system.object_at_infinity else np.abs(fields)
    quadrature, light = PupilQuadrature(pupil, 24, 32), np.zeros(edges_mm.size - 1)
    for field in range(rings):
        at = 0, field
        x_mm, y_mm = wavefronts.spot_mm[:, *at]
        radius_mm = np.hypot(quadrature.splines.values(x_mm, odd=True),
                             quadrature.splines.values(y_mm) + wavefronts.chief_height_mm[*at])
        passing = quadrature.cells * quadrature.coverage(wavefronts.limits[:, *at])
        beam = 2 * np.abs(quadrature.splines.jacobian(*wavefronts.source[:, *at])) * passing
        light += extent[field] * np.histogram(radius_mm, edges_mm, weights=beam)[0]
    return 2 * np.pi * abs(last) / rings * light / (np.pi * np.diff(edges_mm**2))


def light_taken_in(system, fields):
    """Light of unit radiance that the full stop accepts from field points, and where their chief rays land."""
    stop = HalfPupil(9, 13)
    rays = trace_pupil(system, system.heights_of(fields), [550.0], stop)
    quadrature = PupilQuadrature(stop, 12, 16)
    areas = np.abs(quadrature.splines.jacobian(*rays.source[:, 0])) * quadrature.cells
    return 2 * areas.sum(axis=(1, 2)), rays.chief_height_mm[0]


def hyperbola():
    """Flat in front, at its stop, with a rear hyperboloid of conic -n^2: all axial rays meet."""
    surfaces = (Surface(thickness_mm=8.0, glass="1.5/60", stop=True), Surface(-10.0, 20.0, conic=-2.25))
    return Prescription("hyperbola", surfaces, ("f_number", 2.0), ("angle_deg", 5.0), reference_wavelength_nm=587.5618)


def test_rays_from_the_focus_of_a_perfect_lens_leave_parallel_with_equal_paths():
    table = ray_table(hyperbola(), [587.5618])
    stop = random_stop(100)
    rays = table.rays(0, np.zeros(2), np.stack([stop.x, stop.y]))
    np.testing.assert_allclose(rays.entrance_mm, 5 * np.stack([stop.x, stop.y]), atol=1e-5)
    np.testing.assert_allclose(rays.direction[:2], 0, atol=1e-7)
    np.testing.assert_allclose(rays.path_mm, 0, atol=1e-6)
    assert np.all(rays.margin >= -1e-12)


def test_it_rotates_with_the_sensor_position_and_is_mirror_symmetric():
    table, rng = table_of("angenieux-50mm"), np.random.default_rng(2)
    stop, height_mm, turn = rng.uniform(-0.7, 0.7, (2, 50)), rng.uniform(0, 14, 50), rng.uniform(-4, 4, 50)
    upright = table.rays(2, np.stack([0 * height_mm, height_mm]), stop)

    def turned(vector):
        x, y = vector
        return np.stack([x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)])

    rays = table.rays(2, turned(np.stack([0 * height_mm, height_mm])), turned(stop))
    mirrored = table.rays(2, np.stack([0 * height_mm, height_mm]), stop * [[-1], [1]])
    for other, moved in ((rays, turned), (mirrored, lambda vector: vector * [[-1], [1]])):
        np.testing.assert_allclose(other.entrance_mm, moved(upright.entrance_mm), atol=1e-11)
        np.testing.assert_allclose(other.direction[:2], moved(upright.direction[:2]), atol=1e-13)
        for name in ("margin", "path_mm", "weight"):
            np.testing.assert_allclose(getattr(other, name), getattr(upright, name), rtol=1e-9, atol=1e-12)


def test_a_smaller_stop_has_a_subset_of_its_rays():
    lens = focused("cooke-triplet-50mm")
    kind, size = lens.aperture
    small, stop = ray_table(replace(lens, aperture=(kind, size / 2))), random_stop(50)
    place_mm, stop = np.array([[0.0], [12.0]]), np.stack([stop.x, stop.y])[:, 0]
    wide, small = table_of("cooke-triplet-50mm").rays(1, place_mm, stop / 2), small.rays(1, place_mm, stop)
    np.testing.assert_allclose(wide.entrance_mm, small.entrance_mm, atol=1e-4)
    np.testing.assert_allclose(4 * small.weight, wide.weight, rtol=1e-3)


def test_its_margin_shows_where_no_ray_gets_through():
    """Without surface apertures, only rays that miss a surface are lost, to half the spacing of the table's rays."""
    lens = focused("angenieux-50mm")
    open_lens = replace(lens, aperture=(lens.aperture[0], 1.2 * lens.aperture[1]),
                        surfaces=tuple(replace(each, semi_aperture_mm=np.inf) for each in lens.surfaces))
    system, table, stop = build_system(open_lens), ray_table(open_lens, [550.0]), random_stop(600)
    heights_mm = np.linspace(0.3, 0.99, 6) * table.last_height_mm
    places = (system.stop_semi_aperture_mm * each[0] for each in (stop.x, stop.y))
    aimed = aim_at_image(system, system.indices_at([550.0]), heights_mm, *places)[2][0]
    rays = table.rays(0, np.stack([0 * heights_mm, heights_mm])[..., None], np.stack([stop.x, stop.y]))
    assert 0.03 < np.mean(~aimed) and np.mean(aimed != (rays.margin > 0)) < 0.025
    assert np.all(np.isfinite(rays.entrance_mm)) and np.all(np.isfinite(rays.direction))


def test_it_ends_with_the_field_and_states_where():
    with pytest.raises(LensError, match="tessar-50mm: sensor position is 30 mm from the axis: the lens's field ends"):
        table_of("tessar-50mm").rays(0, np.array([0.0, 30.0]), np.zeros(2))


def test_wavelengths_outside_its_range_are_an_error():
    with pytest.raises(LensError, match=r"tessar-50mm: wavelengths is \[550.0, 701.0\]: .* covers 400 to 700 nm"):
        table_of("tessar-50mm").at([550.0, 701.0])


def test_it_is_a_value():
    table = table_of("tessar-50mm")
    again = pickle.loads(pickle.dumps(table))
    assert again == table and hash(again) == hash(table) and again != table.at(WAVELENGTHS_NM)
    assert not table.coefficients.flags.writeable and "tessar" in repr(table)


@lenses
def test_bundles_equal_the_single_rays(name):
    rng = np.random.default_rng(3)
    table = table_of(name)
    radius, azimuth = np.sqrt(rng.random(50)), 2 * np.pi * rng.random(50)
    stop = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)])
    heights_mm = np.linspace(0, table.last_height_mm, 7)
    bundles = table.bundles(heights_mm, stop)
    places_mm = np.stack([0 * heights_mm, heights_mm])[:, :, None]
    rays = table.rays(np.arange(len(table.wavelengths_nm))[:, None, None], places_mm, stop[:, None])
    for name in ("entrance_mm", "direction", "margin", "path_mm", "weight"):
        one, other = getattr(bundles, name), getattr(rays, name)
        assert one.shape == other.shape
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())


@lenses
def test_a_sketch_serves_pixels_of_a_160th_of_the_picture(name):
    """The directions of passing rays differ by less than a 20th of a pixel, and the light of a place by 3 %."""
    table, sketch = table_of(name), ray_table(focused(name), sketch=True)
    stop, heights_mm = random_stop(1024), np.linspace(0, table.last_height_mm, 40)
    rays, sketched = (each.bundles(heights_mm, np.stack([stop.x[0], stop.y[0]])) for each in (table, sketch))
    passing = np.minimum(rays.surface_margin, sketched.surface_margin) > 0
    pixel_rad = 2 * table.last_height_mm / 160 / abs(build_system(focused(name)).efl_mm)
    apart_rad = np.linalg.norm(sketched.direction - rays.direction, axis=0)
    assert 0 < apart_rad[passing].max() < 0.05 * pixel_rad
    light, sketched_light = ((each.weight * np.clip(20 * each.surface_margin + 0.5, 0, 1)).sum(axis=-1)
                             for each in (rays, sketched))
    assert np.allclose(sketched_light, light, rtol=0.03)


def test_a_table_ends_where_the_light_of_the_first_wavelength_does():
    """Small, for a frame beyond its field: at 400 nm, no ray reaches the last light of 700 nm."""
    design = focused("zeiss-biotar-50mm")
    small = design.scaled(6.08575 / build_system(design).capture_focal_length_mm)
    wavelengths_nm = np.linspace(400, 700, 7)
    table = ray_table(small, wavelengths_nm, sketch=True)
    end = light_end(build_system(small), (400.0, 700.0))
    ends = trace_pupil(build_system(small), [end.height_mm], wavelengths_nm, HalfPupil(1, 1))
    assert table.dark_beyond and table.last_height_mm == ends.chief_height_mm.min()


def test_a_table_ends_just_inside_the_fold_of_the_field():
    """Small, for a frame beyond its field: the light ends where the field folds back, between two slopes of the search
    for chief rays."""
    design = focused("kodak-petzval-100mm")
    small = replace(design.scaled(6.08575 / build_system(design).capture_focal_length_mm), sensor_mm=(4.8, 3.6))
    table, end = ray_table(small, sketch=True), light_end(build_system(small), (400.0, 700.0))
    ends = trace_pupil(build_system(small), [end.height_mm], table.wavelengths_nm, HalfPupil(1, 1))
    assert table.dark_beyond and 0.999 < table.last_height_mm / ends.chief_height_mm.min() < 1
