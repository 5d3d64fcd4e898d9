"""Checks of lens data from any source, for valid but suspicious values.

`RadialLens` itself refuses invalid values. Each check here is a small generator of findings. The bounds are set so that
accurate tables of real lenses, from a 6 mm video lens to a fisheye of 70 degrees, pass without false findings.
"""

from collections.abc import Iterator

import numpy as np

from ..field.radial.distortion import (
    DISTORTION_TOLERANCE,
    ILLUMINATION_TOLERANCE,
    ORDERS,
    FieldGeometry,
    fit_polynomial,
)
from ..lens.radial_lens import RadialLens
from ..runtime.errors import LensError
from .finding import SEVERITIES, LensFinding, graded, greatest, place
from .psf_checks import LEAST_NM, PSF_CHECKS

GREATEST_NM = 2500  # beyond it glass absorbs and silicon is blind
VISIBLE_NM = (405, 695)  # 400 to 700, with some slack for tables on other grids
WIDEST_GAP_NM = 60
UNEVEN_GAP = 1.5
F_NUMBERS = (0.5, 64)  # the limit of sin(u) = 1 in air, and above the smallest stop of any photographic lens
FIELD_ANGLES_DEG = (0.1, 88)  # less than a telescope's field; f tan(88 degrees) is 29 focal lengths
AXIS_TOLERANCE = 1e-4  # of the last height, also for the fits: a tenth of a pixel, with 1000 from axis to corner
AXIS_SCALE_TOLERANCE = 0.05  # the image scale of real lenses varies by less than 2 % with colour; wrong units by more
UNIT_FACTOR = 5  # below the smallest mistake in units, a factor of 10
FEWEST_HEIGHTS = ORDERS[0] + 2  # with fewer, the engine's polynomials interpolate every height without smoothing


def check_lens(lens: RadialLens) -> list[LensFinding]:
    """Find suspicious or harmful values in valid lens data.

    Parameters
    ----------
    lens : RadialLens

    Returns
    -------
    list of LensFinding, errors first
    """
    findings = [finding for check in CHECKS for finding in check(lens)]
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


def _field_angle(lens):
    image_distance_mm = lens.efl_mm * (1 + abs(lens.magnification))
    angle, real = np.degrees(np.arctan(np.array([lens.heights_mm[-1], np.abs(lens.real_height_mm[:, -1]).max()])
                                       / image_distance_mm))
    if not FIELD_ANGLES_DEG[0] <= angle <= FIELD_ANGLES_DEG[1]:
        yield LensFinding("error", "heights_mm", f"{lens.heights_mm[-1]:g} mm at the last",
                          f"out of proportion to a focal length of {lens.efl_mm:g} mm, check the units: they give a "
                          f"half field of {angle:.4g} degrees ({real:.4g} from the real height)")


def _sensor(lens):
    yield from beyond_the_field(lens.sensor_mm, np.abs(lens.real_height_mm[:, -1]).min())


def beyond_the_field(sensor_mm: tuple[float, float], covered_mm: float) -> Iterator[LensFinding]:
    """A finding if too much of a sensor is beyond the real height of a field's end."""
    x_mm, y_mm = (side / 2 * (np.arange(400) + 0.5) / 400 for side in sensor_mm)
    beyond = float(np.mean(np.hypot(x_mm, y_mm[:, None]) > covered_mm))
    width, height = sensor_mm
    yield from graded(beyond, 1e-3, 0.1, "sensor_mm", f"{beyond:.1%} of {width:g} x {height:g} mm is beyond the last "
                      f"real height, {covered_mm:.4g} mm", "these pixels use the last PSF or stay black: give heights "
                      f"up to a real height of {np.hypot(width, height) / 2:.4g} mm, or check the units")


def _axis_height(lens):
    offset_mm = np.abs(lens.real_height_mm[:, 0])
    wave = offset_mm.argmax()
    if offset_mm[wave] > AXIS_TOLERANCE * lens.heights_mm[-1]:
        yield LensFinding("warning", "real_height_mm", f"{lens.real_height_mm[wave, 0]:g} mm {place(lens, wave, 0)}",
                          "expected 0: a centred lens images the axis on the axis, and the fit goes through 0")


def _axis_scale(lens):
    """Ratio of real to paraxial height on the axis at each wavelength, from a cubic through the first two heights."""
    ratio, height = lens.real_height_mm[:, 1:3] / lens.heights_mm[1:3], lens.heights_mm[1:3]
    if height.size == 1:
        return ratio[:, 0]
    return (ratio[:, 0] * height[1]**2 - ratio[:, 1] * height[0]**2) / (height[1]**2 - height[0]**2)


def _height_units(lens):
    scale = _axis_scale(lens)
    wave = np.abs(scale - 1).argmax()
    value = f"{scale[wave]:.4g} times the paraxial height near the axis, {place(lens, wave, 1)}"
    if scale[wave] < 0:
        yield LensFinding("error", "real_height_mm", value, "wrong sign: both heights are measured away from the axis")
    elif not 1 / UNIT_FACTOR < scale[wave] < UNIT_FACTOR:
        yield LensFinding("error", "real_height_mm", value, "expected about 1: check that both heights are in mm")
    elif abs(scale[wave] - 1) > AXIS_SCALE_TOLERANCE and lens.heights_mm.size > 2:
        yield LensFinding("warning", "real_height_mm", value, "expected about 1: check that both are for the same "
                          "focal length and object distance, or give more heights near the axis")


def _folding(lens):
    if np.any(_axis_scale(lens) < 0):
        return  # reported as a wrong sign
    for wave, (nm, real_mm) in enumerate(zip(lens.wavelengths_nm, lens.real_height_mm, strict=True)):
        falling = np.flatnonzero(np.diff(real_mm) <= 0)
        if falling.size:
            height = falling[0]
            yield LensFinding("error", "real_height_mm", f"{real_mm[height]:.4g} mm {place(lens, wave, height)}, and "
                              f"{real_mm[height + 1]:.4g} mm at the next",
                              "distortion must not fold the field back: end the table before that height")
            return
        try:
            FieldGeometry(lens.at_wavelength(nm), lens.name)
        except LensError as error:
            yield LensFinding("error", error.field, f"{error.value} in the polynomial fitted at {nm:g} nm",
                              "the table rises, but its fitted polynomial folds back: give more heights, or end the "
                              "table before that height")
            return


def _fit_residuals(lens):
    """Errors of the engine's polynomials: more than a tenth of a pixel or a pixel, 1 % or 5 % of the light."""
    last_mm = lens.heights_mm[-1]
    for field, power, tolerance, note_above, warning_above in (
            ("real_height_mm", 1, DISTORTION_TOLERANCE * last_mm, AXIS_TOLERANCE * last_mm, 1e-3 * last_mm),
            ("relative_illumination", 0, ILLUMINATION_TOLERANCE, 1e-2, 5e-2)):
        table = getattr(lens, field)
        fitted = np.array([fit_polynomial(lens.heights_mm, row, power, tolerance)(lens.heights_mm) for row in table])
        off = np.abs(fitted - table)
        worst = greatest(off)
        shown = f"{1e3 * off[worst]:.3g} um" if field == "real_height_mm" else f"{off[worst]:.3g}"
        yield from graded(off[worst], note_above, warning_above, field,
                          f"{shown} off the fitted polynomial, {place(lens, *worst)}",
                          f"no order up to {ORDERS[-1]} fits the table: look for an outlier, or give more heights")


def _illumination(lens):
    table, field = lens.relative_illumination, "relative_illumination"
    wave = np.abs(table[:, 0] - 1).argmax()
    axis = table[wave, 0]
    if abs(axis - 1) > 0.01:
        yield LensFinding("warning" if 0.5 < axis < 2 else "error", field, f"{axis:.4g} {place(lens, wave, 0)}",
                          "expected 1 on the axis: a fraction of the irradiance there, not percent")
        return
    worst = greatest(table)
    if table[worst] > 1.5:  # pupil aberrations brighten real corners by about 10 %
        yield LensFinding("warning", field, f"{table[worst]:.4g} {place(lens, *worst)}",
                          "more than 1.5 times as bright as the axis: check that it is irradiance at the image")
    dark = np.argwhere(table == 0)
    if dark.size:
        wave, height = min(dark, key=lambda at: at[1])
        yield LensFinding("note", field, f"0 {place(lens, wave, height)}", "this part of the picture stays black")


def _few_heights(lens):
    if lens.heights_mm.size < FEWEST_HEIGHTS:
        yield LensFinding("warning", "heights_mm", f"{lens.heights_mm.size} heights",
                          f"PSFs, distortion and relative illumination need at least {FEWEST_HEIGHTS}, preferably 20")


def _transmittance(lens):
    if np.all(lens.transmittance == 1):
        yield LensFinding("note", "transmittance", "1 at all wavelengths",
                          "losses in glass and at coatings are not included")


CHECKS = (_wavelength_units, _wavelength_range, _wavelength_gaps, _f_number, _magnification_sign, _conjugates,
          _field_angle, _sensor, _axis_height, _height_units, _folding, _fit_residuals, _illumination, _few_heights,
          _transmittance, *PSF_CHECKS)
