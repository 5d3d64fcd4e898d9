"""SpectralImage: radiance or irradiance, one plane per wavelength."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import ImageError

RADIANCE = "radiance"
IRRADIANCE = "irradiance"
PLANE, FISHEYE = "plane", "equidistant"
PROJECTIONS = PLANE, FISHEYE
UNITS = {RADIANCE: "W.m^-2.sr^-1.nm^-1", IRRADIANCE: "W.m^-2.nm^-1"}


@dataclass(frozen=True, eq=False)
class SpectralImage:
    """A spectral image on the sensor's pixel grid.

    A radiance image is the scene as an ideal (paraxial, distortion-free) lens would lay it on the sensor.

    Attributes
    ----------
    cube : float32 array (wavelength, row, column)
        W m^-2 sr^-1 nm^-1 (radiance) or W m^-2 nm^-1 (irradiance); row 0 is the top of the upright picture.
    wavelengths_nm : float64 array (wavelength,)
        Ascending.
    pitch_um : float
        Distance between pixel centres at the sensor, the same in x and y.
    centre_px : (float, float)
        Row and column, in index terms, where the optical axis meets the cube; the middle by default.
    quantity : "radiance" or "irradiance"
    overscan_px : (int, int)
        Rows and columns by which the cube extends beyond the sensor's frame on each side.
    projection : "plane" or "equidistant"
        What a radiance image was captured with; see `capture.image_radius`.
    lens_name : str
        The lens that an irradiance image was made with, else "".
    f_number_effective : float or None
        That lens's effective f-number, which relates irradiance to radiance (Eq. 2).
    """

    cube: np.ndarray
    wavelengths_nm: np.ndarray
    pitch_um: float
    centre_px: tuple[float, float] | None = None
    quantity: str = RADIANCE
    overscan_px: tuple[int, int] = (0, 0)
    projection: str = "plane"
    lens_name: str = ""
    f_number_effective: float | None = None

    def __post_init__(self):
        cube = np.asarray(self.cube, dtype=np.float32)
        wavelengths = np.atleast_1d(np.asarray(self.wavelengths_nm, dtype=np.float64))
        if cube.ndim == 2:
            cube = cube[None]
        if cube.ndim != 3 or 0 in cube.shape:
            raise ImageError("image", "cube", f"of shape {cube.shape}", "expected (wavelength, row, column)")
        if wavelengths.shape != cube.shape[:1]:
            raise ImageError("image", "wavelengths_nm", f"{wavelengths.size} long",
                             f"expected one for each of the {cube.shape[0]} planes")
        if not np.all(np.isfinite(wavelengths)) or np.any(wavelengths <= 0) or np.any(np.diff(wavelengths) <= 0):
            raise ImageError("image", "wavelengths_nm", wavelengths.tolist(), "expected positive and ascending")
        for field in ("pitch_um", "f_number_effective"):
            value = getattr(self, field)
            if not (_is_positive(value) or (value is None and field == "f_number_effective")):
                raise ImageError("image", field, value, "expected a positive number")
        if self.projection not in PROJECTIONS:
            raise ImageError("image", "projection", self.projection, f"expected one of {', '.join(PROJECTIONS)}")
        if self.quantity not in UNITS:
            raise ImageError("image", "quantity", self.quantity, f"expected one of {', '.join(UNITS)}")
        rows, columns = cube.shape[1:]
        overscan = tuple(int(n) for n in self.overscan_px)
        if min(overscan) < 0 or 2 * overscan[0] >= rows or 2 * overscan[1] >= columns:
            raise ImageError("image", "overscan_px", overscan, f"expected less than half of {rows} x {columns} px")
        centre = ((rows - 1) / 2, (columns - 1) / 2) if self.centre_px is None else self.centre_px
        if np.shape(centre) != (2,) or not np.all(np.isfinite(np.asarray(centre, dtype=float))):
            raise ImageError("image", "centre_px", centre, "expected a row and a column")
        object.__setattr__(self, "cube", cube)
        object.__setattr__(self, "wavelengths_nm", wavelengths)
        object.__setattr__(self, "pitch_um", float(self.pitch_um))
        object.__setattr__(self, "centre_px", tuple(float(c) for c in centre))
        object.__setattr__(self, "overscan_px", overscan)

    @property
    def frame_px(self):
        """Rows and columns of the sensor's frame."""
        return tuple(n - 2 * margin for n, margin in zip(self.cube.shape[1:], self.overscan_px))

    @property
    def centred(self):
        """Whether the optical axis meets the middle, so that four mirrored quadrants share all of the optics."""
        return all(abs(centre - (n - 1) / 2) < 1e-9 for centre, n in zip(self.centre_px, self.cube.shape[1:]))

    def frame(self):
        """The image cropped to the sensor's frame."""
        return self.cropped(self.overscan_px)

    def cropped(self, margin_px):
        """The image without `margin_px` (rows, columns) on each side, taken from its overscan."""
        rows, columns = margin_px
        cube = self.cube[:, rows:self.cube.shape[1] - rows, columns:self.cube.shape[2] - columns]
        return replace(self, cube=cube, overscan_px=(self.overscan_px[0] - rows, self.overscan_px[1] - columns),
                       centre_px=(self.centre_px[0] - rows, self.centre_px[1] - columns))


def _is_positive(value):
    return isinstance(value, (int, float, np.number)) and np.isfinite(value) and value > 0


def pixel_position_mm(rows, columns, centre_px, pitch_um):
    """Image-plane coordinates, x to the right and y upwards, of positions in index terms."""
    return (columns - centre_px[1]) * pitch_um * 1e-3, (centre_px[0] - rows) * pitch_um * 1e-3


def pixel_axes_mm(shape_px, centre_px, pitch_um):
    """x_mm (column,) and y_mm (row,) of the pixel centres of a grid of (rows, columns)."""
    return pixel_position_mm(np.arange(shape_px[0]), np.arange(shape_px[1]), centre_px, pitch_um)
