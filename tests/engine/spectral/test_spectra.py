"""Spectra: reading, densities, lists of wavelengths, and conversion of colours to spectra."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import trapezoid

from lensfield.engine.runtime.errors import InputError
from lensfield.engine.spectral import spectra
from lensfield.engine.spectral.refraction import load_refraction
from lensfield.engine.spectral.spectra import (
    BAND_NM,
    CHANNEL_NM,
    MOST_WAVELENGTHS,
    Spectrum,
    blackbody,
    channel_basis,
    colour_matching,
    emission_basis,
    library_names,
    load_spectrum,
    parse_wavelengths,
    reflectance_basis,
    white_density,
)
from refusals import refused

LIBRARY = Path(spectra.__file__).parent / "data" / "spectra"

NM = np.arange(380.0, 781.0, 5.0)
# IEC 61966-2-1: XYZ of the linear primaries, columns R, G, B, for a white of Y = 1
REC709_TO_XYZ = np.array([[0.4124564, 0.3575761, 0.1804375],
                          [0.2126729, 0.7151522, 0.0721750],
                          [0.0193339, 0.1191920, 0.9503041]])


@pytest.mark.parametrize("text, expected", [
    ("400:700:31", np.arange(400, 701, 10)), ("400:700:2", [400, 700]), ("550:550:1", [550]),
    ("450,550,650", [450, 550, 650]), (" 450, 550, 650 ", [450, 550, 650]),
    ("486.1 587.6\t656.3", [486.1, 587.6, 656.3]), ("550", [550]), ("4e2:7e2:4", [400, 500, 600, 700]),
])
def test_wavelengths_are_read(text, expected):
    np.testing.assert_allclose(parse_wavelengths(text), expected, rtol=1e-14)


@pytest.mark.parametrize("text", [
    "", "  ", "red", "400:700", "400:700:31:2", "400:700:0", "400:700:-3", "400:700:1", "550:550:2", "700:400:31",
    "400:700:2.5", "400:700:x", "700,400", "500,500", "-400,500", "0,500", "nan", "400,nan", "inf", "400:inf:3",
])
def test_invalid_wavelengths_are_refused(text):
    with refused(InputError, field="wavelengths", match="400:700:31"):
        parse_wavelengths(text)


def write(folder, contents, name="lamp.spd"):
    (folder / name).write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    return name


def test_a_spectrum_of_the_library_is_loaded_by_name():
    assert {"illuminant-d65", "illuminant-a", "mercury"} <= set(library_names())
    assert load_spectrum("illuminant-d65").at(560) == pytest.approx(100.0)


def test_the_library_contains_lights_and_reflectances():
    lights, reflectances = library_names("light"), library_names("reflectance")
    assert sorted(lights + reflectances) == library_names() and not set(lights) & set(reflectances)
    assert {*(f"fluorescent-fl{number}" for number in range(1, 13)), *(f"led-b{number}" for number in range(1, 6)),
            "illuminant-e", "led-bh1", "led-rgb1", "led-v1", "led-v2", "sodium-lp", "sodium-hp1"} <= set(lights)
    assert {"chart-15-red", "grass-lawn", "snow-melting", "brick-red"} <= set(reflectances)


@pytest.mark.parametrize("name", library_names("light"))
def test_every_light_of_the_library_covers_the_band(name):
    spectrum = load_spectrum(name)
    assert spectrum.wavelengths_nm[0] <= BAND_NM[0] and spectrum.wavelengths_nm[-1] >= BAND_NM[1]
    assert spectrum.values.max() > 0


@pytest.mark.parametrize("name", library_names("reflectance"))
def test_every_reflectance_of_the_library_covers_visible_light_and_is_at_most_1(name):
    spectrum = load_spectrum(name)
    assert spectrum.wavelengths_nm[0] <= 400 and spectrum.wavelengths_nm[-1] >= 700
    assert 0 < spectrum.values.min() and spectrum.values.max() <= 1


@pytest.mark.parametrize("path", sorted(LIBRARY.glob("*/*.spd")), ids=lambda path: path.stem)
def test_every_spectrum_of_the_library_names_its_source(path):
    head = path.read_text().splitlines()[0]
    assert any(source in head for source in ("CIE 015:2018", "NIST", "ISO 17321", "USGS Spectral Library"))


@pytest.mark.parametrize("contents", [
    "400 0.1\n700 0.3\n", "# a lamp\n400\t0.1\n\n700\t0.3 # red", "400,0.1\r\n700,0.3\r\n", "400; 0.1\n700; 0.3",
    "\ufeff400 1e-1\n700 3E-1\n", "  400   0.1 17\n 700 .3 18\n",
])
def test_a_file_of_two_columns_is_read(tmp_path, contents):
    spectrum = load_spectrum(write(tmp_path, contents), tmp_path)
    np.testing.assert_allclose(spectrum.at([300, 400, 550, 700, 800]), [0.1, 0.1, 0.2, 0.3, 0.3])


def test_an_absolute_path_needs_no_folder(tmp_path):
    write(tmp_path, "400 1\n700 1\n")
    assert load_spectrum(str(tmp_path / "lamp.spd")).at(500) == 1


@pytest.mark.parametrize("text", ["400:0.1, 700:0.3", "400:0.1,700:0.3", "400nm:0.1;700nm:0.3;",
                                  " 400 : .1 ; 700 : 3e-1 "])
def test_inline_pairs_are_read(text):
    spectrum = load_spectrum(text)
    np.testing.assert_allclose(spectrum.wavelengths_nm, [400, 700])
    np.testing.assert_allclose(spectrum.values, [0.1, 0.3])


@pytest.mark.parametrize("text", ["[400 0.1 700 0.3]", "400 0.1 700 0.3", " [ 400 .1\t700 3e-1 ] "])
def test_inline_pairs_of_pbrt_are_read(text):
    spectrum = load_spectrum(text)
    np.testing.assert_allclose(spectrum.wavelengths_nm, [400, 700])
    np.testing.assert_allclose(spectrum.values, [0.1, 0.3])


@pytest.mark.parametrize("text", ["[400 0.1 700]", "400 0.1 700", "[]", "[", "[400 0.1", "400 0.1]", "[[400 0.1]]",
                                  "[400 red]", "[700 1 400 1]", "[400 -1]", "[nan 1]", "[400:0.1]"])
def test_bad_pairs_of_pbrt_are_an_input_error(text):
    with pytest.raises(InputError) as error:
        load_spectrum(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["400:0.1, 700", "400:0.1 700:0.3", "700:1, 400:1", "500:1, 500:2", "400:-1, 500:1",
                                  "-400:1, 500:1", "400:1, x:2", "no-such-lamp", "", "missing/file.spd"])
def test_bad_text_is_an_input_error(text):
    with pytest.raises(InputError) as error:
        load_spectrum(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["1" * 10**6, "1" * 60000, "1" * 30000 + "." + "1" * 30000, "1e" + "1" * 60000,
                                  "400:" + "1" * 60000 + "x", "~no-such-user/x", "~no-such-user", "[" + "1 " * 30000])
def test_texts_of_a_million_digits_and_unknown_home_folders_are_refused_at_once(text):
    """None takes quadratic time in its length, which would be hours."""
    for read in (load_spectrum, load_refraction, parse_wavelengths):
        with pytest.raises(InputError) as error:
            read(text)
        assert len(str(error.value)) < 900


def test_a_list_of_wavelengths_has_a_maximum_length():
    with refused(InputError, field="wavelengths", match=f"at most {MOST_WAVELENGTHS}"):
        parse_wavelengths(",".join(map(str, range(1, MOST_WAVELENGTHS + 2))))
    assert parse_wavelengths(",".join(map(str, range(1, MOST_WAVELENGTHS + 1)))).size == MOST_WAVELENGTHS


@pytest.mark.parametrize("contents, field, value", [
    ("400 1\n" * 2**21, "size", f"over {2**23} bytes"), ("1" * 10**6, "line 1", "1" * 58 + "..." + "1" * 59),
    ("\x1b[31m400 1", "line 1", "?[31m400 1")], ids=["large", "long", "steers"])
def test_files_that_are_not_spectra_give_a_short_error(tmp_path, contents, field, value):
    (tmp_path / "lamp.spd").write_text(contents)
    with refused(InputError, field=field, value=value, where="lamp.spd") as error:
        load_spectrum(str(tmp_path / "lamp.spd"))
    assert str(error.value).isprintable() and len(str(error.value)) < 400


def test_a_text_too_long_for_a_path_is_an_input_error():
    with pytest.raises(InputError):
        load_spectrum("x" * 5000)


@pytest.mark.parametrize("contents, field, word", [
    ("", "spectrum", "empty"), ("# nothing\n", "spectrum", "empty"), ("400 0.1\nred 0.3\n", "line 2", "red 0.3"),
    ("400\n", "line 1", "400"), ("700 1\n400 1\n", "wavelengths", "ascending"),
    ("400 1\n400 1\n", "wavelengths", "ascending"), ("400 -1\n700 1\n", "spectrum", "-1"),
    ("400 nan\n700 1\n", "spectrum", "nan"), ("400 inf\n700 1\n", "spectrum", "finite"),
    ("inf 1\n", "wavelengths", "ascending"), (b"\x00\xff\xfe\x9c", "line 1", ""),
])
def test_a_bad_file_is_an_input_error_that_says_what_is_wrong(tmp_path, contents, field, word):
    with refused(InputError, field=field, where="lamp.spd", match=word):
        load_spectrum(write(tmp_path, contents), tmp_path)


def integral_over_the_band(spectrum):
    nm = np.arange(BAND_NM[0], BAND_NM[1] + 0.005, 0.01)
    density = spectrum.density_at(nm)
    return ((density[1:] + density[:-1]) / 2).sum() * 0.01


@pytest.mark.parametrize("name", library_names("light"))
def test_a_density_integrates_to_one(name):
    assert integral_over_the_band(load_spectrum(name)) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("text", ["300:1, 900:1", "380:0, 780:5", "500:0, 550.5:7, 551:0", "200:3, 420:1, 2000:9"])
def test_a_density_of_pairs_integrates_to_one(text):
    assert integral_over_the_band(load_spectrum(text)) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("text", ["500:1, 600:1", "550:1, 551:1", "632:1, 634:1"])
def test_a_density_that_ends_inside_the_band_integrates_to_one(text):
    assert integral_over_the_band(load_spectrum(text)) == pytest.approx(1.0, abs=1e-3)


def test_a_flat_density_is_one_over_the_band():
    np.testing.assert_allclose(load_spectrum("300:5, 900:5").density_at([400, 555.5, 780]), 1 / 400, rtol=1e-9)


def test_a_lamp_emits_no_light_beyond_its_ends():
    np.testing.assert_array_equal(load_spectrum("500:1, 600:1").density_at([499, 601]), 0)


@pytest.mark.parametrize("text", ["400:0, 700:0", "790:1, 900:1"])
def test_a_lamp_without_light_in_the_band_is_an_input_error(text):
    with pytest.raises(InputError):
        load_spectrum(text).density_at([550])


@pytest.mark.parametrize("temperature_k, peak_nm", [(4000, 724.44), (5000, 579.55), (6500, 445.81)])
def test_a_blackbody_peaks_where_wien_says(temperature_k, peak_nm):
    spectrum = blackbody(temperature_k)
    assert spectrum.wavelengths_nm[spectrum.values.argmax()] == pytest.approx(peak_nm, abs=1)


def test_a_blackbody_of_2856_k_is_illuminant_a():
    ratio = blackbody(2856).at(NM) / load_spectrum("illuminant-a").at(NM)
    np.testing.assert_allclose(ratio / ratio[36], 1, rtol=0.01)  # 560 nm


def test_illuminant_a_follows_its_definition():
    # CIE 15: 100 (560 / nm)^5 (exp(1.435e7 / (2848 * 560)) - 1) / (exp(1.435e7 / (2848 nm)) - 1)
    expected = 100 * (560 / NM)**5 * np.expm1(1.435e7 / (2848 * 560)) / np.expm1(1.435e7 / (2848 * NM))
    np.testing.assert_allclose(load_spectrum("illuminant-a").at(NM), expected, rtol=2e-4)


@pytest.mark.parametrize("nm, value", [(380, 49.9755), (400, 82.7549), (450, 117.008), (500, 109.354), (550, 104.046),
                                       (600, 90.0062), (650, 80.0268), (700, 71.6091), (780, 63.3828)])
def test_d65_matches_the_cie_table(nm, value):
    assert load_spectrum("illuminant-d65").at(nm) == pytest.approx(value, rel=1e-3)


@pytest.mark.parametrize("nm, x_bar, y_bar, z_bar", [(450, 0.3362, 0.038, 1.77211), (555, 0.5121, 1.0, 0.0057),
                                                     (600, 1.0622, 0.631, 0.0008), (340, 0, 0, 0), (900, 0, 0, 0)])
def test_colour_matching_functions_are_those_of_1931(nm, x_bar, y_bar, z_bar):
    np.testing.assert_allclose(colour_matching(nm), [x_bar, y_bar, z_bar], atol=2e-4)


def chromaticity(spectrum):
    tristimulus = spectrum @ colour_matching(NM)
    return tristimulus[:2] / tristimulus.sum()


# CIE 015:2018: the chromaticities that the CIE states with the spectra (and for E, by definition)
@pytest.mark.parametrize("name, x, y", [
    ("illuminant-a", 0.44758, 0.40745), ("illuminant-d50", 0.34567, 0.35850), ("illuminant-d55", 0.33243, 0.34744),
    ("illuminant-d65", 0.31272, 0.32903), ("illuminant-d75", 0.29903, 0.31488), ("illuminant-e", 1 / 3, 1 / 3),
    ("fluorescent-fl1", 0.3131, 0.3371), ("fluorescent-fl2", 0.3721, 0.3751), ("fluorescent-fl3", 0.4091, 0.3941),
    ("fluorescent-fl4", 0.4402, 0.4031), ("fluorescent-fl5", 0.3138, 0.3452), ("fluorescent-fl6", 0.3779, 0.3882),
    ("fluorescent-fl7", 0.3129, 0.3292), ("fluorescent-fl8", 0.3458, 0.3586), ("fluorescent-fl9", 0.3741, 0.3727),
    ("fluorescent-fl10", 0.3458, 0.3588), ("fluorescent-fl11", 0.3805, 0.3769), ("fluorescent-fl12", 0.4370, 0.4042),
    ("led-b1", 0.4560, 0.4078), ("led-b2", 0.4357, 0.4012), ("led-b3", 0.3756, 0.3723), ("led-b4", 0.3422, 0.3502),
    ("led-b5", 0.3118, 0.3236), ("led-bh1", 0.4474, 0.4066), ("led-rgb1", 0.4557, 0.4211), ("led-v1", 0.4548, 0.4044),
    ("led-v2", 0.3781, 0.3775), ("sodium-hp1", 0.5330, 0.4150), ("sodium-hp2", 0.4778, 0.4158),
    ("metal-halide-hp3", 0.4302, 0.4075), ("metal-halide-hp4", 0.3812, 0.3797), ("metal-halide-hp5", 0.3776, 0.3713)])
def test_chromaticity_of_known_lights(name, x, y):
    assert chromaticity(load_spectrum(name).at(NM)) == pytest.approx((x, y), abs=2e-3)


def test_white_reflects_everything():
    np.testing.assert_allclose(reflectance_basis(np.linspace(380, 780, 401)).sum(axis=1), 1, atol=1e-4)


def test_reflectances_of_colours_lie_between_0_and_1():
    assert reflectance_basis(NM).min() >= -1e-6 and reflectance_basis(NM).max() <= 1 + 1e-6


@pytest.mark.parametrize("rgb", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (0.2, 0.5, 0.8), (0.9, 0.7, 0.1)])
def test_a_colour_converted_to_a_reflectance_looks_the_same_under_d65(rgb):
    d65, matching = load_spectrum("illuminant-d65").at(NM), colour_matching(NM)
    tristimulus = (reflectance_basis(NM) @ rgb * d65) @ matching / (d65 @ matching[:, 1])
    white = d65 @ matching / (d65 @ matching[:, 1])
    xyz = np.array([[0.64, 0.33, 0.03], [0.30, 0.60, 0.10], [0.15, 0.06, 0.79]]).T  # Rec. 709: x, y, z of R, G, B
    np.testing.assert_allclose(np.linalg.solve(xyz * np.linalg.solve(xyz, white), tristimulus), rgb, atol=5e-6)
    np.testing.assert_allclose(np.linalg.solve(REC709_TO_XYZ, tristimulus), rgb, atol=1e-3)


def test_the_curves_of_the_primaries_have_no_steps():
    assert np.abs(np.diff(reflectance_basis(NM), axis=0)).max() < 0.2  # over 5 nm


@pytest.mark.parametrize("lamp", ["fluorescent-fl2", "fluorescent-fl11", "led-b3", "led-rgb1", "sodium-hp1"])
def test_natural_reflectances_reconstructed_from_their_colours_look_right_under_lamps(lamp):
    # USGS samples that were not part of the fit; XYZ as fractions of the Y of white
    d65, light, matching = load_spectrum("illuminant-d65").at(NM), load_spectrum(lamp).at(NM), colour_matching(NM)
    for name in ("brick-red", "concrete-grey", "grass-dry", "leaf-maple", "sand-beach", "snow-melting", "wood-pine"):
        measured = load_spectrum(name).at(NM)
        rgb = np.linalg.solve(REC709_TO_XYZ, (measured * d65) @ matching / (d65 @ matching[:, 1]))
        missed = (reflectance_basis(NM) @ rgb - measured) * light @ matching / (light @ matching[:, 1])
        assert np.abs(missed).max() < 0.012, name


def test_white_light_is_d65_of_one_watt_in_the_band():
    np.testing.assert_allclose(emission_basis(NM).sum(axis=1), white_density(NM), rtol=1e-4)
    assert trapezoid(white_density(NM), NM) == pytest.approx(1.0, abs=1e-4)
    assert white_density(560)[0] / white_density(450)[0] == pytest.approx(100 / 117.008, rel=1e-4)


def test_a_spectrum_is_linear_between_its_values():
    assert Spectrum(np.array([400.0, 500.0]), np.array([1.0, 3.0])).at(425) == pytest.approx(1.5)


def test_channel_values_are_exact_at_their_wavelengths_and_shared_between():
    np.testing.assert_allclose(channel_basis(np.array(CHANNEL_NM)), np.eye(3), atol=1e-12)
    halfway = channel_basis(np.array([(CHANNEL_NM[0] + CHANNEL_NM[1]) / 2]))
    np.testing.assert_allclose(halfway, [[0.5, 0.5, 0]], atol=1e-12)
    np.testing.assert_allclose(channel_basis(np.array([380.0, 780.0])), [[0, 0, 1], [1, 0, 0]], atol=1e-12)


def test_illuminant_e_gives_683_lumens_times_the_mean_of_v():
    # Wyszecki and Stiles: the integral of V is 106.857 nm
    assert load_spectrum("illuminant-e").luminous_flux_per_watt() == pytest.approx(683 * 106.857 / 400, rel=1e-4)


@pytest.mark.parametrize("nm, v", [(555, 1.0), (450, 0.038), (510, 0.503), (600, 0.631), (650, 0.107)])
def test_a_line_gives_683_lumens_times_v(nm, v):
    line = load_spectrum(f"{nm - 0.1}:0, {nm}:1, {nm + 0.1}:0")
    assert line.luminous_flux_per_watt() == pytest.approx(683 * v, rel=2e-3)


def test_light_outside_of_the_band_counts_neither_as_watts_nor_as_lumens():
    inside, wider = load_spectrum("380:1, 780:1"), load_spectrum("200:1, 2000:1")
    assert wider.luminous_flux_per_watt() == pytest.approx(inside.luminous_flux_per_watt(), rel=1e-12)


def test_a_lamp_without_light_in_the_band_has_no_lumens_and_no_means():
    dark = load_spectrum("790:1, 900:1")
    with pytest.raises(InputError):
        dark.luminous_flux_per_watt()
    with pytest.raises(InputError):
        dark.band_means([400, 500])


def test_band_means_of_a_flat_lamp_by_hand():
    # 0.01 per nm from 500 to 600 nm; the hat about 550 of base 450 to 650 is 1/2 at 500 and 600, with an area of 0.75
    # of 100 nm, so 0.01 * 75 / 100. The hat about 450 falls from 1/2 at 500 to 0 at 550: an area of 12.5 nm of its 50.
    means = load_spectrum("500:1, 600:1").band_means([450, 550, 650])
    np.testing.assert_allclose(means, [0.0025, 0.0075, 0.0025], rtol=1e-12)


def test_band_means_of_a_ramp_by_hand():
    # density (nm - 400) / 20000 from 400 to 600; for a straight line, the mean under a full hat is the value in its
    # middle, and under a half hat the value a third of the way in
    ramp = load_spectrum("400:0, 600:1")
    np.testing.assert_allclose(ramp.band_means([440, 500, 560]), np.array([60, 100, 140]) / 20000, rtol=1e-12)


def test_a_line_between_two_wavelengths_is_shared_without_loss():
    # 1 W within 0.02 nm of 525 nm: a quarter of the way from 510 to 570, between hats 60 nm wide
    means = load_spectrum("524.99:0, 525:1, 525.01:0").band_means([450, 510, 570, 630])
    np.testing.assert_allclose(means, [0, 0.75 / 60, 0.25 / 60, 0], atol=1e-12, rtol=1e-9)


@pytest.mark.parametrize("name", ["fluorescent-fl11", "led-rgb1", "mercury", "sodium-lp", "illuminant-d65"])
@pytest.mark.parametrize("count", [2, 5, 9, 31])
def test_band_means_keep_the_light_between_the_first_and_last_wavelength(name, count):
    lamp, few, fine = load_spectrum(name), np.linspace(400, 700, count), np.linspace(400, 700, 30001)
    assert trapezoid(lamp.band_means(few), few) == pytest.approx(trapezoid(lamp.density_at(fine), fine), rel=1e-6)


def test_the_band_mean_of_a_single_wavelength_is_its_density():
    lamp = load_spectrum("mercury")
    np.testing.assert_allclose(lamp.band_means([547.3]), lamp.density_at([547.3]), rtol=1e-12)


def test_band_means_at_many_wavelengths_are_the_density():
    lamp, nm = load_spectrum("illuminant-d65"), np.arange(400.0, 700.5, 1.0)
    np.testing.assert_allclose(lamp.band_means(nm), lamp.density_at(nm), rtol=0.01)
