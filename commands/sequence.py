"""The pictures that a command line names: one, or the frames of a sequence such as shot_####.exr or shot_%04d.exr."""

import re
from dataclasses import dataclass
from pathlib import Path

from lensfield.engine import InputError
from lensfield.engine.runtime.errors import absence
from lensfield.engine.runtime.files import file_status, hidden_folder

NUMBER = re.compile(r"#+|%(?:0(\d+))?d")
FRAMES = re.compile(r"(-?\d{1,15})(?:-(-?\d{1,15})(?::(\d{1,15}))?)?")
MOST_FRAMES = 1 << 21  # Blender's limit
MOST_NAMED = 5


@dataclass(frozen=True)
class Shot:
    """A picture to filter, and the files to write; `frame` is None outside a sequence."""

    radiance: Path
    output: Path
    preview: Path | None = None
    frame: int | None = None

    @property
    def targets(self):
        return [path for path in (self.output, self.preview) if path]

    @property
    def record(self):
        """The record of a finished frame."""
        return hidden_folder(self.output.parent) / f"{self.output.name}.json"

    def sources(self, first):
        """The pictures that the files are made of, if the frame `first` sets the exposure of the previews: list of
        [name, bytes, time]."""
        read = [self.radiance, *([first.radiance] if self.preview else [])]
        return [[path.name, status.st_size, status.st_mtime_ns] for path in read for status in [path.stat()]]


def parse_frames(text):
    """Parse frames: one frame, a range such as 1-50, a range with a step such as 1-50:2, or a list such as 1,5,10-20.

    Returns
    -------
    list of int
        Ascending and unique.

    Raises
    ------
    InputError
        The text is invalid, or names more than MOST_FRAMES frames.
    """
    parts = [FRAMES.fullmatch(part.strip()) for part in text.split(",")]
    bounds = [(int(part[1]), int(part[2] or part[1]), int(part[3] or 1)) for part in parts if part]
    if not all(parts) or any(first > last or not step for first, last, step in bounds):
        raise InputError("options", "--frames", text,
                         "expected a range such as 1-50 or 1-50:2, one frame, or several of these such as 1,5,10-20")
    if sum((last - first) // step + 1 for first, last, step in bounds) > MOST_FRAMES:
        raise InputError("options", "--frames", text, f"expected no more than {MOST_FRAMES} frames")
    return sorted({frame for first, last, step in bounds for frame in range(first, last + 1, step)})


def frames_text(frames):
    """Format ascending frames for `parse_frames`, such as 1-3,5."""
    ranges = []
    for frame in frames:
        if ranges and frame == ranges[-1][1] + 1:
            ranges[-1][1] = frame
        else:
            ranges.append([frame, frame])
    return ",".join(f"{first}-{last}" if last > first else f"{first}" for first, last in ranges)


def find_shots(radiance, output, preview=None, frames=None):
    """The pictures that a command line names, in order.

    A name that exists as a file means that file. Otherwise a run of #, or %04d, is a placeholder for the frame number.

    Parameters
    ----------
    radiance, output, preview : Path
    frames : str, optional
        In the syntax of `parse_frames`; by default all existing frames.

    Raises
    ------
    InputError
        Frames are missing, or a name of a sequence does not have exactly one placeholder.
    """
    if file_status(radiance) or not NUMBER.search(radiance.name):
        if frames is not None:
            raise InputError("options", "--frames", frames, f"{radiance} is not a sequence such as shot_####.exr")
        shots = [Shot(radiance, output, preview)]
    else:
        for path in filter(None, (radiance, output, preview)):
            if len(NUMBER.findall(path.name)) != 1:
                raise InputError(path, "name", path.name, "expected one run of # or %04d for the frame number")
        numbers = _numbers(radiance) if frames is None else _chosen(radiance, frames)
        shots = [Shot(*(path and _of_frame(path, number) for path in (radiance, output, preview)), number)
                 for number in numbers]
    return shots


def _of_frame(pattern, number):
    """The file of one frame."""
    match = NUMBER.search(pattern.name)
    digits = int(match[1] or 1) if match[0].startswith("%") else len(match[0])
    return pattern.with_name(f"{pattern.name[:match.start()]}{number:0{digits}d}{pattern.name[match.end():]}")


def _numbers(pattern):
    """The existing frames, ascending."""
    match = NUMBER.search(pattern.name)
    name = re.compile(re.escape(pattern.name[:match.start()]) + r"(-?\d+)" + re.escape(pattern.name[match.end():]))
    files = pattern.parent.iterdir() if pattern.parent.is_dir() else ()
    numbers = [int(matched[1]) for path in files if (matched := name.fullmatch(path.name)) and path.is_file()]
    numbers = sorted({number for number in numbers if _of_frame(pattern, number).is_file()})  # 007 does not match ##
    if not numbers:
        raise InputError(pattern, "file", absence(pattern), "no frame of this sequence exists")
    return numbers


def _chosen(pattern, frames):
    """The requested frames; raises an InputError if any is missing."""
    requested, existing = parse_frames(frames), set(_numbers(pattern))
    missing = [str(number) for number in requested if number not in existing]
    if missing:
        named = ", ".join(missing[:MOST_NAMED]) + (", ..." if len(missing) > MOST_NAMED else "")
        raise InputError(pattern, "--frames", frames, f"missing {len(missing)} of {len(requested)} frames: {named}")
    return requested
