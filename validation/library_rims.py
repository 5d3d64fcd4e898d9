"""Fit the rims of the library's lenses to photographs in Lensfun's database, and state how closely they agree.

    python validation/library_rims.py [NAME ...]

rewrites the apertures of these lenses, or of all in `BEFORE_FIT`, in engine/library/prescriptions, and
`photographs` of all that are compared. Other lines stay as they are. `make lens-rims` does that.
"""

import re
import sys

import numpy as np

from lensfield.engine.fitting.fit import DIGITS
from lensfield.engine.library import prescription_path
from lensfield.engine.prescription.photographs import Agreement
from lensfield.engine.prescription.prescription import FITTED
from lensfield.engine.runtime.toml_fields import pairs
from photographs import BEFORE_FIT, PHOTOGRAPHED, TODAY, fitted, light_differences, shape, source_of

SURFACE = re.compile(r"^  \{ .*\}", re.MULTILINE)
STATED_SIZE = re.compile(r"semi_aperture_mm = [^,} ]+")
OF_APERTURES = re.compile(r'(provenance = \{.*)apertures = "[^"]*"')
OF_PHOTOGRAPHS = re.compile(r"^photographs = .*\n", re.MULTILINE)
BEFORE = re.compile(r"^(?=coating = )", re.MULTILINE)  # the line that follows `provenance` in the library


def agreement(name, fit=None):
    """The Agreement of a lens, with fitted rims or as it is."""
    differences, figures = light_differences(name), shape(name)
    illumination = fit.judged if fit else max((np.abs(off).max() for _, off in differences), default=None)
    colours = [each for each in (figures.red_um, figures.blue_um) if each is not None]
    return Agreement(source_of(name), TODAY, illumination and round(float(illumination), DIGITS),
                     figures.distortion_um and round(float(figures.distortion_um), 1),
                     round(max(colours), 1) if colours else None)


def with_apertures(text, prescription):
    """The text of a file with the apertures of a prescription, which are fitted."""
    sizes = iter(surface.semi_aperture_mm for surface in prescription.surfaces)

    def sized(row):
        size_mm, line = next(sizes), row[0]
        if not np.isfinite(size_mm):
            return line
        written = f"semi_aperture_mm = {size_mm:g}"
        return STATED_SIZE.sub(written, line) if STATED_SIZE.search(line) else f"{line[:-2]}, {written} }}"

    return OF_APERTURES.sub(rf'\1apertures = "{FITTED}"', SURFACE.sub(sized, text))


def with_agreement(text, agreed):
    """The text of a file with this Agreement."""
    figures = {name: value for name, value in vars(agreed).items() if value not in (None, ())}
    return BEFORE.sub(f"photographs = {{ {', '.join(pairs(figures, {}))} }}\n", OF_PHOTOGRAPHS.sub("", text), count=1)


def main(names):
    for name in names or PHOTOGRAPHED:
        path = prescription_path(name)
        text, fit = path.read_text(encoding="utf-8"), None
        if name in BEFORE_FIT:
            fit = fitted(name)
            text = with_apertures(text, fit.prescription)
        agreed = agreement(name, fit)
        path.write_text(with_agreement(text, agreed), encoding="utf-8", newline="\n")
        print(name, agreed, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
