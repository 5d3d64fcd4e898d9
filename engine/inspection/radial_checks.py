"""Checks of tables over field heights: their end, distortion, and the fitted polynomials."""

from collections.abc import Iterator

import numpy as np

from ..field.radial.distortion import ORDERS, FieldGeometry, fit_distortion, fit_illumination, lit_heights
from ..runtime.errors import LensError
from .finding import AXIS_SCALE_TOLERANCE, FIELD_ANGLES_DEG, UNIT_FACTOR, LensFinding, graded, greatest, place

AXIS_TOLERANCE = 1e-4  # of the last height, also for the fits: a tenth of a pixel, with 1000 from axis to corner
FEWEST_HEIGHTS = ORDERS[0] + 2  # with fewer, the engine's polynomials interpolate every height without smoothing


def _field_angle(lens):
    image_distance_mm = lens.efl_mm * (1 + abs(lens.magnification))
    angle, real = np.degrees(np.arctan(np.array([lens.heights_mm[-1], np.abs(lens.real_height_mm[:, -1]).max()])
                                       / image_distance_mm))
    if angle < FIELD_ANGLES_DEG[0] or min(angle, real) > FIELD_ANGLES_DEG[1]:  # paraxially infinite at 90 degrees
        yield LensFinding("error", "heights_mm", f"{lens.heights_mm[-1]:g} mm at the last",
                          f"out of proportion to a focal length of {lens.efl_mm:g} mm, check the units: they give a "
                          f"half field of {angle:.4g} degrees ({real:.4g} from the real height)")


def _sensor(lens):
    if not lens.dark_beyond:
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
    last_mm, optics = lens.heights_mm[-1], [lens.at_wavelength(nm) for nm in lens.wavelengths_nm]
    for field, fit, note_above, warning_above in (
            ("real_height_mm", fit_distortion, AXIS_TOLERANCE * last_mm, 1e-3 * last_mm),
            ("relative_illumination", fit_illumination, 1e-2, 5e-2)):
        lit = max(lit_heights(each.relative_illumination) for each in optics)
        fitted = np.array([fit(each)(lens.heights_mm[:lit]) for each in optics])
        off = np.abs(fitted - getattr(lens, field)[:, :lit])
        worst = greatest(off)
        shown = f"{1e3 * off[worst]:.3g} um" if field == "real_height_mm" else f"{off[worst]:.3g}"
        yield from graded(off[worst], note_above, warning_above, field,
                          f"{shown} off the fitted polynomial, {place(lens, *worst)}",
                          f"no order up to {ORDERS[-1]} fits the table: look for an outlier, or give more heights")


def _few_heights(lens):
    if lens.heights_mm.size < FEWEST_HEIGHTS:
        yield LensFinding("warning", "heights_mm", f"{lens.heights_mm.size} heights",
                          f"PSFs, distortion and relative illumination need at least {FEWEST_HEIGHTS}, preferably 20")


RADIAL_CHECKS = (_field_angle, _sensor, _axis_height, _height_units, _folding, _fit_residuals, _few_heights)
