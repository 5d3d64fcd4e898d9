"""The job: what is asked for, by a scene's own settings and by whoever calls."""

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...engine import Lens, Options
from ...engine.depth.pencils import Iris
from ...engine.errors import InputError
from ...engine.image.depth_range import AUTO, TRACED
from ...engine.spectral.wavelength_choice import SpectralOptions
from ..scene.rings import scene_iris, scene_lens
from ..shading.assigned import LOADERS
from .record import picture_settings

UNSAVED_FOLDER = Path(tempfile.gettempdir()) / f"lensfield_unsaved_{os.getpid()}"
"""In the place of a .blend's folder as long as there is none; it outlives Blender, as pictures should."""


@dataclass(frozen=True)
class Job:
    """One frame to be seen through a lens.

    Attributes
    ----------
    view_layer : str
        The one to render; "" for the only one that is on for rendering.
    denoise, clamp : bool
        Whether Cycles denoises its passes, and whether the scene's clamps hold.
    picture : Path, optional
        A PNG that is to show, after each pass, the light so far, as a perfect pinhole sees it.
    room : float
        How much of the picture's longer side is captured beyond each of its edges, at the least, for other lenses.
    settings : dict
        What of the scene's render settings counts for the picture.
    state : str
        The scene's fingerprint; "" where nobody asked for it.
    source : str
        What tells the files apart that the scene is of, for passes to be kept; "" for none to be.
    ring_words : tuple of str
        What the lens's rings cannot do, a line each.
    depth : str
        One of DEPTHS.
    iris : Iris or None
        The blades that stop the lens down; None for a round stop.
    others : tuple of Lens
        That are to see the same capture: the lens, turned as in other frames.
    """

    lens: Lens
    wavelengths_nm: np.ndarray
    output_folder: Path
    options: Options
    spectral: SpectralOptions
    unfit: str
    frame: int
    view_layer: str
    denoise: bool
    clamp: bool
    to_compositor: bool
    lens_warning: str = ""
    picture: Path | None = None
    room: float = 0.0
    settings: dict | None = None
    state: str = ""
    source: str = ""
    ring_words: tuple[str, ...] = ()
    depth: str = AUTO
    iris: Iris | None = None
    others: tuple[Lens, ...] = ()

    @property
    def traced(self):
        """Whether Cycles renders what the lens lays on its film, and not what a pinhole sees."""
        return self.depth == TRACED


def job_from_settings(scene, *, lens=None, wavelengths_nm=None, output_folder=None, options=None, spectral=None,
                      view=None, unfit=None, view_layer=None, denoise=None, to_compositor=None, picture=None,
                      room=None, state="", source="", focus=None, f_number=None, focused_wide_open=None,
                      lens_quality=None, depth=None, iris=None):
    """The Job for the scene's current frame that its settings ask for, but for what is given.

    Raises
    ------
    InputError
        What is asked for cannot be.
    """
    settings = scene.lensfield
    lens = settings.lens_name_or_path() if lens is None else lens
    if not lens:
        raise InputError("scene settings", "lens file", "empty", "choose a prescription or a lens package")
    spectral = settings.to_spectral_options() if spectral is None else spectral
    rings = {"focus": focus, "f_number": f_number, "focused_wide_open": focused_wide_open}
    iris = scene_iris(scene, lens, iris, **rings)
    lens, warning, words = scene_lens(scene, lens, settings.view.lower() if view is None else view,
                                      lens_quality or spectral.tier, **rings)
    return Job(
        lens, settings.wavelengths_nm() if wavelengths_nm is None else np.asarray(wavelengths_nm, dtype=float),
        folder_for(scene, output_folder),
        settings.to_options() if options is None else options, spectral,
        settings.unfit.lower() if unfit is None else unfit, scene.frame_current,
        settings.view_layer if view_layer is None else view_layer,
        settings.denoises(spectral) if denoise is None else denoise, spectral.tier != "reference",
        settings.to_compositor if to_compositor is None else to_compositor, warning, picture, room or 0.0,
        picture_settings(scene), state, source or "", words, settings.depth.lower() if depth is None else depth, iris)


def folder_for(scene, output_folder=None):
    """The folder to write to: the one given, or that of the settings; // is beside the .blend, or among the system's
    temporary files as long as it is not saved."""
    folder = scene.lensfield.output_folder if output_folder is None else str(output_folder)
    if is_temporary(folder):
        return UNSAVED_FOLDER / folder.removeprefix("//")
    return Path(bpy.path.abspath(folder)).resolve()


def is_temporary(folder):
    """Whether a folder of the settings is beside a .blend that is nowhere yet."""
    return folder.startswith("//") and not bpy.data.filepath


def check_output_folder(scene):
    """Raise an InputError unless the settings name a folder to write to."""
    folder = scene.lensfield.output_folder
    if not folder.strip():
        raise InputError("scene settings", "output folder", "empty", "give a folder for the files")


def look_beside(folder):
    """Let paths start from another folder than the .blend's, which is a copy of one there.

    These are in Lensfield's settings, and of geometry nodes' bakes: Blender sees to all others as it saves a copy.

    Parameters
    ----------
    folder : path
    """
    for scene in bpy.data.scenes:
        for field in ("lens_file", "output_folder"):
            setattr(scene.lensfield, field, bpy.path.abspath(getattr(scene.lensfield, field), start=str(folder)))
    for block in (*bpy.data.materials, *bpy.data.lights, *bpy.data.worlds):
        for field in LOADERS:
            path = os.path.join(folder, bpy.path.abspath(getattr(block.lensfield, field, ""), start=str(folder)))
            if block.library is None and os.path.isfile(path):  # not the name of a library's spectrum, nor pairs
                setattr(block.lensfield, field, path)
    for modifier in (modifier for obj in bpy.data.objects for modifier in obj.modifiers if modifier.type == "NODES"):
        for owner, field in ((modifier, "bake_directory"), *((bake, "directory") for bake in modifier.bakes)):
            setattr(owner, field, bpy.path.abspath(getattr(owner, field), start=str(folder)))
