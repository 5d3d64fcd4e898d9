"""Lens: the data of a lens-design program about a lens, as one frozen value."""

import sys
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from ..prescription.prescription import Prescription
from ..runtime.errors import LensError, printable
from ..runtime.values import Value
from .spline import Spline

UNIT_SUM_TOLERANCE = 1e-3
LARGEST = 1e15  # limit for every figure except an infinite distance: larger figures overflow in later steps
TEXTS = ("name", "maker", "story", "source", "notes")
FIRST_ORDER = ("efl_mm", "magnification", "f_number_effective", "object_distance_mm", "entrance_pupil_mm",
               "reference_wavelength_nm")
NUMBERS = (*FIRST_ORDER, "psf_pitch_um", "central_obstruction")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Lens(Value):
    """Lens-design data for one object distance (section 2.2.1 of the paper).

    Its subclasses add the tables over the field: `RadialLens` over heights, for rotationally symmetric lenses, and
    `GridLens` over x and y, for all others. Arrays are read-only copies.

    Attributes
    ----------
    name, maker, story : str
        The name of the lens; its designer or maker; why it is known.
    source, notes : str
        The source of the figures; assumptions.
    efl_mm : float
        Effective focal length.
    magnification : float
        Paraxial image height over object height; negative for a real image.
    f_number_effective : float
        0.5 / NA on the axis, in image space, of a pupil without a hole that has the same area.
    object_distance_mm : float
        From the first surface to the object plane; inf for a lens focused at infinity.
    entrance_pupil_mm : float
        From the first surface to the entrance pupil, towards the image.
    sensor_mm : (float, float)
        Width and height of the sensor that the lens is designed for.
    reference_wavelength_nm : float
    wavelengths_nm : array (wavelength,), ascending
    relative_illumination : array (wavelength, *place)
        Irradiance relative to the axis, from a uniform Lambertian object plane, at the places in the field of the
        subclass.
    psf : float32 array (wavelength, *place, v, u)
        Point spread functions of unit sum. The chief ray is at `[n // 2, n // 2]`.
    psf_pitch_um : float
        Distance between PSF samples, the same along v and u.
    enclosed_energy : array (wavelength, *place)
        Fraction of the light within the PSF window; NaN if unknown.
    transmittance : array (wavelength,)
        T(wavelength) of Eq. 2.
    central_obstruction : float
        Diameter of a mirror lens's hole in the pupil, relative to the diameter of the pupil; 0 by default.
    point_flux : array (wavelength, *place)
        All light that the lens collects from a point of that plane, divided by the light that follows from the f-number
        and the relative illumination at its chief ray. It differs from 1 by a few hundredths at wide apertures, where
        coma moves that much light, and for colours with another f-number. 1 by default, if unknown.
    prescription : Prescription or None
        The prescription that the tables were baked from, with focus and f-stop set, for tracing rays. None for tables
        alone.

    Examples
    --------
    >>> from lensfield import load_lens
    >>> lens = load_lens("edmund-54852")
    >>> f"{lens.efl_mm:.2f} mm, f/{lens.f_number_effective:.2f}, sensor {lens.sensor_mm} mm"
    '6.00 mm, f/1.88, sensor (4.8, 3.6) mm'
    >>> lens.psf.shape  # (wavelength, height, v, u)
    (16, 63, 73, 73)
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
    relative_illumination: np.ndarray
    psf: np.ndarray
    psf_pitch_um: float
    enclosed_energy: np.ndarray
    transmittance: np.ndarray
    central_obstruction: float = 0.0
    point_flux: np.ndarray = field(default_factory=lambda: np.ones(()))
    maker: str = field(default="", repr=False)
    story: str = field(default="", repr=False)
    source: str = field(default="", repr=False)
    notes: str = field(default="", repr=False)
    prescription: Prescription | None = field(default=None, repr=False)

    AXES: ClassVar[tuple[str, ...]] = ()
    """The coordinates of places in the field: a field for each axis of the tables."""
    PLACE: ClassVar[str] = "place"
    """What a place in the field is called in messages."""
    LENGTHS: ClassVar[tuple[str, ...]] = ("efl_mm", "object_distance_mm", "entrance_pupil_mm", "psf_pitch_um")
    """Fields that are as many times larger for a larger lens."""

    def __post_init__(self) -> None:
        _check_kinds(self)
        for text in TEXTS:
            object.__setattr__(self, text, printable(getattr(self, text)))
        if np.ndim(self.point_flux) == 0:
            object.__setattr__(self, "point_flux", np.full_like(self.relative_illumination, self.point_flux, float))
        for one in fields(self):
            if one.type is np.ndarray:
                table = _protected(getattr(self, one.name), np.float32 if one.name == "psf" else np.float64)
                object.__setattr__(self, one.name, table)
        object.__setattr__(self, "sensor_mm", tuple(float(side) for side in self.sensor_mm))
        _check_numbers(self)
        self._check_axes()
        _check_shapes(self)
        self._check_landing()
        _check_tables(self)
        object.__setattr__(self, "psf", _normalised(self.psf, _checked_psf_sums(self)))
        super().__post_init__()

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shapes of tables that are not axes or PSFs, by name."""
        waves, places = self.wavelengths_nm.shape, tuple(getattr(self, axis).size for axis in self.AXES)
        return {name: waves + places for name in ("relative_illumination", "enclosed_energy", "point_flux")} | {
            "transmittance": waves}

    @property
    def middle(self) -> tuple[int, ...]:
        """Indices of the place on the axis, or next to it."""
        raise NotImplementedError

    def _check_axes(self) -> None:
        """Raise a LensError for the first invalid coordinate."""
        raise NotImplementedError

    def _check_landing(self) -> None:
        """Raise a LensError if chief rays land where no lens images them."""
        raise NotImplementedError

    @property
    def squeeze(self) -> float:
        """Focal length across over focal length along the picture's width: 1 without anamorphic elements."""
        return 1.0

    @property
    def focus_slope(self) -> tuple[float, float]:
        """Rise of the inverse depth in focus, in 1/mm, with x and y of the ideal image, in mm: 0 unless the plane of
        focus leans."""
        return 0.0, 0.0

    @property
    def rim_f_number(self) -> float:
        """0.5 / NA of the pupil's rim: less than `f_number_effective`, whose pupil has the same area, with a central
        obstruction."""
        return self.f_number_effective * float(np.sqrt(1 - self.central_obstruction**2))

    @property
    def capture_focal_length_mm(self) -> float:
        """Image height over tangent of the object-side chief-ray angle: the pinhole camera with this lens's view.

        From the entrance pupil, an object of height y appears at the angle atan(y / (object distance + entrance
        pupil)), and its ideal image is |m| y high. At infinity this is the focal length. It is the one of the picture's
        height; along its width, a squeezed picture has this focal length over `squeeze`.
        """
        if np.isinf(self.object_distance_mm):
            return self.efl_mm
        return abs(self.magnification) * (self.object_distance_mm + self.entrance_pupil_mm)

    def scaled(self, factor: float) -> Self:
        """A lens `factor` times as large, in focus at `factor` times the distance.

        Angles, f-number and magnification stay the same, and so do relative illumination and transmittance. Distortion
        and aberrations scale with the lens. The complete PSF is scaled with them, but true diffraction would not be,
        because wavelengths stay the same. The diffraction blur of the result is therefore off by `factor`: too wide in
        a larger lens, too narrow in a smaller one.

        Raises
        ------
        LensError
            The factor is not a positive finite number.
        """
        if not 0 < factor < np.inf:
            raise LensError(self.name, "scale", factor, "expected a positive number")
        width_mm, height_mm = self.sensor_mm
        design = self.prescription
        return replace(self, name=f"{self.name}, scaled by {factor:.4g}",
                       sensor_mm=(factor * width_mm, factor * height_mm),
                       prescription=design and replace(
                           design.scaled(factor), object_distance_mm=factor * design.object_distance_mm,
                           sensor_mm=design.sensor_mm and (factor * design.sensor_mm[0], factor * design.sensor_mm[1])),
                       **{length: factor * getattr(self, length) for length in self.LENGTHS})

    def _tables_at(self, wavelength_nm: float) -> dict[str, Any]:
        """The tables of all lenses at one wavelength, by name, for `at_wavelength` of the subclasses.

        Relative illumination and point flux, which are smooth in wavelength, follow a spline of up to third degree.
        PSFs and transmittance are interpolated linearly, to stay within their bounds.
        """
        below, weight = self.wavelength_position(wavelength_nm)
        psf = self.psf[below]
        if weight:
            psf = (1 - weight) * psf + weight * self.psf[below + 1]
        nm = float(self.nearest_nm(wavelength_nm))
        return {"wavelength_nm": nm, "relative_illumination": self._illumination_spline(nm),
                "point_flux": self._flux_spline(nm), "psf": psf, "psf_pitch_um": self.psf_pitch_um,
                "transmittance": float(np.interp(nm, self.wavelengths_nm, self.transmittance))}

    @cached_property
    def _illumination_spline(self):
        return Spline.through(self.wavelengths_nm, self.relative_illumination)

    @cached_property
    def _flux_spline(self):
        return Spline.through(self.wavelengths_nm, self.point_flux)

    def nearest_nm(self, wavelengths_nm: ArrayLike) -> np.ndarray:
        """The wavelengths clipped to the range of the lens data."""
        return np.clip(wavelengths_nm, self.wavelengths_nm[0], self.wavelengths_nm[-1])

    def wavelength_position(self, wavelength_nm: float) -> tuple[int, float]:
        """Position of a wavelength in the lens data: the index of the one below it, and the weight of the next.

        Raises
        ------
        LensError
            The wavelength is outside the range of the lens data.
        """
        low, high = self.wavelengths_nm[0], self.wavelengths_nm[-1]
        if not low - 1e-6 <= wavelength_nm <= high + 1e-6:
            raise LensError(self.name, "wavelength", f"{wavelength_nm:g} nm",
                            f"the lens data spans {low:g} to {high:g} nm")
        position = float(np.interp(wavelength_nm, self.wavelengths_nm, np.arange(self.wavelengths_nm.size)))
        return int(position), position % 1

    def wavelengths_around(self, wavelengths_nm: Iterable[float]) -> np.ndarray:
        """The lens data's wavelengths that equal or enclose these: array, ascending."""
        positions = [self.wavelength_position(nm) for nm in wavelengths_nm]
        around = {below for below, _ in positions} | {below + 1 for below, weight in positions if weight}
        return self.wavelengths_nm[sorted(around)]


def _protected(table, dtype):
    """The table as an array that nothing else can change: a copy, unless it belongs to another lens."""
    of_lens = type(table) is np.ndarray and table.dtype == dtype and not table.flags.writeable
    return table if of_lens and table.flags.c_contiguous else np.array(table, dtype)


def _check_kinds(lens):
    for name in TEXTS:
        if not isinstance(getattr(lens, name), str):
            raise LensError("lens", name, getattr(lens, name), "expected a string")
    for name in NUMBERS:
        if not _is_number(getattr(lens, name)):
            raise LensError(lens.name, name, getattr(lens, name), "expected a number")
    if not np.iterable(lens.sensor_mm) or not all(map(_is_number, lens.sensor_mm)):
        raise LensError(lens.name, "sensor_mm", lens.sensor_mm, "expected a positive width and height")


def _is_number(value):
    """Whether this is a number within the range of a float, including NaN and infinity."""
    return (isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
            and not (isinstance(value, int) and abs(value) > sys.float_info.max))


def _check_numbers(lens):
    for name in ("efl_mm", "f_number_effective", "object_distance_mm", "reference_wavelength_nm", "psf_pitch_um"):
        if not getattr(lens, name) > 0:
            raise LensError(lens.name, name, getattr(lens, name), "expected a positive number")
    for name in NUMBERS:
        if name != "object_distance_mm" and not np.isfinite(getattr(lens, name)):
            raise LensError(lens.name, name, getattr(lens, name), "expected a finite number")
        if LARGEST < abs(getattr(lens, name)) < np.inf:
            raise LensError(lens.name, name, getattr(lens, name), f"expected at most {LARGEST:g}")
    if not 0 <= lens.central_obstruction < 1:
        raise LensError(lens.name, "central_obstruction", lens.central_obstruction, "expected 0, or less than 1")
    if lens.magnification == 0 and np.isfinite(lens.object_distance_mm):
        raise LensError(lens.name, "magnification", lens.magnification, "expected other than 0 at a finite distance")
    if len(lens.sensor_mm) != 2 or not all(0 < side <= LARGEST for side in lens.sensor_mm):
        raise LensError(lens.name, "sensor_mm", lens.sensor_mm, "expected a positive width and height")


def _check_shapes(lens):
    waves = lens.wavelengths_nm.shape
    if len(waves) != 1 or waves[0] < 1:
        raise LensError(lens.name, "wavelengths_nm", f"of shape {waves}", "expected at least one wavelength")
    for name, shape in lens.shapes.items():
        if getattr(lens, name).shape != shape:
            raise LensError(lens.name, name, f"of shape {getattr(lens, name).shape}", f"expected {shape}")
    places = lens.shapes["relative_illumination"]
    if lens.psf.ndim != len(places) + 2 or lens.psf.shape[:-2] != places or lens.psf.shape[-2] != lens.psf.shape[-1]:
        raise LensError(lens.name, "psf", f"of shape {lens.psf.shape}", f"expected {places} + (v, u), square")


def check_finite(lens: Lens, names: Iterable[str]) -> None:
    """Raise a LensError for the first table with numbers that are not finite, or too large."""
    for name in names:
        least, most = (float(end(getattr(lens, name), initial=0)) for end in (np.min, np.max))
        if not np.isfinite([least, most]).all():  # a NaN propagates to both
            raise LensError(lens.name, name, "not finite", "expected only finite numbers")
        if max(-least, most) > LARGEST:
            raise LensError(lens.name, name, f"up to {max(-least, most):g}", f"expected at most {LARGEST:g}")


def check_ascending(lens: Lens, name: str) -> None:
    """Raise a LensError unless a table's values ascend."""
    if np.any(np.diff(getattr(lens, name)) <= 0):
        raise LensError(lens.name, name, getattr(lens, name).tolist(), "expected ascending values")


def _check_tables(lens):
    check_finite(lens, ("wavelengths_nm", "relative_illumination", "transmittance", "point_flux", "psf"))
    check_ascending(lens, "wavelengths_nm")
    if lens.wavelengths_nm[0] <= 0:
        raise LensError(lens.name, "wavelengths_nm", lens.wavelengths_nm.tolist(), "expected positive nanometres")
    for name in ("relative_illumination", "point_flux"):
        table = getattr(lens, name)
        if np.any(table < 0):
            raise LensError(lens.name, name, f"{table.min():g} at its minimum", "expected 0 or more")
        if np.any(table[:, *lens.middle] == 0):
            raise LensError(lens.name, name, "0 on the axis", "expected light on the axis")
    if np.any(lens.transmittance < 0) or np.any(lens.transmittance > 1):
        raise LensError(lens.name, "transmittance", lens.transmittance.tolist(), "expected 0 to 1")
    if not lens.transmittance.any():
        raise LensError(lens.name, "transmittance", "0 at all wavelengths", "expected light at one wavelength or more")


def _checked_psf_sums(lens):
    """The sums of the PSFs, array (wavelength, *place)."""
    if lens.psf.min() < 0:
        raise LensError(lens.name, "psf", f"{lens.psf.min():g} at its minimum", "expected 0 or more")
    sums = lens.psf.sum(axis=(-2, -1), dtype=np.float64)
    worst = np.unravel_index(np.argmax(np.abs(sums - 1)), sums.shape)
    if abs(sums[worst] - 1) > UNIT_SUM_TOLERANCE:
        wavelength, *place = worst
        raise LensError(lens.name, "psf", f"{sums[worst]:g} in total at wavelength {wavelength}, "
                        f"{lens.PLACE} {', '.join(map(str, place))}", "expected PSFs that sum to 1")
    return sums


def _normalised(psf, sums):
    """PSFs of unit sum (Eq. 9). An array already normalised to rounding is returned as is, so saving preserves it."""
    if np.abs(sums - 1).max() < 1e-6:
        return psf
    return (psf / sums[..., None, None]).astype(np.float32)
