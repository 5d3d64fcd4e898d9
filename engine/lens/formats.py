"""Sensor formats: the sizes of sensors and film that cameras have."""

from collections.abc import Sequence
from math import hypot, inf

from ..runtime.errors import InputError

FORMATS = {
    "phone": ("Phone 1/1.3\"", (9.8, 7.35)),
    "super16": ("Super 16", (12.52, 7.41)),
    "1inch": ("1 Inch", (13.2, 8.8)),
    "mft": ("Micro Four Thirds", (17.3, 13.0)),
    "apsc": ("APS-C", (23.6, 15.6)),
    "super35": ("Super 35", (24.89, 18.66)),
    "fullframe": ("Full Frame", (36.0, 24.0)),
    "mediumformat": ("Medium Format", (43.8, 32.9)),
    "65mm": ("65 mm Film", (52.48, 23.01)),
    "imax": ("IMAX 70 mm Film", (70.41, 52.63)),
    "film645": ("Film 6 \u00d7 4.5", (56.0, 41.5)),
    "film66": ("Film 6 \u00d7 6", (56.0, 56.0)),
    "film67": ("Film 6 \u00d7 7", (69.5, 56.0)),
    "film4x5": ("Film 4 \u00d7 5 Inch", (120.0, 95.0))}
"""Name in panels of each format, and width and height of its picture in mm."""


def format_mm(text: str, option: str = "--sensor", others: Sequence[str] = ()) -> tuple[float, float]:
    """Width and height in mm of a sensor: of a format by name, or as WIDTHxHEIGHT.

    Parameters
    ----------
    text : str
    option : str
        Where the user entered it, for errors.
    others : sequence of str
        Other words that are valid there, for errors.

    Raises
    ------
    InputError
        Neither a format nor a size.
    """
    if text in FORMATS:
        return FORMATS[text][1]
    try:
        width_mm, height_mm = (float(side) for side in text.lower().split("x"))
        if not (0 < width_mm < inf and 0 < height_mm < inf):
            raise ValueError
    except ValueError:
        raise InputError("options", option, text, "expected WIDTHxHEIGHT in mm, such as 36x24, or one of "
                                                  f"{', '.join([*others, *FORMATS])}") from None
    return width_mm, height_mm


def crop_factor(sensor_mm: tuple[float, float]) -> float:
    """Diagonal of full frame divided by the diagonal of a sensor."""
    return hypot(*FORMATS["fullframe"][1]) / hypot(*sensor_mm)
