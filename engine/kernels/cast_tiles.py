"""Cast on the graphics processor or, where there is none, by rows of tiles in all threads."""

from collections.abc import Iterator

import numpy as np

from ..runtime.threads import thread_pool
from .cast import cast
from .casting import Casting
from .gpu import usable_gpu
from .gpu_calls import leaving_to_c
from .gpu_cast import gpu_cast
from .library import running


def cast_tiles(casting: Casting, blurred: np.ndarray, clear: np.ndarray) -> Iterator[float]:
    """Write the pixels of all tiles with rays, as `kernels.cast.cast`, and yield the completed fraction.

    If the graphics processor fails, or has too little memory, the loop in C casts all of them, after a warning.
    """
    running()  # refuses an unavailable implementation
    gpu = usable_gpu()
    if gpu:
        with leaving_to_c(gpu):
            yield from gpu_cast(gpu, casting, blurred, clear)
            return
    casting.make_levels()
    rows = len(casting.eights)
    with thread_pool() as pool:
        for completed, _ in enumerate(pool.map(lambda row: cast(casting, row, blurred, clear), range(rows)), 1):
            yield completed / rows
