"""The main job, as a generator of steps: scene -> spectral radiance -> lens -> spectral irradiance.

A driver runs the steps: `run` one after the other for scripts, the modal operator between the ticks of a timer.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import bpy
import numpy as np
import OpenEXR

from ..engine import Kept, Lens, Options, Report, SpectralImage, simulate
from ..engine.atomic import check_target, temporary_folder
from ..engine.colour import auto_exposure, to_rec709, write_png
from ..engine.errors import InputError
from ..engine.exr import write_exr, write_rgb_exr
from ..engine.spectra import BAND_NM
from ..engine.spectral_image import RADIANCE
from .bands import WAVELENGTHS_PER_PASS, passes
from .camera import check_camera, make_framing, match_camera_to_lens
from .compositor import lay_into_compositor
from .errors import SceneError
from .journal import Journal
from .lenses import load_lens
from .substitution import RENDER_SCALE, Substitution
from .watch import samples_watched

RENDER_SHARE = 0.85  # of the progress bar; the rest is the engine's and the files'


@cache
def kept():
    """What the lens renders of a session share. It outlives them, so that the next frame, or the same one tried with
    another light, does not wait again for the point spread functions of the same lens on the same grid."""
    return Kept()


@dataclass(frozen=True)
class Job:
    """One frame to be seen through a lens."""

    lens: Lens
    wavelengths_nm: np.ndarray
    output_folder: Path
    options: Options
    frame: int
    denoise: bool
    to_compositor: bool


@dataclass(frozen=True)
class RenderPass:
    """Step: render the scene as it stands, to the file that it names.

    `fraction` of the whole job is done before this step, `share` of it is this step's.
    """

    scene: bpy.types.Scene
    label: str
    fraction: float
    share: float


@dataclass(frozen=True)
class Work:
    """Step: call `call(progress)`, which may run in another thread and must not touch Blender."""

    call: Callable
    label: str
    fraction: float
    share: float = 0.0


@dataclass(frozen=True)
class Result:
    """What a job left behind: spectral EXRs, the lens image in plain linear RGB, pictures, and the report."""

    radiance: Path
    irradiance: Path
    lens_image: Path
    before: Path
    after: Path
    report: Report

    @property
    def files(self):
        return self.radiance, self.irradiance, self.lens_image, self.before, self.after


def render_through_lens(scene, lens, wavelengths_nm, output_folder, *, options=Options(), frame=None, denoise=False,
                        to_compositor=False, progress=None):
    """Render a scene multispectrally and put it through a lens: the whole main job in one call.

    What depends on the lens and the pixel grid alone is kept for the next call, up to some memory, until the add-on is
    unregistered: later frames take less time and come out the same.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens, or a name or path that `Lens.load` takes
    wavelengths_nm : ascending sequence of float
    output_folder : path
    options : Options
    frame : int, optional
        The scene's current frame by default.
    denoise : bool
        Let Cycles denoise its passes; this shifts means by up to 1 %, unequally between wavelengths.
    to_compositor : bool
        Lay the lens image into the scene's compositor.
    progress : callable (fraction, label), optional

    Returns
    -------
    Result

    Raises
    ------
    LensError, SceneError, InputError
        The scene is then exactly as it was.
    """
    lens = lens if isinstance(lens, Lens) else load_lens(lens)
    frame = scene.frame_current if frame is None else frame
    folder = Path(bpy.path.abspath(str(output_folder))).resolve()  # // is beside the .blend
    job = Job(lens, np.asarray(wavelengths_nm, dtype=float), folder, options, frame, denoise, to_compositor)
    return run(render_steps(scene, job), progress)


def run(steps, progress=None):
    """Run the steps one after the other; the result of the last."""
    tell = progress or (lambda fraction, label: None)

    def within_step(done):
        tell(step.fraction + step.share * done, step.label)

    try:
        step = next(steps)
        while True:
            tell(step.fraction, step.label)
            if isinstance(step, RenderPass):
                answer = None
                with samples_watched(within_step):
                    _render(step.scene)
            else:
                answer = step.call(within_step)
            step = steps.send(answer)
    except StopIteration as end:
        tell(1.0, "done")
        return end.value
    finally:
        steps.close()


def _render(scene):
    try:
        bpy.ops.render.render(write_still=True, scene=scene.name)
    except RuntimeError as error:
        raise SceneError(f"scene {scene.name!r}", "render", "refused by Blender", str(error).strip()) from None


def render_steps(scene, job):
    """Generator of RenderPass and Work steps; each is sent the answer of its call. Returns a Result.

    Closing it at any step leaves the scene as it was and no half-written file.
    """
    report = Report()
    _check_job(scene, job)
    stem = f"{bpy.path.clean_name(scene.name)}_{job.frame:04d}"
    result = Result(*(job.output_folder / f"{stem}_{name}" for name in
                      ("radiance.exr", "irradiance.exr", "lens_image.exr", "before.png", "after.png")), report)
    with report.stage("multispectral render"):
        radiance = yield from _capture(scene, job, result)
    yield Work(_timed(report, "write radiance", lambda tell: write_exr(radiance, result.radiance)),
               "Writing radiance", RENDER_SHARE)
    irradiance = yield Work(lambda tell: simulate(radiance, job.lens, job.options, progress=tell, report=report,
                                                  kept=kept()),
                            f"Through {job.lens.name}", RENDER_SHARE + 0.02, 0.96 - RENDER_SHARE)
    yield Work(_timed(report, "write irradiance", lambda tell: write_exr(irradiance, result.irradiance)),
               "Writing irradiance", 0.98)
    yield Work(_timed(report, "write pictures", lambda tell: _write_pictures(radiance, irradiance, result)),
               "Writing pictures", 0.99)
    if job.to_compositor:
        lay_into_compositor(scene, result.lens_image)
    return result


def _capture(scene, job, result):
    """Steps that render the scene's spectral radiance; returns a SpectralImage with overscan."""
    bands = passes(job.wavelengths_nm)
    framing = make_framing(scene, job.lens, job.wavelengths_nm)
    cube = np.empty((len(bands) * WAVELENGTHS_PER_PASS, *framing.capture_px), dtype=np.float32)
    with temporary_folder() as folder, Journal() as journal:
        _go_to_frame(scene, job.frame, journal)
        check_camera(scene)
        substitution = Substitution(scene, journal)
        _guard_render_state(scene, job, framing, folder / "pass.exr", journal)
        for path in result.files:
            check_target(path)
        for index, band in enumerate(bands):
            substitution.set_wavelengths(band)
            yield RenderPass(scene, f"Pass {index + 1} of {len(bands)}: {_span(band)} nm",
                             RENDER_SHARE * index / len(bands), RENDER_SHARE / len(bands))
            first = index * WAVELENGTHS_PER_PASS
            cube[first:first + WAVELENGTHS_PER_PASS] = _read_pass(folder / "pass.exr", framing.capture_px)
    result.report.facts |= {"passes": len(bands), "wavelengths_nm": [float(nm) for nm in job.wavelengths_nm]}
    return SpectralImage(cube[:len(job.wavelengths_nm)], job.wavelengths_nm, pitch_um=framing.pitch_um,
                         overscan_px=framing.overscan_px, quantity=RADIANCE)


def _go_to_frame(scene, frame, journal):
    """Evaluate the scene at a frame, as a render would: its animation, and the camera that a marker binds."""
    if bpy.context.window:  # animation reaches the data-blocks that we copy only in the window's scene,
        journal.set(bpy.context.window, "scene", scene)
        bpy.context.evaluated_depsgraph_get()  # and in 4.5 only once that has been evaluated
    camera, current, subframe = scene.camera, scene.frame_current, scene.frame_subframe

    def go_back():
        scene.frame_set(current, subframe=subframe)
        scene.camera = camera

    journal.on_exit(go_back)
    scene.frame_set(frame)


def _guard_render_state(scene, job, framing, path, journal):
    """Set everything that would change or bend the radiance; the journal puts it back."""
    render, cycles, image = scene.render, scene.cycles, scene.render.image_settings
    journal.set(render, "engine", "CYCLES")
    for name, value in (("film_transparent", False), ("use_border", False), ("use_compositing", False),
                        ("use_sequencer", False), ("use_multiview", False), ("use_motion_blur", False),
                        ("use_freestyle", False), ("use_overwrite", True), ("use_placeholder", False),
                        ("use_file_extension", False), ("use_persistent_data", True), ("use_single_layer", False),
                        ("use_stamp", False), ("filepath", str(path)), ("resolution_percentage", 100),
                        ("resolution_y", framing.capture_px[0]), ("resolution_x", framing.capture_px[1])):
        journal.set(render, name, value)
    for name, value in (("film_exposure", 1.0), ("sample_clamp_direct", 0.0), ("sample_clamp_indirect", 0.0),
                        ("pixel_filter_type", "BOX"), ("use_animated_seed", False), ("use_denoising", job.denoise)):
        journal.set(cycles, name, value)
    # Blender changes what does not fit as soon as the format changes, so all are put back together, in this order.
    formats = {"media_type": "IMAGE", "file_format": "OPEN_EXR", "color_mode": "RGB", "color_depth": "32",
               "exr_codec": "ZIP"}
    if not hasattr(image, "media_type"):  # it came with 5.0
        del formats["media_type"]
    before = {name: getattr(image, name) for name in formats}
    colour_space = image.linear_colorspace_settings.name
    if colour_space:  # a scene new from the factory has none until a format is chosen
        journal.on_exit(lambda: setattr(image.linear_colorspace_settings, "name", colour_space))
    journal.on_exit(lambda: _assign(image, before))
    _assign(image, formats)
    camera = journal.stand_in(scene.camera.data, bpy.data.cameras)
    camera.animation_data_clear()
    camera.dof.use_dof = False  # blur is the lens's
    match_camera_to_lens(camera, job.lens, framing.capture_px[1], framing.pitch_um)


def _assign(owner, values):
    for name, value in values.items():
        setattr(owner, name, value)


def _read_pass(path, shape_px):
    """Spectral radiance at the three wavelengths that the red, green and blue of a pass carry."""
    if not path.is_file():
        raise SceneError("Cycles", "render pass", "not written", "see Blender's messages above")
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.parts[0].channels
        planes = np.stack([channels[name].pixels for name in "RGB"])
    path.unlink()
    if planes.shape[1:] != shape_px:
        raise SceneError("Cycles", "render pass", f"of {planes.shape[1:]} px", f"expected {shape_px}")
    return planes / RENDER_SCALE


def _write_pictures(radiance, irradiance, result):
    """The lens image; and, exposed alike, the frame as a perfect pinhole and as the lens give it."""
    after = to_rec709(irradiance)
    write_rgb_exr(after, result.lens_image)
    exposure = auto_exposure(after)
    write_png(to_rec709(radiance.frame()), result.before, exposure)
    write_png(after, result.after, exposure)


def _check_job(scene, job):
    """Raise an InputError for what can be known to fail before anything is changed or rendered."""
    if not len(job.wavelengths_nm):
        raise InputError("options", "wavelengths", "empty", "expected at least one")
    for nm in job.wavelengths_nm:
        job.lens.at_wavelength(nm)
        if not BAND_NM[0] <= nm <= BAND_NM[1]:
            raise InputError("options", "wavelength", f"{nm:g} nm",
                             "colours and lights of a scene reach from {:g} to {:g} nm".format(*BAND_NM))
    layers = [layer.name for layer in scene.view_layers if layer.use]
    if len(layers) != 1:
        raise SceneError(f"scene {scene.name!r}", "view layers for rendering", ", ".join(layers) or "none",
                         "leave one on (View Layer properties > Use for Rendering)")
    working_space = getattr(getattr(bpy.data, "colorspace", None), "working_space", "Linear Rec.709")  # since 5.0
    if working_space != "Linear Rec.709":
        raise SceneError(f"scene {scene.name!r}", "working colour space", working_space,
                         "colours are upsampled from Linear Rec.709: choose that")


def _timed(report, stage, call):
    def timed(tell):
        with report.stage(stage):
            return call(tell)

    return timed


def _span(band):
    return f"{band[0]:.0f}" if band[0] == band[-1] else f"{band[0]:.0f} to {band[-1]:.0f}"
