"""The exposure of a shot: so that an animation does not flicker, the camera's meter looks at the shot's first frame.

It looks at a small picture, which every process renders alike: the machines of a farm choose the same exposure.
"""

from dataclasses import replace

from lensfield.engine import Options, simulate
from lensfield.engine.depth.depth_range import OFF
from lensfield.engine.photo.photograph import held
from lensfield.engine.plan.options import TIER_ACCURACY
from lensfield.engine.runtime.files import temporary_folder
from lensfield.engine.sensor.metering import metered
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions

from ..capture.radiance import capture
from ..job.job import Shot
from ..job.result import Result
from ..scene.motion import camera_at, exposure_animated
from ..scene.render_state import rendered_layer
from ..scene.undo import Journal
from .render import job_of_frame, run

PREVIEW = "preview"
LONG_SIDE_PX, SAMPLES = 128, 16
SMALL = {"spectral": SpectralOptions(PREVIEW), "options": Options(accuracy=TIER_ACCURACY[PREVIEW]),
         "stray": StrayOptions(OFF), "depth": OFF, "denoise": OFF, "unfit": "render", "lens_quality": PREVIEW,
         "picture": None, "source": "", "dng": False, "develop": False}
"""Fields of a RenderRequest that a metered picture has."""


def shot_of(scene, job):
    """The Shot of a frame; None if the camera does not choose its exposure, or if that is animated: keyframes on ISO or
    shutter have each frame metered."""
    camera = camera_at(scene, job.frame)
    if not job.camera or (job.iso and job.shutter_s) or exposure_animated(camera.data):
        return None
    cuts = [marker.frame for marker in scene.timeline_markers if marker.camera and marker.frame <= job.frame]
    return Shot(camera.name, min(job.frame, max([scene.frame_start, *cuts])))


def shot_exposure(scene, shot, progress, **given):
    """The shutter in seconds and the ISO that a camera's meter chooses for a shot.

    Parameters
    ----------
    scene : bpy.types.Scene
    shot : Shot
    progress : callable (fraction, label)
    given : by name
        Fields of a `RenderRequest`, as in `render_through_lens`.
    """
    with temporary_folder() as folder, Journal() as journal:
        _shrink(scene, journal)
        job = job_of_frame(scene, shot.first, **given | SMALL | {"output_folder": folder})
        captured = run(capture(scene, job, Result.of(scene, job.output_folder, job.frame), 1.0),
                       lambda fraction, label: progress(fraction, f"Metering frame {shot.first}"))
        irradiance = simulate(captured.radiance, job.lens, job.options)
    light = replace(irradiance, cube=captured.cut(irradiance.cube))
    exposure = metered(light, held(job.camera, light.frame_px), job.iso or None, job.shutter_s or None)
    return exposure.shutter_s, exposure.iso


def _shrink(scene, journal):
    """Set a small picture with few samples."""
    render = scene.render
    longest = max(render.resolution_x, render.resolution_y)
    if longest * render.resolution_percentage / 100 > LONG_SIDE_PX:
        for name in ("resolution_x", "resolution_y"):
            journal.set(render, name, max(4, round(getattr(render, name) * LONG_SIDE_PX / longest)))
        journal.set(render, "resolution_percentage", 100)
    journal.set(scene.cycles, "samples", min(SAMPLES, scene.cycles.samples))
    journal.set(scene.cycles, "use_adaptive_sampling", False)
    journal.set(rendered_layer(scene), "samples", 0)  # no override of the scene's samples
