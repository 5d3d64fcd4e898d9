"""What the project's plots share: matplotlib, where there is one, colours and sizes of type."""

from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, PALE_INK, GRID_COLOUR = "#333333", "#777777", "#DDDDDD"
TITLE, TEXT, SMALL = 13, 10.5, 9.5  # sizes of type on a lens sheet


def require_matplotlib() -> "type[Figure]":
    """matplotlib's Figure, which draws without a window; an InputError where there is none."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise InputError("matplotlib", "module", "not there", "pip install lensfield[plots]") from None
    return Figure


def degree_labels(degrees: np.ndarray) -> list[str]:
    """Angles as labels, with as many decimals as keep neighbours apart."""
    step = np.abs(np.diff(degrees)).min(initial=np.inf)
    decimals = int(np.clip(np.ceil(-np.log10(max(step, 1e-9) / 2)), 0, 3))
    return [f"{angle:.{decimals}f}°" for angle in degrees]
