"""The field map answers in x and y, whatever its geometry."""

import numpy as np
import pytest

from lenses import comatic_lens, lopsided_lens
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sampling import Sampling

LENS = comatic_lens()
GRID = PixelGrid((37, 50), 71.0, (14.25, 27.5))


def places():
    x_mm, y_mm = GRID.axes_mm()
    return x_mm[None, :], y_mm[:, None]


def test_source_and_landing_positions_are_inverse():
    field = field_map(LENS).at_wavelength(550.0)
    x_mm, y_mm = (at[field.within(*places())] for at in np.broadcast_arrays(*places()))
    again = field.landing_mm(*field.source_mm(x_mm, y_mm))
    np.testing.assert_allclose(again, (x_mm, y_mm), atol=1e-6)
    moved = np.hypot(*np.subtract(field.source_mm(x_mm, y_mm), (x_mm, y_mm)))
    assert moved.max() > 0.02  # 2 % of distortion per mm of height


def test_the_share_beyond_the_lens_data_counts_pixels():
    field = field_map(LENS).at_wavelength(550.0)
    beyond = ~field.within(*places())
    assert 0.02 < beyond.mean() < 0.5 and field.share_beyond(GRID) == pytest.approx(beyond.mean(), abs=1e-12)
    assert field.share_beyond(PixelGrid((10, 12), 71.0)) == 0


def test_psfs_by_pixel_equal_the_table_at_its_nodes():
    fields, planes = field_map(LENS), Planes(PixelGrid((9, 9), 20.0), False)
    sampling = Sampling(planes.picture, (550.0,))
    table = fields.node_psfs(sampling, planes, lambda psfs: psfs, 4, "float64").at_wavelength(550.0).table()
    placed = fields.at_wavelength(550.0).psfs(lambda psfs: psfs, planes)
    rows, columns = np.array([4, 2, 7]), np.array([7, 2, 4])  # at 0, 45 and 270 degrees
    taps_row, taps_column, taps = table.mixed(placed.place(rows, columns))
    mixed = np.zeros((3, 2 * table.radius_px + 1, 2 * table.radius_px + 1))
    mixed[:, taps_row, taps_column] = taps.T
    np.testing.assert_allclose(mixed, placed.psfs(rows, columns), atol=1e-12)


def test_quadrants_share_only_mirror_symmetric_optics():
    assert field_map(LENS).mirror_symmetric and not field_map(lopsided_lens()).mirror_symmetric
