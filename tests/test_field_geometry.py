"""Only the field map uses the geometry of a lens's field, checked in the source code."""

import ast
import re

import pytest

from test_architecture import MODULES, imports

GEOMETRY = re.compile("height_mm|heights_mm|azimuth|hypot", re.IGNORECASE)
BEHIND_THE_FIELD_MAP = "engine.field.radial", "engine.field.grid"
TABLES_OVER_HEIGHTS = ("engine.prescription", "engine.lens", "engine.lens_files", "engine.rays", "engine.bake",
                       "engine.inspection", "engine.fitting", "engine.measured")
"""Modules that make, read, check or fit the data of rotationally symmetric lenses, which are tables over heights."""
COMPILED = "engine.kernels"
"""The loops, which the radial field calls."""
OTHER_GEOMETRY = {
    "engine.image.pixel_grid": "the corner of a grid",
    "engine.image.directions": "the projection of a panoramic capture",
    "engine.field.lens_correction": "the farthest pixel, the unit of radii in raw files",
    "engine.field.psf_samples": "circles around the chief ray",
    "engine.field.in_capture": "the projection of a panoramic capture",
    "engine.depth.depth_range": "the projection of a panoramic capture",
    "engine.depth.parallax": "the distance between two places",
    "engine.depth.slabs": "the projection of a panoramic capture; distances from the frame",
    "engine.lens.iris": "blades around the stop",
    "engine.field.ray_blur": "the radius of places in the stop",
    "engine.stray.ghost_beams": "the plane of a source and the axis of a rotationally symmetric lens",
    "engine.stray.ghost_nodes": "the plane of a source and the axis of a rotationally symmetric lens",
    "engine.stray.ghost_survey": "that plane, and the slope of the light's edge",
    "engine.stray.ghost_table": "the field of the point whose ghosts are listed",
    "engine.stray.ghosts": "the plane of a source and the axis of a rotationally symmetric lens",
    "engine.stray.arrivals": "the distance of sources beyond the field",
    "engine.stray.star": "the edges of the stop, and distances from a lamp",
    "engine.stray.cells": "the transform of a disc",
    "engine.stray.veil": "the marginal ray at surfaces, and distances from scattered light",
    "engine.calibration.fit": "distances between pixels, and the largest angle from the axis",
    "engine.calibration.models": "the radius in other programs' models",
    "engine.calibration.rays": "the farthest pixel from the axis, and its distortion",
    "engine.spectral.colour_difference": "chroma",
    "addon.scene.camera": "the projection of a panoramic capture",
    "addon.scene.clicked_focus": "the angles of a field from the axis to its end",
    "addon.scene.depth": "the projection of a panoramic capture",
    "addon.scene.lens_facts": "the angles of a field from the axis to its end",
    "addon.ui.open_lens": "the end of a prescription's field",
}
KNOB = re.compile("azimuths", re.IGNORECASE)
KNOB_ROOMS = "engine.blur", "engine.plan", "engine.simulation", "addon.ui"
"""Rooms that name the option `azimuths`: the steps of the table of PSFs."""


def identifiers(tree):
    """Every name that a module defines, uses or imports."""
    for node in ast.walk(tree):
        for part in ("id", "attr", "arg", "name", "asname"):
            if isinstance(name := getattr(node, part, None), str):
                yield name


def within(module, rooms):
    return any(module == room or module.startswith(f"{room}.") for room in rooms)


def may_name(module, identifier):
    return (within(module, (*BEHIND_THE_FIELD_MAP, *TABLES_OVER_HEIGHTS, COMPILED)) or module in OTHER_GEOMETRY
            or bool(KNOB.fullmatch(identifier) and within(module, KNOB_ROOMS)))


def named_geometry(module):
    tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
    return {name for name in identifiers(tree) if GEOMETRY.search(name)}


def test_only_modules_behind_the_field_map_name_heights_and_azimuths():
    outside = [f"{module} names {name}" for module in MODULES for name in sorted(named_geometry(module))
               if not may_name(module, name)]
    assert not outside


def test_only_the_field_map_and_lens_data_checks_import_its_implementations():
    outside = [f"{module} imports {other}" for module in MODULES for other, relative in imports(module)
               if relative and within(other, BEHIND_THE_FIELD_MAP)
               and not within(module, ("engine.field", "engine.inspection"))]
    assert not outside


@pytest.mark.parametrize("module", OTHER_GEOMETRY)
def test_every_exception_is_needed(module):
    assert named_geometry(module)
