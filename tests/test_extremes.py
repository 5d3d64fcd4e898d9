"""Numerical stability at the extremes, each with its figure."""

import numpy as np
import pytest
from lenses import SHARED_DATA, gaussian_psf, make_lens
from lensfield.engine import Lens, Options, Report, SpectralImage, simulate

EDMUND = Lens.load("edmund-54852")


def radiance(plane, pitch_um=6.25, nm=550.0):
    return SpectralImage(np.asarray(plane, dtype=np.float32)[None], [nm], pitch_um=pitch_um)


@pytest.mark.parametrize("section_size", [1, 2, 7, 1000])
@pytest.mark.parametrize("order", [1, 2])
def test_even_light_keeps_its_energy_whatever_the_section(section_size, order):
    report = Report()
    simulate(radiance(np.ones((40, 52))), EDMUND, Options(section_size, order), report=report)
    energy = report.facts["energy"]
    assert energy["out_w_per_nm"] == pytest.approx(energy["in_w_per_nm"], rel=1e-12)


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (3, 5)])
def test_images_smaller_than_the_psf_are_taken(shape):
    result = simulate(radiance(np.ones(shape), pitch_um=1.0), EDMUND)
    assert result.cube.shape == (1, *shape) and np.isfinite(result.cube).all() and result.cube.min() > 0


@pytest.mark.parametrize("order", [1, 2])
def test_a_highlight_leaves_the_background_alone(order):
    """1e6 on 1e-3: no pixel falls below 0.999e-3 of its light, and far ones are right to 1e-6."""
    plane = np.full((96, 128), 1e-3)
    even = simulate(radiance(plane), EDMUND, Options(32, order)).cube[0].astype(float)
    plane[40, 70] = 1e6
    result = simulate(radiance(plane), EDMUND, Options(32, order)).cube[0].astype(float)
    inside = (slice(12, -12), slice(12, -12))
    assert (result[inside] / even[inside]).min() > 0.999
    far = np.hypot(*np.mgrid[-40:56, -70:58]) > 12
    far[:12], far[-12:], far[:, :12], far[:, -12:] = False, False, False, False
    assert np.abs(result[far] / even[far] - 1).max() < 1e-6


def test_the_faintest_and_the_brightest_floats_survive():
    for value in (1e-44, 1e-30, 1e30):
        result = simulate(radiance(np.full((16, 16), value)), make_lens(gaussian_psf(4, 4, 2.5, 9))).cube
        expected = float(np.float32(value)) * np.pi / 16
        assert result[0, 8, 8] == pytest.approx(expected, rel=1e-3, abs=2e-45)


def test_black_stays_black():
    assert not simulate(radiance(np.zeros((30, 40))), EDMUND).cube.any()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_pixel_that_is_no_number_is_named(value):
    plane = np.ones((6, 8))
    plane[4, 3] = value
    with pytest.raises(ValueError, match="pixel at row 4, column 3, 550 nm is"):
        simulate(radiance(plane), EDMUND)


@pytest.mark.parametrize("pitch_um", [100.0, 0.5])
def test_psfs_smaller_than_a_pixel_and_larger_than_the_image(pitch_um):
    lens = make_lens(gaussian_psf(1.0, 1.0, 0.25, 33), psf_pitch_um=0.25)
    report = Report()
    simulate(radiance(np.ones((9, 9)), pitch_um=pitch_um), lens, report=report)
    energy = report.facts["energy"]
    assert energy["out_w_per_nm"] == pytest.approx(energy["in_w_per_nm"], rel=1e-12)


def test_the_axis_may_lie_outside_the_frame():
    image = SpectralImage(np.ones((1, 24, 32)), [550], pitch_um=6.25, centre_px=(-200.0, 300.0))
    result = simulate(image, EDMUND)
    assert np.isfinite(result.cube).all() and result.cube.min() >= 0


def test_a_fully_vignetted_height_is_dark_and_no_more():
    lens = make_lens(relative_illumination=lambda nm, p: np.clip(1 - p, 0, None))
    result = simulate(radiance(np.ones((101, 101)), pitch_um=30.0), lens)
    assert result.cube.min() >= 0
    assert result.cube[0, 50, 0] < 0.02 * result.cube[0, 50, 50]  # 1.5 mm from the axis


@pytest.mark.parametrize("real_height_mm", [lambda nm, p: 0.7 * np.arctan(p / 0.7), lambda nm, p: p + p**3 / 8])
def test_strong_distortion_keeps_even_light_even(real_height_mm):
    """-57 % and +50 % at the edge, 2 mm."""
    lens = make_lens(real_height_mm=real_height_mm)
    plane = np.full((401, 401), 2.0)
    image = SpectralImage(plane[None], [550], pitch_um=10.0, overscan_px=(140, 140))
    result = simulate(image, lens).cube[0]
    np.testing.assert_allclose(result, 2.0 * np.pi / 16, rtol=1e-5)


def test_a_fisheye_of_140_degrees_is_taken():
    path = SHARED_DATA / "lens_packages" / "muller_fisheye25.npz"
    if not path.exists():
        pytest.skip(f"needs {path}")
    data = np.load(path)
    waves = np.round(data["wl_um"] * 1000, 6)
    lens = make_lens(wavelengths_nm=waves, heights_mm=data["hpar_mm"], psf=data["psf"].transpose(1, 0, 2, 3),
                     psf_pitch_um=float(data["pitch_um"]))
    lens = Lens(**{name: getattr(lens, name) for name in lens.__dataclass_fields__}
                | {"real_height_mm": data["hreal_mm"].T, "relative_illumination": data["ri"].T})
    image = SpectralImage(np.ones((1, 400, 400)), [550], pitch_um=400.0, overscan_px=(100, 100))
    report = Report()
    result = simulate(image, lens, report=report).cube
    assert np.isfinite(result).all() and result.min() >= -1e-12
    fits = report.facts["wavelengths"][0]
    assert fits["distortion_fit"]["residual_mm"] < 0.01


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch):
    plane = np.random.default_rng(4).random((90, 120))
    results = []
    for threads in (1, 2, 3):
        monkeypatch.setattr("os.cpu_count", lambda threads=threads: threads)
        results.append(simulate(radiance(plane), EDMUND).cube)
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])
