"""JSON prescriptions of Optiland, DeepLens and lentil, and how the reader distinguishes them."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
import scipy

from lens_texts import DEEPLENS, LENTIL, SURFACES, optiland
from lensfield.engine import LensError
from lensfield.engine.prescription.prescription import Pose, Surface
from lensfield.engine.prescription.readers import ReadingOptions, read_prescription
from lensfield.engine.rays.focus import build_system
from notes import unread
from refusals import refused

FIELD = ("image_height_mm", 12.0)
BENT = replace(SURFACES[2], semi_aperture_mm=8.0, aspheric=(0.0, 1e-6, -2e-9))


@pytest.fixture
def read(tmp_path):
    """Read these contents as a file."""
    def read_contents(contents, *arguments):
        (tmp_path / "lens.json").write_text(json.dumps(contents))
        return read_prescription(tmp_path / "lens.json", ReadingOptions(*arguments))

    return read_contents


def test_optiland(read):
    lens = read(optiland())
    assert lens.surfaces == (SURFACES[0], SURFACES[1],
                             Surface(-50.0, 2.0, "1.62/60.3", conic=-0.5, aspheric=(1e-4, -2e-6)),
                             Surface(thickness_mm=45.0))
    assert (lens.name, lens.aperture, lens.field) == ("singlet", ("entrance_pupil_diameter_mm", 5.0),
                                                      ("angle_deg", 14.0))
    assert lens.reference_wavelength_nm == pytest.approx(546.1) and np.isinf(lens.object_distance_mm)


def test_files_written_by_optiland_are_read(tmp_path):
    """Checks that the text in these tests is what Optiland writes."""
    pytest.importorskip("optiland", reason="Optiland, a witness, is in the environment of make test-bake")
    from optiland.fileio import save_optiland_file
    from optiland.materials import AbbeMaterial, Material
    from optiland.optic import Optic
    from optiland.physical_apertures import RadialAperture

    optic = Optic(name="singlet")
    optic.surfaces.add(index=0, thickness=np.inf)
    optic.surfaces.add(index=1, thickness=2.0, is_stop=True)
    optic.surfaces.add(index=2, radius=50.0, thickness=4.0, material=Material("N-BK7", catalog="schott"),
                       aperture=RadialAperture(r_max=8.0))
    optic.surfaces.add(index=3, radius=-50.0, thickness=2.0, conic=-0.5, surface_type="even_asphere",
                       coefficients=[1e-4, -2e-6], material=AbbeMaterial(1.62, 60.3, model="buchdahl"))
    optic.surfaces.add(index=4, thickness=45.0)
    optic.surfaces.add(index=5)
    optic.set_aperture("EPD", 5.0)
    optic.fields.set_type("angle")
    for x, y in ((0, 0), (0, 14), (6, 8)):
        optic.fields.add(x=x, y=y)
    optic.wavelengths.add(0.4861)
    optic.wavelengths.add(0.5461, is_primary=True)
    save_optiland_file(optic, str(tmp_path / "theirs.json"))
    (tmp_path / "ours.json").write_text(json.dumps(optiland()))
    theirs, ours = (read_prescription(tmp_path / f"{name}.json") for name in ("theirs", "ours"))
    assert replace(theirs, source="") == replace(ours, source="")


def test_an_odd_asphere_of_optiland(read):
    lens = read(optiland(kind="OddAsphere", coefficients=[0.0, 1e-4, 2e-5, 3e-6, 4e-7]))
    assert (lens.surfaces[2].aspheric, lens.surfaces[2].odd_aspheric) == ((1e-4, 3e-6), (0.0, 2e-5, 4e-7))


def test_files_of_older_optiland_releases_are_read(read):
    """Older releases stored fields and mirrors elsewhere, and identified a glass by its file only."""
    contents = optiland()
    contents["fields"]["field_type"] = "angle"
    del contents["fields"]["field_definition"]
    rows = contents["surface_group"]["surfaces"]
    rows[2]["material_post"] = {"type": "Material", "name": "SK16", "filename": "C:\\a\\glass\\hikari\\SK16.yml"}
    for row in rows:
        del row["interaction_model"]
        row["is_reflective"] = False
    lens = read(contents)
    assert lens.field == ("angle_deg", 14.0) and lens.surfaces[1].glass == "HIKARI SK16"
    rows[3]["is_reflective"] = True
    with refused(LensError, field="mirrors", value=1, where="lens.json"):
        read(contents)


def test_a_missing_name_is_an_error(read):
    contents = optiland()
    del contents["wavelengths"]
    with pytest.raises(LensError, match="wavelengths is missing: the file may be damaged, or have another version"):
        read(contents)


def test_an_index_without_dispersion_becomes_the_glass_name(read):
    assert read(optiland(material={"type": "IdealMaterial", "index": 1.5})).surfaces[2].glass == "1.5"


@pytest.mark.parametrize("third, message", [
    (dict(interaction_model={"type": "RefractiveReflectiveModel", "is_reflective": True}),
     "mirrors is 1"),
    (dict(interaction_model={"type": "ThinLensInteractionModel"}), "surface 3 is ThinLensInteractionModel: expected"),
    (dict(kind="ChebyshevPolynomialGeometry"), "surface 3 is ChebyshevPolynomialGeometry: expected one of"),
    (dict(kind="BiconicGeometry", radius_x=-80.0, radius_y=-50.0),
     "surface 3 is BiconicGeometry, curved along x and y: Optiland adds the sags"),
    (dict(cs={"reference_cs": {"x": 0.0}}), "surface 3 is in the coordinate system of another"),
    (dict(material={"type": "Mirror"}), "surface 3, glass is Mirror: expected a catalogue glass"),
    (dict(aperture={"type": "RectangularAperture", "x_min": -4.0, "x_max": 5.0, "y_min": -6.0, "y_max": 6.0}),
     "surface 3, aperture is RectangularAperture: expected a centred circle, RadialAperture, or rectangle"),
    (dict(aperture={"type": "EllipticalAperture", "a": 8.0, "b": 1.0}),
     "surface 3, aperture is EllipticalAperture: expected a centred circle")], ids=lambda value: None)
def test_unsupported_surfaces_of_optiland_are_refused(read, third, message):
    with pytest.raises(LensError, match=message):
        read(optiland(**third))


@pytest.mark.parametrize("third, changes", [
    (dict(kind="ToroidalGeometry", radius=-50.0, conic=0.0, radius_x=-80.0, radius_y=-50.0, conic_yz=-0.5,
          coeffs_poly_y=[0.0, 2e-6]), dict(radius_x_mm=-80.0, profile="y", aspheric=(0.0, 2e-6))),
    (dict(kind="ToroidalGeometry", radius_x=float("inf"), radius_y=-50.0, conic_yz=-0.5),
     dict(radius_x_mm=np.inf, profile="y")),
    (dict(kind="BiconicGeometry", radius_x=-80.0, radius_y=float("inf"), conic_x=0.7),
     dict(radius_mm=np.inf, conic=0.0, radius_x_mm=-80.0, conic_x=0.7))], ids=lambda value: None)
def test_toroids_and_cylinders_of_optiland(read, third, changes):
    contents = optiland(**third)
    geometry = contents["surface_group"]["surfaces"][3]["geometry"]
    del geometry["coefficients"]
    expected = Surface(-50.0, 2.0, "1.62/60.3", conic=-0.5)
    lens = read(contents)
    assert lens.surfaces[2] == replace(expected, **changes) and not unread(lens.notes)


def test_a_rectangular_aperture_of_optiland(read):
    lens = read(optiland(aperture={"type": "RectangularAperture", "x_min": -4.0, "x_max": 4.0, "y_min": -6.0,
                                   "y_max": 6.0}))
    assert lens.surfaces[2].half_widths_mm == (4.0, 6.0) and not unread(lens.notes)


def test_poses_of_optiland(read):
    """Radians about the fixed x, y and z axes, in this order, like ours; the image plane may be displaced, too."""
    contents = optiland(cs={"x": 0.3, "y": -0.2, "rx": 0.1, "ry": -0.2})
    contents["surface_group"]["surfaces"][-1]["geometry"]["cs"] |= {"rx": np.radians(2.0), "y": 1.5}
    lens = read(contents)
    pose = lens.surfaces[2].pose
    turn, theirs = (scipy.spatial.transform.Rotation.from_euler("xyz", angles)
                    for angles in (np.radians(pose.tilt_deg), (0.1, -0.2, 0.0)))
    assert pose.offset_mm == (0.3, -0.2, 0.0) and turn.apply([0, 0, 1]) == pytest.approx(theirs.apply([0, 0, 1]))
    assert lens.image_pose == Pose((0.0, 1.5, 0.0), (2.0, 0.0, 0.0))
    assert [surface.thickness_mm for surface in lens.surfaces] == [2.0, 4.0, 2.0, 45.0]
    contents["surface_group"]["surfaces"][0]["geometry"]["cs"]["rx"] = 0.1
    with pytest.raises(LensError, match="object is tilted or decentred: expected an object plane on the axis"):
        read(contents)


def deeplens(number=0, **changes):
    """DeepLens' singlet with one surface changed, without the figures that no longer apply."""
    contents = {name: value for name, value in copy.deepcopy(DEEPLENS).items() if name not in ("foclen", "fnum")}
    contents["surfaces"][number] |= changes
    return contents


def test_deeplens(read):
    lens = read(DEEPLENS)
    assert lens.surfaces == (SURFACES[0].__class__(thickness_mm=2.0, semi_aperture_mm=2.5, stop=True),
                             Surface(50.0, 4.0, "N-BK7", 8.0), BENT)
    assert (lens.aperture, lens.field, lens.sensor_mm) == (("stop", 2.5), ("image_height_mm", 12.2), (20.0, 14.0))
    assert lens.focus == "as given" and "a singlet" in lens.source
    assert build_system(lens).efl_mm == pytest.approx(49.0, abs=0.1)


@pytest.mark.parametrize("doe", ["Grating", "Binary2"])
def test_a_diffractive_element_of_deeplens_is_rejected(read, doe):
    with pytest.raises(LensError, match=f"DOE is {doe}: expected refracting surfaces"):
        read(DEEPLENS | {"DOE": {"type": doe, "d": 8.3, "order2": 0.0}})
    with pytest.raises(LensError, match="surface 2, diffraction is on: expected refracting surfaces"):
        read(deeplens(1, diffraction=True))
    assert read(deeplens(1, diffraction=False)).surfaces[1] == read(DEEPLENS).surfaces[1]


@pytest.mark.parametrize("changes, aspheric", [
    (dict(use_ai2=False), (0.0, 0.0, 1e-6, -2e-9)), (dict(use_ai2=True), (0.0, 1e-6, -2e-9)),
    (dict(ai=None, ai4=1e-6, ai8=-2e-9), (0.0, 1e-6, 0.0, -2e-9)), (dict(ai=None), ())])
def test_deeplens_aspheres_start_at_the_power_that_the_file_states(read, changes, aspheric):
    assert read(deeplens(2, **changes)).surfaces[2].aspheric == aspheric


def test_a_radius_of_0_is_a_plane_in_deeplens(read):
    assert np.isinf(read(deeplens(1, roc=0.0)).surfaces[1].radius_mm)


def test_a_cylinder_of_deeplens_is_curved_along_x(read):
    front = read(deeplens(1, type="Cylindric")).surfaces[1]
    assert front == Surface(np.inf, 4.0, "N-BK7", 8.0, radius_x_mm=50.0)


@pytest.mark.parametrize("material, glass", [("1.62041/60.3", "1.62041/60.3"), ("pmma", "1.4918/57.44"), ("air", ""),
                                             ("H-K51", "H-K51"), (None, "")])
def test_glasses_of_deeplens(read, material, glass):
    assert read(deeplens(1, mat2=material)).surfaces[1].glass == glass


@pytest.mark.parametrize("contents, message", [
    (deeplens(1, type="Fresnel"), "surface 2 is Fresnel: expected one of Spheric, Aspheric, Plane, Cylindric, Aper"),
    (deeplens(0, type="Plane"), "stop is missing: expected a surface of type Aperture or Stop"),
    ({name: value for name, value in DEEPLENS.items() if name != "d_sensor"}, "surface 3, d_next is missing"),
    (deeplens(1, roc=None), "prescription is damaged"),
    (deeplens(1, r=-1), "surface 2, semi_aperture_mm is -1.0"),
    ({"lenses": []}, "surface_group is missing: expected a file of Optiland's"), ([], "surface_group is missing")],
    ids=lambda value: None)
def test_invalid_lenses_of_deeplens_are_errors(read, contents, message):
    with pytest.raises(LensError, match=message):
        read(contents)


def test_lentil(read):
    lens = read(LENTIL, FIELD)
    assert lens.surfaces == (Surface(thickness_mm=2.0, semi_aperture_mm=2.5, stop=True),
                             Surface(50.0, 4.0, "1.5168/64.2", 8.0),
                             Surface(-50.0, 47.5, "", 8.0, aspheric=(0.0, 1e-6, -2e-9, 0.0, 0.0)))
    assert (lens.name, lens.aperture, lens.focus) == ("Nobody singlet", ("stop", 2.5), "best")
    assert "US1234567 1920" in lens.source and "zoom positions" in lens.notes


def test_a_lentil_iris_between_the_surfaces_of_a_lens_is_in_its_glass(read):
    entry = copy.deepcopy(LENTIL["0001"])
    rows = entry["optical-elements-patent"]
    rows[0], rows[1] = rows[1], rows[0]
    assert [surface.glass for surface in read({"7": entry}, FIELD).surfaces] == ["1.5168/64.2", "1.5168/64.2", ""]


def test_adjusted_elements_of_lentil_are_used(read):
    entry = copy.deepcopy(LENTIL["0001"])
    adjusted = copy.deepcopy(entry["optical-elements-patent"])
    adjusted[1]["radius"] = 50.5
    assert read({"7": entry | {"optical-elements-adjusted": adjusted}}, FIELD).surfaces[1].radius_mm == 50.5
    assert read({"7": entry | {"optical-elements-adjusted": []}}, FIELD).surfaces[1].radius_mm == 50.0


def test_one_of_several_lentil_lenses_must_be_named(read):
    other = LENTIL["0001"] | {"product-name": "other"}
    both = LENTIL | {"0002": other}
    assert read(both, FIELD, "0002").name == "Nobody other"
    with pytest.raises(LensError, match="--which is missing: expected one of 0001 Nobody singlet, 0002 Nobody other"):
        read(both, FIELD)
    with refused(LensError, field="--which", value="3", where="lens.json"):
        read(both, FIELD, "3")
    for contents in (DEEPLENS, optiland()):
        with pytest.raises(LensError, match="--which is 2: the file contains one lens"):
            read(contents, FIELD, "2")


def test_a_lens_of_lentil_needs_a_field_and_known_surfaces(read):
    with pytest.raises(LensError, match="field is missing: lentil does not state .*--field-angle"):
        read(LENTIL)
    bent = copy.deepcopy(LENTIL)
    bent["0001"]["optical-elements-patent"][1]["lens-geometry"] = "toric"
    with pytest.raises(LensError, match="surface 2 is toric: expected one of spherical, aspherical, cyl-x, cyl-y"):
        read(bent, FIELD)


@pytest.mark.parametrize("kind, changes", [("cyl-x", dict(radius_x_mm=np.inf)),
                                           ("cyl-y", dict(radius_mm=np.inf, radius_x_mm=50.0))])
def test_a_cylinder_of_lentil_is_straight_along_its_axis(read, kind, changes):
    contents = copy.deepcopy(LENTIL)
    row = contents["0001"]["optical-elements-patent"][1]
    row["lens-geometry"], contents["0001"]["focal-length-mm-patent"] = kind, 0
    contents["0001"]["optical-elements-patent"][2]["radius"] = -20.0
    assert read(contents, FIELD).surfaces[1] == replace(Surface(50.0, 4.0, "1.5168/64.2", 8.0), **changes)
    row["aspherical-equation"] = [1e-6]
    with pytest.raises(LensError, match=f"surface 2, aspherical-equation is .* expected none for {kind}"):
        read(contents, FIELD)
