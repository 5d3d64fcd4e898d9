"""The data of a lens without rotational symmetry: tables over x and y."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from ..runtime.errors import LensError
from ..runtime.values import Value
from .lens import Lens, check_ascending, check_finite
from .spline import Spline

LEAST_STEP = 1e-6  # of source_mm between adjacent nodes, relative to their distance: less is a folded picture


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class GridLens(Lens):
    """Lens-design data of a lens without rotational symmetry, for one plane of focus.

    The nodes of its tables are places on the sensor, where chief rays meet it, at every wavelength: the PSF of a pixel
    is a mixture of those of the four nodes around it. Between nodes, `source_mm` and the relative illumination follow
    splines.

    Attributes
    ----------
    y_mm, x_mm : arrays (row,) and (column,), ascending
        Places of the nodes, from the axis: x to the right and y upwards in the upright picture.
    mirrored : (bool, bool)
        Whether the upper and lower halves of the field, and the right and left ones, are mirror images; y_mm, or x_mm,
        then begins with 0.
    source_mm : array (wavelength, row, column, 2)
        x and y of the light that lands at a node, in an ideal image that fits on the sensor: `capture_focal_length_mm`
        times the tangent of its angle from the camera's axis along y, and this focal length over `squeeze` along x.
    within : array (row, column)
        Distance from the middle of the field relative to its end, at the reference wavelength; the lens data do not
        cover places with more than 1, and tables continue there.
    squeeze : float
        Focal length of the picture's height over the one of its width.
    focus_slope : (float, float)
        Rise of the inverse depth in focus, in 1/mm, with x and y of the ideal image, in mm: other than 0 if the plane
        of focus leans. Depth is along the camera's axis, from the entrance pupil.
    psf : float32 array (wavelength, row, column, v, u)
        +v points upwards, +u to the right.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import GridLens
    >>> y_mm, x_mm = np.linspace(-1.5, 1.5, 5), np.linspace(-2, 2, 7)
    >>> table, psf = np.ones((2, 5, 7)), np.zeros((2, 5, 7, 5, 5))
    >>> psf[..., 2, 2] = 1  # all light in the sample of the chief ray
    >>> lens = GridLens(
    ...     name="MINE", efl_mm=10.0, magnification=-0.1, f_number_effective=2.0, object_distance_mm=100.0,
    ...     entrance_pupil_mm=5.0, sensor_mm=(4.0, 3.0), reference_wavelength_nm=550.0, wavelengths_nm=[450.0, 650.0],
    ...     y_mm=y_mm, x_mm=x_mm, mirrored=(False, False), within=np.hypot(x_mm / 2, y_mm[:, None] / 1.5) / 1.5,
    ...     source_mm=table[..., None] * np.stack(np.meshgrid(x_mm, y_mm), axis=-1), relative_illumination=table,
    ...     psf=psf, psf_pitch_um=2.5, enclosed_energy=table, transmittance=np.ones(2))
    >>> lens.psf.shape  # (wavelength, row, column, v, u)
    (2, 5, 7, 5, 5)
    """

    y_mm: np.ndarray
    x_mm: np.ndarray
    mirrored: tuple[bool, bool]
    source_mm: np.ndarray
    within: np.ndarray
    squeeze: float = 1.0
    focus_slope: tuple[float, float] = field(default=(0.0, 0.0))

    AXES: ClassVar = ("y_mm", "x_mm")
    PLACE: ClassVar = "node"
    LENGTHS: ClassVar = (*Lens.LENGTHS, "y_mm", "x_mm", "source_mm")

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """See `Lens`."""
        shapes = super().shapes
        places = shapes["relative_illumination"]
        return shapes | {"source_mm": (*places, 2), "within": places[1:]}

    @property
    def middle(self) -> tuple[int, int]:
        """See `Lens`."""
        return int(np.argmin(np.abs(self.y_mm))), int(np.argmin(np.abs(self.x_mm)))

    @property
    def inverted_ends_mm(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ends of the nodes' y, and x, in the image as formed by the lens, upside down; from 0 along a mirror."""
        y_mm, x_mm = ((0.0, float(places[-1])) if mirrored else (-float(places[-1]), -float(places[0]))
                      for places, mirrored in zip((self.y_mm, self.x_mm), self.mirrored, strict=True))
        return y_mm, x_mm

    def at_wavelength(self, wavelength_nm: float) -> "MonochromaticGrid":
        """Lens data for one wavelength. Positions are interpolated as the relative illumination is.

        Raises
        ------
        LensError
            The wavelength is outside the range of the lens data.
        """
        tables = self._tables_at(wavelength_nm)
        return MonochromaticGrid(y_mm=self.y_mm, x_mm=self.x_mm, mirrored=self.mirrored, within=self.within,
                                 source_mm=self._source_spline(tables["wavelength_nm"]), **tables)

    def scaled(self, factor: float) -> Self:
        """See `Lens.scaled`."""
        along_x, along_y = self.focus_slope
        per_square = factor**2  # per mm of depth, and per mm of places
        return replace(super().scaled(factor), focus_slope=(along_x / per_square, along_y / per_square))

    @cached_property
    def _source_spline(self):
        return Spline.through(self.wavelengths_nm, self.source_mm)

    def _check_axes(self):
        object.__setattr__(self, "mirrored", tuple(map(bool, self.mirrored)))
        object.__setattr__(self, "focus_slope", tuple(map(float, self.focus_slope)))
        if len(self.mirrored) != 2:
            raise LensError(self.name, "mirrored", self.mirrored, "expected whether the field is mirrored, in y and x")
        if len(self.focus_slope) != 2 or not np.isfinite(self.focus_slope).all():
            raise LensError(self.name, "focus_slope", self.focus_slope, "expected two finite numbers")
        if not 0 < self.squeeze < np.inf:
            raise LensError(self.name, "squeeze", self.squeeze, "expected a positive number")
        for name, mirrored in zip(self.AXES, self.mirrored, strict=True):
            places = getattr(self, name)
            if places.ndim != 1 or places.size < 2:
                raise LensError(self.name, name, f"of shape {places.shape}", "expected at least two places")
            check_finite(self, (name,))
            check_ascending(self, name)
            if places[0] > 0 or places[-1] <= 0 or mirrored and places[0] != 0:
                raise LensError(self.name, name, places.tolist(), "expected places from 0, the axis, outwards"
                                if mirrored else "expected places on both sides of the axis")

    def _check_landing(self):
        check_finite(self, ("source_mm", "within"))
        for number, (name, axis) in enumerate((("y_mm", 1), ("x_mm", 2))):
            rise = np.diff(self.source_mm[..., 1 - number], axis=axis)
            steps = np.diff(getattr(self, name)).reshape((-1, 1) if axis == 1 else (-1,))
            if np.any(rise <= LEAST_STEP * steps):
                raise LensError(self.name, "source_mm", f"not rising with {name}",
                                "distortion must be monotonic over the field in use")


@dataclass(frozen=True, eq=False, repr=False)
class MonochromaticGrid(Value):
    """Lens data at one wavelength: the tables of `GridLens` without their wavelength axis."""

    wavelength_nm: float
    y_mm: np.ndarray
    x_mm: np.ndarray
    mirrored: tuple[bool, bool]
    source_mm: np.ndarray
    relative_illumination: np.ndarray
    point_flux: np.ndarray
    within: np.ndarray
    psf: np.ndarray
    psf_pitch_um: float
    transmittance: float
