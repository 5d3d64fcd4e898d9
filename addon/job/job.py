"""The job: a request with the values of the scene's settings and of the caller's arguments."""

import ntpath
import os
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from lensfield.engine import Lens
from lensfield.engine.depth.depth_range import OFF
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import temporary_root
from lensfield.engine.spectral.wavelength_choice import REFERENCE

from ...request import BY_SCENE, ON, RING_FIELDS, RenderRequest
from ..scene.blend_folder import check_blend_folder
from ..scene.lens_cache import unwatched
from ..scene.linked import stated_path
from ..scene.look import look_of, to_text
from ..scene.rings import scene_iris, scene_lens
from ..scene.trust import check_output
from ..shading.assigned import LOADERS
from .photo import chosen_camera
from .recorded import picture_settings

_folders = {}  # of the .blend files that open ones are copies of, by the copies' paths


@dataclass(frozen=True)
class Shot:
    """Frames with the same camera, whose exposure is metered once.

    Attributes
    ----------
    camera : str
    first : int
        The frame that is metered.
    """

    camera: str
    first: int


@dataclass(frozen=True, kw_only=True)
class Job(RenderRequest):
    """One frame to be rendered through a lens: a request with all values decided by the scene.

    Attributes
    ----------
    lens : Lens
        Focused and stopped down as in this frame.
    wavelengths_nm : float64 array (wavelength,)
    camera : Camera or ""
    denoise : "on" or "off"
    iris : Iris or None
        Blades that stop the lens down; None for a round stop.
    frame : int
    subframe : float
        Added to `frame`: the scene may be between two frames.
    clamp : bool
        Whether the scene's clamps apply.
    settings : dict
        The scene's render settings that affect the picture.
    lens_warning : str
        The consequences of scaling the lens for this view; "" at its own size.
    ring_words : tuple of str
        A line for each setting of focus and f-stop that the lens does not have.
    others : tuple of Lens
        Lenses that share the capture: of other pictures, or this one with the settings of other frames.
    shot : Shot or None
        Its first frame decides on the exposure that the camera's meter chooses; None for this one.
    shot_exposure : (float, float) or None
        The shutter in seconds and the ISO of the shot, once it is metered.
    """

    frame: int
    clamp: bool
    subframe: float = 0.0
    settings: dict | None = None
    lens_warning: str = ""
    ring_words: tuple[str, ...] = ()
    others: tuple[Lens, ...] = ()
    shot: Shot | None = None
    shot_exposure: tuple[float, float] | None = None

    @property
    def lenses(self):
        """All lenses of the capture: tuple of Lens."""
        return self.lens, *self.others

    @property
    def exposure(self):
        """The shutter and the ISO of the shot, or as in the settings."""
        return self.shot_exposure or super().exposure

    @property
    def denoises(self):
        """Whether Cycles denoises its passes."""
        return self.denoise == ON


def job_of(scene, quality=None, baking=unwatched, **given):
    """The Job for the scene's current frame, by its settings except for the given fields of a RenderRequest.

    Parameters
    ----------
    scene : bpy.types.Scene
    quality : str, optional
        Of the lens, as for `load_lens`; by default the request's.
    baking : callable (fraction, label)
        Progress of a bake of the lens.
    given : by name

    Raises
    ------
    InputError
        The lens, or a value of the settings, is not valid.
    """
    request = requested(scene, **given)
    rings = {name: getattr(request, name) for name in RING_FIELDS}
    iris = scene_iris(scene, request.lens, request.iris, **rings)
    quality = quality or request.lens_quality or request.spectral.tier
    lens, warning, words = scene_lens(scene, request.lens, request.view_on_sensor, quality, request.wavelengths_nm,
                                      baking, **rings)
    decided = {"lens": lens, "camera": chosen_camera(request), "iris": iris,
               "wavelengths_nm": np.array(request.wavelengths_nm),
               "denoise": ON if denoises(scene, request) else OFF,
               "view_settings": request.view_settings or to_text(look_of(scene))}
    return Job(**vars(request) | decided, frame=scene.frame_current, subframe=scene.frame_subframe,
               clamp=request.spectral.tier != REFERENCE, settings=picture_settings(scene), lens_warning=warning,
               ring_words=words)


def requested(scene, **given):
    """The RenderRequest of the scene's settings except for the given fields.

    Raises
    ------
    InputError
        A value is not valid, or no lens is chosen.
    """
    request = scene.lensfield.to_request(**given)
    if not request.lens:
        raise InputError("camera settings", "lens file", "empty", "choose a prescription or a lens package")
    return request


def denoises(scene, request):
    """Whether Cycles denoises the passes of a request."""
    if request.denoise == BY_SCENE:
        return scene.cycles.use_denoising and request.spectral.tier != REFERENCE
    return request.denoise == ON


def folder_for(scene, output_folder=None):
    """The folder to write to: the given one, or the one in the settings. // is the .blend's folder or, until the .blend
    is saved, `unsaved_folder()`."""
    folder = _native(scene.lensfield.output_folder) if output_folder is None else str(output_folder)
    if is_temporary(folder):
        return unsaved_folder() / folder.removeprefix("//")
    return Path(bpy.path.abspath(folder)).resolve()


def unsaved_folder():
    """Replaces the .blend's folder until the .blend is saved. It outlives Blender, as pictures should."""
    return temporary_root() / f"lensfield_unsaved_{os.getpid()}"


def _native(folder):
    """A folder of the settings with this system's separators: Windows may have written it."""
    return folder.replace("\\", "/") if folder.startswith("//") and os.name != "nt" else folder


def is_temporary(folder):
    """Whether a folder of the settings is relative to a .blend that is not saved yet."""
    return folder.startswith("//") and not bpy.data.filepath


def check_output_folder(scene):
    """Raise an InputError unless the settings name a folder to write to: in the folder of the .blend, which must exist,
    or chosen by the user."""
    folder = scene.lensfield.output_folder
    if not folder.strip():
        raise InputError("scene settings", "output folder", "empty", "choose a folder for the files")
    if folder.startswith("~") or (os.name != "nt" and ntpath.splitdrive(folder)[0][1:2] == ":"):
        raise InputError("scene settings", "output folder", folder,
                         "not a full path on this system: use --output, or enter the full path in the panel")
    if not is_temporary(folder):
        if folder.startswith("//"):
            check_blend_folder()
        check_output(bpy.path.abspath(_native(folder)))


def blend_path():
    """The path of the open .blend, or of the one that it is a copy of; None until it is saved."""
    path = Path(bpy.data.filepath)
    return _folders.get(path, path.parent) / path.name if bpy.data.filepath else None


def set_blend_folder(folder):
    """Resolve relative paths from `folder`, where the .blend that this one is a copy of is stored.

    This covers Lensfield's settings and the bakes of geometry nodes: Blender adapts all other paths when it saves a
    copy.

    Parameters
    ----------
    folder : path
    """
    _folders[Path(bpy.data.filepath)] = Path(folder)
    paths = [*((scene, "output_folder") for scene in bpy.data.scenes),
             *((camera, field) for camera in bpy.data.cameras for field in ("lens_file", "body_file"))]
    for block, field in paths:
        if block.is_editable:
            setattr(block.lensfield, field, stated_path(block, field, str(folder)))
    for block in (*bpy.data.materials, *bpy.data.lights, *bpy.data.worlds):
        for field in LOADERS:
            path = os.path.join(folder, bpy.path.abspath(getattr(block.lensfield, field, ""), start=str(folder)))
            if block.library is None and os.path.isfile(path):  # neither a library spectrum's name nor pairs
                setattr(block.lensfield, field, path)
    for modifier in (modifier for obj in bpy.data.objects for modifier in obj.modifiers if modifier.type == "NODES"):
        for owner, field in ((modifier, "bake_directory"), *((bake, "directory") for bake in modifier.bakes)):
            setattr(owner, field, bpy.path.abspath(getattr(owner, field), start=str(folder)))
