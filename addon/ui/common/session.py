"""The state of the window's session: what panels, timers and handlers share until Blender ends. No file contains it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...render.preflight import Preflight


@dataclass(frozen=True)
class LastRender:
    """The outcome of the last render.

    Attributes
    ----------
    icon : str
        Blender's icon of the lines.
    lines : tuple of str
    lens_image : Path or None
        The newest lens image.
    sheet : Path or None
        The contact sheet of a comparison.
    """

    icon: str = "INFO"
    lines: tuple[str, ...] = ()
    lens_image: Path | None = None
    sheet: Path | None = None

    @property
    def picture(self):
        """The picture to show: the contact sheet or the lens image; None without them."""
        return self.sheet or self.lens_image


@dataclass(frozen=True)
class ComparedLens:
    """A picture on a contact sheet.

    Attributes
    ----------
    lens : str
        Name or path.
    f_number : float
    label : str
    box : (int, int, int, int)
        The pixels that show it: left, top, right and bottom, from the sheet's upper left corner.
    """

    lens: str
    f_number: float
    label: str
    box: tuple[int, int, int, int]


@dataclass(frozen=True)
class LastSheet:
    """The last contact sheet, for the choice of a lens.

    Attributes
    ----------
    path : Path
    scene_uid : int
        The session_uid of the compared scene.
    f_stops : bool
        Whether f-numbers were chosen for the comparison; otherwise the camera or the lens sets them.
    lenses : tuple of ComparedLens
    """

    path: Path
    scene_uid: int
    f_stops: bool
    lenses: tuple[ComparedLens, ...]


@dataclass(frozen=True)
class Check:
    """The last scene check.

    Attributes
    ----------
    scene_uid : int or None
        The session_uid of the scene, which no other scene has until Blender ends; None before the first check.
    settings : object
        The settings that were checked.
    result : Preflight
    """

    scene_uid: int | None = None
    settings: Any = None
    result: Preflight = Preflight()


@dataclass
class CameraOverlay:
    """Drawings over the camera's view.

    Attributes
    ----------
    handle : object
        Of the draw handler; None without one.
    texture : gpu.types.GPUTexture or None
        Of the preview.
    tints : (array, gpu.types.GPUTexture)
        The last tints of the focus overlay, and their texture.
    turned : bool
        Whether a viewport has been turned to the camera and not been drawn since.
    """

    handle: Any = None
    texture: Any = None
    tints: tuple[Any, Any] = (None, None)
    turned: bool = False


@dataclass
class Session:
    """The state of one Blender process.

    Attributes
    ----------
    render : WindowRender or None
        The render that is running in the background.
    last_render : LastRender
    last_sheet : LastSheet or None
    preview : Preview or None
        The preview, while it is on.
    preview_failure : str
        Why the preview was switched off; "" if the user did.
    preview_unaffected : bool
        Whether a change in progress does not affect the preview.
    focus_overlay : bool
        Whether the focus overlay is on.
    overlay : CameraOverlay
    live : Live or None
        The live view, while it is on.
    live_failure : str
        Why the live view was switched off; "" if the user did.
    check : Check
    times : dict of int: tuple of LearnedTime
        Of the last renders of scenes, by their session_uid: of one or two, with different numbers of samples.
    """

    render: Any = None
    last_render: LastRender = LastRender()
    last_sheet: LastSheet | None = None
    preview: Any = None
    preview_failure: str = ""
    preview_unaffected: bool = False
    focus_overlay: bool = False
    overlay: CameraOverlay = field(default_factory=CameraOverlay)
    live: Any = None
    live_failure: str = ""
    check: Check = Check()
    times: dict[int, tuple[Any, ...]] = field(default_factory=dict)


session = Session()
