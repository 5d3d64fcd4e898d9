"""Sphinx's configuration of the site: `make site` builds README.md, docs and the reference of the engine as they are.

The source folder is the repository's root, so that links between pages, and to pictures, are those that code hosts
follow. Nothing on the pages comes from other hosts.
"""

import re
from pathlib import Path
from shutil import copyfile

from docutils import nodes
from docutils.parsers.rst import Directive

import lensfield

project, author, copyright = "Lensfield", "The Lensfield developers", "2026, the Lensfield developers"
version = release = lensfield.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
root_doc = "README"
smartquotes = False
include_patterns = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/**.md", "docs/site/api.rst"]
exclude_patterns = [".*", "build", "dist"]

myst_enable_extensions = ["html_image"]
myst_heading_anchors = 6
myst_fence_as_directive = ["mermaid"]

add_module_names = False
autodoc_typehints = "none"  # numpydoc's sections state them
autodoc_preserve_defaults = True
default_role = "code"
numpydoc_class_members_toctree = numpydoc_show_class_members = False

html_theme = "furo"
html_title = f"Lensfield {version}"
html_favicon = "../../packaging/platform/icon.png"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_copy_source = html_show_sourcelink = html_use_index = False

CONTENTS = {
    "Start": ["docs/guide/install", "docs/guide/answers", "docs/gallery", "docs/lenses"],
    "For": ["Artists <docs/guide/artist>", "Scripters <docs/guide/scripts>", "Render farms <docs/farm>",
            "Camera engineers <docs/guide/engineer>"],
    "Reference": ["docs/guide/artist-reference", "docs/guide/spectra", "docs/camera", "docs/anamorphic",
                  "docs/photographs"],
    "Methods and accuracy": ["docs/depth", "docs/traced_lens", "docs/stray_light", "docs/truth", "docs/cornell_box",
                             "docs/stmap", "docs/calibration", "docs/measured", "docs/blenderproc", "docs/datasets",
                             "docs/reliability"],
    "Developers": ["docs/api", "docs/site/api", "CONTRIBUTING", "docs/architecture", "CHANGELOG"],
}
"""Pages in the side bar, by caption: for each kind of users, one page to begin with. Sphinx reports pages that are
missing."""
MARKS = re.compile(r"(`[^`]*`|^ *>>>.*(?:\n.+)*)|([*|])", re.MULTILINE)
"""Code, with its output, or a character that would be markup."""


class Mermaid(Directive):
    """A graph as a list of arrows: to draw it, browsers would need Mermaid's script and a window wider than a phone."""

    has_content = True

    def run(self):
        head, *lines = self.content
        pairs = re.findall(r'\["(.*?)"\] --> .*\["(.*?)"\]', "\n".join(lines))
        if len(pairs) != len(lines):
            raise self.error(f"{head}: expected only arrows between boxes")
        arrows = {}
        for room, other in pairs:
            arrows.setdefault(room, []).append(other)
        text = "\n".join(f"{room} → {', '.join(others)}" for room, others in arrows.items())
        return [nodes.literal_block(text, text, language="text")]


def add_contents(app, page, source):
    """Append the side bar's contents to the front page, where a code host would show them as text."""
    if page == root_doc:
        for caption, pages in CONTENTS.items():
            source[0] += "\n".join(["\n```{toctree}", ":hidden:", f":caption: {caption}\n", *pages, "```\n"])


def escape_marks(app, what, name, thing, options, lines):
    """Keep marks outside of code, as in `*place` and `|m|`, as they are: docstrings are not written as markup."""
    text = MARKS.sub(lambda match: match[1] or f"\\{match[2]}", "\n".join(lines))
    lines[:] = text.split("\n")


def write_index(app, error):
    """Web servers show index.html for a folder."""
    if not error:
        copyfile(Path(app.outdir, f"{root_doc}.html"), Path(app.outdir, "index.html"))


def setup(app):
    app.add_directive("mermaid", Mermaid)
    app.connect("autodoc-process-docstring", escape_marks, priority=400)  # before numpydoc's
    app.connect("source-read", add_contents)
    app.connect("build-finished", write_index)
