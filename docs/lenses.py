"""The gallery of the library's lenses, docs/lenses.md.

    python docs/lenses.py docs/lenses.md

Each lens shows the picture engine/library/pictures/NAME.jpg, where there is one.
"""

import sys
from pathlib import Path

from lensfield.engine.bake.prescription import Prescription
from lensfield.engine.library import BUNDLED, bundled_lenses

PICTURES = BUNDLED / "pictures"
WIDTH = 240  # of a picture, as the page shows it
HEAD = """# The lenses

{number} lenses, by the years of their designs, each with what it is made of: `engine/library/prescriptions/NAME.toml`.
Figures are those of the patents that are named; what they leave open, and who typed them, the files' own notes tell.
Names say whose design a file follows; the makers have no part in this, and what they sold may differ from patents.

    lensfield lens list portrait 85mm      # by name, maker, year, focal length, character
    lensfield lens check nikkor-85mm-f1.4  # what speaks against its figures

`docs/lenses.py` writes this page.

| | lens | character | what it is | source |
|---|---|---|---|---|
"""


def gallery() -> str:
    """The page."""
    lenses = sorted(bundled_lenses().values(), key=lambda lens: (lens.year or sys.maxsize, lens.name))
    return HEAD.format(number=len(lenses)) + "".join(map(row, lenses))


def row(lens: Prescription) -> str:
    """A lens as a line of the table."""
    picture = PICTURES / f"{lens.name}.jpg"
    shown = f'<img src="../engine/library/pictures/{picture.name}" width="{WIDTH}">' if picture.is_file() else ""
    cells = (shown, f"**{lens.title}**<br>`{lens.name}`<br>{lens.maker}", ", ".join(lens.character), lens.story,
             lens.source)
    return f"| {' | '.join(cells)} |\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(gallery(), encoding="utf-8", newline="\n")
