"""Each kind of file leads from a lens to its calibration and back: the field of the lens that is read is the same."""

from dataclasses import replace

import numpy as np
import pytest

from calibrated import FRAME, modelled_lens, radial_lens
from lensfield.engine.calibration.fit import Calibration
from lensfield.engine.calibration.formats import FORMATS, calibrated_for
from lensfield.engine.calibration.models import (
    BROWN_CONRADY,
    DOUBLE_SPHERE,
    FISHEYE_POLY5,
    KANNALA_BRANDT,
    PINHOLE,
    POLY3,
    POLY5,
    PTLENS,
    RADIAL,
    RADTAN,
    RATIONAL,
    THIN_PRISM,
)
from lensfield.engine.calibration.views import View
from lensfield.engine.field.stmap import distort_map, undistort_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens import GridLens
from lensfield.engine.measured.files import kind_of, lens_of, read_measured
from lensfield.engine.measured.options import MeasuredOptions
from lensfield.engine.pictures.spectral_exr import write_rgb_exr
from measuring import lens_directions, off_px

MOST_PX = 0.02
SENSOR = MeasuredOptions(sensor_mm=(7.0, 4.5))
COEFFICIENTS = {
    PINHOLE: (), RADIAL[0]: (-0.1,), RADIAL[1]: (-0.25, 0.1), RADIAL[2]: (0.1, -0.06, 0.02),
    RADTAN: (-0.25, 0.1, 0.004, -0.003), BROWN_CONRADY: (0.12, -0.1, -0.002, 0.003, 0.04),
    RATIONAL: (0.2, 0.06, 0.003, 0.002, 0.01, 0.4, 0.1, 0.02),
    THIN_PRISM: (-0.25, 0.1, 0.004, -0.003, 0.01, 0.02, 0.01, 0.005, 0.003, -0.001, 0.002, 0.001),
    KANNALA_BRANDT: (0.03, -0.01, 0.004, -0.001), DOUBLE_SPHERE: (-0.1, 0.57), POLY3: (-0.05,), POLY5: (-0.06, 0.01),
    PTLENS: (0.02, -0.06, 0.03)} | {model: (-0.02, 0.004) for model in FISHEYE_POLY5}
SIZE_PX = 1400, 900
NAMES = {"opencv": "c.yml", "colmap": "c.txt", "nerfstudio": "c.json", "kalibr": "c.yaml", "ros": "camera.yaml",
         "gyroflow": "profile.json", "lensfun": "lens.xml"}


def calibration_of(model, focal_px=(900.0, 910.0), principal_px=(671.3, 468.9)):
    """A calibration with a model of a picture whose axis is not in the middle."""
    one_focal = model.one_focal
    columns, rows = SIZE_PX
    return Calibration(
        model, PixelGrid((rows, columns), 5.0), 2 * focal_px[:1] if one_focal else focal_px,
        ((columns - 1) / 2, (rows - 1) / 2) if one_focal else principal_px, COEFFICIENTS[model], 0.0, 0.0, 1.0,
        "a lens", np.inf, 2.8, 550.0, 40.0, (0.8, 0.5, 0.8, 0.5), 2.8, 0.0)


def read_back(name, calibration, folder, options=SENSOR):
    path = folder / NAMES[name]
    path.write_text(FORMATS[name].text([View(calibration)]))
    assert kind_of(path) == name
    return lens_of(read_measured(path, options), options)


CASES = [(name, model) for name in NAMES for model in FORMATS[name].models]


@pytest.mark.sample(15)
@pytest.mark.parametrize("name, model", CASES, ids=lambda each: getattr(each, "name", each))
def test_a_file_leads_back_to_the_field(name, model, tmp_path):
    calibration = calibration_of(model)
    options = replace(SENSOR, size_px=SIZE_PX) if name == "lensfun" else SENSOR
    lens = read_back(name, calibration, tmp_path, options)
    assert off_px(lens, SIZE_PX, calibration.pixels) <= MOST_PX
    assert lens.sensor_mm == (7.0, 4.5)
    assert name == "lensfun" or isinstance(lens, GridLens)


@pytest.mark.sample(6)
@pytest.mark.parametrize("name", [name for name in NAMES if name != "lensfun"])
@pytest.mark.parametrize("kind", ["radial", "fisheye", "decentred"])
def test_a_lens_returns_from_its_calibration(name, kind, tmp_path):
    """The lens that is read has the field of the first one, except for the model's residual."""
    lens, frame = {
        "radial": (radial_lens(lambda t: t * (1 - 0.9 * t**2)), PixelGrid((90, 140), 22.0)),
        "fisheye": (radial_lens(lambda t: np.arctan(t), np.linspace(0, 30, 65)), PixelGrid((90, 140), 150.0)),
        "decentred": (modelled_lens(RADTAN, (-0.4, 0.5, 0.011, -0.007)), FRAME)}[kind]
    calibration = calibrated_for(name, lens, frame, 550.0)
    options = MeasuredOptions(sensor_mm=(14.0, 9.0))
    renewed = read_back(name, calibration, tmp_path, options)
    assert off_px(renewed, calibration.size_px, calibration.pixels) <= MOST_PX
    assert renewed.capture_focal_length_mm == pytest.approx(calibration.focal_px[1] * 0.1, rel=1e-9)


def tilted():
    """A lens in front of a frame of odd sides that is not in the middle of its field."""
    return modelled_lens(RADTAN, (-0.4, 0.5, 0.011, -0.007)), PixelGrid((301, 467), 6.6, centre_px=(203.5, 140.0))


@pytest.mark.parametrize("direction", ["distort", "undistort"])
def test_our_stmaps_lead_back_to_the_field(direction, tmp_path):
    lens, frame = tilted()
    path = tmp_path / f"lens_{direction}.exr"
    write_rgb_exr({"distort": distort_map, "undistort": undistort_map}[direction](lens, frame, 550.0), path)
    options = MeasuredOptions(focal_mm=lens.capture_focal_length_mm / 6.6e-3 * 0.02, sensor_mm=(467 * 0.02, 301 * 0.02))
    renewed = lens_of(read_measured(path, options), options)
    middle_px, size_px = np.array([233.0, 150.0]), (467, 301)
    from lensfield.engine.field.field_map import field_map
    field = field_map(lens).at_wavelength(550.0)

    def project(directions):
        """Pixels of light of the first lens, from the axis of the second, which is in the middle of the frame."""
        ideal = directions[:, :2] * lens.capture_focal_length_mm / 6.6e-3 + middle_px
        ideal_mm = frame.position_mm(ideal[:, 1], ideal[:, 0])
        row, column = frame.index_of(*field.landing_mm(*ideal_mm))
        return np.stack([column, row], axis=1)

    assert off_px(renewed, size_px, project, least=0.8) <= MOST_PX
    assert lens_directions(renewed, size_px)[2].all() == (direction == "distort")  # corners are beyond this map
