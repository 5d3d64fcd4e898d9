"""Rims fitted to the light of a lens whose rims are known."""

from dataclasses import replace

import numpy as np
import pytest

from flat_pictures import flat_light, mounted, write_flat
from lensfield.engine import LensError
from lensfield.engine.fitting.even_light import EvenField
from lensfield.engine.fitting.fit import RESPONSE_DEG, fit_rims
from lensfield.engine.fitting.flat_fields import read_flat_field
from lensfield.engine.fitting.rims import with_rims
from lensfield.engine.fitting.vignetting import light_of
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.photographs import Vignetting
from refusals import refused
from seed import SEED

ESTIMATED_MM = 14.25
HELIOS = replace(prescription_of("helios-44-2-58mm"), photographs=None, surfaces=tuple(
    surface if surface.stop else replace(surface, semi_aperture_mm=ESTIMATED_MM)
    for surface in prescription_of("helios-44-2-58mm").surfaces))
HEIGHTS_MM = np.linspace(2, 20.5, 12)
RIMS_MM = {2: 13.9, 10: 11.4}
F_NUMBERS = 2.0, 2.8, 4.0, 5.6, 8.0, 11.0
SOURCE, DATE = "a test", "2026-11-29"


@pytest.fixture(scope="module")
def truth():
    """The lens with known rims."""
    fields = [EvenField(HELIOS, focus_mm, np.array([0.0, 10.0, 21.6])) for focus_mm in (np.inf, 526.0)]
    return with_rims(HELIOS, fields, RIMS_MM)


def curves_of(lens, settings, pixel_loss=0.0, noise=0.0, seed=0):
    """Curves of the light of a lens at f-numbers and focus distances."""
    empty = [Vignetting(f_number, focus_mm, HEIGHTS_MM, np.ones(HEIGHTS_MM.size)) for f_number, focus_mm in settings]
    random = np.random.default_rng(seed)
    return [replace(curve, light=light * (1 + noise * random.standard_normal(light.size)))
            for curve, light in zip(empty, light_of(lens, empty, pixel_loss), strict=True)]


def fitted(lens, curves):
    return fit_rims(lens, curves, SOURCE, DATE)


def test_known_rims_return_with_their_uncertainty(truth):
    settings = [(f_number, focus_mm) for f_number in F_NUMBERS for focus_mm in (np.inf, 1500.0)]
    fit = fitted(HELIOS, curves_of(truth, settings, pixel_loss=0.8, noise=0.002, seed=SEED))
    sizes_mm = {rim.surface - 1: rim for rim in fit.rims}
    assert sizes_mm.keys() == RIMS_MM.keys()
    for surface, size_mm in RIMS_MM.items():
        rim = sizes_mm[surface]
        assert abs(rim.semi_aperture_mm - size_mm) < 5 * rim.sigma_mm + 1e-3 and rim.sigma_mm < 0.02 * size_mm
        assert fit.prescription.surfaces[surface].semi_aperture_mm == pytest.approx(rim.semi_aperture_mm, abs=1e-3)
        assert rim.before_mm == HELIOS.surfaces[surface].semi_aperture_mm
    assert abs(fit.pixel_loss - 0.8) < 5 * fit.pixel_sigma + 0.05
    judges = [each for each in fit.comparisons if each.judge]
    assert len(judges) == len(settings) // 3 and fit.judged == max(each.missed[1] for each in judges) < 0.015
    assert max(each.missed[0] for each in judges) > 0.05


def test_rims_that_block_nothing_are_not_fitted(truth):
    """Two rims block light: no third is supported, and no loss of the pixels."""
    fit = fitted(HELIOS, curves_of(truth, [(f_number, np.inf) for f_number in F_NUMBERS]))
    assert {rim.surface - 1 for rim in fit.rims} == RIMS_MM.keys() and fit.pixel_loss < 0.02
    assert {surface: fit.prescription.surfaces[surface].semi_aperture_mm for surface in RIMS_MM} == pytest.approx(
        RIMS_MM, rel=0.005)


def test_only_apertures_change_and_the_file_states_their_origin(truth):
    fit = fitted(HELIOS, curves_of(truth, [(2.0, np.inf), (2.8, np.inf), (8.0, np.inf)]))
    widened = [replace(surface, semi_aperture_mm=before.semi_aperture_mm)
               for surface, before in zip(fit.prescription.surfaces, HELIOS.surfaces, strict=True)]
    assert replace(fit.prescription, surfaces=tuple(widened)) == HELIOS
    assert dict(fit.prescription.provenance)["apertures"] == "fitted to photographs"
    agreement = fit.prescription.photographs
    assert (agreement.source, agreement.date) == (SOURCE, DATE)
    assert agreement.illumination == pytest.approx(fit.judged, abs=5.1e-4)


def test_one_f_stop_gives_one_rim_at_most(truth):
    fit = fitted(HELIOS, curves_of(truth, [(2.0, np.inf), (2.0, 1500.0), (2.0, 900.0), (2.0, 600.0)]))
    assert len(fit.rims) == 1 and not fit.pixel_loss and not any(each.judge for each in fit.comparisons)
    assert fit.lines()[-1].startswith("too few f-stops and distances to leave any out: 0.")


def test_the_fit_as_text(truth):
    settings = [(f_number, np.inf) for f_number in F_NUMBERS]
    lines = fitted(HELIOS, curves_of(truth, settings, pixel_loss=1.0)).lines()
    rims = [line for line in lines if line.startswith(("rear rim, surface 11: 11.", "inner front rim, surface 3: 13."))]
    assert len(rims) == 2 and all(" mm, before 14.25 mm" in line for line in rims)
    share = np.exp(-np.sin(np.radians(RESPONSE_DEG))**2)
    assert any(line.startswith(f"pixels: {share:.2f}") for line in lines)
    assert [line.split()[0] for line in lines if " left out  " in line] == ["f/2.8", "f/8"]
    assert lines[-1].startswith("at f-stops and distances left out of the fit: 0.0")


def test_photographs_of_other_lenses_are_refused(truth):
    curves = curves_of(truth, [(2.0, np.inf), (8.0, np.inf)])
    with refused(LensError, field="f-number", where="helios-44-2-58mm", value="1.4 in the photographs",
                 match="the lens has f/2: give"):
        fitted(HELIOS, [replace(curves[0], f_number=1.4)])
    with refused(LensError, field="light at 20.5 mm, f/2 at infinity", value="0.95",
                 match=r"its surfaces pass 0\.\d\d at most"):
        fitted(HELIOS, [replace(curves[0], light=np.linspace(1, 0.95, HEIGHTS_MM.size)), curves[1]])


def test_flat_fields_give_the_rims_of_the_lens(tmp_path, truth):
    sensor_mm = 36.0, 24.0
    fields = []
    for number, f_number in enumerate((2.0, 2.8, 4.0, 8.0)):
        path = tmp_path / f"{number}.dng"
        write_flat(path, flat_light(truth, f_number, sensor_mm, (0.05, 0.08)), mounted(58.6, f_number),
                   seed=SEED + number)
        fields.append(read_flat_field(path, sensor_mm, HELIOS.focal_length_mm))
    fit = fitted(HELIOS, [field.curve for field in fields])
    sizes_mm = {rim.surface - 1: rim.semi_aperture_mm for rim in fit.rims}
    assert sizes_mm == pytest.approx(RIMS_MM, rel=0.02) and fit.judged < 0.02
