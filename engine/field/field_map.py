"""FieldMap: a lens as a function of the place (x, y) on its sensor.

Code outside this room asks a `FieldMap` where light lands, how bright it is, and for its PSF and rays, in x and y from
the optical axis, x to the right and y upwards. The geometry behind it, such as the field heights and azimuths of a
rotationally symmetric lens, is known to its implementation alone: in `radial`, or in `grid` for all other lenses.
`field_map` chooses.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..image.pixel_grid import PixelGrid
from ..image.sampling import Sampling
from ..kernels.casting import HeightRays, MeshRays
from ..lens import GridLens, Lens, RadialLens
from ..rays.grid_rays import LensRays
from ..runtime.memory import MemoryBudget
from .grid.field import GridFieldMap
from .mirror_symmetry import Planes
from .radial.field import RadialFieldMap
from .ray_blur import CaptureView, RayReach, Tiles

Place = Any
"""Places in the field, as the tables of their own field map count them."""


class Fit(Protocol):
    """How well a smooth function fits the lens data: a polynomial at the data, or a spline between them."""

    @property
    def order(self) -> int: ...
    @property
    def residual(self) -> float: ...
    @property
    def highest_order(self) -> int: ...


class PsfSet(Protocol):
    """The PSFs of a lens at one wavelength, on pixels of one pitch."""

    @property
    def nbytes(self) -> int: ...

    def trimmed(self, energy: float, radius_px: int | None = None) -> "PsfSet":
        """The PSFs trimmed to the smallest circles that contain this fraction of each."""

    def halo(self, energy: float, wider_energy: float, radius_px: int) -> "PsfSet":
        """The light between two such circles."""


class PlacedPsfs(Protocol):
    """PSFs at the pixels of planes, by rows and columns of a plane."""

    @property
    def planes(self) -> Planes: ...
    @property
    def nbytes(self) -> int: ...
    @property
    def extent_mm(self) -> float:
        """Distance from the axis that the lens data reach."""

    def place(self, rows: np.ndarray, columns: np.ndarray) -> Place:
        """Places in the field where the light of these pixels comes from."""

    def psfs(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """PSFs of these pixels: float64 array (n, row, column), unit sums, the chief ray in the middle."""


class Cells(Protocol):
    """The cells between the nodes of a table of PSFs, at one wavelength."""

    radius_px: int
    mean_distance_px: float

    @property
    def nbytes(self) -> int: ...

    def corners(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """The nodes around places, and their weights, 0 to 1 and of unit sum: int and float arrays (corner, place)."""

    def mean_offsets_px(self, place: Place) -> np.ndarray:
        """Mean offset of light from the chief ray, downwards and to the right: array (2, place)."""


class Table(Cells, Protocol):
    """A table of PSFs in plain arrays."""

    rows: np.ndarray
    columns: np.ndarray

    def mixed(self, place: Place) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """PSFs at places: rows and columns of their taps, and array (tap, place)."""

    def node_psfs(self, nodes: Sequence[int] | np.ndarray) -> np.ndarray:
        """PSFs of nodes: array (node, row, column), odd square, the chief ray in the middle."""


@runtime_checkable
class PackedTable(Cells, Protocol):
    """A table of PSFs for the compiled loops of its field map."""

    def places(self, psfs: Any) -> Any:
        """Positions of the pixels of these placed PSFs among the table's nodes."""

    def spread(self, places: Any, first_row: int, light: np.ndarray, lit: np.ndarray, section_px: int) -> np.ndarray:
        """Spread the light of a row of sections, (plane, row, column), that starts at this row."""

    def spread_at_once(self, places: Any, light: np.ndarray, lit: np.ndarray,
                       section_px: int) -> tuple[np.ndarray, str] | None:
        """Spread the light of all sections, and name the graphics processor; None if it does not do this."""


class NodePsfs(Protocol):
    """The PSFs for the tables of one wavelength."""

    def table(self) -> Table: ...

    def packed(self) -> PackedTable | None:
        """The table for the compiled loops; None if they do not support these PSFs."""


class NodePsfsByWavelength(Protocol):
    """The same for several wavelengths, which share PSFs of the lens data."""

    def at_wavelength(self, wavelength_nm: float) -> NodePsfs: ...


class TableLayout(Protocol):
    """The size of tables of PSFs on pixels of one pitch, which determines their cost.

    Attributes
    ----------
    psfs : int
        PSFs of the lens data at a wavelength.
    window_um, sample_um : float
        Sides of a PSF of the lens data, and of its samples, at the resolution that the pixels require.
    """

    @property
    def psfs(self) -> int: ...
    @property
    def window_um(self) -> float: ...
    @property
    def sample_um(self) -> float: ...

    def extra_counts(self, pixels: float) -> dict[str, float]:
        """Amounts of the kinds of work that only such lens data require, for a plane of this many pixels: a dict with
        names of `cost.NANOSECONDS`."""

    def turned(self, steps: int) -> int:
        """How many times all PSFs of the lens data are turned for a table with this number of steps."""

    def nodes(self, steps: int, planes: Planes) -> int:
        """Number of nodes of a table."""

    def nodes_around(self, steps: int, planes: Planes, section_px: int) -> tuple[float, float]:
        """Number of nodes around the sections of a plane: summed over the sections, and without duplicates."""


class PicturePsfs(Protocol):
    """The PSFs of a lens on the pixels of a picture, for the choice of a plan."""

    def reach(self, energy: float) -> tuple[int, float]:
        """Radius in pixels of PSFs trimmed to this energy, and the mean number of pixels that they cover."""

    def mixing(self, energy: float, planes: Planes) -> Iterator[Any]:
        """The data for `mixing_error` of each wavelength, for PSFs trimmed to this energy."""

    def mixing_error(self, wavelengths: list[Any], steps: int) -> float:
        """Largest error of trimmed PSFs mixed from a table with these steps."""

    def mixing_estimate(self, wavelength: Any, steps: int) -> float:
        """As `mixing_error` for one wavelength, approximate, and in a fraction of the time."""

    def one_psf_error(self, energy: float, planes: Planes, enough: float) -> float:
        """Largest error of one trimmed PSF for the complete field, or some error above `enough`."""

    def uniform_light_error(self) -> float:
        """Largest relative error of a pixel under uniform radiance, because each pixel has one PSF."""


class RaySample(Protocol):
    """Some rays of a sensor's pixels."""

    def fringe_px(self, nearness: float) -> int:
        """Largest distance between the wavelengths of a ray, up to an inverse depth."""

    def area_px(self, nearness: float) -> float:
        """Largest area of the blur of the open stop at an inverse depth, in square pixels."""

    def known_places(self, right_px: np.ndarray, up_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nearest places, relative to the axis, that the rays are known for: others have the rays of these."""

    def bundles(self, right_px: np.ndarray,
                up_px: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The rays of the shortest wavelength at places relative to the axis.

        Returns
        -------
        far_px, moved_px : arrays (..., ray, 2)
            Their positions at infinity in the plane of an ideal image, to the right and up, in pixels; and the change
            of these with the inverse depth, in pixels times mm.
        light : array (..., ray)
            Light within the rims of the lens's surfaces.
        stop : array (2, ..., ray)
            Their positions in the stop, to the right and up, in semi-apertures.
        """

    def reach(self, nearness: np.ndarray, axis_px: tuple[float, float], view: CaptureView, tiles: Tiles) -> RayReach:
        """The reach of the rays of tiles in a layer that is as near as this, with the axis at `axis_px`."""


class PixelRays(Protocol):
    """The rays of a lens from the pixels of a sensor."""

    def sample(self, wavelengths_nm: np.ndarray, focal_mm: float, count: int, reach: float) -> RaySample:
        """Rays for a capture of this focal length, through the stop out to `reach`; `count` is one of `RAY_COUNTS`."""

    def packed(self, wavelengths_nm: np.ndarray, focal_mm: float, counts: Sequence[int],
               reach: float) -> HeightRays | MeshRays:
        """Sets of rays of these counts, for the compiled loops."""

    def irradiance_per_radiance(self, wavelength_nm: float) -> np.ndarray:
        """Irradiance per uniform radiance by all rays, without the glass's losses: float32 array (row, column)."""


class IdealImage(Protocol):
    """Converts planes of radiance to irradiance before the blur."""

    def irradiance(self, radiance: np.ndarray) -> np.ndarray:
        """Distorted irradiance of a plane of radiance: array (plane, row, column)."""


class MonochromaticField(Protocol):
    """A lens at one wavelength, as a function of the place on its sensor: x_mm and y_mm are arrays that broadcast."""

    transmittance: float

    @property
    def nbytes(self) -> int: ...
    @property
    def distortion(self) -> Fit: ...
    @property
    def illumination(self) -> Fit: ...

    def source_mm(self, x_mm: np.ndarray, y_mm: np.ndarray,
                  capture: PixelGrid | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Position in a capture of the light that lands here; by default in an ideal image on the sensor."""

    def landing_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position on the sensor of light that is here in an ideal image: the inverse of `source_mm`."""

    def relative_illumination(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Irradiance of a uniform scene's picture, relative to the axis; constant beyond the lens data."""

    def relative_flux(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Irradiance of a uniform scene's picture before PSFs spread it, as relative_illumination."""

    def within(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Whether the lens data cover these positions."""

    def share_beyond(self, frame: PixelGrid) -> float:
        """The fraction of a frame's pixels that are beyond the lens data, unless these end where the light does."""

    def psfs(self, part: Callable[[Any], Any], planes: Planes) -> PlacedPsfs:
        """A part of the PSFs, such as the trimmed ones, at the pixels of planes."""

    def ideal_image(self, capture: PixelGrid, planes: Planes, *, vignette: bool, precision: str,
                    memory: MemoryBudget) -> IdealImage:
        """The ideal image of a capture on planes."""


class FieldMap(Protocol):
    """A lens as a function of the place on its sensor and of the wavelength."""

    @property
    def rotationally_symmetric(self) -> bool:
        """Whether tables of PSFs have a number of steps; otherwise they contain the nodes of the lens data."""

    @property
    def mirror_symmetric(self) -> bool:
        """Whether the four quadrants about the axis share all of the optics."""

    @property
    def extent_mm(self) -> float:
        """Distance from the axis that the lens data reach at all wavelengths."""

    @property
    def light_extent_mm(self) -> float:
        """Distance from the axis beyond which no light arrives; inf unless the lens data reach it."""

    def at_wavelength(self, wavelength_nm: float) -> MonochromaticField: ...

    def covered_diagonal(self, sensor_mm: tuple[float, float]) -> float:
        """The fraction of a sensor's diagonal that the lens data cover at the reference wavelength, up to 1; and 1 if
        they end where the light does."""

    def overscan_px(self, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
                    psf_radius_px: int) -> tuple[int, int]:
        """Rows and columns that a capture needs beyond its frame, for distortion and the reach of the PSFs."""

    def reach_px(self, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray, psf_radius_px: int) -> int:
        """Largest distance in pixels between light in a capture and on the frame."""

    def psf_radius_px(self, pitch_um: float) -> int:
        """Pixels that untrimmed PSFs reach from the pixel of the chief ray."""

    def table_wavelengths(self, sampling: Sampling) -> Sequence[float] | np.ndarray:
        """The wavelengths with tabulated PSFs, which are sufficient for the errors of all wavelengths."""

    def layout(self, pitch_um: float) -> TableLayout: ...

    def node_psfs(self, sampling: Sampling, planes: Planes, part: Callable[[Any], Any], steps: int,
                  precision: str) -> NodePsfsByWavelength:
        """The PSFs for tables with this number of steps; 0 unless the lens is rotationally symmetric."""

    def picture_psfs(self, sampling: Sampling, most_energy: float) -> PicturePsfs:
        """The PSFs on a picture's pixels, trimmed to `most_energy` at least."""

    def first_order_rays(self, reach: float) -> LensRays:
        """The rays of a lens without aberrations except its distortion, for lenses without a prescription."""

    def packed_ray_values(self, count: int, wavelengths: int) -> int:
        """Maximum number of values in the result of `PixelRays.packed`, for sets of up to this many rays."""

    def pixel_rays(self, table: Any, sensor: PixelGrid) -> PixelRays:
        """The rays of a table of this lens's kind from the pixels of a sensor, out to the scene."""


def field_map(lens: Lens) -> FieldMap:
    """The field map of a lens."""
    if isinstance(lens, GridLens):
        return GridFieldMap(lens)
    assert isinstance(lens, RadialLens)
    return RadialFieldMap(lens)
