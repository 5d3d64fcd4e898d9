"""One singlet as each program writes it: a stop, then a lens of N-BK7 with a rear ellipsoid, f/10 at infinity."""

import json
from copy import deepcopy

from lensfield.engine.prescription.prescription import Surface
from lensfield.engine.prescription.readers import ReadingOptions, read_prescription

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
  DIAM 2.5 0 0 0 1 ""
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
  DIAM 8.0 0 0 0 1 ""
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

OPTBENCH = """[descriptive data]
title	US 1,234,567 Example 1
[constants]
Scaled	50
[variable distances]
Focal Length	49.0	49.0
Angle of View	28.0	27.0
F-Number	9.8	9.8
Image Height	24.4	24.4
d0	Infinity	500
d3	47.5	52.8
Bf	0	0
[lens data]
1	AS	2.0		5
2	50.0	4.0	1.5168	16	64.2	BSC7
3	-50.0	d3		16
[aspherical data]
3	-50.0	-0.5	1e-6	-2e-9
[figure]
source	nowhere.png
[notes]
Bill: measured.
"""

DOT_LENS = """# Singlet 50mm f/10
#
# Patent: US001234567
# 3 surfaces, 1 glass elements, f/10.0

name: Singlet 50mm f/10
focal_length: 49.00

surfaces:
# radius       thickness    ior      abbe     semi_ap   coating
  stop           2.0000       1.00000  0.00     5.000    0
  50.0000        4.0000       1.51680  64.20    16.000    1
  -50.0000       47.5000      1.00000  0.00     16.000    0
"""

PHYSICAL_CAMERA = """[lens]
name = "singlet"
patent = "US 1,234,567"
focal_length = 49.0
max_fstop = 9.8
coating = "single"
squeeze = 2.0

[[surface]]
type = "stop"
radius = 0
thickness = 2.0
ior = 1.0
aperture = 5.0
abbe_v = 0.0

[[surface]]
radius = 50.0
thickness = 4.0
ior = 1.5168
aperture = 16.0
abbe_v = 64.2

[[surface]]
type = "aspheric"
radius = -50.0
thickness = 1.5
ior = 1.0
aperture = 16.0
abbe_v = 0.0
conic = -0.5
aspheric_coeffs = [1e-6, -2e-9, 0.0]

[[surface]]
type = "cylindrical_x"
radius = 80.0
thickness = 1.0
ior = 1.6
aperture = 17.0
abbe_v = 0.0

[[surface]]
radius = 0
thickness = 0.0
ior = 1.0
aperture = 17.0
abbe_v = 0.0

[focus]
close_distance = 500.0

[[focus.variable]]
surface = 2
thickness_close = 3.5
"""

GHOSTLIGHT = {
    "format": "ghostlight-optical", "version": {"major": 1, "minor": 0},
    "metadata": {"name": "singlet", "source": "US1234567", "focal_length_mm": 49.0, "nominal_f_number": 9.8},
    "glass_catalogue": {
        "N-BK7": {"name": "N-BK7", "catalogue_ref": "Schott:N-BK7", "dispersion": {
            "model": "sellmeier", "B": [1.03961212, 0.231792344, 1.01046945],
            "C": [0.00600069867, 0.0200179144, 103.560653]}},
        "weak": {"name": "weak", "dispersion": {"model": "abbe", "nd": 1.6, "Vd": 60.0}}},
    "optical_system": [
        {"type": "element", "transform": {"position": {"mode": "absolute", "z": -56.5}}, "materials": [],
         "surfaces": [{"semi_aperture": 2.5, "is_stop": True, "form": {"type": "sphere", "radius": 0.0}}]},
        {"type": "element", "name": "lens", "materials": [{"glass": "N-BK7"}],
         "transform": {"position": {"mode": "relative_to_preceding", "x": 0.0, "y": 0.0, "z": 2.0},
                       "rotation": {"tilt_x": 0.0, "tilt_y": 0.0, "roll": 0.0}},
         "surfaces": [{"semi_aperture": 8.0, "form": {"type": "sphere", "radius": 50.0}, "thickness": 4.0,
                       "modifiers": [{"type": "coating", "model": "simple", "ar_layers": 1}]},
                      {"semi_aperture": 8.0, "thickness": 9.9, "form": {
                          "type": "asphere", "radius": -50.0, "conic_constant": -0.5, "terms": [1e-6, -2e-9]}}]},
        {"type": "element", "name": "cylinder", "materials": [{"glass": "weak"}],
         "transform": {"position": {"x": 0.3, "y": -0.2, "z": -49.0}, "pivot": {"x": 0.0, "y": 0.0, "z": 0.5},
                       "rotation": {"tilt_x": 2.0, "tilt_y": 0.0, "roll": 0.0}},
         "surfaces": [{"semi_aperture": 8.5, "form": {"type": "cylindrical", "radius": 80.0, "axis": "y"},
                       "thickness": 1.0},
                      {"semi_aperture": 8.5, "form": {"type": "sphere", "radius": 0.0}, "thickness": 48.0}]}],
    "pivots": []}

DEEPLENS = {
    "info": "a singlet", "foclen": 49.0, "fnum": 9.8, "r_sensor": 12.2, "d_sensor": 53.5, "sensor_size": [20.0, 14.0],
    "surfaces": [
        {"type": "Stop", "r": 2.5, "c": 0.0, "d": 0.0, "mat1": "air", "mat2": "occluder"},
        {"type": "Spheric", "r": 8.0, "(c)": 0.02, "roc": 50.0, "d": 2.0, "mat2": "n-bk7", "d_next": 4.0},
        {"type": "Aspheric", "r": 8.0, "c": -0.02, "d": 6.0, "k": -0.5, "ai": [0.0, 1e-6, -2e-9], "mat2": "air"}]}

LENTIL = {
    "0001": {"company": "Nobody", "product-name": "singlet", "patent-number": "US1234567", "year": 1920,
             "focal-length-mm-patent": 49, "optical-elements-patent": [
                 {"radius": 99999.0, "thickness": 2.0, "ior": None, "abbe": None, "material": "iris",
                  "housing-radius": 2.5, "lens-geometry": "spherical", "aspherical-equation": None},
                 {"radius": 50.0, "thickness": 4.0, "ior": 1.5168, "abbe": 64.2, "material": "BK7",
                  "housing-radius": 8, "lens-geometry": "spherical", "aspherical-equation": None},
                 {"radius": -50.0, "thickness": [47.5, 50.0, 55.0], "ior": None, "abbe": None, "material": "air",
                  "housing-radius": 8, "lens-geometry": "aspherical", "aspherical-equation": [1e-6, -2e-9, 0.0, 0.0]}]}}


OF_OPTILAND = ("radius", "conic", "coefficients", "radius_x", "radius_y", "conic_x", "conic_yz", "coeffs_poly_y")


def optiland_row(z, kind="Plane", material=None, **changes):
    """A surface as Optiland writes it, with air behind it by default."""
    geometry = {"type": kind, "cs": dict.fromkeys(("x", "y", "rx", "ry", "rz"), 0.0) | {"z": z}}
    geometry["cs"] |= changes.pop("cs", {})
    geometry |= {name: changes.pop(name) for name in OF_OPTILAND if name in changes}
    return {"geometry": geometry, "material_post": material or {"type": "IdealMaterial", "index": 1.0},
            "is_stop": False, "aperture": None,
            "interaction_model": {"type": "RefractiveReflectiveModel", "is_reflective": False}} | changes


def optiland(**third):
    """The output of Optiland's save_optiland_file for a singlet, whose third surface has a model or the given glass."""
    glass = {"type": "Material", "name": "N-BK7", "catalog": "schott", "reference": None}
    model = {"type": "AbbeMaterial", "index": 1.62, "abbe": 60.3}
    asphere = dict(kind="EvenAsphere", radius=-50.0, conic=-0.5, coefficients=[1e-4, -2e-6], material=model)
    rows = [optiland_row(float("-inf")), optiland_row(0.0, is_stop=True),
            optiland_row(2.0, "StandardGeometry", glass, radius=50.0, conic=0.0,
                         aperture={"type": "RadialAperture", "r_max": 8.0, "r_min": 0.0}),
            optiland_row(6.0, **asphere | third), optiland_row(8.0), optiland_row(53.0)]
    fields = [{"x": x, "y": y, "vx": 0.0, "vy": 0.0} for x, y in ((0, 0), (0, 14), (6, 8))]
    wavelengths = [{"value": value, "is_primary": value == 0.5461} for value in (0.4861, 0.5461)]
    return {"name": "singlet", "aperture": {"type": "EPD", "value": 5.0}, "surface_group": {"surfaces": rows},
            "fields": {"fields": fields, "telecentric": False, "field_definition": {"field_type": "AngleField"}},
            "wavelengths": {"wavelengths": wavelengths}}


def changed(text, *pairs):
    """A text with some pieces replaced; each piece must occur in it."""
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text


ANAMORPHIC_ZEMAX = changed(ZEMAX, ("SURF 3\n  TYPE STANDARD", """SURF 3
  TYPE COORDBRK
  PARM 1 0.1
  PARM 3 -0.5
  CURV 0
  DISZ 0
SURF 4
  TYPE TOROIDAL
  PARM 1 -80.0
  PARM 3 2.0E-6"""), ("DISZ 4.75E+1", "DISZ 0"), ("SURF 4\n  TYPE STANDARD", """SURF 5
  TYPE COORDBRK
  PARM 1 -0.1
  PARM 3 0.5
  PARM 6 1
  CURV 0
  DISZ 47.5
SURF 6
  TYPE STANDARD"""))

ANAMORPHIC_CODEV = changed(CODEV, ("  CIR EDG 9.0\n", "  CYL\n  CUX 0.0\n  CIR EDG 9.0\n"),
                           ("  CON\n  K   -0.5\n", """  AAS
  RDX -80.0; KX 0.3; KY -0.5
  AR 2.0e-6; BR -1.0e-9
  AP 0.1; BP -0.2
  XDE 0.1; YDE 0.0; ADE -0.5; DAR
"""))

SAMPLES = {".toml": TOML, ".zmx": ZEMAX, ".seq": CODEV, ".dat": PBRT, ".txt": OPTBENCH, ".lens": DOT_LENS,
           "physical-camera.toml": PHYSICAL_CAMERA, "anamorphic.zmx": ANAMORPHIC_ZEMAX,
           "anamorphic.seq": ANAMORPHIC_CODEV, "Ghostlight.lens": json.dumps(GHOSTLIGHT, indent=1),
           "Optiland.json": json.dumps(optiland(), indent=1), "DeepLens.json": json.dumps(DEEPLENS, indent=1),
           "lentil.json": json.dumps(LENTIL, indent=1)}
"""A valid file of each kind, by its suffix; if several have the same suffix, with the program or the lens before it."""


SURFACES = (Surface(thickness_mm=2.0, stop=True), Surface(50.0, 4.0, "SCHOTT N-BK7", 8.0),
            Surface(-50.0, 47.5, conic=-0.5))


def prescriptions(count):
    """(name, text) of a lens with so many surfaces, as each program writes it: one surface of the valid lens, repeated.
    """
    for name, text, surface in (
            ("lens.toml", TOML, "[[surfaces]]\nthickness_mm = 1\n"),
            ("lens.zmx", ZEMAX, "SURF 2\n  CURV 2.0E-2\n  DISZ 4.0\n"),
            ("lens.seq", CODEV, "S     50.0 4.0 NBK7_SCHOTT\n"),
            ("lens.dat", PBRT, "50\t4\t1.5168\t16\n"), ("lens.txt", OPTBENCH, "2\t50.0\t4.0\t1.5168\t16\t64.2\tBSC7\n"),
            ("lens.lens", DOT_LENS, "  50.0000        4.0000       1.51680  64.20    16.000    1\n")):
        first = surface.splitlines(keepends=True)[0]
        before, _, after = text.partition(first)
        yield name, before + surface * count + first + after
    for name, contents, rows in (
            ("optiland.json", of_optiland := optiland(), of_optiland["surface_group"]["surfaces"]),
            ("deeplens.json", of_deeplens := deepcopy(DEEPLENS), of_deeplens["surfaces"]),
            ("lentil.json", of_lentil := deepcopy(LENTIL), of_lentil["0001"]["optical-elements-patent"])):
        rows[2:2] = [rows[1]] * count
        yield name, json.dumps(contents)


def reader_of(path, text):
    """A function that reads this prescription with some of its text changed, from a file at this path."""
    def read_changed(*pairs, field=None, encoding="utf-8"):
        path.write_bytes(changed(text, *pairs).encode(encoding))
        return read_prescription(path, ReadingOptions(field))

    return read_changed
