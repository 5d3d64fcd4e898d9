"""The lens sheet: one picture of a lens's optical properties."""

import os
import textwrap
from collections.abc import Sequence

import numpy as np

from ..lens.radial_lens import RadialLens
from ..runtime.build_identity import software
from ..runtime.errors import InputError
from ..runtime.files import atomic_path
from .curves import field_angle_rad, field_of, preferred_frequencies_per_mm
from .panels import FREQUENCY_COLOURS, draw_distortion, draw_illumination, draw_lateral_colour, draw_mtf
from .psf_checks import ENCLOSED_LIGHT
from .psf_map import BURNT_OUT, DECADES, draw_psf_map
from .style import INK, PALE_INK, SMALL, TEXT, TITLE, require_matplotlib

SIDE, DPI = 12, 140  # the sheet is square; inches, like all positions here
MARGIN, LEFT, RIGHT = 0.3, 1.05, 6.85  # of the sheet, and of its two columns
LEFT_WIDTH, RIGHT_WIDTH = 4.9, 4.4
MAP_TOP, MAP_HEIGHT = 9.55, 6.15
HEAD = 24
PALETTE_COLOURS, PAPER = 256, 248
LONGEST_NAME, LONGEST_LINE = 50, 140
HINTING = 0.97  # each letter of a smaller font may be up to a pixel wider
WORTH_REPORTING = 0.005  # of the light


def write_lens_plot(lens: RadialLens, path: str | os.PathLike,
                    frequencies_per_mm: Sequence[float] | None = None) -> None:
    """Draw the sheet of a lens as a PNG: PSFs, distortion, MTF, relative illumination, lateral colour.

    The file appears complete or not at all.

    Parameters
    ----------
    lens : RadialLens
    path : path
    frequencies_per_mm : sequence of one to five floats, optional
        Frequencies of the MTF in cycles per mm; by default `preferred_frequencies_per_mm`.

    Raises
    ------
    LensError
        The distortion folds the picture, or PSFs are sampled too coarsely for a frequency.
    InputError
        The number of frequencies is not one to five, or matplotlib is not installed.
    """
    figure = require_matplotlib()(figsize=(SIDE, SIDE), dpi=DPI, facecolor="white")
    _give_canvas(figure)
    frequencies_per_mm = preferred_frequencies_per_mm(lens) if frequencies_per_mm is None else frequencies_per_mm
    if not 1 <= len(frequencies_per_mm) <= len(FREQUENCY_COLOURS):
        raise InputError("lens sheet", "frequencies", f"{len(frequencies_per_mm)} of them",
                         f"expected 1 to {len(FREQUENCY_COLOURS)}")
    field = field_of(lens)
    _draw_header(figure, lens)
    _draw_psfs(figure, lens, field)
    draw_distortion(_panel(figure, RIGHT, 7.15, RIGHT_WIDTH, 2.9), lens, field)
    draw_mtf(_panel(figure, RIGHT, 3.9, RIGHT_WIDTH, 2.4), lens, field, frequencies_per_mm)
    draw_illumination(_panel(figure, LEFT, 0.95, LEFT_WIDTH, 1.8), lens, field)
    draw_lateral_colour(_panel(figure, RIGHT, 0.95, RIGHT_WIDTH, 1.8), lens, field)
    _save(figure, path)


def _give_canvas(figure):
    """Attach a canvas to the figure, which measuring and drawing texts requires."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)


def _save(figure, path):
    """Write a PNG with a palette, a fifth of the size without one, because sheets of all lenses add up."""
    from PIL import Image, PngImagePlugin

    figure.canvas.draw()
    pixels = np.ascontiguousarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])
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


def _panel(figure, left, bottom, width, height):
    return figure.add_axes(np.array((left, bottom, width, height)) / SIDE)


def _write(figure, left, top, text, size, colour=INK, **style):
    """Write text below a point, reduced to fit on the sheet. It may contain any characters, including dollars."""
    written = figure.text(left / SIDE, top / SIDE, text, fontsize=size, color=colour, va="top", parse_math=False,
                          **style)
    width = written.get_window_extent(figure.canvas.get_renderer()).width / DPI
    room = left - MARGIN if style.get("ha") == "right" else SIDE - MARGIN - left
    if width > room:
        written.set_fontsize(size * HINTING * room / width)


def _draw_header(figure, lens):
    """Draw name, maker, first-order data and story, and the source of the figures at the foot."""
    top = right = SIDE - MARGIN
    name = _short(lens.name, LONGEST_NAME)
    _write(figure, MARGIN, top, name, HEAD, "black", fontweight="bold")
    _write(figure, right, top - 0.12, _short(lens.maker, 2 * LONGEST_NAME + 5 - 2 * len(name)), TITLE, ha="right")
    _write(figure, MARGIN, top - 0.53, "      ".join(_facts(lens)), TITLE)
    _write(figure, MARGIN, top - 0.86, _wrapped(lens.story), TEXT, PALE_INK)
    enclosed = lens.enclosed_energy.min()
    windows = f"PSF windows contain at least {100 * enclosed:.3g} % of the light" if enclosed < ENCLOSED_LIGHT else ""
    foot = ". ".join(filter(None, (lens.source.rstrip(". "), windows)))
    _write(figure, MARGIN, 0.35, _wrapped(foot), SMALL - 1, PALE_INK)


def _wrapped(text):
    """The text wrapped to at most two lines of the width of the sheet."""
    return "\n".join(textwrap.wrap(text, LONGEST_LINE, max_lines=2, placeholder=" …"))


def _facts(lens):
    degrees = np.degrees(field_angle_rad(lens, lens.heights_mm[-1]))
    distance = "infinity" if np.isinf(lens.object_distance_mm) else f"{lens.object_distance_mm:g} mm"
    first, last = lens.wavelengths_nm[[0, -1]]
    light = f"{first:.4g} to {last:.4g} nm, reference " if first < last else ""
    return [f"f = {lens.efl_mm:#.4g}".rstrip(".") + " mm", f"f/{lens.f_number_effective:.3g}",
            f"field ±{degrees:.3g}°", f"sensor {lens.sensor_mm[0]:g} × {lens.sensor_mm[1]:g} mm",
            f"object at {distance}", f"{light}{lens.reference_wavelength_nm:.4g} nm"]


def _short(text, most):
    text = " ".join(text.split())
    return text if len(text) <= most else text[:most - 1].rstrip() + "…"


def _draw_psfs(figure, lens, field):
    """Draw the map of PSFs, and its colour bar."""
    _write(figure, LEFT, MAP_TOP + 0.76, "Point spread functions", TITLE)
    shown, right, bottom, hidden = draw_psf_map(figure, (LEFT, MAP_TOP), (LEFT_WIDTH, MAP_HEIGHT), lens, field)
    _write(figure, right, MAP_TOP + 0.72, "outwards →", TEXT, ha="right")
    bar = _panel(figure, right + 0.08, MAP_TOP - 1.6, 0.1, 1.55)
    figure.colorbar(shown, cax=bar, ticks=range(-DECADES, 1))
    bar.set_yticklabels([f"{10.0**decade:g}" for decade in range(-DECADES, 1)])
    bar.tick_params(labelsize=SMALL - 1, colors=INK, length=2, pad=2)
    bar.set_title("of peak", fontsize=SMALL - 1, color=INK, loc="left", pad=6)
    note = f"White light has equal energy; peaks are overexposed {BURNT_OUT:g} times."
    if hidden >= WORTH_REPORTING:
        note += (f"\nUp to {100 * hidden:.2g} % of a point's light is not shown: dimmer than 1/{10**DECADES} of its "
                 "peak, or beyond its tile.")
    _write(figure, LEFT, bottom - 0.04, note, SMALL - 1, PALE_INK)
