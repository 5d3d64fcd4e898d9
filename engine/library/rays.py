"""The rays of a lens: traced through its prescription and cached, or to first order for a lens without one."""

from collections.abc import Callable
from dataclasses import fields
from functools import lru_cache
from io import BytesIO

import numpy as np

from ..field.field_map import field_map
from ..lens import GridLens, Lens
from ..prescription.prescription import Prescription
from ..rays.grid_rays import GridRayTable, LensRays, grid_ray_table
from ..rays.ray_table import RayTable, ray_table
from ..runtime import cache
from ..runtime.values import digest_of

KIND, MOST_BYTES = "rays", 2**28
REACHES = 8  # steps of `reach` per semi-aperture: irises with smaller differences at their corners share a table
ROUNDING = 1e-6
Rays = Callable[[Lens, float], LensRays]


@lru_cache(maxsize=4)
def lens_rays(lens: Lens, reach: float = 1.0) -> LensRays:
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
    return _cached(lens, lens.prescription, _within_rim(lens.prescription, reach))


@lru_cache(maxsize=4)
def sketched_rays(lens: Lens, reach: float = 1.0) -> LensRays:
    """As `lens_rays`, but of few rays, for pixels that are much larger than its errors."""
    if not lens.prescription:
        return lens_rays(lens, reach)
    return _traced(lens, lens.prescription, _within_rim(lens.prescription, reach), sketch=True)


def _within_rim(prescription, reach):
    return max(1.0, min(reach, prescription.stop_rim))


def _traced(lens: Lens, prescription: Prescription, reach: float, *, sketch: bool = False) -> LensRays:
    if isinstance(lens, GridLens):
        return grid_ray_table(prescription, *lens.inverted_ends_mm, lens.mirrored, reach=reach, sketch=sketch)
    return ray_table(prescription, reach=reach, sketch=sketch)


def _cached(lens: Lens, prescription: Prescription, reach: float) -> LensRays:
    ends_mm = (lens.inverted_ends_mm, lens.mirrored) if isinstance(lens, GridLens) else ()
    key = digest_of((prescription.coated(), reach, *ends_mm))
    archive_bytes = cache.load(KIND, key)
    if archive_bytes is None:
        table, stream = _traced(lens, prescription, reach), BytesIO()
        np.savez(stream, **{name: getattr(table, name) for name in _arrays(type(table))})
        archive_bytes = stream.getvalue()
        cache.store(KIND, key, archive_bytes, MOST_BYTES)
    kind = GridRayTable if isinstance(lens, GridLens) else RayTable
    with np.load(BytesIO(archive_bytes), allow_pickle=False) as archive:
        return kind(prescription.name, **{name: _value(name, archive[name]) for name in _arrays(kind)})


def _arrays(kind):
    return [field.name for field in fields(kind) if field.name != "name"]


def _value(name, array):
    """A field of a table of rays from an array."""
    if name in ("wavelengths_nm", "coefficients"):
        return array
    return tuple(array.tolist()) if array.ndim else float(array)
