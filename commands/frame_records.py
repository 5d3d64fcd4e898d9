"""Records of the finished frames of a sequence, written after each frame into the hidden folder next to it."""

import json
from dataclasses import asdict
from pathlib import Path

from ..engine.pictures.header_check import has_header
from ..engine.runtime.build_identity import build_identity
from ..engine.runtime.files import atomic_path, discard, file_status, hidden_folder, stamp_of
from ..engine.runtime.values import json_value
from .sequence import Shot

UNRECORDED = ("radiance", "output", "preview", "frames", "report", "overwrite", "any_build", "lens", "untrusted",
              "root", "time_limit", "memory_limit")


def request_facts(options, lens, chosen):
    """Everything that the frames of a command line depend on, except their files, as JSON values."""
    arguments = {name: value if value is None else str(value) for name, value in vars(options).items()
                 if name not in UNRECORDED and not callable(value)}
    return json_value({"arguments": arguments, "options": asdict(chosen), "lens": lens.digest.hex()})


def recorded_build(shot: Shot, first: Shot, by):
    """The identity of the build that finished a frame; None unless all of its files exist with their recorded sizes
    and their headers, and come from the present picture and the same settings.

    Parameters
    ----------
    shot : Shot
    first : Shot
        The frame that sets the exposure of the previews.
    by : dict
        From `request_facts`.
    """
    try:
        record = json.loads(_record(shot).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    build = record.pop("build", None) if isinstance(record, dict) else None
    finished = build and record == _facts(shot, first, by) and all(map(has_header, shot.targets))
    return build if finished else None


def record_frame(shot, first, by):
    """Record that a frame is finished."""
    with atomic_path(_record(shot), overwrite=True) as temporary:
        temporary.write_text(json.dumps({"build": build_identity()} | _facts(shot, first, by)) + "\n", encoding="utf-8")


def record_stamp(shot):
    """A stamp that changes when the frame is filtered again; None without a record."""
    return stamp_of(_record(shot))


def remove_record(shot):
    """Remove the record of a frame that is about to be filtered again."""
    discard(_record(shot))


def _record(shot):
    return hidden_folder(shot.output.parent) / f"{shot.output.name}.json"


def _facts(shot, first, by):
    read = [shot.radiance, *([first.radiance] if shot.preview else [])]
    return {"by": by, "of": [_identity(path, path.stat().st_mtime_ns) for path in read],
            "files": [_identity(path) for path in shot.targets]}


def _identity(path: Path, *more):
    status = file_status(path)
    return [path.name, status and status.st_size, *more]
