"""Checks of tables over x and y: their end, the distortion between nodes, and symmetries."""

import numpy as np

from ..field.field_map import field_map
from ..runtime.errors import LensError
from .finding import AXIS_SCALE_TOLERANCE, FIELD_ANGLES_DEG, UNIT_FACTOR, LensFinding, graded, greatest, place
from .grid_curves import reference_field

SQUEEZES = 1 / 3, 3  # anamorphic lenses squeeze by 1.25 to 2, along the width or, turned, along the height
FEWEST_NODES = 3  # from the axis outwards: splines from edge to edge through fewer are less than cubic
MIRROR_TOLERANCE = 1e-4  # of the last place: a tenth of a pixel, with 1000 from the axis to the edge
SENSOR_SAMPLES = 400  # across and up, for the share of a sensor beyond the field


def _squeeze(lens):
    if not SQUEEZES[0] <= lens.squeeze <= SQUEEZES[1]:
        yield LensFinding("warning", "squeeze", f"{lens.squeeze:g}", f"expected {SQUEEZES[0]:.2g} to {SQUEEZES[1]:g}: "
                          "the focal length of the picture's height over the one of its width")


def _field_angle(lens):
    source_mm = lens.source_mm[:, lens.within <= 1]
    if not source_mm.size:
        yield LensFinding("error", "within", f"{lens.within.min():g} at its minimum", "expected 1 or less in the field")
        return
    farthest_mm = np.hypot(lens.squeeze * source_mm[..., 0], source_mm[..., 1]).max()
    degrees = np.degrees(np.arctan(farthest_mm / lens.capture_focal_length_mm))
    if not FIELD_ANGLES_DEG[0] <= degrees <= FIELD_ANGLES_DEG[1]:
        yield LensFinding("error", "source_mm", f"up to {np.abs(source_mm).max():g} mm", "out of proportion to a "
                          f"capture focal length of {lens.capture_focal_length_mm:g} mm, check the units: they give a "
                          f"half field of {degrees:.4g} degrees")


def _sensor(lens):
    width, height = lens.sensor_mm
    middles = (np.arange(SENSOR_SAMPLES) + 0.5) / SENSOR_SAMPLES - 0.5
    try:
        beyond = 1 - float(np.mean(reference_field(lens).within(width * middles, height * middles[:, None])))
    except LensError:
        return  # `_folding` reports it
    yield from graded(beyond, 1e-3, 0.1, "sensor_mm", f"{beyond:.1%} of {width:g} x {height:g} mm is beyond the end of "
                      "the field", "these pixels use the nearest PSFs or stay black: give nodes up to the sensor's "
                      "corners, or check the units")


def _mirror_lines(lens):
    """Whether light on a line of symmetry comes from this line."""
    for name, mirrored, table in (("y", lens.mirrored[0], lens.source_mm[:, :1, :, 1]),
                                  ("x", lens.mirrored[1], lens.source_mm[:, :, :1, 0])):
        worst = greatest(np.abs(table))
        if mirrored and abs(table[worst]) > MIRROR_TOLERANCE * getattr(lens, f"{name}_mm")[-1]:
            yield LensFinding("warning", "source_mm", f"{name} = {table[worst]:g} mm {place(lens, *worst)}",
                              f"expected 0: the two halves of the field are mirror images about {name} = 0")


def _scale(lens):
    """Rise of `source_mm` with x and with y next to the middle: array (wavelength, 2)."""
    scales = []
    for number, (name, source_mm) in enumerate((("x_mm", lens.source_mm[:, lens.middle[0], :, 0]),
                                                ("y_mm", lens.source_mm[:, :, lens.middle[1], 1]))):
        at, middle = getattr(lens, name), lens.middle[1 - number]
        low, high = max(middle - 1, 0), min(middle + 1, at.size - 1)
        scales.append((source_mm[:, high] - source_mm[:, low]) / (at[high] - at[low]))
    return np.stack(scales, axis=1)


def _units(lens):
    scale = _scale(lens)
    wave, number = greatest(np.abs(np.log(scale)))
    value, axis = scale[wave, number], "xy"[number]
    shown = f"rises {value:.4g} times as fast as {axis} next to the middle, {place(lens, wave, *lens.middle)}"
    if not 1 / UNIT_FACTOR < value < UNIT_FACTOR:
        yield LensFinding("error", "source_mm", shown, "expected about 1: check that both are in mm")
    elif abs(value - 1) > AXIS_SCALE_TOLERANCE:
        yield LensFinding("warning", "source_mm", shown, "expected about 1: check the squeeze, the focal length and "
                          "the object distance, or give more nodes near the axis")


def _folding(lens):
    for nm in lens.wavelengths_nm:
        try:
            field_map(lens).at_wavelength(nm)
        except LensError as error:
            yield LensFinding("error", error.field, f"{error.value} at {nm:g} nm", error.remedy)
            return


def _few_nodes(lens):
    for name, mirrored in zip(lens.AXES, lens.mirrored, strict=True):
        count, fewest = getattr(lens, name).size, FEWEST_NODES if mirrored else 2 * FEWEST_NODES - 1
        if count < fewest:
            yield LensFinding("warning", name, f"{count} nodes", "PSFs, distortion and relative illumination need at "
                              f"least {fewest}, preferably {2 * fewest}")


GRID_CHECKS = (_squeeze, _field_angle, _sensor, _mirror_lines, _units, _folding, _few_nodes)
