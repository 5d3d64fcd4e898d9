"""Lenses side by side: one capture, put through each lens at each f-number in the same view, and a contact sheet.

Anamorphic lenses of each squeeze have a capture of their own. The sheet shows their pictures with the squeeze undone.
"""

import re
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lensfield.engine import InputError, Report
from lensfield.engine.depth.depth_range import AUTO, OFF, TRACED
from lensfield.engine.field.overscan import CAMERA_VIEW
from lensfield.engine.inspection.contact_sheet import write_contact_sheet
from lensfield.engine.library import bundled_names, has_rings, prescription_of
from lensfield.engine.pictures.preview import auto_exposure
from lensfield.engine.pictures.spectral_exr import read_parts
from lensfield.engine.rays.rings import AT_REST, Rings
from lensfield.engine.runtime.files import check_target, discard
from lensfield.engine.runtime.locks import only_writer

from ...request import RING_FIELDS, RenderRequest
from ..capture.radiance import capture
from ..capture.scene_plan import check_job
from ..job.job import Job
from ..job.origin import check_replaced
from ..job.result import Result
from ..job.shown import look_for, pixels_of
from ..job.steps import Work
from ..job.targets import check_files
from ..scene.camera import frame_px, pixel_aspect
from ..scene.lens_facts import lens_facts, squeeze_of
from ..scene.requirements import check_scene
from ..scene.rings import FIXED, ring_fields, scene_rings
from ..scene.undo import Journal
from .one_capture import shared_job
from .pictures import write_radiance
from .refilter import apply_lens, check_capture, requested_rings, stored_radiance, with_stored_look
from .render import attributes_of, job_of_frame, run

CAPTURE = "capture"  # the folder of the stored light; the pictures' folders end with an f-number
CAPTURE_SHARE = 0.5  # of the progress bar
SHEET = "contact_sheet.png"
MARKED = re.compile(r"\bf/(\d+(?:\.\d+)?)")  # the f-number in a lens's title
YEAR = re.compile(r" \(\d{4}\)$")


@dataclass(frozen=True)
class Cell:
    """A picture of a comparison: a lens at an f-number.

    Attributes
    ----------
    lens : str
        Name or path.
    rings : Rings
        Its focus and f-number; at rest for a package.
    f_number : float
        The actual f-number, also of a package.
    words : tuple of str
        A line for each requested setting that the lens does not have.
    """

    lens: str
    rings: Rings
    f_number: float
    words: tuple[str, ...]

    @property
    def folder(self):
        """The name of the folder with its files."""
        return f"{lens_stem(self.lens)}_f{self.f_number:.3g}"

    @property
    def label(self):
        """The lens's title and the f-number, as photographers write them."""
        title, marked = _title(self.lens), MARKED.search(_title(self.lens))
        wide_open = marked and float(marked[1]) == float(f"{self.f_number:.2g}")
        return title if wide_open else f"{title} at f/{self.f_number:.3g}"


@dataclass(frozen=True)
class Capture:
    """Light that several pictures of a comparison share.

    Attributes
    ----------
    radiance : Path
        Its file.
    fields : dict of str: dict
        The arguments of `apply_lens` for each picture, by its folder.
    job : Job or None
        The job that captures it; None if the file exists.
    squeeze : float
        Of its lenses.
    """

    radiance: Path
    fields: dict[str, dict]
    job: Job | None = None
    squeeze: float = 1.0


@dataclass(frozen=True)
class Comparison:
    """The plan of a comparison.

    Attributes
    ----------
    rows : tuple of tuple of Cell
        As on the sheet: a row for each lens, a column for each f-number.
    captures : tuple of Capture
        Cells with the same folder share a picture.
    folder : Path
        The folder of the sheet, and of the pictures' folders.
    size_px : (int, int)
        Width and height of the pictures on the sheet.
    scene : bpy.types.Scene or None
        The scene to be captured; None if the capture exists.
    """

    rows: tuple[tuple[Cell, ...], ...]
    captures: tuple[Capture, ...]
    folder: Path
    size_px: tuple[int, int]
    scene: Any = None

    @property
    def radiance(self):
        """The path of the first capture."""
        return self.captures[0].radiance

    @property
    def pictures(self):
        """(capture, folder, arguments of `apply_lens`) of each picture: list."""
        return [(capture, folder, fields) for capture in self.captures for folder, fields in capture.fields.items()]

    @property
    def sheet(self):
        """The path of the contact sheet."""
        return self.folder / self.radiance.name.replace("radiance.exr", SHEET)

    @property
    def words(self):
        """A line for each requested setting that a lens does not have."""
        return tuple(dict.fromkeys(f"{_title(cell.lens)}: {word}"
                                   for row in self.rows for cell in row for word in cell.words))


@dataclass(frozen=True)
class ContactSheet:
    """A finished comparison.

    Attributes
    ----------
    path : Path
    cells : tuple of (Cell, (int, int, int, int))
        Each with the pixels of the sheet that show it: left, top, right and bottom, from the upper left corner.
    report : Report
        Of the capture; without facts about the scene if the capture existed.
    messages : tuple of str
        The file, the time, the plan and the remarks.
    """

    path: Path
    cells: tuple[tuple[Cell, tuple[int, int, int, int]], ...]
    report: Report
    messages: tuple[str, ...]


def plan_comparison(source, lenses, f_numbers=(), *, output_folder, progress=None, **given):
    """Plan a comparison: load all lenses, and check that the capture serves them and that the files can be written.

    Parameters
    ----------
    source : bpy.types.Scene or Path
        The scene to be captured, at its current frame; or the radiance file of a render.
    lenses : sequence of str
        Names or paths.
    f_numbers : sequence of float
        By default the f-number of a render: the camera's F-Stop if its depth of field is on, otherwise the widest of
        each lens. Out-of-range f-numbers are clamped.
    output_folder : path
    progress : callable (fraction, label), optional
    given : by name
        Fields of a `RenderRequest`, except for `view`: the view is the view of the camera. For a scene as in
        `render_through_lens`, for a file as in `apply_lens`.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        Among others, a lens needs more than was captured.
    """
    _check_names(lenses)
    plan = _plan_of_file if isinstance(source, Path) else _plan_of_scene
    comparison = plan(source, lenses, tuple(f_numbers) or (None,), Path(output_folder), progress or _silent, given)
    for each in comparison.captures if comparison.scene else ():
        check_replaced(source, Result.from_file(each.radiance, "radiance"), each.job.state)
    check = partial(check_files, source) if comparison.scene else lambda paths: [check_target(path) for path in paths]
    check([comparison.sheet, *(file for _, folder, _ in comparison.pictures
                               for file in _result(comparison, folder).files)])
    return comparison


def render_comparison(comparison, progress=None):
    """Capture the scene unless the capture exists, put it through each lens, and write the sheet.

    Parameters
    ----------
    comparison : Comparison
    progress : callable (fraction, label), optional

    Returns
    -------
    ContactSheet

    Raises
    ------
    Busy
        Another process is capturing this scene into this folder.
    LensError, SceneError, InputError
        The scene is restored exactly.
    """
    on_progress = progress or _silent
    captured = [Result.from_file(each.radiance, "radiance") for each in comparison.captures]
    start = CAPTURE_SHARE if comparison.scene else 0.0
    if comparison.scene:
        _capture_all(comparison, captured, on_progress)
    count, results = len(comparison.pictures), {}
    for number, (each, folder, fields) in enumerate(comparison.pictures):
        part = _part(on_progress, start + (1 - start) * number / count, (1 - start) / count,
                     f"Picture {number + 1} of {count}: ")
        results[folder] = apply_lens(each.radiance, output_folder=comparison.folder / folder, progress=part,
                                     **fields)
    with captured[0].report.stage("contact sheet"):
        boxes = _write_sheet(comparison, results)
    cells = [cell for row in comparison.rows for cell in row]
    return ContactSheet(comparison.sheet, tuple(zip(cells, boxes, strict=True)), captured[0].report,
                        tuple(_messages(comparison, captured, results)))


def _silent(fraction, label):
    pass


def _part(on_progress, start, share, prefix=""):
    """The progress function of a part of the work, from `start` on."""
    return lambda fraction, label: on_progress(start + share * fraction, prefix + label)


def _plan_of_file(radiance, lenses, f_numbers, folder, on_progress, given):
    rings = requested_rings(RenderRequest(**given))
    given = {name: value for name, value in given.items() if name not in RING_FIELDS}
    rows = _rows(lenses, [replace(rings, f_number=f_number) for f_number in f_numbers],
                 stored_radiance(radiance).focal_mm)
    fields = {name: {"lens": cell.lens, "view": CAMERA_VIEW, **given, **ring_fields(cell.rings)}
              for name, cell in _by_folder(rows).items()}
    for name, _ in _announced(rows, on_progress):
        check_capture(radiance, **fields[name])
    stored = stored_radiance(radiance)
    size_px = round(stored.frame_px[1] * stored.squeeze), stored.frame_px[0]
    return Comparison(rows, (Capture(radiance, fields, squeeze=stored.squeeze),), folder, size_px)


def _plan_of_scene(scene, lenses, f_numbers, folder, on_progress, given):
    given = given | {"view": CAMERA_VIEW}
    with squeezed_frame(scene, 1.0):
        check_scene(scene, output_folder=folder, **given)
        height_px, width_px = frame_px(scene)
    if (given.get("depth") or scene.lensfield.value_of("depth")) == TRACED:
        raise InputError("options", "depth", TRACED, "expected auto or off: a traced lens stores no light for others")
    if given.get("truth"):
        raise InputError("options", "truth", given["truth"], "a comparison writes none: render through that lens")
    requested = {name: given.pop(name, None) for name in RING_FIELDS}
    rows = _rows(lenses, [scene_rings(scene, **requested | ({} if f_number is None else {"f_number": f_number}))
                          for f_number in f_numbers], scene.camera.data.lens)
    jobs = {name: _cell_job(scene, cell, folder, given) for name, cell in _announced(rows, on_progress)}
    cells = _by_folder(rows)
    captures = tuple(_capture_of(scene, squeeze, {name: (cells[name], job) for name, job in jobs.items()
                                                  if job.lens.squeeze == squeeze})
                     for squeeze in sorted({job.lens.squeeze for job in jobs.values()}))
    return Comparison(rows, captures, folder, (width_px, height_px), scene)


def _cell_job(scene, cell, folder, given):
    """The job that would capture the scene for a picture alone."""
    squeeze = squeeze_of(cell.lens)
    with squeezed_frame(scene, squeeze):
        job = job_of_frame(scene, scene.frame_float, **given | {
            "lens": cell.lens, "output_folder": folder / capture_name(squeeze), "truth": "",
            **ring_fields(cell.rings)})
        check_job(scene, job)
    return job


def capture_name(squeeze):
    """The name of a capture for lenses of a squeeze."""
    return CAPTURE if squeeze == 1 else f"{CAPTURE}_{squeeze:.4g}x"


def _capture_of(scene, squeeze, jobs):
    """The Capture for lenses of a squeeze: dict of folder to (Cell, Job)."""
    fields = {name: {"lens": cell.lens, "view": CAMERA_VIEW, "options": job.options, "stray": job.stray,
                     "iris": job.iris, "lens_quality": job.lens_quality or job.spectral.tier, "look": job.look,
                     "view_settings": job.view_settings, "files": job.files, "depth": OFF if job.depth == OFF else AUTO,
                     **ring_fields(cell.rings)} for name, (cell, job) in jobs.items()}
    with squeezed_frame(scene, squeeze):
        job = shared_job(scene, [job for _, job in jobs.values()])
    return Capture(Result.of(scene, job.output_folder, scene.frame_current).radiance, fields, job, squeeze)


@contextmanager
def squeezed_frame(scene, squeeze):
    """Within the block, the scene's frame has pixels `squeeze` times as wide as tall, and as many fewer columns."""
    render = scene.render
    with Journal() as journal:
        rows, columns = frame_px(scene)
        columns *= pixel_aspect(scene) / squeeze
        for name, value in {"resolution_x": max(1, round(columns)), "resolution_y": rows,
                            "resolution_percentage": 100, "pixel_aspect_x": max(1.0, squeeze),
                            "pixel_aspect_y": max(1.0, 1 / squeeze)}.items():
            journal.set(render, name, value)
        yield


def _rows(lenses, rings, focal_mm):
    """The cells of the sheet, for lenses that are scaled to a focal length."""
    return tuple(tuple(_cell(lens, each, focal_mm) for each in rings) for lens in lenses)


def _cell(lens, rings, focal_mm):
    if not has_rings(lens):
        return Cell(lens, AT_REST, lens_facts(lens).f_number, (FIXED,) * (rings != AT_REST))
    facts = lens_facts(lens, rings, focal_mm)
    return Cell(lens, replace(rings, f_number=facts.f_number), facts.f_number, facts.words)


def _by_folder(rows):
    return {cell.folder: cell for row in rows for cell in row}


def _announced(rows, on_progress):
    """The different cells by their folders, each reported before its lens is baked: generator."""
    cells = _by_folder(rows)
    for number, (name, cell) in enumerate(cells.items(), 1):
        on_progress(0.0, f"Preparing lens {number} of {len(cells)}: {cell.label}")
        yield name, cell


def _capture_all(comparison, results, on_progress):
    """Capture the scene for the lenses of each squeeze."""
    share = CAPTURE_SHARE / len(results)
    for number, (each, result) in enumerate(zip(comparison.captures, results, strict=True)):
        with only_writer(result.record), squeezed_frame(comparison.scene, each.squeeze):
            run(_capture_steps(comparison.scene, each.job, result), _part(on_progress, share * number, share))


def _capture_steps(scene, job, result):
    captured = yield from capture(scene, job, result, 1.0)
    discard(result.record)  # the files that it describes are about to change
    attributes = attributes_of(scene, job)
    yield Work(lambda _: write_radiance(captured, result.radiance, attributes), "Writing radiance", 1.0)


def _write_sheet(comparison, results):
    """Write the sheet, with the same exposure for all pictures; returns the boxes of the cells."""
    pictures = {name: rec709(result.lens_image) for name, result in results.items()}
    exposure = auto_exposure(np.concatenate([picture.reshape(-1, 1, 3) for picture in pictures.values()]))
    look = look_for(_first_request(comparison))
    pixels = {name: _unsqueezed(pixels_of(picture, exposure, look), comparison.size_px)
              for name, picture in pictures.items()}
    boxes = write_contact_sheet([[pixels[cell.folder] for cell in row] for row in comparison.rows],
                                [[cell.label for cell in row] for row in comparison.rows], comparison.sheet)
    return [box for row in boxes for box in row]


def _unsqueezed(pixels, size_px):
    """A picture with the squeeze undone: of this width and height."""
    if pixels.shape[1::-1] == tuple(size_px):
        return pixels
    from PIL import Image

    return np.asarray(Image.fromarray(pixels).resize(size_px, Image.Resampling.LANCZOS))


def _first_request(comparison):
    """The request of the first picture; all have one look."""
    capture, _, fields = comparison.pictures[0]
    return with_stored_look(RenderRequest(**fields), capture.radiance)


def rec709(path):
    """The colours of a lens image: array (row, column, 3)."""
    _, planes = read_parts(path)[0]
    return np.stack([planes[channel] for channel in "RGB"], axis=-1, dtype=np.float32)


def _messages(comparison, captured, results):
    """The file, the time, the plan and the remarks: generator of lines."""
    seconds = sum(sum(result.report.stages.values()) for result in (*captured, *results.values()))
    yield f"{comparison.sheet} in {seconds:.1f} s"
    scenes = [result.report.scene for result in captured if result.report.scene]
    yield from dict.fromkeys(scene.scene_plan for scene in scenes) or [f"from the light in {comparison.radiance}"]
    yield from comparison.words
    yield from dict.fromkeys(remark for result in captured for remark in result.report.remarks())
    yield from dict.fromkeys(f"{_title(cell.lens)}: {remark}" for name, cell in _by_folder(comparison.rows).items()
                             for remark in results[name].report.remarks())


def _result(comparison, folder):
    """The Result of a picture."""
    return Result.from_file(comparison.radiance, "radiance", comparison.folder / folder)


def _check_names(lenses):
    """Raise an InputError unless each lens has a folder of its own."""
    stems = [lens_stem(lens).casefold() for lens in lenses]
    for number, stem in enumerate(stems):
        if stem in stems[:number]:
            raise InputError("options", "lens", lenses[number], "named like another lens of the comparison: leave it "
                                                                "out, or rename its file")


def lens_stem(lens):
    """The name of a lens in file names."""
    return lens if lens in bundled_names() else Path(lens).stem


def _title(lens):
    """The title of a lens without its year; of a package, the name of its file."""
    return YEAR.sub("", prescription_of(lens).title if has_rings(lens) else "") or Path(lens).name
