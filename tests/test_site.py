"""The check of the built site reports broken links, foreign files, and pictures that are large or lack a text; and the
reference lists the public names."""

import re

import pytest

import lensfield
from places import ROOT
from site_check import CHECKS, LARGEST_BYTES, broken_links, foreign_loads, large_pictures, pictures_without_text

GOOD = ('<a href="https://example.org/"></a><p id="part"></p><a href="sub/page.html#part"></a>'
        '<script src="own.js"></script><img src="own.png" alt="Two lenses">')
LOADS = ['<script src="https://example.org/x.js"></script>', '<img src="//example.org/x.png">',
         '<img srcset="https://example.org/x.png 2x">', '<link rel="stylesheet" href="https://example.org/x.css">',
         '<style>@import "https://example.org/x.css";</style>', '<p style="background: url(//example.org/x.png)">',
         '<script>fetch("https://example.org/x")</script>', '<iframe src="http://example.org"></iframe>']
BROKEN = ["missing.html", "sub", "#missing", "sub/page.html#missing"]


@pytest.fixture
def site(tmp_path):
    """A sound site of two pages and a script."""
    (tmp_path / "sub").mkdir()
    (tmp_path / "index.html").write_text(GOOD)
    (tmp_path / "sub" / "page.html").write_text('<h1 id="part"></h1><a href="../index.html#part"></a><a href="#"></a>')
    (tmp_path / "own.png").write_bytes(bytes(LARGEST_BYTES))
    (tmp_path / "own.js").write_text('draw("http://www.w3.org/2000/svg")  // https://example.org/licence')
    return tmp_path


def test_a_sound_site_has_no_findings(site):
    assert not [line for check in CHECKS for line in check(site)]


@pytest.mark.parametrize("element", LOADS)
def test_loads_from_other_hosts_are_reported(site, element):
    (site / "sub" / "page.html").write_text(element)
    finding, = foreign_loads(site)
    assert finding.startswith("sub/page.html") and "//example.org" in finding


@pytest.mark.parametrize("name, code", [("own.js", 'import("https://example.org/x.js")'),
                                        ("own.css", "@font-face { src: url('https://example.org/x.woff2') }")])
def test_loads_by_scripts_and_style_sheets_are_reported(site, name, code):
    (site / name).write_text(code)
    finding, = foreign_loads(site)
    assert finding.startswith(name) and "//example.org/x" in finding


@pytest.mark.parametrize("element", ['<a href="{}">', '<img src="{}">'])
@pytest.mark.parametrize("address", BROKEN)
def test_broken_links_are_reported(site, element, address):
    (site / "index.html").write_text(GOOD + element.format(address))
    assert list(broken_links(site)) == [f"index.html: no target for {address}"]


@pytest.mark.parametrize("text", ["", 'alt=""', 'alt=" "', 'alt="../own.png"'])
def test_pictures_without_text_are_reported(site, text):
    (site / "sub" / "page.html").write_text(f'<img src="../own.png" {text}>')
    assert list(pictures_without_text(site)) == ["sub/page.html: no text for ../own.png"]


def test_large_pictures_are_reported(site):
    (site / "sub" / "large.jpg").write_bytes(bytes(LARGEST_BYTES + 1))
    assert list(large_pictures(site)) == ["sub/large.jpg: 300001 bytes, more than 300000"]


def test_the_reference_lists_the_public_names():
    names = re.findall(r"^\.\. auto\w+:: (\w+)", (ROOT / "docs" / "site" / "api.rst").read_text(), re.MULTILINE)
    assert sorted(names) == sorted(lensfield.__all__)
