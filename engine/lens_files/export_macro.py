"""Macros for Zemax, Code V and zospy that export a lens in the format that `lensfield lens import` reads."""

from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np

from ..lens.conventions import HEIGHTS, WAVELENGTHS_NM
from ..runtime.errors import InputError

MACROS = Path(__file__).resolve().parent / "macros"
PROGRAMS = {"zemax": "zemax.zpl", "codev": "codev.seq", "zospy": "zospy.py.in"}
WAVELENGTH_LINES = {"zemax": "nm_of({number}) = {nm}", "codev": "^NM({number}) == {nm}", "zospy": "    {nm},"}
SAMPLES = tuple(2**power for power in range(5, 12))
MOST_HEIGHTS = 1000
RANGE = (1e-3, 1e5)  # of wavelengths, heights, pitch and sides, each in its unit


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export macro.

    Attributes
    ----------
    heights : int
        Number of field heights, evenly spaced from 0 to the last.
    last_height_mm : float or None
        Paraxial image height of the last field; None for the lens's outermost field.
    wavelengths_nm : sequence of float, ascending
    psf_samples : int
        Samples along each side of a PSF, a power of two.
    psf_pitch_um : float
        Distance between them.
    pupil_samples : int
        Samples across the pupil, a power of two: with too few, the PSF's window contains copies of the PSF.
    sensor_mm : (float, float) or None
        Width and height of the sensor; None to let the reader choose.

    Raises
    ------
    InputError
        A value is out of range.
    """

    heights: int = HEIGHTS
    last_height_mm: float | None = None
    wavelengths_nm: tuple[float, ...] = WAVELENGTHS_NM
    psf_samples: int = 64
    psf_pitch_um: float = 0.5
    pupil_samples: int = 128
    sensor_mm: tuple[float, float] | None = None

    def __post_init__(self):
        if not 2 <= self.heights <= MOST_HEIGHTS:
            raise InputError("options", "heights", self.heights, f"expected 2 to {MOST_HEIGHTS}")
        for name in ("psf_samples", "pupil_samples"):
            if getattr(self, name) not in SAMPLES:
                raise InputError("options", name, getattr(self, name),
                                 f"expected one of {', '.join(map(str, SAMPLES))}")
        if not len(self.wavelengths_nm) or not np.all(np.diff(self.wavelengths_nm) > 0):
            raise InputError("options", "wavelengths_nm", self.wavelengths_nm, "expected ascending values")
        for name in ("wavelengths_nm", "last_height_mm", "psf_pitch_um", "sensor_mm"):
            _check_range(name, getattr(self, name))


def export_macro(program: str, options: ExportOptions) -> str:
    """The text of a macro that exports a lens from a lens-design program.

    The macro processes one wavelength at a time and traces fields at paraxial image heights, like the macros of the
    paper. Unlike them, it adapts the height to the wavelength so that the object point stays the same.

    Parameters
    ----------
    program : {'zemax', 'codev', 'zospy'}
        A ZPL macro, a Code V sequence, or a Python script for zospy.
    options : ExportOptions

    Returns
    -------
    str, ASCII
    """
    if program not in PROGRAMS:
        raise InputError("options", "program", program, f"expected one of {', '.join(PROGRAMS)}")
    template = _MacroTemplate((MACROS / PROGRAMS[program]).read_text(encoding="ascii"))
    lines = (WAVELENGTH_LINES[program].format(number=number, nm=_decimal(nm))
             for number, nm in enumerate(options.wavelengths_nm, 1))
    return template.substitute(_values(options), wavelength_lines="\n".join(lines))


class _MacroTemplate(Template):
    """`@{name}`, because $ has a meaning in the languages of the macros; `@@` is written for @."""

    delimiter = "@"


def _values(options):
    """Values for a template's placeholders, except for the lines of wavelengths."""
    width, height = options.sensor_mm or (0, 0)
    sensor = f"{_decimal(width)} x {_decimal(height)} mm" if options.sensor_mm else "4:3, its corner at the last height"
    last = "the outermost field" if options.last_height_mm is None else f"{_decimal(options.last_height_mm)} mm"
    return {
        "heights": options.heights, "last_height": _decimal(options.last_height_mm or 0), "last_height_text": last,
        "waves": len(options.wavelengths_nm), "points": options.heights * len(options.wavelengths_nm),
        "first_nm": _decimal(options.wavelengths_nm[0]), "last_nm": _decimal(options.wavelengths_nm[-1]),
        "psf_samples": options.psf_samples, "psf_doublings": _doublings(options.psf_samples),
        "pupil_samples": options.pupil_samples, "pupil_doublings": _doublings(options.pupil_samples),
        # The PSF of an FFT is periodic; twice the window excludes its copies.
        "grid_samples": max(2 * options.psf_samples, options.pupil_samples),
        "pitch_um": _decimal(options.psf_pitch_um), "pitch_mm": _decimal(options.psf_pitch_um / 1000),
        "sensor_width": _decimal(width), "sensor_height": _decimal(height), "sensor_text": sensor}


def _doublings(samples):
    """Zemax's code for a sampling: 1 for 32, 2 for 64, ..."""
    return SAMPLES.index(samples) + 1


def _decimal(number):
    """Digits without an exponent, which some of the languages cannot read."""
    return np.format_float_positional(number, precision=9, trim="-")


def _check_range(name, value):
    """Raise an InputError for a value that cannot be written without an exponent. None passes."""
    least, most = RANGE
    values = np.asarray([] if value is None else value)
    if not np.all((values >= least) & (values <= most)):
        raise InputError("options", name, value, f"expected {least:g} to {most:g}")
