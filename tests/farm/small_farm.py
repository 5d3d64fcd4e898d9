"""Helpers of the farm tests: the command, its arguments, and its running processes."""

import sys
from pathlib import Path

LENSFIELD = [sys.executable, "-c", "from lensfield.cli import console; console()"]
OPTIONS = ["--frames", "1-2", "--lens-quality", "preview", "--resolution", "64x48", "--samples", "128"]


def passes(folder):
    """The stored passes, without half-written ones, which a killed render removes."""
    return list(folder.glob(".lensfield/*_passes/*/[!.]*.exr"))


def interrupted(folder):
    """Whether a render of two frames has begun, but not ended. A frame's end deletes its passes."""
    first, second = (folder / f"ein_ende_Scene_000{number}_report.json" for number in (1, 2))
    return bool(passes(folder) or first.exists()) and not second.exists()


def renders(folder):
    """Processes that render into a folder for a farm."""
    return [int(path.parent.name) for path in Path("/proc").glob("[0-9]*/cmdline")
            if f"--output={folder}" in _words(path)]


def _words(path):
    try:
        return path.read_text(errors="replace").split("\0")
    except OSError:  # the process has ended
        return []
