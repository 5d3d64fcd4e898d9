"""The gallery of lenses is up to date with the library."""

import importlib.util

from places import ROOT


def test_the_gallery_is_up_to_date():
    specification = importlib.util.spec_from_file_location("gallery", ROOT / "docs" / "lenses.py")
    gallery = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(gallery)
    assert (ROOT / "docs" / "lenses.md").read_text(encoding="utf-8") == gallery.gallery(), (
        "python docs/lenses.py docs/lenses.md")
