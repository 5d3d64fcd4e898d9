"""Rays through the surfaces of a lens, and the search for rays from object points or to image points."""

from collections.abc import Sequence
from ctypes import Structure, byref
from dataclasses import dataclass

import numpy as np

from .arrays import address
from .declarations import NUMBERS, STRUCTURES
from .library import check, chosen

SYSTEM, TARGETS = STRUCTURES["system"], STRUCTURES["targets"]
ANGLE, OBJECT_HEIGHT, IMAGE_HEIGHT = (NUMBERS[kind] for kind in ("ANGLE", "OBJECT_HEIGHT", "IMAGE_HEIGHT"))
KINDS = {"": NUMBERS["BICONIC"], "y": NUMBERS["TOROID_Y"], "x": NUMBERS["TOROID_X"]}
"""Kinds of surfaces with two sections, by `Surface.profile`; 0 is a surface of revolution."""
QUANTITIES = 13


@dataclass(frozen=True, eq=False)
class TracedSurfaces:
    """The surfaces of a lens, in mm.

    Attributes
    ----------
    shapes : array (surface, 3 + even_terms + odd_terms)
        Curvature; conic constant; distance to the next surface or the image plane; coefficients of r^2, r^4 ... and of
        r, r^3 ...
    stop : int
        Index of the aperture stop.
    even_terms, odd_terms : int
    kinds : int64 array (surface,) or None
        0 or one of `KINDS`; None if all surfaces are of revolution, and so is
    sections : array (surface, 2 + even_terms) or None
        Curvature and conic constant along x, with those of `shapes` along y; and the p of each even term, for which r^2
        is replaced by (1 - p) x^2 + (1 + p) y^2.
    poses : array (surface + 1, 12) or None
        Offset, and the matrix of the tilt by rows, of each surface and of the image plane; None if all are on the axis.
    rectangles : int64 array (surface,) or None
        For a surface with a rectangular aperture, the row of the traced squares that x^2 is in, in front of y^2; 0 for
        another one. None without any.
    """

    shapes: np.ndarray
    stop: int
    even_terms: int
    odd_terms: int
    kinds: np.ndarray | None = None
    sections: np.ndarray | None = None
    poses: np.ndarray | None = None
    rectangles: np.ndarray | None = None

    @property
    def squares(self) -> int:
        """Number of squares of a traced ray."""
        return len(self.shapes) + 2 * (0 if self.rectangles is None else int(np.count_nonzero(self.rectangles)))

    def system(self, indices: np.ndarray) -> tuple[Structure, tuple[np.ndarray, ...]]:
        """The structure for the loops, with refractive indices (surface + 1,), and its arrays, which it points to."""
        shapes = np.ascontiguousarray(self.shapes, dtype=np.float64)
        indices = np.ascontiguousarray(indices, dtype=np.float64)
        surfaces, terms = len(shapes), (self.even_terms, self.odd_terms)
        system = SYSTEM(address(shapes, np.float64, (surfaces, 3 + sum(terms))),
                        address(indices, np.float64, (surfaces + 1,)), surfaces, self.stop, *terms,
                        _address_or_none(self.kinds, np.int64, (surfaces,)),
                        _address_or_none(self.sections, np.float64, (surfaces, 2 + self.even_terms)),
                        _address_or_none(self.poses, np.float64, (surfaces + 1, 12)),
                        _address_or_none(self.rectangles, np.int64, (surfaces,)))
        return system, (shapes, indices)


def _address_or_none(array, dtype, shape):
    return None if array is None else address(array, dtype, shape)


def trace(surfaces: TracedSurfaces, indices: np.ndarray, rays: Sequence[np.ndarray]
          ) -> tuple[np.ndarray, np.ndarray]:
    """Trace rays from the stop, back to the first surface and on to the image plane.

    Parameters
    ----------
    surfaces : TracedSurfaces
    indices : array (surface + 1,)
        Refractive indices in front of each surface and behind the last.
    rays : sequence of 4 arrays (ray,)
        x and y on the stop; slopes dx/dz and dy/dz in front of it.

    Returns
    -------
    array (13, ray)
        Position on the first surface (3) and direction in front of it (3); position on the image plane (3) and
        direction there (3); optical path from the first surface to the image plane. NaN for lost rays.
    array (square, ray)
        Squared heights at the surfaces, and x^2 and y^2 at those with rectangular apertures.

    Raises
    ------
    ValueError
        Sizes are invalid.
    """
    loops, variant = chosen()
    system, _arrays = surfaces.system(indices)
    starts = np.array(rays, dtype=np.float64)
    count = starts.shape[1]
    out = np.empty((QUANTITIES + surfaces.squares, count))
    check(loops.lf_trace(variant, byref(system), address(starts, np.float64, (4, count)), count,
                         address(out, np.float64)))
    return out[:QUANTITIES], out[QUANTITIES:]


def aim(surfaces: TracedSurfaces, indices: np.ndarray, kind: int, scale: float, targets: np.ndarray, guess: np.ndarray,
        places: np.ndarray, step: float) -> np.ndarray:
    """Slopes at the stop of rays from object points or to image points, by Broyden's method.

    Parameters
    ----------
    surfaces, indices
        As for `trace`.
    kind : int
        `ANGLE`, `OBJECT_HEIGHT` or `IMAGE_HEIGHT`.
    scale : float
        Of an object height: the object's distance in mm; of an image height: the length that errors are relative to.
    targets : array (2, field)
        Cosine and sine of angles; or heights in mm and zeros.
    guess : array (field,)
        Slopes of the chief rays.
    places : array (2, ray)
        Points of the stop in mm.
    step : float
        On the stop in mm, for derivatives.

    Returns
    -------
    array (3, field, ray)
        Slopes along x and y, and the largest error; NaN for lost rays.

    Raises
    ------
    ValueError
        Sizes are invalid.
    """
    loops, variant = chosen()
    system, _arrays = surfaces.system(indices)
    targets, places = np.ascontiguousarray(targets, dtype=np.float64), np.ascontiguousarray(places, dtype=np.float64)
    guess = np.ascontiguousarray(guess, dtype=np.float64)
    (fields,), rays = guess.shape, places.shape[1]
    out = np.empty((3, fields, rays))
    address(places, np.float64, (2, rays))
    request = TARGETS(address(targets, np.float64, (2, fields)), guess.ctypes.data, places[0].ctypes.data,
                      places[1].ctypes.data, fields, rays, kind, scale, step)
    check(loops.lf_aim(variant, byref(system), byref(request), address(out, np.float64)))
    return out
