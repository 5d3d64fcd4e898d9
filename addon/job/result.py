"""The files and the report of a rendered frame."""

import re
from dataclasses import dataclass
from pathlib import Path

import bpy

from lensfield.engine import Report
from lensfield.engine.pictures.frame_record import PICTURE_END, RECORD_END, TRUTH_END
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import discard

from ...request import SPECTRAL_FILES

FRAME_FILES = {"radiance": "radiance.exr", "irradiance": "irradiance.exr", "lens_image": "lens_image.exr",
               "stray": "stray_light.exr", "depth": "depth.exr", "before": "before.png", "after": PICTURE_END,
               "record": RECORD_END}
UNSAVED = "unsaved"  # in the place of the name of a .blend
MOST_NAME_BYTES = 120  # of a .blend's name in file names, which systems limit to 255 bytes
RAW_END = "raw.dng"
"""Of a file that a frame has only on request, and if it has a camera."""
PINHOLE_FILES = "radiance", "before"
"""The FRAME_FILES that a traced lens does not write: they show the view of a pinhole."""
LENS_FILES = {name: f"{name}.exr" for name in ("relative_illumination", "stmap_distort", "stmap_undistort")}


@dataclass(frozen=True)
class Result:
    """The files and the report of a job.

    Attributes
    ----------
    radiance, irradiance : Path
        Spectral EXRs. The radiance file also contains the capture's depth and, for a transparent film, its alpha.
    lens_image : Path
        A plain EXR: linear R, G and B, premultiplied by its alpha.
    stray : Path
        The stray light in the lens image, as a plain EXR; black without any.
    depth : Path
        In metres, by the scene's Unit Scale, distorted like the lens image: nearest samples, 1e10 for the background.
    before, after : Path
        PNGs: the scene through a perfect pinhole and through the lens.
    raw : Path
        The camera's picture, if there is a camera and its raw file is wanted.
    truth : Path
        What the pixels' chief rays meet: an EXR with the channels of Blender's passes, if ground truth is requested.
    record : Path
        JSON: the report and the frame's settings, which `engine/pictures/frame_record.py` reads back.
    relative_illumination, stmap_distort, stmap_undistort : Path
        Properties of the lens, one file for all frames; docs/stmap.md has the convention.
    frame : int
    report : Report
    """

    radiance: Path
    irradiance: Path
    lens_image: Path
    stray: Path
    depth: Path
    before: Path
    after: Path
    raw: Path
    truth: Path
    record: Path
    relative_illumination: Path
    stmap_distort: Path
    stmap_undistort: Path
    frame: int
    report: Report

    @classmethod
    def of(cls, scene, folder, frame):
        """The Result of a frame of a scene in this folder; its report names the files."""
        return cls.called(stem_of(scene), folder, frame)

    @classmethod
    def called(cls, stem, folder, frame):
        """The Result of a frame whose file names start with `stem`."""
        files = {name: folder / f"{stem}_{frame:04d}_{end}" for name, end in FRAME_FILES.items()} | {
            name: folder / f"{stem}_{end}" for name, end in LENS_FILES.items()}
        raw, truth = (folder / f"{stem}_{frame:04d}_{end}" for end in (RAW_END, TRUTH_END))
        return cls(**files, raw=raw, truth=truth, frame=frame,
                   report=Report(files={name: str(path) for name, path in files.items()}))

    @classmethod
    def from_file(cls, path, name, folder=None):
        """The Result of the frame whose `name` file, such as its radiance, is at `path`; with its files in `folder`, if
        given.

        Raises
        ------
        InputError
            The file name does not match.
        """
        parts = re.fullmatch(rf"(.+)_(-?\d+)_{re.escape(FRAME_FILES[name])}", path.name)
        result = parts and cls.called(parts[1], path.parent if folder is None else Path(folder), int(parts[2]))
        if not result or getattr(result, name).name != path.name:
            raise InputError(path, "file", "not named like a rendered frame",
                             f"expected a name such as shot_Scene_0001_{FRAME_FILES[name]}")
        return result

    @property
    def stem(self):
        """The start of the names of the frame's files."""
        return self.record.name.removesuffix(f"_{RECORD_END}")

    def written_by(self, request):
        """The files of the frame that a RenderRequest writes, except its record: list of Path."""
        absent = {"record", *(name for name in SPECTRAL_FILES if not request.writes(name)),
                  *(PINHOLE_FILES if request.traced else ())}
        return [*(getattr(self, name) for name in FRAME_FILES if name not in absent),
                *[self.raw] * bool(request.camera and request.dng), *[self.truth] * bool(request.truth)]

    def remove(self, *names):
        """Remove files of the frame that an earlier render may have left, and that this one does not write."""
        for name in names:
            discard(getattr(self, name))
            self.report.files.pop(name, None)

    def leave_out(self, name):
        """Remove a spectral file that the request leaves out, as the report states."""
        self.remove(name)
        self.report.left_out.append(name)

    @property
    def files(self):
        """All files; a raw file and ground truth if they exist. A job writes them again or removes them."""
        return (*(getattr(self, name) for name in (*FRAME_FILES, *LENS_FILES)),
                *(path for path in (self.raw, self.truth) if path.exists()))

    @property
    def messages(self):
        """The file, the time, the plan and the remarks: list of lines."""
        seconds = sum(self.report.stages.values())
        scene, file = self.report.scene, self.report.file
        source = scene.scene_plan if scene else f"from the light in {file.radiance}"
        return [f"{self.lens_image} in {seconds:.1f} s", source, *self.report.remarks()]


def stem_of(scene):
    """The start of all file names of a scene: the names of the .blend and the scene."""
    blend = Path(bpy.data.filepath).stem or UNSAVED
    blend = blend.encode(errors="surrogateescape")[:MOST_NAME_BYTES].decode(errors="ignore")
    return bpy.path.clean_name(f"{blend}_{scene.name}")


def check_next_to_frames(folder, *paths):
    """Raise an InputError for a file in the output folder whose name is, or could become, the name of a frame.

    Parameters
    ----------
    folder : Path
    paths : Path or None
    """
    ends = "|".join(map(re.escape, (*FRAME_FILES.values(), RAW_END, TRUTH_END)))
    of_frame = re.compile(rf".+_-?\d+_({ends})", re.IGNORECASE)
    for path in filter(None, paths):
        if path.resolve().parent == folder.resolve() and of_frame.fullmatch(path.name):
            raise InputError(path, "file", "named like a rendered frame", "choose another name or folder")
