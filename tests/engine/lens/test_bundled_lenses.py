"""The lenses that come with the project: small, told about, sound, and usable as they are."""

import re
import tomllib

import numpy as np
import pytest

from lensfield.engine import Lens, Options, SpectralImage, simulate
from lensfield.engine.lens.checks import check_lens
from lensfield.engine.library import BUNDLED, bundled_lenses, bundled_names

KINDS = {"angenieux-50mm-f1.1", "angenieux-50mm-f4", "apple-phone-4mm", "cooke-triplet-50mm", "edmund-54852",
         "kodak-petzval-100mm", "muller-fisheye-25mm", "nikkor-28mm", "tessar-50mm"}


@pytest.fixture(scope="module", params=bundled_names())
def lens(request):
    """Each lens of the library, loaded once for all tests of it."""
    return Lens.load(request.param)


def test_the_library_has_every_kind_and_is_small():
    assert KINDS <= set(bundled_names())
    sizes = [(BUNDLED / f"{name}.npz").stat().st_size for name in bundled_names()]
    assert max(sizes) <= 2e6 and sum(sizes) <= 16e6


def test_each_is_told_about(lens):
    told = bundled_lenses()[lens.name]
    assert (told.maker, told.story) == (lens.maker, lens.story)
    assert min(len(lens.maker), len(lens.story), len(lens.source), len(lens.notes)) > 10


def test_each_has_its_prescription(lens):
    """Of the same name, but for those that one prescription gives at several stops."""
    paths = [BUNDLED / "prescriptions" / f"{stem}.toml" for stem in (lens.name, re.sub(r"-f[\d.]+$", "", lens.name))]
    path = next(path for path in paths if path.is_file())
    prescription = tomllib.loads(path.read_text(encoding="utf-8"))
    assert " ".join(prescription["story"].split()) == lens.story
    assert lens.notes.startswith(" ".join(prescription["notes"].split()))
    assert tuple(prescription["sensor_mm"]) == lens.sensor_mm


def test_each_holds_the_light_and_is_without_errors(lens):
    least = 0.97 if lens.name == "apple-phone-4mm" else 0.995  # whose pitch is that of its sensor's pixels
    assert lens.enclosed_energy.min() >= least
    assert lens.mirror_symmetric
    assert [str(finding) for finding in check_lens(lens) if finding.severity == "error"] == []


def test_each_covers_its_sensor_but_for_the_outermost_corners(lens):
    x_mm, y_mm = np.meshgrid(*((np.arange(400) + 0.5) / 400 * side / 2 for side in lens.sensor_mm))
    last_mm = lens.at_wavelength(550).real_height_mm[-1]
    assert np.mean(np.hypot(x_mm, y_mm) <= last_mm) > 0.97


def test_each_makes_a_picture(lens):
    radiance = SpectralImage(np.ones((2, 60, 80)), [450, 620], pitch_um=lens.sensor_mm[0] * 1e3 / 80)
    irradiance = simulate(radiance, lens, Options(accuracy=0.03)).cube
    assert np.all(np.isfinite(irradiance)) and np.all(irradiance[:, 15:45, 20:60] > 0)
    expected = np.pi / (4 * lens.f_number_effective**2) * lens.at_wavelength(450).transmittance
    assert irradiance[0, 30, 40] == pytest.approx(expected, rel=0.03)


def test_the_fisheye_is_close_to_the_papers_second_lens():
    """f = 25.25 mm, f/4, 140 degrees, -56.6 % (section 4 of the paper)."""
    lens = Lens.load("muller-fisheye-25mm")
    optics = lens.at_wavelength(587.6)
    assert lens.efl_mm == pytest.approx(25.25, abs=0.01)
    assert lens.f_number_effective == pytest.approx(4, rel=0.02)
    assert np.degrees(np.arctan(lens.heights_mm[-1] / lens.efl_mm)) == pytest.approx(70, abs=0.01)
    assert 100 * (optics.real_height_mm[-1] / optics.heights_mm[-1] - 1) == pytest.approx(-56.6, abs=1.5)


def test_stopping_down_sharpens_and_dims():
    wide, closed = Lens.load("angenieux-50mm-f1.1"), Lens.load("angenieux-50mm-f4")
    assert wide.efl_mm == pytest.approx(closed.efl_mm, rel=1e-6)
    assert wide.f_number_effective < 1.3 and closed.f_number_effective == pytest.approx(4, rel=0.02)
    assert closed.psf_pitch_um * closed.psf.shape[-1] < 0.7 * wide.psf_pitch_um * wide.psf.shape[-1]
