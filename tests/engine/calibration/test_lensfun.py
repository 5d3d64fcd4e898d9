"""Lensfun distorts a straight picture as the calibration that was written for it.

Without lensfunpy, these tests are skipped: make test-calibration runs them.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from calibrated import radial_lens
from lensfield.engine.calibration.fit import calibrate
from lensfield.engine.calibration.formats import FORMATS
from lensfield.engine.calibration.models import FISHEYE_POLY5, POLY3, POLY5, PTLENS
from lensfield.engine.calibration.views import View
from lensfield.engine.image.pixel_grid import PixelGrid

lensfunpy = pytest.importorskip("lensfunpy", reason="lensfunpy is not installed: make test-calibration")
SINGLE_PX = 2e-3  # Lensfun computes in single precision
PITCH_MM = 0.022


def places_by_lensfun(calibration, flags):
    """Places in the picture of places in the straight one, by the entry that is written: columns and rows of both; and
    the entry's text."""
    text = FORMATS["lensfun"].text([View(calibration)])
    lens, = lensfunpy.Database(xml=text, load_common=False, load_bundled=False).lenses
    columns, rows = calibration.size_px
    modifier = lensfunpy.Modifier(lens, lens.crop_factor, columns, rows)
    modifier.initialize(calibration.focal_px[0] * PITCH_MM, 8.0, 1000.0, scale=1.0, pixel_format=np.float32,
                        targeom=lensfunpy.LensType.RECTILINEAR, flags=flags)
    straight = np.stack(np.meshgrid(np.arange(0, columns, 13), np.arange(0, rows, 11)), axis=-1).reshape(-1, 2)
    places = np.array([modifier.apply_geometry_distortion(x, y, 1, 1)[0, 0]  # its vector loops mix neighbours' radii
                       for x, y in straight])
    return straight, places, text


def directions(straight, calibration, straight_px):
    """Of places in a straight picture of this focal length."""
    middle = (np.array(calibration.size_px) - 1) / 2
    return np.pad((straight - middle) / straight_px, ((0, 0), (0, 1)), constant_values=1.0)


@pytest.mark.parametrize("model", [POLY3, POLY5, PTLENS], ids=lambda model: model.name)
@pytest.mark.parametrize("shape_px", [(80, 140), (150, 90)])
def test_lensfun_distorts_as_calibrated(model, shape_px):
    frame = PixelGrid(shape_px, 1e3 * PITCH_MM)
    calibration = calibrate(radial_lens(lambda t: t * (1 - 0.9 * t**2 + 4 * t**4)), frame, 550.0, [model])
    straight, places, text = places_by_lensfun(calibration, lensfunpy.ModifyFlags.DISTORTION)
    straight_px = float(re.search(r"undistorted picture: (\S+) mm", text)[1]) / PITCH_MM
    np.testing.assert_allclose(places, calibration.pixels(directions(straight, calibration, straight_px)),
                               atol=SINGLE_PX)
    assert np.abs(places[0]).max() > 0.2  # there is distortion


@pytest.mark.parametrize("model", FISHEYE_POLY5, ids=lambda model: model.name)
@pytest.mark.parametrize("shape_px", [(80, 140), (150, 90)])
def test_lensfun_reads_fisheyes_of_all_types(model, shape_px):
    """Stretched to a plane by Lensfun, and compared with the calibration there."""
    lens = radial_lens(lambda t: np.arctan(t) * (1 - 0.1 * np.arctan(t)**2), np.linspace(0, 20, 65))
    calibration = calibrate(lens, PixelGrid(shape_px, 1e3 * PITCH_MM), 550.0, [model])
    calibration = replace(calibration, focal_px=(60.0, 60.0))  # for a wide field in few pixels
    straight, places, text = places_by_lensfun(
        calibration, lensfunpy.ModifyFlags.DISTORTION | lensfunpy.ModifyFlags.GEOMETRY)
    towards = directions(straight, calibration, 60.0)
    np.testing.assert_allclose(places, calibration.pixels(towards), atol=SINGLE_PX)
    assert np.abs(places - straight).max() > 5 and f"<type>{model.name.partition('-')[2]}</type>" in text
