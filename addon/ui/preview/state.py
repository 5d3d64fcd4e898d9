"""The state of a preview: the work of its child, the scene in it, and the picture."""

import tempfile
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from lensfield.engine.runtime.child import Child
from lensfield.engine.runtime.errors import InputError

from ...job.photo import ShownExposure
from ...scene.active_camera import camera_settings
from ...scene.camera import view_tangents
from ...scene.rings import rings_for, scene_iris

LONGEST_COPY_S = 1.0  # longest automatic copy, as copying blocks the window


class Task(Enum):
    """A task of the child. The first is RENDER; each may be paused and continued."""

    RENDER = "a copy of the file"
    CHANGE = "values that have changed in the scene that it has loaded"
    LENS = "another lens, applied to the light so far"


class State(Enum):
    """What the child does.

    IDLE -> WORKING when it is asked -> IDLE when it is done.
    WORKING -> STOPPING when its pictures are out of date -> PAUSED -> WORKING when it is asked again.
    """

    IDLE = "waits for a change"
    WORKING = "renders"
    STOPPING = "renders, but its next pictures are not wanted"
    PAUSED = "has been stopped, and can go on"


@dataclass(frozen=True)
class Shown:
    """The picture that a preview shows.

    Attributes
    ----------
    columns_px : int
        As captured.
    depth : Path
    facts : list of str
    exposure : ShownExposure or None
    """

    columns_px: int
    depth: Path
    facts: list
    exposure: ShownExposure | None


@dataclass
class Loaded:
    """The scene that the child has loaded.

    Attributes
    ----------
    structure : str
        Its `structure_digest`.
    changes : dict or None
        Data-blocks that have changed since; None if the file must be copied.
    prepared : tuple
        The lens's key and the size that it is prepared for; () if it is not.
    still : dict
        Its `still_digests` that are known.
    tangents : tuple
        The `view_tangents` of the captured view.
    """

    structure: str = ""
    changes: dict | None = None
    prepared: tuple = ()
    still: dict = field(default_factory=dict)
    tangents: tuple = ()


@dataclass
class Preview:
    """A running preview.

    Attributes
    ----------
    changed_s, other_s : float or None
        time.monotonic() of the last change of the scene since it was rendered, and of the last one but of the lens, its
        focus and f-stop; None without any.
    grown : bool
        Whether only the frame in the viewport has changed since the picture: it has grown.
    by_hand : bool
        Whether the user has requested a refresh.
    switches, looked_s
        The last `render_switches`, and time.monotonic() of the look at them.
    state, task : State, Task
    lens : tuple
        The key of the last lens that was applied or tried.
    number : int
        Of the task's last picture that has been taken in; 0 for none.
    started_s : float
        time.monotonic() of the task's beginning.
    copies_s : tuple
        Seconds for each of the last two copies.
    shown : Shown or None
    error : str
    announced : str
        The last `waiting_for` that the windows show.
    """

    child: Child
    folder: tempfile.TemporaryDirectory
    scene_uid: int
    changed_s: float | None = 0.0
    other_s: float | None = None
    grown: bool = False
    by_hand: bool = False
    switches: dict = field(default_factory=dict)
    looked_s: float = 0.0
    loaded: Loaded = field(default_factory=Loaded)
    state: State = State.IDLE
    task: Task = Task.RENDER
    lens: tuple = ()
    number: int = 0
    started_s: float = 0.0
    copies_s: tuple = ()
    shown: Shown | None = None
    error: str = ""
    announced: str = ""

    @property
    def picture(self):
        """The path of a PNG of the preview as Blender shows it, which exists after the first render."""
        return Path(self.folder.name) / "shown.png"

    @property
    def depth(self):
        """The file of the picture's depth; None without a picture."""
        return self.shown and self.shown.depth

    @property
    def exposure(self):
        """The ShownExposure of the picture; None without a picture, or without a camera's body."""
        return self.shown and self.shown.exposure

    @property
    def at_work(self):
        """Whether the child renders."""
        return self.state in (State.WORKING, State.STOPPING)

    @property
    def slow(self):
        """Whether copying the file takes so long that only the user may start it."""
        return len(self.copies_s) == 2 and min(self.copies_s) > LONGEST_COPY_S  # a single slow copy may be chance

    @property
    def fresh(self):
        return self.changed_s is None

    @property
    def same_scene(self):
        """Whether only the lens, or its focus and f-stop, has changed since the last render."""
        return self.other_s is None

    @property
    def up_to_date(self):
        """Whether the picture shows the scene, if there is one."""
        return self.same_scene and not self.error

    def shows_exposure_of(self, scene):
        """Whether the picture has the exposure of a scene's camera as it is set."""
        try:
            return self.scene_uid == scene.session_uid and self.same_scene and lens_key(scene) == self.lens
        except InputError:
            return False

    @property
    def waiting_for(self):
        """What the first picture waits for, as text; "" once it exists."""
        if self.picture.is_file() or self.error:
            return ""
        label, fraction = (self.child.status.get(name) for name in ("label", "fraction"))
        return f"Lensfield Preview: {label} {fraction:.0%}" if label else "Lensfield Preview: starting"


def lens_key(scene):
    """Everything that changes the lens or the camera's exposure but not the scene: name or path, view, out-of-field
    treatment, focus and f-stop, blades, and the values of `EXPOSED_FIELDS`."""
    settings = camera_settings(scene)
    lens, out_of_field = settings.lens_name_or_path(), scene.lensfield.value_of("out_of_field")
    exposed = (settings.body_name_or_path(), settings.value_of("iso"), settings.value_of("shutter_s"),
               scene.lensfield.develop)
    return lens, settings.view_text(), out_of_field, rings_for(scene, lens), scene_iris(scene, lens), exposed


def shown_tangents(scene, key):
    """The `view_tangents` for a lens key."""
    lens, view, _, rings, *_ = key
    return view_tangents(scene, lens, view, rings)
