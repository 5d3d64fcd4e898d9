"""Mirror lenses in the files of other programs: mirrors, the media around them, and central obstructions."""

import json
from dataclasses import replace

import numpy as np
import pytest

from lens_texts import DOT_LENS, changed, optiland_row
from lensfield.engine import LensError
from lensfield.engine.inspection.screen import check_prescription
from lensfield.engine.prescription.prescription import ALUMINIUM
from lensfield.engine.prescription.readers import ReadingOptions, read_prescription
from mirror_lens import GLASS, MIRROR_LENS, two_mirrors
from notes import unread

EPD_MM, FIELD = 14.0, ("image_height_mm", 4.3)
INDEX, ABBE = map(float, GLASS.split("/"))
EXPECTED = replace(
    MIRROR_LENS, aperture=("entrance_pupil_diameter_mm", EPD_MM), field=FIELD, sensor_mm=None, focus="as given",
    surfaces=tuple(replace(surface, reflectance=ALUMINIUM) for surface in MIRROR_LENS.surfaces))


def zemax(lens, unit_mm=1.0):
    """A Zemax file; obstructions of clear apertures are rings of CLAP, others are OBSC."""
    lines = ["MODE SEQ", "NAME mirror lens", f"UNIT {'CM' if unit_mm == 10 else 'MM'} X W X CM MR CPMM",
             f"ENPD {EPD_MM / unit_mm!r}", "FTYP 2 0 1 1 0 0 0", "XFLN 0", f"YFLN {FIELD[1] / unit_mm!r}",
             "WAVM 1 0.5875618 1", "PWAV 1", "SURF 0", "  TYPE STANDARD", "  CURV 0", "  DISZ INFINITY"]
    for number, surface in enumerate(lens.surfaces, 1):
        lines += [f"SURF {number}", *["  STOP"] * surface.stop, "  TYPE STANDARD",
                  f"  CURV {unit_mm / surface.radius_mm!r}", f"  CONI {surface.conic!r}",
                  f"  DISZ {surface.thickness_mm / unit_mm!r}"]
        if surface.mirror or surface.glass:
            lines.append("  GLAS MIRROR 0 0 1.5 40" if surface.mirror else
                         f"  GLAS ___BLANK 1 0 {INDEX} {ABBE} 0 0 0 0 0 0")
        inner, outer = surface.semi_obstruction_mm / unit_mm, surface.semi_aperture_mm / unit_mm
        lines += [f"  CLAP {inner!r} {outer!r} 0"] if np.isfinite(outer) else [f"  OBSC 0 {inner!r} 0"] * bool(inner)
    return "\n".join([*lines, f"SURF {len(lens.surfaces) + 1}", "  TYPE STANDARD", "  CURV 0", "  DISZ 0", ""])


def codev(lens):
    lines = ["RDM;LEN", "TITLE 'mirror lens'", f"EPD {EPD_MM!r}", "DIM M", "WL 587.5618", "REF 1",
             f"YIM {FIELD[1]!r}", "SO 0.0 0.1e14"]
    for surface in lens.surfaces:
        glass = "REFL" if surface.mirror else f"{INDEX:g}:{ABBE:g}" if surface.glass else ""
        radius_mm = 0.0 if np.isinf(surface.radius_mm) else surface.radius_mm
        lines.append(f"S {radius_mm!r} {surface.thickness_mm!r} {glass}")
        lines += ["  STO"] * surface.stop + [f"  CON; K {surface.conic!r}"] * bool(surface.conic)
        if np.isfinite(surface.semi_aperture_mm):
            lines.append(f"  CIR {surface.semi_aperture_mm!r}")
        if surface.semi_obstruction_mm:
            lines.append(f"  CIR OBS {surface.semi_obstruction_mm!r}")
    return "\n".join([*lines, "SI 0.0 0.0", "GO", ""])


def optiland(lens):
    rows, z, medium = [optiland_row(float("-inf"))], 0.0, None
    for surface in lens.surfaces:
        medium = {"type": "AbbeMaterial", "index": INDEX, "abbe": ABBE} if surface.glass else None
        ring = {"type": "RadialAperture", "r_max": surface.semi_aperture_mm, "r_min": surface.semi_obstruction_mm}
        row = optiland_row(z, "StandardGeometry", medium, radius=surface.radius_mm, conic=surface.conic,
                           aperture=ring if surface.semi_obstruction_mm or np.isfinite(ring["r_max"]) else None,
                           is_stop=surface.stop)
        row["interaction_model"]["is_reflective"] = surface.mirror
        rows.append(row)
        z += surface.thickness_mm
    return json.dumps({
        "name": "mirror lens", "aperture": {"type": "EPD", "value": EPD_MM},
        "surface_group": {"surfaces": [*rows, optiland_row(z)]}, "wavelengths": {"wavelengths": [
            {"value": 0.5875618, "is_primary": True}]},
        "fields": {"fields": [{"x": 0.0, "y": FIELD[1], "vx": 0.0, "vy": 0.0}], "telecentric": False,
                   "field_definition": {"field_type": "ParaxialImageHeightField"}}})


@pytest.mark.parametrize("name, text, tolerance", [
    ("lens.zmx", zemax(MIRROR_LENS), 1e-12), ("cm.zmx", zemax(MIRROR_LENS, 10.0), 1e-12),
    ("lens.seq", codev(MIRROR_LENS), 0), ("lens.json", optiland(MIRROR_LENS), 1e-12)])
def test_the_same_mirror_lens(tmp_path, name, text, tolerance):
    path = tmp_path / name
    path.write_text(text)
    lens = read_prescription(path)
    assert "Mirrors count as reflecting 90% of the light" in lens.notes and not unread(lens.notes)
    assert "no central obstruction" not in lens.notes
    for surface, expected in zip(lens.surfaces, EXPECTED.surfaces, strict=True):
        for field in ("radius_mm", "thickness_mm", "conic", "semi_aperture_mm", "semi_obstruction_mm"):
            assert getattr(surface, field) == pytest.approx(getattr(expected, field), rel=tolerance, abs=tolerance)
        for field in ("glass", "mirror", "stop", "reflectance", "pose"):
            assert getattr(surface, field) == getattr(expected, field)
    assert lens.aperture == (EXPECTED.aperture[0], pytest.approx(EPD_MM))
    assert lens.field == (FIELD[0], pytest.approx(FIELD[1]))


def test_a_missing_obstruction_is_reported(tmp_path):
    path = tmp_path / "lens.seq"
    path.write_text(codev(two_mirrors()))
    lens = read_prescription(path)
    assert "The file states no central obstruction" in lens.notes
    assert any(finding.field == "semi_obstruction_mm" for finding in check_prescription(lens))
    assert not any(finding.field == "semi_obstruction_mm" for finding in check_prescription(MIRROR_LENS))


@pytest.mark.parametrize("old, new, words", [
    ("OBSC 0 3.6", "OBSC 1 3.6", "surface 3, aperture is an obstruction in the shape of a ring: expected OBSC"),
    ("OBSC 0 3.6 0", "OBSC 0 3.6 0\n  OBDC 0 1", "surface 3, aperture is decentred: expected a centred circle"),
    ("DISZ -15.4", "DISZ 15.4", "thickness_mm is 13.6 in total up to the mirror, surface 7: expected a negative"),
    ("GLAS MIRROR 0 0 1.5 40\n  CLAP", "CLAP", "mirrors is 1")])
def test_refused_mirror_lenses(tmp_path, old, new, words):
    path = tmp_path / "lens.zmx"
    path.write_text(changed(zemax(MIRROR_LENS), (old, new)))
    with pytest.raises(LensError, match=words):
        read_prescription(path)


def test_a_ring_and_an_obstruction_on_one_surface_block_as_far_as_the_wider(tmp_path):
    path = tmp_path / "lens.zmx"
    path.write_text(changed(zemax(MIRROR_LENS), ("CLAP 0.0 3.6 0", "CLAP 1.0 3.6 0\n  OBSC 0 1.5 0")))
    assert read_prescription(path).surfaces[6].semi_obstruction_mm == 1.5


def test_dot_lens_files_cannot_contain_mirrors(tmp_path):
    path = tmp_path / "lens.lens"
    path.write_text(changed(DOT_LENS, ("4.0000", "-4.0000")))
    with pytest.raises(LensError, match="line 12, thickness is -4.0000: this is a mirror lens, and rows"):
        read_prescription(path, ReadingOptions(FIELD))


def test_labels_of_apertures_and_drawn_holes_of_code_v(tmp_path):
    path = tmp_path / "lens.seq"
    path.write_text(changed(codev(MIRROR_LENS), ("CIR OBS 3.6", "CIR L'B' 9.5; CIR OBS L'A' 3.6"),
                            ("CIR OBS 3.2", "CIR HOL 3.1; CUM 0.0; THM 4.0")))
    lens = read_prescription(path)
    assert (lens.surfaces[2].semi_aperture_mm, lens.surfaces[2].semi_obstruction_mm) == (9.5, 3.6)
    assert lens.surfaces[4].semi_obstruction_mm == 0 and not unread(lens.notes)
