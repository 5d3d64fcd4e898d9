"""The lens: its design data as one frozen value, with its symmetry and conventions."""

from .lens import Lens

__all__ = ["Lens"]
