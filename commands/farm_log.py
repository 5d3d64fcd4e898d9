"""What a command tells a render farm whose task it is: lines of the task's log, as each farm reads them.

Nobody else writes at the beginning of these lines: what names of scenes and files hold stays within one.
"""

import os
import sys
from contextlib import contextmanager
from pathlib import Path

from ..engine.errors import shown

PACE_S = 5.0  # between two lines: logs are kept, and paid for
LONGEST = 240  # characters of a label
LENS_IMAGE, PICTURE = "lens_image.exr", "after.png"


def openjd_lines(facts):
    """As Open Job Description has it, and with it AWS Deadline Cloud."""
    if "fraction" in facts:
        yield f"openjd_progress: {100 * facts['fraction']:.1f}"
        yield f"openjd_status: {shown(facts['label'], LONGEST)}"
    if "error" in facts:
        yield f"openjd_fail: {shown(facts['error'], LONGEST)}"


def flamenco_lines(facts):
    """As Flamenco's workers take them from Blender: each frame is a step, and its picture is shown by the Manager."""
    if "fraction" in facts:
        yield f"{facts['fraction']:.0%} {shown(facts['label'], LONGEST)}"
    if "seconds" in facts:
        yield f"Saved: '{Path(facts['lens_image'].removesuffix(LENS_IMAGE) + PICTURE)}'"
        yield f"Time: {facts['seconds']:.1f}"
    elif "lens_image" in facts:
        yield f"Skipping existing frame: {facts['lens_image']}"


FARM_LOGS = {"openjd": openjd_lines, "flamenco": flamenco_lines}
"""The farms that read what a task tells, and how each is told it: facts, as messages.py has them, to lines."""


@contextmanager
def farm_log(lines):
    """A function that writes the lines of the facts that it is given, at once, on standard output as it now is."""
    sys.stdout.flush()
    with open(os.dup(1), "w", encoding="utf-8", errors="backslashreplace") as log:
        yield lambda **facts: print(*lines(facts), sep="\n", end="\n" * any(lines(facts)), file=log, flush=True)
