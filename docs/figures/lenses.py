"""Generate the gallery of the bundled lenses, docs/lenses.md.

    python docs/figures/lenses.py docs/lenses.md

Each lens is shown with its picture engine/library/pictures/NAME.jpg, if this exists.
"""

import sys
from html import escape
from pathlib import Path

from lensfield.engine.inspection.illumination_band import relative_error
from lensfield.engine.inspection.info import NEAR_CORNER
from lensfield.engine.library import BUNDLED, bundled_lenses
from lensfield.engine.prescription.prescription import Prescription
from lensfield.engine.rays.rings import widest_notes

PICTURES = BUNDLED / "pictures"
WIDTH = 240  # of a picture on the page, in pixels
BAR = r"\|"  # within a cell of a table
HEAD = """# The lenses

{number} lenses, sorted by the year of the patent, or of the lens's introduction if that is certain. Each is a
prescription, `engine/library/prescriptions/NAME.toml`. *Figures* states the origin of all its figures, then of those
that differ: from the patent, published elsewhere, estimated from other figures or drawings, guessed, fitted to
photographs, or typical of photographed lenses. *Rims* is the uncertainty of the light wide open at 0.9 of the half
diagonal, where rims are not known exactly ([how](photographs.md#limits-of-the-light)). Notes list the assumptions.
Notes on apertures, computed from rays on the axis, report differences of more than 3 % from the f-number, or of the
stop from the file's (`engine/rays/axial_light.py`). Lenses are named after the designs in the files. The manufacturers
are not involved in this project, and their production lenses may differ from the patents. Eighteen were compared with
[photographs](photographs.md), and state their largest differences.

Each picture is taken wide open, at the distance at which the bust is equally large, or as close to it as the lens
focuses. Lamps behind it become discs of the lens's own shapes. The row below shows white points from the centre (left)
to the corner (right) in the plane of focus, 27 times as large as in the picture; outwards is to the right. Pictures of
anamorphic lenses are unsqueezed, and their points are as in the picture, towards its upper right corner.

    lensfield lens list portrait 85mm      # by name, maker, year, focal length or character
    lensfield lens check nikkor-85mm-f1.4  # check its figures

`docs/figures/lenses.py` generates this page.

| | lens | character | description | source |
|---|---|---|---|---|
"""


def gallery() -> str:
    """The text of the page."""
    shown = lenses()
    return HEAD.format(number=len(shown)) + "".join(map(row, shown))


def lenses() -> list[Prescription]:
    """The bundled lenses by year and name; those without a year are last."""
    return sorted(bundled_lenses().values(), key=lambda lens: (lens.year or sys.maxsize, lens.name))


def row(lens: Prescription) -> str:
    """A lens's line of the table."""
    picture = PICTURES / f"{lens.name}.jpg"
    text = escape(f"Bust in front of lamps, and points of light from centre to corner, through {lens.title}")
    shown = (f'<img src="../engine/library/pictures/{picture.name}" alt="{text}" width="{WIDTH}">'
             if picture.is_file() else "")
    error = relative_error(lens, [NEAR_CORNER])
    rims = "" if error is None else f"Rims: light ± {100 * error[0]:.0f} %"
    facts = lens.source, f"Figures: {lens.passport}", rims, str(lens.photographs or ""), lens.notes, *widest_notes(lens)
    cells = (shown, f"**{lens.title}**<br>`{lens.name}`<br>{lens.maker}", ", ".join(lens.character), lens.story,
             "<br>".join(filter(None, facts)))
    return f"| {' | '.join(cell.replace('|', BAR) for cell in cells)} |\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(gallery(), encoding="utf-8", newline="\n")
