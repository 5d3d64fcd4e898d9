"""The main job, as a generator of steps: scene -> spectral radiance -> lens -> spectral irradiance.

A driver runs the steps, one after the other.
"""

import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import bpy

from ...engine import Kept, Report, simulate
from ...engine.errors import InputError
from ...engine.files import discard
from ...engine.image.spectral_exr import write_exr
from ...engine.image.spectral_image import IRRADIANCE
from ...engine.locks import only_maker
from ..scene.compositor import fingerprint_anew, lay_into_compositor
from ..scene.errors import SceneError
from ..scene.render_state import go_to_frame
from ..scene.undo import Journal
from ..scene.watch import samples_watched
from .job import check_output_folder, job_from_settings
from .kept_passes import forget_passes
from .pictures import write_film_pictures, write_pictures, write_radiance
from .radiance import capture
from .record import write_record
from .scene_plan import check_job
from .steps import RenderPass, Work

RENDER_SHARE = 0.85  # of the progress bar; the rest is the engine's and the files'


@cache
def kept():
    """What the lens renders of a session share. It outlives them, so that the next frame, or the same one tried with
    another light, does not wait again for the point spread functions of the same lens on the same grid."""
    return Kept()


FRAME_FILES = {"radiance": "radiance.exr", "irradiance": "irradiance.exr", "lens_image": "lens_image.exr",
               "depth": "depth.exr", "before": "before.png", "after": "after.png", "record": "report.json"}
PINHOLE_FILES = "radiance", "before"
"""Those of FRAME_FILES that are not there where the lens was traced: they are what a pinhole sees."""
LENS_FILES = {name: f"{name}.exr" for name in ("relative_illumination", "stmap_distort", "stmap_undistort")}


@dataclass(frozen=True)
class Result:
    """What a job left behind.

    Attributes
    ----------
    radiance, irradiance : Path
        Spectral EXRs. The radiance has the capture's depth beside it and, of a transparent film, its alpha.
    lens_image : Path
        A plain EXR: linear R, G and B, premultiplied by its alpha.
    depth : Path
        In metres of the scene, where the lens puts it: nearest samples, 1e10 where nothing is.
    before, after : Path
        PNGs: the scene as a perfect pinhole and as the lens give it.
    record : Path
        The report as JSON, and how the frame was made: `record.py` goes by it.
    relative_illumination, stmap_distort, stmap_undistort : Path
        Of the lens, one for all frames; docs/stmap.md has the convention.
    report : Report
    """

    radiance: Path
    irradiance: Path
    lens_image: Path
    depth: Path
    before: Path
    after: Path
    record: Path
    relative_illumination: Path
    stmap_distort: Path
    stmap_undistort: Path
    report: Report

    @classmethod
    def of(cls, scene, folder, frame):
        """The Result of a frame of a scene in this folder; its report names the files."""
        return cls.called(bpy.path.clean_name(scene.name), folder, frame)

    @classmethod
    def called(cls, stem, folder, frame):
        """The same for a scene whose files are called so."""
        files = {name: folder / f"{stem}_{frame:04d}_{end}" for name, end in FRAME_FILES.items()} | {
            name: folder / f"{stem}_{end}" for name, end in LENS_FILES.items()}
        return cls(**files, report=Report(files={name: str(path) for name, path in files.items()}))

    @classmethod
    def beside(cls, path, name, folder=None):
        """The Result of the frame that a file is the `name` of, such as its radiance; as if it lay in another folder,
        if that is given.

        Raises
        ------
        InputError
            The file is not called so.
        """
        parts = re.fullmatch(rf"(.+)_(-?\d+)_{re.escape(FRAME_FILES[name])}", path.name)
        result = parts and cls.called(parts[1], path.parent if folder is None else Path(folder), int(parts[2]))
        if not result or getattr(result, name).name != path.name:
            raise InputError(path, "file", "not named as by a render",
                             f"expected one such as Scene_0001_{FRAME_FILES[name]}")
        return result

    @property
    def pictures(self):
        """The files of the frame, but for its record."""
        return tuple(getattr(self, name) for name in FRAME_FILES if name != "record")

    @property
    def files(self):
        return tuple(getattr(self, name) for name in (*FRAME_FILES, *LENS_FILES))

    @property
    def told(self):
        """What to tell of it: list of lines."""
        seconds = sum(self.report.stages.values())
        scene, file = self.report.scene, self.report.file
        made_of = scene.scene_plan if scene else f"of the light in {file.radiance}"
        return [f"{self.lens_image} in {seconds:.1f} s", made_of, *self.report.remarks()]


def check_beside_frames(folder, *paths):
    """Raise an InputError for a file that is, or might come to be, one of a frame in the folder of its output.

    Parameters
    ----------
    folder : Path
    paths : Path or None
    """
    of_frame = re.compile(rf".+_-?\d+_({'|'.join(map(re.escape, FRAME_FILES.values()))})", re.IGNORECASE)
    for path in filter(None, paths):
        if path.resolve().parent == folder.resolve() and of_frame.fullmatch(path.name):
            raise InputError(path, "file", "called as one of a frame", "give it another name or folder")


def render_through_lens(scene, lens=None, wavelengths_nm=None, output_folder=None, *, options=None, spectral=None,
                        view=None, unfit=None, frame=None, view_layer=None, denoise=None, to_compositor=False,
                        picture=None, room=None, state=None, focus=None, f_number=None, focused_wide_open=None,
                        lens_quality=None, depth=None, iris=None, source=None, progress=None):
    """Render a scene multispectrally and put it through a lens: the whole main job in one call.

    What is left out is as the scene's own Lensfield settings say. What depends on the lens and the pixel grid alone is
    kept for the next call, up to some memory, until the add-on is unregistered: later frames take less time and come
    out the same.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens, or a name or path that `Lens.load` takes
    wavelengths_nm : ascending sequence of float
    output_folder : path
    options : Options
        How accurate the lens image is to be.
    spectral : SpectralOptions
        How true the spectra are to be, and so how many of the wavelengths Cycles renders.
    view : "lens" or "camera"
        What is seen: what the lens sees on its own sensor; or what the scene's camera sees, the lens being made as
        large as that takes.
    unfit : "refuse" or "render"
        What to do about nodes that cannot be rendered by wavelengths: raise an error, or take them as Cycles does.
    frame : int, optional
        The scene's current frame by default.
    view_layer : str, optional
        The one to render, where it is not the only one that is on for rendering.
    denoise : bool
        Let Cycles denoise its passes; this shifts means by up to 1 %, of dim wavelengths by more.
    to_compositor : bool
        Lay the lens image into the scene's compositor.
    picture : Path, optional
        A PNG that is to show, after each pass, the light so far, as a perfect pinhole sees it.
    room : float, optional
        Capture at least this part of the picture's longer side beyond each of its edges, so that `apply_lens` can take
        lenses with more distortion.
    state : str, optional
        What the frame's record tells of the scene's state: its fingerprint, unless it is known to have another one.
    focus : float or "camera", optional
        Distance in mm of what is in focus. By default the camera's, where its depth of field is on, else that which
        the lens is told with; "camera" for its own in any case.
    f_number : float, optional
        By default the camera's, where its depth of field is on, else the widest.
    focused_wide_open : bool, optional
        Focus at the widest aperture, and stop down after that.
    lens_quality : str, optional
        How finely a prescription is baked; as the tier by default.
    depth : "auto", "off" or "traced"
        How what is out of focus is blurred: by layers of depth, where the lens's data do not hold for all of the scene;
        not at all; or by rays that Cycles traces through the lens.
    iris : Iris, optional
        The blades that stop the lens down; by default those of the camera's Aperture and the settings' roundness, where
        its depth of field is on. They count below the widest f-stop, for what is out of focus.
    source : str, optional
        What tells the files apart that the scene is of (`source_digest`), where nothing has been changed since they
        were opened. Then finished passes are kept beside the output until the frame is there, and a render that was
        stopped goes on from them.
    progress : callable (fraction, label), optional

    Returns
    -------
    Result

    Raises
    ------
    Busy
        Another process renders this frame into this folder.
    LensError, SceneError, InputError
        The scene is then exactly as it was.
    """
    job = job_of_frame(scene, scene.frame_current if frame is None else frame, lens=lens,
                       wavelengths_nm=wavelengths_nm, output_folder=output_folder, options=options, spectral=spectral,
                       view=view, unfit=unfit, view_layer=view_layer, denoise=denoise, to_compositor=to_compositor,
                       picture=picture, room=room, state=state or fingerprint_anew(scene), focus=focus,
                       f_number=f_number, focused_wide_open=focused_wide_open, lens_quality=lens_quality,
                       depth=depth, iris=iris, source=source)
    with only_maker(Result.of(scene, job.output_folder, job.frame).record):
        return run(render_steps(scene, job), progress)


def job_of_frame(scene, frame, *, output_folder=None, **asked):
    """The Job for a frame, by the camera and the settings that the scene has there, but for what is given."""
    if output_folder is None:
        check_output_folder(scene)
    with Journal() as journal:
        go_to_frame(scene, frame, journal)
        return job_from_settings(scene, output_folder=output_folder, **asked)


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


def render_steps(scene, job, one=None):
    """Generator of RenderPass and Work steps; each is sent the answer of its call. Returns a Result.

    Closing it at any step leaves the scene as it was and no half-written file. `one` is the OneCapture that the frame
    is seen in, if there is one.
    """
    check_job(scene, job)
    capture_by, write_by = (one.capture, one.write_radiance) if one else (capture, write_radiance)
    result = Result.of(scene, job.output_folder, job.frame)
    report = result.report
    with report.stage("multispectral render"):
        captured = yield from capture_by(scene, job, result, RENDER_SHARE)
    discard(result.record)  # from here on it would tell of other files
    if job.traced:
        yield from _film_steps(captured, job.lens, result)
    else:
        yield Work(_timed(report, "write radiance", lambda tell: write_by(captured, result.radiance)),
                   "Writing radiance", RENDER_SHARE)
        yield from lens_steps(captured, job.lens, job.options, job.iris, result, RENDER_SHARE + 0.02)
    write_record(job, result)
    if one is None:
        forget_passes(scene, job.output_folder, job.frame)
    if job.to_compositor:
        lay_into_compositor(scene, result.lens_image, fingerprint=job.state)
    return result


def lens_steps(captured, lens, options, iris, result, done):
    """Steps that put what is Captured through a lens and write what follows from it, when so much of the job is done.
    """
    report = result.report
    discard(result.record)  # from here on it would tell of other files
    irradiance = yield Work(lambda tell: simulate(captured.layers or captured.radiance, lens, options, iris=iris,
                                                  progress=tell, report=report, kept=kept()),
                            f"Through {lens.name}", done, 0.98 - done)
    irradiance = replace(irradiance, cube=captured.cut(irradiance.cube))
    yield from _file_steps(irradiance, result,
                           lambda: write_pictures(captured, irradiance, lens, options, iris, result))


def _film_steps(film, lens, result):
    """Steps that write what follows from what has been Captured on a film, through the lens itself."""
    irradiance = replace(film.radiance, cube=film.cut(film.radiance.cube), quantity=IRRADIANCE, lens_name=lens.name,
                         f_number_effective=lens.f_number_effective, focal_mm=None)
    for name in PINHOLE_FILES:  # of an earlier render
        discard(getattr(result, name))
        del result.report.files[name]
    yield from _file_steps(irradiance, result, lambda: write_film_pictures(film, irradiance, lens, result))


def _file_steps(irradiance, result, write_its_pictures):
    report = result.report
    yield Work(_timed(report, "write irradiance", lambda tell: write_exr(irradiance, result.irradiance)),
               "Writing irradiance", 0.98)
    yield Work(_timed(report, "write pictures", lambda tell: write_its_pictures()), "Writing pictures", 0.99)


def _timed(report, stage, call):
    def timed(tell):
        with report.stage(stage):
            return call(tell)

    return timed

