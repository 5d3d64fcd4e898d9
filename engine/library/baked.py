"""Lenses baked where they are used: what has been baked once is remembered in the user's cache folder."""

from collections.abc import Callable
from dataclasses import replace
from io import BytesIO

from .. import cache
from ..bake.bake import bake
from ..bake.prescription import Prescription
from ..bake.quality import QUALITIES
from ..bake.rings import AT_REST, Rings, turned
from ..errors import LensError
from ..lens.lens import Lens
from ..lens.readers.package import package_bytes, read_package
from ..values import digest_of

KIND, MOST_BYTES = "lenses", 2**29
ROOMS = "bake", "lens"  # whose code makes lens data
WAVELENGTHS_NM = (400, 410, 420, 430, 441, 453, 467, 482, 499, 518, 539, 562, 588, 618, 655, 700)
"""Denser in the blue, where glass and so blur change fastest."""


def baked_lens(prescription: Prescription, rings: Rings = AT_REST, quality: str = "standard",
               progress: Callable[[float, str], object] = lambda fraction, label: None) -> Lens:
    """Lens data of a prescription as it is turned, baked or remembered.

    Raises
    ------
    LensError
        As `turned` and `bake`.
    """
    if quality not in QUALITIES:
        raise LensError(prescription.name, "quality", quality, f"expected {', '.join(QUALITIES)}")
    there = turned(prescription, rings).prescription
    key = digest_of((cache.code_version(*ROOMS), there, quality))
    known = cache.recall(KIND, key)
    if known is None:
        known = package_bytes(bake(there, quality=quality, wavelengths_nm=WAVELENGTHS_NM, progress=progress))
        cache.remember(KIND, key, known, MOST_BYTES)
    return replace(read_package(BytesIO(known)), prescription=there)
