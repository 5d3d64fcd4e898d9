"""The rays of a lens: traced through its prescription and remembered, or of first order where it has none."""

from functools import lru_cache
from io import BytesIO

import numpy as np

from .. import cache
from ..bake.first_order import first_order_rays
from ..bake.prescription import Prescription
from ..bake.ray_table import RayTable, ray_table
from ..lens.lens import Lens
from ..values import digest_of

KIND, MOST_BYTES = "rays", 2**28
ROOMS = ("bake",)  # whose code traces them
ARRAYS = "wavelengths_nm", "coefficients", "last_height_mm", "entrance_pupil_mm"


@lru_cache(maxsize=4)
def lens_rays(lens: Lens) -> RayTable:
    """The table of a lens's rays, by which it sees what is near or far, and what hides what.

    Raises
    ------
    LensError
        A prescription that cannot be traced.
    """
    return _traced(lens.prescription) if lens.prescription else first_order_rays(lens)


def _traced(prescription: Prescription) -> RayTable:
    key = digest_of((cache.code_version(*ROOMS), prescription))
    known = cache.recall(KIND, key)
    if known is None:
        table, stream = ray_table(prescription), BytesIO()
        np.savez(stream, **{name: getattr(table, name) for name in ARRAYS})
        known = stream.getvalue()
        cache.remember(KIND, key, known, MOST_BYTES)
    with np.load(BytesIO(known), allow_pickle=False) as archive:
        held = {name: archive[name] for name in ARRAYS}
    return RayTable(prescription.name, held["wavelengths_nm"], float(held["last_height_mm"]),
                    float(held["entrance_pupil_mm"]), held["coefficients"])
