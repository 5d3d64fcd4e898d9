"""Blur planes by a spreader, as a channel does."""

import numpy as np

from lensfield.engine.blur.overlap_add import overlap_add
from lensfield.engine.blur.section_needs import section_needs
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.image.pixel_grid import PixelGrid


def needs_of(plane, section_size, reach_px, single_range=0.0, flat_slope=0.0, folded=False):
    """Needs of the sections of a plane (row, column), or of its quadrants."""
    planes = Planes(PixelGrid(np.shape(plane), 1.0), folded)
    return section_needs(planes.split(np.asarray(plane)), planes, section_size, reach_px, single_range, flat_slope)


def blurred(plane, spreader, single_range=0.0):
    """Blur a plane section by section, in double precision unless a `single_range` is given."""
    needs = needs_of(plane, spreader.section_size, spreader.radius_px, single_range)
    return overlap_add(plane[None], spreader, needs)[0]
