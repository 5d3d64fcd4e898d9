"""A camera that DLR CalLab has calibrated: its .cal file, OpenCV's equations, and the lens that it describes."""

import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Polynomial

from lensfield.engine.lens import RadialLens
from lensfield.engine.runtime.errors import InputError, LensError
from lensfield.engine.runtime.text import read_text
from lensfield.engine.runtime.values import Value

CAMERA = "camera.0."
VERSION, ORIGIN = "2", "center"  # places count from the middle of the upper left pixel
LINE = re.compile(r"^[ \t]*([\w.]+)[ \t]*=[ \t]*(.*?)[ \t]*(?:#.*)?$", re.MULTILINE)
PIXEL_MM = 0.005  # any: a calibration is in pixels
HEIGHTS = 65
LEAST_SLOPE = 0.1  # of distorted over undistorted tangents
SAMPLED, UNEXPRESSED_PX = 101, 0.02
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

    @property
    def principal_px(self):
        """Column and row of the axis."""
        return self.matrix_px[:2, 2]

    @property
    def farthest_px(self):
        """Distance from the axis of the frame's farthest corner."""
        edges_px = np.array([(-0.5, side - 0.5) for side in self.size_px])
        return float(np.hypot(*np.abs(edges_px - self.principal_px[:, None]).max(axis=1)))

    @property
    def distortion(self):
        """The distorted tangent as a Polynomial in the tangent, without tangential distortion."""
        k1, k2, k3 = self.radial
        return Polynomial([0, 1, 0, k1, 0, k2, 0, k3])

    @property
    def last_tangent(self):
        """Tangent of the angle at the end of the field: the frame's farthest corner, or before, where the polynomial
        is about to turn back."""
        corner = self.distortion - self.farthest_px / self.matrix_px[1, 1]
        return min(map(first_root, (corner, self.distortion.deriv() - LEAST_SLOPE)))

    def tangents(self, points):
        """Tangents of the angles of points in front of the camera, to the right and down: array (point, 2)."""
        x, y, z = ((points - self.place) @ self.rotation).T
        return np.stack([x / z, y / z], axis=1)

    def project(self, tangents):
        """Column and row of light, by OpenCV's equations: array (point, 2)."""
        x, y = tangents.T
        square, (p1, p2) = x**2 + y**2, self.tangential
        scale = Polynomial([1, *self.radial])(square)
        distorted = np.stack([scale * x + 2 * p1 * x * y + p2 * (square + 2 * x**2),
                              scale * y + p1 * (square + 2 * y**2) + 2 * p2 * x * y, np.ones_like(x)])
        return (self.matrix_px[:2] @ distorted).T

    def in_frame(self, tangents, margin_px=0.0):
        """Whether light lands in the frame, and at least this far from its edges: bool array (point,).

        Beyond the last tangent, the polynomial turns back into the frame, and light does not.
        """
        size_px = np.array(self.size_px)
        inside_px = size_px / 2 - np.abs(self.project(tangents) - (size_px - 1) / 2)
        return np.all(inside_px.T >= margin_px, axis=0) & (np.hypot(*tangents.T) <= self.last_tangent)

    @property
    def undistorted(self):
        """The pinhole camera with this place and matrix."""
        return replace(self, radial=(0.0, 0.0, 0.0), tangential=(0.0, 0.0))

    @property
    def unexpressed_px(self):
        """The largest distance in the frame between light by the calibration and by its rotationally symmetric part."""
        focal_px = self.matrix_px[1, 1]
        symmetric = replace(self, tangential=(0.0, 0.0), matrix_px=np.array(
            [[focal_px, 0, self.principal_px[0]], [0, focal_px, self.principal_px[1]], [0, 0, 1]]))
        across = np.linspace(-1, 1, SAMPLED) * self.last_tangent
        tangents = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
        tangents = tangents[symmetric.in_frame(tangents)]
        return float(np.hypot(*(self.project(tangents) - symmetric.project(tangents)).T).max())


def first_root(polynomial):
    """Its first positive zero; infinity without any."""
    roots = polynomial.trim().roots()
    return float(roots[np.isreal(roots) & (roots.real > 0)].real.min(initial=np.inf))


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
    """The lens with a calibration's radial distortion, and without shading: a RadialLens focused at infinity.

    Raises
    ------
    LensError
        More than 0.02 px of the calibration is not rotationally symmetric.
    """
    unexpressed_px, focal_mm = calibration.unexpressed_px, calibration.matrix_px[1, 1] * PIXEL_MM
    if unexpressed_px > UNEXPRESSED_PX:
        raise LensError(calibration.name, "A, p1, p2", f"{unexpressed_px:.2g} px without rotational symmetry",
                        f"expected at most {UNEXPRESSED_PX:g} px: square pixels, without tangential distortion")
    tangents = np.linspace(0, calibration.last_tangent, HEIGHTS)
    ones, psf = np.ones((1, HEIGHTS)), gaussian_psf()
    return RadialLens(
        name=calibration.name, efl_mm=focal_mm, magnification=0.0, f_number_effective=F_NUMBER,
        object_distance_mm=np.inf, entrance_pupil_mm=0.0,
        sensor_mm=tuple(PIXEL_MM * side for side in calibration.size_px), reference_wavelength_nm=WAVELENGTH_NM,
        wavelengths_nm=np.array([WAVELENGTH_NM]), heights_mm=focal_mm * tangents,
        real_height_mm=focal_mm * calibration.distortion(tangents)[None], relative_illumination=ones,
        psf=np.broadcast_to(psf, (1, HEIGHTS, *psf.shape)), psf_pitch_um=1e3 * PIXEL_MM / PER_PIXEL,
        enclosed_energy=ones, transmittance=np.ones(1))


def gaussian_psf():
    """A PSF of unit sum, up to four standard deviations: array (v, u)."""
    reach = round(4 * BLUR_PX * PER_PIXEL)
    along = np.exp(-(np.arange(-reach, reach + 1) / (BLUR_PX * PER_PIXEL))**2 / 2)
    psf = np.outer(along, along)
    return psf / psf.sum()
