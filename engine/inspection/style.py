"""Common parts of all plots: matplotlib, if it is installed, colours and font sizes."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..runtime.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, PALE_INK, GRID_COLOUR = "#333333", "#777777", "#DDDDDD"
FONT = "fonts/ttf/DejaVuSans.ttf"  # in matplotlib's data
TITLE, TEXT, SMALL = 13, 10.5, 9.5  # font sizes on a lens sheet


def require_matplotlib() -> "type[Figure]":
    """matplotlib's Figure, which draws without a window; raise an InputError if matplotlib is not installed."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise _missing() from None
    return Figure


def font_path() -> Path:
    """The TrueType file of the font of all plots; raise an InputError if matplotlib, which has it, is not installed."""
    try:
        import matplotlib
    except ImportError:
        raise _missing() from None
    return Path(matplotlib.get_data_path(), FONT)


def _missing():
    return InputError("matplotlib", "module", "not installed", "pip install lensfield[plots]")


def degree_labels(degrees: np.ndarray) -> list[str]:
    """Angles as labels, with enough decimals to distinguish neighbours."""
    step = np.abs(np.diff(degrees)).min(initial=np.inf)
    decimals = int(np.clip(np.ceil(-np.log10(max(step, 1e-9) / 2)), 0, 3))
    return [f"{angle:.{decimals}f}°" for angle in degrees]
