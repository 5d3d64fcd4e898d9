"""From irradiance to a raw picture: metering, light in arbitrary units, and the report."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import Report, SpectralImage
from lensfield.engine.library.bodies import load_camera
from lensfield.engine.photo.photograph import CameraFacts, missing_channels, missing_text, photograph, shutter_text
from lensfield.engine.pictures.spectral_exr import read_exr, write_exr
from lensfield.engine.runtime.errors import ImageError
from lensfield.engine.sensor.exposure import Exposure, expose
from lensfield.engine.spectral.spectra import load_spectrum
from seed import SEED

CAMERA = load_camera("nikon-d700")
NM = np.linspace(380, 780, 21)


def daylight(lux, shape=(90, 130), pitch_um=CAMERA.pitch_um, **fields):
    """Even daylight of an illuminance."""
    light = load_spectrum("illuminant-d55")
    density = lux * light.band_means(NM) / light.luminous_flux_per_watt()
    return SpectralImage(np.tile(density[:, None, None], (1, *shape)), NM, pitch_um=pitch_um, quantity="irradiance",
                         **fields)


@pytest.mark.parametrize("lux", [1e-3, 20.0, 1e5])
@pytest.mark.parametrize("iso", [None, 200.0, 3200.0])
def test_the_shutter_is_metered_by_iso_2721(lux, iso):
    """The mean exposure of a metered picture is 10 / ISO lux seconds."""
    raw = photograph(daylight(lux), CAMERA, iso, noise=False)
    assert raw.exposure.shutter_s * lux == pytest.approx(10 / (iso or 200), rel=0.01)


def test_the_iso_is_metered_for_a_given_shutter():
    raw = photograph(daylight(5.0), CAMERA, shutter_s=1 / 500, noise=False)
    assert raw.exposure.iso == pytest.approx(10 * 500 / 5, rel=0.01) and raw.exposure.shutter_s == 1 / 500
    assert photograph(daylight(1e5), CAMERA, shutter_s=1.0).exposure.iso == 200, "not below the base ISO"


def test_lamps_do_not_darken_the_metered_picture():
    """A lamp on a hundredth of the picture is as bright as 5,000 times the rest."""
    lit = daylight(10.0)
    lit.cube[:, 10:19, 100:113] *= 5000
    plain, lamp = (photograph(light, CAMERA, noise=False).exposure.shutter_s for light in (daylight(10.0), lit))
    assert lamp > 0.9 * plain


@pytest.mark.parametrize("value", [0.0, np.nan, -1.0, -np.inf])
def test_black_and_damaged_pixels_leave_the_exposure_alone(value):
    """A render region, a transparent film and a small image circle are black around the picture."""
    cropped = daylight(20.0)
    cropped.cube[:, 9:], cropped.cube[:, :, 60:] = value, value
    assert photograph(cropped, CAMERA, noise=False).exposure == photograph(daylight(20.0), CAMERA, noise=False).exposure


def test_damaged_pixels_are_black_and_reported():
    light, report = daylight(20.0), Report()
    light.cube[:, 3, 4] = np.nan
    raw = photograph(light, CAMERA, report=report, noise=False)
    assert raw.numbers[3, 4] == CAMERA.black_dn < raw.numbers[3, 6]
    assert "21 values of the lens image are not finite: NaN counts as black" in report.remarks()
    assert photograph(light, CAMERA).numbers[3, 4] < CAMERA.black_dn + 7, "5 sigma of its dark noise"


def test_a_black_picture_has_an_exposure():
    assert photograph(daylight(0.0), CAMERA).exposure == Exposure(1 / 60, 200.0)


def test_light_in_arbitrary_units_is_scaled_to_the_exposure(tmp_path):
    picture = daylight(1e6, arbitrary=True)
    write_exr(picture, tmp_path / "rgb.exr")
    picture = read_exr(tmp_path / "rgb.exr")
    assert picture.arbitrary and not daylight(1.0).arbitrary
    with pytest.raises(ImageError, match="units is arbitrary: expected W m"):
        expose(picture, CAMERA, Exposure(1 / 60, 200.0))
    report = Report()
    raw = photograph(picture, CAMERA, 800.0, 1 / 30, report=report, noise=False)
    proper = photograph(daylight(10 * 30 / 800), CAMERA, 800.0, 1 / 30, noise=False)
    np.testing.assert_allclose(raw.numbers - CAMERA.black_dn, proper.numbers - CAMERA.black_dn, rtol=0.01)
    assert any("arbitrary units" in line for line in report.remarks())


def test_the_report_states_exposure_saturation_and_noise():
    generator, light = np.random.default_rng(SEED), daylight(100.0)
    light.cube[:, :30] *= 1000  # a third is saturated
    light.cube[:, 60:] *= 0.1
    report = Report()
    raw = photograph(light, CAMERA, 200.0, 1 / 2000, report=report, seed=int(generator.integers(1000)))
    facts = report.parts.of(CameraFacts)
    assert facts.saturated == pytest.approx(1 / 3, abs=0.001) and not facts.metered and facts.resampled is None
    dark = raw.numbers[60:].astype(float) - CAMERA.black_dn
    noise = np.mean([dark[raw.channel[60:] == channel].var() for channel in range(3)])
    assert facts.darkest_snr == pytest.approx(dark.mean() / np.sqrt(noise), rel=0.1)
    assert "1/2e+03 s" not in report.remarks()[0] and "1/2000 s at ISO 200; 33.3" in report.remarks()[0]
    assert report.as_dict()["camera"]["saturated"] == facts.saturated


def test_the_noise_of_bright_pixels_includes_their_differences():
    camera, report = replace(CAMERA, filters=("G",)), Report()
    raw = photograph(daylight(100.0), camera, 200.0, 1 / 300, report=report, seed=SEED)
    signal = raw.numbers.astype(float) - camera.black_dn
    light_e, snr = signal.mean() / camera.gain_at(200.0), signal.mean() / signal.std()
    assert camera.saturation_e / 2 < light_e < camera.saturation_e and snr < 0.8 * np.sqrt(light_e)
    assert report.parts.of(CameraFacts).darkest_snr == pytest.approx(snr, rel=0.05)


def test_another_pitch_and_missing_wavelengths_are_reported():
    report = Report()
    coarse = replace(daylight(100.0, (44, 66), 2.5 * CAMERA.pitch_um))
    few = SpectralImage(coarse.cube[6:10], NM[6:10], pitch_um=coarse.pitch_um, quantity="irradiance")
    raw = photograph(few, CAMERA, report=report)
    assert raw.numbers.shape == (110, 165)
    _, resampled, missing = report.remarks()
    assert "2.5 times as large as the camera's pixels: resampled to 165 x 110 px" in resampled
    shares = dict(missing_channels(CAMERA, NM[6:10]))
    assert shares["R"] > 0.5 and f"{shares['R']:.1%} of R" in missing
    assert missing_text(missing_channels(CAMERA, NM)) == ""


@pytest.mark.parametrize("shape_px, covered", [((30, 60), 1.0), ((40, 50), 0.75), ((60, 120), 0.25)])
def test_a_sensor_smaller_than_the_lens_image_is_reported(shape_px, covered):
    report = Report()
    photograph(daylight(100.0, shape_px, 2 * CAMERA.pitch_um), replace(CAMERA, shape_px=(60, 120)), report=report)
    assert report.parts.of(CameraFacts).covered == pytest.approx(covered)
    words = f"the camera's sensor covers {covered:.0%} of the lens image: the picture lacks the rest"
    assert (words in report.remarks()) == (covered < 1)


@pytest.mark.parametrize("shutter_s, text", [(1 / 60, "1/60 s"), (1 / 8000, "1/8000 s"), (0.5, "0.5 s"), (30, "30 s")])
def test_shutters_read_as_on_cameras(shutter_s, text):
    assert shutter_text(shutter_s) == text


def test_the_camera_is_turned_for_an_upright_picture():
    camera = replace(CAMERA, shape_px=(60, 90))
    for shape in ((90, 60), (60, 90)):
        assert photograph(daylight(5.0, shape), camera).numbers.shape == shape
    assert photograph(daylight(5.0, (80, 80)), camera).numbers.shape == (60, 80)
