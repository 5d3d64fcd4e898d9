"""The PSF bank: pixel integration, orientation, interpolation, normalisation."""

import numpy as np
import pytest
from scipy.special import erf

from lenses import POINT_UM, gaussian_psf, make_lens, marked_psf
from lensfield.engine import load_lens
from lensfield.engine.field.psf_samples import psf_radius_px
from lensfield.engine.field.radial.psf_bank import PsfBank
from places import SHARED_DATA

AZIMUTHS = (0.0, 0.3, np.pi / 4, np.pi / 2, 2.0, np.pi, -2.5)
ON_CENTRE = (7 / 8) ** 2  # share in a pixel of a sample half as wide, on its centre
AXES = {"right": 0.0, "up": np.pi / 2, "left": np.pi, "down": -np.pi / 2}


def pixel_psf(psf, psf_pitch_um, pixel_pitch_um, azimuth_rad=0.0, height_mm=1.0):
    bank = PsfBank.of(make_lens(psf, psf_pitch_um=psf_pitch_um).at_wavelength(550), pixel_pitch_um)
    return bank.psfs([height_mm], [azimuth_rad])[0]


def offsets_px(pixels):
    """x and y of every pixel relative to the middle one, y upwards."""
    offset = np.arange(len(pixels)) - len(pixels) // 2
    return offset[None, :], -offset[:, None]


def centroid_px(pixels):
    x, y = offsets_px(pixels)
    return (pixels * x).sum(), (pixels * y).sum()


def middle(pixels, radius):
    centre = len(pixels) // 2
    return pixels[centre - radius:centre + radius + 1, centre - radius:centre + radius + 1]


@pytest.mark.parametrize("azimuth", AZIMUTHS)
@pytest.mark.parametrize("window", [1, 8, 9])
def test_a_point_stays_in_its_pixel(window, azimuth):
    pixels = pixel_psf(marked_psf(0, 0, window), POINT_UM, 4.0, azimuth)
    assert pixels[len(pixels) // 2, len(pixels) // 2] == pytest.approx(1.0, abs=1e-6)
    assert np.count_nonzero(pixels > 1e-6) == 1


def test_a_square_one_pixel_wide_lands_from_all_of_the_pixel():
    square = np.zeros((9, 9))
    square[2:7, 2:7] = 1 / 25
    pixels = pixel_psf(square, 1.0, 5.0)
    np.testing.assert_allclose(middle(pixels, 1), np.outer([0.125, 0.75, 0.125], [0.125, 0.75, 0.125]), atol=1e-7)


@pytest.mark.parametrize("azimuth", AZIMUTHS)
def test_light_that_moves_by_a_part_of_a_pixel_moves_by_as_much_on_average(azimuth):
    """With all light from the pixel's middle, it would move by no pixel or by a complete one."""
    pixels = pixel_psf(marked_psf(3, 0), 1.0, 10.0, azimuth)
    assert centroid_px(pixels) == pytest.approx((0.3 * np.cos(azimuth), 0.3 * np.sin(azimuth)), abs=1e-9)


def test_samples_as_large_as_pixels_are_joined_by_straight_lines():
    # A single lit sample is then 1/4, 1/2, 1/4 of squares half a pixel wide; the middle pixel shares the outer ones.
    pixels = pixel_psf(marked_psf(0, 0, 5), 5.0, 5.0)
    profile = [0.5 / 16 + 0.25 / 2, 0.5 * 7 / 8 + 0.25, 0.5 / 16 + 0.25 / 2]
    np.testing.assert_allclose(middle(pixels, 1), np.outer(profile, profile), atol=1e-7)


@pytest.mark.parametrize("azimuth", AZIMUTHS)
@pytest.mark.parametrize("pixel_pitch_um", [8.0, 4.0, 2.0, 1.0, 0.5, 0.25])
def test_a_gaussian_is_integrated_over_the_pixels_that_emit_and_receive_it(pixel_pitch_um, azimuth):
    sigma_um, psf_pitch_um = 2.0, 0.5
    pixels = pixel_psf(gaussian_psf(sigma_um, sigma_um, psf_pitch_um, 41), psf_pitch_um, pixel_pitch_um, azimuth)
    sigmas = (np.arange(len(pixels) + 2) - (len(pixels) + 1) / 2) * pixel_pitch_um / sigma_um
    integral = sigmas * (1 + erf(sigmas / np.sqrt(2))) / 2 + np.exp(-sigmas**2 / 2) / np.sqrt(2 * np.pi)
    profile = np.diff(integral, 2) * sigma_um / pixel_pitch_um
    # Samples are small squares joined by straight lines, which widens a Gaussian with a sigma of 4 samples by 1 % at
    # most.
    np.testing.assert_allclose(pixels, np.outer(profile, profile), atol=0.025 * pixels.max())


@pytest.mark.parametrize("azimuth", AZIMUTHS)
@pytest.mark.parametrize("pixel_pitch_um", [4.0, 2.0, 1.0])
def test_even_light_stays_even_at_any_rotation(pixel_pitch_um, azimuth):
    pixels = pixel_psf(np.full((81, 81), 1 / 81**2), 1.0, pixel_pitch_um, azimuth)
    inside = middle(pixels, int(20 / pixel_pitch_um))
    np.testing.assert_allclose(inside, inside.mean(), rtol=0.005)


@pytest.mark.parametrize("azimuth", AZIMUTHS)
@pytest.mark.parametrize("pixel_pitch_um", [2.0, 1.0])
def test_second_moments_are_those_of_the_turned_psf_and_two_pixels(pixel_pitch_um, azimuth):
    sigma_v_um, sigma_u_um = 2.5, 1.2
    pixels = pixel_psf(gaussian_psf(sigma_v_um, sigma_u_um, 0.25, 111), 0.25, pixel_pitch_um, azimuth)
    x, y = offsets_px(pixels)
    cos, sin, pixel = np.cos(azimuth), np.sin(azimuth), pixel_pitch_um**2 / 6
    moments = np.array([(pixels * x * x).sum(), (pixels * y * y).sum(), (pixels * x * y).sum()]) * pixel_pitch_um**2
    expected = [sigma_v_um**2 * cos**2 + sigma_u_um**2 * sin**2 + pixel,
                sigma_v_um**2 * sin**2 + sigma_u_um**2 * cos**2 + pixel,
                (sigma_v_um**2 - sigma_u_um**2) * cos * sin]
    np.testing.assert_allclose(moments, expected, atol=0.01 * sigma_v_um**2)


@pytest.mark.parametrize("direction, x, y", [("right", 1, 0), ("up", 0, 1), ("left", -1, 0), ("down", 0, -1)])
def test_v_points_away_from_the_axis(direction, x, y):
    pixels = pixel_psf(marked_psf(8, 0), 2.5, 5.0, AXES[direction])
    assert centroid_px(pixels) == pytest.approx((4 * x, 4 * y), abs=1e-9)
    assert pixels.max() == pytest.approx(ON_CENTRE, abs=1e-9)


@pytest.mark.parametrize("direction, x, y", [("right", 0, -1), ("up", 1, 0), ("left", 0, 1), ("down", -1, 0)])
def test_u_points_along_the_stated_tangent(direction, x, y):
    pixels = pixel_psf(marked_psf(0, 8), 2.5, 5.0, AXES[direction])
    assert centroid_px(pixels) == pytest.approx((4 * x, 4 * y), abs=1e-9)


def test_a_mark_lands_on_the_3_4_5_diagonal():
    pixels = pixel_psf(marked_psf(10, 0), 2.5, 5.0, np.arctan2(4, 3))
    row, column = np.unravel_index(pixels.argmax(), pixels.shape)
    assert (column - len(pixels) // 2, len(pixels) // 2 - row) == (3, 4)
    assert centroid_px(pixels) == pytest.approx((3, 4), abs=1e-9)


@pytest.mark.parametrize("azimuth", np.linspace(-3, 3, 13))
@pytest.mark.parametrize("pixel_pitch_um", [7.0, 2.0, 0.8])
def test_the_centroid_turns_with_the_azimuth_even_at_the_corner_of_the_window(pixel_pitch_um, azimuth):
    pixels = pixel_psf(marked_psf(-8, -8, 16), 1.0, pixel_pitch_um, azimuth)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    x_px, y_px = (-8 * cos - 8 * sin) / pixel_pitch_um, (-8 * sin + 8 * cos) / pixel_pitch_um
    # For small pixels, the corner sample is interpolated inwards.
    tolerance_px = 0.5 / pixel_pitch_um if pixel_pitch_um < 1.4 else 1e-9
    assert centroid_px(pixels) == pytest.approx((x_px, y_px), abs=tolerance_px)


def test_a_quarter_turn_rotates_the_pixels():
    psf = np.random.default_rng(0).random((12, 12))
    first, second = (pixel_psf(psf / psf.sum(), 1.0, 3.0, azimuth) for azimuth in (0.4, 0.4 + np.pi / 2))
    np.testing.assert_allclose(np.rot90(first), second, atol=1e-12)


@pytest.mark.parametrize("height_mm, weight", [(0.0, 0.0), (0.5, 0.25), (1.0, 0.5), (2.0, 1.0), (3.0, 1.0)])
def test_psfs_are_linear_in_height_and_constant_beyond_the_last(height_mm, weight):
    table = np.stack([marked_psf(0, 0), marked_psf(8, 0)])[None]
    lens = make_lens(table, wavelengths_nm=(550,), heights_mm=(0.0, 2.0))
    on_axis, pixels = PsfBank.of(lens.at_wavelength(550), 5.0).psfs([0.0, height_mm], [0.0, 0.0])
    centre = len(pixels) // 2
    assert pixels[centre, centre] == pytest.approx((1 - weight) * on_axis[centre, centre], abs=1e-9)
    assert pixels[centre, centre + 4] == pytest.approx(weight * ON_CENTRE, abs=1e-9)


@pytest.mark.parametrize("pixel_pitch_um", [1.5, 4.0, 30.0])
def test_the_psf_on_the_axis_has_no_azimuth(pixel_pitch_um):
    """Its samples are squares, so turned ones would differ, and uniform light would not be uniform on the axis."""
    table = np.stack([gaussian_psf(1, 1, 2.0, 21), gaussian_psf(4, 2, 2.0, 21)])[None]
    lens = make_lens(table, wavelengths_nm=(550,), heights_mm=(0.0, 2.0), psf_pitch_um=2.0)
    bank = PsfBank.of(lens.at_wavelength(550), pixel_pitch_um)
    psfs = bank.at_table_heights([0.0, 0.5, 2.0])[:, 0]
    np.testing.assert_allclose(psfs, psfs[[0, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(np.rot90(psfs[0]), psfs[0], atol=1e-15)
    np.testing.assert_allclose(bank.psfs([0.0, 0.5], [1.0, 1.0])[0], psfs[0], atol=1e-13)
    mixed = 0.75 * psfs[0] + 0.25 * bank.at_table_heights([1.0])[0, 1]
    np.testing.assert_allclose(bank.psfs([0.5], [1.0])[0], mixed, atol=1e-13)


def test_psfs_between_heights_depend_on_the_nearest_two_only():
    table = np.stack([marked_psf(v, 0) for v in (0, 4, 8)])[None]
    lens = make_lens(table, wavelengths_nm=(550,), heights_mm=(0.0, 0.5, 2.0))
    pixels = PsfBank.of(lens.at_wavelength(550), 5.0).psfs([0.875], [0.0])[0]
    centre = len(pixels) // 2
    shares = pixels[centre, [centre + 2, centre + 4]]
    np.testing.assert_allclose(shares, [0.75 * ON_CENTRE, 0.25 * ON_CENTRE], atol=1e-9)
    assert pixels[centre, centre] == pytest.approx(0, abs=1e-9)


def test_every_psf_sums_to_one_and_none_is_negative():
    rng = np.random.default_rng(1)
    psf = rng.random((16, 16))
    lens = make_lens(psf / psf.sum() * 1.0005)  # within the tolerance of a lens, and Eq. 9 normalises it
    pixels = PsfBank.of(lens.at_wavelength(550), 3.3).psfs(rng.uniform(0, 3, 50), rng.uniform(-np.pi, np.pi, 50))
    np.testing.assert_allclose(pixels.sum(axis=(1, 2)), 1, atol=1e-13)
    assert pixels.min() >= 0


def test_psfs_do_not_depend_on_the_batch_size():
    lens = make_lens(gaussian_psf(3, 1.5, 1.0, 64), psf_pitch_um=1.0)
    bank = PsfBank.of(lens.at_wavelength(550), 2.0)
    heights, azimuths = np.linspace(0, 2, 600), np.linspace(-3, 3, 600)
    together = bank.psfs(heights, azimuths)
    for index in (0, 255, 256, 257, 599):
        np.testing.assert_array_equal(together[index], bank.psfs(heights[[index]], azimuths[[index]])[0])


@pytest.mark.parametrize("window, psf_pitch_um, pixel_pitch_um", [(64, 0.5, 6.25), (9, 1.0, 5.0), (1, 0.1, 5.0)])
def test_the_radius_covers_the_diagonal_of_the_window(window, psf_pitch_um, pixel_pitch_um):
    lens = make_lens(gaussian_psf(1, 1, psf_pitch_um, window), psf_pitch_um=psf_pitch_um)
    half_diagonal_px = np.sqrt(2) * (window / 2) * psf_pitch_um / pixel_pitch_um
    assert half_diagonal_px <= psf_radius_px(lens, pixel_pitch_um) <= half_diagonal_px + 2


@pytest.fixture(scope="module")
def traced():
    path = SHARED_DATA / "lens_packages" / "eo54852.npz"
    if not path.exists():
        pytest.skip(f"needs {path}")
    return np.load(path, allow_pickle=False)


def centroid_um(psf, pitch_um, window_um=np.inf):
    """Outward and tangential centroid of the light in a square window about the chief ray."""
    offset_um = (np.arange(psf.shape[0]) - psf.shape[0] // 2) * pitch_um
    inside = np.clip((window_um / 2 - np.abs(offset_um)) / pitch_um + 0.5, 0, 1)  # a share of the samples at the edge
    psf = psf * inside[:, None] * inside
    return (psf.sum(axis=1) @ offset_um) / psf.sum(), (psf.sum(axis=0) @ offset_um) / psf.sum()


def test_edmund_coma_agrees_with_an_independent_trace(traced):
    """Traced by hand, independently of the baker, on 32 um windows whose samples were points."""
    lens = load_lens("edmund-54852")
    for w, h in np.ndindex(7, 21):
        optics = lens.at_wavelength(1e3 * traced["wl_um"][w])
        position = np.interp(traced["hpar_mm"][h], optics.heights_mm, np.arange(optics.heights_mm.size))
        below = min(int(position), optics.heights_mm.size - 2)
        weight = position - below
        psf = (1 - weight) * optics.psf[below] + weight * optics.psf[below + 1]
        expected = centroid_um(traced["psf"][h, w], float(traced["pitch_um"]))
        assert centroid_um(psf, lens.psf_pitch_um, 32) == pytest.approx(expected, abs=0.25)


def test_edmund_is_symmetric_about_the_meridional_plane():
    lens = load_lens("edmund-54852")
    tangential = [centroid_um(psf, lens.psf_pitch_um)[1] for psf in lens.psf.reshape(-1, *lens.psf.shape[2:])]
    assert np.abs(tangential).max() < 1e-4


def rings_lens(pitch_um=2.0):
    """A point on the axis, and rings of samples at 2 mm.

    At 2 mm, one sample in the middle has 0.9 of the light, four samples at a distance of 3 have 0.02 each, and four in
    the corners of a 9 x 9 window, sqrt(32) samples away, have 0.005 each.
    """
    rings = np.zeros((9, 9))
    rings[4, 4] = 0.9
    rings[[1, 7, 4, 4], [4, 4, 1, 7]] = 0.02
    rings[[0, 0, 8, 8], [0, 8, 0, 8]] = 0.005
    point = marked_psf(0, 0, 9)
    table = np.stack([point, rings])[None]
    return make_lens(table, wavelengths_nm=(550,), heights_mm=(0.0, 2.0), psf_pitch_um=pitch_um)


@pytest.mark.parametrize("energy, samples, lost", [(0.5, 0, 0.1), (0.9, 0, 0.1), (0.91, 3, 0.02), (0.98, 3, 0.02),
                                                   (0.981, np.sqrt(32), 0.0), (1.0, np.sqrt(32), 0.0)])
def test_each_psf_is_trimmed_to_the_smallest_circle_that_contains_the_energy(energy, samples, lost):
    """The point on the axis loses no light, and its circle has radius 0."""
    bank = PsfBank.of(rings_lens().at_wavelength(550), 4.0)  # samples of half a pixel
    np.testing.assert_allclose(bank.support_px(energy), [0, samples / 2], atol=0.5 / 4)
    trimmed = bank.trimmed(energy)
    np.testing.assert_allclose(trimmed.lost, [0, lost], atol=1e-6)
    np.testing.assert_allclose(trimmed.samples.sum(axis=1), 1, atol=1e-13)
    reach_px = np.where(trimmed.samples > 0, np.hypot(trimmed.v_px, trimmed.u_px), 0).max(axis=1)
    np.testing.assert_allclose(reach_px, [0, samples / 2], atol=1e-9)


def test_trimming_twice_equals_trimming_once():
    psf = np.random.default_rng(3).random((17, 17))
    untrimmed = PsfBank.of(make_lens(psf / psf.sum()).at_wavelength(550), 4.0)
    at_once, in_two = untrimmed.trimmed(0.7), untrimmed.trimmed(0.9).trimmed(0.7)
    np.testing.assert_allclose(in_two.samples, at_once.samples, rtol=1e-12)
    np.testing.assert_allclose(in_two.lost, at_once.lost, atol=1e-12)
    np.testing.assert_array_equal(untrimmed.trimmed(0.7).support_px(0.99), at_once.support_px(0.7))


def test_a_trimmed_psf_is_its_circle_normalised():
    untrimmed = PsfBank.of(rings_lens().at_wavelength(550), 4.0)
    trimmed = untrimmed.trimmed(0.95)
    first, then = (bank.psfs([2.0], [0.0])[0] for bank in (untrimmed, trimmed))
    assert then.sum() == pytest.approx(1, abs=1e-13) and len(then) < len(first)
    assert middle(then, 0)[0, 0] / middle(first, 0)[0, 0] == pytest.approx(1 / 0.98)


@pytest.mark.parametrize("radius_px", [1, 2, 3, 5, 30])
def test_a_trimmed_psf_stays_within_the_given_radius(radius_px):
    psf = np.random.default_rng(3).random((17, 17))
    bank = PsfBank.of(make_lens(psf / psf.sum()).at_wavelength(550), 4.0)
    trimmed = bank.trimmed(0.99, radius_px)
    psfs = trimmed.at_table_heights(np.linspace(-np.pi, np.pi, 41))
    assert psfs.shape[-1] == 2 * radius_px + 1
    np.testing.assert_allclose(psfs.sum(axis=(2, 3)), 1, atol=1e-13)
    if radius_px >= bank.trimmed(0.99).radius_px:
        np.testing.assert_array_equal(trimmed.samples, bank.trimmed(0.99).samples)


@pytest.mark.parametrize("energy", [1.0, 0.99, 0.9, 0.1])
@pytest.mark.parametrize("pixel_pitch_um", [1.0, 3.3, 50.0])
def test_no_light_is_lost_at_the_rim_of_the_radius(energy, pixel_pitch_um):
    psf = np.random.default_rng(3).random((17, 17))
    lens = make_lens(psf / psf.sum())
    bank = PsfBank.of(lens.at_wavelength(550), pixel_pitch_um).trimmed(energy)
    assert bank.radius_px <= psf_radius_px(lens, pixel_pitch_um)
    psfs = bank.at_table_heights(np.linspace(-np.pi, np.pi, 41))
    # Their sums equal the shares, without later normalisation.
    np.testing.assert_allclose(psfs.sum(axis=(2, 3)), 1, atol=1e-13)


@pytest.mark.parametrize("pixel_pitch_um", [1.0, 4.0, 30.0])
def test_many_azimuths_at_once_equal_single_ones(pixel_pitch_um):
    table = np.stack([gaussian_psf(2 + h, 3, 1.0, 20) for h in range(4)])[None]
    lens = make_lens(table, wavelengths_nm=(550,), heights_mm=(0.0, 0.5, 1.5, 2.0), psf_pitch_um=1.0)
    bank = PsfBank.of(lens.at_wavelength(550), pixel_pitch_um)
    azimuths = np.linspace(-4, 4, 57)  # more than one batch
    one_by_one = np.stack([bank.psfs(lens.heights_mm, np.full(4, azimuth)) for azimuth in azimuths])
    np.testing.assert_allclose(bank.at_table_heights(azimuths), one_by_one, atol=1e-13)
