"""From irradiance to digital numbers: by hand, and by EMVA 1288's own measurement of flat fields and dark pictures."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from lensfield.engine import CameraError, ImageError, InputError, Report, SpectralImage, photograph
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.sensor.camera import LEAST, MOST, NUMBERS, PITCH_LIMITS_UM, POSITIVE, UP_TO_1, Camera
from lensfield.engine.sensor.electrons import missing_response, response
from lensfield.engine.sensor.exposure import Exposure, channels_of, expose, exposure_value, raw_grid
from lensfield.engine.sensor.resampling import pixel_means
from refusals import refused
from seed import SEED

NM = np.array([400.0, 500.0, 600.0, 700.0])
EFFICIENCY = np.array([[0.0, 0.1, 0.5, 0.3], [0.1, 0.6, 0.2, 0.0], [0.4, 0.2, 0.0, 0.0]])
CAMERA = Camera("test", (300, 401), 4.0, ("RG", "GB"), "RGB", NM, EFFICIENCY, gain_dn_per_e=0.25, base_iso=100.0,
                saturation_e=12000.0, bits=12, black_dn=64.0, dark_noise_e=3.0, readout_noise_dn=0.5,
                dark_current_e_per_s=20.0, dsnu_e=1.5, prnu=0.008)
MONO = replace(CAMERA, filters=("G",))
PHOTON_J = 6.62607015e-34 * 299792458 / 500e-9


def flat(irradiance, shape=(120, 200), nm=(500.0,), pitch_um=4.0):
    return SpectralImage(np.full((len(nm), *shape), irradiance), nm, pitch_um=pitch_um, quantity="irradiance")


def test_electrons_of_monochromatic_light_by_hand():
    # 0.02 W/m2 on (4 um)^2 for 10 ms are 3.2e-15 J: 8055 photons of 500 nm
    raw = expose(flat(0.02), CAMERA, Exposure(0.01, 100.0, noise=False))
    electrons = 0.02 * 16e-12 * 0.01 / PHOTON_J * EFFICIENCY[:, 1]
    assert electrons == pytest.approx([805.5, 4833, 1611], rel=1e-3)
    for channel, count in enumerate(electrons):
        expected = round(64 + 0.25 * (count + 20 * 0.01))
        assert set(raw.numbers[raw.channel == channel]) == {expected}


def electrons_per_s(each, first_nm, last_nm):
    """Of even light of 1 W m^-2 nm^-1 between two wavelengths, for the linear efficiency of a channel."""
    nm = np.unique(np.concatenate([np.linspace(first_nm, last_nm, 20001), NM[(NM > first_nm) & (NM < last_nm)]]))
    return 16e-12 * scipy.integrate.trapezoid(np.interp(nm, NM, each) * nm / 500 / PHOTON_J, nm)


def test_broad_light_is_integrated_between_coarse_wavelengths():
    exact = [electrons_per_s(each, 400, 700) for each in EFFICIENCY]
    for nm in ([400, 700], [400, 450, 475, 610, 700], np.linspace(400, 700, 31)):
        np.testing.assert_allclose(response(CAMERA, np.array(nm, float)).sum(axis=1), exact, rtol=1e-5)
    missing = [1 - electrons_per_s(each, 510, 640) / complete for each, complete in zip(EFFICIENCY, exact, strict=True)]
    np.testing.assert_allclose(missing_response(CAMERA, [510, 640]), missing, rtol=1e-5)
    for beyond_nm in ([300.0, 320.0], [900.0]):
        assert missing_response(CAMERA, beyond_nm).tolist() == [1, 1, 1]


def test_the_axis_keeps_its_place_in_a_raw_picture_of_other_pixels():
    picture = PixelGrid((44, 68), 10.0, (12.0, 45.5), overscan_px=(2, 4))
    raw = raw_grid(picture, CAMERA)
    assert raw.shape_px == (100, 150) and raw.pitch_um == 4.0
    np.testing.assert_allclose(raw.edges_mm, picture.frame().edges_mm, rtol=1e-9)


@pytest.mark.parametrize("filters, corner", [
    (("RG", "GB"), "RGGB"), (("GBR", "RGG", "BRB"), "GBRG"), (("G",), "GGGG")])
def test_the_filter_array_starts_at_the_sensors_corner(filters, corner):
    """A picture in its middle begins at row 90 and column 100 of 300 x 401."""
    camera = replace(CAMERA, filters=filters)
    channel = channels_of(camera, (120, 200))
    for row, column in np.ndindex(5, 7):
        letter = filters[(90 + row) % len(filters)][(100 + column) % len(filters[0])]
        assert camera.channels[channel[row, column]] == letter


X_TRANS = ("GBGGRG", "RGRBGB", "GBGGRG", "GRGGBG", "BGBRGR", "GRGGBG")
RGBW = ("WRWG", "RWGW", "WGWB", "GWBW")


@pytest.mark.parametrize("filters, shares", [
    (X_TRANS, {"R": 8 / 36, "G": 20 / 36, "B": 8 / 36}), (RGBW, {"R": 2 / 16, "G": 4 / 16, "B": 2 / 16, "W": 8 / 16}),
    (("RRGG", "RRGG", "GGBB", "GGBB"), {"R": 1 / 4, "G": 1 / 2, "B": 1 / 4}), (("W",), {"W": 1}), ((), {})])
def test_each_pixel_counts_the_light_at_its_place_behind_its_own_filter(filters, shares):
    """X-Trans, RGBW, Quad Bayer, monochrome and three chips, under light whose colour changes across and down."""
    efficiency = dict(zip("RGBW", [*EFFICIENCY, [0.5, 0.8, 0.7, 0.4]], strict=True))
    channels = "".join(shares) or "RGB"
    camera = replace(CAMERA, shape_px=(84, 132), filters=filters, channels=channels,
                     quantum_efficiency=[efficiency[letter] for letter in channels], dark_current_e_per_s=0.0)
    rows, columns = np.mgrid[:72, :108]
    light = np.stack([0.01 + 2e-4 * columns, 0.02 + 1e-4 * rows, 0.03 - 1e-4 * columns])
    image = SpectralImage(light, [500.0, 600.0, 700.0], pitch_um=4.0, quantity="irradiance")
    raw = expose(image, camera, Exposure(6e-5, 100.0, noise=False))
    per_s = response(camera, image.wavelengths_nm)
    electrons = {letter: np.tensordot(each, light, 1) * 6e-5 for letter, each in zip(channels, per_s, strict=True)}
    if filters:
        letters = np.array([[filters[(6 + row) % len(filters)][(12 + column) % len(filters[0])]
                             for column in range(108)] for row in range(72)])  # the picture is in the middle
        assert {letter: (letters == letter).mean() for letter in channels} == pytest.approx(shares)
        expected = np.choose([channels.index(letter) for letter in letters.ravel()],
                             [each.ravel() for each in electrons.values()]).reshape(72, 108)
    else:
        expected = np.stack(list(electrons.values()))
    np.testing.assert_allclose(raw.numbers, 64 + 0.25 * expected, atol=0.51)
    assert np.ptp(raw.numbers) > 500 and raw.saturated == 0


def test_light_keeps_its_energy_and_its_place_in_other_pixels():
    generator = np.random.default_rng(SEED)
    picture = generator.random((37, 54)).astype(np.float32)
    for wanted_um, shape in ((4.0, (37, 54)), (1.3, (114, 167)), (10.7, (15, 22))):
        means = pixel_means(picture, 4.0, shape, wanted_um)
        assert means.shape == shape
        assert means.sum() * wanted_um**2 == pytest.approx(picture.sum() * 16, rel=1e-5)
        for axis in (0, 1):
            middles = [(np.arange(n) - (n - 1) / 2) * pitch for n, pitch in ((picture.shape[axis], 4.0),
                                                                             (shape[axis], wanted_um))]
            moments = [(each.sum(axis=1 - axis) * middle).sum() / each.sum()
                       for each, middle in zip((picture, means), middles, strict=True)]
            assert moments[1] == pytest.approx(moments[0], abs=0.01 * wanted_um)
    np.testing.assert_allclose(pixel_means(picture, 4.0, (74, 108), 2.0), picture.repeat(2, 0).repeat(2, 1), rtol=1e-6)
    spot = np.zeros((5, 7), np.float32)
    spot[1, 5] = 1e9
    assert pixel_means(spot, 3.0, (15, 21), 1.0).min() == 0, "no light moves"


def photon_transfer(camera, iso, levels, shutter_s=0.01):
    """Means and temporal variances, in DN, of pairs of pictures at some levels of irradiance."""
    for level in levels:
        light = flat(level, (240, 400))
        first, second = (expose(light, camera, Exposure(shutter_s, iso, SEED, frame)).numbers.astype(float)
                         for frame in (0, 1))
        yield (first + second).mean() / 2, ((first - second)**2).mean() / 2


@pytest.mark.parametrize("iso", [100.0, 800.0])
def test_emva_1288_returns_the_gain_the_noise_and_the_saturation(iso):
    pixels, gain = 240 * 400, 0.25 * iso / 100
    (dark_dn, dark_variance), *points = photon_transfer(MONO, iso, [0.0, 0.002, 0.004, 0.006])
    means, variances = np.array(points).T
    slopes = (variances - dark_variance) / (means - dark_dn)
    sigma = np.sqrt(2 / pixels) * variances / (means - dark_dn)  # of each slope
    assert np.all(np.abs(slopes - gain) < 5 * sigma)
    sigma_d = np.sqrt(3**2 + (0.5 / gain)**2 + 20 * 0.01)  # dark current fluctuates, too
    expected = (gain * sigma_d)**2 + 1 / 12
    assert dark_variance == pytest.approx(expected, abs=5 * np.sqrt(2 / pixels) * expected)
    assert dark_dn == pytest.approx(64 + gain * 0.2, abs=5 * gain * np.sqrt((sigma_d**2 + 1.5**2) / pixels) + 0.01)
    full = expose(flat(10.0), MONO, Exposure(0.01, iso, SEED))
    assert full.saturated > 0.3 and full.highest_dn == (64 + 0.25 * 12000 if iso == 100 else 4095)


def test_emva_1288_returns_the_differences_between_pixels():
    pictures = {level: np.mean([expose(flat(level, (240, 400)), MONO, Exposure(0.01, 100.0, SEED, frame)).numbers
                                for frame in range(16)], axis=0) / 0.25 for level in (0.0, 0.03)}
    noise_e2 = {level: (3**2 + 2**2 + 1 / 12 / 0.25**2 + 0.2 + level * 16e-14 / PHOTON_J * 0.6) / 16
                for level in pictures}
    dark, light = (pictures[level].var() - noise_e2[level] for level in pictures)
    count_e, pixels = pictures[0.03].mean() - pictures[0.0].mean(), 240 * 400
    assert np.sqrt(dark) == pytest.approx(1.5, abs=5 * pictures[0.0].var() * np.sqrt(2 / pixels) / (2 * 1.5))
    assert np.sqrt(light - dark) / count_e == pytest.approx(
        0.008, abs=5 * pictures[0.03].var() * np.sqrt(2 / pixels) / (2 * 0.008 * count_e**2))
    other = expose(flat(0.03, (240, 400)), MONO, Exposure(0.01, 100.0, SEED, serial=1)).numbers / 0.25
    correlation = np.corrcoef(pictures[0.03].ravel(), other.ravel())[0, 1]
    assert abs(correlation) < 5 / np.sqrt(pixels), "another copy of the camera has other pixels"


@pytest.mark.parametrize("count_e", [0.5, 20.0, 100.0, 3000.0])
def test_counts_are_poissons(count_e):
    """Mean, variance and third moment, within five standard deviations; and the share of pixels without electrons."""
    quiet = replace(MONO, dark_noise_e=0.0, readout_noise_dn=0.0, dsnu_e=0.0, prnu=0.0, dark_current_e_per_s=0.0,
                    gain_dn_per_e=1.0, black_dn=0.0, bits=16, saturation_e=6e4)
    level = count_e * PHOTON_J / (16e-12 * 0.01 * 0.6)
    counts = expose(flat(level, (300, 400)), quiet, Exposure(0.01, 100.0, SEED)).numbers.astype(float)
    size, about = counts.size, counts - count_e
    assert counts.mean() == pytest.approx(count_e, abs=5 * np.sqrt(count_e / size))
    assert (about**2).mean() == pytest.approx(count_e, abs=5 * np.sqrt((2 * count_e**2 + count_e) / size))
    sixth = 15 * count_e**3 + 25 * count_e**2 + count_e
    assert (about**3).mean() == pytest.approx(count_e, abs=5 * np.sqrt(sixth / size))
    if count_e < 1:
        empty = np.exp(-count_e)
        assert (counts == 0).mean() == pytest.approx(empty, abs=5 * np.sqrt(empty * (1 - empty) / size))


def test_noise_follows_from_the_seed_and_the_frame():
    one, same, *others = (expose(flat(0.01, (130, 70)), CAMERA, Exposure(0.01, 200.0, **given)).numbers for given in (
        {"seed": 3, "frame": 5}, {"seed": 3, "frame": 5}, {"seed": 4, "frame": 5}, {"seed": 3, "frame": 6}))
    assert np.array_equal(one, same) and not any(np.array_equal(one, other) for other in others)


def test_a_sensor_without_filters_has_all_channels():
    raw = expose(flat(0.02), replace(CAMERA, filters=()), Exposure(0.01, 100.0, noise=False))
    assert raw.numbers.shape == (3, 120, 200) and raw.channel is None
    assert raw.numbers[:, 0, 0].tolist() == [265, 1272, 467]


def test_a_picture_larger_than_the_sensor_is_cut_and_a_coarser_one_resampled():
    raw = expose(flat(0.02, (40, 60), pitch_um=16.0), CAMERA, Exposure(0.01, 100.0))
    assert raw.numbers.shape == (160, 240) and raw.resampled == 4
    assert expose(flat(0.02, (900, 900)), CAMERA, Exposure(0.01, 100.0)).numbers.shape == CAMERA.shape_px


def test_the_middle_of_a_larger_picture_in_the_same_pixels_is_taken():
    light = flat(0.0, (30, 50))
    light.cube[0, 5, 10] = 0.02  # the first pixel of the middle, 20 x 30 px
    raw = expose(light, replace(MONO, shape_px=(20, 30)), Exposure(0.01, 100.0, noise=False))
    assert np.argwhere(raw.numbers > 100).tolist() == [[0, 0]]


def test_saturation_stays_above_black_at_any_gain():
    raw = expose(flat(0.02), replace(CAMERA, black_dn=0.0, gain_dn_per_e=1e-6),
                 Exposure(0.01, 100.0, noise=False))
    assert raw.highest_dn == 1 and raw.dark_dn < 1e-6 and raw.saturated == 0 and not raw.numbers.any()


@pytest.mark.parametrize("change, message", [
    ({"pitch_um": 0.0}, "pitch_um is 0.0: expected a positive number"), ({"prnu": -0.1}, "prnu is -0.1: expected 0"),
    ({"bits": 17}, "bits is 17: expected 1 to 16"), ({"filters": ("RX",)}, "filters is X: expected only R, G, B"),
    ({"filters": ("RG", "G")}, "filters is .*same length"),
    ({"quantum_efficiency": EFFICIENCY * 2}, "is 1.2: expected 0 to 1"),
    ({"quantum_efficiency": EFFICIENCY * [[0], [1], [1]]}, "is 0 in all of R: expected more than 0"),
    ({"quantum_efficiency": EFFICIENCY[:2]}, "4 numbers for each of 3"), ({"gain_dn_per_e": "1"}, "expected a number"),
    ({"crosstalk": 1.5}, "is 1.5: expected at most 1"), ({"pixel_aperture": 0.0}, "expected a positive number"),
    ({"black_dn": 5000.0}, "black_dn is 5000.0: expected less than 4095"), ({"shape_px": (0, 4)}, "shape_px is")])
def test_bad_cameras_are_refused(change, message):
    with pytest.raises(CameraError, match=f"camera test: .*{message}"):
        replace(CAMERA, **change)


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [1e308, 1e-300, np.nan, np.inf, pytest.param(10**400, id="10**400")])
def test_implausible_numbers_are_refused(name, value):
    """Their squares and quotients overflow; a number of 0 or nearly 0 is possible where 0 is."""
    if value == 1e-300 and name not in POSITIVE:
        assert getattr(replace(CAMERA, **{name: value}), name) == value
        return
    with refused(CameraError, field=name, where="camera test"):
        replace(CAMERA, **{name: value})


@pytest.mark.parametrize("nm", [(1e-300, 500, 600, 700), (400, 500, 600, 1e300)])
def test_implausible_wavelengths_are_refused(nm):
    """Integrals over them would take all memory."""
    with pytest.raises(CameraError, match="wavelengths_nm .* ascending numbers from 10 to 100000"):
        replace(CAMERA, wavelengths_nm=nm)


@pytest.mark.parametrize("iso, shutter_s", [(None, None), (1e20, 1e20), (1e-20, 1e-20), (None, 0.01), (100.0, None)])
@pytest.mark.parametrize("name", NUMBERS)
def test_cameras_at_the_limits_take_pictures(name, iso, shutter_s):
    limits = PITCH_LIMITS_UM if name == "pitch_um" else (LEAST if name in POSITIVE else 0.0, 1.0 if name in UP_TO_1
                                                         else 4094.0 if name == "black_dn" else MOST)
    for value in limits:
        with np.errstate(all="raise"):
            raw = photograph(flat(0.02, (30, 40)), replace(CAMERA, **{name: value}), iso, shutter_s, report=Report())
        assert np.isfinite([raw.saturated, raw.dark_dn, raw.highest_dn]).all()


def test_bad_exposures_are_refused():
    with refused(InputError, field="shutter_s", value=0, where="exposure"):
        Exposure(0, 100.0)
    with pytest.raises(InputError, match=r"exposure: iso is 1e\+300: expected a positive number, from 1e-20 to 1e\+20"):
        Exposure(1.0, 1e300)
    with pytest.raises(InputError, match="seed is -1: expected a whole number"):
        Exposure(1.0, 100.0, seed=-1)
    with pytest.raises(ImageError, match="quantity is radiance: expected irradiance"):
        expose(SpectralImage(np.ones((2, 2)), [500.0], pitch_um=1.0), CAMERA, Exposure(1.0, 100.0))


def rippled(cycles_per_pixel, parts, axis):
    """Irradiance on 40 x 40 pixels of 4 um, a cosine across or down: its means over parts of a pixel."""
    x = (np.arange(40 * parts) + 0.5) / parts
    wave = 0.01 * (1 + np.sinc(cycles_per_pixel / parts) * np.cos(2 * np.pi * cycles_per_pixel * x))
    wave = np.broadcast_to(wave, (40 * parts, 40 * parts))
    return SpectralImage((wave if axis else wave.T)[None], [500.0], pitch_um=4 / parts, quantity="irradiance")


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("aperture, crosstalk", [(1.0, 0.0), (0.5, 0.0), (0.75, 0.3)])
def test_aperture_and_crosstalk_have_the_mtf_of_their_shapes(aperture, crosstalk, axis):
    camera = replace(MONO, shape_px=(40, 40), pixel_aperture=aperture, crosstalk=crosstalk, gain_dn_per_e=5.0,
                     bits=16, black_dn=0.0, dark_current_e_per_s=0.0)
    middle = np.arange(40) + 0.5
    for cycles in (0.1, 0.25, 0.4):
        numbers = expose(rippled(cycles, 16, axis), camera, Exposure(0.01, 100.0, noise=False)).numbers
        wave = numbers.mean(axis=1 - axis)[1:-1] / (5 * 0.01 * 16e-14 / PHOTON_J * 0.6) - 1  # without the edges
        expected = np.sinc(aperture * cycles) * (1 - crosstalk * np.sin(np.pi * cycles)**2)
        np.testing.assert_allclose(wave, expected * np.cos(2 * np.pi * cycles * middle[1:-1]), atol=1e-4)


def test_crosstalk_keeps_all_electrons_and_crosses_filters():
    light = np.zeros((1, 150, 40), np.float32)
    light[0, 63, 10] = light[0, 64, 0] = light[0, 149, 39] = 0.02  # by the ends of a block, at an edge and in a corner
    image = SpectralImage(light, [500.0], pitch_um=4.0, quantity="irradiance")
    for filters in (("G",), ("RG", "GB"), ()):
        camera = replace(CAMERA, shape_px=(150, 40), filters=filters, gain_dn_per_e=4.0, bits=16,
                         dark_current_e_per_s=0.0, black_dn=0.0)
        apart, shared = (expose(image, replace(camera, crosstalk=share), Exposure(0.01, 100.0, noise=False)).numbers
                         .astype(float) for share in (0.0, 0.2))
        assert shared.sum() == pytest.approx(apart.sum(), abs=15)  # each of 13 numbers is rounded
        assert shared[..., 63, 10] == pytest.approx(0.8 * apart[..., 63, 10], abs=1)
        for row, column in ((62, 10), (64, 10), (63, 9), (63, 11)):
            assert shared[..., row, column] == pytest.approx(0.05 * apart[..., 63, 10], abs=1)
    camera = replace(MONO, crosstalk=0.2, pixel_aperture=0.5)
    even = expose(flat(0.02, (150, 40)), camera, Exposure(0.01, 100.0, noise=False))
    assert np.ptp(even.numbers) == 0


@pytest.mark.parametrize("filters", [("RG", "GB"), ("GBR", "RGG", "BRB"), ("RRG", "GBB"), ()])
def test_a_turned_camera_has_the_same_pixels(filters):
    """The sensor of 300 x 401 pixels has an odd number of columns, so its corner on the right is another filter."""
    camera = replace(CAMERA, filters=filters)
    turned = camera.turned
    assert turned.shape_px == (401, 300) and turned.size_mm == camera.size_mm[::-1]
    if filters:
        np.testing.assert_array_equal(channels_of(turned, (401, 300)), np.rot90(channels_of(camera, (300, 401))))
    assert turned.turned.turned.turned == camera


def test_the_exposure_value_is_that_of_common_exposures():
    """Sunny 16: f/16 at 1/100 s and ISO 100 suits EV100 14.6, and so does f/8 at 1/800 s and ISO 200."""
    assert exposure_value(1.0, 1.0, 100.0) == 0
    assert exposure_value(16.0, 1 / 100, 100.0) == pytest.approx(8 + np.log2(100))
    assert exposure_value(8.0, 1 / 800, 200.0) == pytest.approx(8 + np.log2(100))
