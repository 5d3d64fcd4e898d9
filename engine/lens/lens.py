"""Lens: what a lens-design program knows about a lens, as one frozen value."""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import make_interp_spline

from ..errors import LensError
from ..field.mirror_symmetry import mirror_symmetric

UNIT_SUM_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Lens:
    """Lens-design data of a rotationally symmetric lens, for one object distance (section 2.2.1 of the paper).

    Attributes
    ----------
    name, maker, story : str
        What it is; who designed or makes it; what it is known for.
    source, notes : str
        Where the figures come from; what is assumed.
    efl_mm : float
        Effective focal length.
    magnification : float
        Paraxial image height over object height; negative for a real image.
    f_number_effective : float
        0.5 / NA on the axis, in image space.
    object_distance_mm : float
        From the first surface to the object plane; inf for a lens focused at infinity.
    entrance_pupil_mm : float
        From the first surface to the entrance pupil, towards the image.
    sensor_mm : (float, float)
        Width and height of the sensor that the lens is made for.
    reference_wavelength_nm : float
    wavelengths_nm : array (wavelength,), ascending
    heights_mm : array (height,), ascending from 0
        Field heights, as *paraxial* image heights.
    real_height_mm : array (wavelength, height)
        Height at which the chief ray really meets the image plane.
    relative_illumination : array (wavelength, height)
        Irradiance relative to the axis, from a uniform Lambertian object plane.
    psf : float32 array (wavelength, height, v, u)
        Point spread functions of unit sum. The chief ray is at `[n // 2, n // 2]`; +v runs away from the axis
        (radially outwards), u along the tangent.
    psf_pitch_um : float
        Distance between PSF samples, the same along v and u.
    enclosed_energy : array (wavelength, height)
        Fraction of the light that the PSF window holds; NaN where not known.
    transmittance : array (wavelength,)
        T(wavelength) of Eq. 2.
    """

    name: str
    efl_mm: float
    magnification: float
    f_number_effective: float
    object_distance_mm: float
    entrance_pupil_mm: float
    sensor_mm: tuple[float, float]
    reference_wavelength_nm: float
    wavelengths_nm: np.ndarray
    heights_mm: np.ndarray
    real_height_mm: np.ndarray
    relative_illumination: np.ndarray
    psf: np.ndarray
    psf_pitch_um: float
    enclosed_energy: np.ndarray
    transmittance: np.ndarray
    maker: str = ""
    story: str = ""
    source: str = ""
    notes: str = ""

    def __post_init__(self):
        for field in fields(self):
            if field.type in ("np.ndarray", np.ndarray):
                kind = np.float32 if field.name == "psf" else np.float64
                value = np.array(getattr(self, field.name), dtype=kind)
                value.setflags(write=False)
                object.__setattr__(self, field.name, value)
        object.__setattr__(self, "sensor_mm", tuple(float(side) for side in self.sensor_mm))
        _check(self)
        object.__setattr__(self, "psf", _normalised(self.psf))

    @classmethod
    def load(cls, name_or_path):
        """Load a bundled lens by its name, or lens data from a file.

        Raises
        ------
        LensError
            No such lens, or a file that is damaged or of no known kind.
        """
        from . import load  # a door: readers build Lens values, so they cannot be imported first

        return load(name_or_path)

    @property
    def capture_focal_length_mm(self):
        """Image height over tangent of the object-side chief-ray angle: the pinhole camera with this lens's view.

        Seen from the entrance pupil an object of height y stands at the angle atan(y / (object distance +
        entrance pupil)), and its ideal image is |m| y high. At infinity this is the focal length.
        """
        if np.isinf(self.object_distance_mm):
            return self.efl_mm
        return abs(self.magnification) * (self.object_distance_mm + self.entrance_pupil_mm)

    @cached_property
    def mirror_symmetric(self):
        """Whether the PSFs are symmetric about the meridional plane, but for noise, as a centred lens's are."""
        return all(mirror_symmetric(psf)[1] for psf in self.psf)

    def scaled(self, factor):
        """A lens `factor` times as large, in focus at `factor` times the distance.

        Angles, f-number and magnification stay, and so do relative illumination and transmittance. Distortion and
        aberrations scale with the lens, and so does its whole PSF; diffraction does not, for wavelengths stay as they
        are. So what diffraction has spread is `factor` times too wide in the result: too wide in a larger lens, too
        narrow in a smaller one.

        Raises
        ------
        LensError
            The factor is no positive number.
        """
        if not 0 < factor < np.inf:
            raise LensError(self.name, "scale", factor, "expected a positive number")
        lengths = ("efl_mm", "object_distance_mm", "entrance_pupil_mm", "heights_mm", "real_height_mm", "psf_pitch_um")
        return replace(self, name=f"{self.name}, scaled by {factor:.4g}",
                       sensor_mm=tuple(factor * side for side in self.sensor_mm),
                       **{field: factor * getattr(self, field) for field in lengths})

    def at_wavelength(self, wavelength_nm):
        """Lens data for one wavelength.

        Heights and relative illumination, smooth in wavelength, follow a spline of up to third degree; PSFs and
        transmittance are interpolated linearly, so that they stay within their bounds.

        Raises
        ------
        LensError
            The wavelength lies outside the lens data.
        """
        below, weight = self.wavelength_position(wavelength_nm)
        psf = self.psf[below]
        if weight:
            psf = (1 - weight) * psf + weight * self.psf[below + 1]
        nm = float(np.clip(wavelength_nm, self.wavelengths_nm[0], self.wavelengths_nm[-1]))
        degree = min(3, self.wavelengths_nm.size - 1)

        def smooth(table):
            return make_interp_spline(self.wavelengths_nm, table, k=degree)(nm) if degree else table[0]

        return MonochromaticLens(nm, self.heights_mm, smooth(self.real_height_mm), smooth(self.relative_illumination),
                                 psf, self.psf_pitch_um, float(np.interp(nm, self.wavelengths_nm, self.transmittance)))

    def wavelength_position(self, wavelength_nm):
        """Between which of the lens data's wavelengths one lies: the index below it and the weight of the next.

        Raises
        ------
        LensError
            The wavelength lies outside the lens data.
        """
        low, high = self.wavelengths_nm[0], self.wavelengths_nm[-1]
        if not low - 1e-6 <= wavelength_nm <= high + 1e-6:
            raise LensError(self.name, "wavelength", f"{wavelength_nm:g} nm",
                            f"the lens data spans {low:g} to {high:g} nm")
        position = float(np.interp(wavelength_nm, self.wavelengths_nm, np.arange(self.wavelengths_nm.size)))
        return int(position), position % 1

    def wavelengths_around(self, wavelengths_nm):
        """The lens data's wavelengths between which, or at which, these lie: array, ascending."""
        positions = [self.wavelength_position(nm) for nm in wavelengths_nm]
        around = {below for below, _ in positions} | {below + 1 for below, weight in positions if weight}
        return self.wavelengths_nm[sorted(around)]


@dataclass(frozen=True, eq=False)
class MonochromaticLens:
    """Lens data at one wavelength: the tables of `Lens` without their wavelength axis."""

    wavelength_nm: float
    heights_mm: np.ndarray
    real_height_mm: np.ndarray
    relative_illumination: np.ndarray
    psf: np.ndarray
    psf_pitch_um: float
    transmittance: float


def _check(lens):
    """Raise a LensError that names the first field that cannot be right."""
    _check_numbers(lens)
    _check_shapes(lens)
    _check_tables(lens)
    _check_psfs(lens)


def _check_numbers(lens):
    for field in ("efl_mm", "f_number_effective", "object_distance_mm", "reference_wavelength_nm", "psf_pitch_um"):
        if not getattr(lens, field) > 0:
            raise LensError(lens.name, field, getattr(lens, field), "expected a positive number")
    for field in ("efl_mm", "f_number_effective", "magnification", "entrance_pupil_mm", "reference_wavelength_nm",
                  "psf_pitch_um"):
        if not np.isfinite(getattr(lens, field)):
            raise LensError(lens.name, field, getattr(lens, field), "expected a finite number")
    if lens.magnification == 0 and np.isfinite(lens.object_distance_mm):
        raise LensError(lens.name, "magnification", lens.magnification, "expected other than 0 at a finite distance")
    if len(lens.sensor_mm) != 2 or not min(lens.sensor_mm) > 0:
        raise LensError(lens.name, "sensor_mm", lens.sensor_mm, "expected a positive width and height")


def _check_shapes(lens):
    waves, heights = lens.wavelengths_nm.shape, lens.heights_mm.shape
    if len(waves) != 1 or waves[0] < 1:
        raise LensError(lens.name, "wavelengths_nm", f"of shape {waves}", "expected at least one wavelength")
    if len(heights) != 1 or heights[0] < 2:
        raise LensError(lens.name, "heights_mm", f"of shape {heights}", "expected at least two field heights")
    shapes = {"real_height_mm": waves + heights, "relative_illumination": waves + heights,
              "enclosed_energy": waves + heights, "transmittance": waves}
    for field, shape in shapes.items():
        if getattr(lens, field).shape != shape:
            raise LensError(lens.name, field, f"of shape {getattr(lens, field).shape}", f"expected {shape}")
    if lens.psf.ndim != 4 or lens.psf.shape[:2] != waves + heights or lens.psf.shape[2] != lens.psf.shape[3]:
        raise LensError(lens.name, "psf", f"of shape {lens.psf.shape}", f"expected {waves + heights} + (v, u), square")


def _check_tables(lens):
    for field in ("wavelengths_nm", "heights_mm", "real_height_mm", "relative_illumination", "transmittance", "psf"):
        if not np.all(np.isfinite(getattr(lens, field))):
            raise LensError(lens.name, field, "not finite", "expected numbers throughout")
    for field in ("wavelengths_nm", "heights_mm"):
        if np.any(np.diff(getattr(lens, field)) <= 0):
            raise LensError(lens.name, field, getattr(lens, field).tolist(), "expected ascending values")
    if lens.heights_mm[0] != 0:
        raise LensError(lens.name, "heights_mm", f"{lens.heights_mm[0]} first", "expected the axis, 0, first")
    if np.any(lens.relative_illumination < 0):
        raise LensError(lens.name, "relative_illumination", "negative", "expected 0 or more")
    if np.any(lens.transmittance < 0) or np.any(lens.transmittance > 1):
        raise LensError(lens.name, "transmittance", lens.transmittance.tolist(), "expected 0 to 1")


def _check_psfs(lens):
    if np.any(lens.psf < 0):
        raise LensError(lens.name, "psf", f"{lens.psf.min():g} at the least", "expected 0 or more")
    sums = lens.psf.sum(axis=(2, 3), dtype=np.float64)
    worst = np.unravel_index(np.argmax(np.abs(sums - 1)), sums.shape)
    if abs(sums[worst] - 1) > UNIT_SUM_TOLERANCE:
        raise LensError(lens.name, "psf", f"{sums[worst]:g} in sum at wavelength {worst[0]}, height {worst[1]}",
                        "expected unit sums")


def _normalised(psf):
    """PSFs of unit sum (Eq. 9); the same array where they are so to the last digit, that saving changes nothing."""
    sums = psf.sum(axis=(2, 3), keepdims=True, dtype=np.float64)
    if np.abs(sums - 1).max() < 1e-6:
        return psf
    psf = (psf / sums).astype(np.float32)
    psf.setflags(write=False)
    return psf
