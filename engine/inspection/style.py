"""Common parts of all sheets and plots: colours, font sizes, labels of angles."""

import numpy as np

INK, PALE_INK, GRID_COLOUR = "#333333", "#777777", "#DDDDDD"
TITLE, TEXT, SMALL = 13, 10.5, 9.5  # font sizes on a lens sheet


def degree_labels(degrees: np.ndarray) -> list[str]:
    """Angles as labels, with enough decimals to distinguish neighbours."""
    step = np.abs(np.diff(degrees)).min(initial=np.inf)
    decimals = int(np.clip(np.ceil(-np.log10(max(step, 1e-9) / 2)), 0, 3))
    return [f"{angle:.{decimals}f}°" for angle in degrees]
