"""The page of lenses beside photographs: its tables, and a new run of the comparison if lensfunpy is installed."""

import re

import pytest

from lensfield.engine.library import bundled_names
from photographs import LIGHT_HEAD, PHOTOGRAPHED, SHAPE_HEAD, tables, with_tables
from places import ROOT

NUMBER = re.compile(r"(?<![\w./-])[-+]?\d+(?:\.\d+)?(?![\w.-]*`)")
ROUNDING = {LIGHT_HEAD: 0.0101, SHAPE_HEAD: 1.01}  # a unit of the last digit: rounding, on other processors


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


def test_the_page_has_the_figures_of_a_new_run(page):
    pytest.importorskip("lensfunpy", reason="Lensfun's data come with lensfunpy: make test-photographs")
    for head, text in tables().items():
        for stated, renewed in zip(rows(page, head), rows(text, head), strict=True):
            assert NUMBER.sub("", stated) == NUMBER.sub("", renewed)
            for own, new in zip(NUMBER.findall(stated), NUMBER.findall(renewed), strict=True):
                assert abs(float(own) - float(new)) <= ROUNDING[head], f"{stated} against {renewed}"
