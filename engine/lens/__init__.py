"""The lens: its design data as one frozen value, with its symmetry and conventions."""

from .grid_lens import GridLens
from .lens import Lens
from .radial_lens import RadialLens

__all__ = ["GridLens", "Lens", "RadialLens"]
