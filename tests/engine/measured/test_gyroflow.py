"""Gyroflow's profiles lead to the pixels that Gyroflow itself finds for a direction.

`by_gyroflow` follows its sources, version 1.6.3: `get_camera_matrix_internal` in src/core/lens_profile.rs,
`get_lens_data_at_timestamp` in stabilization/frame_transform.rs, and `rotate_and_distort` in
stabilization/cpu_undistort.rs.
"""

import json

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.measured.files import lens_of, read_measured
from lensfield.engine.measured.options import MeasuredOptions
from measuring import off_px
from refusals import refused

MOST_PX = 0.02
SIDES = 320, 180
PROFILE = {
    "calib_dimension": {"w": SIDES[0], "h": SIDES[1]}, "calibrator_version": "1.6.3",
    "fisheye_params": {"camera_matrix": [[250.0, 0.0, 167.0], [0.0, 252.0, 84.0], [0.0, 0.0, 1.0]],
                       "distortion_coeffs": [0.1, -0.05, 0.02, 0.01]}}


def by_gyroflow(profile, size_px, directions):
    """Pixels of directions in a video of this size."""
    (fx, _, cx), (_, fy, cy), _ = profile["fisheye_params"]["camera_matrix"]
    k1, k2, k3, k4 = profile["fisheye_params"]["distortion_coeffs"]
    sides = profile["calib_dimension"]["w"], profile["calib_dimension"]["h"]
    if not profile.get("asymmetrical"):
        cx, cy = sides[0] / 2, sides[1] / 2
    crop = profile.get("crop") or 1
    stretches = [stretch if stretch > 0.01 else 1 for stretch in (
        profile.get("input_horizontal_stretch", 0), profile.get("input_vertical_stretch", 0))]
    scale = [size / side * stretch for size, side, stretch in zip(size_px, sides, stretches, strict=True)]
    x, y = directions[:, 0], directions[:, 1]
    angle, radius = np.arctan(np.hypot(x, y)), np.maximum(np.hypot(x, y), 1e-12)
    square = angle**2
    shrunk = angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4)))) / radius
    shrunk = shrunk if any((k1, k2, k3, k4)) else 1.0
    u, v = x * shrunk * fx / crop * scale[0] + cx * scale[0], y * shrunk * fy / crop * scale[1] + cy * scale[1]
    return np.stack([u / stretches[0], v / stretches[1]], axis=1)


def written(folder, changes):
    path = folder / "profile.json"
    path.write_text(json.dumps(PROFILE | changes))
    return path


FLAT = {"fisheye_params": PROFILE["fisheye_params"] | {"distortion_coeffs": [0.0] * 4}}


@pytest.mark.parametrize("changes, size_px", [
    ({}, SIDES), ({"asymmetrical": True}, SIDES), ({"crop": 1.25}, SIDES),
    ({"crop": None, "digital_lens": None}, SIDES), (FLAT, SIDES), ({"input_horizontal_stretch": 1.6}, (200, 180)),
    ({"input_horizontal_stretch": 1.33, "asymmetrical": True}, (241, 180)),
    ({"input_vertical_stretch": 0.75}, (320, 240)), ({"input_horizontal_stretch": 0.0}, SIDES)],
    ids=["symmetrical", "asymmetrical", "crop", "null", "flat", "anamorphic", "rounded", "vertical", "unset"])
def test_a_profile_leads_to_gyroflows_pixels(changes, size_px, tmp_path):
    measured = read_measured(written(tmp_path, changes), MeasuredOptions())
    assert measured.size_px == size_px
    lens = lens_of(measured, MeasuredOptions())
    assert off_px(lens, size_px, lambda directions: by_gyroflow(PROFILE | changes, size_px, directions)) <= MOST_PX


@pytest.mark.parametrize("changes, field", [
    ({"distortion_model": "sony"}, "distortion_model"), ({"digital_lens": "gopro_superview"}, "digital_lens"),
    ({"crop": "half"}, "crop"), ({"crop": -1}, "focal length"), ({"crop": 0}, "file"),
    ({"input_vertical_stretch": None}, "input_vertical_stretch"), ({"asymmetrical": 1}, "asymmetrical")])
def test_other_profiles_are_refused(changes, field, tmp_path):
    with refused(LensError, field=field):
        read_measured(written(tmp_path, changes), MeasuredOptions())
