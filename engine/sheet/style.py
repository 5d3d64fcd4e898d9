"""What the project's drawings share: matplotlib, where there is one, and the ink."""

from ..errors import InputError

INK, PALE_INK, GRID_COLOUR = "#333333", "#777777", "#DDDDDD"
TITLE, TEXT, SMALL = 13, 10.5, 9.5  # sizes of type on a lens sheet


def require_matplotlib():
    """matplotlib's Figure, which draws without a window; an InputError where there is none."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise InputError("matplotlib", "module", "not there", "pip install lensfield[plots]") from None
    return Figure
