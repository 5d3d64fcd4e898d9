"""The gallery of lenses is up to date with the library."""


import pytest

from lensfield.engine.library import bundled_names, prescription_of
from places import ROOT
from scripts import script


@pytest.fixture(scope="module")
def gallery():
    return script("docs/figures/lenses.py")


@pytest.fixture(scope="module")
def page():
    return (ROOT / "docs" / "lenses.md").read_text(encoding="utf-8")


def test_the_gallery_lists_all_lenses_by_year(gallery, page):
    lenses = gallery.lenses()
    head = gallery.HEAD.format(number=len(lenses))
    assert page.startswith(head), "python docs/figures/lenses.py docs/lenses.md"
    for line, lens in zip(page.removeprefix(head).splitlines(), lenses, strict=True):
        assert f"<br>`{lens.name}`<br>" in line, "python docs/figures/lenses.py docs/lenses.md"


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", bundled_names())
def test_a_lens_of_the_gallery_is_up_to_date(gallery, page, name):
    assert gallery.row(prescription_of(name)) in page, "python docs/figures/lenses.py docs/lenses.md"
