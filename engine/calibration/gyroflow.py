"""Gyroflow's lens profile, in JSON: https://github.com/gyroflow/lens_profiles"""

import json
from collections.abc import Sequence

from .views import View, origin


def gyroflow_text(views: Sequence[View]) -> str:
    """The profile of one camera: Gyroflow describes every lens by OpenCV's model of fisheyes."""
    calibration, = (view.calibration for view in views)
    (columns, rows), (fx, fy), (cx, cy) = calibration.size_px, calibration.focal_px, calibration.principal_px
    size = {"w": columns, "h": rows}
    name = " ".join(calibration.lens.split())
    return json.dumps({
        "name": f"Lensfield_{name}", "note": origin(calibration), "calibrated_by": "Lensfield",
        "camera_brand": "Lensfield", "camera_model": "Simulated camera", "lens_model": name, "camera_setting": "",
        "calib_dimension": size, "orig_dimension": size, "output_dimension": size,
        "input_horizontal_stretch": 1.0, "input_vertical_stretch": 1.0, "official": False,
        "calibrator_version": "Lensfield",  # without one, Gyroflow refuses the profile
        "asymmetrical": True,  # otherwise, Gyroflow ignores cx and cy
        "fisheye_params": {
            "RMS_error": calibration.rms_px, "camera_matrix": [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
            "distortion_coeffs": list(calibration.coefficients)},
        "distortion_model": "opencv_fisheye"}, indent=2) + "\n"
