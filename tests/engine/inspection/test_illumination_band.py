"""Limits of the light of lenses whose rims are not known, on the sheet and in figures."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import Rings, load_lens
from lensfield.engine.inspection.axes import Panel
from lensfield.engine.inspection.illumination_band import ERRORS, SHARES, illumination_band, relative_error
from lensfield.engine.inspection.info import lens_info, lens_text
from lensfield.engine.inspection.sheet import write_lens_plot
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.photographs import Agreement
from lensfield.engine.rays.rings import turned

NAME = "kodak-ektar-52mm"  # f/1.5
LIGHT = np.array([1.0, 0.8, 0.6, 0.4, 0.35])


def set_to(f_number, origin="estimated"):
    lens = turned(prescription_of(NAME), Rings(f_number=f_number)).prescription
    return replace(lens, provenance=(("figures", "patent"), ("apertures", origin)))


@pytest.mark.parametrize("origin", ERRORS)
@pytest.mark.parametrize("stop", [0, 1, 3])
def test_the_error_is_the_measured_one_at_whole_f_stops(origin, stop):
    assert relative_error(set_to(1.5 * 2**(stop / 2), origin), SHARES) == pytest.approx(ERRORS[origin][stop], abs=1e-6)


def test_the_error_falls_between_f_stops_and_is_constant_beyond():
    between = relative_error(set_to(1.5 * 2**0.25), SHARES)
    assert between == pytest.approx(np.mean(ERRORS["estimated"][:2], axis=0), abs=1e-6)
    assert relative_error(set_to(22), SHARES) == pytest.approx(ERRORS["estimated"][-1])
    assert relative_error(set_to(1.5), [0.25, 1.0]) == pytest.approx([0.1, 0.37])


def test_limits_are_as_far_below_as_above_and_end_at_the_light_of_the_middle():
    least, most = illumination_band(set_to(1.5, "typical of photographed lenses"), SHARES, LIGHT)
    assert least * most == pytest.approx(LIGHT**2) and most[3] / LIGHT[3] == pytest.approx(np.exp(0.19))
    assert illumination_band(set_to(1.5), [0.5], np.array([0.95]))[1] == 1.0
    assert illumination_band(set_to(1.5), [0.5], np.array([1.1]))[1] == 1.1, "light above 1 is real for some lenses"


def test_fitted_rims_have_the_difference_from_photographs():
    lens = replace(set_to(4, "fitted to photographs"), photographs=Agreement("a source", "2026-11-29", 0.03))
    least, most = illumination_band(lens, SHARES, LIGHT)
    for off in (most - LIGHT, LIGHT - least):
        assert off == pytest.approx([0, 0.03, 0.03, 0.03, 0.03])


@pytest.mark.parametrize("provenance", [(), (("figures", "patent"),),
                                        (("figures", "estimated"), ("apertures", "patent"))])
def test_rims_of_the_patent_or_of_unknown_origin_have_no_limits(provenance):
    assert illumination_band(replace(set_to(1.5), provenance=provenance), SHARES, LIGHT) is None
    assert illumination_band(None, SHARES, LIGHT) is None


def test_figures_state_the_light_near_the_corner_and_its_limits():
    lens = load_lens(NAME, quality="preview", wavelengths_nm=[550])
    near = lens_info(lens)["light_near_corner"]
    optics, corner_mm = lens.at_wavelength(550), np.hypot(36, 24) / 2
    about = np.interp(0.9 * corner_mm, optics.real_height_mm, optics.relative_illumination)
    assert near["light"] == pytest.approx(about, abs=0.02)
    assert [near["least"], near["most"]] == pytest.approx([near["light"] * np.exp(-0.19), near["light"] * np.exp(0.19)])
    assert (f"light near the corner    {near['light']:.2f} of the middle's at 0.9 of the way: {near['least']:.2f} to "
            f"{near['most']:.2f} by the uncertainty of the rims\n") in lens_text(lens_info(lens))
    printed = lens_info(replace(lens, prescription=None))
    assert printed["light_near_corner"] == {"share": 0.9, "light": near["light"]}
    assert "uncertainty" not in lens_text(printed)


def test_the_sheet_draws_the_limits(tmp_path, monkeypatch):
    """About the light at the middle one of the wavelengths."""
    lens, filled = load_lens(NAME, quality="preview", wavelengths_nm=[480, 550, 620]), []
    draw = Panel.band
    monkeypatch.setattr(Panel, "band", lambda panel, *drawn: filled.append(drawn) or draw(panel, *drawn))
    write_lens_plot(lens, tmp_path / "sheet.png")
    (along_mm, least, most, _), _ = filled  # and the Airy disk
    shares = along_mm / (np.hypot(36, 24) / 2)
    error = np.interp(shares, SHARES, ERRORS["typical of photographed lenses"][0])
    light = least * np.exp(error)
    assert light[0] == pytest.approx(1) and most == pytest.approx(np.minimum(light * np.exp(error), 1))
    filled.clear()
    write_lens_plot(replace(lens, prescription=None), tmp_path / "other.png")
    assert len(filled) == 1
