"""Memory to keep things in, up to a limit."""

import threading


class MemoryBudget:
    """Memory that may be taken for good, a piece at a time, by any thread."""

    def __init__(self, size_bytes: float) -> None:
        self._left, self._lock = size_bytes, threading.Lock()

    def take(self, size_bytes: int) -> bool:
        """Whether so much is left; then it is taken."""
        with self._lock:
            if size_bytes > self._left:
                return False
            self._left -= size_bytes
            return True
