"""OpenCV reads the files, projects as the models do, and undistorts the lens's pixels to its rays.

Without OpenCV, these tests are skipped: make test-calibration runs them.
"""

import numpy as np
import pytest

from calibrated import FRAME, modelled_lens, radial_lens
from lensfield.engine.calibration.fit import calibrate
from lensfield.engine.calibration.formats import FORMATS
from lensfield.engine.calibration.models import (
    BROWN_CONRADY,
    KANNALA_BRANDT,
    PINHOLE,
    RADIAL,
    RADTAN,
    RATIONAL,
    THIN_PRISM,
)
from lensfield.engine.calibration.rays import frame_rays
from lensfield.engine.calibration.views import View
from lensfield.engine.image.pixel_grid import PixelGrid

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: make test-calibration")
STOP = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-10) if hasattr(cv2, "TERM_CRITERIA_EPS") else None
LENSES = {
    "mustache": (lambda: radial_lens(lambda t: t * (1 - 0.9 * t**2 + 8 * t**4)), FRAME),
    "decentred": (lambda: modelled_lens(RADTAN, (-0.4, 0.5, 0.011, -0.007)), FRAME),
    "squeezed": (lambda: modelled_lens(BROWN_CONRADY, (-0.4, 0.5, 0.003, 0.008, 1.0), 1.5), FRAME)}
FISHEYE = (lambda: radial_lens(lambda t: np.arctan(t) * (1 - 0.05 * np.arctan(t)**2), np.linspace(0, 30, 65)),
           PixelGrid((90, 140), 150.0, centre_px=(61.0, 42.0)))


def opencv_camera(fit, folder):
    """The camera matrix and the coefficients that OpenCV reads, and its model."""
    path = folder / "camera.yml"
    path.write_text(FORMATS["opencv"].text([View(fit)]))
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert (file.getNode("image_width").real(), file.getNode("image_height").real()) == fit.size_px
    return (file.getNode("camera_matrix").mat(), file.getNode("distortion_coefficients").mat(),
            file.getNode("camera_model").string())


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("model", [PINHOLE, *RADIAL, RADTAN, BROWN_CONRADY, RATIONAL, THIN_PRISM],
                         ids=lambda model: model.name)
def test_opencv_projects_as_its_models(name, model, tmp_path):
    lens, frame = LENSES[name]
    fit, rays = calibrate(lens(), frame, 550.0, [model]), frame_rays(lens(), frame, 550.0)
    matrix, coefficients, kind = opencv_camera(fit, tmp_path)
    projected, _ = cv2.projectPoints(rays.directions[:, None], np.zeros(3), np.zeros(3), matrix, coefficients)
    assert kind == "pinhole"
    np.testing.assert_allclose(projected[:, 0], fit.pixels(rays.directions), atol=1e-6)


@pytest.mark.parametrize("name", LENSES)
def test_opencv_undistorts_pixels_to_the_rays_of_the_lens(name, tmp_path):
    lens, frame = LENSES[name]
    fit = calibrate(lens(), frame, 550.0, [RADTAN, RADIAL[2], BROWN_CONRADY], 0.01)
    rays = frame_rays(lens(), frame, 550.0)
    matrix, coefficients, _ = opencv_camera(fit, tmp_path)
    straight = cv2.undistortPointsIter(rays.pixels[:, None], matrix, coefficients, None, None, STOP)[:, 0]
    off_px = (straight - rays.directions[:, :2]) * fit.focal_px
    assert np.hypot(*off_px.T).max() < 0.05


def test_opencv_undistorts_a_fisheye(tmp_path):
    lens, frame = FISHEYE
    fit, rays = calibrate(lens(), frame, 550.0, [KANNALA_BRANDT]), frame_rays(lens(), frame, 550.0)
    matrix, coefficients, kind = opencv_camera(fit, tmp_path)
    assert kind == "fisheye" and coefficients.shape == (1, 4)
    projected, _ = cv2.fisheye.projectPoints(rays.directions[:, None], np.zeros(3), np.zeros(3), matrix, coefficients)
    np.testing.assert_allclose(projected[:, 0], fit.pixels(rays.directions), atol=1e-6)
    straight = cv2.fisheye.undistortPoints(rays.pixels[:, None], matrix, coefficients)[:, 0]
    angles = np.arctan(np.hypot(*straight.T)) - np.arctan(np.hypot(*rays.directions[:, :2].T))
    assert np.abs(angles).max() * fit.focal_px[0] < 0.05
