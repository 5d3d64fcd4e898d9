"""How far a lens made from a calibration is from it."""

import numpy as np

from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.pinhole import fitting_pitch_um

COLUMNS, ROWS = 29, 23


def frame_of(lens, size_px):
    """The frame of a picture on the lens's sensor."""
    columns, rows = size_px
    return PixelGrid((rows, columns), fitting_pitch_um(lens, (rows, columns)))


def lens_directions(lens, size_px, wavelength_nm=540.0):
    """Pixels of a frame, array (place, 2), where their light comes from, (place, 3), to the right, downwards and
    forwards, and whether the lens data cover them."""
    columns, rows = size_px
    column, row = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.5, columns - 0.5, COLUMNS),
                                                        np.linspace(-0.5, rows - 0.5, ROWS)))
    field = field_map(lens).at_wavelength(wavelength_nm)
    x_mm, y_mm = frame_of(lens, size_px).position_mm(row, column)
    source_x_mm, source_y_mm = field.source_mm(x_mm, y_mm)
    focal_mm = lens.capture_focal_length_mm
    directions = np.stack([source_x_mm * lens.squeeze / focal_mm, -source_y_mm / focal_mm, np.ones_like(x_mm)], axis=1)
    return np.stack([column, row], axis=1), directions, field.within(x_mm, y_mm)


def off_px(lens, size_px, project, wavelength_nm=540.0, least=0.9):
    """The largest distance in pixels, over the covered part of a frame, between a pixel and where `project` has its
    light."""
    pixels, directions, inside = lens_directions(lens, size_px, wavelength_nm)
    assert inside.mean() > least
    return float(np.hypot(*(project(directions[inside]) - pixels[inside]).T).max())
