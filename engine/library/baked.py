"""Lenses baked on demand, and cached in the user's cache folder."""

from collections.abc import Callable
from dataclasses import replace
from io import BytesIO

from ..bake.bake import bake
from ..bake.quality import QUALITIES
from ..lens.lens import Lens
from ..lens_files.package import package_bytes, read_package
from ..prescription.prescription import Prescription
from ..rays.rings import AT_REST, Rings, turned
from ..runtime import cache
from ..runtime.errors import LensError
from ..runtime.values import digest_of

KIND, MOST_BYTES = "lenses", 2**29
WAVELENGTHS_NM = (400, 410, 420, 430, 441, 453, 467, 482, 499, 518, 539, 562, 588, 618, 655, 700)
"""Denser in the blue, where refractive indices, and therefore blur, change fastest."""


def baked_lens(prescription: Prescription, rings: Rings = AT_REST, quality: str = "standard",
               progress: Callable[[float, str], object] = lambda fraction, label: None) -> Lens:
    """Lens data of a prescription with its rings set, baked or from the cache.

    Raises
    ------
    LensError
        As `turned` and `bake`.
    """
    if quality not in QUALITIES:
        raise LensError(prescription.name, "quality", quality, f"expected {', '.join(QUALITIES)}")
    fixed = turned(prescription, rings).prescription
    key = digest_of((fixed, quality))
    package = cache.load(KIND, key)
    if package is None:
        package = package_bytes(bake(fixed, quality=quality, wavelengths_nm=WAVELENGTHS_NM, progress=progress))
        cache.store(KIND, key, package, MOST_BYTES)
    return replace(read_package(BytesIO(package)), prescription=fixed)
