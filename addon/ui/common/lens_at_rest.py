"""The facts of a scene's lens with its rings at rest, read in a thread: this takes a fraction of a second, and drawing
must not wait for it."""

from concurrent.futures import ThreadPoolExecutor, wait
from functools import lru_cache

from ....engine.runtime.files import stamp_of
from ...scene.active_camera import camera_settings
from ...scene.lens_facts import LensFacts, lens_facts

MOST_LENSES = 4

_worker = ThreadPoolExecutor(1, "Lensfield facts")


def facts_at_rest(scene, longest_s: float | None = 0.0) -> LensFacts | None:
    """The LensFacts of a scene's lens with its rings at rest; None if they are not available within this
    time; without one, it is awaited.

    Raises
    ------
    InputError
        The lens is not available.
    """
    lens = camera_settings(scene).lens_name_or_path()
    future = _read(lens, stamp_of(lens))
    wait([future], longest_s)
    return future.result() if future.done() else None


def forget_facts():
    """Clear the cache."""
    _read.cache_clear()


@lru_cache(maxsize=MOST_LENSES)
def _read(lens, changed):
    return _worker.submit(lens_facts, lens)
