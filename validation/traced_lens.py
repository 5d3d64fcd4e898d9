"""Pictures through the traced lens (`addon/scene/traced_camera.py`), of the full frame or a patch, and their seconds.

The traced lens includes geometry and vignetting at every depth, but not diffraction. It is therefore the reference for
lens data where aberrations dominate, and the alternative to lens data.
"""

import time
from contextlib import contextmanager

import bpy
import numpy as np

from lensfield.addon import render_through_lens
from lensfield.addon.scene.render_state import guard_region
from lensfield.addon.scene.undo import Journal
from lensfield.commands.terminal import quiet
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.runtime.files import temporary_folder

FULL_FRAME = slice(None), slice(None)


def photograph(scene, lens, wavelength_nm, frame_px, *, samples, seed=0, part=None):
    """The scene through the traced lens, at one wavelength.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens
    wavelength_nm : float
    frame_px : (int, int)
        Rows and columns that fit the lens's sensor.
    samples : int
    seed : int
        Added to the scene's seed.
    part : (slice, slice), optional
        Rows and columns of the frame to render; the full frame by default.

    Returns
    -------
    picture : array (row, column), W m^-2 nm^-1
        Irradiance of the part.
    seconds : array (2,)
        Duration of Blender's render: processor seconds over all cores, and wall-clock seconds.
    """
    render, cycles = scene.render, scene.cycles
    with Journal() as journal, temporary_folder() as folder, _timed() as seconds:
        for owner, name, value in ((render, "resolution_y", frame_px[0]), (render, "resolution_x", frame_px[1]),
                                   (cycles, "samples", samples), (cycles, "seed", cycles.seed + seed)):
            journal.set(owner, name, value)
        if part:
            guard_region(render, part, frame_px, journal)
        with quiet(1):  # suppresses Blender's messages about saved passes
            result = render_through_lens(scene, lens=lens, wavelengths_nm=[wavelength_nm], output_folder=folder,
                                         depth="traced")
        picture = read_exr(result.irradiance).cube[0].astype(float)
    return picture[part or FULL_FRAME], np.diff(seconds, axis=0)[0]


@contextmanager
def _timed():
    """Yield a list that receives the times before and after the render."""
    times = []

    def note(*_):
        times.append((time.process_time(), time.perf_counter()))

    handlers = bpy.app.handlers.render_init, bpy.app.handlers.render_complete
    for each in handlers:
        each.append(note)
    try:
        yield times
    finally:
        for each in handlers:
            each.remove(note)
