"""Macros with which users of Zemax, Code V and zospy export a lens in the form that `lensfield lens import` reads."""

from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np

from ..errors import InputError
from .sampling import HEIGHTS, WAVELENGTHS_NM

MACROS = Path(__file__).resolve().parent / "macros"
PROGRAMS = {"zemax": "zemax.zpl", "codev": "codev.seq", "zospy": "zospy.py.in"}
WAVELENGTH_LINES = {"zemax": "nm_of({number}) = {nm}", "codev": "^NM({number}) == {nm}", "zospy": "    {nm},"}
SAMPLES = tuple(2**power for power in range(5, 12))
MOST_HEIGHTS = 1000
RANGE = (1e-3, 1e5)  # of wavelengths, heights, pitch and sides, each in its own unit


@dataclass(frozen=True)
class ExportOptions:
    """What a macro is to export.

    Attributes
    ----------
    heights : int
        Number of field heights, evenly from 0 to the last.
    last_height_mm : float or None
        Paraxial image height of the last field; None for that of the lens's own outermost field.
    wavelengths_nm : sequence of float, ascending
    psf_samples : int
        Samples along each side of a PSF, a power of two.
    psf_pitch_um : float
        Distance between them.
    pupil_samples : int
        Sampling of the pupil, a power of two: with too few rays the PSF's window holds copies of the PSF.
    sensor_mm : (float, float) or None
        Width and height of the sensor; None where the reader is to choose.

    Raises
    ------
    InputError
        A value with which no lens could be exported.
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

    The macro takes one wavelength at a time and traces fields at paraxial image heights, as the macros of the paper
    do; unlike them it moves the height with the wavelength so that the object point stays.

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
    lines = (WAVELENGTH_LINES[program].format(number=number, nm=_plain(nm))
             for number, nm in enumerate(options.wavelengths_nm, 1))
    return template.substitute(_values(options), wavelength_lines="\n".join(lines))


class _MacroTemplate(Template):
    """`@{name}`, for the languages of the macros use $ themselves; `@@` is a plain @."""

    delimiter = "@"


def _values(options):
    """What fills a template, other than the lines of wavelengths."""
    width, height = options.sensor_mm or (0, 0)
    sensor = f"{_plain(width)} x {_plain(height)} mm" if options.sensor_mm else "4:3, its corner at the last height"
    last = "the outermost field" if options.last_height_mm is None else f"{_plain(options.last_height_mm)} mm"
    return {
        "heights": options.heights, "last_height": _plain(options.last_height_mm or 0), "last_height_text": last,
        "waves": len(options.wavelengths_nm), "points": options.heights * len(options.wavelengths_nm),
        "first_nm": _plain(options.wavelengths_nm[0]), "last_nm": _plain(options.wavelengths_nm[-1]),
        "psf_samples": options.psf_samples, "psf_doublings": _doublings(options.psf_samples),
        "pupil_samples": options.pupil_samples, "pupil_doublings": _doublings(options.pupil_samples),
        # An FFT's PSF repeats itself; twice the window keeps its copies out.
        "grid_samples": max(2 * options.psf_samples, options.pupil_samples),
        "pitch_um": _plain(options.psf_pitch_um), "pitch_mm": _plain(options.psf_pitch_um / 1000),
        "sensor_width": _plain(width), "sensor_height": _plain(height), "sensor_text": sensor}


def _doublings(samples):
    """Zemax's code for a sampling: 1 for 32, 2 for 64, ..."""
    return SAMPLES.index(samples) + 1


def _plain(number):
    """Digits without an exponent, which not all of the languages read."""
    return np.format_float_positional(number, precision=9, trim="-")


def _check_range(name, value):
    """None is no value; everything else must print as plain digits."""
    least, most = RANGE
    values = np.asarray([] if value is None else value)
    if not np.all((values >= least) & (values <= most)):
        raise InputError("options", name, value, f"expected {least:g} to {most:g}")
