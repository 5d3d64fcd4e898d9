"""Which frames of a sequence are there already: each has a record, in the hidden folder beside it, written after it."""

import json
from dataclasses import asdict
from pathlib import Path

from ..engine.cache import code_version
from ..engine.files import atomic_path, discard, hidden_folder, stamp_of
from ..engine.image.whole import has_header
from ..engine.values import plain
from .sequence import Shot

OF_NO_ACCOUNT = "radiance", "output", "preview", "frames", "report", "overwrite", "run", "lens"
CODE = "bake", "blur", "depth", "field", "image", "kernels", "lens", "plan", "spectral"


def made_by(options, lens, chosen):
    """What all frames of a command line follow from, but for their files: as JSON holds it."""
    asked = {name: value if value is None else str(value) for name, value in vars(options).items()
             if name not in OF_NO_ACCOUNT}
    return plain({"asked": asked, "options": asdict(chosen), "lens": lens.digest.hex(), "code": code_version(*CODE)})


def is_there(shot: Shot, first: Shot, by):
    """Whether a frame is there: all of its files, as large as they were written and with their headers, and made of
    the picture that there is, by the same settings. `first` is the one that previews are exposed as."""
    try:
        record = json.loads(_record(shot).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return record == _facts(shot, first, by) and all(map(has_header, shot.targets))


def note_made(shot, first, by):
    """Note that a frame is there."""
    with atomic_path(_record(shot), own=True) as temporary:
        temporary.write_text(json.dumps(_facts(shot, first, by)) + "\n", encoding="utf-8")


def when_noted(shot):
    """What is another one as soon as the frame is made again; None where it never was."""
    return stamp_of(_record(shot))


def forget_made(shot):
    """Forget a frame that is about to be made again."""
    discard(_record(shot))


def _record(shot):
    return hidden_folder(shot.output.parent) / f"{shot.output.name}.json"


def _facts(shot, first, by):
    read = [shot.radiance, *([first.radiance] if shot.preview else [])]
    return {"by": by, "of": [_told(path, path.stat().st_mtime_ns) for path in read],
            "files": [_told(path) for path in shot.targets]}


def _told(path: Path, *more):
    return [path.name, path.stat().st_size if path.is_file() else None, *more]
