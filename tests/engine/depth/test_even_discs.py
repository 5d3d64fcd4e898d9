"""The discs of lamps out of focus: how much of the pattern of rays they show, and where they are in previews."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from lensfield.engine.depth.cast import cast
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.rays.rings import Rings
from varied_lenses import lens_for_rays

SETS = 8  # of rays, whose mean is many rays
FINE_PX = 4.0  # rings are finer than this blur
INSIDE = 0.85  # of a disc's radius
LAMP_PX, LAMP_MM, FOCUS_MM, PITCH_UM = 3, 12e3, 1e3, 18.75
PREVIEW, STANDARD = 256, 1024  # rays


def disc(lens, rays, grid, count):
    """The picture of a lamp."""
    alpha = np.zeros(grid.shape_px, np.float32)
    alpha[tuple(slice(n // 2, n // 2 + LAMP_PX) for n in grid.shape_px)] = 1
    lamp = Layer(alpha[None], alpha, np.full(alpha.shape, LAMP_MM))
    scene = LayeredRadiance((lamp,), [550.0], grid, lens.capture_focal_length_mm)
    plane, = cast(scene, lens, lambda: rays, most_rays=count)
    return plane.blurred.astype(float)


def turned_spiral(count, turn):
    """Evenly spread places of the stop, a different set for each turn."""
    number = np.arange(count) + 0.5
    azimuth = np.pi * (3 - 5**0.5) * number + turn
    return np.sqrt((1 - np.pi / (3 * count)) * number / count) * np.stack([np.cos(azimuth), np.sin(azimuth)])


def centroid(picture):
    return [(picture * places).sum() / picture.sum() for places in np.indices(picture.shape)]


def ripple(picture, many):
    """Ratio to the picture by many rays inside the disc, without its slow changes."""
    lit = many > 0.3 * many.max()
    ratio = np.where(lit, picture / np.where(lit, many, 1), 1)
    away = np.hypot(*(places - at for places, at in zip(np.indices(many.shape), centroid(many), strict=True)))
    return (ratio - gaussian_filter(ratio, FINE_PX))[away < INSIDE * np.sqrt(lit.sum() / np.pi)]


@pytest.mark.parametrize("name, f_number, shape_px, centre_px, count, most", [
    ("angenieux-50mm", 1.1, (170, 178), (85.0, 89.0), PREVIEW, 0.0135),
    ("nikkor-z-50mm-f1.8", 1.8, (110, 134), (255.0, 467.0), PREVIEW, 0.019),
    ("nikkor-z-50mm-f1.8", 1.8, (110, 134), (255.0, 467.0), STANDARD, 0.0067),
    ("angenieux-50mm", 1.1, (170, 178), (85.0, 89.0), STANDARD, 0.0111)])
def test_discs_do_not_show_the_pattern_of_rays(monkeypatch, name, f_number, shape_px, centre_px, count, most):
    """On and off the axis. With look-ups of squares, the deviations of the first two were 0.018 and 0.034; with many
    rays in a lattice, those of the others were 0.0071 and 0.0124."""
    lens = lens_for_rays(name, Rings(f_number=f_number, focus_mm=FOCUS_MM))
    rays, grid = lens_rays(lens), PixelGrid(shape_px, PITCH_UM, centre_px)
    picture, several = disc(lens, rays, grid, count), []
    for turn in range(SETS):
        monkeypatch.setattr("lensfield.engine.field.radial.pencils.stop_places",
                            lambda count, turn=turn: turned_spiral(count, turn))
        several.append(disc(lens, rays, grid, count))
    assert ripple(picture, np.mean(several, axis=0)).std() < most


@pytest.mark.parametrize("name, f_number, shape_px, centre_px", [
    ("nikkor-z-50mm-f1.8", 1.8, (110, 134), (255.0, 467.0)), ("angenieux-50mm", 1.1, (150, 166), (185.0, -57.0))])
def test_previews_show_a_disc_where_standard_does(name, f_number, shape_px, centre_px):
    """With look-ups of squares, they were 0.8 and 3.3 px apart."""
    lens = lens_for_rays(name, Rings(f_number=f_number, focus_mm=FOCUS_MM))
    rays, grid = lens_rays(lens), PixelGrid(shape_px, PITCH_UM, centre_px)
    preview, standard = (disc(lens, rays, grid, count) for count in (PREVIEW, STANDARD))
    assert np.hypot(*np.subtract(centroid(preview), centroid(standard))) < 0.3
