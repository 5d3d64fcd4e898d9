"""Optiland JSON."""

from pathlib import Path, PureWindowsPath

import numpy as np

from ...runtime.errors import LensError
from ...runtime.text import object_distance
from ...runtime.unread import json_names, unread_names
from ..glasses import best_name
from ..prescription import Prescription, Surface
from .field_and_aperture import field_end, vignetting_note
from .frames import START, posed
from .reading import Reading, ReadingOptions, with_stop

KNOWN_NAMES = ("name", "aperture", "type", "value", "fields", "field_definition", "field_type", "x", "y", "vx", "vy",
               "telecentric", "surface_group", "surfaces", "geometry", "cs", "z", "rx", "ry", "rz", "reference_cs",
               "radius", "conic", "coefficients", "material_post", "index", "abbe", "catalog", "filename", "reference",
               "is_stop", "is_reflective", "interaction_model", "r_min", "r_max", "x_min", "x_max", "y_min",
               "y_max", "wavelengths", "is_primary",
               "radius_x", "radius_y", "conic_x", "conic_y", "conic_yz", "coeffs_poly_y")
HARMLESS_NAMES = ("version", "material_pre", "robust_search", "min_wavelength", "max_wavelength", "unit", "weight",
                  "polarization", "pickups", "solves", "tol", "max_iter", "thickness", "comment", "model",
                  "object_space_telecentric", "ray_tracer", "ray_aiming_config",
                  "match_policy", "bounds", "propagation_model", "geometry_type")
DISPLACEMENTS = ("x", "y", "rx", "ry", "rz")
REFRACTIVE = "RefractiveReflectiveModel"
TOROID, BICONIC = "ToroidalGeometry", "BiconicGeometry"
SHAPES = ("Plane", "StandardGeometry", "EvenAsphere", "OddAsphere", TOROID, BICONIC)
APERTURES = {"EPD": "entrance_pupil_diameter_mm", "imageFNO": "f_number", "objectNA": "object_na"}
FIELDS = {"AngleField": "angle_deg", "ObjectHeightField": "object_height_mm",
          "ParaxialImageHeightField": "image_height_mm",
          "angle": "angle_deg", "object_height": "object_height_mm"}  # names in older releases


def read_optiland(path: Path, contents: dict, options: ReadingOptions) -> Reading:
    """Read a lens written by `optiland.fileio.save_optiland_file`."""
    rows = contents["surface_group"]["surfaces"]
    _check_ends(path, rows)
    places = [row["geometry"]["cs"]["z"] for row in rows]
    on_axis = []
    for number, row in enumerate(rows[1:-1], 1):
        glass_before = on_axis[-1].glass if on_axis else ""
        on_axis.append(_surface(path, number, row, places[number + 1] - places[number], glass_before))
    in_poses, image_pose = posed(on_axis, [_frame(path, number, row) for number, row in enumerate(rows[1:], 1)])
    surfaces = with_stop(path, in_poses, options)
    if contents["fields"].get("telecentric"):
        raise LensError(path, "fields", "telecentric in object space", "expected rays to be aimed at the stop")
    factors = [point.get(axis) for point in contents["fields"]["fields"] for axis in ("vx", "vy")]
    return Reading(Prescription(
        name=" ".join(str(contents.get("name") or path.stem).split()), surfaces=surfaces,
        aperture=_aperture(path, contents["aperture"]), field=options.field or _field(path, contents["fields"]),
        focus=options.image_plane or "as given", object_distance_mm=object_distance(places[1] - places[0]),
        reference_wavelength_nm=_reference_nm(contents["wavelengths"]["wavelengths"]),
        source=f"{path.name} (Optiland)", image_pose=image_pose, notes=vignetting_note(factors, surfaces)),
        unread=unread_names(json_names(contents, HARMLESS_NAMES), KNOWN_NAMES))


def _check_ends(path, rows):
    """Check that object and image are planes, and that the object is in air."""
    if len(rows) < 3 or any(np.isfinite(row["geometry"].get("radius", np.inf)) for row in (rows[0], rows[-1])):
        raise LensError(path, "surface_group", "without a flat object and a flat image", "expected both, and a lens")
    if _glass(path, 0, rows[0]["material_post"]):
        raise LensError(path, "object", "in glass", "expected air in front of the lens")
    if any(rows[0]["geometry"]["cs"][key] for key in DISPLACEMENTS):
        raise LensError(path, "object", "tilted or decentred", "expected an object plane on the axis")


def _surface(path, number, row, thickness_mm, glass_before):
    shape, aperture, interaction = row["geometry"], row.get("aperture"), row.get("interaction_model", {})
    mirror = bool(interaction.get("is_reflective") or row.get("is_reflective"))  # of older releases
    if interaction.get("type", REFRACTIVE) != REFRACTIVE:
        raise LensError(path, f"surface {number}", interaction["type"], "expected refracting surfaces and mirrors")
    if shape["type"] not in SHAPES:
        raise LensError(path, f"surface {number}", shape["type"], f"expected one of {', '.join(SHAPES)}")
    return Surface(thickness_mm=thickness_mm, stop=row["is_stop"], mirror=mirror,
                   glass=glass_before if mirror else _glass(path, number, row["material_post"]),
                   **_aperture_of(path, number, aperture), **_form(path, number, shape))


def _aperture_of(path, number, aperture):
    """Fields of a surface from its aperture, if it has one."""
    kind = aperture["type"] if aperture else ""
    if kind == "RadialAperture":
        return {"semi_aperture_mm": aperture["r_max"], "semi_obstruction_mm": aperture.get("r_min") or 0.0}
    if kind == "RectangularAperture" and all(aperture[f"{axis}_min"] == -aperture[f"{axis}_max"] for axis in "xy"):
        return {"half_widths_mm": (aperture["x_max"], aperture["y_max"])}
    if aperture:
        raise LensError(path, f"surface {number}, aperture", kind,
                        "expected a centred circle, RadialAperture, or rectangle, RectangularAperture")
    return {}


def _form(path, number, shape):
    """Fields of a surface that its geometry determines."""
    if shape["type"] == TOROID:
        return {"radius_mm": shape["radius_y"] or np.inf, "conic": shape.get("conic_yz", 0.0),
                "radius_x_mm": shape["radius_x"], "profile": "y", "aspheric": tuple(shape.get("coeffs_poly_y", ()))}
    if shape["type"] == BICONIC:
        return _biconic(path, number, shape)
    terms = tuple(shape.get("coefficients", ()))
    even, odd = (terms[1::2], terms[::2]) if shape["type"] == "OddAsphere" else (terms, ())
    return {"radius_mm": shape.get("radius", np.inf), "conic": shape.get("conic", 0.0), "aspheric": even,
            "odd_aspheric": odd}


def _biconic(path, number, shape):
    """A cylinder with a conic section: Optiland adds the sags of both sections, which differs if both are curved."""
    sections = {"radius_x_mm": shape["radius_x"], "radius_mm": shape["radius_y"]}
    sections = {name: radius or np.inf for name, radius in sections.items()}
    if all(map(np.isfinite, sections.values())):
        raise LensError(path, f"surface {number}", f"{BICONIC}, curved along x and y",
                        "Optiland adds the sags of the two sections: expected one plane section, or a ToroidalGeometry")
    return sections | {"conic_x": shape.get("conic_x", 0.0), "conic": shape.get("conic_y", 0.0)}


def _frame(path, number, row):
    """The coordinate system of a surface, which is turned about the fixed x, y and z axes and then moved."""
    place = row["geometry"]["cs"]
    if place.get("reference_cs"):
        raise LensError(path, f"surface {number}", "in the coordinate system of another",
                        "expected the surface's own x, y, z, rx, ry and rz")
    turns = [(axis, np.degrees(place[f"r{axis}"])) for axis in "zyx"]  # about its own axes in reverse order
    return START.moved(place["x"], place["y"], place["z"]).turned(*turns)


def _glass(path, number, material):
    if material["type"] == "Material":
        catalogue = material.get("catalog") or material.get("reference")
        return best_name(material["name"], [catalogue or PureWindowsPath(material.get("filename") or "").parent.name])
    if material["type"] == "AbbeMaterial":
        return f"{material['index']:.9g}/{material['abbe']:.9g}"
    if material["type"] == "IdealMaterial":
        return "" if material["index"] == 1 else f"{material['index']:.9g}"
    raise LensError(path, f"surface {number}, glass", material["type"], "expected a catalogue glass or AbbeMaterial")


def _field(path, fields):
    x, y = ([point[axis] for point in fields["fields"]] for axis in ("x", "y"))
    kind = fields.get("field_definition", fields).get("field_type")
    return field_end(path, FIELDS.get(kind), x, y)


def _aperture(path, aperture):
    if aperture["type"] == "float_by_stop_size":
        return "stop", aperture["value"] / 2
    if aperture["type"] not in APERTURES:
        raise LensError(path, "aperture", aperture["type"], f"expected float_by_stop_size, {', '.join(APERTURES)}")
    return APERTURES[aperture["type"]], aperture["value"]


def _reference_nm(wavelengths):
    """The primary wavelength, or the first."""
    return 1e3 * next((row for row in wavelengths if row["is_primary"]), wavelengths[0])["value"]
