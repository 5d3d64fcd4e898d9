"""The page that compares lenses with photographs: its tables, and a new comparison if lensfunpy is installed."""

import re
from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine.fitting.typical import FULL_FRAME, with_typical_rims
from lensfield.engine.inspection.illumination_band import ERRORS
from lensfield.engine.library import bundled_names, prescription_of
from lensfield.engine.prescription.photographs import Agreement
from lensfield.engine.prescription.prescription import FITTED, TYPICAL
from lensfield.engine.prescription.readers.toml import write_prescription
from library_rims import agreement, may_be_typical, with_agreement, with_apertures
from photographs import (
    ESTIMATED_MM,
    LIGHT_HEAD,
    PHOTOGRAPHED,
    RIMS_HEAD,
    SHAPE_HEAD,
    fitted,
    light_table,
    rims_row,
    shape_table,
    with_tables,
)
from places import ROOT
from typical_light import ERRORS_HEAD, PREDICTED_HEAD, RULE_HEAD, tables

NUMBER = re.compile(r"(?<![\w./-])[-+]?\d+(?:\.\d+)?(?![\w.-]*`)")
ROUNDING = {LIGHT_HEAD: 0.0101, RIMS_HEAD: 0.0301, SHAPE_HEAD: 1.01, RULE_HEAD: 0.0101, PREDICTED_HEAD: 0.0101,
            ERRORS_HEAD: 1.01}  # rounding, on other processors


def rows(text, head):
    """Lines of the table with this head."""
    lines = text.split(head + "\n", 1)[1].splitlines()[1:]
    return lines[:next((number for number, line in enumerate(lines) if not line.startswith("|")), len(lines))]


@pytest.fixture(scope="module")
def page():
    return (ROOT / "docs" / "photographs.md").read_text(encoding="utf-8")


def test_the_page_shows_each_lens_that_is_compared(page):
    shown = {row.split("`")[1] for head in (LIGHT_HEAD, SHAPE_HEAD) for row in rows(page, head)}
    assert shown == set(PHOTOGRAPHED) <= set(bundled_names())


def test_tables_are_replaced_whole(page):
    changed = with_tables(page, {SHAPE_HEAD: f"{SHAPE_HEAD}\n|---|\n| new |"})
    assert rows(changed, SHAPE_HEAD) == ["| new |"] and rows(changed, LIGHT_HEAD) == rows(page, LIGHT_HEAD)
    assert changed.split(SHAPE_HEAD)[0] == page.split(SHAPE_HEAD)[0]


@pytest.fixture
def lensfunpy():
    pytest.importorskip("lensfunpy", reason="Lensfun's data come with lensfunpy: make test-photographs")


def assert_alike(stated, renewed, head):
    assert NUMBER.sub("", stated) == NUMBER.sub("", renewed)
    for own, new in zip(NUMBER.findall(stated), NUMBER.findall(renewed), strict=True):
        assert abs(float(own) - float(new)) <= ROUNDING[head], f"{stated} against {renewed}"


@pytest.mark.parametrize("head, table", [(LIGHT_HEAD, light_table), (SHAPE_HEAD, shape_table)],
                         ids=["light", "distortion"])
def test_the_page_has_the_figures_of_a_new_run(page, lensfunpy, head, table):
    for stated, renewed in zip(rows(page, head), rows(table(), head), strict=True):
        assert_alike(stated, renewed, head)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", ESTIMATED_MM)
def test_a_new_fit_has_the_rims_of_the_page_and_of_the_library(page, lensfunpy, name):
    stated, = [row for row in rows(page, RIMS_HEAD) if f"`{name}`" in row]
    assert_alike(stated, rims_row(name), RIMS_HEAD)
    lens, fit = prescription_of(name), fitted(name)
    sizes_mm = [surface.semi_aperture_mm for surface in fit.prescription.surfaces]
    assert sizes_mm == pytest.approx([surface.semi_aperture_mm for surface in lens.surfaces], abs=0.03)
    assert agreement(name, lens, fit).figures == pytest.approx(lens.photographs.figures, abs=1.01, rel=0.1)
    assert lens.photographs.illumination == pytest.approx(fit.judged, abs=0.002)


@pytest.fixture(scope="module")
def typical():
    pytest.importorskip("lensfunpy", reason="Lensfun's data come with lensfunpy: make test-photographs")
    return tables()


@pytest.mark.parametrize("head", [RULE_HEAD, PREDICTED_HEAD, ERRORS_HEAD], ids=["rule", "predicted", "errors"])
def test_the_page_has_the_rule_and_the_errors_of_a_new_run(page, typical, head):
    for stated, renewed in zip(rows(page, head), rows(typical[head], head), strict=True):
        assert_alike(stated, renewed, head)


def test_the_engine_has_the_rule_and_the_errors_of_the_page(page):
    (rule,), errors = rows(page, RULE_HEAD), rows(page, ERRORS_HEAD)
    assert [float(cell) for cell in rule.split(" | ")[1:4]] == list(FULL_FRAME)
    for origin in ("estimated", "typical of photographed lenses"):
        stated = [[0, *(float(cell) / 100 for cell in re.findall(r"(\d+) %", row))]
                  for row in errors if row.startswith(f"| {origin} |")]
        assert stated == pytest.approx(np.array(ERRORS[origin]))


@pytest.mark.parametrize("name", ["kodak-ektar-52mm", "nikkor-28mm", "nikkor-z-35mm-f1.2", "pentax-macro-200mm",
                                  "zeiss-planar-80mm"])
def test_typical_rims_of_the_library_are_those_of_the_rule(name):
    lens = prescription_of(name)
    assert [surface.semi_aperture_mm for surface in with_typical_rims(lens).surfaces] == pytest.approx(
        [surface.semi_aperture_mm for surface in lens.surfaces], abs=0.03)


def test_the_library_states_which_lenses_are_compared_and_fitted():
    lenses = {name: prescription_of(name) for name in bundled_names()}
    assert {name for name, lens in lenses.items() if lens.photographs} == set(PHOTOGRAPHED)
    assert not any(lens.photographs.light for lens in lenses.values() if lens.photographs), "not ours to publish"
    by_origin = {origin: {name for name, lens in lenses.items() if lens.aperture_origin == origin}
                 for origin in (FITTED, TYPICAL)}
    assert by_origin == {FITTED: set(ESTIMATED_MM), TYPICAL: set(filter(may_be_typical, bundled_names()))}


def test_files_change_in_their_apertures_and_agreement_alone():
    lens = prescription_of("tessar-50mm")
    wider = replace(lens, surfaces=tuple(replace(surface, semi_aperture_mm=9.75) for surface in lens.surfaces),
                    provenance=(("apertures", FITTED),))
    text = re.sub(r"(provenance\..*\n)+", 'provenance = { apertures = "estimated" }\n', write_prescription(lens))
    agreed = Agreement("a source", "2026-11-29", 0.02)
    changed = with_agreement(with_apertures(text, wider), agreed)
    assert changed.count("semi_aperture_mm = 9.75") == len(lens.surfaces)
    assert f'provenance = {{ apertures = "{FITTED}" }}' in changed
    assert 'photographs = { source = "a source", date = "2026-11-29", illumination = 0.02 }\ncoating = ' in changed
    assert with_agreement(changed, agreed) == changed
    assert with_apertures(f"scale = 0.5\n{text}", wider).count("semi_aperture_mm = 19.5") == len(lens.surfaces)
    with pytest.raises(SystemExit, match=f"tessar-50mm: 1 lines with surfaces; .* each, {len(lens.surfaces)}"):
        with_apertures("surfaces = [\n  { radius_mm = 50 }\n]\n", wider)
