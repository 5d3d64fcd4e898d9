"""The lens sheet: one picture of a lens's optical properties."""

import os
import textwrap
from collections.abc import Sequence

import numpy as np
from PIL import Image, PngImagePlugin

from ..lens import GridLens, Lens
from ..prescription.photographs import Agreement
from ..runtime.build_identity import software
from ..runtime.errors import InputError
from ..runtime.files import atomic_path
from .curves import preferred_frequencies_per_mm
from .grid_sheet import draw_grid_panels, grid_facts
from .page import MARGIN, SIDE, WORD_GAP, new_sheet, write
from .panels import FREQUENCY_COLOURS
from .psf_checks import ENCLOSED_LIGHT
from .radial_sheet import draw_radial_panels, radial_facts
from .style import PALE_INK, SMALL, TEXT, TITLE

HEAD, NAME_WIDTH = 24, 10.2  # inches
PALETTE_COLOURS, PAPER = 256, 248
LONGEST_NAME, LONGEST_LINE = 50, 140


def write_lens_plot(lens: Lens, path: str | os.PathLike,
                    frequencies_per_mm: Sequence[float] | None = None, photographs: Agreement | None = None) -> None:
    """Draw the sheet of a lens as a PNG: PSFs, distortion, MTF, relative illumination, lateral colour.

    The file appears complete or not at all.

    Parameters
    ----------
    lens : Lens
    path : path
    frequencies_per_mm : sequence of one to five floats, optional
        Frequencies of the MTF in cycles per mm; by default `preferred_frequencies_per_mm`.
    photographs : Agreement, optional
        How closely the lens agrees with photographs, which the sheet states. Its light is drawn next to the relative
        illumination: pass `Agreement.at` with the f-number and the focus of the lens.

    Raises
    ------
    LensError
        The distortion folds the picture, or PSFs are sampled too coarsely for a frequency.
    InputError
        The number of frequencies is not one to five.
    """
    frequencies_per_mm = preferred_frequencies_per_mm(lens) if frequencies_per_mm is None else frequencies_per_mm
    if not 1 <= len(frequencies_per_mm) <= len(FREQUENCY_COLOURS):
        raise InputError("lens sheet", "frequencies", f"{len(frequencies_per_mm)} of them",
                         f"expected 1 to {len(FREQUENCY_COLOURS)}")
    page = new_sheet()
    _draw(page, lens, frequencies_per_mm, photographs)
    _save(page.pixels(), path)


def _draw(page, lens, frequencies_per_mm, photographs):
    if isinstance(lens, GridLens):
        _draw_header(page, lens, grid_facts(lens), photographs)
        draw_grid_panels(page, lens, frequencies_per_mm)
    else:
        _draw_header(page, lens, radial_facts(lens), photographs)
        draw_radial_panels(page, lens, frequencies_per_mm, photographs.light if photographs else ())


def _save(pixels, path):
    """Write a PNG with a palette, a fifth of the size without one, because sheets of all lenses add up."""
    few = Image.fromarray(np.ascontiguousarray(pixels[::3, ::3]))  # enough to choose colours, in a ninth of the time
    chosen = few.quantize(PALETTE_COLOURS, method=Image.Quantize.MAXCOVERAGE, kmeans=1)
    palette = np.reshape(chosen.getpalette(), (-1, 3))
    palette[palette.min(axis=1) >= PAPER] = 255  # restores the paper's white, which quantisation averages with others
    chosen.putpalette(palette.ravel().tolist())
    texts = PngImagePlugin.PngInfo()
    texts.add_text("Software", software())
    with atomic_path(path) as temporary:
        Image.fromarray(pixels).quantize(palette=chosen, dither=Image.Dither.NONE).save(temporary, "PNG", optimize=True,
                                                                                       pnginfo=texts)


def _draw_header(page, lens, field_facts, photographs):
    """Draw name, maker, first-order data and story; at the foot, the agreement with photographs and the source of the
    figures."""
    top = right = SIDE - MARGIN
    name = _short(lens.name, LONGEST_NAME)
    box = page.write(MARGIN, top, name, page.fitting_size(name, HEAD, NAME_WIDTH, bold=True), "#000000", bold=True)
    maker = _short(lens.maker, 2 * LONGEST_NAME + 5 - 2 * len(name))
    size = page.fitting_size(maker, TITLE, right - box.right - WORD_GAP)
    page.write(right, top - 0.12, maker, size, across=1.0)
    write(page, MARGIN, top - 0.53, "      ".join(_facts(lens, *field_facts)), TITLE)
    write(page, MARGIN, top - 0.86, _wrapped(lens.story), TEXT, PALE_INK)
    enclosed = lens.enclosed_energy.min()
    windows = f"PSF windows contain at least {100 * enclosed:.3g} % of the light" if enclosed < ENCLOSED_LIGHT else ""
    agreement = f"Compared with photographs: {photographs.differences}" if photographs else ""
    foot = ". ".join(filter(None, (agreement, lens.source.rstrip(". "), windows)))
    write(page, MARGIN, 0.35, _wrapped(foot), SMALL - 1, PALE_INK)


def _wrapped(text):
    """The text wrapped to at most two lines of the width of the sheet."""
    return "\n".join(textwrap.wrap(text, LONGEST_LINE, max_lines=2, placeholder=" …"))


def _facts(lens, focal_length, field):
    distance = "infinity" if np.isinf(lens.object_distance_mm) else f"{lens.object_distance_mm:g} mm"
    first, last = lens.wavelengths_nm[[0, -1]]
    light = f"{first:.4g} to {last:.4g} nm, reference " if first < last else ""
    return [focal_length, f"f/{lens.f_number_effective:.3g}", f"field {field}",
            f"sensor {lens.sensor_mm[0]:g} × {lens.sensor_mm[1]:g} mm",
            f"object at {distance}", f"{light}{lens.reference_wavelength_nm:.4g} nm"]


def _short(text, most):
    text = " ".join(text.split())
    return text if len(text) <= most else text[:most - 1].rstrip() + "…"
