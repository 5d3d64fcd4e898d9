"""Lenses baked on demand, and cached in the user's cache folder."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from io import BytesIO

import numpy as np

from ..bake.bake import bake
from ..bake.grid_ends import Ends, grid_ends_mm
from ..bake.quality import QUALITIES
from ..lens.lens import Lens
from ..lens_files.package import package_bytes, read_package
from ..prescription.prescription import Prescription
from ..prescription.system import system_of
from ..rays.focus import build_system
from ..rays.rings import AT_REST, Rings, turned
from ..rays.transmission import transmittance
from ..runtime import cache
from ..runtime.errors import LensError
from ..runtime.values import digest_of

KIND, MOST_BYTES = "lenses", 2**29
WAVELENGTHS_NM = (400, 410, 420, 430, 441, 453, 467, 482, 499, 518, 539, 562, 588, 618, 655, 700)
"""Denser in the blue, where refractive indices, and therefore blur, change fastest."""
Edges = tuple[float, float, float, float]
"""Left, lower, right and upper edge of a picture on the sensor, in mm from the axis: `PixelGrid.edges_mm`."""


def baked_lens(prescription: Prescription, rings: Rings = AT_REST, quality: str = "standard",
               progress: Callable[[float, str], object] = lambda fraction, label: None,
               wavelengths_nm: Sequence[float] | np.ndarray | None = None,
               edges_mm: Edges | None = None) -> Lens:
    """Lens data of a prescription with its rings set, baked or from the cache, for pictures with these wavelengths and
    edges, as for `load_lens`.

    Raises
    ------
    LensError
        As `turned` and `bake`.
    """
    if quality not in QUALITIES:
        raise LensError(prescription.name, "quality", quality, f"expected {', '.join(QUALITIES)}")
    fixed = turned(prescription, rings).prescription
    baked_nm, ends_mm = needed_wavelengths_nm(wavelengths_nm), needed_ends_mm(fixed, edges_mm)
    design = fixed.coated()
    key = digest_of((design, quality, baked_nm, *(ends_mm or ())))
    lens = cache.load(KIND, key, _of_package)
    if lens is None:
        package = package_bytes(bake(design, quality=quality, wavelengths_nm=baked_nm, ends_mm=ends_mm,
                                     progress=progress))
        cache.store(KIND, key, package, MOST_BYTES)
        lens = _of_package(package)
    return with_prescription(lens, fixed)


def _of_package(package):
    return read_package(BytesIO(package))


def with_prescription(lens: Lens, prescription: Prescription) -> Lens:
    """Lens data, which do not depend on coatings, with their prescription and the transmittance of its coatings."""
    return replace(lens, prescription=prescription,
                   transmittance=transmittance(system_of(prescription), lens.wavelengths_nm))


def needed_ends_mm(fixed: Prescription, edges_mm: Edges | None) -> Ends | None:
    """The ends of the grid of a lens, with its rings set, for pictures with these edges; None with rotational
    symmetry."""
    return None if fixed.radial else grid_ends_mm(build_system(fixed), edges_mm)


def needed_wavelengths_nm(wavelengths_nm: Sequence[float] | np.ndarray | None) -> tuple[float, ...]:
    """The wavelengths of a bake for pictures with these wavelengths in nm.

    These are the picture's own, between which nothing is interpolated; or, if these are more, the `WAVELENGTHS_NM` that
    enclose them. Without a picture, and for one beyond the range of `WAVELENGTHS_NM`, they are all of these.
    """
    if wavelengths_nm is None or not len(wavelengths_nm):
        return WAVELENGTHS_NM
    picture_nm = np.unique(wavelengths_nm)
    if not WAVELENGTHS_NM[0] <= picture_nm[0] <= picture_nm[-1] <= WAVELENGTHS_NM[-1]:
        return WAVELENGTHS_NM
    places = np.interp(picture_nm, WAVELENGTHS_NM, np.arange(len(WAVELENGTHS_NM)))
    around = np.unique(np.concatenate([np.floor(places), np.ceil(places)]).astype(int))
    if around.size < picture_nm.size:
        return tuple(WAVELENGTHS_NM[index] for index in around)
    return tuple(picture_nm.tolist())
