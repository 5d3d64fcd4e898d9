"""Terminal output: a progress bar, and suppression of messages from C++ libraries."""

import os
import sys
import time
from contextlib import contextmanager

from lensfield.engine.runtime.errors import printable
from lensfield.engine.runtime.messages import time_left

BAR_CELLS = 24


def say(*lines, file=None):
    """Print each line without control characters: paths, names and notes may come from untrusted files, and a terminal
    obeys the escape sequences in them."""
    for line in lines:
        print(printable(" ".join(str(line).split("\n"))), file=file, flush=True)


@contextmanager
def progress_bar():
    """A function (fraction, label) that draws a bar with the remaining time on a terminal, and nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda fraction, label: None
        return

    first = []

    def draw(fraction, label):
        first[:] = first or (fraction, time.monotonic())
        completed = (fraction - first[0]) / (1 - first[0]) if first[0] < 1 else 1.0
        left, filled = time_left(completed, time.monotonic() - first[1]), round(BAR_CELLS * fraction)
        print(f"\r[{'#' * filled}{'.' * (BAR_CELLS - filled)}] {fraction:4.0%}  {left:<11} "
              f"{printable(label):<36.36}", end="", file=sys.stderr, flush=True)

    try:
        yield draw
    finally:
        print(f"\r{'':{BAR_CELLS + 58}}\r", end="", file=sys.stderr, flush=True)


@contextmanager
def quiet(*descriptors):
    """Suppress output to these descriptors (1: standard output, 2: standard error), such as messages of Blender and
    OpenEXR's C++ code."""
    sys.stdout.flush()
    saved = [(number, os.dup(number)) for number in descriptors]
    with open(os.devnull, "w") as nowhere:
        for number in descriptors:
            os.dup2(nowhere.fileno(), number)
    try:
        yield
    finally:
        sys.stdout.flush()
        for number, original in saved:
            os.dup2(original, number)
            os.close(original)
