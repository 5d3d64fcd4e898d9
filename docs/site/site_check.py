"""Check a built site: its links within it have targets, browsers load nothing from other hosts for it, its pictures are
small, and each has a text for readers who do not see it.

    python docs/site/site_check.py build/site
"""

import re
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

FOLLOWED = "a", "area"  # by the reader's choice; browsers load what other elements name
ADDRESSES = "href", "src", "srcset", "poster", "data"
IN_CODE = re.compile(r"""(?:url\(|["'`])\s*["']?((?!http://www\.w3\.org/)(?:https?:)?//\w[^\s"'`)]*)""")
"""In scripts and style sheets, an address on another host. Addresses on w3.org only name XML formats."""
PICTURES = ".gif", ".jpg", ".png", ".svg", ".webp"
LARGEST_BYTES = 300_000  # of a picture, for readers on a phone


class Page(HTMLParser):
    """The names of a page's parts, the addresses that it links to and that browsers load for it, its code, and the
    addresses and texts of its pictures."""

    def __init__(self, path):
        super().__init__()
        self.names, self.followed, self.loaded, self.code, self.pictures = {""}, [], [], "", []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        attributes = {name: value or "" for name, value in attrs}
        self.names |= {attributes[name] for name in ("id", "name") if name in attributes}
        self.code += f'"{attributes.get("style", "")}"'
        addresses = self.followed if tag in FOLLOWED else self.loaded
        if tag == "img":
            self.pictures.append((attributes.get("src", ""), attributes.get("alt", "")))
        addresses += [attributes[name].split()[0] for name in ADDRESSES if attributes.get(name)]

    def handle_data(self, data):
        if self.cdata_elem:  # script or style
            self.code += data


def foreign_loads(folder):
    """What browsers load from other hosts, as lines "FILE: ADDRESS"."""
    for path in sorted(folder.rglob("*")):
        addresses = []
        if path.suffix == ".html":
            page = _page(path)
            addresses = [address for address in page.loaded if urlsplit(address).netloc] + IN_CODE.findall(page.code)
        elif path.suffix in (".css", ".js"):
            addresses = IN_CODE.findall(path.read_text(encoding="utf-8"))
        yield from (f"{path.relative_to(folder)}: loads {address}" for address in addresses)


def broken_links(folder):
    """Links within the site to missing files, or to missing parts of pages, as lines "FILE: ADDRESS"."""
    for path in sorted(folder.rglob("*.html")):
        page = _page(path)
        for address in [*page.followed, *page.loaded]:
            if not _exists(path, urlsplit(address)):
                yield f"{path.relative_to(folder)}: no target for {address}"


def pictures_without_text(folder):
    """Pictures without a text in place of them, as lines "FILE: ADDRESS"; Sphinx repeats the address there."""
    for path in sorted(folder.rglob("*.html")):
        yield from (f"{path.relative_to(folder)}: no text for {address}" for address, text in _page(path).pictures
                    if not text.strip() or text == address)


def large_pictures(folder):
    """Pictures of more than LARGEST_BYTES, as lines "FILE: BYTES"."""
    for path in sorted(folder.rglob("*")):
        if path.suffix in PICTURES and path.stat().st_size > LARGEST_BYTES:
            yield f"{path.relative_to(folder)}: {path.stat().st_size} bytes, more than {LARGEST_BYTES}"


def _exists(path, link):
    if link.scheme or link.netloc:
        return True
    target = path.parent / unquote(link.path) if link.path else path
    return target.is_file() and (target.suffix != ".html" or unquote(link.fragment) in _page(target.resolve()).names)


@cache
def _page(path):
    return Page(path)


CHECKS = foreign_loads, broken_links, pictures_without_text, large_pictures

if __name__ == "__main__":
    site = Path(sys.argv[1]).resolve()
    findings = [line for check in CHECKS for line in check(site)]
    print(*findings, f"{len(findings)} findings in {len([*site.rglob('*.html')])} pages", sep="\n")
    sys.exit(bool(findings))
