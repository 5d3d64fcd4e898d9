"""ROS's own reader of camera_info, and the rays of its image_geometry.

Debian's Python runs both. Without its packages python3-camera-calibration-parsers and python3-image-geometry, these
tests are skipped.
"""

import json
import subprocess
from functools import lru_cache

import numpy as np
import pytest

from calibrated import FRAME, modelled_lens, radial_lens
from lensfield.engine.calibration.fit import calibrate
from lensfield.engine.calibration.formats import FORMATS
from lensfield.engine.calibration.models import BROWN_CONRADY, KANNALA_BRANDT, RADIAL, RADTAN
from lensfield.engine.calibration.rays import frame_rays
from lensfield.engine.calibration.views import View
from lensfield.engine.image.pixel_grid import PixelGrid

PYTHON = "/usr/bin/python3"
IMPORTS = "from camera_calibration_parsers import readCalibration; from image_geometry import PinholeCameraModel"
READER = IMPORTS + """
import json, sys
_, info = readCalibration(sys.argv[1])
model = PinholeCameraModel()
model.fromCameraInfo(info)
rays = [model.projectPixelTo3dRay(model.rectifyPoint(pixel)) for pixel in json.load(sys.stdin)]
print(json.dumps([[info.width, info.height], info.distortion_model, info.K, info.D, rays]))
"""
MOST_PX = 0.05
LENSES = {
    "radial": (lambda: radial_lens(lambda t: t * (1 - 0.9 * t**2)), FRAME, RADIAL[2]),
    "decentred": (lambda: modelled_lens(RADTAN, (-0.4, 0.5, 0.011, -0.007)), FRAME, RADTAN),
    "squeezed": (lambda: modelled_lens(BROWN_CONRADY, (-0.4, 0.5, 0.003, 0.008, 1.0), 1.5), FRAME, BROWN_CONRADY)}


@lru_cache(maxsize=1)
def has_ros():
    try:
        return subprocess.run([PYTHON, "-c", IMPORTS], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


@pytest.fixture
def read_by_ros(tmp_path):
    """The size, the model, K, D and the rays of pixels that ROS reads for a calibration, as a function."""
    if not has_ros():
        pytest.skip("ROS is not installed: apt-get install python3-camera-calibration-parsers python3-image-geometry")

    def read(fit, pixels):
        path = tmp_path / "camera_info.yaml"
        path.write_text(FORMATS["ros"].text([View(fit)]))
        output = subprocess.run([PYTHON, "-c", READER, path], input=json.dumps(pixels.tolist()), text=True,
                                capture_output=True, check=True).stdout
        size, kind, matrix, coefficients, rays = json.loads(output)
        return tuple(size), kind, matrix, coefficients, np.array(rays)

    return read


@pytest.mark.parametrize("name", LENSES)
def test_ros_finds_the_rays_of_the_lens(name, read_by_ros):
    lens, frame, model = LENSES[name]
    fit, rays = calibrate(lens(), frame, 550.0, [model]), frame_rays(lens(), frame, 550.0)
    size, kind, _, _, ros_rays = read_by_ros(fit, rays.pixels)
    off_px = (ros_rays[:, :2] / ros_rays[:, 2:] - rays.directions[:, :2]) * fit.focal_px
    assert size == fit.size_px and kind == "plumb_bob"
    assert np.hypot(*off_px.T).max() < MOST_PX


def test_ros_reads_the_numbers_of_a_fisheye(read_by_ros):
    """Its image_geometry knows fisheyes only in C++: the rays of the one in Python are left aside."""
    lens = radial_lens(lambda t: np.arctan(t) * (1 - 0.05 * np.arctan(t)**2), np.linspace(0, 30, 65))
    fit = calibrate(lens, PixelGrid((90, 140), 150.0, centre_px=(61.0, 42.0)), 550.0, [KANNALA_BRANDT])
    size, kind, matrix, coefficients, _ = read_by_ros(fit, np.zeros((0, 2)))
    (fx, fy), (cx, cy) = fit.focal_px, fit.principal_px
    assert size == fit.size_px and kind == "equidistant"
    assert matrix == [fx, 0, cx, 0, fy, cy, 0, 0, 1] and coefficients == list(fit.coefficients)
