"""Checks of lens data from any source, for valid but suspicious values.

Lenses themselves refuse invalid values. Each check here is a small generator of findings. The bounds are set so that
accurate tables of real lenses, from a 6 mm video lens to a fisheye of 70 degrees, pass without false findings.
"""

import numpy as np

from ..lens import GridLens, Lens
from .finding import SEVERITIES, UNIT_FACTOR, LensFinding, greatest, place
from .grid_checks import GRID_CHECKS
from .psf_checks import LEAST_NM, PSF_CHECKS
from .radial_checks import RADIAL_CHECKS

GREATEST_NM = 2500  # beyond it glass absorbs and silicon is blind
VISIBLE_NM = (405, 695)  # 400 to 700, with some slack for tables on other grids
WIDEST_GAP_NM = 60
UNEVEN_GAP = 1.5
F_NUMBERS = (0.5, 64)  # the limit of sin(u) = 1 in air, and above the smallest stop of any photographic lens


def check_lens(lens: Lens) -> list[LensFinding]:
    """Find suspicious or harmful values in valid lens data.

    Parameters
    ----------
    lens : Lens

    Returns
    -------
    list of LensFinding, errors first
    """
    of_field = GRID_CHECKS if isinstance(lens, GridLens) else RADIAL_CHECKS
    findings = [finding for check in (*FIRST_ORDER_CHECKS, *of_field, *LIGHT_CHECKS, *PSF_CHECKS)
                for finding in check(lens)]
    return sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))


def _wavelength_units(lens):
    for field, values in (("wavelengths_nm", lens.wavelengths_nm[[0, -1]]),
                          ("reference_wavelength_nm", np.array([lens.reference_wavelength_nm] * 2))):
        shown = " to ".join(f"{nm:g}" for nm in np.unique(values)) + " nm"
        if values[0] < LEAST_NM:
            yield LensFinding("error", field, shown, "expected nanometres; this looks like micrometres")
        elif values[1] > GREATEST_NM:
            yield LensFinding("warning", field, shown, f"expected nanometres, up to {GREATEST_NM}: check the unit")


def _wavelength_range(lens):
    low, high = lens.wavelengths_nm[[0, -1]]
    if min(low, lens.reference_wavelength_nm) < LEAST_NM or high > GREATEST_NM:
        return  # reported as a wrong unit
    if low > VISIBLE_NM[0] or high < VISIBLE_NM[1]:
        yield LensFinding("note", "wavelengths_nm", f"{low:g} to {high:g} nm",
                          "scenes can be filtered only at these wavelengths; accurate colours need 400 to 700 nm")
    if not low <= lens.reference_wavelength_nm <= high:
        yield LensFinding("note", "reference_wavelength_nm", f"{lens.reference_wavelength_nm:g} nm",
                          f"outside the lens data, {low:g} to {high:g} nm")


def _wavelength_gaps(lens):
    """A gap much wider than its neighbours on both sides counts as a missing wavelength."""
    gaps = np.diff(lens.wavelengths_nm)
    if gaps.size == 0:
        return
    around = np.pad(gaps, 1)
    limits = np.full(gaps.size, WIDEST_GAP_NM, dtype=float)
    if gaps.size > 1:
        limits = np.minimum(limits, UNEVEN_GAP * np.maximum(around[:-2], around[2:]))
    widest = np.argmax(gaps / limits)
    if gaps[widest] > limits[widest] + 1e-6:
        low, high = lens.wavelengths_nm[[widest, widest + 1]]
        yield LensFinding("note", "wavelengths_nm", f"none between {low:g} and {high:g} nm",
                          f"PSFs are interpolated there; give one at least every {limits[widest]:g} nm")


def _f_number(lens):
    number = lens.f_number_effective
    if number < F_NUMBERS[0]:
        yield LensFinding("error", "f_number_effective", f"{number:g}",
                          "the f-number of a lens in air is at least 0.5: expected 0.5 / NA")
    elif number > F_NUMBERS[1]:
        yield LensFinding("warning", "f_number_effective", f"{number:g}", f"expected {F_NUMBERS[0]} to {F_NUMBERS[1]}")


def _magnification_sign(lens):
    if np.isinf(lens.object_distance_mm):
        if abs(lens.magnification) > 1e-3:
            yield LensFinding("warning", "magnification", f"{lens.magnification:g} with the object at infinity",
                              "expected 0, or the object distance of this magnification")
    elif lens.magnification > 0:
        yield LensFinding("warning", "magnification", f"{lens.magnification:g}",
                          "a real image is inverted: expected a negative number")


def _conjugates(lens):
    """The lens equation, approximately: principal planes are within a few focal lengths of the first surface."""
    if np.isinf(lens.object_distance_mm):
        return
    from_principal_mm = lens.efl_mm * (1 + 1 / abs(lens.magnification))
    reach_mm = max(3 * (lens.efl_mm + abs(lens.entrance_pupil_mm)), 0.1 * from_principal_mm)
    if abs(from_principal_mm - lens.object_distance_mm) > reach_mm:
        in_unit = 1 / UNIT_FACTOR < from_principal_mm / lens.object_distance_mm < UNIT_FACTOR
        yield LensFinding("warning" if in_unit else "error", "object_distance_mm",
                          f"{lens.object_distance_mm:g} mm at a magnification of {lens.magnification:g}",
                          f"a focal length of {lens.efl_mm:g} mm gives that magnification at {from_principal_mm:.4g} "
                          "mm from the front principal plane: check these three and their units")
        return
    # For a thin lens it is efl (1 + |m|); a distant pupil, as in a telecentric lens, makes it large.
    relative = lens.capture_focal_length_mm / (lens.efl_mm * (1 + abs(lens.magnification)))
    if not 1 / UNIT_FACTOR < relative < UNIT_FACTOR:
        yield LensFinding("error" if relative <= 0 else "warning", "entrance_pupil_mm",
                          f"{lens.entrance_pupil_mm:g} mm",
                          f"it gives a capture focal length of {lens.capture_focal_length_mm:.4g} mm: expected the "
                          "pupil's distance behind the first surface, in mm")


def _illumination(lens):
    table, field = lens.relative_illumination, "relative_illumination"
    on_axis = table[:, *lens.middle]
    wave = np.abs(on_axis - 1).argmax()
    axis = on_axis[wave]
    if abs(axis - 1) > 0.01:
        yield LensFinding("warning" if 0.5 < axis < 2 else "error", field,
                          f"{axis:.4g} {place(lens, wave, *lens.middle)}",
                          "expected 1 on the axis: a fraction of the irradiance there, not percent")
        return
    worst = greatest(table)
    if table[worst] > 1.5:  # pupil aberrations brighten real corners by about 10 %
        yield LensFinding("warning", field, f"{table[worst]:.4g} {place(lens, *worst)}",
                          "more than 1.5 times as bright as the axis: check that it is irradiance at the image")
    dark = np.argwhere(table == 0)
    if dark.size:
        nearest = min(dark, key=lambda at: np.abs(at[1:] - lens.middle).sum())
        yield LensFinding("note", field, f"0 {place(lens, *nearest)}", "this part of the picture stays black")


def _transmittance(lens):
    if lens.prescription and "" in lens.prescription.coatings_in_air:
        yield LensFinding("note", "coating", "unknown", "reflections are not counted: choose one (--coating)")
    elif np.all(lens.transmittance == 1):
        yield LensFinding("note", "transmittance", "1 at all wavelengths",
                          "losses in glass and at coatings are not included")


FIRST_ORDER_CHECKS = (_wavelength_units, _wavelength_range, _wavelength_gaps, _f_number, _magnification_sign,
                      _conjugates)
LIGHT_CHECKS = (_illumination, _transmittance)
