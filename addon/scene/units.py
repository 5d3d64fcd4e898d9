"""Units: the length of a Blender unit. Only this module converts scene lengths to metres or millimetres.

Blender stores positions, clipping and focus distances as plain numbers and Cycles writes depth in the same units. The
scene's Unit Scale says how many metres a unit is. Radiance needs no conversion: Blender shows the power of a lamp times
the square of the scale, so power per area is the same number in units and in metres.
"""

import numpy as np

M_TO_MM = 1e3
BACKGROUND_UNITS = 1e10  # Cycles' depth for the background
DIGITS = 7  # of Blender's single precision: a scale of 0.01 is stored as 0.00999999978


def metres_per_unit(scene):
    """Length of a Blender unit in metres: the scene's Unit Scale.

    Without a unit system, Blender shows lengths as plain numbers and ignores the scale (`BKE_unit_value_scale`): a
    unit is then a metre.
    """
    units = scene.unit_settings
    return 1.0 if units.system == "NONE" else float(f"{units.scale_length:.{DIGITS}g}")


def mm_per_unit(scene):
    """Length of a Blender unit in millimetres."""
    return metres_per_unit(scene) * M_TO_MM


def depth_pass_m(plane, unit_m):
    """A depth pass in metres: float32 array (row, column). The background's value stays the same.

    Parameters
    ----------
    plane : float32 array (row, column)
        From Cycles, in Blender units.
    unit_m : float
        `metres_per_unit` of the scene.
    """
    return np.where(plane < BACKGROUND_UNITS, plane * np.float32(unit_m), plane)
