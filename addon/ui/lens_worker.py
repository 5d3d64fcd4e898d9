"""The lens of a panel, worked out in threads: panels are drawn many times a second, and wait for no bake.

Each scene has one question, its newest, and an answer is kept with its question. What a lens is comes at once; it is
baked as soon as nobody goes on turning its rings, as finely as a render will have it.
"""

import traceback
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Event

import bpy

from ...engine import Lens
from ...engine.errors import InputError, LensError
from ...engine.files import stamp_of
from ..scene.lens_cache import load_lens, loaded_lens
from ..scene.lens_facts import LensFacts, lens_facts
from ..scene.rings import rings_for
from . import preview, window_render

TICK_S = 0.2
AT_ONCE_S = 0.1  # that a panel waits for what a lens is, lest its lines come and go as a ring is turned
STILL_S = 0.4  # without another question, before a lens is baked
QUICKEST = "preview"
READING, BAKING = "Reading the lens", "Baking the lens"

_worker = ThreadPoolExecutor(2, "Lensfield lens")  # one may be at what nobody asks for any more, for a second
_requests = {}  # by the session_uid of the scene


class Dropped(Exception):
    """Nobody asks for it any more."""


@dataclass(eq=False)
class Request:
    """A question, and what is known of it so far.

    Attributes
    ----------
    lens : Lens or None
        Its own size.
    error : InputError or None
        Why there is none.
    fraction : float
        How far it is baked.
    """

    question: tuple
    facts: LensFacts | None = None
    lens: Lens | None = None
    error: InputError | None = None
    fraction: float = 0.0
    known: Event = field(default_factory=Event)  # what it is, or that it cannot be
    dropped: Event = field(default_factory=Event)
    future: Future | None = None

    @property
    def label(self):
        """What is being done."""
        return BAKING if self.facts and self.facts.reach else READING

    def tell(self, fraction, label):
        """Note how far it is baked."""
        if self.dropped.is_set():
            raise Dropped
        self.fraction = fraction


def lens_request(scene):
    """The Request that a scene's settings make now; the answer may be under way still."""
    settings, name = scene.lensfield, scene.lensfield.lens_name_or_path()
    camera = scene.camera.data if scene.camera and scene.camera.type == "CAMERA" else None
    focal_mm = camera.lens if camera and settings.view == "CAMERA" else None
    question = name, stamp_of(name), rings_for(scene, name), focal_mm, settings.to_spectral_options().tier
    request = _requests.get(scene.session_uid)
    if request is None or request.question != question:
        request = _ask(scene, question)
    return request


def asked_lens(scene):
    """The lens that a scene's settings ask for, as large as it is itself; None as long as it is baked.

    Raises
    ------
    InputError
        There is none.
    """
    request = lens_request(scene)
    if request.error:
        raise request.error.with_traceback(None)  # which would grow with each drawing
    return request.lens


def lens_now(scene, quality=None):
    """The same, baked while all waits, in a quality that may be another: for operators.

    Raises
    ------
    InputError
        There is none.
    """
    name, _, rings, focal_mm, asked = lens_request(scene).question
    return load_lens(name, lens_facts(name, rings, focal_mm).rings, quality or asked)


def quality_at_hand(scene):
    """The quality that a render will have, where its lens is there; else the quickest, for what holds in each."""
    request = lens_request(scene)
    return request.question[-1] if request.lens else QUICKEST


def forget_requests():
    """Drop them: what is baked comes to nothing."""
    for request in _requests.values():
        request.dropped.set()
    _requests.clear()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _ask(scene, question):
    there = {each.session_uid for each in bpy.data.scenes} - {scene.session_uid}
    for uid in set(_requests) - there:
        _requests.pop(uid).dropped.set()
    request = _requests[scene.session_uid] = Request(question)
    request.future = _worker.submit(_answer, request)
    request.known.wait(AT_ONCE_S)
    if not bpy.app.background and not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=TICK_S, persistent=True)
    return request


def _tick():
    """Draw anew what is told of lenses that are being baked; seconds to the next time."""
    done = all(request.future.done() for request in _requests.values())
    window_render.redraw_panels()
    return None if done else TICK_S


def _answer(request):
    """Find out what a lens is, then bake it; in a thread."""
    name, _, rings, focal_mm, quality = request.question
    try:
        request.facts = lens_facts(name, rings, focal_mm)
        request.known.set()
        asked = name, request.facts.rings, quality
        if loaded_lens(*asked) is None:
            _wait_until_still(request)
        lens = load_lens(*asked, request.tell)
        hash(lens)  # takes its time, and plans are looked up by it
        request.lens = lens
    except Dropped:
        pass
    except InputError as error:
        request.error = error
    except Exception as error:  # a thread's ends nowhere
        if request.dropped.is_set():  # as Blender ends, among others
            return
        traceback.print_exc()
        request.error = LensError(name, "lens", f"not to be had, of {type(error).__name__}", str(error))
    finally:
        request.known.set()


def _wait_until_still(request):
    """Let rings be turned on, and the preview have the processor for its own."""
    seconds = STILL_S
    while request.dropped.wait(seconds) or _preview_is_at_work():
        if request.dropped.is_set():
            raise Dropped
        seconds = TICK_S


def _preview_is_at_work():
    return preview.state["preview"] is not None and bool(preview.state["preview"].asked)
