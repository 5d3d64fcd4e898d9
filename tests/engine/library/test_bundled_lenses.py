"""The bundled lenses: small files, documented, valid, and ready to use."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import Options, Rings, SpectralImage, library, load_lens, simulate
from lensfield.engine.inspection.checks import check_lens
from lensfield.engine.inspection.curves import relative_illumination
from lensfield.engine.library import PRESCRIPTIONS, bundled_names, described_lenses, find_bundled, prescription_of
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.axial_image import eye_response_at
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.rays import HalfPupil, trace_pupil
from lensfield.engine.rays.rings import turned
from lensfield.engine.rays.transmission import coating_transmittance
from varied_lenses import VARIED, varied_lens

NM = np.linspace(420, 680, 14)
SPOT = HalfPupil(17, 25)
UNDATED = {"edmund-54852": "single", "helios-44-2-58mm": "single", "laikin-telecentric-102mm": "multi"}


@pytest.fixture(scope="module", params=VARIED)
def lens(request):
    """Lenses of the library, each loaded once for all tests."""
    return varied_lens(request.param)


def test_the_library_is_small():
    sizes = [path.stat().st_size for path in PRESCRIPTIONS.iterdir()]
    assert max(sizes) <= 8e3 and np.mean(sizes) <= 4e3


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", bundled_names())
def test_each_is_documented(name):
    prescription = prescription_of(name)
    assert prescription.name == name and set(VARIED) <= set(bundled_names())
    assert prescription.maker and min(map(len, (prescription.title, prescription.story, prescription.source))) > 10
    assert prescription.focal_length_mm and prescription.sensor_mm and prescription.character


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", bundled_names())
def test_each_has_the_coating_of_its_time_and_a_plausible_loss(name):
    """At each surface against air: 4 to 11 % of bare glass, about 1 % of a single coating, less of a multi-coating."""
    lens, eye = prescription_of(name), eye_response_at(NM)
    assert lens.coating == UNDATED.get(name) or lens.coating == ("none" if lens.year < 1940 else "single"
                                                                 if lens.year < 1970 else "multi")
    assert ("coatings", "estimated") in lens.provenance
    through = coating_transmittance(system_of(lens), NM) / system_of(lens).mirror_reflectance
    share = np.average(through, weights=eye)**(1 / len(lens.coatings_in_air))
    least, most = {"none": (0.89, 0.96), "single": (0.985, 0.998), "multi": (0.99, 0.9995)}[lens.coating]
    assert least < share < most


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", bundled_names())
def test_a_description_agrees_with_the_complete_file(name):
    lens, description = prescription_of(name), described_lenses()[name]
    assert description._asdict() == {field: getattr(lens, field) for field in description._fields}


def test_lists_and_searches_read_no_surfaces(monkeypatch):
    """With 500 lenses, these would take seconds."""
    monkeypatch.setattr(library, "read_lensfield", lambda path: pytest.fail(f"{path} is read"))
    described_lenses.cache_clear()
    assert "kodak-petzval-100mm" in find_bundled(["swirl", "1950"])


def test_they_are_searched_by_their_descriptions():
    assert {"angenieux-50mm", "cooke-triplet-50mm", "tessar-50mm"} <= set(find_bundled(["50mm"]))
    assert set(find_bundled(["NIKON", "28"])) >= {"nikkor-28mm"}
    assert "kodak-petzval-100mm" in find_bundled(["swirl"]) and "nikkor-28mm" not in find_bundled(["swirl"])
    assert find_bundled(["swirl", "no such word"]) == {} and len(find_bundled([])) == len(bundled_names())


def test_each_encloses_its_light_and_has_no_errors(lens):
    assert lens.enclosed_energy.min() >= 0.995
    assert lens.mirror_symmetric
    assert [str(finding) for finding in check_lens(lens) if finding.severity == "error"] == []


def test_each_covers_its_sensor_except_for_the_outermost_corners(lens):
    x_mm, y_mm = np.meshgrid(*((np.arange(400) + 0.5) / 400 * side / 2 for side in lens.sensor_mm))
    last_mm = lens.at_wavelength(550).real_height_mm[-1]
    assert np.mean(np.hypot(x_mm, y_mm) <= last_mm) > 0.97


def test_each_makes_a_picture(lens):
    radiance = SpectralImage(np.ones((2, 60, 80)), [450, 620], pitch_um=lens.sensor_mm[0] * 1e3 / 80)
    irradiance = simulate(radiance, lens, Options(accuracy=0.03)).cube
    assert np.all(np.isfinite(irradiance)) and np.all(irradiance[:, 15:45, 20:60] > 0)
    blue = lens.at_wavelength(450)
    expected = np.pi / (4 * lens.f_number_effective**2) * blue.transmittance * blue.point_flux[0]
    assert irradiance[0, 30, 40] == pytest.approx(expected, rel=0.03)


def test_the_fisheye_is_close_to_the_papers_second_lens():
    """f = 25.25 mm, f/4, 140 degrees, -56.6 % (section 4 of the paper)."""
    lens = varied_lens("muller-fisheye-25mm")
    optics = lens.at_wavelength(587.6)
    assert lens.efl_mm == pytest.approx(25.25, abs=0.01)
    assert lens.f_number_effective == pytest.approx(4, rel=0.02)
    assert np.degrees(np.arctan(lens.heights_mm[-1] / lens.efl_mm)) == pytest.approx(70, abs=0.01)
    assert 100 * (optics.real_height_mm[-1] / optics.heights_mm[-1] - 1) == pytest.approx(-56.6, abs=1.5)


def test_the_topogon_darkens_as_published():
    """35 degrees off the axis: M. Rimmer has 34.7 % (Proc. SPIE 655, 1986), R. Kingslake 35.0 % (1965); without the
    light that aberrations move, Rimmer has 36.7 %."""
    lens = load_lens("zeiss-topogon-66mm", quality="preview", wavelengths_nm=[587.6])
    height_mm = lens.efl_mm * np.tan(np.radians(35))
    bundle, pictures = lens.at_wavelength(587.6).relative_illumination, relative_illumination(lens, [587.6])[0]
    assert np.interp(height_mm, lens.heights_mm, pictures) == pytest.approx(0.3485, abs=0.005)
    assert np.interp(height_mm, lens.heights_mm, bundle) == pytest.approx(0.367, abs=0.008)


def test_the_telecentric_lens_meets_its_sensor_at_right_angles():
    system = build_system(prescription_of("laikin-telecentric-102mm"))
    rays = trace_pupil(system, np.linspace(0, system.last_height_mm, 5), [587.6], HalfPupil(1, 1))
    assert np.degrees(np.abs(rays.direction[1])).max() < 0.1


def test_stopping_down_sharpens_and_dims():
    wide = varied_lens("angenieux-50mm")
    closed = load_lens("angenieux-50mm", Rings(f_number=4.0), quality="preview")
    assert wide.efl_mm == pytest.approx(closed.efl_mm, rel=1e-6)
    assert wide.f_number_effective < 1.3 and closed.f_number_effective == pytest.approx(4, rel=0.02)
    assert closed.psf_pitch_um * closed.psf.shape[-1] < 0.7 * wide.psf_pitch_um * wide.psf.shape[-1]


MACROS = {"olympus-macro-90mm": (0.5, 0.40), "minolta-macro-100mm": (1.0, 0.35), "pentax-macro-200mm": (1.0, 0.55)}
"""The production lenses' magnifications, and their closest distances from the film in m, to two decimals."""


def from_the_film_mm(prescription):
    return prescription.object_distance_mm + sum(surface.thickness_mm for surface in prescription.surfaces)


@pytest.mark.parametrize("name", MACROS)
def test_a_macro_lens_focuses_as_close_as_the_production_lens(name):
    closest = turned(prescription_of(name), Rings(1.0)).prescription
    magnification, distance_m = MACROS[name]
    assert -build_system(closest).magnification == pytest.approx(magnification, rel=0.002)
    assert from_the_film_mm(closest) * 1e-3 == pytest.approx(distance_m, abs=0.005)


@pytest.mark.parametrize("name", MACROS)
def test_floating_elements_keep_a_macro_lens_sharp(name):
    """Its spots wide open at its closest focus are small. If the same lens moves as a unit, its corners are more than
    five times as blurred."""
    closest = turned(prescription_of(name), Rings(1.0)).prescription
    far = turned(prescription_of(name), Rings(np.inf)).prescription
    as_a_unit = replace(far, focus="best", object_distance_mm=closest.object_distance_mm)
    spots, of_unit = map(spot_radii_mm, (closest, as_a_unit))
    assert spots.max() < 0.04 and of_unit[-1] > 5 * spots[-1]


def spot_radii_mm(prescription):
    """Root-mean-square radii of spots at the reference wavelength, from the middle to the corner."""
    system = build_system(prescription)
    rays = trace_pupil(system, np.array([0.0, 0.5, 0.7, 1.0]) * 21.6, [prescription.reference_wavelength_nm], SPOT)
    passing = ~rays.lost[0] & np.all(system.limits(rays.square_height_mm2[:, 0]) <= 1, axis=0)
    light = np.where(passing, SPOT.radii[:, None], 0.0)
    x_mm, y_mm = np.where(passing, rays.position_mm[:, 0], 0.0)
    middle_mm = np.average(y_mm, axis=(1, 2), weights=light)[:, None, None]  # mirror images have the opposite x
    return np.sqrt(np.average(x_mm**2 + (y_mm - middle_mm)**2, axis=(1, 2), weights=light))


@pytest.mark.parametrize("name, magnification", [
    ("nikkor-28mm", 1 / 3.9), ("nikkor-50mm-f1.2", 1 / 7.9), ("nikkor-85mm-f1.4", 1 / 7.9),
    ("zeiss-flektogon-20mm", 1 / 5.8), ("zeiss-apo-germinar-375mm", 1.0), ("mamiya-soft-focus-150mm", 0.295)])
def test_a_closest_distance_gives_the_published_magnification(name, magnification):
    """The makers publish both. The file has the distance, and moves the lens as a unit."""
    closest = turned(prescription_of(name), Rings(1.0)).prescription
    assert -build_system(closest).magnification == pytest.approx(magnification, rel=0.025)
