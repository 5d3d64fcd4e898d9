"""The record of a finished frame: a JSON file, written after the frame's files.

It states the job that the files come from, their sizes, and the build that wrote them. With records, a sequence resumes
where it stopped, and makes damaged or outdated frames again.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..runtime.build_identity import build_identity, software
from ..runtime.errors import ImageError, InputError
from ..runtime.files import atomic_path, file_status
from ..runtime.versions import check_version
from .spectral_exr import read_parts

FORMAT, VERSION = "lensfield-record", 1
RECORD_END, PICTURE_END, TRUTH_END = "report.json", "after.png", "truth.exr"
"""Ends of the names of a rendered frame's record, picture and ground truth."""
SIGNATURES = {".png": b"\x89PNG\r\n\x1a\n", ".dng": b"II*\0"}


def write_record(record: Path, job: dict[str, Any], files: Iterable[Path],
                 facts: Mapping[str, Any] | None = None) -> None:
    """Record that a frame is finished.

    Parameters
    ----------
    record : Path
    job : dict
        Everything that the files depend on, except the build, as `json_value` returns it.
    files : iterable of Path
    facts : mapping, optional
        Others that the record states, such as a report.
    """
    contents = {"format": FORMAT, "version": VERSION, "software": software(), "build": build_identity()}
    contents |= dict(facts or {}) | {"job": job, "sizes": _sizes(files)}
    with atomic_path(record) as temporary:
        temporary.write_text(json.dumps(contents, indent=2) + "\n", encoding="utf-8")


def read_record(record: Path, job: dict[str, Any], files: Iterable[Path]) -> dict[str, Any] | None:
    """The contents of a frame's record if these files have their recorded sizes and their headers, and come from this
    job; else None. The frame may have more files.

    Its "build" identifies the build that wrote the files, which may differ from this one.

    Raises
    ------
    InputError
        The record is from a newer version of Lensfield.
    """
    files, contents = list(files), _contents(record)
    sizes = contents.get("sizes")
    finished = (isinstance(contents.get("build"), str) and contents.get("job") == job and isinstance(sizes, dict)
                and _sizes(files).items() <= sizes.items()
                and all(has_header(path) for path in files if path.is_file()))
    return contents if finished else None


def check_left_out(path: Path, kind: str) -> None:
    """Raise an InputError if a spectral file of a frame, "radiance" or "irradiance", is missing because its render left
    it out, as `--files` requested."""
    if not path.exists():
        left_out = _contents(path.with_name(path.name.removesuffix(f"{kind}.exr") + RECORD_END)).get("left_out")
        if isinstance(left_out, list) and kind in left_out:
            raise InputError(path, f"{kind} file", "left out of the frame's files",
                             f"write the frame again with --files {kind} or all")


def _contents(record):
    """The contents of a record; an empty dict if it is missing or damaged."""
    try:
        contents = json.loads(record.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(contents, dict):
        return {}
    check_version(record, contents.get("version", VERSION), [VERSION])
    return contents


def _sizes(files):
    """Sizes in bytes by name; None for a file that does not exist."""
    return {path.name: (status := file_status(path)) and status.st_size for path in files}


def has_header(path: Path) -> bool:
    """Whether an EXR's header is readable, or a PNG or DNG has its signature: after a disk failure a file may be all
    zeros."""
    if signature := SIGNATURES.get(path.suffix.lower()):
        with open(path, "rb") as file:
            return file.read(len(signature)) == signature
    try:
        return bool(read_parts(path, header_only=True))
    except ImageError:
        return False
