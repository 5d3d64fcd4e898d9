"""What the tests of farms share: the command, what is asked of it, and who is at work on that."""

import sys
import time
from pathlib import Path

LENSFIELD = [sys.executable, "-c", "from lensfield.cli import console; console()"]
ASKED = ["--frames", "1-2", "--lens-quality", "preview", "--resolution", "64x48", "--samples", "128"]
PATIENCE_S = 240.0  # of a machine with much else to do


def wait(holds):
    """Wait until something holds; what it is."""
    end = time.monotonic() + PATIENCE_S
    while not (found := holds()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return found


def passes(folder):
    return list(folder.glob(".lensfield/*_passes/*/*.exr"))


def renders(folder):
    """Processes that render into a folder, for a farm."""
    return [int(path.parent.name) for path in Path("/proc").glob("[0-9]*/cmdline")
            if f"--output={folder}" in _words(path)]


def _words(path):
    try:
        return path.read_text(errors="replace").split("\0")
    except OSError:  # it has ended
        return []
