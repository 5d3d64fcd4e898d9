"""Lenses without rotational symmetry: against rotationally symmetric ones, and what can be worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import (
    brightest,
    comatic_grid,
    comatic_lens,
    distance_of_light,
    gaussian_psf,
    lopsided_grid,
    make_grid_lens,
    make_lens,
    marked_psf,
    points_image,
    tinted,
)
from lensfield.engine import InputError, LensError, Options, Report, SpectralImage, simulate
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.frame_planes import nearest_samples, pinhole_view, relative_illumination
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.field.overscan import choose_capture
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE
from lensfield.engine.kernels.library import NUMPY, available
from lensfield.engine.plan.choose import make_plan
from lensfield.engine.runtime.memory import MemoryBudget
from loops import using
from refusals import refused

EXACT = Options(method="exact")
METHODS = {"pixels": Options(method="pixels", psf_energy=1.0), "sections": Options(section_size=16, psf_energy=1.0),
           "double": Options(method="pixels", psf_energy=1.0, precision="float64"), "exact": EXACT}
LOPSIDED = tinted(lopsided_grid())
HALF, QUARTER = (False, True), (True, True)


def noise(shape=(45, 58), pitch_um=50.0, seed=0, wavelengths_nm=(550.0,), **facts):
    cube = np.random.default_rng(seed).random((len(wavelengths_nm), *shape)) ** 4
    return SpectralImage(cube, wavelengths_nm, pitch_um=pitch_um, **facts)


def test_a_rotationally_symmetric_lens_on_a_grid_gives_the_same_picture():
    radiance = noise((61, 83), 30.0, centre_px=(20.0, 50.0))
    expected = simulate(radiance, tinted(comatic_lens()), EXACT).cube
    errors = [distance_of_light(simulate(radiance, tinted(comatic_grid(n, n)), Options(method="pixels", psf_energy=1.0)
                                         ).cube, expected) for n in (9, 33)]
    assert errors[1] < errors[0] / 10 and errors[1] < 5e-4  # the square of the distance between nodes


@pytest.mark.parametrize("centre_px", [(22.0, 28.5), (3.0, 50.25), (-40.0, 20.0)])
@pytest.mark.parametrize("method", METHODS)
def test_every_method_mixes_the_psfs_of_the_four_nodes_around_a_pixel(method, centre_px):
    radiance = noise(centre_px=centre_px, wavelengths_nm=(500.0, 640.0))
    expected = simulate(radiance, LOPSIDED, EXACT).cube
    result = simulate(radiance, LOPSIDED, METHODS[method]).cube
    assert expected.sum() > 1 and distance_of_light(result, expected) < 1e-5


def test_points_have_the_flux_of_the_data_before_their_psfs_spread_it():
    lens = make_grid_lens(relative_illumination=lambda nm, x, y: 1 - 0.1 * x)
    flux = 1 - 0.2 * lens.y_mm[:, None] + 0 * lens.relative_illumination
    field = field_map(replace(lens, point_flux=flux)).at_wavelength(550.0)
    expected = (1 - 0.1 * 0.6) * (1 + 0.2 * 1.1)
    assert field.relative_flux(np.array([0.6]), np.array([-1.1])) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("options", [Options(accuracy=0.02), Options(accuracy=0.002, method="pixels"),
                                     Options(accuracy=0.002, method="sections")], ids=str)
def test_misplaced_light_is_at_most_the_plans_bound(options):
    radiance, report = noise(pitch_um=8.0, overscan_px=(3, 4)), Report()
    result = simulate(radiance, LOPSIDED, options, report=report).cube
    error = distance_of_light(result, simulate(radiance, LOPSIDED, EXACT).cube)
    bound = report.lens_image.plan.error_bound
    assert bound <= options.accuracy and 1e-6 < error <= bound


def test_the_bound_is_at_most_twice_the_error_at_the_worst_node():
    lens = make_grid_lens(lambda x, y: gaussian_psf(6 + 10 * x, 4, 2.5, 25), columns=3, rows=3, half_mm=(0.3, 0.4))
    radiance = points_image([(0, 0)], (121, 161), pitch_um=5.0)
    plan = make_plan(Options(accuracy=0.05, method="pixels"), lens, radiance.sampling)
    psfs = field_map(lens).at_wavelength(550.0).psfs(lambda psfs: psfs, Planes(radiance.grid, False))
    trimmed = field_map(lens).at_wavelength(550.0).psfs(plan.trimmed, Planes(radiance.grid, False))
    node = np.array([0]), np.array([160])  # 0.4 mm to the right, 0.3 mm up
    true, used = psfs.psfs(*node)[0], trimmed.psfs(*node)[0]
    rim = (len(true) - len(used)) // 2
    error = np.abs(true - np.pad(used, rim)).sum()
    assert plan.error_bound / 2 < error <= plan.error_bound <= 0.05


@pytest.mark.sample(6)
@pytest.mark.parametrize("shape", [(45, 58), (44, 57)])
@pytest.mark.parametrize("mirrored", [HALF, QUARTER, (True, False)])
@pytest.mark.parametrize("method", ["pixels", "sections", "exact"])
def test_stored_halves_and_quadrants_equal_the_complete_grid(method, mirrored, shape):
    radiance = noise(shape, 60.0)
    complete, part = (tinted(comatic_grid(9, 9, mirrored=each)) for each in ((False, False), mirrored))
    assert field_map(part).mirror_symmetric == all(mirrored)
    result = simulate(radiance, part, METHODS[method]).cube
    assert distance_of_light(result, simulate(radiance, complete, METHODS[method]).cube) < 2e-6


def test_quadrants_of_a_picture_off_the_axis_are_mirrored_too():
    radiance = noise(centre_px=(10.0, 40.0))
    complete, quarter = (tinted(comatic_grid(9, 9, mirrored=each)) for each in ((False, False), QUARTER))
    expected = simulate(radiance, complete, METHODS["pixels"]).cube
    assert distance_of_light(simulate(radiance, quarter, METHODS["pixels"]).cube, expected) < 2e-6


@pytest.mark.parametrize("place", [(12, 7), (-12, 7), (-12, -7), (12, -7)])
def test_psfs_point_upwards_and_to_the_right_and_are_mirrored_with_their_quadrant(place):
    facts = dict(psf_pitch_um=10.0, rows=3, columns=3)  # 1 pixel for each sample
    right, up = place
    image = points_image([place], (51, 61), pitch_um=10.0)
    everywhere = make_grid_lens(marked_psf(2, 5), **facts)
    assert brightest(simulate(image, everywhere, EXACT)) == (right + 5, up + 2)
    for mirrored, moved in ((HALF, (5 * np.sign(right), 2)), (QUARTER, (5 * np.sign(right), 2 * np.sign(up)))):
        lens = make_grid_lens(lambda x, y: marked_psf(2, 5), mirrored=mirrored, half_mm=(0.05, 0.05), **facts)
        assert brightest(simulate(image, lens, EXACT)) == (right + moved[0], up + moved[1])


def test_transmittance_illumination_and_f_number_multiply_the_radiance():
    lens = make_grid_lens(relative_illumination=lambda nm, x, y: 1 + 0.25 * x, transmittance=0.4)
    image = points_image([(20, 10)], pitch_um=50.0)  # 1 mm to the right
    expected = np.pi * 0.4 * 1.25 / (4 * lens.f_number_effective**2)
    assert simulate(image, lens, EXACT).cube.sum() == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("factor", [1e-3, 40.0])
def test_a_scaled_lens_gives_the_same_picture_on_scaled_pixels(factor):
    radiance, options = noise(), Options(accuracy=0.01)
    scaled = SpectralImage(radiance.cube, 550.0, pitch_um=factor * radiance.pitch_um)
    np.testing.assert_allclose(simulate(scaled, LOPSIDED.scaled(factor), options).cube,
                               simulate(radiance, LOPSIDED, options).cube, rtol=1e-4, atol=1e-7)


def test_source_and_landing_positions_are_inverse_also_beyond_the_grid():
    field = field_map(LOPSIDED).at_wavelength(470.0)
    x_mm, y_mm = np.meshgrid(np.linspace(-2.6, 2.7, 23), np.linspace(-2.1, 2.2, 19))
    source_mm = field.source_mm(x_mm, y_mm)
    np.testing.assert_allclose(field.landing_mm(*source_mm), (x_mm, y_mm), atol=1e-9)
    inside = np.abs(x_mm) < 2
    exact = (x_mm * (1 + 0.02 * x_mm + 1e-5 * 470) + 0.01 * y_mm**2)[inside & (np.abs(y_mm) < 1.5)]
    np.testing.assert_allclose(source_mm[0][inside & (np.abs(y_mm) < 1.5)], exact, atol=1e-12)  # cubic splines
    beyond_mm = field.source_mm(np.array([2.0, 2.3, 2.6]), np.full(3, 0.2))[0]
    assert np.diff(beyond_mm, 2) == pytest.approx(0, abs=1e-12) and np.diff(beyond_mm).min() > 0.3


def test_a_folded_picture_is_refused_with_its_place():
    lens = make_grid_lens(source_mm=lambda nm, x, y: (x, np.interp(y, (-1.5, -0.5, 0.5, 1.5), (-1.5, 0, 0.01, 1.5))),
                          rows=4)  # rising from node to node, but not between them
    with refused(LensError, field="source_mm", value="folded at x = -2 mm, y = -0.25 mm", where="hand-made grid",
                 match="folded at x = .* mm, y = .* mm.*monotonic"):
        field_map(lens).at_wavelength(550.0)


def test_light_beyond_the_field_is_counted_and_black_on_request():
    radiance = SpectralImage(np.ones((1, 61, 81)), 550.0, pitch_um=60.0)
    x_mm, y_mm = radiance.grid.axes_mm()
    field, report = field_map(LOPSIDED).at_wavelength(550.0), Report()
    beyond = ~field.within(x_mm[None, :], y_mm[:, None])
    distance = np.hypot(x_mm / 2, y_mm[:, None] / 1.5) / 1.5
    outside = (np.abs(x_mm) > 2) | (np.abs(y_mm[:, None]) > 1.5) | (distance > 1)
    assert (beyond != outside).mean() < 0.01 and 0.2 < beyond.mean() < 0.6
    black = simulate(radiance, LOPSIDED, Options(out_of_field="vignette", method="exact"), report=report).cube[0]
    assert report.lens_image.out_of_field_fraction == pytest.approx(beyond.mean(), abs=1e-12)
    assert black[beyond].mean() < 0.02 * black[~beyond].mean()


def test_relative_illumination_is_that_of_a_picture_of_uniform_light():
    frame = PixelGrid((61, 81), 40.0, (25.0, 44.0))
    wall = SpectralImage(np.ones((1, 101, 121)), 550.0, pitch_um=40.0, centre_px=(45.0, 64.0), overscan_px=(20, 20))
    picture = simulate(wall, LOPSIDED, EXACT).cube[0]
    np.testing.assert_allclose(relative_illumination(LOPSIDED, frame, 550.0), picture / picture[25, 44], rtol=6e-3)


@pytest.mark.parametrize("pitch_um", [40.0, 11.0])
def test_uniform_light_is_as_even_as_promised(pitch_um):
    lens = make_grid_lens(lambda x, y: np.roll(gaussian_psf(4, 3, 2.5, 41), (round(6 * abs(y)), round(4 * abs(x))),
                                               (0, 1)), rows=5, columns=5)
    shape = (40, 60)
    wall = SpectralImage(np.ones((1, *shape)), 550.0, pitch_um=pitch_um, overscan_px=(8, 8), centre_px=(20.0, 31.0))
    bound = make_plan(Options(), lens, wall.sampling).uniform_light_error
    plain, fine = (simulate(wall, lens, Options(method="pixels", psf_energy=1.0, supersampling=times)).cube
                   for times in (1, 8))
    error = np.abs(plain / fine - 1).max()
    assert 1e-5 < error <= bound < 2 * error


@pytest.mark.parametrize("factor, options", [(1, {"method": "paper"}), (1, {"azimuths": 8})])
def test_settings_of_rotationally_symmetric_lenses_are_refused_in_one_line(factor, options):
    (field, value), = options.items()
    with refused(InputError, field=field, value=value, match="hand-made grid is not rotationally symmetric"):
        simulate(noise(), LOPSIDED, Options(**options))


def test_the_fit_estimates_the_error_between_nodes():
    def source_mm(nm, x, y):
        return x + 0.01 * np.sin(2 * x), y

    coarse, fine = (field_map(make_grid_lens(source_mm=source_mm, columns=n)).at_wavelength(550.0) for n in (13, 25))
    x_mm = np.linspace(-2, 2, 1001)
    errors = [np.abs(field.source_mm(x_mm, 0 * x_mm)[0] - source_mm(0, x_mm, 0)[0]).max() for field in (coarse, fine)]
    for field, error in zip((coarse, fine), errors, strict=True):
        assert error / 4 < field.distortion.residual < 4 * error


ANAMORPHIC = make_grid_lens(source_mm=lambda nm, x, y: (x * (1 + 0.01 * y**2), y * (1 + 0.02 * x**2)), squeeze=1.8,
                            mirrored=QUARTER)


def test_a_capture_with_another_squeeze_gives_the_same_picture():
    """A scene without detail finer than a pixel: light falls off linearly to the right and upwards."""
    def scene(grid):
        x_mm, y_mm = grid.axes_mm()
        across = x_mm * grid.squeeze / (grid.focal_mm or ANAMORPHIC.capture_focal_length_mm)
        return SpectralImage(2 + across + 0.5 * (y_mm / (grid.focal_mm or 10.5))[:, None], 550.0, grid)

    sensor = PixelGrid((90, 120), 25.0, overscan_px=(15, 20))
    wide = PixelGrid((90, 220), 25.0, overscan_px=(15, 70))
    pictures = [simulate(scene(grid), ANAMORPHIC, EXACT).cube for grid in (
        replace(sensor, squeeze=1.8), replace(wide, squeeze=1.0))]
    assert pictures[1].shape[2] == 80 and pictures[0].shape[2] == 80
    np.testing.assert_allclose(pictures[0], pictures[1], rtol=2e-3)
    assert np.ptp(pictures[0][0, 30]) > 0.1 * pictures[0].mean()


def test_captures_of_an_anamorphic_lens_are_planes_with_its_squeeze_and_enough_overscan():
    frame = PixelGrid((60, 80), 37.5)
    capture = choose_capture(ANAMORPHIC, frame, (550.0,), 2)
    assert capture.projection.is_plane and capture.squeeze == 1.8 and capture.frame_px == (60, 80)
    corners_mm = np.array([-1.5, 1.5, 1.5]), np.array([1.125, 1.125, 0.0])
    rows, columns = capture.index_of(*field_map(ANAMORPHIC).at_wavelength(550.0).source_mm(*corners_mm, capture))
    assert -0.5 <= rows.min() < 3.5 and columns.max() <= capture.shape_px[1] - 0.5 < columns.max() + 5


def test_a_squeezed_capture_is_refused_by_a_spherical_lens():
    with pytest.raises(Exception, match="squeeze is 1.8: .* needs an unsqueezed capture"):
        simulate(SpectralImage(np.ones((1, 9, 9)), 550.0, pitch_um=9.0, squeeze=1.8), make_lens())


def test_planes_of_a_squeezed_capture_show_the_frame():
    lens = make_grid_lens(squeeze=1.5)
    sensor, wide = (PixelGrid((20, 30), 40.0, overscan_px=(2, 3), squeeze=squeeze) for squeeze in (1.5, 0.75))
    ramps = [grid.axes_mm()[0] * grid.squeeze + np.zeros((20, 1)) for grid in (sensor, wide)]  # tangent of the angle
    expected = sensor.frame().axes_mm()[0] * 1.5 + np.zeros((16, 1))
    for grid, ramp in zip((sensor, wide), ramps, strict=True):
        inside = slice(8, 16)  # the wide capture shows only half as much
        np.testing.assert_allclose(pinhole_view(ramp[None], lens, grid)[0][:, inside], expected[:, inside], atol=1e-9)
        nearest = nearest_samples(ramp, lens, grid, 550.0)
        np.testing.assert_allclose(nearest[:, inside], expected[:, inside], atol=0.04)


def test_a_panorama_gives_the_same_picture_as_a_plane():
    lens = make_grid_lens(source_mm=lambda nm, x, y: (x + 0.02 * x**3, y + 0.01 * x))

    def scene(grid):
        x_mm, y_mm = (axis / lens.capture_focal_length_mm for axis in grid.axes_mm())
        radius = np.hypot(x_mm, y_mm[:, None])
        scale = np.tan(radius) / np.where(radius > 0, radius, 1) if not grid.projection.is_plane else 1
        return SpectralImage(2 + scale * x_mm + 0.5 * scale * y_mm[:, None], 550.0, grid)

    plane = PixelGrid((80, 100), 40.0, overscan_px=(15, 15))
    pictures = [simulate(scene(replace(plane, projection=projection)), lens, EXACT).cube
                for projection in (plane.projection, FISHEYE)]
    np.testing.assert_allclose(*pictures, rtol=2e-4)


@pytest.mark.sample(12)
@pytest.mark.skipif(len(available()) < 2, reason="no library of the loops: no compiler")
@pytest.mark.parametrize("lens", [LOPSIDED, tinted(comatic_grid(9, 9, mirrored=QUARTER)), ANAMORPHIC],
                         ids=["lopsided", "folded", "anamorphic"])
@pytest.mark.parametrize("facts", [{}, {"shape": (1, 1)}, {"shape": (1, 77)}, {"shape": (70, 1)},
                                   {"centre_px": (-9.5, 70.0)}, {"overscan_px": (5, 9)}], ids=str)
@pytest.mark.parametrize("out_of_field", ["hold", "vignette"])
def test_compiled_loops_agree_with_numpy(lens, facts, out_of_field):
    radiance = noise(**facts)
    radiance = SpectralImage(radiance.cube**0.1, 550.0, replace(radiance.grid, squeeze=lens.squeeze))
    options, results = Options(method="pixels", out_of_field=out_of_field), []
    for name in available():
        with using(name):
            results.append(simulate(radiance, lens, options).cube)
    expected = results[available().index(NUMPY)]
    for compiled in results[2:]:
        np.testing.assert_array_equal(compiled, results[1])
    # positions in the capture are interpolated to 1e-3 px, between pixels that differ by up to the brightest
    np.testing.assert_allclose(results[1], expected, rtol=0, atol=2e-3 * max(expected.max(), 1e-6))


@pytest.mark.parametrize("make", [comatic_grid, make_grid_lens], ids=["distorted", "without distortion"])
@pytest.mark.parametrize("shape", [(1, 1), (40, 70), (540, 960)])
def test_positions_and_light_on_the_mesh_are_accurate(shape, make):
    lens = make(rows=17, columns=17, relative_illumination=lambda nm, x, y: 1 / (1 + 0.1 * x**2 + 0.2 * y**2))
    grid, field = PixelGrid(shape, 3e3 / max(shape), (0.3 * shape[0], 0.6 * shape[1])), field_map(lens)
    ideal = field.at_wavelength(550.0).ideal_image(
        grid, Planes(grid, False), vignette=True, precision="float32", memory=MemoryBudget(0))
    geometry = ideal.compiled_geometry()
    step, mesh = geometry._structure.mesh_step, geometry._mesh
    rows, columns = (np.arange(n) / step for n in shape)
    assert mesh.shape[0] > rows[-1] and mesh.shape[1] > columns[-1]
    at, rng = np.stack(np.meshgrid(rows, columns, indexing="ij")).reshape(2, -1), np.random.default_rng(0)
    at = at[:, rng.permutation(at.shape[1])[:5000]]
    below = np.minimum(at.astype(int), np.array(mesh.shape[:2])[:, None] - 2)
    down, on = (at - below)[..., None]
    row, column = below
    between = ((1 - down) * ((1 - on) * mesh[row, column] + on * mesh[row, column + 1])
               + down * ((1 - on) * mesh[row + 1, column] + on * mesh[row + 1, column + 1]))
    x_mm, y_mm = grid.position_mm(*(at * step))
    source_mm = field.at_wavelength(550.0).source_mm(x_mm, y_mm, grid)
    exact = np.stack([-source_mm[1], source_mm[0]], axis=1) / (grid.pitch_um * 1e-3)
    assert np.abs(between[:, :2] - exact).max() < 1e-3
    light = between[:, 4] / field.at_wavelength(550.0).relative_flux(x_mm, y_mm)
    np.testing.assert_allclose(light, light[0], rtol=3e-5)
