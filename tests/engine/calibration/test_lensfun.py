"""Lensfun distorts a straight picture as the calibration that was written for it.

Without lensfunpy, these tests are skipped: make test-calibration runs them.
"""

import re

import numpy as np
import pytest

from calibrated import radial_lens
from lensfield.engine.calibration.fit import calibrate
from lensfield.engine.calibration.formats import FORMATS
from lensfield.engine.calibration.models import POLY3, POLY5, PTLENS
from lensfield.engine.calibration.views import View
from lensfield.engine.image.pixel_grid import PixelGrid

lensfunpy = pytest.importorskip("lensfunpy", reason="lensfunpy is not installed: make test-calibration")
SINGLE_PX = 2e-3  # Lensfun computes in single precision


@pytest.mark.parametrize("model", [POLY3, POLY5, PTLENS], ids=lambda model: model.name)
@pytest.mark.parametrize("shape_px", [(80, 140), (150, 90)])
def test_lensfun_distorts_as_calibrated(model, shape_px):
    frame = PixelGrid(shape_px, 22.0)
    calibration = calibrate(radial_lens(lambda t: t * (1 - 0.9 * t**2 + 4 * t**4)), frame, 550.0, [model])
    text = FORMATS["lensfun"].text([View(calibration)])
    straight_px = float(re.search(r"undistorted picture: (\S+) mm", text)[1]) / 0.022
    lens, = lensfunpy.Database(xml=text, load_common=False, load_bundled=False).lenses
    columns, rows = calibration.size_px
    modifier = lensfunpy.Modifier(lens, lens.crop_factor, columns, rows)
    modifier.initialize(calibration.focal_px[0] * 0.022, 8.0, 1000.0, scale=1.0, pixel_format=np.float32,
                        flags=lensfunpy.ModifyFlags.DISTORTION)
    column, row = (axis.ravel() for axis in np.meshgrid(np.arange(0, columns, 13), np.arange(0, rows, 11)))
    places = np.array([modifier.apply_geometry_distortion(x, y, 1, 1)[0, 0]  # its vector loops mix neighbours' radii
                       for x, y in zip(column, row, strict=True)])
    directions = np.stack([(column - (columns - 1) / 2) / straight_px, (row - (rows - 1) / 2) / straight_px,
                           np.ones(column.shape)], axis=-1)
    np.testing.assert_allclose(places, calibration.pixels(directions), atol=SINGLE_PX)
    assert np.abs(places[0]).max() > 0.2  # there is distortion
