"""The inner loops in C. On a machine without their compiled library, numpy is used instead.

Check `running` before calling `turn`, `footprints`, `spread`, `waves` or `cast`: if it returns "numpy", the library is
missing.
"""

from .cast import MEETING, SEQUENCES, TOGETHER, Casting, LayerArrays, cast, rays_shape
from .footprints import RadialGeometry, footprints
from .library import NUMPY, available, running
from .spreading import PackedTable, TablePlaces, spread
from .turning import TurnableSamples, turn
from .waves import waves

__all__ = ["MEETING", "NUMPY", "SEQUENCES", "TOGETHER", "Casting", "PackedTable", "RadialGeometry", "LayerArrays",
           "TablePlaces", "TurnableSamples", "available", "cast", "footprints", "rays_shape", "running", "spread",
           "turn", "waves"]
