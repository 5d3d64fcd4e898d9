"""The sign of each program's angles, by the ray that a tilted plate displaces."""

import json

import numpy as np
import pytest

from lens_texts import CODEV, GHOSTLIGHT, ZEMAX, changed, optiland, optiland_row
from lensfield.engine.prescription.readers import ReadingOptions, read_prescription
from lensfield.engine.rays.trace import start_on_stop, trace_to_image

DEGREES, THICKNESS_MM, INDEX, GAP_MM = 12.0, 4.0, 1.5, 20.0
MODEL = {"type": "AbbeMaterial", "index": INDEX, "abbe": 60.0}


def zemax(tilt_x, tilt_y):
    """The plate turns about its front vertex, and a plane there, reached backwards, returns."""
    planes = [("CURV 2.0E-2", "CURV 0"), ("CURV -2.0E-2", "CURV 0"), ("DISZ 4.75E+1", f"DISZ {-THICKNESS_MM}")]
    breaks = [f"  TYPE COORDBRK\n  CURV 0\n  PARM 3 {sign * tilt_x}\n  PARM 4 {sign * tilt_y}\n  PARM 6 {order}\n"
              for sign, order in ((1, 0), (-1, 1))]
    return changed(ZEMAX, *planes, ("SURF 2\n", f"SURF 2\n{breaks[0]}  DISZ 0\nSURF 3\n"),
                   ("SURF 4\n", f"SURF 5\n{breaks[1]}  DISZ {GAP_MM}\nSURF 6\n"))


def codev(tilt_x, tilt_y):
    """As `zemax`, with REV at the plane."""
    lines = f"  ADE {tilt_x}; BDE {tilt_y}"
    return changed(CODEV, ("S     50.0", f"S 0.0 0.0\n{lines}\nS     0.0"), ("-50.0 47.5", f"0.0 {-THICKNESS_MM}"),
                   ("SI ", f"S 0.0 {GAP_MM}\n{lines}; REV\nSI "))


def optiland_json(tilt_x, tilt_y):
    """Both surfaces of the plate have their own places and turns."""
    rx, ry = np.radians([tilt_x, tilt_y])
    x, y, z = THICKNESS_MM * np.array([np.sin(ry) * np.cos(rx), -np.sin(rx), np.cos(ry) * np.cos(rx)])
    contents = optiland()
    turn = {"rx": rx, "ry": ry}
    contents["surface_group"]["surfaces"][2:] = [
        optiland_row(2.0, material=MODEL, cs=turn), optiland_row(2.0 + z, cs=turn | {"x": x, "y": y}),
        optiland_row(2.0 + GAP_MM)]
    return json.dumps(contents)


def ghostlight(tilt_x, tilt_y):
    """An element turns about its front vertex."""
    contents = GHOSTLIGHT | {"metadata": {}}
    plane = {"semi_aperture": 9.0, "form": {"type": "sphere", "radius": 0.0}, "thickness": THICKNESS_MM}
    plate = {"type": "element", "surfaces": [plane, plane], "materials": [{"glass": "weak"}], "transform": {
        "position": {"z": 0.0}, "rotation": {"tilt_x": tilt_x, "tilt_y": tilt_y}}}
    return json.dumps(contents | {"optical_system": [contents["optical_system"][0], plate]})


@pytest.mark.parametrize("tilt_x, tilt_y", [(DEGREES, 0.0), (0.0, DEGREES)])
@pytest.mark.parametrize("name, text, signs", [("lens.zmx", zemax, (-1, 1)), ("lens.seq", codev, (1, -1)),
                                               ("lens.json", optiland_json, (-1, 1)),
                                               ("lens.lens", ghostlight, (-1, 1))])
def test_a_tilted_plate_displaces_a_ray(tmp_path, name, text, signs, tilt_x, tilt_y):
    """Towards the side to which its axis leans: for a right-handed turn about x to -y, and about y to +x. Angles of
    Code V are left-handed."""
    (tmp_path / name).write_text(text(tilt_x, tilt_y))
    lens = read_prescription(tmp_path / name, ReadingOptions(("image_height_mm", 5.0)))
    indices = np.array([1.0, *(INDEX if surface.glass and surface.radius_x_mm is None else 1.0
                               for surface in lens.surfaces)])[:, None]
    start = start_on_stop(lens, *(np.array([value]) for value in (0.3, -0.2, 0.0, 0.0)))
    (x, y, _), direction, *_ = trace_to_image(lens, indices, *start)
    angle = np.radians(DEGREES)
    shift_mm = THICKNESS_MM * np.sin(angle) * (1 - np.cos(angle) / np.sqrt(INDEX**2 - np.sin(angle)**2))
    expected = (0.3 + signs[1] * shift_mm * bool(tilt_y), -0.2 + signs[0] * shift_mm * bool(tilt_x))
    assert (x[0], y[0]) == pytest.approx(expected, abs=1e-9)
    assert direction[:, 0] == pytest.approx((0, 0, 1), abs=1e-12)
