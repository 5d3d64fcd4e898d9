"""Threads that wait for something outside, such as a signal or the end of standard input; and flags to wait for."""

import threading
from collections.abc import Callable


class Flag(threading.Event):
    """A flag that one thread sets, and that others read or wait for."""


def wait_in_thread(wait: Callable[[], object], kind: str) -> None:
    """Call a function in a thread that does not keep the process alive, unless a thread of this kind exists."""
    name = f"Lensfield {kind}"
    if all(thread.name != name for thread in threading.enumerate()):
        threading.Thread(target=wait, name=name, daemon=True).start()
