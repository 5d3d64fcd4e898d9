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
AXES, QUANTITIES = {RayTable: 5, GridRayTable: 6}, 7  # of a table's coefficients
Rays = Callable[[Lens, float], LensRays]


@lru_cache(maxsize=4)
def lens_rays(lens: Lens, reach: float = 1.0) -> LensRays:
    """The table of a lens's rays, for blur by depth and for hidden surfaces.

    Parameters
    ----------
    lens : Lens
    reach : float
        The required radius of the rays in the stop, in semi-apertures; above 1 for the corners of an iris with blades.

    Returns
    -------
    RayTable or GridRayTable
        A GridRayTable of a lens without rotational symmetry. `psf_at_depth` takes a RayTable.

    Raises
    ------
    LensError
        The prescription cannot be traced.

    Examples
    --------
    >>> from lensfield import lens_rays, load_lens, psf_at_depth
    >>> rays = lens_rays(load_lens("tessar-50mm", quality="preview", wavelengths_nm=[550]))
    >>> psf_at_depth(rays, 550, height_mm=10.0, depth_mm=2000.0, pitch_um=10.0, samples=65).shape
    (65, 65)
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
    kind = GridRayTable if isinstance(lens, GridLens) else RayTable
    table = cache.load(KIND, key, lambda content: _table(kind, prescription.name, content))
    if table is None:
        table, stream = _traced(lens, prescription, reach), BytesIO()
        np.savez(stream, **{field.name: getattr(table, field.name) for field in _arrays(kind)})
        cache.store(KIND, key, stream.getvalue(), MOST_BYTES)
    return table


def _table(kind, name, content):
    """The table of rays in an archive's bytes."""
    with np.load(BytesIO(content), allow_pickle=False) as archive:
        table = kind(name, **{field.name: _value(field.type, archive[field.name]) for field in _arrays(kind)})
    shape, stored = table.coefficients.shape, table.coefficients.dtype
    if len(shape) != AXES[kind] or shape[:1] != table.wavelengths_nm.shape or shape[-1] != QUANTITIES or stored != "f4":
        raise ValueError("not the arrays of a table")
    return table


def _arrays(kind):
    return [field for field in fields(kind) if field.name != "name"]


def _value(kind, array):
    """A field of a table of rays from an array; raises an error for another type."""
    if kind is np.ndarray:
        return array
    if kind in (float, bool):
        return kind(array)
    first, last = array.tolist()
    return first, last
