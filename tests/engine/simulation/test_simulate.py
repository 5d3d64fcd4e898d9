"""simulate() from end to end, on lenses whose images can be calculated by hand."""

import json

import numpy as np
import pytest

from lenses import (
    PIXEL_BY_PIXEL,
    SENSOR_POINT,
    brightest,
    gaussian_psf,
    images_of_points,
    lit_pixels,
    lopsided_lens,
    make_lens,
    marked_psf,
    points_image,
)
from lensfield.engine import ImageError, LensError, Options, Report, SpectralImage, load_lens, simulate
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.psf_samples import psf_radius_px
from lensfield.engine.image.pixel_grid import PixelGrid
from refusals import refused

E_AXIS = np.pi / 16  # irradiance per radiance of the hand-made lens, N = 2
SECTIONS = Options(section_size=32)


def uniform(shape, lens, pitch_um):
    """Radiance 1 everywhere, with the overscan that the lens needs."""
    radius = psf_radius_px(lens, pitch_um)
    overscan = field_map(lens).overscan_px(PixelGrid(shape, pitch_um), [550.0], radius)
    cube = np.ones((1, shape[0] + 2 * overscan[0], shape[1] + 2 * overscan[1]))
    return SpectralImage(cube, [550.0], pitch_um=pitch_um, overscan_px=overscan)


def checkerboard(shape, square_px):
    row, column = np.indices(shape)
    return ((row // square_px + column // square_px) % 2).astype(float)


def test_a_perfect_lens_changes_nothing_but_the_unit():
    cube = np.random.default_rng(0).random((2, 20, 30))
    result = simulate(SpectralImage(cube, [500, 600], pitch_um=5.0), make_lens(transmittance=0.9), SECTIONS)
    np.testing.assert_allclose(result.cube, 0.9 * E_AXIS * cube, rtol=1e-6, atol=1e-7)


def test_the_result_states_its_quantity_and_its_lens():
    result = simulate(points_image([(0, 0)]), make_lens())
    assert (result.quantity, result.lens_name, result.f_number_effective) == ("irradiance", "hand-made", 2.0)
    assert result.cube.dtype == np.float32


@pytest.mark.parametrize("source, image", [
    ((10, 0), (15, 0)), ((-10, 0), (-15, 0)), ((0, 10), (0, 15)), ((0, -10), (0, -15)),
    ((6, 8), (9, 12)), ((-6, 8), (-9, 12)), ((-8, -6), (-12, -9)), ((8, -6), (12, -9)),
])
def test_a_mark_outside_the_chief_ray_falls_away_from_the_axis(source, image):
    lit = images_of_points([source], make_lens(marked_psf(10, 0)))  # 10 samples of 2.5 um: 5 px of 5 um
    assert lit == {image: pytest.approx(1.0)}


@pytest.mark.parametrize("source, image", [
    ((0, 10), (5, 10)), ((10, 0), (10, -5)), ((0, -10), (-5, -10)), ((-10, 0), (-10, 5)),
    ((6, 8), (10, 5)),  # u = (sin, -cos) = (0.8, -0.6): 4 right and 3 down
])
def test_a_mark_along_u_falls_where_the_convention_says(source, image):
    assert images_of_points([source], make_lens(marked_psf(0, 10))) == {image: pytest.approx(1.0)}


@pytest.mark.parametrize("centre_px", [(10.0, 45.0), (40.0, 12.0), (-20.0, 90.0), (70.0, 30.0)])
def test_outwards_is_relative_to_the_axis_wherever_it_lies(centre_px):
    column, row = 30, 20
    cube = np.zeros((1, 61, 61))
    cube[0, row, column] = 1
    image = SpectralImage(cube, [550.0], pitch_um=5.0, centre_px=centre_px)
    result = simulate(image, make_lens(marked_psf(10, 0)), PIXEL_BY_PIXEL)
    outward = np.array([column - centre_px[1], centre_px[0] - row])
    x, y = np.array([column, -row]) + 5 * outward / np.hypot(*outward)
    weights = result.cube[0] / result.cube[0].sum()
    centroid = (weights.sum(axis=0) @ np.arange(61), -weights.sum(axis=1) @ np.arange(61))
    assert centroid == pytest.approx((x, y), abs=0.5)
    assert result.centre_px == centre_px


def test_an_axis_between_pixels_turns_its_four_neighbours_outwards():
    image = SpectralImage(np.zeros((1, 40, 40)), [550.0], pitch_um=5.0)
    image.cube[0, 19:21, 19:21] = 1
    lit = lit_pixels(simulate(image, make_lens(marked_psf(12, 0)), PIXEL_BY_PIXEL))  # 6 px: 4.24 along x and y
    assert set(lit) >= {(4.5, 4.5), (-4.5, 4.5), (4.5, -4.5), (-4.5, -4.5)}
    assert max(lit, key=lit.get) in {(4.5, 4.5), (-4.5, 4.5), (4.5, -4.5), (-4.5, -4.5)}
    assert all(4 <= abs(x) <= 6 and 4 <= abs(y) <= 6 for x, y in lit)


@pytest.mark.parametrize("source, image", [((25, 0), (20, 0)), ((0, -25), (0, -20)), ((15, 20), (12, 16))])
def test_barrel_distortion_pulls_points_toward_the_axis(source, image):
    result = simulate(points_image([source]), make_lens(real_height_mm=lambda nm, p: 0.8 * p), PIXEL_BY_PIXEL)
    assert brightest(result) == image
    assert result.cube.max() == pytest.approx(0.8**2 * E_AXIS, rel=1e-5)  # compressed into less than a pixel


def test_a_mark_is_laid_out_from_the_real_position():
    lens = make_lens(marked_psf(10, 0), real_height_mm=lambda nm, p: 0.8 * p)
    assert brightest(simulate(points_image([(15, 20)]), lens, PIXEL_BY_PIXEL)) == (15, 20)  # (12, 16) + (3, 4)


def test_lateral_colour_puts_red_outside_blue():
    lens = make_lens(real_height_mm=lambda nm, p: p * np.where(nm > 500, 1.0, 0.8))
    result = simulate(points_image([(-15, 20)], wavelengths_nm=(400.0, 700.0)), lens, PIXEL_BY_PIXEL)
    assert (brightest(result, 0), brightest(result, 1)) == ((-12, 16), (-15, 20))


def test_lateral_colour_between_wavelengths_lies_between():
    lens = make_lens(real_height_mm=lambda nm, p: p * np.where(nm > 500, 1.0, 0.8))
    result = simulate(points_image([(20, 0)], wavelengths_nm=(550.0,)), lens, PIXEL_BY_PIXEL)
    assert brightest(result) == (18, 0)


def test_psfs_are_looked_up_by_the_height_of_the_source():
    # Ideal height 0.1 mm or 20 px, real height 16 px. The mark is 0, 5 or 10 px farther out at 0, 0.1 and 0.2 mm.
    table = np.stack([marked_psf(v, 0, 49) for v in (0, 10, 20)])[None]
    lens = make_lens(table, lambda nm, p: 0.8 * p, wavelengths_nm=(550.0,), heights_mm=(0.0, 0.1, 0.2))
    assert brightest(simulate(points_image([(20, 0)], (81, 81)), lens, PIXEL_BY_PIXEL)) == (16 + 5, 0)


@pytest.mark.parametrize("blur, tolerance", [(SENSOR_POINT, 2e-6), (gaussian_psf(6, 6, 2.5, 17), 2.5e-3)])
def test_a_uniform_scene_shows_the_relative_illumination(blur, tolerance):
    lens = make_lens(blur, lambda nm, p: 0.9 * p, lambda nm, p: 1 - 0.05 * p**2)
    result = simulate(uniform((81, 101), lens, 20.0), lens, Options(section_size=8))
    row, column = np.indices((81, 101))
    paraxial_mm = np.hypot(row - 40, column - 50) * 0.02 / 0.9
    # A round PSF of 6 um preserves R, to 1e-5, except for the uneven sampling by pixels of 20 um as the PSF rotates:
    # with the exact operator that is 0.2 % near the axis.
    np.testing.assert_allclose(result.cube[0], E_AXIS * (1 - 0.05 * paraxial_mm**2), rtol=tolerance)


def test_overscan_leaves_no_dark_border():
    lens = make_lens(gaussian_psf(12, 12, 2.5, 33), lambda nm, p: p - 0.02 * p**3)
    result = simulate(uniform((60, 80), lens, 25.0), lens, SECTIONS)
    np.testing.assert_allclose(result.cube, E_AXIS, rtol=2e-3)


def test_light_from_beyond_the_frame_is_blurred_into_it():
    cube = np.zeros((1, 61, 61))
    cube[0, 30, 48] = 1  # 18 px right of the axis; the frame ends 15 px from it
    image = SpectralImage(cube, [550.0], pitch_um=5.0, overscan_px=(15, 15))
    result = simulate(image, make_lens(marked_psf(-10, 0)), PIXEL_BY_PIXEL)
    assert result.cube.shape == (1, 31, 31)
    assert lit_pixels(result) == {(13, 0): pytest.approx(1.0)}


def test_light_from_beyond_the_frame_is_distorted_into_it():
    cube = np.zeros((1, 61, 61))
    cube[0, 5, 30] = 1  # 25 px above the axis
    image = SpectralImage(cube, [550.0], pitch_um=5.0, overscan_px=(9, 9))
    result = simulate(image, make_lens(real_height_mm=lambda nm, p: 0.8 * p), PIXEL_BY_PIXEL)
    assert brightest(result) == (0, 20)


@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (17, 23), (40, 40)])
@pytest.mark.parametrize("knobs", [dict(section_size=7), dict(section_size=1000), dict(method="pixels", azimuths=8),
                                   dict(method="paper", section_size=7), dict(method="paper")])
def test_any_shape_and_section_keeps_the_energy(shape, knobs):
    lens = make_lens(gaussian_psf(12, 6, 2.5, 17))
    report, options = Report(), Options(precision="float64", **knobs)
    cube = np.random.default_rng(5).random((1, *shape))
    simulate(SpectralImage(cube, [550.0], pitch_um=5.0), lens, options, report=report)
    energy = report.lens_image.energy
    assert energy.in_w_per_nm == pytest.approx(E_AXIS * cube.sum() * (5e-6)**2, rel=1e-6, abs=0)
    assert energy.out_w_per_nm == pytest.approx(energy.in_w_per_nm, rel=1e-12, abs=0)


def test_a_psf_larger_than_the_section_does_not_wrap_around():
    lens = make_lens(marked_psf(12, 0))
    points = [(8, 0), (9, 0), (-12, -16), (-8, -7)]  # corners of sections of 4 px
    image = points_image(points)
    small, large = (simulate(image, lens, Options(section_size=size, precision="float64")) for size in (4, 64))
    np.testing.assert_allclose(small.cube, large.cube, atol=1e-7)
    assert small.cube.sum() == pytest.approx(4 * E_AXIS, rel=1e-6)


@pytest.mark.parametrize("options, tolerance", [
    (Options(method="paper", section_size=8), 0), (Options(method="exact"), 0),
    (Options(method="pixels", azimuths=8), 1e-6), (Options(section_size=8, azimuths=8), 1e-6)])
def test_many_wavelengths_are_simulated_independently(options, tolerance):
    """Tables of many wavelengths are mixed from the tables of the lens data, and so equal except for rounding."""
    rng = np.random.default_rng(8)
    lens = make_lens(np.stack([np.tile(gaussian_psf(s, s, 2.5, 17), (11, 1, 1)) for s in (4, 8)]),
                     lambda nm, p: p * (0.9 + nm / 7000), lambda nm, p: 1 - 0.03 * p * nm / 550)
    cube, nm = rng.random((4, 30, 40)), [410.0, 500.0, 555.5, 690.0]
    together = simulate(SpectralImage(cube, nm, pitch_um=30.0), lens, options)
    for index, wavelength_nm in enumerate(nm):
        alone = simulate(SpectralImage(cube[index], wavelength_nm, pitch_um=30.0), lens, options)
        np.testing.assert_allclose(alone.cube[0], together.cube[index], rtol=0, atol=tolerance)


@pytest.mark.parametrize("out_of_field, beyond", [("hold", 0.6), ("vignette", 0.0)])
def test_beyond_the_last_height_light_is_held_or_vignetted_as_requested(out_of_field, beyond):
    lens = make_lens(relative_illumination=lambda nm, p: 1 - 0.1 * p**2)  # heights to 2 mm
    report = Report()
    image = SpectralImage(np.ones((1, 61, 61)), [550.0], pitch_um=100.0)
    options = Options(section_size=32, precision="float64", out_of_field=out_of_field)
    result = simulate(image, lens, options, report=report)
    row, column = np.indices((61, 61)) - 30
    height_mm = np.hypot(row, column) * 0.1
    inside = height_mm < 2 - 1e-6
    outside = height_mm > 2 + 1e-6
    np.testing.assert_allclose(result.cube[0][inside], E_AXIS * (1 - 0.1 * height_mm[inside]**2), rtol=1e-5)
    np.testing.assert_allclose(result.cube[0][outside], E_AXIS * beyond, rtol=1e-5, atol=1e-8)
    assert report.lens_image.out_of_field_fraction == pytest.approx(outside.mean(), abs=0.005)


def test_progress_is_reported_after_every_wavelength():
    fractions = []
    simulate(points_image([(0, 0)], wavelengths_nm=(400, 500, 600, 700)), make_lens(), progress=fractions.append)
    assert fractions == [0.25, 0.5, 0.75, 1.0]


def test_report_can_be_written_and_names_stages_and_fits(tmp_path):
    report = Report()
    simulate(points_image([(0, 0)]), make_lens(real_height_mm=lambda nm, p: p - 0.01 * p**3), report=report)
    report.write(tmp_path / "report.json")
    read = json.loads((tmp_path / "report.json").read_text())
    assert read["wavelengths"][0]["distortion_fit"]["residual_mm"] < 1e-9
    assert set(read["stages_s"]) >= {"distortion and relative illumination", "filtering", "lens data", "plan"}
    assert read["lens"] == "hand-made" and read["frame_px"] == [61, 73]


def test_irradiance_is_not_accepted_as_radiance():
    with refused(ImageError, field="quantity", value="irradiance", where="image"):
        simulate(points_image([(0, 0)], quantity="irradiance"), make_lens())


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_pixel_that_is_not_finite_is_named(value):
    image = points_image([(0, 0)], wavelengths_nm=(500.0, 600.0))
    image.cube[1, 3, 7] = value
    with refused(ImageError, field="pixel at row 3, column 7, 600 nm", where="image"):
        simulate(image, make_lens())


def test_a_wavelength_outside_the_lens_is_an_error_that_names_it():
    with refused(LensError, field="wavelength", value="720 nm", where="hand-made"):
        simulate(points_image([(0, 0)], wavelengths_nm=(600.0, 720.0)), make_lens())


def test_a_folding_lens_is_an_error():
    with refused(LensError, field="real_height_mm", where="hand-made", match="monotonic"):
        simulate(points_image([(0, 0)]), make_lens(real_height_mm=lambda nm, p: p - 0.4 * p**2))


def test_the_papers_checkerboard_keeps_its_energy():
    """Section 4: 768 x 576 px on a 1/3 inch sensor, 587.6 nm, sections of 16 px, a space of 64 x 64."""
    report = Report()
    image = SpectralImage(np.pad(checkerboard((560, 752), 16), 8), 587.6, pitch_um=6.25)  # black borders keep all light
    result = simulate(image, load_lens("edmund-54852"), Options(method="paper"), report=report)
    energy = report.lens_image.energy
    assert result.cube.shape == (1, 576, 768)
    assert report.lens_image.plan.method.space_px == 64
    assert energy.out_w_per_nm == pytest.approx(energy.in_w_per_nm, rel=1e-12, abs=0)
    assert energy.in_frame_w_per_nm == pytest.approx(energy.in_w_per_nm, rel=1e-6, abs=0)
    assert result.cube.min() >= -1e-7 * result.cube.max()


@pytest.fixture(scope="module")
def crop_of_the_paper():
    """A crop of the paper's frame, off its centre: the image, the lens, and the exact result."""
    lens = load_lens("edmund-54852")
    image = SpectralImage(checkerboard((64, 96), 16), 587.6, pitch_um=6.25, centre_px=(-150.0, 250.0))
    return image, lens, simulate(image, lens, Options(method="exact")).cube[0]


@pytest.mark.parametrize("options, tolerance", [
    (Options(method="paper"), 0.02), (Options(method="paper", section_size=16, precision="auto"), 0.02),
    (Options(method="pixels", azimuths=32), 0.002), (Options(section_size=16, azimuths=32), 0.002)])
def test_the_papers_sections_approximate_the_exact_operator(crop_of_the_paper, options, tolerance):
    image, lens, exact = crop_of_the_paper
    result = simulate(image, lens, options).cube[0]
    assert np.linalg.norm(result - exact) < tolerance * np.linalg.norm(exact)


def test_the_method_of_the_paper_is_16_px_in_64_with_uncropped_psfs(crop_of_the_paper):
    image, lens, _ = crop_of_the_paper
    by_knobs = Options(method="paper", section_size=16, psf_energy=1.0, precision="float64")
    paper = simulate(image, lens, Options(method="paper")).cube
    np.testing.assert_allclose(paper, simulate(image, lens, by_knobs).cube, atol=1e-7 * paper.max())


def test_edmund_image_of_a_point_lies_at_its_real_height():
    # 2.4 mm paraxial; the lens's own table gives the chief ray's landing point. Pixels of 20 um.
    lens = load_lens("edmund-54852")
    optics = lens.at_wavelength(587.6)
    real_px = np.interp(2.4, optics.heights_mm, optics.real_height_mm) / 0.02
    cube = np.zeros((1, 9, 301))
    cube[0, 3:6, 150 + 119:150 + 122] = 1  # a square of 3 px about (120, 0)
    result = simulate(SpectralImage(cube, 587.6, pitch_um=20.0), lens, SECTIONS).cube[0]
    centroid_px = result.sum(axis=0) @ (np.arange(301) - 150) / result.sum()
    assert real_px < 115  # barrel
    assert centroid_px == pytest.approx(real_px, abs=0.15)


def test_single_pixel_sections_reproduce_the_exact_method():
    image, lens = points_image([(3, 4), (-12, 9)]), make_lens(gaussian_psf(8, 4, 2.5, 17))
    exact = simulate(image, lens, Options(method="exact")).cube
    np.testing.assert_allclose(simulate(image, lens, PIXEL_BY_PIXEL).cube, exact, atol=1e-6 * exact.max())


@pytest.mark.parametrize("options", [SECTIONS, Options(method="pixels", azimuths=8), Options(method="exact")])
def test_irradiance_may_overwrite_its_radiance(options):
    rng = np.random.default_rng(9)
    lens = make_lens(gaussian_psf(8, 4, 2.5, 17), lambda nm, p: 0.9 * p)
    cube = rng.random((3, 46, 58)).astype(np.float32)
    facts = dict(wavelengths_nm=[450.0, 550.0, 650.0], pitch_um=10.0, overscan_px=(8, 9))
    alone = simulate(SpectralImage(cube.copy(), **facts), lens, options)
    over = simulate(SpectralImage(cube, **facts), lens, options, out=cube[:, 8:-8, 9:-9])
    np.testing.assert_array_equal(over.cube, alone.cube)
    np.testing.assert_array_equal(cube[:, 8:-8, 9:-9], alone.cube)
    assert np.shares_memory(over.cube, cube)


def test_wavelengths_may_be_interleaved_in_memory():
    """A lopsided lens has a single plane, which is not copied."""
    interleaved = np.random.default_rng(0).random((20, 24, 2), dtype=np.float32)
    one, other = (simulate(SpectralImage(cube, (450.0, 650.0), pitch_um=100.0), lopsided_lens(), Options(accuracy=0.1))
                  for cube in (np.moveaxis(interleaved, 2, 0), np.moveaxis(interleaved, 2, 0).copy()))
    assert np.array_equal(one.cube, other.cube)


def test_light_outside_the_frame_is_counted_separately():
    # Half of a Gaussian on the edge of the frame is outside; the canvas contains all of it.
    image, report = points_image([(36, 0)]), Report()
    simulate(image, make_lens(gaussian_psf(12, 12, 2.5, 33)), PIXEL_BY_PIXEL, report=report)
    energy = report.lens_image.energy
    assert energy.out_w_per_nm == pytest.approx(energy.in_w_per_nm, rel=1e-12, abs=0)
    # Its centre is that of the last pixel: 12 um are 2.4 px, so half the light and another half pixel are inside.
    assert 0.5 < energy.in_frame_w_per_nm / energy.in_w_per_nm < 0.5 + 0.5 / (2.4 * np.sqrt(2 * np.pi)) + 0.01
