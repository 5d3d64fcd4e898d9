"""Rays of a lens without a prescription, to first order: from its pupil, its focal lengths and its distortion.

All rays meet in the plane of focus, which may lean. With a squeeze, the light of a point is as wide at the viewpoint as
`entrance_pupil_size_mm`, wherever the pupils of both sections are, and its circle of confusion becomes an ellipse.
"""

import numpy as np

from ...lens.entrance_pupil import entrance_pupil_size_mm, focus_nearness
from ...lens.grid_lens import GridLens
from ...rays.grid_rays import GridRayTable, grid_coefficients, table_axes, table_pupil
from ..in_focus_rays import in_focus_rays, pupil_margin, table_wavelengths
from .geometry import GridGeometry


def first_order_rays(lens: GridLens, reach: float = 1.0) -> GridRayTable:
    """The table of rays of a lens with this lens's first-order data and distortion, and no other aberrations.

    Parameters
    ----------
    lens : GridLens
    reach : float
        `GridRayTable.reach`.
    """
    wavelengths_nm = table_wavelengths(lens.wavelengths_nm[0], lens.wavelengths_nm[-1])
    ends_mm, pupil = lens.inverted_ends_mm, table_pupil()
    y_mm, x_mm = table_axes(*ends_mm, lens.mirrored)
    fields = [GridGeometry(lens.at_wavelength(nm), lens.name) for nm in wavelengths_nm]
    ideal_mm = np.stack([field.source_mm(-x_mm[None, :], -y_mm[:, None]) for field in fields], axis=1)
    illumination = np.array([field.relative_illumination(-x_mm[None, :], -y_mm[:, None]) for field in fields])
    # axes from here on: x and y, wavelength, row, column, radius, azimuth
    ideal_mm, across = ideal_mm[..., None, None], np.reshape([lens.squeeze, 1.0], (2, 1, 1, 1, 1, 1))
    chief = -across * ideal_mm / lens.capture_focal_length_mm
    stop = reach * np.stack([pupil.x, pupil.y])
    pupil_mm = np.reshape(entrance_pupil_size_mm(lens), (2, 1, 1)) / 2 * stop
    light = illumination[..., None, None] / (4 * lens.rim_f_number**2)
    values = in_focus_rays(pupil_mm, chief, focus_nearness(lens, *ideal_mm), light,
                           pupil_margin(stop, lens.central_obstruction))
    return GridRayTable(lens.name, wavelengths_nm, *ends_mm, lens.mirrored, lens.entrance_pupil_mm,
                        grid_coefficients(values, lens.mirrored).astype(np.float32), reach)
