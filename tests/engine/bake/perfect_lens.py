"""A perfect lens, whose PSFs, distortion and illumination are known in closed form."""

import numpy as np
from optiland.materials import IdealMaterial
from optiland.optic import Optic

from lensfield.engine.bake.prescription import Prescription, Surface
from lensfield.engine.bake.system import System

EFL_MM = 50.0


def perfect_system(f_number, last_angle_deg=45.0):
    """Optiland's paraxial surface, stop and lens in one, focused at infinity."""
    stop_mm = EFL_MM / f_number / 2
    optic = Optic()
    optic.surfaces.add(index=0, thickness=np.inf)
    optic.surfaces.add(index=1, surface_type="paraxial", f=EFL_MM, thickness=EFL_MM, is_stop=True)
    optic.surfaces.add(index=2)
    optic.set_aperture("EPD", 2 * stop_mm)
    optic.fields.set_type("angle")
    optic.fields.add(y=0.0)
    optic.fields.add(y=last_angle_deg)
    optic.wavelengths.add(0.55, is_primary=True)
    prescription = Prescription("perfect", (Surface(thickness_mm=EFL_MM, stop=True),), ("f_number", f_number),
                                ("angle_deg", last_angle_deg))
    return System(optic, prescription, [IdealMaterial(1.0)], EFL_MM, 0.0, 0.0, -EFL_MM, stop_mm,
                  EFL_MM * np.tan(np.radians(last_angle_deg)))
