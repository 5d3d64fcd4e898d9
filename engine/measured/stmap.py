"""STMaps of any tracker or compositor: EXRs whose red and green (or U and V) are places in another picture.

Places run from 0 to 1 across the picture that the map leads into, t upwards or downwards, and a pixel's place is that
of its middle. A *distort* map has the pixels of the lens's picture, and leads to the undistorted one; an *undistort*
map has the pixels of the undistorted picture. The undistorted picture may be larger, about the same middle: by a data
window larger than the display window, or by a stated overscan.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from ..calibration.models import Model
from ..pictures.rgb_picture import flat_layers, lay_out, overscan_of
from ..pictures.spectral_exr import read_parts
from ..runtime.errors import InputError, LensError
from .camera import Measured, check_focal, check_size, pixel_mm
from .inverse import REACH, Straight, straight_places
from .options import MeasuredOptions

PAIRS = ("R", "G"), ("U", "V")
LINES = 257  # of the map along its longer side, through which splines lead: distortion is smooth
HALF_ROUNDING = 2**-12  # of a float of 16 bits from 0.5 to 1
FEW_STEPS = 4
DISTORT, UNDISTORT = "distort", "undistort"
NAMED = {UNDISTORT: ("undist", "unwarp"), DISTORT: ("dist", "warp")}


def direction_of(path: Path) -> str | None:
    """Whether a map's name says that it distorts or undistorts; None if it says neither."""
    return next((direction for direction, words in NAMED.items() if any(word in path.stem.lower() for word in words)),
                None)


def read_distort(path: Path, options: MeasuredOptions) -> Measured:
    """The camera of a map that distorts a picture."""
    return _DistortMap(path, _read(path), options)


def read_undistort(path: Path, options: MeasuredOptions) -> Measured:
    """The camera of a map that undistorts a picture."""
    return _UndistortMap(path, _read(path), options)


class _Map:
    """A `Measured` by a map."""

    width_mm, ending = None, "the map ends"

    def __init__(self, path, places, size_px, options):
        self.name, self.size_px, self.notes = path.stem, size_px, places.notes
        check_size(self.name, size_px)
        if options.focal_mm is None or options.sensor_mm is None:
            raise LensError(path, "focal length", "missing",
                            "an STMap states none: give it, and the sensor (--focal-length, --sensor)")
        self._focal_px = options.focal_mm / pixel_mm(self.name, options.sensor_mm, size_px)
        self.focal_px = self._focal_px, self._focal_px
        self.principal_px = (size_px[0] - 1) / 2, (size_px[1] - 1) / 2
        check_focal(self.name, self.focal_px)

    def _from_middle(self, pixels):
        return np.asarray(pixels, float) - self.principal_px


class _DistortMap(_Map):
    program = "distort STMap"

    def __init__(self, path, places, options):
        super().__init__(path, places, places.size_px, options)
        straight_px = (places.at - 0.5) * [round(side * options.overscan) for side in self.size_px]
        self._tangents = [_spline(places.middle_px, each / self._focal_px) for each in np.moveaxis(straight_px, -1, 0)]

    def straight(self, pixels: np.ndarray) -> Straight:
        """See `Measured`."""
        at = self._from_middle(pixels).T
        return Straight(np.stack([each(*at) for each in self._tangents], axis=-1), np.full(len(pixels), REACH))


class _UndistortMap(_Map):
    program = "undistort STMap"

    def __init__(self, path, places, options):
        columns, rows = (round(side / options.overscan) for side in places.size_px)
        super().__init__(path, places, (columns, rows), options)
        self._ends = [np.abs(line[[0, -1]]).min() + 0.5 for line in places.middle_px]
        across, down = (_spline(places.middle_px, each) for each in np.moveaxis(
            (places.at - 0.5) * self.size_px, -1, 0))

        def placed(x, y, z):
            at = self._focal_px * np.stack([x / z, y / z])
            return across(*at) / self._focal_px, down(*at) / self._focal_px

        self._model = Model("STMap", (), placed, ())

    def straight(self, pixels: np.ndarray) -> Straight:
        """See `Measured`. The field ends where the map does."""
        straight = straight_places(self._model, (), self._from_middle(pixels) / self._focal_px, FEW_STEPS)
        shares = np.abs(straight.tangents) * self._focal_px / self._ends
        return Straight(straight.tangents, np.minimum(straight.end, 1 / np.maximum(shares.max(axis=1), 1 / REACH)))


class _Places(NamedTuple):
    """A map.

    Attributes
    ----------
    at : array (row, column, 2)
        From 0 to 1 to the right and downwards, thinned.
    middle_px : (array, array)
        Columns and rows, from the middle of the map.
    size_px : (int, int)
        Of the map's frame.
    notes : tuple of str
    """

    at: np.ndarray
    middle_px: tuple[np.ndarray, np.ndarray]
    size_px: tuple[int, int]
    notes: tuple[str, ...]


def _read(path):
    """The _Places of a map."""
    s, t, header = _planes(path)
    notes = () if s.dtype != np.float16 else (
        f"The map has 16 bits: its places are rounded by up to {max(s.shape) * HALF_ROUNDING:.2g} px.",)
    overscan = overscan_of(header)
    s, t = (lay_out(plane, header, overscan, np.nan) for plane in (s, t))
    size_px = s.shape[1] - 2 * overscan[1], s.shape[0] - 2 * overscan[0]
    columns, rows = (np.unique(np.linspace(0, side - 1, max(5, round(LINES * side / max(s.shape)))).astype(int))
                     for side in s.shape[::-1])
    places = np.stack([s, t], axis=-1)[np.ix_(rows, columns)].astype(float)
    unknown = np.argwhere(~np.isfinite(places).all(axis=-1) | ~places.any(axis=-1))
    if unknown.size:
        row, column = unknown[0]
        raise LensError(path, "place", f"missing at column {columns[column]}, row {rows[row]}",
                        "expected places everywhere, below 0 and above 1 where light comes from outside the picture")
    if np.median(np.diff(places[..., 1], axis=0)) < 0:  # t counts upwards
        places[..., 1] = 1 - places[..., 1]
    for axis, name in ((1, "red"), (0, "green")):
        if np.any(np.diff(places[..., 1 - axis], axis=axis) <= 0):
            raise LensError(path, name, "not rising or falling evenly", "expected the places of a lens that does not "
                                                                       "fold or mirror its picture")
    return _Places(places, (columns - (s.shape[1] - 1) / 2, rows - (s.shape[0] - 1) / 2), size_px, notes)


def _planes(path):
    """The planes of s and t, float arrays, and their header."""
    try:
        layers = flat_layers(read_parts(path))
        found = [(header, planes[first], planes[second]) for header, planes in layers.values()
                 for first, second in PAIRS if first in planes and second in planes]
    except InputError as error:
        raise LensError(path, error.field, error.value, error.remedy) from None
    if len(found) != 1:
        raise LensError(path, "channels", ", ".join(layers) or "none",
                        "expected one layer with red and green, or U and V")
    header, s, t = found[0]
    return s, t, header


def _spline(middle_px, values):
    """A function of places from the middle, x and y, through the values of a map; linear beyond them."""
    columns, rows = middle_px
    spline = scipy.interpolate.RectBivariateSpline(rows, columns, values)

    def at(x, y):
        held_x, held_y = np.clip(x, columns[0], columns[-1]), np.clip(y, rows[0], rows[-1])
        return (spline.ev(held_y, held_x) + spline.ev(held_y, held_x, dy=1) * (x - held_x)
                + spline.ev(held_y, held_x, dx=1) * (y - held_y))

    return at
