"""The ghosts of a lens for a small source: its strongest pairs of surfaces, and where their light lands."""

from dataclasses import dataclass, replace

import numpy as np

from ..image.pixel_grid import PixelGrid
from ..image.sources import Sources
from ..lens import Lens
from ..lens.iris import Iris, opening
from ..prescription.coatings import IDEAL
from ..runtime.errors import LensError
from .ghosts import direct_light, ghosts
from .stray_light import no_ghosts

WIDTH_PX = 360
ROWS = 12


@dataclass(frozen=True)
class GhostRow:
    """The ghost of a pair of surfaces, on the sensor's frame.

    Attributes
    ----------
    surfaces : (int, int)
        Numbers of the surfaces that reflect, from 1, the front one first.
    share : float
        Its light, as a share of the light of the source that the lens transmits to its image on the axis.
    x_mm, y_mm : float
        Centroid from the middle of the sensor, to the right and up.
    radius_mm : float
        Radius of the disc with its second moment.
    """

    surfaces: tuple[int, int]
    share: float
    x_mm: float
    y_mm: float
    radius_mm: float


@dataclass(frozen=True, eq=False)
class GhostTable:
    """The ghosts of a point at infinity above the axis, in white light of equal energy.

    Attributes
    ----------
    angle_deg : float
        Between the point and the axis.
    rows : list of GhostRow
        The strongest ghosts, strongest first.
    total : float
        Light of all ghosts, as a share like `GhostRow.share`.
    irradiance : array (row, column)
        On the sensor, relative to the point's irradiance at the entrance pupil.
    """

    angle_deg: float
    rows: list[GhostRow]
    total: float
    irradiance: np.ndarray


def ghost_table(lens: Lens, angle_deg: float, iris: Iris | None = None, rows: int = ROWS) -> GhostTable:
    """Compute the table of a lens.

    Parameters
    ----------
    lens : Lens
        With a prescription.
    angle_deg : float
        Between the source and the axis.
    iris : Iris, optional
    rows : int
        Number of ghosts.

    Raises
    ------
    LensError
        The lens has no ghosts.
    """
    nm, prescription = lens.wavelengths_nm, lens.prescription
    word = no_ghosts(lens, nm)
    if word or prescription is None:  # which has a word
        raise LensError(lens.name, "ghosts", "none", word)
    grid, source = _grid(lens), _source(angle_deg, nm)
    found = _ghosts_of(lens, prescription, source, grid, iris)
    image = direct_light(prescription, _source(0.0, nm), opening(iris, lens))
    light = np.nansum(found.light, axis=(0, 2)) / image.sum()
    strongest = [index for index in np.argsort(-light, kind="stable")[:rows] if light[index]]
    table = [_row(lens, found.pairs[index], float(light[index]), source, grid, iris) for index in strongest]
    return GhostTable(angle_deg, table, float(light.sum()), found.irradiance.mean(axis=0))


def _ghosts_of(lens, prescription, source, grid, iris):
    return ghosts(prescription, source, grid, opening(iris, lens))


def _grid(lens):
    width_mm, height_mm = lens.sensor_mm
    return PixelGrid((round(WIDTH_PX * height_mm / width_mm), WIDTH_PX), width_mm / WIDTH_PX * 1e3)


def _source(angle_deg, wavelengths_nm):
    angle = np.radians(angle_deg)
    return Sources(np.array([[0.0, np.sin(angle), np.cos(angle)]]), np.array([np.inf]),
                   np.ones((1, len(wavelengths_nm))), wavelengths_nm, np.zeros(1), (f"{angle_deg:g} degrees",))


def _row(lens, pair, share, source, grid, iris):
    """A ghost's row. Its place is as for the only ghost of a lens whose other surfaces do not reflect."""
    coated = zip(lens.prescription.surfaces, lens.prescription.surface_coatings, strict=True)
    surfaces = tuple(replace(surface, coating=coating if number in pair else IDEAL)
                     for number, (surface, coating) in enumerate(coated, 1))
    only = _ghosts_of(lens, replace(lens.prescription, surfaces=surfaces), source, grid, iris)
    plane = only.irradiance.sum(axis=0, dtype=np.float64)
    x_mm, y_mm = grid.position_mm(*np.indices(plane.shape))
    total = max(plane.sum(), np.finfo(float).tiny)
    middle = [float((plane * place).sum() / total) for place in (x_mm, y_mm)]
    square = (plane * ((x_mm - middle[0]) ** 2 + (y_mm - middle[1]) ** 2)).sum() / total
    return GhostRow(tuple(pair.tolist()), share, *middle, float(np.sqrt(2 * square)))
