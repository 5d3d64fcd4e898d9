"""Matrix products on the calling thread.

Products are split into pieces small enough for BLAS to compute on the calling thread. Threads of BLAS would wait for
the engine's threads, many times longer than the products take, and results would depend on their number.
"""

import numpy as np

PIECE = 1 << 17  # multiply-adds: half of OpenBLAS's threshold for threads


def product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """left @ right, for matrices or stacks of as many matrices, in pieces of several rows."""
    *stack, rows, inner = left.shape
    together = max(1, PIECE // (inner * right.shape[-1]))
    if together >= rows:
        return left @ right
    count = -(-rows // together)
    pieces = np.zeros((*stack, count, together, inner), left.dtype)
    pieces.reshape(*stack, count * together, inner)[..., :rows, :] = left
    multiplied = pieces @ (right[..., None, :, :] if right.ndim > 2 else right)
    return multiplied.reshape(*multiplied.shape[:-3], count * together, right.shape[-1])[..., :rows, :]
