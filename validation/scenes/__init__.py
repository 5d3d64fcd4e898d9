"""The ordinary scenes, one module for each theme; `kit.py` has what they are made of."""

from . import worlds
from .kit import ORDINARY

__all__ = ["ORDINARY", "worlds"]
