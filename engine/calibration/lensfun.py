"""Lensfun's database, in XML: https://lensfun.github.io/manual/latest/corrections.html

Lensfun's radius is in half short sides of the frame, which ends at the middles of the outermost pixels. Its models
poly3 and ptlens leave the radius 1 where it is, so the undistorted picture has another size than on the axis. The
undistorted picture of a fisheye is the ideal one of its type. `real-focal-length` is the focal length on the axis.
"""

from collections.abc import Sequence
from xml.sax.saxutils import escape, quoteattr

import numpy as np
import scipy

from ..lens.formats import crop_factor
from ..runtime.errors import InputError
from .fit import Calibration
from .views import View, origin

LARGEST_OFFSET_PX = 0.01  # of the axis from the middle of the frame
NAMES = {"poly3": ("k1",), "poly5": ("k1", "k2"), "ptlens": ("a", "b", "c")}
"""Of the coefficients. A model's name may have the type of a fisheye after it, as in poly5-equisolid."""


def lensfun_text(views: Sequence[View]) -> str:
    """The entry of one lens.

    Raises
    ------
    InputError
        The axis is not in the middle of the frame.
    """
    calibration, = (view.calibration for view in views)
    model, _, kind = calibration.model.name.partition("-")
    (columns, rows), pitch_mm = calibration.size_px, calibration.frame.pitch_um * 1e-3
    offset_px = np.subtract(calibration.principal_px, ((columns - 1) / 2, (rows - 1) / 2))
    if np.abs(offset_px).max() > LARGEST_OFFSET_PX:
        raise InputError("options", "--for", "lensfun", "expected the optical axis in the middle of the frame: use "
                                                        "another program, or set the camera's Shift and Tilt to 0")
    size_px, values = _lensfun_values(calibration)
    name, short, long = escape(" ".join(calibration.lens.split())), *sorted((columns - 1, rows - 1))
    words = " ".join(f"{key}={quoteattr(repr(value))}"
                     for key, value in zip(NAMES[model], values, strict=True))
    focal = quoteattr(repr(calibration.focal_px[0] * pitch_mm))
    return "\n".join([
        '<?xml version="1.0" encoding="utf-8"?>', f"<!-- {origin(calibration).replace('--', '- -')} -->",
        f"<!-- focal length of the undistorted picture: {size_px * pitch_mm:.8g} mm -->",
        '<lensdatabase version="1">', "  <lens>", "    <maker>Lensfield</maker>", f"    <model>{name}</model>",
        "    <mount>Generic</mount>",
        f"    <cropfactor>{crop_factor((long * pitch_mm, short * pitch_mm)):.6f}</cropfactor>",
        f"    <aspect-ratio>{long / short:.6f}</aspect-ratio>", f"    <type>{kind or 'rectilinear'}</type>",
        "    <calibration>",
        f'      <distortion model="{model}" focal={focal} {words}/>',
        f"      <real-focal-length focal={focal} real-focal={focal}/>", "    </calibration>",
        "  </lens>", "</lensdatabase>", ""])


def _lensfun_values(calibration: Calibration):
    """Focal length in pixels of the undistorted picture, and the coefficients in Lensfun's order.

    A radius in the frame is f t (1 + k1 t^n ...) for the tangent t; Lensfun has it in terms of the radius g t of the
    undistorted picture. For a fisheye, t is a function of the angle.
    """
    focal_px, coefficients = calibration.focal_px[0], calibration.coefficients
    half_px = (min(calibration.size_px) - 1) / 2  # between the middles of pixels
    if calibration.model.name.startswith("poly5"):
        return focal_px, [each * (half_px / focal_px)**power for each, power in zip(coefficients, (2, 4), strict=True)]
    powers = (2,) if calibration.model.name == "poly3" else (1, 2, 3)

    def scaled(size_px):
        return [focal_px * each * half_px**power / size_px**(power + 1)
                for each, power in zip(coefficients, powers, strict=True)]

    size_px = float(scipy.optimize.newton(lambda size_px: size_px * (1 - sum(scaled(size_px))) - focal_px, focal_px))
    return size_px, scaled(size_px)[::-1]
