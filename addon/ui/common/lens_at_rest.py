"""The facts of a scene's lens with its rings at rest, read in a thread: this takes a fraction of a second."""

from lensfield.engine.runtime.files import stamp_of

from ...scene.active_camera import camera_settings
from ...scene.lens_facts import LensFacts, lens_facts
from .background import Answers

MOST_LENSES = 4


def facts_at_rest(scene, longest_s: float | None = 0.0) -> LensFacts | None:
    """The LensFacts of a scene's lens with its rings at rest; None if they are not available within this
    time; without one, it is awaited.

    Raises
    ------
    InputError
        The lens is not available.
    """
    lens = camera_settings(scene).lens_name_or_path()
    work = _facts.to(lens, stamp_of(lens))
    work.wait(longest_s)
    return work.result() if work.done() else None


def _facts_of_file(lens, changed):
    return lens_facts(lens)


_facts = Answers(_facts_of_file, MOST_LENSES)
forget_facts = _facts.forget
