"""The inner loops, in C. Where there is no library of them for a machine, numpy does their work.

Whoever calls `turn`, `footprints`, `spread` or `waves` has asked `running` before: where that is "numpy" there is no
library.
"""

from .footprints import RadialGeometry, footprints
from .library import NUMPY, available, running
from .spreading import PackedTable, TablePlaces, spread
from .turning import TurnableSamples, turn
from .waves import waves

__all__ = ["NUMPY", "PackedTable", "RadialGeometry", "TablePlaces", "TurnableSamples", "available", "footprints",
           "running", "spread", "turn", "waves"]
