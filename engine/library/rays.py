"""The rays of a lens: traced through its prescription and cached, or to first order for a lens without one."""

from collections.abc import Callable
from functools import lru_cache
from io import BytesIO

import numpy as np

from ..field.field_map import field_map
from ..lens.lens import Lens
from ..prescription.prescription import Prescription
from ..rays.ray_table import RayTable, ray_table
from ..runtime import cache
from ..runtime.values import digest_of

KIND, MOST_BYTES = "rays", 2**28
ARRAYS = "wavelengths_nm", "coefficients", "last_height_mm", "entrance_pupil_mm", "reach"
REACHES = 8  # steps of `reach` per semi-aperture: irises with smaller differences at their corners share a table
ROUNDING = 1e-6
Rays = Callable[[Lens, float], RayTable]


@lru_cache(maxsize=4)
def lens_rays(lens: Lens, reach: float = 1.0) -> RayTable:
    """The table of a lens's rays, for blur by depth and for hidden surfaces.

    Parameters
    ----------
    lens : Lens
    reach : float
        The required radius of the rays in the stop, in semi-apertures: `Opening.reach`.

    Raises
    ------
    LensError
        The prescription cannot be traced.
    """
    reach = max(reach, np.ceil(REACHES * (reach - ROUNDING)) / REACHES)
    if not lens.prescription:
        return field_map(lens).first_order_rays(reach)
    return _traced(lens.prescription, _within_rim(lens.prescription, reach))


@lru_cache(maxsize=4)
def sketched_rays(lens: Lens, reach: float = 1.0) -> RayTable:
    """As `lens_rays`, but of few rays, for pixels that are much larger than its errors."""
    if not lens.prescription:
        return lens_rays(lens, reach)
    return ray_table(lens.prescription, reach=_within_rim(lens.prescription, reach), sketch=True)


def _within_rim(prescription, reach):
    return max(1.0, min(reach, prescription.stop_rim))


def _traced(prescription: Prescription, reach: float) -> RayTable:
    key = digest_of((prescription, reach))
    archive_bytes = cache.load(KIND, key)
    if archive_bytes is None:
        table, stream = ray_table(prescription, reach=reach), BytesIO()
        np.savez(stream, **{name: getattr(table, name) for name in ARRAYS})
        archive_bytes = stream.getvalue()
        cache.store(KIND, key, archive_bytes, MOST_BYTES)
    with np.load(BytesIO(archive_bytes), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in ARRAYS}
    return RayTable(prescription.name, arrays["wavelengths_nm"], float(arrays["last_height_mm"]),
                    float(arrays["entrance_pupil_mm"]), arrays["coefficients"], float(arrays["reach"]))
