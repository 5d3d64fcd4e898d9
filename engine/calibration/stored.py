"""Calibrations as values for JSON, and back."""

from dataclasses import fields
from math import inf
from typing import Any

from ..image.pixel_grid import PixelGrid
from ..runtime.values import json_value
from .fit import Calibration
from .models import MODELS

OF_FRAME = "shape_px", "pitch_um", "centre_px"


def calibration_values(calibration: Calibration) -> dict[str, Any]:
    """A Calibration as JSON: its fields, with the name of the model, {name: coefficient}, and null for infinity.

    `calibration_from` reads them.
    """
    values = {field.name: getattr(calibration, field.name) for field in fields(calibration)}
    frame = {name: getattr(calibration.frame, name) for name in OF_FRAME}
    return json_value(values | {"model": calibration.model.name, "coefficients": calibration.by_name, "frame": frame})


def calibration_from(values: dict[str, Any]) -> Calibration:
    """The Calibration of `calibration_values`."""
    model, frame = MODELS[values["model"]], PixelGrid(**values["frame"])
    lists = {name: tuple(value) for name, value in values.items() if isinstance(value, list)}
    focus_mm = inf if values["focus_mm"] is None else values["focus_mm"]
    coefficients = tuple(values["coefficients"][name] for name in model.coefficients)
    return Calibration(**values | lists | {"model": model, "frame": frame, "coefficients": coefficients,
                                           "focus_mm": focus_mm})
