"""SpectralImage: radiance or irradiance, one plane per wavelength."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.errors import ImageError
from ..runtime.numbers import is_positive
from .detail import Detail, merged
from .pixel_grid import PixelGrid, check_focal_length
from .projection import Projection
from .sampling import Sampling

RADIANCE = "radiance"
IRRADIANCE = "irradiance"
UNITS = {RADIANCE: "W.m^-2.sr^-1.nm^-1", IRRADIANCE: "W.m^-2.nm^-1"}


@dataclass(frozen=True, eq=False, init=False)
class SpectralImage:
    """A spectral image on the sensor's pixel grid.

    A radiance image is the scene as an ideal (paraxial, distortion-free) lens would image it on the sensor.

    Parameters
    ----------
    cube : array (wavelength, row, column), or (row, column) for a single wavelength
    wavelengths_nm : sequence of float, ascending
    grid : PixelGrid, optional
    pitch_um, centre_px, overscan_px, projection, squeeze : optional
        Attributes of the grid, to use instead of a grid or to override its values.
    quantity, lens_name, f_number_effective, focal_mm, exposure, detail, arbitrary
        See below.

    Attributes
    ----------
    cube : float32 array (wavelength, row, column)
        W m^-2 sr^-1 nm^-1 (radiance) or W m^-2 nm^-1 (irradiance); row 0 is the top of the upright picture.
    wavelengths_nm : float64 array (wavelength,)
        Ascending.
    grid : PixelGrid
        Its pixels in the sensor's plane. `pitch_um`, `centre_px`, `overscan_px`, `projection`, `squeeze` and
        `frame_px` are also properties of the image.
    quantity : "radiance" or "irradiance"
    lens_name : str
        The lens of an irradiance image; "" for radiance.
    f_number_effective : float or None
        That lens's effective f-number, which relates irradiance to radiance (Eq. 2).
    focal_mm : float or None
        Focal length of the pinhole that captured a radiance image. Together with the pitch it defines the field of
        view.
    exposure : float
        The renderer's film exposure: pictures are multiplied by it to be as bright as in the renderer.
    detail : Detail or None
        The distribution of light inside the pixels of a radiance image; None if each pixel is even.
    arbitrary : bool
        Whether it is only proportional to watts, by an unknown factor, like most RGB pictures.

    Raises
    ------
    ImageError
        A part is invalid, or parts do not match.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import SpectralImage
    >>> points = np.zeros((2, 24, 32), "float32")
    >>> points[:, 12, 16] = 1  # W m^-2 sr^-1 nm^-1, in a single pixel
    >>> image = SpectralImage(points, wavelengths_nm=[450, 550], pitch_um=15)
    >>> image.quantity, image.frame_px, image.pitch_um
    ('radiance', (24, 32), 15.0)
    """

    cube: np.ndarray
    wavelengths_nm: np.ndarray
    grid: PixelGrid
    quantity: str
    lens_name: str
    f_number_effective: float | None
    focal_mm: float | None
    exposure: float
    detail: Detail | None
    arbitrary: bool

    def __init__(self, cube: ArrayLike, wavelengths_nm: ArrayLike, grid: PixelGrid | None = None, *,
                 quantity: str = RADIANCE, lens_name: str = "", f_number_effective: float | None = None,
                 focal_mm: float | None = None, exposure: float = 1.0, pitch_um: float | None = None,
                 centre_px: Sequence[float] | None = None, overscan_px: Sequence[int] | None = None,
                 projection: Projection | None = None, squeeze: float | None = None, detail: Detail | None = None,
                 arbitrary: bool = False) -> None:
        cube = np.asarray(cube, dtype=np.float32)
        wavelengths = np.atleast_1d(np.asarray(wavelengths_nm, dtype=np.float64))
        if cube.ndim == 2:
            cube = cube[None]
        if cube.ndim != 3 or 0 in cube.shape:
            raise ImageError("image", "cube", f"of shape {cube.shape}", "expected (wavelength, row, column)")
        if wavelengths.shape != cube.shape[:1]:
            raise ImageError("image", "wavelengths_nm", f"{wavelengths.size} long",
                             f"expected one for each of the {cube.shape[0]} planes")
        check_capture("image", wavelengths, focal_mm, exposure)
        if f_number_effective is not None and not is_positive(f_number_effective):
            raise ImageError("image", "f_number_effective", f_number_effective, "expected a positive number")
        if not isinstance(lens_name, str):
            raise ImageError("image", "lens_name", lens_name, "expected a string")
        if quantity not in UNITS:
            raise ImageError("image", "quantity", quantity, f"expected one of {', '.join(UNITS)}")
        parts = {"pitch_um": pitch_um, "centre_px": centre_px, "overscan_px": overscan_px, "projection": projection,
                 "squeeze": squeeze}
        given: dict[str, Any] = {name: part for name, part in parts.items() if part is not None}
        if grid is None:
            grid = PixelGrid(cube.shape[1:], **{"pitch_um": None} | given)
        elif not isinstance(grid, PixelGrid):
            raise ImageError("image", "grid", grid, "expected a PixelGrid; pass a pitch by keyword, pitch_um=")
        else:
            grid = replace(grid, **given)
        if grid.shape_px != cube.shape[1:]:
            raise ImageError("image", "cube", f"of {cube.shape[1:]} px", f"expected {grid.shape_px}, as in its grid")
        if detail is not None and detail.shape_px != grid.shape_px:
            raise ImageError("image", "detail", f"of {detail.shape_px} px", f"expected {grid.shape_px}")
        for name, value in (("cube", cube), ("wavelengths_nm", wavelengths), ("grid", grid), ("quantity", quantity),
                            ("lens_name", lens_name), ("f_number_effective", f_number_effective),
                            ("focal_mm", focal_mm), ("exposure", float(exposure)), ("detail", detail),
                            ("arbitrary", bool(arbitrary))):
            object.__setattr__(self, name, value)

    @property
    def pitch_um(self) -> float:
        return self.grid.pitch_um

    @property
    def centre_px(self) -> tuple[float, float]:
        return self.grid.centre_px

    @property
    def overscan_px(self) -> tuple[int, int]:
        return self.grid.overscan_px

    @property
    def projection(self) -> Projection:
        return self.grid.projection

    @property
    def squeeze(self) -> float:
        return self.grid.squeeze

    @property
    def frame_px(self) -> tuple[int, int]:
        """Rows and columns of the sensor's frame."""
        return self.grid.frame_px

    @property
    def sampling(self) -> Sampling:
        """Its pixels, in columns of the sensor, and its wavelengths."""
        return Sampling(self.grid.on_sensor(), tuple(self.wavelengths_nm.tolist()))

    @property
    def detail_times(self) -> int:
        """Parts of a pixel, down and across, whose light is known."""
        return self.detail.times if self.detail else 1

    @property
    def light(self) -> np.ndarray:
        """An array (wavelength, row, column) that is stored where the image is: in memory or in a file."""
        return self.cube

    def even(self) -> "SpectralImage":
        """The image without its detail."""
        return replace(self, detail=None)

    def frame(self) -> "SpectralImage":
        """The image cropped to the sensor's frame."""
        return self.cropped(self.overscan_px)

    def cropped(self, margin_px: Sequence[int]) -> "SpectralImage":
        """The image without `margin_px` (rows, columns) on each side, taken from its overscan."""
        rows, columns = margin_px
        inside = slice(rows, self.cube.shape[1] - rows), slice(columns, self.cube.shape[2] - columns)
        return replace(self, cube=self.cube[:, *inside], grid=self.grid.cropped(margin_px),
                       detail=self.detail and self.detail.within(*inside))

    def coarser(self, times: int) -> "SpectralImage":
        """Radiance in pixels that each merge `times` x `times` of these, with the detail of all wavelengths.

        A sensor has these pixels, and its lens image is as sharp as the radiance.

        Raises
        ------
        ImageError
            Frame or overscan is not a whole number of such pixels.
        """
        grid = self.grid.coarser(times)
        return replace(self, cube=merged(self.cube, times), grid=grid,
                       detail=Detail.of(self.cube, self.wavelengths_nm, times))


def check_irradiance(image: SpectralImage) -> None:
    """Raise an ImageError if an image is not irradiance in W m^-2 nm^-1."""
    if image.quantity != IRRADIANCE:
        raise ImageError("image", "quantity", image.quantity, "expected irradiance, from a lens")
    if image.arbitrary:
        raise ImageError("image", "units", "arbitrary", "expected W m^-2 nm^-1: `photograph` scales other light")


def check_capture(where: str, wavelengths_nm: np.ndarray, focal_mm: float | None, exposure: float) -> None:
    """Raise an ImageError that names the first invalid figure of a capture."""
    nm = wavelengths_nm
    if not np.all(np.isfinite(nm)) or np.any(nm <= 0) or np.any(np.diff(nm) <= 0):
        raise ImageError(where, "wavelengths_nm", nm.tolist(), "expected positive and ascending")
    if focal_mm is not None:
        check_focal_length(where, focal_mm)
    if exposure != 0 and not is_positive(exposure):
        raise ImageError(where, "exposure", exposure, "expected 0 or more")
