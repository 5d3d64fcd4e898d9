"""Camera models of other programs: from directions of light to places on a plane at unit distance.

Directions are in the axes of OpenCV: x to the right, y downwards, z forwards. A pixel is the focal length in pixels
times the place, plus the principal point.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Placing = Callable[..., tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Model:
    """A camera model.

    Attributes
    ----------
    name : str
        As `--model` names it.
    coefficients : tuple of str
        In the order of OpenCV's arrays.
    placed : function (x, y, z, *coefficients) -> (x, y)
        Places on the plane at unit distance: arrays of any shape.
    start : tuple of float
        Coefficients to start a fit with.
    limits : (float, float)
        Of the coefficients.
    fisheye : bool
        Whether it describes light far from the axis.
    one_focal : bool
        Whether its focal lengths along rows and columns are equal.
    """

    name: str
    coefficients: tuple[str, ...]
    placed: Placing
    start: tuple[float, ...]
    limits: tuple[float, float] = (-np.inf, np.inf)
    fisheye: bool = False
    one_focal: bool = False

    @property
    def symmetric(self) -> np.ndarray:
        """Whether each coefficient may differ from 0 for a rotationally symmetric lens: bool array (coefficient,)."""
        return np.array([name[0] not in ASYMMETRIC for name in self.coefficients], bool)

    def place(self, directions: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """Places of directions: arrays (..., 3) and (..., 2)."""
        return np.stack(self.placed(*np.moveaxis(directions, -1, 0), *coefficients), axis=-1)


NEWTON_STEPS, SLOPE_STEP = 12, 1e-6
FARTHEST = 1e3  # in focal lengths: keeps Newton's steps finite where a trial polynomial is not monotonic
LENSFUN_FISHEYES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "fisheye": lambda angle: angle, "equisolid": lambda angle: 2 * np.sin(angle / 2),
    "stereographic": lambda angle: 2 * np.tan(angle / 2), "orthographic": np.sin,
    "fisheye_thoby": lambda angle: 1.47 * np.sin(0.713 * angle)}
"""Lensfun's types of fisheyes: radii in focal lengths, as functions of the angle. The last one is M. Thoby's fit to a
lens."""
ASYMMETRIC = "p", "s"  # first letters of tangential and thin-prism coefficients


def _brown_conrady(x, y, z, k1=0.0, k2=0.0, p1=0.0, p2=0.0, k3=0.0, k4=0.0, k5=0.0, k6=0.0, s1=0.0, s2=0.0, s3=0.0,
                   s4=0.0):
    """OpenCV's pinhole camera with rational, tangential and thin-prism distortion (calib3d)."""
    x, y = x / z, y / z
    square = x**2 + y**2
    radial = (1 + square * (k1 + square * (k2 + square * k3))) / (1 + square * (k4 + square * (k5 + square * k6)))
    return (x * radial + 2 * p1 * x * y + p2 * (square + 2 * x**2) + square * (s1 + square * s2),
            y * radial + p1 * (square + 2 * y**2) + 2 * p2 * x * y + square * (s3 + square * s4))


def _radial(x, y, z, k1=0.0, k2=0.0, k3=0.0):
    return _brown_conrady(x, y, z, k1, k2, 0.0, 0.0, k3)


def _distorted(x, y, z, *coefficients):
    """OpenLensIO's default model: Brown's equations lead from distorted to undistorted places, and Newton's method with
    the radial slope back."""
    x, y = x / z, y / z
    at_x, at_y = x, y
    for _ in range(NEWTON_STEPS):
        straight_x, straight_y = _brown_conrady(at_x, at_y, 1.0, *coefficients)
        outer_x, outer_y = _brown_conrady((1 + SLOPE_STEP) * at_x, (1 + SLOPE_STEP) * at_y, 1.0, *coefficients)
        radius = np.maximum(np.hypot(straight_x, straight_y), np.finfo(float).tiny)
        slope = (np.hypot(outer_x, outer_y) / radius - 1) / SLOPE_STEP  # of log radius: 1 without distortion
        ratio = np.hypot(at_x, at_y) / radius / np.where(slope > 0, slope, 1)
        at_x, at_y = at_x + (x - straight_x) * ratio, at_y + (y - straight_y) * ratio
    return at_x, at_y


def _ptlens(x, y, z, k1, k2, k3):
    """A polynomial of the third degree in the radius, as Lensfun's ptlens."""
    x, y = x / z, y / z
    radius = np.hypot(x, y)
    scale = 1 + radius * (k1 + radius * (k2 + radius * k3))
    return scale * x, scale * y


def _kannala_brandt(x, y, z, k1, k2, k3, k4):
    """Kannala and Brandt, IEEE PAMI 28 (2006), as OpenCV's fisheye camera: an odd polynomial of the angle."""
    angle = np.arctan2(np.hypot(x, y), z)
    square = angle**2
    return at_radius(x, y, z, angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4)))))


def _ftheta(x, y, z, k2, k3, k4):
    """NVIDIA's f-theta camera: the angle is a polynomial of the radius, which Newton's method inverts."""
    angle = np.arctan2(np.hypot(x, y), z)
    radius = angle
    for _ in range(NEWTON_STEPS):
        beyond = radius * (1 + radius * (k2 + radius * (k3 + radius * k4))) - angle
        slope = 1 + radius * (2 * k2 + radius * (3 * k3 + radius * 4 * k4))
        radius = np.clip(radius - beyond / np.where(slope > 0, slope, 1), 0, FARTHEST)
    return at_radius(x, y, z, radius)


def at_radius(x: np.ndarray, y: np.ndarray, z: np.ndarray, distorted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places at these radii, in the azimuths of the directions: arrays of one shape."""
    radius = np.hypot(x, y)
    scale = np.where(radius > 0, distorted / np.where(radius > 0, radius, 1), 1 / np.abs(z))
    return scale * x, scale * y


def _fisheye_poly5(projection):
    """Lensfun's poly5 of a fisheye: a polynomial of the radius in the ideal picture of its kind."""
    def placed(x, y, z, k1, k2):
        ideal = projection(np.arctan2(np.hypot(x, y), z))
        return at_radius(x, y, z, ideal * (1 + ideal**2 * (k1 + ideal**2 * k2)))

    return placed


def _double_sphere(x, y, z, xi, alpha):
    """Usenko, Demmel and Cremers, 3DV 2018: a second sphere's projection is mixed with a plane's."""
    distance = np.sqrt(x**2 + y**2 + z**2)
    shifted = xi * distance + z
    depth = alpha * np.sqrt(x**2 + y**2 + shifted**2) + (1 - alpha) * shifted
    return x / depth, y / depth


def _model(name, coefficients, placed, **facts):
    names = tuple(coefficients.split())
    return Model(name, names, placed, **{"start": (0.0,) * len(names)} | facts)


PINHOLE = _model("pinhole", "", _radial)
RADIAL = tuple(_model(f"radial-{count}", " ".join(["k1", "k2", "k3"][:count]), _radial) for count in (1, 2, 3))
RADTAN = _model("radtan", "k1 k2 p1 p2", _brown_conrady)
BROWN_CONRADY = _model("brown-conrady", "k1 k2 p1 p2 k3", _brown_conrady)
RATIONAL = _model("rational", "k1 k2 p1 p2 k3 k4 k5 k6", _brown_conrady)
THIN_PRISM = _model("thin-prism", "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4", _brown_conrady)
UNDISTORTING = tuple(
    _model(f"undistorting-{count}", names, _distorted, one_focal=True) for count, names in (
        (1, "k1"), (2, "k1 k2"), (3, "k1 k2 p1 p2 k3"), (6, "k1 k2 p1 p2 k3 k4 k5 k6")))
POLY3, POLY5 = (_model(name, names, _radial, one_focal=True) for name, names in (("poly3", "k1"), ("poly5", "k1 k2")))
PTLENS = _model("ptlens", "k1 k2 k3", _ptlens, one_focal=True)
KANNALA_BRANDT = _model("kannala-brandt", "k1 k2 k3 k4", _kannala_brandt, fisheye=True)
FTHETA = _model("ftheta", "k2 k3 k4", _ftheta, fisheye=True, one_focal=True)
FISHEYE_POLY5 = tuple(
    _model(f"poly5-{kind}", "k1 k2", _fisheye_poly5(projection), fisheye=True, one_focal=True)
    for kind, projection in LENSFUN_FISHEYES.items())
DOUBLE_SPHERE = _model("double-sphere", "xi alpha", _double_sphere, fisheye=True, start=(0.0, 0.5), limits=(-1.0, 1.0))
MODELS = {model.name: model for model in (
    PINHOLE, *RADIAL, RADTAN, BROWN_CONRADY, RATIONAL, THIN_PRISM, KANNALA_BRANDT, DOUBLE_SPHERE, *UNDISTORTING, POLY3,
    POLY5, PTLENS, *FISHEYE_POLY5, FTHETA)}
"""By name."""
