"""The lens of a panel, loaded in threads: panels are drawn many times a second and must not wait for a bake.

Each scene has one request, its newest, which also stores the answer. The facts of a lens are available at once. It is
baked, at the quality and for the wavelengths of the render, as soon as its focus and f-stop stop changing.
"""

from dataclasses import dataclass, field

import bpy

from lensfield.engine.runtime.background_work import Work
from lensfield.engine.runtime.errors import InputError, Stopped
from lensfield.engine.runtime.files import stamp_of
from lensfield.engine.runtime.waiting import Flag

from ...scene.active_camera import camera_settings
from ...scene.camera import SceneFrame, scene_frame
from ...scene.lens_cache import load_lens, loaded_lens
from ...scene.lens_facts import lens_facts
from ...scene.rings import rings_for
from .background import Worker, note_progress
from .session import session

IDLE_S = 0.2  # between looks whether the preview is idle
AT_ONCE_S = 0.1  # a panel's wait for the lens facts, so that its lines do not flicker while a ring is turned
STILL_S = 0.4  # time without another request before a lens is baked
READING, BAKING = "Reading the lens", "Baking the lens"

_reader = Worker("facts")
_baker = Worker("bake", threads=2)  # one may be busy with a dropped request for up to a second
_requests = {}  # by the scene's session_uid


@dataclass(eq=False)
class Request:
    """A request for a lens.

    Attributes
    ----------
    frame : SceneFrame or None
        None without a camera.
    read : Work
        Of the LensFacts.
    baked : Work
        Of the Lens, unscaled.
    fraction : float
        Progress of the bake, 0 to 1.
    dropped : Flag
        Set when the request is obsolete: its bake then ends with Stopped.
    """

    question: tuple
    frame: SceneFrame | None
    read: Work
    baked: Work = field(init=False)
    fraction: float = 0.0
    dropped: Flag = field(default_factory=Flag)

    def __post_init__(self):
        self.baked = _baker.run(_bake, self)

    @property
    def facts(self):
        """The LensFacts; None until they are read, or if they cannot be."""
        return self.read.result() if self.read.done() and not self.read.exception() else None

    @property
    def lens(self):
        """The Lens; None until it is baked.

        Raises
        ------
        InputError
            The lens is not available.
        """
        ended = next((work for work in (self.baked, self.read) if work.done()), None)
        return ended.result() if ended is self.baked or (ended and ended.exception()) else None

    def is_for(self, question, frame):
        """Whether this is the request for a lens and a frame; lenses with rotational symmetry serve all frames."""
        return self.question == question and (self.frame == frame or self.facts is not None and self.facts.radial)

    @property
    def label(self):
        """The current step, for the panel."""
        return BAKING if self.facts and self.facts.reach else READING

    def on_progress(self, fraction, label):
        """Record the progress of the bake; raises Stopped if the request is obsolete."""
        if self.dropped.is_set():
            raise Stopped
        if int(100 * fraction) != int(100 * self.fraction):
            note_progress()
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
    return lens_request(scene).lens


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
    return lens_request(scene).read.result()


def forget_requests():
    """Drop all requests, including running bakes."""
    for request in _requests.values():
        request.dropped.set()
    _requests.clear()


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
    name, _, rings, focal_mm, *_ = question
    request = _requests[scene.session_uid] = Request(question, frame, _reader.run(lens_facts, name, rings, focal_mm))
    request.read.wait(AT_ONCE_S)
    return request


def _bake(request):
    """Bake the lens of a request, once its facts are read; runs in a thread."""
    name, _, _, _, wavelengths_nm, quality = request.question
    facts = request.read.result()
    edges_mm = request.frame and request.frame.edges_mm(facts)
    if loaded_lens(name, facts.rings, quality, wavelengths_nm, edges_mm) is None:
        _wait_until_settled(request)
    try:
        lens = load_lens(name, facts.rings, quality, request.on_progress, wavelengths_nm, edges_mm)
    except Exception as error:
        if request.dropped.is_set():  # for example because Blender is quitting
            raise Stopped from error
        raise
    hash(lens)  # slow, and needed to look up plans: compute it in this thread
    return lens


def _wait_until_settled(request):
    """Wait STILL_S for a newer request, and until the preview is idle, so that it has the processor for itself.

    Raises
    ------
    Stopped
        A newer request has replaced this one.
    """
    seconds = STILL_S
    while request.dropped.wait(seconds) or _preview_is_at_work():
        if request.dropped.is_set():
            raise Stopped
        seconds = IDLE_S


def _preview_is_at_work():
    return session.preview is not None and session.preview.at_work
