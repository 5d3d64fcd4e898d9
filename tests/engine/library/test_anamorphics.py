"""Anamorphic designs typed from patents: focal lengths, squeeze and focus of both sections."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.system import system_of

pytestmark = pytest.mark.one_blender
FOCAL_LENGTHS_MM = {  # along x and y, by another program's matrices; the first as the patent states them
    "cooke-42mm-2x": (21.47, 42.47), "atlas-42mm-1.5x": (28.13, 41.85), "atlas-42mm-1.5x-2024": (27.74, 41.94),
    "panavision-21mm-1.3x": (15.82, 20.65), "jacobsen-41mm-2x": (20.47, 41.04), "us9063321-129mm-2x": (65.59, 128.65),
    "schneider-61mm-2x": (31.49, 60.56)}
DEPTH_MM = 0.18  # between the sections' paraxial foci: what spherical aberration and indices of three decimals explain
LAST_DIGIT_MM = 2e-3  # of the spaces that vary with focus
PROJECTORS = ("schneider-61mm-2x",)  # their squeeze changes with the distance of the screen


@pytest.fixture(params=FOCAL_LENGTHS_MM)
def design(request):
    return prescription_of(request.param)


def focused(design, position):
    """System of a design at one of its focus positions."""
    surfaces = tuple(replace(surface, gaps_mm=(), thickness_mm=surface.gaps_mm[position]) if surface.gaps_mm
                     else surface for surface in design.surfaces)
    return system_of(replace(design, surfaces=surfaces, focused_at_mm=(),
                             object_distance_mm=design.focused_at_mm[position]))


def test_focal_lengths_are_the_patents(design):
    system = system_of(design)
    assert (system.across.efl_mm, system.efl_mm) == pytest.approx(FOCAL_LENGTHS_MM[design.name], rel=6e-4)


def test_the_width_is_compressed_as_the_name_says(design):
    focal_length, squeeze = design.name.split("-")[1:3]
    assert system_of(design).squeeze == pytest.approx(float(squeeze.removesuffix("x")), rel=0.04)
    assert design.focal_length_mm == pytest.approx(float(focal_length.removesuffix("mm")), abs=0.5)
    assert design.focal_length_mm == pytest.approx(system_of(design).efl_mm, rel=2e-3)


def test_both_sections_are_in_focus_at_every_distance(design):
    systems = [focused(design, position) for position in range(len(design.focused_at_mm))]
    apart_mm = [system.across.image_distance_mm - system.image_distance_mm for system in systems]
    assert abs(apart_mm[0]) < DEPTH_MM
    assert apart_mm == pytest.approx([apart_mm[0]] * len(apart_mm), abs=LAST_DIGIT_MM)


def test_camera_lenses_compress_near_and_far_faces_alike(design):
    """As US 3,041,935 and US 2024/0053589 claim."""
    far, *near = (focused(design, position) for position in range(len(design.focused_at_mm)))
    squeezes = [system.magnification / system.across.magnification / far.squeeze for system in near]
    assert (squeezes == pytest.approx([1.0] * len(near), abs=0.02)) == (design.name not in PROJECTORS)


def test_every_surface_passes_the_full_aperture_on_the_axis(design):
    system = system_of(design)
    heights_mm = np.maximum(np.abs(system.marginal_heights_mm), np.abs(system.across.marginal_heights_mm))
    assert np.min(system.semi_apertures_mm / heights_mm) > 0.88  # the Speed Panchro in its own file, too
