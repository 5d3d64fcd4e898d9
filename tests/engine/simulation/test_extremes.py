"""Numerical stability at the extremes, each with a figure."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from lenses import PIXEL_BY_PIXEL, comatic_lens, distance_of_light, gaussian_psf, make_lens, marked_psf
from lensfield.engine import ImageError, LensError, Options, Report, SpectralImage, blur, load_lens, simulate
from lensfield.engine.field.psf_samples import psf_radius_px
from places import SHARED_DATA
from refusals import refused

E_AXIS = np.pi / 16
EDMUND = load_lens("edmund-54852")
SECTIONS, PIXELS = Options(section_size=32, azimuths=16), Options(method="pixels", azimuths=16)
EXACT = Options(method="exact")
SOFT = make_lens(gaussian_psf(8, 4, 2.5, 9))
PAPER = Options(method="paper")
METHODS = {name: Options(method=name) for name in blur.METHODS} | {
    "sections": SECTIONS, "pixels": PIXELS, "paper single": Options(method="paper", section_size=16, precision="auto"),
    "accuracy": Options(accuracy=0.01)}
EVERY_METHOD = pytest.mark.parametrize("options", METHODS.values(), ids=METHODS.keys())
FIXED_PRECISION = [name for name, method in blur.METHODS.items() if "precision" not in method.knobs]
DOUBLE = {name: options if options.method in FIXED_PRECISION else replace(options, precision="float64")
          for name, options in METHODS.items() if name != "accuracy"}


def radiance(plane, pitch_um=6.25, nm=550.0, **facts):
    return SpectralImage(np.asarray(plane, dtype=np.float32)[None], [nm], pitch_um=pitch_um, **facts)


def noise(shape, seed=4):
    return np.random.default_rng(seed).random(shape)


def energy_ratio(image, lens, options):
    """Light after the blur, on the full canvas, divided by the light before it."""
    report = Report()
    simulate(image, lens, options, report=report)
    energy = report.lens_image.energy
    return energy.out_w_per_nm / energy.in_w_per_nm


# Sections, images and PSFs of all sizes

@pytest.mark.parametrize("section_size", [1, 2, 7, 1000])
@pytest.mark.parametrize("method", ["sections", "paper"])
def test_even_light_keeps_its_energy_for_any_section_size(section_size, method):
    image = radiance(np.ones((8, 11)))
    double, single = (Options(method=method, section_size=section_size, precision=precision)
                      for precision in ("float64", "auto"))
    assert energy_ratio(image, EDMUND, double) == pytest.approx(1, rel=1e-12, abs=0)
    assert energy_ratio(image, SOFT, single) == pytest.approx(1, rel=1e-6)


@pytest.fixture(scope="module", params=[None, (3.0, 30.0)], ids=["centred", "off centre"])
def exact_noise(request):
    """A picture, a lens, and the result of the exact operator."""
    image, lens = radiance(noise((32, 40)), pitch_um=36.0, centre_px=request.param), comatic_lens()
    return image, lens, simulate(image, lens, EXACT).cube


@pytest.mark.parametrize("options, bound", [
    *((Options(section_size=size, azimuths=64), 1e-4) for size in (1, 7, 1000)),
    *((Options(method="paper", section_size=size), bound) for size, bound in ((1, 1e-12), (7, 1e-2), (1000, 0.1)))])
def test_sections_of_any_size_approximate_the_exact_operator(exact_noise, options, bound):
    image, lens, exact = exact_noise
    assert distance_of_light(simulate(image, lens, options).cube, exact) < bound


@EVERY_METHOD
@pytest.mark.parametrize("shape", [(1, 1), (3, 20)])
def test_images_smaller_than_the_psf_are_accepted(shape, options):
    image = radiance(np.ones(shape), pitch_um=1.5)
    result = simulate(image, SOFT, options)
    assert result.cube.shape == (1, *shape) and np.isfinite(result.cube).all() and result.cube.min() > 0


@EVERY_METHOD
def test_an_image_of_one_pixel_keeps_the_middle_of_its_psf(options):
    lens = make_lens(gaussian_psf(2.0, 2.0, 0.25, 65), psf_pitch_um=0.25)
    result = simulate(radiance([[8.0]], pitch_um=5.0), lens, options)
    sigmas = 2.5  # per pixel; a point of the pixel at x sends ndtr(sigmas (1 - x)) - ndtr(-sigmas x) into it
    stays = 2 * ndtr(sigmas) - 1 - np.sqrt(2 / np.pi) * (1 - np.exp(-sigmas**2 / 2)) / sigmas
    assert result.cube[0, 0, 0] == pytest.approx(8 * E_AXIS * stays**2, rel=options.accuracy or 3e-3)


@pytest.mark.parametrize("options", DOUBLE.values(), ids=DOUBLE.keys())
@pytest.mark.parametrize("pitch_um", [100.0, 0.5])
def test_psfs_smaller_than_a_pixel_and_larger_than_the_image_keep_all_light(pitch_um, options):
    lens = make_lens(gaussian_psf(1.0, 1.0, 0.25, 33), psf_pitch_um=0.25)
    image = radiance(noise((9, 9)), pitch_um=pitch_um)
    assert energy_ratio(image, lens, options) == pytest.approx(1, rel=1e-12, abs=0)


@EVERY_METHOD
def test_a_psf_far_smaller_than_a_pixel_changes_nothing(options):
    lens = make_lens(gaussian_psf(1.0, 1.0, 0.25, 33), psf_pitch_um=0.25e-5)
    plane = noise((9, 9))
    result = simulate(radiance(plane, pitch_um=100.0), lens, options).cube[0]
    np.testing.assert_allclose(result, E_AXIS * plane, atol=3e-7)


# Light of all strengths

@pytest.mark.parametrize("options", [options for options in METHODS.values() if options != EXACT],
                         ids=[name for name in METHODS if name != "exact"])
def test_a_highlight_leaves_the_background_alone(options):
    """1e6 on 1e-3: no pixel falls below 0.999e-3 of its light, and distant ones are accurate to 1e-6."""
    plane = np.full((72, 96), 1e-3)
    even = simulate(radiance(plane), EDMUND, options).cube[0].astype(float)
    plane[30, 53] = 1e6
    result = simulate(radiance(plane), EDMUND, options).cube[0].astype(float)
    inside = (slice(12, -12), slice(12, -12))
    ratio = result[inside] / even[inside]
    far = np.hypot(*np.mgrid[-18:30, -41:31]) > psf_radius_px(EDMUND, 6.25) + 3
    # With an accuracy, uniform areas are written directly and others are filtered, which may differ by that accuracy.
    lowest, farthest = (0.999, 1e-6) if options.accuracy is None else (1 - options.accuracy, options.accuracy)
    assert ratio.min() > lowest
    assert np.abs((result[inside] / even[inside])[far] - 1).max() < farthest


@pytest.mark.parametrize("options", [SECTIONS, METHODS["paper single"], PIXELS], ids=["sections", "paper", "pixels"])
def test_all_pixels_around_a_highlight_are_accurate_to_one_part_in_ten_thousand(options):
    """Including those under the highlight's blur, despite a ratio of 1e9."""
    plane = 1e-3 * (1 + noise((72, 96)))
    plane[30, 53], plane[60:64, 7:9] = 1e6, 3e4
    single = simulate(radiance(plane), EDMUND, options).cube
    double = simulate(radiance(plane), EDMUND, replace(options, precision="float64")).cube
    np.testing.assert_allclose(single, double, rtol=1e-4)


@pytest.mark.parametrize("options", [SECTIONS, PIXELS, EXACT], ids=["sections", "pixels", "exact"])
@pytest.mark.parametrize("value", [1e-44, 1e-40, 1e-30, 1e30, 1e37, 3e38])
def test_the_faintest_and_the_brightest_floats_survive(value, options):
    lens, plane = make_lens(gaussian_psf(4, 4, 2.5, 9)), 0.5 + noise((16, 16)) / 2
    of_one = simulate(radiance(plane), lens, options).cube
    result = simulate(radiance(plane * value), lens, options).cube
    # The steps of the smallest floats are 1.4e-45, and each of about 25 taps is rounded to one.
    np.testing.assert_allclose(result, of_one * value, rtol=1e-5, atol=25 * 0.7e-45)
    assert result.min() >= 0


@EVERY_METHOD
def test_black_stays_black(options):
    assert not simulate(radiance(np.zeros((30, 40))), SOFT, options).cube.any()


@EVERY_METHOD
def test_a_single_dim_pixel_in_the_black_is_not_lost(options):
    plane = np.zeros((30, 40))
    plane[11, 17] = 1e-12
    assert energy_ratio(radiance(plane), SOFT, options) == pytest.approx(1, rel=1e-5)


@EVERY_METHOD
@pytest.mark.parametrize("value", [np.nan, -np.inf])
def test_a_nonfinite_pixel_is_named(value, options):
    plane = np.ones((6, 8))
    plane[4, 3] = value
    with refused(ImageError, field="pixel at row 4, column 3, 550 nm", where="image"):
        simulate(radiance(plane), SOFT, options)


@EVERY_METHOD
@pytest.mark.parametrize("value", [np.nan])  # test_fireflies has the others
def test_a_nonfinite_pixel_takes_its_neighbours_light_on_request(value, options):
    plane = np.ones((6, 8))
    clean = simulate(radiance(plane), SOFT, options).cube
    plane[4, 3] = value
    report = Report()
    mended = simulate(radiance(plane), SOFT, replace(options, fireflies="clamp"), report=report).cube
    np.testing.assert_array_equal(mended, clean)
    assert report.lens_image.fireflies_clamped == 1


# Wavelengths

@EVERY_METHOD
def test_a_lens_of_one_wavelength_serves_only_that_wavelength(options):
    lens, plane = make_lens(wavelengths_nm=(587.6,), transmittance=0.5), noise((40, 40))
    result = simulate(radiance(plane, nm=587.6), lens, options).cube[0]
    np.testing.assert_allclose(result, 0.5 * E_AXIS * plane, atol=3e-7)
    with refused(LensError, field="wavelength", value="588 nm", where="hand-made"):
        simulate(radiance(np.ones((40, 40)), nm=588.0), lens, options)


@EVERY_METHOD
@pytest.mark.parametrize("nm, named", [(399.0, "399 nm"), (701.0, "701 nm")])
def test_wavelengths_outside_the_lens_are_named_with_its_range(nm, named, options):
    with refused(LensError, field="wavelength", value=named, match="400 to 700 nm$"):
        simulate(radiance(np.ones((8, 8)), nm=nm), make_lens(), options)


# Fields and axes

@pytest.mark.parametrize("centre_px", [(-200.0, 300.0), (12.0, -90.0), (500.0, 500.0)])
@pytest.mark.parametrize("options, bound", [(SECTIONS, 1e-2), (PIXELS, 1e-3), (Options(accuracy=0.01), 0.01)])
def test_the_axis_may_lie_outside_the_frame(centre_px, options, bound):
    # Distortion would move all light out of the frame.
    lens = replace(EDMUND, real_height_mm=np.broadcast_to(EDMUND.heights_mm, EDMUND.real_height_mm.shape))
    image = radiance(noise((16, 20)), centre_px=centre_px)
    result = simulate(image, lens, options).cube
    assert result.min() >= 0
    assert distance_of_light(result, simulate(image, lens, EXACT).cube) < bound


@EVERY_METHOD
def test_a_fully_vignetted_height_is_dark_but_not_negative(options):
    lens = make_lens(relative_illumination=lambda nm, p: np.clip(1 - p, 0, None))
    report = Report()
    result = simulate(radiance(np.ones((61, 61)), pitch_um=50.0), lens, options, report=report).cube[0]
    assert result.min() >= -1e-7 * result.max()
    assert result[30, 0] < 0.02 * result[30, 30]  # 1.5 mm from the axis
    # Elsewhere it is 1 - p, within the error of a polynomial, which the report states. There is a height every 0.2 mm.
    residual = report.lens_image.wavelengths[0].relative_illumination_fit.residual
    row, column = (np.indices((61, 61)) - 30) * 0.05
    height_mm = np.hypot(row, column)
    on_a_height = np.isclose(height_mm / 0.2, np.round(height_mm / 0.2)) & (height_mm < 1)
    assert on_a_height.sum() == 17 and residual < 0.1
    assert np.abs(result / E_AXIS - 1 + height_mm)[on_a_height].max() < residual + 1e-5


@pytest.mark.parametrize("options", [SECTIONS, PIXELS, PAPER, EXACT], ids=["sections", "pixels", "paper", "exact"])
@pytest.mark.parametrize("real_height_mm", [lambda nm, p: 0.7 * np.arctan(p / 0.7), lambda nm, p: p + p**3 / 8])
def test_strong_distortion_keeps_even_light_even(real_height_mm, options):
    """-57 % and +50 % at the edge, 2 mm."""
    lens = make_lens(real_height_mm=real_height_mm)
    image = radiance(np.full((201, 201), 2.0), pitch_um=20.0, overscan_px=(70, 70))
    np.testing.assert_allclose(simulate(image, lens, options).cube, 2.0 * E_AXIS, rtol=1e-5)


def test_57_percent_barrel_distortion_moves_a_point_to_its_real_height():
    lens = make_lens(real_height_mm=lambda nm, p: 0.7 * np.arctan(p / 0.7))
    assert lens.real_height_mm[0, -1] / 2 - 1 == pytest.approx(-0.57, abs=0.005)
    plane = np.zeros((201, 201))
    plane[99:102, 188:191] = 1  # 1.78 mm right of the axis: 0.7 atan(1.78 / 0.7) = 0.838 mm, 41.9 px
    result = simulate(radiance(plane, pitch_um=20.0), lens, PIXEL_BY_PIXEL).cube[0]
    column = result.sum(axis=0) @ np.arange(201) / result.sum()
    # Compressed to 0.13 of its width, the square is smaller than a pixel, so its position is known to half a pixel.
    assert column - 100 == pytest.approx(41.9, abs=0.5)


@pytest.fixture(scope="module")
def fisheye_of_140_degrees():
    path = SHARED_DATA / "lens_packages" / "muller_fisheye25.npz"
    if not path.exists():
        pytest.skip(f"needs {path}")
    data = np.load(path)
    waves = np.round(data["wl_um"] * 1000, 6)
    lens = make_lens(wavelengths_nm=waves, heights_mm=data["hpar_mm"], psf=data["psf"].transpose(1, 0, 2, 3),
                     psf_pitch_um=float(data["pitch_um"]))
    return replace(lens, real_height_mm=data["hreal_mm"].T, relative_illumination=data["ri"].T)


@pytest.mark.parametrize("options", [SECTIONS, PIXELS], ids=["sections", "pixels"])
def test_a_fisheye_of_140_degrees_is_simulated(fisheye_of_140_degrees, options):
    image = SpectralImage(np.ones((1, 400, 400)), [550], pitch_um=400.0, overscan_px=(100, 100))
    report = Report()
    result = simulate(image, fisheye_of_140_degrees, options, report=report).cube
    assert np.isfinite(result).all() and result.min() >= 0
    assert report.lens_image.wavelengths[0].distortion_fit.residual_mm < 0.01


def test_fits_of_order_8_on_7_heights_are_lowered_and_the_report_says_so():
    """The table requires order 8 and has heights for order 5, two more than the order."""
    lens = make_lens(real_height_mm=lambda nm, p: p - 0.002 * p**8 / 2**5,
                     relative_illumination=lambda nm, p: 1 - 0.5 * (p / 2)**8, heights_mm=np.linspace(0, 2, 7))
    report = Report()
    simulate(radiance(np.ones((9, 9))), lens, SECTIONS, report=report)
    facts = report.lens_image.wavelengths[0]
    for fit in (facts.distortion_fit, facts.relative_illumination_fit):
        assert fit.highest_order_tried == 5 and fit.order <= 5
    # None of the tested orders met them.
    assert facts.distortion_fit.residual_mm > 2e-5 and facts.relative_illumination_fit.residual > 1e-3


def test_fits_on_enough_heights_stop_at_the_order_that_meets_the_table():
    lens = make_lens(real_height_mm=lambda nm, p: p - 0.02 * p**3, heights_mm=np.linspace(0, 2, 21))
    report = Report()
    simulate(radiance(np.ones((9, 9))), lens, SECTIONS, report=report)
    fit = report.lens_image.wavelengths[0].distortion_fit
    assert (fit.order, fit.highest_order_tried) == (4, 8) and fit.residual_mm < 1e-12


# Energy and threads

@pytest.mark.parametrize("options", DOUBLE.values(), ids=DOUBLE.keys())
@pytest.mark.parametrize("shape, centre_px", [((20, 26), None), ((21, 27), None), ((21, 26), (3.0, 50.0))])
def test_energy_on_the_full_canvas_is_preserved_to_1e_12(shape, centre_px, options):
    for lens in (comatic_lens(), make_lens(marked_psf(10, 8))):
        image = radiance(noise(shape), pitch_um=8.0, centre_px=centre_px)
        assert energy_ratio(image, lens, options) == pytest.approx(1, rel=1e-12, abs=0)


@EVERY_METHOD
@pytest.mark.parametrize("centre_px", [None, (3.0, 50.0)])
def test_results_do_not_depend_on_the_number_of_threads(monkeypatch, centre_px, options):
    plane = noise((40, 45))
    plane[20, 30] = 1e6  # creates sections of either precision
    image, lens = radiance(plane, pitch_um=30.0, centre_px=centre_px), comatic_lens()
    results = []
    for threads in (1, 2):
        monkeypatch.setattr("lensfield.engine.runtime.threads.thread_count", lambda threads=threads: threads)
        results.append(simulate(image, lens, options).cube)
    np.testing.assert_array_equal(*results)
