"""The inner loops, in C. Where there is no library of them for a machine, numpy does their work.

Whoever calls `turn`, `footprints`, `spread`, `waves` or `cast` has asked `running` before: where that is "numpy" there
is no library.
"""

from .cast import MEETING, SEQUENCES, TOGETHER, Casting, SeenLayer, cast, rays_shape
from .footprints import RadialGeometry, footprints
from .library import NUMPY, available, running
from .spreading import PackedTable, TablePlaces, spread
from .turning import TurnableSamples, turn
from .waves import waves

__all__ = ["MEETING", "NUMPY", "SEQUENCES", "TOGETHER", "Casting", "PackedTable", "RadialGeometry", "SeenLayer",
           "TablePlaces", "TurnableSamples", "available", "cast", "footprints", "rays_shape", "running", "spread",
           "turn", "waves"]
