"""Messages from a task to its render farm: lines of the task's log, in each farm's syntax.

Names of scenes and files cannot break a line, so they cannot imitate such a message.
"""

import os
import sys
from contextlib import contextmanager
from pathlib import Path

from lensfield.engine.runtime.errors import shown

PACE_S = 5.0  # between lines: farms store logs and charge for them
LONGEST = 240  # characters of a label
LENS_IMAGE, PICTURE = "lens_image.exr", "after.png"


def openjd_lines(facts):
    """Lines for Open Job Description, which AWS Deadline Cloud uses."""
    if "fraction" in facts:
        yield f"openjd_progress: {100 * facts['fraction']:.1f}"
        yield f"openjd_status: {shown(facts['label'], LONGEST)}"
    if "error" in facts:
        yield f"openjd_fail: {shown(facts['error'], LONGEST)}"


def flamenco_lines(facts):
    """Lines that Flamenco's workers expect from Blender: each frame is a step, and the Manager shows its picture."""
    if "fraction" in facts:
        yield f"{facts['fraction']:.0%} {shown(facts['label'], LONGEST)}"
    if "seconds" in facts:
        yield f"Saved: '{Path(facts['lens_image'].removesuffix(LENS_IMAGE) + PICTURE)}'"
        yield f"Time: {facts['seconds']:.1f}"
    elif "lens_image" in facts:
        yield f"Skipping existing frame: {facts['lens_image']}"


FARM_LOGS = {"openjd": openjd_lines, "flamenco": flamenco_lines}
"""Functions that convert facts (see messages.py) to lines, for each farm that reads progress."""


@contextmanager
def farm_log(lines):
    """A function that writes facts as lines immediately, to the standard output of this moment, even if that is later
    redirected."""
    sys.stdout.flush()
    with os.fdopen(os.dup(1), "w", encoding="utf-8", errors="backslashreplace") as log:
        yield lambda **facts: print(*lines(facts), sep="\n", end="\n" * any(lines(facts)), file=log, flush=True)
