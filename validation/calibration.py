"""A camera that DLR CalLab has calibrated: its .cal file, OpenCV's equations, and the lens that it describes."""

import re
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lensfield.engine.calibration.models import BROWN_CONRADY
from lensfield.engine.measured.blur import Light
from lensfield.engine.measured.camera import ModelledCamera
from lensfield.engine.measured.lens import measured_lens
from lensfield.engine.runtime.errors import InputError, LensError
from lensfield.engine.runtime.text import read_text
from lensfield.engine.runtime.values import Value

CAMERA = "camera.0."
VERSION, ORIGIN = "2", "center"  # places count from the middle of the upper left pixel
LINE = re.compile(r"^[ \t]*([\w.]+)[ \t]*=[ \t]*(.*?)[ \t]*(?:#.*)?$", re.MULTILINE)
PIXEL_MM = 0.005  # any: a calibration is in pixels
SAME = 1e-6  # of tangents
WAVELENGTH_NM, F_NUMBER = 550.0, 8.0
BLUR_PX, PER_PIXEL = 0.8, 2
"""Standard deviation of a Gaussian PSF, and its samples in a pixel. Calibrations do not include blur, but in a
picture as sharp as its pixels, the corners that OpenCV finds depend on their positions in a pixel."""


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Value):
    """A camera and its place.

    Attributes
    ----------
    name : str
    size_px : (int, int)
        Columns and rows.
    matrix_px : array (3, 3)
        From distorted tangents to column and row.
    radial : (float, float, float)
        OpenCV's k1, k2 and k3.
    tangential : (float, float)
        OpenCV's p1 and p2.
    rotation : array (3, 3)
        From axes of the camera, to the right, down and forwards, to axes of the world.
    place : array (3,)
        Of the camera in the world.
    """

    name: str
    size_px: tuple[int, int]
    matrix_px: np.ndarray
    radial: tuple[float, float, float]
    tangential: tuple[float, float]
    rotation: np.ndarray
    place: np.ndarray

    @cached_property
    def camera(self):
        """The ModelledCamera with OpenCV's equations.

        Raises
        ------
        LensError
            The matrix has a skew.
        """
        (fx, skew, column), (_, fy, row), _ = self.matrix_px.tolist()
        if skew:
            raise LensError(self.name, "A", f"{skew:g} in its upper row", "expected 0 there: pixels without a skew")
        (k1, k2, k3), (p1, p2) = self.radial, self.tangential
        return ModelledCamera(self.name, "DLR CalLab", self.size_px, (fx, fy), (column, row), BROWN_CONRADY,
                              (k1, k2, p1, p2, k3))

    def tangents(self, points):
        """Tangents of the angles of points in front of the camera, to the right and down: array (point, 2)."""
        x, y, z = ((points - self.place) @ self.rotation).T
        return np.stack([x / z, y / z], axis=1)

    def project(self, tangents):
        """Column and row of light, by OpenCV's equations: array (point, 2)."""
        return self.camera.pixels(tangents)

    def in_frame(self, tangents, margin_px=0.0):
        """Whether light lands in the frame, and at least this far from its edges: bool array (point,).

        Beyond the end of the field, the polynomial turns back into the frame, and light does not.
        """
        size_px, landed_px = np.array(self.size_px), self.project(tangents)
        inside_px = size_px / 2 - np.abs(landed_px - (size_px - 1) / 2)
        inside = np.all(inside_px.T >= margin_px, axis=0)
        lit = np.zeros_like(inside)
        straight = self.camera.straight(landed_px[inside])
        lit[inside] = (straight.end >= 1) & np.all(np.abs(straight.tangents - tangents[inside]) < SAME, axis=1)
        return lit

    @property
    def undistorted(self):
        """The pinhole camera with this place and matrix."""
        return replace(self, radial=(0.0, 0.0, 0.0), tangential=(0.0, 0.0))


def read_calibration(path):
    """Read a .cal with one camera.

    Raises
    ------
    InputError
        A line is missing, or not as expected.
    """
    fields = dict(LINE.findall(read_text(path, InputError)))
    for name, value in (("version", VERSION), ("origin", ORIGIN)):
        if fields.get(name) != value:
            raise InputError(path, name, fields.get(name, "missing"), f"expected {value}")

    def numbers(name, *shape, default=None):
        text = fields.get(CAMERA + name, default)
        try:
            return np.array(text.strip("[] ").replace(";", " ").split(), dtype=float).reshape(shape)
        except (AttributeError, ValueError):
            raise InputError(path, CAMERA + name, "missing" if text is None else text,
                             f"expected {int(np.prod(shape))} numbers") from None

    coefficients = {name: float(numbers(name, default="0")) for name in ("k1", "k2", "k3", "p1", "p2")}
    return Calibration(path.stem, (int(numbers("width")), int(numbers("height"))), numbers("A", 3, 3),
                       tuple(coefficients[name] for name in ("k1", "k2", "k3")),
                       (coefficients["p1"], coefficients["p2"]), numbers("R", 3, 3), numbers("T", 3))


def calibrated_lens(calibration):
    """The lens with a calibration's distortion, focused at infinity, and without shading.

    Raises
    ------
    LensError
        As `measured_lens`.
    """
    sensor_mm = tuple(PIXEL_MM * side for side in calibration.size_px)
    return measured_lens(calibration.camera, sensor_mm, np.inf, lambda magnification: GaussianBlur())


class GaussianBlur:
    """A `Blur` by a Gaussian, up to four standard deviations, at one wavelength."""

    words, turns = f"blur by a Gaussian of {BLUR_PX:g} px", False
    last_mm = np.inf
    wavelengths_nm, transmittance = np.array([WAVELENGTH_NM]), np.ones(1)
    reference_nm, f_number_effective, pitch_um = WAVELENGTH_NM, F_NUMBER, 1e3 * PIXEL_MM / PER_PIXEL

    def at(self, distances_mm):
        """See `Blur`."""
        reach = round(4 * BLUR_PX * PER_PIXEL)
        along = np.exp(-(np.arange(-reach, reach + 1) / (BLUR_PX * PER_PIXEL))**2 / 2)
        psf, ones = np.outer(along, along) / along.sum()**2, np.ones((1, distances_mm.size))
        return Light(np.broadcast_to(psf, (1, distances_mm.size, *psf.shape)), ones, ones)
