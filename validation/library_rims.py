"""Fit the rims of the library's lenses to photographs in Lensfun's database, and state how closely they agree; give
similar lenses without photographs typical rims.

    python validation/library_rims.py [NAME ...]

rewrites the apertures of these lenses, or of all in `ESTIMATED_MM` and all that `may_be_typical`, in
engine/library/prescriptions, and `photographs` of all that are compared. Other lines stay as they are. `make lens-rims`
does that.
"""

import re
import sys
import tomllib

import numpy as np

from lensfield.engine.fitting.fit import DIGITS
from lensfield.engine.fitting.typical import is_like_measured, with_typical_rims
from lensfield.engine.library import bundled_names, prescription_of, prescription_path
from lensfield.engine.prescription.photographs import Agreement
from lensfield.engine.prescription.prescription import ESTIMATED, TYPICAL
from lensfield.engine.runtime.toml_fields import pairs
from photographs import ESTIMATED_MM, PHOTOGRAPHED, TODAY, fitted, light_differences, shape, source_of

OTHER_RIMS = {"arri-signature-prime-58mm": "for cinema cameras", "kodak-petzval-100mm": "for projectors",
              "muller-fisheye-25mm": "a fisheye", "zeiss-s-biogon-40mm": "for reproduction",
              "nikkor-58mm-f1.4": "the reference pictures of docs/depth.md are made with them",
              "nikkor-400mm-f2.8": "sharp at its closest focus only if rims block the edge of the beam",
              "zeiss-flektogon-20mm": "its surfaces 3 and 4 meet in the light of the corner"}
"""Lenses like the measured ones that keep estimated apertures, and why."""
SURFACE = re.compile(r"^  \{ .*\}", re.MULTILINE)
STATED_SIZE = re.compile(r"semi_aperture_mm = [^,} ]+")
OF_APERTURES = re.compile(r'(provenance = \{.*)apertures = "[^"]*"')
OF_PHOTOGRAPHS = re.compile(r"^photographs = .*\n", re.MULTILINE)
BEFORE = re.compile(r"^(?=coating = )", re.MULTILINE)  # the line that follows `provenance` in the library


def agreement(name, lens, fit=None):
    """The Agreement of a lens, with rims that are fitted or not."""
    differences, figures = light_differences(name, lens), shape(name)
    illumination = fit.judged if fit else max((np.abs(off).max() for _, off in differences), default=None)
    colours = [each for each in (figures.red_um, figures.blue_um) if each is not None]
    return Agreement(source_of(name), TODAY, illumination and round(float(illumination), DIGITS),
                     figures.distortion_um and round(float(figures.distortion_um), 1),
                     round(max(colours), 1) if colours else None)


def may_be_typical(name):
    """Whether rims of a lens are unknown, and those of lenses like it are known."""
    lens = prescription_of(name)
    return (lens.aperture_origin in (ESTIMATED, TYPICAL) and lens.radial and not lens.mirrors
            and is_like_measured(lens) and name not in OTHER_RIMS)


def with_apertures(text, prescription):
    """The text of a file with the apertures of a prescription, and their origin."""
    scale = tomllib.loads(text).get("scale", 1.0)
    sizes = iter(surface.semi_aperture_mm / scale for surface in prescription.surfaces)

    def sized(row):
        size_mm, line = next(sizes), row[0]
        if not np.isfinite(size_mm):
            return line
        written = f"semi_aperture_mm = {size_mm:.5g}"
        return STATED_SIZE.sub(written, line) if STATED_SIZE.search(line) else f"{line[:-2]}, {written} }}"

    resized, count = SURFACE.subn(sized, text)
    if count != len(prescription.surfaces):
        raise SystemExit(f"{prescription.name}: {count} lines with surfaces; expected one for each, "
                         f"{len(prescription.surfaces)}")
    return OF_APERTURES.sub(rf'\1apertures = "{prescription.aperture_origin}"', resized)


def with_agreement(text, agreed):
    """The text of a file with this Agreement."""
    figures = {name: value for name, value in vars(agreed).items() if value not in (None, ())}
    return BEFORE.sub(f"photographs = {{ {', '.join(pairs(figures, {}))} }}\n", OF_PHOTOGRAPHS.sub("", text), count=1)


def main(names):
    for name in names or bundled_names():
        path, lens, fit = prescription_path(name), prescription_of(name), None
        text = path.read_text(encoding="utf-8")
        if name in ESTIMATED_MM:
            fit = fitted(name)
            lens = fit.prescription
        elif may_be_typical(name):
            lens = with_typical_rims(lens)
        if lens is not prescription_of(name):
            text = with_apertures(text, lens)
        if name in PHOTOGRAPHED:
            text = with_agreement(text, agreement(name, lens, fit))
        path.write_text(text, encoding="utf-8", newline="\n")
        print(name, lens.aperture_origin, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
