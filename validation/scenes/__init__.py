"""The ordinary scenes, one module for each theme; `kit.py` has their parts."""

from . import (
    cameras,
    colour_management,
    files,
    film,
    lamps,
    materials,
    motion,
    objects,
    sets,
    textures,
    units,
    view_layers,
    worlds,
)
from .kit import ORDINARY

__all__ = ["ORDINARY", "cameras", "colour_management", "files", "film", "lamps", "materials", "motion", "objects",
           "sets", "textures", "units", "view_layers", "worlds"]
