"""The lens of a panel, loaded in threads: panels are drawn many times a second and must not wait for a bake.

Each scene has one request, its newest, which also stores the answer. The facts of a lens are available at once. It is
baked, at the quality and for the wavelengths of the render, as soon as its focus and f-stop stop changing.
"""

import traceback
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Event

import bpy

from ....engine import Lens
from ....engine.runtime.errors import InputError, LensError
from ....engine.runtime.files import stamp_of
from ...scene.active_camera import camera_settings
from ...scene.camera import SceneFrame, scene_frame
from ...scene.lens_cache import load_lens, loaded_lens
from ...scene.lens_facts import LensFacts, lens_facts
from ...scene.rings import rings_for
from .areas import redraw_panels
from .session import session

TICK_S = 0.2
AT_ONCE_S = 0.1  # a panel's wait for the lens facts, so that its lines do not flicker while a ring is turned
STILL_S = 0.4  # time without another request before a lens is baked
READING, BAKING = "Reading the lens", "Baking the lens"

_worker = ThreadPoolExecutor(2, "Lensfield lens")  # one may be busy with a dropped request for up to a second
_requests = {}  # by the scene's session_uid


class Dropped(Exception):
    """The request is obsolete."""


@dataclass(eq=False)
class Request:
    """A request for a lens, and the answer so far.

    Attributes
    ----------
    frame : SceneFrame or None
        None without a camera.
    lens : Lens or None
        Unscaled.
    error : InputError or None
        Why the lens is not available.
    fraction : float
        Progress of the bake, 0 to 1.
    """

    question: tuple
    frame: SceneFrame | None = None
    facts: LensFacts | None = None
    lens: Lens | None = None
    error: InputError | None = None
    fraction: float = 0.0
    known: Event = field(default_factory=Event)  # set once the facts or an error are available
    dropped: Event = field(default_factory=Event)
    future: Future | None = None

    def is_for(self, question, frame):
        """Whether this is the request for a lens and a frame; lenses with rotational symmetry serve all frames."""
        return self.question == question and (self.frame == frame or self.facts is not None and self.facts.radial)

    @property
    def label(self):
        """The current step, for the panel."""
        return BAKING if self.facts and self.facts.reach else READING

    def on_progress(self, fraction, label):
        """Record the progress of the bake; raises Dropped if the request is obsolete."""
        if self.dropped.is_set():
            raise Dropped
        self.fraction = fraction


def lens_request(scene):
    """The Request for a scene's current settings; its answer may still be pending."""
    settings = camera_settings(scene)
    name, focal_mm = settings.lens_name_or_path(), settings.id_data.lens if settings.view == "CAMERA" else None
    question = (name, stamp_of(name), rings_for(scene, name), focal_mm, _wavelengths_nm(scene.lensfield),
                scene.lensfield.to_spectral_options().tier)
    frame = scene_frame(scene, settings.view_text())
    request = _requests.get(scene.session_uid)
    if request is None or not request.is_for(question, frame):
        request = _ask(scene, question, frame)
    return request


def requested_lens(scene):
    """The lens of a scene's settings, unscaled; None until it is baked.

    Raises
    ------
    InputError
        The lens is not available.
    """
    request = lens_request(scene)
    if request.error:
        raise request.error.with_traceback(None)  # the traceback would grow with each redraw
    return request.lens


def lens_now(scene):
    """Like `requested_lens`, for operators in background mode: blocks until the lens is baked.

    Raises
    ------
    InputError
        The lens is not available.
    """
    request = lens_request(scene)
    name, _, rings, focal_mm, wavelengths_nm, quality = request.question
    facts = lens_facts(name, rings, focal_mm)
    return load_lens(name, facts.rings, quality, wavelengths_nm=wavelengths_nm,
                     edges_mm=request.frame and request.frame.edges_mm(facts))


def is_baking(scene):
    """Whether the lens of a scene's settings is not baked yet."""
    try:
        return bool(camera_settings(scene).lens_text()) and requested_lens(scene) is None
    except InputError:
        return False


def facts_now(scene):
    """The LensFacts of the lens in a scene's settings, which do not need a bake.

    Raises
    ------
    InputError
        The lens is not available.
    """
    request = lens_request(scene)
    request.known.wait()
    if request.error:
        raise request.error.with_traceback(None)
    return request.facts


def forget_requests():
    """Drop all requests, including running bakes."""
    for request in _requests.values():
        request.dropped.set()
    _requests.clear()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _wavelengths_nm(settings):
    """The wavelengths of a render; None while their text is not valid, which the plan in the panel reports."""
    try:
        return tuple(settings.wavelengths_nm().tolist())
    except InputError:
        return None


def _ask(scene, question, frame):
    other_uids = {each.session_uid for each in bpy.data.scenes} - {scene.session_uid}
    for uid in set(_requests) - other_uids:
        _requests.pop(uid).dropped.set()
    request = _requests[scene.session_uid] = Request(question, frame)
    request.future = _worker.submit(_answer, request)
    request.known.wait(AT_ONCE_S)
    if not bpy.app.background and not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=TICK_S, persistent=True)
    return request


def _tick():
    """Redraw the panels while lenses are being baked; returns seconds until the next call, or None."""
    finished = all(request.future.done() for request in _requests.values())
    redraw_panels()
    return None if finished else TICK_S


def _answer(request):
    """Read the facts of a lens, then bake it; runs in a thread."""
    name, _, rings, focal_mm, wavelengths_nm, quality = request.question
    try:
        request.facts = lens_facts(name, rings, focal_mm)
        request.known.set()
        rings, edges_mm = request.facts.rings, request.frame and request.frame.edges_mm(request.facts)
        if loaded_lens(name, rings, quality, wavelengths_nm, edges_mm) is None:
            _wait_until_settled(request)
        lens = load_lens(name, rings, quality, request.on_progress, wavelengths_nm, edges_mm)
        hash(lens)  # slow, and needed to look up plans: compute it in this thread
        request.lens = lens
    except Dropped:
        pass
    except InputError as error:
        request.error = error
    except Exception as error:  # in a thread, it would be lost
        if request.dropped.is_set():  # for example because Blender is quitting
            return
        traceback.print_exc()
        request.error = LensError(name, "lens", f"not available ({type(error).__name__})", str(error))
    finally:
        request.known.set()


def _wait_until_settled(request):
    """Wait STILL_S for a newer request, and until the preview is idle, so that it has the processor for itself.

    Raises
    ------
    Dropped
        A newer request has replaced this one.
    """
    seconds = STILL_S
    while request.dropped.wait(seconds) or _preview_is_at_work():
        if request.dropped.is_set():
            raise Dropped
        seconds = TICK_S


def _preview_is_at_work():
    return session.preview is not None and bool(session.preview.job)
