"""Methods to spread every point's light by its PSF, each in a module."""

from .exact import Exact
from .isoplanatic import OnePsf, Paper
from .method import Method
from .pixels import Pixels
from .polar_sections import Sections

METHODS: dict[str, type[Method]] = {method.name: method for method in (Sections, Pixels, Paper, Exact)}
"""The methods that users can choose, by name."""

__all__ = ["METHODS", "Method", "OnePsf", "Paper"]
