"""Supersampling against closed forms, and against pictures provided in finer pixels."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from lenses import comatic_lens, distance_of_light, gaussian_psf, make_lens, points_image
from lensfield.engine import ChannelCache, InputError, Options, Report, SpectralImage, simulate
from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE, PLANE
from lensfield.engine.plan.choose import make_plan, priced, workload
from lensfield.engine.plan.cost import nanoseconds
from lensfield.engine.runtime.memory import MemoryBudget
from lensfield.engine.simulation.channel import Channel
from refusals import refused

SIGMA_PX = 0.2
FINE = make_lens(gaussian_psf(1.0, 1.0, 0.1, 81), psf_pitch_um=0.1)  # on pixels of 5 um
PIXELS = np.arange(-5, 6)
SAMPLING = 1e-3  # of the light: samples of sigma / 10 widen the Gaussian by w^2 / 12, and 4 edges let 0.4 sigma pass


def even_pixel():
    """Light of a row of uniformly lit points that reaches the pixel and its neighbours through a Gaussian."""
    def twice_integrated(x):
        return x * ndtr(x / SIGMA_PX) + SIGMA_PX * np.exp(-(x / SIGMA_PX)**2 / 2) / np.sqrt(2 * np.pi)

    return twice_integrated(PIXELS + 1) - 2 * twice_integrated(PIXELS) + twice_integrated(PIXELS - 1)


def image_of_a_point(times):
    image = points_image([(0, 0)], shape=(11, 11))
    result = simulate(image, FINE, Options(method="exact", supersampling=times)).cube[0]
    return result / result.sum(dtype=float)


@pytest.mark.parametrize("times", [1, 2, 5])
def test_a_bright_pixel_is_an_even_square(times):
    """Without supersampling, too: only the PSF's change within the pixel is left to it."""
    assert distance_of_light(image_of_a_point(times), np.outer(even_pixel(), even_pixel())) < SAMPLING


def in_finer_pixels(image, times):
    """The same radiance in finer pixels: the axis, given in half pixels of the original from the edge, stays."""
    centre = [times * centre + (times - 1) / 2 for centre in image.centre_px]
    return SpectralImage(np.kron(image.cube, np.ones((1, times, times))), image.wavelengths_nm,
                         pitch_um=image.pitch_um / times, centre_px=centre, projection=image.projection,
                         overscan_px=[times * n for n in image.overscan_px])


@pytest.mark.parametrize("times", [2, 3])
@pytest.mark.parametrize("shape, facts", [
    ((40, 51), {}), ((40, 51), dict(overscan_px=(7, 8))), ((30, 41), dict(centre_px=(3.25, -8.5), overscan_px=(2, 0))),
    ((1, 30), {}), ((1, 1), {}), ((36, 36), dict(projection=FISHEYE, overscan_px=(3, 3)))], ids=str)
@pytest.mark.parametrize("options", [{}, dict(method="pixels", azimuths=8), dict(section_size=16)], ids=str)
def test_it_equals_the_averaged_picture_in_finer_pixels(times, shape, facts, options):
    cube = np.random.default_rng(3).random((2, *shape)) ** 8  # some bright pixels among dark ones
    image, lens = SpectralImage(cube, [450, 600], pitch_um=20.0, **facts), comatic_lens()
    result = simulate(image, lens, Options(supersampling=times, **options))
    fine = simulate(in_finer_pixels(image, times), lens, Options(**options))
    rows, columns = result.frame_px
    expected = fine.cube.reshape(2, rows, times, columns, times).mean(axis=(2, 4), dtype=float)
    np.testing.assert_allclose(result.cube, expected, atol=1e-6 * expected.max(), rtol=0)
    assert result.grid == SpectralImage(image.cube, [450, 600], pitch_um=20.0,
                                        grid=PixelGrid(shape, 20.0, **facts | dict(projection=PLANE))).frame().grid


def test_1_gives_the_ordinary_picture_bit_for_bit():
    image, lens = points_image([(3, 4), (-9, 2), (0, 0)]), comatic_lens()
    plan = make_plan(Options(method="paper"), lens, image.sampling)
    channel = Channel(field_map(lens).at_wavelength(550.0), image.grid, plan, None, MemoryBudget(0))
    blurred, radius = channel.blur(channel.ideal_irradiance(image.cube[0])), plan.psf_radius_px
    result = simulate(image, lens, Options(method="paper", supersampling=1)).cube[0]
    np.testing.assert_array_equal(result, blurred[radius:-radius, radius:-radius].astype(np.float32))


def test_the_light_is_preserved_and_reported_in_watts():
    image, report = points_image([(3, 4), (-9, 2), (0, 0)]), Report()
    result = simulate(image, FINE, Options(supersampling=3), report=report)
    energy = report.lens_image.energy
    in_w = np.pi / 16 * 3 * 5e-6**2  # Eq. 2 of three pixels of radiance 1
    assert energy.in_w_per_nm == pytest.approx(in_w, rel=1e-6)
    assert energy.out_w_per_nm == pytest.approx(in_w, rel=1e-6)
    assert energy.in_frame_w_per_nm == pytest.approx(result.cube.sum(dtype=float) * 5e-6**2, rel=1e-6)
    assert energy.in_frame_w_per_nm == pytest.approx(in_w, rel=1e-6)


def test_frames_of_an_animation_share_a_cache_and_may_overwrite_their_radiance():
    first, second = points_image([(3, 4)]), points_image([(-9, 2)])
    options, cache = Options(supersampling=2), ChannelCache()
    alone = simulate(second, FINE, options).cube
    simulate(first, FINE, options, cache=cache)
    simulate(second, FINE, options, cache=cache, out=second.cube)
    np.testing.assert_array_equal(second.cube, alone)


def test_nonfinite_pixels_are_clamped_before_they_are_subdivided():
    image = points_image([(3, 4)])
    image.cube[0, 10, 10] = np.nan
    report = Report()
    simulate(image, FINE, Options(supersampling=2, fireflies="clamp"), report=report)
    assert report.lens_image.fireflies_clamped == 1


@pytest.mark.parametrize("options", [{}, dict(method="pixels"), dict(section_size=16)], ids=str)
def test_its_plan_equals_that_of_the_picture_in_finer_pixels(options):
    image, lens = points_image([(0, 0)], overscan_px=(6, 4)), comatic_lens()
    plan = make_plan(Options(supersampling=3, **options), lens, image.sampling)
    fine = make_plan(Options(**options), lens, in_finer_pixels(image, 3).sampling)
    assert replace(plan, supersampling=1) == fine and plan.error_bound == fine.error_bound
    assert plan.memory_mb == pytest.approx(fine.memory_mb + 9 * image.cube.nbytes / 1e6)
    assert priced(plan, lens, image.sampling).memory_mb == plan.memory_mb  # like cached plans
    works = workload(plan, lens, image.sampling), workload(fine, lens, in_finer_pixels(image, 3).sampling)
    assert nanoseconds(works[0], plan) == pytest.approx(nanoseconds(works[1], fine))


def test_the_plan_states_the_supersampling():
    plan = make_plan(Options(supersampling=4), FINE, points_image([(0, 0)]).sampling)
    default = make_plan(Options(), FINE, points_image([(0, 0)]).sampling)
    assert "4 x 4 per pixel" in plan.text and "per pixel" not in default.text
    assert plan.as_dict()["supersampling"] == 4
    assert plan.memory_mb > 4 * default.memory_mb and plan.error_bound <= 0.01
    assert plan.psf_radius_px > plan.reach_px >= plan.psf_radius_px / 4


def test_the_error_for_too_fine_pixels_names_the_option():
    wide = make_lens(gaussian_psf(900, 900, 100, 81), psf_pitch_um=100)
    with refused(InputError, field="supersampling", value=9):
        simulate(points_image([(0, 0)], shape=(9, 9), pitch_um=20.0), wide, Options(supersampling=9, psf_energy=1))


@pytest.mark.parametrize("value", [0, -1, 17, 1.5, True, None, "2", float("nan")])
def test_only_integers_from_1_to_16_are_accepted(value):
    with pytest.raises(InputError, match="supersampling is .*: expected a whole number, from 1 to 16"):
        Options(supersampling=value)
