"""One singlet as each program would write it: a stop, a lens of N-BK7 with an ellipsoid behind, f/10 at infinity."""

import numpy as np
from optiland.fileio import save_optiland_file
from optiland.materials import AbbeMaterial, Material
from optiland.optic import Optic
from optiland.physical_apertures import RadialAperture

from lensfield.engine.bake.prescription import Surface
from lensfield.engine.bake.prescriptions import read_prescription

TOML = """
format = "lensfield-prescription"
version = 1
name = "singlet"
aperture = { entrance_pupil_diameter_mm = 5.0 }
field = { angle_deg = 14.0 }

[[surfaces]]
thickness_mm = 2.0
stop = true

[[surfaces]]
radius_mm = 50.0
thickness_mm = 4.0
glass = "SCHOTT N-BK7"
semi_aperture_mm = 8.0

[[surfaces]]
radius_mm = -50.0
thickness_mm = 47.5
conic = -0.5
"""

ZEMAX = """VERS 130404 15 24485
MODE SEQ
NAME singlet
NOTE 0 Made by hand
UNIT MM X W X CM MR CPMM
ENPD 5.0E+0
GCAT SCHOTT
FTYP 0 0 2 3 0 0 0
XFLN 0 0 0 0
YFLN 0 1.4E+1 0 0
VCYN 0 0 0 0
WAVM 1 4.8613E-1 1
WAVM 2 5.875618E-1 1
WAVM 3 6.5627E-1 1
WAVM 4 5.5E-1 1
PWAV 2
SURF 0
  TYPE STANDARD
  CURV 0.0 0 0 0 0 ""
  DISZ INFINITY
  DIAM 0 0 0 0 1 ""
SURF 1
  STOP
  TYPE STANDARD
  CURV 0.0 0 0 0 0 ""
  DISZ 2
  DIAM 2.5 1 0 0 1 ""
SURF 2
  TYPE STANDARD
  CURV 2.0E-2 0 0 0 0 ""
  DISZ 4.0
  GLAS N-BK7 0 0 1.5 40 0 0 0 0 0 0
  DIAM 8.0 1 0 0 1 ""
  FLAP 0 8.0 0
SURF 3
  TYPE STANDARD
  CURV -2.0E-2 0 0 0 0 ""
  CONI -0.5
  DISZ 4.75E+1
  DIAM 8.0 1 0 0 1 ""
SURF 4
  TYPE STANDARD
  CURV 0.0 0 0 0 0 ""
  DISZ 0
  DIAM 1.2E+1 0 0 0 1 ""
BLNK
MNUM 1 1
"""

CODEV = """RDM;LEN       "VERSION: 10.7; a"
TITLE 'singlet'
EPD   5.0
DIM   M
WL    656.27 587.5618 486.13   ! red first
REF   2
XAN   0.0 0.0
YAN   0.0 14.0
SO    0.0 0.1e14
S     0.0 2.0
  STO
S     50.0 4.0 NBK7_SCHOTT
  CIR 8.0
  CIR EDG 9.0
S     -50.0 47.5
  CON
  K   -0.5
SI    0.0 0.0
GO
"""

PBRT = """# a singlet
# radius	sep	n	aperture
0	2	0	5
50	4	1.5168	16
-50	47.5	1	16
"""

SURFACES = (Surface(thickness_mm=2.0, stop=True), Surface(50.0, 4.0, "SCHOTT N-BK7", 8.0),
            Surface(-50.0, 47.5, conic=-0.5))


def changed(text, *pairs):
    """A text with pieces of it replaced; each has to be there."""
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text


def reader_of(path, text):
    """A function that reads the prescription of this text with some of it changed, as a file of this path."""
    def read_changed(*pairs, field=None, encoding="utf-8"):
        path.write_bytes(changed(text, *pairs).encode(encoding))
        return read_prescription(path, field)

    return read_changed


def saved_by_optiland(path, **third):
    """A file of Optiland: the singlet, with a third surface of a model glass and an even asphere, or what is asked."""
    optic = Optic(name="singlet")
    optic.surfaces.add(index=0, thickness=np.inf)
    optic.surfaces.add(index=1, thickness=2.0, is_stop=True)
    optic.surfaces.add(index=2, radius=50.0, thickness=4.0, material=Material("N-BK7", catalog="schott"),
                       aperture=RadialAperture(r_max=8.0))
    optic.surfaces.add(**dict(index=3, radius=-50.0, thickness=2.0, conic=-0.5, surface_type="even_asphere",
                              coefficients=[1e-4, -2e-6], material=AbbeMaterial(1.62, 60.3, model="buchdahl")) | third)
    optic.surfaces.add(index=4, thickness=45.0)
    optic.surfaces.add(index=5)
    optic.set_aperture("EPD", 5.0)
    optic.fields.set_type("angle")
    for x, y in ((0, 0), (0, 14), (6, 8)):
        optic.fields.add(x=x, y=y)
    optic.wavelengths.add(0.4861)
    optic.wavelengths.add(0.5461, is_primary=True)
    save_optiland_file(optic, str(path))
    return path
