"""Icon, pictures and text of packaging/platform suit the page of an extensions platform, and are up to date."""

import re
import tomllib

import pytest
from PIL import Image

from lensfield.engine.library import bundled_names
from places import ROOT

PLATFORM = ROOT / "packaging" / "platform"
PICTURES = sorted(path.name for path in PLATFORM.iterdir() if path.suffix in (".jpg", ".png"))
PREVIEWS = [name for name in PICTURES if name[0].isdigit()]


def text(name):
    return (PLATFORM / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("name, size, mode", [("icon.png", (256, 256), "RGBA"), ("featured.jpg", (1920, 1080), "RGB")])
def test_icon_and_featured_picture_have_their_sizes(name, size, mode):
    with Image.open(PLATFORM / name) as picture:
        assert (picture.size, picture.mode) == (size, mode)


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_are_small(name):
    assert (PLATFORM / name).stat().st_size <= 300_000


def test_six_pictures_have_captions():
    captions = re.findall(r"(?m)^\| \[(\d\S+)\]\(\1\) \| \S.* \|$", text("README.md"))
    assert captions == PREVIEWS and len(PREVIEWS) == 6


def test_pictures_of_the_guide_are_those_of_the_guide():
    guide = {path.read_bytes() for path in (ROOT / "docs" / "guide" / "pictures").iterdir()}
    copied = [name for name in PREVIEWS if name != "1_lenses.jpg"]
    assert not [name for name in copied if (PLATFORM / name).read_bytes() not in guide], "make platform-pictures"


def test_the_description_counts_lenses_and_cameras():
    front_page = (ROOT / "README.md").read_text(encoding="utf-8")
    bodies, = re.findall(r"(\d+) measured camera bodies", front_page)
    counts = re.findall(r"(\d+) (lenses|camera bodies)", text("description.md"))
    assert counts == [(str(len(bundled_names())), "lenses"), (bodies, "camera bodies")]


def test_the_description_names_the_permissions_of_the_manifest():
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    section = text("description.md").partition("## Permissions\n")[2].partition("\n## ")[0]
    assert [name.lower() for name in re.findall(r"\*\*(\w+)\*\*", section)] == list(manifest["permissions"])
