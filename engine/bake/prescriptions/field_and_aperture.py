"""Field points of other programs' files: the field ends at the farthest; their vignetting factors are left aside."""

import numpy as np

from ...errors import LensError


def field_end(path, kind, points, scale=1.0):
    """`Prescription.field` of a file.

    Parameters
    ----------
    path : path
        For the error.
    kind : str or None
        One of `FIELDS`; None for what none of them means.
    points : list of (x, y)
        In degrees, or in the file's unit of length.
    scale : float
        That unit in mm.

    Raises
    ------
    LensError
        The file does not say where the field ends, or not in a way that we know.
    """
    x, y = np.abs(np.reshape(points, (-1, 2))).T
    values = np.hypot(x, y)
    if kind == "angle_deg":  # of the projections on two planes
        slant = np.degrees(np.arctan(np.hypot(np.tan(np.radians(x)), np.tan(np.radians(y)))))
        values = np.where(np.minimum(x, y) > 0, slant, values)
    value = float(np.max(values, initial=0.0))
    if kind is None or not value > 0:
        raise LensError(path, "field", "on the axis alone" if kind else "of no kind that we know",
                        "give --field-angle or --field-height")
    return kind, value if kind == "angle_deg" else value * scale


def vignetting_note(factors, surfaces):
    """What a lens's notes say of vignetting factors, where any of them is not 0: apertures vignette, these do not."""
    if not any(factors):
        return ""
    stopping = any(np.isfinite(surface.semi_aperture_mm) for surface in surfaces if not surface.stop)
    return ("The file's vignetting factors are not used: " +
            ("its apertures vignette." if stopping else "without apertures nothing vignettes."))
