"""Anamorphic designs typed from patents: focal lengths, squeeze and focus of the two sections, by hand."""

import tomllib

import numpy as np
import pytest

from lensfield.engine.prescription.glasses import find_glass
from places import DATA

pytestmark = pytest.mark.one_blender
ANAMORPHICS = {path.stem: path for path in (DATA / "anamorphics").glob("*.toml")}
D_LINE_NM = 587.5618
FOCAL_LENGTHS_MM = {  # along x and y
    "cooke-42mm-2x": (21.47, 42.47),  # as the patent states
    "atlas-42mm-1.5x": (28.13, 41.85), "atlas-42mm-1.5x-2024": (27.74, 41.94), "panavision-21mm-1.3x": (15.82, 20.65),
    "jacobsen-41mm-2x": (20.47, 41.04), "us9063321-129mm-2x": (65.59, 128.65), "schneider-61mm-2x": (31.49, 60.56)}
DEPTH_MM = 0.18  # between the sections' paraxial foci: what spherical aberration and indices of three decimals explain
KEPT_MM = 2e-3  # of that distance at other focus positions: the figures' last digit


@pytest.fixture(params=sorted(ANAMORPHICS))
def design(request):
    """A design as its file has it."""
    with ANAMORPHICS[request.param].open("rb") as file:
        return tomllib.load(file)


def section(design, axis, position=0):
    """Matrix of heights and reduced angles through a section of a lens, at one of its focus positions."""
    total, before = np.eye(2), 1.0
    for number, surface in enumerate(design["surfaces"]):
        radius_mm = surface.get("radius_mm", np.inf)
        radius_mm = surface.get("radius_x_mm", radius_mm) if axis == "x" else radius_mm
        behind = find_glass(surface.get("glass", ""), design["name"], "glass").index_at([D_LINE_NM])[0]
        thickness_mm = np.atleast_1d(surface["thickness_mm"])
        thickness_mm = thickness_mm[position if len(thickness_mm) > 1 else 0]
        total = np.array([[1, 0], [(before - behind) / radius_mm, 1]]) @ total
        if number < len(design["surfaces"]) - 1:
            total = np.array([[1, thickness_mm / behind], [0, 1]]) @ total
        before = behind
    return total


def focus_mm(design, axis, position=0):
    """From the last surface to the image of an object on the axis."""
    distance_mm = design["focused_at_mm"][position]
    height, angle = section(design, axis, position) @ ((1, 0) if np.isinf(distance_mm) else (distance_mm, 1))
    return -height / angle


def test_focal_lengths_are_the_patents(design):
    for axis, expected_mm in zip("xy", FOCAL_LENGTHS_MM[design["name"]], strict=True):
        assert -1 / section(design, axis)[1, 0] == pytest.approx(expected_mm, rel=6e-4)


def test_the_width_is_compressed_as_the_name_says(design):
    along_x, along_y = (-1 / section(design, axis)[1, 0] for axis in "xy")
    assert along_y / along_x == pytest.approx(float(design["name"].split("mm-")[1].split("x")[0]), rel=0.04)
    assert design["focal_length_mm"] == pytest.approx(along_y, rel=2e-3)


def test_both_sections_are_in_focus_at_every_distance(design):
    apart_mm = [focus_mm(design, "x", position) - focus_mm(design, "y", position)
                for position in range(len(design["focused_at_mm"]))]
    assert abs(apart_mm[0]) < DEPTH_MM
    assert apart_mm == pytest.approx([apart_mm[0]] * len(apart_mm), abs=KEPT_MM)
